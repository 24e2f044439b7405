"""Static deformations of a structure that its modes leave out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices
from symmb.structures.eigenmodes import determinate, factorized
from symmb.structures.mass_samples import Sparse


@dataclass(frozen=True, eq=False)
class Flexibility:
    """A structure with its modes, of which loads at nodes deform the one more than the others.

    Parameters
    ----------
    K, M : (d, d)        stiffness and mass matrix, sparse
    free : (f,)          degrees of freedom that can move
    rigid : (d, r)       rigid motions; r = 0 for a clamped structure
    X, stiffness : (d, n), (n,)
    per_node : int       degrees of freedom a node
    """

    K: Sparse
    M: Sparse
    free: Indices
    rigid: Array
    X: Array
    stiffness: Array
    per_node: int

    def joins(self, a: int, b: int) -> bool:
        """Whether an element joins two nodes."""
        rows, columns = (slice(self.per_node * k, self.per_node * (k + 1)) for k in (a, b))
        return bool(self.K[rows][:, columns].nnz)

    def missing(self, nodes: Sequence[int]) -> Array:
        """Compliance (6 m, 6 m) of loads at m nodes, forces and moments, less that of the modes.

        A free structure accelerates as a rigid body under the loads, and deforms by them and by its inertia.
        """
        dofs = (self.per_node * np.array(nodes, dtype=int)[:, None] + np.arange(self.per_node)).ravel()
        moves = np.isin(dofs, self.free)
        unit = np.zeros((self.K.shape[0], len(dofs)))
        unit[dofs[moves], np.flatnonzero(moves)] = 1.0
        loads = unit - self.M @ self._rigid_part(unit)
        supported = np.setdiff1d(self.free, self.free[determinate(self.rigid[self.free])])
        u = np.zeros_like(unit)
        u[supported] = factorized(self.K[supported][:, supported])(loads[supported])
        u -= self._rigid_part(self.M @ u)
        shapes = unit.T @ self.X
        left = loads.T @ u - (shapes / self.stiffness) @ shapes.T
        places = (6 * np.arange(len(nodes))[:, None] + np.arange(self.per_node)).ravel()
        whole = np.zeros((6 * len(nodes),) * 2)
        whole[np.ix_(places, places)] = (left + left.T) / 2
        return whole

    def _rigid_part(self, loads: Array) -> Array:
        """Rigid acceleration by loads, or rigid displacement by momenta (d, m)."""
        R = self.rigid
        return R @ np.linalg.solve(R.T @ (self.M @ R), R.T @ loads) if R.size else np.zeros_like(loads)
