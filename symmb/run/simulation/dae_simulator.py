"""The simulator of a declared scene."""

import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from importlib.metadata import version as symmb_version
from typing import Any, TypeVar, cast

import casadi as ca
import numpy as np

from symmb._errors import SimulationError, SymmbWarning, WithWarnings
from symmb._interrupts import kept_interrupts
from symmb._names import ByName
from symmb._options import require_instance, require_numbers, whole
from symmb._types import Array, Executor, Indices
from symmb.connect import Progress, Reduction, Samples, checked_samples, digest, stream
from symmb.declare.mechanics import FlexibleBody
from symmb.declare.symbolic import HIGHEST_ORDER, batch
from symmb.equations.model import DAE, Scene
from symmb.run.codegen import SLOW, Engine, compiler_advice, cores, has_compiler
from symmb.run.events import broken
from symmb.run.formulations import Formulation, formulations, jet_outputs, outputs_along
from symmb.run.integrate import (
    CVODES,
    CompiledSolver,
    EventDriven,
    Integration,
    Solver,
    SwitchPasses,
    follow_doubts,
    impacts_text,
    refined,
    round_otherwise,
    solver_of,
)
from symmb.run.simulation.ensembles import LOCK, CompiledEnsemble, block_size, ensemble_of_expressions, ensemble_of_runs
from symmb.run.simulation.solver_choice import MANY, Pilot, another, choose, for_studies, require_able
from symmb.run.verification import LinearTheory, TwoWays, noise_of_outputs, times_to_compare

S = TypeVar("S")

_TIGHTENINGS = 4
"""Most times that a solver is made ten times more accurate until its run changes; exact runs never do."""
_NEIGHBOURS, _NEIGHBOUR_DISTANCE = 7, 1e-3
"""Runs of a pilot beside the nominal one, and the distance of their parameters, as a share of the nominal values."""
_LONG = 10_000
"""Operations of the rows of loops in coordinates of bodies above which their equations are not derived to judge runs:
those of a robot arm with 25,000 take a minute. `tests/benchmarks/real_robots.py` has such ones."""


class DAESimulator(WithWarnings):
    """A scene that is prepared for runs: its equations, its start and its solver. `prepare` makes it.

    It runs samples of the parameters. It compiles once, at its first run, and it can be pickled.

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional
        default: pilot runs choose it here, mostly DormandPrince()

    Attributes
    ----------
    scene : Scene
    parameters : dict
        name -> nominal value, in the order of the columns of P
    times : (n_t,) array
        [s]
    outputs : tuple of str
        names of the n_y outputs over time
    units : tuple of str
        of the outputs, '' where they do not follow from the expression
    solver : Solver
    reason : str
        why symmb chose this solver and these coordinates; empty if they were given
    setup_seconds : float
        time for deriving, compiling and starting so far [s]
    threads : int
        CasADi threads for samples; 1 in a pickled copy
    bodies : Formulation
        in coordinates of the bodies
    doubts : tuple of str
        what cannot be trusted about the start and, after `second_look`, about runs at the nominal parameters
    noise : (n_y,) array
        how far outputs may be off, by errors of the solver's steps and as far as the nominal run is; None before
        `second_look`
    nominal : (n_t, n_y) array
        outputs of the nominal run; None before `second_look`

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> simulator = mb.DAESimulator(scene)
    >>> simulator.run([[3.9], [4.1]]).Y[:, -1].round(4)
    array([[-0.6909],
           [-0.6152]])
    """

    @kept_interrupts()
    def __init__(self, scene: Scene, solver: Solver | str | None = None) -> None:
        require_instance("DAESimulator", scene, Scene, "a Scene")
        solver = solver_of(solver)
        begin = time.perf_counter()
        self.scene, self.name, self.box = scene, scene.name, scene.box
        self.parameters = ByName(scene.system.parameters)
        self.times = np.asarray(scene.times, dtype=float)
        self.outputs, self.units = scene.curve_names, scene.curve_units
        self.bodies, self._joints, self._spare = formulations(scene)
        self.dae, self.start, self.y = self.bodies.dae, self.bodies.start, self.bodies.y
        self._contradiction = broken(self.dae, self.start.q_nominal, self.times)
        self.threads = cores()
        self._is_flexible = any(isinstance(body, FlexibleBody) for body in scene.system.bodies)
        self.setup_seconds, reason = 0.0, ""
        if solver is None and self.dae.impacts is not None:
            solver, reason = EventDriven(), f"{impacts_text(self.dae.impacts)}: events have to be located"
        self._use(solver or for_studies().first)
        if solver is None:
            reason = self._choose()
        self.reason = "; ".join(filter(None, (reason, self.formulation.why)))
        self.setup_seconds = time.perf_counter() - begin

    def __repr__(self) -> str:
        return f"DAESimulator({self.name!r}, {self.solver!r})"

    def __getstate__(self) -> dict[str, Any]:
        self.prepare()
        state = {name: value for name, value in self.__dict__.items() if name not in ("_other", "theory")}
        scene = self.scene if self._is_flexible else None  # nothing else of a study asks for it
        # A copy is one of many that run in parallel.
        return state | {"scene": scene, "_ways": {}, "_single": [], "threads": 1}

    def _choose(self) -> str:
        """Choose the solver by pilot runs, and keep what the pilot compiled in the same coordinates; the reason."""
        pilots: dict[Solver, DAESimulator] = {}
        solver, reason = choose(for_studies, lambda solver: self._pilot(pilots, solver))
        pilot = pilots[solver]
        integrations, engines, coordinates = pilot._integrations, pilot._engines, pilot.coordinates
        self._use(solver)
        if self.coordinates == coordinates:
            self._integrations, self._engines = integrations, engines
        if not (has_compiler() or self._stateless):
            warnings.warn(f"No C compiler found. {SLOW} {compiler_advice()}", SymmbWarning, stacklevel=2)
        return "; ".join(filter(None, (reason, str(self.formulation.kinks(self.times) or ""))))

    @property
    def formulation(self) -> Formulation:
        """Equations, start and outputs in the coordinates in which the solver runs."""
        return self._joints if self._joints is not None and self.solver.takes_any_coordinates else self.bodies

    @property
    def least_constrained(self) -> Formulation:
        """Equations, start and outputs in the coordinates that the fewest rows of constraints bind."""
        return min(filter(None, (self.bodies, self._joints, self._spare)), key=lambda form: form.dae.n_r)

    def shortest_equations(self, X: Array, p: Array) -> tuple[Array, DAE]:
        """Equations and their states (m, n_x) where the bodies have states X.

        They are those of the joints where these have no loops or those of the bodies are long, else of the bodies.
        """
        tree = self.least_constrained
        if tree.bodies is None or (tree.has_loops and self.bodies.least_operations <= _LONG):
            return X, self.dae
        return batch(tree.bodies.joints(), X, p)[0], tree.dae

    @property
    def coordinates(self) -> str:
        """The coordinates in which samples run: "joint" or "body"."""
        return "joint" if self.formulation is self._joints else "body"

    @property
    def _stateless(self) -> bool:
        """Whether nothing is integrated: no bodies, or welded ones in coordinates of joints."""
        return self.formulation.y.numel_in(0) == 0

    @property
    def compiled(self) -> bool:
        """Whether samples run in compiled lanes. A scene without states is not integrated."""
        return self.solver.runs_in_lanes(self.formulation.dae) and not self._stateless

    def around(self, p: Array) -> "DAESimulator":
        """The same simulator for runs with parameters p (n_p,): steps follow the pulses of functions of time there."""
        bodies = self.bodies.around(p)
        joints, spare = (form and form.around(p) for form in (self._joints, self._spare))
        copy = self._with(bodies=bodies, dae=bodies.dae, _joints=joints, _spare=spare, _longest_step=None)
        if copy.longest_step != self.longest_step:
            copy._use(self.solver)  # what is compiled follows other pulses
        return copy

    def _with(self, **changes: object) -> "DAESimulator":
        copy = object.__new__(DAESimulator)
        vars(copy).update(vars(self) | changes)
        return copy

    def cautious(self) -> "DAESimulator":
        """The formulation that judges solvers. Loops run in coordinates of bodies, whose steps are short near singular
        positions.

        Loops of many bodies run in coordinates of joints, because the equations of the bodies take minutes to derive.
        """
        loops = self._joints is not None and self._joints.why and self._joints.dae.n_c and self._joints.has_loops
        return self._in_bodies if loops and self.bodies.least_operations <= _LONG else self

    @property
    def longest_step(self) -> float:
        """A step [s] shorter than every pulse of a function of time at the nominal parameters; infinite without
        pulses."""
        if self._longest_step is None:
            self._longest_step = float(self.formulation.pulses(self.times)(self.dae.p_nominal[None])[0])
        return self._longest_step

    @cached_property
    def _in_bodies(self) -> "DAESimulator":
        copy = self._with(_joints=None, _spare=self._joints)
        copy._use(self.solver)
        return copy

    def prepare(self) -> None:
        """Prepare the runs, if they are not prepared yet."""
        _ = self._lanes() or self.integration()

    def _lanes(self, order: int = 0) -> Engine | None:
        """The engine, if samples run in compiled lanes."""
        return self.engine(order) if self.compiled else None

    def with_output_function(self, y: ca.Function) -> "DAESimulator":
        """The same simulator with outputs y (x, p, t), in the coordinates in which the samples run."""
        form = replace(self.formulation, y=y)
        copy = self._with(_joints=form) if form.bodies else self._with(bodies=form, _joints=None, _spare=None, y=y)
        copy._use(self.solver)
        return copy

    def at_times(self, times: Array) -> "DAESimulator":
        """The same simulator at other times, which begin and end as its own. Nothing is compiled again."""
        if self.compiled:
            self._lanes()
        engines = {order: engine.at(times) for order, engine in self._engines.items()}
        return self._with(times=times, _engines=engines, _integrations={}, _single=[], _outputs={}, _ways={})

    def tighter(self) -> "DAESimulator":
        """The same simulator with a solver ten times more accurate, or more if its steps would be the same."""
        P = self.dae.p_nominal[None]
        nominal = self.run(P)
        finer = self.solved_by(self.solver.tighter(times=self.times))
        if self.dae.impacts is not None and nominal.ok.size:
            round_otherwise(finer.engine(), self.engine())
            return finer
        for _ in range(_TIGHTENINGS if nominal.ok.all() and not self._stateless else 0):
            if not np.array_equal(finer.run(P).Y, nominal.Y):
                break
            next_one = self.solved_by(finer.solver.tighter(times=self.times))
            if not next_one.run(P).ok.all():  # below rounding
                break
            finer = next_one
        return finer

    def solved_by(self, solver: Solver) -> "DAESimulator":
        """The same simulator with another solver."""
        if solver == self.solver:
            return self
        copy = self._with(reason="")
        copy._use(solver)
        return copy

    def _use(self, solver: Solver) -> None:
        require_able(solver, self.dae, self.times, self._contradiction)
        self.solver = solver
        self._integrations: dict[int, Integration] = {}
        self._engines: dict[int, Engine] = {}
        self._single: list[tuple[Integration, Array, Indices]] = []
        self._ways: dict[bytes, TwoWays] = {}
        self._outputs: dict[bytes, Array] = {}
        self._longest_step: float | None = None
        self.doubts: tuple[str, ...] = self.start.doubts
        self.noise: Array | None = None
        self.nominal: Array | None = None
        for of_another_solver in ("_other", "_in_bodies"):
            self.__dict__.pop(of_another_solver, None)

    def _pilot(self, pilots: dict[Solver, "DAESimulator"], solver: Solver) -> Pilot:
        pilots[solver] = copy = self.cautious().solved_by(solver)
        copy.prepare()
        p, begin = self.dae.p_nominal, time.perf_counter()
        ensemble = copy.run(p[None])
        message = ensemble.messages[0] if ensemble.messages else ""
        seconds = time.perf_counter() - begin
        steps = copy.engine().counts.steps if copy.compiled else copy.integration().statistics().get("steps", 0)
        if copy.compiled and not message:  # the nominal run may pass a singular position by chance
            shares = np.random.default_rng(0).uniform(-_NEIGHBOUR_DISTANCE, _NEIGHBOUR_DISTANCE, (_NEIGHBOURS, len(p)))
            ensemble = copy.run(p * (1 + shares))
            late = ensemble.t_failed[~ensemble.ok] > self.times[0]  # no solver can start the others
            message = next((text for text, k in zip(ensemble.messages, late, strict=True) if k), "")
        return Pilot(message, steps, seconds, steps > MANY)

    @property
    def way(self) -> str:
        """The solver, and the coordinates in which it runs."""
        return f"{self.solver!r} in coordinates of {'joints' if self.coordinates == 'joint' else 'bodies'}"

    def another_way(self, times: Array, finest: bool = False) -> "DAESimulator":
        """The same simulator by a solver of another family, and in other coordinates if the scene has any."""
        # With impacts, or drives whose rates jump, there is one family only.
        if self.dae.impacts is not None or self._contradiction or self._stateless:
            return self.tighter()
        joints = None if self.coordinates == "joint" else self._spare
        other = self._with(_joints=joints, times=times, reason="")
        other._use(solver := another(self.solver, finest))
        if isinstance(solver, CVODES):
            other._integrations[0] = solver.independent_integration(other.formulation.dae, times, finest)
        return other

    def two_ways(self, p: Array, values: Array | None = None, finest: bool = False) -> TwoWays:
        """The run with parameters p (n_p,), with outputs (n_t, n_y) or as studies make it, and one in another way.

        It takes the more accurate second way if `finest` is true, or if the ways disagree.
        """
        other, key = self._other if values is None else self.another_way(self.times), p.tobytes() + bytes([finest])
        if values is not None or key not in self._ways:
            Y = self._outputs_at(p) if values is None else values
            ways = TwoWays.of(self, self.another_way(other.times, finest=True) if finest else other, p, Y)
            if not finest and ways.lost.any():
                ways = TwoWays.of(self, self.another_way(other.times, finest=True), p, Y)
            if ways.message:  # the same family of solvers tells less, but more than nothing
                tighter = self._with(times=other.times, reason="")
                tighter._use(self.solver.tighter(times=self.times))
                by_itself = TwoWays.of(self, tighter, p, Y)
                ways = ways if by_itself.message else replace(by_itself, unchecked=ways.unchecked)
            self._ways[key] = ways
        return self._ways[key]

    def _outputs_at(self, p: Array) -> Array:
        """Outputs (n_t, n_y) of the run with parameters p (n_p,), which is made once."""
        key = p.tobytes()
        if key not in self._outputs:
            self._outputs[key] = self.run(p[None]).Y[0]
        return self._outputs[key]

    @cached_property
    def _other(self) -> "DAESimulator":
        return self.another_way(self.times[times_to_compare(self.times)])

    @cached_property
    def theory(self) -> LinearTheory:
        """That of flexible bodies."""
        scene = self.scene if self._is_flexible else None
        return LinearTheory(scene, lambda: self._other if self.compiled else self)

    def second_look(self) -> None:
        """Run the nominal parameters in two ways, at the first time. `warnings` and `noise` say what is seen."""
        if self.noise is None:
            p, rtol = self.dae.p_nominal, getattr(self.solver, "rtol", None)
            steps = noise_of_outputs(self.y, self.dae, self.start.states(p[None])[0][0], p, float(self.times[0]), rtol)
            ways, self.nominal = self.two_ways(p), self._outputs_at(p)
            self.doubts = (*self.start.doubts, *follow_doubts(self.dae), *self.theory.doubts(p), *ways.doubts)
            self.noise = np.maximum(steps, ways.error.max(axis=0, initial=0.0))

    def single(self) -> tuple[Integration, Array, Indices]:
        """The integration of one run with its work, its times (m,), and where the output times stand among them.

        The times are close together where this leaves the steps as they are.
        """
        if not self._single:
            dae, fine, outputs = self.formulation.dae, self.times, np.arange(len(self.times))
            if self.solver.has_dense_output(dae):
                fine, outputs = refined(self.times)
            work = dae.power is not None or dae.impacts is not None
            self._single.append((self.solver.integration(dae, fine, work=work), fine, outputs))
        return self._single[0]

    def integration(self, order: int = 0) -> Integration:
        """The compiled integration of the Taylor coefficients up to `order`, built at its first use."""
        if order not in self._integrations:
            begin = time.perf_counter()
            self._integrations[order] = self.solver.integration(self.formulation.dae, self.times, order=order)
            self.setup_seconds += time.perf_counter() - begin
        return self._integrations[order]

    def engine(self, order: int = 0) -> Engine:
        """The outputs, or their Taylor coefficients up to `order`, in compiled lanes, built at the first use."""
        solver = cast(CompiledSolver, self.solver)
        if order not in self._engines:
            begin = time.perf_counter()
            y = jet_outputs(self.formulation.y, order) if order else self.formulation.y
            start = None if order else self.formulation.start
            self._engines[order] = solver.engine(self.formulation.dae, self.times, y, order=order, start=start)
            self.setup_seconds += time.perf_counter() - begin
        return self._engines[order]

    def run(self, P: Array) -> Samples:
        """Run samples P (N, d). Outputs of a sample are nan after its failure."""
        with LOCK:
            P = np.ascontiguousarray(checked_samples(self, P, None))
            if (lanes := self._lanes()) is not None:
                return CompiledEnsemble(self.formulation, lanes, P, float(self.times[0]), self.threads)
            if self._stateless:
                return ensemble_of_expressions(self.formulation, P, self.times, self.threads)
            x0, reasons = self.formulation.start.states(P)
            runs = self.integration().run(x0, P, self.threads)
            runs = [replace(run, message=why) if why else run for run, why in zip(runs, reasons, strict=True)]
            Y = outputs_along(self.formulation.y, runs, P, self.times, self.threads)
            return ensemble_of_runs(self.formulation, self.times, Y, runs, P)

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples block by block, and reduce each block."""
        require_instance("stream: reduction", reduction, Reduction, "a Reduction")
        n_x, values = self.formulation.y.numel_in(0), len(self.times) * len(self.outputs)
        block = block_size(n_x, values, self.compiled, reduction.trajectories)
        return stream(self, P, reduction, executor, progress, block)

    def jets(self, p0: Array, directions: Array, order: int) -> Array:
        """Taylor coefficients (order + 1, m, n_t, n_y) of the outputs along m directions (m, d), by larger runs.

        The point p0 is (d,), or (m, d) with one for each direction.

        Raises
        ------
        SimulationError
            If a run breaks down
        """
        with LOCK:
            d = len(self.parameters)
            directions = np.atleast_2d(require_numbers("jets", "directions", directions, d, leading=True))
            points = np.broadcast_to(require_numbers("jets", "p0", p0, d, leading=True), directions.shape)
            order = whole("jets", "order", order, 0, HIGHEST_ORDER)
            m, form = len(directions), self.formulation
            x0, P = np.hstack(form.start.jets(points, directions, order)), np.hstack([points, directions])
            fault: tuple[float, str, int] | None = None
            if (lanes := self._lanes(order)) is not None:
                Y, failed = lanes.values(x0, P, self.threads)
                if np.isfinite(failed.t_failed).any():
                    k = int(np.nanargmin(failed.t_failed))
                    fault = failed.t_failed[k], failed.reasons[k], k
            else:
                runs, y = self.integration(order).run(x0, P, self.threads), jet_outputs(form.y, order)
                fault = next(((run.t_failed, run.message, k) for k, run in enumerate(runs) if run.message), None)
                Y = outputs_along(y, runs, P, self.times, self.threads)
            if fault:
                kink = self.kink(points[fault[2]])
                near = f"; the run itself has met {kink[1]} by t = {kink[0]:g} s" if kink else ""
                text = f"t = {fault[0]:g} s: {fault[1]}{near}"
                raise SimulationError(f"{self!r}: derivatives break down at {text}.")
            return Y.reshape(m, len(self.times), order + 1, -1).transpose(2, 0, 1, 3)

    def kink(self, p0: Array) -> tuple[float, str] | None:
        """Time at which the run at p0 (d,) first meets a kink or a jump of its state [s], and their names."""
        with LOCK:
            form, p = self.formulation, np.asarray(p0, float)
            kinks = form.kinks(self.times)
            if kinks is None or not kinks.spoil_derivatives:
                return None
            x0, _ = form.start.states(p[None])
            X = self.integration().run(x0, p[None], 1)[0].X
            first = kinks.first(X[(ok := np.isfinite(X).all(axis=1))], p, self.times[ok])
            if form.dae.impacts is None:  # passes that cancel between two output times
                first = np.fmin(first, SwitchPasses(form.dae, self.times).first(x0, p[None]))
            return None if np.isnan(first) else (float(first), str(kinks))

    def march(self, P: Array) -> Iterator[tuple[int, Array]]:
        """All samples in parallel with a fixed step: (i, Y_i (N, n_y)) for every output time.

        Raises
        ------
        PropagationError
            If the solver controls its step
        """
        P = np.ascontiguousarray(checked_samples(self, P, None))
        x0, _ = self.formulation.start.states(P)
        for i, x in self.integration().march(x0, P):
            yield i, batch(self.formulation.y, x, P, self.times[i : i + 1])[0]

    def identity(self) -> str:
        """A digest of equations, start, outputs, times and solver, for `StoredSimulator`."""
        form = self.formulation
        return digest(symmb_version("symmb"), form.dae, form.start, form.y, repr(self.solver), self.times)

    @property
    def expression(self) -> ca.Function:
        """(p, t) -> y of a scene without bodies, whose outputs are plain expressions."""
        if self.dae.n_q:
            raise AttributeError("only a scene without bodies has outputs that are plain expressions")
        p, t = ca.SX.sym("p", len(self.parameters)), ca.SX.sym("t")
        return ca.Function("expression", [p, t], [self.y(ca.SX(0, 1), p, t)])
