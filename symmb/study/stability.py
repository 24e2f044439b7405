"""Stability of solvers: every solver with several steps or tolerances, on a scene and its harder variants."""

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symmb import files, plot
from symmb._errors import SimulationError
from symmb._interrupts import carry
from symmb._table import aligned
from symmb._types import Array
from symmb.integrate import CVODES, IDAS, NSTIFFSI2, SOLVERS, Rosenbrock, Solver, StabilizedIndex2, stiffness
from symmb.model import Box, Scene
from symmb.simulation import DAESimulator, require_scene
from symmb.study.advice import advice
from symmb.study.stress import stresses
from symmb.study.trials import Job, Trial, run_jobs

TIMES = 51
"""Output times: enough to show drift over time. Steps end at output times, so more of them would shorten steps."""
TOLERANCES = (1e-4, 1e-6, 1e-8)
"""Relative tolerances that are tried: coarse, usual and fine."""
STEPS = (50, 200, 800, 3200)
"""Numbers of fixed steps over the horizon that are tried."""
_LIMIT, _REFERENCE_LIMIT, _ALL = 3.0, 10.0, 45.0
"""Most time for a trial, most time for a reference, and time after which no trial begins [s]: the command takes about a
minute."""
_WIDTHS = 0.1, 0.2, 0.5
"""Half widths of wider boxes, as shares of the nominal values."""


@dataclass(frozen=True, eq=False)
class Stability:
    """Results of the solvers on a scene. `print` shows them, `plot` draws them, `save` and `load` keep them in a file.

    Attributes
    ----------
    scene : str
    times : (n_t,) array
    trials, stress : runs of the scene, and of its harder variants
    errors : dict              key of a trial -> root mean square error, over that of the deviation from the mean
    uncertainty : float        of the reference, in the same measure
    corners : dict             relative half width of the box -> (corners that fail, corners)
    advice : str
    """

    scene: str
    times: Array
    trials: tuple[Trial, ...]
    stress: tuple[Trial, ...]
    errors: dict[str, float]
    uncertainty: float
    corners: dict[float, tuple[int, int]]
    advice: str

    def __str__(self) -> str:
        head = ["solver", "setting", "error", "position", "velocity", "energy", "run [s]", "outcome"]
        lines = [
            f"{self.scene}: {len(self.trials)} runs from {self.times[0]:g} to {self.times[-1]:g} s, "
            f"errors to {self.uncertainty:.0e}",
            *aligned([head, *(self._cells(trial) for trial in self.trials)], left=(0, 7)),
        ]
        if self.stress:
            head[0:0] = ["under stress"]
            rows = [[trial.scene, *self._cells(trial)] for trial in self.stress]
            lines += ["", *aligned([head, *rows], left=(0, 1, 8))]
        for width, (failed, corners) in self.corners.items():
            lines.append(f"box widened to {width:.0%}: {failed or 'none'} of {corners} corners fail")
        return "\n".join([*lines, "", self.advice])

    def _cells(self, trial: Trial) -> list[str]:
        drift = [trial.position.max(initial=0.0), trial.velocity.max(initial=0.0), trial.energy]
        numbers = [self.errors.get(trial.key, np.nan), *(drift if not trial.reason else [np.nan] * 3), trial.seconds]
        cells = ["–" if np.isnan(number) else f"{number:.1e}" for number in numbers]
        return [trial.family, f"{trial.setting:.1e}", *cells, trial.reason or "finished"]

    def to_json(self) -> dict[str, Any]:
        """The results as lists, texts and numbers. Numbers that are not known are None."""
        return files.in_json(self._record())

    def save(self, path: str | Path) -> None:
        """Write an .npz or .json file. It holds neither outputs nor states of the trials.

        Raises
        ------
        DeclarationError    if the name has another suffix
        """
        files.save(path, self._record())

    @classmethod
    def load(cls, path: str | Path) -> "Stability":
        """Read a file of `save`.

        Raises
        ------
        DeclarationError    if the file is damaged or has other contents
        """
        return files.load(path, "a saved Stability", cls._of_record)

    def _record(self) -> dict[str, Any]:
        errors = [self.errors.get(trial.key) for trial in (*self.trials, *self.stress)]
        return {
            "scene": self.scene,
            "t": self.times,
            "uncertainty": self.uncertainty,
            "trials": [
                {**trial.record(), "error": error}
                for trial, error in zip((*self.trials, *self.stress), errors, strict=True)
            ],
            "corners": {f"{width:g}": list(counts) for width, counts in self.corners.items()},
            "advice": self.advice,
        }

    @classmethod
    def _of_record(cls, record: files.Record) -> "Stability":
        t, parts, corners = record.times(), record.records("trials"), record.record("corners")
        trials = [Trial.of_record(part) for part in parts]
        return cls(
            scene=record.text("scene"),
            times=t,
            trials=_parted(trials)[0],
            stress=_parted(trials)[1],
            errors={
                trial.key: part.number("error") for trial, part in zip(trials, parts, strict=True) if "error" in part
            },
            uncertainty=record.number("uncertainty"),
            corners={float(width): tuple(corners.array(width, 2).astype(int).tolist()) for width in corners.plain},
            advice=record.text("advice"),
        )

    def plot(self, path: str | Path) -> None:
        """Draw error against run time, the drift of positions over time, and errors of the harder variants."""
        finished = [trial for trial in self.trials if not trial.reason]
        points = {
            family: [(t.seconds, self.errors[t.key]) for t in finished if t.family == family]
            for family in dict.fromkeys(trial.family for trial in finished)
        }
        drift = {
            family: min(
                (t for t in finished if t.family == family), key=lambda t: abs(np.log10(self.errors[t.key]) + 4)
            ).position
            for family in points
        }
        stress = {
            family: {t.scene: self.errors.get(t.key, np.nan) for t in self.stress if t.family == family}
            for family in points
        }
        plot.plot_stability(self.times, points, drift, stress, path, title=self.scene)


def stability(scene: Scene, progress: Callable[[str, int, int], None] | None = None) -> Stability:
    """Try every solver on a scene and on harder variants, each run within 3 s and all within a minute.

    The variants have springs 100 and 10,000 times as stiff, a lightest body 100 and 10,000 times as light, a time scale
    a tenth and ten times as long (of laws of time, start velocities and gravity, not of springs and dampers), and
    horizons 10 and 100 times as long. The corners of boxes of 10, 20 and 50 % are tried as well.

    Parameters
    ----------
    scene : Scene
    progress : callable, optional      called with the label of the work, the finished runs and all its runs

    Raises
    ------
    AssemblyError              if the scene cannot be started
    SimulationError            if there is nothing to integrate, there are impacts, or no solver finishes
    KeyboardInterrupt          if it is interrupted: `partial` then holds the Stability of the runs so far
    """
    require_scene(scene)
    begin = time.monotonic()
    times = np.linspace(float(scene.times[0]), float(scene.times[-1]), TIMES)
    if scene.system.collected.impacts:
        raise SimulationError(f"{scene.name} has impacts, which only EventDriven() locates: no solvers to compare.")
    dae = DAESimulator(scene, CVODES()).dae
    if len(scene.times) < 2 or not dae.n_v:
        raise SimulationError(f"{scene.name} has no motion over a time to be tried.")
    scene_at_times = scene.with_times(times)
    jobs = [Job("", lambda: scene_at_times, family, ladder) for family, ladder in _ladders(float(times[-1] - times[0]))]
    under = [Job(name, make, family, [one]) for name, make in stresses(scene_at_times) for family, one in _few(times)]
    total = sum(len(job.solvers) for job in (*jobs, *under))
    done: list[Trial] = []

    def collect(some: Sequence[Job], limit: float) -> list[Trial]:
        order = [(job.scene, job.family) for job in some]
        first = len(done)
        for trial in run_jobs(some, limit, begin + _ALL):
            done.append(trial)
            if progress is not None:
                progress(trial.family, len(done), total + len(_REFERENCES))
        return sorted(done[first:], key=lambda t: order.index((t.scene, t.family)))  # stable

    references = collect(
        [Job("", lambda: scene_at_times, name, [one]) for name, one in _REFERENCES.items()], _REFERENCE_LIMIT
    )
    best, uncertainty = _reference(references)
    if best is None:
        raise SimulationError(f"{scene.name}: no solver finishes. {references[0].reason}")
    some = slice(None, None, max(1, TIMES // 10))
    fastest = stiffness(dae, best.states[some], dae.p_nominal, times[some])
    try:
        trials, stress = collect(jobs, _LIMIT), collect(under, _LIMIT)
        corners = _corners(scene)
    except KeyboardInterrupt as interrupt:
        parts = _parted(done[len(references) :])
        text = f"Interrupted after {len(done)} of {total + len(_REFERENCES)} runs."
        errors = _errors(*parts, best.values)
        carry(interrupt, Stability(scene.name, times, *parts, errors, uncertainty, {}, text))
        raise
    errors = _errors(trials, stress, best.values)
    text = advice(trials, stress, errors, corners, fastest, float(times[-1] - times[0]))
    return Stability(scene.name, times, tuple(trials), tuple(stress), errors, uncertainty, corners, text)


def _parted(trials: Sequence[Trial]) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Runs of the scene, and of its harder variants."""
    return tuple(trial for trial in trials if not trial.scene), tuple(trial for trial in trials if trial.scene)


def _errors(trials: Sequence[Trial], stress: Sequence[Trial], true: Array) -> dict[str, float]:
    """Errors of the runs of the scene, and of its harder variants, whose reference is the best of their own runs."""
    errors = {trial.key: _error(trial.values, true) for trial in trials if not trial.reason}
    for name in dict.fromkeys(trial.scene for trial in stress):
        finished = [trial for trial in stress if trial.scene == name and not trial.reason]
        best, _ = _reference(finished)
        if best is not None:
            errors |= {trial.key: _error(trial.values, best.values) for trial in finished if trial is not best}
    return errors


_REFERENCES: dict[str, tuple[float, Solver]] = {
    "IDAS()": (1e-11, IDAS()),
    "CVODES(stiff=True)": (1e-11, CVODES(stiff=True)),
    "CVODES(rtol=1e-12)": (1e-12, CVODES(rtol=1e-12)),
}


def _ladders(horizon: float) -> list[tuple[str, list[tuple[float, Solver]]]]:
    """Families of solvers with their settings: relative tolerance or step [s], and solver, from fast to slow."""
    families = []
    for entry in SOLVERS:
        if entry.ladder is not None:
            numbers = TOLERANCES if entry.tolerances else STEPS
            settings = [(r if entry.tolerances else horizon / r, entry.ladder(r, horizon)) for r in numbers]
            families.append((entry.family, settings))
    return families


def _few(times: Array) -> list[tuple[str, tuple[float, Solver]]]:
    """A setting of each of the most different solvers, the tightest last, with the same steps for all horizons."""
    step = float(times[-1] - times[0]) / 800
    return [
        ("NSTIFFSI2", (step, NSTIFFSI2(step=step))),
        ("Rosenbrock", (step, Rosenbrock(step=step))),
        ("StabilizedIndex2", (1e-6, StabilizedIndex2(rtol=1e-6))),
        ("CVODES, stiff", (1e-10, CVODES(rtol=1e-10, stiff=True))),
        ("CVODES", (1e-11, CVODES(rtol=1e-11))),
    ]


def _corners(scene: Scene) -> dict[float, tuple[int, int]]:
    """Numbers of corners of wider boxes that fail, and of all corners."""
    if scene.box is None or len(scene.box) > 8:
        return {}
    simulator, failures = DAESimulator(scene), {}
    order, nominal = list(simulator.parameters), np.array(list(simulator.parameters.values()))
    for width in _WIDTHS:
        box = Box.around(scene.system.parameters, width, scene.box.names)
        corners = box.from_unit(np.array(list(itertools.product((-1.0, 1.0), repeat=len(box)))))
        P = np.tile(nominal, (len(corners), 1))
        P[:, [order.index(name) for name in box.names]] = corners
        failures[width] = int((~simulator.run(P).ok).sum()), len(corners)
    return failures


def _reference(trials: Sequence[Trial]) -> tuple[Trial | None, float]:
    """The second of the two closest runs, and the distance between both."""
    done = [trial for trial in trials if not trial.reason]
    if len(done) < 2:
        return (done[0], float("nan")) if done else (None, float("nan"))
    apart, which = min((_error(done[i].values, done[j].values), j) for j in range(len(done)) for i in range(j))
    return done[which], apart


def _error(values: Array, true: Array) -> float:
    """Largest over outputs of the root mean square error over that of the deviation from the mean."""
    largest = np.abs(true).max(axis=0)
    deviation = np.std(true, axis=0)
    deviation = np.where(deviation > 1e-12 * largest, deviation, np.maximum(largest, 1e-300))
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.sqrt(np.mean(np.square(values - true), axis=0)) / deviation
    return float(np.nan_to_num(error, nan=np.inf, posinf=np.inf).max(initial=0.0))
