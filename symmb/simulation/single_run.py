"""One run of a scene."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, SimulationError, SymmbError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._names import did_you_mean
from symmb._options import is_finite_number, require_truth, shown
from symmb._types import Array, Expr
from symmb.events import Kinks
from symmb.integrate import Solver, SwitchPasses
from symmb.model import Scene, compile_dae
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.pilot_runs import PilotRuns
from symmb.simulation.run_quality import unreached
from symmb.simulation.solver_choice import choose, for_one_run
from symmb.simulation.subject import prepare, require_own, require_solver, scene_of
from symmb.simulation.trajectory import Trajectory
from symmb.start import prepare_start
from symmb.symbolic import batch, has_kinks


def simulate(
    scene: Scene | DAESimulator,
    solver: Solver | None = None,
    parameters: Mapping[str, float] | None = None,
    *,
    check: bool = False,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> Trajectory:
    """Run a scene once.

    Parameters
    ----------
    scene : Scene              or one of `prepare`, which has a solver
    solver : Solver            default: CVODES(); DormandPrince() with switches; CVODES(stiff=True) for stiff scenes;
                               CVODES with AugmentedLagrangian() if these fail; EventDriven() with impacts.
                               `trajectory.reason` gives the reason
    parameters : mapping       values instead of the nominal ones
    check : bool               run a second time in another way: by a solver of another family, and in other
                               coordinates if the scene has any. `trajectory.error` (n_t, n_y) is the difference, and
                               the doubts tell from when on digits are lost
    times, outputs             instead of those of the scene

    Returns
    -------
    Trajectory                 what is doubtful about it stands in `doubts`, and is a SymmbWarning

    Raises
    ------
    DeclarationError           if a parameter is unknown or not finite
    AssemblyError              if the scene cannot be started
    SimulationError            if the run breaks down, leaves its constraints, or has an output that is not finite

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start={"ball.vx": 2.0}, times=[0.0, 1.0])
    >>> traj = mb.simulate(fall)
    >>> float(traj["ball.y"][-1].round(6)), float(traj(ball.x)[-1])
    (-4.905, 2.0)
    """
    own = scene_of(scene)
    require_solver(solver)
    require_truth("simulate", "check", check)
    if isinstance(scene, DAESimulator):
        require_own(scene, solver, times, outputs)
    if times is not None:
        own = own.with_times(times)
    if outputs is not None:
        own = own.with_outputs(outputs)
    values = parameter_values(own, {} if parameters is None else parameters)
    with kept_interrupts():
        if isinstance(scene, DAESimulator):
            prepared: DAESimulator | None = scene
        else:
            has_solver = solver is not None or bool(own.system.collected.impacts)
            prepared = prepare(own, solver) if has_solver else None
        solver, trajectory = _simulated(PilotRuns(own, values, prepared), check)
    warn_of(trajectory.doubts, f"{own.name} by {solver!r}")
    return trajectory


def _simulated(runs: PilotRuns, check: bool) -> tuple[Solver, Trajectory]:
    """The solver that was chosen, and its run with all that is told about it."""
    if runs.start_fault:
        begin = f"t = {runs.simulator.times[0]:g} s"
        fault = f"{runs.scene.name} does not start at {begin}{runs.where}: {runs.start_fault}. {_start_fault(runs)}"
        raise SimulationError(fault.rstrip())
    if runs.solver is not None:
        solver, reason = runs.solver, runs.reason
        runs.run(solver)
    else:
        stiff, ends = runs.starts_stiff, runs.simulator.dae.sampling is not None
        solver, reason = choose(
            for_one_run(stiff, ends or runs.simulator.bodies.kinks(runs.simulator.times) is not None), runs.judge
        )
        reason = f"something dies away too fast for explicit steps; {reason}" if stiff else reason
        reason = "; ".join(filter(None, (reason, runs.simulator.solved_by(solver).formulation.why)))
    run, trajectory = runs.done[solver]
    switches = runs.simulator.bodies.kinks(runs.simulator.times)
    if run.message:
        raise SimulationError(_breakdown_text(runs, solver, reason, str(switches) if switches else ""))
    states = trajectory.examination
    count = switches.met(states.x, runs.p, states.t) if switches and reason else 0
    reason = f"{reason}; {switches} met {count} times or more" if count else reason
    if runs.solver is None and switches is not None and switches.on_state.any():
        solver, trajectory, reason = _confirmed(runs, solver, trajectory, reason)
    trajectory = replace(trajectory, reason=reason)
    _require_sound(runs, solver, trajectory)
    doubts = (*_switch_doubts(runs, solver), *_gap_doubts(runs, solver))
    doubts = (*doubts, *_pass_doubts(runs, solver, switches)) if switches else doubts
    trajectory = replace(trajectory, run_doubts=doubts)
    return solver, _checked(runs, solver, trajectory) if check else trajectory


def _start_fault(runs: PilotRuns) -> str:
    """What the assembly says if the parameters of the run are the nominal ones, such as a joint that stays open."""
    scene = runs.scene
    try:
        prepare_start(scene, replace(compile_dae(scene.system), p_nominal=runs.p))
    except SymmbError as error:
        return str(error)
    return ""


def _confirmed(runs: PilotRuns, solver: Solver, trajectory: Trajectory, reason: str) -> tuple[Solver, Trajectory, str]:
    """The solver, run and reason after runs at tighter tolerances, while two of them do not agree.

    A switch of the state that is met at a small angle magnifies errors: a wall that is touched shortly before a motion
    turns back, by several hundred.
    """
    sizes = runs.simulator.dae.state_sizes
    for _ in range(_CONFIRMATIONS):
        tighter = solver.tighter(times=runs.simulator.times)
        if runs.run(tighter).message:
            break
        finer = runs.done[tighter][1]
        least = np.maximum(np.abs(finer.x).max(axis=0), _LEAST * sizes)
        difference = float((np.abs(finer.x - trajectory.x) / least).max(initial=0.0))
        if difference <= _AGREEMENT:
            break
        reason = f"{reason}; {tighter!r}, because switches magnify the errors of {solver!r} to {difference:.0e}"
        solver, trajectory = tighter, finer
    return solver, trajectory, reason


def _require_sound(runs: PilotRuns, solver: Solver, trajectory: Trajectory) -> None:
    """SimulationError if the run has left its constraints, or has outputs that are not finite."""
    about = f"{runs.scene.name}{runs.where} by {trajectory.solver}"
    states = trajectory.examination
    fault = unreached(states.t, states.violation, getattr(solver, "rtol", None))
    irregular = ~np.isfinite(trajectory.values)
    if irregular.any():
        k, i = np.argwhere(irregular)[0]
        fault = f"output {trajectory.names[i]!r} is {trajectory.values[k, i]} at t = {trajectory.t[k]:g} s"
    if fault:
        raise SimulationError(f"{about}: {fault}.")


def _switch_doubts(runs: PilotRuns, solver: Solver) -> tuple[str, ...]:
    """Whether steps of a fixed length pass over contacts, pulses of forces, or switches to which the motion sticks."""
    simulator = runs.simulator
    step = solver.step_taken(simulator.times)
    if not step or simulator.dae.impacts is not None or not has_kinks(simulator.dae.rhs):
        return ()
    stops = SwitchPasses(simulator.dae, simulator.times).stops(runs.x0, runs.p[None]).of(0)
    if np.isfinite(stops.sticks):
        return (
            f"The motion sticks to a switch of a force at t = {stops.sticks:.6g} s, and steps of a fixed length pass "
            f"it again and again: {_SMOOTH}.",
        )
    times, span = stops.times[np.isfinite(stops.times)], np.ptp(simulator.times)
    if (share := len(times) * step / span) > _CROWDED:
        return (
            f"The equations switch {len(times)} times, and steps of {step:.1g} s do not end there: forces jump or bend "
            f"in {min(share, 1):.0%} of the steps. Take shorter ones, or DormandPrince(), whose steps end there.",
        )
    distances = np.diff(times)
    distances[distances < _SAME * span] = np.inf
    if not (distances <= step).any():
        return ()
    return (
        f"Two switches of the equations follow each other in {distances.min():.1g} s at t = "
        f"{times[distances.argmin()]:.6g} s, and a step is {step:.1g} s long: contacts or pulses may be missed.",
    )


def _gap_doubts(runs: PilotRuns, solver: Solver) -> tuple[str, ...]:
    """Whether the states of a run are below the gap of an impact."""
    dae, states = runs.simulator.dae, runs.done[solver][1].examination
    if dae.impacts is None:
        return ()
    x, p, t = ca.SX.sym("x", states.x.shape[1]), ca.SX.sym("p", len(runs.p)), ca.SX.sym("t")
    gaps = ca.Function("gaps", [x, p, t], dae.impacts.gaps.call([*dae.arguments(x, p, t)])[:1])
    (values,) = batch(gaps, states.x, runs.p, states.t[:, None])
    k, i = np.unravel_index(int(values.argmin()), values.shape)
    if values[k, i] >= -_BELOW * dae.scales.length:
        return ()
    name = dae.impacts.names[i]
    return (f"The gap of Impact {name!r} is {values[k, i]:.3g} m at t = {states.t[k]:.6g} s: an impact is missed.",)


def _pass_doubts(runs: PilotRuns, solver: Solver, switches: Kinks) -> tuple[str, ...]:
    """Whether the states of a run change the side of a switch near which it noted no pass."""
    (run, trajectory), dae = runs.done[solver], runs.simulator.dae
    states = trajectory.examination
    if run.stops is None or dae.sampling is not None:  # sampled laws have sides of their own
        return ()
    known = states.t < run.stops.until
    missed = switches.passed_over(states.x[known], runs.p, states.t[known], run.stops.passes)
    if np.isnan(missed):
        return ()
    return (
        f"The equations have {switches}. The motion changes the side of one behind t = {missed:.6g} s, where no step "
        "of the run ended: others may be passed over as well.",
    )


def _checked(runs: PilotRuns, solver: Solver, trajectory: Trajectory) -> Trajectory:
    """The trajectory with errors from a second run."""
    ways = runs.simulator.solved_by(solver).two_ways(runs.p, trajectory.values)
    doubts = (*trajectory.run_doubts, *ways.doubts, *filter(None, [ways.unchecked]))
    return replace(trajectory, error=np.abs(ways.values - ways.others), run_doubts=doubts)


def parameter_values(scene: Scene, changes: Mapping[str, float]) -> dict[str, float]:
    """Nominal values, of which some are replaced."""
    nominal = scene.system.parameters
    if not isinstance(changes, Mapping):
        raise DeclarationError(f'parameters: expected values by name, such as {{"l1": 1.02}}, got {shown(changes)}.')
    for name, value in changes.items():
        if not isinstance(name, str) or name not in nominal:
            raise DeclarationError(f"No parameter {name!r}.{did_you_mean(name, nominal)}")
        if not is_finite_number(value):
            raise DeclarationError(f"Parameter {name!r}: {value!r} is not a finite number.")
    return {name: float(changes.get(name, value)) for name, value in nominal.items()}


def _breakdown_text(runs: PilotRuns, solver: Solver, reason: str, switches: str) -> str:
    """The reason why a run failed, its place, and possible causes."""
    run, trajectory = runs.done[solver]
    near = trajectory.singularity
    parts = [
        f"{runs.scene.name}: the run breaks down at t = {run.t_failed:g} s{runs.where}: {run.message}",
        f"The position may be singular: {near}" if near else "",
        f"The equations have {switches}, at which no motion can stay: {_STICKS}" if switches else "",
        f"No other solver gets through: {reason}" if len(runs.done) > 1 else "",
    ]
    return ". ".join(filter(None, parts)) + "."


_CONFIRMATIONS, _AGREEMENT, _LEAST = 2, 1e-6, 1e-3
"""Runs at tighter tolerances at most, each ten times tighter; largest difference of two runs over the sizes of the
states, a tenth of the error that default runs may have; and least size of a state over that of its part of the
scene."""
_SAME = 1e-12
"""Share of the horizon by which two switches at one time may differ by rounding."""
_CROWDED = 0.1
"""Share of fixed steps with a switch from which errors are visible: those of a motor on pulses are a tenth of it."""
_BELOW = 1e-6
"""Share of the length of the scene by which a gap may be below 0: that of a closed contact is rounding."""
_SMOOTH = "smooth it, as tanh(v / 1e-3) does sign(v)"
_STICKS = f"where it sticks to one, {_SMOOTH}"
