"""Data of a calibration as its user gives them, and their faults."""

from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import SLIGHT, SMALL
from symmb._names import normal_keys
from symmb._options import numbers_of, require_instance, require_name, require_positive, shown
from symmb._types import Array
from symmb.equations.model import Box, System, require_only_intervals

_NARROWEST = 1e-9
"""Smallest width of limits, divided by their size. In narrower limits, differences of runs are rounding errors."""

OWNER = "calibrate"
_LEAST_POSITIVE = SMALL
"""Smallest value of a parameter that must be above 0, divided by its nominal value. With a mass of one millionth, a
damped run takes millions of steps."""


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
    return {name: float(noise[name]) for name in measured}


def limits_of(
    box: Box | None, nominal: Mapping[str, float], units: Mapping[str, str]
) -> dict[str, tuple[float, float]]:
    """The limits of each parameter of the box, in its own unit. `nominal` are the estimated parameters."""
    if box is None:
        return {}
    require_instance(f"{OWNER}: box", box, Box, "Box(k=(6.0, 8.0))")
    require_only_intervals(OWNER, box)
    box = box.with_units(units)
    for name, (lower, upper) in (found := dict(zip(box.names, box.bounds, strict=True))).items():
        require_name(OWNER, "estimated parameter", name, nominal)
        if upper - lower <= _NARROWEST * max(abs(lower), abs(upper)):
            raise DeclarationError(f"{OWNER}: the limits of {name!r} are equal. Leave out this parameter.")
        if not lower <= nominal[name] <= upper:
            raise DeclarationError(
                f"{OWNER}: the nominal value {nominal[name]:g} of {name!r} must be between its limits {lower:g} and "
                f"{upper:g}, because the search starts there."
            )
    return found


def with_signs(
    limits: Mapping[str, tuple[float, float]], system: System, nominal: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """The limits, not below 0 for parameters whose sign is that of a mass or of another number that must be positive.

    If the number must be above 0, the limit is a small part of the nominal value.
    """
    found, order, positive = dict(limits), list(system.parameters), system.positive[1]
    # Three values of the other parameters: the sign must not depend on them.
    others = system.parameters.nominal * np.random.default_rng(0).uniform(0.5, 2.0, (3, len(order)))
    for name, value in nominal.items():
        sides = []
        for part in (-SLIGHT, 0.0, SLIGHT):
            P = others.copy()
            P[:, order.index(name)] = part * (abs(value) or 1.0)
            sides.append(np.array([np.ravel(positive(p)) for p in P]) > 0)
        below, at, above = sides
        if (has_sign := (above & ~below).all(axis=0)).any():
            lower, upper = found.get(name, (-np.inf, np.inf))
            found[name] = max(lower, 0.0 if at[:, has_sign].all() else _LEAST_POSITIVE * value), upper
    return found


def priors_of(
    priors: Mapping[str, Any] | None, nominal: Mapping[str, float], units: Mapping[str, str]
) -> dict[str, Array]:
    """Value and standard deviation (2,) of each parameter with a prior, in its own unit."""
    if not isinstance(priors, Mapping | None):
        raise DeclarationError(f'{OWNER}: priors must map parameters to pairs, such as {{"k": (7.0, 0.1)}}.')
    found = {}
    for name, given in normal_keys(OWNER, priors or {}).items():
        require_name(OWNER, "estimated parameter", name, nominal)
        if isinstance(given, tuple) and (pair := numbers_of(given[:2])) is not None and pair.shape == (2,):
            given = (pair[0] - pair[1], pair[0] + pair[1], *given[2:]) if pair[1] > 0 else None
        refused = DeclarationError(
            f"{OWNER}: the prior of {name!r} must be a value and a standard deviation above 0 in units of "
            f"this parameter, such as (7.0, 0.1), (7.0, 0.1, 'N/m') or '7.0 N/m ±0.1 N/m', "
            f"got {shown(priors and priors[name])}."
        )
        if not isinstance(given, str | tuple):
            raise refused
        try:
            box = Box(**{name: given}).with_units(units)
        except DeclarationError as error:
            raise refused from error
        found[name] = np.array([box.center[0], box.radius[0]])
        require_positive(OWNER, f"standard deviation of the prior of {name!r}", float(box.radius[0]))
    return found
