"""Check runs: an independent check of methods that do not estimate their error. `adaptive` has its own check runs.

The first run is at a point near the centre of the box. The next runs are at the ends of lines through this point,
parallel to the axes. Further runs are at the extremes of parabolas along these lines. No method makes these runs
itself. Runs, bounds and the method's surrogate must agree.
"""

from functools import reduce

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array, Executor, Indices, Mask
from symmb.bound.answers import Bounds
from symmb.bound.nodes import corners
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import (
    DOUBTFUL,
    MOST_NUMBERS,
    failure_records,
    gathered,
    parameter_samples,
    rms,
    which_failed,
)
from symmb.connect import Simulator, noise_from_runs
from symmb.equations.model import Box

_RUNS_AT_EXTREMES = 4
"""Number of runs at predicted extremes."""
_PREDICTED_VALUES = 256
"""Number of extremes, over outputs and times, that are predicted. A few times of each output suffice."""
_SEARCHED_TIMES = 128
"""Largest number of times at which the surrogate's range is searched."""
_WIDE = 1e100
"""The width of bounds with an infinite end, of which runs show no error."""
_MOST_CORNERS, _POINTS_INSIDE = 64, 64
"""Largest number of corners, and number of points inside of the box, in a search for the surrogate's range."""
_OFF_CENTRE = 0.2, 0.4
"""Smallest and largest distance of the first point from the centre of the box, in each parameter."""


def check_doubts(
    simulator: Simulator, bounds: Bounds, share: float, executor: Executor | None = None
) -> tuple[tuple[str, ...], int]:
    """Warnings from check runs about bounds that have no estimated error, and the number of check runs.

    Runs outside of the bounds show that the bounds are too narrow. If the surrogate differs from the runs, the bounds
    may be too narrow or too wide. Some bounds are not the exact range of the surrogate. Such bounds are too wide if no
    value of the surrogate is near the bounds. Only differences above `share` times the width give a warning.
    """
    box = bounds.box
    assert box is not None
    # Check runs at points that are not allowed would not check the bounds.
    if bounds.kind == "enclosure" or bounds.estimate is not None or share == np.inf or box.constraints:
        return (), 0
    varied = np.flatnonzero(box.radius > 0)
    # The allowed runs suffice for the first point, faces and extremes of four parameters. A method with more runs has
    # more check runs.
    most = min(max(13, bounds.evaluations), MOST_NUMBERS // max(bounds.lower.size, 1))
    if not varied.size or most < 3:
        return (), 0
    checks = _Checks(simulator, box, bounds, share, executor)
    candidates = _corners(len(box), varied)
    if 1 + 2 * len(varied) + _RUNS_AT_EXTREMES <= most:
        star = _star(len(box), varied)
        Y = checks.run(star)
        if Y is not None:
            extremes, candidates = _predicted(Y / checks.scale, star[0, varied], varied, candidates)
            checks.run(extremes)
    else:
        checks.run(candidates[-_POINTS_INSIDE - most // 2 :][:most])
    return checks.doubts(candidates), checks.n


class _Checks:
    """The largest differences over the n check runs so far, and the scale (n_y,) of the outputs."""

    def __init__(self, simulator: Simulator, box: Box, bounds: Bounds, share: float, executor: Executor | None) -> None:
        self._simulator, self._box, self._executor = simulator, box, executor
        noise = noise_from_runs(simulator) if bounds.noise is None else bounds.noise
        self._bounds = bounds
        self.scale = np.where(bounds.scale > 0, bounds.scale, 1.0)
        self._floor = np.full(len(self.scale), SAME) if noise is None else noise / self.scale
        width = rms(bounds.upper / self.scale - bounds.lower / self.scale)
        self._width = np.where(np.isfinite(width), width, _WIDE)
        self._lowest, self._highest = bounds.lower - self._floor * self.scale, bounds.upper + self._floor * self.scale
        self.n, self._outside, self._missed = 0, np.zeros((2, *bounds.lower.shape)), np.zeros((1, *bounds.lower.shape))
        self._failed, self._share, self._n_outside, self._n_missed = "", share, 0, 0

    def run(self, points: Array) -> Array | None:
        """Responses (N, n_t, n_y) at points (N, d) of the unit box; None if a run fails."""
        P = parameter_samples(self._simulator, self._box, points)
        bounds, (Y, bad) = self._bounds, gathered(self._simulator, P, self._executor)
        if bad:
            self._failed = str(failure_records(self._simulator, self._box, P, bad)[0])
            ok = ~which_failed(bad, len(P))
            points, Y = points[ok], Y[ok]
        self.n += len(Y)
        if len(Y):
            outside = bounds.lower - Y.min(axis=0), Y.max(axis=0) - bounds.upper
            self._outside = np.maximum(self._outside, outside)
            self._n_outside += sum(bool(((y < self._lowest) | (y > self._highest)).any()) for y in Y)
        if len(Y) and bounds.surrogate is not None:
            missed = np.abs(bounds.surrogate.values(points) - Y)
            self._missed = np.maximum(self._missed, missed.max(axis=0))
            least = (self._share * self._width + self._floor) * self.scale
            self._n_missed += sum(bool((own > least).any()) for own in missed)
        return None if bad else Y

    def doubts(self, candidates: Array) -> tuple[str, ...]:
        """Sentences about large differences. The range of the surrogate is searched at candidates (N, d)."""
        bounds, share, of_all = self._bounds, self._share, f"of {self.n} other points"
        parts = [(f"runs at {self._n_outside} {of_all} are outside of the bounds", self._outside, share)]
        if bounds.surrogate is not None:
            parts.append((f"the polynomial differs from runs at {self._n_missed} {of_all}", self._missed, share))
        if bounds.surrogate is not None and not bounds.surrogate.exact:
            gap = self._gap(bounds.surrogate, candidates)
            parts.append(("the bounds are wider than the range of the method's polynomial", gap, DOUBTFUL))
        found = [(text, part * self._is_large(part, least)) for text, part, least in parts]
        doubts = list[str]()
        if any(part.any() for _, part in found):
            kinds = " and ".join(text for text, part in found if part.any())
            where = self._where(reduce(np.maximum, [part for _, part in found]))
            doubts.append(f"Check runs show errors of the bounds: {where}. {kinds[:1].upper()}{kinds[1:]}.")
        if self._failed and not bounds.failed:
            doubts.append(f"A check run failed, although no run of the method failed: {self._failed}")
        return tuple(doubts)

    def _is_large(self, error: Array, share: float) -> Mask:
        """Mask (n_y,) of the outputs with errors (2, n_t, n_y) above noise and a fraction of the width."""
        return self._size(error) > share * self._width + self._floor

    def _size(self, error: Array) -> Array:
        """Root mean square (n_y,) of errors (2, n_t, n_y), divided by the outputs' scale."""
        return rms((error / self.scale).reshape(-1, len(self.scale)))

    def _gap(self, surrogate: Piecewise, points: Array) -> Array:
        """Distances (2, n_t, n_y) of the bounds from the values of a surrogate at points (N, d).

        They are computed at some times. Other times have the distance of the closest of these times.
        """
        n_t = len(self._bounds.t)
        times = _evenly_spaced(n_t, _SEARCHED_TIMES)
        lower, upper, own = self._bounds.lower[times], self._bounds.upper[times], surrogate.part(times, slice(None))
        # The surrogate is evaluated at 64 points at once, to limit memory.
        parts = [own.values(some) for some in np.array_split(points, -(-len(points) // 64))]
        low = np.min([part.min(axis=0) for part in parts], axis=0)
        high = np.max([part.max(axis=0) for part in parts], axis=0)
        closest = np.linspace(0, len(times) - 1, n_t).round().astype(int)
        gap = np.maximum([low - lower, upper - high], 0.0)[:, closest]
        return np.where(np.isfinite(gap), gap, 0.0)  # some events never happen

    def _where(self, error: Array, most: int = 3) -> str:
        """Errors (2, n_t, n_y) in words: the outputs with large errors, and the time from which errors are large."""
        names, t = self._bounds.names, self._bounds.t
        size, width = self._size(error), self._width
        share = size / np.maximum(width, self._floor + SAME)
        large = sorted(np.flatnonzero(size), key=lambda k: -share[k])
        shares = [
            f"{names[k]} by {share[k]:.2g} of the width" if width[k] > 0 else f"{names[k]}, which has no width"
            for k in large[:most]
        ]
        more = [f"{len(large) - most} more outputs"] if len(large) > most else []
        first = np.argmax((error / self.scale > share * width / 2 + self._floor).any(axis=(0, 2)))
        since = f", from t = {t[first] + 0.0:g} s on" if len(t) > 1 else ""
        return ", ".join([*shares, *more]) + since


def _corners(d: int, varied: Indices) -> Array:
    """Points (N, d) of the unit box: some corners, and random points inside."""
    n, random = len(varied), np.random.default_rng(0)
    ends = some_corners(n, random)
    points = np.zeros((len(ends) + _POINTS_INSIDE, d))
    points[:, varied] = np.concatenate([ends, random.uniform(-1.0, 1.0, (_POINTS_INSIDE, n))])
    return points


def some_corners(d: int, random: np.random.Generator) -> Array:
    """All corners (N, d) of the unit box, or random corners if there are many."""
    return random.choice([-1.0, 1.0], (_MOST_CORNERS, d)) if 2**d > _MOST_CORNERS else corners(d)


def _star(d: int, varied: Indices) -> Array:
    """A point c near the centre, then the points with one parameter of c at its lower or upper end.

    The centre itself is not used, because most methods make a run at the centre, and have no error there.
    """
    n = len(varied)
    random = np.random.default_rng(1)
    star = np.zeros((1 + 2 * n, d))
    star[:, varied] = random.uniform(*_OFF_CENTRE, n) * random.choice([-1.0, 1.0], n)
    star[1 + np.arange(n), varied] = -1.0
    star[1 + n + np.arange(n), varied] = 1.0
    return star


def _predicted(Y: Array, c: Array, varied: Indices, candidates: Array) -> tuple[Array, Array]:
    """At most _RUNS_AT_EXTREMES points at extremes of parabolas, and the candidates with further extremes.

    Y (1 + 2 n, n_t, n_y) are the scaled responses at the points of `_star`, with the first point c (n,).
    """
    n, n_t, n_y = len(varied), *Y.shape[1:]
    outputs = _evenly_spaced(n_y, _PREDICTED_VALUES)
    times = _evenly_spaced(n_t, max(_PREDICTED_VALUES // len(outputs), 1))
    seen = Y[:, times][:, :, outputs]
    middle, low, high = seen[0], seen[1 : n + 1], seen[n + 1 :]
    at = c[:, None, None]
    with np.errstate(all="ignore"):
        slope = (high - low) / 2
        bend = 2 * ((high + low) / 2 + slope * at - middle) / (1 - at**2)
        top = np.where((bend < 0) & (np.abs(slope) < -bend), -slope / bend, np.where(slope < 0, -1.0, 1.0))
        bottom = np.where((bend > 0) & (np.abs(slope) < bend), -slope / bend, np.where(slope > 0, -1.0, 1.0))
    points = np.concatenate([top.reshape(n, -1), bottom.reshape(n, -1)], axis=1).T
    points = np.unique(np.round(points, 2), axis=0)
    values = middle + np.tensordot(points - c, slope, axes=1) + np.tensordot(points**2 - c**2, bend, axes=1) / 2
    width = rms(values.max(axis=0) - values.min(axis=0))
    width = np.where(width > 0, width, np.inf)
    values, seen = values / width, seen / width
    below, above = seen.min(axis=0), seen.max(axis=0)
    chosen = list[int]()
    for _ in range(_RUNS_AT_EXTREMES):
        beyond = (values - np.clip(values, below, above)).reshape(len(points), -1)
        gain = np.einsum("pk,pk->p", beyond, beyond)
        best = int(gain.argmax())
        if not gain[best] > 0:
            break
        chosen.append(best)
        below, above = np.minimum(below, values[best]), np.maximum(above, values[best])
    some = [*chosen, *_evenly_spaced(len(points), _POINTS_INSIDE)]
    predicted = np.zeros((len(some), candidates.shape[1]))
    predicted[:, varied] = points[some]
    return predicted[: len(chosen)], np.concatenate([candidates, predicted])


def _evenly_spaced(n: int, most: int) -> Indices:
    """At most `most` of the numbers below n."""
    return np.linspace(0, n - 1, min(n, most)).astype(int)
