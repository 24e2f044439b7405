"""Small probabilities: a Gaussian process of the margin of an event, importance sampling, and runs near the limit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symmb._threads import one_thread
from symmb._types import Array, Indices, Mask
from symmb.bound.nodes import Sobol
from symmb.bound.polynomials import TotalDegree, basis_values
from symmb.bound.searches import GaussianProcess, Kernel

_CHAINS, _MOVES_OF_A_CHAIN = 3000, 4
"""Number of samples at each level of subset simulation, and number of moves for each sample."""
_FAR_RUNS, _NEAREST, _FARTHEST = 96, 3.0, 7.0
"""Number of runs in all directions, and their distances from the centre in standard deviations."""
_KEPT_OF_A_LEVEL = 0.1
"""Fraction of samples that a level keeps."""
_LEAST_PROBABILITY = 1e-10
"""Smallest probability for which events are searched."""
_CLUSTERS, _COVARIANCE_FACTOR, _SHARE_OF_LAWS = 8, 1.6, 0.05
"""Number of normal distributions from which samples are drawn. Factor on their covariances, because failures have
heavier tails. Fraction of samples from the distributions of the parameters."""
SETS_OF_SAMPLES, _SAMPLES_OF_A_SET = 8, 2048
"""Number of independent sets of samples, and number of samples of a set."""
_POOL_OF_RUNS = 4096
"""Number of samples from which the points of runs are chosen."""
_RUNS_OF_A_ROUND = 48
"""Number of runs in a round that correct the probability, at points where the predicted sign is most likely wrong."""
_RUNS_OVER_FAILURES = 0.25
"""Fraction of the runs of a round that is spread over all failures."""
EXPECTED_IF_NONE = 3.0
"""Expected number of wrong samples if none is observed, at a confidence of 95 %."""
_STANDARD_ERRORS = 3.0
"""The reported error divided by the standard error."""

Normal = Callable[[Array], Array]
"""A function of standard normal numbers (N, n_l)."""


@dataclass(frozen=True, eq=False)
class RareEvent:
    """The probability of an event, its estimated error, and the runs.

    Attributes
    ----------
    probability, error : float
    shares : (n_t,)        fraction of the failures that occur at each time
    failures : int         number of runs from which these fractions follow
    runs : int
    """

    probability: float
    error: float
    shares: Array
    failures: int
    runs: int


def rare_event(points_of: Normal, margins: Normal, known: tuple[Array, Array], aim: float, most: int) -> RareEvent:
    """Probability that the largest margin over time is positive.

    Each round fits a Gaussian process to the margins of all runs. Subset simulation finds failures of the process, and
    samples are drawn around them. Runs are made where the sign of the margin is most uncertain. These runs correct the
    probability, and are used in the next fit. (Echard, Gayton and Lemaire, Structural Safety 33 (2011); Dubourg, Sudret
    and Deheeger, Probabilistic Engineering Mechanics 33 (2013))

    Parameters
    ----------
    points_of : function that gives the points (N, n_l) at which the process is fitted
    margins : function that gives margins (N, n_t) by runs
    known : standard normal numbers (N, n_l) and margins (N, n_t) of runs that were made
    aim : relative error at which to stop
    most : largest number of runs
    """
    rng, n_l = np.random.default_rng(0), known[0].shape[1]
    far = _directions(n_l)
    z, m = np.concatenate([known[0], far]), np.concatenate([known[1], margins(far)]).max(axis=1)
    first = len(z)
    process, rounds, failures = None, list[tuple[float, float]](), list[tuple[Array, Mask]]()
    value, error, n = 0.0, np.inf, 0
    while error > max(aim * value, _LEAST_PROBABILITY) and len(z) - len(known[0]) + _RUNS_OF_A_ROUND <= most:
        with one_thread():
            some = _fitted_runs(m, first)
            process = _Margin.of(points_of(z[some]), m[some], process)
            samples, weights, of_process, scatter = _sampled(process, points_of, z[m > 0], n_l, rng)
            pool = rng.choice(len(samples), _POOL_OF_RUNS, replace=False)
            at, share = points_of(samples[pool]), weights[pool] / _POOL_OF_RUNS
            s = process.mean(at)
            doubt = np.exp(-0.5 * np.square(s / process.deviation(at)))  # uncertainty of the sign
        # The variance of the correction is smallest if the density of runs is the weight times the root of the
        # probability of a wrong sign. Some runs are spread over all failures. They find wrong signs for which the
        # process predicts no error.
        uncertain, failing = _normalized(share * np.sqrt(doubt)), _normalized(share * (s > 0))
        density = _normalized((1 - _RUNS_OVER_FAILURES) * uncertain + _RUNS_OVER_FAILURES * failing)
        chosen = rng.choice(_POOL_OF_RUNS, _RUNS_OF_A_ROUND, p=density)
        Y = margins(samples[pool][chosen])
        fails, each = Y.max(axis=1) > 0, share[chosen] / density[chosen]
        # The process gives most of the probability without runs. Runs only correct its errors, so that few runs
        # suffice.
        wrong = (fails.astype(float) - (s[chosen] > 0)) * each
        unseen = EXPECTED_IF_NONE / _RUNS_OF_A_ROUND * float((share * doubt).sum())
        of_wrong = max(_STANDARD_ERRORS * float(wrong.std(ddof=1)) / np.sqrt(_RUNS_OF_A_ROUND), unseen)
        rounds.append((of_process + float(wrong.mean()), scatter + of_wrong))
        failures.append((each[fails], Y[fails] > 0))
        value, error, n = _mean_of_last(rounds)
        z, m = np.concatenate([z, samples[pool][chosen]]), np.concatenate([m, Y.max(axis=1)])
    weights, failed = (np.concatenate(part) for part in zip(*failures[-n:], strict=True))
    shares = weights @ failed / weights.sum() if len(weights) else np.zeros(known[1].shape[1])
    return RareEvent(max(value, 0.0), error, shares, len(weights), len(z) - len(known[0]))


def _mean_of_last(rounds: list[tuple[float, float]]) -> tuple[float, float, int]:
    """Mean of the probabilities of the last half of the rounds, its error, and the number of rounds.

    All rounds have the same weight. Weights by errors would favor small probabilities, because their errors are small.
    """
    values, errors = np.array(rounds[len(rounds) // 2 :]).T
    error = float(np.sqrt(np.square(errors).sum())) / len(values)
    return float(values.mean()), max(error, _LEAST_PROBABILITY), len(values)


def _directions(n_l: int) -> Array:
    """Standard normal numbers (N, n_l) in all directions, far from the centre. They are near rare failures."""
    from scipy.special import ndtr, ndtri

    normal = ndtri((Sobol().points(_FAR_RUNS, n_l + 1, seed=SETS_OF_SAMPLES) + 1) / 2)
    radius = _NEAREST + (_FARTHEST - _NEAREST) * ndtr(normal[:, :1])
    return radius * normal[:, 1:] / np.linalg.norm(normal[:, 1:], axis=1, keepdims=True)


def _fitted_runs(m: Array, first: int) -> Indices:
    """Numbers of the runs for a fit: the first runs, spread over all failures, and some runs near the limit."""
    # Largest number of runs in a fit, because the time grows with its cube. Runs closest to the limit are preferred.
    near = first + np.argsort(np.abs(m[first:]))[:400]
    return np.concatenate([np.arange(first), near])


def _normalized(density: Array) -> Array:
    total = density.sum()
    return density / total if total > 0 else np.full(len(density), 1 / len(density))


@dataclass(frozen=True, eq=False)
class _Margin:
    """A polynomial of first or second degree, and a Gaussian process of the residuals.

    Attributes
    ----------
    trend : (n_b,)             coefficients of the polynomial
    centre, scale : (n_l,)     of points; the process takes points minus centre, divided by scale
    size : float               unit of the residuals
    of_kernel : int            number of runs in the last fit of the kernel
    factor : float             factor on deviations, from leave-one-out errors
    """

    trend: Array
    process: GaussianProcess
    centre: Array
    scale: Array
    size: float
    of_kernel: int
    factor: float

    @classmethod
    def of(cls, x: Array, m: Array, before: "_Margin | None") -> "_Margin":
        """Fit margins m (N,) at points x (N, n_l)."""
        centre, scale = (x.mean(axis=0), 2 * x.std(axis=0)) if before is None else (before.centre, before.scale)
        scale = np.where(scale > 0, scale, 1.0)
        own = (x - centre) / scale
        alpha = TotalDegree().indices(x.shape[1], 2)
        if 2 * len(alpha) > len(x):
            alpha = TotalDegree().indices(x.shape[1], 1)
        basis = basis_values(alpha, own)
        trend: Array = np.asarray(np.linalg.lstsq(basis, m)[0], dtype=float)
        rest = m - basis @ trend
        size = max(float(rest.std()), 1e-9 * float(np.abs(m).max(initial=0.0)), np.finfo(float).tiny)
        kernel, of_kernel = (Kernel.of(x.shape[1]), 0) if before is None else (before.process.kernel, before.of_kernel)
        process = GaussianProcess(kernel, own, rest[:, None] / size)
        # Growth of the number of runs after which the kernel is fitted again.
        if len(x) > 1.25 * of_kernel:
            process, of_kernel = process.most_likely(), len(x)
        factor = max(1.0, float(np.sqrt(np.square(process.left_out_deviations()).mean())))
        return cls(trend, process, centre, scale, size, of_kernel, factor)

    def mean(self, x: Array) -> Array:
        """Margins (N,) at points."""
        own = (x - self.centre) / self.scale
        alpha = TotalDegree().indices(x.shape[1], 1 if len(self.trend) == x.shape[1] + 1 else 2)
        return basis_values(alpha, own) @ self.trend + self.size * self.process.mean(own)[:, 0]

    def deviation(self, x: Array) -> Array:
        """Errors (N,) of margins at points, from leave-one-out errors."""
        least = np.sqrt(self.process.kernel.noise)
        return self.size * self.factor * np.maximum(self.process.deviation((x - self.centre) / self.scale), least)

    def optimistic(self, x: Array) -> Array:
        """Margins (N,) plus leave-one-out errors, because standard deviations take a hundred times as long."""
        error = float(np.sqrt(np.square(self.process.left_out_errors()).mean()))
        # The search for failures adds this many errors to a margin. With smaller numbers, the search misses regions
        # without runs.
        return self.mean(x) + 1.5 * self.size * error


def _sampled(
    process: _Margin, points_of: Normal, failed: Array, n_l: int, rng: np.random.Generator
) -> tuple[Array, Array, float, float]:
    """Samples (N, n_l), their weights (N,), and the probability of a positive margin with its sampling error."""
    from scipy.special import ndtri

    def margin(z: Array) -> Array:
        return process.optimistic(points_of(z))

    z = _failures(margin, n_l, rng)
    if len(failed):  # keep all regions with failed runs
        near = failed[rng.choice(len(failed), _CHAINS)]
        moved = near, np.maximum(margin(near), 0.0)
        for _ in range(_MOVES_OF_A_CHAIN):
            # Size of moves from failed runs to places with likely failures.
            moved = _moved(margin, 0.0, *moved, 0.3, rng)
        z = np.concatenate([z, moved[0]])
    centres, roots = _clusters(z, rng)
    shares = np.append(_SHARE_OF_LAWS, np.full(len(centres) - 1, (1 - _SHARE_OF_LAWS) / (len(centres) - 1)))
    sets = [Sobol().points(_SAMPLES_OF_A_SET, n_l + 1, seed) for seed in range(SETS_OF_SAMPLES)]
    uniform = (np.concatenate(sets) + 1) / 2
    which = np.searchsorted(np.cumsum(shares)[:-1], uniform[:, 0], side="right")
    normal = ndtri(np.clip(uniform[:, 1:], 1e-15, 1 - 1e-15))
    samples = centres[which] + np.einsum("nij,nj->ni", roots[which], normal)
    squares, density = np.square(samples).sum(axis=1), np.zeros(len(samples))
    # The density of the samples divided by that of the parameters. All constant factors cancel except for determinants.
    for share, centre, root in zip(shares, centres, roots, strict=True):
        inner = np.square(np.linalg.solve(root, (samples - centre).T)).sum(axis=0)
        density += share * np.exp(0.5 * (squares - inner)) / np.prod(np.diag(root))
    weights = 1 / density
    means = np.concatenate([process.mean(points_of(part)) for part in np.array_split(samples, SETS_OF_SAMPLES)])
    sets = (weights * (means > 0)).reshape(SETS_OF_SAMPLES, -1).mean(axis=1)
    return samples, weights, float(sets.mean()), float(_STANDARD_ERRORS * sets.std(ddof=1) / np.sqrt(SETS_OF_SAMPLES))


def _failures(margin: Normal, n_l: int, rng: np.random.Generator) -> Array:
    """Standard normal numbers (N, n_l) with positive margins, or with the largest margins, from subset simulation.

    Au and Beck, Probabilistic Engineering Mechanics 16 (2001); moves by Papaioannou and others, ibid. 41 (2015).
    """
    z = rng.standard_normal((_CHAINS, n_l))
    m, step, probability = margin(z), 0.6, 1.0
    while (level := min(float(np.quantile(m, 1 - _KEPT_OF_A_LEVEL)), 0.0)) < 0 and probability > _LEAST_PROBABILITY:
        z, m = _moved(margin, level, z, m, step, rng)
        probability *= _KEPT_OF_A_LEVEL
        step = max(0.85 * step, 0.2)
    return _moved(margin, level, z, m, step, rng)[0]


def _moved(
    margin: Normal, level: float, z: Array, m: Array, step: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Samples beyond a level, as many as before, after moves that do not change their distribution."""
    start = rng.choice(np.flatnonzero(m >= level), len(z))
    z, m = z[start], m[start]
    for _ in range(_MOVES_OF_A_CHAIN):
        new = np.sqrt(1 - step**2) * z + step * rng.standard_normal(z.shape)
        of_new = margin(new)
        kept = of_new >= level
        z, m = np.where(kept[:, None], new, z), np.where(kept, of_new, m)
    return z, m


def _clusters(z: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres (k, n_l) and roots (k, n_l, n_l) of covariances of normal distributions.

    The first covariance is that of the parameters. The second covariance is that of all samples z (N, n_l), because
    clusters alone have too narrow tails.
    """
    from scipy.cluster.vq import kmeans2

    n_l = z.shape[1]
    _, which = kmeans2(z, min(_CLUSTERS, max(1, len(z) // (20 * n_l))), rng=rng, minit="++")
    groups = [z, *(z[which == k] for k in np.unique(which))]
    groups = [own for own in groups if len(own) > 2 * n_l]
    centres = [np.zeros(n_l), *(own.mean(axis=0) for own in groups)]
    covariances = [_COVARIANCE_FACTOR * np.cov(own.T).reshape(n_l, n_l) + 1e-3 * np.eye(n_l) for own in groups]
    roots: Array = np.array([np.eye(n_l), *map(np.linalg.cholesky, covariances)], dtype=float)
    return np.array(centres), roots
