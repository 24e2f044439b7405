"""The reference solution for the trials of a scene, or the reason why there is no reference."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from symmb._magnitudes import NOTHING, ROUNDING
from symmb._types import Array
from symmb.study.ladders import CONTROLLED
from symmb.study.trials import Trial, by_family, by_reason

AGREEMENT = 1e-4
"""Largest difference of two runs that confirm each other. The runs have two tolerances, or two solvers."""


@dataclass(frozen=True, eq=False)
class Standard:
    """A confirmed solution of one scene: two tolerances of one solver agree, and energy is conserved.

    Attributes
    ----------
    values : (n_t, n_y) array    outputs; empty without a confirmed solution
    units : n_y texts            units of the outputs
    uncertainty : float          `distance` of the coarser run, or of the closest run of another solver if larger
    fault : str                  reason why there is no confirmed solution; empty if there is one
    """

    values: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    units: tuple[str, ...] = ()
    uncertainty: float = float("nan")
    fault: str = ""

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
    must also agree with each other.
    """
    trials = [trial for trial in trials if trial.family in CONTROLLED]
    pairs = _pairs(trials, units)
    reasons = {trial.reason for trial in trials}
    if len(reasons) == 1 and reasons != {""}:  # all fail for the same reason: the scene is the cause
        return Standard(fault=reasons.pop())
    if not pairs:
        return Standard(fault=f"no solver finishes at two tolerances ({by_reason(trials)})")
    # Largest accepted drift of energy of a solution, relative to the largest kinetic energy.
    confirmed = [pair for pair in pairs if pair.apart <= AGREEMENT and not pair.fine.energy > 1e-4]
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
