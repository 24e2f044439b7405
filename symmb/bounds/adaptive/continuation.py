"""The most likely continuation of an interpolant on a grid through check runs, its range, and its error."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._limits import windows
from symmb._types import Array
from symmb.bounds.adaptive.check_runs import inflated_error, select_dispersed
from symmb.bounds.adaptive.gaussian_process import EXPECTED_NOISE
from symmb.bounds.adaptive.runs import Runs, relative_rms, rms
from symmb.bounds.adaptive.surrogate import EstimatedRange
from symmb.nodes import Grid, Index, below
from symmb.polynomials import Expansion, MultiIndices, basis_values
from symmb.polynomials.ranges import Exact, Piecewise

SPARSE_PROBES = 2
"""Quasi-random check points: more take runs, fewer miss products of parameters, which runs along axes do not show."""
REMAINING_SHARE = 0.2
"""Least share of the expected error that remains at places of check runs, since the continuation does not interpolate,
and of the estimated error after them: less misses more, more takes more runs."""
SPARSE_RANGE = 0.02
"""Accuracy of a range, over the tolerance: less takes more time."""
RANGE_WORK = 200_000
"""Coefficients in all boxes that the search of a range may take, since many parameters leave it unproved anyway: more
take time."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """Expected coefficients beyond those of a grid, before and after further runs are known.

    The further coefficients are independent Gaussian variables with mean 0 and sizes that are extrapolated from the
    grid. Given the interpolant's errors e at some points, their most likely values are

        c = S F' (F F' + noise)^-1 e,

    where S are the sizes, and F (C, n_b) are the further polynomials at the points, less their interpolants, times S.
    Nodes keep their values.

    Attributes
    ----------
    alpha : (n_b, d)        multi-indices that may come next
    sizes : (n_b,)          expected sizes
    interpolants : (N, n_b) coefficients of the interpolants of these polynomials
    """

    alpha: MultiIndices
    sizes: Array
    interpolants: Array

    @classmethod
    def of(cls, grid: Grid, sizes: dict[Index, float]) -> "Continuation":
        """From the indices ahead of a grid, with their expected sizes."""
        alpha = np.array(list(sizes), dtype=np.intp)
        return cls(alpha, np.array(list(sizes.values())), grid.coefficients(basis_values(alpha, grid.nodes)))

    def through(self, known: MultiIndices, points: Array, errors: Array) -> tuple[Array, Array]:
        """Changes of the known coefficients (N, m), and further coefficients (n_b, m).

        Parameters
        ----------
        known : (N, d)          multi-indices of the grid
        points : (C, d)
        errors : (C, m)         of the interpolant
        """
        free = self._free(known, points)
        further = self.sizes[:, None] * (free.T @ np.linalg.solve(self._products(free), errors))
        return -self.interpolants @ further, further

    def expected_error(self, known: MultiIndices, places: Array, points: Array) -> Array:
        """Root mean square (...) of the error that runs at points (C, d) leave at places (..., d), rounded to 0.1."""
        free, places = self._free(known, points), places.round(1)
        flat, errors = places.reshape(-1, places.shape[-1]), np.empty(places.shape[:-1])
        for window in windows(len(flat), places.shape[-1]):
            different, which = np.unique(flat[window], axis=0, return_inverse=True)
            there = self._free(known, different)
            covariance = free @ there.T
            explained = (covariance * np.linalg.solve(self._products(free), covariance)).sum(axis=0)
            remaining = np.sqrt(np.maximum(np.square(there).sum(axis=1) - explained, 0.0))
            errors.reshape(-1)[window] = remaining[which.ravel()]
        return errors

    def _free(self, known: MultiIndices, points: Array) -> Array:
        """(C, n_b) values of the further polynomials at points, less their interpolants, times the expected sizes."""
        return (basis_values(self.alpha, points) - basis_values(known, points) @ self.interpolants) * self.sizes

    def _products(self, free: Array) -> Array:
        """(C, C) expected products of the errors at points."""
        noise = EXPECTED_NOISE * np.square(self.sizes).sum() or 1.0  # any, if none is expected
        return free @ free.T + noise * np.eye(len(free))


def extrapolated_sizes(grid: Grid, sizes: Array) -> dict[Index, float]:
    """Expected sizes of the coefficients next to those of a grid, if they decay as these (N,) do.

    The size at index a is the least of |c_b| and |c_b| |c_(a-b+z)| / |c_z| over its lower neighbours b and theirs z.
    """
    size = dict(zip(grid.row, sizes.tolist(), strict=True))
    return {index: _extrapolated(index, size) for index in sorted(grid.ahead())}


def largest(sizes: dict[Index, float], number: int) -> set[Index]:
    """So many indices with the largest sizes."""
    return set(sorted(sizes, key=lambda a: (-sizes[a], sum(a), a))[: max(number, 0)])


def _extrapolated(index: Index, size: dict[Index, float]) -> float:
    candidates = [size[b] for b in below(index)]
    for b in below(index):
        for z in below(b):
            c = tuple(i - j + k for i, j, k in zip(index, b, z, strict=True))
            if any(z) and size[z] > 0:
                candidates.append(size[b] * size[c] / size[z])
    return min(candidates)


@dataclass(frozen=True, eq=False)
class Corrected:
    """An expansion that is continued through check runs. Its coefficients are computed for windows of responses.

    Attributes
    ----------
    base : expansion on the grid
    continuation : of the base
    points, checks : (C, d) and (C, n_t, n_y), the check runs
    """

    base: Expansion
    continuation: Continuation
    points: Array
    checks: Array

    @cached_property
    def alpha(self) -> MultiIndices:
        """(n_b, d)."""
        return np.concatenate([self.base.alpha, self.continuation.alpha])

    def parts(self) -> Iterator[tuple[slice, Array]]:
        """Windows of the n_t n_y responses, and their coefficients (n_b, m)."""
        cuts = [*windows(self.base.coefficients[0].size, len(self.alpha))]
        for window in cuts:
            yield window, self._whole if len(cuts) == 1 else self._part(window)

    @cached_property
    def _whole(self) -> Array:
        return self._part(slice(None))

    def _part(self, window: slice) -> Array:
        base = self.base.coefficients.reshape(len(self.base.alpha), -1)[:, window]
        checks = self.checks.reshape(len(self.points), self.base.coefficients[0].size)[:, window]
        errors = checks - basis_values(self.base.alpha, self.points) @ base
        change, further = self.continuation.through(self.base.alpha, self.points, errors)
        return np.concatenate([base + change, further])

    def expansion(self) -> Expansion:
        """With all coefficients."""
        coefficients = np.empty((len(self.alpha), *self.base.coefficients.shape[1:]))
        for window, part in self.parts():
            coefficients.reshape(len(self.alpha), -1)[:, window] = part
        return Expansion(self.alpha, coefficients, self.base.parameters)

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d)."""
        basis, shape = basis_values(self.alpha, points), self.base.coefficients.shape[1:]
        return np.concatenate([basis @ part for _, part in self.parts()], axis=1).reshape(-1, *shape)

    def range(self, tolerance: float) -> tuple[Array, Array, Array]:
        """Minima and maxima (n_t, n_y), and their places (2, n_t, n_y, d).

        The range is that of the best values of the search. A proof would take longer than the runs, and the response
        may exceed the range of the expansion anyway.
        """
        alpha, shape = self.alpha, self.base.coefficients.shape[1:]
        attained = Exact(tolerance, RANGE_WORK // len(alpha) + 1).attained
        found = [attained(alpha, part) for _, part in self.parts()]
        names = "lower", "upper", "at_lower", "at_upper"
        lower, upper, *places = (np.concatenate([getattr(each, name) for each in found]) for name in names)
        return lower.reshape(shape), upper.reshape(shape), np.stack(places).reshape(2, *shape, -1)


def corrected_bounds(
    runs: Runs, grid: Grid, base: Expansion, sizes: dict[Index, float], tolerance: float, estimate: Array
) -> EstimatedRange:
    """The range of the expansion continued through check runs at some of its extremes, and its error.

    The runs of a round show the error of the expansion that those before have corrected. Rounds end when it is small
    enough or does not fall. An error at a place where the continuation leaves the share s(x) of the typical
    error suggests the error e / s(x) elsewhere. What the range has beyond all runs is an error by the share that runs
    have not confirmed of what was predicted beyond former ones.
    """
    continuation, n_round = Continuation.of(grid, sizes), len(runs.box)
    corrected = Corrected(base, continuation, runs.points, runs.checks)
    lower, upper, extremes = corrected.range(SPARSE_RANGE * tolerance)
    typical = rms(continuation.expected_error(base.alpha, extremes, runs.points[:SPARSE_PROBES]).ravel())

    def remaining_share(places: Array, points: Array) -> Array:
        """Share of the error typical of extremes that runs at points (C, d) leave at places (..., d)."""
        error = continuation.expected_error(base.alpha, places, points)
        ratio = np.divide(error, typical, out=np.ones_like(error), where=error < typical)
        return REMAINING_SHARE + (1 - REMAINING_SHARE) * ratio

    def unattained() -> Array:
        """How far the range exceeds what runs attain at its minima and maxima (2, n_t, n_y), beyond noise."""
        lowest, highest = runs.extremes
        return doubted * np.maximum(np.stack([lowest - lower, upper - highest]) - runs.noise, 0.0)

    remaining = observed = estimate
    before, doubted = np.inf, np.ones(runs.shape[1])
    unconfirmed, foreseen = np.zeros((2, runs.shape[1]))
    while True:
        known, (lowest, highest) = runs.points, runs.extremes
        weights = np.maximum(remaining_share(extremes, known) * estimate, unattained()) / runs.rms_widths()
        points, Y = runs.check(select_dispersed(extremes, weights, min(n_round, runs.left)))
        if not len(points):
            break
        predicted = corrected.values(points)
        errors = Y - predicted
        beyond = np.maximum(np.maximum(lowest - predicted, predicted - highest), 0.0)
        foreseen += np.square(beyond).sum(axis=(0, 1))
        unconfirmed += np.where(beyond > 0, np.square(errors), 0.0).sum(axis=(0, 1))
        doubted = np.sqrt(np.divide(unconfirmed, foreseen, out=np.ones_like(foreseen), where=foreseen > 0))
        doubted = np.minimum(doubted, 1.0)
        errors /= remaining_share(points, known)[:, None, None]
        observed = (1 + 1 / len(points)) * inflated_error(np.mean(np.square(errors), axis=0))
        corrected = Corrected(base, continuation, runs.points, runs.checks)
        lower, upper, extremes = corrected.range(SPARSE_RANGE * tolerance)
        share = remaining_share(extremes, runs.points).max(axis=0)
        remaining = share * np.maximum(observed, REMAINING_SHARE * estimate)
        error = relative_rms(np.maximum(remaining, unattained().max(axis=0)), runs.rms_widths())
        if (len(known) >= n_round and (error <= tolerance or error >= before)) or runs.clock.is_late:
            break
        before = error
    error = np.maximum(spread_over_times(remaining, upper - lower), unattained().max(axis=0))

    def polynomials() -> Piecewise:
        return Piecewise.whole(corrected.expansion(), spread_over_times(observed, upper - lower))

    return EstimatedRange(lower, upper, error, polynomials, "an interpolant on a sparse grid", extremes)


def spread_over_times(error: Array, width: Array) -> Array:
    """Errors (n_t, n_y) of which half the square is that of one share of the width (n_t, n_y) at all times.

    Few check runs tell the size of errors, but not well at which times they are small.
    """
    share = np.divide(rms(error), rms(width), out=np.zeros(width.shape[1]), where=rms(width) > 0)
    return np.sqrt((np.square(error) + np.square(share * width)) / 2)
