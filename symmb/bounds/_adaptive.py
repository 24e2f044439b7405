"""Polynomial chaos that chooses its nodes: tensor grids of few parameters, sparse grids of many, and check runs."""

from dataclasses import dataclass, field

import numpy as np

from symmb._box import Box
from symmb._errors import PropagationError
from symmb._types import Array, Executor
from symmb.bounds._continuation import Continuation, likely_ahead
from symmb.bounds._dense import HIGHEST_DEGREE, dense_extremes
from symmb.bounds._describe import failure_text
from symmb.bounds._exact import Exact
from symmb.bounds._grid import Grid, Index
from symmb.bounds._method import parameter_samples
from symmb.bounds._moments import Expansion
from symmb.bounds._reductions import failure_records
from symmb.bounds._result import Bounds, Failure
from symmb.bounds._tails import Tails, smooth
from symmb.codegen.build import has_compiler
from symmb.simulate import Mask, Progress, Simulator, run_blocks

MOST_RUNS, MOST_NUMBERS = 5000, 40_000_000
"""Without a budget: where to stop although the tolerance is not met, since ``estimate`` tells how far off; and how many
responses are kept, 0.3 GB, as many coefficients beside them."""
TENSOR_PARAMETERS = 3
"""Up to so many parameters grids are tensors: extremes lie at corners and edges, where sparse grids are weakest."""
ROUNDING = 1e-9
"""Share of an output's scale below which its width counts as none."""
_REFINED = 0.25
"""Directions of a tensor whose errors are at least this share of the largest are refined together."""
_GROWTH = 0.25
"""A sparse grid grows by about this share at a time."""
_SAFETY = 2.5
"""What the errors seen by check runs are multiplied with: they are those at a few of the extremes."""
_TRUST = 0.6
"""Least share of its estimated error that an interpolant keeps when check runs see less."""
_REACHED = 0.2
"""Share of that which remains even at places of check runs: the continuation is no interpolant of all others."""
_DENSE = 1e-5
"""Share of a range to which the dense search finds it."""
_RANGE = 0.02
"""Share of the tolerance to which ranges are found."""
_WORK, _FEWEST_BOXES = 200_000, 20
"""Coefficients in all boxes that a range may take, where many parameters leave it unproved anyway; boxes at least."""
_CANDIDATES = 150
"""Extremes among which check runs are chosen."""


@dataclass
class _Runs:
    """All runs made so far: at the nodes of the grid, in its order, and at other points.

    Nodes whose runs failed hold what the interpolant before them predicts; other points that failed are left out.
    """

    simulator: Simulator
    box: Box
    executor: Executor | None
    progress: Progress | None
    nodes: Array = field(init=False)
    checks: Array = field(init=False)
    points: Array = field(init=False)  # of the checks
    attained: Mask = field(init=False)  # which of the nodes have been run
    failed: tuple[Failure, ...] = ()

    def __post_init__(self) -> None:
        self.shape = len(self.simulator.times), len(self.simulator.outputs)
        self.nodes = self.checks = np.empty((0, *self.shape))
        self.points = np.empty((0, len(self.box)))
        self.attained = np.empty(0, dtype=bool)

    def __len__(self) -> int:
        """Runs that were made, failed ones included."""
        return len(self.attained) + len(self.checks) + len(self.failed) - int((~self.attained).sum())

    def at(self, points: Array) -> tuple[Array, Mask]:
        """Responses (N, n_t, n_y) at points (N, d) of the unit box, and which did not fail (N,)."""
        P = parameter_samples(self.simulator, self.box, points)
        ensemble = run_blocks(self.simulator, P, self.executor, self.progress)
        bad = np.flatnonzero(~ensemble.ok)
        told = tuple(zip(bad.tolist(), ensemble.t_failed[bad].tolist(), ensemble.messages, strict=True))
        self.failed += failure_records(self.simulator, self.box, P, told)
        return ensemble.Y, ensemble.ok

    def add(self, nodes: Array, before: Expansion | None) -> None:
        """Run new nodes (N, d), of which the interpolant before predicts those that fail.

        Raises
        ------
        PropagationError        if there is none before
        """
        Y, ok = self.at(nodes)
        if not ok.all():
            if before is None:
                raise PropagationError(
                    f"{len(self.failed)} of the first {len(nodes)} runs failed, too many to go on from. "
                    "PolynomialChaos(order=..., basis=TotalDegree()) can fit around some.\n" + failure_text(self.failed)
                )
            Y[~ok] = before.values(nodes[~ok])
        self.nodes, self.attained = np.concatenate([self.nodes, Y]), np.concatenate([self.attained, ok])

    def check(self, points: Array) -> tuple[Array, Array]:
        """Those of the points (C, d) beside the grid that do not fail, and the responses there, which are kept."""
        Y, ok = self.at(points)
        Y, points = Y[ok], points[ok]
        self.checks, self.points = np.concatenate([self.checks, Y]), np.concatenate([self.points, points])
        return points, Y

    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest responses of all runs (n_t, n_y)."""
        nodes = self.nodes if self.attained.all() else self.nodes[self.attained]
        both = [Y for Y in (nodes, self.checks) if len(Y)]
        return np.min([Y.min(axis=0) for Y in both], axis=0), np.max([Y.max(axis=0) for Y in both], axis=0)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """An expansion and its range (n_t, n_y) to a share, with the places (2, n_t, n_y, d) of its minima and maxima.

    The range is the widest that was found: proofs take longer than the runs, and prove nothing of the responses.
    """

    expansion: Expansion
    lower: Array
    upper: Array
    places: Array
    tolerance: float

    @classmethod
    def of(cls, expansion: Expansion, share: float) -> "_Fitted":
        """With the range to a share of itself, or better."""
        alpha, shape = expansion.alpha, expansion.coefficients.shape[1:]
        flat = expansion.coefficients.reshape(len(alpha), -1)
        if alpha.shape[1] <= TENSOR_PARAMETERS and has_compiler():
            share = _DENSE
            lower, upper, *places = dense_extremes(alpha, flat)
        else:
            found = Exact(share, max(_FEWEST_BOXES, _WORK // len(alpha))).search(alpha, flat)
            lower, upper = found.lower + found.below, found.upper - found.above
            places = [found.at_lower, found.at_upper]
        points = np.stack(places).reshape(2, *shape, alpha.shape[1])
        return cls(expansion, lower.reshape(shape), upper.reshape(shape), points, share)


def adaptive_bounds(
    text: str,
    tolerance: float,
    budget: int | None,
    simulator: Simulator,
    box: Box,
    executor: Executor | None,
    progress: Progress | None,
) -> Bounds:
    """Bounds by an interpolant that is refined until its estimated error is below ``tolerance`` of the width.

    The error is the root mean square over time, over that of the width, of the output where it is largest. It is
    estimated from the interpolant's last coefficients, at the places of its extremes. Runs at some of these places then
    check the estimate and, on sparse grids, correct the expansion.
    """
    d = len(box)
    numbers = len(simulator.times) * len(simulator.outputs)
    most = max(min(MOST_RUNS, MOST_NUMBERS // max(numbers, 1)), 5**d if d < 4 else 4 * d) if budget is None else budget
    share = _RANGE * tolerance
    checks = max(2 * d, 4)
    tensor = d <= TENSOR_PARAMETERS
    runs, grid = _Runs(simulator, box, executor, progress), Grid(d)
    axes = [tuple(2 * (i == j) for j in range(d)) for i in range(d)]
    step = grid.missing([(4,) if d == 1 else (2,) * d] if tensor else axes)
    if len(step) > most:
        raise PropagationError(f"{text}: the first level takes {len(step)} runs, more than the budget of {most}.")
    expansion = None
    while True:
        known = len(grid.row)
        grid.add(step)
        runs.add(grid.nodes[known:], expansion)
        coefficients = grid.coefficients(runs.nodes.reshape(len(runs.nodes), -1)).reshape(runs.nodes.shape)
        expansion = Expansion(grid.alpha, coefficients, box.names)
        tails = Tails.of(grid.alpha, coefficients)
        unit = _unit(*runs.extremes())
        sizes = (_rms(coefficients.swapaxes(0, 1)) / unit).max(axis=1)
        room = most - len(runs) - checks
        step = _next_tensor(grid, tails, unit) if tensor else _next_sparse(grid, sizes, room)
        last = not step or len(runs) + len(step) > most
        enough = tolerance / _TRUST  # checks may show that much less
        if not last and _share(tails.least(), unit) > enough:
            continue  # too large wherever the extremes are
        fitted = _Fitted.of(expansion, share)
        estimate = np.maximum(*(tails.at(x) for x in fitted.places))
        if not last and _share(estimate, unit) > enough:
            continue
        number = min(checks, most - len(runs))
        if tensor:
            estimate = _checked(runs, fitted, tails, estimate, unit, number)
        else:
            fitted, estimate = _corrected(runs, grid, fitted, sizes, share, estimate, unit, number)
        if last or _share(estimate, unit) <= tolerance:
            break
    inner = runs.extremes()
    return Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=np.minimum(fitted.lower, inner[0]),
        upper=np.maximum(fitted.upper, inner[1]),
        kind="estimate",
        method=text,
        evaluations=len(runs),
        estimate=estimate + fitted.tolerance * (fitted.upper - fitted.lower),
        inner=inner,
        failed=runs.failed,
        expansion=fitted.expansion,
    )


def _next_tensor(grid: Grid, tails: Tails, unit: Array) -> set[Index]:
    """Twice the degree in those directions whose errors are large; nothing where that would be too high."""
    errors = np.array([_share(e, unit) for e in tails.directions])
    refined = errors >= _REFINED * errors.max()
    top = zip(max(grid.row), refined, strict=True)
    return grid.missing([tuple(2 * k if more and 2 * k <= HIGHEST_DEGREE else k for k, more in top)])


def _next_sparse(grid: Grid, sizes: Array, room: int) -> set[Index]:
    """The indices whose coefficients are likely to be the largest, at most as many as there is room for."""
    likely = likely_ahead(grid, sizes)
    number = min(max(grid.d, int(_GROWTH * len(grid.row))), max(room, 0))
    return set(sorted(likely, key=lambda a: (-likely[a], a))[:number])


def _checked(runs: _Runs, fitted: _Fitted, tails: Tails, estimate: Array, unit: Array, number: int) -> Array:
    """The estimate (n_t, n_y), changed where runs at some of the extremes see other errors than expected there."""
    points, Y = runs.check(_spread(fitted.places, np.stack([estimate, estimate]) / unit, number))
    if not len(points):
        return estimate
    errors, expected = Y - fitted.expansion.values(points), np.stack([tails.at(x) for x in points])
    ratios = np.divide(errors, expected, out=np.zeros_like(errors), where=expected > 0)
    return estimate * np.maximum(_seen(ratios), _TRUST)


def _corrected(
    runs: _Runs, grid: Grid, fitted: _Fitted, sizes: Array, tolerance: float, estimate: Array, unit: Array, number: int
) -> tuple[_Fitted, Array]:
    """The expansion continued through runs at some of its extremes, twice; and its error as the second ones see it."""
    base, seen = fitted.expansion, estimate
    continuation = Continuation.of(grid, likely_ahead(grid, sizes))
    typical = _rms(continuation.expected(base.alpha, fitted.places, runs.points).ravel())

    def share(places: Array, points: Array) -> Array:
        """Of the error typical of extremes, what nodes and points leave at places (..., d)."""
        left = continuation.expected(base.alpha, places, points)
        return _REACHED + (1 - _REACHED) * np.divide(left, typical, out=np.ones_like(left), where=left < typical)

    for some in (number // 2, number - number // 2):
        before = runs.points
        points, Y = runs.check(_spread(fitted.places, share(fitted.places, before) * estimate / unit, some))
        if not len(points):
            continue
        errors = (Y - fitted.expansion.values(points)) / share(points, before)[:, None, None]
        seen = _seen(errors)
        known = (runs.checks - base.values(runs.points)).reshape(len(runs.points), -1)
        change, further = continuation.through(base.alpha, runs.points, known)
        coefficients = np.concatenate([base.coefficients.reshape(len(change), -1) + change, further])
        alpha = np.concatenate([base.alpha, continuation.alpha])
        fitted = _Fitted.of(Expansion(alpha, coefficients.reshape(len(alpha), *runs.shape), base.parameters), tolerance)
    return fitted, share(fitted.places, runs.points).max(axis=0) * np.maximum(seen, _TRUST * estimate)


def _seen(errors: Array) -> Array:
    """Errors (n_t, n_y) to be expected elsewhere from those at check runs (C, n_t, n_y)."""
    return _SAFETY * np.sqrt(smooth(np.square(errors).max(axis=0)))


def _spread(places: Array, weights: Array, number: int) -> Array:
    """So many of the places (2, n_t, n_y, d), where most of the weight (2, n_t, n_y) is, not close to each other."""
    points, weights = places.reshape(-1, places.shape[-1]), weights.ravel()
    heaviest = np.argsort(weights)[-min(len(weights), 20 * _CANDIDATES) :]
    chosen = heaviest[:: max(1, len(heaviest) // _CANDIDATES)]
    points, weights = points[chosen], weights[chosen]
    near = np.exp(-np.square(points[:, None] - points[None]).sum(axis=2) * 2 / points.shape[1])
    picked = []
    for _ in range(min(number, len(points))):
        best = int(np.argmax(near @ weights))
        picked.append(best)
        weights = weights * (1 - near[best])
    return points[picked]


def _unit(low: Array, high: Array) -> Array:
    """What errors of each output are measured by, rms width (n_y,); infinite if it is constant but for rounding."""
    width, scale = _rms(high - low), np.maximum(_rms(low), _rms(high))
    return np.where(width > ROUNDING * scale, width, np.inf)


def _share(error: Array, unit: Array) -> float:
    """Largest over outputs of rms error over rms width."""
    return float(np.max(_rms(error) / unit, initial=0.0))


def _rms(a: Array) -> Array:
    return np.sqrt(np.mean(np.square(a), axis=0))
