"""One run of a scene. Pilot runs choose the solver if no solver is given."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np

from symmb._doubt import Doubt
from symmb._errors import DeclarationError, SimulationError, SymmbError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._names import ByName, counted, did_you_mean, normal_keys
from symmb._options import require_truth, shown
from symmb._progress import Progress
from symmb._types import Array, Expr
from symmb._units import number_in, units_of_parameters
from symmb.declare.symbolic import evaluated
from symmb.equations.model import Scene, compile_dae
from symmb.equations.start import prepare_start
from symmb.run import integrate, simulation
from symmb.run.formulations import program_of
from symmb.run.integrate import Solver
from symmb.run.simulation.dae_simulator import DAESimulator
from symmb.run.simulation.figure_simulator import FigureSimulator
from symmb.run.simulation.pilots import PilotRuns, given_program
from symmb.run.simulation.run_doubts import SMOOTH, run_doubts
from symmb.run.simulation.subject import Subject, scene_of
from symmb.run.simulation.trajectory import Trajectory
from symmb.run.verification import in_two_ways, other_way

_STICKS = f"If the motion sticks to a jump of a force, {SMOOTH}"


@overload
def simulate(
    scene: Scene | DAESimulator,
    solver: Solver | str | None = None,
    parameters: Mapping[str, float] | None = None,
    *,
    rtol: float | None = None,
    atol: float | None = None,
    check: bool = False,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> Trajectory: ...


@overload
def simulate(
    scene: Scene | DAESimulator,
    solver: Solver | str | None = None,
    parameters: Sequence[Mapping[str, float]] = ...,
    *,
    rtol: float | None = None,
    atol: float | None = None,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> "simulation.Sweep": ...


@kept_interrupts()
def simulate(
    scene: Scene | DAESimulator,
    solver: Solver | str | None = None,
    parameters: Mapping[str, float] | Sequence[Mapping[str, float]] | None = None,
    *,
    rtol: float | None = None,
    atol: float | None = None,
    check: bool = False,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> "Trajectory | simulation.Sweep":
    """Run a scene once, or once for each of several sets of parameters.

    Parameters
    ----------
    scene : Scene
        scene, or the result of `prepare`, which has a solver
    solver : Solver
        solver, or a text that names it, such as "cvodes:1e-9". Default: EventDriven() if there are impacts, or joints
        that open or close; CVODES(stiff=True) for stiff scenes; otherwise DormandPrince(rtol=1e-11), or CVODES()
        without a C compiler. If these solvers fail, other solvers are tried, for example with AugmentedLagrangian().
        `trajectory.reason` gives the reason
    parameters : mapping
        values instead of the nominal values; or a list of mappings, for runs that are made in parallel
    rtol, atol : float
        relative and absolute tolerance, instead of those of the default solver
    check : bool
        whether a second run is made by a solver of another family and, if possible, in other coordinates.
        `trajectory.error` (n_t, n_y) is the difference of both runs. Warnings give the
        time after which outputs have fewer than three certain digits
    times, outputs
        times and outputs, if they differ from those of the scene

    Returns
    -------
    Trajectory
        the run, or a Sweep for a list of parameters. `warnings` list what is uncertain. If there are warnings, Python
        also issues a SymmbWarning

    Raises
    ------
    DeclarationError
        If a parameter is unknown or not finite
    AssemblyError
        If the scene cannot be started
    SimulationError
        If the run fails, leaves its constraints, or has an output that is not finite

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start={"ball.vx": 2.0}, times=[0.0, 1.0])
    >>> traj = mb.simulate(fall)
    >>> float(traj["ball.y"][-1].round(6)), float(traj(ball.x)[-1])
    (-4.905, 2.0)
    """
    scene_of(scene)  # raises an error for other simulators
    subject = Subject.of(scene, solver, times, outputs)
    require_truth("simulate", "check", check)
    own, solver = subject.scene, subject.solver
    tolerances = _tolerances(rtol, atol, solver is not None)
    if not isinstance(parameters, Mapping | str | None) and isinstance(parameters, Sequence):
        return simulation.side_by_side(subject, parameters, check, tolerances)
    if tolerances and own.system.collected.has_events:
        solver = integrate.EventDriven(**tolerances)
    values = parameter_values(own, {} if parameters is None else parameters)
    with Progress(f"{own.name}: equations") as progress:
        if isinstance(scene, DAESimulator):
            runs = PilotRuns(own, values, scene.program, scene.reason)
        else:
            runs = PilotRuns(own, values, *(given_program(own, solver) or (program_of(own), None)))
        progress(f"{own.name}: running", 0, 0)
        used, trajectory = _simulated(runs, check, tolerances)
        if own.figures:
            figures = Subject(own, used if tolerances else solver).figures
            trajectory = with_figures_of(trajectory, figures, check)
    warn_of(trajectory.doubts, f"{own.name} by {used!r}")
    return trajectory


def _tolerances(rtol: float | None, atol: float | None, is_chosen: bool) -> dict[str, Any]:
    """The given tolerances by name. DeclarationError is raised if the user also gives a solver."""
    tolerances = {name: value for name, value in (("rtol", rtol), ("atol", atol)) if value is not None}
    if tolerances and is_chosen:
        raise DeclarationError(
            "simulate: rtol= and atol= apply to the default solver only. Write them as options of the solver, as in "
            "solver=CVODES(rtol=1e-10)."
        )
    return tolerances


def _simulated(runs: PilotRuns, check: bool, tolerances: Mapping[str, Any]) -> tuple[Solver, Trajectory]:
    """The solver of one run, which is given or chosen here, and the trajectory with reasons and warnings."""
    bodies, times = runs.program.bodies, runs.program.times
    if runs.start_fault:
        begin = f"t = {times[0]:g} s"
        fault = f"{runs.scene.name} does not start at {begin}{runs.where}: {runs.start_fault}. {_start_fault(runs)}"
        raise SimulationError(fault.rstrip())
    if runs.reason is not None:
        solver, reason = runs.program.solver, runs.reason
        runs.run(solver)
    else:
        solver, reason = runs.choice(tolerances)
    run, trajectory = runs.done[solver]
    switches = bodies.kinks(times)
    if run.message:
        raise SimulationError(_breakdown_text(runs, solver, str(switches) if switches else ""))
    states = trajectory.examination
    count = switches.met(states.switch_values) if switches and reason else 0
    reason = f"{reason}; the run meets {switches} at least {counted(count, 'time')}" if count else reason
    if runs.reason is None and switches is not None and switches.on_state.any():
        solver, trajectory, reason = _confirmed(runs, solver, trajectory, reason)
    trajectory = replace(trajectory, reason=reason)
    _require_sound(runs, trajectory)
    doubts = run_doubts(runs, solver, trajectory, switches)
    trajectory = replace(trajectory, run_doubts=doubts)
    if check:
        program = runs.program.by(solver)
        ways = in_two_ways(program, other_way(program, times), trajectory.names, runs.p, trajectory.values)
        doubts = (*doubts, *ways.doubts, *filter(None, [ways.unchecked]))
        trajectory = replace(trajectory, error=np.abs(ways.values - ways.others), run_doubts=doubts)
    return solver, trajectory


def with_figures_of(trajectory: Trajectory, simulator: FigureSimulator, check: bool) -> Trajectory:
    """The trajectory with the scalar outputs of its scene, and with their errors if `check` is true.

    If the condition of a scalar output never holds, the output is nan, and there is a warning.

    Raises
    ------
    SimulationError        if the run that computes the scalar outputs fails
    """
    p = np.array([*trajectory.parameters.values()])
    Y, lacking = simulator.values(p)
    columns = [simulator.outputs.index(name) for name in simulator.figures]
    values = dict(zip(simulator.figures, Y[0, columns].tolist(), strict=True))
    error = None
    if trajectory.error is not None:
        error = np.abs((simulator.tighter().values(p)[0] if check else Y)[:1] - Y[:1]).repeat(len(trajectory.t), axis=0)
        others = [k for k in range(len(simulator.outputs)) if k not in columns]
        error[:, others] = trajectory.error
    doubts = (Doubt(f"Output {name!r} is nan, because its condition never holds.", [name]) for name in lacking)
    return replace(trajectory, figures=values, error=error, run_doubts=(*trajectory.run_doubts, *doubts))


def _start_fault(runs: PilotRuns) -> str:
    """The fault of an assembly with the parameters of the run, such as a joint that remains open; '' without fault."""
    scene = runs.scene
    try:
        prepare_start(scene, replace(compile_dae(scene.system), p_nominal=runs.p))
    except SymmbError as error:
        return str(error)
    return ""


def _confirmed(runs: PilotRuns, solver: Solver, trajectory: Trajectory, reason: str) -> tuple[Solver, Trajectory, str]:
    """The solver, the run and the reason after further runs at tighter tolerances, until two runs agree.

    Errors grow if a motion meets a switch of the state at a small angle. For example, they grow by a factor of several
    hundred if a body touches a wall shortly before it turns back.
    """
    sizes = runs.program.bodies.dae.state_sizes
    # At most two further runs are made, each with ten times tighter tolerances. Two runs agree if their difference,
    # divided by the sizes of the states, is at most a tenth of the error of default runs. The size of a state is at
    # least 0.001 times its typical size.
    for _ in range(2):
        tighter = solver.tighter(times=runs.program.times)
        if runs.run(tighter).message:
            break
        finer = runs.done[tighter][1]
        least = np.maximum(np.abs(finer.x).max(axis=0), 1e-3 * sizes)
        difference = float((np.abs(finer.x - trajectory.x) / least).max(initial=0.0))
        if difference <= 1e-6:
            break
        reason = f"{reason}; {tighter!r}, because switches magnify the errors of {solver!r} to {difference:.0e}"
        solver, trajectory = tighter, finer
    return solver, trajectory, reason


def _require_sound(runs: PilotRuns, trajectory: Trajectory) -> None:
    """Raise a SimulationError if the run has left its constraints, or if an output is not finite."""
    about = f"{runs.scene.name}{runs.where} by {trajectory.solver}"
    fault = trajectory.examination.fault
    irregular = ~np.isfinite(trajectory.values)
    if irregular.any():
        k, i = np.argwhere(irregular)[0]
        fault = f"output {trajectory.names[i]!r} is {trajectory.values[k, i]} at t = {trajectory.t[k]:g} s"
    if fault:
        raise SimulationError(f"{about}: {fault}.")


def parameter_values(scene: Scene, changes: Mapping[str, float]) -> dict[str, float]:
    """The nominal values of all parameters, with these changes."""
    nominal = scene.system.parameters
    if not isinstance(changes, Mapping):
        raise DeclarationError(f'parameters: expected values by name, such as {{"l1": 1.02}}, got {shown(changes)}.')
    for name in (changes := normal_keys("parameters", changes)):
        if not isinstance(name, str) or name not in nominal:
            raise DeclarationError(f"No parameter {name!r}.{did_you_mean(name, nominal)}")
    units = units_of_parameters(nominal)
    values = {**nominal, **changes}
    own = {n: number_in(f"Parameter {n!r}", f"parameter {n!r}", values[n], units.get(n, "")) for n in nominal}
    return ByName(own, units)


def _breakdown_text(runs: PilotRuns, solver: Solver, switches: str) -> str:
    """The message of a failed run: the time, the reason and possible causes."""
    run, trajectory = runs.done[solver]
    is_known = "': " in run.message  # a fault of an element, with its own remedy
    near, switches = (None, "") if is_known else (trajectory.singularity, switches)
    begin = f"{runs.scene.name}: the run fails at t = {run.t_failed:g} s{runs.where}"
    if run.t_failed <= runs.program.times[0] and (undefined := _undefined_forces(runs)):
        return f"{begin}: {undefined}"
    others = [
        f"{re.sub(r'(?<=AugmentedLagrangian)[(][^)]*[)]', '()', repr(key))} at t = {other.t_failed:g} s"
        for key, (other, _) in runs.done.items()
        if key != solver
    ]
    parts = [
        f"{begin}: {run.message}",
        f"The position may be singular: {near}" if near else "",
        f"The equations have {switches}. {_STICKS}" if switches else "",
        f"Other solvers fail as well: {', '.join(others)}" if others else "",
    ]
    return ". ".join(filter(None, parts)) + "."


def _undefined_forces(runs: PilotRuns) -> str:
    """A sentence about forces that are not numbers at the start; empty if there are none."""
    dae = runs.program.bodies.dae
    q, v, s = np.split(runs.x0[0], [dae.n_q, dae.n_q + dae.n_v])
    forces = evaluated(dae.Q, q, v, *([s] if dae.n_s else []), runs.p, runs.program.times[:1]).ravel()
    lost = dict.fromkeys(dae.v_names[k].rsplit(".", 1)[0] for k in np.flatnonzero(~np.isfinite(forces)))
    if not lost:
        return ""
    return (
        f"the forces on {', '.join(map(repr, lost))} are not numbers at the start. A spring of length 0 has no "
        "direction. A root of a negative number and a quotient by 0 have no value."
    )
