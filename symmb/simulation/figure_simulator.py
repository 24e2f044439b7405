"""Runs of a scene with figures of its motion, from runs at times so close together that curves are exact between them."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import casadi as ca
import numpy as np

from symmb._errors import SimulationError
from symmb._options import require_instance
from symmb._types import Array, Executor, Indices, Mask
from symmb.black_boxes import Ensemble, Progress, Reduction, Samples, checked_samples, digest, stream
from symmb.formulations import Formulation
from symmb.model import Scene
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.ensembles import LOCK, CompiledEnsemble
from symmb.simulation.panels import Panels, first_passage, highest, values_at
from symmb.symbolic import common

S = TypeVar("S")

_BLOCK = 64
"""Samples of a block: their values at all times take some MB."""
_LEAST, _MOST = 64, 2048
"""Panels of a run at first."""
_FEW = 0.1
"""Share of panels of the nominal run that are not exact up to which there are enough."""
_PARTS, _LEVELS = 8, 9
"""Parts of a panel that is not exact, and how often it is divided at most."""
_SHORTEST, _BESIDE, _NEAR = 3e-10, 1e-10, 1e-3
"""Width over the horizon below which panels are not divided; distance from an event over the horizon, and from a bend
over the width of the panel, at which they end."""
_SAME = 1e-13
"""Distance over the horizon of times that are the same."""
_TOUCHED = 1e-9
"""Margin over its largest value in a run up to which a condition is touched."""


class _Rule(NamedTuple):
    """How a figure follows from curves: `expression` and `margin` are numbers of curves, -1 without."""

    name: str
    kind: str
    expression: int
    margin: int
    is_strict: bool
    window: tuple[float, float]


class FigureSimulator:
    """A scene with figures of its motion, for studies. It has the interface of `DAESimulator`, but for derivatives.

    Figures are the same at all times; if there is nothing else, there is one time, 0.

    Parameters
    ----------
    scene : Scene
    curves : DAESimulator
        of `scene.curves`
    """

    def __init__(self, scene: Scene, curves: DAESimulator) -> None:
        self.scene: Scene | None = scene
        self.curves, self.name, self.box = curves, scene.name, scene.box
        self.parameters = dict(curves.parameters)
        self.outputs, self.units = scene.output_names, scene.units
        self.times = curves.times if scene.curve_names else np.zeros(1)
        self.solver, self.reason, self.threads = curves.solver, curves.reason, curves.threads
        self._span = float(np.ptp(curves.times))
        self._columns = [self.outputs.index(name) for name in scene.curve_names]
        self._rules, n = list[_Rule](), len(scene.curve_names)
        for name, f in scene.figures.items():
            expression = -1 if f.expression is None else n
            n += f.expression is not None
            self._rules.append(_Rule(name, f.kind, expression, -1 if f.margin is None else n, f.is_strict, f.window))
            n += f.margin is not None
        self._with_rates = _with_rates(curves)
        self._count = 0
        self.doubts: tuple[str, ...] = curves.start.doubts
        self.noise: Array | None = None
        self.nominal: Array | None = None

    def __repr__(self) -> str:
        return repr(self.curves)

    def __getstate__(self) -> dict[str, Any]:
        self._first_times()
        return self.__dict__ | {"scene": None}

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the outputs that are one number a run."""
        return tuple(rule.name for rule in self._rules)

    @property
    def setup_seconds(self) -> float:
        """Time for deriving, compiling and starting so far [s]."""
        return self.curves.setup_seconds + self._with_rates.setup_seconds

    def prepare(self) -> None:
        """Prepare the runs, if they are not prepared yet."""
        self._with_rates.prepare()

    def solved_by(self, curves: DAESimulator) -> "FigureSimulator":
        """The same figures of curves by another solver."""
        other = copy.copy(self)
        vars(other).update(curves=curves, solver=curves.solver, _with_rates=_with_rates(curves), scene=self.scene)
        return other

    def tighter(self) -> "FigureSimulator":
        """The same simulator with a solver ten times more accurate, or more if its steps would be the same."""
        return self.solved_by(self.curves.tighter())

    def second_look(self) -> None:
        """Run the nominal parameters in two ways, at the first time. `doubts` and `noise` tell what is seen."""
        if self.noise is not None:
            return
        self.curves.second_look()
        self.doubts = self.curves.doubts
        P = np.array([list(self.parameters.values())])
        first = self.run(P)
        if not first.ok.all():
            raise SimulationError(f"{self!r}: the nominal run fails: {first.messages[0]}")
        self.nominal = first.Y[0]
        second = self.tighter().run(P)
        off = np.abs(second.Y[0] - self.nominal) if second.ok.all() else np.zeros_like(self.nominal)
        self.noise = off.max(axis=0)

    def run(self, P: Array) -> Samples:
        """Run samples P (N, d) as one block. Outputs of a sample are nan after its failure."""
        P = np.ascontiguousarray(checked_samples(self, P, None))
        with LOCK:
            return self._run(P)

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples block by block, and reduce each block."""
        require_instance("stream: reduction", reduction, Reduction, "a Reduction")
        return stream(self, P, reduction, executor, progress, _BLOCK)

    def identity(self) -> str:
        """A digest of equations, start, outputs, times and solver, for `StoredSimulator`."""
        return digest(self._with_rates.identity(), self.outputs, tuple(self._rules))

    def _run(self, P: Array) -> Ensemble:
        times, grid = self._first_times()
        traces = self._traces(times, P)
        ok, t_failed, texts = traces.ok.copy(), traces.t_failed.copy(), dict(traces.texts)
        Y = np.full((len(P), len(self.times), len(self.outputs)), np.nan)
        at = np.searchsorted(times, self.curves.times - _SAME * self._span)
        if self._columns:
            Y[:, :, self._columns] = traces.Y[:, :, : len(self._columns), 0][:, at]
        good = np.flatnonzero(ok)
        panels = _panels(traces, np.repeat(good, len(grid) - 1), np.tile(grid[:-1], len(good)), np.tile(grid[1:], len(good)))
        sizes = np.abs(traces.Y[..., 0]).max(axis=1)
        panels = self._refined(panels, sizes, P, traces.stops)
        numbers = np.searchsorted(panels.sample, np.arange(len(P) + 1))
        exact = panels.is_exact(sizes[panels.sample])
        for rule in self._rules:
            column = self.outputs.index(rule.name)
            for i in good[ok[good]]:
                own = np.arange(numbers[i], numbers[i + 1])
                value = _value(rule, panels.of(own), exact[own], sizes[i], _BESIDE * self._span)
                if value is None:
                    ok[i], t_failed[i] = False, rule.window[1]
                    texts[i] = f"the condition of output {rule.name!r} does not hold in the run"
                else:
                    Y[i, :, column] = value
        Y[~ok] = np.nan
        messages = [texts[i] if not traces.ok[i] else self._text(P[i], t_failed[i], texts[i]) for i in np.flatnonzero(~ok)]
        return Ensemble(Y, ok, t_failed, tuple(messages))

    def _text(self, p: Array, time: float, reason: str) -> str:
        values = "".join(f", {name} = {value:.6g}" for name, value in zip(self.parameters, p, strict=True))
        return f"t = {time:g} s{values}: {reason}"

    def _first_times(self) -> tuple[Array, Array]:
        """Times of runs at first, and the ends of their panels: as many as the nominal run needs."""
        P, count = np.array([list(self.parameters.values())]), self._count or _LEAST
        while not self._count:
            times, grid = self._times_of(count)
            traces = self._traces(times, P)
            if not traces.ok.all():
                self._count = _MOST // 4
                break
            zeros = np.zeros(len(grid) - 1, dtype=np.intp)
            panels = _panels(traces, zeros, grid[:-1], grid[1:])
            sizes = np.abs(traces.Y[..., 0]).max(axis=1)
            off = ~panels.is_exact(sizes[panels.sample])[:, len(self._columns) :].all(axis=1)
            stops = np.searchsorted(np.sort(traces.stops[0]), [panels.begin, panels.end])
            off &= stops[0] == stops[1]
            if off.mean() <= _FEW or count >= _MOST:
                self._count = count
            count = min(2 * count, _MOST)
        return self._times_of(self._count)

    def _times_of(self, count: int) -> tuple[Array, Array]:
        ends = self.curves.times[[0, -1]]
        windows = [end for rule in self._rules for end in rule.window]
        grid = _distinct(np.concatenate([np.linspace(*ends, count + 1), windows]), 1e-9 * self._span, windows)
        return _distinct(np.concatenate([self.curves.times, *_nodes(grid[:-1], grid[1:])]), _SAME * self._span), grid

    def _traces(self, times: Array, P: Array) -> "_Traces":
        """The curves and their rates at times (n_t,) that begin and end with the scene."""
        ensemble = self._with_rates.at_times(times).run(P)
        Y, n = ensemble.Y, self.curves.y.numel_out(0)
        Y = np.stack([Y[..., :n], Y[..., n:]], axis=-1)
        stops: list[Array] = [np.empty(0)] * len(P)
        if isinstance(ensemble, CompiledEnsemble):
            failed = ensemble.failed_samples
            events = [failed.events[failed.events[:, 0] == i, 3] for i in range(len(P))] if len(failed.events) else stops
            passes = stops if failed.passes is None else [row[np.isfinite(row)] for row in failed.passes]
            stops = [np.concatenate(pair) for pair in zip(events, passes, strict=True)]
        texts = dict(zip(np.flatnonzero(~ensemble.ok).tolist(), ensemble.messages, strict=True))
        return _Traces(times, Y, ensemble.ok, ensemble.t_failed, texts, stops)

    def _refined(self, panels: Panels, sizes: Array, P: Array, stops: Sequence[Array]) -> Panels:
        """Panels that are divided, in further runs, until they are exact or so short that it does not matter."""
        nothing, has_stops = panels.of(slice(0, 0)), any(own.size for own in stops)
        for level in range(_LEVELS):
            off = ~panels.is_exact(sizes[panels.sample]) & (panels.width > _SHORTEST * self._span)[:, None]
            divided = self._relevant(panels, off, sizes)
            if level == 0 and has_stops:
                divided |= _with_stop(panels, stops)
            if not divided.any():
                break
            coarse = panels.of(divided)
            together = 8 if self._with_rates.compiled else len(P)
            used, fine = np.unique(coarse.sample), nothing
            for group in np.array_split(used, -(-len(used) // together)):
                some = coarse.of(np.isin(coarse.sample, group))
                sample, begin, end = self._parts(some, off[divided][np.isin(coarse.sample, group)], stops)
                ends = self.curves.times[[0, -1]]
                times = _distinct(np.concatenate([ends, *_nodes(begin, end)]), _SAME * self._span)
                traces = self._traces(times, P[group])
                if not traces.ok.all():  # only the run at first counts
                    continue
                new = _panels(traces, np.searchsorted(group, sample), begin, end)
                fine = fine.sorted_with(Panels(sample, begin, end, new.nodes))
                divided_here = np.isin(panels.sample, group) & divided
                panels = panels.of(~divided_here)
                divided = divided[~divided_here]
            panels = panels.sorted_with(fine)
        return panels

    def _parts(self, panels: Panels, off: Mask, stops: Sequence[Array]) -> tuple[Indices, Array, Array]:
        """Samples, begins and ends of the parts into which panels are divided: at stops, about bends, and evenly."""
        sample, begin, end = [], [], []
        bends, shortest = panels.bends(), _BESIDE * self._span
        for k in range(len(panels)):
            a, b, i = panels.begin[k], panels.end[k], int(panels.sample[k])
            near = bends[k][off[k] & np.isfinite(bends[k])]
            own = stops[i][(stops[i] > a) & (stops[i] < b)]
            inner = [np.linspace(a, b, _PARTS + 1)[1:-1]]
            inner += [own - shortest, own + shortest, near - _NEAR * (b - a), near + _NEAR * (b - a)]
            kept = _distinct(np.concatenate([[a, b], *inner]), shortest / 2, [a, b, *own - shortest, *own + shortest])
            kept = kept[(kept >= a) & (kept <= b)]
            sample.append(np.full(len(kept) - 1, i))
            begin.append(kept[:-1])
            end.append(kept[1:])
        return np.concatenate(sample), np.concatenate(begin), np.concatenate(end)

    def _relevant(self, panels: Panels, off: Mask, sizes: Array) -> Mask:
        """(n,) whether curves of panels are off in a way that may count for a figure."""
        some = np.zeros(len(panels), dtype=bool)
        slack, values = 4 * panels.misfit, panels.nodes[..., 0]
        for rule in self._rules:
            inside = _inside(panels, rule.window)
            e, g = rule.expression, rule.margin
            if rule.kind == "mean":
                some |= inside & off[:, e]
            elif rule.kind in ("maximum", "minimum"):
                sign = 1.0 if rule.kind == "maximum" else -1.0
                B = sign * panels.bernstein(e, np.ones(len(panels), dtype=bool))
                best = np.full(len(sizes), -np.inf)
                np.maximum.at(best, panels.sample[inside], sign * values[inside, :, e].reshape(-1, 3)[:, 0])
                np.maximum.at(best, panels.sample[inside], sign * values[inside, :, e].reshape(-1, 3)[:, 2])
                some |= inside & off[:, e] & (B.max(axis=1) + slack[:, e] >= best[panels.sample])
            elif rule.kind != "final":
                B = panels.bernstein(g, np.ones(len(panels), dtype=bool))
                low = B.min(axis=1) - slack[:, g] <= _TOUCHED * sizes[panels.sample, g]
                own = off[:, g] | (off[:, e] if e >= 0 else False)
                some |= inside & own & low & (values[:, :, g].max(axis=1) + slack[:, g] > 0)
        return some


class _Traces(NamedTuple):
    """Curves of samples at times (n_t,): Y (N, n_t, n_c, 2) with their rates, and when the steps of samples meet kinks."""

    times: Array
    Y: Array
    ok: Mask
    t_failed: Array
    texts: Mapping[int, str]
    stops: Sequence[Array]


def _with_rates(curves: DAESimulator) -> DAESimulator:
    """The simulator with the rates of its outputs behind them."""
    form = curves.formulation
    x, p, t = ca.SX.sym("x", form.y.numel_in(0)), ca.SX.sym("p", form.y.numel_in(1)), ca.SX.sym("t")
    y = ca.densify(form.y(x, p, t))
    rates = ca.jtimes(y, t, ca.SX(1))
    if x.numel():
        rates += ca.jtimes(y, x, ca.densify(ca.vertcat(*map(ca.vec, form.dae.rhs(*form.dae.arguments(x, p, t))))))
    return curves.with_outputs(common("y", [x, p, t], [ca.densify(ca.vertcat(y, rates))]))


def _nodes(begin: Array, end: Array) -> tuple[Array, Array, Array]:
    return begin, (begin + end) / 2, end


def _distinct(times: Array, distance: float, kept: Sequence[float] = ()) -> Array:
    """Times in order, each more than a distance behind the last one, in favour of those to be kept and of the ends."""
    times = np.sort(times)
    priority = np.isin(times, [*kept, times[0], times[-1]])
    chosen = [0]
    for k in np.flatnonzero(np.diff(times) > 0) + 1:
        if times[k] - times[chosen[-1]] > distance or (priority[k] and priority[chosen[-1]]):
            chosen.append(int(k))
        elif priority[k]:
            chosen[-1] = int(k)
    return times[chosen]


def _panels(traces: _Traces, sample: Indices, begin: Array, end: Array) -> Panels:
    """Panels between times of traces, sample numbers being those of traces."""
    half = np.append(np.diff(traces.times) / 2, np.inf)
    at = []
    for time in _nodes(begin, end):
        k = np.clip(np.searchsorted(traces.times, time), 1, len(traces.times) - 1)
        at.append(np.where(time - traces.times[k - 1] < half[k - 1], k - 1, k))
    return Panels(sample, begin, end, traces.Y[sample[:, None], np.stack(at, axis=1)])


def _with_stop(panels: Panels, stops: Sequence[Array]) -> Mask:
    """(n,) panels within which steps of their samples end."""
    has = np.zeros(len(panels), dtype=bool)
    for i, own in enumerate(stops):
        if own.size:
            mine = panels.sample == i
            counts = np.searchsorted(np.sort(own), [panels.begin[mine], panels.end[mine]])
            has[mine] = counts[0] < counts[1]
    return has


def _inside(panels: Panels, window: tuple[float, float]) -> Mask:
    middle = (panels.begin + panels.end) / 2
    return np.asarray((middle > window[0]) & (middle < window[1]))


def _value(rule: _Rule, panels: Panels, exact: Mask, sizes: Array, beside: float) -> float | None:
    """A figure of one sample from its panels, in order; None if its condition does not hold."""
    own = _inside(panels, rule.window)
    panels, exact = panels.of(own), exact[own]
    e = rule.expression
    if rule.kind == "final":
        return float(panels.nodes[-1, 2, e, 0])
    if rule.kind == "mean":
        integrals = panels.width * panels.bernstein(e, exact[:, e]).mean(axis=1)
        return float(integrals.sum() / panels.width.sum())
    if rule.kind in ("maximum", "minimum"):
        sign = 1.0 if rule.kind == "maximum" else -1.0
        B = sign * panels.bernstein(e, exact[:, e])
        best = float(B[:, [0, -1]].max())
        higher = B[B.max(axis=1) > best]
        return sign * max([best, *highest(higher)[1].tolist()]) if len(higher) else sign * best
    found = _first(rule, panels, exact, sizes[rule.margin], beside)
    if found is None:
        return None
    k, x = found
    if rule.kind == "first_time":
        return float(panels.begin[k] + x * panels.width[k])
    if not exact[k, e]:
        return float(panels.nodes[k, 0, e, 0])
    return float(values_at(panels.bernstein(e, exact[:, e])[k], np.array(x)))


def _first(rule: _Rule, panels: Panels, exact: Mask, size: float, beside: float) -> tuple[int, float] | None:
    """Number of the panel, and the place in it, where a condition first holds; None if it does not."""
    g = rule.margin
    B = panels.bernstein(g, exact[:, g])
    ends = panels.nodes[:, :, g, :]
    tolerance = np.full(len(panels), _TOUCHED * size)
    short = panels.width <= 4 * beside
    tolerance[short] += (np.abs(ends[short, :, 1]).max(axis=1)) * panels.width[short]
    start, rate = ends[0, 0]
    if start < -tolerance[0] or (start <= tolerance[0] and (not rule.is_strict or rate < 0)):
        return 0, 0.0
    return first_passage(B, start, tolerance)
