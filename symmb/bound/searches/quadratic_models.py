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
            if np.count_nonzero(gaining) < 0.8 * len(left):  # fewer quadratics take less time
                part = Quadratics(*(getattr(part, field.name).compress(gaining, axis=-1) for field in fields(self)))
                left, gain, least = left[gaining], gain[gaining], least[gaining]
            best = left.argmax()
            points.append(part.origin[:, best] + part.step[:, best])
            left = np.minimum(left, np.abs(part.change(points[-1][:, None] - part.origin) + gain) / least)
            left[best] = 0.0  # each quadratic gains only once at its own point
        return np.reshape(points, (-1, len(self.origin)))


def quadratics(X: Array, J: Sequence[Array], some: Indices, lowest: Indices) -> Quadratics:
    """Quadratics of m functions about their lowest points, from values and slopes J at points X (N, d).

    J contains an array (n, 1 + d) for each point. Function i is output i, and function n + i is its negative. `some`
    (m,) are the indices of the functions, and `lowest` (m,) the indices of their lowest points.
    """
    N, d = X.shape
    i, j = np.triu_indices(d)
    basis = np.zeros((d, d, len(i)))
    basis[i, j, np.arange(len(i))] = basis[j, i, np.arange(len(i))] = 1.0
    sign, rows = np.where(some < len(J[0]), 1.0, -1.0), some % len(J[0])
    slopes, curvatures = np.empty((len(some), d)), np.empty((len(some), len(i)))
    half = np.square(X[:, None] - X).sum(axis=2) / 2
    half[np.diag_indices(N)] = np.inf
    chosen = np.unique(lowest)
    groups = {k: np.flatnonzero(lowest == k) for k in chosen}
    # Number of nearest points for a curvature, divided by d + 1. Points farther away change the curvature little.
    near = half.argsort(axis=1)[:, : min(N - 1, 4 * (d + 1))]
    for points in np.array_split(chosen, 1 + len(chosen) // 16):  # in many parameters, each point needs much memory
        for k, matrix in zip(points, _curvatures(X[near[points]] - X[points, None], basis), strict=True):
            own = groups[k]
            jets = np.stack([J[n].take(rows[own], axis=0) for n in [k, *near[k]]], axis=1)
            slopes[own], curvatures[own] = jets[:, 0, 1:], jets.reshape(len(own), -1) @ matrix
    gradient, hessian = np.multiply(sign, slopes.T, order="C"), sign * np.tensordot(basis, curvatures, (2, 1))
    origin = X.T.take(lowest, axis=1)
    step = _box_minima(gradient, hessian, -1.0 - origin, 1.0 - origin)
    # Beyond half the distance to another point, the quadratic of the other point is more accurate.
    for k, own in groups.items():
        along = ((X - X[k]) / half[k, :, None]) @ step.take(own, axis=1)
        step[:, own] /= along.max(axis=0, initial=1.0)
    return Quadratics(origin, gradient, hessian, step)


def _curvatures(offset: Array, basis: Array) -> Array:
    """Matrices that give curvatures H from values and slopes at K points, and at N points with offsets (K, N, d).

    The rows of a matrix are the value and the slopes at the point, then those at each other point. The columns are the
    components of H in a basis (d, d, n) of the symmetric matrices. H is the least-squares solution of H offset = change
    of the slopes, and offset H offset / 2 = change of the value minus the linear change. Closer points have larger
    weights. If the equations do not determine H, the solution is the smallest H.
    """
    (K, N, d), n = offset.shape, basis.shape[2]
    turn = np.tensordot(offset, basis, 1)
    rise = np.einsum("kni,knie->kne", offset, turn) / 2
    weight = np.linalg.norm(offset, axis=2)[..., None, None] ** -np.array([4.0, *[3.0] * d])[:, None]
    system = weight * np.concatenate([rise[:, :, None], turn], axis=2)
    # Singular values below this fraction of the largest one do not determine a curvature.
    inverse: Array = np.linalg.pinv(system.reshape(K, N * (1 + d), n), SAME)
    other = inverse.transpose(0, 2, 1).reshape(system.shape) * weight
    own = -other.sum(axis=1, keepdims=True)
    own[:, 0, 1:] -= offset.transpose(0, 2, 1) @ other[:, :, 0]
    return np.concatenate([own, other], axis=1).reshape(K, (1 + N) * (1 + d), n)


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
