"""Collocation nodes and weights on [-1, 1]^d. The weights contain the density 2^-d, so that their sum is 1."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Protocol

import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import FACTORS
from symmb._options import constructor_text, dimensions, require_kind, require_whole
from symmb._types import Array
from symmb.bound.polynomials import homogeneous

MOST_ORDER = 1000
"""Highest degree of a rule. Nodes of higher degrees take longer than a second to compute."""


class Nodes(Protocol):
    """A rule of nodes and weights for expansions of a given order."""

    projects: ClassVar[bool]
    """True: coefficients by Galerkin projection, eq. (30). False: coefficients by weighted least squares, or by
    interpolation if there are as many nodes as polynomials."""

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes (N, d) and weights (N,)."""
        ...


class Rule(ABC):
    """A rule on [-1, 1] for each degree, and its tensor grids of order + 1 nodes for each parameter."""

    projects: ClassVar[bool] = False

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes ((order + 1)^d, d) and weights."""
        d, _, order = dimensions(self, d, order=order)
        return tensor([self.line(order)] * d)

    def size(self, d: int, order: int) -> int:
        """Number of nodes."""
        return (order + 1) ** d

    @abstractmethod
    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact at least to that degree."""

    @abstractmethod
    def degree(self, level: int) -> int:
        """Degree of a level of a sparse grid. The rule of this degree is exact at least to degree 2 level + 1."""


@dataclass(frozen=True)
class Gauss(Rule):
    """Tensor grid of order + 1 Gauss-Legendre nodes for each parameter, eq. (33): the paper's choice.

    Examples
    --------
    >>> import symmb as mb
    >>> nodes, weights = mb.Gauss().points(1, order=1)
    >>> nodes.ravel().round(4), weights
    (array([-0.5774,  0.5774]), array([0.5, 0.5]))
    """

    projects: ClassVar[bool] = True

    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact to degree 2 degree + 1."""
        nodes, weights = np.polynomial.legendre.leggauss(degree + 1)
        return nodes, 0.5 * weights

    def degree(self, level: int) -> int:
        """One additional node for each level."""
        return level


@dataclass(frozen=True)
class ClenshawCurtis(Rule):
    """Tensor grid of the order + 1 extremes of the Chebyshev polynomial, with faces and corners.

    Most responses have their extremes at faces and corners. An expansion from Gauss nodes extrapolates to faces and
    corners.

    Examples
    --------
    >>> import symmb as mb
    >>> nodes, weights = mb.ClenshawCurtis().points(1, order=2)
    >>> nodes.ravel(), weights.round(4)
    (array([-1.,  0.,  1.]), array([0.1667, 0.6667, 0.1667]))
    """

    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact to that degree. Every second node is a node of degree / 2."""
        return _interpolatory(np.sin(0.5 * np.pi * np.arange(-degree, degree + 1, 2) / max(degree, 1)))

    def degree(self, level: int) -> int:
        """The degree doubles for each level, so that levels are nested."""
        return 0 if level == 0 else 2**level


@dataclass(frozen=True)
class ChebyshevGauss(Rule):
    """Tensor grid of the order + 1 roots of the Chebyshev polynomial T_(order + 1), with the weights of
    Fejér's first rule, all positive.

    Interpolation at these nodes is nearly as accurate as the best approximation by polynomials. The interpolant
    extrapolates to the ends of the intervals.

    Examples
    --------
    >>> import symmb as mb
    >>> nodes, weights = mb.ChebyshevGauss().points(1, order=2)
    >>> nodes.ravel().round(4), weights.round(4)
    (array([-0.866,  0.   ,  0.866]), array([0.2222, 0.5556, 0.2222]))

    References
    ----------
    Waldvogel, BIT Numerical Mathematics 46 (2006), Fejér's rules.
    """

    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact to that degree."""
        return _interpolatory(np.sin(0.5 * np.pi * np.arange(-degree, degree + 1, 2) / (degree + 1)))

    def degree(self, level: int) -> int:
        """Two additional nodes for each level. Three times as many nodes would nest the levels, but take more runs."""
        return 2 * level


@dataclass(frozen=True)
class Leja(Rule):
    """Tensor grid of the first order + 1 Leja nodes 0, 1, -1, x, -x, ... .

    The nodes of an order are nodes of every higher order. Even orders are symmetric. Up to order 20, Lebesgue constants
    are at most 8.9 for even orders, and at most 18.4 for odd orders. Sparse grids use even orders, with two additional
    nodes for each level.

    Examples
    --------
    >>> import symmb as mb
    >>> nodes, weights = mb.Leja().points(1, order=4)
    >>> nodes.ravel().round(4), weights.round(4)
    (array([ 0.    ,  1.    , -1.    ,  0.6547, -0.6547]), array([0.2, 0.2, 0.2, 0.2, 0.2]))

    References
    ----------
    Narayan and Jakeman, SIAM J. Sci. Comput. 36 (2014), sparse grids of Leja sequences.
    """

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes ((order + 1)^d, d) and equal weights."""
        # For odd orders, interpolatory weights are 0 at the last node. A fit would not use this node.
        nodes, weights = super().points(d, order)
        return nodes, np.full_like(weights, 1.0 / len(weights))

    def line(self, degree: int) -> tuple[Array, Array]:
        """degree + 1 nodes and weights, exact to that degree."""
        return _interpolatory(_symmetric_leja(degree + 1))

    def degree(self, level: int) -> int:
        """Two additional nodes for each level: nested and symmetric, and therefore exact to one more degree."""
        return 2 * level


@dataclass(frozen=True, repr=False)
class SparseGrid:
    """Smolyak's sparse grid (section 3.3 and Fig. 3): tensor grids of low total level, combined with signs.

    The grid is exact for total degree 2 level + 1. Weights may be negative. Large weights amplify errors of runs. For 6
    parameters at level 4, the sum of the magnitudes of weights is 681 with Gauss nodes and 34 with Clenshaw-Curtis
    nodes. Leja nodes need the fewest runs. For 2 parameters at level 4, Leja nodes need 33 runs, Gauss nodes 53, and
    Clenshaw-Curtis nodes 65.

    Parameters
    ----------
    rule : Gauss() as in the paper, ClenshawCurtis(), Leja() or ChebyshevGauss()
    level : level of the grid; default: the order of the expansion

    Examples
    --------
    >>> import symmb as mb
    >>> nodes, weights = mb.SparseGrid().points(2, order=2)
    >>> len(nodes), bool(weights.min() < 0)
    (13, True)

    References
    ----------
    Smolyak (1963); Gerstner and Griebel, Numerical Algorithms 18 (1998), combination formula.
    """

    rule: Rule = Gauss()
    level: int | None = None

    projects: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_kind("SparseGrid", "rule", self.rule, "line", "ClenshawCurtis()")
        if self.level is not None:
            require_whole(self, "level", 0)

    def points(self, d: int, order: int) -> tuple[Array, Array]:
        """Nodes (N, d) and weights (N,)."""
        d, _, order = dimensions(self, d, order=order)
        level = self._level(order)
        if self.rule.degree(level) > MOST_ORDER:
            degree = self.rule.degree(level)
            raise PropagationError(f"{self!r}: level {level} needs degree {degree}. Use a degree up to {MOST_ORDER}.")
        lines = [self.rule.line(self.rule.degree(i)) for i in range(level + 1)]
        grids = []
        for total in range(max(0, level - d + 1), level + 1):
            sign = (-1) ** (level - total) * math.comb(d - 1, level - total)
            for levels in homogeneous(d, total):
                nodes, weights = tensor([lines[i] for i in levels])
                grids.append((nodes, sign * weights))
        return _merged(np.concatenate([x for x, _ in grids]), np.concatenate([w for _, w in grids]))

    def size(self, d: int, order: int) -> int:
        """Number of nodes. Common nodes of several tensor grids are counted several times."""
        level = self._level(order)
        line = [self.rule.degree(i) + 1 for i in range(level + 1)]
        totals = [1] + [0] * level  # number of nodes of each total level, for the parameters so far
        for _ in range(d):
            totals = [sum(line[i] * totals[total - i] for i in range(total + 1)) for total in range(level + 1)]
        return sum(totals[max(0, level - d + 1) :])

    def _level(self, order: int) -> int:
        level = order if self.level is None else self.level
        if level > MOST_ORDER:  # a degree is never lower than its level
            raise PropagationError(f"{self!r}: level {level} is too high. Use a level below {MOST_ORDER}.")
        return level

    def __repr__(self) -> str:
        return constructor_text(self)


def _interpolatory(nodes: Array) -> tuple[Array, Array]:
    """Nodes (n,) and the weights that integrate the interpolant through them."""
    means = np.eye(len(nodes))[0]  # means of Legendre polynomials: 0 except for the constant
    weights: Array = np.linalg.solve(np.polynomial.legendre.legvander(nodes, len(nodes) - 1).T, means)
    return nodes, weights


def tensor(lines: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Tensor grid (N, d) and product weights (N,) of one-dimensional rules."""
    nodes = np.stack(np.meshgrid(*(x for x, _ in lines), indexing="ij"), axis=-1).reshape(-1, len(lines))
    weights = np.ones(1)
    for _, w in lines:
        weights = np.multiply.outer(weights, w).ravel()
    return nodes, weights


def _merged(nodes: Array, weights: Array) -> tuple[Array, Array]:
    """Nodes and weights after equal nodes are merged. Nodes with cancelling weights are removed."""
    rounded = nodes.round(12) + 0.0  # 0 is not -0
    _, first, group = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    total: Array = np.bincount(group.ravel(), weights).astype(float)
    nonzero = np.abs(total) > FACTORS
    return nodes[first[nonzero]], total[nonzero]


@cache
def _symmetric_leja(n: int) -> Array:
    """The first n of the nodes 0, 1, -1, x, -x, ... (n,), read-only.

    Each pair (x, -x) maximises the product of all distances, including its distance 2x. The positive node is first. If
    maxima are equal, the leftmost one is taken.

    Bos and Caliari, Dolomites Research Notes on Approximation 8 (2015), Leja sequences of symmetric sets.
    """
    nodes = np.array([0.0, 1.0, -1.0])
    while len(nodes) < n:
        x = _farthest(nodes)
        nodes = np.append(nodes, [x, -x])
    nodes = nodes[:n]
    nodes.flags.writeable = False
    return nodes


def _farthest(nodes: Array) -> float:
    """The x > 0 that maximises 2x prod (x - x_j)^2."""
    # Between two nodes the logarithm of the product is concave. Bisection on its slope finds the only maximum to the
    # last digit. Values near a maximum differ by less than rounding. A number has fewer than 60 binary digits.
    ends = np.sort(nodes[nodes >= 0])
    low, high = ends[:-1], ends[1:]
    for _ in range(60):
        middle = 0.5 * (low + high)
        rises = 0.5 / middle + (1.0 / np.subtract.outer(middle, nodes)).sum(axis=1) > 0
        low, high = np.where(rises, middle, low), np.where(rises, high, middle)
    x = 0.5 * (low + high)
    logarithms = 0.5 * np.log(x) + np.log(np.abs(np.subtract.outer(x, nodes))).sum(axis=1)
    return float(x[logarithms.argmax()])
