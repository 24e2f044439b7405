"""The mass of a flexible body as point masses that move with the degrees of freedom."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symmb._types import Array, Indices

Sparse = Any
"""A SciPy sparse matrix or array."""


@dataclass(frozen=True, eq=False)
class MassSamples:
    """Point masses with inertia that move with d degrees of freedom. Sums over masses replace integrals."""

    mass: Array  # (s,) [kg]
    positions: Array  # (s, 3), undeformed [m]
    translation: Sparse  # (3 s, d), displacement of each sample for unit degrees of freedom
    rotary: Array  # (s, 3, 3), inertia about the sample itself [kg m^2]
    rotation: Sparse  # (3 s, d), small rotation of each sample for unit degrees of freedom

    def mass_matrix(self) -> Sparse:
        """Consistent mass matrix (d, d), Σ (m Nᵀ N + Θᵀ J Θ)."""
        from scipy.sparse import bsr_array, csc_array, diags_array

        s, masses = len(self.mass), diags_array(np.repeat(self.mass, 3))
        rotary = bsr_array((self.rotary, np.arange(s), np.arange(s + 1)), shape=(3 * s, 3 * s))
        return csc_array(self.translation.T @ masses @ self.translation + self.rotation.T @ rotary @ self.rotation)


def joined(parts: Sequence[MassSamples]) -> MassSamples:
    """All samples of several sets that have the same degrees of freedom."""
    from scipy.sparse import vstack

    return MassSamples(
        np.concatenate([part.mass for part in parts]),
        np.concatenate([part.positions for part in parts]),
        vstack([part.translation for part in parts], format="csr"),
        np.concatenate([part.rotary for part in parts]),
        vstack([part.rotation for part in parts], format="csr"),
    )


def at_nodes(nodes: Indices, mass: Array, rotary: Array, positions: Array, per_node: int) -> MassSamples:
    """Samples at nodes, which move with the degrees of freedom of the nodes."""
    from scipy.sparse import csr_array

    def rows(first: int) -> Sparse:
        shape = (3 * len(nodes), per_node * len(positions))
        if first >= per_node:
            return csr_array(shape)
        columns = (nodes[:, None] * per_node + first + np.arange(3)).ravel()
        return csr_array((np.ones(columns.size), (np.arange(columns.size), columns)), shape=shape)

    return MassSamples(np.asarray(mass), positions[nodes], rows(0), np.asarray(rotary), rows(3))


def rigid_motions(positions: Array, per_node: int) -> Array:
    """Displacements (per_node k, 6) of the nodes for unit translations, and for unit rotations about the origin."""
    motions = np.zeros((len(positions), per_node, 6))
    motions[:, :3, :3] = np.eye(3)
    x, y, z = positions.T
    o = np.zeros_like(x)
    motions[:, :3, 3:] = -np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)
    if per_node == 6:
        motions[:, 3:, 3:] = np.eye(3)
    return motions.reshape(-1, 6)
