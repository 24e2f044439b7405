"""Steady motions, and rotating coordinates in which the linearised equations have constant coefficients.

Deviations z from a motion satisfy z' = A(t) z. The eigenvalues of A determine stability only if A is constant, as at an
equilibrium. A wheel that rolls at constant speed is in a steady motion too. But the coordinates of the wheel rotate
with the wheel, so that A changes. In rotating coordinates w, with z = exp(X t) w, the equations are

    w' = (exp(-X t) A exp(X t) - X) w

A motion is steady if rotations X of the coordinates, one rotation for each body, make this matrix constant.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from symmb._types import Array, Indices
from symmb.run.linear.eigenvalues import Eigenvalues, eigenvalues
from symmb.run.linear.linear_equations import Blocks, LinearEquations, lifts
from symmb.run.linear.point import LinearizationPoint

DOUBT = (
    "The state is neither an equilibrium nor a steady motion: A changes along the motion. The eigenvalues of A do not "
    "describe the later motion."
)
_DEPENDENT = 1e-9
"""Relative difference. Below it, two rotations of coordinates have the same effect, or differ by rounding errors."""


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """The motion through a point, with the linear equations of deviations from this motion.

    Parameters
    ----------
    equations : LinearEquations
    point : LinearizationPoint
    blocks : Blocks            linear equations at the point
    free : (n,)                numbers of the independent displacements, velocities and states
    """

    equations: LinearEquations
    point: LinearizationPoint
    blocks: Blocks
    free: Indices

    @cached_property
    def lift(self) -> Array:
        """All displacements, velocities and states (n_z, n) for unit values of the independent states."""
        return lifts(self.blocks, self.free)[0]

    @cached_property
    def _fixed(self) -> Array:
        """The matrix A (n, n) in coordinates that do not rotate."""
        return (self.blocks.A[0] @ self.lift)[self.free]

    @cached_property
    def _rates(self) -> Array:
        """Rates of displacements, velocities and states along the motion (n_z,)."""
        dae, x = self.equations.dae, self.point.x
        parts = np.split(x, [dae.n_q, dae.n_q + dae.n_v])[: 2 + bool(dae.n_s)]
        _, *rates = (rate.full().ravel() for rate in dae.rhs(*parts, self.point.p, self.point.t))
        return np.concatenate([parts[1], *rates])

    @property
    def moves(self) -> bool:
        """Whether something has a velocity."""
        return bool(self._rates[: self.equations.dae.n_v].any())

    @cached_property
    def turning(self) -> Array | None:
        """A rotation X (n_z, n_z) of coordinates that makes A constant: 0 if A is constant, None if none exists."""
        none = np.zeros((self.equations.n_z,) * 2)
        if not self._rates.any() or not self._fixed.size or self._is_constant(none):
            return none
        X = self.best_turning() if self.moves else None
        return X if X is not None and self._is_constant(X) else None

    @property
    def A(self) -> Array:
        """The matrix (n, n) of the equations, in rotating coordinates if this makes the matrix constant."""
        return self.turned(self.turning)

    def turned(self, X: Array | None) -> Array:
        """The matrix A (n, n) in coordinates that rotate by X (n_z, n_z)."""
        if X is None or not X.any():
            return self._fixed
        turn = (X @ self.lift)[self.free]
        A = self._fixed - turn
        size = np.abs(self._fixed) + np.abs(turn)
        # Entry of turned equations, divided by the largest entry of A. Smaller entries are rounding, which would change
        # eigenvalues 0.
        return np.where(np.abs(A) <= _DEPENDENT * size + 1e-15 * size.max(), 0.0, A)

    @property
    def doubts(self) -> tuple[str, ...]:
        """A warning if A changes along the motion."""
        return (DOUBT,) if self.turning is None else ()

    def best_turning(self) -> Array | None:
        """The rotation X (n_z, n_z) with the smallest change of exp(-X t) A exp(X t) and of the rows of constraints.

        The result is None if no coordinates can rotate.
        """
        candidates = list(_generators(self.equations.dae.v_names, self.equations.n_z))
        if not candidates:
            return None
        A, rows = self._at(0.0, None)
        changes = [change @ self.lift for change in self._slopes(self._step(np.inf))]
        effects = [[(A @ X - X @ A) @ self.lift, rows @ X @ self.lift] for X in candidates]
        # All equations have equal weights, although equations of stiff parts have large coefficients.
        units = [np.linalg.norm(part, axis=1, keepdims=True) for part in (A, rows)]
        # Size of a row of A, divided by the largest row. The weight of a smaller row is not increased, because it may
        # be rounding.
        units = [np.maximum(unit, 1e-6 * unit.max(initial=1e-300)) for unit in units]
        F = np.array([np.concatenate([(e / u).ravel() for e, u in zip(some, units, strict=True)]) for some in effects])
        f = np.concatenate([(change / unit).ravel() for change, unit in zip(changes, units, strict=True)])
        rates, *_ = np.linalg.lstsq(F.T, -f, rcond=_DEPENDENT)
        rates = np.where(np.abs(rates) <= _DEPENDENT * np.abs(rates).max(), 0.0, rates)
        return np.tensordot(rates, np.array(candidates), 1)

    def _slopes(self, h: float) -> list[Any]:
        """Rates of A (n_z, n_z) and of the rows of constraints along the motion, by differences of sixth order."""
        pairs = [(self._at(k * h, None), self._at(-k * h, None)) for k in (1, 2, 3)]
        weights = np.array([45.0, -9.0, 1.0]) / (60 * h)
        return [
            sum(w * (ahead[k] - behind[k]) for w, (ahead, behind) in zip(weights, pairs, strict=True)) for k in (0, 1)
        ]

    def _is_constant(self, X: Array) -> bool:
        """Whether A is constant in coordinates that rotate by X: no mode changes within its own time constant."""
        modes = eigenvalues(self._turned(0.0, X))
        sizes = np.abs(modes.values)
        slowest = sizes[sizes > 0].min(initial=np.inf)
        times = 1 / np.where(sizes > 0, sizes, slowest)
        left = np.argsort(times, kind="stable")
        while left.size:
            # Modes are examined separately if the ratio of their time constants is above this value.
            chosen = left[times[left] <= 4.0 * times[left[0]]]
            if not self._keeps(modes[chosen], float(times[left[0]]) or np.inf, X):
                return False
            left = left[len(chosen) :]
        return True

    def _keeps(self, modes: Eigenvalues, time: float, X: Array) -> bool:
        """Whether the changes of A from -`time` to `time` have little effect on these modes.

        A change dA of the matrix has the effect (s - A)^-1 dA x on a mode x. The distance of s from the eigenvalue is
        the size of the eigenvalue. With this s, stiff parts respond little, as in the motion.
        """
        step = self._step(time)
        # Largest factor of the extrapolation. With it, rounding of 1e-13 in second differences becomes 1e-8.
        factor = min(time / step, 300.0)
        A, ahead, behind = (self._turned(tau, X) for tau in (0.0, step, -step))
        first, second = factor * (ahead - behind) / 2, factor**2 * (ahead + behind - 2 * A) / 2
        units = self.equations.sizes[self.free]
        for k, value in enumerate(modes.values):
            # Direction [rad] from an eigenvalue to the point s. Another eigenvalue is unlikely at this point.
            s = value + np.exp(0.9 * 1j) * max(abs(value), 1 / (factor * step))
            changes = np.stack([first + second, second - first], axis=2).swapaxes(1, 2) @ modes.vectors[:, k]
            answers = np.linalg.solve(s * np.eye(len(A)) - A, changes) / units[:, None]
            # Change of a mode within its time constant, divided by its size. Above this value, a motion is not steady.
            if np.abs(answers).max() > 1e-3 * np.abs(modes.vectors[:, k] / units).max():
                return False
        return True

    def _step(self, time: float) -> float:
        """A step [s], at most `time`, in which the motion covers a distance that suits comparisons of A."""
        step = min(time, 1e3 / max(float(np.abs(self._rates / self.equations.sizes).max()), 1e-300))
        n_v = self.equations.dae.n_v
        # Maximum number of halvings of a step. The last step is 1e-60 of the first one.
        for _ in range(200):
            moved = np.abs(self._displacement(step) / self.equations.sizes)
            # Weight of velocities relative to displacements, because A depends on the squares of velocities.
            moved[n_v : 2 * n_v] *= 0.1 * (time if np.isfinite(time) else step)
            # Largest displacement, in sizes of the states, at which A is compared. Changes of A over larger
            # displacements are extrapolated. A smaller value would give larger errors by rounding, a larger value
            # larger errors of third order.
            if moved.max() <= 2e-3:
                break
            step /= 2
        return step

    def _displacement(self, tau: float) -> Array:
        """The displacement (n_z,) of the motion in a time tau, from the implicit midpoint rule."""
        return np.linalg.solve(np.eye(self.equations.n_z) - tau / 2 * self.blocks.A[0], tau * self._rates)

    def _at(self, tau: float, X: Array | None) -> tuple[Array, Array]:
        """The matrix A (n_z, n_z) and the rows of constraints at a time tau, in coordinates that rotate by X."""
        from scipy.linalg import expm

        equations, point = self.equations, self.point
        blocks = self.blocks
        if tau:
            dae, moved = equations.dae, self._displacement(tau)
            q = dae.retract(point.x[: dae.n_q], moved[: dae.n_v]).full().ravel()
            x = np.concatenate([q, point.x[dae.n_q :] + moved[dae.n_v :]])
            blocks = equations.blocks(x[None], point.p[None], point.t + tau)
        A, rows = blocks.A[0], blocks.rows[0]
        if X is None or not X.any():
            return A, rows
        turned = expm(X * tau)
        return turned.T @ A @ turned - X, rows @ turned  # rotations

    def _turned(self, tau: float, X: Array) -> Array:
        """The matrix A (n, n) of independent displacements at a time tau, in coordinates that rotate by X."""
        A, rows = self._at(tau, X)
        lift = lifts(Blocks(A[None], *[rows[None]] * 6), self.free)[0]
        return (A @ lift)[self.free]


def _generators(v_names: tuple[str, ...], n_z: int) -> Iterator[Array]:
    """Rotations (n_z, n_z) of displacements and velocities of each body: of its position, and of its axes."""
    n_v, numbers = len(v_names), {name: k for k, name in enumerate(v_names)}
    for kinds in (("vx", "vy", "vz"), ("omega_x", "omega_y", "omega_z")):
        for owner in dict.fromkeys(name.rpartition(".")[0] for name in v_names):
            for i, j in ((1, 2), (2, 0), (0, 1)):
                a, b = (numbers.get(f"{owner}.{kinds[k]}") for k in (i, j))
                if a is None or b is None:
                    continue
                X = np.zeros((n_z, n_z))
                for shift in (0, n_v):
                    X[b + shift, a + shift], X[a + shift, b + shift] = 1.0, -1.0
                yield X
