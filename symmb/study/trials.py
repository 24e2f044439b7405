"""Runs of `stability` that may fail or take too long. Each family of solvers has a separate process."""

import contextlib
import multiprocessing
import os
import re
import signal
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np

from symmb._cleanup import end_groups, lead_group, note_group
from symmb._errors import SymmbError
from symmb._types import Array
from symmb.equations.model import Scene
from symmb.results.files import NOT_KEPT, Record, entries, entry
from symmb.run.integrate import Solver
from symmb.run.simulation import Trajectory, simulate
from symmb.study.ladders import CONTROLLED

LEFT_OUT = "left out for lack of time"
_TOO_LONG, _MANY_STEPS = "took more than", "has taken too many steps at"
_LONGER, _LARGER = "a longer step took too long", "a larger tolerance took too long"
_EASIER = "an easier variant took too long"
SLOW = (LEFT_OUT, _TOO_LONG, _LONGER, _LARGER, _EASIER, _MANY_STEPS)
"""First words of the reason of a trial that had no time to finish."""
_LIMITED = ("TOO_MUCH_WORK", "steps are not enough")
"""Parts of the messages of solvers that reached their maximum number of steps."""
_ENERGY = "the energy"
"""First words of the reason of a trial with a wrong energy."""
_TOO_SLOW, _WRONG_ENERGY, _BROKEN = "too slow", "wrong energy", "breaks down"
"""Kinds of failures. LEFT_OUT is another kind."""
_SETUP = 15.0
"""Processor time in which the scene of a job is made and its equations are derived [s], before its first trial."""
_SHORT = 1e-9
"""Horizon of a run that derives the equations and compiles the solver, divided by the horizon of the scene."""
_HARDER = ("stiffness", "mass ratio", "horizon")
"""First words of the variants that take longer with a larger factor."""
_WALL = 20.0
"""Wall time over processor time after which a trial counts as hanging. On a busy machine, trials wait for others."""
_DRIFT = entry(Record.size, None)


@dataclass(frozen=True)
class Trial:
    """One run of a scene by a solver.

    Attributes
    ----------
    scene : str                the variant of the scene, "" for the scene itself
    solver : str               text of the solver
    family : str               name of the solver's class, with the option that distinguishes the family
    setting : float            relative tolerance or step [s]
    reason : str               reason why the run failed; empty if the run succeeded
    seconds : float            time of the run alone
    position, velocity : (n_t,) arrays     largest violation of a constraint at each time
    energy : float             largest error of the energy balance divided by the largest kinetic energy
    times : (n_t,) array       output times [s]
    values : (n_t, n_y) array  outputs
    states : (n_t, n_x) array
    """

    scene: str = field(metadata=entry(name="stress"))
    solver: str
    family: str
    setting: float
    reason: str = ""
    seconds: float = field(default=float("nan"), metadata=entry(name="run_seconds"))
    position: Array = field(default_factory=lambda: np.empty(0), repr=False, metadata=_DRIFT)
    velocity: Array = field(default_factory=lambda: np.empty(0), repr=False, metadata=_DRIFT)
    energy: float = field(default=float("nan"), metadata=entry(name="energy_drift"))
    times: Array = field(default_factory=lambda: np.empty(0), repr=False, metadata=NOT_KEPT)
    values: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False, metadata=NOT_KEPT)
    states: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False, metadata=NOT_KEPT)

    def record(self) -> dict[str, Any]:
        """The trial for a file, without times, outputs and states."""
        position, velocity = (
            np.nan if self.reason else drift.max(initial=0.0) for drift in (self.position, self.velocity)
        )
        return entries(self) | {"position_drift": position, "velocity_drift": velocity}

    @property
    def key(self) -> str:
        """The key of the trial in a study."""
        return f"{self.scene}|{self.solver}"

    @property
    def slow(self) -> bool:
        """Whether the run was stopped for lack of time."""
        return self.reason.startswith(SLOW)

    @property
    def failure(self) -> str:
        """The kind of failure in words; empty if the run succeeded."""
        if not self.reason:
            return ""
        if self.slow:
            return LEFT_OUT if self.reason == LEFT_OUT else _TOO_SLOW
        return _WRONG_ENERGY if self.reason.startswith(_ENERGY) else _BROKEN


def by_reason(trials: Sequence[Trial]) -> str:
    """The families of trials that failed, by the kind of their failure."""
    texts = list[str]()
    for kind in (LEFT_OUT, _TOO_SLOW, _WRONG_ENERGY, _BROKEN):
        some = [trial for trial in trials if trial.failure == kind]
        at = [float(time) for trial in some for time in re.findall(r" at t = (\S+) s", trial.reason)]
        first = f" at t = {min(at):.3g} s" if kind == _BROKEN and at else ""
        if some:
            texts.append(f"{kind}{first}: {named(some)}")
    return "; ".join(texts)


def by_family(trials: Sequence[Trial]) -> dict[str, list[Trial]]:
    """The trials of each family."""
    families = dict[str, list[Trial]]()
    for trial in trials:
        families.setdefault(trial.family, []).append(trial)
    return families


def named(trials: Sequence[Trial]) -> str:
    """The families of trials as a list of words."""
    return ", ".join(" ".join(reversed(family.split(", "))) for family in by_family(trials))


@dataclass(frozen=True)
class Job:
    """Settings of one solver, which run one after the other, from fast to slow.

    Attributes
    ----------
    scene : str                        name of the variant
    make : callable                    function that makes the scene
    family : str
    solvers : sequence                 pairs of setting and solver
    follow : scene -> sequence         further settings that depend on the scene; optional
    """

    scene: str
    make: Callable[[], Scene]
    family: str
    solvers: Sequence[tuple[float, Solver]]
    follow: Callable[[Scene], Sequence[tuple[float, Solver]]] | None = None

    @property
    def kind(self) -> tuple[str, str]:
        """The family, and the variants to which the scene belongs. Variants with larger factors are harder."""
        return self.family, self.scene.rpartition(" x ")[0]

    def trial(self, k: int, **results: Any) -> Trial:
        setting, solver = self.solvers[k]
        return Trial(self.scene, repr(solver), self.family, setting, **results)

    def begin(self) -> "Job":
        """The job with all its settings and its scene, made in this process, and a compiled solver."""
        try:
            scene = self.make()
            further = self.follow(scene) if self.follow else ()
        except SymmbError as error:
            return replace(self, make=partial(_raise, error), follow=None)
        begin, end = float(scene.times[0]), float(scene.times[-1])
        with contextlib.suppress(SymmbError):  # the trials tell why
            simulate(scene.with_times([begin, begin + _SHORT * (end - begin)]), self.solvers[0][1])
        return replace(self, make=lambda: scene, solvers=[*self.solvers, *further], follow=None)

    def run(self) -> Iterator[Trial]:
        """All trials in this process."""
        for k, (_, solver) in enumerate(self.solvers):
            try:
                scene = self.make()
            except SymmbError as error:
                yield self.trial(k, reason=str(error).splitlines()[0])
                continue
            try:
                yield self.trial(k, **_results(scene, solver))
            except SymmbError as error:
                reason = str(error).splitlines()[0].removeprefix(f"{scene.name}: ")
                if any(part in reason for part in _LIMITED):
                    reason = " ".join([_MANY_STEPS, *re.findall(r"at (t = \S+ s)", reason)[:1]])
                yield self.trial(k, reason=reason)


def _raise(error: SymmbError) -> Scene:
    raise error


def _results(scene: Scene, solver: Solver) -> dict[str, Any]:
    """The attributes of the trial of a finished run."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the trial reports problems of the run
        run = simulate(scene, solver)
        return {
            "reason": _fault(run),
            "seconds": run.run_seconds,
            "position": run.drift.position,
            "velocity": run.drift.velocity,
            "energy": run.energy_drift,
            "times": run.t,
            "values": run.values,
            "states": run.x,
        }


def _fault(run: Trajectory) -> str:
    """The reason why a finished run counts as failed; empty if it succeeded."""
    if not (np.isfinite(run.values).all() and np.isfinite(run.x).all()):
        return "outputs are not finite"
    T, V, W = run.energy
    if not np.isfinite(T + V - W).all():
        return f"{_ENERGY} is not finite"
    # A run has failed if its drift of energy exceeds this fraction of the largest kinetic energy. Half of the energy of
    # the motion is then wrong.
    if run.energy_drift > 0.5:
        return f"{_ENERGY} is off by {run.energy_drift:.1g} of the largest kinetic energy"
    return ""


@dataclass
class _Running:
    """A job in a separate process, which sends its trials through a pipe."""

    job: Job
    process: Any
    pipe: Connection
    limit: float
    since: float
    done: int = 0
    ended: bool = False

    def received(self) -> Iterator[Trial]:
        """The trial in the pipe. The first message contains the settings of the job. A closed pipe ends the job."""
        try:
            message = self.pipe.recv()
        except EOFError:
            self.process.join()
            if self.process.exitcode == -signal.SIGPROF:
                yield from self._too_long()
            else:
                self.ended = True
                yield from _left(self.job, self.done, "the process ended without a result")
            return
        if isinstance(message, Trial):
            yield message
            self.done += 1
        else:
            self.job = replace(self.job, solvers=message)
        self.since = time.monotonic()
        self.ended = self.done == len(self.job.solvers)

    @property
    def is_hanging(self) -> bool:
        return time.monotonic() - self.since > _WALL * (self.limit + _SETUP)

    def _too_long(self) -> Iterator[Trial]:
        """The remaining trials of the job, marked as left out."""
        self.ended = True
        others = _LARGER if self.job.family in CONTROLLED else _LONGER
        yield from _left(self.job, self.done, f"{_TOO_LONG} {self.limit:g} s of processor time", others)

    def steps(self, is_ready: bool) -> Iterator[Trial]:
        """The trials that are known now."""
        if is_ready:
            yield from self.received()
        elif self.is_hanging:
            yield from self._too_long()


def processor_time() -> float:
    """Processor time of this process and of the processes that it has waited for [s]."""
    return sum(os.times()[:4])


def run_jobs(jobs: Sequence[Job], limit: float, end: float) -> Iterator[Trial]:
    """The trials of all jobs, in the order in which they end.

    A trial is stopped if it takes more processor time than the limit [s]. Slower trials of the same job are then left
    out, and if it was the first one, also harder variants. No job starts after a processor time (`processor_time`). If
    processes cannot be forked, jobs run in this process one after the other, without limits.
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        for job in jobs:
            yield from job.begin().run() if processor_time() < end else _left(job, 0, LEFT_OUT)
        return
    pending, running, slow = list(jobs), list[_Running](), set[tuple[str, str]]()
    try:
        while pending or running:
            # Number of trials that run at the same time. A variant waits for easier ones.
            kinds = [r.job.kind for r in running]
            while len(kinds) < 2 and (job := next((job for job in pending if job.kind not in kinds), None)):
                pending.remove(job)
                if job.kind in slow:
                    yield from _left(job, 0, _EASIER)
                elif processor_time() < end:
                    running.append(_begin(job, limit))
                    kinds.append(job.kind)
                else:
                    yield from _left(job, 0, LEFT_OUT)
            # Time between checks of the running trials [s]: shorter than a trial, and longer than a check.
            ready = wait([r.pipe for r in running], 0.2)
            for r in list(running):
                for trial in r.steps(r.pipe in ready):
                    if trial.slow and trial.setting == r.job.solvers[0][0] and r.job.scene.startswith(_HARDER):
                        slow.add(r.job.kind)
                    yield trial
                if r.ended:
                    _end(r)
                    running.remove(r)
    finally:  # also if the caller is interrupted
        for r in running:
            _end(r)


def _begin(job: Job, limit: float) -> _Running:
    context = multiprocessing.get_context("fork")
    mine, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(job, theirs, limit), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of forks in programs with threads
        process.start()
    theirs.close()
    running = _Running(job, process, mine, limit, time.monotonic())
    note_group(running.process.pid)
    return running


def _end(running: _Running) -> None:
    end_groups(running.process.pid)
    running.process.join()


def _send(job: Job, pipe: Connection, limit: float) -> None:
    """Send the settings of a job and its trials. The system ends this process if a trial takes too long."""
    lead_group()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, _SETUP)
    begun = job.begin()
    signal.setitimer(signal.ITIMER_PROF, limit)
    pipe.send(begun.solvers)
    for trial in begun.run():
        signal.setitimer(signal.ITIMER_PROF, limit)
        pipe.send(trial)
    pipe.close()


def _left(job: Job, done: int, reason: str, others: str | None = None) -> Iterator[Trial]:
    for k in range(done, len(job.solvers)):
        yield job.trial(k, reason=reason if k == done or others is None else others)
