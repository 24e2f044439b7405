"""Further runs near a limit: the search for the run that comes closest to the limit."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from symmb._magnitudes import LAST_DIGITS
from symmb._types import Array, Indices
from symmb.bound.bounds.direct_search import LINE_POINTS, direct_search
from symmb.bound.bounds.envelope import Envelope
from symmb.bound.bounds.worst_case import SIDES
from symmb.bound.nodes import Sobol

_CLOSE_TO_LIMIT = 0.03
"""Distance of a limit divided by the width of bounds. If it is smaller, lines along the axes follow after the search,
because a peak that passes output times makes many hills. Smaller values miss more. Larger values take more runs."""
_MISSED_HILL = 1e-3
"""Distance divided by the width of bounds that a search may miss if it ends inside the box. A slightly higher hill may
be beside the highest known hill. tests/benchmarks/machine_tolerances.py"""


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
    runs, failed : int         number of further runs, and of those that failed
    is_flat : bool             whether most runs have the same extreme, because the output is limited to this value
    """

    side: str
    place: Array
    values: Array
    beyond: float
    error: float
    runs: int
    failed: int
    is_flat: bool

    @property
    def row(self) -> int:
        """Index of the time at which the run is closest to the limit."""
        return int(np.nanargmin(self.values) if self.side == "lower" else np.nanargmax(self.values))


class _Excess:
    """The excess of runs over a limit, which is negative inside. The run with the largest excess is stored."""

    def __init__(self, bounds: Envelope, k: int, sign: float, limit: float) -> None:
        assert bounds.study is not None and bounds.box is not None
        self._study, self._k, self._sign, self._limit = bounds.study, k, sign, limit
        self.runs, self.failed, self.largest, self.first = 0, 0, -np.inf, np.zeros(0)
        self.place, self.values = np.zeros(len(bounds.box)), np.full(len(bounds.t), np.nan)

    def __call__(self, points: Array) -> Array:
        """Largest excess (N,) over time at points (N, d); minus infinity for failed runs."""
        Y, bad = self._study.attempted(points)
        excess = np.nan_to_num((self._sign * (Y[:, :, self._k] - self._limit)).max(axis=1), nan=-np.inf)
        i = int(excess.argmax())
        self.first = self.first if self.runs else excess
        if excess[i] > self.largest:
            self.largest, self.place, self.values = float(excess[i]), points[i], Y[i, :, self._k]
        self.runs, self.failed = self.runs + len(points), self.failed + len(bad)
        return excess

    def is_flat(self) -> bool:
        """Whether most starts and the nominal run have the largest excess. This does not happen on a hill."""
        least = self.largest - LAST_DIGITS * (abs(self._limit) + abs(self.largest))
        nominal = self._study.nominal[0] if np.mean(self.first >= least) > 0.5 else None
        return nominal is not None and bool((self._sign * (nominal[:, self._k] - self._limit)).max() >= least)


def closest_run(bounds: Envelope, k: int, side: str, limit: float, rows: Indices, enough: float) -> FurtherRun:
    """The further run that is closest to a limit, or farthest beyond it, from a search with several starts.

    The starts are the worst runs of the study, the extremes of its polynomials, and the nearest corners. They are taken
    at the first of the rows (n_t,) that have different runs. If runs cost little, starts also include points with two
    parameters changed, and points spread over the box. If the limit is close, lines through the best run follow. An
    excess above `enough` ends the search.
    """
    study, box, sign = bounds.study, bounds.box, -1.0 if side == "lower" else 1.0
    assert study is not None and box is not None
    excess = _Excess(bounds, k, sign, limit)
    points = np.clip(np.concatenate([*_starts(bounds, k, side, rows)]).round(9), -1.0, 1.0)  # corners to the last digit
    points = np.concatenate([points, np.where(points < 0, -1.0, 1.0)])
    # Many runs of a scene cost little. Other simulators make at most twice as many runs as the study.
    most = max(600, bounds.evaluations) if study.has_lanes else 2 * bounds.evaluations
    error = direct_search(excess, points, most, enough).error
    if study.has_lanes and 0 <= -excess.largest < _CLOSE_TO_LIMIT * _width(bounds, k):
        # A poll stays on its hill. Lines over the whole box find other hills along each parameter.
        lines = np.tile(excess.place, (len(box), LINE_POINTS, 1))
        lines[range(len(box)), :, range(len(box))] = np.linspace(-1.0, 1.0, LINE_POINTS)
        error = direct_search(excess, np.concatenate([excess.place[None], *lines]), most, enough).error
    is_flat = excess.is_flat()
    if study.has_lanes and bounds.estimate is not None and not is_flat and _is_on_hill(bounds, k, sign, excess, enough):
        error = max(error, min(float(bounds.estimate[:, k].max()), _MISSED_HILL * _width(bounds, k)))
    return FurtherRun(side, excess.place, excess.values, excess.largest, error, excess.runs, excess.failed, is_flat)


def _starts(bounds: Envelope, k: int, side: str, rows: Indices) -> Iterator[Array]:
    """Points (n, d) from which the search for the closest run starts."""
    study, box = bounds.study, bounds.box
    assert study is not None and box is not None
    # Runs of the study at several times, and points that are spread over the box, are starts only if runs cost little.
    d, peaks = len(box), 3 if study.has_lanes else 1
    some = rows_of_runs(bounds, k, side, rows)[:peaks]
    first = attaining_points(bounds, k, side, some)
    yield first
    if study.has_lanes:
        # Corners that studies miss usually differ from the known worst corner in two parameters that act only together.
        signs = [np.where(np.isin(np.arange(d), pair), -1.0, 1.0) for pair in combinations(range(d), 2)]
        yield np.reshape(signs, (-1, d)) * first[0]
        yield Sobol().points(16, d, seed=0)
    if bounds.surrogate is not None:
        one = np.ones(d)
        yield bounds.surrogate.part(some, [k]).range(-one, one)[2][SIDES.index(side), :, 0]


def rows_of_runs(bounds: Envelope, k: int, side: str, rows: Indices) -> Indices:
    """The rows at which bounds are attained by a run for the first time; all if the runs are not known.

    Neighbouring times share a run, so that the first rows alone would give one run several times.
    """
    if bounds.attaining is None:
        return rows
    return rows[np.sort(np.unique(bounds.attaining.at[side][rows, k], return_index=True)[1])]


def attaining_points(bounds: Envelope, k: int, side: str, rows: Indices) -> Array:
    """Points (n, d) of the unit box of runs that attain bounds at rows; the middle if the runs are not known."""
    box, runs = bounds.box, bounds.attaining
    assert box is not None
    if runs is None:
        return np.zeros((1, len(box)))
    columns = [list(runs.simulator.parameters).index(name) for name in box.names]
    samples = runs.samples([(side, int(i), k) for i in rows])
    return box.to_unit(np.stack([sample.P[sample.index, columns] for sample in samples]))


def _is_on_hill(bounds: Envelope, k: int, sign: float, excess: _Excess, floor: float) -> bool:
    """Whether the closest run is inside the box in a parameter that acts at the time of the run's extreme.

    A parameter without effect at this time makes no hill, so no higher hill can be beside it.
    """
    inside = np.abs(excess.place) < 1.0
    if bounds.surrogate is not None:
        row = int(np.nan_to_num(sign * excess.values, nan=-np.inf).argmax())
        inside &= bounds.surrogate.part([row], [k]).acting(np.array([floor]))
    return bool(inside.any())


def _width(bounds: Envelope, k: int) -> float:
    """Largest width of the bounds of output number k."""
    return float((bounds.upper - bounds.lower)[:, k].max())
