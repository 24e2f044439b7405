"""Programs run samples of a scene. A program consists of formulations, a solver and output times."""

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

import symmb.connect as connect
from symmb._errors import DeclarationError
from symmb._types import Array, Indices
from symmb.connect import Samples
from symmb.declare.symbolic import batch
from symmb.equations.model import DAE, Scene
from symmb.run import integrate
from symmb.run.codegen import Engine
from symmb.run.events import Break, broken
from symmb.run.formulations.ensembles import (
    LOCK,
    CardEnsemble,
    CompiledEnsemble,
    ensemble_of_expressions,
    ensemble_of_runs,
)
from symmb.run.formulations.formulation import Formulation, Formulations, formulations
from symmb.run.formulations.output_functions import jet_outputs, outputs_along
from symmb.run.integrate import CVODES, CompiledSolver, Integration, Run, Solver, Task, impacts_text, refined

if TYPE_CHECKING:
    from symmb.run.codegen import Card, CardEngine

_LONG = 10_000
"""Number of operations of rows of loops in coordinates of bodies. If rows have more, checks of runs do not derive these
equations. The rows of a robot arm with 25,000 operations take a minute: `tests/benchmarks/real_robots.py` has such
arms."""

INTERPRETED = 20
"""Time of an operation of CasADi's interpreter, over that of an operation in compiled C."""


class _Compiled:
    """The compiled parts of programs with the same equations, solver and times, and the time of compilation [s]."""

    def __init__(self, parts: dict[Hashable, Any] | None = None) -> None:
        self.parts, self.seconds = parts or {}, 0.0
        self.last: tuple[tuple[bytes, bytes], list[Run]] | None = None  # start and parameters of a run, and the run

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The part with this key. At the first use, `make` makes the part."""
        if key not in self.parts:
            begin = time.perf_counter()
            self.parts[key] = make()
            self.seconds += time.perf_counter() - begin
        return self.parts[key]

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"parts": {k: part for k, part in self.parts.items() if k != "single"}, "last": None}


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """Runs of a scene by a solver, over output times, in the coordinates that suit the solver.

    A program never changes: another solver, or other times or parameters, need another program. A program compiles at
    its first use, and a pickle contains the compiled parts.

    Attributes
    ----------
    forms : Formulations
    solver : Solver
    times : (n_t,)                    output times [s]
    contradiction : Break, optional   a drive whose law of time jumps; accelerations do not show such a jump
    card : Card, optional             graphics card that runs the samples
    compiled : the compiled parts. Programs share these parts if their runs differ only in parameters
    """

    forms: Formulations
    solver: Solver
    times: Array
    contradiction: Break | None = None
    card: "Card | None" = None
    compiled: _Compiled = field(default_factory=_Compiled)

    def __getstate__(self) -> dict[str, Any]:
        self.prepare()
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @property
    def bodies(self) -> Formulation:
        """The scene in coordinates of its bodies."""
        return self.forms.bodies

    @property
    def formulation(self) -> Formulation:
        """Equations, start and outputs in the coordinates in which the solver runs."""
        return self.forms.of(self.solver)

    @property
    def coordinates(self) -> str:
        """The coordinates in which samples run: "joint" or "body"."""
        return "joint" if self.formulation is self.forms.joints else "body"

    @property
    def is_stateless(self) -> bool:
        """Whether nothing is integrated, because there are no bodies, or only welded bodies in joint coordinates."""
        return self.formulation.y.numel_in(0) == 0

    @property
    def runs_in_lanes(self) -> bool:
        """Whether samples run in compiled lanes. A scene without states is not integrated."""
        return self.solver.runs_in_lanes(self.formulation.dae) and not self.is_stateless

    @cached_property
    def longest_step(self) -> float:
        """A step [s] that is shorter than every pulse of a function of time at the nominal parameters; infinite without
        pulses."""
        return float(self.formulation.pulses(self.times)(self.bodies.dae.p_nominal[None])[0])

    def __repr__(self) -> str:
        return f"{self.solver!r} in coordinates of {'joints' if self.coordinates == 'joint' else 'bodies'}"

    def prepare(self) -> None:
        """Prepare the runs, if they are not prepared yet."""
        _ = self.engine() if self.runs_in_lanes else self.integration()

    def integration(self, order: int = 0) -> Integration:
        """The compiled integration of the Taylor coefficients up to `order`."""

        def make() -> Integration:
            return self.solver.integration(self.formulation.dae, self.times, order=order)

        return self.compiled.get(("integration", order), make)

    def engine(self, order: int = 0) -> Engine:
        """The outputs, or their Taylor coefficients up to `order`, in compiled lanes."""

        def make() -> Engine:
            solver, form = cast(CompiledSolver, self.solver), self.formulation
            y, start = (jet_outputs(form.y, order), None) if order else (form.y, form.start)
            card = None if order else self.card
            return solver.engine(Task(form.dae, self.times, y, order, start=start), card)

        return self.compiled.get(("engine", order), make)

    def operations(self, integration: Integration | None = None) -> float:
        """Number of operations of the last run of an integration; default: of `runs`. Those of CasADi's interpreter
        count INTERPRETED times."""
        if integration is None and self.runs_in_lanes:
            return self.engine().counts.steps * self.engine().operations
        integration = integration or self.integration()
        engine, counts = getattr(integration, "engine", None), integration.statistics()
        if engine is not None:
            return engine.counts.steps * engine.operations
        dae = self.formulation.dae
        linear = (dae.n_q + dae.n_v + dae.n_s) ** 2  # of an implicit solver
        return INTERPRETED * counts.get("evaluations", 0) * (dae.rhs.n_instructions() + linear)

    def single(self) -> tuple[Integration, Array, Indices]:
        """The integration of one run with its work, its times (m,), and the indices (n_t,) of the output times.

        If further times do not change the steps, the times (m,) are close together, also between output times.
        """

        def make() -> tuple[Integration, Array, Indices]:
            dae, fine, outputs = self.formulation.dae, self.times, np.arange(len(self.times))
            if self.solver.has_dense_output(dae):
                fine, outputs = refined(self.times)
            work = dae.power is not None or dae.impacts is not None
            return self.solver.integration(dae, fine, work=work), fine, outputs

        return self.compiled.get("single", make)

    def runs(self, P: Array, threads: int = 1) -> Samples:
        """Runs of samples P (N, d). Outputs (N, n_t, n_y) of a sample are nan after its failure."""
        with LOCK:
            form, P = self.formulation, np.ascontiguousarray(P)
            if self.runs_in_lanes:
                kind = CompiledEnsemble if self.card is None else CardEnsemble
                return kind(form, cast("CardEngine", self.engine()), P, float(self.times[0]), threads)
            if self.is_stateless:
                return ensemble_of_expressions(form, P, self.times, threads)
            return self._ensemble(self.states(P, threads), P, threads)

    def runs_alone(self, P: Array, threads: int = 1) -> Samples:
        """The same as `runs`, by the integration of one run.

        If the run of a scene is already compiled, this integration compiles nothing.
        """
        integration, _, outputs = self.single()
        x0, reasons = self.formulation.start.states(P)
        runs = zip(integration.run(x0, P, threads), reasons, strict=True)
        return self._ensemble([replace(run.at(outputs), message=why or run.message) for run, why in runs], P, threads)

    def _ensemble(self, runs: list[Run], P: Array, threads: int) -> Samples:
        Y = outputs_along(self.formulation.y, runs, P, self.times, threads)
        return ensemble_of_runs(self.formulation, self.times, Y, runs, P)

    def states(self, P: Array, threads: int = 1) -> list[Run]:
        """Runs of samples P (N, d) by an integration. The last run of one sample is kept for other checks of it."""
        x0, reasons = self.formulation.start.states(P)
        key, last = (x0.tobytes(), P.tobytes()), self.compiled.last
        if last is None or last[0] != key:
            last = key, self.integration().run(x0, P, threads)
            self.compiled.last = last if len(P) == 1 else None
        return [replace(run, message=why) if why else run for run, why in zip(last[1], reasons, strict=True)]

    def identity(self) -> str:
        """A digest of equations, start, outputs, times and solver."""
        from importlib.metadata import version  # this import takes as long as a short run

        form = self.formulation
        return connect.digest(version("symmb"), form.dae, form.start, form.y, repr(self.solver), self.times)

    def by(self, solver: Solver) -> "Program":
        """The program of the same scene with another solver.

        Raises
        ------
        DeclarationError       if the solver cannot run the scene
        """
        if solver == self.solver:
            return self
        _require_able(solver, self.bodies.dae, self.times, self.contradiction)
        return Program(self.forms, solver, self.times, self.contradiction, self.card)

    def on_card(self, card: "Card") -> "Program":
        """The program of the same scene, with samples that run on a graphics card.

        Raises
        ------
        DeclarationError       if the solver cannot run there
        CardError              if the card cannot make the runs
        """
        if not self.runs_in_lanes:
            if self.is_stateless:
                raise DeclarationError("device: the scene has no states, so no runs are integrated. Leave out device.")
            raise DeclarationError(
                f"device: {self.solver!r} does not run there. "
                "Graphics cards run explicit solvers, such as DormandPrince()."
            )
        program = replace(self, card=card, compiled=_Compiled())
        program.engine()
        return program

    def tighter(self) -> "Program":
        """The program of the same scene with a solver that is at least ten times more accurate, so that its steps
        change."""
        P = self.bodies.dae.p_nominal[None]
        nominal, finer = self.runs(P), self.by(self.solver.tighter(times=self.times))
        if self.bodies.dae.impacts is not None and nominal.ok.size:
            integrate.round_otherwise(finer.engine(), self.engine())
            return finer
        # How often a solver is made ten times more accurate until its run changes. Exact runs never change.
        for _ in range(4 if nominal.ok.all() and not self.is_stateless else 0):
            if not np.array_equal(finer.runs(P).Y, nominal.Y):
                break
            next_one = self.by(finer.solver.tighter(times=self.times))
            if not next_one.runs(P).ok.all():  # below rounding
                break
            finer = next_one
        return finer

    def at(self, times: Array) -> "Program":
        """The program of the same scene at other times with the same begin and end. No engine is compiled again."""
        if self.runs_in_lanes:
            self.engine()
        engines = {key: part.at(times) for key, part in self.compiled.parts.items() if isinstance(part, Engine)}
        return replace(self, times=times, compiled=_Compiled(engines))

    def around(self, p: Array) -> "Program":
        """The program for runs with parameters p (n_p,). Steps follow the pulses of functions of time for these
        parameters."""
        copy = replace(self, forms=self.forms.around(p))
        same = copy.longest_step == self.longest_step
        return copy if same else replace(copy, compiled=_Compiled())  # the copy has other pulses

    def with_outputs(self, y: Any) -> "Program":
        """The program of the same runs with outputs y (x, p, t), in the coordinates in which the samples run."""
        form = replace(self.formulation, y=y)
        forms = self.forms._replace(joints=form) if form.bodies else Formulations(form, None, None)
        return replace(self, forms=forms, compiled=_Compiled())

    @cached_property
    def _in_bodies(self) -> "Program":
        forms = self.forms._replace(joints=None, spare=self.forms.joints)
        same = forms.bodies is self.formulation
        return replace(self, forms=forms, compiled=self.compiled if same else _Compiled())

    @property
    def cautious(self) -> "Program":
        """The program for checks of solvers. Loops run in coordinates of bodies, in which steps are short near singular
        positions.

        Loops of many bodies run in coordinates of joints, because the equations of the bodies take minutes to derive.
        """
        joints = self.forms.joints
        loops = joints is not None and joints.why and joints.dae.n_c and joints.has_loops
        return self._in_bodies if loops and self.bodies.least_operations <= _LONG else self

    def shortest_equations(self, X: Array, p: Array) -> tuple[Array, DAE]:
        """Equations in some coordinates, and the states (m, n_x) in these coordinates for states X of the bodies.

        Coordinates of joints are used if the scene has no loops, or if the equations of the bodies are long; otherwise
        coordinates of bodies are used.
        """
        tree = self.forms.least_constrained
        if tree.bodies is None or (tree.has_loops and self.bodies.least_operations <= _LONG):
            return X, self.bodies.dae
        return batch(tree.bodies.joints(), X, p)[0], tree.dae


def program_of(scene: Scene, solver: Solver | None = None) -> Program:
    """The program of a scene. The scene stores this program.

    Without a solver, the program is for callers that do not integrate, or that choose the solver themselves. No pilot
    run is made.

    Raises
    ------
    DeclarationError       if the solver cannot run the scene
    """

    own = solver or (integrate.EventDriven() if scene.system.collected.has_events else CVODES())

    def make() -> Program:
        forms, times = formulations(scene), np.asarray(scene.times, dtype=float)
        bodies = forms.bodies
        fault = scene.remembered(broken, lambda: broken(bodies.dae, bodies.start.q_nominal, times))
        _require_able(own, bodies.dae, times, fault)
        return Program(forms, own, times, fault)

    return scene.remembered((Program, own), make)


def _require_able(solver: Solver, dae: DAE, times: Array, contradiction: Break | None) -> None:
    """Raise DeclarationError if the solver cannot run a scene, for example because the law of a drive jumps."""
    if dae.sampling is not None and not solver.controls_step:
        missed = dae.sampling.missed(times)
        if not solver.begins_anew or missed.size:
            remedy = f" or give times that contain every instant, such as {missed[0]:.6g} s" if missed.size else ""
            raise DeclarationError(
                f"Steps of {solver!r} do not begin at the instants of sampled values. "
                f"Use a solver that controls its steps, such as DormandPrince(){remedy if solver.begins_anew else ''}."
            )
    if dae.impacts is not None and not solver.locates_events:
        raise DeclarationError(
            f"{solver!r} does not locate the events of {impacts_text(dae.impacts)}. "
            "Use EventDriven(), which is the default for impacts and joint events."
        )
    if contradiction and not solver.keeps_positions:
        raise DeclarationError(
            f"{contradiction}. {solver!r} integrates accelerations only, so it would miss this jump. Give a "
            "law with a continuous rate, or use a solver that satisfies the constraints, such as NSTIFFSI2(step=...)."
        )
