"""Extremes of polynomials by a search along one parameter after the other, for use without a C compiler."""

import numpy as np
from numpy.polynomial import legendre

from symmb._limits import windows
from symmb._magnitudes import SAME
from symmb._types import Array
from symmb.bound.polynomials.legendre import MultiIndices
from symmb.bound.polynomials.ranges.dense import SAMPLES_PER_DEGREE


def searched_extremes(alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Attained minima and maxima (m,), and their points (m, d), of polynomials with Legendre coefficients (n_b, m)."""
    lower, at_lower = _minima(alpha, coefficients)
    upper, at_upper = _minima(alpha, -coefficients)
    return lower, -upper, at_lower, at_upper


def _minima(alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
    """The best minima (m,) of several searches, and their points (m, d)."""
    # The starts are the centre, the corner in the direction of descent, the opposite corner, and three random points.
    # The random points find most other minima.
    m, d = coefficients.shape[1], alpha.shape[1]
    slopes = np.zeros((m, d))
    for k in range(d):
        slopes[:, k] = coefficients[(alpha.sum(axis=1) == 1) & (alpha[:, k] == 1)].sum(axis=0)
    corner = np.where(slopes > 0, -1.0, 1.0)
    others = np.broadcast_to(np.random.default_rng(0).uniform(-1, 1, (3, 1, d)), (3, m, d))
    values, points = np.full(m, np.nan), np.zeros((m, d))
    for window in windows(m, 4 * len(alpha)):
        for start in (np.zeros((m, d)), corner, -corner, *others):
            y, x = _descended(alpha, coefficients[:, window], start[window])
            better = ~(y >= values[window])
            values[window] = np.where(better, y, values[window])
            points[window] = np.where(better[:, None], x, points[window])
    return values, points


def _descended(alpha: MultiIndices, coefficients: Array, x: Array, most_sweeps: int = 30) -> tuple[Array, Array]:
    """Values (m,) and points (m, d) of searches from points x along each parameter in turn, until none improves."""
    x, d = x.copy(), alpha.shape[1]
    factors = [legendre.legvander(x[:, k], int(alpha[:, k].max()))[:, alpha[:, k]].T for k in range(d)]
    value, floor = np.full(x.shape[0], np.inf), SAME * np.abs(coefficients).max(axis=0, initial=0.0)
    for _ in range(most_sweeps):
        before = value
        for k in range(d):
            terms = coefficients * np.prod([factors[j] for j in range(d) if j != k], axis=0)
            degree = int(alpha[:, k].max())
            c = np.stack([terms[alpha[:, k] == n].sum(axis=0) for n in range(degree + 1)])
            x[:, k], value = _least(c)
            factors[k] = legendre.legvander(x[:, k], degree)[:, alpha[:, k]].T
        if not (before - value > floor).any():
            break
    return value, x


def _least(c: Array) -> tuple[Array, Array]:
    """Points and values (m,) of the minima of polynomials with Legendre coefficients (n, m) of one parameter."""
    n, every = len(c), np.arange(c.shape[1])
    samples = np.cos(np.pi * np.arange(SAMPLES_PER_DEGREE * n + 1) / (SAMPLES_PER_DEGREE * n))
    values: Array = np.asarray(legendre.legval(samples, c), dtype=float)
    best = values.argmin(axis=1)
    x, value = samples[best], values[every, best]
    slope, bend = legendre.legder(c), legendre.legder(c, 2)
    for _ in range(3):  # Newton's method
        s, b = (legendre.legval(x, f, tensor=False) for f in (slope, bend))
        new = np.where(b > 0, np.clip(x - s / np.where(b > 0, b, 1.0), -1.0, 1.0), x)
        y = legendre.legval(new, c, tensor=False)
        x, value = np.where(y < value, new, x), np.where(y < value, y, value)
    return x, value
