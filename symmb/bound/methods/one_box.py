"""The bounds of a method over a box without choices, with the data that all methods share."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._errors import PropagationError, SymmbError, text_of
from symmb._interrupts import carry
from symmb._names import counted
from symmb._options import numbers_of, shown
from symmb._types import Array
from symmb.bound.answers import Bounds
from symmb.bound.methods.method import Method
from symmb.bound.responses import AttainingRuns, RunsOverBox, failure_text
from symmb.connect import Attained, Simulator, attained_by_runs
from symmb.declare.symbolic import interpret
from symmb.equations.model import Box
from symmb.prove import Interval, operate, parameter_intervals
from symmb.run.simulation import DAESimulator


def bounds_of(method: Method, runs: RunsOverBox, found_by: Callable[[RunsOverBox], object]) -> Bounds:
    """Bounds from what `found_by` returns for the runs of a method, Bounds or arrays.

    Raises
    ------
    PropagationError
        If too many runs fail, or a method of the user raises an error or returns no bounds.
    KeyboardInterrupt
        If the study is interrupted. ``partial`` then contains the bounds that runs have attained, if there are any.
    """
    simulator, box = runs.simulator, runs.box
    start = time.perf_counter()
    nominal = np.array(list(simulator.parameters.values()), dtype=float)
    with attained_by_runs(len(simulator.times), len(simulator.outputs), nominal) as attained:
        try:
            found = found_by(runs)
        except KeyboardInterrupt as interrupt:
            carry(interrupt, _partial(method, runs, attained, time.perf_counter() - start))
            raise
        except SymmbError:
            raise
        except Exception as error:
            if type(method).__module__.startswith("symmb.") or isinstance(error, Warning):
                raise
            raise PropagationError(f"{method!r}: `bounds` raised {text_of(error)}.") from error
    result = found if isinstance(found, Bounds) else _of_arrays(method, runs, attained, found)
    lower, upper = result.lower, result.upper
    if result.kind == "estimate":
        lower, upper = np.clip((lower, upper), *possible_values(simulator, box))
    seconds = time.perf_counter() - start
    attaining = AttainingRuns.of(simulator, attained)
    nominal = attained.nominal if result.nominal is None else result.nominal
    if box.constraints:
        told = f"The bounds hold for parameters that satisfy {counted(len(box.constraints), 'constraint')}."
        result = replace(result, remarks=(*result.remarks, told))
    known = {"lower": lower, "upper": upper, "attaining": attaining, "nominal": nominal, "seconds": seconds}
    return replace(result, **known, **_about(simulator, box))


def _partial(method: Method, runs: RunsOverBox, attained: Attained, seconds: float) -> Bounds | None:
    """The extremes of the runs before an interrupt."""
    if not (attained.lower <= attained.upper).all():
        return None
    inner, text = (attained.lower, attained.upper), f"{method!r}, interrupted"
    bounds = Bounds(runs.times, runs.outputs, *inner, "sampled", text, attained.runs, inner=inner)
    return replace(bounds, seconds=seconds, **_about(runs.simulator, runs.box))


_RETURNS = "`bounds` must return (lower, upper) or (lower, upper, estimate), each an array ({}, {}) of numbers"


def _of_arrays(method: Method, runs: RunsOverBox, attained: Attained, found: object) -> Bounds:
    """Bounds from the arrays that a method of the user returns."""
    shape = len(runs.times), len(runs.outputs)
    expected = f"{method!r}: {_RETURNS.format(*shape)}"
    if not isinstance(found, tuple | list) or len(found) not in (2, 3):
        raise PropagationError(f"{expected}, got {shown(found)}.")
    found = found[:2] if found[-1] is None else found
    arrays = [numbers_of(each) for each in found]
    if any(each is None or each.shape != shape for each in arrays):
        forms = ", ".join("no numbers" if each is None else str(each.shape) for each in arrays)
        raise PropagationError(f"{expected}, got {forms}.")
    lower, upper, *estimates = (np.array(each, dtype=float) for each in arrays)
    failed = f" Values of failed runs are nan.\n{failure_text(runs.failed)}" if runs.failed else ""
    for name, each in zip(("lower", "upper", "estimate"), (lower, upper, *estimates), strict=False):
        if np.isnan(each).any():
            k, j = np.argwhere(np.isnan(each))[0]
            raise PropagationError(
                f"{method!r}: {name} of {runs.outputs[j]} is nan at t = {runs.times[k]:g} s.{failed}"
            )
    if (lower > upper).any():
        k, j = np.argwhere(lower > upper)[0]
        raise PropagationError(
            f"{method!r}: lower is above upper for {runs.outputs[j]} at t = {runs.times[k]:g} s: "
            f"{lower[k, j]:g} and {upper[k, j]:g}."
        )
    if estimates and (estimates[0] < 0).any():
        raise PropagationError(f"{method!r}: estimate must not be negative.")
    details: dict[str, Any] = {"failed": runs.failed, "estimate": estimates[0] if estimates else None}
    if (attained.lower <= attained.upper).all():
        details["inner"] = low, high = attained.lower, attained.upper
        if method.kind == "enclosure" and ((low < lower) | (high > upper)).any():
            details["run_doubts"] = ("Runs of the method lie outside of its proved bounds.",)
        if method.kind == "sampled" and ((low > lower) | (high < upper)).any():
            details["run_doubts"] = ("The bounds are sampled, but no run of the method attains them.",)
    return method._result(runs, lower, upper, runs.evaluations, **details)


def units_of(simulator: Simulator) -> tuple[str, ...]:
    """Units of the outputs, if the simulator knows them."""
    return tuple(getattr(simulator, "units", ()))


def _about(simulator: Simulator, box: Box) -> dict[str, Any]:
    """Attributes of Bounds that are the same for all methods."""
    return {"units": units_of(simulator), "figures": tuple(getattr(simulator, "figures", ())), "box": box}


def possible_values(simulator: Simulator, box: Box | None) -> tuple[Array, Array]:
    """Smallest and largest possible values (n_t, n_y) of the outputs, for all states; infinite if unknown.

    Parameters are in the box. Without a box, they may have any value.
    """
    shape = len(simulator.times), len(simulator.outputs)
    lower, upper = np.full(shape, -np.inf), np.full(shape, np.inf)
    # Largest number of operations in the outputs. Their interval extension takes a tenth of a second.
    if not isinstance(simulator, DAESimulator) or simulator.y.n_instructions() > 10_000:
        return lower, upper
    y, anything = simulator.y, Interval(np.array(-np.inf), np.array(np.inf))

    def operation(code: int, arguments: tuple[Interval, ...]) -> Interval:
        try:
            return operate(code, arguments)
        except PropagationError:  # the operation has no extension, or some states have no value
            return anything

    parameters = [anything] * y.nnz_in(1) if box is None else parameter_intervals(simulator.parameters, box)
    inputs = [[anything] * y.nnz_in(0), parameters, [Interval.exactly(simulator.times)] * y.nnz_in(2)]
    values = interpret(y, inputs, operation, Interval.exactly)[0]
    for row, value in zip(y.sparsity_out(0).row(), values, strict=True):
        lower[:, row], upper[:, row] = value
    return lower, upper
