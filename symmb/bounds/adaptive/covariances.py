"""Terms of the covariance of a Gaussian process over a box: ridges, functions of all parameters, and sums."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from symmb._types import Array

_MEAN_RATE, _DEVIATION_RATE, _DEVIATION_RIDGE, _DEVIATION_SIZE = float(np.log(0.3)), 1.5, 4.0, 4.0
"""Expected logarithm of rates; standard deviations of these, of components of ridges, of logarithms of sizes."""
_LIMIT_RIDGE, _LIMITS_RATE, _LIMITS_SIZE = 15.0, (1e-3, 10.0), (1e-6, 1e4)


@dataclass(frozen=True, eq=False)
class Term(ABC):
    """A covariance of responses at points of the box.

    Attributes
    ----------
    size : float    variance of the response, a
    """

    size: float

    def with_size(self, size: float) -> Self:
        """With another size."""
        return replace(self, size=size)

    @property
    @abstractmethod
    def vector(self) -> Array:
        """The numbers (k,) that a likely kernel is searched in. The last one is log(a)."""

    @abstractmethod
    def with_vector(self, vector: Array) -> Self:
        """With other numbers."""

    @property
    @abstractmethod
    def limits(self) -> Array:
        """(k, 2) of the vector."""

    @property
    @abstractmethod
    def prior(self) -> tuple[Array, Array]:
        """Expected vector (k,) and its standard deviations (k,)."""

    @abstractmethod
    def values(self, a: Array, b: Array) -> Array:
        """The covariance (N, M) of points (N, d) and (M, d)."""

    @abstractmethod
    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """Gradient (k,) of the sum of symmetric pulls (N, N) times values (N, N), with respect to the vector."""

    @abstractmethod
    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        """Gradients (N, d) of sums over m of pull (N, M) times values (N, M), with respect to points a (N, d)."""


@dataclass(frozen=True, eq=False)
class Ridge(Term):
    """a exp(-(w (x - x'))^2 / 2).

    Attributes
    ----------
    direction : (d,)        w, in units of one over the length over which the response varies
    """

    direction: Array

    @property
    def vector(self) -> Array:
        """w and log(a)."""
        return np.append(self.direction, np.log(self.size))

    def with_vector(self, vector: Array) -> Self:
        """With other numbers."""
        return type(self)(float(np.exp(vector[-1])), vector[:-1])

    @property
    def limits(self) -> Array:
        """Of w and log(a)."""
        return np.array([(-_LIMIT_RIDGE, _LIMIT_RIDGE)] * len(self.direction) + [np.log(_LIMITS_SIZE)])

    @property
    def prior(self) -> tuple[Array, Array]:
        """Of w and log(a)."""
        d = len(self.direction)
        return np.zeros(d + 1), np.array([_DEVIATION_RIDGE] * d + [_DEVIATION_SIZE])

    def values(self, a: Array, b: Array) -> Array:
        """(N, M)."""
        return self.size * np.exp(-0.5 * np.square(self._differences(a, b)))

    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """With respect to w and log(a)."""
        product = pull * values
        direction = -2 * ((product * self._differences(points, points)).sum(axis=1) @ points)
        return np.append(direction, product.sum())

    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        """(N, d)."""
        return -np.outer((pull * self.values(a, b) * self._differences(a, b)).sum(axis=1), self.direction)

    def _differences(self, a: Array, b: Array) -> Array:
        return np.asarray(np.subtract.outer(a @ self.direction, b @ self.direction))


@dataclass(frozen=True, eq=False)
class _OfParameters(Term):
    """A term with a rate of each parameter.

    Attributes
    ----------
    rates : (d,)            l, one over the length over which the response varies
    """

    rates: Array

    @classmethod
    def of(cls, d: int) -> Self:
        """With expected rates."""
        return cls(1.0, np.full(d, np.exp(_MEAN_RATE)))

    @property
    def vector(self) -> Array:
        """log(l) and log(a)."""
        return np.log(np.append(self.rates, self.size))

    def with_vector(self, vector: Array) -> Self:
        """With other numbers."""
        return type(self)(float(np.exp(vector[-1])), np.exp(vector[:-1]))

    @property
    def limits(self) -> Array:
        """Of log(l) and log(a)."""
        return np.log([_LIMITS_RATE] * len(self.rates) + [_LIMITS_SIZE])

    @property
    def prior(self) -> tuple[Array, Array]:
        """Of log(l) and log(a)."""
        d = len(self.rates)
        return np.array([_MEAN_RATE] * d + [0.0]), np.array([_DEVIATION_RATE] * d + [_DEVIATION_SIZE])


class Smooth(_OfParameters):
    """a exp(-|l (x - x')|^2 / 2): smooth functions of all parameters."""

    def values(self, a: Array, b: Array) -> Array:
        """(N, M)."""
        p, q = a * self.rates, b * self.rates
        squares = np.square(p).sum(axis=1)[:, None] + np.square(q).sum(axis=1) - 2 * p @ q.T
        return self.size * np.exp(-0.5 * np.maximum(squares, 0.0))

    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """With respect to log(l) and log(a)."""
        own = pull * values
        rates = own.sum(axis=1) @ np.square(points) - (points * (own @ points)).sum(axis=0)
        return np.append(-2 * np.square(self.rates) * rates, own.sum())

    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        """(N, d)."""
        own = pull * self.values(a, b)
        return -np.square(self.rates) * (own.sum(axis=1)[:, None] * a - own @ b)


class Sum(_OfParameters):
    """a / d sum_i (1 + |z_i|) exp(-|z_i|), z_i = l_i (x_i - x_i'): sums of functions of one parameter, even with kinks.

    Each is a Matern covariance of order 3/2.

    References
    ----------
    Duvenaud, Nickisch and Rasmussen, Additive Gaussian Processes (2011).
    """

    def values(self, a: Array, b: Array) -> Array:
        """(N, M)."""
        total = np.zeros((len(a), len(b)))
        for i in range(len(self.rates)):
            z = np.abs(self._differences(a, b, i))
            total += (1 + z) * np.exp(-z)
        return self.size / len(self.rates) * total

    def vector_gradient(self, pull: Array, points: Array, values: Array) -> Array:
        """With respect to log(l) and log(a)."""
        rates = np.empty(len(self.rates))
        for i in range(len(rates)):
            z = np.abs(self._differences(points, points, i))
            rates[i] = -(pull * np.square(z) * np.exp(-z)).sum()
        return np.append(self.size / len(rates) * rates, (pull * values).sum())

    def slope(self, pull: Array, a: Array, b: Array) -> Array:
        """(N, d)."""
        slopes = np.empty(a.shape)
        for i, rate in enumerate(self.rates):
            z = self._differences(a, b, i)
            slopes[:, i] = -rate * (pull * z * np.exp(-np.abs(z))).sum(axis=1)
        return self.size / len(self.rates) * slopes

    def _differences(self, a: Array, b: Array, i: int) -> Array:
        return np.asarray(np.subtract.outer(a[:, i] * self.rates[i], b[:, i] * self.rates[i]))
