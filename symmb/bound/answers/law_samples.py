"""Samples of an output by the distributions of parameters, from polynomials, from least squares or from runs."""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from symmb._types import Array, Indices
from symmb.bound.answers.laws import Laws
from symmb.bound.answers.limit_state import SETS_OF_SAMPLES
from symmb.bound.nodes import Random, Sobol, corners, fitted
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import FINE, Responses, RunsUsedUpError

_SAMPLES_OF_POLYNOMIALS, _SAMPLES_WITH_SEARCH, SAMPLES_BEFORE_RUNS = 512, 128, 32
"""Numbers of samples of a set for three cases: from polynomials; if each sample requires a search or a run; and if runs
near a limit may follow. Larger numbers take more time."""
_MOST_VALUES = 2**30
"""Largest number of values from polynomials. With more output times, samples are fewer, and their error is larger."""
SAMPLES_ON_CARD, _BINS = 2**17, 2048
"""Number of samples of a set if runs on a graphics card are the samples, and number of bins of their values."""
_LEAST_RUNS_OF_A_SET = 4
"""Smallest number of samples of a set, if fewer runs are allowed than usual."""
_VERIFYING_RUNS = 32
"""Number of runs at samples of the distributions. They verify the values of polynomials, not only their range."""
SAFETY_OF_RUNS = 2.0
"""The reported error of polynomials, divided by the residual at runs that are not used in the fit."""
_FITTED_RUNS, _POINTS_INSIDE, _INTERVALS_OF_ALL_CORNERS = 256, 32, 5
"""Number of runs of a fit if polynomials are not accurate enough, number of points inside the intervals, and largest
number of intervals for which all corners are used."""
STANDARD_ERRORS = 3.5
"""The reported sampling error divided by the standard error of the mean of the sets. It is the quantile for 99 % of
Student's t with 7 degrees of freedom."""


def verifying_runs(responses: Responses) -> int:
    """Number of runs that verify polynomials."""
    return 0 if responses.runs is None else int(min(_VERIFYING_RUNS, responses.runs.left))


class LawSamples:
    """Samples of an output: sets of points that follow the distributions, and ranges over all other parameters.

    Attributes
    ----------
    free : (d,)            parameters without a distribution
    number : int           number of all samples
    error : (n_t,)         error of the polynomials
    surrogate : Piecewise  None if runs are the samples
    """

    def __init__(
        self, owner: str, responses: Responses, k: int, laws: object, correlation: object, n: int = _SAMPLES_WITH_SEARCH
    ) -> None:
        self.responses, self.column, self._laws = responses, k, Laws.of(owner, laws, correlation, responses.box)
        self.columns = self._laws.columns
        self.free = responses.box.radius > 0
        self.free[self.columns] = False
        self.runs, self._around = responses.extra_runs, np.zeros((1, 0))
        self.surrogate, self.error = responses.own(k), np.zeros(len(responses.t))
        if self.surrogate is not None:
            self.error = self.surrogate.error[:, 0]
            if verifying_runs(responses):
                self.runs += verifying_runs(responses)
                residual = np.abs(
                    self.surrogate.values(self.unit_points(self.checks[0]))[:, :, 0] - self.checks[1]
                ).max(axis=0)
                self.error = SAFETY_OF_RUNS * residual
                if not responses.are_good(self.error[:, None], [k])[0]:
                    self.surrogate = None
        if self.surrogate is None and self.free.any():
            self.runs += verifying_runs(responses) if responses.own(k) is None else 0
            self._fit()
        if self.surrogate is None and responses.runs is not None and responses.runs.left < SETS_OF_SAMPLES * n:
            n = int(responses.runs.left) // SETS_OF_SAMPLES
            if n < _LEAST_RUNS_OF_A_SET:
                raise RunsUsedUpError("The samples need more runs.")
        if self.surrogate is not None:
            is_large = SETS_OF_SAMPLES * _SAMPLES_OF_POLYNOMIALS * len(self.error) > _MOST_VALUES
            n = _SAMPLES_WITH_SEARCH if self.free.any() or is_large else _SAMPLES_OF_POLYNOMIALS
        self.draw(n)

    @cached_property
    def checks(self) -> tuple[Array, Array]:
        """Uniform numbers (N, n_l + n_free) of runs, and responses (N, n_t). The runs follow the distributions. Other
        parameters are uniform."""
        d = len(self.columns) + int(self.free.sum())
        u = (Sobol().points(verifying_runs(self.responses), d, seed=SETS_OF_SAMPLES) + 1) / 2
        return u, self.by_runs(self.unit_points(u))

    def known(self) -> tuple[Array, Array]:
        """Uniform numbers (N, n_l) of all runs so far, and responses (N, n_t)."""
        return self.checks if self.surrogate is not None else (self._uniform, self._by_samples[:, :, 0])

    def may_grow(self, most: int = 2**20) -> bool:
        """Whether more samples require no runs, and at most a number of values of polynomials."""
        # The default is that for a probability. Runs near the limit find rarer events in less time.
        return self.surrogate is not None and not self.free.any() and 4 * self.number * len(self.error) <= most

    def draw(self, n: int) -> None:
        """Draw n samples in each set."""
        self.number = SETS_OF_SAMPLES * n
        sets = [Sobol().points(n, len(self.columns), seed) for seed in range(SETS_OF_SAMPLES)]
        self._uniform = (np.concatenate(sets) + 1) / 2
        self._points = self.unit_points(self._uniform)

    def unit_points(self, uniform: Array) -> Array:
        """Points (N, d) of the unit box from uniform numbers (N, n_l), or (N, n_l + n_free) with parameters without a
        distribution."""
        n, points = len(self.columns), np.zeros((len(uniform), len(self.free)))
        points[:, self.columns] = self._laws.unit_points(uniform[:, :n], self.responses.box)
        if uniform.shape[1] > n:
            points[:, self.free] = 2 * uniform[:, n:] - 1
        return points

    def by_runs(self, points: Array) -> Array:
        """Responses (N, n_t) of runs at points (N, d)."""
        return self.responses.by_runs(points, self.column)

    def _fit(self) -> None:
        """Fit less accurate polynomials by least squares. Runs that differ only in the parameters without a
        distribution give their error."""
        responses, free = self.responses, np.flatnonzero(self.free)
        assert responses.runs is not None
        points, Y = responses.runs.sample(_FITTED_RUNS)
        self.surrogate = fitted(points, Y[:, :, [self.column]], responses.box.names)
        n, has_few = len(free), len(free) <= _INTERVALS_OF_ALL_CORNERS
        ends = corners(n) if has_few else Random().points(_POINTS_INSIDE, n, 0).round()
        self._around = np.concatenate([ends, Sobol().points(_POINTS_INSIDE, n, seed=0)])
        few = len(ends) + _POINTS_INSIDE // 4
        outer = self.unit_points(self.checks[0])
        with_free = outer[:, None].repeat(few, axis=1)
        with_free[:, :, free] = self._around[:few]
        runs = self.by_runs(with_free.reshape(-1, outer.shape[1])).reshape(len(outer), few, -1)
        low, high = self._ranges(self.surrogate, outer)
        residual = np.square([low[:, :, 0] - runs.min(axis=1), high[:, :, 0] - runs.max(axis=1)])
        self.error = SAFETY_OF_RUNS * np.sqrt(residual.mean(axis=1).max(axis=0))
        self.runs += len(points) + runs.shape[0] * few

    def _ranges(self, own: Piecewise, points: Array) -> tuple[Array, Array]:
        """Lowest and highest values (N, n_t, 1) over the parameters without a distribution."""
        if not self._around.size:
            return own.ranges(points, self.free)
        low, high = np.full((2, len(points), *own.error.shape), [[[[np.inf]]], [[[-np.inf]]]])
        for each in self._around:
            points[:, self.free] = each
            values = own.values(points)
            low, high = np.minimum(low, values), np.maximum(high, values)
        return low, high

    def over_time(self) -> Iterator[tuple[slice, Array, Array]]:
        """Windows of time, and the lowest and highest values (replicates, n, n_t) in each window."""
        surrogate, n_t = self.surrogate, len(self.responses.t)
        step = n_t
        if surrogate is not None:  # each window repeats the computation of all terms
            # Number of values that are computed together. They fit into the processor cache.
            step = max(2**20 // self.number, *(len(own.alpha) for own in surrogate.expansions))
        for start in range(0, n_t, step):
            window = slice(start, min(start + step, n_t))
            if surrogate is None:
                low = high = self._by_samples
            elif self.free.any():
                low, high = self._ranges(surrogate.part(window, [0]), self._points)
            else:
                low = high = surrogate.part(window, [0]).values(self._points)
            shape = SETS_OF_SAMPLES, -1, low.shape[1]
            sets = low.reshape(shape)
            yield window, sets, sets if low is high else high.reshape(shape)

    @property
    def on_card(self) -> bool:
        """Whether runs on a graphics card are the samples."""
        return self.surrogate is None and self.responses.runs is not None and self.responses.runs.on_card

    def quantiles_on_card(self, q: Array) -> tuple[Array, Array, Array]:
        """Quantiles (n_q, n_t) of many runs on a graphics card, as lowest and as highest ones, and their error."""
        runs, k = self.responses.runs, self.column
        assert runs is not None
        ends = np.stack([self.responses.lower[:, k], self.responses.upper[:, k]])
        self.draw(SAMPLES_ON_CARD)
        self.runs += self.number
        parts = np.split(self._points, SETS_OF_SAMPLES)
        counts = np.array([runs.reduced(part, lambda card: card.histogram(k, ends, _BINS)) for part in parts])
        error = np.maximum(scatter(_quantiles(counts, ends, q)), (ends[1] - ends[0]) / _BINS)
        (quantiles,) = _quantiles(counts.sum(axis=0, keepdims=True), ends, q)
        return quantiles, quantiles, error

    @cached_property
    def _by_samples(self) -> Array:
        """Responses of runs at all samples."""
        self.runs += self.number
        return self.by_runs(self._points)[:, :, None]

    def about(
        self, levels: Array | None = None
    ) -> tuple[str, str, Array, str, tuple[str, ...], int, int, tuple[str, ...]]:
        """The values of the attributes of `Figures`, in the order of the attributes."""
        responses = self.responses
        intervals = tuple(name for name, free in zip(responses.box.names, self.free, strict=True) if free)
        remarks = (*responses.remarks, *self._laws.remarks)
        if self.surrogate is not None and not responses.are_good(self.error[:, None], [self.column], FINE)[0]:
            text = f"Polynomials replace runs. Their error is above {FINE:.0%} of the width where runs were made."
            remarks = (*remarks, text)
        # If fewer samples than this are beyond a quantile, a remark reports too few samples.
        if levels is not None and (few := np.minimum(levels, 1 - levels) * self.number < 8).any():
            text = ", ".join(f"{q:g}" for q in levels[few])
            remarks = (*remarks, f"Few samples are beyond the quantiles {text}, so their errors are inaccurate.")
        unit = responses.units[self.column] if responses.units else ""
        numbers = self.number, self.runs
        return responses.names[self.column], unit, responses.t, repr(self._laws), intervals, *numbers, remarks


def scatter(sets: Array) -> Array:
    """Sampling error of the mean over sets of results (replicates, ...)."""
    return STANDARD_ERRORS * sets.std(axis=0, ddof=1) / np.sqrt(SETS_OF_SAMPLES)


def _quantiles(counts: Indices, ends: Array, q: Array) -> Array:
    """Quantiles (sets, n_q, n_t) from numbers (sets, n_t, bins) of values in equal bins between the ends (2, n_t)."""
    sums, bins, places = counts.cumsum(axis=2), counts.shape[2], []
    for rank in q * sums[0, 0, -1]:
        own = (sums < rank).sum(axis=2)[..., None]
        above, within = (np.take_along_axis(each, own, axis=2) for each in (sums - rank, counts))
        places.append((own + 1 - above / within)[..., 0])
    return ends[0] + np.stack(places, axis=1) / bins * (ends[1] - ends[0])
