"""Quadratic models of many functions, each about its best point, from values and gradients at shared points."""

from dataclasses import dataclass, fields

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array


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
        left = self.gain / least
        some = np.flatnonzero(left > 1.0)
        part = Quadratics(*(getattr(self, field.name)[..., some] for field in fields(self)))
        left, lowest, least = left[some], part.change(part.step), least[some]
        points = np.empty((min(count, len(some)), len(self.origin)))
        for n in range(len(points)):  # each quadratic gains only once at its own point
            if not (left > 1.0).any():
                return points[:n]
            best = left.argmax()
            points[n] = part.origin[:, best] + part.step[:, best]
            left = np.minimum(left, np.abs(part.change(points[n][:, None] - part.origin) - lowest) / least)
        return points


def quadratics(X: Array, F: Array, G: Array) -> Quadratics:
    """Quadratics of m functions about their lowest points among X (N, d), from values F (N, m) and slopes G (N, d,
    m)."""
    N, d = X.shape
    lowest = F.argmin(axis=0)
    gradient, hessian = np.empty((d, F.shape[1])), np.empty((d, d, F.shape[1]))
    half = np.square(X[:, None] - X).sum(axis=2) / 2
    half[np.diag_indices(N)] = np.inf
    for k in np.unique(lowest):
        own = np.flatnonzero(lowest == k)
        # Number of nearest points for a curvature, divided by d + 1. Points farther away change the curvature little.
        near = half[k].argsort()[: min(N - 1, 4 * (d + 1))]
        offset = X[near] - X[k]
        g = G[k][:, own]
        rise = F[np.ix_(near, own)] - F[k, own] - offset @ g
        gradient[:, own] = g
        hessian[..., own] = _curvatures(offset, rise, G[np.ix_(near, np.arange(d), own)] - g)
    origin = X[lowest].T
    step = _box_minima(gradient, hessian, -1.0 - origin, 1.0 - origin)
    # Beyond half the distance to another point, the quadratic of the other point is more accurate.
    along = X @ step - (origin * step).sum(axis=0)
    return Quadratics(origin, gradient, hessian, step / (along / half[:, lowest]).max(axis=0, initial=1.0))


def _curvatures(offset: Array, rise: Array, turn: Array) -> Array:
    """Symmetric matrices (d, d, m) by least squares over the other points. Closer points have larger weights.

    The equations are H offset = turn (N, d, m), the change of the gradient, and offset H offset / 2 = rise (N, m).
    `rise` is the change of the value minus the linear change. If the equations do not determine H, the smallest H is
    returned.
    """
    N, d = offset.shape
    i, j = np.triu_indices(d)
    entries = np.arange(len(i))
    length = np.linalg.norm(offset, axis=1)
    system = np.zeros((N, d + 1, len(i)))
    system[:, i, entries] = offset[:, j]
    system[:, j, entries] = offset[:, i]
    system[:, d] = offset[:, i] * offset[:, j] * np.where(i == j, 0.5, 1.0) / length[:, None]
    right = np.concatenate([turn, (rise / length[:, None])[:, None]], axis=1)
    weight = length[:, None, None] ** -3
    H = np.empty((d, d, rise.shape[1]))
    # Singular values below this fraction of the largest one do not determine a curvature.
    solve = np.linalg.pinv((weight * system).reshape(N * (d + 1), len(i)), SAME)
    H[i, j] = H[j, i] = solve @ (weight * right).reshape(N * (d + 1), rise.shape[1])
    return H


def _box_minima(g: Array, H: Array, lower: Array, upper: Array, sweeps: int = 10) -> Array:
    """Steps (d, m) to minima of g s + s H s / 2 with lower <= s <= upper (d, m), by sweeps of coordinate descent."""
    s = np.zeros_like(g)
    for i in [*range(len(g))] * sweeps:
        h = H[i, i]
        slope = g[i] + np.einsum("jm,jm->m", H[i], s) - h * s[i]
        low, high = lower[i], upper[i]
        end = np.where(slope * low + h * low**2 / 2 < slope * high + h * high**2 / 2, low, high)
        convex = h > 0
        s[i] = np.where(convex, np.clip(-slope / np.where(convex, h, 1.0), low, high), end)
    return s
