"""The list of all solvers. A new solver needs one entry here.

The command line, `stability` and the shared tests read this list.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

from symmb._errors import DeclarationError
from symmb._specs import Spec, read_spec
from symmb.run.integrate.casadi_solvers import CVODES, IDAS, Collocation, StabilizedIndex2
from symmb.run.integrate.event_driven import EventDriven
from symmb.run.integrate.explicit import DormandPrince, RungeKutta
from symmb.run.integrate.implicit import Rosenbrock
from symmb.run.integrate.position_schemes import BDFI3, HHT, NSTIFFSI2, GeneralizedAlpha, Newmark
from symmb.run.integrate.solver import Solver
from symmb.run.integrate.stabilization import AugmentedLagrangian, Baumgarte, Projection
from symmb.run.integrate.state_space import StateSpace


@dataclass(frozen=True)
class SolverEntry(Spec):
    """The entry of a solver for the command line, for `stability` and for the shared tests.

    Attributes
    ----------
    ladder : (number, horizon [s]) -> Solver    solver with this relative tolerance or number of steps, for `stability`
    tolerances : bool                           whether the number is a relative tolerance
    accurate : Solver                           solver with six correct digits in smooth motions of some seconds
    """

    ladder: Callable[[float, float], Solver] | None = None
    tolerances: bool = False
    accurate: Solver | None = None

    @property
    def family(self) -> str:
        """Name of the class, followed by "stiff" for stiff solvers."""
        return self.text.split("(")[0] + (", stiff" if "stiff=True" in self.text else "")


def _by_tolerance(form: str, solver: Solver, text: str, accurate: float | None, ladder: bool = True) -> SolverEntry:
    def at(rtol: float = solver.rtol) -> Solver:  # pyright: ignore[reportAttributeAccessIssue]
        return replace(solver, rtol=rtol)  # pyright: ignore[reportArgumentType]

    exact = None if accurate is None else at(accurate)
    return SolverEntry(form, text, at, (lambda rtol, _: at(rtol)) if ladder else None, True, exact)


def _by_step(form: str, kind: Callable[..., Solver], name: str, accurate: float) -> SolverEntry:
    return SolverEntry(
        form, f"{name}(step=STEP)", kind, lambda n, horizon: kind(step=horizon / n), False, kind(step=accurate)
    )


SOLVERS: tuple[SolverEntry, ...] = (
    _by_tolerance("dopri[:RTOL]", DormandPrince(), "DormandPrince(rtol=RTOL)", 1e-11),
    _by_tolerance("cvodes[:RTOL]", CVODES(), "CVODES(rtol=RTOL)", 1e-11),
    _by_tolerance("cvodes:stiff[:RTOL]", CVODES(stiff=True), "CVODES(rtol=RTOL, stiff=True)", 1e-11),
    _by_tolerance("idas[:RTOL]", IDAS(), "IDAS(rtol=RTOL)", 1e-11),
    _by_tolerance("si2[:RTOL]", StabilizedIndex2(), "StabilizedIndex2(rtol=RTOL)", 1e-9),
    SolverEntry(
        "rk[:STEPS]",
        "RungeKutta(steps=STEPS)",
        RungeKutta,
        lambda n, _: RungeKutta(steps=int(n)),
        accurate=RungeKutta(steps=2000),
    ),
    SolverEntry(
        "rosenbrock[:RTOL]",
        "Rosenbrock(rtol=RTOL)",
        Rosenbrock,
        lambda n, horizon: Rosenbrock(step=horizon / n),
        accurate=Rosenbrock(rtol=1e-9),
    ),
    _by_step("nstiff-si2[:STEP]", NSTIFFSI2, "NSTIFFSI2", 1e-3),
    SolverEntry("nstiff-si2:tol=RTOL", "NSTIFFSI2(step=1.0, rtol=RTOL)", lambda rtol: NSTIFFSI2(1.0, rtol)),
    _by_step("gen-alpha[:STEP]", GeneralizedAlpha, "GeneralizedAlpha", 1e-3),
    _by_step("hht[:STEP]", HHT, "HHT", 1e-3),
    _by_step("newmark[:STEP]", Newmark, "Newmark", 2e-4),
    _by_step("bdf-i3[:STEP]", BDFI3, "BDFI3", 1e-3),
    SolverEntry("collocation", "Collocation()", Collocation, accurate=Collocation(steps=100)),
    _by_tolerance("state-space[:RTOL]", StateSpace(), "StateSpace(rtol=RTOL)", None, ladder=False),
    _by_tolerance("events[:RTOL]", EventDriven(), "EventDriven(rtol=RTOL)", None, ladder=False),
)
WORDS: dict[str, tuple[str, Any]] = {
    "stiff": ("stiff", True),
    "baumgarte": ("stabilization", Baumgarte()),
    "projection": ("stabilization", Projection()),
    "lagrangian": ("stabilization", AugmentedLagrangian()),
}
"""Word on the command line -> name and value of the option of the solver that the word sets."""


def read_solver(text: str) -> Solver:
    """The solver that a text such as "cvodes:1e-8" or "dopri:1e-8:projection" names.

    Raises
    ------
    DeclarationError    if the text has no known form, or its numbers are out of range

    Examples
    --------
    >>> read_solver("cvodes:stiff"), read_solver("rosenbrock:1e-5:lagrangian").stabilization.omega
    (CVODES(stiff=True), 100.0)
    """
    parts = text.split(":")
    if parts[0] in WORDS:
        raise DeclarationError(f"The solver {text!r}: {parts[0]!r} is an option. Write the name of a solver first.")
    words = [WORDS[word] for word in parts if word in WORDS]
    options = dict(words)
    if len(options) < len(words):
        raise DeclarationError(f"The solver {text!r} sets an option twice.")
    solver = read_spec(":".join(part for part in parts if part not in WORDS), SOLVERS, "solver")
    known = {f.name for f in fields(solver)}
    unknown = [word for word in parts if word in WORDS and WORDS[word][0] not in known]
    if unknown:
        raise DeclarationError(f"The solver {text!r}: {type(solver).__name__} has no option {unknown[0]!r}.")
    return replace(solver, **options)
