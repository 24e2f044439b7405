"""The simulator of a declared scene."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from threading import RLock
from typing import Any, TypeVar, cast

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._types import Array, Executor, Mask
from symmb.codegen import REASONS, FailedSamples, cores
from symmb.events import Kinks, broken, kinks
from symmb.integrate import AnyEngine, CompiledSolver, EventDriven, Integration, Run, Solver, impacts_text
from symmb.model import DAE, Scene, compile_dae, unit_of
from symmb.simulation.simulator import BLOCK, Ensemble, Progress, Reduction, Samples, stream
from symmb.simulation.solver_choice import MANY, Pilot, choose, for_studies
from symmb.start import Start, prepare_start, singularity
from symmb.symbolic import batch, jets
from symmb.symbolic import t as time_symbol

S = TypeVar("S")

IRREGULAR = REASONS[1]
_NEIGHBOURS, _NEXT = 7, 1e-3
"""Runs of a pilot next to the nominal one, and how far their parameters are off as a share."""
COMPILED_BLOCK = 1024
"""Samples a block for the engine: enough for its lanes on many cores. Small models whose trajectories nobody looks at
take up to 8 times as many, so that the blocks last much longer than threads take to start."""

_LOCK = RLock()  # CasADi's reference counts are not atomic: Python threads take turns, its own threads do the work


class DAESimulator:
    """Runs a scene for samples of its parameters; compiled once, pickles.

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional      default: what a pilot run shows to be right, mostly DormandPrince()

    Attributes
    ----------
    parameters : dict              name -> nominal value, in the order of the columns of P
    times : (n_t,) array           [s]
    outputs : tuple of str         names of the n_y outputs
    units : tuple of str           of the outputs, '' where the expression does not show it
    solver : Solver
    reason : str                   why this solver, if none was given
    setup_seconds : float          deriving, compiling and starting
    threads : int                  CasADi threads that samples are spread over; 1 in a copy sent elsewhere
    """

    def __init__(self, scene: Scene, solver: Solver | None = None) -> None:
        begin = time.perf_counter()
        self.name = scene.name
        self.parameters = dict(scene.system.parameters)
        self.times = np.asarray(scene.times, dtype=float)
        self.outputs = scene.output_names
        self.units = tuple(unit_of(y) for y in ca.vertsplit(scene.y)) if self.outputs else ()
        whole = compile_dae(scene.system)
        self.start: Start = prepare_start(scene, whole)
        kept = whole if self.start.kept is None else compile_dae(scene.system, self.start.kept)
        self.dae: DAE = replace(kept, scales=self.start.scales(kept, float(np.ptp(self.times))))
        self.y = output_function(self.dae, scene, scene.y)
        self._broken = broken(self.dae, self.start.q_nominal, self.times)
        self.threads = cores()
        self.reason = ""
        if solver is None and self.dae.impacts is not None:
            solver, self.reason = EventDriven(), f"{impacts_text(self.dae.impacts)}: events have to be located"
        if solver is None:
            made: dict[Solver, DAESimulator] = {}
            solver, self.reason = choose(for_studies(), lambda solver: self._pilot(made, solver))
            self.reason += f"; {self._kinks}" if self._kinks else ""
            self.__dict__ = made[solver].__dict__ | {"reason": self.reason}
        else:
            self._take(solver)
        self.setup_seconds = time.perf_counter() - begin

    def __repr__(self) -> str:
        return f"DAESimulator({self.name!r}, {self.solver!r})"

    def __getstate__(self) -> dict[str, Any]:
        # Whoever gets a copy runs many of them side by side already.
        return {**self.__dict__, "threads": 1}

    @property
    def compiled(self) -> bool:
        """Whether samples run in compiled lanes; a scene without states has nothing to integrate."""
        solver = self.solver
        return isinstance(solver, CompiledSolver) and solver.available(self.dae) and self.y.numel_in(0) > 0

    def tighter(self) -> "DAESimulator":
        """The same simulator with a solver ten times more accurate."""
        return self.solved_by(self.solver.tighter())

    def solved_by(self, solver: Solver) -> "DAESimulator":
        """The same simulator with another solver."""
        if solver == self.__dict__.get("solver"):
            return self
        copy = object.__new__(DAESimulator)
        copy.__dict__ = {**self.__dict__, "reason": ""}
        copy._take(solver)
        return copy

    def _take(self, solver: Solver) -> None:
        if self.dae.impacts is not None and not isinstance(solver, EventDriven):
            raise DeclarationError(
                f"{solver!r} does not locate the events of {impacts_text(self.dae.impacts)}. "
                "Use EventDriven(), which is the default there."
            )
        if self._broken and (hasattr(solver, "stabilization") or isinstance(solver, EventDriven)):
            raise DeclarationError(
                f"{self._broken}. {solver!r} integrates accelerations, which know nothing of that: give a law with a "
                "continuous rate, or take a solver that keeps positions itself, such as NSTIFFSI2(step=...)."
            )
        self.solver = solver
        self._integrations: dict[tuple[int, bool], Integration] = {}
        self._engines: dict[int, AnyEngine] = {}
        if self.compiled:
            self.engine()
        else:
            self.integration()

    def _pilot(self, made: dict[Solver, "DAESimulator"], solver: Solver) -> Pilot:
        """A run at the nominal parameters, and some next to them: by luck one passes through a singular position."""
        made[solver] = copy = self.solved_by(solver)
        P = self.dae.p_nominal[None]
        begin = time.perf_counter()
        ensemble = copy.run(P)
        message = ensemble.messages[0] if ensemble.messages else ""
        steps = copy.engine().counts.steps if copy.compiled else copy.integration().statistics().get("steps", 0)
        seconds = time.perf_counter() - begin
        if copy.compiled and not message:
            shares = np.random.default_rng(0).uniform(-_NEXT, _NEXT, (_NEIGHBOURS, P.shape[1]))
            ensemble = copy.run(P * (1 + shares))
            late = ensemble.t_failed[~ensemble.ok] > self.times[0]  # others cannot be assembled by any solver
            message = next((told for told, k in zip(ensemble.messages, late, strict=True) if k), "")
        return Pilot(message, steps, seconds, steps > MANY)

    def integration(self, order: int = 0, work: bool = False) -> Integration:
        """The compiled integration of the Taylor coefficients up to `order`, made when first asked for."""
        key = (order, work)
        if key not in self._integrations:
            self._integrations[key] = self.solver.integration(self.dae, self.times, order=order, work=work)
        return self._integrations[key]

    def run(self, P: Array) -> Samples:
        """Run samples P (N, d); a sample that breaks down is nan from there on."""
        with _LOCK:
            P = np.ascontiguousarray(P, dtype=float)
            if self.compiled:
                return CompiledEnsemble(self, self.engine(), P)
            x0, reasons = self.start.states(P)
            runs = self.integration().run(x0, P, self.threads)
            runs = [replace(run, message=why) if why else run for run, why in zip(runs, reasons, strict=True)]
            return _ensemble(self, self._evaluate(self.y, runs, P), runs, P)

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples block by block and keep only what the reduction keeps."""
        block = BLOCK
        if self.compiled:
            block = COMPILED_BLOCK * (1 if reduction.trajectories else max(1, min(8, 100 // self.y.numel_in(0))))
        return stream(self, P, reduction, executor, progress, block)

    def engine(self, order: int = 0) -> AnyEngine:
        """The outputs, or their Taylor coefficients up to `order`, in compiled lanes; made when first asked for."""
        if order not in self._engines and isinstance(self.solver, CompiledSolver):
            y = _jet_outputs(self.y, self.y.numel_in(0), len(self.parameters), order) if order else self.y
            self._engines[order] = self.solver.engine(
                self.dae, self.times, y, order=order, start=None if order else self.start
            )
        return self._engines[order]

    def _evaluate(self, f: ca.Function, runs: list[Run], P: Array) -> Array:
        """A Function of (x, p, t) along N runs, (N, n_t, n)."""
        n_t, N = len(self.times), len(P)
        X = np.concatenate([run.X for run in runs]) if runs else np.zeros((0, f.numel_in(0)))
        if not f.numel_out(0) or not N:
            return np.zeros((N, n_t, f.numel_out(0)))
        arguments = (X, np.repeat(P, n_t, axis=0), np.tile(self.times, N)[:, None])
        return batch(f, *arguments, threads=self.threads)[0].reshape(N, n_t, -1)

    def jets(self, p0: Array, directions: Array, order: int) -> Array:
        """Taylor coefficients (order + 1, m, n_t, n_y) of the outputs along m directions (m, d), a larger run each.

        Raises
        ------
        SimulationError        if a run breaks down
        """
        with _LOCK:
            directions = np.atleast_2d(np.asarray(directions, dtype=float))
            m = len(directions)
            x0 = np.hstack(self.start.jets(np.asarray(p0, dtype=float), directions, order))
            P = np.hstack([np.tile(p0, (m, 1)), directions])
            shape = (m, len(self.times), order + 1, len(self.outputs))
            if self.compiled:
                Y, failed_samples = self.engine(order).values(x0, P, self.threads)
                t_failed = failed_samples.t_failed
                if not np.isnan(t_failed).all():
                    k = int(np.nanargmin(t_failed))
                    raise SimulationError(self._no_derivatives(p0, t_failed[k], failed_samples.reasons[k]))
                return Y.reshape(shape).transpose(2, 0, 1, 3)
            runs = self.integration(order).run(x0, P, self.threads)
            for run in runs:
                if run.message:
                    raise SimulationError(self._no_derivatives(p0, run.t_failed, run.message))
            f = _jet_outputs(self.y, self.y.numel_in(0), len(p0), order)
            Y = self._evaluate(f, runs, P)
            return Y.reshape(shape).transpose(2, 0, 1, 3)

    def _no_derivatives(self, p0: Array, time: float, why: str) -> str:
        met = self.kink(p0)
        near = f"; the run itself has met {met[1]} by t = {met[0]:g} s" if met else ""
        return f"{self!r}: derivatives break down at t = {time:g} s: {why}{near}."

    @cached_property
    def _kinks(self) -> Kinks | None:
        return kinks(self.dae)

    def kink(self, p0: Array) -> tuple[float, str] | None:
        """When the run at p0 (d,) has first met a kink or a jump that depends on its state [s], and which there are."""
        with _LOCK:
            if self._kinks is None or not self._kinks.on_state.any():
                return None
            p0 = np.asarray(p0, dtype=float)
            x0, _ = self.start.states(p0[None])
            (run,) = self.integration().run(x0, p0[None], 1)
            known = np.isfinite(run.X).all(axis=1)
            first = self._kinks.first(run.X[known], p0, self.times[known])
            return None if np.isnan(first) else (first, str(self._kinks))

    def march(self, P: Array) -> Iterator[tuple[int, Array]]:
        """All samples side by side with a fixed step: (i, Y_i (N, n_y)) for every output time.

        Raises
        ------
        PropagationError       if the solver chooses its steps
        """
        P = np.ascontiguousarray(P, dtype=float)
        x0, _ = self.start.states(P)
        for i, x in self.integration().march(x0, P):
            yield i, batch(self.y, x, P, self.times[i : i + 1])[0]

    @property
    def expression(self) -> ca.Function:
        """(p, t) -> y of a scene without bodies, whose outputs are plain expressions."""
        if self.dae.n_q:
            raise AttributeError("only a scene without bodies has outputs that are plain expressions")
        p, t = ca.SX.sym("p", len(self.parameters)), ca.SX.sym("t")
        return ca.Function("expression", [p, t], [self.y(ca.SX(0, 1), p, t)])


def output_function(dae: DAE, scene: Scene, y: ca.SX) -> ca.Function:
    """(x, p, t) -> y; multipliers and accelerations are computed only if y contains some."""
    system = scene.system
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    at = dae.arguments(x, p, t)
    states = [system.q, system.v, *([system.s] if dae.n_s else []), system.p, time_symbol]
    lam, vdot = ca.SX(system.lam), system.vdot
    plain = ca.Function("plain", [*states, lam, vdot], [ca.densify(y)])
    multipliers, accelerations = ca.SX(*lam.shape), ca.SX(*vdot.shape)
    if dae.gamma is not None and any(ca.which_depends(y, lam, 1, True) or []):
        multipliers = dae.forward(*at, dae.gamma(*at))[1]
        if dae.distribute_multipliers is not None:
            multipliers = dae.distribute_multipliers(*at, multipliers)
    if any(ca.which_depends(y, vdot, 1, True) or []):
        accelerations = dae.rhs(*at)[1]
    return ca.Function("y", [x, p, t], [plain(*at, multipliers, accelerations)], {"cse": True})


def _jet_outputs(y: ca.Function, n_x: int, n_p: int, order: int) -> ca.Function:
    X = [ca.SX.sym(f"x_{j}", n_x) for j in range(order + 1)]
    P = [ca.SX.sym(f"p_{j}", n_p) for j in range(order + 1)]
    t = ca.SX.sym("t")
    coefficients = ca.vertcat(*jets(y(X[0], P[0], t), [X, P]))
    straight = (
        ca.substitute(coefficients, ca.vertcat(*P[2:]), ca.SX.zeros(n_p * (order - 1))) if order > 1 else coefficients
    )
    return ca.Function("jets", [ca.vertcat(*X), ca.vertcat(*P[:2]), t], [straight], {"cse": True})


def _ensemble(simulator: DAESimulator, Y: Array, runs: list[Run], P: Array) -> Ensemble:
    ok = np.array([not run.message and bool(np.isfinite(y).all()) for run, y in zip(runs, Y, strict=True)], dtype=bool)
    t_failed = np.full(len(runs), math.nan)
    for k in np.flatnonzero(~ok):
        first = simulator.times[int(np.argmin(np.isfinite(Y[k]).all(axis=1)))]
        t_failed[k] = runs[k].t_failed if runs[k].message else first
    reasons = [run.message or IRREGULAR for run in runs]
    events = None
    if simulator.dae.impacts is not None:
        when = [[event.time for event in run.events] for run in runs]
        events = np.array([np.searchsorted(times, simulator.times, "right") for times in when], dtype=np.intp)
    told = _messages(simulator, P, t_failed, reasons, lambda k: (runs[k].X, simulator.times))
    return Ensemble(Y, ok, t_failed, told, events)


NAMED = 5
"""Failed samples of a block of which joints are named: as many as are printed."""


def _messages(
    simulator: DAESimulator,
    P: Array,
    t_failed: Array,
    reasons: Sequence[str],
    states: Callable[[int], tuple[Array, Array]],
) -> tuple[str, ...]:
    """A text for each failed sample: time, parameters, reason, and of the first the joints of a singular position.

    `states` of a sample gives some (m, n_x), which may be nan, and their times (m,).
    """
    texts = []
    for k in np.flatnonzero(np.isfinite(t_failed)).tolist():
        values = ", ".join(f"{n} = {v:.6g}" for n, v in zip(simulator.parameters, P[k], strict=True))
        near = None
        if len(texts) < NAMED:
            X, times = states(k)
            known = np.isfinite(X).all(axis=1)
            near = singularity(simulator.dae, X[known], P[k], times[known])
        texts.append(f"t = {t_failed[k]:g} s, {values}: {reasons[k]}{f'; {near}' if near else ''}")
    return tuple(texts)


class CompiledEnsemble:
    """An Ensemble from the engine: only what is asked for, trajectories or extremes, is computed."""

    events = None

    def __init__(self, simulator: DAESimulator, engine: AnyEngine, P: Array) -> None:
        self._simulator, self._engine, self._P = simulator, engine, P
        self._x0 = np.empty((len(P), 0)) if engine.starts else simulator.start.states(P)[0]
        self._losses: FailedSamples | None = None

    @property
    def Y(self) -> Array:
        """(N, n_t, n_y) outputs, nan where a sample failed."""
        return self._values

    @cached_property
    def _values(self) -> Array:
        Y, self._losses = self._engine.values(self._x0, self._P, self._simulator.threads)
        return Y

    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail; inf and -inf without any."""
        if "_values" in self.__dict__:
            return Ensemble(self.Y, self.ok, self.t_failed, ()).extremes()
        lower, upper, self._losses = self._engine.extremes(self._x0, self._P, self._simulator.threads)
        return lower, upper

    def _lost(self) -> FailedSamples:
        if self._losses is None:
            _ = self._values
        return cast(FailedSamples, self._losses)

    @property
    def t_failed(self) -> Array:
        """(N,) time at which a sample failed [s], nan where ok."""
        return self._lost().t_failed

    @property
    def ok(self) -> Mask:
        """(N,) bool."""
        return np.isnan(self.t_failed)

    @property
    def messages(self) -> tuple[str, ...]:
        """One text for each failed sample, in order."""
        lost = self._lost()
        reasons = lost.reasons
        at_once = np.flatnonzero(self.t_failed == self._simulator.times[0])
        with _LOCK:
            told = self._simulator.start.states(self._P[at_once])[1] if at_once.size else ()
        for k, why in zip(at_once.tolist(), told, strict=True):
            reasons[k] = why or reasons[k]
        X = lost.x_failed[:, : self._simulator.y.numel_in(0)]
        return _messages(self._simulator, self._P, lost.t_failed, reasons, lambda k: (X[[k]], lost.t_failed[[k]]))
