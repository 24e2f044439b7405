"""Stiffness and mass matrices from other programs: reading, checks, lumped masses."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from os import PathLike
from typing import Any

import numpy as np
import numpy.typing as npt

from symmb._errors import DeclarationError, FileError
from symmb._magnitudes import SLIGHT, SMALL
from symmb._options import optional_package
from symmb._types import Array
from symmb.declare.structures.eigenmodes import INDEFINITE, definite
from symmb.declare.structures.mass_samples import MassSamples, Sparse, at_nodes, rigid_motions
from symmb.declare.structures.nastran import Matrix, is_nastran, read_dmig, read_grids
from symmb.declare.structures.validation import numbers
from symmb.results.files import told

OWNER = "FiniteElements.matrices"
ASYMMETRY, STRAIN = 1e-8, SLIGHT
"""Accepted asymmetry and strain of rigid motions, relative to the largest entries. The cause is rounding in files."""


def loaded(
    positions: npt.ArrayLike | str | PathLike[str], sources: dict[str, list[Any]]
) -> tuple[Array, list[list[Sparse]]]:
    """Positions (k, 3) of nodes, and lists of the matrices K and M, from arrays or files.

    For matrices of Nastran, the nodes are the nodes of the matrices in the order of their numbers.
    """
    opened = {
        name: [read_dmig(source, name) if is_nastran(source) else source for source in some]
        for name, some in sources.items()
    }
    degrees = set[tuple[int, int]]().union(
        *(source.degrees for some in opened.values() for source in some if isinstance(source, Matrix))
    )
    numbered = sorted({node for node, _ in degrees})
    nodes = _positions(positions, numbered)
    per_node = 6 if any(part > 3 for _, part in degrees) else 3
    if numbered and len(nodes) != len(numbered):
        raise DeclarationError(f"{OWNER}: positions has {len(nodes)} nodes, but the matrices have {len(numbered)}.")
    ready = [
        [read(A.sparse(numbered, per_node) if isinstance(A, Matrix) else A, name, len(nodes)) for A in some]
        for name, some in opened.items()
    ]
    return nodes, ready


def _positions(source: npt.ArrayLike | str | PathLike[str], numbered: list[int]) -> Array:
    """Positions (k, 3) from an array or a mesh. `numbered` are the nodes to read from a Nastran file; empty for all."""
    if not isinstance(source, str | PathLike):
        return numbers(source, OWNER, "positions", ("k", 3))
    if is_nastran(source):
        grids = read_grids(source)
        missing = [node for node in numbered if node not in grids]
        if missing:
            raise DeclarationError(f"{OWNER}: the matrices have node {missing[0]}, but {source} has no such GRID card.")
        return numbers([grids[node] for node in numbered or sorted(grids)], OWNER, "positions", ("k", 3))
    meshio = optional_package("meshio", f"{OWNER} with a file of a mesh", "fe")
    with told(source, "read"):
        open(source, "rb").close()
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            points = np.asarray(meshio.read(source).points, dtype=float)
    except (Exception, SystemExit):  # many readers raise many errors, and one reader ends the program
        raise DeclarationError(f"{OWNER}: positions: meshio cannot read {source}.") from None
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return numbers(points, OWNER, f"positions of {source}", ("k", 3))


def read(source: Sparse | str | PathLike[str], name: str, k: int) -> Sparse:
    """A symmetric sparse matrix of 3 k or 6 k rows from an array, a sparse matrix or a Matrix Market file."""
    from scipy.io import mminfo, mmread
    from scipy.sparse import csc_array, issparse

    if isinstance(source, str | PathLike):
        try:
            with told(source, "read"):
                open(source, "rb").close()
                *shape, entries = mminfo(source)[:3]  # checked before the entries are read
                _require_size(tuple(shape), name, k)
                if not entries <= shape[0] * shape[1]:
                    raise ValueError(f"its header gives {entries} entries, too many for {shape[0]} rows")
                source = mmread(source, spmatrix=False)
        except FileError:
            raise
        except (ValueError, OverflowError, MemoryError) as error:
            raise DeclarationError(f"{OWNER}: {name}: {source} is not a Matrix Market file: {error}") from error
    # Lists are reported like other arrays, and NumPy itself has a `dtype`.
    if isinstance(getattr(source, "dtype", None), np.dtype) and np.iscomplexobj(source):
        raise DeclarationError(f"{OWNER}: {name} is complex. Pass a real matrix, and damping by modes(damping=...).")
    if issparse(source):
        matrix = csc_array(source, dtype=float)
        numbers(matrix.data, OWNER, name, ("m",))
    else:
        matrix = csc_array(numbers(source, OWNER, name, ("d", "d")))
    _require_size(matrix.shape, name, k)
    if abs(matrix - matrix.T).max() > ASYMMETRY * abs(matrix).max():
        raise DeclarationError(f"{OWNER}: {name} is not symmetric. If only one triangle is stored, add the other.")
    return csc_array((matrix + matrix.T) / 2)


def _require_size(shape: Any, name: str, k: int) -> None:
    """Raise a DeclarationError unless a matrix fits k nodes."""
    if shape not in ((3 * k, 3 * k), (6 * k, 6 * k)):
        raise DeclarationError(
            f"{OWNER}: {name} has the shape {shape}, but {k} nodes have 3 or 6 degrees of freedom each: "
            f"{3 * k} or {6 * k} rows. Remove nodes without degrees of freedom."
        )


def checked(positions: Array, K: Sparse, M: Sparse) -> None:
    """Raise a DeclarationError unless K and M belong to a body without supports."""
    if K.shape != M.shape:
        raise DeclarationError(f"{OWNER}: K has the shape {K.shape}, but M has the shape {M.shape}. Use equal shapes.")
    if not np.ptp(positions, axis=0).any():
        raise DeclarationError(f"{OWNER}: a structure needs at least two nodes at different positions.")
    motions = rigid_motions(positions - positions.mean(axis=0), K.shape[0] // len(positions))
    largest = abs(K) @ np.abs(motions)
    wrong = np.abs(K @ motions) > STRAIN * np.maximum(largest, largest.max(axis=0) * SMALL)
    if wrong.any():
        motion = ("translation along", "rotation about")[int(wrong.any(axis=0).argmax()) // 3]
        axis = "xyz"[int(wrong.any(axis=0).argmax()) % 3]
        row = int(wrong.any(axis=1).argmax())
        raise DeclarationError(
            f"{OWNER}: K has strain energy for a rigid {motion} {axis} (row {row}). Pass the matrices of the body "
            "without supports, and positions in the units of K. The degrees of freedom are ordered by nodes: three "
            "translations, then three rotations, in the axes of the positions."
        )
    if not definite(M, K):
        raise DeclarationError(f"{OWNER}: {INDEFINITE}")


def lumped(positions: Array, M: Sparse) -> MassSamples:
    """Masses at the nodes: the row sums of M for rigid translations, averaged over the three directions."""
    k = len(positions)
    per_node = M.shape[0] // k
    moved = (M @ rigid_motions(positions, per_node)[:, :3]).reshape(k, per_node, 3)
    mass = np.trace(moved[:, :3], axis1=1, axis2=2) / 3
    return at_nodes(np.arange(k), mass, np.zeros((k, 3, 3)), positions, per_node)
