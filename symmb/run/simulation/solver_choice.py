"""Choice of the solver by pilot runs, with its reason, if none is given."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from symmb.run.codegen import REASONS, FailureCode, has_compiler, with_compiler
from symmb.run.integrate import CVODES, AugmentedLagrangian, DormandPrince, Rosenbrock, Solver

MANY = 20_000
"""Steps of a run beyond which an implicit solver may be faster."""

_SMOOTH, _SWITCHING, _STIFF = CVODES(), DormandPrince(), CVODES(stiff=True)
_TIGHTER, _COMPILED = CVODES(rtol=1e-12, stiff=True), (Rosenbrock(), DormandPrince())
"""Of stiff scenes."""
_SINGULAR = (DormandPrince(stabilization=AugmentedLagrangian()),)
"""The solver that passes singular positions of scenes that are not stiff."""
_THROUGH = CVODES(stiff=True, stabilization=AugmentedLagrangian())
"""That of those that are."""
_MANY_RUNS = CVODES(rtol=1e-8)
"""That of studies without a C compiler: as accurate as DormandPrince()."""


@dataclass(frozen=True)
class Pilot:
    """A run at the nominal parameters: why it failed, steps, run time [s], why others may be faster or better.

    `drift` is what the doubt is about, over the largest drift that raises none.
    """

    message: str
    steps: int
    seconds: float
    slow: bool
    doubt: str = ""
    drift: float = 0.0

    @property
    def succeeds(self) -> bool:
        """Whether it did not fail, and nothing about it is doubtful."""
        return not (self.message or self.doubt)


class Candidates(NamedTuple):
    """Candidates for a scene: the first one, one that may be faster, and those that may not fail."""

    first: Solver
    implicit: Solver
    others: tuple[Solver, ...]


def for_studies() -> Candidates:
    """Candidates for many runs."""
    if not has_compiler():
        return Candidates(_MANY_RUNS, *for_one_run(False, False)[1:])
    return Candidates(DormandPrince(), Rosenbrock(), (*_SINGULAR, Rosenbrock(stabilization=AugmentedLagrangian())))


def for_one_run(stiff: bool, switches: bool) -> Candidates:
    """Candidates for one run. With switches of time or state, steps should end there."""
    if stiff:
        return Candidates(_STIFF, _STIFF, (_TIGHTER, *(_COMPILED if has_compiler() else ()), _THROUGH))
    if not has_compiler():
        return Candidates(_SMOOTH, _STIFF, (CVODES(stabilization=AugmentedLagrangian()), _THROUGH))
    return Candidates(_SWITCHING if switches else _SMOOTH, _STIFF, (_SWITCHING, *_SINGULAR, _THROUGH))


def choose(candidates: Callable[[], Candidates], pilot: Callable[[Solver], Pilot]) -> tuple[Solver, str]:
    """The solver with which pilot runs succeed, or the faster one if the first is slow, and the reason."""
    choice = partial(_choice, candidates, pilot)
    return with_compiler(choice, choice)  # the candidates are others if no compiler builds the first


def _choice(candidates: Callable[[], Candidates], pilot: Callable[[Solver], Pilot]) -> tuple[Solver, str]:
    first, implicit, others = candidates()
    run = pilot(first)
    if REASONS[FailureCode.STICKS] in run.message:  # no motion goes on
        return first, _fault(first, run)
    if not run.succeeds:
        return _replaced(first, run, (*others, implicit), pilot)
    if not run.slow or implicit == first:
        return first, _count(run)
    other = pilot(implicit)
    if not other.succeeds:
        return first, f"{_count(run)}; {implicit!r}: {other.message or other.doubt}"
    times = run.seconds / other.seconds
    if times > 1:
        return implicit, f"{first!r} takes {run.steps} steps and {times:.1f} times as long"
    return first, f"{_count(run)}; {implicit!r} takes {1 / times:.1f} times as long"


def _replaced(
    failed: Solver, run: Pilot, others: Sequence[Solver], pilot: Callable[[Solver], Pilot]
) -> tuple[Solver, str]:
    """The first of the others that succeeds in the place of one that does not, or the one that drifts least."""
    runs, verdicts = {failed: run}, [_fault(failed, run)]
    for solver in others:
        if solver not in runs:
            run = runs[solver] = pilot(solver)
            if run.succeeds:
                return solver, "; ".join([*verdicts, _count(run)])
            verdicts.append(_fault(solver, run))
    finished = [solver for solver, run in runs.items() if not run.message]
    return min(finished, key=lambda solver: runs[solver].drift, default=failed), "; ".join(verdicts)


def _fault(solver: Solver, run: Pilot) -> str:
    return f"{solver!r} breaks down: {run.message}" if run.message else f"{solver!r}: {run.doubt}"


def _count(run: Pilot) -> str:
    return f"a pilot run took {run.steps} steps" if run.steps else "a pilot run finishes"
