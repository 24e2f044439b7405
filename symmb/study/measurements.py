"""Data of a calibration as its user gives them, and their faults."""

from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._names import normal_keys
from symmb._options import numbers_of, require_name, require_positive, shown
from symmb._types import Array

OWNER = "calibrate"


def measured_values(
    times: Array, outputs: Sequence[str], figures: Container[str], data: Mapping[str, Any]
) -> dict[str, tuple[Array, Array]]:
    """Times (n,) [s] and values (n,) of each output that has data, without gaps.

    `times` (n_t,) are the times of values without times of their own. `figures` are names of scalar outputs.
    """
    if not isinstance(data, Mapping) or not data:
        raise DeclarationError(f'{OWNER}: data must map outputs to values, such as {{"x": [...]}}, got {shown(data)}.')
    measured = {}
    for name, values in normal_keys(OWNER, data).items():
        require_name(OWNER, "output", name, outputs)
        if name in figures:
            raise DeclarationError(f"{OWNER}: {name!r} is a scalar output, but data must belong to outputs over time.")
        pair = isinstance(values, tuple) and len(values) == 2 and np.ndim(values[0]) == 1
        t, y = (numbers_of(part) for part in (values if pair else (times, values)))
        if t is None or y is None or t.ndim != 1 or y.shape != t.shape:
            where = "the given times" if pair else f"the {len(times)} output times"
            raise DeclarationError(f"{OWNER}: data of {name!r} must be one number for each of {where}.")
        if fault := _fault(t, y, times[0]):
            raise DeclarationError(f"{OWNER}: {fault.format(name=repr(name))}")
        known = ~np.isnan(y)
        measured[name] = t[known], y[known]
    return measured


def _fault(t: Array, y: Array, begin: float) -> str:
    """The fault of data (n,) at times (n,) [s] as a sentence with the field {name}; empty if the data are valid."""
    if np.isnan(y).all():
        return "all data of {name} are gaps (nan). Give at least one number."
    if np.isinf(y).any():
        return f"data of {{name}} are infinite at {t[np.isinf(y)][0]:g} s. Write a gap as nan."
    if not np.isfinite(t).all():
        return "the times of {name} must be finite."
    if t.min() < begin:
        return f"the times of {{name}} start at {t.min():g} s, before the run starts at {begin:g} s."
    return ""


def noise_of_outputs(noise: Mapping[str, float] | None, measured: Mapping[str, Any]) -> dict[str, float]:
    """The given noise of each output; empty if not given."""
    if noise is None:
        return {}
    noise = normal_keys(OWNER, noise)
    if not isinstance(noise, Mapping) or noise.keys() != measured.keys():
        raise DeclarationError(
            f"{OWNER}: noise must have a number for each output with data: {', '.join(measured)}, got {shown(noise)}."
        )
    for name, value in noise.items():
        require_positive(OWNER, f"noise of {name!r}", value)
    return {name: float(value) for name, value in noise.items()}
