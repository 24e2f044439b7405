"""Collocation nodes and weights on [-1, 1]^d; the weights carry the density 2^-d, so they sum to 1."""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from symmb._types import Array
from symmb.bounds._legendre import homogeneous
from symmb.bounds._method import constructor_text, require_whole


class Nodes(Protocol):
    """A rule of nodes and weights for expansions of a given order."""

    projects: ClassVar[bool]
    """True: coefficients by Galerkin projection, eq. (30). False: by weighted least squares, that is by
    interpolation where there are as many nodes as polynomials."""

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes (N, d) and weights (N,)."""
        ...


@dataclass(frozen=True)
class Gauss:
    """Tensor grid of order + 1 Gauss-Legendre nodes a parameter, eq. (33): the paper's choice.

    Examples
    --------
    >>> nodes, weights = Gauss().points(1, order=1)
    >>> nodes.ravel().round(4), weights
    (array([-0.5774,  0.5774]), array([0.5, 0.5]))
    """

    projects: ClassVar[bool] = True

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes ((order + 1)^d, d) and weights."""
        return tensor([self.line(order)] * d)

    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact to degree 2 degree + 1."""
        nodes, weights = np.polynomial.legendre.leggauss(degree + 1)
        return nodes, 0.5 * weights

    def degree(self, level: int) -> int:
        """Degree of a level of a sparse grid: one node more each level."""
        return level


@dataclass(frozen=True)
class ClenshawCurtis:
    """Tensor grid of the order + 1 extremes of the Chebyshev polynomial: faces and corners are among the
    nodes.

    Responses mostly reach their extremes there, where Gauss nodes leave the expansion to extrapolate.

    Examples
    --------
    >>> nodes, weights = ClenshawCurtis().points(1, order=2)
    >>> nodes.ravel(), weights.round(4)
    (array([-1.,  0.,  1.]), array([0.1667, 0.6667, 0.1667]))
    """

    projects: ClassVar[bool] = False

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes ((order + 1)^d, d) and weights."""
        return tensor([self.line(order)] * d)

    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact to that degree; every second one is a node of degree / 2."""
        if degree == 0:
            return np.zeros(1), np.ones(1)
        nodes = np.sin(0.5 * np.pi * np.arange(-degree, degree + 1, 2) / degree)
        moments = np.eye(degree + 1)[0]
        weights: Array = np.linalg.solve(np.polynomial.legendre.legvander(nodes, degree).T, moments)
        return nodes, weights

    def degree(self, level: int) -> int:
        """Degree of a level of a sparse grid: doubled each level, so that levels are nested."""
        return 0 if level == 0 else 2**level


@dataclass(frozen=True, repr=False)
class SparseGrid:
    """Smolyak's sparse grid (section 3.3 and Fig. 3): tensor grids of low total level, combined with signs.

    Exact for total degree 2 level + 1. Weights may be negative; with Gauss nodes they grow large (the sum of
    magnitudes is 681 for 6 parameters at level 4, 34 with Clenshaw-Curtis), which amplifies integration
    errors.

    Parameters
    ----------
    rule : Gauss() as in the paper, or ClenshawCurtis()
    level : the order of the expansion where left out

    Examples
    --------
    >>> nodes, weights = SparseGrid().points(2, order=2)
    >>> len(nodes), bool(weights.min() < 0)
    (13, True)

    References
    ----------
    Smolyak (1963); Gerstner and Griebel, Numerical Algorithms 18 (1998), combination formula.
    """

    rule: Gauss | ClenshawCurtis = Gauss()
    level: int | None = None

    projects: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.level is not None:
            require_whole("SparseGrid", "level", self.level, 0)

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes (N, d) and weights (N,)."""
        level = order if self.level is None else self.level
        lines = [self.rule.line(self.rule.degree(i)) for i in range(level + 1)]
        grids = []
        for total in range(max(0, level - d + 1), level + 1):
            sign = (-1) ** (level - total) * math.comb(d - 1, level - total)
            for levels in homogeneous(d, total):
                nodes, weights = tensor([lines[i] for i in levels])
                grids.append((nodes, sign * weights))
        return _merged(np.concatenate([x for x, _ in grids]), np.concatenate([w for _, w in grids]))

    def __repr__(self) -> str:
        return constructor_text(self)


def tensor(lines: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Tensor grid (N, d) and product weights (N,) of one-dimensional rules."""
    nodes = np.stack(np.meshgrid(*(x for x, _ in lines), indexing="ij"), axis=-1).reshape(-1, len(lines))
    weights = np.ones(1)
    for _, w in lines:
        weights = np.multiply.outer(weights, w).ravel()
    return nodes, weights


def node_keys(nodes: Array) -> Array:
    """Nodes rounded, so that equal nodes compare equal; adding 0 turns -0 into 0."""
    return nodes.round(12) + 0.0


def _merged(nodes: Array, weights: Array) -> tuple[Array, Array]:
    """Equal nodes made one; those whose weights cancel left out."""
    _, first, group = np.unique(node_keys(nodes), axis=0, return_index=True, return_inverse=True)
    total: Array = np.bincount(group.ravel(), weights).astype(float)
    kept = np.abs(total) > 1e-14
    return nodes[first[kept]], total[kept]
