"""Damped Gauss-Newton method: the smallest change of coordinates that satisfies the constraints."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import casadi as ca
import numpy as np

from symmb._magnitudes import LAST_DIGITS, NOTHING
from symmb._types import Array, Indices
from symmb.equations.model import DAE
from symmb.equations.start.labels import constraint_of_row
from symmb.equations.start.scales import rest_states
from symmb.equations.start.sparse_rows import least_step


def with_fewest_turns(
    x: Array, angles: Iterable[int], violation: Callable[[Array], Array], least: float = 0.0
) -> Array:
    """Values x (n,) after whole turns are added to the angles (their indices) to minimise a violation.

    Changes of the violation up to `least` count as rounding errors.
    """
    x = x.copy()
    for k in angles:
        more = x.copy()
        more[k] += math.tau
        r = violation(x)
        change = violation(more) - r
        if np.abs(change).max(initial=0.0) > least:
            x[k] -= math.tau * np.round(change @ r / (change @ change))
    return x


class FailedAssembly(Exception):
    """A failed assembly: a sentence with the reason, and the name of the joint."""

    def __init__(self, text: str, joint: str) -> None:
        self.joint = joint
        super().__init__(text)


@dataclass(frozen=True, eq=False)
class PositionRows:
    """The position rows of a DAE at rest at the time t0 and the nominal parameters, divided by the DAE's scales.

    `angles` are the indices of the states that count the turns of angles in the rows.
    """

    dae: DAE
    angles: Indices
    t0: float

    @cached_property
    def _scales(self) -> Array:
        return self.dae.row_scales[: self.dae.n_c]

    def violation(self, q: Array, s: Array) -> Array:
        """Scaled Phi (n_c,) at coordinates q and states s."""
        return self._evaluate(self.dae.Phi, q, s).full().ravel() / self._scales

    def _evaluate(self, f: ca.Function | None, q: Array, s: Array) -> ca.DM:
        states = (s,) if self.dae.n_s else ()
        return cast(ca.Function, f)(q, np.zeros(self.dae.n_v), *states, self.dae.p_nominal, self.t0)

    def _counted(self, q: Array, s: Array) -> Array:
        """States s after angles follow coordinates q, with the numbers of turns closest to the given states."""
        if self.dae.s_start is None or not self.angles.size:
            return s
        angle, counted = self.dae.s_start(q, self.dae.p_nominal).full().ravel()[self.angles], s.copy()
        counted[self.angles] = angle + math.tau * np.floor((s[self.angles] - angle) / math.tau + 0.5)
        return counted

    def turned(self, q: Array) -> Array:
        """States at coordinates q, with the number of turns of each angle that minimises the violation."""
        every = np.arange(len(self.violation(q, rest_states(self.dae))))
        return self.with_turns_of(every, q, self._counted(q, rest_states(self.dae)))

    def with_turns_of(self, rows: Indices, q: Array, s: Array) -> Array:
        """States s with the number of turns of each angle that minimises the violation of some rows."""
        return with_fewest_turns(s, self.angles, lambda s: self.violation(q, s)[rows])

    def size(self, q: Array) -> float:
        """The size of the scene at coordinates q. Violations are measured relative to this size."""
        coordinates = float(np.abs(q / self.dae.coordinate_scales).max(initial=0.0))
        r = self.violation(q, rest_states(self.dae))
        return max(coordinates, float(np.abs(r).max(initial=0.0)), NOTHING)

    def reach(
        self, q: Array, s: Array, free: Indices, is_damped: bool = True, steps: int = 50
    ) -> tuple[Array, Array, Array]:
        """Coordinates, states and violations after the smallest free displacements that satisfy the rows.

        The turns of angles are counted from states s. Damped steps always reduce the violation. Full steps may leave a
        local minimum of the violation. Raises FailedAssembly if rows are not finite.
        """
        units, rounding = self.dae.displacement_scales[free], LAST_DIGITS * self.size(q)
        s = self._counted(q, s)
        r = self.violation(q, s)
        for _ in range(steps if free.size else 0):
            if np.abs(r).max(initial=0.0) <= rounding:
                break
            J = self._evaluate(self.dae.G, q, s)[: self.dae.n_c, free.tolist()].full() * units / self._scales[:, None]
            irregular = ~(np.isfinite(J).all(axis=1) & np.isfinite(r))
            if irregular.any():
                joint = constraint_of_row(self.dae, int(irregular.argmax()))
                raise FailedAssembly(
                    f"Joint {joint!r} is singular at the guess: its rows are not finite. For example, the "
                    "points of a Distance must not coincide.",
                    joint,
                )
            delta = np.zeros(self.dae.n_v)
            delta[free] = least_step(J, -r) * units
            for damping in 0.5 ** np.arange(12):
                q_new = np.asarray(self.dae.retract(q, damping * delta)).ravel()
                r_new = self.violation(q_new, s)
                # The condition of Armijo (1966), Pacific J. Math. 16(1), with a decrease of 1 % of the step.
                if not is_damped or np.linalg.norm(r_new) < (1 - 0.01 * damping) * np.linalg.norm(r):
                    break
            else:
                break
            q, r, s = q_new, r_new, self._counted(q_new, s)
        return q, s, r
