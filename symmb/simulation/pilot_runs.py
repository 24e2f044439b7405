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
from symmb.simulation.solver_choice import MANY, Pilot
from symmb.simulation.trajectory import Trajectory

POSITION_DRIFT, ENERGY_DRIFT, SINGULAR_ENERGY_DRIFT = 1e-6, 1e-4, 1e-6
"""Drift of positions over the scene's size, drift of energy over the kinetic energy, and the latter in a run through a
singular position, above which other solvers are tried. Calibrated by tests/test_problems.py."""
STIFFNESS_SAMPLES = 5
"""Output times at which stiffness is estimated."""


class PilotRuns:
    """Runs with one set of parameters, kept by solver.

    Attributes
    ----------
    simulator : DAESimulator
    solver, reason              the given or the required solver, and the reason; None if it is to be chosen
    p, x0 : (n_p,), (1, n_x)    parameters, and the state at the start
    start_fault : str           why the scene cannot start; empty if it can
    text : str                  the parameters as text
    done : dict                 solver -> its run and trajectory
    """

    def __init__(self, scene: Scene, parameters: Mapping[str, float], solver: Solver | None) -> None:
        begin = time.perf_counter()
        self.scene, self.parameters = scene, dict(parameters)
        self.simulator = DAESimulator(scene, solver)
        is_free = solver is None and self.simulator.dae.impacts is None
        self.solver, self.reason = (None, "") if is_free else (self.simulator.solver, self.simulator.reason)
        self.p = np.array(list(parameters.values()))
        self.x0, (self.start_fault,) = self.simulator.start.states(self.p[None])
        self.text = ", ".join(f"{name} = {value:g}" for name, value in parameters.items())
        self.done: dict[Solver, tuple[Run, Trajectory]] = {}
        self._setup = time.perf_counter() - begin

    def run(self, solver: Solver) -> Pilot:
        """Run by a solver, and keep the trajectory."""
        begin = time.perf_counter()
        simulator = self.simulator.solved_by(solver)
        integration = simulator.integration(work=simulator.dae.power is not None or simulator.dae.impacts is not None)
        built = time.perf_counter()
        try:
            run = integration.run(self.x0, self.p[None])[0]
        except KeyboardInterrupt as interrupt:
            for run in runs_of(interrupt):
                known = int(np.argmin([*np.isfinite(run.X).all(axis=1), False]))
                some = self._trajectory(simulator, run, {}, built - begin, time.perf_counter() - built, known)
                carry(interrupt, some if known > 1 else None)
            raise
        seconds, counts = time.perf_counter() - built, integration.statistics()
        trajectory = self._trajectory(simulator, run, counts, built - begin, seconds, len(run.X))
        self.done[solver] = run, trajectory
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
            work=run.quad[:known, 0] if run.quad.shape[1] else np.zeros(known),
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
        drift = trajectory.position_drift / self.simulator.dae.scales.length
        if not drift < POSITION_DRIFT:
            return replace(pilot, doubt=f"drifts off its constraints by {drift:.0e} of its size")
        singularity = trajectory.singularity
        if trajectory.energy_drift > (SINGULAR_ENERGY_DRIFT if singularity else ENERGY_DRIFT):
            # Branches of the motion meet in singular positions: the solver may have taken another one.
            where = f"{singularity}, " if singularity else ""
            return replace(pilot, doubt=f"{where}energy drifts by {trajectory.energy_drift:.0e}")
        return replace(pilot, slow=pilot.steps > MANY and self.is_stiff_along(run.X))

    def is_stiff_along(self, X: Array) -> bool:
        """Whether the motion linearised about some of the states X (m, n_x) is stiff over the horizon."""
        times = self.simulator.times
        some = np.unique(np.linspace(0, len(X) - 1, STIFFNESS_SAMPLES).astype(int))
        return stiffness(self.simulator.dae, X[some], self.p, times[some]).is_stiff(float(times[-1] - times[0]))
