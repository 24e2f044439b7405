"""Maps u(w) given by R(u, w) = 0: Newton for many samples at once, and their Taylor coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.start.block_solver import BlockSolver
from symmb.symbolic import batch, jet_function, nonzeros

_FEW = 40
"""Symbols of a residual up to which its expressions are searched for common ones, which takes longer than it saves."""


LAST_DIGITS = 4e-15
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
            r, J = batch(self.residual, u[active], w[active])[0], nonzeros(self.jacobian, u[active], w[active])
            finite = np.isfinite(r).all(axis=1) & np.isfinite(J).all(axis=1)
            active, r, J = active[finite], r[finite], J[finite]
            if not active.size:
                break
            step = self._blocks.solve(J, r)
            u[active] -= step
            # Quadratic convergence: a step below 1e-9 leaves an error at rounding level.
            done = np.abs(step).max(axis=1, initial=0.0) <= 1e-9 * np.maximum(
                np.abs(u[active]).max(axis=1, initial=0.0), 1e-3
            )
            # Close to singular positions rounding of the residual makes steps that never become small.
            done = done | (np.abs(r) <= LAST_DIGITS * self._blocks.row_sizes(J)).all(axis=1)
            ok[active[done]] = True
            active = active[~done]
            if not active.size:
                break
        return u, ok

    @cached_property
    def _blocks(self) -> BlockSolver:
        return BlockSolver(self.jacobian.sparsity_out(0))

    def jets(self, u0: Array, w: Sequence[Array]) -> list[Array]:
        """Taylor coefficients u_0, ..., u_k along the curves with coefficients w_0, ..., w_k, each (N, n_w)."""
        order = len(w) - 1
        coefficients = jet_function(self.residual, order + 1)
        J = nonzeros(self.jacobian, u0, w[0])
        u = [u0, *(np.zeros_like(u0) for _ in range(order))]
        for j in range(1, order + 1):  # coefficient j of R is linear in u_j, with the Jacobian at order 0
            u[j] = -self._blocks.solve(J, batch(coefficients, *u, *w)[j])
        return u
