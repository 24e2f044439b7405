"""Stiffness of a motion: eigenvalues of its linearisation along a run."""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.model import DAE
from symmb.symbolic import batch, common


@dataclass(frozen=True)
class Stiffness:
    """The fastest rates of the linearised motions.

    Attributes
    ----------
    decay : float            largest rate of decay [1/s]
    growth : float           largest rate of growth [1/s]
    frequency : float        largest angular frequency [rad/s]
    """

    decay: float
    growth: float
    frequency: float

    @property
    def rate(self) -> float:
        """The rate that limits the step of explicit methods: their product must be below about 3."""
        return max(self.decay, self.frequency)

    def is_stiff(self, span: float) -> bool:
        """Whether the decay is so fast that the steps should not resolve it over this time [s].

        Near an unstable position motions decay as fast as others grow, which the steps must resolve.
        """
        return self.decay * span > STIFF and self.decay > 10 * self.growth


STIFF = 2e3
"""A motion is stiff if its horizon holds more shortest time constants: explicit steps are about as long as one."""


def stiffness(dae: DAE, X: Array, p: Array, times: Array) -> Stiffness:
    """From the symbolic Jacobian of x' = f(x, p, t) at states X (m, n_x) of the times (m,), parameters p (n_p,)."""
    n, along = X.shape[1], _along(dae.rhs)
    cuts = [dae.n_q, dae.n_q + dae.n_v][: along.n_in() - 4]
    decay = growth = frequency = 0.0
    for state, time in zip(X if n else X[:0], times if n else times[:0], strict=True):
        (columns,) = batch(along, *np.split(state, cuts), p, np.array([time]), np.eye(n))
        if np.isfinite(columns).all():
            eigenvalues = np.linalg.eigvals(columns.reshape(n, n).T)
            decay = max(decay, float(-eigenvalues.real.min()))
            growth = max(growth, float(eigenvalues.real.max()))
            frequency = max(frequency, float(np.abs(eigenvalues.imag).max()))
    return Stiffness(decay, growth, frequency)


@lru_cache(maxsize=64)
def _along(rhs: ca.Function) -> ca.Function:
    """(q, v [, s], p, t, dx) -> change of the rates along dx."""
    at = rhs.sx_in()
    x = ca.vertcat(*at[:-2])
    direction, rates = ca.SX.sym("dx", x.numel()), ca.vertcat(*rhs.call(at))
    return common("along", [*at, direction], [ca.densify(ca.jtimes(rates, x, direction))])
