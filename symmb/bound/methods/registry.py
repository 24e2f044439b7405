"""The list of all bounding methods. A new method is registered here, by one entry.

The command line, `compare` and the shared tests read this list.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from symmb._specs import Spec, read_spec
from symmb.bound.methods.interval_arithmetic import IntervalArithmetic
from symmb.bound.methods.method import Method, require_method
from symmb.bound.methods.optimization import Optimization
from symmb.bound.methods.polynomial_chaos import PolynomialChaos
from symmb.bound.methods.sampling import MonteCarlo, Scanning, Vertex
from symmb.bound.methods.swarm import Swarm
from symmb.bound.methods.taylor import Taylor
from symmb.bound.methods.taylor_model import TaylorModel
from symmb.bound.nodes import ChebyshevGauss, Gauss, LatinHypercube, Leja, Sobol, SparseGrid
from symmb.bound.polynomials import HyperbolicCross, TotalDegree

MOST_RUNS = 2000
"""Default largest number of runs of a method in a comparison. A comparison then takes seconds. Monte Carlo may make
more runs."""


@dataclass(frozen=True)
class MethodEntry(Spec):
    """A method on the command line, in comparisons and in the shared tests.

    Attributes
    ----------
    compared : d -> methods     settings that `compare` runs by default for d parameters, from few runs to many
    examples : methods          settings that are tested against closed forms
    """

    compared: Callable[[int], Sequence[Method]] = lambda d: ()
    examples: tuple[Method, ...] = ()


def _adaptive(d: int) -> list[Method]:
    budget = None if d <= 2 else MOST_RUNS  # with one or two parameters, no level takes as many runs
    return [PolynomialChaos(tolerance=tolerance, budget=budget) for tolerance in (1e-1, 1e-2, 1e-3)]


METHODS: tuple[MethodEntry, ...] = (
    MethodEntry("pce", "PolynomialChaos(), adaptive", PolynomialChaos, _adaptive, (PolynomialChaos(),)),
    MethodEntry(
        "pce:tol=TOL", "PolynomialChaos(tolerance=TOL)", lambda tolerance: PolynomialChaos(tolerance=tolerance)
    ),
    MethodEntry(
        "pce:budget=RUNS",
        "PolynomialChaos(budget=RUNS)",
        lambda budget: PolynomialChaos(budget=budget),
        examples=(PolynomialChaos(budget=30),),
    ),
    MethodEntry(
        "pce:ORDER:paper",
        "PolynomialChaos.paper(order=ORDER)",
        PolynomialChaos.paper,
        lambda d: [PolynomialChaos.paper(order) for order in (2, 3, 4) if (order + 1) ** d <= MOST_RUNS],
        (
            PolynomialChaos.paper(order=2),
            PolynomialChaos.paper(order=4, lockstep=True),
            PolynomialChaos.paper(order=3, nodes=SparseGrid()),
        ),
    ),
    MethodEntry(
        "pce:ORDER",
        "PolynomialChaos(order=ORDER)",
        lambda order: PolynomialChaos(order=order),
        examples=(
            PolynomialChaos(order=4),
            PolynomialChaos(order=4, nodes=Gauss(), basis=TotalDegree()),
            PolynomialChaos(order=4, nodes=Leja()),
            PolynomialChaos(order=6, nodes=ChebyshevGauss(), basis=HyperbolicCross(q=0.75)),
        ),
    ),
    MethodEntry(
        "taylor[:ORDER]", "Taylor(order=ORDER)", Taylor, lambda d: [Taylor(2), Taylor(3)], (Taylor(2), Taylor(5))
    ),
    MethodEntry(
        "taylor:ORDER:PARTS",
        "Taylor(order=ORDER, subintervals=PARTS)",
        Taylor,
        examples=(Taylor(order=2, subintervals=4),),
    ),
    MethodEntry(
        "interval",
        "IntervalArithmetic()",
        IntervalArithmetic,
        lambda d: [IntervalArithmetic()],
        (IntervalArithmetic(),),
    ),
    MethodEntry("tm[:ORDER]", "TaylorModel(order=ORDER)", TaylorModel, examples=(TaylorModel(),)),
    MethodEntry("tm:ORDER:BOXES", "TaylorModel(order=ORDER, boxes=BOXES)", TaylorModel),
    MethodEntry(
        "scan[:POINTS]",
        "Scanning(POINTS)",
        Scanning,
        lambda d: [Scanning(k) for k in (3, 6, 11, 21) if k**d <= MOST_RUNS],
        (Scanning(21),),
    ),
    MethodEntry(
        "mc[:SAMPLES]",
        "MonteCarlo(SAMPLES)",
        MonteCarlo,
        lambda d: [MonteCarlo(100), MonteCarlo(1000), MonteCarlo(10_000)],
        (MonteCarlo(2000), MonteCarlo(500, sampler=Sobol()), MonteCarlo(500, sampler=LatinHypercube())),
    ),
    MethodEntry("vertex", "Vertex()", Vertex, lambda d: [Vertex()] if 2**d <= MOST_RUNS else [], (Vertex(),)),
    MethodEntry(
        "opt[:RUNS]",
        "Optimization(budget=RUNS)",
        Optimization,
        lambda d: [Optimization()] if 2 * (1 + d) <= Optimization().budget else [],
        (Optimization(), Optimization(budget=30)),
    ),
    MethodEntry("swarm[:PARTICLES]", "Swarm(particles=PARTICLES)", Swarm, examples=(Swarm(particles=5, steps=10),)),
)


def read_method(text: str) -> Method:
    """The method for a text such as "pce:2:paper".

    Examples
    --------
    >>> read_method("pce:2:paper"), read_method("mc:100")
    (PolynomialChaos.paper(order=2), MonteCarlo(100))
    """
    return read_spec(text, METHODS, "method")


def method_of(owner: str, method: object) -> Method:
    """The given method, or the method of a text as on the command line. Other values raise DeclarationError."""
    return read_method(method) if isinstance(method, str) else require_method(owner, method)
