"""Bounds of few responses over many parameters, from a Gaussian process that learns the directions of variation.

tests/benchmarks/known_ranges.py has 370 functions (seeds 5-9, 60 s each). The process is used for 153 functions. The
median is 80 runs, 10 functions have needless warnings, and no error is without a warning. With sparse grids, the median
is 328 runs, 80 functions have needless warnings, and three sums of kinks have errors without a warning.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array, Mask
from symmb.bound.adaptive.check_points import (
    FEW_TIMES,
    PATIENCE,
    SAFETY,
    evenly_spread_points,
    quasi_random_points,
    screening_corners,
)
from symmb.bound.adaptive.check_rounds import is_among
from symmb.bound.adaptive.continuation import extrapolated_sizes, largest
from symmb.bound.adaptive.outputs import OutputProblem
from symmb.bound.adaptive.runs import CHEAP_RUNS, TRUST, OutputRuns
from symmb.bound.adaptive.small_study import Attempt, Checks, Noise, OutputStudy, Steps
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.nodes import Grid, along_axes
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import DOUBTFUL, rms
from symmb.bound.searches import LINE_POINTS, GaussianProcess, Kernel, Ridge, Sum

_NAME = "a response surface"


@dataclass(frozen=True)
class ResponseSurface(OutputStudy):
    """A Gaussian process through runs, with further runs at known and at possible extremes.

    Slopes in the middle give the direction of a first ridge. Each round makes runs at the extremes of the mean, and of
    the mean plus or minus some standard deviations. Further runs are at points spread over the box, corners first. The
    estimated error is the effect of these deviations on the extremes, or a fraction of the error at the latest runs. If
    the runs do not suffice, this error is at least the error of cross-validation. If the error remains large, the
    bounds are extremes of runs.

    Attributes
    ----------
    shortest_ridge : length of a ridge. Searches start from 1, 2, 4 and 8 times this length. Fewer starts may fail, more
        take time
    refit_growth : growth of the number of runs after which the kernel is chosen again. Smaller growth takes more time
        and fewer runs
    unlikely : logarithm of the likelihood ratio at which a kernel is abandoned
    deviations : largest expected distance of a response from its mean, in standard deviations
    latest_runs : number of last runs that may increase this distance. Larger numbers are safer and take more runs
    spread_runs, fewest_spread : number of runs of a round that are spread over the box, and their smallest total
        number. Eight of the first are at corners, because some effects require several high parameters
    extension : ratio of the largest to the usual largest number of runs, while the error is above 5 % of the width.
        Other studies would take more runs, and bounds with twice this error are doubtful
    unlike : smallest difference of the surface from a run that it does not use, over the width and the tolerance, at
        which it uses this run. Smaller numbers take more runs, larger ones miss bumps (benchmarks/silent_errors.py)
    slope_step : distance from the centre at which slopes are measured. Runs at the same distance from an extreme test
        whether the response is flat there. At a smaller distance, changes are smaller. At a larger one, slopes differ
    candidates, starts : number of points near corners (as many corners, and as many points inside), and number of
        starts of searches. Larger numbers take more time and miss fewer extremes
    apart : least distance of these starts. If starts are closer, all of them are near the largest extreme, and bumps
        inside of the box are missed. With larger distances, close extremes are missed (benchmarks/silent_errors.py)
    """

    shortest_ridge: float = 0.7
    refit_growth: float = 1.4
    unlikely: float = 20.0
    deviations: float = 2.0
    latest_runs: int = 10
    spread_runs: int = 4
    fewest_spread: int = 16
    extension: int = 2
    unlike: float = 2.0
    slope_step: float = 0.15
    candidates: int = 200
    starts: int = 3
    apart: float = 0.5

    name = "response surface"
    when = f"an output has at most {FEW_TIMES} times, and its sparse grid or its corners do not decide it"

    def accepts(self, problem: OutputProblem) -> bool:
        return problem.found is None and problem.is_brief

    def steps(self, problem: OutputProblem) -> Attempt:
        runs = problem.runs
        points = np.concatenate([problem.grid.nodes, problem.probes if runs.has_lanes else runs.points])
        found = yield from self._found(problem, points)
        return (yield from problem.polled(found))

    def _found(self, problem: OutputProblem, points: Array) -> Steps:
        """The range, from points (N, d) of the first runs of the process."""
        runs, tolerance, is_patient = problem.runs, problem.tolerance, problem.is_patient
        d = len(runs.box)
        most = runs.most if is_patient else PATIENCE * d
        latest, kernels, n_spread, n_fit = np.zeros(1), list[Kernel](), 0, 0
        corners = np.array_split(screening_corners(d)[: 2 * self.spread_runs], 2)
        slopes, n_even = self.slope_step * np.eye(d), 0
        while is_among(evenly_spread_points(n_even + 1, d)[-1:], runs.points).all():  # earlier studies have run them
            n_even += 1
        yield Checks(slopes)
        points = np.concatenate([points, slopes])
        while True:
            data = _Responses.of(*runs.attained(points), runs)
            if not data.varies.any() and len(data.points) < len(runs.attained()[0]):
                points = runs.attained()[0]  # corners may differ
                continue
            if not data.varies.any():
                evidence = Evidence.of("exact", np.zeros(runs.shape))
                return EstimatedRange(*runs.extremes, evidence, None, _NAME, is_enough=True)
            if len(data.points) >= self.refit_growth * n_fit:
                kernels, n_fit = _kernels(kernels, data), len(data.points)
            surface = GaussianProcess(kernels[0], data.points, data.Y)
            # At an extreme of a sum, the errors of all its kinks have the same sign.
            factor = self.deviations * (d**0.5 if kernels[0].is_sum else 1.0)
            places, ends = _extremes(
                surface, factor * max(1.0, float(rms(surface.left_out_deviations()[-self.latest_runs :])))
            )
            attained, width = np.stack([data.Y.min(axis=0), data.Y.max(axis=0)]), np.ptp(data.Y, axis=0)
            ends = np.stack([np.minimum(ends[0], attained[0]), np.maximum(ends[1], attained[1])])
            is_plateau = _is_plateau(data, attained)
            ends = np.where(is_plateau[:, None], attained[:, None], ends)
            left_out = _left_out(surface, data.noise)
            observed = np.where(is_plateau, 0.0, np.maximum(TRUST * rms(latest) * width, left_out))
            estimate = np.maximum(np.abs(ends[:, 1] - ends[:, 0]), observed).max(axis=0)
            is_enough = n_spread >= self.fewest_spread and all(
                (error <= np.maximum(tolerance * width, noise)).all()
                for error, noise in ((estimate, data.noise), (left_out * ~is_plateau.any(axis=0), data.noise / SAFETY))
            )
            if is_enough and len(others := self._unlike(data, surface, runs, tolerance)):
                points, most = np.concatenate([points, others]), most + len(others)
                continue
            if not is_enough:
                estimate = np.maximum(estimate, SAFETY * left_out)
            allowed = most if (estimate <= DOUBTFUL / 2 * width).all() else self.extension * most
            if is_enough or len(data.points) >= allowed or not runs.left or runs.clock.is_late:
                found = data.range(runs, surface, (places[:, 0], ends), attained, estimate)
                return found._replace(is_enough=is_enough)
            if not runs.noise_is_known and len(data.points) > CHEAP_RUNS:
                yield Noise()
                kernels, n_fit = [], 0  # noise of one response changes the kernel of all responses
                continue
            is_at_corners = bool(corners) and n_spread % (2 * self.spread_runs) > 0
            spread = evenly_spread_points(n_even + n_spread + self.spread_runs, d)[-self.spread_runs :]
            spread = corners.pop() if is_at_corners else spread
            n_spread += self.spread_runs
            beside = _beside(places[:, 0].reshape(-1, d), n_spread)
            n_known = len(runs.points)
            new = _distinct([*places.reshape(-1, d), *beside, *spread], data.points)
            points = np.concatenate([points, new])
            yield Checks(new)
            if len(runs.points) > n_known:
                responses = runs.checks[n_known:]
                errors = np.abs(data.relative(responses) - surface.mean(runs.points[n_known:]))
                latest = (errors / np.ptp(data.Y, axis=0)).max(axis=1)

    def _unlike(self, data: "_Responses", surface: GaussianProcess, runs: OutputRuns, tolerance: float) -> Array:
        """Points (n, d) of some runs that the surface does not use, and from which it differs most."""
        points, Y = runs.attained()
        is_new = ~is_among(points, data.points)
        if not is_new.any():
            return points[:0]
        errors = np.abs(data.relative(Y[is_new]) - surface.mean(points[is_new])) - data.noise
        errors = (errors / np.ptp(data.Y, axis=0)).max(axis=1)
        worst = np.argsort(-errors, kind="stable")[: self.spread_runs]
        return points[is_new][worst][errors[worst] > self.unlike * tolerance]


_SURFACE = ResponseSurface()


@dataclass(frozen=True, eq=False)
class _Responses:
    """Successful runs, and their responses that vary, minus the mean and divided by the standard deviation.

    Attributes
    ----------
    points, Y : (N, d) and (N, m)
    mean, deviation : (n_t n_y,) mean and standard deviation of all responses
    varies : (n_t n_y,) mask of the m responses that vary
    noise : (m,) of the responses that vary
    """

    points: Array
    Y: Array
    mean: Array
    deviation: Array
    varies: Mask
    noise: Array

    @classmethod
    def of(cls, points: Array, Y: Array, runs: OutputRuns) -> "_Responses":
        Y = Y.reshape(len(points), -1)
        mean, deviation, noise = Y.mean(axis=0), Y.std(axis=0), np.tile(runs.noise, runs.shape[0])
        varies = np.ptp(Y, axis=0) > np.maximum(runs.rounding * abs(Y).max(axis=0), 2 * noise)
        return cls(
            points,
            (Y - mean)[:, varies] / deviation[varies],
            mean,
            deviation,
            varies,
            noise[varies] / deviation[varies],
        )

    def relative(self, responses: Array) -> Array:
        """Responses (C, n_t, n_y) in the units of Y, (C, m)."""
        return (responses.reshape(len(responses), -1) - self.mean)[:, self.varies] / self.deviation[self.varies]

    def range(
        self,
        runs: OutputRuns,
        surface: GaussianProcess,
        extremes: tuple[Array, Array],
        attained: Array,
        estimate: Array,
    ) -> EstimatedRange:
        """The range, from places (2, m, d) of extremes of the mean, and ends (2, 2, m) without and with deviations.

        If the bounds of a response are uncertain, its ends are the values (2, m) that runs attained.
        """
        at, ends = extremes
        places = np.zeros((2, len(self.mean), at.shape[2]))
        places[:, self.varies] = at
        doubtful = estimate > DOUBTFUL * np.ptp(attained, axis=0)
        lower, upper = np.where(doubtful, attained, ends[:, 0])
        estimate = np.where(doubtful, np.maximum(estimate, np.abs(ends[:, 1] - attained).max(axis=0)), estimate)
        error = (self.absolute(estimate) - self.mean).reshape(runs.shape)
        polynomials = partial(_polynomials, lambda points: self.absolute(surface.mean(points)), runs, error)
        return EstimatedRange(
            self.absolute(lower).reshape(runs.shape),
            self.absolute(upper).reshape(runs.shape),
            Evidence.of("surface", error),
            None if doubtful.any() else polynomials,
            _NAME,
            places.reshape(2, *runs.shape, -1),
        )

    def absolute(self, values: Array) -> Array:
        """Responses (..., n_t n_y) from normalised values (..., m)."""
        relative = np.zeros((*values.shape[:-1], len(self.mean)))
        relative[..., self.varies] = values
        return self.mean + self.deviation * relative


def _is_plateau(data: _Responses, attained: Array) -> Mask:
    """Mask (2, m) of minima and maxima that several runs inside the box attain. The response is constant there."""
    inside = (np.abs(data.points) < 1).all(axis=1) & data.points.all(axis=1)
    shared = np.abs(data.Y[inside] - attained[:, None]) <= SAME * np.ptp(attained, axis=0)
    return np.asarray(shared.sum(axis=1) > 1)


def _left_out(surface: GaussianProcess, noise: Array) -> Array:
    """Errors (m,) of a surface from leave-one-out cross-validation, as root mean squares, without noise (m,).

    Errors at the latest runs may be too small: these runs may all be on one side of a jump. The noise includes the
    safety factor, and its squares are subtracted: the few runs that measure noise may be close by chance.
    """
    squares = np.square(surface.left_out_errors()).mean(axis=0) - np.square(noise / SAFETY)
    return np.sqrt(np.maximum(squares, 0.0))


def _kernels(kernels: list[Kernel], data: _Responses) -> list[Kernel]:
    """Likely kernels of a smooth response, of responses with one or two ridges, and of a sum. The most likely is first.

    The first ridge is along the slope at the centre. The second ridge is along the direction of the largest remaining
    variation.
    """
    slope, plain = _slope(data), Kernel.of(data.points.shape[1])
    starts = [*(kernels or (plain, plain.with_term(Sum(1.0, plain.terms[0].rates))))]
    if slope.any() and (not kernels or any(kernel.n_ridges for kernel in kernels)):
        starts.append(_with_ridge(plain, slope, data))
    fits = [GaussianProcess(kernel, data.points, data.Y).most_likely() for kernel in starts]
    ridges = [each for each in fits if each.kernel.n_ridges == 1]
    if ridges:
        first = min(ridges, key=_unlikeliness)
        second = _with_ridge(first.kernel, first.rest_direction(), data)
        fits.append(GaussianProcess(second, data.points, data.Y).most_likely())
    fits.sort(key=_unlikeliness)
    likely: dict[tuple[int, bool], Kernel] = {}  # the best kernel for each number of ridges, and for sums
    for fit in fits:
        kernel = fit.kernel
        if _unlikeliness(fit) < _unlikeliness(fits[0]) + _SURFACE.unlikely:
            likely.setdefault((kernel.n_ridges, kernel.is_sum), kernel)
    return list(likely.values())


def _unlikeliness(process: GaussianProcess) -> float:
    return process.unlikeliness()[0]


def _slope(data: _Responses) -> Array:
    """The slope (d,) at the centre of the response with the largest slope."""
    is_near = (data.points == _SURFACE.slope_step).any(axis=1) & (np.count_nonzero(data.points, axis=1) == 1)
    middle = data.Y[(data.points == 0).all(axis=1)]
    if not len(middle):
        return np.zeros(data.points.shape[1])
    slopes = (data.Y[is_near] - middle[0]).T @ data.points[is_near]
    return slopes[np.argmax(np.square(slopes).sum(axis=1))]


def _with_ridge(kernel: Kernel, direction: Array, data: _Responses) -> Kernel:
    """A kernel with one more ridge along a direction. The ridge has the most likely length."""
    direction = direction / np.linalg.norm(direction)
    kernels = [kernel.with_term(Ridge(1.0, _SURFACE.shortest_ridge * k * direction)) for k in (1, 2, 4, 8)]
    return min(kernels, key=lambda each: _unlikeliness(GaussianProcess(each, data.points, data.Y)))


def _extremes(surface: GaussianProcess, factor: float) -> tuple[Array, Array]:
    """Places (2, 2, m, d) of minima and maxima (first axis) of the mean without and with deviations, and the values.

    Local searches start from the best points of the box, corners and runs. One more start combines the best values of
    all parameters, because a sum of functions of one parameter has many local extremes.
    """
    d, m = surface.points.shape[1], surface.Y.shape[1]
    spread = quasi_random_points(_SURFACE.candidates, d)
    candidates = np.concatenate([spread, np.sign(spread), evenly_spread_points(len(spread), d), surface.points])
    mean, deviation = surface.mean(candidates), surface.deviation(candidates)
    places, ends = np.empty((2, 2, m, d)), np.empty((2, 2, m))
    for end, sign in enumerate((1.0, -1.0)):
        for k, deviations in enumerate((0.0, factor)):
            for j in range(m):
                order = np.argsort(sign * mean[:, j] - deviations * deviation, kind="stable")
                best = _best_of_each_parameter(surface, j, sign, deviations, candidates[order[0]])
                starts = _apart([best, *candidates[order]], 1 + _SURFACE.starts)
                places[end, k, j], least = surface.smallest(j, sign, deviations, starts)
                ends[end, k, j] = sign * least
    return places, ends


def _apart(places: Sequence[Array], number: int) -> Array:
    """The first places (number, d) that are not close to earlier ones."""
    chosen = [places[0]]
    for place in places[1:]:
        if len(chosen) == number:
            break
        if all(np.abs(place - other).max() > _SURFACE.apart for other in chosen):
            chosen.append(place)
    return np.array(chosen)


def _best_of_each_parameter(surface: GaussianProcess, response: int, sign: float, factor: float, x: Array) -> Array:
    """For each parameter, its value (d,) with the smallest optimistic response on a line through x (d,)."""
    values = np.linspace(-1, 1, LINE_POINTS)
    points = np.where(np.eye(len(x), dtype=bool)[:, None], values[:, None], x).reshape(-1, len(x))
    objective = sign * surface.mean(points)[:, response] - (factor * surface.deviation(points) if factor else 0.0)
    return values[objective.reshape(len(x), -1).argmin(axis=1)]


def _beside(places: Array, number: int) -> Array:
    """Points (n, d), one near each place (n, d). Runs there test whether the response is as flat as the surface.

    The directions depend on `number`, the number of the round.
    """
    directions = np.sign(quasi_random_points(number + len(places), places.shape[1])[number:])
    return np.clip(places + _SURFACE.slope_step * np.where(np.abs(places) < 1, directions, -np.sign(places)), -1.0, 1.0)


def _distinct(points: list[Array], known: Array) -> Array:
    """Points (N, d) that are not close to each other or to known points (M, d)."""
    distinct = known
    for x in points:
        if np.abs(distinct - x).max(axis=1).min() > 1e-3:
            distinct = np.concatenate([distinct, x[None]])
    return distinct[len(known) :]


def _polynomials(surface: Callable[[Array], Array], runs: OutputRuns, error: Array) -> Piecewise | None:
    """An interpolant of a surface (N, d) -> (N, n_t n_y) with an error (n_t, n_y); None if it is not accurate.

    Its error is measured at quasi-random points and at runs. A factor SAFETY allows for larger errors near jumps.
    """
    d = len(runs.box)
    # Degree 2 does not distinguish x^3 from x.
    grid, step = Grid(d), along_axes(d, 4)
    points = np.concatenate([quasi_random_points(4 * d, d), runs.attained()[0]])
    expected = surface(points)
    while True:
        grid.add(grid.missing(step))
        coefficients = grid.coefficients(surface(grid.nodes))
        expansion = Expansion(grid.alpha, coefficients.reshape(-1, *runs.shape), runs.box.names)
        errors = SAFETY * np.abs(expansion.values(points).reshape(expected.shape) - expected)
        widths = np.where(np.ptp(expected, axis=0) > 0, np.ptp(expected, axis=0), np.inf)
        if (errors / widths).max() <= DOUBTFUL:
            return Piecewise.whole(expansion, error + errors.max(axis=0).reshape(runs.shape))
        if len(grid.row) >= PATIENCE * d:
            return None
        sizes = extrapolated_sizes(grid, np.abs(coefficients / widths).max(axis=1))
        step = largest(sizes, len(grid.row) // 4)
