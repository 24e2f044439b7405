"""Quadratic models of many functions, each about its best point, from values and gradients at shared points."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array, Indices


@dataclass(frozen=True, eq=False)
class Quadratics:
    """m quadratics g s + s H s / 2 in the step s from a point of the box [-1, 1]^d, and steps that decrease them.

    Attributes
    ----------
    origin : (d, m) point of each quadratic
    gradient : (d, m)
    hessian : (d, d, m)
    step : (d, m)
    """

    origin: Array
    gradient: Array
    hessian: Array
    step: Array

    def change(self, step: Array) -> Array:
        """Values (m,) at steps (d, m) from the origins. The values at the origins are 0."""
        return ((self.gradient + np.einsum("ijm,jm->im", self.hessian, step) / 2) * step).sum(axis=0)

    @property
    def gain(self) -> Array:
        """Decrease (m,) of the quadratics by the steps, at least 0."""
        return np.maximum(-self.change(self.step), 0.0)

    def promising(self, least: Array, count: int) -> Array:
        """At most ``count`` points (n, d) at which quadratics gain more than ``least`` (m,), the largest gain first.

        After each choice, the gain of other quadratics is the difference from their values at the chosen point.
        """
        part, gain, points = self, self.gain, list[Array]()
        left = gain / least
        while len(points) < count and (gaining := left > 1.0).any():
            if 2 * np.count_nonzero(gaining) < len(left):  # fewer quadratics take less time
                part = Quadratics(*(getattr(part, field.name)[..., gaining] for field in fields(self)))
                left, gain, least = left[gaining], gain[gaining], least[gaining]
            best = left.argmax()
            points.append(part.origin[:, best] + part.step[:, best])
            left = np.minimum(left, np.abs(part.change(points[-1][:, None] - part.origin) + gain) / least)
            left[best] = 0.0  # each quadratic gains only once at its own point
        return np.reshape(points, (-1, len(self.origin)))


def quadratics(X: Array, J: Sequence[Array], some: Indices, lowest: Indices) -> Quadratics:
    """Quadratics of some functions about their lowest points.

    Parameters
    ----------
    X : (N, d) points
    J : N arrays (n, 1 + d) with values and slopes of n outputs at the points
    some : (m,) numbers of the functions: i for output i, n + i for the negative of output i
    lowest : (m,) numbers of the lowest points of these functions
    """
    (N, d), (i, j) = X.shape, np.triu_indices(X.shape[1])
    place = np.empty((d, d), dtype=int)
    place[i, j] = place[j, i] = np.arange(len(i))
    side, rows = np.divmod(some, len(J[0]))
    curvature, slope = np.empty((len(some), len(i))), np.empty((len(some), d))
    half = np.square(X[:, None] - X).sum(axis=2) / 2
    half[np.diag_indices(N)] = np.inf
    groups = [(k, np.flatnonzero(lowest == k)) for k in np.unique(lowest)]
    for k, own in groups:
        # Number of nearest points for a curvature, divided by d + 1. Points farther away change the curvature little.
        near = half[k].argsort()[: min(N - 1, 4 * (d + 1))]
        jets = np.stack([J[n].take(rows[own], axis=0) for n in [k, *near]], axis=1)
        slope[own] = jets[:, 0, 1:]
        curvature[own] = jets.reshape(len(own), -1) @ _curvatures(X[near] - X[k], i, j)
    sign = 1.0 - 2.0 * side
    gradient, hessian = np.multiply(sign, slope.T, order="C"), np.multiply(sign, curvature.T, order="C")[place]
    origin = X.T[:, lowest]
    step = _box_minima(gradient, hessian, -1.0 - origin, 1.0 - origin)
    # Beyond half the distance to another point, the quadratic of the other point is more accurate.
    for k, own in groups:
        along = ((X - X[k]) / half[k, :, None]) @ step[:, own]
        step[:, own] /= along.max(axis=0, initial=1.0)
    return Quadratics(origin, gradient, hessian, step)


def _curvatures(offset: Array, i: Indices, j: Indices) -> Array:
    """Matrix from values and slopes at a point and at N points with offsets (N, d) from it to second derivatives H_ij.

    The rows are the value and the slopes at the point, then those at each other point. H is the least-squares solution
    of H offset = change of the slopes, and offset H offset / 2 = change of the value minus the linear change. Closer
    points have larger weights. If the equations do not determine H, the smallest H is the solution.
    """
    N, d = offset.shape
    entries = np.arange(len(i))
    system = np.zeros((N, 1 + d, len(i)))
    system[:, 0] = offset[:, i] * offset[:, j] * np.where(i == j, 0.5, 1.0)
    system[:, 1 + i, entries] = offset[:, j]
    system[:, 1 + j, entries] = offset[:, i]
    weight = np.linalg.norm(offset, axis=1)[:, None, None] ** -np.array([4.0, *[3.0] * d])[:, None]
    # Singular values below this fraction of the largest one do not determine a curvature.
    solve = np.linalg.pinv((weight * system).reshape(-1, len(i)), SAME).T.reshape(system.shape) * weight
    own = -solve.sum(axis=0)
    own[1:] -= offset.T @ solve[:, 0]
    return np.concatenate([own[None], solve]).reshape(-1, len(i))


def _box_minima(g: Array, H: Array, lower: Array, upper: Array, sweeps: int = 10) -> Array:
    """Steps (d, m) to minima of g s + s H s / 2 with lower <= s <= upper (d, m), by sweeps of coordinate descent."""
    s, middle = np.zeros_like(g), (lower + upper) / 2
    convex = np.einsum("iim->im", H) > 0
    for i in [*range(len(g))] * sweeps:
        h = H[i, i]
        slope = g[i] + np.einsum("jm,jm->m", H[i], s) - h * s[i]
        end = np.where(slope + h * middle[i] > 0, lower[i], upper[i])
        s[i] = np.where(convex[i], np.clip(-slope / np.where(convex[i], h, 1.0), lower[i], upper[i]), end)
    return s
