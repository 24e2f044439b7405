"""The bounds of a union of boxes, from the bounds over each of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symmb._types import Array, Indices
from symmb.bound.answers import Bounds
from symmb.bound.responses import SIDES, AttainingRuns, Trace


def hull_of(parts: Sequence[Bounds]) -> Bounds:
    """The smallest bounds that contain the bounds of all parts, with the runs of all parts.

    Warnings, remarks and the polynomials are those of the first part.
    """
    lower, upper = _hull([(part.lower, part.upper) for part in parts])
    low, high = _hull([part.outer for part in parts])
    inner = [part.inner for part in parts if part.inner is not None]
    noise = [part.noise for part in parts if part.noise is not None]
    traced = [(part.trace, part.estimate) for part in parts if part.trace is not None and part.estimate is not None]
    return replace(
        parts[0],
        lower=lower,
        upper=upper,
        estimate=None if parts[0].estimate is None else np.maximum(distance(lower, low), distance(high, upper)),
        inner=_hull(inner) if len(inner) == len(parts) else None,
        noise=np.max(noise, axis=0) if noise else None,
        evaluations=sum(part.evaluations for part in parts),
        seconds=sum(part.seconds for part in parts),
        failed=tuple(run for part in parts for run in part.failed),
        caution=next((part.caution for part in parts if part.caution), ""),
        nominal=next((part.nominal for part in parts if part.nominal is not None), None),
        trace=Trace.joined(*zip(*traced, strict=True)) if parts[0].trace is not None else None,
        attaining=_attaining([part.attaining for part in parts]),
    )


def distance(high: Array, low: Array) -> Array:
    """The difference high - low, 0 if both are equal, also if both are infinite."""
    return np.subtract(high, low, out=np.zeros(np.shape(high)), where=np.asarray(high != low))


def _hull(pairs: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """The smallest of several lower ends, and the largest of several upper ends. Ends that are nan are ignored."""
    return np.fmin.reduce([low for low, _ in pairs]), np.fmax.reduce([high for _, high in pairs])


def _attaining(each: Sequence[AttainingRuns | None]) -> AttainingRuns | None:
    """The runs of all combinations that attain the extremes."""
    runs = [own for own in each if own is not None]
    if len(runs) < len(each):
        return None
    offsets = np.cumsum([0, *(len(own.blocks) for own in runs)])
    ends, at = dict[str, Array](), dict[str, Indices]()
    for side, best in zip(SIDES, (np.argmin, np.argmax), strict=True):
        values = np.stack([own.ends[side] for own in runs])
        chosen = best(values, axis=0)[None]
        numbers = np.stack([own.at[side] + offset for own, offset in zip(runs, offsets[:-1], strict=True)])
        ends[side] = np.take_along_axis(values, chosen, axis=0)[0]
        at[side] = np.take_along_axis(numbers, chosen, axis=0)[0]
    others = dict[int, AttainingRuns]()
    for k in {k: True for own in runs for k in own.others}:  # the other parts have values of this output in all runs
        if found := _attaining([own.others.get(k, replace(own, others={})) for own in runs]):
            others[k] = found
    return AttainingRuns(runs[0].simulator, tuple(block for own in runs for block in own.blocks), ends, at, others)
