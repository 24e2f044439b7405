"""The reference solution for the trials of a scene, or the reason why there is no reference."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symmb._magnitudes import NOTHING, ROUNDING
from symmb._types import Array
from symmb.study.ladders import CONTROLLED, FILTERING
from symmb.study.trials import Trial, by_family, by_reason

AGREEMENT = 1e-4
"""Largest difference of two runs that confirm each other. The runs have two tolerances, or two solvers."""
_FILTERED = 4e-4
"""Largest uncertainty of a solution without fast oscillations. Errors below 1e-3, known to 4e-4, can then be stated."""
_DAMPED = 0.03
"""Largest velocities of the oscillations that may be left out, divided by the largest velocities."""
_LOST = 1e-4
"""Largest accepted drift of energy of a solution, relative to the largest kinetic energy."""


@dataclass(frozen=True, eq=False)
class Standard:
    """A confirmed solution of one scene: two tolerances of one solver agree, and energy is conserved.

    Attributes
    ----------
    values : (n_t, n_y) array    outputs; empty without a confirmed solution
    units : n_y texts            units of the outputs
    uncertainty : float          `distance` of the coarser run, or of the closest run of another solver if larger
    fault : str                  reason why there is no confirmed solution; empty if there is one
    damped : float               velocities of fast oscillations that the solution does not contain, because its solvers
                                 damp them, divided by the largest velocities; nan if it contains them
    """

    values: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    units: tuple[str, ...] = ()
    uncertainty: float = float("nan")
    fault: str = ""
    damped: float = float("nan")

    def error(self, trial: Trial) -> float | None:
        """The error of a run, but not less than the uncertainty; None if the run failed, or without a reference."""
        if self.fault or trial.reason:
            return None
        return max(distance(trial.values, self.values, self.units), self.uncertainty)


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two runs of one solver, and their distance."""

    coarse: Trial
    fine: Trial
    apart: float


def standard_of(trials: Sequence[Trial], units: tuple[str, ...]) -> Standard:
    """The solution on which runs of one scene with adaptive solvers agree.

    For each solver, the finished runs with the two smallest tolerances are compared. Solvers with a small difference
    must also agree with each other. If no such solver finishes, a solution without fast oscillations may be found.
    """
    found = _standard_of(trials, units)
    other = _filtered(trials, units) if found.fault else None
    if other is None or not other.damped > _DAMPED:
        return other or found
    lost = f"solvers with fixed steps agree, but damp oscillations with {other.damped:.1g} of the largest velocity"
    return replace(found, fault=f"{found.fault}; {lost}")


def _filtered(trials: Sequence[Trial], units: tuple[str, ...]) -> Standard | None:
    """The solution on which two solvers that damp fast oscillations agree, each with two steps; None if they do not.

    The energy that a run has lost is at least that of the oscillations, so that the square root of its share bounds the
    share of their velocities.
    """
    pairs = _pairs([trial for trial in trials if trial.family in FILTERING], units)
    if len(pairs) < 2:
        return None
    best = pairs[0].fine
    apart = max(pairs[0].apart, *(distance(pair.fine.values, best.values, units) for pair in pairs[1:]))
    return Standard(best.values, units, apart, damped=best.energy**0.5) if apart <= _FILTERED else None


def _standard_of(trials: Sequence[Trial], units: tuple[str, ...]) -> Standard:
    """The solution on which solvers with tolerances agree."""
    trials = [trial for trial in trials if trial.family in CONTROLLED]
    pairs = _pairs(trials, units)
    reasons = {trial.reason for trial in trials}
    # If all fail for the same reason, which is not time, the scene is the cause.
    if len(reasons) == 1 and reasons != {""} and not trials[0].slow:
        return Standard(fault=reasons.pop())
    if not pairs:
        return Standard(fault=f"no solver finishes at two tolerances ({by_reason(trials)})")
    confirmed = [pair for pair in pairs if pair.apart <= AGREEMENT and not pair.fine.energy > _LOST]
    if not confirmed:
        return Standard(fault=_fault(pairs, units))
    best = confirmed[0].fine
    away = [distance(pair.fine.values, best.values, units) for pair in confirmed[1:]]
    if max(away, default=0.0) > AGREEMENT:
        other = confirmed[1 + int(np.argmax(away))].fine
        return Standard(fault=f"{best.solver} and {other.solver} differ by {max(away):.1g} of the motion")
    return Standard(best.values, units, max(confirmed[0].apart, min(away, default=0.0)))


def _pairs(trials: Sequence[Trial], units: tuple[str, ...]) -> list[_Pair]:
    """For each solver, the finished runs with the two smallest tolerances, sorted by their difference."""
    pairs = list[_Pair]()
    for some in by_family(trials).values():
        finished = sorted((trial for trial in some if not trial.reason), key=lambda trial: -trial.setting)
        if len(finished) > 1:
            coarse, fine = finished[-2:]
            pairs.append(_Pair(coarse, fine, distance(coarse.values, fine.values, units)))
    return sorted(pairs, key=lambda pair: pair.apart)


def _fault(pairs: Sequence[_Pair], units: tuple[str, ...]) -> str:
    """The reason why the pair with the smallest difference is not confirmed."""
    agreeing = [pair for pair in pairs if pair.apart <= AGREEMENT]
    if agreeing:
        best = min(agreeing, key=lambda pair: pair.fine.energy).fine
        return f"the energy of {best.solver} is off by {best.energy:.1g} of the largest kinetic energy"
    best = pairs[0]
    away = np.abs(best.coarse.values - best.fine.values) / _deviation(best.fine.values, units)
    first = best.fine.times[int(np.argmax((away > AGREEMENT).any(axis=1)))]
    return (
        f"{best.coarse.solver} and {best.fine.solver}, which agree best, differ from t = {first:.3g} s on, "
        f"by {best.apart:.1g} of the motion"
    )


def distance(values: Array, true: Array, units: Sequence[str]) -> float:
    """Rms difference divided by the rms deviation from the mean; the largest value over all outputs."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.sqrt(np.mean(np.square(values - true), axis=0)) / _deviation(true, units)
    return float(np.nan_to_num(error, nan=np.inf, posinf=np.inf).max(initial=0.0))


def _deviation(true: Array, units: Sequence[str]) -> Array:
    """Root mean square deviation of each output from its mean (n_y,).

    If an output is constant up to rounding, the result is its largest value. If this value is 0 up to rounding, the
    result is the largest value of all outputs with the same unit.
    """
    largest, deviation = np.abs(true).max(axis=0), np.std(true, axis=0)
    of_unit = np.array([max(largest[k] for k in range(len(units)) if units[k] == unit) for unit in units])
    constant = np.where(largest > ROUNDING * of_unit, largest, np.maximum(of_unit, NOTHING))
    return np.where(deviation > ROUNDING * of_unit, deviation, constant)
