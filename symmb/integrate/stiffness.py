"""How fast a motion could change: eigenvalues of its linearisation along a run."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.model import DAE
from symmb.symbolic import batch


@dataclass(frozen=True)
class Stiffness:
    """The fastest of the linearised motions.

    Attributes
    ----------
    decay : float            largest rate at which something dies away [1/s]
    growth : float           largest rate at which something grows [1/s]
    frequency : float        largest angular frequency [rad/s]
    """

    decay: float
    growth: float
    frequency: float

    @property
    def rate(self) -> float:
        """What an explicit step times must stay below a few."""
        return max(self.decay, self.frequency)

    def is_stiff(self, span: float) -> bool:
        """Whether something dies away so fast that steps should not follow it over so long a time [s].

        Near an unstable position things die away as fast as others grow; these have to be followed.
        """
        return self.decay * span > STIFF and self.decay > 10 * self.growth


STIFF = 2e3
"""A motion is stiff if its horizon holds more shortest time constants: explicit steps are about as long as one."""


def stiffness(dae: DAE, X: Array, p: Array, times: Array) -> Stiffness:
    """From the symbolic Jacobian of x' = f(x, p, t) at states X (m, n_x) of the times (m,), parameters p (n_p,)."""
    n = X.shape[1]
    x, P, t, direction = ca.SX.sym("x", n), ca.SX.sym("p", len(p)), ca.SX.sym("t"), ca.SX.sym("dx", n)
    rates = ca.vertcat(*dae.rhs.call(list(dae.arguments(x, P, t))))
    along = ca.Function("along", [x, direction, P, t], [ca.densify(ca.jtimes(rates, x, direction))], {"cse": True})
    decay = growth = frequency = 0.0
    for state, time in zip(X if n else X[:0], times if n else times[:0], strict=True):
        (columns,) = batch(along, state, np.eye(n), p, np.array([time]))
        if np.isfinite(columns).all():
            eigenvalues = np.linalg.eigvals(columns.reshape(n, n).T)
            decay = max(decay, float(-eigenvalues.real.min()))
            growth = max(growth, float(eigenvalues.real.max()))
            frequency = max(frequency, float(np.abs(eigenvalues.imag).max()))
    return Stiffness(decay, growth, frequency)
