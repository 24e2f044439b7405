"""Values of design variables with the best bounds of an objective, so that limits are satisfied in the whole box."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, PropagationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._labelled import Counted, Labelled, Result, over_parameters, texts
from symmb._names import normal_keys
from symmb._options import require_name, shown
from symmb._progress import shown_runs
from symmb._table import aligned
from symmb._types import Array, Executor
from symmb._units import units_of_parameters
from symmb.bound.answers import Bounds, LimitCheck, Limits, limit_pairs, limit_text, unit_suffix
from symmb.bound.methods import units_of
from symmb.bound.propagation import far_intervals
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box, Scene, require_only_intervals
from symmb.run.integrate import Solver
from symmb.run.simulation import Subject
from symmb.study.design_search import COST, DesignSearch, Goal, Verified
from symmb.study.tolerances import Costs, of_outputs, total_cost

OWNER = "design"
_COST = "cost"
_FRONT, _END = 5, 0.02
"""Number of designs of a front, and distance of the last design from the best second objective, divided by its range.
"""
_BINDS, _EDGE = 0.02, 1e-3
"""Largest distance from a limit that is active, divided by the width; and from an end, divided by the range."""

Objective = tuple[str, str] | str
"""An output and 'upper', 'lower' or 'width', or 'cost'."""


@dataclass(frozen=True, eq=False, repr=False)
class Design(Counted, Result):
    """A design: values of its variables, and bounds over its tolerances. `print` shows the design.

    Attributes
    ----------
    values : dict
        value of each design variable
    objectives : dict
        "upper y", "lower y", "width y" or "cost" -> value of the objective. Bounds are the largest upper bound over
        time, the smallest lower bound, and the largest width
    bounds : Bounds
        bounds over the box of the design, from a study
    box : Box
        intervals of all parameters that are varied
    factors : dict
        factor of each tolerance with costs
    binding : tuple of str
        sentences about active limits, and about variables and factors at the ends of their ranges
    check : LimitCheck
        check of the limits; None without limits
    front : tuple of Design
        designs of a front of two objectives, ordered by the first objective; empty for one objective
    evaluations, runs : int
        number of runs of all studies

    Examples
    --------
    >>> import symmb as mb
    >>> valley = mb.FunctionSimulator(lambda a, b: [[(a - b) ** 2]], {"a": 1.0, "b": 2.0}, [0.0], ["y"])
    >>> best = mb.design(valley, {"a": (0.0, 5.0)}, ("y", "upper"), box=mb.Box(b=(1.0, 3.0)))
    >>> round(best.values["a"], 2), round(best.objectives["upper y"], 2)
    (2.0, 1.0)
    """

    values: dict[str, float]
    objectives: dict[str, float]
    bounds: Bounds
    box: Box
    factors: dict[str, float]
    binding: tuple[str, ...]
    check: LimitCheck | None
    front: tuple["Design", ...]
    evaluations: int

    def _head(self) -> str:
        kind = "A design of the front" if self.front else "The best design found"
        lines = [f"{kind}, from {self.evaluations} runs"]
        for name, value in self.objectives.items():
            unit = "" if name == _COST else unit_suffix(self.bounds, self.bounds.names.index(name.split(" ", 1)[1]))
            lines.append(f"  {name:<9} {value:.6g}{unit}")
        return "\n".join([*lines, *(f"  binding   {text}" for text in self.binding)])

    def _rows(self) -> list[list[str]]:
        rows = [["parameter", "value", "lower", "upper", "factor"]]
        for name, label, (low, high) in zip(self.box.names, self.box.labels, self.box.bounds, strict=True):
            value = self.bounds.nominal_parameters[name]
            factor = f"{self.factors[name]:.4g}" if name in self.factors else ""
            rows.append([label, f"{value:.6g}", f"{low - value:+.4g}", f"{high - value:+.4g}", factor])
        return rows

    def _front_rows(self) -> list[list[str]]:
        rows = [[*self.objectives, *self.values, *(f"factor {name}" for name in self.factors)]]
        numbers = [(p.objectives, p.values, p.factors) for p in self.front]
        return rows + [[f"{x:.5g}" for part in parts for x in part.values()] for parts in numbers]

    def _tables(self) -> list[list[list[str]]]:
        return [self._rows(), *([self._front_rows()] if self.front else [])]

    def __str__(self) -> str:
        tables = ["\n".join(f"  {line}" for line in aligned(rows)) for rows in self._tables()]
        return "\n\n".join([f"{self._head()}\n{tables[0]}", *tables[1:], *([str(self.check)] if self.check else [])])

    def _repr_html_(self) -> str:
        check = [html.text(str(self.check))] if self.check else []
        return html.page(html.text(self._head()), *map(html.table, self._tables()), *check)

    def _labelled(self) -> Labelled:
        points = self.front or (self,)
        coordinates = over_parameters(self.values, units_of_parameters(self.bounds.nominal_parameters))
        coordinates |= {"objective": (("objective",), texts([*self.objectives]))}
        coordinates |= {"design": (("design",), np.arange(len(points)))}
        variables = {
            "value": (("design", "parameter"), np.array([[*point.values.values()] for point in points])),
            "best": (("design", "objective"), np.array([[*point.objectives.values()] for point in points])),
        }
        return Labelled(coordinates, variables, {"binding": "\n".join(self.binding)}, {}, ("design", "parameter"))


@kept_interrupts()
def design(
    scene_or_simulator: Scene | Simulator,
    variables: Mapping[str, Any],
    objective: Objective | list[Objective],
    limits: Limits | None = None,
    box: Box | None = None,
    costs: Costs | None = None,
    solver: Solver | str | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Design:
    """Values of design variables with the best bound of an objective. Limits are satisfied in the whole box.

    The box contains the tolerances. The interval of a variable moves with its value: its deviations from the nominal
    value stay the same. Intervals of other parameters stay where they are, and variables need no interval.

    Polynomials of all parameters replace the runs. They are fitted to runs that are spread over the ranges and the
    tolerances, and the bounds of the polynomials are minimised. A study with PolynomialChaos() and `Bounds.check`
    verify the design. If the polynomials are not accurate, the search starts at several designs, and continues with new
    polynomials in smaller regions. It may still find a local minimum. Designs with failed runs are left out. Only
    outputs with an objective or a limit are computed.

    Parameters
    ----------
    scene_or_simulator : Scene or simulator
    variables : mapping
        parameter -> (lower, upper), the range of its nominal value
    objective : pair, or list of two objectives
        (output, "upper") minimises the largest upper bound over time, (output, "lower") maximises the smallest lower
        bound, (output, "width") minimises the largest width. "cost" minimises the sum of the costs of the tolerances.
        Two objectives give a front of five designs. The result is then the design of the front that is closest to the
        best values of both objectives
    limits : mapping
        output -> (low, high); one limit may be None. With costs, "cost" -> (None, high) limits the sum of the costs
    box : Box
        tolerances; default: the box of the scene. Without a box, only the nominal run counts
    costs : mapping
        parameter -> cost as a function of the half width, as in `tolerances`. Each tolerance is then multiplied by a
        factor from 1/4 to 4, which belongs to the design. {} uses the cost 1 / factor for all parameters of the box.
        None as cost keeps the interval of a parameter
    solver : solver of a Scene
    executor, progress : as in `propagate`

    Raises
    ------
    DeclarationError
        If a name, a range, a limit or an objective is not valid, or an interval does not contain the nominal value
    PropagationError
        If no design satisfies the limits, or too many runs fail

    Examples
    --------
    >>> import symmb as mb
    >>> f = mb.FunctionSimulator(lambda a, b: [[(a - b) ** 2, a]], {"a": 1.0, "b": 2.0}, [0.0], ["y", "a"])
    >>> best = mb.design(f, {"a": (0.0, 5.0)}, ("a", "upper"), {"y": (None, 4.0)}, mb.Box(b=(1.0, 3.0)))
    >>> round(best.values["a"], 2), best.binding
    (1.0, ('The limit y <= 4 is active.',))
    """
    box = getattr(scene_or_simulator, "box", None) if box is None else box
    if not isinstance(variables, Mapping) or not variables:
        raise DeclarationError(
            f"{OWNER}: variables must be ranges by name, such as {{'k': (1, 2)}}, got {shown(variables)}."
        )
    ranges = Box(**normal_keys(OWNER, variables))
    if ranges.is_cut:
        raise DeclarationError(f"{OWNER}: ranges must be pairs (lower, upper), without choices and constraints.")
    if box is None:
        simulator = Subject.of(scene_or_simulator, solver, owner=OWNER).simulator
    else:
        simulator, box = Subject.of(scene_or_simulator, solver).over(box)
        require_only_intervals(OWNER, box)
    ranges = ranges.with_units(units_of_parameters(simulator.parameters))
    _require_intervals(simulator, ranges, box)
    warn_of([*far_intervals(simulator, ranges)], OWNER)  # now, because the search may take long
    allocated, cost = _allocation(costs, box)
    known = [*simulator.outputs, *([] if costs is None else [_COST])]
    wanted: list[Any] = objective if isinstance(objective, list) and len(objective) == 2 else [objective]
    named = [each for each in wanted if isinstance(each, str)] + [*(limits if isinstance(limits, Mapping) else ())]
    if _COST in named and _COST not in known:
        raise DeclarationError(f"{OWNER}: {_COST!r} needs costs, such as costs={{}}.")
    asked = [_output_and_side(each, known) for each in wanted]
    units = dict(zip(simulator.outputs, units_of(simulator), strict=False))
    pairs = limit_pairs(OWNER, limits, known, [units.get(name, "") for name in known], needed=False)
    if len({*asked}) < len(asked):
        raise DeclarationError(f"{OWNER}: the two objectives are the same. Give one of them.")
    used = [name for name in simulator.outputs if name in pairs or name in dict(asked)]
    if not used:
        raise DeclarationError(f"{OWNER}: the objective {_COST!r} needs a limit of an output.")
    with shown_runs(progress, OWNER) as progress:
        simulator = of_outputs(simulator, used)
        columns = {name: k for k, name in enumerate(simulator.outputs)} | ({} if costs is None else {_COST: COST})
        goals, held = [Goal(columns[name], side or "upper") for name, side in asked], list[Goal]()
        for name, (low, high) in pairs.items():
            text = limit_text(name, units.get(name, ""), low, high)
            held += [Goal(columns[name], side, e, text) for side, e in (("lower", -low), ("upper", high)) if e < np.inf]
        own = {name: pair for name, pair in normal_keys(OWNER, limits or {}).items() if columns[name] != COST}
        search = DesignSearch(simulator, ranges, box, allocated, cost, own, held, executor, progress)
        first = search.best(goals)
        _require_kept(search, first, ranges)
        trials = [first] if len(goals) == 1 else _front(search, goals, first)
        points = np.array([trial.values[: len(goals)] for trial in trials])
        share = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1e-300)
        chosen = int(np.square(share).sum(axis=1).argmin())

        def result(trial: Verified) -> Design:
            values, factors = (each.tolist() for each in search.parts(trial.u))
            numbers = zip(asked, goals, trial.values.tolist(), strict=False)
            return Design(
                dict(zip(ranges.names, values, strict=True)),
                {f"{side} {name}".strip(): -x if goal.side == "lower" else x for (name, side), goal, x in numbers},
                trial.bounds,
                search.box(trial.u),
                dict(zip(allocated, factors, strict=True)),
                _binding(search, trial, [*ranges, *allocated]),
                trial.check,
                (),
                search.evaluations,
            )

        trials[chosen] = search.finished(trials[chosen])
        found = [result(trial) for trial in trials]
    warn_of(found[chosen].bounds.doubts, OWNER)
    return replace(found[chosen], front=tuple(found) if len(goals) > 1 else ())


def _require_intervals(simulator: Simulator, ranges: Box, box: Box | None) -> None:
    for name in (*ranges, *(box or ())):
        require_name(OWNER, "parameter", name, simulator.parameters)
    for name, (low, high) in zip(ranges.names, ranges.bounds, strict=True):
        if low == high:
            raise DeclarationError(f"{OWNER}: the range of {name} has no width. Leave out {name}, or give two values.")
    for name, (low, high) in zip(box.names, box.bounds, strict=True) if box else ():
        if not low <= (p := float(simulator.parameters[name])) <= high:
            raise DeclarationError(
                f"{OWNER}: the nominal value {name} = {p:g} is outside of its interval from {low:g} to {high:g}."
            )


def _output_and_side(objective: object, known: Sequence[str]) -> tuple[str, str]:
    """The output of an objective, and its side; the cost has none."""
    if isinstance(objective, str) and objective == _COST:
        return _COST, ""
    output, side = objective if isinstance(objective, tuple) and len(objective) == 2 else (None, None)
    if not isinstance(side, str) or side not in ("lower", "upper", "width"):
        raise DeclarationError(
            f"{OWNER}: objective must be a pair such as ('y', 'upper'), with 'lower', 'upper' or 'width', {_COST!r}, "
            f"or a list of two of them, got {shown(objective)}."
        )
    return require_name(OWNER, "output", output, known), side


def _allocation(costs: Costs | None, box: Box | None) -> tuple[list[str], Callable[[Array], float]]:
    """The parameters with costs, and the sum of their costs as a function of the factors."""
    if costs is None:
        return [], lambda factors: 0.0
    if box is None:
        raise DeclarationError(f"{OWNER}: costs need a box of tolerances.")
    kept = [name for name, own in costs.items() if own is None] if isinstance(costs, Mapping) else []
    for name in kept:
        require_name(f"{OWNER}: costs", "parameter", name, box.names)
    if isinstance(costs, Mapping):
        costs = {name: own for name, own in costs.items() if own is not None}
    intervals = zip(box.names, box.bounds, strict=True)
    own: dict[str, Any] = {name: ends for name, ends in intervals if name not in kept and ends[0] < ends[1]}
    if not own:
        raise DeclarationError(f"{OWNER}: costs need at least one interval of the box with a width.")
    return [*own], total_cost(OWNER, costs, Box(**own))


def _front(search: DesignSearch, goals: Sequence[Goal], first: Verified) -> list[Verified]:
    """Designs with the best first objective, for levels of the second objective down to its best value."""
    most, least = first.values[1], search.search(goals[::-1], first.u)[0].values[0]
    levels = np.linspace(most, least + _END * (most - least), _FRONT)[1:] if most > least else []
    trials = [first]
    for level in levels:
        trial = search.best([goals[0], goals[1]._replace(most=float(level))], trials[-1].u)
        trials += [trial] if trial.state < 2 else []
    points = np.array([trial.values[:2] for trial in trials])
    beaten = [((points <= own).all(axis=1) & (points < own).any(axis=1)).any() for own in points]
    return [trials[n] for n in np.argsort(points[:, 0], kind="stable") if not beaten[n]]


def _require_kept(search: DesignSearch, trial: Verified, ranges: Box) -> None:
    """Raise PropagationError if the closest design violates a limit."""
    if trial.state < 2:
        return
    over = trial.values[-len(search.held) :] - [goal.most for goal in search.held]
    n = int((over / np.maximum(trial.sizes[-len(over) :], 1e-300)).argmax())
    goal, values = search.held[n], zip(ranges.labels, search.parts(trial.u)[0], strict=True)
    unit = unit_suffix(trial.bounds, goal.k) if goal.k >= 0 else ""
    raise PropagationError(
        f"{OWNER}: no design was found that satisfies all limits in the whole box. In the closest design, "
        f"{', '.join(f'{name} = {x:.6g}' for name, x in values)}, "
        + (f"the limit {goal.text} is violated by {over[n]:.3g}{unit}" if goal.text else f"runs fail: {search.failure}")
        + ". Change the limits, the ranges or the tolerances."
    )


def _binding(search: DesignSearch, trial: Verified, names: Sequence[str]) -> tuple[str, ...]:
    """Sentences about active limits and ends of ranges."""
    held = zip(search.held[:-1], trial.values[-len(search.held) :], trial.sizes[-len(search.held) :], strict=False)
    texts = [f"The limit {goal.text} is active." for goal, x, size in held if x >= goal.most - _BINDS * size]
    values, factors = search.parts(trial.u)
    for name, u, factor in zip(names, trial.u, [*[None] * len(values), *factors], strict=True):
        side = "lower" if u <= _EDGE else "upper" if u >= 1 - _EDGE else None
        if side and factor is None:
            texts.append(f"{name} is at the {side} end of its range.")
        elif side:
            word = "smallest" if side == "lower" else "largest"
            texts.append(f"The tolerance of {name} has the {word} factor, {factor:.4g}.")
    return tuple(dict.fromkeys(texts))
