"""The simulator of a scene with random inputs: scalar outputs over the runs of all realizations."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import casadi as ca
import numpy as np

import symmb.connect as connect
from symmb._errors import DeclarationError, WithWarnings
from symmb._names import ByName
from symmb._types import Array, Executor
from symmb._units import told_names, units_of_parameters, values_text
from symmb.connect import Ensemble, Progress, Reduction, checked_samples, stream
from symmb.declare import mechanics
from symmb.declare.mechanics import Input
from symmb.declare.symbolic import ddt, t
from symmb.equations.model import Scene
from symmb.run.integrate import Solver
from symmb.run.simulation.dae_simulator import DAESimulator
from symmb.run.simulation.figure_simulator import FigureSimulator
from symmb.run.simulation.pilots import at_tolerances

if TYPE_CHECKING:
    from symmb.run.codegen import Card

S = TypeVar("S")
_GROUP = 16
"""Smallest number of seeds of a group. Averages over groups give the standard error."""
_OVER_TIME = "mean", "rms", "psd", "percentile"
"""Kinds of scalar outputs that are averages over the times of all runs."""
_RTOL = 1e-4
"""Default relative tolerance of the solver. Its errors are smaller than those of averages over 1000 realizations."""


def random_inputs(scene: Scene) -> "tuple[mechanics.RandomInput, ...]":
    """The random inputs of a scene whose seeds are not parameters."""
    inputs = [e for e in scene.system.elements if isinstance(e, Input)]  # most scenes have none
    return tuple(e for e in inputs if isinstance(e, mechanics.RandomInput) and e.name in scene.system.inputs)


class RandomSimulator(WithWarnings):
    """A simulator of a scene with random inputs. A sample is the average of scalar outputs over all realizations.

    All samples have the same seeds, so that averages depend smoothly on the parameters. Between output times, curves
    are polynomials of degree 5.

    Raises
    ------
    DeclarationError
        If the scene has outputs over time, or if a random function of way stands still

    Parameters
    ----------
    scene : Scene
    inputs : sequence of RandomInput
        the random inputs of the scene
    solver : Solver, optional
        default: pilot runs choose the solver, with a relative tolerance of 1e-4
    card : Card, optional
        graphics card of the runs
    """

    def __init__(
        self, scene: Scene, inputs: "Sequence[mechanics.RandomInput]", solver: Solver | None, card: "Card | None" = None
    ) -> None:
        if scene.curve_names:
            raise DeclarationError(
                f"{scene.name}: a study of random inputs needs scalar outputs, but {scene.curve_names[0]!r} is an "
                "output over time. Write mb.rms(...), mb.maximum(...) or another scalar output."
            )
        own = scene.with_inputs([e.name for e in inputs])
        curves = DAESimulator(own.curves, solver)
        if solver is None and hasattr(curves.solver, "rtol"):
            curves = curves.solved_by(at_tolerances(curves.solver, {"rtol": _RTOL}))
        self.runs = FigureSimulator(own, curves if card is None else curves.on_card(card))
        self.name, self.box, self.outputs, self.units = scene.name, scene.box, self.runs.outputs, self.runs.units
        self.parameters, self.times, self.solver = ByName(scene.system.parameters), np.zeros(1), curves.solver
        count = max(e.realizations for e in inputs)
        self.seeds = np.stack([np.arange(count) % e.realizations for e in inputs], axis=1).astype(float)
        self.doubts = (*self.runs.doubts, *_coarse(scene, inputs))

    def __repr__(self) -> str:
        return f"RandomSimulator({self.name!r}, {self.solver!r}, {len(self.seeds)} realizations)"

    def prepare(self) -> None:
        """Prepare the runs, if they are not prepared yet."""
        self.runs.prepare()

    @cached_property
    def standard_errors(self) -> Array | None:
        """Standard errors (n_y,) of the averages at the nominal parameters; None if they are not known.

        All samples have the same seeds. Therefore differences between samples have smaller errors.
        """
        if len(self.seeds) < 2:
            return None
        # Seeds with the same remainder have the same amplitudes and frequencies, so that their averages include the
        # error of few amplitudes. It cancels in averages over time, for which groups of any seeds are used.
        number = int(np.clip(len(self.seeds) // _GROUP, 2, mechanics.LEVELS))
        p, found = np.array([*self.parameters.values()]), list[Array]()
        for seeds in (self.seeds, np.random.default_rng(0).permutation(self.seeds)):
            values = np.array([self._averages(p, seeds[k::number])[0] for k in range(number)])
            found.append(values.std(axis=0, ddof=1) / number**0.5)
        of_peaks = [rule.over_runs or rule.kind not in _OVER_TIME for rule in self.runs.rules]
        errors = np.where(of_peaks, *found)
        return None if np.isnan(errors).any() else errors

    @property
    def remark(self) -> str:
        """A sentence about the standard errors; empty if they are not known."""
        if self.standard_errors is None:
            return ""
        pairs = zip(told_names(self.outputs, self.units), self.standard_errors, strict=True)
        return (
            f"Averages over {len(self.seeds)} realizations have the standard errors "
            f"{', '.join(f'{name} {error:.2g}' for name, error in pairs)} at the nominal parameters. The bounds do not "
            "contain these errors. More realizations decrease them."
        )

    def _averages(self, p: Array, seeds: Array) -> tuple[Array, str]:
        """Averages (n_y,) over the runs of seeds (n, n_i) at parameters (d,), and the fault of a failed run."""
        return self.runs.over_runs(np.hstack([np.tile(p, (len(seeds), 1)), seeds]), len(self.seeds))

    def run(self, P: Array) -> Ensemble:
        """Averages Y (N, 1, n_y) over the runs of all realizations, for samples P (N, d)."""
        P = checked_samples(self, P, None)
        Y, texts = np.full((len(P), 1, len(self.outputs)), np.nan), dict[int, str]()
        for i, p in enumerate(P):
            values, fault = self._averages(p, self.seeds)
            lacking = [name for name, value in zip(self.runs.figures, values, strict=True) if np.isnan(value)]
            if fault or lacking:
                where = values_text(self.parameters, p, units_of_parameters(self.parameters))
                text = f"the condition of output {lacking[0]!r} does not hold in each run. Use mb.probability"
                texts[i] = f"{where}: {fault or text}"
            else:
                Y[i, 0] = values
        ok = np.asarray(np.isfinite(Y[:, 0]).all(axis=1))
        return Ensemble(Y, ok, np.where(ok, np.nan, float(self.runs.curves.times[-1])), tuple(texts.values()))

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples P (N, d) one by one, and reduce each sample."""
        return stream(self, P, reduction, executor, progress, 1)

    def identity(self) -> str:
        """A digest of equations, start, outputs, times, solver and seeds, for `StoredSimulator`."""
        return connect.digest(self.runs.identity(), self.runs.curves.times, self.seeds)


def _coarse(scene: Scene, inputs: "Sequence[mechanics.RandomInput]") -> list[str]:
    """Warnings about output times that are further apart than the shortest wave of an input.

    Raises
    ------
    DeclarationError       if a random function of way stands still
    """
    doubts, nominal, box = list[str](), dict(scene.system.parameters), scene.box
    ends = [] if box is None else [dict(zip(box.names, end, strict=True)) for end in (box.lower, box.upper)]
    P = np.array([[*(nominal | end).values()] for end in ({}, *ends)])
    step, begin = float(np.diff(scene.times).max()), float(scene.times[0])
    for e, way in [(own, way) for own in inputs for way in own.ways]:
        rate = ca.Function("rate", [scene.system.p, t], [scene.expression(ddt(way))], {"allow_free": True})
        if rate.has_free():  # the way of a body is not known before the run
            continue
        speeds = np.abs([float(rate(p, begin)) for p in P])
        if not speeds.all():
            where = values_text(nominal, P[speeds.argmin()], units_of_parameters(scene.system.parameters))
            raise DeclarationError(f"{e.title}: the speed is 0 at {where}, so no wave passes. Give a positive speed.")
        shortest = 1 / (e.band[1] * speeds.max())
        if step > shortest:
            doubts.append(
                f"The output times are up to {step:.3g} s apart, but the shortest wave of {e.title} passes in "
                f"{shortest:.3g} s. Use closer times, or a lower frequency as the end of the band."
            )
    return [*dict.fromkeys(doubts)]
