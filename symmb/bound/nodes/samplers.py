"""Points of the unit box: regular, random, low-discrepancy, stratified."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symmb._options import dimensions
from symmb._types import Array


class Sampler(Protocol):
    """A method to distribute n points over [-1, 1]^d."""

    def points(self, n: int, d: int, seed: int) -> Array:
        """(n, d) points."""
        ...


def grid(line: Array, d: int) -> Array:
    """(len(line)**d, d) points. The coordinates are all combinations of the numbers in ``line``."""
    return line[np.indices((len(line),) * d).reshape(d, -1).T]


def corners(d: int) -> Array:
    """(2**d, d) corners of the unit box."""
    return grid(np.array([-1.0, 1.0]), d)


@dataclass(frozen=True)
class Random:
    """Independent uniform points.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Random().points(2, 3, seed=0).shape
    (2, 3)
    """

    def points(self, n: int, d: int, seed: int) -> Array:
        """(n, d) points."""
        d, n, _ = dimensions(self, d, n=n)
        return np.random.default_rng(seed).uniform(-1.0, 1.0, (n, d))


@dataclass(frozen=True)
class Sobol:
    """The first n points of a scrambled Sobol' sequence (Sobol' 1967; Owen 1998).

    Examples
    --------
    >>> import symmb as mb
    >>> mb.MonteCarlo(1024, sampler=mb.Sobol())
    MonteCarlo(1024, sampler=Sobol())
    >>> mb.Sobol().points(2, 4, seed=0).shape
    (2, 4)
    """

    def points(self, n: int, d: int, seed: int) -> Array:
        """(n, d) points."""
        d, n, _ = dimensions(self, d, n=n)
        from scipy.stats import qmc

        sequence = qmc.Sobol(d, rng=np.random.default_rng(seed))
        return 2.0 * sequence.random_base2((n - 1).bit_length())[:n] - 1.0


@dataclass(frozen=True)
class LatinHypercube:
    """One point in each of n slices of every parameter (McKay, Beckman and Conover 1979).

    Examples
    --------
    >>> import symmb as mb
    >>> mb.MonteCarlo(1000, sampler=mb.LatinHypercube())
    MonteCarlo(1000, sampler=LatinHypercube())
    >>> mb.LatinHypercube().points(2, 3, seed=0).shape
    (2, 3)
    """

    def points(self, n: int, d: int, seed: int) -> Array:
        """(n, d) points."""
        d, n, _ = dimensions(self, d, n=n)
        from scipy.stats import qmc

        return 2.0 * qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(n) - 1.0
