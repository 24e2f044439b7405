"""One run of a scene."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._names import did_you_mean
from symmb._types import Array, Expr
from symmb.events import kinks
from symmb.integrate import CVODES, Run, Solver, stiffness
from symmb.model import Scene
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.solver_choice import MANY, Pilot, choose, for_one_run
from symmb.simulation.subject import require_scene, require_solver
from symmb.simulation.trajectory import Trajectory


def simulate(
    scene: Scene,
    solver: Solver | None = None,
    parameters: Mapping[str, float] | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> Trajectory:
    """Run a scene once.

    Parameters
    ----------
    scene : Scene
    solver : Solver            default CVODES(), for stiff scenes CVODES(stiff=True), where these break down that with
                               AugmentedLagrangian(), with Impacts EventDriven(); `trajectory.reason` tells why
    parameters : mapping       values in the place of nominal ones
    times, outputs             in the place of the scene's own

    Returns
    -------
    Trajectory

    Raises
    ------
    DeclarationError           if a parameter is unknown or not finite
    AssemblyError              if the scene cannot be started
    SimulationError            if the run breaks down, with time and parameters

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start={"ball.vx": 2.0}, times=[0.0, 1.0])
    >>> traj = mb.simulate(fall)
    >>> float(traj["ball.y"][-1].round(6)), float(traj(ball.x)[-1])
    (-4.905, 2.0)
    """
    require_scene(scene)
    require_solver(solver)
    if times is not None:
        scene = scene.with_times(times)
    if outputs is not None:
        scene = scene.with_outputs(outputs)
    nominal = scene.system.parameters
    values = dict(nominal)
    for name, value in (parameters or {}).items():
        if name not in nominal:
            raise DeclarationError(f"No parameter {name!r}.{did_you_mean(name, nominal)}")
        if not np.isfinite(value):
            raise DeclarationError(f"Parameter {name!r}: {value!r} is not a finite number.")
        values[name] = float(value)
    begin = time.perf_counter()
    if solver is None and not scene.system.collected.impacts:
        simulator = DAESimulator(scene, CVODES())
    else:
        simulator = DAESimulator(scene, solver)
        solver = simulator.solver
    setup = time.perf_counter() - begin
    p = np.array(list(values.values()))
    told = ", ".join(f"{n} = {v:g}" for n, v in values.items())
    x0, (wrong,) = simulator.start.states(p[None])
    if wrong:
        raise SimulationError(f"{scene.name} does not start at t = {simulator.times[0]:g} s ({told}): {wrong}.")
    made: dict[Solver, tuple[Run, Trajectory]] = {}

    def pilot(solver: Solver) -> Pilot:
        begin = time.perf_counter()
        solved = simulator.solved_by(solver)
        integration = solved.integration(work=solved.dae.power is not None or solved.dae.impacts is not None)
        middle = time.perf_counter()
        run = integration.run(x0, p[None])[0]
        seconds, counted = time.perf_counter() - middle, integration.statistics()
        start = {name: list(getattr(solved.start, name)) for name in ("held", "solved", "free", "redundant")}
        trajectory = Trajectory(
            scene=scene,
            simulator=solved,
            parameters=values,
            solver=repr(solver),
            reason="",
            t=solved.times,
            x=run.X,
            work=run.quad[:, 0] if run.quad.shape[1] else np.zeros(len(solved.times)),
            statistics={"start": start, "integrator": counted},
            setup_seconds=setup + middle - begin,
            run_seconds=seconds,
            events=run.events,
        )
        made[solver] = run, trajectory
        return Pilot(run.message, counted.get("steps", 0), seconds, False)

    def judged(solver: Solver) -> Pilot:
        found, (run, trajectory) = pilot(solver), made[solver]
        if found.message:
            return replace(found, message=f"t = {run.t_failed:g} s, {run.message}")
        drift = trajectory.position_drift / simulator.dae.scales.length
        if not drift < _FAR:
            return replace(found, doubt=f"drifts off its constraints by {drift:.0e} of its size")
        if trajectory.energy_drift > (_SUSPECT if trajectory.singularity else _LOST):
            # Where positions are singular branches of the motion meet, and a solver may have taken another.
            where = f"{trajectory.singularity}, " if trajectory.singularity else ""
            return replace(found, doubt=f"{where}energy drifts by {trajectory.energy_drift:.0e}")
        return replace(found, slow=found.steps > MANY and stiff_along(run.X))

    def stiff_along(X: Array) -> bool:
        some = np.unique(np.linspace(0, len(X) - 1, 5).astype(int))
        span = float(simulator.times[-1] - simulator.times[0])
        return stiffness(simulator.dae, X[some], p, simulator.times[some]).is_stiff(span)

    reason = simulator.reason
    if solver is not None:
        pilot(solver)
    else:
        stiff = stiff_along(x0)
        solver, reason = choose(for_one_run(stiff), judged)
        reason = f"something dies away too fast for explicit steps; {reason}" if stiff else reason
    run, trajectory = made[solver]
    corners = kinks(simulator.dae) if reason or run.message else None
    if run.message:
        near = trajectory.singularity
        texts = [f"{scene.name}: the run breaks down at t = {run.t_failed:g} s ({told}): {run.message}"]
        texts += [f"The position may be singular: {near}"] if near else []
        texts += [f"The equations have {corners}, at which no motion can stay: {_SMOOTH}"] if corners else []
        texts += [f"No other solver gets through: {reason}"] if len(made) > 1 else []
        raise SimulationError(". ".join(texts) + ".")
    met = corners.met(run.X, p, simulator.times) if corners else 0
    if met:
        reason += f"; {corners} met {met} times or more"
    return replace(trajectory, reason=reason)


_SMOOTH = "where it sticks to one, smooth it, as tanh(v / 1e-3) does sign(v)"
_FAR, _LOST, _SUSPECT = 1e-6, 1e-4, 1e-6
"""Drift of positions over the size, of energy, and of that through a singular position, at which others are tried."""
