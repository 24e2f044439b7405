"""How loose tolerances may be: the largest box of a shape, or the cheapest one, that keeps limits of outputs."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, PropagationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._labelled import Labelled, Result, texts
from symmb._names import did_you_mean
from symmb._options import is_finite_number, shown
from symmb._progress import shown_runs
from symmb._table import aligned
from symmb._types import Array, Executor, Indices
from symmb.black_boxes import Progress, Simulator
from symmb.bounds import Bounds, LimitCheck, PolynomialChaos, WorstCase, finished, limit_pairs
from symmb.integrate import Solver
from symmb.model import Box, Scene
from symmb.polynomials.ranges import Piecewise
from symmb.simulation import simulator_of

_OWNER = "tolerances"
_TOLERANCES = 1e-2, 1e-3
"""Tolerance of the first study and of the others: the error of a factor is about as large."""
_SETTLED = 2e-3
"""Change of the factors over them at which a search ends."""
_MOST = 16.0
"""Largest factor that is looked for: the box that is given is meant to be of the right size."""
_STUDIES = 16
"""Most studies: three are usual, more where polynomials are not good."""
_BEYOND, _FAR = 1.05, 1.5
"""How far beyond the factor on a line the next study is, and beyond one that keeps the limits against such a line."""
_WIDER, _NARROWER = 1.6, 0.25
"""Factors that an allocation may change at once, on the polynomials of a study over the wider box."""
_ROUNDS = 12
"""Most allocations on one study, each with the times at which limits were broken before."""
Costs = Mapping[str, Callable[[float], float]] | Callable[[float], float]


@dataclass(frozen=True, eq=False, repr=False)
class Tolerances(Result):
    """Tolerances that keep limits. `print` shows them.

    Attributes
    ----------
    box : Box
    factor : float
        of the box that was given, by which all its intervals are stretched about the nominal values; of an allocation
        the least of `factors`
    factors : dict
        that of each parameter
    cost : float
        of an allocation; None of others
    binding : WorstCase
        the run that comes closest to a limit; None if none binds, up to 16 times the box
    check : LimitCheck
        of `bounds`
    bounds : Bounds
        those over the box, from a last study
    evaluations : int
        runs of all studies
    nominal : dict
        nominal values of the parameters of the box
    remarks : sentences
        why no larger box was found, if no limit is near

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> found = mb.tolerances(scene, {"x": (-0.7, None)})
    >>> round(found.factor, 2)
    1.25
    """

    box: Box
    factor: float
    factors: dict[str, float]
    cost: float | None
    binding: WorstCase | None
    check: LimitCheck
    bounds: Bounds
    evaluations: int
    nominal: dict[str, float]
    remarks: tuple[str, ...] = ()

    def _head(self) -> str:
        kind = "The cheapest" if self.cost is not None else "The largest"
        lines = [f"{kind} box that keeps the limits, from {self.evaluations} runs"]
        if self.cost is not None:
            lines.append(f"  cost      {self.cost:.6g}")
        lines += [f"  remark    {remark}" for remark in self.remarks]
        if self.check.kept is None:
            lines.append("  undecided the margin is within the error of the bounds: larger tolerances may do")
        if self.binding is None:
            lines.append("  binding   no limit")
        else:
            lines.append(f"  binding   {self.check[self.binding.output].text}; {self.binding}")
        return "\n".join(lines)

    def _rows(self) -> list[list[str]]:
        rows = [["parameter", "nominal", "lower", "upper", "factor"]]
        for name, (low, high) in zip(self.box.names, self.box.bounds, strict=True):
            p = self.nominal[name]
            factor = f"{self.factors[name]:.4g}" if high > low else "fixed"
            rows.append([name, f"{p:.6g}", f"{low - p:+.4g}", f"{high - p:+.4g}", factor])
        return rows

    def __str__(self) -> str:
        rows = "\n".join(f"  {line}" for line in aligned(self._rows()))
        return "\n\n".join([f"{self._head()}\n{rows}", str(self.check)])

    def _repr_html_(self) -> str:
        return html.page(html.text(self._head()), html.table(self._rows()), html.text(str(self.check)))

    def _labelled(self) -> Labelled:
        names = texts(self.box.names)
        ends = np.stack([self.box.lower, self.box.upper], axis=1)
        variables = {
            "interval": (("parameter", "bound"), ends),
            "nominal": (("parameter",), np.array([self.nominal[name] for name in self.box.names])),
            "factor": (("parameter",), np.array([self.factors[name] for name in self.box.names])),
        }
        coordinates = {"parameter": (("parameter",), names), "bound": (("bound",), texts(("lower", "upper")))}
        return Labelled(
            coordinates, variables, {"binding": str(self.binding or ""), "cost": self.cost}, {}, ("parameter",)
        )


def tolerances(
    scene: Scene | Simulator,
    limits: Mapping[str, tuple[float | None, float | None]],
    box: Box | None = None,
    costs: Costs | None = None,
    solver: Solver | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Tolerances:
    """The largest tolerances that keep limits of outputs at all times, or the cheapest ones.

    All deviations of the box from the nominal values are multiplied by one factor, up to 16, or, with costs, each by
    its own. The factors are searched on the polynomials of a study with PolynomialChaos(), and a last study over the
    box that is found checks the limits. Where a study leaves no good polynomials, more studies are made.

    Parameters
    ----------
    scene : Scene or simulator
    limits : mapping
        output -> (low, high), of which one may be None
    box : Box
        shape of the intervals, which hold the nominal values; default: that of the scene
    costs : mapping
        parameter -> function of its half width, whose sum is least; those that are left out cost the half width in the
        box over their own. {} is that for all of them. A function is the same for all. They should fall smoothly: a
        search finds the least cost near its start
    solver : of a Scene
    executor, progress : as of `propagate`

    Raises
    ------
    DeclarationError
        If an output or a parameter is unknown, limits cross, or an interval lacks the nominal value
    PropagationError
        If the nominal run breaks a limit, or too many runs fail

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> chain = mb.FunctionSimulator(lambda a, b: [[a + b]], {"a": 1.0, "b": 2.0}, [0.0], ["gap"])
    >>> round(mb.tolerances(chain, {"gap": (2.7, 3.3)}, mb.Box(a=(0.9, 1.1), b=(1.9, 2.1))).factor, 2)
    1.5
    """
    with kept_interrupts(), shown_runs(progress, _OWNER) as progress:
        simulator, shape = simulator_of(scene, box, solver)
        for name in shape.names:
            if name not in simulator.parameters:
                raise DeclarationError(f"{_OWNER}: no parameter {name!r}.{did_you_mean(name, simulator.parameters)}")
        search = _Search(simulator, shape, limit_pairs(_OWNER, limits, simulator.outputs), executor, progress)
        if costs is None:
            factors, bounds = search.largest(np.ones(len(shape)))
            cost = None
        else:
            total = _total_cost(costs, shape)
            factors, bounds = search.cheapest(total)
            cost = total(factors)
        bounds = finished(PolynomialChaos(tolerance=_TOLERANCES[1]), simulator, bounds, executor)
    warn_of((*bounds.doubts, *search.remarks), _OWNER)
    check = bounds.check(limits)
    by_name = dict(zip(shape.names, factors.tolist(), strict=True))
    nominal = {name: float(simulator.parameters[name]) for name in shape.names}
    factor = float(factors[shape.radius > 0].min(initial=_MOST))
    assert bounds.box is not None
    binding = None if factor >= _MOST or search.remarks else check.worst
    return Tolerances(
        bounds.box, factor, by_name, cost, binding, check, bounds, search.evaluations, nominal, search.remarks
    )


def _total_cost(costs: Costs, shape: Box) -> Callable[[Array], float]:
    """Sum of the costs as a function of the factors (d,)."""
    if not isinstance(costs, Mapping):
        if not callable(costs):
            raise DeclarationError(f"{_OWNER}: costs must be functions of half widths by name, got {shown(costs)}.")
        costs = dict.fromkeys(shape.names, costs)
    for name, own in costs.items():
        if name not in shape.names:
            raise DeclarationError(
                f"{_OWNER}: costs: {name!r} is not in the box.{did_you_mean(str(name), shape.names)}"
            )
        if not callable(own):
            raise DeclarationError(f"{_OWNER}: the cost of {name!r} must be a function of its half width.")
    varied = [(k, costs.get(name)) for k, name in enumerate(shape.names) if shape.radius[k] > 0]

    def total(factors: Array) -> float:
        return sum(1 / factors[k] if own is None else _cost_of(k, own, factors[k]) for k, own in varied)

    def _cost_of(k: int, own: Callable[[float], float], factor: float) -> float:
        half = float(factor * shape.radius[k])
        try:
            value = own(half)
        except Exception as error:  # of the user's function
            raise DeclarationError(f"{_OWNER}: the cost of {shape.names[k]!r} fails at {half:g}: {error}.") from error
        if not is_finite_number(value):
            raise DeclarationError(
                f"{_OWNER}: the cost of {shape.names[k]!r} at {half:g} is {shown(value)}, no number."
            )
        return float(value)

    return total


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


class _Search:
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
                    f"{_OWNER}: the nominal value {name} = {p:g} is outside of its interval from {low:g} to {high:g}."
                )
        self.evaluations, self.remarks, self._at_nominal = 0, tuple[str, ...](), 0.0

    def _nominal_margin(self, surrogate: Piecewise | None, whole: Box) -> float:
        """The least margin of the nominal values, by polynomials over a box, or by a run if these do not tell it.

        Raises
        ------
        PropagationError       if the run fails, or breaks a limit
        """
        if surrogate is not None:
            own = self._limited(surrogate)
            values = own.values(whole.to_unit(self._nominal)[None])[0]
            margins = self._margins(values, values)
            if (margins > 2 * own.error).all():
                return float(margins.min())
        run = self._simulator.run(np.array([[*map(float, self._simulator.parameters.values())]]))
        self.evaluations += 1
        if not run.ok.all():
            raise PropagationError(f"{_OWNER}: the run at the nominal parameters fails: {run.messages[0]}.")
        values = run.Y[0][:, self._columns]
        margins = self._margins(values, values)
        i, k = np.unravel_index(np.argmin(margins), values.shape)
        if margins[i, k] <= 0:
            name = self._simulator.outputs[self._columns[k]]
            raise PropagationError(
                f"{_OWNER}: the nominal run breaks the limit of {name} at {self._simulator.times[i]:g} s, or meets it, "
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

    def largest(self, along: Array, first: float = _TOLERANCES[0]) -> tuple[Array, Bounds]:
        """The largest factors (d,) along a ray, and bounds over their box, which keep the limits without a doubt.

        A line through the margins at 0 and at a factor that keeps the limits shows where to look for one that does not.
        Its polynomials show the largest factor, which a last study checks. Without good polynomials the search goes on
        between the largest factor that keeps the limits and the least that does not.
        """
        bracket, most = _Bracket(), float(np.min(_MOST / along))
        s, tolerance, kept = 1.0, first, None
        for _ in range(_STUDIES):
            try:
                bounds, margin = self._study(s * along, tolerance)
            except PropagationError as error:
                if kept is None:
                    raise
                bracket.fails(s, (str(error).splitlines()[0],))
            else:
                if margin >= 0 and not self._is_doubted(bounds):
                    kept = bounds
                    bracket.keeps(s, margin, self._at_nominal)
                else:
                    bracket.breaks(s, margin, bounds.doubts, self._factor_of(bounds, s * along) if margin < 0 else None)
            is_settled = tolerance == _TOLERANCES[1] and bracket.low * (1 + _SETTLED) >= bracket.next_bound
            if kept is not None and (bracket.low >= most or is_settled):
                break
            s, tolerance = min(bracket.next(), most), _TOLERANCES[1]
        if kept is None:
            raise PropagationError(" ".join([f"{_OWNER}: no box was found in {_STUDIES} studies.", *bracket.doubts]))
        self.remarks = () if bracket.low >= most else bracket.remarks
        return bracket.low * along, kept

    def _factor_of(self, bounds: Bounds, factors: Array) -> float | None:
        """The largest share of the factors (d,) that keeps the limits, by the polynomials of their study, if good."""
        surrogate = bounds.good_surrogate(self._columns)
        return None if surrogate is None else self._factor_on(surrogate, factors, factors)

    def _is_doubted(self, bounds: Bounds) -> bool:
        """Whether runs fail, or the error of an output with limits is large."""
        names = {bounds.names[k] for k in self._columns}
        return bool(bounds.failed or bounds.run_doubts or names & bounds.doubtful().keys())

    def cheapest(self, cost: Callable[[Array], float]) -> tuple[Array, Bounds]:
        """The factors of least cost, and bounds over their box.

        It begins where a line through the margins at 0 and at 1 meets the limit, or, where no polynomials are good over
        a box that is wider, at the largest common factor. More studies are made until the factors lie inside of such a
        box.
        """
        ones = np.ones(len(self._shape))
        _, margin = self._study(ones, _TOLERANCES[0])
        factors, is_largest = ones / max(1 - margin / self._at_nominal, 1 / 4), False
        for _ in range(_STUDIES):
            wide = np.minimum(_WIDER * factors, _MOST)
            surrogate = self._polynomials(wide)
            if surrogate is None and is_largest:
                raise PropagationError(f"{_OWNER}: no polynomials are good enough for an allocation. Leave costs out.")
            if surrogate is None:
                factors, is_largest = self.largest(ones)[0], True
                continue
            start = factors * self._factor_on(surrogate, wide, factors)
            factors = self._allocated(surrogate, wide, start, cost)
            is_inside = (factors < wide * (1 - _SETTLED)) | (factors >= _MOST * (1 - _SETTLED))
            if (is_inside & (factors > start * _NARROWER * (1 + _SETTLED))).all():
                break
        return self.largest(factors, _TOLERANCES[1])

    def _polynomials(self, factors: Array) -> Piecewise | None:
        """Those of a study over a box, if it has good ones."""
        with suppress(PropagationError):  # too many runs fail
            return self._study(factors, _TOLERANCES[0])[0].good_surrogate(self._columns)
        return None

    def _margins_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> Array:
        """Margins (n_t, n_l) on polynomials, whose box has the factors `wide` (d,), over a box with other factors."""
        whole, part = self._box(wide), self._box(factors)
        low, high, _ = surrogate.range(whole.to_unit(part.lower), whole.to_unit(part.upper))
        return self._margins(low, high)

    def _factor_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> float:
        """The largest share of the factors (d,), at most 1, whose margins on the polynomials are not negative."""
        own = self._limited(surrogate)
        low, high = 0.0, 1.0
        if self._margins_on(own, wide, factors).min() >= 0:
            return 1.0
        while high - low > _SETTLED / 8 * high:
            middle = (low + high) / 2
            is_kept = self._margins_on(own, wide, middle * factors).min() >= 0
            low, high = (middle, high) if is_kept else (low, middle)
        return low

    def _limited(self, surrogate: Piecewise, rows: Indices | slice = slice(None)) -> Piecewise:
        """Polynomials of the outputs with limits alone, at some times."""
        return surrogate.part(rows, self._columns)

    def _allocated(self, surrogate: Piecewise, wide: Array, start: Array, cost: Callable[[Array], float]) -> Array:
        """Factors of least cost on polynomials, from those at the start.

        Few times bind. Those at which a solution breaks limits are added until none does.
        """
        from scipy.optimize import minimize

        own, scale = self._limited(surrogate), cost(start) or 1.0
        rows = {int(self._margins_on(own, wide, start).min(axis=1).argmin())}
        found = start
        for _ in range(_ROUNDS):
            few = self._limited(surrogate, np.array(sorted(rows)))

            def kept(z: Array, few: Piecewise = few) -> Array:
                return self._margins_on(few, wide, start * np.exp(z)).ravel() / self._at_nominal

            solution = minimize(
                lambda z: cost(start * np.exp(z)) / scale,
                np.zeros(len(start)),
                method="SLSQP",
                bounds=[(np.log(_NARROWER), w) for w in np.log(wide / start)],
                constraints={"type": "ineq", "fun": kept},
                options={"ftol": 1e-7, "maxiter": 60},
            )
            found = start * np.exp(np.asarray(solution.x, dtype=float))
            margins = self._margins_on(own, wide, found).min(axis=1)
            broken = int(margins.argmin())
            if margins[broken] >= -_SETTLED / 10 * self._at_nominal or broken in rows:
                break
            rows.add(broken)
        found = found * self._factor_on(surrogate, wide, found)
        return found if cost(found) < cost(start) else start
