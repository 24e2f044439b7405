"""The Legendre products of an expansion of given order."""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symmb._options import dimensions, require_between
from symmb.bound.polynomials.legendre import Index, MultiIndices, tensor_degree, total_degree

_BORDER = 1 + 1e-12
"""Largest sum of powers. The powers have rounding errors, and indices on the border belong to the set."""


class Basis(Protocol):
    """A choice of multi-indices."""

    def indices(self, d: int, order: int) -> MultiIndices:
        """Multi-indices (n_b, d) of d parameters, the constant first."""
        ...


@dataclass(frozen=True)
class TotalDegree:
    """Products with total degree up to the order, eq. (21), as in the paper.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.TotalDegree().indices(2, 2).tolist()
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
    """

    def indices(self, d: int, order: int) -> MultiIndices:
        """Multi-indices (n_b, d) of products with total degree up to the order, the constant first."""
        d, _, order = dimensions(self, d, order=order)
        return total_degree(d, order)

    def size(self, d: int, order: int) -> int:
        """Number of products."""
        return math.comb(d + order, d)


@dataclass(frozen=True)
class TensorDegree:
    """Products with each degree up to the order. A tensor grid has the same number of nodes.

    Examples
    --------
    >>> import symmb as mb
    >>> len(mb.TensorDegree().indices(2, 2))
    9
    """

    def indices(self, d: int, order: int) -> MultiIndices:
        """Multi-indices (n_b, d) with each degree up to the order, the constant first."""
        d, _, order = dimensions(self, d, order=order)
        return tensor_degree(d, order)

    def size(self, d: int, order: int) -> int:
        """Number of products."""
        return (order + 1) ** d


@dataclass(frozen=True)
class HyperbolicCross:
    """Multi-indices with a quasi-norm (sum alpha_i^q)^(1/q) up to the order. Such sets have the full order in single
    parameters, and few products of several parameters.

    Parameters
    ----------
    q : exponent above 0 and up to 1. For 1, the norm is the total degree. Smaller values give fewer products

    Raises
    ------
    DeclarationError
        If q is out of its range.

    Examples
    --------
    >>> import symmb as mb
    >>> len(mb.HyperbolicCross().indices(6, 4)), len(mb.TotalDegree().indices(6, 4))
    (40, 210)

    References
    ----------
    Blatman and Sudret, Journal of Computational Physics 230 (2011), hyperbolic index sets.
    """

    q: float = 0.5

    def __post_init__(self) -> None:
        require_between(self, "q", "(]", 0.0, 1.0)

    def indices(self, d: int, order: int) -> MultiIndices:
        """Multi-indices (n_b, d) with a quasi-norm up to the order, the constant first."""
        d, _, order = dimensions(self, d, order=order)
        parts, found = self._parts(order), dict[Index, float]({(): 0.0})
        for _ in range(d):  # the total degree has too many indices to test each one
            found = {
                (*index, k): total + part
                for index, total in found.items()
                for k, part in enumerate(parts)
                if total + part <= _BORDER
            }
        ordered = sorted(found, key=lambda index: (sum(index), [-k for k in index]))
        return np.array(ordered, dtype=np.intp)

    def size(self, d: int, order: int) -> int:
        """Number of products."""
        parts, counts = self._parts(order), Counter({0.0: 1})
        for _ in range(d):
            found = Counter[float]()
            for total, count in counts.items():
                for part in parts:
                    if total + part <= _BORDER:
                        found[round(total + part, 14)] += count
            counts = found
        return counts.total()

    def _parts(self, order: int) -> list[float]:
        """The part of each degree in the quasi-norm. The largest sum of parts is 1."""
        return [(k / max(order, 1)) ** self.q for k in range(order + 1)]
