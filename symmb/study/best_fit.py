"""The best fit of several starts, and the combinations of parameters that it determines."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from symmb._errors import SimulationError
from symmb._types import Array
from symmb.study.measurements import OWNER
from symmb.study.residuals import (
    MAX_RUNS,
    UNDETERMINED,
    UNDETERMINED_BY_DIFFERENCES,
    Residuals,
    cost_of,
    least_squares,
    other_minima,
    residual_doubts,
)


class Minimum(NamedTuple):
    """The result of one fit.

    `u` (n_p,) are relative parameters. `noise` (n_y,) is the noise of the outputs. Rows of `directions` are orthonormal
    combinations of relative parameters. `sizes` are their sensitivities; 0 if the data do not determine a combination.
    """

    u: Array
    noise: Array
    sizes: Array
    directions: Array


def best_fit(fit: Residuals, known_noise: Mapping[str, float]) -> tuple[Minimum, tuple[str, ...]]:
    """The best fit and its warnings. More fits follow if the fit from the nominal parameters fails or has warnings."""
    nominal = fit.p[fit.columns] / fit.sizes
    if not np.isfinite(fit(nominal)[0]).all():
        raise SimulationError(f"{OWNER}: the run with the nominal parameters fails. Call simulate(scene) to see why.")
    known_noise = {output: max(size, fit.least_noise[output]) for output, size in known_noise.items()}
    best, doubts, cost = None, (), np.inf
    for k, begin in enumerate(itertools.chain([nominal], other_minima(fit, nominal))):
        found = _minimum(fit, nominal, begin, known_noise)
        if found is not None and (own := cost_of(fit, found.u, found.noise)) < cost:
            best, cost = found, own
            degrees = len(fit.data) + len(fit.priors) - int((found.sizes > 0).sum())
            doubts = residual_doubts(fit, found.u, known_noise, degrees)
        if k == 0 and best is not None and not doubts:
            break
    if best is None:
        raise SimulationError(f"{OWNER}: the fit has not ended after {MAX_RUNS} runs. Give better nominal values.")
    return best, doubts


def _minimum(fit: Residuals, nominal: Array, begin: Array, known_noise: Mapping[str, float]) -> Minimum | None:
    """The fit that starts at parameters `begin`; None if it does not end. Undetermined combinations stay nominal."""
    basis, first = np.eye(len(begin)), None
    for _ in range(2):
        solution = least_squares(fit, begin, basis, known_noise)
        if solution is None:
            return None
        u, noise = solution
        if (u < fit.limits[0]).any() or (u > fit.limits[1]).any():  # the nominal combinations are beyond a limit
            return first
        sizes, directions = _sensitivities(fit, u, noise)
        first = Minimum(u, noise, sizes, directions)
        if (sizes > 0).all():
            break
        basis = directions[sizes > 0]  # changes of the fit in the other directions are arbitrary
        begin = nominal + (begin - nominal) @ basis.T @ basis
    return first


def _sensitivities(fit: Residuals, u: Array, noise: Array) -> tuple[Array, Array]:
    """Sensitivities (n_p,) of orthonormal combinations (n_p, n_p) of parameters; 0 if a combination is undetermined."""
    deviations = np.repeat(noise, fit.counts)[:, None] * (fit.widening(u, noise) if fit.is_robust else 1.0)
    _, sizes, directions = np.linalg.svd(fit(u)[1] / deviations, full_matrices=False)
    least = UNDETERMINED
    if fit.has_kinks and sizes.min() <= (least := UNDETERMINED_BY_DIFFERENCES) * sizes.max():
        slopes, errors = fit.extrapolated(u)
        if np.isfinite(slopes).all():
            _, sizes, directions = np.linalg.svd(slopes / deviations, full_matrices=False)
            # A determined combination changes the outputs by several times the error of its derivatives.
            error = 10 * np.linalg.norm(errors / deviations) / (sizes.max() or 1.0)
            least = float(np.clip(error, UNDETERMINED, UNDETERMINED_BY_DIFFERENCES))
    is_known = sizes > least * sizes.max()
    prior = fit.prior(u)[1]  # a parameter with a prior is determined, even if the data are much more precise
    units = np.concatenate([directions[is_known], prior / np.linalg.norm(prior, axis=1, keepdims=True)])
    _, shares, basis = np.linalg.svd(units)
    rank = int((shares > UNDETERMINED).sum())
    rows = np.concatenate([sizes[is_known, None] * directions[is_known], prior])
    _, sizes, directions = np.linalg.svd(rows @ basis[:rank].T, full_matrices=False)
    return np.append(sizes, np.zeros(len(u) - rank)), np.concatenate([directions @ basis[:rank], basis[rank:]])
