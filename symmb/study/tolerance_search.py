"""The search for the largest factors of tolerances, or the cheapest ones, that keep limits of outputs."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._types import Array, Executor
from symmb.black_boxes import Progress, Simulator
from symmb.bounds import Bounds, PolynomialChaos
from symmb.model import Box
from symmb.polynomials.ranges import Piecewise

OWNER = "tolerances"
TOLERANCES = 1e-2, 1e-3
"""Tolerance of the first study and of the others: the error of a factor is about as large."""
_SETTLED = 2e-3
"""Change of the factors over them at which a search ends."""
MOST = 16.0
"""Largest factor that is looked for: the box that is given is meant to be of the right size."""
_OF_SIGN = 0.99
"""The same over that at which a parameter would reach 0, such as a mass or a length, if its interval has one sign."""
_STUDIES = 16
"""Most studies: three are usual, more where polynomials are not good."""
_BEYOND, _FAR = 1.05, 1.5
"""How far beyond the factor on a line the next study is, and beyond one that keeps the limits against such a line."""
_WIDER, _NARROWER = 1.6, 0.25
"""Factors that an allocation may change at once, on the polynomials of a study over the wider box."""
_AGREE = 0.8
"""Share of factors that keep the limits on polynomials over one box, which keep them on those over a wider one."""
_ROUNDS = 12
"""Most allocations on one study, each with the times at which limits were broken before."""


class _Bracket:
    """Factors that keep the limits and factors that do not, and where the largest of the first is expected.

    Attributes
    ----------
    low, high : float      the largest factor that keeps the limits, the least that does not
    doubts : sentences     why the latter does not, if it is not for a limit
    """

    def __init__(self) -> None:
        self.low, self.high, self.doubts = 0.0, np.inf, tuple[str, ...]()
        self._expected, self._margins, self._is_first = np.inf, [0.0, 0.0], True

    def keeps(self, s: float, margin: float, at_nominal: float) -> None:
        """A factor keeps the limits with a margin. That at 0 is the nominal one."""
        slope = (at_nominal - margin) / s
        self._expected = at_nominal / slope if slope > 0 else np.inf
        self._far = _BEYOND if self._is_first else _FAR
        self.low, self._margins, self._is_first = s, [margin, self._margins[1] / 2], False

    def breaks(self, s: float, margin: float, doubts: tuple[str, ...], share: float | None) -> None:
        """A factor breaks a limit, or is doubted. Good polynomials show the share of it that keeps the limits."""
        self.fails(s, doubts if margin >= 0 else ())
        self._expected = np.nan if share is None else share * s
        self._margins = [self._margins[0] / 2, min(margin, 0.0)]

    def fails(self, s: float, doubts: tuple[str, ...]) -> None:
        """A study fails."""
        self.high, self.doubts, self._expected = s, doubts, np.nan
        self._margins = [self._margins[0], 0.0]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is not decided, if the largest factor is not found."""
        if self.doubts:
            return (f"At {self.high / self.low:.4g} times these tolerances the bounds are doubted: {self.doubts[0]}",)
        if self.low * (1 + 4 * _SETTLED) >= self.next_bound:
            return ()
        return (
            f"Up to {self.high / self.low:.3g} times these tolerances is not decided: the studies were not enough.",
        )

    @property
    def next_bound(self) -> float:
        """The factor that cannot be exceeded, as far as is known; infinite before any breaks a limit."""
        return min(self._expected, self.high) if self._expected > self.low and self.high < np.inf else self.high

    def next(self) -> float:
        """The factor of the next study: by polynomials, by a line between the margins (Illinois), or in the middle."""
        if self.high == np.inf:
            return min(max(_BEYOND * self._expected, self._far * self.low), 4 * self.low)
        if self.low < self._expected < self.high:
            return self._expected * (1 - _SETTLED / 4)
        inside, beyond = self._margins
        share = inside / (inside - beyond) if beyond < 0 < inside else 0.5
        return self.low + min(max(share, 0.05), 0.95) * (self.high - self.low)


class Search:
    """Studies over boxes that are stretched about the nominal values, and margins on their polynomials."""

    def __init__(
        self,
        simulator: Simulator,
        shape: Box,
        limits: dict[str, tuple[float, float]],
        executor: Executor | None,
        progress: Progress | None,
    ) -> None:
        self._simulator, self._shape, self._executor, self._progress = simulator, shape, executor, progress
        self._columns = [tuple(simulator.outputs).index(name) for name in limits]
        self._low, self._high = np.array([*limits.values()]).T
        self._nominal = np.array([simulator.parameters[name] for name in shape.names], dtype=float)
        for name, p, (low, high) in zip(shape.names, self._nominal, shape.bounds, strict=True):
            if not low <= p <= high:
                raise DeclarationError(
                    f"{OWNER}: the nominal value {name} = {p:g} is outside of its interval from {low:g} to {high:g}."
                )
        closest = np.where(shape.lower > 0, shape.lower, np.where(shape.upper < 0, shape.upper, self._nominal))
        with np.errstate(divide="ignore", invalid="ignore"):
            to_zero = np.where(closest != self._nominal, self._nominal / (self._nominal - closest), np.inf)
        self._most = np.minimum(_OF_SIGN * to_zero, MOST)
        self.evaluations, self.remarks, self._at_nominal = 0, tuple[str, ...](), 0.0

    def _nominal_margin(self, surrogate: Piecewise | None, whole: Box) -> float:
        """The least margin of the nominal values, by polynomials over a box, or by a run if these do not tell it."""
        if surrogate is not None:
            own = surrogate.part(slice(None), self._columns)
            values = own.values(whole.to_unit(self._nominal)[None])[0]
            margins = self._margins(values, values)
            if (margins > 2 * own.error).all():
                return float(margins.min())
        run = self._simulator.run(np.array([[*map(float, self._simulator.parameters.values())]]))
        self.evaluations += 1
        if not run.ok.all():
            raise PropagationError(f"{OWNER}: the run at the nominal parameters fails: {run.messages[0]}.")
        values = run.Y[0][:, self._columns]
        margins = self._margins(values, values)
        i, k = np.unravel_index(np.argmin(margins), values.shape)
        if margins[i, k] <= 0:
            name = self._simulator.outputs[self._columns[k]]
            raise PropagationError(
                f"{OWNER}: the nominal run breaks the limit of {name} at {self._simulator.times[i]:g} s, or meets it, "
                f"with {values[i, k]:.6g}: no tolerance keeps it."
            )
        return float(margins[i, k])

    def _margins(self, lower: Array, upper: Array) -> Array:
        """Margins (n_t, n_l) of bounds of the outputs with limits."""
        return np.minimum(lower - self._low, self._high - upper)

    def _box(self, factors: Array) -> Box:
        low = self._nominal - factors * (self._nominal - self._shape.lower)
        high = self._nominal + factors * (self._shape.upper - self._nominal)
        ends = np.stack([low, high], axis=1).tolist()
        return Box(**dict(zip(self._shape.names, map(tuple, ends), strict=True)))

    def _study(self, factors: Array, tolerance: float) -> tuple[Bounds, float]:
        """Bounds over a box, and the least margin."""
        method, box = PolynomialChaos(tolerance=tolerance), self._box(factors)
        bounds = method.bounds(self._simulator, box, executor=self._executor, progress=self._progress)
        self.evaluations += bounds.evaluations
        if not self._at_nominal:
            self._at_nominal = self._nominal_margin(bounds.good_surrogate(self._columns), box)
        return bounds, float(self._margins(bounds.lower[:, self._columns], bounds.upper[:, self._columns]).min())

    def largest(self, along: Array, first: float = TOLERANCES[0]) -> tuple[Array, Bounds]:
        """The largest factors (d,) along a ray, and bounds over their box, which keep the limits without a doubt.

        A line through the margins at 0 and at a factor that keeps the limits shows where to look for one that does not.
        Its polynomials show the largest factor, which a last study checks. Without good polynomials the search goes on
        between the largest factor that keeps the limits and the least that does not.
        """
        bracket, most = _Bracket(), float(np.min(self._most / along))
        names = {self._simulator.outputs[k] for k in self._columns}
        s, tolerance, best = 1.0, first, None
        for _ in range(_STUDIES):
            try:
                bounds, margin = self._study(s * along, tolerance)
            except PropagationError as error:
                if best is None:
                    raise
                bracket.fails(s, (str(error).splitlines()[0],))
            else:
                is_kept = margin >= 0 and not bounds.failed and not bounds.run_doubts
                if is_kept and names.isdisjoint(bounds.doubtful()):
                    best = bounds
                    bracket.keeps(s, margin, self._at_nominal)
                else:
                    surrogate = bounds.good_surrogate(self._columns) if margin < 0 else None
                    share = None if surrogate is None else self._factor_on(surrogate, s * along, s * along)
                    bracket.breaks(s, margin, bounds.doubts, share)
            is_settled = tolerance == TOLERANCES[1] and bracket.low * (1 + _SETTLED) >= bracket.next_bound
            if best is not None and (bracket.low >= most or is_settled):
                break
            s, tolerance = min(bracket.next(), most), TOLERANCES[1]
        if best is None:
            raise PropagationError(" ".join([f"{OWNER}: no box was found in {_STUDIES} studies.", *bracket.doubts]))
        self.remarks = () if bracket.low >= most else bracket.remarks
        return bracket.low * along, best

    def signs(self, factors: Array) -> tuple[str, ...]:
        """Why factors (d,) are not larger, if parameters would change their signs."""
        ends = (self._most < MOST) & (factors >= self._most * (1 - _SETTLED))
        names = [name for name, is_end in zip(self._shape.names, ends, strict=True) if is_end]
        return (f"Larger tolerances are not looked for: {', '.join(names)} would reach 0.",) if names else ()

    def cheapest(self, cost: Callable[[Array], float]) -> tuple[Array, Bounds]:
        """The factors of least cost, and bounds over their box.

        It begins where a line through the margins at 0 and at 1 meets the limit, or, where no polynomials are good over
        a box that is wider, at the largest common factor. More studies are made until the factors lie inside of such a
        box. Where polynomials over boxes of different widths disagree, the largest common factor is another candidate.
        """
        ones = np.ones(len(self._shape))
        _, margin = self._study(ones, TOLERANCES[0])
        factors, is_largest, disagree = ones / max(1 - margin / self._at_nominal, 1 / 4), False, False
        factors = np.minimum(factors, self._most)
        for _ in range(_STUDIES):
            wide = np.minimum(_WIDER * factors, self._most)
            surrogate = self._polynomials(wide)
            if surrogate is None and is_largest:
                raise PropagationError(f"{OWNER}: no polynomials are good enough for an allocation. Leave costs out.")
            if surrogate is None:
                factors, is_largest = self.largest(ones)[0], True
                continue
            share = self._factor_on(surrogate, wide, factors)
            start, disagree = share * factors, disagree or share < _AGREE
            factors = self._allocated(surrogate, wide, start, cost)
            is_inside = (factors < wide * (1 - _SETTLED)) | (factors >= self._most * (1 - _SETTLED))
            if (is_inside & (factors > start * _NARROWER * (1 + _SETTLED))).all():
                break
        if disagree and not is_largest and cost(common := self.largest(ones)[0]) < cost(factors):
            factors = common
        return self.largest(factors, TOLERANCES[1])

    def _polynomials(self, factors: Array) -> Piecewise | None:
        """Those of a study over a box, if it has good ones."""
        with suppress(PropagationError):  # too many runs fail
            return self._study(factors, TOLERANCES[0])[0].good_surrogate(self._columns)
        return None

    def _margins_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> Array:
        """Margins (n_t, n_l) on polynomials, whose box has the factors `wide` (d,), over a box with other factors."""
        whole, part = self._box(wide), self._box(factors)
        low, high, _ = surrogate.range(whole.to_unit(part.lower), whole.to_unit(part.upper))
        return self._margins(low, high)

    def _factor_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> float:
        """The largest share of the factors (d,), at most 1, whose margins on the polynomials are not negative."""
        own, low, high = surrogate.part(slice(None), self._columns), 0.0, 1.0
        if self._margins_on(own, wide, factors).min() >= 0:
            return 1.0
        while high - low > _SETTLED / 8 * high:
            middle = (low + high) / 2
            is_kept = self._margins_on(own, wide, middle * factors).min() >= 0
            low, high = (middle, high) if is_kept else (low, middle)
        return low

    def _allocated(self, surrogate: Piecewise, wide: Array, start: Array, cost: Callable[[Array], float]) -> Array:
        """Factors of least cost on polynomials, from those at the start.

        Few times bind. Those at which a solution breaks limits are added until none does.
        """
        from scipy.optimize import minimize

        own, scale = surrogate.part(slice(None), self._columns), cost(start) or 1.0
        rows = {int(self._margins_on(own, wide, start).min(axis=1).argmin())}
        factors = start
        for _ in range(_ROUNDS):
            few = surrogate.part(np.array(sorted(rows)), self._columns)

            def margins_of(z: Array, few: Piecewise = few) -> Array:
                return self._margins_on(few, wide, start * np.exp(z)).ravel() / self._at_nominal

            solution = minimize(
                lambda z: cost(start * np.exp(z)) / scale,
                np.zeros(len(start)),
                method="SLSQP",
                bounds=[(np.log(_NARROWER), w) for w in np.log(wide / start)],
                constraints={"type": "ineq", "fun": margins_of},
                options={"ftol": 1e-7, "maxiter": 60},
            )
            factors = start * np.exp(np.asarray(solution.x, dtype=float))
            margins = self._margins_on(own, wide, factors).min(axis=1)
            broken = int(margins.argmin())
            if margins[broken] >= -_SETTLED / 10 * self._at_nominal or broken in rows:
                break
            rows.add(broken)
        factors = factors * self._factor_on(surrogate, wide, factors)
        return factors if cost(factors) < cost(start) else start
