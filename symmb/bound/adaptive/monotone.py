"""Bounds of responses that are monotonic in each parameter. Runs at corners attain these bounds."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices
from symmb.bound.adaptive.check_points import PATIENCE, SAFETY, evenly_spread_points, screening_points
from symmb.bound.adaptive.outputs import OutputProblem
from symmb.bound.adaptive.runs import OutputRuns, relative_rms
from symmb.bound.adaptive.small_study import Attempt, Checks, Noise, OutputStudy, Request
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.nodes import corners
from symmb.bound.responses import LEAST_WIDTH, rms


@dataclass(frozen=True)
class Corners(OutputStudy):
    """The extremes of runs at the corners where monotonic responses are lowest and highest.

    The effect of a parameter is the change of a response if only this parameter changes. Runs on both sides of the
    middle of the box, and along edges, show the effects. If each effect has one sign, the response is assumed to be
    monotonic. The signs then give the corners of the extremes. Times with almost the same corner use one corner.

    The estimated error has four parts: corners without a run, effects with the opposite sign, parabolas along the axes
    above their ends, and runs beyond the best corner. If this error is too large because signs change, and there are
    few corners, all corners are run. Responses with little curvature along each parameter, such as products, have their
    extremes at corners.

    Attributes
    ----------
    share : expected error of the extremes at corners, divided by the tolerance. The cause is that effects may change
        their signs between runs. Half of this error may come from the use of neighbouring corners. Smaller values take
        more runs
    inside : number of runs inside of the box, if an output has few times. No run at a corner sees a bump inside. Fewer
        runs miss bumps (tests/benchmarks/silent_errors.py)
    unlike : largest deviation of these runs from the expansion through the other runs, divided by the width. Smaller
        numbers take more runs
    """

    share: float = 0.2
    inside: int = 12
    unlike: float = 0.05

    name = "corners"
    when = "runs are not computed side by side, and responses are monotonic"

    def accepts(self, problem: OutputProblem) -> bool:
        return problem.found is None and not problem.has_corners and not problem.runs.has_lanes

    def steps(self, problem: OutputProblem) -> Attempt:
        runs, tolerance, problem.has_corners = problem.runs, problem.tolerance, True
        error = yield from self._error(runs, tolerance)
        if error is None:
            return None
        if problem.is_brief:  # values at many times show more, and no surface would follow
            inside = evenly_spread_points(self.inside, len(runs.box))
            yield Checks(inside)
            if problem.deviation(inside) > self.unlike:
                return None
        if not runs.noise_is_known:
            yield Noise()
        low, high = runs.extremes
        evidence = Evidence.of("corners", error + self.share * tolerance * (high - low))
        return EstimatedRange(low, high, evidence, problem.continued, "runs at corners", is_enough=True)

    def _error(self, runs: OutputRuns, tolerance: float) -> Generator[Request, None, Array | None]:
        """The estimated error (n_t, n_y) of the extremes at corners; None if it is too large."""
        d = len(runs.box)
        unit = np.eye(d)
        star = runs.at_nodes(np.concatenate([np.zeros((1, d)), -unit, unit]))
        lower_half, upper_half = star[0] - star[1 : d + 1], star[d + 1 :] - star[0]
        slope = lower_half + upper_half
        width = np.abs(slope).sum(axis=0)
        least = LEAST_WIDTH * rms(width)
        allowed = self.share / 2 * tolerance * np.maximum(width, least)
        bulge = _bulge(lower_half, upper_half)

        def is_too_large(error: Array) -> bool:
            return relative_rms(error, runs.rms_widths()) > tolerance

        # Parabolas along the axes are checked first, because they need no further run.
        if is_too_large(_beyond_noise(runs, bulge)) or not runs.are_ok:
            return None
        if runs.may_hide():
            yield Checks(screening_points(d)[: runs.left // 2])
        signs, own = _corners(slope.reshape(d, -1).T, allowed.ravel(), min(PATIENCE * d, (runs.left - 2 * d) // 2))
        if len(signs):
            error = yield from _error_at_own_corners(runs, slope, bulge, signs, own)
            if error is None or not is_too_large(error):
                return error
        error = yield from _error_at_all_corners(runs, bulge)  # e.g. effects in products change their signs
        return None if error is None or is_too_large(error) else error


def _beyond_noise(runs: OutputRuns, against: Array) -> Array:
    """The sum (n_t, n_y) of opposite effects (d, n_t, n_y), minus noise."""
    return np.maximum(against - 2 * runs.noise, 0.0).sum(axis=0)


def _error_at_own_corners(
    runs: OutputRuns, slope: Array, bulge: Array, signs: Array, own: Indices
) -> Generator[Request, None, Array | None]:
    """The estimated error (n_t, n_y) of the extremes at corners (K, d), one (m,) for each response, from slopes and
    curvature (d, n_t, n_y) along the axes; None if runs fail."""
    d, against = len(slope), bulge.copy()
    yield Checks(np.concatenate([signs, -signs, *_uncertain(signs[0], np.abs(slope).reshape(d, -1)[:, own == 0])]))
    values = runs.checked(np.concatenate([signs, -signs]))
    if values is None:
        return None
    at = own.reshape(1, *runs.shape)
    highest, lowest = (np.take_along_axis(each, at, axis=0)[0] for each in np.split(values, 2))
    edges = [*_edges(runs.points[(np.abs(runs.points) == 1).all(axis=1)], signs[0])]
    yield Checks(np.concatenate([points for both in edges for points in both]))
    for i, (ends, others) in enumerate(edges):
        at_ends, at_others = runs.checked(ends), runs.checked(others)
        if at_ends is None or at_others is None:
            return None
        for x, y, at_x, at_y in zip(ends[:, i], others[:, i], at_ends, at_others, strict=True):
            effect = (at_x - at_y) / (x - y)  # only the part opposite to the slope is used
            against[i] = np.maximum(against[i], np.where(slope[i] < 0, effect, -effect))
    lost = (np.abs(slope).reshape(d, -1) * (np.sign(slope).reshape(d, -1) != signs[own].T)).sum(axis=0)
    return _beyond_noise(runs, against) + SAFETY * (lost.reshape(runs.shape) + runs.beyond(lowest, highest))


def _error_at_all_corners(runs: OutputRuns, bulge: Array) -> Generator[Request, None, Array | None]:
    """The estimated error (n_t, n_y) of the extremes at all corners, from the curvature (d, n_t, n_y) along the axes
    and along edges at two corners; None if there are too many corners, or if runs fail."""
    d, every = len(bulge), corners(len(bulge))
    if 2**d > min(PATIENCE * d, runs.left - 2 * d):
        return None
    yield Checks(every)
    values = runs.checked(every)
    if values is None:
        return None
    base = np.stack(
        [every[np.bincount(side.ravel()).argmax()] for side in (values.argmin(axis=0), values.argmax(axis=0))]
    )
    yield Checks(np.concatenate([np.where(unit, 0.0, base) for unit in np.eye(d)]))
    bulge = bulge.copy()
    for i in range(d):
        triple = (runs.checked(np.where(np.arange(d) == i, factor * base, base)) for factor in (-1.0, 0.0, 1.0))
        below, middle, above = triple
        if below is None or middle is None or above is None:
            return None
        bulge[i] = np.maximum(bulge[i], _bulge(middle - below, above - middle).max(axis=0))
    return _beyond_noise(runs, bulge) + SAFETY * runs.beyond(values.min(axis=0), values.max(axis=0))


def _uncertain(corner: Array, slopes: Array) -> list[Array]:
    """Corners (3, d) that differ from a corner, and from its opposite, in the two parameters of smallest slopes (d,
    m)."""
    first, second = np.argsort(slopes.max(axis=1))[:2]
    flips = np.ones((3, len(corner)))
    flips[[0, 2], first] = flips[[1, 2], second] = -1.0
    return [flips * corner, -flips * corner]


def _bulge(lower: Array, upper: Array) -> Array:
    """The maximum of a parabola minus the larger value at its ends. The parabola changes by given values over the lower
    and the upper half of the interval."""
    slope, bend = np.abs(lower + upper) / 2, np.abs(upper - lower) / 2
    place = np.divide(slope, 2 * bend, out=np.ones_like(bend), where=2 * bend > slope)
    return bend * np.square(1 - place)


def _edges(corners: Array, corner: Array) -> Iterator[tuple[Array, Array]]:
    """For each parameter, points (n, d), and points that differ from them in this parameter only.

    The points are pairs of corners (K, d). Without corners, they are halves of the edges at a corner and its opposite.
    """
    row = {tuple(each): k for k, each in enumerate(corners.tolist())}
    for i in range(len(corner)):
        other = corners.copy()
        other[:, i] *= -1
        pairs = [k for k, each in enumerate(other.tolist()) if each[i] < 0 and tuple(each) in row]
        if pairs:
            yield corners[pairs], other[pairs]
        else:
            ends = np.stack([corner, -corner])
            yield ends, np.where(np.arange(len(corner)) == i, 0.0, ends)


def _corners(slope: Array, allowed: Array, most: int) -> tuple[Array, Indices]:
    """Corners (K, d) for slopes (m, d), and the corner (m,) of each response. Losses are at most `allowed` (m,).

    Responses with the same signs of all slopes form a group. The most frequent signs give the first corner. Groups with
    a small loss at this corner use it too. The result is empty if more than `most` corners are needed.
    """
    packed = np.packbits(slope >= 0, axis=1)
    _, first, group, count = np.unique(packed, axis=0, return_index=True, return_inverse=True, return_counts=True)
    signs, group = np.where(slope[first] < 0, -1.0, 1.0), group.ravel()
    share = np.zeros((len(signs), slope.shape[1]))
    with np.errstate(invalid="ignore"):  # a constant response has slope 0 and an allowed loss of 0
        np.maximum.at(share, group, np.where(slope != 0, np.abs(slope) / allowed[:, None], 0.0))
    taken = np.full(len(signs), -1)
    corners: list[Array] = []
    while (open_groups := taken < 0).any():
        if len(corners) >= most:
            return signs[:0], group
        corner = signs[np.argmax(np.where(open_groups, count, 0))]
        is_served = open_groups & ((share * (signs != corner)).sum(axis=1) <= 1.0)
        taken[is_served] = len(corners)
        corners.append(corner)
    return np.array(corners), taken[group]
