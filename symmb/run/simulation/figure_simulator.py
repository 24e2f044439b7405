"""Runs of a scene with scalar outputs ("figures"). Between the times of a run, curves over time are polynomials."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar, cast

import casadi as ca
import numpy as np

import symmb.connect as connect
from symmb._errors import SimulationError, WithWarnings
from symmb._names import ByName
from symmb._options import require_instance
from symmb._types import Array, Executor, Indices, Mask
from symmb._units import units_of_parameters, values_text
from symmb.connect import Ensemble, Progress, Reduction, Samples, blocks, checked_samples, stream
from symmb.declare.symbolic import common
from symmb.equations.model import Scene
from symmb.run.formulations import LOCK, CompiledEnsemble, Program, block_size
from symmb.run.simulation.dae_simulator import DAESimulator
from symmb.run.simulation.figure_values import TOUCHED, Curves, Rule
from symmb.run.simulation.panels import ON_GRID, Panels, distinct, panel_nodes, with_stop

S = TypeVar("S")

_LEAST, _MOST = 64, 2048
"""Smallest and largest number of panels of a run before divisions."""
_PARTS, _LEVELS = 8, 9
"""Number of parts of a divided panel, and maximum number of repeated divisions."""
_SHORTEST, _BESIDE, _NEAR = 1e-10, 3e-11, 1e-3
"""Smallest width of a divided panel, divided by the horizon; distance of panel ends from an event, divided by the
horizon; and distance of panel ends from a bend, divided by the width of the panel."""
_SAME = 1e-13
"""Largest distance of two equal times, divided by the horizon."""


class FigureSimulator(WithWarnings):
    """A simulator of a scene with scalar outputs, with the interface of `DAESimulator`, but without derivatives.

    A scalar output has the same value at all times. If all outputs are scalar, the only time is 0.

    Parameters
    ----------
    scene : Scene
    curves : DAESimulator
        simulator of `scene.curves`, which has the outputs over time
    """

    def __init__(self, scene: Scene, curves: DAESimulator) -> None:
        rules, n = list[Rule](), len(scene.curve_names)
        for name, f in scene.figures.items():
            expression = -1 if f.expression is None else n
            n += f.expression is not None
            margin = -1 if f.margin is None else n
            if f.kind == "probability":  # from the lowest margin of each run
                expression, margin = margin, -1
            window, level = f.window, f.level
            rules.append(Rule(name, f.kind, expression, margin, f.is_strict, window, f.per_second, level, f.over_runs))
            n += f.margin is not None
        self.outputs, self.units = scene.output_names, scene.units
        self._columns = [self.outputs.index(name) for name in scene.curve_names]
        self._hold(scene, curves, _with_rates(curves), rules)

    @classmethod
    def of_peaks(cls, simulator: "SceneSimulator", names: Sequence[str]) -> "FigureSimulator":
        """A simulator of the lowest and the highest value over time of each of these outputs.

        Each output gives two scalar outputs, which are equal if the output is scalar already.
        """
        own, known = cls.__new__(cls), dict[str, Rule]()
        if isinstance(simulator, DAESimulator):
            curves, rates = simulator, _with_rates(simulator)
        else:
            curves, rates = simulator.curves, simulator._with_rates
            known = {rule.name: rule for rule in simulator.rules}
        window = float(curves.times[0]), float(curves.times[-1])
        rules = [
            known[name]._replace(name=f"{name}, {kind}")
            if name in known
            else Rule(f"{name}, {kind}", kind, tuple(curves.outputs).index(name), -1, False, window)
            for name in names
            for kind in ("minimum", "maximum")
        ]
        own.outputs, own.units, own._columns = tuple(rule.name for rule in rules), None, []
        own._hold(None, curves, rates, rules)
        return own.continued([name for name, end in own.ends.items() if end is not None])

    def _hold(self, scene: Scene | None, curves: DAESimulator, with_rates: Program, rules: list[Rule]) -> None:
        """Set the attributes that follow from the simulator of the curves and from the rules of scalar outputs."""
        self.scene, self.curves, self.name, self.box = scene, curves, curves.name, curves.box
        self.parameters = ByName(curves.parameters)
        self.times = curves.times if self._columns else np.zeros(1)
        self.solver, self.reason, self.threads = curves.solver, curves.reason, curves.threads
        self._span, self.rules, self._with_rates = float(np.ptp(curves.times)), rules, with_rates
        self.doubts: tuple[str, ...] = curves.start.doubts
        self.noise: Array | None = None
        self.nominal: Array | None = None
        self._continued = frozenset[str]()

    def __repr__(self) -> str:
        return f"FigureSimulator({self.name!r}, {self.solver!r})"

    def __getstate__(self) -> dict[str, Any]:
        _ = self._count
        return self.__dict__ | {"scene": None, "box": None, "threads": 1}

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the scalar outputs. Each run has one number for each scalar output."""
        return tuple(rule.name for rule in self.rules)

    @property
    def ends(self) -> dict[str, float | None]:
        """The scalar outputs with a condition, and the last time that `first_time` can give; None for `value_at`."""
        return {rule.name: rule.end for rule in self.rules if rule.is_event}

    def continued(self, names: Collection[str] | None = None) -> "FigureSimulator":
        """The same simulator, whose runs do not fail if the conditions of scalar outputs never hold; default: of all.

        At the end of the window, the condition then counts as true: studies need a value that is continuous if a
        condition holds later and later.
        """
        continued = frozenset(self.ends) if names is None else frozenset(names)
        if continued == self._continued:
            return self
        _, other = self._count, FigureSimulator.__new__(FigureSimulator)
        vars(other).update(vars(self), _continued=continued, noise=None)
        return other

    @property
    def setup_seconds(self) -> float:
        """Time spent on deriving, compiling and starting so far [s]."""
        return self.curves.setup_seconds + self._with_rates.compiled.seconds

    @property
    def parameter_switches(self) -> ca.Function | None:
        """Margins, the first switches of `Ensemble.reach`, and values, as a Function of a sample; None without them."""
        return self._with_rates.formulation.parameter_switches

    def prepare(self) -> None:
        """Prepare the runs, if they are not prepared yet."""
        self._with_rates.prepare()

    def tighter(self) -> "FigureSimulator":
        """The same simulator with a solver that is at least ten times more accurate, so that its steps change."""
        _, other, curves = self._count, FigureSimulator.__new__(FigureSimulator), self.curves.tighter()
        vars(other).update(vars(self), curves=curves, solver=curves.solver, _with_rates=_with_rates(curves))
        return other

    def second_look(self) -> None:
        """At the first call, run the nominal parameters in two ways, and set `warnings` and `noise`."""
        if self.noise is not None:
            return
        self.curves.second_look()
        self.doubts = self.curves.doubts
        P = np.array([list(self.parameters.values())])
        first, second = self.run(P), self.tighter().run(P)
        self.noise = noise = np.zeros(len(self.outputs))
        if not first.ok.all():
            self.doubts = (*self.doubts, f"The nominal run fails at {first.messages[0]}.")
            return
        self.nominal = first.Y[0]
        if self._continued:
            lacks = np.isnan(self.continued(())._values(P)[1][0])
            never = [np.inf if self.ends.get(name) is not None else np.nan for name in self.outputs]
            self.nominal = np.where(lacks, never, first.Y[0])
        if second.ok.all():
            noise += np.abs(second.Y[0] - first.Y[0]).max(axis=0)
        if self._columns:
            noise[self._columns] = cast(Array, self.curves.noise)[: len(self._columns)]
        sizes = np.abs(cast(Array, self.curves.nominal)).max(axis=0)
        for rule in self.rules:
            size = self._span * rule.per_second if rule.expression < 0 else sizes[rule.expression]
            # Error of a scalar output, divided by the largest value of its expression; error of a time, divided by the
            # horizon.
            noise[self.outputs.index(rule.name)] += 1e-9 * size

    def run(self, P: Array) -> Samples:
        """Run samples P (N, d) as one block. Outputs (N, n_t, n_y) of a failed sample are nan."""
        P = np.ascontiguousarray(checked_samples(self, P, None))
        with LOCK:
            traces, Y = self._values(P)
        ok, t_failed, texts = traces.ok.copy(), traces.t_failed.copy(), dict(traces.texts)
        for i in np.flatnonzero(np.isnan(Y[:, 0]).any(axis=1) & ok).tolist():
            lacking = [rule for rule in self.rules if np.isnan(Y[i, 0, self.outputs.index(rule.name)])]
            values = values_text(self.parameters, P[i], units_of_parameters(self.parameters))
            ok[i], t_failed[i] = False, lacking[0].window[1]
            place = ", ".join(filter(None, [f"t = {t_failed[i]:g} s", values]))
            texts[i] = f"{place}: {' and '.join(never_holds(rule.name) for rule in lacking)}"
        Y[~ok] = np.nan
        return Ensemble(Y, ok, t_failed, tuple(texts[i] for i in np.flatnonzero(~ok).tolist()), reach=traces.reach)

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples P (N, d) block by block, and reduce each block."""
        require_instance("stream: reduction", reduction, Reduction, "a Reduction")
        block = 64  # the values of these samples at all times take some MB
        if self._with_rates.card is not None:
            engine = self._with_rates.at(self._times_of(self._count)[0]).engine()
            block = block_size(0, 10 * engine.numbers, True, True, True)  # panels take ten times the memory of values
        return stream(self, P, reduction, executor, progress, block)

    def identity(self) -> str:
        """A digest of equations, start, outputs, times and solver, for `StoredSimulator`."""
        own = (tuple(sorted(self._continued)),) if self._continued else ()
        return connect.digest(self._with_rates.identity(), self.outputs, tuple(self.rules), *own)

    def values(self, p: Array) -> tuple[Array, tuple[str, ...]]:
        """Outputs (n_t, n_y) of the run with parameters p (d,), and names of scalar outputs that are nan.

        A scalar output is nan if its condition never holds.

        Raises
        ------
        SimulationError        if the run fails
        """
        with LOCK:
            traces, Y = self._values(p[None])
        if not traces.ok[0]:
            raise SimulationError(f"{self.name}: {traces.texts[0]}.")
        return Y[0], tuple(name for name in self.figures if np.isnan(Y[0, 0, self.outputs.index(name)]))

    def _values(self, P: Array) -> "tuple[_Traces, Array]":
        """Curves of samples P (N, d), and outputs (N, n_t, n_y). Scalar outputs are nan if a condition never holds,
        unless they are continued."""
        times, grid = self._times_of(self._count)
        traces = self._traces(times, P)
        Y = np.full((len(P), len(self.times), len(self.outputs)), np.nan)
        at = np.searchsorted(times, self.curves.times - _SAME * self._span)
        if self._columns:
            Y[:, :, self._columns] = np.moveaxis(traces.Y[0, : len(self._columns)], 0, 2)[:, at]
        good, count = np.flatnonzero(traces.ok), len(grid) - 1
        panels = _panels(traces, np.repeat(good, count), np.tile(grid[:-1], len(good)), np.tile(grid[1:], len(good)))
        sizes = self._sizes(traces)
        panels = self._refined(panels, sizes, P, traces.stops)
        curves = Curves(panels, panels.is_exact(sizes), sizes, 4 * _BESIDE * self._span)
        # A condition holds at some time if its margin falls to 0. This smallest margin is on one side in each run.
        lowest = [
            curves.figure(rule._replace(kind="minimum", expression=rule.margin)) for rule in self.rules if rule.is_event
        ]
        own = np.repeat(np.reshape(lowest, (-1, 1, len(P))).T, 2, axis=1)
        own = own if traces.reach is None else np.concatenate([traces.reach, own], axis=2)
        traces = traces._replace(reach=own)
        for rule in self.rules:
            values = rule.over(curves.figure(rule)[:, None])
            if rule.name in self._continued and (lacks := np.isnan(values) & traces.ok).any():
                last = rule.end if rule.expression < 0 else curves.figure(rule._replace(kind="final"))[lacks]
                values[lacks] = cast(float, last)
            Y[:, :, self.outputs.index(rule.name)] = values[:, None]
        return traces, Y

    def over_runs(self, P: Array, runs: int) -> tuple[Array, str]:
        """Scalar outputs (n_y,) of the runs of all samples P (N, d) together, and the fault of a failed run.

        The samples are some or all of the `runs` runs of a study.

        The output times are the ends of panels, which are not divided.
        """
        ends = [end for rule in self.rules for end in rule.window]
        grid = distinct(np.concatenate([self.curves.times, ends]), 1e-9 * self._span, ends)
        times = distinct(np.concatenate(panel_nodes(grid[:-1], grid[1:])), _SAME * self._span)
        own, pooled = [rule for rule in self.rules if rule.kind != "percentile"], list[Panels]()
        values = np.empty((len(own), len(P)))
        for some in blocks(len(P), 64):  # the panels of 64 runs fit into a cache
            with LOCK:
                traces = self._traces(times, P[some])
            if traces.texts:
                return np.full(len(self.rules), np.nan), next(iter(traces.texts.values()))
            sample, n = np.repeat(np.arange(len(some)), len(grid) - 1), len(some)
            panels = _panels(traces, sample, np.tile(grid[:-1], n), np.tile(grid[1:], n))
            curves = _unrefined(panels, self._sizes(traces))
            values[:, some] = [curves.figure(rule) for rule in own]
            pooled += [panels] * (len(own) < len(self.rules))
        together = dict(zip(own, values, strict=True))
        if pooled:  # the times of all runs
            panels = Panels.joined([replace(panels, sample=0 * panels.sample) for panels in pooled])
            curves = _unrefined(panels, np.zeros((1, len(panels.nodes))))
            together |= {rule: curves.figure(rule) for rule in self.rules if rule not in own}
        return np.array([rule.over(together[rule][None], runs)[0] for rule in self.rules]), ""

    @cached_property
    def _count(self) -> int:
        """The number of panels of a run before divisions: as many as the nominal run needs."""
        P, count = np.array([list(self.parameters.values())]), self._least_count()
        while True:
            times, grid = self._times_of(count)
            traces = self._traces(times, P)
            if not traces.ok.all():
                return _MOST // 4
            zeros = np.zeros(len(grid) - 1, dtype=np.intp)
            panels = _panels(traces, zeros, grid[:-1], grid[1:])
            sizes = self._sizes(traces)
            off = self._divided(panels, ~panels.is_exact(sizes), sizes, np.full((len(self.rules), 1), -np.inf))
            off &= ~with_stop(panels, traces.stops)
            # Fraction of panels of the nominal run that may be inexact. If more are inexact, all panels are halved.
            if off.mean() <= 0.1 or count >= _MOST:
                return count
            count = min(2 * count, _MOST)

    def _sizes(self, traces: "_Traces") -> Array:
        """Largest absolute values (N, n_c) of the curves of samples; at least the rounding errors of the curves."""
        return np.maximum(np.abs(traces.Y[0]).max(axis=2).T, self.rounding)

    @cached_property
    def rounding(self) -> Array:
        """Absolute values (n_c,) below which curves are rounding errors."""
        form = self.curves.formulation
        x, p, t = ca.SX.sym("x", form.y.numel_in(0)), ca.SX.sym("p", form.y.numel_in(1)), ca.SX.sym("t")
        change = ca.fabs(ca.jacobian(form.y(x, p, t), x)) @ ca.DM(form.dae.state_sizes)
        f = ca.Function("change", [x, p, t], [ca.densify(change)])
        sizes = f(form.dae.state_sizes, form.dae.p_nominal, float(self.curves.times[0])).full().ravel()
        # Size of a curve, divided by its change if all states change by their sizes. Smaller curves are rounding, such
        # as the speed of a fixed point.
        return 1e-6 * np.where(np.isfinite(sizes), sizes, 0.0)

    def _least_count(self) -> int:
        """Half the number of steps of the nominal run, or a larger number for which panels are shorter than pulses."""
        runs = self._with_rates
        runs.runs(np.array([list(self.parameters.values())])).t_failed.sum()
        steps = runs.engine().counts.steps if runs.runs_in_lanes else 0
        return int(np.clip(max(steps / 2, self._span / self.curves.program.longest_step), _LEAST, _MOST))

    def _times_of(self, count: int) -> tuple[Array, Array]:
        ends = self.curves.times[[0, -1]]
        windows = [end for rule in self.rules for end in rule.window]
        # Fraction of a panel by which all panels are shifted. Curves bend at round times, which should not be in the
        # middle of a panel.
        inner = ends[0] + self._span / count * (np.arange(1, count) + 0.137)
        grid = distinct(np.concatenate([ends, inner, windows]), 1e-9 * self._span, windows)
        nodes = panel_nodes(grid[:-1], grid[1:])
        return distinct(np.concatenate([self.curves.times, *nodes]), _SAME * self._span), grid

    def _traces(self, times: Array, P: Array) -> "_Traces":
        """The curves and their rates at times (n_t,), which cover the horizon of the scene."""
        ensemble = self._with_rates.at(times).runs(P, self.threads)
        Y = np.ascontiguousarray(np.moveaxis(ensemble.Y, -1, 0)).reshape(2, -1, len(P), len(times))
        stops: list[Array] = [np.empty(0)] * len(P)
        if isinstance(ensemble, CompiledEnsemble):
            failed = ensemble.failed_samples
            events = [failed.events[failed.events[:, 0] == i, 3] for i in range(len(P))]
            passes = stops if failed.passes is None else [row[np.isfinite(row)] for row in failed.passes]
            stops = [np.concatenate(pair) for pair in zip(events, passes, strict=True)]
        texts = dict(zip(np.flatnonzero(~ensemble.ok).tolist(), ensemble.messages, strict=True))
        return _Traces(times, Y, ensemble.ok, ensemble.t_failed, texts, stops, ensemble.reach)

    def _refined(self, panels: Panels, sizes: Array, P: Array, stops: Sequence[Array]) -> Panels:
        """The panels, divided by means of further runs until the panels are exact or very short."""
        done, has_stops = list[Panels](), any(own.size for own in stops)
        best = np.full((len(self.rules), len(P)), -np.inf)
        for level in range(_LEVELS):
            off = ~panels.is_exact(sizes) & (panels.width > _SHORTEST * self._span)
            divided = self._divided(panels, off, sizes, best)
            if level == 0:
                divided |= self._dips(panels, sizes)
                divided |= with_stop(panels, stops) if has_stops else False
            # Maximum number of panels of a sample that are divided together. A curve with more bends is noise.
            if not divided.any() or divided.sum() > 2**15 * len(P):
                break
            coarse, coarse_off, fine = panels.of(divided), off[:, divided], list[Panels]()
            together = 8 if self._with_rates.runs_in_lanes else len(P)
            used = np.unique(coarse.sample)
            for group in np.array_split(used, -(-len(used) // together)):
                mine = np.isin(coarse.sample, group)
                sample, begin, end = self._parts(coarse.of(mine), coarse_off[:, mine], stops)
                ends = self.curves.times[[0, -1]]
                times = distinct(np.concatenate([ends, *panel_nodes(begin, end)]), _SAME * self._span)
                traces = self._traces(times, P[group])
                if not traces.ok.all():  # these panels stay as they are
                    divided &= ~np.isin(panels.sample, group)
                    continue
                new = _panels(traces, np.searchsorted(group, sample), begin, end)
                fine.append(Panels(sample, begin, end, new.nodes))
            done.append(panels.of(~divided))
            panels = Panels.joined(fine) if fine else panels.of(slice(0, 0))
        return Panels.joined([*done, panels])

    def _parts(self, panels: Panels, off: Mask, stops: Sequence[Array]) -> tuple[Indices, Array, Array]:
        """Samples, begins and ends of the parts of panels. Panels are divided evenly, at stops and around bends.

        In the first division, panels are divided evenly, because most of them are only too long.
        """
        own_stops = with_stop(panels, stops)
        even = ~own_stops & (panels.width > 0.5 * self._span / self._count)
        width = panels.width[even, None] / _PARTS
        begin = panels.begin[even, None] + width * np.arange(_PARTS)
        parts = [(np.repeat(panels.sample[even], _PARTS), begin.ravel(), (begin + width).ravel())]
        bends, beside = panels.bends(), _BESIDE * self._span
        for k in np.flatnonzero(~even):
            a, b, i = panels.begin[k], panels.end[k], int(panels.sample[k])
            near = bends[off[:, k] & np.isfinite(bends[:, k]), k]
            own = stops[i][(stops[i] > a) & (stops[i] < b)]
            kept = [a, b, *own - beside, *own + beside]
            close = _NEAR * (b - a)
            inner = np.concatenate([kept, np.linspace(a, b, _PARTS + 1), near - 0.7 * close, near + 1.3 * close])
            ends = distinct(inner[(inner >= a) & (inner <= b)], beside / 2, kept)
            parts.append((np.full(len(ends) - 1, i), ends[:-1], ends[1:]))
        sample, begin, end = (np.concatenate(some) for some in zip(*parts, strict=True))
        return sample, begin, end

    def _dips(self, panels: Panels, sizes: Array) -> Mask:
        """Mask (n,) of panels in which a condition is true only between nodes.

        The margin of several conditions is the largest of their margins. Between nodes, the margin of another condition
        may be the largest. The polynomial through the nodes does not show this.
        """
        dips = np.zeros(len(panels.sample), dtype=bool)
        for g in {rule.margin for rule in self.rules if rule.margin >= 0}:
            tolerance = TOUCHED * sizes[panels.sample, g]
            above = np.flatnonzero(panels.nodes[g, 0].min(axis=0) > tolerance)
            dips[above] |= (panels.of(above).bernstein(g) @ ON_GRID).min(axis=1) <= tolerance[above]
        return dips

    def _divided(self, panels: Panels, off: Mask, sizes: Array, best: Array) -> Mask:
        """Mask (n,) of inexact panels that may change a scalar output.

        `best` (n_f, N) has the largest value so far of each scalar output and sample. For a scalar output with a
        condition, it is minus the time at which the condition is known to hold. The method updates `best`.
        """
        divided, slack = np.zeros(off.shape[1], dtype=bool), 4 * panels.misfit
        for number, rule in enumerate(self.rules):
            e, g, inside = rule.expression, rule.margin, rule.inside(panels)
            if rule.kind in ("mean", "rms", "percentile", "psd"):
                divided |= inside & (off[e] | (off[g] if g >= 0 else False))
            elif rule.kind in ("maximum", "minimum", "probability"):
                values = (rule.sign * panels.nodes[e, 0, ::2]).max(axis=0)
                np.maximum.at(best[number], panels.sample[inside], values[inside])
                some = np.flatnonzero(inside & off[e])
                high = (rule.sign * panels.of(some).bernstein(e)).max(axis=1) + slack[e, some]
                divided[some] |= high >= best[number, panels.sample[some]]
            elif rule.kind != "final":
                holds = inside & (panels.nodes[g, 0].min(axis=0) < -TOUCHED * sizes[panels.sample, g])
                np.maximum.at(best[number], panels.sample[holds], -panels.end[holds])  # later panels have no effect
                inside &= -panels.begin > best[number, panels.sample]
                some = np.flatnonzero(inside & (off[g] | (off[e] if e >= 0 else False)))
                low = panels.of(some).bernstein(g).min(axis=1) - slack[g, some]
                is_above = panels.nodes[g, 0][:, some].max(axis=0) + slack[g, some] > 0
                divided[some] |= (low <= TOUCHED * sizes[panels.sample[some], g]) & is_above
        return divided


def never_holds(name: str) -> str:
    """Why a run has no value of a scalar output."""
    return f"the condition of output {name!r} never holds until the end of the run"


SceneSimulator = DAESimulator | FigureSimulator
"""The simulators of scenes."""


def motion_of(simulator: object) -> DAESimulator | None:
    """The simulator of the motion of a scene; None for other simulators."""
    simulator = simulator.curves if isinstance(simulator, FigureSimulator) else simulator
    return simulator if isinstance(simulator, DAESimulator) else None


def _unrefined(panels: Panels, sizes: Array) -> Curves:
    """Curves that are polynomials in all panels. `sizes` (N, n_c) are sizes of the curves."""
    return Curves(panels, np.ones(panels.nodes.shape[::3], dtype=bool), sizes, 0.0)


class _Traces(NamedTuple):
    """Curves and rates Y (2, n_c, N, n_t) of samples at times (n_t,), times at which steps end at switches [s], and the
    reach (N, 2, m) of switches, see `Ensemble`."""

    times: Array
    Y: Array
    ok: Mask
    t_failed: Array
    texts: Mapping[int, str]
    stops: Sequence[Array]
    reach: Array | None


def _with_rates(curves: DAESimulator) -> Program:
    """The program of curves with further outputs, which are the rates of the curves."""
    form = curves.formulation
    x, p, t = ca.SX.sym("x", form.y.numel_in(0)), ca.SX.sym("p", form.y.numel_in(1)), ca.SX.sym("t")
    y = ca.densify(form.y(x, p, t))
    rates = ca.jtimes(y, t, ca.SX(1))
    if x.numel():
        rates += ca.jtimes(y, x, ca.densify(ca.vertcat(*map(ca.vec, form.dae.rhs(*form.dae.arguments(x, p, t))))))
    # A speed sqrt(vx^2 + vy^2) has no rate at rest. There the rate is set to 0, and panels are divided.
    rates = ca.if_else(ca.fabs(rates) < ca.inf, rates, 0)
    return curves.program.with_outputs(common("y", [x, p, t], [ca.densify(ca.vertcat(y, rates))]))


def _panels(traces: _Traces, sample: Indices, begin: Array, end: Array) -> Panels:
    """Panels from `begin` (n,) to `end` (n,), which are times of the traces. `sample` (n,) are their sample numbers."""
    half = np.append(np.diff(traces.times) / 2, np.inf)
    at = []
    for time in panel_nodes(begin, end):
        k = np.clip(np.searchsorted(traces.times, time), 1, len(traces.times) - 1)
        at.append(np.where(time - traces.times[k - 1] < half[k - 1], k - 1, k))
    Y = traces.Y.reshape(2, traces.Y.shape[1], -1)
    return Panels(sample, begin, end, Y.take(sample * len(traces.times) + np.stack(at), axis=2).swapaxes(0, 1))
