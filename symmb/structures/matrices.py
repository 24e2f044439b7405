"""Stiffness and mass matrices from other programs: reading, checks, lumped masses."""

from os import PathLike

import numpy as np

from symmb._errors import DeclarationError, FileError
from symmb._types import Array
from symmb.files import told
from symmb.structures.eigenmodes import INDEFINITE, definite
from symmb.structures.mass_samples import MassSamples, Sparse, at_nodes, rigid_motions
from symmb.structures.validation import numbers

OWNER = "FiniteElements.matrices"
ASYMMETRY, STRAIN = 1e-8, 1e-6
"""Asymmetry, and strain under rigid motions, over the largest entries, that the printed digits of a file may cause."""


def read(source: Sparse | str | PathLike[str], name: str, k: int) -> Sparse:
    """A symmetric sparse matrix of 3 k or 6 k rows from an array, a sparse matrix or a Matrix Market file."""
    from scipy.io import mmread
    from scipy.sparse import csc_array, issparse

    if isinstance(source, str | PathLike):
        try:
            with told(source, "read"):
                source = mmread(source)
        except FileError:
            raise
        except (ValueError, OverflowError) as error:
            raise DeclarationError(f"{OWNER}: {name}: {source} is no Matrix Market file: {error}") from error
    if issparse(source):
        matrix = csc_array(source, dtype=float)
        numbers(matrix.data, OWNER, name, ("m",))
    else:
        matrix = csc_array(numbers(source, OWNER, name, ("d", "d")))
    if matrix.shape not in ((3 * k, 3 * k), (6 * k, 6 * k)):
        raise DeclarationError(
            f"{OWNER}: {name} has the shape {matrix.shape}, but {k} nodes have 3 or 6 degrees of freedom each: "
            f"{3 * k} or {6 * k} rows. Nodes without freedom are not listed."
        )
    if abs(matrix - matrix.T).max() > ASYMMETRY * abs(matrix).max():
        raise DeclarationError(f"{OWNER}: {name} is not symmetric. If only one triangle is stored, add the other.")
    return csc_array((matrix + matrix.T) / 2)


def checked(positions: Array, K: Sparse, M: Sparse) -> None:
    """Raise a DeclarationError unless K and M are those of a body free in space."""
    if K.shape != M.shape:
        raise DeclarationError(f"{OWNER}: K has the shape {K.shape}, M {M.shape}. They must be the same.")
    if not np.ptp(positions, axis=0).any():
        raise DeclarationError(f"{OWNER}: a structure has two nodes at least, at different places.")
    motions = rigid_motions(positions - positions.mean(axis=0), K.shape[0] // len(positions))
    largest = abs(K) @ np.abs(motions)
    wrong = np.abs(K @ motions) > STRAIN * np.maximum(largest, largest.max(axis=0) * 1e-3)
    if wrong.any():
        motion = ("translation along", "rotation about")[int(wrong.any(axis=0).argmax()) // 3]
        axis = "xyz"[int(wrong.any(axis=0).argmax()) % 3]
        row = int(wrong.any(axis=1).argmax())
        raise DeclarationError(
            f"{OWNER}: K strains in a rigid {motion} {axis} (row {row}). Give the matrices of the body without "
            "supports, positions in the units of K, and degrees of freedom node by node: three translations, then "
            "three rotations, in the axes of the positions."
        )
    if not definite(M, K):
        raise DeclarationError(f"{OWNER}: {INDEFINITE}")


def lumped(positions: Array, M: Sparse) -> MassSamples:
    """Masses at the nodes: the row sums of M over rigid translations, the mean of the three directions."""
    k = len(positions)
    per_node = M.shape[0] // k
    moved = (M @ rigid_motions(positions, per_node)[:, :3]).reshape(k, per_node, 3)
    mass = np.trace(moved[:, :3], axis1=1, axis2=2) / 3
    return at_nodes(np.arange(k), mass, np.zeros((k, 3, 3)), positions, per_node)
