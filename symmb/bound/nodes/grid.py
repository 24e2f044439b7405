"""Interpolation on nested nodes, on tensor grids and on sparse grids. A grid is a set of degrees with a node for each.

The nodes of one parameter have an order: the middle, the ends, then the nodes that halve the angles between them. The
first 3, 5, 9, 17, ... nodes are those of Clenshaw and Curtis. Among the nodes of a halving, the next node has the
largest product of distances to earlier nodes (Leja). Degree k has the first k + 1 nodes. A set that contains all
smaller multi-indices thus has one node for each polynomial, with the same multi-index.
"""

import itertools
from collections.abc import Iterable
from functools import cache, cached_property

import numpy as np

from symmb._types import Array, Indices
from symmb.bound import polynomials
from symmb.bound.nodes.tensor_fit import Tensor, interpolants, packed
from symmb.bound.polynomials import Index, MultiIndices, below, with_lower
from symmb.run.codegen import Tables


class Grid:
    """A growing set of multi-indices in d parameters.

    Attributes
    ----------
    row : dict        multi-index -> row, in the order of additions
    """

    def __init__(self, d: int) -> None:
        self.d = d
        self.row: dict[Index, int] = {}
        self._signs: dict[Index, int] = {}  # signs of the tensor interpolants

    def missing(self, indices: Iterable[Index]) -> set[Index]:
        """The given indices and all smaller indices that the set does not contain, which must be added together."""
        return with_lower(indices, self.row)

    def add(self, indices: set[Index]) -> None:
        """Add indices, in the order of their degrees."""
        for index in sorted(indices, key=lambda a: (sum(a), a)):
            self.row[index] = len(self.row)
            # The sum of tensor products of differences (Smolyak 1963) consists of these tensor interpolants. Most terms
            # cancel.
            for steps in itertools.product(*[(0, 1) if k else (0,) for k in index]):
                lowered = tuple(k - z for k, z in zip(index, steps, strict=True))
                self._signs[lowered] = self._signs.get(lowered, 0) + (-1) ** sum(steps)
        for derived in ("alpha", "nodes", "_tensors"):
            self.__dict__.pop(derived, None)

    def grown(self, indices: set[Index]) -> "Grid":
        """A set with further indices."""
        grid = Grid(self.d)
        grid.row, grid._signs = dict(self.row), dict(self._signs)
        grid.add(indices)
        return grid

    def ahead(self) -> set[Index]:
        """Indices that may be added, because the set contains all smaller indices."""
        near = {above for index in self.row for above in _above(index)}
        return {index for index in near if index not in self.row and all(b in self.row for b in below(index))}

    @cached_property
    def alpha(self) -> MultiIndices:
        """(N, d) multi-indices in the order of `row`."""
        alpha = np.array(list(self.row), dtype=np.intp).reshape(-1, self.d)
        alpha.flags.writeable = False  # several expansions use it
        return alpha

    @cached_property
    def nodes(self) -> Array:
        """(N, d) nodes in [-1, 1]."""
        return line(int(self.alpha.max(initial=0)) + 1)[self.alpha]

    def coefficients(self, *blocks: Array, rows: Indices | None = None) -> Array:
        """Legendre coefficients (N, m) of the interpolant from blocks of values (.., m).

        `rows` (N,) are the rows of the nodes in all blocks together; by default all rows.
        """
        return interpolants(self._tensors, blocks, np.arange(len(self.row)) if rows is None else rows)

    def axis(self, k: int) -> list[int]:
        """Rows of the nodes at which only parameter k is not in the middle, in the order of its nodes."""
        own = (tuple(j if i == k else 0 for i in range(self.d)) for j in itertools.count())
        return [self.row[index] for index in itertools.takewhile(self.row.__contains__, own)]

    def tables(self) -> Tables:
        """The Tensors of c/tensor_fit.h, from values at the nodes to Chebyshev coefficients."""
        fits = {id(A): polynomials.legendre_to_chebyshev(len(A) - 1) @ A for _, axes, _ in self._tensors for A in axes}
        basis = packed([(rows, [fits[id(A)] for A in axes], sign) for rows, axes, sign in self._tensors], len(self.row))
        return basis, basis.arrays

    @cached_property
    def _tensors(self) -> list[Tensor]:
        """The tensor grids of the sparse interpolant, with their factors."""
        tensors = []
        for index, sign in self._signs.items():
            if not sign:
                continue
            shape = tuple(k + 1 for k in index)
            rows = np.array([self.row[n] for n in itertools.product(*map(range, shape))])
            tensors.append((rows, [_line_fit(n) for n in shape], sign))
        return tensors


def along_axes(d: int, degree: int) -> set[Index]:
    """The multi-indices of one degree along each of d axes, and of degree 0 along the others."""
    return {tuple(degree * (i == j) for j in range(d)) for i in range(d)}


def _above(index: Index) -> list[Index]:
    return [(*index[:i], k + 1, *index[i + 1 :]) for i, k in enumerate(index)]


@cache
def line(n: int) -> Array:
    """(n,) first nodes of one parameter."""
    angles, step = [0.0, -1.0, 1.0], 1.0  # quarter turns
    while len(angles) < n:
        step /= 2
        new = np.arange(-1 + step, 1, 2 * step)
        while new.size:
            distances = np.abs(np.subtract.outer(np.sin(np.pi / 2 * new), np.sin(np.pi / 2 * np.array(angles))))
            # Mirror images have equal products. After rounding, every machine chooses the first node.
            best = int(np.argmax(np.log(distances).sum(axis=1).round(9)))
            angles.append(float(new[best]))
            new = np.delete(new, best)
    return np.sin(np.pi / 2 * np.array(angles[:n]))


@cache
def _line_fit(n: int) -> Array:
    """(n, n) matrix from values at the first n nodes to Legendre coefficients."""
    return np.asarray(np.linalg.inv(np.polynomial.legendre.legvander(line(n), n - 1)), dtype=float)
