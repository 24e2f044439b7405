"""The choice of the solver by pilot runs, and the reason for the choice. Each pilot run is checked."""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from symmb._errors import SymmbWarning
from symmb._interrupts import carry, runs_of
from symmb._names import ByName
from symmb._types import Array
from symmb._units import units_of_parameters, values_text
from symmb.equations.model import Scene
from symmb.run.codegen import REASONS, SLOW, FailureCode, compiler_advice, has_compiler, with_compiler
from symmb.run.formulations import Program, program_of
from symmb.run.integrate import (
    CVODES,
    STIFF,
    AugmentedLagrangian,
    DormandPrince,
    Rosenbrock,
    Run,
    Solver,
    impacts_text,
    some_states,
    stiffness,
)
from symmb.run.schemes import MOST_STEPS
from symmb.run.simulation.trajectory import Trajectory
from symmb.run.verification import Examination, work_of

_POSITION_DRIFT, _ENERGY_DRIFT, _SINGULAR_ENERGY_DRIFT = 1e-6, 1e-4, 1e-6
"""Largest drifts of an accepted run: of positions, divided by the size of the scene; of energy, divided by the kinetic
energy; and of energy in a run through a singular position. If a drift is larger, other solvers are tried. Calibration:
tests/test_problems.py."""
_NEIGHBOURS, _NEIGHBOUR_DISTANCE = 7, 1e-3
"""Number of pilot runs near the nominal run, and largest relative distance of their parameters from nominal values."""
TOO_FAST = "a part of the motion decays too fast for explicit steps"
MANY = 20_000
"""Number of steps of a run. If a run needs more, an implicit solver may be faster."""
_PAIR, _MULTISTEP, _STIFF = DormandPrince(rtol=1e-11), CVODES(), CVODES(stiff=True)
"""Solvers of one run. For all tests/problems.py, the errors of DormandPrince are at most those of CVODES() at the same
tolerance. DormandPrince takes a third to a twentieth of the time, plus compilation, and ends steps at switches."""
_TIGHTER, _COMPILED = CVODES(rtol=1e-12, stiff=True), (Rosenbrock(), DormandPrince())
"""Solvers of stiff scenes."""
_SINGULAR = (DormandPrince(stabilization=AugmentedLagrangian()),)
"""The solver that passes through singular positions, if the scene is not stiff."""
_THROUGH = CVODES(stiff=True, stabilization=AugmentedLagrangian())
"""The solver that passes through singular positions of stiff scenes."""
_MANY_RUNS = CVODES(rtol=1e-8)
"""The solver of studies without a C compiler. It is as accurate as DormandPrince()."""


@dataclass(frozen=True)
class Pilot:
    """A pilot run.

    Attributes
    ----------
    message : str       why the run failed; empty if it did not fail
    steps : int         number of steps
    operations : float  number of operations of the run, as in `Program.operations`
    slow : bool         whether an implicit solver may be faster
    doubt : str         why another solver may be better; empty if there is no reason
    drift : float       drift that causes `doubt`, divided by the largest accepted drift
    """

    message: str
    steps: int
    operations: float
    slow: bool
    doubt: str = ""
    drift: float = 0.0

    @property
    def succeeds(self) -> bool:
        """Whether the run finished, and `doubt` is empty."""
        return not (self.message or self.doubt)


class Candidates(NamedTuple):
    """Solvers to try: the first solver, an implicit solver that may be faster, and others if the first solver fails."""

    first: Solver
    implicit: Solver
    others: tuple[Solver, ...]


def for_studies(stiff: bool) -> Candidates:
    """Candidates for many runs. Explicit solvers are not tried for stiff scenes, which need too many steps."""
    if not has_compiler():
        return Candidates(_STIFF if stiff else _MANY_RUNS, *for_one_run(stiff)[1:])
    implicit, through = Rosenbrock(), Rosenbrock(stabilization=AugmentedLagrangian())
    if stiff:
        return Candidates(implicit, implicit, (through,))
    return Candidates(DormandPrince(), implicit, (*_SINGULAR, through))


def for_one_run(stiff: bool) -> Candidates:
    """Candidates for one run."""
    if stiff:
        return Candidates(_STIFF, _STIFF, (_TIGHTER, *(_COMPILED if has_compiler() else ()), _THROUGH))
    if not has_compiler():
        return Candidates(_MULTISTEP, _STIFF, (CVODES(stabilization=AugmentedLagrangian()), _THROUGH))
    return Candidates(_PAIR, _STIFF, (_MULTISTEP, *_SINGULAR, _THROUGH))


def at_tolerances(solver: Solver, tolerances: Mapping[str, Any]) -> Solver:
    """The solver with other tolerances `rtol` and `atol`."""
    return replace(solver, **tolerances)  # pyright: ignore[reportArgumentType]


def choose(candidates: Callable[[], Candidates], pilot: Callable[[Solver], Pilot]) -> tuple[Solver, str]:
    """The first solver with a successful pilot run, or a faster solver if this run is slow, and the reason."""
    choice = partial(_choice, candidates, pilot)
    return with_compiler(choice, choice)  # if no compiler works, other candidates are tried


def _choice(candidates: Callable[[], Candidates], pilot: Callable[[Solver], Pilot]) -> tuple[Solver, str]:
    first, implicit, others = candidates()
    run = pilot(first)
    if REASONS[FailureCode.STICKS] in run.message:  # the motion cannot continue with any solver
        return first, _fault(first, run)
    if not run.succeeds:
        return _replaced(first, run, (*others, implicit), pilot)
    if not run.slow or implicit == first:
        return first, _count(run)
    other = pilot(implicit)
    if not other.succeeds:
        return first, f"{_count(run)}; {_fault(implicit, other)}"
    times = run.operations / other.operations
    if times > 1:
        return implicit, f"{first!r} takes {run.steps} steps, and {times:.2g} times the operations of {implicit!r}"
    return first, f"{_count(run)}; {implicit!r} takes {1 / times:.2g} times the operations of {first!r}"


def _replaced(
    failed: Solver, run: Pilot, others: Sequence[Solver], pilot: Callable[[Solver], Pilot]
) -> tuple[Solver, str]:
    """The first solver that succeeds, otherwise the solver with the smallest drift, and the reason for the choice."""
    runs, verdicts = {failed: run}, [_fault(failed, run)]
    for solver in others:
        if solver not in runs:
            run = runs[solver] = pilot(solver)
            if run.succeeds:
                return solver, "; ".join([*verdicts, _count(run)])
            verdicts.append(_fault(solver, run))
    finished = [solver for solver, run in runs.items() if not run.message]
    return min(finished, key=lambda solver: runs[solver].drift, default=failed), "; ".join(verdicts)


def _fault(solver: Solver, run: Pilot) -> str:
    return f"{solver!r} fails: {run.message}" if run.message else f"{solver!r}: {run.doubt}"


def _count(run: Pilot) -> str:
    return f"a pilot run took {run.steps} steps" if run.steps else "a pilot run finishes"


def given_program(scene: Scene, solver: Solver | None) -> tuple[Program, str] | None:
    """The program with the given solver or the solver for events, and the reason; None if pilot runs must choose."""
    if solver is None and not scene.system.collected.has_events:
        return None
    program = program_of(scene, solver)
    impacts = program.bodies.dae.impacts
    events = f"{impacts_text(impacts)}: events have to be located" if solver is None and impacts else ""
    return program, _joined(events, program.formulation.why)


def program_for_studies(scene: Scene, threads: int) -> tuple[Program, str]:
    """The program of a scene with the solver that pilot runs choose for many samples, and the reason."""

    def pilot(solver: Solver) -> Pilot:
        program = program_of(scene, solver)
        return _pilot_of_samples(program.cautious, program, threads)

    program = program_of(scene, for_studies(False).first)  # raises an error if these solvers cannot run the scene
    p = program.bodies.dae.p_nominal
    x0, _ = program.bodies.start.states(p[None])
    # Explicit steps are not tried if they certainly exceed the step limit. Below the limit, they may be faster.
    stiff = Rosenbrock().runs_in_lanes(program.formulation.dae) and starts_stiff(program, x0, p, MOST_STEPS)
    solver, reason = choose(partial(for_studies, stiff), pilot)
    program = program_of(scene, solver)
    if not (has_compiler() or program.is_stateless):
        warnings.warn(f"No C compiler found. {SLOW} {compiler_advice()}", SymmbWarning, stacklevel=2)
    form = program.formulation
    return program, _joined(TOO_FAST if stiff else "", reason, str(form.kinks(program.times) or ""), form.why)


def starts_stiff(program: Program, x0: Array, p: Array, most: float = STIFF) -> bool:
    """Whether the horizon has more than `most` time constants of the motion linearised about the start x0 (1, n_x)."""
    X, dae = program.shortest_equations(x0, p)
    return stiffness(dae, X, p, program.times[:1]).is_stiff(np.ptp(program.times), most)


def _joined(*reasons: str) -> str:
    return "; ".join(filter(None, reasons))


def _pilot_of_samples(program: Program, study: Program, threads: int) -> Pilot:
    """The pilot run of a program for many samples: the nominal run, and runs with parameters nearby.

    If the study runs in other coordinates, the pilot needs no library for samples.
    """
    p, in_lanes = program.bodies.dae.p_nominal, program.runs_in_lanes
    alone = in_lanes and program.formulation is not study.formulation
    runs, integration = (program.runs_alone, program.single()[0]) if alone else (program.runs, None)
    ensemble = runs(p[None], threads)
    message = ensemble.messages[0] if ensemble.messages else ""
    if in_lanes and integration is None:
        steps = program.engine().counts.steps
    else:
        steps = (integration or program.integration()).statistics().get("steps", 0)
    operations = program.operations(integration)
    if in_lanes and not message:  # the nominal run may pass a singular position by chance
        shares = np.random.default_rng(0).uniform(-_NEIGHBOUR_DISTANCE, _NEIGHBOUR_DISTANCE, (_NEIGHBOURS, len(p)))
        ensemble = runs(p * (1 + shares), threads)
        late = ensemble.t_failed[~ensemble.ok] > program.times[0]  # no solver can start the other samples
        message = next((text for text, k in zip(ensemble.messages, late, strict=True) if k), "")
    return Pilot(message, steps, operations, steps > MANY)


class PilotRuns:
    """Runs of a scene by several solvers with one set of parameters. Each run is checked.

    Attributes
    ----------
    program : Program           program with these parameters; its solver is used only if a reason is given
    reason : str, optional      why this solver is used; None if a solver is to be chosen
    p, x0 : (n_p,), (1, n_x)    parameters, and the state of the bodies at the start
    start_fault : str           why the scene cannot start; empty if it can
    where : str                 the parameters as text for a message; empty if there are none
    done : dict                 solver -> run and trajectory
    """

    def __init__(self, scene: Scene, parameters: Mapping[str, float], program: Program, reason: str | None) -> None:
        begin = time.perf_counter()
        self.scene, self.parameters = scene, ByName(parameters)
        self.p = np.array(list(parameters.values()))
        self.program, self.reason = self._judging(program), reason
        self.x0, (self.start_fault,) = self.program.bodies.start.states(self.p[None])
        text = values_text(parameters, parameters.values(), units_of_parameters(parameters))
        self.where = f" ({text})" if text else ""
        self.done: dict[Solver, tuple[Run, Trajectory]] = {}
        self._setup = time.perf_counter() - begin

    def _judging(self, program: Program) -> Program:
        """The program with the parameters of the run, for a run that is checked."""
        return program.cautious.around(self.p)

    def run(self, solver: Solver) -> Pilot:
        """Make a run by a solver, and store the trajectory in `done`."""
        begin = time.perf_counter()
        is_own = solver == self.program.solver
        program = self.program if is_own else self._judging(program_of(self.scene, solver))
        form, times = program.formulation, program.times
        x0 = self.x0 if form.bodies is None else form.start.states(self.p[None])[0]
        integration, fine, outputs = program.single()
        is_close = solver.has_dense_output(form.dae) and len(fine) > len(times) + 1  # times between outputs
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
        return Pilot(run.message, counts.get("steps", 0), program.operations(integration), False)

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

    def choice(self, tolerances: Mapping[str, Any]) -> tuple[Solver, str]:
        """The solver that pilot runs choose for one run, with these tolerances, and the reason."""
        stiff = starts_stiff(self.program, self.x0, self.p)
        solver, reason = choose(partial(for_one_run, stiff), lambda each: self.judge(at_tolerances(each, tolerances)))
        solver = at_tolerances(solver, tolerances)
        return solver, _joined(TOO_FAST if stiff else "", reason, self.program.forms.of(solver).why)

    def judge(self, solver: Solver) -> Pilot:
        """Make a run by a solver, and check the result."""
        pilot = self.run(solver)
        run, trajectory = self.done[solver]
        if pilot.message:
            return replace(pilot, message=f"t = {run.t_failed:g} s, {run.message}")
        drift = float(trajectory.examination.violation.max(initial=0.0))
        if not drift < _POSITION_DRIFT:
            doubt = f"positions violate the constraints by {drift:.0e} of the size of the scene"
            return replace(pilot, doubt=doubt, drift=float(np.nan_to_num(drift, nan=np.inf)) / _POSITION_DRIFT)
        singularity = trajectory.singularity
        limit = _SINGULAR_ENERGY_DRIFT if singularity else _ENERGY_DRIFT
        if trajectory.energy_drift > limit:
            # Branches of the motion meet in singular positions. The solver may have taken another branch.
            where = f"{singularity}, " if singularity else ""
            doubt = f"{where}energy drifts by {trajectory.energy_drift:.0e}"
            return replace(pilot, doubt=doubt, drift=trajectory.energy_drift / limit)
        return replace(pilot, slow=pilot.steps > MANY and self._is_stiff(trajectory.examination))

    def _is_stiff(self, states: Examination) -> bool:
        """Whether the linearised motion is stiff at some states of a run."""
        some = some_states(len(states.t))
        rates = stiffness(self.program.bodies.dae, states.x[some], self.p, states.t[some])
        return rates.is_stiff(np.ptp(self.program.times))
