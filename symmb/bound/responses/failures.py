"""Failed runs, their texts, and a simple box of parameters in which more runs fail than elsewhere."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._names import look_up_by_name
from symmb._types import Array, Indices, Mask
from symmb.equations.model import Box

_NEWTON_STEPS, _RIDGE = 25, 1e-2
"""Number of steps of the logistic regression, and its ridge, which limits the weights of separable runs."""
_Intervals = dict[int, tuple[int, int]]
"""The first and the last rank of the allowed values, for some columns. Equal values have equal ranks."""


@dataclass(frozen=True)
class Failure:
    """A failed run: parameter values by name, time of the failure [s], message."""

    parameters: dict[str, float]
    time: float
    message: str

    __post_init__ = look_up_by_name

    def __str__(self) -> str:
        if all(re.search(rf"\b{re.escape(name)} ?= ?", self.message) for name in self.parameters):
            return self.message  # the message contains the parameters already
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.parameters.items())
        return f"{values}: t = {self.time:.6g}: {self.message}"


def failure_text(failed: Sequence[Failure], most: int = 5, indent: str = "  ") -> str:
    """The first run that failed for each reason, and how many others failed for the same reason."""
    counts = Counter(_reason(run) for run in failed)
    firsts = {_reason(run): run for run in reversed(failed)}
    lines = []
    for reason, n in [*counts.items()][:most]:
        others = f" ({n - 1} other {'runs fail' if n > 2 else 'run fails'} for the same reason)" if n > 1 else ""
        lines.append(f"{indent}{firsts[reason]}{others}")
    if len(counts) > most:
        lines.append(f"{indent}and {sum([*counts.values()][most:])} more")
    return "\n".join(lines)


def _reason(run: Failure) -> str:
    """The end of a message, without the time and the parameters of the run."""
    return run.message.rpartition(": ")[2]


@dataclass(frozen=True)
class FailedRegion:
    """A box in which runs fail more often than elsewhere.

    Attributes
    ----------
    box : box of all parameters
    limits : (low, high) of some parameters, by their column; infinite if there is no limit
    inside, outside : number of failed runs and of all runs inside and outside of the box
    """

    box: Box
    limits: dict[int, tuple[float, float]]
    inside: tuple[int, int]
    outside: tuple[int, int]

    def contains(self, points: Array) -> Mask:
        """Mask (...) of the points (..., d) of the unit box that are in the region."""
        return _within(self.limits, self.box.from_unit(points))

    def __str__(self) -> str:
        conditions = [_condition(self.box.names[j], *self.limits[j]) for j in sorted(self.limits)]
        return _counted(" and ".join(conditions), self)


@dataclass(frozen=True)
class FailedHalfSpace:
    """The side of a plane on which runs fail more often: the sum of coefficients times parameters is above a limit.

    Attributes
    ----------
    box : box of all parameters
    coefficients : (d,)
    limit : float
    inside, outside : number of failed runs and of all runs on both sides
    """

    box: Box
    coefficients: Array
    limit: float
    inside: tuple[int, int]
    outside: tuple[int, int]

    def contains(self, points: Array) -> Mask:
        """Mask (...) of the points (..., d) of the unit box on the side of failed runs."""
        return np.asarray(self.box.from_unit(points) @ self.coefficients > self.limit)

    def __str__(self) -> str:
        used = np.flatnonzero(self.coefficients)
        sign = np.sign(self.coefficients[used[0]])
        factors = ("" if abs(x) == 1 else f"{abs(x):.6g} " for x in self.coefficients[used])
        signs = ("+ " if sign * x > 0 else "- " for x in self.coefficients[used])
        parts = (f"{sign}{x}{self.box.names[j]}" for sign, x, j in zip(signs, factors, used, strict=True))
        left, limit = " ".join(parts).removeprefix("+ "), sign * self.limit + 0.0
        return _counted(f"{left} {'>' if sign > 0 else '<'} {limit:.15g}", self)


def _counted(condition: str, region: FailedRegion | FailedHalfSpace) -> str:
    """A condition with the numbers of failed runs and of all runs on both sides."""
    there, elsewhere = (f"{failed} of {runs}" for failed, runs in (region.inside, region.outside))
    return f"for {condition} ({there} runs there, {elsewhere} elsewhere)"


def failed_region(box: Box, points: Array, failed: Mask) -> str:
    """The region of failed runs (N,) at points (N, d) of the unit box, in words; empty for fewer than two failures.

    Examples
    --------
    >>> points = np.linspace(-1.0, 1.0, 21)[:, None]
    >>> failed_region(Box(k=(0.9, 1.1)), points, points[:, 0] > 0.75)
    'for k > 1.075 (3 of 3 runs there, 0 of 18 elsewhere)'
    """
    if failed.sum() < 2:
        return ""
    return str(find_failed_region(box, points, failed) or "scattered over the box")


def find_failed_region(box: Box, points: Array, failed: Mask) -> FailedRegion | FailedHalfSpace | None:
    """The box with limits of few parameters, or the half space, that explains the failures best; None if failures are
    scattered.

    Runs fail with one probability inside of the box, and with another probability outside. The best box maximizes the
    logarithm of the likelihood less a cost for each limit. The cost is the logarithm of the number of possible limits
    (minimum description length; Rissanen, Automatica 14, 1978). A half space has this cost for each coefficient.
    """
    # Number of decimal digits to which points of the unit box are compared.
    points = np.round(points, 12)
    X = box.from_unit(points)
    ranks = np.stack([np.unique(column, return_inverse=True)[1].ravel() for column in points.T])
    intervals, best = _Intervals(), _Intervals()
    least = 0.0
    # Largest number of parameters that a description names.
    for _ in range(min(3, len(box))):
        intervals = _extended(intervals, ranks, failed)
        if (score := _score(intervals, ranks, failed)) > least:
            best, least = dict(intervals), score
    if (half_space := _half_space(box, points, X, ranks, failed, least)) is not None:
        return half_space
    if not best:
        return None
    limits = {j: _limits(X[:, j], ranks[j], ends) for j, ends in best.items()}
    return FailedRegion(box, limits, *_counts(failed, _within(limits, X)))


def _half_space(
    box: Box, points: Array, X: Array, ranks: Indices, failed: Mask, least: float
) -> FailedHalfSpace | None:
    """The best half space of two to four parameters; None if its score is not above `least`.

    The parameters X (N, d) are at points (N, d) of the unit box. Coefficients have the fewest digits that keep the
    score.
    """
    found, columns = None, np.flatnonzero(box.radius > 0)
    while len(columns) > 1:
        weights = _separator(points[:, columns], failed)
        order = np.argsort(-np.abs(weights), kind="stable")
        if len(columns) <= 4:
            slopes = weights / box.radius[columns]
            slopes /= abs(slopes[order[0]]) or 1.0
            short = (np.array([float(f"{x:.{n}g}") for x in slopes]) for n in (1, 2, 3, 12))
            trials, cost = [np.round(2 * slopes) / 2, *short], len(columns) * _cost(ranks)
            cuts = [(*_cut(X[:, columns] @ own, failed, cost), own) for own in trials]
            best = max(score for score, _, _ in cuts)
            if best > least:
                limit, own = next((limit, own) for score, limit, own in cuts if score >= best - SLIGHT)
                least, found = best, (limit, np.bincount(columns, own, len(box)).astype(float))
        columns = np.sort(columns[order[: min(4, len(columns) - 1)]])
    if found is None:
        return None
    limit, coefficients = found
    return FailedHalfSpace(box, coefficients, limit, *_counts(failed, X @ coefficients > limit))


def _counts(failed: Mask, inside: Mask) -> list[tuple[int, int]]:
    """Numbers of failed runs and of all runs inside and outside of a region."""
    return [(int((failed & part).sum()), int(part.sum())) for part in (inside, ~inside)]


def _separator(points: Array, failed: Mask) -> Array:
    """Weights (d,) of the logistic regression of failures at points (N, d), by Newton's method."""
    A, w = np.column_stack([points, np.ones(len(points))]), np.zeros(points.shape[1] + 1)
    for _ in range(_NEWTON_STEPS):
        p = 1 / (1 + np.exp(-np.clip(A @ w, -30.0, 30.0)))
        H = (A * (p * (1 - p))[:, None]).T @ A + _RIDGE * np.eye(len(w))
        w = w + np.linalg.solve(H, A.T @ (failed - p) - _RIDGE * w)
    return w[:-1]


def _cut(z: Array, failed: Mask, cost: float) -> tuple[float, float]:
    """The best score of the runs with z (N,) above a limit, and this limit."""
    order = np.argsort(z)[::-1]
    high, runs = z[order], np.arange(1, len(z))
    scores = np.where(
        high[:-1] > high[1:], _gain(np.cumsum(failed[order].astype(np.intp))[:-1], runs, failed) - cost, -np.inf
    )
    k = int(scores.argmax())
    return float(scores[k]), _between(high[k + 1 :], high[k:])


def _extended(intervals: _Intervals, ranks: Indices, failed: Mask) -> _Intervals:
    """The intervals with an interval of one more column. Each interval is then optimized, with the others fixed."""
    free = [j for j in range(len(ranks)) if j not in intervals]
    tried = [intervals | {j: _best_interval(intervals, j, ranks, failed)} for j in free]
    intervals = max(tried, key=lambda some: _score(some, ranks, failed))
    for j in intervals:
        others = {other: ends for other, ends in intervals.items() if other != j}
        intervals = intervals | {j: _best_interval(others, j, ranks, failed)}
    return intervals


def _best_interval(others: _Intervals, j: int, ranks: Indices, failed: Mask) -> tuple[int, int]:
    """The interval of column j, with one limit or two, that has the best score together with other intervals."""
    inside, last = _inside(others, ranks), int(ranks[j].max())
    runs = np.cumsum(np.bincount(ranks[j][inside], minlength=last + 1))
    bad = np.cumsum(np.bincount(ranks[j][inside & failed], minlength=last + 1))
    at = np.unique(ranks[j][inside & failed])  # an interval is best if failed runs are at its ends
    # Largest number of ends of an interval that are tried on each side. More ends take longer.
    at = at[np.linspace(0, len(at) - 1, min(len(at), 200)).round().astype(int)]
    first, end = np.concatenate([[0], at]), np.concatenate([at, [last]])
    before_runs, before_bad = (np.concatenate([[0], sums])[first][:, None] for sums in (runs, bad))
    limits = (first > 0)[:, None].astype(int) + (end < last)
    scores = _gain(bad[end] - before_bad, runs[end] - before_runs, failed) - limits * _cost(ranks)
    scores[(first[:, None] > end) | (limits == 0)] = -np.inf
    best = np.unravel_index(scores.argmax(), scores.shape)
    return int(first[best[0]]), int(end[best[1]])


def _score(intervals: _Intervals, ranks: Indices, failed: Mask) -> float:
    """Gain of the log-likelihood by intervals, minus the cost of their limits."""
    inside = _inside(intervals, ranks)
    limits = sum((first > 0) + (end < ranks[j].max()) for j, (first, end) in intervals.items())
    return float(_gain(int((failed & inside).sum()), int(inside.sum()), failed)) - limits * _cost(ranks)


def _cost(ranks: Indices) -> float:
    """Cost of a limit: the logarithm of the number of possible limits."""
    return math.log(max(2.0 * ranks.max(axis=1).sum(), 1.0))


def _inside(intervals: _Intervals, ranks: Indices) -> Mask:
    """Mask (N,) of the runs with ranks inside of all intervals."""
    inside = np.ones(ranks.shape[1], dtype=bool)
    for j, (first, end) in intervals.items():
        inside &= (ranks[j] >= first) & (ranks[j] <= end)
    return inside


def _gain(bad: Indices | int, runs: Indices | int, failed: Mask) -> Array:
    """Gain of the log-likelihood if `bad` of `runs` runs fail inside; 0 if failures are rarer inside than outside."""
    all_bad, n = int(failed.sum()), len(failed)
    gain = _log_likelihood(bad, runs) + _log_likelihood(all_bad - bad, n - runs) - _log_likelihood(all_bad, n)
    return np.where(bad * n > all_bad * runs, gain, 0.0)


def _log_likelihood(bad: Indices | int, runs: Indices | int) -> Array:
    """Maximum log-likelihood of `bad` failures in `runs` runs."""
    parts = [np.asarray(part, dtype=float) for part in (bad, np.subtract(runs, bad))]
    return sum((part * np.log(np.where(part > 0, part / np.maximum(runs, 1), 1.0)) for part in parts), np.zeros(()))


def _within(limits: dict[int, tuple[float, float]], X: Array) -> Mask:
    """Mask (...) of the parameters X (..., d) between all limits."""
    return np.all([(X[..., j] > low) & (X[..., j] < high) for j, (low, high) in limits.items()], axis=0)


def _limits(x: Array, rank: Indices, ends: tuple[int, int]) -> tuple[float, float]:
    """Limits with few digits that separate an interval of the values x from the others; infinite at the end of x."""
    first, end = ends
    low = _between(x[rank == first - 1], x[rank == first]) if first > 0 else -math.inf
    return low, _between(x[rank == end], x[rank == end + 1]) if end < rank.max() else math.inf


def _between(below: Array, above: Array) -> float:
    """The number with the fewest digits that is clearly between two values."""
    low, high = float(below[0]), float(above[0])
    middle, near = low + 0.5 * (high - low), 0.45 * (high - low)
    numbers = (float(f"{middle:.{digits}g}") for digits in range(1, 18))
    return next((x for x in numbers if abs(x - middle) <= near), middle)


def _condition(name: str, low: float, high: float) -> str:
    if math.isinf(high):
        return f"{name} > {low:.15g}"
    return f"{name} < {high:.15g}" if math.isinf(low) else f"{low:.15g} < {name} < {high:.15g}"
