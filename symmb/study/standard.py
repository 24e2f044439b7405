"""The solution that the trials of a scene are measured with, or the reason why there is none."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from symmb._types import Array
from symmb.study.ladders import CONTROLLED
from symmb.study.trials import Trial, by_family, by_reason

AGREEMENT = 1e-4
"""Largest difference of two tolerances, and of two solvers, that confirm each other."""
ENERGY = 1e-4
"""Largest drift of energy of a confirmed solution, over the largest kinetic energy."""
_NOISE = 1e-12
"""Size of an output, over the largest value of its unit, below which it is rounding."""


@dataclass(frozen=True, eq=False)
class Standard:
    """A confirmed solution of one scene: two tolerances of one solver agree on it, and its energy holds.

    Attributes
    ----------
    values : (n_t, n_y) array    outputs; empty if there is none
    units : n_y texts            of the outputs
    uncertainty : float          `distance` of the coarser run, and of that of the closest other solver, if there is one
    fault : str                  why there is none; empty if there is one
    """

    values: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    units: tuple[str, ...] = ()
    uncertainty: float = float("nan")
    fault: str = ""

    def error(self, trial: Trial) -> float | None:
        """The error of a run of the scene, at least the uncertainty; None if it failed, or nothing can measure it."""
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
    """The solution that those of the runs of one scene agree on whose solvers have tolerances.

    Each solver is asked with its two finest tolerances that finish. Solvers that agree with themselves have to agree
    with each other.
    """
    trials = [trial for trial in trials if trial.family in CONTROLLED]
    pairs = _pairs(trials, units)
    reasons = {trial.reason for trial in trials}
    if len(reasons) == 1 and reasons != {""}:  # the scene itself is at fault
        return Standard(fault=reasons.pop())
    if not pairs:
        return Standard(fault=f"no solver finishes at two tolerances ({by_reason(trials)})")
    confirmed = [pair for pair in pairs if pair.apart <= AGREEMENT and not pair.fine.energy > ENERGY]
    if not confirmed:
        return Standard(fault=_fault(pairs, units))
    best = confirmed[0].fine
    away = [distance(pair.fine.values, best.values, units) for pair in confirmed[1:]]
    if max(away, default=0.0) > AGREEMENT:
        other = confirmed[1 + int(np.argmax(away))].fine
        return Standard(fault=f"{best.solver} and {other.solver} differ by {max(away):.1g} of the motion")
    return Standard(best.values, units, max(confirmed[0].apart, min(away, default=0.0)))


def _pairs(trials: Sequence[Trial], units: tuple[str, ...]) -> list[_Pair]:
    """The runs with the two finest tolerances of each solver that finish, those first that agree best."""
    pairs = list[_Pair]()
    for some in by_family(trials).values():
        finished = sorted((trial for trial in some if not trial.reason), key=lambda trial: -trial.setting)
        if len(finished) > 1:
            coarse, fine = finished[-2:]
            pairs.append(_Pair(coarse, fine, distance(coarse.values, fine.values, units)))
    return sorted(pairs, key=lambda pair: pair.apart)


def _fault(pairs: Sequence[_Pair], units: tuple[str, ...]) -> str:
    """Why none of the pairs is confirmed, from the one that agrees best."""
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
    """Largest over outputs of the root mean square difference over that of the deviation from the mean."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.sqrt(np.mean(np.square(values - true), axis=0)) / _deviation(true, units)
    return float(np.nan_to_num(error, nan=np.inf, posinf=np.inf).max(initial=0.0))


def _deviation(true: Array, units: Sequence[str]) -> Array:
    """Root mean square deviation of each output from its mean (n_y,).

    Of an output that is constant but for rounding it is its largest value; of one that is 0 but for rounding it is the
    largest value of its unit.
    """
    largest, deviation = np.abs(true).max(axis=0), np.std(true, axis=0)
    of_unit = np.array([max(largest[k] for k in range(len(units)) if units[k] == unit) for unit in units])
    constant = np.where(largest > _NOISE * of_unit, largest, np.maximum(of_unit, 1e-300))
    return np.where(deviation > _NOISE * of_unit, deviation, constant)
