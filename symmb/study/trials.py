"""Runs that may break down or take too long, each family of solvers in a process of its own."""

import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np

from symmb._cleanup import end_group, lead_group, note_group
from symmb._errors import SymmbError, SymmbWarning
from symmb._types import Array
from symmb.files import Record
from symmb.integrate import Solver
from symmb.model import Scene
from symmb.simulation import simulate

LEFT_OUT = "left out for want of time"
_TICK = 0.2
"""Time between two looks at the running trials [s]: short beside a trial, long beside a look."""
_SETUP = 8.0
"""Additional time for the first trial of a job [s]: its compilation is cached only if it ends."""


@dataclass(frozen=True)
class Trial:
    """One run of a scene by a solver.

    Attributes
    ----------
    scene : str                the variant of the scene, "" for the scene itself
    solver : str               text of its constructor
    family : str               name of its class, with the option that distinguishes it
    setting : float            relative tolerance or step [s]
    reason : str               why it failed; empty if it did not
    seconds : float            of the run alone
    position, velocity : (n_t,) arrays     largest violation of a row, at every time
    energy : float             largest imbalance over the largest kinetic energy
    values : (n_t, n_y) array  outputs
    states : (n_t, n_x) array
    """

    scene: str
    solver: str
    family: str
    setting: float
    reason: str = ""
    seconds: float = float("nan")
    position: Array = field(default_factory=lambda: np.empty(0), repr=False)
    velocity: Array = field(default_factory=lambda: np.empty(0), repr=False)
    energy: float = float("nan")
    values: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    states: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)

    def record(self) -> dict[str, Any]:
        """The trial for a file, without outputs and states."""
        return {
            "stress": self.scene,
            "solver": self.solver,
            "family": self.family,
            "setting": self.setting,
            "reason": self.reason,
            "position_drift": np.nan if self.reason else self.position.max(initial=0.0),
            "velocity_drift": np.nan if self.reason else self.velocity.max(initial=0.0),
            "energy_drift": self.energy,
            "run_seconds": self.seconds,
            "position": self.position,
            "velocity": self.velocity,
        }

    @classmethod
    def of_record(cls, record: Record) -> "Trial":
        """The trial of a file."""
        return cls(
            scene=record.text("stress"),
            solver=record.text("solver"),
            family=record.text("family"),
            setting=record.number("setting"),
            reason=record.text("reason"),
            seconds=record.number("run_seconds"),
            position=record.size("position", None),
            velocity=record.size("velocity", None),
            energy=record.number("energy_drift"),
        )

    @property
    def key(self) -> str:
        """Its key in a study."""
        return f"{self.scene}|{self.solver}"


@dataclass(frozen=True)
class Job:
    """Settings of one solver to run one after the other, from fast to slow."""

    scene: str
    make: Callable[[], Scene]
    family: str
    solvers: Sequence[tuple[float, Solver]]

    def trial(self, k: int, **results: Any) -> Trial:
        setting, solver = self.solvers[k]
        return Trial(self.scene, repr(solver), self.family, setting, **results)

    def run(self) -> Iterator[Trial]:
        """All trials in this process."""
        scene = None
        for k, (_, solver) in enumerate(self.solvers):
            try:
                scene = self.make() if scene is None else scene
                with warnings.catch_warnings():  # the study judges the run itself
                    warnings.simplefilter("ignore", SymmbWarning)
                    run = simulate(scene, solver)
            except SymmbError as error:
                reason = str(error).splitlines()[0]
                yield self.trial(k, reason=reason.removeprefix(f"{scene.name}: ") if scene else reason)
                continue
            finite = bool(np.isfinite(run.values).all())
            yield self.trial(
                k,
                reason="" if finite else "outputs are not finite",
                seconds=run.run_seconds,
                position=run.drift.position,
                velocity=run.drift.velocity,
                energy=run.energy_drift,
                values=run.values,
                states=run.x,
            )


@dataclass
class _Running:
    job: Job
    process: Any
    pipe: Connection
    since: float
    done: int = 0


def run_jobs(jobs: Sequence[Job], limit: float, deadline: float, workers: int = 2) -> Iterator[Trial]:
    """The trials of all jobs, as they end.

    A trial that takes longer than the limit [s], without its set-up, is stopped, and the slower ones of its job are
    left out. After the deadline (`time.monotonic`) no job begins. Where processes cannot be forked, jobs run in this
    process one after the other, without limits.
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        for job in jobs:
            yield from job.run() if time.monotonic() < deadline else _left(job, 0, LEFT_OUT)
        return
    pending: list[Job] = list(jobs)
    running: list[_Running] = []
    try:
        yield from _forked(pending, running, limit, deadline, workers)
    finally:  # also where the caller is interrupted
        for r in running:
            _end(r)


def _forked(
    pending: list[Job], running: list[_Running], limit: float, deadline: float, workers: int
) -> Iterator[Trial]:
    while pending or running:
        while pending and len(running) < workers:
            job = pending.pop(0)
            if time.monotonic() < deadline:
                running.append(_begin(job))
            else:
                yield from _left(job, 0, LEFT_OUT)
        ready = wait([r.pipe for r in running], _TICK)
        for r in list(running):
            if r.pipe in ready:
                try:
                    yield r.pipe.recv()
                    r.done, r.since = r.done + 1, time.monotonic()
                    ended = r.done == len(r.job.solvers)
                except EOFError:
                    ended = True
                    yield from _left(r.job, r.done, "the process broke down")
            else:
                ended = time.monotonic() - r.since > (limit if r.done else limit + _SETUP)
                if ended:
                    yield from _left(r.job, r.done, f"took longer than {limit:g} s", "a longer step took too long")
            if ended:
                _end(r)
                running.remove(r)


def _begin(job: Job) -> _Running:
    context = multiprocessing.get_context("fork")
    mine, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(job, theirs), daemon=True)
    process.start()
    theirs.close()
    running = _Running(job, process, mine, time.monotonic())
    note_group(running.process.pid)
    return running


def _end(running: _Running) -> None:
    end_group(running.process.pid)
    running.process.join()


def _send(job: Job, pipe: Connection) -> None:
    lead_group()
    for trial in job.run():
        pipe.send(trial)
    pipe.close()


def _left(job: Job, done: int, reason: str, others: str | None = None) -> Iterator[Trial]:
    for k in range(done, len(job.solvers)):
        yield job.trial(k, reason=reason if k == done or others is None else others)
