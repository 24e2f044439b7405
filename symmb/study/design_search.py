"""The search for design variables with the best bounds of an objective. Studies verify designs.

Polynomials of all parameters replace the runs in a region of designs. The best design by the polynomials is run in its
worst cases. The next region is about the best design so far. It is smaller if the polynomials were not accurate.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Executor, Mask
from symmb._units import units_of_parameters
from symmb.bound.bounds import Bounds, LimitCheck, Limits, PolynomialChaos, Study, fitted, gathered, parameter_samples
from symmb.bound.nodes import Sobol, corners
from symmb.bound.polynomials.ranges import Piecewise
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box

LARGEST_FACTOR = 4.0
"""Largest factor of a tolerance with costs. The smallest factor is its inverse."""
AGREES = 5e-3
"""Largest error of polynomials at the end of a search: of an objective divided by its value, and of a limited bound
divided by the width."""
_NUMBERS, _FEWEST, _ACCURATE = (64, 128, 256), 8, 0.02
"""Numbers of runs of the polynomials of a region, which increase until the error of the polynomials, divided by the
standard deviation, is small enough, and smallest number of runs that do not fail."""
_SMALLER, _SMALLEST, _MAX_REGIONS, _MAX_TRIALS = 0.4, 0.01, 12, 3
"""Ratio of the sizes of consecutive regions, smallest size divided by the ranges, largest number of regions, and of
designs that are run or verified with the same polynomials."""
_MARGIN = 2e-3
"""Margin of limits, which the search aims at, so that runs near a limit can decide it. It is divided by the changes of
the output in the region."""
_STARTS, _APART, _NEAR, _ROUNDS, _PEAKS = 3, 0.2, 0.05, 12, 3
"""Number of designs from which searches start, and their smallest distance divided by the ranges; largest distance of
a known design; number of optimisations with more worst cases, and of peaks of a curve that are added together."""
_CORNERS = 5
"""Up to this number of parameters, a design is also run at all corners of its box."""
_PENALTY, _EDGE = 100.0, 1e-3
"""Weight of a violated limit, and distance from an end that is no distance, in a region of size 1."""
_WEIGHTS = {"upper": (0.0, 1.0), "lower": (-1.0, 0.0), "width": (-1.0, 1.0)}
"""Weights of the lowest and of the highest value in a goal."""
COST, _FAILED = -2, -1
"""Numbers of the columns of the cost, and of failures: 1 if a run fails, and -1 otherwise."""


class Goal(NamedTuple):
    """A number that should be small: an upper bound, a negative lower bound, or a width, the largest over time.

    `k` is the number of the column. `most` is the limit; infinite for objectives.
    """

    k: int
    side: str
    most: float = np.inf


@dataclass(frozen=True, eq=False)
class Trial:
    """A design, and the values (n_g,) of its goals, infinite if runs fail. Errors are divided by the sizes (n_g,).

    `places` (N, d) in the tolerances and `Y` (N, n_t, n_c) are its runs. A verified design has bounds, the check of its limits, and a
    state: limits are satisfied (0), undecided (1) or violated (2).
    """

    z: Array
    values: Array
    sizes: Array
    places: Array
    Y: Array
    bounds: Bounds | None = None
    check: LimitCheck | None = None
    state: int = 0


class Region(NamedTuple):
    """Designs between two ends (n,), the box and runs of all their parameters, polynomials, and the sizes (n_c,) of
    output changes."""

    low: Array
    high: Array
    joint: Box
    points: Array
    Y: Array
    surrogate: Piecewise
    is_accurate: bool
    changes: Array


class _Worst(NamedTuple):
    """A worst case: number of the goal and of the time, and places (2, d) of the lowest and highest values in the
    tolerances."""

    goal: int
    row: int
    places: Array


class _Errors(NamedTuple):
    """Errors (N, n_t, n_c) of polynomials in runs at places (N, d) in the tolerances."""

    places: Array
    values: Array

    def closest(self, places: Array) -> Array:
        """Indices (...) of the closest runs to places (..., d)."""
        return np.square(places[..., None, :] - self.places).sum(axis=-1).argmin(axis=-1)


class DesignSearch:
    """Designs z (n,) are the values of the variables, followed by the logarithms of the factors of tolerances.

    Parameters are the variables, followed by the other parameters of the box. `limits` are those of outputs, and `held`
    are the goals of all limits. Columns (n_c,) are the outputs, the failed runs and the cost.
    """

    def __init__(
        self,
        simulator: Simulator,
        ranges: Box,
        tolerances: Box | None,
        allocated: Sequence[str],
        cost: Callable[[Array], float],
        limits: Limits,
        held: Sequence[Goal],
        executor: Executor | None,
        progress: Progress | None,
    ) -> None:
        self.simulator, self._limits, self._cost = simulator, limits, cost
        self._held, self._executor, self._progress = [*held, Goal(_FAILED, "upper", 0.0)], executor, progress
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
        self.evaluations, self.failure, self._regions = 0, "", list[Region]()

    def factors(self, z: Array) -> Array:
        """Factors (n_f,) of the tolerances with costs."""
        return np.exp(z[self._n_x :])

    def cost(self, z: Array) -> float:
        """Sum of the costs of the tolerances."""
        return self._cost(self.factors(z))

    def _middle(self, z: Array) -> Array:
        """Nominal values (d,) of the parameters."""
        return np.concatenate([z[: self._n_x], self._nominal[self._n_x :]])

    def _ends(self, z: Array) -> Array:
        """Ends (2, d) of the intervals of a design."""
        middle, factors = self._middle(z), np.ones(len(self.names))
        factors[self._scaled] = self.factors(z)
        return np.array([middle - factors * self._below, middle + factors * self._above])

    def _box(self, low: Array, high: Array) -> Box:
        ends = dict(zip(self.names, zip(low.tolist(), high.tolist(), strict=True), strict=True))
        return Box(**ends).with_units(units_of_parameters(self.simulator.parameters))

    def box(self, z: Array) -> Box:
        """The intervals of a design."""
        return self._box(*self._ends(z))

    def at_ends(self, z: Array, low: Array, high: Array) -> tuple[Mask, Mask]:
        """Masks (n,) of the parts of a design at the lower and at the upper ends."""
        near = _EDGE * (high - low)
        return z <= low + near, z >= high - near

    def _runs(self, box: Box, points: Array) -> Array:
        """Outputs and failures (N, n_t, n_y + 1) at points (N, d) of a box. Outputs of failed runs are nan."""
        Y, bad = gathered(self.simulator, parameter_samples(self.simulator, box, points), self._executor)
        self.evaluations += len(Y)
        failed = np.full((*Y.shape[:2], 1), -1.0)
        failed[[index for index, _, _ in bad]] = 1.0
        if bad:
            self.failure = bad[0][2]
        return np.concatenate([Y, failed], axis=2)

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
        narrow = np.concatenate([low[: self._n_x], high[self._n_x :]])
        joint = self._box(self._ends(narrow)[0], self._ends(high)[1])
        share, points, Y = np.inf, np.zeros((0, len(self.names))), self._runs(joint, np.zeros((0, len(self.names))))
        for n in _NUMBERS:
            new, before = Sobol().points(n, len(self.names), seed=1)[len(points) :], share
            new = np.sin(np.pi / 2 * new)
            points, Y = np.concatenate([points, new]), np.concatenate([Y, self._runs(joint, new)])
            ok = Y[:, 0, _FAILED] < 0
            if ok.sum() < _FEWEST:
                raise PropagationError(f"design: {(~ok).sum()} of {len(ok)} runs in the ranges fail: {self.failure}")
            known = Y.copy()
            if not ok.all():  # the boundary between failed and other runs is a polynomial, too
                known[~ok, :, :-1] = fitted(points[ok], Y[ok], joint.names).values(points[~ok])[..., :-1]
            surrogate, outputs = fitted(points, known, joint.names), Y[ok][..., :-1]
            error, spread = np.square(surrogate.error[:, :-1]).mean(axis=0), outputs.var(axis=0).mean(axis=0)
            share = float(np.sqrt(error / np.maximum(spread, 1e-300)).max())
            if share <= _ACCURATE or share > before / 2:  # kinks: more runs would not help much
                break
        sizes = outputs.max(axis=1).std(axis=0) + outputs.min(axis=1).std(axis=0)
        sizes += 1e-9 * np.abs(outputs).max(axis=(0, 1)) + 1e-300
        changes = np.array([*sizes, self.cost((low + high) / 2) or 1.0, 1.0])
        self._regions.append(Region(low, high, joint, points, Y, surrogate, share <= _ACCURATE, changes))
        return self._regions[-1]

    def curves(self, goals: Sequence[Goal], z: Array, extremes: Array) -> list[Array]:
        """The curves (n_t,) of goals from the lowest and highest values (2, n_t, n_c)."""
        cost = np.full(extremes.shape[1], self.cost(z))
        return [cost if g.k == COST else np.tensordot(_WEIGHTS[g.side], extremes[..., g.k], 1) for g in goals]

    def _worst(
        self, region: Region, goals: Sequence[Goal], z: Array, errors: _Errors | None = None
    ) -> tuple[Array, list[_Worst]]:
        """Values (n_g,) of goals by polynomials, and their worst cases at the highest peaks over time.

        The errors of the polynomials in the closest runs are added.
        """
        unit = region.joint.to_unit(self._ends(z))
        *found, places = region.surrogate.range(*np.clip(unit, -1.0, 1.0))
        half = (unit[1] - unit[0]) / 2
        places = (places - unit.mean(axis=0)) / np.where(half > 0, half, np.inf)
        if errors:
            found = found + np.take_along_axis(errors.values, errors.closest(places), axis=0)
        curves, cases = self.curves(goals, z, np.array(found)), list[_Worst]()
        for n, (goal, curve) in enumerate(zip(goals, curves, strict=True)):
            beside = np.concatenate([[-np.inf], curve, [-np.inf]])
            peaks = np.flatnonzero((curve >= beside[:-2]) & (curve >= beside[2:]))
            rows = peaks[np.argsort(-curve[peaks])][: _PEAKS if goal.k >= 0 else 1].tolist()
            cases += [_Worst(n, row, places[:, row, goal.k]) for row in rows]
        return np.max(curves, axis=1), cases

    def _tried(self, region: Region, goals: Sequence[Goal], z: Array) -> Trial:
        """A design with runs in its worst cases by the polynomials, and at corners if there are few."""
        d = len(self.names)
        places = [place for case in self._worst(region, goals, z)[1] for place in case.places]
        unit = np.unique(np.round([*places, *(corners(d) if d <= _CORNERS else np.zeros((1, d)))], 9), axis=0)
        Y = self._runs(self.box(z), unit)
        extremes = np.array([Y.min(axis=0), Y.max(axis=0)])
        values = np.nan_to_num(np.max(self.curves(goals, z, extremes), axis=1), nan=np.inf)
        return Trial(z, values, self._sizes(goals, values, extremes), unit, Y)

    def _sizes(self, goals: Sequence[Goal], values: Array, extremes: Array) -> Array:
        """Values of objectives, and widths of limited outputs (n_g,)."""
        widths = np.nan_to_num(np.ptp(extremes, axis=0).max(axis=0))
        is_width = [np.isfinite(goal.most) and goal.k != COST for goal in goals]
        return np.where(is_width, widths[[goal.k for goal in goals]], np.abs(values))

    def _errors(self, region: Region, trial: Trial) -> _Errors:
        """Errors of the polynomials in the runs of a trial."""
        values = trial.Y - region.surrogate.values(region.joint.to_unit(self.box(trial.z).from_unit(trial.places)))
        values[..., _FAILED] = 0.0
        return _Errors(trial.places, np.nan_to_num(values))

    @staticmethod
    def _merit(region: Region, goals: Sequence[Goal], values: Array, margin: float) -> float:
        """The scaled value of the first goal, with a penalty for violated limits."""
        scales = region.changes[[goal.k for goal in goals]]
        over = [(value - goal.most) / scale + margin for goal, value, scale in zip(goals, values, scales, strict=True)]
        return float(values[0] / scales[0] + _PENALTY * max(*over[1:], 0.0))

    def _optimum(
        self, region: Region, goals: Sequence[Goal], errors: _Errors | None, z: Array, margin: float = _MARGIN
    ) -> tuple[Array, Array]:
        """The best design by polynomials near a start, and the values (n_g,) of its goals.

        An optimisation considers a few worst cases. Those of its solution are added for the next one.
        """
        cases, best, reach, expected = list[_Worst](), (np.inf, z, np.empty(0)), 1.0, -np.inf
        for _ in range(_ROUNDS):
            values, new = self._worst(region, goals, z, errors)
            cases += new
            merit = self._merit(region, goals, values, margin)
            reach *= 1.0 if merit < best[0] else _SMALLER
            best = min(best, (merit, z, values), key=lambda each: each[0])
            if abs(best[0] - expected) < 1e-5 * (1 + abs(expected)):
                break
            z, expected = self._with_cases(region, goals, cases, errors, best[1], margin, reach)
        return best[1:]

    def _with_cases(
        self,
        region: Region,
        goals: Sequence[Goal],
        cases: Sequence[_Worst],
        errors: _Errors | None,
        z: Array,
        margin: float,
        reach: float,
    ) -> tuple[Array, float]:
        """The best design within reach of a start if only these worst cases count, and its merit."""
        from scipy.optimize import minimize

        span, n, m = region.high - region.low, len(z), np.arange(len(cases))
        own = [goals[case.goal] for case in cases]
        columns, is_cost = np.array([goal.k for goal in own]), np.array([goal.k == COST for goal in own])
        is_first = np.array([case.goal == 0 for case in cases])
        rows, at = np.unique([case.row for case in cases], return_inverse=True)
        few, places = region.surrogate.part(rows, slice(None)), np.array([case.places for case in cases])
        weights, shift = np.array([_WEIGHTS[goal.side] for goal in own]), np.zeros((len(cases), 2))
        if errors:
            shift = errors.values[errors.closest(places), rows[at][:, None], columns[:, None]]
        scales = region.changes[columns]
        most = np.where(is_first, 0.0, [g.most for g in own] - margin * scales)

        def values(x: Array) -> Array:
            """Scaled values (n_c,) of the cases, without the limits."""
            z = region.low + span * x[:n]
            low, high = region.joint.to_unit(self._ends(z))
            points = ((low + high) / 2 + (high - low) / 2 * places).reshape(-1, len(low))
            Y = few.values(points).reshape(len(m), 2, len(rows), -1)[m, :, at, columns]
            return (np.where(is_cost, self.cost(z), (weights * (Y + shift)).sum(axis=1)) - most) / scales

        def merit(x: Array) -> tuple[float, float]:
            found = values(x)
            return found[is_first].max(), found[~is_first].max(initial=0.0)

        u = np.clip((z - region.low) / span, 0.0, 1.0)
        slopes = np.array([*np.zeros(n), 1.0, _PENALTY])
        solution = minimize(
            lambda x: slopes @ x,
            np.array([*u, *merit(u)]),
            jac=lambda x: slopes,
            method="SLSQP",
            bounds=[(max(x - reach, 0.0), min(x + reach, 1.0)) for x in u] + [(None, None), (0.0, None)],
            constraints={"type": "ineq", "fun": lambda x: np.where(is_first, x[n], x[n + 1]) - values(x)},
            options={"ftol": 1e-9, "maxiter": 100, "eps": 1e-6},
        )
        u = np.clip(solution.x[:n], 0.0, 1.0)
        return region.low + span * u, float(slopes[n:] @ merit(u))

    def _descended(
        self, goals: Sequence[Goal], z: Array, size: float, known: Sequence[Trial] | None = None
    ) -> tuple[Trial, Region]:
        """The best design by runs, from a start, and the last region. Regions follow the design and become smaller.

        The search ends early at a known design. If None are given, the start is a good design.
        """
        region = self.region(z, size)
        best, is_small = self._tried(region, goals, z), False
        for _ in range(_MAX_REGIONS):
            first = best
            for _ in range(2 * _MAX_TRIALS):
                trial = self._tried(region, goals, self._optimum(region, goals, self._errors(region, best), best.z)[0])
                gain = self._gain(region, goals, best, trial)
                best = trial if gain > 0 else best
                if gain <= AGREES / 4:
                    break
            error = np.abs(best.values - self._worst(region, goals, best.z)[0])
            lower, upper = self.at_ends(best.z, region.low, region.high)
            is_edge = ((lower & (region.low > self.low)) | (upper & (region.high < self.high))).any()
            was_small, is_small = is_small, self._gain(region, goals, first, best) < AGREES / 4
            is_exact = (error <= AGREES * best.sizes).all() and np.isfinite(error).all()
            is_known = any((np.abs(best.z - other.z) <= _NEAR * (self.high - self.low)).all() for other in known or ())
            if (
                (is_exact and (known is None or region.is_accurate) and not is_edge)
                or size <= _SMALLEST
                or (is_small and was_small)
                or is_known
            ):
                break
            size *= 1 if is_edge and not is_small else _SMALLER
            region = self.region(best.z, size)
        return best, region

    def _gain(self, region: Region, goals: Sequence[Goal], old: Trial, new: Trial) -> float:
        """How much better a trial is than another, divided by the size of the objective."""
        before, after = (self._merit(region, goals, trial.values, _MARGIN) for trial in (old, new))
        return (before - after) * region.changes[goals[0].k] / old.sizes[0] if np.isfinite(after) else -np.inf

    def searched(self, objectives: Sequence[Goal], start: Array | None = None) -> tuple[Trial, Region]:
        """The best design by runs, and the last region.

        Without a start, the search starts at several of the best runs in the whole ranges. Regions are smaller if the
        polynomials of the whole ranges are not accurate.
        """
        goals = [*objectives, *self._held]
        if start is not None:
            return self._descended(goals, start, 1.0)
        whole, ranges = self.region((self.low + self.high) / 2, 1.0), self.high - self.low
        designs = np.zeros((len(whole.points), len(ranges)))
        designs[:, : self._n_x] = whole.joint.from_unit(whole.points)[:, : self._n_x]
        designs = np.clip(designs, self.low, self.high)
        values = [
            np.max(self.curves(goals, z, np.array([Y, Y])), axis=1) for z, Y in zip(designs, whole.Y, strict=True)
        ]
        order = np.argsort([self._merit(whole, goals, each, _MARGIN) for each in values])
        starts = [self._optimum(whole, goals, None, designs[order[0]])[0]]
        for n in order[whole.Y[order, 0, _FAILED] < 0]:
            if all((np.abs(designs[n] - other) > _APART * ranges).any() for other in starts):
                starts.append(designs[n])
        ends = list[tuple[Trial, Region]]()
        for z in starts[:_STARTS]:
            size = 1.0 if whole.is_accurate else _SMALLER
            with suppress(PropagationError):  # too many runs fail near this start
                ends.append(self._descended(goals, z, size, [trial for trial, _ in ends]))
        ends = [end for end in ends if np.isfinite(end[0].values).all()]
        if not ends:
            raise PropagationError(f"design: in all designs that were tried, runs fail: {self.failure}")
        return min(ends, key=lambda end: self._merit(whole, goals, end[0].values, _MARGIN))

    def _study(self, goals: Sequence[Goal], z: Array) -> Trial:
        """A design with bounds by a study, and the check of its limits."""
        box = self.box(z)
        bounds = PolynomialChaos().bounds(self.simulator, box, executor=self._executor, progress=self._progress)
        middle = dict(zip(self.names, self._middle(z).tolist(), strict=True))
        nominal = dict(self.simulator.parameters) | middle
        bounds = replace(bounds, study=Study(self.simulator, box), nominal_parameters=nominal, nominal=None)
        check = bounds.check(self._limits) if self._limits else None
        further = [limit.further.runs for limit in check.limits if limit.further] if check else []
        self.evaluations += bounds.evaluations + sum(further)
        failed = np.full((2, len(bounds.lower), 1), 1.0 if bounds.failed else -1.0)
        extremes = np.concatenate([[bounds.lower, bounds.upper], failed], axis=2)
        values = np.max(self.curves(goals, z, extremes), axis=1)
        for limit in check.limits if check else ():  # the check also knows further runs, and values between times
            k = self.simulator.outputs.index(limit.output)
            own = [n for n, goal in enumerate(goals) if goal.k == k and goal in self._held]
            n = min(own, key=lambda n: goals[n].most - values[n])
            values[n] = goals[n].most - float(limit.margin.min())
        sizes = self._sizes(goals, values, extremes)
        is_over = any(v - g.most > AGREES * size for g, v, size in zip(goals, values, sizes, strict=True))
        state = 2 if is_over or (check and check.kept is False) else int(check is not None and not check.kept)
        return Trial(z, values, sizes, self._ends(z), extremes, bounds, check, state)

    def best(self, objectives: Sequence[Goal], start: Array | None = None) -> Trial:
        """The best design for the first objective that satisfies all limits, verified by a study.

        Another objective has a limit. Without a start, the search compares designs in the whole ranges.
        """
        goals = [*objectives, *self._held]
        trial, region = self.searched(objectives, start)
        z, expected, margin, verified = trial.z, trial.values, _MARGIN, list[Trial]()
        for _ in range(_MAX_TRIALS + 1):
            verified.append(self._study(goals, z))
            best = min(verified, key=lambda each: (each.state, self._merit(region, goals, each.values, 0.0)))
            if best.state == 0 and (best.values - expected <= AGREES * best.sizes).all():
                break
            margin *= 2 if best.state == 1 else 1
            more = np.append(0.0, np.maximum(best.values - expected, 0.0)[1:])
            stricter = [goal._replace(most=goal.most - x) for goal, x in zip(goals, more, strict=True)]
            errors = self._errors(region, self._tried(region, goals, best.z))
            z, expected = self._optimum(region, stricter, errors, best.z, margin)
            expected += more
        return best
