"""Colours of methods, solvers, curves and bodies. A method has the same colour in every picture."""

from zlib import crc32

COLOURS = ("#0b6fb8", "#d1495b", "#2e8b57", "#e08e00", "#7a4fb5", "#4b5563", "#00929c", "#9c5a2d")
"""Colours of methods. Line style and marker differ too, for readers who cannot distinguish red and green."""
PALETTE = (*COLOURS, "#c2428d", "#7d8b1a", "#3d5a80", "#d9772b", "#5aa36f", "#8f9bb3")
"""`COLOURS`, and further colours for pictures with more lines."""
_METHODS = (
    "PolynomialChaos",
    "PolynomialChaos.paper",
    "Taylor",
    "MonteCarlo",
    "Scanning",
    "Vertex",
    "Optimization",
    "Swarm",
    "IntervalArithmetic",
    "TaylorModel",
)
_SOLVERS = (
    "DormandPrince",
    "CVODES",
    "Rosenbrock",
    "IDAS",
    "StabilizedIndex2",
    "NSTIFFSI2",
    "GeneralizedAlpha",
    "HHT",
    "CVODES, stiff",
    "Newmark",
    "BDFI3",
    "RungeKutta",
    "Collocation",
    "StateSpace",
)
BAND_COLOUR = "#c9d3dd"
RUN_COLOUR = "#1f2937"
"""Colour of curves that are not bounds by a method: reference bounds, and single runs."""


def colour_of(family: str) -> str:
    """The colour of a method or a solver. The colour depends only on the name, not on other curves of the picture.

    Examples
    --------
    >>> colour_of("Taylor") == colour_of("Taylor(subintervals=4)"), colour_of("Taylor") == colour_of("MonteCarlo")
    (True, False)
    """
    for names in (_METHODS, _SOLVERS):
        for name in (family, family.partition("(")[0]):
            if name in names:
                return PALETTE[names.index(name)]
    return PALETTE[crc32(family.encode()) % len(PALETTE)]
