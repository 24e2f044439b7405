"""The simulator of a scene: a program with the interface that studies use."""

import time
from collections.abc import Iterator
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from symmb._errors import SimulationError, WithWarnings
from symmb._interrupts import kept_interrupts
from symmb._names import ByName
from symmb._options import require_instance, require_numbers, whole
from symmb._types import Array, Executor
from symmb.connect import Progress, Reduction, Samples, checked_samples, stream
from symmb.declare.mechanics import is_flexible
from symmb.declare.symbolic import HIGHEST_ORDER, batch
from symmb.equations.model import Scene
from symmb.run import codegen
from symmb.run.codegen import cores
from symmb.run.formulations import LOCK, Program, block_size, jet_outputs, outputs_along
from symmb.run.integrate import Solver, SwitchPasses, impacts_text, solver_of
from symmb.run.simulation.pilots import given_program, program_for_studies
from symmb.run.verification import OtherWays

S = TypeVar("S")


class DAESimulator(WithWarnings):
    """A scene with its equations, start and solver, ready for runs. `prepare` returns a DAESimulator.

    The simulator runs samples of the parameters. Equations are compiled once, at the first run. Pickling is possible.

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional
        default: pilot runs choose the solver, mostly DormandPrince()

    Attributes
    ----------
    scene : Scene
    parameters : dict
        name -> nominal value, in the order of the columns of P
    times : (n_t,) array
        output times [s]
    outputs : tuple of str
        names of the n_y outputs over time
    units : tuple of str
        units of the outputs; '' if the unit does not follow from the expression
    solver : Solver
    reason : str
        why symmb chose this solver and these coordinates; empty if they were given
    setup_seconds : float
        time spent on deriving, compiling and starting so far [s]
    threads : int
        CasADi threads for samples; 1 in a pickled copy
    bodies : Formulation
        equations, start and outputs in coordinates of the bodies
    doubts : tuple of str
        warnings about the start and, after `second_look`, about the nominal run
    noise : (n_y,) array
        estimated errors of the outputs: the larger of the error of the solver's steps and the error of the nominal
        run; None before `second_look`
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
        begin, self.threads = time.perf_counter(), cores()
        self.scene, self.name, self.box = scene, scene.name, scene.box
        self.parameters = ByName(scene.system.parameters)
        self.outputs, self.units = scene.curve_names, scene.curve_units
        self._hold(*given_program(scene, solver) or program_for_studies(scene, self.threads))
        self._setup = time.perf_counter() - begin - self.program.compiled.seconds

    def _hold(self, program: Program, reason: str) -> None:
        """Set the attributes that follow from a program, and forget the results of earlier runs."""
        self.program, self.reason = program, reason
        self.solver, self.times, self.bodies = program.solver, program.times, program.bodies
        self.dae, self.start, self.y = self.bodies.dae, self.bodies.start, self.bodies.y
        self.formulation, self.coordinates = program.formulation, program.coordinates
        has_flexible = self.scene and any(is_flexible(body) for body in self.scene.system.bodies)
        self.ways = OtherWays(program, self.outputs, self.scene if has_flexible else None)
        self.doubts: tuple[str, ...] = self.start.doubts
        self.noise: Array | None = None
        self.nominal: Array | None = None

    def __repr__(self) -> str:
        return f"DAESimulator({self.name!r}, {self.solver!r})"

    def __getstate__(self) -> dict[str, Any]:
        flexible = self.ways.flexible  # a copy needs the scene only for these checks
        # A copy has one thread, because many copies run in parallel.
        # Runs need no box. Its constraints may be functions that cannot be pickled.
        ways = OtherWays(self.program, self.outputs, flexible)
        return vars(self) | {"scene": flexible, "box": None, "ways": ways, "threads": 1}

    @property
    def setup_seconds(self) -> float:
        """Time spent on deriving, compiling and starting so far [s]."""
        return self._setup + self.program.compiled.seconds

    @property
    def compiled(self) -> bool:
        """Whether samples run in compiled lanes."""
        return self.program.runs_in_lanes

    @property
    def parameter_switches(self) -> ca.Function | None:
        """Margins, the first switches of `Ensemble.reach`, and values, as a Function of a sample; None without them."""
        return self.formulation.parameter_switches

    def prepare(self) -> None:
        """Prepare the runs, if they are not prepared yet."""
        self.program.prepare()

    def tighter(self) -> "DAESimulator":
        """The same simulator with a solver that is at least ten times more accurate, so that its steps change."""
        return self._by(self.program.tighter())

    def solved_by(self, solver: Solver) -> "DAESimulator":
        """The same simulator with another solver."""
        return self if solver == self.solver else self._by(self.program.by(solver))

    def on_card(self, card: "codegen.Card") -> "DAESimulator":
        """The same simulator with samples that run on a graphics card."""
        require_instance("on_card: card", card, codegen.Card, "the card of a program")
        return self._by(self.program.on_card(card))

    def _by(self, program: Program) -> "DAESimulator":
        other = DAESimulator.__new__(DAESimulator)
        vars(other).update(vars(self) | {"_setup": self.setup_seconds})
        other._hold(program, "")
        return other

    def second_look(self) -> None:
        """At the first call, run the nominal parameters in two ways, and set `warnings`, `noise` and `nominal`."""
        if self.noise is None:
            self.nominal, self.noise, self.doubts = self.ways.at_nominal()

    def run(self, P: Array) -> Samples:
        """Run samples P (N, d). Outputs (N, n_t, n_y) of a sample are nan after its failure."""
        with LOCK:
            return self.program.runs(checked_samples(self, P, None), self.threads)

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples P (N, d) block by block, and reduce each block."""
        require_instance("stream: reduction", reduction, Reduction, "a Reduction")
        n_x, on_card = self.formulation.y.numel_in(0), self.program.card is not None
        values = self.program.engine().numbers if on_card else len(self.times) * len(self.outputs)
        block = block_size(n_x, values, self.compiled, reduction.trajectories, on_card)
        return stream(self, P, reduction, executor, progress, block)

    @kept_interrupts()
    def jets(self, p0: Array, directions: Array, order: int) -> Array:
        """Taylor coefficients (order + 1, m, n_t, n_y) of the outputs along m directions (m, d).

        The coefficients are integrated along with the states. The point p0 is (d,), or (m, d) with one point for each
        direction.

        Raises
        ------
        SimulationError
            If a run fails
        """
        with LOCK:
            d = len(self.parameters)
            directions = np.atleast_2d(require_numbers("jets", "directions", directions, d, leading=True))
            points = np.broadcast_to(require_numbers("jets", "p0", p0, d, leading=True), directions.shape)
            order = whole("jets", "order", order, 0, HIGHEST_ORDER)
            m, form = len(directions), self.formulation
            x0, P = np.hstack(form.start.jets(points, directions, order)), np.hstack([points, directions])
            fault: tuple[float, str, int] | None = None
            if self.compiled:
                Y, failed = self.program.engine(order).values(x0, P, self.threads)
                if np.isfinite(failed.t_failed).any():
                    k = int(np.nanargmin(failed.t_failed))
                    fault = failed.t_failed[k], failed.reasons[k], k
            else:
                runs, y = self.program.integration(order).run(x0, P, self.threads), jet_outputs(form.y, order)
                fault = next(((run.t_failed, run.message, k) for k, run in enumerate(runs) if run.message), None)
                Y = outputs_along(y, runs, P, self.times, self.threads)
            if fault:
                kink = self.kink(points[fault[2]])
                near = f"; the run itself meets {kink[1]} at or before t = {kink[0]:g} s" if kink else ""
                text = f"t = {fault[0]:g} s: {fault[1]}{near}"
                raise SimulationError(f"{self!r}: the computation of derivatives fails at {text}.")
            return Y.reshape(m, len(self.times), order + 1, len(self.outputs)).transpose(2, 0, 1, 3)

    def kink(self, p0: Array) -> tuple[float, str] | None:
        """Time [s] at which the run at p0 (d,) first meets a kink or jump of the equations, and the names of all kinks.

        The result is None if the run meets no kink. With impacts, it is the first event, or the end without events,
        because derivatives cannot be integrated then.
        """
        with LOCK:
            form, p = self.formulation, np.asarray(p0, float)
            kinks = form.kinks(self.times)
            impacts = form.dae.impacts
            if impacts is None and (kinks is None or not kinks.spoil_derivatives):
                return None
            x0, _ = form.start.states(p[None])
            run = self.program.integration().run(x0, p[None], 1)[0]
            if impacts is not None:
                return min((event.time for event in run.events), default=float(self.times[-1])), impacts_text(impacts)
            assert kinks is not None
            X = run.X
            first = kinks.first(X[(ok := np.isfinite(X).all(axis=1))], p, self.times[ok])
            # A switch may be passed twice between two output times.
            first = np.fmin(first, SwitchPasses(form.dae, self.times).first(x0, p[None]))
            return None if np.isnan(first) else (float(first), str(kinks))

    def march(self, P: Array) -> Iterator[tuple[int, Array]]:
        """Run all samples P (N, d) together, and yield the number i and the outputs (N, n_y) of every output time.

        Raises
        ------
        PropagationError
            If the solver has step control
        """
        P = np.ascontiguousarray(checked_samples(self, P, None))
        x0, _ = self.formulation.start.states(P)
        for i, x in self.program.integration().march(x0, P):
            yield i, batch(self.formulation.y, x, P, self.times[i : i + 1])[0]

    def identity(self) -> str:
        """A digest of equations, start, outputs, times and solver, for `StoredSimulator`."""
        return self.program.identity()

    @property
    def expression(self) -> ca.Function:
        """A function (p, t) -> outputs y of a scene without bodies, in which outputs are plain expressions."""
        if self.dae.n_q:
            raise AttributeError(
                "The outputs depend on the motion of bodies, so they are not expressions of p and t alone."
            )
        p, t = ca.SX.sym("p", len(self.parameters)), ca.SX.sym("t")
        return ca.Function("expression", [p, t], [self.y(ca.SX(0, 1), p, t)])
