"""One run of a scene."""

import time
from collections.abc import Mapping, Sequence

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._names import did_you_mean
from symmb._types import Array, Expr
from symmb.scene import Scene
from symmb.simulate._dae import DAESimulator
from symmb.simulate._subject import require_scene, require_solver
from symmb.simulate._trajectory import Trajectory
from symmb.solve.solvers import CVODES, Solver


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
    solver : Solver            default CVODES()
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
    simulator = DAESimulator(scene, CVODES() if solver is None else solver)
    integration = simulator.integration(work=simulator.dae.power is not None)
    setup = time.perf_counter() - begin
    begin = time.perf_counter()
    p = np.array(list(values.values()))
    x0, (reason,) = simulator.start.states(p[None])
    run = integration.run(x0, p[None])[0]
    seconds = time.perf_counter() - begin
    told = ", ".join(f"{n} = {v:g}" for n, v in values.items())
    if reason:
        raise SimulationError(f"{scene.name} does not start at t = {simulator.times[0]:g} s ({told}): {reason}.")
    if run.message:
        raise SimulationError(f"{scene.name}: the run breaks down at t = {run.t_failed:g} s ({told}): {run.message}.")
    start = simulator.start
    return Trajectory(
        scene=scene,
        simulator=simulator,
        parameters=values,
        solver=repr(simulator.solver),
        t=simulator.times,
        x=run.X,
        work=run.quad[:, 0] if run.quad.shape[1] else np.zeros(len(simulator.times)),
        statistics={
            "start": {name: list(getattr(start, name)) for name in ("held", "solved", "free", "redundant")},
            "integrator": integration.statistics(),
        },
        setup_seconds=setup,
        run_seconds=seconds,
    )
