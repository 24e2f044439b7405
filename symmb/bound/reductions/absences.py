"""Scalar outputs whose condition never holds in some runs: bounds of the other outputs do not depend on it.

Two studies are made where `value_at` has no value in some runs: one in which all runs have a value of all outputs, and
one in which these runs fail, for the outputs concerned.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import SAME
from symmb._names import counted
from symmb._types import Array
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, MonteCarlo, bounds_of
from symmb.bound.responses import RunsOverBox
from symmb.run.simulation import FigureSimulator, never_holds

_SAMPLES = MonteCarlo(1000)
"""Runs for the bounds of `value_at`, if its condition never holds in most runs of a method."""


def bounds_with_absences(method: Method, runs: RunsOverBox) -> Bounds:
    """Bounds by a method. The last time of `first_time` is infinite if its condition never holds in a run.

    `value_at` is bounded in the runs in which its condition holds.
    """
    simulator = runs.simulator
    if not isinstance(simulator, FigureSimulator) or not simulator.ends:
        return bounds_of(method, runs, method.bounds)
    values_at = [name for name, end in simulator.ends.items() if end is None]
    failing = runs.of(simulator.continued([name for name in simulator.ends if name not in values_at]))
    try:
        found = bounds_of(method, failing, method.bounds)
    except PropagationError:
        every = bounds_of(method, runs.of(simulator.continued()), method.bounds)  # raises, if other runs fail
        lost, found = values_at, bounds_of(_SAMPLES, failing, _SAMPLES.bounds)
    else:
        lost = [name for name in values_at if any(never_holds(name) in run.message for run in found.failed)]
        every = bounds_of(method, runs.of(simulator.continued()), method.bounds) if lost else found
    return with_never(_with_columns(every, found, lost) if lost else found, simulator)


def _with_columns(every: Bounds, some: Bounds, lost: Sequence[str]) -> Bounds:
    """Bounds of all outputs, in which some outputs have their bounds from the runs that have a value of them."""
    columns = [every.names.index(name) for name in lost]
    where = some.failed_region or f"in {len(some.failed)} of {counted(some.evaluations, 'run')}"
    remarks = [
        f"The condition of {name} never holds {where}. The bounds of {name} are those of the other runs. In samples, "
        f"{name} has its value at the end of such runs."
        for name in lost
    ]
    remarks += [f"The bounds of {name} are extremes of random runs." for name in lost if some.kind == "sampled"]

    def mixed(own: Array | None, other: Array | None) -> Array | None:
        if own is None or other is None:
            return own
        values = np.array(own)
        values[:, columns] = other[:, columns]
        return values

    widths = some.upper - some.lower
    known: dict[str, Any] = {
        "lower": mixed(every.lower, some.lower),
        "upper": mixed(every.upper, some.upper),
        "estimate": mixed(every.estimate, widths if some.estimate is None else some.estimate),
        "remarks": (*every.remarks, *remarks),
        "evaluations": every.evaluations + some.evaluations,
    }
    if every.inner is not None and some.inner is not None:
        known["inner"] = tuple(mixed(*pair) for pair in zip(every.inner, some.inner, strict=True))
    if every.attaining is not None and some.attaining is not None:
        known["attaining"] = replace(every.attaining, others=dict.fromkeys(columns, some.attaining))
    return replace(every, **known)


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
