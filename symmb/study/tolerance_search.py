"""The search for the largest or the cheapest tolerances with which outputs stay within their limits."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._types import Array, Executor, Mask
from symmb._units import typeset, units_of_parameters
from symmb.bound.answers import Bounds, LimitCheck
from symmb.bound.methods import PolynomialChaos, units_of
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.propagation import Extremes, Study, idle_parameters
from symmb.bound.reductions import bounded
from symmb.bound.responses import WorstCase, parameter_samples
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box

OWNER = "tolerances"
TOLERANCE = 1e-2
"""Tolerance of the studies. If bounds are closer to a limit than this, runs near the limit decide."""
SETTLED = 2e-3
"""A search ends if factors change by less than this fraction. A study uses a factor that is smaller than the expected
one by half of this fraction."""
LARGEST_FACTOR = 16.0
"""Largest factor that a search tries. If a search reaches this factor, the given box was far too small."""
MAX_STUDIES = 12
"""Largest number of studies. Two or three studies are usual; undecided limits need more."""
_WIDER, _NARROWER = 1.6, 0.25
"""Largest and smallest factor of an optimisation step. The polynomials must be accurate in the box with the largest
step."""
_FAULT = "Runs fail with larger tolerances: {}"
_FARTHER = 0.25, 0.8
"""Smallest and largest ratio of a factor to the next factor, while no run that violates a limit is known."""


@dataclass
class _Bracket:
    """State of the search along a ray of factors (d,).

    Attributes
    ----------
    along : (d,) array             factors of the parameters at point 1 of the ray
    most : float                   largest factor
    places : (n, d) array          points of the unit box with the worst runs so far
    low, high : float              factors of the largest valid study, and of the last study that is not valid
    reach, violation : float       factor at which runs reach a limit, and factor at which runs or a study violate it
    less : float                   relative distance of the next study from `reach`
    best : Bounds or None          bounds from the study at `low`
    undecided : tuple or None      factor and bounds of the first study that did not decide a limit
    why : str                      reason why the study at `high` is not valid; empty if runs show it
    fault : str                    why runs have no value at factors above `low`, as a sentence; empty if they reach a
                                   limit, or are not known
    """

    along: Array
    most: float
    places: Array
    low: float = 0.0
    high: float = np.inf
    reach: float = np.inf
    violation: float = np.inf
    less: float = SETTLED / 2
    best: Bounds | None = None
    undecided: tuple[float, Bounds] | None = None
    why: str = ""
    fault: str = ""


def runs_of_check(bounds: Bounds) -> int | None:
    """Number of runs of a check in a search. A limit that stays undecided costs a further study."""
    return None if bounds.study is None or bounds.study.has_lanes else 2 * bounds.evaluations


class Search:
    """Studies over boxes that are stretched about the nominal values, and runs at the worst points of these boxes."""

    def __init__(
        self,
        simulator: Simulator,
        shape: Box,
        limits: dict[str, tuple[float, float]],
        executor: Executor | None,
        progress: Progress | None,
    ) -> None:
        self._simulator, self._shape, self._executor, self._progress = simulator, shape, executor, progress
        self._limits, self._columns = limits, [tuple(simulator.outputs).index(name) for name in limits]
        self._low, self._high = np.array([*limits.values()]).T
        self._nominal = np.array([simulator.parameters[name] for name in shape.names], dtype=float)
        for name, p, (low, high) in zip(shape.names, self._nominal, shape.bounds, strict=True):
            if not low <= p <= high:
                raise DeclarationError(
                    f"{OWNER}: the nominal value {name} = {p:g} is outside of its interval from {low:g} to {high:g}."
                )
        closest = np.where(shape.lower >= 0, shape.lower, np.where(shape.upper <= 0, shape.upper, self._nominal))
        with np.errstate(divide="ignore", invalid="ignore"):
            to_zero = np.where(closest != self._nominal, self._nominal / (self._nominal - closest), np.inf)
        # At the factor `to_zero`, a parameter such as a mass or length would reach 0. The given box is always allowed.
        self._most = np.clip(0.99 * to_zero, 1.0, LARGEST_FACTOR)
        self.evaluations, self.remarks, self.narrow = 1, tuple[str, ...](), tuple[str, ...]()
        self._idle: Mask | None = None
        self._shift = np.zeros(len(limits))
        # Limits also apply between output times. Studies have values at output times only, single runs at all times.
        self._extremes = Extremes(simulator, [*limits], executor)
        nominal = np.array([[*map(float, simulator.parameters.values())]])
        run = simulator.run(nominal)
        if not run.ok.all():
            raise PropagationError(f"{OWNER}: the run at the nominal parameters fails: {run.messages[0]}.")
        lowest, highest = self._extremes(nominal)[:, 0]
        self._lowest, self._highest, self._at_nominal = lowest, highest, self._margins(lowest, highest)
        if self._at_nominal.min() <= 0:
            units = units_of(simulator) or ("",) * len(simulator.outputs)
            texts = []
            for k in np.flatnonzero(self._at_nominal <= 0).tolist():
                is_low = lowest[k] - self._low[k] <= 0
                value, limit = (lowest[k], self._low[k]) if is_low else (highest[k], self._high[k])
                unit = f" {typeset(units[self._columns[k]])}".rstrip()
                texts.append(f"the limit {limit:.6g}{unit} of {[*limits][k]}: {value:.6g}{unit}")
            raise PropagationError(
                f"{OWNER}: the nominal run violates or reaches {'; '.join(texts)}. "
                "The search needs a margin. Change the limit or the nominal values."
            )

    def _margins(self, lower: Array, upper: Array) -> Array:
        """Margins (..., n_l) of bounds (..., n_l) of outputs with limits."""
        above = np.subtract(self._high, upper, out=np.full(np.shape(upper), np.inf), where=self._high < np.inf)
        return np.minimum(lower - self._low, above)

    def _box(self, factors: Array) -> Box:
        factors = np.minimum(factors, self._most)  # otherwise rounding may change the sign of an end at 0
        low = self._nominal - factors * (self._nominal - self._shape.lower)
        high = self._nominal + factors * (self._shape.upper - self._nominal)
        ends = np.stack([low, high], axis=1).tolist()
        box = Box(**dict(zip(self._shape.names, map(tuple, ends), strict=True)))
        return box.with_units(units_of_parameters(self._simulator.parameters))

    def _study(self, factors: Array) -> Bounds:
        """Bounds over the box with these factors (d,). The bounds can make further runs."""
        box, simulator = self._box(factors), self._simulator
        bounds = bounded(
            PolynomialChaos(tolerance=TOLERANCE), simulator, box, executor=self._executor, progress=self._progress
        )
        self.evaluations += bounds.evaluations
        return replace(bounds, study=Study(simulator, box), nominal_parameters=dict(simulator.parameters))

    def _check(self, bounds: Bounds) -> LimitCheck:
        check = bounds.check(self._limits, runs=runs_of_check(bounds))
        self.evaluations += sum(limit.further.runs for limit in check.limits if limit.further)
        return check

    def _worst_places(self, bounds: Bounds, check: LimitCheck) -> Array:
        """Points (n, d) of the unit box: the run closest to each limit, and a failed run."""
        box = bounds.box
        assert box is not None
        places = [limit.further.place for limit in check.limits if limit.further]
        cases = [] if check.worst is None else [check.worst.parameters]
        for values in (*cases, *(dict(run.parameters) for run in bounds.failed[:1])):
            places.append(np.clip(box.to_unit(np.array([values[name] for name in box.names])), -1.0, 1.0))
        return np.array(places)

    def _margin(self, factors: Array, places: Array) -> float:
        """The smallest margin of runs at points (n, d) of a box, relative to the margin of the nominal run.

        The margin is -inf if a run fails, or if an event that must happen never happens.
        """
        P = parameter_samples(self._simulator, self._box(factors), places)
        self.evaluations += len(P)
        shares = self._margins(*self._extremes(P)) / self._at_nominal
        return float(np.where(np.isnan(shares), -np.inf, shares).min())

    def _met(self, ray: _Bracket) -> tuple[float, bool]:
        """The factor between `low` and `high` at which runs reach a limit, and whether runs fail at larger factors.

        If no run reaches a limit, the factor is `high`.

        The next factor follows by linear interpolation of margins, or by bisection. If one end of the interval is kept
        twice, the margin at this end is halved (Illinois method). If `high` is infinite, runs are made up to the
        largest factor.
        """
        along, places, low = ray.along, ray.places, ray.low
        inside, beyond = (self._margin(low * along, places) if low else 1.0), np.nan
        end = min(ray.high, ray.most)
        for s in [*(low * 2.0 ** np.arange(1, 5) if ray.high > end else []), end]:
            if s <= end and (beyond := self._margin(s * along, places)) < 0:
                end = s
                break
            low, inside = (s, beyond) if s < end else (low, inside)
        if not beyond < 0:
            return ray.high, False
        margin = np.nan
        # Largest number of factors with runs between two studies. More factors are needed only if runs fail.
        for _ in range(40):
            if end <= low * (1 + SETTLED / 4):
                break
            share = inside / (inside - beyond) if np.isfinite(beyond) and inside > 0 else 0.5
            s = low + min(max(share, 0.02), 0.98) * (end - low)
            before, margin = margin, self._margin(s * along, places)
            if margin >= 0:
                low, inside, beyond = s, margin, beyond / 2 if before >= 0 else beyond
            else:
                end, beyond, inside = s, margin, inside / 2 if before < 0 else inside
        return low, beyond == -np.inf

    def largest(self, along: Array) -> tuple[Array, Bounds]:
        """The largest factors (d,) along a ray for which the box satisfies the limits, and bounds over this box.

        A study and its check find the worst points of a box. Runs at these points of other boxes show the factor at
        which a limit is reached. The next study is over a slightly smaller box. Such studies follow until a check
        satisfies the limits.
        """
        ray = _Bracket(along, self._most_along(along), np.empty((0, len(self._shape))))
        s = min(1.0, ray.most)
        for _ in range(MAX_STUDIES):
            after = self._next(ray, s)
            if ray.best is not None and ray.undecided is not None:
                after = (ray.low + ray.high) / 2  # the largest decided factor is between them
            if ray.best is not None and (ray.low >= ray.most or after <= ray.low * (1 + SETTLED)):
                break
            if not after:
                raise PropagationError(f"{OWNER}: runs next to the nominal parameters fail. {ray.fault}".rstrip())
            s = after
        if ray.best is None and ray.undecided is not None:
            ray.low, ray.best = ray.undecided
        if ray.best is None:
            raise PropagationError(
                f"{OWNER}: no box that satisfies the limits was found in {MAX_STUDIES} studies. {ray.why}".rstrip()
            )
        undecided, violation = (ray.high if ray.why else min(ray.high, ray.reach)) / ray.low, ray.violation / ray.low
        self.remarks = ()
        if ray.low < ray.most and max(undecided, violation if violation < np.inf else 0.0) > 1 + 4 * SETTLED:
            why = ray.why or "the largest number of studies was reached."
            beyond = f" Runs reach a limit at {violation:.4g} times these tolerances." if violation < np.inf else ""
            where = f"At {undecided:.4g} times these tolerances the limits are undecided"
            if undecided == np.inf:
                where = "Larger tolerances may also satisfy the limits"
            self.remarks = (f"{where}: {why}{beyond}",)
        elif ray.fault and ray.low < ray.most:
            self.remarks = (ray.fault,)
        return np.minimum(ray.low * along, self._most), ray.best

    def idle(self, bounds: Bounds) -> Mask:
        """Mask (d,) of parameters that do not change outputs with limits in the box of these bounds."""
        assert bounds.box is not None
        names, runs = idle_parameters(self._simulator, bounds.box, bounds, self._columns, self._executor)
        self.evaluations += runs
        return np.isin(self._shape.names, names)

    def _most_along(self, along: Array) -> float:
        """The largest factor along a ray. Parameters without effect keep their sign, but do not end the search."""
        most = self._most if self._idle is None else np.where(self._idle, LARGEST_FACTOR, self._most)
        return float(np.min(most / along))

    def _next(self, ray: _Bracket, s: float) -> float:
        """The factor of the next study, after a study at the factor s. The bracket stores the results of this study."""
        try:
            bounds = self._study(s * ray.along)
            check = self._check(bounds)
        except PropagationError as error:  # too many runs fail
            lines = [line.strip() for line in str(error).splitlines()]
            ray.high, ray.why, ray.fault = s, lines[0], _FAULT.format(lines[-1])
            return (ray.low + s) / 2
        if self._idle is None:
            self._idle = self.idle(bounds)
            ray.most = self._most_along(ray.along)
        # Two studies may give the same place with different rounding. Equal places are merged, to save runs.
        ray.places = np.unique(np.concatenate([ray.places, self._worst_places(bounds, check)]).round(9), axis=0)
        if check.kept:
            if ray.best is None:  # runs now show how far limits are, so that larger boxes may be decided
                ray.high, ray.undecided, ray.why = np.inf, None, ""
            ray.low, ray.best = s, bounds
        else:
            ray.high, ray.why = s, "" if check.kept is False else (*bounds.doubts, _undecided(check))[0]
            ray.violation = s if check.kept is False else ray.violation
        if check.kept is None and not bounds.failed:
            # The margin is too small for a decision. A smaller box has a larger margin.
            ray.undecided = ray.undecided or (s, bounds)
            after, ray.less = s * (1 - ray.less), min(2 * ray.less, 0.5)
            return after
        ray.reach, is_failed = self._met(ray)
        ray.why = ray.why if is_failed or ray.reach == ray.high else ""
        if check.kept is not True:
            ray.fault = _FAULT.format(bounds.failed[0]) if is_failed and bounds.failed else ""
            if check.worst is not None and np.isinf(check.worst.value):
                ray.fault = f"With larger tolerances, {check.worst}."
        ray.violation = ray.violation if ray.why else min(ray.violation, ray.reach)
        if ray.reach == np.inf:
            # No run that violates a limit is known. The next factor is up to twice as far as linear margins allow.
            nominal = zip(check.limits, self._at_nominal, strict=True)
            left = min(float(limit.margin.min() / margin) for limit, margin in nominal)
            return min(s / np.clip(1 - 2 * left, *_FARTHER), ray.most)
        # Consecutive violated studies show that the known runs are not the worst runs. The next step back is larger.
        less, ray.less = (ray.less, 4 * ray.less) if check.kept is False else (SETTLED / 2, SETTLED / 2)
        return min(max(ray.reach * (1 - less), (ray.low + ray.reach) / 2), ray.most)

    def binding(self, bounds: Bounds, check: LimitCheck) -> WorstCase | None:
        """The run that is closest to a limit, relative to the margin of the nominal run."""
        left = dict[tuple[int, str], float]()
        for n, (limit, k) in enumerate(zip(check.limits, self._columns, strict=True)):
            if limit.low > -np.inf:
                left[n, "lower"] = (bounds.lower[:, k].min() - limit.low) / (self._lowest[n] - limit.low)
            if limit.high < np.inf:
                left[n, "upper"] = (limit.high - bounds.upper[:, k].max()) / (limit.high - self._highest[n])
            if limit.further and np.isfinite(limit.between):
                left[n, limit.further.side] = limit.margin.min() / self._at_nominal[n]
        n, side = min(left, key=lambda each: left[each])
        limit = check.limits[n]
        if side == bounds._side(limit) and (case := bounds._closest_to([limit])):
            return case
        return getattr(bounds.worst(limit.output), side)

    def signs(self, factors: Array, idle: Mask) -> tuple[str, ...]:
        """A sentence if a parameter with an effect would reach 0 with larger factors (d,); otherwise empty."""
        ends = (self._most < LARGEST_FACTOR) & (factors >= self._most * (1 - SETTLED)) & ~idle
        names = [name for name, is_end in zip(self._shape.names, ends, strict=True) if is_end]
        text = f"The search ends here, because with larger tolerances {', '.join(names)} would reach 0."
        return (text,) if names else ()

    def cheapest(self, cost: Callable[[Array], float]) -> tuple[Array, Bounds]:
        """The factors with the lowest cost, and bounds over their box.

        The search starts at the largest common factor. Further studies follow until the factors are inside a box with
        accurate polynomials. If polynomials are inaccurate, each step is verified, and the search ends if a step
        saves little. If no factors cost less than the common factor, the common factor is the result.
        """
        best = self.largest(np.ones(len(self._shape)))
        factors, remarks = best[0], self.remarks

        def try_factors() -> bool:
            """Whether these factors, or a multiple of them, satisfy the limits and cost less than the best so far."""
            nonlocal best, remarks
            before, found = cost(best[0]), self.largest(factors)
            if cost(found[0]) < before:
                best, remarks = found, self.remarks
            return cost(best[0]) < before * (1 - SETTLED)

        for _ in range(MAX_STUDIES):
            wide = np.minimum(_WIDER * factors, self._most)
            surrogate, is_good = self._polynomials(wide)
            names = ", ".join(self._limits)
            inaccurate = f"A cheaper box may exist: polynomials of {names} are inaccurate in a wider box."
            self.narrow = () if is_good else (inaccurate,)
            if surrogate is None:
                break
            self._shift = np.zeros(len(self._limits))
            if not is_good:  # the box with these factors satisfies the limits, and its margins must not be negative
                self._shift = np.maximum(-self._margins_on(surrogate, wide, factors).min(axis=0), 0.0)
            start = self._factor_on(surrogate, wide, factors) * factors
            factors = self._allocated(surrogate, wide, start, cost)
            is_inside = (factors < wide * (1 - SETTLED)) | (factors >= self._most * (1 - SETTLED))
            if is_good and (is_inside & (factors > start * _NARROWER * (1 + SETTLED))).all():
                break
            if not is_good:  # each step is verified
                if not try_factors():
                    break
                factors = best[0]
        if cost(factors) < cost(best[0]):
            try_factors()
        self.remarks = remarks
        return best

    def _polynomials(self, factors: Array) -> tuple[Piecewise | None, bool]:
        """The polynomials of the outputs with limits over a box, or None, and whether they are accurate."""
        with suppress(PropagationError):  # too many runs fail
            bounds = self._study(factors)
            own = bounds.surrogate and bounds.surrogate.part(slice(None), self._columns)
            return own, bounds.good_surrogate(self._columns) is not None
        return None, False

    def _margins_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> Array:
        """Margins (n_t, n_l) over a box with given factors, by polynomials for a box with the factors `wide` (d,)."""
        whole, part = self._box(wide), self._box(factors)
        low, high, _ = surrogate.range(whole.to_unit(part.lower), whole.to_unit(part.upper))
        return self._margins(low, high) + self._shift

    def _factor_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> float:
        """The largest multiple of the factors (d,), at most 1, for which the polynomials give nonnegative margins."""
        if self._margins_on(surrogate, wide, factors).min() >= 0:
            return 1.0
        low, high = 0.0, 1.0
        while high - low > SETTLED / 8 * high:
            middle = (low + high) / 2
            is_kept = self._margins_on(surrogate, wide, middle * factors).min() >= 0
            low, high = (middle, high) if is_kept else (low, middle)
        return low

    def _allocated(self, surrogate: Piecewise, wide: Array, start: Array, cost: Callable[[Array], float]) -> Array:
        """Factors with the lowest cost by polynomials; the search begins at the start factors.

        The search starts with few output times. Times at which a solution violates a limit are added.
        """
        from scipy.optimize import minimize

        scale = cost(start) or 1.0
        rows = {int(self._margins_on(surrogate, wide, start).min(axis=1).argmin())}
        factors = start
        # Largest number of optimisations for one study. Each one adds the time with the largest violation.
        for _ in range(12):
            few = surrogate.part(np.array(sorted(rows)), range(len(self._low)))

            def margins_of(z: Array, few: Piecewise = few) -> Array:
                return (self._margins_on(few, wide, start * np.exp(z)) / self._at_nominal).ravel()

            solution = minimize(
                lambda z: cost(start * np.exp(z)) / scale,
                np.zeros(len(start)),
                method="SLSQP",
                bounds=[(np.log(_NARROWER), w) for w in np.log(wide / start)],
                constraints={"type": "ineq", "fun": margins_of},
                options={"ftol": 1e-7, "maxiter": 60},
            )
            factors = start * np.exp(np.asarray(solution.x, dtype=float))
            margins = (self._margins_on(surrogate, wide, factors) / self._at_nominal).min(axis=1)
            broken = int(margins.argmin())
            if margins[broken] >= -SETTLED / 10 or broken in rows:
                break
            rows.add(broken)
        factors = factors * self._factor_on(surrogate, wide, factors)
        return factors if cost(factors) < cost(start) else start


def _undecided(check: LimitCheck) -> str:
    """The reason why the first undecided limit of a check is undecided."""
    return next(limit.why for limit in check.limits if limit.kept is None)
