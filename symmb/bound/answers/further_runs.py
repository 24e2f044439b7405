"""Further runs near a limit: the search for the run that comes closest to the limit."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from symmb._magnitudes import LAST_DIGITS, SAME
from symmb._types import Array, Indices
from symmb.bound.answers.envelope import Envelope
from symmb.bound.nodes import Sobol
from symmb.bound.responses import SIDES
from symmb.bound.searches import LINE_POINTS, direct_search, gradient_sampling

_NEAR_LIMIT = 0.2
"""Distance of a limit divided by the width of bounds. For smaller distances, the search follows creases. Without this,
the direct search missed up to 0.15 of the width. tests/adaptive/test_creases.py"""
_CLOSE_TO_LIMIT = 0.03
"""Distance of a limit divided by the width of bounds. For smaller distances, searches along the axes follow. A peak
that moves past output times causes many local maxima. Smaller values miss more maxima. Larger values take more runs."""
_MISSED_HILL = 1e-3
"""Error of a search that ends inside the box, divided by the spread of the extremes of its first runs. A slightly
higher local maximum may be next to the highest known one. tests/benchmarks/machine_tolerances.py"""
_REPEATED = 3
"""Number of runs that are kept for the nominal run, and for the closest run, which is repeated."""
_SUFFICIENT_GAIN = 1e-4
"""Smallest relevant gain of a step along a crease, divided by the spread of the first runs."""


@dataclass(frozen=True, eq=False)
class FurtherRun:
    """The further run of a check that comes closest to a limit.

    Attributes
    ----------
    side : str                 side of the limit, "lower" or "upper"
    place : (d,)               parameters in the unit box
    values : (n_t,)            of the output
    beyond : float             largest distance of the values beyond the limit, negative inside
    error : float              distance by which other runs may be closer; infinite if the search was not completed
    runs, failed : int         number of further runs, and number of failed runs
    is_flat : bool             whether most runs have the same extreme, because the output is limited to this value
    between : float            time of the closest value [s] if it is between two output times; otherwise nan
    """

    side: str
    place: Array
    values: Array
    beyond: float
    error: float
    runs: int
    failed: int
    is_flat: bool
    between: float = np.nan

    @property
    def row(self) -> int:
        """Index of the time at which the run is closest to the limit."""
        return int(np.nanargmin(self.values) if self.side == "lower" else np.nanargmax(self.values))


class Excess:
    """The excess of runs over one end of a limit, negative inside of the limit. The worst run is stored.

    For curves of scenes, extremes over time are used, also between output times. Other outputs have values at output
    times only.

    Attributes
    ----------
    side : str                     side of the limit, "lower" or "upper"
    largest, place : float, (d,)   largest excess so far, and its point of the unit box
    runs, failed : int             number of runs so far, and number of failed runs
    first : (N,)                   excess of the first runs
    """

    def __init__(self, bounds: Envelope, k: int, side: str, limit: float) -> None:
        assert bounds.study is not None and bounds.box is not None
        self.side, self._bounds, self._study, self._k, self._limit = side, bounds, bounds.study, k, limit
        self._sign = -1.0 if side == "lower" else 1.0
        self.has_peaks = bounds.study.has_lanes and len(bounds.t) > 1 and bounds.names[k] not in bounds.figures
        self.runs, self.failed, self.largest, self.first = 0, 0, -np.inf, np.zeros(0)
        self.place = np.zeros(len(bounds.box))

    def __call__(self, points: Array) -> Array:
        """Make runs at points (N, d), and return the largest excess (N,) of each over time; -inf if a run fails.

        Without runs left, it is -inf.
        """
        most = int(min(max(self._study.left - _REPEATED, 0), len(points)))
        if most < len(points):
            made = self(points[:most]) if most else np.zeros(0)
            return np.concatenate([made, np.full(len(points) - most, -np.inf)])
        if self.has_peaks:
            own = self._study.extremes((self._bounds.names[self._k],), points)[SIDES.index(self.side), :, 0]
            return self.add(points, own)
        values, failed = self._study.of_output(self._k, points)
        self.failed -= int(np.isnan(values[:, 0]).sum()) - failed
        return self.add(points, self._sign * (self._sign * values).max(axis=1))

    def add(self, points: Array, own: Array) -> Array:
        """Count runs at points (N, d) with known extremes (N,), nan if they failed, and return their excess (N,)."""
        excess = np.nan_to_num(self._sign * (own - self._limit), nan=-np.inf)
        i = int(excess.argmax())
        self.first = self.first if self.runs else excess
        if excess[i] > self.largest:
            self.largest, self.place = float(excess[i]), points[i]
        self.runs, self.failed = self.runs + len(points), self.failed + int(np.isnan(own).sum())
        return excess

    @property
    def spread(self) -> float:
        """Difference of the largest and the smallest excess of the first runs."""
        return self.largest - float(self.first[np.isfinite(self.first)].min(initial=self.largest))

    def is_flat(self) -> bool:
        """Whether most first runs and the nominal run have the largest excess, because the output cannot exceed it."""
        least = self.largest - LAST_DIGITS * (abs(self._limit) + abs(self.largest))
        nominal = self._study.nominal[0] if 2 * (self.first >= least).sum() > len(self.first) else None
        return nominal is not None and bool((self._sign * (nominal[:, self._k] - self._limit)).max() >= least)

    def further_run(self, error: float, is_flat: bool = False) -> FurtherRun:
        """The run with the largest excess. Other runs may be closer to the limit by `error`."""
        bounds, between = self._bounds, np.nan
        if not self.has_peaks or self.largest == -np.inf:
            values = self._study.of_output(self._k, self.place[None])[0][0]
        else:
            times, Y = self._study.at_many_times(self.place)
            curves = [name for name in bounds.names if name not in bounds.figures]
            fine = Y[:, curves.index(bounds.names[self._k])]
            every = (len(times) - 1) // (len(bounds.t) - 1)
            own = np.nan_to_num(self._sign * fine, nan=-np.inf)
            best = np.flatnonzero(own >= own.max() - SAME * abs(own.max()))
            moment = int(min(best, key=lambda i: i % every != 0))  # output times are preferred
            values, row = fine[::every].copy(), int(np.abs(bounds.t - times[moment]).argmin())
            if moment % every:
                # The extreme replaces the value at the closest output time, so that the margin there is correct.
                between, values[row] = float(times[moment]), self._limit + self._sign * self.largest
        return FurtherRun(self.side, self.place, values, self.largest, error, self.runs, self.failed, is_flat, between)


def closest_run(bounds: Envelope, k: int, side: str, limit: float, rows: Indices, enough: float) -> FurtherRun:
    """The further run that is closest to a limit, or farthest beyond the limit, from a search with several starts.

    The starts are the worst runs of the study, the extremes of its polynomials, and the nearest corners. The starts are
    taken at the first of the times `rows` (n_t,) that have different runs. If runs cost little, starts also include
    points with two changed parameters, and points spread over the box. If the limit is close, searches along lines
    through the best run follow. An excess above `enough` ends the search.
    """
    study, box = bounds.study, bounds.box
    assert study is not None and box is not None
    excess = Excess(bounds, k, side, limit)
    points = np.clip(np.concatenate([*_starts(bounds, k, side, rows)]).round(9), -1.0, 1.0)  # corners to the last digit
    points = np.concatenate([points, np.where(points < 0, -1.0, 1.0)])
    # Many runs of a scene cost little.
    most = max(600, bounds.evaluations) if study.left == np.inf else int(study.left)
    error, width = direct_search(excess, points, most, enough).error, _width(bounds, k)
    if study.has_lanes and 0 <= -excess.largest < _NEAR_LIMIT * width:
        error = _along_crease(excess, error, enough)
    if study.has_lanes and 0 <= -excess.largest < _CLOSE_TO_LIMIT * width:
        # A poll stays near its local maximum. Lines over the whole box find other local maxima along each parameter.
        before, lines = excess.largest, np.tile(excess.place, (len(box), LINE_POINTS, 1))
        lines[range(len(box)), :, range(len(box))] = np.linspace(-1.0, 1.0, LINE_POINTS)
        found = direct_search(excess, np.concatenate([excess.place[None], *lines]), most, enough)
        error = _along_crease(excess, found.error, enough) if excess.largest > before else found.error
    is_flat = excess.is_flat()
    run = excess.further_run(error, is_flat)
    if study.has_lanes and bounds.estimate is not None and not is_flat and _is_on_hill(bounds, k, run, enough):
        error = max(error, min(float(bounds.estimate[:, k].max()), _MISSED_HILL * excess.spread))
    return replace(run, error=error)


def _along_crease(excess: Excess, error: float, enough: float) -> float:
    """The error of the closest run after a search along a crease, if the run is in the box and not beyond `enough`."""
    if excess.largest > enough or (np.abs(excess.place) == 1.0).all():
        return error
    return gradient_sampling(excess, excess.place, excess.largest, _SUFFICIENT_GAIN * excess.spread, enough).error


def _starts(bounds: Envelope, k: int, side: str, rows: Indices) -> Iterator[Array]:
    """Points (n, d) from which the search for the closest run starts."""
    study, box = bounds.study, bounds.box
    assert study is not None and box is not None
    # If runs cost little, runs of the study at several times and points spread over the box are further starts.
    d, peaks = len(box), 3 if study.has_lanes else 1
    some = rows_of_runs(bounds, k, side, rows)[:peaks]
    first = attaining_points(bounds, k, side, some)
    yield first
    if study.has_lanes:
        # Studies usually miss corners that differ from the known worst corner in two parameters with a joint effect.
        signs = [np.where(np.isin(np.arange(d), pair), -1.0, 1.0) for pair in combinations(range(d), 2)]
        yield np.reshape(signs, (-1, d)) * first[0]
        yield Sobol().points(16, d, seed=0)
    if bounds.surrogate is not None:
        one = np.ones(d)
        yield bounds.surrogate.part(some, [k]).range(-one, one)[2][SIDES.index(side), :, 0]


def rows_of_runs(bounds: Envelope, k: int, side: str, rows: Indices) -> Indices:
    """The time indices at which a run attains the bounds for the first time; all indices if the runs are not known.

    Neighbouring times often have the same run, so that the first indices alone would give one run several times.
    """
    if bounds.attaining is None:
        return rows
    return rows[np.sort(np.unique(bounds.attaining.at[side][rows, k], return_index=True)[1])]


def attaining_points(bounds: Envelope, k: int, side: str, rows: Indices) -> Array:
    """Points (n, d) of the unit box of runs that attain bounds at `rows`; the centre if the runs are not known."""
    box, runs = bounds.box, bounds.attaining
    assert box is not None
    if runs is None:
        return np.zeros((1, len(box)))
    columns = [list(runs.simulator.parameters).index(name) for name in box.names]
    samples = runs.samples([(side, int(i), k) for i in rows])
    return box.to_unit(np.stack([sample.P[sample.index, columns] for sample in samples]))


def _is_on_hill(bounds: Envelope, k: int, run: FurtherRun, floor: float) -> bool:
    """Whether the closest run is inside the box in a parameter that has an effect at the time of the run's extreme.

    A parameter without effect at this time causes no local maximum, so there can be no higher one nearby.
    """
    inside = np.abs(run.place) < 1.0
    if bounds.surrogate is not None and np.isfinite(run.values).any():
        inside &= bounds.surrogate.part([run.row], [k]).acting(np.array([floor]))
    return bool(inside.any())


def _width(bounds: Envelope, k: int) -> float:
    """Largest width of the bounds of output k."""
    return float((bounds.upper - bounds.lower)[:, k].max())
