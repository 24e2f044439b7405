"""A Gaussian process of responses that vary mainly in few directions: the most likely response for given runs."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from symmb._types import Array
from symmb._work import count_work
from symmb.bound.searches.covariances import DEVIATION, MEAN_RATE, Ridge, Smooth, Sum, Term

EXPECTED_NOISE, _LEAST_NOISE = 1e-6, 1e-10
"""Expected and smallest variance of noise divided by the variance of responses. Noise keeps covariance matrices
regular. With more noise, the process is smoother."""
_FARTHEST_DEVIATIONS = 3.0
"""Largest distance of the variables of a kernel from their prior mean, in standard deviations. Larger distances cause
overflow. Smaller distances exclude some responses."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """Covariance of responses: a sum of terms, and noise. The first term is for smooth functions.

    Attributes
    ----------
    terms : tuple[Term, ...]
    noise : variance of the noise
    """

    terms: tuple[Term, ...]
    noise: float

    @classmethod
    def of(cls, d: int) -> "Kernel":
        """A kernel with the first term only."""
        return cls((Smooth(1.0, np.full(d, np.exp(MEAN_RATE))),), 1e-4)

    def with_term(self, term: Term) -> "Kernel":
        """The kernel with one more term, which gets most of the variance of the smooth term."""
        smooth, *further = self.terms
        return replace(self, terms=(replace(smooth, size=0.1 * smooth.size), *further, replace(term, size=smooth.size)))

    def with_vector(self, vector: Array) -> "Kernel":
        """The kernel with another vector."""
        *own, noise = np.split(vector, np.cumsum([len(term.vector) for term in self.terms]))
        terms = (term.with_vector(part) for term, part in zip(self.terms, own, strict=True))
        return Kernel(tuple(terms), float(np.exp(noise[0])))

    @property
    def n_ridges(self) -> int:
        """Number of terms that are ridges."""
        return sum(isinstance(term, Ridge) for term in self.terms)

    @property
    def is_sum(self) -> bool:
        """Whether a term is a sum of functions of one parameter."""
        return any(isinstance(term, Sum) for term in self.terms)

    @property
    def n_functions(self) -> int:
        """Number of functions of distances that a covariance takes."""
        return sum(len(term.rates) if isinstance(term, Sum) else 1 for term in self.terms)

    @property
    def vector(self) -> Array:
        """The vectors of the terms, and the logarithm of the noise."""
        return np.concatenate([*(term.vector for term in self.terms), [np.log(self.noise)]])

    @property
    def prior(self) -> Array:
        """Expected vector and its standard deviations, an array (2, n)."""
        of_noise = [[np.log(EXPECTED_NOISE)], [DEVIATION]]
        return np.concatenate([*(term.prior for term in self.terms), of_noise], axis=1)

    @property
    def size(self) -> float:
        """Variance of the responses without noise."""
        return sum(term.size for term in self.terms)

    def values(self, a: Array, b: Array) -> Array:
        """The covariance (N, M) of points (N, d) and (M, d), without noise."""
        return np.asarray(np.sum([term.values(a, b) for term in self.terms], axis=0))


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """Mean and standard deviation of responses for given runs, in units of the mean and deviation of these runs.

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
    def _covariances(self) -> list[Array]:
        """Covariance matrices (N, N) of the runs, one for each term of the kernel."""
        return [term.values(self.points, self.points) for term in self.kernel.terms]

    @cached_property
    def _inverse_root(self) -> Array:
        """Inverse (N, N) of the Cholesky factor of the covariance of the runs."""
        from scipy.linalg import cholesky, solve_triangular

        covariance, unit = np.sum(self._covariances, axis=0), np.eye(len(self.points))
        noise = self.kernel.noise + _LEAST_NOISE
        while True:
            try:
                root = cholesky(covariance + noise * unit, lower=True)
            except np.linalg.LinAlgError:  # rounding, because points are near each other
                noise *= 100
            else:
                return np.asarray(solve_triangular(root, unit, lower=True))

    @cached_property
    def _weights(self) -> Array:
        return self._inverse_root.T @ (self._inverse_root @ self.Y)

    def unlikeliness(self) -> tuple[float, Array]:
        """Negative log-likelihood of the responses, and its gradient with respect to the vector of the kernel.

        A weak prior determines variables that have no effect on the likelihood.
        """
        kernel, (n, m) = self.kernel, self.Y.shape
        # Time of an evaluation, fitted to 45,000 evaluations for the functions of tests/benchmarks/known_ranges.py.
        count_work(3e5 + 16 * kernel.n_functions * n**2 + 0.15 * n**3)
        mean, deviation = kernel.prior
        root, weights = self._inverse_root, self._weights
        value = 0.5 * float((self.Y * weights).sum()) - m * float(np.log(np.diag(root)).sum())
        pull = 0.5 * (m * root.T @ root - weights @ weights.T)
        each = zip(kernel.terms, self._covariances, strict=True)
        parts = [term.vector_gradient(pull, self.points, values) for term, values in each]
        gradient = np.concatenate([*parts, [kernel.noise * np.trace(pull)]])
        distance = (kernel.vector - mean) / deviation
        return value + 0.5 * float(distance @ distance), gradient + distance / deviation

    def most_likely(self) -> "GaussianProcess":
        """The process with the most likely kernel near the kernel of this process."""
        from scipy.optimize import minimize

        mean, deviation = self.kernel.prior
        limits = np.stack([mean - _FARTHEST_DEVIATIONS * deviation, mean + _FARTHEST_DEVIATIONS * deviation], axis=1)
        limits[-1] = np.log([_LEAST_NOISE, 1.0])  # of the noise
        # Tolerance of the maximum, relative to the log-likelihood of some hundreds. It saves two thirds of the steps.
        result = minimize(
            lambda vector: replace(self, kernel=self.kernel.with_vector(vector)).unlikeliness(),
            np.clip(self.kernel.vector, *limits.T),
            jac=True,
            method="L-BFGS-B",
            bounds=limits,
            options={"maxiter": 60, "ftol": 1e-5},  # directions of ridges change slowly
        )
        return replace(self, kernel=self.kernel.with_vector(result.x))

    def left_out_errors(self) -> Array:
        """Errors (N, m) of the mean at each run if this run is left out (Rasmussen and Williams, section 5.4.2)."""
        return self._weights / np.square(self._inverse_root).sum(axis=0)[:, None]

    def left_out_deviations(self) -> Array:
        """The largest leave-one-out errors (N,), in standard deviations."""
        return np.abs(self.left_out_errors()).max(axis=1) * np.sqrt(np.square(self._inverse_root).sum(axis=0))

    def mean(self, points: Array) -> Array:
        """Mean responses (M, m) at points (M, d)."""
        return self.kernel.values(points, self.points) @ self._weights

    def deviation(self, points: Array) -> Array:
        """Standard deviation (M,) of a response at points (M, d), without noise."""
        root = self.kernel.values(points, self.points) @ self._inverse_root.T
        return np.sqrt(np.maximum(self.kernel.size - np.square(root).sum(axis=1), 0.0))

    def rest_direction(self) -> Array:
        """The direction (d,) in which the smooth part of the mean varies most: the first active subspace.

        Constantine, Dow and Wang, SIAM Journal on Scientific Computing 36 (2014), A1500-A1524.
        """
        slopes = [self.kernel.terms[0].slope(weights, self.points, self.points) for weights in self._weights.T]
        return np.linalg.svd(np.concatenate(slopes), full_matrices=False)[2][0]

    def smallest(self, response: int, sign: float, factor: float, starts: Array) -> tuple[Array, float]:
        """The place (d,) in the box with the smallest sign * mean - factor * deviation of a response, and this value.

        The result is the best of local searches from the starts (S, d).
        """
        from scipy.optimize import minimize

        weights, root, kernel = sign * self._weights[:, response], self._inverse_root, self.kernel

        def objective(x: Array) -> tuple[float, Array]:
            covariance = kernel.values(x[None], self.points)[0]
            half = root @ covariance
            deviation = np.sqrt(max(kernel.size - half @ half, 1e-16))
            pull = weights + factor / deviation * (root.T @ half)  # effect of the covariances on the objective
            gradient = np.sum([term.slope(pull, x[None], self.points)[0] for term in kernel.terms], axis=0)
            return float(weights @ covariance - factor * deviation), gradient

        limits = [(-1.0, 1.0)] * starts.shape[1]
        results = [minimize(objective, x, jac=True, method="L-BFGS-B", bounds=limits) for x in starts]
        count_work(sum(result.nfev for result in results) * (2e5 + 2e4 * kernel.n_functions + len(weights) ** 2))
        best = min(results, key=lambda result: result.fun)
        return np.asarray(best.x), float(best.fun)
