"""Which solver a scene gets when none is given, by pilot runs, and why."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from symmb.codegen.build import has_compiler
from symmb.solve.compiled import DormandPrince
from symmb.solve.implicit_solvers import Rosenbrock
from symmb.solve.solvers import CVODES, Solver
from symmb.solve.stabilization import AugmentedLagrangian

MANY = 20_000
"""Steps of a run beyond which an implicit solver may be faster."""

_SINGULAR = (DormandPrince(stabilization=AugmentedLagrangian()),)
"""What goes on through singular positions if nothing is stiff."""


@dataclass(frozen=True)
class Pilot:
    """A run at the nominal parameters: what stopped it, steps, run time [s], whether others may be faster."""

    message: str
    steps: int
    seconds: float
    slow: bool


class Candidates(NamedTuple):
    """What a scene may be run by: the one tried first, what may be faster where that is slow, what else may finish."""

    first: Solver
    implicit: Solver
    others: tuple[Solver, ...]


def for_studies() -> Candidates:
    """Solvers of many runs."""
    if not has_compiler():  # which Rosenbrock needs to control its step
        return Candidates(DormandPrince(), *for_one_run(False)[1:])
    return Candidates(DormandPrince(), Rosenbrock(), (*_SINGULAR, Rosenbrock(stabilization=AugmentedLagrangian())))


def for_one_run(stiff: bool) -> Candidates:
    """Solvers of one run."""
    implicit = CVODES(stiff=True)
    through = CVODES(stiff=True, stabilization=AugmentedLagrangian())
    return Candidates(implicit if stiff else CVODES(), implicit, (*(() if stiff else _SINGULAR), through))


def choose(candidates: Candidates, pilot: Callable[[Solver], Pilot]) -> tuple[Solver, str]:
    """The solver by which pilot runs finish, the faster one where the first is slow; and why."""
    first, implicit, others = candidates
    run = pilot(first)
    if not run.message and not (run.slow and implicit != first):
        return first, _count(run)
    if not run.message:
        other = pilot(implicit)
        if other.message:
            return first, f"{_count(run)}; {implicit!r} breaks down: {other.message}"
        times = run.seconds / other.seconds
        if times > 1:
            return implicit, f"{first!r} takes {run.steps} steps and {times:.1f} times as long"
        return first, f"{_count(run)}; {implicit!r} takes {1 / times:.1f} times as long"
    told = [f"{first!r} breaks down: {run.message}"]
    for solver in dict.fromkeys((*others, implicit)):
        run = pilot(solver)
        if not run.message:
            return solver, "; ".join([*told, _count(run)])
        told.append(f"{solver!r} breaks down: {run.message}")
    return first, "; ".join(told)


def _count(run: Pilot) -> str:
    return f"{run.steps} steps in a pilot run" if run.steps else "a pilot run finishes"
