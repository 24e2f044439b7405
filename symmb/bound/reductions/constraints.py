"""Boxes with constraints: a study of the whole box, and the range of its polynomials over the allowed points."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symmb._errors import PropagationError
from symmb._names import counted
from symmb._types import Array, Indices
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, bounds_of
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.reductions.reduction import Reduced, Reduction
from symmb.bound.responses import (
    FEW,
    RunsOverBox,
    allowed_points,
    failure_details,
    first_points,
    gathered,
    parameter_samples,
    which_failed,
    with_tolerance_remark,
)
from symmb.connect import RUNS_TOGETHER, note_attained
from symmb.equations.model import Box
from symmb.run.simulation import SceneSimulator

_MOST_PARAMETERS = 4
_ROUNDS, _SHRINK, _CLOUD, _MOST_CLOUDS = 26, 0.8, 48, 128
"""Number of rounds that search near the extremes, factor of the steps in each, and points and extremes in a round."""
_MOST_RUNS = 32
"""Largest number of runs at extremes."""


class Constraints(Reduction):
    """Bounds over the allowed points, from the polynomials of bounds over the whole box, and from runs at extremes."""

    def accepts(self, method: Method, box: Box) -> bool:
        return bool(box.constraints) and method.constraints != "own" and bool(box.radius.any())

    def apply(self, method: Method, box: Box) -> Sequence[Box]:
        if method.constraints == "refused":
            raise PropagationError(
                f"{method!r}: the method has no bounds for constraints. Use PolynomialChaos(), MonteCarlo(...) or "
                "Scanning(...)."
            )
        return [box.hull]

    def invert(self, study: Reduced, found: Sequence[Bounds | PropagationError]) -> Bounds:
        (whole,) = found
        if isinstance(whole, PropagationError):
            raise whole
        runs = RunsOverBox(repr(study.method), study.simulator, study.box, study.executor)
        bounds = bounds_of(study.method, runs, lambda _: _constrained(study, whole))
        return replace(bounds, seconds=bounds.seconds + whole.seconds)


def _constrained(study: Reduced, whole: Bounds) -> Bounds:
    method, simulator, box = study.method, study.simulator, study.box
    if whole.surrogate is None or np.sum(box.radius > 0) > _MOST_PARAMETERS:
        raise PropagationError(
            f"{method!r}: constraints need polynomials of at most {_MOST_PARAMETERS} parameters. Use MonteCarlo(...)."
        )
    points = first_points(box)
    if not len(points):
        raise PropagationError(f"{method!r}: no point that was tried satisfies all constraints.")
    lower, upper, search, extremes = _range(whole.surrogate, box, points)
    P = parameter_samples(simulator, box, extremes)
    Y, bad = gathered(simulator, P, study.executor)
    ok = ~which_failed(bad, len(P))
    details = failure_details(simulator, box, extremes, P, bad)
    lost = np.array([[run.parameters[name] for name in box.names] for run in whole.failed]).reshape(-1, len(box))
    before = tuple(run for run, own in zip(whole.failed, box.allowed(lost), strict=True) if own)
    details["failed"] = before + details["failed"]
    if not ok.any():
        raise PropagationError(f"{method!r}: all runs at extremes failed. {details['failed'][0]}")
    inner = Y[ok].min(axis=0), Y[ok].max(axis=0)
    note_attained(*inner, P, Y, together=RUNS_TOGETHER if isinstance(simulator, SceneSimulator) else 1)
    missed = np.abs(whole.surrogate.values(extremes[ok]) - Y[ok]).max(axis=0)
    few = (
        f"Only {counted(len(points), 'point')} of many that were tried satisfy the constraints, so the bounds may be "
        "too narrow. Use a smaller box around the allowed points."
    )
    told = f"{counted(len(P), 'run')} at extremes of the polynomials over the allowed points checked the bounds."
    lower, upper = np.minimum(lower, inner[0]), np.maximum(upper, inner[1])
    estimate = np.maximum(whole.surrogate.error, missed) + search
    remarks, tolerance = (*whole.remarks, told), getattr(method, "tolerance", np.inf)
    if getattr(method, "order", None) is None:  # the allowed points have a smaller width than the box
        remarks = with_tolerance_remark(remarks, whole.names, tolerance, estimate, upper - lower)
    return replace(
        whole,
        lower=lower,
        upper=upper,
        estimate=estimate,
        trace=None,
        inner=inner,
        evaluations=whole.evaluations + len(P),
        nominal=None,
        expansion=None,
        surrogate=None,
        range_of="",
        run_doubts=(*whole.run_doubts, *([few] if len(points) < FEW else [])),
        remarks=remarks,
        **details,
    )


def _range(surrogate: Piecewise, box: Box, points: Array) -> tuple[Array, Array, Array, Array]:
    """The range (n_t, n_y) of polynomials over allowed points, the error (n_y,) of the search, and extremes (n, d).

    A search in random points near the extremes improves them. Its steps decrease. The gain of the second half of
    the rounds estimates the error of the search.
    """
    random, radius = np.random.default_rng(0), 0.5
    ends = np.full((2, *surrogate.error.shape), np.inf)
    best = np.zeros((*ends.shape, points.shape[1]))
    half = ends.copy()
    for n in range(_ROUNDS + 1):
        for some in np.array_split(points, -(-len(points) // 64)):
            values = surrogate.values(some)
            for own, at, y in zip(ends, best, (values, -values), strict=True):
                k = y.argmin(axis=0)
                lowest = np.take_along_axis(y, k[None], axis=0)[0]
                at[lowest < own] = some[k[lowest < own]]
                np.minimum(own, lowest, out=own)
        half = ends.copy() if 2 * n == _ROUNDS else half
        extremes = np.unique(best.reshape(-1, points.shape[1]), axis=0)
        centres = extremes[_some(len(extremes), _MOST_CLOUDS)]
        scale = radius * 10.0 ** random.uniform(-1.0, 0.0, (len(centres), _CLOUD, 1))
        steps = random.uniform(-1.0, 1.0, (len(centres), _CLOUD, points.shape[1]))
        # A third of the steps are differences of allowed points, which follow thin sets.
        pairs = random.integers(len(points), size=(2, len(centres), _CLOUD // 3))
        steps[:, ::3] = points[pairs[0]] - points[pairs[1]]
        cloud = centres[:, None] + scale * steps
        near = np.clip(cloud.reshape(-1, points.shape[1]), -1.0, 1.0)
        points = np.concatenate([centres, allowed_points(box, np.where(box.radius > 0, near, 0.0))])
        radius *= _SHRINK
    return ends[0], -ends[1], (half - ends).max(axis=(0, 1)), extremes[_some(len(extremes), _MOST_RUNS)]


def _some(n: int, most: int) -> Indices:
    """At most `most` of the numbers below n."""
    return np.linspace(0, n - 1, min(n, most)).astype(int)
