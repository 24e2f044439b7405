"""Gauss-Newton method with damping: coordinates on the constraints, moved least from where they are."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.model import DAE
from symmb.start.labels import constraint_of_row
from symmb.start.scales import rest_states
from symmb.start.sparse_rows import normal_solver

_TOLERANCE = 1e-9
"""Violation of Phi over the scene's size that an assembly may leave. tests/start/test_start.py"""
_ITERATIONS, _FULL_STEPS, _HALVINGS = 100, 30, 12
"""Gauss-Newton steps, those of full length, and halvings of a step that does not reduce the violation."""
_REGULAR = 1e-6
"""Ratio of pivots above which rows count as independent."""
_TURN = 2 * np.pi
_PATIENCE, _PROGRESS = 15, 0.9
"""Steps after which the violation must have fallen by this factor: far from a solution it may fall slowly."""


class SingularRow(Exception):
    """Rows of a joint are not finite."""

    def __init__(self, joint: str) -> None:
        self.joint = joint
        super().__init__(
            f"Joint {joint!r} is singular at the guess: its rows are not finite there, as those of a Distance whose "
            "points coincide."
        )


@dataclass(frozen=True)
class Reached:
    """Coordinates q (n_q,), states s (n_s,), and the violation of the position rows over their scales (n_c,)."""

    q: Array
    s: Array
    r: Array
    is_on_constraints: bool


@dataclass(frozen=True, eq=False)
class PositionRows:
    """The position rows of a DAE at rest at the time t0 and the nominal parameters, over the DAE's scales."""

    dae: DAE
    Phi: ca.Function
    G: ca.Function
    angles: Indices  # numbers of the states that count the turns of angles in Phi
    t0: float

    @cached_property
    def _scales(self) -> Array:
        return self.dae.row_scales[: self.dae.n_c]

    def violation(self, q: Array, s: Array) -> Array:
        """Phi (n_c,) at coordinates q and states s."""
        return self._evaluate(self.Phi, q, s).full().ravel() / self._scales

    def _evaluate(self, f: ca.Function, q: Array, s: Array) -> ca.DM:
        states = (s,) if self.dae.n_s else ()
        return f(q, np.zeros(self.dae.n_v), *states, self.dae.p_nominal, self.t0)

    def _counted(self, q: Array, s: Array) -> Array:
        """States s next to which the angles count the turns that they have at coordinates q next to states s."""
        if self.dae.s_start is None or not self.angles.size:
            return s
        angle, counted = self.dae.s_start(q, self.dae.p_nominal).full().ravel()[self.angles], s.copy()
        counted[self.angles] = angle + _TURN * np.floor((s[self.angles] - angle) / _TURN + 0.5)
        return counted

    def turned(self, q: Array) -> Array:
        """States with as many turns of each angle as reduce the violation most."""
        s = self._counted(q, rest_states(self.dae))
        for k in self.angles:
            more = s.copy()
            more[k] += _TURN
            r = self.violation(q, s)
            change = self.violation(q, more) - r
            if change.any():
                s[k] -= _TURN * np.round(change @ r / (change @ change))
        return s

    def size(self, q: Array) -> float:
        """The size of the scene at coordinates q, by which violations are judged."""
        coordinates = float(np.abs(q / self.dae.coordinate_scales).max(initial=0.0))
        r = self.violation(q, rest_states(self.dae))
        return max(coordinates, float(np.abs(r).max(initial=0.0)), 1e-300)

    def reach(self, q: Array, s: Array, rows: Indices, free: Indices, is_damped: bool = True) -> Reached:
        """Move free displacements least until rows, by their numbers, hold. Angles count turns next to states s.

        Damped steps reduce the violation. Full steps may leave a place where none does.

        Raises
        ------
        SingularRow                if rows are not finite
        """
        units, size = self.dae.displacement_scales[free], self.size(q)
        s = self._counted(q, s)
        r = self.violation(q, s)
        course = [float(np.linalg.norm(r[rows]))]
        for _ in range(_ITERATIONS if is_damped else _FULL_STEPS):
            if np.abs(r[rows]).max(initial=0.0) <= 1e-15 * size or not free.size:
                break
            if is_damped and len(course) > _PATIENCE and course[-1] > _PROGRESS * course[-1 - _PATIENCE]:
                break
            J = self._jacobian(q, s, rows, free) * units / self._scales[rows, None]
            irregular = ~(np.isfinite(J).all(axis=1) & np.isfinite(r[rows]))
            if irregular.any():
                name = constraint_of_row(self.dae, int(rows[int(irregular.argmax())]))
                raise SingularRow(name)
            step = _least_step(J, -r[rows]) * units
            for damping in 0.5 ** np.arange(_HALVINGS):
                delta = np.zeros(self.dae.n_v)
                delta[free] = damping * step
                q_new = np.asarray(self.dae.retract(q, delta)).ravel()
                r_new = self.violation(q_new, s)
                if not is_damped or np.linalg.norm(r_new[rows]) < np.linalg.norm(r[rows]):
                    break
            else:
                break
            q, r, s = q_new, r_new, self._counted(q_new, s)
            course.append(float(np.linalg.norm(r[rows])))
        return Reached(q, s, r, bool(np.abs(r[rows]).max(initial=0.0) <= _TOLERANCE * size))

    def _jacobian(self, q: Array, s: Array, rows: Indices, free: Indices) -> Array:
        return self._evaluate(self.G, q, s)[rows.tolist(), free.tolist()].full()


def _least_step(J: Array, r: Array) -> Array:
    """The step (n,) of least norm with J step = r, which moves the coordinates least.

    Factors of J' are found faster than its singular values, which are needed only where rows depend on each other.
    """
    if (solve := normal_solver(J)) is not None:
        return np.asarray(J.T @ solve(r), dtype=np.float64)
    if J.shape[0] <= J.shape[1]:
        Q, R = np.linalg.qr(J.T)
        pivots = np.abs(np.diag(R))
        if pivots.min(initial=1.0) > _REGULAR * pivots.max(initial=0.0):
            return np.asarray(Q @ np.linalg.solve(R.T, r), dtype=np.float64)
    return np.asarray(np.linalg.lstsq(J, r, rcond=1e-10)[0], dtype=np.float64)
