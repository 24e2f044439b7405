"""Leja's nodes on [-1, 1]: each has the largest product of distances to those before it."""

from functools import cache

import numpy as np

from symmb._types import Array

HALVINGS = 60
"""Halvings of an interval of at most unit length: more than the binary digits of a number."""


@cache
def symmetric_leja(n: int) -> Array:
    """The first n of the nodes 0, 1, -1, x, -x, ... (n,), read-only.

    Each pair (x, -x) maximises the product of all distances, its own 2x included. The positive node is first. Of equal
    maxima the leftmost is taken.

    Examples
    --------
    >>> symmetric_leja(6).round(4)
    array([ 0.    ,  1.    , -1.    ,  0.6547, -0.6547,  0.8684])

    References
    ----------
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
    """The x > 0 that maximises 2x prod (x - x_j)^2.

    Between two nodes the logarithm of the product is concave. Bisection on its slope finds the only maximum to the last
    digit, which a comparison of values would not.
    """
    ends = np.sort(nodes[nodes >= 0])
    low, high = ends[:-1], ends[1:]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        rises = 0.5 / middle + (1.0 / np.subtract.outer(middle, nodes)).sum(axis=1) > 0
        low, high = np.where(rises, middle, low), np.where(rises, high, middle)
    x = 0.5 * (low + high)
    logarithms = 0.5 * np.log(x) + np.log(np.abs(np.subtract.outer(x, nodes))).sum(axis=1)
    return float(x[logarithms.argmax()])
