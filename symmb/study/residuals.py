"""Residuals between runs and data, least squares from one or many starts, and warnings about the residuals."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np

from symmb._errors import SimulationError
from symmb._magnitudes import SMALL
from symmb._types import Array, Mask
from symmb.bound.nodes import Sobol
from symmb.connect import Jets, Simulator
from symmb.run.simulation import has_exact_jets

MAX_RUNS = 200
"""Largest number of runs of a fit. If the start is within 30 % of the truth, ten runs are usual."""
UNDETERMINED, UNDETERMINED_BY_DIFFERENCES = 1e-6, 1e-4
"""Smallest sensitivity of a determined quantity, divided by the largest sensitivity (parameters in relative units).
Derivatives by integration are exact to about 1e-7, and differences of runs to about 1e-5. The first value also holds
for extrapolated differences, if their errors are small."""
LEAST_NOISE, LEAST_NOISE_BY_DIFFERENCES = 1e-7, 1e-5
"""Smallest noise, divided by the spread of the data. Errors of runs and of their derivatives change estimates as noise
does. Runs have errors of about 1e-9. Differences only count beside priors: with a smaller noise, their errors exceed
the effect of the prior on a combination that the data do not determine (`benchmarks/calibrations.py --precise`)."""
FALSE_WARNING = 1e-4
"""Probability of a false warning, for each test."""
FALSE_CORRELATION = 1e-6
"""The same for the test of correlation in time. Its statistic has a long tail, because residuals of fits to few values
are correlated: 20 values and three parameters exceed this level with a probability of 2e-4, and 1e-4 with 2e-3."""
FEWEST_TESTED = 12
"""Smallest number of values of an output for a test of its residuals. Tests of independence need many values."""
NEAR_LIMIT = 0.05
"""Largest distance from a limit, in relative parameters, at which a search may have ended because of the limit."""
MOST_LEVERAGE = 0.5
"""Largest leverage of an outlier. Without this, the first of 33 values of two decays, with a leverage of 0.8, was an
outlier in the certified fit of NIST's problem MGH17."""
ROBUST = 1.345
"""Residuals below this multiple of the noise count by their square, larger residuals by their size."""
NOISE_OF_RUNS = 1e-4
"""Residuals below this fraction of the spread of the data may be errors of runs, so their correlation is not tested."""


class Residuals:
    """Residuals and their derivatives with respect to relative parameters. Each run is made once.

    Derivatives are exact if the run meets no kink, jump or event. Other derivatives are differences of few runs,
    because a search needs less accuracy than `sensitivities`.
    """

    def __init__(
        self,
        simulator: Simulator,
        names: Sequence[str],
        measured: Mapping[str, tuple[Array, Array]],
        limits: Mapping[str, tuple[float, float]],
        priors: Mapping[str, Array],
        is_robust: bool,
    ) -> None:
        self.simulator, self.names, self.measured = simulator, names, measured
        self.priors, self.is_robust = priors, is_robust
        order = list(simulator.parameters)
        self.p = np.array(list(simulator.parameters.values()))
        self.columns = [order.index(name) for name in names]
        self.sizes = np.where(self.p[self.columns] == 0, 1.0, np.abs(self.p[self.columns]))
        self.limits = np.transpose([limits.get(name, (-np.inf, np.inf)) for name in names]) / self.sizes
        self.places = [
            (np.searchsorted(simulator.times, t), simulator.outputs.index(name)) for name, (t, _) in measured.items()
        ]
        self.times = np.concatenate([t for t, _ in measured.values()])
        self.data = np.concatenate([values for _, values in measured.values()])
        self.counts = [len(values) for _, values in measured.values()]
        self.spreads = np.array([np.ptp(part) or np.abs(part).max() or 1.0 for part in self.parts(self.data)])
        self.runs, self.has_kinks = 0, False
        self._known: dict[bytes, tuple[Array, Array]] = {}

    def __call__(self, u: Array) -> tuple[Array, Array]:
        """Residuals (N,) at relative parameters u (n_p,), nan if the run fails, and derivatives (N, n_p) of outputs."""
        if u.tobytes() not in self._known:
            try:
                exact = has_exact_jets(self.simulator, self._parameters(u))
                y, slopes = self._derived(u) if exact else self._differences(u)
                self.has_kinks |= not exact
            except SimulationError:
                y, slopes = np.full(len(self.data), np.nan), np.full((len(u), len(self.data)), np.nan)
            self._known[u.tobytes()] = self.data - y, slopes.T
        return self._known[u.tobytes()]

    def prior(self, u: Array) -> tuple[Array, Array]:
        """Residuals (k,) of the priors, divided by their deviations, and derivatives (k, n_p) of the parameters."""
        values, deviations = np.array([*self.priors.values()]).reshape(-1, 2).T
        rows = np.array([self.names.index(name) for name in self.priors], dtype=int)
        slopes = np.diag(self.sizes)[rows] / deviations[:, None]
        return values / deviations - slopes @ u, slopes

    def loss(self, squares: Array) -> Array:
        """The loss of squared residuals (n,) and its two derivatives (3, n). Residuals are divided by the noise."""
        if not self.is_robust:
            return np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
        root = np.sqrt(1 + squares / ROBUST**2)
        return np.stack([2 * ROBUST**2 * (root - 1), 1 / root, -0.5 / ROBUST**2 / root**3])

    def widening(self, u: Array, noise: Array) -> float:
        """Deviations of estimates with the loss, divided by those of least squares. Huber, Robust Statistics (1981)."""
        squares = np.square(self(u)[0] / np.repeat(noise, self.counts))
        _, first, second = self.loss(squares)
        return max(1.0, float(np.sqrt(np.mean(squares * first**2)) / np.mean(first + 2 * squares * second)))

    def values(self, U: Array) -> Array:
        """Outputs (M, N) at the times of the data, for relative parameters U (M, n_p); nan if a run fails.

        A search may ask for parameters that are not finite, where derivatives are not.
        """
        self.runs += len(U)
        values, known = np.full((len(U), len(self.data)), np.nan), np.isfinite(U).all(axis=1)
        if known.any():
            values[known] = self.placed(self.simulator.run(self._parameters(U[known])).Y)
        return values

    @property
    def least_noise(self) -> dict[str, float]:
        """The smallest noise of each output."""
        share = LEAST_NOISE_BY_DIFFERENCES if self.has_kinks and self.priors else LEAST_NOISE
        return dict(zip(self.measured, (share * self.spreads).tolist(), strict=True))

    def parts(self, values: Array) -> list[Array]:
        """The values of each output, from values (N,) of all outputs."""
        return np.split(values, np.cumsum(self.counts)[:-1])

    def _parameters(self, U: Array) -> Array:
        """Parameters (..., d) of the simulator for relative parameters (..., n_p)."""
        P = np.tile(self.p, (*U.shape[:-1], 1))
        P[..., self.columns] = U * self.sizes
        return P

    def placed(self, Y: Array) -> Array:
        """Values (M, N) at the times of the data, from outputs (M, n_t, n_y)."""
        return np.concatenate([Y[:, i, k] for i, k in self.places], axis=1)

    def _derived(self, u: Array) -> tuple[Array, Array]:
        """Outputs (N,) and their derivatives (n_p, N) by integration."""
        self.runs += 1
        directions = self._parameters(np.eye(len(u))) * 0
        directions[:, self.columns] = np.diag(self.sizes)
        jets = cast(Jets, self.simulator).jets(self._parameters(u), directions, 1)
        y, slopes = map(self.placed, np.asarray(jets, dtype=float))
        return y[0], slopes

    def extrapolated(self, u: Array) -> tuple[Array, Array]:
        """Derivatives (N, n_p) of outputs by Richardson's extrapolation of differences, and their errors (N, n_p)."""
        first, second, third = (self._differences(u, SMALL / 2**k)[1].T for k in range(3))
        finer = (4 * third - second) / 3
        return finer, np.abs(finer - (4 * second - first) / 3)

    def _differences(self, u: Array, step: float = SMALL) -> tuple[Array, Array]:
        """Outputs (N,) and their derivatives (n_p, N) by differences with steps relative to the nominal parameters.

        If an output jumps between two runs, or a run is beyond a limit, the difference on the other side is used. If
        most differences of a parameter that is below its nominal value disagree, its step is relative to its value.
        """
        y, slopes, alike = self._sides(u, np.full(len(u), step))
        poor = ~alike & (np.abs(u) < 1) & (u != 0)
        if poor.any():
            _, others, are_alike = self._sides(u, np.where(poor, step * np.abs(u), step))
            slopes = np.where((poor & are_alike)[:, None], others, slopes)
        return y, slopes

    def _sides(self, u: Array, steps: Array) -> tuple[Array, Array, Mask]:
        """Outputs (N,), their derivatives (n_p, N) with steps (n_p,), and a mask (n_p,): most of both sides agree."""
        n = len(u)
        moves = np.concatenate([np.zeros((1, n)), np.diag(steps), -np.diag(steps)])
        U = np.clip(u + moves, *self.limits)
        Y = self.values(U)
        Y[(U != u + moves).any(axis=1)] = np.nan
        ahead, behind = (Y[1 : n + 1] - Y[0]) / steps[:, None], (Y[0] - Y[n + 1 :]) / steps[:, None]
        smaller = np.where((np.abs(ahead) < np.abs(behind)) | np.isnan(behind), ahead, behind)
        # Near a zero of a smooth slope, both differences are small beside the largest slope of the output.
        largest = np.fmax.reduceat(np.abs(smaller), np.cumsum([0, *self.counts[:-1]]), axis=1)
        alike = np.abs(ahead - behind) < np.fmax(np.abs(smaller), 0.1 * np.repeat(largest, self.counts, axis=1))
        # A parameter without an effect has equal sides.
        most = (alike | (ahead == behind)).mean(axis=1) > 0.5
        return Y[0], np.where(alike, (ahead + behind) / 2, smaller), most


def least_squares(
    fit: Residuals, begin: Array, basis: Array, known_noise: Mapping[str, float]
) -> tuple[Array, Array] | None:
    """Relative parameters (n_p,) with the smallest sum of squares, and the noise of the outputs.

    Parameters change from `begin` along the orthonormal rows of `basis`. The result is None if the fit does not end.
    """
    given = np.array([*known_noise.values()])
    noise, u = fit.spreads if fit.priors or not known_noise else given, begin
    # Fits with weights from the previous residuals. Two to four fits are usual, and outliers need more. Beside a prior,
    # the first fit has small weights: searches along combinations that precise data do not determine take many steps.
    for _ in range(10):
        if len(basis):
            found = _minimum(fit, u, basis, np.repeat(1 / noise, fit.counts))
            if found is None:
                return None
            u = found
        before, noise = noise, given
        if not known_noise:  # divide the number of parameters between the outputs
            share = 1 - (len(basis) - len(fit.priors)) / len(fit.data)
            size, share_of_spread = (robust_size, NOISE_OF_RUNS) if fit.is_robust else (rms_of, 0.0)
            least = np.maximum(share_of_spread * fit.spreads, [*fit.least_noise.values()])
            noise = np.maximum([size(part) / np.sqrt(share) for part in fit.parts(fit(u)[0])], least)
        if np.allclose(noise, before, rtol=0.01, atol=0.0):
            break
    return u, noise


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a search may leave the region of finite outputs
def _minimum(fit: Residuals, begin: Array, basis: Array, weights: Array, held: float = 0.0) -> Array | None:
    """Parameters (n_p,) with the smallest sum of squares of weighted residuals; None if the search does not end."""
    from scipy.optimize import least_squares

    along, d, n = basis @ begin, len(basis), len(weights)
    rest, first = begin - along @ basis, along

    def residuals(along: Array) -> Array:
        u = rest + along @ basis
        return np.concatenate([fit(u)[0] * weights, fit.prior(u)[0], held * (along - first)])

    def slopes(along: Array) -> Array:
        u = rest + along @ basis
        own = -fit(u)[1] * weights[:, None], -fit.prior(u)[1]
        return np.concatenate([np.concatenate(own) @ basis.T, held * np.eye(d)])

    def loss(squares: Array) -> Array:  # of priors, squares
        others = squares[n:]
        return np.hstack([fit.loss(squares[:n]), [others, np.ones_like(others), np.zeros_like(others)]])

    # Limits apply to single parameters.
    is_limited = d == len(begin) and bool(np.isfinite(fit.limits).any())
    limits: Any = {"bounds": fit.limits} if is_limited else {}
    how: Any = {"loss": loss if fit.is_robust else "linear", "max_nfev": MAX_RUNS, **limits}
    solution = least_squares(residuals, along, jac=cast(Any, slopes), **how)
    # The search ends before a limit. "dogbox" starts at the limit, and stays there if the squares fall further beyond,
    # but it goes far along combinations that the data do not determine, so it does not search alone.
    near = np.abs(solution.x - fit.limits) < NEAR_LIMIT if is_limited else np.zeros(0, dtype=bool)
    if near.any():
        at = np.where(near[0], fit.limits[0], np.where(near[1], fit.limits[1], solution.x))
        start = at if all(np.isfinite(part).all() for part in fit(at)) else solution.x
        solution = least_squares(residuals, start, jac=cast(Any, slopes), method="dogbox", **how)
    return rest + solution.x @ basis if solution.status else None


def other_minima(fit: Residuals, nominal: Array) -> Iterator[Array]:
    """Results (n_p,) of other fits. The fits start at runs with small residuals, and use increasing time spans."""
    d, (begin, end) = len(nominal), (fit.times.min(), fit.times.max())
    # Number of further starts for each parameter, and the largest factor between starts and nominal values.
    U = np.clip(nominal * 2.5 ** Sobol().points(64 * d, d, seed=0), *fit.limits)
    weights = np.repeat(1 / fit.spreads, fit.counts)
    squares = np.square((fit.data - fit.values(U)) * weights)
    starts = [nominal]
    for part in (0.2, 1.0):
        costs = np.nan_to_num(squares[:, fit.times <= begin + part * (end - begin)].sum(axis=1), nan=np.inf)
        # Number of starts with a fit. More starts find more minima, and take longer.
        starts += [U[k] for k in np.argsort(costs)[:3] if np.isfinite(costs[k])]
    for start in starts:
        u: Array | None = start
        # Increasing fractions of the time span with data. Over half a period of an oscillation, the sum of squares has
        # one minimum. The result of each fit is the start of the next fit, close to the right minimum.
        for part in (0.1, 0.2, 0.4, 1.0):
            is_within = fit.times <= begin + part * (end - begin)
            if u is not None and is_within.sum() > d and np.isfinite(fit(u)[0]).all():
                # Additional residual, relative to the spread of the data, for a change of a parameter by its size. It
                # limits changes of parameters that early data do not determine.
                prior = 0.01 * np.sqrt(is_within.sum()) if part < 1 else 0.0
                u = _minimum(fit, u, np.eye(d), weights * is_within, prior)
        if u is not None:
            yield u


def cost_of(fit: Residuals, u: Array, noise: Array) -> float:
    """Measure for the comparison of fits: minus twice the log-likelihood, up to a constant."""
    noise = np.repeat(noise, fit.counts)
    losses = fit.loss(np.square(fit(u)[0] / noise))[0] + 2 * np.log(noise)
    return float(np.nan_to_num(losses.sum() + np.square(fit.prior(u)[0]).sum(), nan=np.inf))


def residual_doubts(fit: Residuals, u: Array, known_noise: Mapping[str, float], degrees: int) -> tuple[str, ...]:
    """Sentences with reasons why the residuals (N,) at the relative parameters u are not noise."""
    import scipy.stats as st

    doubts = list[str]()
    squares, n_squares = float(np.square(fit.prior(u)[0]).sum()), 0
    own = fit.parts(np.square(np.linalg.svd(fit(u)[1], full_matrices=False)[0]).sum(axis=1))
    parts = zip(fit.measured.items(), fit.parts(fit(u)[0]), own, fit.spreads, strict=True)
    for (name, (t, y)), r, leverage, spread in parts:
        deviation = known_noise.get(name, max(robust_size(r), NOISE_OF_RUNS * float(spread)))
        # Factor on normal quantiles for outliers, because the standard deviation is only known to 15 %.
        limit = 1.3 * st.norm.isf(FALSE_WARNING / (2 * len(r)))
        is_far = np.abs(r) > limit * deviation
        # Small residuals of most values do not make the others outliers.
        is_far &= np.abs(r) > limit * rms_of(r[~is_far])
        # Smallest number of values, beyond the number of parameters, for a test of one value against the others.
        if not known_noise and (left := len(r) - len(u) - 1) >= 4:  # with few values, the fit follows an outlier
            squared = np.square(r) / np.maximum(1 - leverage, NOISE_OF_RUNS)
            rest = np.maximum((np.square(r).sum() - squared) / left, (NOISE_OF_RUNS * spread) ** 2)
            far = squared / rest > st.t.isf(FALSE_WARNING / (2 * len(r)), left) ** 2
            # The linear model of the others says little about a value that mostly determines its own fit.
            far &= leverage < MOST_LEVERAGE
            is_far = far if len(r) <= len(u) + FEWEST_TESTED else is_far | far
        if 0 < is_far.sum() <= max(1, len(r) // 10):
            size = max(deviation, rms_of(r[~is_far]))
            worst = int(np.argmax(np.abs(r) * is_far))
            doubts.append(
                f"{int(is_far.sum())} of {len(r)} values of {name} are outliers: the value at t = {t[worst]:g} s is "
                f"off by {abs(r[worst]) / size:.3g} times the noise. Replace wrong values by nan."
            )
            t, y, r = t[~is_far], y[~is_far], r[~is_far]
        squares, n_squares = squares + float(np.square(r / deviation).sum()), n_squares + len(r)
        rms = rms_of(r)
        if len(r) < FEWEST_TESTED or rms < NOISE_OF_RUNS * spread:
            continue
        # The model explains little of the data if the variance of residuals exceeds this fraction of that of the data.
        if not known_noise and rms**2 > 0.7 * np.var(y):
            doubts.append(
                f"The fitted run explains little of {name}: its residuals vary as much as the data. Start with other "
                "nominal values, or change the model."
            )
        elif _chance_of_independence(r[np.argsort(t, kind="stable")]) < FALSE_CORRELATION:
            doubts.append(
                f"Residuals of {name} are correlated in time, so they are not noise. The model does not "
                "describe the data, or another minimum fits better. The standard deviations are too small."
            )
    if known_noise and squares > st.chi2.isf(FALSE_WARNING, max(degrees - len(fit.data) + n_squares, 1)):
        doubts.append(
            f"The data do not fit: residuals are {np.sqrt(squares / n_squares):.3g} times as large as the given "
            "noise. Start with other nominal values, change the model, or give a larger noise."
        )
    return tuple(doubts)


def rms_of(values: Array) -> float:
    """Root mean square of values (N,); 0 without values."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


def robust_size(values: Array) -> float:
    """Standard deviation of normal values (N,) from their median absolute value, which outliers hardly change."""
    return 1.4826 * float(np.median(np.abs(values)))


def _chance_of_independence(r: Array) -> float:
    """Probability that independent residuals are correlated in time as strongly as the given residuals (N,).

    Ljung and Box, Biometrika 65 (1978).
    """
    from scipy.stats import chi2

    # More lags detect slow changes better, and fast changes worse.
    n, n_lags = len(r), 4
    lags = np.arange(1, n_lags + 1)
    correlation = np.array([r[lag:] @ r[:-lag] for lag in lags]) / (r @ r)
    return float(chi2.sf(n * (n + 2) * np.sum(correlation**2 / (n - lags)), n_lags))
