"""Rounds of check runs near extremes of one output, which correct an interpolant and measure its error."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array, Mask
from symmb.bound.adaptive.check_points import FIELD_SAFETY, SAFETY, inflated_error, select_dispersed
from symmb.bound.adaptive.continuation import REMAINING_SHARE, SPARSE_PROBES, SPARSE_RANGE, Continuation, Corrected
from symmb.bound.adaptive.runs import OutputRuns, relative_rms
from symmb.bound.adaptive.small_study import Checks, Places, Request, Steps
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.nodes import Grid, Index
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import DOUBTFUL, rms

LEAST_ROUNDS = 2
"""The smallest number of rounds, and the number of last rounds that measure the excess of runs over earlier extremes.
Larger numbers miss fewer extremes and take more runs."""
FITTED_VALUES = 4, 12
"""Number of best runs per coefficient for a fit of parabolas. With too few runs, the fit only describes the best runs.
With too many runs, it describes runs far from the extreme."""
IDLE_ROUNDS, IDLE_RATIO = 10, 0.9
"""Number of rounds of cheap runs in which the least error must fall to this ratio. With 10 rounds, 24 everyday machines
have the same bounds as without an end. Unresolved elements of a small part of the box never end otherwise."""
BESIDE_STEP = 0.3
"""Change of one parameter of a run at an extreme, in the search for larger extremes. Smaller steps take more rounds.
Larger steps leave a narrow ridge. (calibrated by tests/benchmarks/everyday_machines.py)"""


@dataclass
class Foreseen:
    """Predicted and attained distance beyond earlier runs: sums of squares over points and times.

    Attributes
    ----------
    foreseen : sum of the predicted distances
    unconfirmed : sum of the differences between runs and predictions, at points with a predicted distance
    attained : sum of the distances that runs attain at these points
    """

    foreseen: float = 0.0
    unconfirmed: float = 0.0
    attained: float = 0.0

    def add(self, predicted: Array, Y: Array, lowest: Array, highest: Array) -> None:
        """Add predicted and true responses (C, n_t, 1) at new points, with the extremes (n_t, 1) of earlier runs."""
        beyond = np.maximum(np.maximum(lowest - predicted, predicted - highest), 0.0)
        gain = np.maximum(np.maximum(lowest - Y, Y - highest), 0.0)
        self.foreseen += float(np.square(beyond).sum())
        self.unconfirmed += float(np.square(Y - predicted)[beyond > 0].sum())
        self.attained += float(np.square(gain)[beyond > 0].sum())

    def add_at(self, places: Array, foreseen: Array, points: Array, gains: Array) -> None:
        """Add predicted distances and attained distances (2, n_t, 1), at places (2, n_t, 1, d) that are in points (C,
        d)."""
        is_run = is_among(places, points) & (foreseen > 0)
        self.foreseen += float(np.square(foreseen[is_run]).sum())
        self.attained += float(np.square(gains[is_run]).sum())

    def share(self, part: float) -> float:
        """Root of the ratio of a sum, `unconfirmed` or `attained`, to the predicted sum; 1 if nothing is predicted."""
        return min(part / self.foreseen, 1.0) ** 0.5 if self.foreseen else 1.0


@dataclass
class Gain:
    """How the errors of rounds decrease.

    Attributes
    ----------
    least : least error so far, over the width
    idle : number of rounds since it fell
    """

    least: float = np.inf
    idle: int = 0

    def is_idle(self, error: float) -> bool:
        """Add the error of a round. Return whether the least error has not fallen for many rounds."""
        self.least, self.idle = (error, 0) if error < IDLE_RATIO * self.least else (self.least, self.idle + 1)
        return self.idle >= IDLE_ROUNDS


@dataclass
class CheckRounds:
    """Two ranges of an output with their errors, from rounds of check runs. The range with the smaller error is used.

    The first range is the range of an expansion. The check runs of each round correct the expansion. The runs of the
    next round show the error of the range. Rounds end when this error is small enough or no longer decreases. The
    continuation expects an error at x that is s(x) times the typical error. A new run at x with the error e suggests a
    typical error of e / s(x). The first range may exceed all runs. In earlier rounds, runs have attained a fraction of
    the predicted excess. The bounds contain the same fraction of the present excess. The error of the excess is the
    fraction that runs attained, or the fraction that runs did not confirm, if this fraction is smaller.

    The second range contains the extremes of all runs, if corners have been run. The error of this range is the largest
    of four values:

    - the gain of the last rounds
    - the gain from twice as many runs inside the box
    - the excess of the first range, times the fraction that runs have attained
    - the change of the extreme run to the next time, times the fraction of this change that runs near this run gained.
      Other runs are rarely near an extreme of a single time.

    If no run differs from the interpolant at a time, the error at this time is at most the excess of the first range.

    Attributes
    ----------
    runs : OutputRuns
    base, grid : the interpolant, and its grid
    sizes : expected absolute values of the coefficients just outside of the grid
    estimate : (n_t, 1) estimated error of the interpolant
    tolerance : largest accepted ratio of the error to the width
    has_corners : whether corners have been run
    gain : how the errors of all rounds of the output have decreased
    """

    runs: OutputRuns
    base: Expansion
    grid: Grid
    sizes: dict[Index, float]
    estimate: Array
    tolerance: float
    has_corners: bool
    gain: Gain
    _foreseen: Foreseen = field(default_factory=Foreseen)
    _beside: Foreseen = field(default_factory=Foreseen)

    def steps(self) -> Steps:
        """Make rounds of check runs, and return the more accurate of two ranges."""
        runs = self.runs
        self._safety = SAFETY if runs.may_hide() else FIELD_SAFETY
        self._continuation = Continuation.of(self.grid, self.sizes)
        self._correct(Corrected.of(self.base, self._continuation, runs.points, runs.checks))
        few = Corrected.of(self.base, self._continuation, runs.points[:SPARSE_PROBES], runs.checks[:SPARSE_PROBES])
        self._typical = rms(few.expected_error(self._places).ravel())
        share = self._remaining_share(self._places)
        self._observed = self._remaining = self.estimate
        self._searched = np.empty((0, len(runs.box)))
        self._gains, before = [np.full(runs.shape, np.inf)] * LEAST_ROUNDS, np.inf
        n_rounds = n_worse = 0
        while True:
            n_known, extremes, former = len(runs.points), runs.extremes, self._corrected
            if self.has_corners:
                # The next runs are near known runs. They are made first, because the last runs of a round measure the
                # error.
                yield Checks(separable_extremes(*runs.attained()))
                yield from self._search_beside()
            n_beside = len(runs.points) - n_known
            unconfirmed = self._foreseen.share(self._foreseen.unconfirmed) * self._unattained()
            yield Places(self._places, np.maximum(share * self.estimate, unconfirmed) / runs.rms_widths())
            points, Y = runs.points[n_known:], runs.checks[n_known:]
            if not len(points):
                break
            predicted = former.values(points)
            self._foreseen.add(predicted, Y, *extremes)
            self._gains.append(inflated_error(np.square(runs.beyond(*extremes)), self._safety))
            errors = (Y - predicted) / self._remaining_share(points)[:, None, None]
            errors = errors[n_beside:] if n_beside < len(errors) else errors  # earlier errors are near known runs
            self._observed = (1 + 1 / len(errors)) * inflated_error(np.mean(np.square(errors), axis=0), self._safety)
            self._correct(former.extended(points, Y))
            share = self._remaining_share(self._places)
            self._remaining = share.max(axis=0) * np.maximum(self._observed, REMAINING_SHARE * self.estimate)
            error = min(relative_rms(each.error, runs.rms_widths()) for each in self._errors())
            n_worse = n_worse + 1 if error >= before else 0
            is_cheap = runs.has_lanes and error > DOUBTFUL  # cheap runs may still decide uncertain outputs
            is_idle = self.gain.is_idle(error)
            is_done = error <= self.tolerance or (is_idle if is_cheap else n_worse > self.has_corners)
            n_rounds += 1
            if (is_done and n_rounds >= LEAST_ROUNDS) or runs.clock.is_late:
                break
            before = error
        return self._better()

    def _search_beside(self) -> Iterator[Request]:
        """Runs near extreme runs that change fast over time. Earlier places are left out."""
        runs, (lowest, highest) = self.runs, self.runs.extremes
        at, swings = swings_at_extremes(runs)
        new = select_dispersed(at, np.where(is_among(at, self._searched), 0.0, swings), len(runs.box))
        yield Checks(points_beside(new))
        gains = np.stack([lowest - runs.extremes[0], runs.extremes[1] - highest])
        self._beside.add_at(at, swings, new, gains)
        self._searched = np.concatenate([self._searched, new])

    def _correct(self, corrected: Corrected) -> None:
        """Use an expansion that is continued through all check runs, and compute its range."""
        self._corrected = corrected
        self._lower, self._upper, self._places = corrected.range(SPARSE_RANGE * self.tolerance)

    def _remaining_share(self, places: Array) -> Array:
        """Fraction of the typical error of extremes that remains at places (..., d) after the check runs."""
        error = self._corrected.expected_error(places)
        ratio = np.divide(error, self._typical, out=np.ones_like(error), where=error < self._typical)
        return REMAINING_SHARE + (1 - REMAINING_SHARE) * ratio

    def _unattained(self) -> Array:
        """Distance (2, n_t, 1) of the range from the extremes of runs at its minima and maxima, without noise."""
        lowest, highest = self.runs.extremes
        return np.maximum(np.stack([lowest - self._lower, self._upper - highest]) - self.runs.noise, 0.0)

    def _errors(self, spread: bool = False) -> list[Evidence]:
        """Errors (n_t, 1) of the range and, if corners were run, of the extremes of runs."""
        foreseen, exceeding, (lowest, highest) = self._foreseen, self._unattained().max(axis=0), self.runs.extremes
        part = min(foreseen.attained, foreseen.unconfirmed)
        errors = [("check runs", self._remaining, self._upper - self._lower, part)]
        if self.has_corners and len(self._gains) > 2 * LEAST_ROUNDS - 1:
            swings = swings_at_extremes(self.runs)[1].max(axis=0)
            beside = self._safety * self._beside.share(self._beside.attained) * swings
            gained = np.max([*self._gains[-LEAST_ROUNDS:], growth_inside(self.runs, self._safety), beside], axis=0)
            errors.append(("gains", gained, highest - lowest, foreseen.attained))
        return [
            Evidence.of(rule, spread_over_times(error, width) if spread else error).at_least(
                "unconfirmed", foreseen.share(part) * exceeding
            )
            for rule, error, width, part in errors
        ]

    def _better(self) -> EstimatedRange:
        runs, corrected, observed = self.runs, self._corrected, self._observed
        width = self._upper - self._lower

        def polynomials() -> Piecewise:
            return Piecewise.whole(corrected.expansion(), spread_over_times(observed, width))

        (lowest, highest), (below, above) = runs.extremes, self._unattained()
        # Before the first event, all runs agree with the interpolant. The error is not raised there.
        seen = np.square(runs.checks - self.base.values(runs.points)).max(axis=0, initial=0.0)
        agreed = inflated_error(seen, self._safety) + np.maximum(below, above)
        # No error is larger than the width.
        errors = [
            each.at_most("check runs", agreed).at_most("unseen", highest - lowest) for each in self._errors(spread=True)
        ]
        best = int(np.argmin([relative_rms(each.error, runs.rms_widths()) for each in errors]))
        if best:
            return EstimatedRange(lowest, highest, errors[best], polynomials, "runs near extremes", self._places)
        # Further runs are expected to attain the same fraction of predicted distances as earlier runs.
        share, name = self._foreseen.share(self._foreseen.attained), "an interpolant on a sparse grid"
        lower, upper = lowest - share * below, highest + share * above
        return EstimatedRange(lower, upper, errors[best], polynomials, name, self._places)


def is_among(places: Array, points: Array) -> Mask:
    """Mask (...) of the places (..., d) that are equal to one of the points (m, d)."""
    found = np.zeros(places.shape[:-1], dtype=bool)
    for point in points:
        found |= np.abs(places - point).max(axis=-1) < SAME
    return found


def swings_at_extremes(runs: OutputRuns) -> tuple[Array, Array]:
    """Places (2, n_t, 1, d) of the extremes of runs, and the changes (2, n_t, 1) of these runs to neighbouring times.

    If a run changes fast, e.g. at an impact, few other runs are near an extreme at the same time. Changes up to a
    fraction DOUBTFUL of the width are replaced by 0.
    """
    points, Y = runs.attained()
    rows, k = np.stack([Y.argmin(axis=0), Y.argmax(axis=0)]), np.arange(runs.shape[0])[:, None]
    before, now, after = (Y[rows, np.clip(k + step, 0, len(k) - 1), 0] for step in (-1, 0, 1))
    swings = np.maximum(np.abs(before - now), np.abs(after - now))
    return points[rows], np.where(swings > DOUBTFUL * runs.rms_widths(), swings, 0.0)


def points_beside(places: Array) -> Array:
    """Points (N, d) that differ from one of the places (m, d) by BESIDE_STEP in one parameter."""
    steps = BESIDE_STEP * np.concatenate([np.eye(places.shape[1]), -np.eye(places.shape[1])])
    return np.unique(np.clip(places[:, None] + steps, -1.0, 1.0).reshape(-1, places.shape[1]), axis=0)


def growth_inside(runs: OutputRuns, safety: float) -> Array:
    """Expected errors (n_t, 1) of the extremes of runs: the gain from twice as many runs that are not at corners.

    The error is 0 if no run exceeds the extremes at corners.
    """
    points, Y = runs.attained()
    is_corner = (np.abs(points) == 1).all(axis=1)
    growth = np.zeros(runs.shape)
    for values in (Y, -Y):
        ends, inside = values[is_corner].max(axis=0, initial=-np.inf), values[~is_corner]
        halves = [np.maximum(half.max(axis=0), ends) for half in (inside[::2], inside[1::2])]
        growth = np.maximum(growth, np.maximum(*halves) - np.mean(halves, axis=0) - runs.noise)
    return safety * inflated_error(np.square(np.maximum(growth, 0.0)), safety)


def separable_extremes(points: Array, Y: Array) -> Array:
    """Places (k, d) of extremes of separable parabolas, for at most 2 d times.

    The parabolas are fitted to the lowest and to the highest responses Y (N, n_t, 1) at points (N, d).
    """
    d, places = points.shape[1], list[Array]()
    terms = np.concatenate([np.ones((len(points), 1)), points, np.square(points)], axis=1)
    for time in np.unique(np.linspace(0, Y.shape[1] - 1, 2 * d).astype(int)):
        for sign, near in product((1, -1), FITTED_VALUES):
            y = sign * Y[:, time, 0]
            rows = np.argsort(y, kind="stable")[: near * terms.shape[1]]
            _, slope, bend = np.split(np.linalg.lstsq(terms[rows], y[rows])[0], [1, d + 1])
            vertex = np.divide(-slope, 2 * bend, out=-np.sign(slope), where=bend > 0)
            places.append(np.clip(vertex, -1.0, 1.0))
    return np.array(places)


def spread_over_times(error: Array, width: Array) -> Array:
    """Errors (n_t, n_y) distributed over time: half of each squared error is a constant fraction of the squared width.

    A few check runs show the size of errors reliably, but not the times at which the errors are small.
    """
    share = np.divide(
        rms(error), rms(width), out=np.zeros(width.shape[1]), where=(rms(width) > 0) & np.isfinite(rms(error))
    )
    return np.sqrt((np.square(error) + np.square(share * width)) / 2)
