"""Scalar outputs whose condition never holds in some runs: bounds of the other outputs do not depend on it.

If `value_at` has no value in some runs, there are further studies: one in which all runs have a value of all outputs,
and one of the outputs concerned, in which these runs fail.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import SAME
from symmb._names import counted
from symmb._types import Array
from symmb.bound import methods
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, bounds_of
from symmb.bound.responses import RunsOverBox
from symmb.run.simulation import FigureSimulator, never_holds

_SAMPLES = 1000
"""Number of runs for the bounds of `value_at`, if its condition never holds in most runs of a method."""


def bounds_with_absences(method: Method, runs: RunsOverBox) -> Bounds:
    """Bounds by a method. The last time of `first_time` is infinite if its condition never holds in a run.

    `value_at` is bounded in the runs in which its condition holds.
    """
    simulator = runs.simulator
    if not isinstance(simulator, FigureSimulator) or not simulator.ends:
        return bounds_of(method, runs, method.bounds)
    values_at = [name for name, end in simulator.ends.items() if end is None]
    with_value = {name: runs.of(_failing_without(simulator, [name])) for name in values_at}
    try:
        found = bounds_of(method, runs.of(_failing_without(simulator, values_at)), method.bounds)
    except PropagationError:
        found, lost = None, values_at
    else:
        lost = [name for name in values_at if any(never_holds(name) in run.message for run in found.failed)]
        if not lost:
            return with_never(found, simulator)
    every = bounds_of(method, runs.of(simulator.continued()), method.bounds)  # raises, if other runs fail
    # A run without a value of one output may have a value of another.
    apart = found is not None and any(never_holds(name) not in run.message for run in found.failed for name in lost)
    for name in lost:
        own = _bounds_or_none(method, with_value[name]) if apart or (found is None and len(lost) > 1) else found
        every = _with_column(every, own or _bounds_or_none(methods.MonteCarlo(_SAMPLES), with_value[name]), name)
    return with_never(every, simulator)


def _failing_without(simulator: FigureSimulator, names: Sequence[str]) -> FigureSimulator:
    """A simulator whose runs fail if some outputs have no value."""
    return simulator.continued([name for name in simulator.ends if name not in names])


def _bounds_or_none(method: Method, runs: RunsOverBox) -> Bounds | None:
    try:
        return bounds_of(method, runs, method.bounds)
    except PropagationError:
        return None


def _with_column(every: Bounds, some: Bounds | None, name: str) -> Bounds:
    """Bounds of all outputs, in which one has its bounds from the runs that have a value of it; nan if none has."""
    column = every.names.index(name)

    def mixed(own: Array | None, other: Array | None) -> Array | None:
        if own is None or (some is not None and other is None):
            return own
        values = np.array(own)
        values[:, column] = np.nan if other is None else other[:, column]
        return values

    if some is None:
        own = [mixed(each, None) for each in (every.lower, every.upper, every.estimate)]
        remark = (
            f"The condition of {name} holds in none of {_SAMPLES} random runs. In samples, {name} has its "
            f"value at the end of a run."
        )
        known = dict(zip(("lower", "upper", "estimate"), own, strict=True))
        return replace(every, **known, inner=None, remarks=(*every.remarks, remark))
    where = (
        some.failed_region.replace("scattered", "in runs scattered")
        or f"in {len(some.failed)} of {counted(some.evaluations, 'run')}"
    )
    remarks = [
        f"The condition of {name} never holds {where}. The bounds of {name} are those of the other runs. In samples, "
        f"{name} has its value at the end of such runs."
    ]
    remarks = remarks if some.failed else []  # without failed runs, only another output lacks values
    if some.kind == "sampled" and every.kind != "sampled":
        remarks.append(f"The bounds of {name} are extremes of random runs.")
    of_samples = (
        some.upper - some.lower if some.evaluations - len(some.failed) > 1 else np.full(some.upper.shape, np.inf)
    )
    known: dict[str, Any] = {
        "lower": mixed(every.lower, some.lower),
        "upper": mixed(every.upper, some.upper),
        "estimate": mixed(every.estimate, of_samples if some.estimate is None else some.estimate),
        "remarks": (*every.remarks, *remarks),
        "evaluations": every.evaluations + some.evaluations,
    }
    if every.inner is not None and some.inner is not None:
        known["inner"] = tuple(mixed(*pair) for pair in zip(every.inner, some.inner, strict=True))
    if every.attaining is not None and some.attaining is not None:
        known["attaining"] = replace(every.attaining, others={**every.attaining.others, column: some.attaining})
    return replace(every, **known)


def with_open_ends(bounds: Bounds) -> Bounds:
    """Bounds from minus infinity to infinity of outputs of which no run has a value, in place of nan."""
    lost = np.isnan(bounds.lower) & np.isnan(bounds.upper)
    if not lost.any():
        return bounds
    estimate = None if bounds.estimate is None else np.where(lost, 0.0, bounds.estimate)
    return replace(
        bounds,
        lower=np.where(lost, -np.inf, bounds.lower),
        upper=np.where(lost, np.inf, bounds.upper),
        estimate=estimate,
    )


def with_never(bounds: Bounds, simulator: FigureSimulator) -> Bounds:
    """Bounds in which times are infinite if a run attains the end of the window, where a condition never holds."""
    ends = {name: end for name, end in simulator.ends.items() if end is not None}
    reached = bounds.attaining.ends["upper"] if bounds.attaining else bounds.upper
    last = {name: end - SAME * abs(end) for name, end in ends.items()}
    never = [name for name, end in last.items() if (reached[:, bounds.names.index(name)] >= end).all()]
    if not never:
        return bounds
    columns = [bounds.names.index(name) for name in never]

    def unlimited(values: Array) -> Array:
        values = np.array(values)
        values[:, columns] = np.inf
        return values

    remarks = [
        f"The condition of {name} never holds in a run until its end, so that {name} has no largest value. "
        f"bounds.worst({name!r}) shows such a run."
        for name in never
    ]
    inner = None if bounds.inner is None else (bounds.inner[0], unlimited(bounds.inner[1]))
    return replace(bounds, upper=unlimited(bounds.upper), inner=inner, remarks=(*bounds.remarks, *remarks))
