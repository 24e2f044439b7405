"""The search for design variables with the best bounds, on polynomials of all parameters. Studies verify designs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symmb._types import Array, Executor, Mask
from symmb._units import units_of_parameters
from symmb.bound.bounds import Bounds, LimitCheck, Limits, PolynomialChaos, Study, fitted, gathered, parameter_samples
from symmb.bound.nodes import Sobol, corners
from symmb.bound.polynomials.ranges import Piecewise
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box

LARGEST_FACTOR = 4.0
"""Largest factor of a tolerance with costs. The smallest factor is its inverse."""
_FEWEST_RUNS, _MOST_RUNS, _ACCURATE = 64, 256, 0.02
"""Numbers of runs of the first and the last polynomials of a region. The number is doubled until the error of the
polynomials, divided by the standard deviation, is small enough."""
AGREES = 5e-3
"""Largest difference between polynomials and the study of a design at the end of a search: of an objective divided by
its value, and of a limited bound divided by the width."""
_NEAR = 16.0
"""If a smaller region gives no better design, polynomials may have this multiple of the difference."""
_SMALLER, _SMALLEST, _MAX_REGIONS, _MAX_TRIALS = 0.4, 0.02, 10, 3
"""Ratio of the sizes of consecutive regions, smallest size divided by the ranges, largest number of regions, and of
designs that are verified in a region."""
_MARGIN = 2e-3
"""Margin of limits divided by the width, which the search aims at, so that runs near a limit can decide it."""
_SCREENED, _STARTS, _ROUNDS, _PEAKS = 16, 3, 12, 3
"""Number of designs that are compared, of designs from which optimisations start, of optimisations with more worst
cases, and of peaks of a curve that are added together."""
_CORNERS = 5
"""Up to this number of parameters, a design is also run at all corners of its box."""
_PENALTY, _STEP, _EDGE = 100.0, 1e-6, 1e-3
"""Weight of a violated limit; step of differences, and distance from an end that is no distance, in a region of size
1."""


class Goal(NamedTuple):
    """A number that should be small: an upper bound, a negative lower bound, or a width, the largest over time.

    `k` is the number of the output, or -1 for the cost of the tolerances. `most` is the limit; infinite for objectives.
    """

    k: int
    side: str
    most: float = np.inf

    def of(self, low: Array, high: Array) -> Array:
        """The number (..., n_t) from the lowest and highest values (..., n_t, n_y)."""
        own = {"upper": high, "lower": -low, "width": high - low}[self.side]
        return own[..., self.k]


@dataclass(frozen=True, eq=False)
class Trial:
    """A design, and the values (n_g,) of its goals by runs or a study. Differences are divided by the sizes (n_g,).

    `order` compares trials: first whether limits are satisfied (0), undecided (1) or violated (2), then by how much
    they are exceeded, then the objective.
    """

    z: Array
    values: Array
    sizes: Array
    order: tuple[int, float, float]


@dataclass(frozen=True, eq=False)
class Verified(Trial):
    """A design with bounds by a study, and the check of its limits."""

    bounds: Bounds
    check: LimitCheck | None


class Region(NamedTuple):
    """Designs between two ends (n,), polynomials over all their parameters, and the sizes (n_y,) of output changes."""

    low: Array
    high: Array
    joint: Box
    surrogate: Piecewise
    changes: Array


class _Worst(NamedTuple):
    """Worst cases of goals: number of the goal and of the time, and places (d,) of the lowest and highest values in
    the tolerances."""

    goal: int
    row: int
    low: Array
    high: Array


class _Optimum(NamedTuple):
    """A design, the values and errors (n_g,) of goals by polynomials, and their worst cases."""

    z: Array
    values: Array
    errors: Array
    cases: list[_Worst]


class DesignSearch:
    """Designs z (n,) are the values of the variables, followed by the logarithms of the factors of tolerances.

    Parameters are the variables, followed by the other parameters of the box. Limits are those of outputs. The first
    goal is the objective.
    """

    def __init__(
        self,
        simulator: Simulator,
        ranges: Box,
        tolerances: Box | None,
        allocated: Sequence[str],
        cost: Callable[[Array], float],
        limits: Limits,
        executor: Executor | None,
        progress: Progress | None,
    ) -> None:
        self.simulator, self._limits, self._cost = simulator, limits, cost
        self._executor, self._progress = executor, progress
        ends = {} if tolerances is None else dict(zip(tolerances.names, tolerances.bounds, strict=True))
        self.names = tuple(dict.fromkeys([*ranges, *(name for name, (low, high) in ends.items() if low < high)]))
        self._nominal = np.array([float(simulator.parameters[name]) for name in self.names])
        own = np.array([ends.get(name, (p, p)) for name, p in zip(self.names, self._nominal, strict=True)])
        self._below, self._above = np.abs(own.T - self._nominal)
        self._n_x, self._scaled = len(ranges), [self.names.index(name) for name in allocated]
        lowest, highest = self._nominal.copy(), self._nominal.copy()
        lowest[: self._n_x], highest[: self._n_x] = ranges.lower, ranges.upper
        with np.errstate(divide="ignore", invalid="ignore"):  # no interval of a mass or length may reach 0
            to_zero = np.where(lowest > 0, lowest / self._below, np.where(highest < 0, -highest / self._above, np.inf))
        most = np.log(np.clip(0.99 * to_zero[self._scaled], 1.0, LARGEST_FACTOR))
        self.low = np.concatenate([ranges.lower, np.full(len(most), -np.log(LARGEST_FACTOR))])
        self.high = np.concatenate([ranges.upper, most])
        self.evaluations, self._regions = 0, list[Region]()

    def factors(self, z: Array) -> Array:
        """Factors (..., n_f) of the tolerances with costs."""
        return np.exp(z[..., self._n_x :])

    def cost(self, z: Array) -> float:
        """Sum of the costs of the tolerances."""
        return self._cost(self.factors(z))

    def box(self, z: Array) -> Box:
        """The intervals of a design."""
        return self._box(*self._ends(z))

    def middle(self, z: Array) -> Array:
        """Nominal values (..., d) of the parameters."""
        middle = np.tile(self._nominal, (*z.shape[:-1], 1)).reshape(*z.shape[:-1], -1)
        middle[..., : self._n_x] = z[..., : self._n_x]
        return middle

    def _ends(self, z: Array) -> tuple[Array, Array]:
        """Ends (..., d) of the intervals of designs (..., n)."""
        middle = self.middle(z)
        factors = np.ones_like(middle)
        factors[..., self._scaled] = self.factors(z)
        return middle - factors * self._below, middle + factors * self._above

    def _box(self, low: Array, high: Array) -> Box:
        ends = dict(zip(self.names, zip(low.tolist(), high.tolist(), strict=True), strict=True))
        return Box(**ends).with_units(units_of_parameters(self.simulator.parameters))

    def at_ends(self, z: Array, low: Array, high: Array) -> tuple[Mask, Mask]:
        """Masks (n,) of the parts of a design at the lower and at the upper ends."""
        near = _EDGE * (high - low)
        return z <= low + near, z >= high - near

    def region(self, centre: Array, size: float) -> Region:
        """A region about a design, or a smaller known one. The size is a fraction of the ranges."""
        half = size * (self.high - self.low) / 2
        for known in self._regions:
            fits = (known.high - known.low <= 2.01 * half).all()
            quarter = (known.high - known.low) / 4
            is_low = (centre >= known.low + quarter) | (known.low <= self.low)
            if fits and (is_low & ((centre <= known.high - quarter) | (known.high >= self.high))).all():
                return known
        centre = np.clip(centre, self.low + half, self.high - half)
        low, high = centre - half, centre + half
        narrow, wide = self._ends(np.concatenate([low[: self._n_x], high[self._n_x :]])), self._ends(high)
        joint, n = self._box(narrow[0], wide[1]), _FEWEST_RUNS
        study, before = Study(self.simulator, joint), np.inf
        while True:
            points, Y = study.sample(n)
            surrogate = fitted(points, Y, joint.names)
            error, spread = np.square(surrogate.error).mean(axis=0), Y.var(axis=0).mean(axis=0)
            share = float(np.sqrt(error / np.maximum(spread, 1e-300)).max())
            if n >= _MOST_RUNS or share <= _ACCURATE or share > before / 2:  # kinks: more runs would not help much
                break
            before, n = share, 2 * n
        self.evaluations += n
        changes = Y.max(axis=1).std(axis=0) + Y.min(axis=1).std(axis=0) + 1e-9 * np.abs(Y).max(axis=(0, 1)) + 1e-300
        self._regions.append(Region(low, high, joint, surrogate, changes))
        return self._regions[-1]

    def _tried(self, z: Array, goals: Sequence[Goal], cases: Sequence[_Worst]) -> Trial:
        """A design with runs in its worst cases by the polynomials, and at corners if there are few."""
        d = len(self.names)
        places = [place for case in cases for place in (case.low, case.high)]
        places = np.unique(np.round([*places, *(corners(d) if d <= _CORNERS else np.zeros((1, d)))], 9), axis=0)
        Y, _ = gathered(self.simulator, parameter_samples(self.simulator, self.box(z), places), self._executor)
        self.evaluations += len(Y)
        return self._rated(z, goals, Y.min(axis=0), Y.max(axis=0))

    def _study(self, z: Array, goals: Sequence[Goal]) -> Verified:
        """A design with bounds by a study, and the check of its limits."""
        box = self.box(z)
        bounds = PolynomialChaos().bounds(self.simulator, box, executor=self._executor, progress=self._progress)
        nominal = dict(self.simulator.parameters) | dict(zip(self.names, self.middle(z).tolist(), strict=True))
        bounds = replace(bounds, study=Study(self.simulator, box), nominal_parameters=nominal, nominal=None)
        check = bounds.check(self._limits) if self._limits else None
        further = [limit.further.runs for limit in check.limits if limit.further] if check else []
        self.evaluations += bounds.evaluations + sum(further)
        rated = self._rated(z, goals, bounds.lower, bounds.upper, check)
        return Verified(z, rated.values, rated.sizes, rated.order, bounds, check)

    def _rated(
        self, z: Array, goals: Sequence[Goal], low: Array, high: Array, check: LimitCheck | None = None
    ) -> Trial:
        """A design with the lowest and highest values (n_t, n_y), which are nan if a run failed."""
        values = self.values(z, goals, low, high)
        if np.isnan(values).any():
            return Trial(z, np.full(len(goals), np.inf), np.zeros(len(goals)), (2, np.inf, np.inf))
        widths = (high - low).max(axis=0)
        most = np.array([goal.most for goal in goals])
        is_limit = np.isfinite(most)
        sizes = np.array([widths[g.k] if g.k >= 0 else abs(v) for g, v in zip(goals, values, strict=True)])
        sizes = np.where(is_limit, sizes, np.abs(values))
        for limit in check.limits if check else ():  # the check also knows further runs, and values between times
            own = [n for n, g in enumerate(goals) if is_limit[n] and self.simulator.outputs[g.k] == limit.output]
            nearest = min((n for n in own if goals[n].k >= 0), key=lambda n: most[n] - values[n])
            values[nearest] = most[nearest] - float(limit.margin.min())
        excess = float(((values - most)[is_limit] / np.maximum(sizes[is_limit], 1e-300)).max(initial=0.0))
        undecided = check is not None and not check.kept
        state = 2 if excess > AGREES or (check and check.kept is False) else int(undecided)
        return Trial(z, values, sizes, (state, excess if state == 2 else 0.0, float(values[0])))

    def values(self, z: Array, goals: Sequence[Goal], low: Array, high: Array) -> Array:
        """Values (n_g,) of goals from bounds (n_t, n_y)."""
        return np.array([self.cost(z) if g.k < 0 else g.of(low, high).max() for g in goals])

    def best(self, goals: Sequence[Goal], start: Array | None = None) -> Verified:
        """The best design for the first goal that satisfies the limits of the other goals, verified by a study.

        Without a start, the search compares designs in the whole ranges.
        """
        found, region = self.searched(goals, start)
        best, margin, expected = self._study(found.z, goals), _MARGIN, found.values
        for _ in range(_MAX_TRIALS):
            if best.order[0] == 0 and (best.values - expected <= AGREES * best.sizes).all():
                break
            margin *= 2 if best.order[0] == 1 else 1
            error = best.values - self._worst(region, best.z, goals)[0]
            again = self._study(self._optima(region, goals, error, margin, best.z)[0].z, goals)
            best, expected = min([best, again], key=lambda trial: trial.order), again.values
        return best

    def searched(self, goals: Sequence[Goal], start: Array | None = None) -> tuple[Trial, Region]:
        """The best design by runs in its worst cases, and the region of the last polynomials."""
        size, best, found = 1.0, None, None
        region = self.region((self.low + self.high) / 2, size)
        for _ in range(_MAX_REGIONS):
            shift, before = np.zeros(len(goals)), best
            for _ in range(_MAX_TRIALS):
                optima = self._optima(region, goals, shift, _MARGIN, start if best is None else best.z)
                tried = [(self._tried(optimum.z, goals, optimum.cases), optimum) for optimum in optima]
                trial, found = min(tried, key=lambda pair: pair[0].order)
                best = trial if best is None or trial.order < best.order else best
                error, near = trial.values - found.values, AGREES * trial.sizes
                agrees, settled = (np.fmax(np.abs(error), found.errors) <= near).all(), np.abs(error - shift) <= near
                shift = error
                if np.isinf(error).any() or (settled.all() and trial.order[0] == 0):
                    break
            assert best is not None and found is not None
            lower, upper = self.at_ends(found.z, region.low, region.high)
            is_edge = ((lower & (region.low > self.low)) | (upper & (region.high < self.high))).any()
            gain = np.inf if before is None or before.order[0] else before.values[0] - best.values[0]
            is_near = (np.fmax(np.abs(error), found.errors) <= _NEAR * near).all()
            is_last = agrees and not is_edge
            if size <= _SMALLEST or is_last or (is_near and size < 1 and gain < AGREES / 2 * best.sizes[0]):
                break
            size *= 1 if agrees else _SMALLER
            region = self.region(best.z, size)
        assert best is not None
        return best, region

    def _optima(
        self, region: Region, goals: Sequence[Goal], shift: Array, margin: float, start: Array | None
    ) -> list[_Optimum]:
        """The best designs by the polynomials of a region, near the start, or else near several promising designs.

        The shift (n_g,) is added to the values of the goals.
        """
        scales = np.array([region.changes[g.k] if g.k >= 0 else self.cost(region.low) for g in goals])
        most = np.array([goal.most for goal in goals])
        most[1:] -= margin * scales[1:]
        offset = shift - np.where(np.isfinite(most), most, 0.0)

        def merit(values: Array) -> float:
            over = (values + shift - most)[1:] / scales[1:]
            return float((values + shift)[0] / scales[0] + _PENALTY * max(over.max(initial=0.0), 0.0))

        half = (region.high - region.low) / 2
        starts = [np.clip(start, region.low, region.high)] if start is not None else []
        if not starts:
            z = region.low + half * (1 + Sobol().points(_SCREENED, len(half), seed=1))
            starts = sorted(z, key=lambda each: merit(self._worst(region, each, goals)[0]))[:_STARTS]
        optima = list[_Optimum]()
        for z in starts:
            found, all_cases = list[tuple[float, Array, Array, list[_Worst]]](), list[_Worst]()
            for _ in range(_ROUNDS):
                values, cases = self._worst(region, z, goals)
                found.append((merit(values), z, values, cases))
                all_cases += cases
                z, expected = self._with_cases(region, z, goals, all_cases, offset, scales)
                if found[-1][0] - expected < 1e-5 * (1 + abs(expected)) and len(found) > 1:
                    break
            _, z, values, cases = min(found, key=lambda each: each[0])
            if any((np.abs(z - other.z) <= _EDGE * (region.high - region.low)).all() for other in optima):
                continue
            errors = np.zeros(len(goals))
            for case in cases:
                errors[case.goal] = max(errors[case.goal], region.surrogate.error[case.row, goals[case.goal].k])
            optima.append(_Optimum(z, values, errors, cases))
        return optima

    def _worst(self, region: Region, z: Array, goals: Sequence[Goal]) -> tuple[Array, list[_Worst]]:
        """Values (n_g,) of goals by polynomials, and their worst cases at the highest peaks over time."""
        ends = np.array(self._ends(z))
        low, high, places = region.surrogate.range(*np.clip(region.joint.to_unit(ends), -1.0, 1.0))
        unit = region.joint.to_unit(ends)
        half = (unit[1] - unit[0]) / 2
        places = (places - unit.mean(axis=0)) / np.where(half > 0, half, np.inf)
        cases = list[_Worst]()
        for n, goal in enumerate(goals):
            if goal.k < 0:
                continue
            curve = goal.of(low, high)
            beside = np.concatenate([[-np.inf], curve, [-np.inf]])
            peaks = np.flatnonzero((curve >= beside[:-2]) & (curve >= beside[2:]))
            for row in peaks[np.argsort(-curve[peaks])][:_PEAKS].tolist():
                cases.append(_Worst(n, row, *places[:, row, goal.k]))
        return self.values(z, goals, low, high), cases

    def _with_cases(
        self, region: Region, start: Array, goals: Sequence[Goal], cases: Sequence[_Worst], shift: Array, scales: Array
    ) -> tuple[Array, float]:
        """The best design if only these worst cases count, and its merit. Limits are subtracted in the shift (n_g,)."""
        from scipy.optimize import minimize

        span, n = region.high - region.low, len(start)
        rows, at = np.unique(np.array([case.row for case in cases], dtype=int), return_inverse=True)
        few = region.surrogate.part(rows, slice(None))
        places = np.array([[case.low, case.high] for case in cases], dtype=float).reshape(-1, 2, len(self.names))
        of_cost = [k for k, goal in enumerate(goals) if goal.k < 0]
        numbers = np.array([case.goal for case in cases] + of_cost, dtype=int)

        def values(U: Array) -> Array:
            """Scaled values (N, n_c) at designs (N, n) of the region in [0, 1]^n."""
            Z = region.low + span * U
            low, high = (region.joint.to_unit(ends) for ends in self._ends(Z))
            points = ((low + high) / 2)[:, None, None] + ((high - low) / 2)[:, None, None] * places
            Y = few.values(points.reshape(-1, len(self.names))).reshape(
                *points.shape[:3], len(rows), len(self.simulator.outputs)
            )
            own = [goals[c.goal].of(Y[:, i, 0, at[i]], Y[:, i, 1, at[i]]) for i, c in enumerate(cases)]
            own += [np.array([self.cost(z) for z in Z]) for _ in of_cost]
            return (np.array(own).T + shift[numbers]) / scales[numbers]

        def slopes(x: Array) -> Array:
            steps = np.where(x[:n] > 0.5, -_STEP, _STEP)
            all_ = values(np.concatenate([x[None, :n], x[:n] + np.diag(steps)]))
            return np.concatenate([-(all_[1:] - all_[0]) / steps[:, None], is_objective[None], ~is_objective[None]]).T

        is_objective = numbers == 0
        u = np.clip((start - region.low) / span, 0.0, 1.0)
        first = values(u[None])[0]
        x = np.concatenate([u, [first[is_objective].max()], [max(first[~is_objective].max(initial=0.0), 0.0)]])
        weights = np.concatenate([np.zeros(n), [1.0, _PENALTY]])
        solution = minimize(
            lambda x: float(weights @ x),
            x,
            jac=lambda x: weights,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * n + [(None, None), (0.0, None)],
            constraints={
                "type": "ineq",
                "fun": lambda x: np.where(is_objective, x[n], x[n + 1]) - values(x[None, :n])[0],
                "jac": slopes,
            },
            options={"ftol": 1e-9, "maxiter": 100},
        )
        u = np.clip(solution.x[:n], 0.0, 1.0)
        last = values(u[None])[0]
        expected = last[is_objective].max() + _PENALTY * max(last[~is_objective].max(initial=0.0), 0.0)
        return region.low + span * u, float(expected)
