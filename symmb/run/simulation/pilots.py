"""Pilot runs: a scene runs by several solvers, and each run is judged."""

import time
import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from symmb._errors import SymmbWarning
from symmb._interrupts import carry, runs_of
from symmb._names import ByName
from symmb._types import Array
from symmb.equations.model import DAE, Scene
from symmb.run.codegen import SLOW, compiler_advice, has_compiler
from symmb.run.formulations import Program, program_of
from symmb.run.integrate import Run, Solver, impacts_text, stiffness
from symmb.run.simulation.solver_choice import MANY, Pilot, choose, for_studies
from symmb.run.simulation.trajectory import Trajectory
from symmb.run.verification import Examination, work_of

_POSITION_DRIFT, _ENERGY_DRIFT, _SINGULAR_ENERGY_DRIFT = 1e-6, 1e-4, 1e-6
"""Drift of positions over the scene's size, drift of energy over the kinetic energy, and the latter in a run through a
singular position, above which other solvers are tried. Calibrated by tests/test_problems.py."""
_STIFFNESS_SAMPLES = 5
"""Times at which stiffness is estimated."""
_NEIGHBOURS, _NEIGHBOUR_DISTANCE = 7, 1e-3
"""Runs of a pilot beside the nominal one, and the distance of their parameters, as a share of the nominal values."""


def given_program(scene: Scene, solver: Solver | None) -> tuple[Program, str] | None:
    """The program by the solver that is given, or the only one that locates events, and why; None if one has to be
    chosen."""
    if solver is None and not scene.system.collected.has_events:
        return None
    program = program_of(scene, solver)
    impacts = program.bodies.dae.impacts
    events = f"{impacts_text(impacts)}: events have to be located" if solver is None and impacts else ""
    return program, _joined(events, program.formulation.why)


def program_for_studies(scene: Scene, threads: int) -> tuple[Program, str]:
    """The program of a scene by the solver that pilot runs choose for many samples, and the reason."""

    def pilot(solver: Solver) -> Pilot:
        return _pilot_of_samples(program_of(scene, solver).cautious, threads)

    program_of(scene, for_studies().first)  # refuses a scene that no solver can run as they do
    solver, reason = choose(for_studies, pilot)
    program = program_of(scene, solver)
    if not (has_compiler() or program.is_stateless):
        warnings.warn(f"No C compiler found. {SLOW} {compiler_advice()}", SymmbWarning, stacklevel=2)
    form = program.formulation
    return program, _joined(reason, str(form.kinks(program.times) or ""), form.why)


def _joined(*reasons: str) -> str:
    return "; ".join(filter(None, reasons))


def _pilot_of_samples(program: Program, threads: int) -> Pilot:
    """How the nominal run goes as one of many, and its neighbours."""
    program.prepare()
    p, begin = program.bodies.dae.p_nominal, time.perf_counter()
    ensemble = program.runs(p[None], threads)
    message = ensemble.messages[0] if ensemble.messages else ""
    seconds, in_lanes = time.perf_counter() - begin, program.runs_in_lanes
    steps = program.engine().counts.steps if in_lanes else program.integration().statistics().get("steps", 0)
    if in_lanes and not message:  # the nominal run may pass a singular position by chance
        shares = np.random.default_rng(0).uniform(-_NEIGHBOUR_DISTANCE, _NEIGHBOUR_DISTANCE, (_NEIGHBOURS, len(p)))
        ensemble = program.runs(p * (1 + shares), threads)
        late = ensemble.t_failed[~ensemble.ok] > program.times[0]  # no solver can start the others
        message = next((text for text, k in zip(ensemble.messages, late, strict=True) if k), "")
    return Pilot(message, steps, seconds, steps > MANY)


class PilotRuns:
    """Runs of a scene with one set of parameters by several solvers, and what is wrong with them.

    Attributes
    ----------
    program : Program           with these parameters; by a solver that is to run it, or for the equations alone
    reason : str, optional      why that solver is to run it; None if one is to be chosen
    p, x0 : (n_p,), (1, n_x)    parameters, and the state of the bodies at the start
    start_fault : str           why the scene cannot start; empty if it can
    where : str                 the parameters for a message; empty if there are none
    done : dict                 solver -> its run and trajectory
    """

    def __init__(self, scene: Scene, parameters: Mapping[str, float], program: Program, reason: str | None) -> None:
        begin = time.perf_counter()
        self.scene, self.parameters = scene, ByName(parameters)
        self.p = np.array(list(parameters.values()))
        self.program, self.reason = self._judging(program), reason
        self.x0, (self.start_fault,) = self.program.bodies.start.states(self.p[None])
        text = ", ".join(f"{name} = {value:g}" for name, value in parameters.items())
        self.where = f" ({text})" if text else ""
        self.done: dict[Solver, tuple[Run, Trajectory]] = {}
        self._setup = time.perf_counter() - begin

    def _judging(self, program: Program) -> Program:
        """For runs that are judged, with the parameters of the run."""
        return program.cautious.around(self.p)

    def run(self, solver: Solver) -> Pilot:
        """Run by a solver, and keep the trajectory."""
        begin = time.perf_counter()
        is_own = solver == self.program.solver
        program = self.program if is_own else self._judging(program_of(self.scene, solver))
        form, times = program.formulation, program.times
        x0 = self.x0 if form.bodies is None else form.start.states(self.p[None])[0]
        integration, fine, outputs = program.single()
        is_close = solver.has_dense_output(form.dae) and len(fine) > len(times) + 1  # cut, but for the start
        built = time.perf_counter()
        try:
            run = form.run_of_bodies(integration.run(x0, self.p[None])[0], self.p)
        except KeyboardInterrupt as interrupt:
            for run in runs_of(interrupt):
                at_outputs = form.run_of_bodies(run, self.p).at(outputs)
                known = int(np.argmin(np.append(np.isfinite(at_outputs.X).all(axis=1), False)))
                some = self._trajectory(program, at_outputs, {}, built - begin, time.perf_counter() - built, known)
                carry(interrupt, some if known > 1 else None)
            raise
        seconds, counts = time.perf_counter() - built, integration.statistics()
        examination = Examination.of(program, self.p, fine, run.X, work_of(run), is_close)
        run = run.at(outputs)
        trajectory = self._trajectory(program, run, counts, built - begin, seconds, len(times))
        self.done[solver] = run, replace(trajectory, run_examination=examination)
        return Pilot(run.message, counts.get("steps", 0), seconds, False)

    def _trajectory(
        self, program: Program, run: Run, counts: dict[str, int], setup: float, seconds: float, known: int
    ) -> Trajectory:
        """The trajectory of a run, at its first `known` times."""
        start, times = program.bodies.start, program.times[:known]
        names = {
            "held": start.listed,
            "solved": start.solved + start.solved_velocities,
            "free": start.free + start.free_velocities,
            "redundant": start.redundant,
        }
        return Trajectory(
            scene=self.scene if known == len(program.times) else self.scene.with_times(times),
            program=program,
            parameters=self.parameters,
            solver=repr(program.solver),
            reason="",
            t=times,
            x=run.X[:known],
            work=work_of(run)[:known],
            statistics={"start": {key: list(some) for key, some in names.items()}, "integrator": counts},
            setup_seconds=self._setup + setup,
            run_seconds=seconds,
            events=run.events,
        )

    def judge(self, solver: Solver) -> Pilot:
        """Run by a solver, and return what is wrong with the result."""
        pilot = self.run(solver)
        run, trajectory = self.done[solver]
        if pilot.message:
            return replace(pilot, message=f"t = {run.t_failed:g} s, {run.message}")
        drift = float(trajectory.examination.violation.max(initial=0.0))
        if not drift < _POSITION_DRIFT:
            doubt = f"drifts off its constraints by {drift:.0e} of its size"
            return replace(pilot, doubt=doubt, drift=float(np.nan_to_num(drift, nan=np.inf)) / _POSITION_DRIFT)
        singularity = trajectory.singularity
        limit = _SINGULAR_ENERGY_DRIFT if singularity else _ENERGY_DRIFT
        if trajectory.energy_drift > limit:
            # Branches of the motion meet in singular positions: the solver may have taken another one.
            where = f"{singularity}, " if singularity else ""
            doubt = f"{where}energy drifts by {trajectory.energy_drift:.0e}"
            return replace(pilot, doubt=doubt, drift=trajectory.energy_drift / limit)
        states = trajectory.examination
        return replace(pilot, slow=pilot.steps > MANY and self._is_stiff(states.x, states.t))

    @property
    def starts_stiff(self) -> bool:
        """Whether the motion linearised about the start is stiff over the horizon."""
        X, dae = self.program.shortest_equations(self.x0, self.p)
        return self._is_stiff(X, self.program.times[:1], dae)

    def _is_stiff(self, X: Array, t: Array, dae: DAE | None = None) -> bool:
        """Whether the motion linearised about some of the states X (m, n_x) at times t (m,) is stiff."""
        some = np.unique(np.linspace(0, len(t) - 1, _STIFFNESS_SAMPLES).astype(int))
        dae = dae or self.program.bodies.dae
        return stiffness(dae, X[some], self.p, t[some]).is_stiff(np.ptp(self.program.times))
