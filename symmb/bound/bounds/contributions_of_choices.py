"""Contributions of choices, and of intervals beside choices, to bounds."""

from collections.abc import Sequence

import numpy as np

from symmb._types import Array
from symmb.bound.bounds.contributions import Contributions, contributions_of
from symmb.bound.bounds.envelope import Envelope
from symmb.bound.bounds.responses import Responses


def contributions_of_choices(bounds: Envelope, parts: Sequence[Responses]) -> Contributions:
    """Contributions from the responses of each combination of choices.

    A choice alone has all its values while the others are nominal, or have their first value if none is nominal.
    """
    box, width = bounds.box, bounds.upper - bounds.lower
    assert box is not None
    choices = [choice for choice in box.choices if choice.is_studied]
    fixed = [{n: own.box[n][0] for choice in choices for n in choice.parameters} for own in parts]
    words = [[choice.chosen(values) for choice in choices] for values in fixed]
    known = bounds.nominal_parameters
    is_nominal = [all(np.isclose(known.get(n, np.nan), x) for n, x in own.items()) for own in fixed]
    usual = words[is_nominal.index(True) if any(is_nominal) else 0]
    n = words.index(usual)
    free = [name for name in box.names if all(name not in choice.parameters for choice in choices)]
    alone, saved, errors, runs = list[Array](), list[Array](), list[Array](), 0
    reference = contributions_of(parts[n]) if free else None
    for name in free:
        assert reference is not None
        p, of_alone = reference.parameters.index(name), reference._each_error()[0]
        low, high, error, more = _without(parts, name)
        alone.append(reference.alone[..., p])
        saved.append(np.maximum(width - (high - low), 0.0))
        errors.append(np.stack([of_alone[..., p], 2 * (error + (0.0 if bounds.estimate is None else bounds.estimate))]))
        runs += more
    nominal = [own.runs.values(own.nominal[None])[0] for own in parts if own.runs is not None]
    for k in range(len(choices)):
        one = [y for y, told in zip(nominal, words, strict=True) if _others(told, k) == _others(usual, k)]
        same = [own for own, told in zip(parts, words, strict=True) if told[k] == usual[k]]
        alone.append(np.ptp(one, axis=0))
        rest = np.max([own.upper for own in same], axis=0) - np.min([own.lower for own in same], axis=0)
        saved.append(np.maximum(width - rest, 0.0))
        error = 0.0 * width if bounds.estimate is None else 4 * bounds.estimate
        errors.append(np.stack([0.0 * width, error]))
    runs += len(parts) + (reference.runs if reference else 0)
    each = np.minimum(np.stack(errors, axis=-1), width[..., None])
    unknown = np.full((*width.shape, len(alone)), np.nan)
    told = f"Contributions alone are at {', '.join(usual)}. Choices have no probabilities, and thus no indices."
    return Contributions(
        bounds.t,
        bounds.names,
        bounds.units or ("",) * len(bounds.names),
        (*free, *(choice.name for choice in choices)),
        width,
        np.stack(alone, axis=-1),
        np.stack(saved, axis=-1),
        unknown,
        unknown,
        estimate=each[0].max(axis=-1),
        saved_estimate=each[1].max(axis=-1),
        share_estimate=np.full(width.shape, np.nan),
        runs=runs,
        method=bounds.method,
        remarks=(*(reference.remarks if reference else ()), told),
        errors=each,
    )


def _others(told: Sequence[str], k: int) -> list[str]:
    return [word for n, word in enumerate(told) if n != k]


def _without(parts: Sequence[Responses], name: str) -> tuple[Array, Array, Array, int]:
    """Bounds (n_t, n_y) over all combinations with one nominal parameter, their error, and the number of runs."""
    lows, highs, errors, runs = list[Array](), list[Array](), list[Array](), 0
    for own in parts:
        free = (own.box.radius > 0) & (np.array(own.box.names) != name)
        low, high, error = own.range(np.where(free, -1.0, own.nominal), np.where(free, 1.0, own.nominal))
        if not own.is_good.all() and own.runs is not None:
            low, high, error, more = own.range_by_runs(free, f"contributions, {name}")
            runs += more
        lows, highs, errors = [*lows, low], [*highs, high], [*errors, error]
    return np.min(lows, axis=0), np.max(highs, axis=0), np.max(errors, axis=0), runs
