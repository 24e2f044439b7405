"""The search for design variables with the best bounds of an objective. Studies verify designs.

Polynomials of all parameters replace the runs in a region of designs. The best design by the polynomials is run in its
worst cases. The next region is about the best design so far. It is smaller if the polynomials were not accurate.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Indices
from symmb.bound.bounds import Bounds, LimitCheck, PolynomialChaos, Study
from symmb.bound.nodes import corners
from symmb.study.design_space import COST, FAILED, WEIGHTS, DesignSpace, Goal, Region

AGREES = 5e-3
"""Largest error of polynomials at the end of a search: of an objective divided by its value, and of a limited bound
divided by the width."""
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
_PENALTY = 100.0
"""Weight of a violated limit."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A design, and the values (n_g,) of its goals, infinite if runs fail. Errors are divided by the sizes (n_g,).

    `places` (N, d) in the tolerances and `Y` (N, n_t, n_c) are its runs.
    """

    z: Array
    values: Array
    sizes: Array
    places: Array
    Y: Array


@dataclass(frozen=True, eq=False)
class Verified(Trial):
    """A design with bounds by a study, which are also `Y`, the check of its limits, and a state: limits are
    satisfied (0), undecided (1) or violated (2)."""

    bounds: Bounds
    check: LimitCheck | None
    state: int


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

    def closest(self, places: Array) -> Indices:
        """Indices (...) of the closest runs to places (..., d)."""
        return np.square(places[..., None, :] - self.places).sum(axis=-1).argmin(axis=-1)


class DesignSearch(DesignSpace):
    """The search for the best design."""

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
        values[..., FAILED] = 0.0
        return _Errors(trial.places, np.nan_to_num(values))

    @staticmethod
    def _merit(region: Region, goals: Sequence[Goal], values: Array, margin: float) -> float:
        """The scaled value of the first goal, with a penalty for violated limits."""
        scales = region.changes[[goal.k for goal in goals]]
        over = (values[1:] - [goal.most for goal in goals[1:]]) / scales[1:] + margin
        return float(values[0] / scales[0] + _PENALTY * max(over.max(), 0.0))

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
        weights, shift = np.array([WEIGHTS[goal.side] for goal in own]), np.zeros((len(cases), 2))
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
        if not np.isfinite([before, after]).all():  # another design with failed runs is farther from the boundary
            return np.inf if np.isinf(before) else -np.inf
        return (before - after) * region.changes[goals[0].k] / max(old.sizes[0], 1e-300)

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
        for n in order[whole.Y[order, 0, FAILED] < 0]:
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

    def _study(self, goals: Sequence[Goal], z: Array) -> Verified:
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
        return Verified(z, values, sizes, self._ends(z), extremes, bounds, check, state)

    def best(self, objectives: Sequence[Goal], start: Array | None = None) -> Verified:
        """The best design for the first objective that satisfies all limits, verified by a study.

        Another objective has a limit. Without a start, the search compares designs in the whole ranges.
        """
        goals = [*objectives, *self._held]
        trial, region = self.searched(objectives, start)
        z, expected, margin, verified = trial.z, trial.values, _MARGIN, list[Verified]()
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
