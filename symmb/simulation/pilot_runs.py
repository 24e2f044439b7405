"""Runs of a scene by several solvers, and checks of their results."""

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from symmb._interrupts import carry, runs_of
from symmb._types import Array
from symmb.integrate import Run, Solver, stiffness
from symmb.model import Scene
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.examination import Examination, work_of
from symmb.simulation.solver_choice import MANY, Pilot
from symmb.simulation.subject import prepare, prepare_equations
from symmb.simulation.trajectory import Trajectory

POSITION_DRIFT, ENERGY_DRIFT, SINGULAR_ENERGY_DRIFT = 1e-6, 1e-4, 1e-6
"""Drift of positions over the scene's size, drift of energy over the kinetic energy, and the latter in a run through a
singular position, above which other solvers are tried. Calibrated by tests/test_problems.py."""
STIFFNESS_SAMPLES = 5
"""Times at which stiffness is estimated."""


class PilotRuns:
    """Runs with one set of parameters, kept by solver.

    Attributes
    ----------
    simulator : DAESimulator
    solver, reason              those that were prepared; None if a solver is to be chosen here, for one run
    p, x0 : (n_p,), (1, n_x)    parameters, and the state at the start
    start_fault : str           why the scene cannot start; empty if it can
    where : str                 the parameters for a message; empty if there are none
    done : dict                 solver -> its run and trajectory
    """

    def __init__(self, scene: Scene, parameters: Mapping[str, float], prepared: DAESimulator | None) -> None:
        begin = time.perf_counter()
        self.scene, self.parameters = scene, dict(parameters)
        self.p = np.array(list(parameters.values()))
        self.simulator = self._at(prepared or prepare_equations(scene))
        self.solver, self.reason = (prepared.solver, prepared.reason) if prepared else (None, "")
        self.x0, (self.start_fault,) = self.simulator.start.states(self.p[None])
        text = ", ".join(f"{name} = {value:g}" for name, value in parameters.items())
        self.where = f" ({text})" if text else ""
        self.done: dict[Solver, tuple[Run, Trajectory]] = {}
        self._setup = time.perf_counter() - begin

    def _at(self, simulator: DAESimulator) -> DAESimulator:
        """For runs that are judged, with the parameters of the run."""
        return simulator.cautious().around(self.p)

    def run(self, solver: Solver) -> Pilot:
        """Run by a solver, and keep the trajectory."""
        begin = time.perf_counter()
        is_own = solver == self.simulator.solver
        simulator = self.simulator if is_own else self._at(prepare(self.scene, solver))
        form, times = simulator.formulation, simulator.times
        x0 = self.x0 if form.bodies is None else form.start.states(self.p[None])[0]
        integration, fine, outputs = simulator.single()
        is_close = solver.has_dense_output(form.dae)
        built = time.perf_counter()
        try:
            run = form.run_of_bodies(integration.run(x0, self.p[None])[0], self.p)
        except KeyboardInterrupt as interrupt:
            for run in runs_of(interrupt):
                at_outputs = form.run_of_bodies(run, self.p).at(outputs)
                known = int(np.argmin(np.append(np.isfinite(at_outputs.X).all(axis=1), False)))
                some = self._trajectory(simulator, at_outputs, {}, built - begin, time.perf_counter() - built, known)
                carry(interrupt, some if known > 1 else None)
            raise
        seconds, counts = time.perf_counter() - built, integration.statistics()
        examination = Examination.of(simulator, self.p, fine, run.X, work_of(run), is_close)
        run = run.at(outputs)
        trajectory = self._trajectory(simulator, run, counts, built - begin, seconds, len(times))
        self.done[solver] = run, replace(trajectory, run_examination=examination)
        return Pilot(run.message, counts.get("steps", 0), seconds, False)

    def _trajectory(
        self, simulator: DAESimulator, run: Run, counts: dict[str, int], setup: float, seconds: float, known: int
    ) -> Trajectory:
        """The trajectory of a run, at its first `known` times."""
        start = simulator.start
        names = {
            "held": start.listed,
            "solved": start.solved + start.solved_velocities,
            "free": start.free + start.free_velocities,
            "redundant": start.redundant,
        }
        times = simulator.times[:known]
        return Trajectory(
            scene=self.scene if known == len(simulator.times) else self.scene.with_times(times),
            simulator=simulator,
            parameters=self.parameters,
            solver=repr(simulator.solver),
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
        if not drift < POSITION_DRIFT:
            doubt = f"drifts off its constraints by {drift:.0e} of its size"
            return replace(pilot, doubt=doubt, drift=float(np.nan_to_num(drift, nan=np.inf)) / POSITION_DRIFT)
        singularity = trajectory.singularity
        limit = SINGULAR_ENERGY_DRIFT if singularity else ENERGY_DRIFT
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
        return self._is_stiff(self.x0, self.simulator.times[:1])

    def _is_stiff(self, X: Array, t: Array) -> bool:
        """Whether the motion linearised about some of the states X (m, n_x) at times t (m,) is stiff."""
        some = np.unique(np.linspace(0, len(t) - 1, STIFFNESS_SAMPLES).astype(int))
        horizon = float(np.ptp(self.simulator.times))
        return stiffness(self.simulator.dae, X[some], self.p, t[some]).is_stiff(horizon)
