"""Stability of solvers: every solver with several steps or tolerances, on a scene and on harder variants."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import SimulationError, WithWarnings
from symmb._interrupts import carry, kept_interrupts
from symmb._magnitudes import NOTHING
from symmb._options import require_callable, require_positive
from symmb._progress import shown
from symmb._table import aligned
from symmb._types import Array, Figure
from symmb.bound.responses import parameter_samples
from symmb.equations.model import Box, Scene
from symmb.results import plot
from symmb.results.files import NOT_KEPT, Record, Saved, attributes, entries, entry
from symmb.run.codegen import compiler_advice, has_compiler
from symmb.run.formulations import program_of
from symmb.run.integrate import Stiffness, stiffness
from symmb.run.simulation import Subject, scene_of
from symmb.run.verification import linear_theory_doubts
from symmb.study.advice import advice
from symmb.study.ladders import Ladder, finer_steps, ladders, references, under_stress
from symmb.study.standard import Standard, standard_of
from symmb.study.stress import stresses
from symmb.study.trials import Job, Trial, by_family, processor_time, run_jobs

TIMES = 51
"""Number of output times, enough to show drift over time. Steps end at output times: more times need shorter steps."""
_HEAD = ("solver", "setting", "error", "position", "velocity", "energy", "run [s]", "outcome")
_LEFT, _STRESS_LEFT = (0, 7), (0, 1, 8)
"""Head of the tables, and columns that are aligned on the left."""


@dataclass(frozen=True, eq=False, repr=False)
class Stability(plot.ThreeDiagrams, WithWarnings, Saved):
    """Results of the solvers on a scene. `print` shows the results. `save` and `load` write and read files.

    `plot` draws error against run time, the drift of positions over time, and errors of the harder variants.

    Attributes
    ----------
    scene : str
    times : (n_t,) array
    trials, stress : runs of the scene, and of its harder variants
    errors : dict
        key of a trial -> root mean square error, divided by the rms deviation from the mean; empty without a reference
    uncertainty : float
        uncertainty of the reference of the scene, measured like `errors`; nan if there is no reference
    corners : dict
        relative half width of the box -> (number of failed runs at corners, number of corners)
    advice : str

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start={"ball.vx": 2.0}, times=[0.0, 1.0])
    >>> study = mb.stability(fall, seconds=0.5)  # so that few settings are tried
    >>> study.trials[0].family
    'DormandPrince'
    """

    scene: str
    times: Array = field(metadata=entry(Record.times, name="t"))
    trials: tuple[Trial, ...] = field(metadata=NOT_KEPT)
    stress: tuple[Trial, ...] = field(metadata=NOT_KEPT)
    errors: dict[str, float] = field(metadata=NOT_KEPT)
    uncertainty: float
    corners: dict[float, tuple[int, int]] = field(metadata=NOT_KEPT)
    advice: str

    def __str__(self) -> str:
        lines = [self._head(), *aligned(self._rows(), left=_LEFT)]
        if self.stress:
            lines += ["", *aligned(self._stress_rows(), left=_STRESS_LEFT)]
        return "\n".join([*lines, *self._corner_lines(), "", self.advice])

    def _repr_html_(self) -> str:
        tables = [html.table(self._rows(), _LEFT)]
        if self.stress:
            tables.append(html.table(self._stress_rows(), _STRESS_LEFT))
        notes = html.text("\n".join([*self._corner_lines(), "", self.advice]).strip())
        return html.page(html.text(self._head()), *tables, notes, html.picture(plot.png(self.plot())))

    def _head(self) -> str:
        known = "errors are not known" if np.isnan(self.uncertainty) else f"errors known to {self.uncertainty:.0e}"
        return f"{self.scene}: {len(self.trials)} runs from {self.times[0]:g} to {self.times[-1]:g} s, {known}"

    def _rows(self) -> list[list[str]]:
        return [[*_HEAD], *(self._cells(trial) for trial in self.trials)]

    def _stress_rows(self) -> list[list[str]]:
        return [["under stress", *_HEAD], *([trial.scene, *self._cells(trial)] for trial in self.stress)]

    def _corner_lines(self) -> list[str]:
        return [
            f"box widened to {width:.0%}: {failed or 'none'} of {corners} corners fail"
            for width, (failed, corners) in self.corners.items()
        ]

    def _cells(self, trial: Trial) -> list[str]:
        drift = [trial.position.max(initial=0.0), trial.velocity.max(initial=0.0), trial.energy]
        numbers = [self.errors.get(trial.key, np.nan), *(drift if not trial.reason else [np.nan] * 3), trial.seconds]
        cells = ["–" if np.isnan(number) else f"{number:.1e}" for number in numbers]
        return [trial.family, f"{trial.setting:.1e}", *cells, trial.reason or "finished"]

    def _record(self) -> dict[str, Any]:
        trials = (*self.trials, *self.stress)
        return entries(self) | {
            "trials": [{**trial.record(), "error": self.errors.get(trial.key)} for trial in trials],
            "corners": {f"{width:g}": list(counts) for width, counts in self.corners.items()},
        }

    @classmethod
    def _of_record(cls, record: Record) -> "Stability":
        parts, corners = record.records("trials"), record.arrays("corners", 2)
        trials = [Trial(**attributes(Trial, part)) for part in parts]
        known = [(trial.key, part) for trial, part in zip(trials, parts, strict=True) if "error" in part]
        own, stress = _parted(trials)
        return cls(
            **attributes(cls, record),
            trials=own,
            stress=stress,
            errors={key: part.number("error") for key, part in known},
            corners={float(width): tuple(counts.astype(int).tolist()) for width, counts in corners.items()},
        )

    def _figure(self, style: plot.Style) -> Figure:
        finished = by_family([trial for trial in self.trials if not trial.reason])
        points = {
            family: [(t.seconds, self.errors[t.key]) for t in trials if t.key in self.errors]
            for family, trials in finished.items()
        }

        def distance(trial: Trial) -> float:
            """Orders of magnitude between an error and 1e-4."""
            return abs(np.log10(max(self.errors.get(trial.key, 1e-4), NOTHING)) + 4)

        drift = {family: min(trials, key=distance).position for family, trials in finished.items()}
        stress = {
            family: {t.scene: self.errors.get(t.key, np.nan) for t in self.stress if t.family == family}
            for family in finished
        }
        return plot.plot_stability(self.times, points, drift, stress, title=self.scene, style=style)


@kept_interrupts()
def stability(
    scene: Scene, progress: Callable[[str, int, int], None] | None = None, *, seconds: float = 60.0
) -> Stability:
    """Try every solver on a scene and on harder variants. All runs take about a minute of processor time.

    In some variants, springs are 100 or 10,000 times as stiff, or the lightest body is 100 or 10,000 times as light. In
    other variants, functions of time, start velocities and gravity make the motion 10 times faster or slower, with the
    same springs and dampers. Horizons are 10 and 100 times as long. Boxes of 10, 20 and 50 % are tried at their
    corners.

    Fixed steps depend on the horizon and the fastest motion. Errors are differences from a reference solution that
    conserves energy. Runs with two tolerances confirm this solution. If oscillations are too fast for these runs, two
    solvers that damp oscillations may confirm a solution without them. Without a reference, no setting is recommended.

    Parameters
    ----------
    scene : Scene
    progress : callable, optional
        called with the label of the work, the number of finished runs and the number of all runs; default: a bar, in
        notebooks and terminals
    seconds : float
        processor time after which no run starts [s]; a single run may take a fortieth of this time

    Raises
    ------
    DeclarationError
        If seconds is not above 0
    AssemblyError
        If the scene cannot be started
    SimulationError
        If there is nothing to integrate, if there are impacts, or if no solver finishes
    KeyboardInterrupt
        If the study is interrupted. `partial` then contains the Stability of the finished runs

    Examples
    --------
    >>> import symmb as mb
    >>> ground, mass = mb.Ground(), mb.Body("mass", mass=1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", ground.point(0, 0), mass.point(0, 0), 40.0, length=0.5)
    >>> times = [0.0, 0.5, 1.0]
    >>> scene = mb.Scene(mb.System(mass, spring), start={"mass.x": 1.0}, times=times, name="mass on a spring")
    >>> study = mb.stability(scene, seconds=0.5)  # so that few settings are tried: print(study) advises
    >>> study.scene
    'mass on a spring'
    """
    scene = scene_of(scene).curves  # variants have other times
    require_positive("stability", "seconds", seconds)
    require_callable("stability: progress", progress, "label", "done", "all")
    with shown(progress, f"trying solvers on {scene.name}") as progress:
        study = _StabilityStudy(scene, progress)
        # Trials of the scene itself end after half of the time. The harder variants use the remaining time.
        limit, half = seconds / 40, 0.5 * seconds
        study.collect(study.jobs(references(study.step)), 2 * limit, half)
        known = list(study.done)
        fastest, horizon = study.fastest(), float(study.times[-1] - study.times[0])
        jobs = study.jobs(ladders(horizon, fastest.rate))
        harder = [job for name, make in stresses(study.scene) for job in _stress_jobs(name, make, study.step)]
        harder = [job for job in harder if job.family not in study.untried]
        study.announce(jobs, harder)
        try:
            study.collect(jobs, limit, half)
            # Each family of solvers runs all variants before the next family starts.
            families = list(under_stress(1.0))
            study.collect(sorted(harder, key=lambda job: families.index(job.family)), limit, seconds)
            corners = _corners(scene)
        except KeyboardInterrupt as interrupt:
            text = f"Interrupted after {len(study.done)} of {study.total} runs."
            carry(interrupt, study.result(len(known), {}, lambda *_: text))
            raise
        if all(trial.reason for trial in study.done if not trial.scene):
            more = " Allow more by seconds=." if known[0].slow else ""
            raise SimulationError(f"{scene.name}: no solver finishes. The first one: {known[0].reason}.{more}")
        more = {"corners": corners, "fastest": fastest, "span": horizon, "doubts": study.doubts()}
        return study.result(len(known), corners, partial(advice, **more))


class _StabilityStudy:
    """A scene, and its runs so far."""

    def __init__(self, scene: Scene, progress: Callable[[str, int, int], None] | None) -> None:
        self._begin, self._progress = processor_time(), progress
        self.times = np.linspace(float(scene.times[0]), float(scene.times[-1]), TIMES)
        # Number of fixed steps over the horizon of the scene, which gives the steps of the variants.
        self.step = float(self.times[-1] - self.times[0]) / 800
        if scene.system.collected.has_events:
            raise SimulationError(
                f"{scene.name} has impacts, or joints that open or close. Only EventDriven() locates such events, "
                "so there are no solvers to compare."
            )
        self._bodies, self._units = program_of(scene).bodies, scene.curve_units
        if len(scene.times) < 2 or not self._bodies.dae.n_v:
            raise SimulationError(f"{scene.name} has no motion over time, so solvers cannot be compared.")
        self.scene, self.done, self._order = scene.with_times(self.times), [], []
        own = {family: ladder[0][1] for family, ladder in ladders(1.0, 1.0).items() if not has_compiler()}
        self.untried = [name for name, s in own.items() if s.needs_compiler and s.runs_in_lanes(self._bodies.dae)]
        self.total = sum(len(job.solvers) for job in self.jobs(references(self.step)))

    def jobs(self, families: Mapping[str, Ladder]) -> list[Job]:
        """The scene itself, by all solvers of the families. Families are left out if their C compiler is missing."""
        tried = {family: ladder for family, ladder in families.items() if family not in self.untried}
        return [Job("", lambda: self.scene, family, ladder) for family, ladder in tried.items()]

    def announce(self, *jobs: Sequence[Job]) -> None:
        """Set the order of the report to that of these jobs, and count their runs."""
        self._order = [(job.scene, job.family) for some in jobs for job in some]
        self.total += sum(len(job.solvers) for some in jobs for job in some)

    def collect(self, jobs: Sequence[Job], limit: float, end: float) -> None:
        """Run jobs. Each trial has a limit of processor time, and no job starts after the end [s]."""
        for trial in run_jobs(jobs, limit, self._begin + end):
            self.done.append(trial)
            if self._progress is not None:
                self._progress(trial.family, len(self.done), max(self.total, len(self.done)))

    def fastest(self) -> Stiffness:
        """The fastest rates along a finished run, or at the start if no run finished."""
        dae, states = self._bodies.dae, self._states()
        some = slice(None, None, max(1, len(states) // 10))
        return stiffness(dae, states[some], dae.p_nominal, self.times[: len(states)][some])

    def doubts(self) -> tuple[str, ...]:
        """Warnings about solvers that were not tried, and about too large deflections of flexible bodies."""
        dae, states = self._bodies.dae, self._states()
        untried = f"Not tried: {', '.join(self.untried)}, which need a C compiler. {compiler_advice()}"
        theory = linear_theory_doubts(self.scene, dae, states, dae.p_nominal, self.times[: len(states)])
        return (*([untried] if self.untried else []), *theory)

    def _states(self) -> Array:
        """States (m, n_x) of a finished run, or the start if no run finished."""
        states, _ = self._bodies.start.states(self._bodies.dae.p_nominal[None])
        return next((trial.states for trial in reversed(self.done) if not trial.reason), states)

    def result(
        self,
        n_known: int,
        corners: dict[float, tuple[int, int]],
        text: Callable[[Sequence[Trial], Sequence[Trial], dict[str, Standard]], str],
    ) -> Stability:
        """The result of the finished runs. The first runs are for the reference of the scene."""
        known, rest = self.done[:n_known], self.done[n_known:]
        rest = sorted(rest, key=lambda t: self._order.index((t.scene, t.family)))  # stable
        trials, stress = _parted(rest)
        standards = {
            name: standard_of([t for t in (*known, *stress) if t.scene == name], self._units)
            for name in dict.fromkeys(t.scene for t in (*known, *stress))
        }
        errors = {trial.key: standards[trial.scene].error(trial) for trial in rest}
        return Stability(
            self.scene.name,
            self.times,
            trials,
            stress,
            {key: error for key, error in errors.items() if error is not None},
            standards[""].uncertainty,
            corners,
            text(trials, stress, standards),
        )


def _parted(trials: Sequence[Trial]) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """The runs of the scene, and the runs of its harder variants."""
    return tuple(trial for trial in trials if not trial.scene), tuple(trial for trial in trials if trial.scene)


def _stress_jobs(name: str, make: Callable[[], Scene], step: float) -> list[Job]:
    """Jobs of all families for a variant. Fixed steps do not depend on the horizon. Fast motions add smaller steps."""
    further = {"NSTIFFSI2": partial(finer_steps, longest=step / 64)}
    return [Job(name, make, family, ladder, further.get(family)) for family, ladder in under_stress(step).items()]


def _corners(scene: Scene) -> dict[float, tuple[int, int]]:
    """The number of corners of wider boxes that fail, and the number of all corners."""
    if scene.box is None or len(scene.box) > 8:
        return {}
    simulator, failures = Subject(scene).motion, {}
    for width in (0.1, 0.2, 0.5):  # half widths, relative to the nominal values
        box = Box.around(scene.system.parameters, width, scene.box.names)
        P = parameter_samples(simulator, box, np.array(list(itertools.product((-1.0, 1.0), repeat=len(box)))))
        failures[width] = int((~simulator.run(P).ok).sum()), len(P)
    return failures
