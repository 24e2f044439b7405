"""Terms of the covariance of a Gaussian process over a box: ridges, functions of all parameters, and sums."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from symmb._types import Array

DEVIATION = 4.0
"""Prior standard deviation of the components of ridges, and of log(a). It limits values that runs do not determine."""
MEAN_RATE, DEVIATION_RATE = float(np.log(0.3)), 1.5
"""Prior mean and standard deviation of log(w) of other terms. A larger deviation requires more runs."""


@dataclass(frozen=True, eq=False)
class Term(ABC):
    """A covariance of responses at points of the box.

    Attributes
    ----------
    size : float    variance of the response, a
    rates : (d,)    w, the inverse of the length over which the response varies, for each parameter
    """

    size: float
    rates: Array

    @property
    def vector(self) -> Array:
        """The variables (d + 1,) of the search for a likely kernel: log(w) and log(a)."""
        return np.log(np.append(self.rates, self.size))

    def with_vector(self, vector: Array) -> Self:
        """The term with another vector."""
        return replace(self, size=float(np.exp(vector[-1])), rates=np.exp(vector[:-1]))

    @property
    def prior(self) -> Array:
        """Expected vector and its standard deviations (2, d + 1)."""
        return np.array([(MEAN_RATE, DEVIATION_RATE)] * len(self.rates) + [(0.0, DEVIATION)]).T

    @abstractmethod
    def values(self, a: Array, b: Array) -> Array:
        """The covariance (N, M) of points (N, d) and (M, d)."""

    @abstractmethod
    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """Gradient (d + 1,) of sum(pull * values) with respect to the vector; pull (N, N) is symmetric."""

    @abstractmethod
    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        """Gradients (N, d) of sum(pull * values, axis=1) with respect to the points a (N, d); pull is (N, M)."""


class Ridge(Term):
    """a exp(-(w (x - x'))^2 / 2): functions of one direction w. The components of w may have any sign."""

    @property
    def vector(self) -> Array:
        """The variables (d + 1,) of the search: w and log(a). The sign of w matters, so log(w) is not used."""
        return np.append(self.rates, np.log(self.size))

    def with_vector(self, vector: Array) -> Self:
        return replace(self, size=float(np.exp(vector[-1])), rates=vector[:-1])

    @property
    def prior(self) -> Array:
        """Expected w and log(a), all 0, and their standard deviations (2, d + 1)."""
        return np.array([(0.0, DEVIATION)] * (len(self.rates) + 1)).T

    def values(self, a: Array, b: Array) -> Array:
        return self.size * np.exp(-0.5 * np.square(self._differences(a, b)))

    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """Gradient (d + 1,) of sum(pull * values) with respect to w and log(a)."""
        product = pull * values
        rates = -2 * ((product * self._differences(points, points)).sum(axis=1) @ points)
        return np.append(rates, product.sum())

    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        return -np.outer((pull * self.values(a, b) * self._differences(a, b)).sum(axis=1), self.rates)

    def _differences(self, a: Array, b: Array) -> Array:
        return np.asarray(np.subtract.outer(a @ self.rates, b @ self.rates))


class Smooth(Term):
    """a exp(-sum_i (w_i (x_i - x_i'))^2 / 2): smooth functions of all parameters."""

    def values(self, a: Array, b: Array) -> Array:
        p, q = a * self.rates, b * self.rates
        squares = np.square(p).sum(axis=1)[:, None] + np.square(q).sum(axis=1) - 2 * p @ q.T
        return self.size * np.exp(-0.5 * np.maximum(squares, 0.0))

    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """Gradient (d + 1,) of sum(pull * values) with respect to log(w) and log(a)."""
        own = pull * values
        rates = own.sum(axis=1) @ np.square(points) - (points * (own @ points)).sum(axis=0)
        return np.append(-2 * np.square(self.rates) * rates, own.sum())

    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        own = pull * self.values(a, b)
        return -np.square(self.rates) * (own.sum(axis=1)[:, None] * a - own @ b)


class Sum(Term):
    """a / d sum_i (1 + |z_i|) exp(-|z_i|), z_i = w_i (x_i - x_i'): sums of functions of one parameter, also with kinks.

    Each term of the sum is a Matern covariance of order 3/2. (Duvenaud, Nickisch and Rasmussen, Additive Gaussian
    Processes, 2011)
    """

    def values(self, a: Array, b: Array) -> Array:
        z = (np.abs(each) for each in self._differences(a, b))
        return self.size / len(self.rates) * sum(((1 + part) * np.exp(-part) for part in z), np.zeros((1, 1)))

    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """Gradient (d + 1,) of sum(pull * values) with respect to log(w) and log(a)."""
        differences = self._differences(points, points)
        slopes = np.array([-(pull * np.square(z) * np.exp(-np.abs(z))).sum() for z in differences])
        return np.append(self.size / len(self.rates) * slopes, (pull * values).sum())

    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        parts = [(pull * z * np.exp(-np.abs(z))).sum(axis=1) for z in self._differences(a, b)]
        return -self.size / len(self.rates) * self.rates * np.stack(parts, axis=1)

    def _differences(self, a: Array, b: Array) -> list[Array]:
        return [
            np.asarray(np.subtract.outer(p, q)) for p, q in zip((a * self.rates).T, (b * self.rates).T, strict=True)
        ]
