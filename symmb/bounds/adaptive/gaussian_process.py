"""A Gaussian process of responses that vary in few directions most: the most likely response given some runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.covariances import Ridge, Smooth, Sum, Term

_ROUNDING = 1e-10
"""Least variance of the noise, over that of the responses."""
_MEAN_NOISE, _DEVIATION_NOISE, _LIMITS_NOISE = float(np.log(1e-6)), 4.0, (_ROUNDING, 1.0)
"""Expected logarithm of the variance of the noise, its standard deviation, and limits of the variance."""
_LIKELY = 1e-5
"""Share of the logarithm of a likelihood, some hundreds, to which its maximum is found: a third of the steps."""
_ITERATIONS, _SEARCH_ITERATIONS = 60, 60
"""Most steps to a likely kernel, whose directions turn slowly, and to an extreme."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """Covariance of responses: that of smooth functions, further terms, and noise.

    Attributes
    ----------
    smooth : Smooth
    further : Sequence[Term]
    noise : variance of the noise
    """

    smooth: Smooth
    further: Sequence[Term]
    noise: float

    @classmethod
    def of(cls, d: int) -> "Kernel":
        """One without further terms, to start from."""
        return cls(Smooth.of(d), (), 1e-4)

    def with_term(self, term: Term) -> "Kernel":
        """With one more term, which takes most of what the others leave."""
        size = self.smooth.size
        return Kernel(self.smooth.with_size(0.1 * size), (*self.further, term.with_size(size)), self.noise)

    def with_vector(self, vector: Array) -> "Kernel":
        """With other numbers."""
        ends = np.cumsum([len(term.vector) for term in self.terms])
        *own, noise = np.split(vector, ends)
        smooth, *further = (term.with_vector(part) for term, part in zip(self.terms, own, strict=True))
        assert isinstance(smooth, Smooth)
        return Kernel(smooth, further, float(np.exp(noise[0])))

    @property
    def terms(self) -> Sequence[Term]:
        """All of them, the smooth one first."""
        return (self.smooth, *self.further)

    @property
    def ridges(self) -> Sequence[Ridge]:
        """The terms that are ridges."""
        return [term for term in self.further if isinstance(term, Ridge)]

    @property
    def is_sum(self) -> bool:
        """Whether a term is a sum of functions of one parameter."""
        return any(isinstance(term, Sum) for term in self.further)

    @property
    def vector(self) -> Array:
        """The vectors of the terms, and the logarithm of the noise."""
        return np.concatenate([*(term.vector for term in self.terms), [np.log(self.noise)]])

    @property
    def size(self) -> float:
        """Variance of the responses without noise."""
        return sum(term.size for term in self.terms)

    def values(self, a: Array, b: Array) -> Array:
        """The covariance (N, M) of points (N, d) and (M, d), without noise."""
        return np.asarray(np.sum([term.values(a, b) for term in self.terms], axis=0))

    def unlikeliness(self, points: Array, Y: Array) -> tuple[float, Array]:
        """Negative logarithm of the likelihood of responses Y (N, m) at points (N, d), and its gradient.

        A weak prior keeps numbers that do not matter in place.
        """
        from scipy.linalg import cholesky, solve_triangular

        N, m = Y.shape
        values = [term.values(points, points) for term in self.terms]
        try:
            root = cholesky(np.sum(values, axis=0) + (self.noise + _ROUNDING) * np.eye(N), lower=True)
        except np.linalg.LinAlgError:
            return 1e10, np.zeros(len(self.vector))
        inverse_root = solve_triangular(root, np.eye(N), lower=True)
        inverse = inverse_root.T @ inverse_root
        weights = inverse @ Y
        value = 0.5 * float((Y * weights).sum()) + m * float(np.log(np.diag(root)).sum())
        pull = 0.5 * (m * inverse - weights @ weights.T)
        each = zip(self.terms, values, strict=True)
        gradient = [*(term.vector_gradient(pull, points, part) for term, part in each), [self.noise * np.trace(pull)]]
        mean, deviation = (np.concatenate(parts) for parts in zip(*self._priors, strict=True))
        distance = (self.vector - mean) / deviation
        return value + 0.5 * float(distance @ distance), np.concatenate(gradient) + distance / deviation

    @property
    def _priors(self) -> list[tuple[Array, Array]]:
        noise = np.array([_MEAN_NOISE]), np.array([_DEVIATION_NOISE])
        return [*(term.prior for term in self.terms), noise]

    def most_likely(self, points: Array, Y: Array) -> tuple["Kernel", float]:
        """The most likely kernel near this one, and its `unlikeliness`."""
        from scipy.optimize import minimize

        limits = np.concatenate([*(term.limits for term in self.terms), np.log([_LIMITS_NOISE])])
        result = minimize(
            lambda vector: self.with_vector(vector).unlikeliness(points, Y),
            np.clip(self.vector, *limits.T),
            jac=True,
            method="L-BFGS-B",
            bounds=limits,
            options={"maxiter": _ITERATIONS, "ftol": _LIKELY},
        )
        return self.with_vector(result.x), float(result.fun)


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """Mean and standard deviation of responses given some runs, relative to the responses' own mean and deviation.

    Attributes
    ----------
    kernel : Kernel
    points : (N, d)
    Y : (N, m)

    References
    ----------
    Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), sections 2.2 and 5.4.
    Vivarelli and Williams (1998): covariances of linear combinations of the parameters.
    """

    kernel: Kernel
    points: Array
    Y: Array

    @cached_property
    def _inverse_root(self) -> Array:
        """(N, N) inverse of the Cholesky factor of the covariance of the runs."""
        from scipy.linalg import cholesky, solve_triangular

        noise = (self.kernel.noise + _ROUNDING) * np.eye(len(self.points))
        root = cholesky(self.kernel.values(self.points, self.points) + noise, lower=True)
        return np.asarray(solve_triangular(root, np.eye(len(root)), lower=True))

    @cached_property
    def _weights(self) -> Array:
        return self._inverse_root.T @ (self._inverse_root @ self.Y)

    def left_out_errors(self) -> Array:
        """Errors (N, m) of the mean at each run if that run is left out (Rasmussen and Williams, section 5.4.2)."""
        return self._weights / np.square(self._inverse_root).sum(axis=0)[:, None]

    def left_out_deviations(self) -> Array:
        """The largest of these errors (N,) over their standard deviations."""
        return np.abs(self.left_out_errors()).max(axis=1) * np.sqrt(np.square(self._inverse_root).sum(axis=0))

    def mean(self, points: Array) -> Array:
        """(M, m)."""
        return self.kernel.values(points, self.points) @ self._weights

    def deviation(self, points: Array) -> Array:
        """Standard deviation (M,) of a response without noise."""
        root = self.kernel.values(points, self.points) @ self._inverse_root.T
        return np.sqrt(np.maximum(self.kernel.size - np.square(root).sum(axis=1), 0.0))

    def rest_direction(self) -> Array:
        """The direction (d,) in which the smooth part of the mean varies most: the first active subspace.

        References
        ----------
        Constantine, Dow and Wang, SIAM Journal on Scientific Computing 36 (2014), A1500-A1524.
        """
        slopes = [self.kernel.smooth.slope(weights, self.points, self.points) for weights in self._weights.T]
        return np.linalg.svd(np.concatenate(slopes), full_matrices=False)[2][0]

    def smallest(self, response: int, sign: float, factor: float, starts: Array) -> tuple[Array, float]:
        """A place (d,) where sign times a response less factor deviations is smallest in the box, and the value there.

        It is the best of local searches from the starts (S, d).
        """
        from scipy.optimize import minimize

        weights, root, kernel = sign * self._weights[:, response], self._inverse_root, self.kernel

        def objective(x: Array) -> tuple[float, Array]:
            covariance = kernel.values(x[None], self.points)[0]
            half = root @ covariance
            deviation = np.sqrt(max(kernel.size - half @ half, 1e-16))
            pull = weights + factor / deviation * (root.T @ half)  # of the covariances on the objective
            gradient = np.sum([term.slope(pull, x[None], self.points)[0] for term in kernel.terms], axis=0)
            return float(weights @ covariance - factor * deviation), gradient

        limits = [(-1.0, 1.0)] * starts.shape[1]
        options = {"maxiter": _SEARCH_ITERATIONS}
        results = [minimize(objective, x, jac=True, method="L-BFGS-B", bounds=limits, options=options) for x in starts]
        best = min(results, key=lambda result: result.fun)
        return np.asarray(best.x), float(best.fun)
