"""Maps u(w) given by R(u, w) = 0: Newton for many samples at once, and their Taylor coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.symbolic import batch, jet_function

_FEW = 40
"""Symbols of a residual up to which its expressions are searched for common ones, which takes longer than it saves."""


ROUNDING = 4e-15
"""Change of the unknowns, over their scales, whose change of the residual is rounding."""


@dataclass(frozen=True)
class ImplicitMap:
    """The solution u (m,) of m equations R(u, w) = 0 near a known one."""

    residual: ca.Function
    jacobian: ca.Function

    @classmethod
    def of(cls, residual: ca.SX, u: ca.SX, w: ca.SX) -> "ImplicitMap":
        """From SX, residual (m,) in the unknowns u (m,) and the arguments w (n_w,)."""
        options = {"cse": len(ca.symvar(residual)) <= _FEW}
        return cls(
            ca.Function("residual", [u, w], [ca.densify(residual)], options),
            ca.Function("jacobian", [u, w], [ca.jacobian(residual, u)], options),
        )

    def solve(self, w: Array, iterations: int = 30) -> tuple[Array, Mask]:
        """Newton from u = 0.

        Parameters
        ----------
        w : (N, n_w) array

        Returns
        -------
        (N, m) array             the solutions
        (N,) bool array          whether Newton converged
        """
        m = self.residual.numel_in(0)
        u = np.zeros((len(w), m))
        active = np.arange(len(w))
        ok = np.zeros(len(w), dtype=bool)
        for _ in range(iterations):
            (r,), J = batch(self.residual, u[active], w[active]), self._matrices(u[active], w[active])
            finite = np.isfinite(r).all(axis=1) & np.isfinite(J).all(axis=(1, 2))
            active, r, J = active[finite], r[finite], J[finite]
            if not active.size:
                break
            step = _solve_each(J, r)
            u[active] -= step
            # Quadratic convergence: a step below 1e-9 leaves an error at rounding level.
            done = np.abs(step).max(axis=1, initial=0.0) <= 1e-9 * np.maximum(
                np.abs(u[active]).max(axis=1, initial=0.0), 1e-3
            )
            # Close to singular positions rounding of the residual makes steps that never become small.
            done = done | (np.abs(r) <= ROUNDING * np.abs(J).sum(axis=2)).all(axis=1)
            ok[active[done]] = True
            active = active[~done]
            if not active.size:
                break
        return u, ok

    def _matrices(self, u: Array, w: Array) -> Array:
        m = self.residual.numel_in(0)
        return batch(self.jacobian, u, w)[0].reshape(-1, m, m)  # a single unknown comes as a column

    def jets(self, u0: Array, w: Sequence[Array]) -> list[Array]:
        """Taylor coefficients u_0, ..., u_k along the curves with coefficients w_0, ..., w_k, each (N, n_w)."""
        order = len(w) - 1
        coefficients = jet_function(self.residual, order + 1)
        J = self._matrices(u0, w[0])
        u = [u0, *(np.zeros_like(u0) for _ in range(order))]
        for j in range(1, order + 1):  # coefficient j of R is linear in u_j, with the Jacobian at order 0
            u[j] = -_solve_each(J, batch(coefficients, *u, *w)[j])
        return u


def _solve_each(J: Array, r: Array) -> Array:
    if not r.shape[1]:
        return r
    try:
        return np.asarray(np.linalg.solve(J, r[:, :, None])[:, :, 0], dtype=np.float64)
    except np.linalg.LinAlgError:  # a singular sample must not affect the others
        return np.array([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(J, r, strict=True)], dtype=np.float64)
