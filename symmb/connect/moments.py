"""Means and standard deviations of outputs, which are merged from parts of the samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of the outputs of samples that did not fail, at each time.

    Attributes
    ----------
    n : int                        number of samples
    mean : (n_t, n_y)              0 without samples
    squares : (n_t, n_y)           sums of the squares of the distances from the mean
    """

    n: int
    mean: Array
    squares: Array

    @classmethod
    def of(cls, Y: Array) -> "Moments":
        """The moments of outputs Y (N, n_t, n_y)."""
        mean = Y.sum(axis=0) / max(len(Y), 1)
        return cls(len(Y), mean, np.square(Y - mean).sum(axis=0))

    @property
    def sigma(self) -> Array:
        """Standard deviations (n_t, n_y); 0 without samples."""
        return np.sqrt(self.squares / max(self.n, 1))

    def part(self, outputs: Sequence[int]) -> "Moments":
        """The moments of the outputs with these numbers."""
        return Moments(self.n, self.mean[:, outputs], self.squares[:, outputs])

    def merged(self, other: "Moments") -> "Moments":
        """The moments of both sets of samples, after Chan, Golub and LeVeque (1979)."""
        n, gap = self.n + other.n, other.mean - self.mean
        share = other.n / max(n, 1)
        return Moments(n, self.mean + share * gap, self.squares + other.squares + self.n * share * gap**2)
