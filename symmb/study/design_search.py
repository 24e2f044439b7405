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
from symmb._names import ByName
from symmb._types import Array, Executor
from symmb._units import units_of_parameters
from symmb.bound.answers import Bounds, LimitCheck, Limits
from symmb.bound.methods import PolynomialChaos
from symmb.bound.nodes import Sobol, corners, fitted
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.propagation import Study, finished
from symmb.bound.reductions import bounded
from symmb.bound.responses import gathered, parameter_samples
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box
from symmb.study.tolerance_search import runs_of_check

COST, FAILED = -2, -1
"""Columns of the cost, and of failures: 1 if a run fails, and -1 otherwise. Polynomials have the distances from the
boundary of failed runs instead. Other columns are outputs."""
_WEIGHTS = {"upper": (0.0, 1.0), "lower": (-1.0, 0.0), "width": (-1.0, 1.0)}
"""Weights of the lowest and of the highest value in a goal."""
_LARGEST_FACTOR = 4.0
"""Largest factor of a tolerance with costs. The smallest factor is its inverse."""
_NUMBERS, _FEWEST, _ACCURATE, _ROUGH = (64, 128, 256), 8, 0.02, 0.25
"""Numbers of runs of the polynomials of a region; smallest number of runs that do not fail; and errors of polynomials,
divided by the standard deviation, that are small enough, and with which polynomials still show the optima roughly."""
_AGREES = 5e-3
"""Largest error of polynomials at the end of a search: of an objective divided by its value, and of a limited bound
divided by the width. A quarter of it is the smallest improvement that counts."""
_SMALLER, _SMALLEST, _STEPS, _STUDIES = 0.4, 0.01, 40, 4
"""Ratio of the sizes of consecutive regions, smallest size, and largest numbers of steps and of studies."""
_MARGIN, _PENALTY = 1e-3, 100.0
"""Margin of limits, which the search aims at, so that runs near a limit can decide it, divided by the changes of the
output in the region; and weight of a violated limit."""
_STARTS, _CANDIDATES, _APART, _NEAR = 3, 8, 0.2, 0.05
"""Numbers of designs from which searches start, and of their candidates, the smallest distance of candidates, and the
largest distance of equal designs."""
_BACK = 0.05, 0.4
"""First and last distance of designs from the boundary of failed runs, divided by the half widths of the region. If
runs of a design fail, the distance is doubled."""
_ROUNDS, _PEAKS, _CORNERS = 12, 3, 4
"""Number of optimisations with more worst cases; number of peaks of a curve that are worst cases; and largest number of
tolerances of designs that are also run at all corners."""


class Goal(NamedTuple):
    """A number that should be small: an upper bound, a negative lower bound, or a width, the largest over time.

    `k` is the number of the column. `most` is the limit, infinite for objectives, and `text` is its inequality.
    """

    k: int
    side: str
    most: float = np.inf
    text: str = ""


class Region(NamedTuple):
    """Designs between two ends (n,), the box of their parameters, its runs, their polynomials with an error, and sizes
    (n_c,) of changes."""

    low: Array
    high: Array
    joint: Box
    points: Array
    Y: Array
    surrogate: Piecewise
    error: float
    changes: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """A design, curves (n_g, n_t) of its goals by runs, their values (n_g,), which are infinite if runs fail, and sizes
    (n_g,) of which an error is a fraction."""

    u: Array
    curves: Array
    values: Array
    sizes: Array


@dataclass(frozen=True, eq=False)
class Verified(Trial):
    """A design with bounds by a study, the check of its limits, and a state: limits are satisfied (0), undecided (1) or
    violated (2)."""

    bounds: Bounds
    check: LimitCheck | None
    state: int


class _Worst(NamedTuple):
    """A worst case: numbers of the goal and of the time, and places (2, d) of the lowest and highest values in the
    tolerances."""

    goal: int
    row: int
    places: Array


def _is_near(u: Array, others: Sequence[Array], distance: float = _NEAR) -> bool:
    return any((np.abs(u - other) <= distance).all() for other in others)


class DesignSearch:
    """Designs u (n,) in the unit cube are values of the variables, and logarithms of the factors of tolerances.

    `limits` are those of outputs, and `held` are the goals of all limits.
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
        self.held, self._executor, self._progress = [*held, Goal(FAILED, "upper", 0.0)], executor, progress
        ends = {} if tolerances is None else dict(zip(tolerances.names, tolerances.bounds, strict=True))
        self.names = tuple(dict.fromkeys([*ranges, *(name for name, (low, high) in ends.items() if low < high)]))
        self._nominal = np.array([float(simulator.parameters[name]) for name in self.names])
        own = np.array([ends.get(name, (p, p)) for name, p in zip(self.names, self._nominal, strict=True)])
        self._below, self._above = np.abs(own.T - self._nominal)
        self._n_x, self._scaled = len(ranges), [self.names.index(name) for name in allocated]
        low, high = (np.append(end, self._nominal[self._n_x :]) for end in (ranges.lower, ranges.upper))
        with np.errstate(divide="ignore", invalid="ignore"):  # no interval of a mass or length may reach 0
            to_zero = np.where(low > 0, low / self._below, np.where(high < 0, -high / self._above, np.inf))
        most = np.log(np.clip(0.99 * to_zero[self._scaled], 1.0, _LARGEST_FACTOR))
        self._low = np.append(ranges.lower, np.full(len(most), -np.log(_LARGEST_FACTOR)))
        self._high = np.append(ranges.upper, most)
        self.evaluations, self.failure, self._regions = 0, "", list[Region]()
        self._failed_runs, self._good_runs = list[Array](), list[Array]()

    def parts(self, u: Array) -> tuple[Array, Array]:
        """Values (n_x,) of the variables, and factors (n_f,) of the tolerances with costs."""
        z = (1 - u) * self._low + u * self._high
        return z[: self._n_x], np.exp(z[self._n_x :])

    def _middle(self, u: Array) -> Array:
        """Nominal values (d,) of the parameters."""
        return np.append(self.parts(u)[0], self._nominal[self._n_x :])

    def _ends(self, u: Array) -> Array:
        """Ends (2, d) of the intervals of a design."""
        middle, factors = self._middle(u), np.ones(len(self.names))
        factors[self._scaled] = self.parts(u)[1]
        return np.array([middle - factors * self._below, middle + factors * self._above])

    def _box(self, ends: Array) -> Box:
        intervals = dict(zip(self.names, zip(*ends.tolist(), strict=True), strict=True))
        return Box(**intervals).with_units(units_of_parameters(self.simulator.parameters))

    def box(self, u: Array) -> Box:
        """The intervals of a design."""
        return self._box(self._ends(u))

    def _runs(self, box: Box, points: Array) -> Array:
        """Columns (N, n_t, n_c) of runs at points (N, d) of a box. Outputs of failed runs are nan."""
        Y, bad = gathered(self.simulator, parameter_samples(self.simulator, box, points), self._executor)
        self.evaluations += len(Y)
        more = np.tile([0.0, -1.0], (*Y.shape[:2], 1))
        more[[index for index, _, _ in bad], :, FAILED] = 1.0
        values, has_failed = box.from_unit(points), more[:, 0, FAILED] > 0
        self._failed_runs.append(values[has_failed])
        self._good_runs.append(values[~has_failed])
        if bad:
            self.failure = bad[0][2]
        return np.concatenate([Y, more], axis=2)

    def _region(self, centre: Array, size: float) -> Region:
        """A region about a design, or a smaller known one in which the design is not near an end."""
        for known in self._regions:
            quarter = (known.high - known.low) / 4
            is_low = (centre >= known.low + quarter) | (known.low <= 0)
            is_high = (centre <= known.high - quarter) | (known.high >= 1)
            if (4 * quarter <= 1.01 * size).all() and (is_low & is_high).all():
                return known
        centre = np.clip(centre, size / 2, 1 - size / 2)
        low, high = centre - size / 2, centre + size / 2
        narrow = np.append(low[: self._n_x], high[self._n_x :])
        joint = self._box(np.array([self._ends(narrow)[0], self._ends(high)[1]]))
        d, share = len(self.names), np.inf
        points, Y = np.zeros((0, d)), self._runs(joint, np.zeros((0, d)))
        for n in _NUMBERS:
            new, before = np.sin(np.pi / 2 * Sobol().points(n, d, seed=1)[len(points) :]), share
            points, Y = np.concatenate([points, new]), np.concatenate([Y, self._runs(joint, new)])
            ok = Y[:, 0, FAILED] < 0
            if ok.sum() < _FEWEST and n < _NUMBERS[-1]:
                continue
            if ok.sum() < _FEWEST:
                raise PropagationError(f"design: {(~ok).sum()} of {len(ok)} runs in the ranges fail: {self.failure}")
            known = Y.copy()
            if not ok.all():
                known[~ok, :, :FAILED] = fitted(points[ok], Y[ok], joint.names).values(points[~ok])[..., :FAILED]
                # Distances from the boundary between failed and other runs are smoother than 1 and -1.
                for some, others in ((ok, self._failed_runs), (~ok, self._good_runs)):
                    apart = points[some, None] - joint.to_unit(np.concatenate(others))
                    known[some, :, FAILED] *= np.linalg.norm(apart, axis=2).min(axis=1)[:, None]
            surrogate, outputs = fitted(points, known, joint.names), Y[ok][..., :COST]
            error, spread = np.square(surrogate.error[:, :COST]).mean(axis=0), outputs.var(axis=0).mean(axis=0)
            share = float(np.sqrt(error / np.maximum(spread, 1e-300)).max())
            if share <= _ACCURATE or share**2 > _ACCURATE * before:  # kinks: more runs would not help much
                break
        changes = outputs.max(axis=1).std(axis=0) + outputs.min(axis=1).std(axis=0)
        changes += 1e-9 * np.abs(outputs).max(axis=(0, 1)) + 1e-300
        changes = np.array([*changes, self._cost(self.parts(centre)[1]) or 1.0, 1.0])
        self._regions.append(Region(low, high, joint, points, Y, surrogate, share, changes))
        return self._regions[-1]

    def _curves(self, goals: Sequence[Goal], u: Array, extremes: Array) -> Array:
        """Curves (n_g, n_t) of goals from the lowest and highest values (2, n_t, n_c)."""
        extremes[..., COST] = [[0.0], [self._cost(self.parts(u)[1])]]
        return np.array([np.tensordot(_WEIGHTS[goal.side], extremes[..., goal.k], 1) for goal in goals])

    def _worst(
        self, region: Region, goals: Sequence[Goal], u: Array, shift: Array | float = 0.0
    ) -> tuple[Array, list[_Worst]]:
        """Curves (n_g, n_t) of goals by polynomials, shifted, and their worst cases at the highest peaks over time."""
        unit = np.clip(region.joint.to_unit(self._ends(u)), -1.0, 1.0)
        *found, places = region.surrogate.range(*unit)
        half, cases = (unit[1] - unit[0]) / 2, list[_Worst]()
        places = (places - unit.mean(axis=0)) / np.where(half > 0, half, np.inf)
        curves = self._curves(goals, u, np.array(found)) + shift
        for n, (goal, curve) in enumerate(zip(goals, curves, strict=True)):
            if n and goal.most == np.inf:
                continue
            beside = np.concatenate([[-np.inf], curve, [-np.inf]])
            peaks = np.flatnonzero((curve >= beside[:-2]) & (curve >= beside[2:]))
            rows = peaks[np.argsort(-curve[peaks], kind="stable")][: _PEAKS if goal.k >= 0 else 1].tolist()
            cases += [_Worst(n, row, places[:, row, goal.k]) for row in rows]
        return curves, cases

    def _trial(self, goals: Sequence[Goal], u: Array, extremes: Array) -> Trial:
        """A design from the lowest and highest values (2, n_t, n_c) of its runs."""
        curves = self._curves(goals, u, extremes)
        values = np.nan_to_num(curves.max(axis=1), nan=np.inf)
        widths = np.append(np.nan_to_num(np.ptp(extremes, axis=0).max(axis=0))[:FAILED], 1.0)
        sizes = [widths[goal.k] if goal.most < np.inf else np.inf for goal in goals]
        return Trial(u, curves, values, np.array([abs(values[0]), *sizes[1:]]))

    def _try(self, region: Region, goals: Sequence[Goal], u: Array) -> Trial:
        """A design with runs in its worst cases by the polynomials, and at the corners of its tolerances if few."""
        varies = np.ptp(self._ends(u), axis=0) > 0
        ends = corners(n) if 0 < (n := int(varies.sum())) <= _CORNERS else np.zeros((1, n))
        places = np.zeros((len(ends), len(varies)))
        places[:, varies] = ends
        worst = [place for case in self._worst(region, goals, u)[1] for place in case.places]
        Y = self._runs(self.box(u), np.unique(np.round([*worst, *places], 9), axis=0))
        return self._trial(goals, u, np.array([Y.min(axis=0), Y.max(axis=0)]))

    @staticmethod
    def _merit(region: Region, goals: Sequence[Goal], values: Array, margin: float = _MARGIN) -> float:
        """The scaled value of the first goal, with a penalty for violated limits."""
        scales = region.changes[[goal.k for goal in goals]]
        over = (values[1:] - [goal.most for goal in goals[1:]]) / scales[1:] + margin
        return float(values[0] / scales[0] + _PENALTY * max(over.max(), 0.0))

    def _optimum(
        self, region: Region, goals: Sequence[Goal], old: Trial | Array, margin: float = _MARGIN, back: float = _BACK[0]
    ) -> tuple[Array, Array]:
        """The best design by polynomials near an old one, and the values (n_g,) of its goals.

        The errors of the polynomials in an old trial are added. An optimisation considers a few worst cases. Those of
        its solution are added for the next one. `back` is the distance from the boundary of failed runs.
        """
        if isinstance(old, Trial):
            u, shift = old.u, np.nan_to_num(old.curves - self._worst(region, goals, old.u)[0])
        else:
            u, shift = old, np.zeros((len(goals), 1))
        shift[-1] = back
        u, cases, reach, expected = np.clip(u, region.low, region.high), list[_Worst](), 1.0, -np.inf
        best = (np.inf, u, np.empty(0))
        for _ in range(_ROUNDS):
            curves, new = self._worst(region, goals, u, shift)
            cases += new
            values = curves.max(axis=1)
            merit = self._merit(region, goals, values, margin)
            reach *= 1.0 if merit < best[0] else _SMALLER
            best = min(best, (merit, u, values), key=lambda each: each[0])
            if abs(best[0] - expected) < 1e-5 * (1 + abs(expected)):
                break
            u, expected = self._with_cases(region, goals, cases, shift + 0 * curves, best[1], margin, reach)
        return best[1:]

    def _with_cases(
        self,
        region: Region,
        goals: Sequence[Goal],
        cases: Sequence[_Worst],
        shift: Array,
        u: Array,
        margin: float,
        reach: float,
    ) -> tuple[Array, float]:
        """The best design within reach of a start if only these worst cases count, and its merit."""
        from scipy.optimize import minimize

        span, n, m = region.high - region.low, len(u), np.arange(len(cases))
        goal, row, places = (np.array(each) for each in zip(*cases, strict=True))
        columns, weights = np.array([each.k for each in goals])[goal], np.array([_WEIGHTS[g.side] for g in goals])[goal]
        scales, times, at = region.changes[columns], *np.unique(row, return_inverse=True)
        most = np.array([0.0, *(each.most for each in goals[1:])])[goal] - margin * scales * (goal > 0)
        few, slopes = region.surrogate.part(times, slice(None)), np.array([*np.zeros(n), 1.0, _PENALTY])

        def over(x: Array) -> Array:
            """Scaled values of the worst cases, without their limits."""
            u = region.low + span * x[:n]
            low, high = region.joint.to_unit(self._ends(u))
            points = ((low + high) / 2 + (high - low) / 2 * places).reshape(-1, len(low))
            Y = few.values(points).reshape(len(m), 2, len(times), -1)[m, :, at, columns]
            values = np.where(columns == COST, self._cost(self.parts(u)[1]), (weights * Y).sum(axis=1))
            return (values + shift[goal, row] - most) / scales

        def with_slacks(x: Array) -> Array:
            found = over(x)
            return np.array([*x, found[goal == 0].max(), found[goal > 0].max(initial=0.0)])

        x = (u - region.low) / span
        found = minimize(
            lambda x: slopes @ x,
            with_slacks(x),
            jac=lambda x: slopes,
            method="SLSQP",
            bounds=[(max(e - reach, 0.0), min(e + reach, 1.0)) for e in x] + [(None, None), (0.0, None)],
            constraints={"type": "ineq", "fun": lambda x: np.where(goal == 0, x[n], x[n + 1]) - over(x)},
            options={"ftol": 1e-9, "maxiter": 100, "eps": 1e-6},
        )
        x = np.clip(found.x[:n], 0.0, 1.0)
        return region.low + span * x, float(slopes @ with_slacks(x))

    def _gain(self, region: Region, goals: Sequence[Goal], old: Trial, values: Array) -> float:
        """How much better other values are than a trial, in smallest improvements of the objective that count."""
        before, after = (self._merit(region, goals, each) for each in (old.values, values))
        if not np.isfinite([before, after]).all():
            return np.inf if np.isfinite(after) else -np.inf
        return (before - after) * region.changes[goals[0].k] / max(old.sizes[0] * _AGREES / 4, 1e-300)

    def _descend(
        self, goals: Sequence[Goal], starts: Sequence[Array], size: float = 1.0, known: Sequence[Array] | None = None
    ) -> tuple[Trial, Region]:
        """The best design by runs, from the best start, and the last region. Regions follow the design and become
        smaller.

        The search ends early at a known design. If None are given, the start is a good design.
        """
        region, stalls, back = self._region(starts[0], size), 0, _BACK[0]
        trials = [self._try(region, goals, u) for u in starts]
        best = min(trials, key=lambda trial: self._merit(region, goals, trial.values))
        for _ in range(_STEPS):
            u, expected = self._optimum(region, goals, best, back=back)
            hope = self._gain(region, goals, best, expected)
            if hope > 0.1:
                trial = self._try(region, goals, u)
                gain = self._gain(region, goals, best, trial.values)
                best = trial if gain > 0 or np.isinf(best.values[0]) else best
                if gain > 1:
                    stalls, region, back = 0, self._region(best.u, size), _BACK[0]
                    continue
                if np.isinf(trial.values[0]) and back < _BACK[1]:
                    back *= 2
                    continue
            error = np.abs(best.values - self._worst(region, goals, best.u)[0].max(axis=1))
            is_exact = np.isfinite(best.values).all() and (error <= _AGREES * best.sizes).all()
            is_exact &= known is None or region.error <= _ACCURATE
            stalls += 1
            has_failed = (region.Y[:, 0, FAILED] > 0).any()  # smaller regions show where runs fail
            is_settled = (stalls > 2 or (is_exact and hope <= 1)) and not has_failed
            if is_settled or size <= _SMALLEST or _is_near(best.u, known or ()):
                break
            size, back = size * _SMALLER, _BACK[0]
            region = self._region(best.u, size)
        return best, region

    def search(self, objectives: Sequence[Goal], start: Array | None = None) -> tuple[Trial, Region]:
        """The best design by runs, and the last region.

        Without a start, the search starts at several of the best runs in the whole ranges. Regions are smaller if the
        polynomials of the whole ranges are not accurate.
        """
        goals = [*objectives, *self.held]
        if start is not None:
            return self._descend(goals, [start])
        n, low, high = len(self._low), self._low, self._high
        whole = self._region(np.full(n, 0.5), 1.0)
        z = np.zeros((len(whole.points), n))
        z[:, : self._n_x] = whole.joint.from_unit(whole.points)[:, : self._n_x]
        designs = np.clip((z - low) / (high - low), 0.0, 1.0)
        curves = [self._curves(goals, u, np.array([Y, Y])) for u, Y in zip(designs, whole.Y, strict=True)]
        order = np.argsort([self._merit(whole, goals, each.max(axis=1)) for each in curves], kind="stable")
        candidates, starts, ends = list[Array](), list[Array](), list[tuple[Trial, Region]]()
        for u in designs[order[whole.Y[order, 0, FAILED] < 0]]:
            if _is_near(u, candidates, _APART):
                continue
            candidates.append(u)
            both = [self._optimum(whole, goals, u)[0], u] if whole.error <= _ROUGH else [u]
            if _is_near(both[0], starts):
                continue
            starts.append(both[0])
            with suppress(PropagationError):  # too many runs fail near this start
                trials = [trial.u for trial, _ in ends]
                ends.append(self._descend(goals, both, 1.0 if whole.error <= _ACCURATE else _SMALLER, trials))
            if len(starts) == _STARTS or len(candidates) == _CANDIDATES:
                break
        ends = [end for end in ends if np.isfinite(end[0].values).all()]
        if not ends:
            raise PropagationError(f"design: in all designs that were tried, runs fail: {self.failure}")
        return min(ends, key=lambda end: self._merit(whole, goals, end[0].values))

    def _study(self, goals: Sequence[Goal], u: Array) -> Verified:
        """A design with bounds by a study, and the check of its limits."""
        box = self.box(u)
        bounds = bounded(PolynomialChaos(), self.simulator, box, executor=self._executor, progress=self._progress)
        nominal = dict(self.simulator.parameters) | dict(zip(self.names, self._middle(u).tolist(), strict=True))
        bounds = replace(bounds, study=Study(self.simulator, box), nominal_parameters=nominal, nominal=None)
        check = bounds.check(self._limits, runs=runs_of_check(bounds)) if self._limits else None
        self.evaluations += bounds.evaluations
        more = np.tile([0.0, 1.0 if bounds.failed else -1.0], (2, len(bounds.lower), 1))
        trial = self._trial(goals, u, np.concatenate([[bounds.lower, bounds.upper], more], axis=2))
        for limit in check.limits if check else ():  # the check also knows further runs, and values between times
            self.evaluations += limit.further.runs if limit.further else 0
            k = self.simulator.outputs.index(limit.output)
            own = [n for n, goal in enumerate(goals) if goal.k == k and goal in self.held]
            n = min(own, key=lambda n: goals[n].most - trial.values[n])
            excess = goals[n].most - float(limit.margin.min()) - trial.values[n]
            trial.values[n] += excess
            trial.curves[n] += excess
        is_over = (trial.values - [goal.most for goal in goals] > _AGREES * trial.sizes).any()
        state = 2 if is_over or (check and check.kept is False) else int(check is not None and not check.kept)
        return Verified(**vars(trial), bounds=bounds, check=check, state=state)

    def best(self, objectives: Sequence[Goal], start: Array | None = None) -> Verified:
        """The best design for the first objective that satisfies all limits, verified by a study.

        Another objective has a limit. Without a start, the search compares designs in the whole ranges.
        """
        goals, margin, verified = [*objectives, *self.held], _MARGIN, list[Verified]()
        trial, region = self.search(objectives, start)
        u, expected = trial.u, trial.values
        for _ in range(_STUDIES):
            verified.append(self._study(goals, u))
            best = min(verified, key=lambda each: (each.state, self._merit(region, goals, each.values, 0.0)))
            if best.state == 0 and (best.values - expected <= _AGREES * best.sizes).all():
                break
            margin *= 2 if best.state == 1 else 1
            u, expected = self._optimum(region, goals, best, margin)
        return best

    def finished(self, trial: Verified) -> Verified:
        """A verified design with the warnings about its bounds, and with its nominal run."""
        values = trial.bounds.nominal_parameters
        bounds = finished(PolynomialChaos(), self.simulator, trial.bounds, self._executor)
        nominal = gathered(self.simulator, np.array([[*values.values()]]), self._executor)[0][0]
        self.evaluations += 1
        known = ByName(values, units_of_parameters(self.simulator.parameters))
        return replace(trial, bounds=replace(bounds, nominal_parameters=known, nominal=nominal))
