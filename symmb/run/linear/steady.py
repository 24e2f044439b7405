"""Whether a state is on a steady motion, and the turning coordinates in which such a motion is steady.

Deviations z of a motion obey z' = A(t) z. The eigenvalues of A tell what they do where A is constant, as at an
equilibrium. A wheel that rolls evenly is steady as well, but the coordinates of a body turn with it, and A with them.
In turned coordinates z = exp(X t) w the equations are

    w' = (exp(-X t) A exp(X t) - X) w

so that a motion is steady if rotations X of the coordinates, one of each body, make this matrix constant.
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
    "The state is neither an equilibrium nor a steady motion: A changes along the motion. Its eigenvalues say nothing "
    "about what comes later."
)
_LARGE = 2e-3
"""Largest displacement, in sizes of the states, at which A is compared. Changes of A over longer ways are extrapolated
from it: at a lower one rounding counts, at a higher one the third order of the way."""
_LIGHTER = 0.1
"""Weight of velocities beside displacements there: A depends on them by squares."""
_FARTHEST = 300.0
"""Steps of that size up to which changes are extrapolated: rounding of 1e-13 in second differences becomes 1e-8."""
_CHANGE = 1e-3
"""Change of a mode over its size, within its own time constant, from which a motion is not steady."""
_BESIDE = 0.9
"""Direction [rad] in which a mode is asked beside its eigenvalue: no other one is likely to be there."""
_LEAST = 1e-6
"""Share of the largest row of A below which a row counts less than the others: rounding must not count."""
_DEPENDENT = 1e-9
"""Share below which turnings of coordinates have the same effect, and what is left when they cancel is rounding."""
_NOISE = 1e-15
"""Share of the largest entry of A up to which an entry of turned equations is rounding: it would move eigenvalues 0."""
_HALVINGS = 200
"""Most halvings of a step: 1e-60 of its time."""
_APART = 4.0
"""Ratio of times from which they are looked at one by one."""


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """The motion through a point, next to which the equations are linear.

    Parameters
    ----------
    equations : LinearEquations
    point : LinearizationPoint
    blocks : Blocks            at the point
    free : (n,)                numbers of the independent displacements, velocities and states
    """

    equations: LinearEquations
    point: LinearizationPoint
    blocks: Blocks
    free: Indices

    @cached_property
    def lift(self) -> Array:
        """All displacements, velocities and states for independent ones (n_z, n)."""
        return lifts(self.blocks, self.free)[0]

    @cached_property
    def _fixed(self) -> Array:
        """A (n, n) in coordinates that do not turn."""
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
        """X (n_z, n_z) where coordinates must turn; 0 where none has to, None where no turning makes A constant."""
        none = np.zeros((self.equations.n_z,) * 2)
        if not self._rates.any() or not self._fixed.size or self._is_constant(none):
            return none
        X = self.best_turning() if self.moves else None
        return X if X is not None and self._is_constant(X) else None

    @property
    def A(self) -> Array:
        """The matrix (n, n) of the equations, in turning coordinates where these make it constant."""
        return self.turned(self.turning)

    def turned(self, X: Array | None) -> Array:
        """A (n, n) in coordinates that turn by X (n_z, n_z)."""
        if X is None or not X.any():
            return self._fixed
        turn = (X @ self.lift)[self.free]
        A = self._fixed - turn
        size = np.abs(self._fixed) + np.abs(turn)
        return np.where(np.abs(A) <= _DEPENDENT * size + _NOISE * size.max(), 0.0, A)

    @property
    def doubts(self) -> tuple[str, ...]:
        """That A changes along the motion."""
        return (DOUBT,) if self.turning is None else ()

    def best_turning(self) -> Array | None:
        """X with the least change of exp(-X t) A exp(X t) and of the constraints; None if no coordinates can turn."""
        candidates = list(_generators(self.equations.dae.v_names, self.equations.n_z))
        if not candidates:
            return None
        A, rows = self._at(0.0, None)
        changes = [change @ self.lift for change in self._slopes(self._step(np.inf))]
        effects = [[(A @ X - X @ A) @ self.lift, rows @ X @ self.lift] for X in candidates]
        # Every equation counts alike: those of stiff parts have large coefficients.
        units = [np.linalg.norm(part, axis=1, keepdims=True) for part in (A, rows)]
        units = [np.maximum(unit, _LEAST * unit.max(initial=1e-300)) for unit in units]
        F = np.array([np.concatenate([(e / u).ravel() for e, u in zip(some, units, strict=True)]) for some in effects])
        f = np.concatenate([(change / unit).ravel() for change, unit in zip(changes, units, strict=True)])
        rates, *_ = np.linalg.lstsq(F.T, -f, rcond=_DEPENDENT)
        rates = np.where(np.abs(rates) <= _DEPENDENT * np.abs(rates).max(), 0.0, rates)
        return np.tensordot(rates, np.array(candidates), 1)

    def _slopes(self, h: float) -> list[Any]:
        """Rates of A (n_z, n_z) and of the rows of the constraints along the motion, of sixth order in the time h."""
        pairs = [(self._at(k * h, None), self._at(-k * h, None)) for k in (1, 2, 3)]
        weights = np.array([45.0, -9.0, 1.0]) / (60 * h)
        return [
            sum(w * (ahead[k] - behind[k]) for w, (ahead, behind) in zip(weights, pairs, strict=True)) for k in (0, 1)
        ]

    def _is_constant(self, X: Array) -> bool:
        """Whether A, in coordinates that turn by X, changes no mode along the motion within its time constant."""
        modes = eigenvalues(self._turned(0.0, X))
        sizes = np.abs(modes.values)
        slowest = sizes[sizes > 0].min(initial=np.inf)
        times = 1 / np.where(sizes > 0, sizes, slowest)
        left = np.argsort(times, kind="stable")
        while left.size:
            chosen = left[times[left] <= _APART * times[left[0]]]
            if not self._keeps(modes[chosen], float(times[left[0]]) or np.inf, X):
                return False
            left = left[len(chosen) :]
        return True

    def _keeps(self, modes: Eigenvalues, time: float, X: Array) -> bool:
        """Whether A changes these modes little as long as `time` before and after.

        A change dA of the matrix answers a mode x with (s - A)^-1 dA x, for an s as far from its eigenvalue as this is
        large. Stiff parts answer little, as they do in the motion.
        """
        step = self._step(time)
        factor = min(time / step, _FARTHEST)
        A, ahead, behind = (self._turned(tau, X) for tau in (0.0, step, -step))
        first, second = factor * (ahead - behind) / 2, factor**2 * (ahead + behind - 2 * A) / 2
        units = self.equations.sizes[self.free]
        for k, value in enumerate(modes.values):
            s = value + np.exp(_BESIDE * 1j) * max(abs(value), 1 / (factor * step))
            changes = np.stack([first + second, second - first], axis=2).swapaxes(1, 2) @ modes.vectors[:, k]
            answers = np.linalg.solve(s * np.eye(len(A)) - A, changes) / units[:, None]
            if np.abs(answers).max() > _CHANGE * np.abs(modes.vectors[:, k] / units).max():
                return False
        return True

    def _step(self, time: float) -> float:
        """A step [s], not above a time, in which the motion leads so far that it can be compared."""
        step = min(time, 1e3 / max(float(np.abs(self._rates / self.equations.sizes).max()), 1e-300))
        n_v = self.equations.dae.n_v
        for _ in range(_HALVINGS):
            moved = np.abs(self._displacement(step) / self.equations.sizes)
            moved[n_v : 2 * n_v] *= _LIGHTER * (time if np.isfinite(time) else step)
            if moved.max() <= _LARGE:
                break
            step /= 2
        return step

    def _displacement(self, tau: float) -> Array:
        """Where the motion leads in a time (n_z,): exact to second order; stiff parts by their distance from rest."""
        return np.linalg.solve(np.eye(self.equations.n_z) - tau / 2 * self.blocks.A[0], tau * self._rates)

    def _at(self, tau: float, X: Array | None) -> tuple[Array, Array]:
        """A (n_z, n_z) and the rows of the constraints at a time beside the point, in coordinates that turn by X."""
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
        """A (n, n) of the independent ones."""
        A, rows = self._at(tau, X)
        lift = lifts(Blocks(A[None], *[rows[None]] * 6), self.free)[0]
        return (A @ lift)[self.free]


def _generators(v_names: tuple[str, ...], n_z: int) -> Iterator[Array]:
    """Rotations (n_z, n_z) of the displacements and velocities of each body about its axes, and of its place."""
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
