"""A Gaussian process of responses that vary in few directions most: the most likely response given some runs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._types import Array

_ROUNDING = 1e-10
"""Least variance of the noise, over that of the responses."""
_MEAN_RATE, _DEVIATION_RATE, _DEVIATION_RIDGE, _DEVIATION_SIZE = np.log(0.3), 1.5, 4.0, 4.0
"""Expected logarithm of rates; standard deviations of these, of components of ridges, of logarithms of sizes."""
_LIMIT_RIDGE, _LIMITS_RATE, _LIMITS_SIZE, _LIMITS_NOISE = 15.0, (1e-3, 10.0), (1e-6, 1e4), (_ROUNDING, 1.0)
_ITERATIONS, _SEARCH_ITERATIONS = 60, 60
"""Most steps to a likely kernel, whose directions turn slowly, and to an extreme."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """Covariance sum_k a_k exp(-(w_k (x - x'))^2 / 2) + a exp(-|l (x - x')|^2 / 2), and that of the noise.

    Attributes
    ----------
    ridges : (K, d)         directions w_k, in units of the length over which the response varies
    rates : (d,)            l, the same for single parameters
    sizes : (K + 1,)        a_k, then a
    noise : variance of the noise
    """

    ridges: Array
    rates: Array
    sizes: Array
    noise: float

    @classmethod
    def of(cls, d: int) -> "Kernel":
        """One without ridges, to start from."""
        return cls(np.empty((0, d)), np.full(d, np.exp(_MEAN_RATE)), np.ones(1), 1e-4)

    def with_ridge(self, ridge: Array) -> "Kernel":
        """With one more ridge (d,), which takes most of what the others leave."""
        sizes = np.append(self.sizes, 0.1 * self.sizes[-1])
        return Kernel(np.concatenate([self.ridges, ridge[None]]), self.rates, sizes, self.noise)

    @classmethod
    def of_vector(cls, vector: Array, n: int) -> "Kernel":
        """The inverse of `vector`, with n ridges."""
        d = (len(vector) - n - 2) // (n + 1)
        logs = np.exp(vector[n * d :])
        return cls(vector[: n * d].reshape(n, d), logs[:d], logs[d:-1], float(logs[-1]))

    @property
    def vector(self) -> Array:
        """Ridges, and logarithms of the other numbers."""
        return np.concatenate([self.ridges.ravel(), np.log(self.rates), np.log(self.sizes), [np.log(self.noise)]])

    @property
    def limits(self) -> Array:
        """(n, 2) of the vector."""
        n, d = self.ridges.shape
        logs = [_LIMITS_RATE] * d + [_LIMITS_SIZE] * (n + 1) + [_LIMITS_NOISE]
        return np.concatenate([np.tile([-_LIMIT_RIDGE, _LIMIT_RIDGE], (n * d, 1)), np.log(logs)])

    def parts(self, a: Array, b: Array) -> tuple[list[Array], list[Array]]:
        """Terms of the covariance, K + 1 times (N, M), of points (N, d) and (M, d), and w_k (x - x'), K times."""
        differences = [np.subtract.outer(a @ w, b @ w) for w in self.ridges]
        parts = [size * np.exp(-0.5 * z * z) for size, z in zip(self.sizes[:-1], differences, strict=True)]
        p, q = a * self.rates, b * self.rates
        squares = np.square(p).sum(axis=1)[:, None] + np.square(q).sum(axis=1) - 2 * p @ q.T
        return [*parts, self.sizes[-1] * np.exp(-0.5 * np.maximum(squares, 0.0))], differences

    def unlikeliness(self, points: Array, Y: Array) -> tuple[float, Array]:
        """Negative logarithm of the likelihood of responses Y (N, m) at points (N, d), and its gradient.

        A weak prior keeps numbers that do not matter in place.
        """
        from scipy.linalg import cholesky, solve_triangular

        (n, d), (N, m) = self.ridges.shape, Y.shape
        parts, differences = self.parts(points, points)
        try:
            root = cholesky(np.sum(parts, axis=0) + (self.noise + _ROUNDING) * np.eye(N), lower=True)
        except np.linalg.LinAlgError:
            return 1e10, np.zeros(len(self.vector))
        inverse_root = solve_triangular(root, np.eye(N), lower=True)
        inverse = inverse_root.T @ inverse_root
        weights = inverse @ Y
        value = 0.5 * float((Y * weights).sum()) + m * float(np.log(np.diag(root)).sum())
        A = m * inverse - weights @ weights.T
        products = [A * part for part in parts]
        ridges = [-((p * z).sum(axis=1) @ points) for p, z in zip(products[:-1], differences, strict=True)]
        own = products[-1]
        rates = -np.square(self.rates) * (own.sum(axis=1) @ np.square(points) - (points * (own @ points)).sum(axis=0))
        sizes = [0.5 * p.sum() for p in products]
        gradient = np.concatenate([*ridges, rates, sizes, [0.5 * self.noise * np.trace(A)]])
        mean = np.concatenate([np.zeros(n * d), np.full(d, _MEAN_RATE), np.zeros(n + 1), [np.log(1e-6)]])
        deviation = np.concatenate(
            [np.full(n * d, _DEVIATION_RIDGE), np.full(d, _DEVIATION_RATE), np.full(n + 2, _DEVIATION_SIZE)]
        )
        distance = (self.vector - mean) / deviation
        return value + 0.5 * float(distance @ distance), gradient + distance / deviation

    def most_likely(self, points: Array, Y: Array) -> tuple["Kernel", float]:
        """The most likely kernel near this one, and its `unlikeliness`."""
        from scipy.optimize import minimize

        n = len(self.ridges)
        limits = self.limits
        result = minimize(
            lambda vector: Kernel.of_vector(vector, n).unlikeliness(points, Y),
            np.clip(self.vector, *limits.T),
            jac=True,
            method="L-BFGS-B",
            bounds=limits,
            options={"maxiter": _ITERATIONS},
        )
        return Kernel.of_vector(result.x, n), float(result.fun)


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
        root = cholesky(np.sum(self.kernel.parts(self.points, self.points)[0], axis=0) + noise, lower=True)
        return np.asarray(solve_triangular(root, np.eye(len(root)), lower=True))

    @cached_property
    def _weights(self) -> Array:
        return self._inverse_root.T @ (self._inverse_root @ self.Y)

    def left_out_errors(self) -> Array:
        """Errors (N, m) of the mean at each run if that run is left out (Rasmussen and Williams, section 5.4.2)."""
        return self._weights / np.square(self._inverse_root).sum(axis=0)[:, None]

    def mean(self, points: Array) -> Array:
        """(M, m)."""
        return np.sum(self.kernel.parts(points, self.points)[0], axis=0) @ self._weights

    def deviation(self, points: Array) -> Array:
        """Standard deviation (M,) of a response without noise."""
        root = np.sum(self.kernel.parts(points, self.points)[0], axis=0) @ self._inverse_root.T
        return np.sqrt(np.maximum(self.kernel.sizes.sum() - np.square(root).sum(axis=1), 0.0))

    def rest_direction(self) -> Array:
        """The direction (d,) in which that part of the mean varies most that is no ridge: the first active subspace.

        References
        ----------
        Constantine, Dow and Wang, SIAM Journal on Scientific Computing 36 (2014), A1500-A1524.
        """
        covariance = self.kernel.parts(self.points, self.points)[0][-1]
        weights = covariance[:, :, None] * self._weights  # (N, N, m)
        gradients = (
            np.einsum("abj,bi->aji", weights, self.points) - weights.sum(axis=1)[..., None] * self.points[:, None]
        )
        gradients = (gradients * np.square(self.kernel.rates)).reshape(-1, self.points.shape[1])
        return np.linalg.svd(gradients, full_matrices=False)[2][0]

    def smallest(self, response: int, sign: float, factor: float, starts: Array) -> tuple[Array, float]:
        """A place (d,) where sign times a response less factor deviations is smallest in the box, and the value there.

        It is the best of local searches from the starts (S, d).
        """
        from scipy.optimize import minimize

        weights, root, kernel = sign * self._weights[:, response], self._inverse_root, self.kernel

        def objective(x: Array) -> tuple[float, Array]:
            parts, differences = kernel.parts(x[None], self.points)
            covariance = np.sum(parts, axis=0)[0]
            half = root @ covariance
            deviation = np.sqrt(max(kernel.sizes.sum() - half @ half, 1e-16))
            pull = weights + factor / deviation * (root.T @ half)  # of the covariances on the objective
            gradient = -np.square(kernel.rates) * ((own := pull * parts[-1][0]).sum() * x - own @ self.points)
            for part, z, w in zip(parts[:-1], differences, kernel.ridges, strict=True):
                gradient = gradient - (pull * part[0]) @ z[0] * w
            return float(weights @ covariance - factor * deviation), gradient

        limits = [(-1.0, 1.0)] * starts.shape[1]
        options = {"maxiter": _SEARCH_ITERATIONS}
        results = [minimize(objective, x, jac=True, method="L-BFGS-B", bounds=limits, options=options) for x in starts]
        best = min(results, key=lambda result: result.fun)
        return np.asarray(best.x), float(best.fun)
