"""Static deformations of a structure that its modes do not represent."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices
from symmb.declare.structures.eigenmodes import determinate, factorized
from symmb.declare.structures.mass_samples import Sparse


@dataclass(frozen=True, eq=False)
class Responses:
    """Static responses of a structure and of its modes to unit forces and moments at m nodes."""

    modal: Array  # (n, 6 m), modal coordinates
    left: Array  # (6 m, 6 m), nodal displacements and rotations without the part of the modes
    energy: Array  # (6 m, 6 m), quadratic form of twice the strain energy without the part of the modes


@dataclass(frozen=True, eq=False)
class Flexibility:
    """A structure with its modes. Loads at nodes deform the structure more than the modes show."""

    K: Sparse  # (d, d), stiffness matrix
    M: Sparse  # (d, d), mass matrix
    free: Indices  # (f,), movable degrees of freedom, including a clamped node
    rigid: Array  # (d, r), rigid motions
    clamped: Indices  # (c,), degrees of freedom of the clamped node; c = 0 for a body in a floating frame
    X: Array  # (d, n), shapes of the modes
    stiffness: Array  # (n,), squared circular frequencies of the modes [1/s^2]
    per_node: int  # degrees of freedom per node
    of_interfaces: int  # number of static interface shapes; a smaller number of modes is approximate

    @property
    def clamped_node(self) -> int | None:
        """The node to which the body's frame is fixed; None for a floating frame."""
        return int(self.clamped[0]) // self.per_node if self.clamped.size else None

    def joins(self, a: int, b: int) -> bool:
        """Whether an element joins two nodes."""
        rows, columns = (slice(self.per_node * k, self.per_node * (k + 1)) for k in (a, b))
        return bool(self.K[rows][:, columns].nnz)

    def responses(self, nodes: Sequence[int]) -> Responses:
        """Responses to loads at m nodes. A free body accelerates rigidly; inertial forces deform it, too."""
        dofs = (self.per_node * np.array(nodes, dtype=int)[:, None] + np.arange(self.per_node)).ravel()
        moves = np.isin(dofs, self.free)
        unit = np.zeros((self.K.shape[0], len(dofs)))
        unit[dofs[moves], np.flatnonzero(moves)] = 1.0
        R, momenta = self.rigid, self.M @ self.rigid
        loads = unit - momenta @ np.linalg.solve(R.T @ momenta, R.T @ unit)
        # For loads in equilibrium, every statically determinate support gives the elastic displacements.
        supported = np.setdiff1d(self.free, self.free[determinate(R[self.free])])
        u = np.zeros_like(unit)
        u[supported] = factorized(self.K[supported][:, supported])(loads[supported])
        at_frame = [A[self.clamped] if self.clamped.size else momenta.T @ A for A in (R, u)]
        u -= R @ np.linalg.solve(*at_frame)
        eta = self.X.T @ loads / self.stiffness[:, None]
        energy = loads.T @ u - eta.T @ (self.stiffness[:, None] * eta)
        left = np.where(moves[:, None], (u - self.X @ eta)[dofs], 0.0)
        places = (6 * np.arange(len(nodes))[:, None] + np.arange(self.per_node)).ravel()
        spread = np.eye(6 * len(nodes))[:, places]
        return Responses(eta @ spread.T, spread @ left @ spread.T, spread @ (energy + energy.T) @ spread.T / 2)
