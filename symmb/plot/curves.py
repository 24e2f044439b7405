"""What pictures show: a band of reference bounds, and one curve for each method."""

import re
from dataclasses import dataclass

from symmb._types import Array


@dataclass(frozen=True)
class Band:
    """What is filled, the reference of a comparison for one: lower, upper (n_t, n_y)."""

    label: str
    lower: Array
    upper: Array


@dataclass(frozen=True)
class PlottedBounds:
    """Bounds by one setting of one family of methods: lower, upper (n_t, n_y), error (n_y,), run time [s]."""

    family: str
    label: str
    kind: str
    lower: Array
    upper: Array
    error: Array
    evaluations: int
    seconds: float


def family(name: str) -> str:
    """The method without the numbers that set its resolution.

    Examples
    --------
    >>> family("PolynomialChaos.paper(order=2)"), family("MonteCarlo(1000, sampler=Sobol())")
    ('PolynomialChaos.paper', 'MonteCarlo(sampler=Sobol())')
    """
    constructor, _, options = name.partition("(")
    shown = [option for option in options.removesuffix(")").split(", ") if re.search(r"[a-z]+\(|=[A-Z]", option)]
    return f"{constructor}({', '.join(shown)})" if shown else constructor
