"""Which Legendre products an expansion of some order has."""

from dataclasses import dataclass
from typing import Protocol

from symmb.bounds._legendre import MultiIndices, tensor_degree, total_degree


class Basis(Protocol):
    """A choice of multi-indices."""

    def indices(self, d: int, order: int) -> MultiIndices:
        """(n_b, d), the constant first."""
        ...


@dataclass(frozen=True)
class TotalDegree:
    """Degrees that sum to at most the order, eq. (21): the paper's choice.

    Examples
    --------
    >>> TotalDegree().indices(2, 2).tolist()
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
    """

    def indices(self, d: int, order: int) -> MultiIndices:
        """(n_b, d), the constant first."""
        return total_degree(d, order)


@dataclass(frozen=True)
class TensorDegree:
    """Every degree at most the order: as many polynomials as a tensor grid has nodes.

    Examples
    --------
    >>> len(TensorDegree().indices(2, 2))
    9
    """

    def indices(self, d: int, order: int) -> MultiIndices:
        """(n_b, d), the constant first."""
        return tensor_degree(d, order)
