"""The largest box of a given shape, or the cheapest box, that satisfies limits of outputs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._labelled import Counted, Labelled, Result, over_parameters, texts
from symmb._names import did_you_mean, normal_keys
from symmb._options import is_finite_number, require_name, shown
from symmb._progress import shown_runs
from symmb._table import aligned
from symmb._types import Array, Executor
from symmb.bound.answers import Bounds, LimitCheck, Limits, Statistics, box_entries, box_of, limit_pairs, statistics_of
from symmb.bound.methods import PolynomialChaos, units_of
from symmb.bound.propagation import finished
from symmb.bound.responses import WorstCase
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box, Scene, require_only_intervals, with_some_outputs
from symmb.results.files import NOT_KEPT, Record, Saved, attributes, entries, entry
from symmb.run.integrate import Solver
from symmb.run.simulation import SceneSimulator, Subject, motion_of
from symmb.study.tolerance_search import LARGEST_FACTOR, OWNER, TOLERANCE, Search, runs_of_check
from symmb.study.yield_search import ERROR, YieldSearch

Costs = Mapping[str, Callable[[float], float]] | Callable[[float], float]


@dataclass(frozen=True, eq=False, repr=False)
class Tolerances(Counted, Result, Saved):
    """Tolerances that satisfy limits. `print` shows the tolerances. `save` writes a file, and `load` reads it.

    Attributes
    ----------
    box : Box
    factor : float
        factor by which all deviations of the given box from the nominal values are multiplied. With costs, the smallest
        of `factors`, without parameters that have no effect on outputs with limits
    factors : dict
        the factor of each parameter
    cost : float
        sum of the costs of the tolerances; None without costs
    binding : WorstCase
        run that comes closest to the active limit; None if no limit is active up to the factor 16
    check : LimitCheck
        check of `bounds`
    bounds : Bounds
        bounds over the box, from the final study
    evaluations, runs : int
        number of runs of all studies
    nominal : dict
        nominal values of the parameters of the box
    remarks : sentences
        information in sentences, such as the reason why no larger box was found
    yield_ : float
        the requested yield; None if all mechanisms satisfy the limits
    worst_case : dict
        with a yield, the largest common factor that satisfies the limits in the worst case, by parameter
    statistics : Statistics
        with a yield, the rejects, Cp and Cpk of `bounds`

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 0.5, 1.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> widest = mb.tolerances(scene, {"x": (-0.45, None)})
    >>> round(widest.factor, 2)
    1.51
    """

    box: Box = field(metadata=entry(box_of))
    factor: float
    factors: dict[str, float]
    cost: float | None
    binding: WorstCase | None = field(metadata=NOT_KEPT)
    check: LimitCheck = field(metadata=NOT_KEPT)
    bounds: Bounds = field(metadata=NOT_KEPT)
    evaluations: int
    nominal: dict[str, float]
    remarks: tuple[str, ...] = ()
    yield_: float | None = None
    worst_case: dict[str, float] = field(default_factory=dict)
    statistics: Statistics | None = field(default=None, metadata=NOT_KEPT)

    def _head(self) -> str:
        if self.yield_ is not None:
            return self._head_of_yield()
        best = "The cheapest box found that" if self.cost is not None else "The largest box that"
        kind = best if self.binding or self.cost is not None else "At least this box"
        satisfies = "may satisfy" if self.check.kept is None else "satisfies"
        lines = [f"{kind} {satisfies} the limits, from {self.evaluations} runs"]
        if self.cost is not None:
            lines.append(f"  cost      {self.cost:.6g}")
        lines += [f"  remark    {remark}" for remark in self.remarks]
        if self.check.kept is None:
            lines.append("  undecided whether the box satisfies the limits: see below")
        if self.binding is None and self.check.kept is None:
            lines.append("  binding   not known")
        elif self.binding is None:
            lines.append(f"  binding   no limit up to {max(self.factors.values()):.4g} times the tolerances")
        else:
            lines.append(f"  binding   {self.check[self.binding.output].text}; {self.binding}")
        return "\n".join(lines)

    def _head_of_yield(self) -> str:
        best = "The largest box found" if self.cost is None else "The cheapest box found"
        lines = [f"{best} with a yield of at least {self.yield_:.8g}, from {self.evaluations} runs"]
        lines += [] if self.cost is None else [f"  cost        {self.cost:.6g}"]
        lines += [f"  remark      {remark}" for remark in self.remarks]
        return "\n".join([*lines, f"  worst case  up to {min(self.worst_case.values()):.4g} times the tolerances"])

    def _rows(self) -> list[list[str]]:
        rows = [["parameter", "nominal", "lower", "upper", "factor"]]
        for name, label, (low, high) in zip(self.box.names, self.box.labels, self.box.bounds, strict=True):
            p = self.nominal[name]
            factor = f"{self.factors[name]:.4g}" if high > low else "fixed"
            rows.append([label, f"{p:.6g}", f"{low - p:+.4g}", f"{high - p:+.4g}", factor])
        return rows

    def __str__(self) -> str:
        rows = "\n".join(f"  {line}" for line in aligned(self._rows()))
        more = [] if self.statistics is None else [str(self.statistics)]
        return "\n\n".join([f"{self._head()}\n{rows}", *more, str(self.check)])

    def _repr_html_(self) -> str:
        below = [f"worst case: {self.check.worst}"] if self.check.worst else []
        below += [f"remark: {remark}" for remark in self.check.remarks]
        own = html.page(html.text(self._head()), html.table(self._rows()))
        own = own if self.statistics is None else html.page(own, self.statistics._repr_html_())
        return html.page(own, self.check._tabulated(), html.text("\n".join(below)))

    def _record(self) -> dict[str, Any]:
        return {
            **entries(self),
            **box_entries(self.box),
            "binding": self.binding and entries(self.binding),
            "statistics": self.statistics and entries(self.statistics),
            "check": self.check._record(),
            "bounds": self.bounds._record(),
        }

    @classmethod
    def _of_record(cls, record: Record) -> "Tolerances":
        binding = WorstCase.of_record(record.record("binding")) if "binding" in record else None
        chances = record.record("statistics") if "statistics" in record else None
        statistics = Statistics(**attributes(Statistics, chances)) if chances else None
        check, bounds = (record.record(name) for name in ("check", "bounds"))
        parts = {"check": LimitCheck._of_record(check), "bounds": Bounds._of_record(bounds)}
        result = cls(**attributes(cls, record), binding=binding, statistics=statistics, **parts)
        str(result)  # fails if a parameter or an output is missing in an entry
        return result

    def _labelled(self) -> Labelled:
        ends = np.stack([self.box.lower, self.box.upper], axis=1)
        variables = {
            "interval": (("parameter", "bound"), ends),
            "nominal": (("parameter",), np.array([self.nominal[name] for name in self.box.names])),
            "factor": (("parameter",), np.array([self.factors[name] for name in self.box.names])),
        }
        coordinates = over_parameters(self.box.names, dict(zip(self.box.names, self.box.units, strict=False)))
        coordinates |= {"bound": (("bound",), texts(("lower", "upper")))}
        return Labelled(
            coordinates, variables, {"binding": str(self.binding or ""), "cost": self.cost}, {}, ("parameter",)
        )


@kept_interrupts()
def tolerances(
    scene: Scene | Simulator,
    limits: Limits,
    box: Box | None = None,
    costs: Costs | None = None,
    solver: Solver | str | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    *,
    yield_: float | None = None,
    laws: Mapping[str, Any] | None = None,
) -> Tolerances:
    """The largest, or the cheapest, tolerances with which outputs satisfy limits at all times.

    All deviations of the box from the nominal values are multiplied by one factor, up to 16. With costs, each deviation
    has a separate factor. If an interval contains values of one sign only, as for a mass, the sign is kept. A parameter
    without an effect on outputs with limits does not end the search; a remark names this parameter. Studies
    with PolynomialChaos() find the worst points of a box. Runs at these points show the factor at which a limit is
    reached. At the end, a study and `Bounds.check` verify the box. Costs are minimised with the polynomials of studies.
    Outputs without a limit are ignored.

    Parameters
    ----------
    scene : Scene or simulator
    limits : mapping
        output -> (low, high); one limit may be None
    box : Box
        intervals that contain the nominal values, and give the shape; default: the box of the scene
    costs : mapping
        parameter -> cost as a function of its half width. The sum of the costs is minimised. Without a function, the
        cost is the half width in the box divided by the new half width; {} uses this cost for all parameters. A single
        function is the cost of every parameter. Costs should decrease smoothly, because the search finds a local
        minimum
    solver : solver of a Scene
    executor, progress : as in `propagate`
    yield_ : float
        fraction of mechanisms that satisfy all limits at all output times, above 0 and below 1. The tolerances are then
        larger than in the worst case. The estimated error of the rejects counts as rejects
    laws : mapping
        with `yield_`, distributions of parameters in the given box, as in `Bounds.statistical`. They are stretched with
        the tolerances

    Raises
    ------
    DeclarationError
        If an output or a parameter is unknown, the yield is not between 0 and 1, limits cross, or an interval does not
        contain the nominal value
    PropagationError
        If the nominal run violates a limit, or too many runs fail

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> chain = mb.FunctionSimulator(lambda a, b: [[a + b]], {"a": 1.0, "b": 2.0}, [0.0], ["gap"])
    >>> round(mb.tolerances(chain, {"gap": (2.7, 3.3)}, mb.Box(a=(0.9, 1.1), b=(1.9, 2.1))).factor, 2)
    1.5
    >>> round(mb.tolerances(chain, {"gap": (2.7, 3.3)}, mb.Box(a=(0.9, 1.1), b=(1.9, 2.1)), yield_=0.9973).factor, 1)
    2.2
    """
    if yield_ is not None and not (is_finite_number(yield_) and 0 < yield_ < 1):
        raise DeclarationError(
            f"{OWNER}: yield_ must be above 0 and below 1, such as 0.9973, got {shown(yield_)}. Without yield_, all "
            "mechanisms satisfy the limits."
        )
    if laws is not None and yield_ is None:
        raise DeclarationError(f"{OWNER}: laws need a yield, such as yield_=0.9973.")
    with shown_runs(progress, OWNER) as progress:
        simulator, shape = Subject.of(scene, solver).over(box)
        require_only_intervals("tolerances", shape)
        pairs = limit_pairs(OWNER, limits, simulator.outputs, units_of(simulator))
        simulator = of_outputs(simulator, [*pairs])
        for name in shape.names:
            require_name(OWNER, "parameter", name, simulator.parameters)
        search, chances = Search(simulator, shape, pairs, executor, progress), None
        if yield_ is not None:
            search = chances = YieldSearch(simulator, shape, pairs, executor, progress).begin(yield_, laws)
        if costs is None:
            (factors, bounds), cost = search.largest(np.ones(len(shape))), None
        else:
            total = total_cost(OWNER, costs, shape)
            factors, bounds = search.cheapest(total)
            cost = total(factors)
        bounds = finished(PolynomialChaos(tolerance=TOLERANCE), simulator, bounds, executor)
    warn_of((*bounds.doubts, *search.remarks), OWNER)
    check = bounds.check(limits, runs=runs_of_check(bounds))
    by_name = dict(zip(shape.names, factors.tolist(), strict=True))
    nominal = {name: float(simulator.parameters[name]) for name in shape.names}
    assert bounds.box is not None
    varies, idle = shape.radius > 0, search.idle(bounds)
    acts = varies & ~idle
    factor = float(factors[acts if acts.any() else varies].min(initial=LARGEST_FACTOR))
    signs = search.signs(factors, idle)
    remarks = search.remarks + search.narrow + _about_idle([*np.array(shape.names)[idle]])
    has_end = acts.any() and factor < LARGEST_FACTOR and not (signs and cost is None)
    is_open = not has_end or search.remarks or check.kept is None or chances is not None
    binding = None if is_open else search.binding(bounds, check)
    found = Tolerances(
        bounds.box, factor, by_name, cost, binding, check, bounds, search.evaluations, nominal, remarks + signs
    )
    if chances is None:
        return found
    assert chances.worst_case is not None
    worst_case = dict(zip(shape.names, chances.worst_case.tolist(), strict=True))
    responses = bounds._responses("Tolerances.statistics")
    statistics = statistics_of(responses, pairs, chances.laws(factors), ERROR, chances.rejects)
    return replace(found, yield_=yield_, worst_case=worst_case, statistics=statistics)


def _about_idle(names: Sequence[str]) -> tuple[str, ...]:
    """A sentence about parameters without an effect on outputs with limits in the box; otherwise empty."""
    text = f"In this box {', '.join(names)} {'has' if len(names) == 1 else 'have'} no effect on outputs with limits."
    return (text,) if names else ()


def of_outputs(simulator: Simulator, names: Sequence[str]) -> Simulator:
    """The simulator of a scene with some of its outputs, because other outputs may need more runs. A black box keeps
    all outputs."""
    if not isinstance(simulator, SceneSimulator) or simulator.scene is None or simulator.scene.outputs is None:
        return simulator
    if len(names) == len(simulator.outputs):
        return simulator
    motion = motion_of(simulator)
    assert motion is not None
    own = with_some_outputs(simulator.scene, names)
    return Subject(own, simulator.solver, motion.program.card).simulator


def total_cost(owner: str, costs: Costs, shape: Box) -> Callable[[Array], float]:
    """Sum of the costs as a function of the factors (d,)."""
    if not isinstance(costs, Mapping):
        if not callable(costs):
            raise DeclarationError(
                f"{owner}: costs must be a function of the half width, or a mapping of parameters to such functions, "
                f"got {shown(costs)}."
            )
        costs = dict.fromkeys(shape.names, costs)
    costs = normal_keys(owner, costs)
    for name, own in costs.items():
        if name not in shape.names:
            raise DeclarationError(f"{owner}: costs: {name!r} is not in the box.{did_you_mean(str(name), shape.names)}")
        if not callable(own):
            raise DeclarationError(f"{owner}: the cost of {name!r} must be a function of its half width.")
    varied = [(k, costs.get(name)) for k, name in enumerate(shape.names) if shape.radius[k] > 0]

    def total(factors: Array) -> float:
        return sum(1 / factors[k] if own is None else _cost_of(k, own, factors[k]) for k, own in varied)

    def _cost_of(k: int, own: Callable[[float], float], factor: float) -> float:
        half = float(factor * shape.radius[k])
        try:
            value = own(half)
        except Exception as error:  # an exception of the user's function
            raise DeclarationError(
                f"{owner}: the cost function of {shape.names[k]!r} fails for {half:g}: {error}."
            ) from error
        if not is_finite_number(value):
            raise DeclarationError(
                f"{owner}: the cost of {shape.names[k]!r} for {half:g} is not a number: {shown(value)}."
            )
        return float(value)

    ones = np.ones(len(shape))
    if varied and not total(ones / 2) > total(2 * ones):
        raise DeclarationError(f"{owner}: costs must decrease with the tolerance. Give costs such as lambda h: 1 / h.")
    return total
