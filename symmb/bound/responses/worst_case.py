"""The runs that attain bounds: their parameters, values and times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, SimulationError
from symmb._labelled import Labelled, Result, each_parameter, over_parameters, texts
from symmb._magnitudes import SMALL
from symmb._names import ByName, look_up_by_name
from symmb._options import shown
from symmb._table import aligned, at_time, is_timeless, over_times
from symmb._types import Array, Indices
from symmb._units import label, number_in, typeset, units_of_parameters, with_units
from symmb.connect import RUNS_TOGETHER, Attained, Simulator
from symmb.equations.model import Scene
from symmb.results.files import NOT_KEPT, Record
from symmb.run.simulation import SceneSimulator, Trajectory, simulate

SIDES: tuple[str, str] = ("lower", "upper")
Place = tuple[str, int, int]
"""A side, the number of a time, and the number of an output."""
_SEVERAL_TIMES = 2
"""Number of output times of bounds if it is not known."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A run of a study: the value of the output, and the parameters of the run and of the runs in the same block.

    A simulator chooses common steps for several samples. A repeated run is therefore equal to the last bit only if the
    whole block P (n, d) runs again. The run has the number `index` in the block.
    """

    value: float
    P: Array
    index: int


@dataclass(frozen=True, eq=False)
class AttainingRuns:
    """The runs of a study that attained the lowest and highest values of its outputs.

    Attributes
    ----------
    simulator : Simulator
    blocks : tuple of (n, d)       samples that ran together
    ends : dict                    "lower", "upper" -> lowest, highest values (n_t, n_y)
    at : dict                      "lower", "upper" -> (n_t, n_y) numbers of the blocks that attain them
    others : dict                  numbers of outputs with a study of their own -> the runs of this study
    reach : tuple                  samples (n, d) with their reach (n, 2, m); see `Ensemble`
    """

    simulator: Simulator
    blocks: tuple[Array, ...]
    ends: Mapping[str, Array]
    at: Mapping[str, Indices]
    others: "Mapping[int, AttainingRuns]" = field(default_factory=dict)
    reach: tuple[tuple[Array, Array], ...] = ()

    @classmethod
    def of(cls, simulator: Simulator, attained: Attained) -> "AttainingRuns | None":
        """The recorded runs of a study; None if no run is recorded at some times."""
        if not (attained.lower <= attained.upper).all():
            return None
        both = np.stack([attained.lower_at, attained.upper_at])
        is_used = np.bincount(both.ravel(), minlength=len(attained.blocks)) > 0  # faster than `unique`, which sorts
        used, numbers = np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[both]
        ends = dict(zip(SIDES, (attained.lower, attained.upper), strict=True))
        at = dict(zip(SIDES, numbers, strict=True))
        return cls(simulator, tuple(attained.blocks[k] for k in used), ends, at, reach=tuple(attained.reach))

    def samples(self, places: Sequence[Place]) -> list[Sample]:
        """The runs that attain bounds at places. Each block of several samples is run again once."""
        if any(output in self.others for _, _, output in places):
            own = replace(self, others={})
            return [self.others.get(place[2], own).samples([place])[0] for place in places]
        numbers = [int(self.at[side][time, output]) for side, time, output in places]
        samples: dict[int, Sample] = {}
        for number in dict.fromkeys(numbers):
            own = [n for n, place in enumerate(numbers) if place == number]
            P = self.blocks[number]
            Y = None if len(P) == 1 else self.simulator.run(P).Y
            for n in own:
                side, time, output = places[n]
                samples[n] = self._sample(
                    side, P, float(self.ends[side][time, output]), Y if Y is None else Y[:, time, output]
                )
        return [samples[n] for n in range(len(places))]

    def _sample(self, side: str, P: Array, value: float, values: Array | None) -> Sample:
        """The sample of P (n, d) with the most extreme of the values (n,). A single sample keeps its attained value."""
        if values is None:
            return Sample(value, P, 0)
        if np.isnan(values).all():
            raise SimulationError(f"{self.simulator!r}: the run that attained a bound fails when it is repeated.")
        index = int(np.nanargmin(values) if side == "lower" else np.nanargmax(values))
        begin = index // RUNS_TOGETHER * RUNS_TOGETHER
        return Sample(float(values[index]), P[begin : begin + RUNS_TOGETHER], index - begin)


@dataclass(frozen=True, eq=False)
class WorstCase:
    """A bound of an output, and the run that comes closest to it.

    Attributes
    ----------
    output, side : str         side is "lower" or "upper"
    value, time : float        the bound, and the time of the bound [s]
    parameters : dict          values of all parameters of the run
    attained : float           value of the output in the run at this time
    width : float              of the bounds at this time
    varied : tuple of str      parameters of the box that act on the output; these are printed
    times : int                number of output times, 1 for a scalar output; a single time of 0 is not printed
    unit : str                 unit of the output in tables and texts, or ''
    choices : tuple of str     chosen words, as "spring: hard"
    estimate : float           estimated error of the bound, in its unit; nan if the method has none
    simulator : Simulator      None if the bounds were read from a file
    """

    output: str
    side: str
    value: float
    time: float
    parameters: dict[str, float]
    attained: float
    width: float
    varied: tuple[str, ...]
    times: int = _SEVERAL_TIMES
    unit: str = ""
    choices: tuple[str, ...] = ()
    estimate: float = np.nan
    simulator: Simulator | None = field(default=None, metadata=NOT_KEPT)

    __post_init__ = look_up_by_name

    @property
    def _times(self) -> list[float]:
        return [self.time] * self.times

    @property
    def _word(self) -> str:
        return "lowest" if self.side == "lower" else "highest"

    @property
    def shortfall(self) -> float:
        """Distance of the run from the bound, inside the bound."""
        return self.attained - self.value if self.side == "lower" else self.value - self.attained

    @property
    def is_short(self) -> bool:
        """Whether the distance of the run from the bound is visible in pictures."""
        # Distance of a run from a bound, relative to the width, that is not mentioned. Pictures do not show it.
        return self.shortfall > SMALL * self.width

    @property
    def scene(self) -> Scene:
        """The scene with the parameters of this run as nominal values.

        Raises
        ------
        DeclarationError    if the bounds are not of a scene, or were read from a file
        """
        scene = getattr(self.simulator, "scene", None)
        if not isinstance(scene, Scene):
            raise DeclarationError(
                "This worst case has no scene, because the bounds are from a file, or from another simulator."
            )
        return scene.with_nominal(self.parameters)

    def run(self) -> Trajectory | Array:
        """The trajectory of a scene, or the outputs (n_t, n_y) of another simulator.

        Raises
        ------
        DeclarationError    if the bounds were read from a file
        """
        if self.simulator is None:
            raise DeclarationError("This worst case comes from a file. Use bounds that propagate has returned.")
        if isinstance(self.simulator, SceneSimulator):
            return simulate(self.scene, self.simulator.solver)
        return np.array(self.simulator.run(np.array([[*self.parameters.values()]])).Y[0])

    def __str__(self) -> str:
        values = ", ".join(with_units({name: f"{self.parameters[name]:.6g}" for name in self.varied}, self.parameters))
        unit = f" {typeset(self.unit)}" if self.unit else ""
        text = f"{self._word} {self.output} {self.value + 0.0:.6g}{unit}{at_time(self._times, 0)}"
        if self.value == np.inf:
            text = f"{self.output} never happens"
        text += f": {', '.join(filter(None, [values, *self.choices]))}" if values or self.choices else ""
        short = f"; the closest run, with these parameters, attains {self.attained:.6g}{unit}"
        return text + (short if self.is_short and np.isfinite(self.value) else "")

    def __repr__(self) -> str:
        return f"WorstCase({self})"

    def _repr_html_(self) -> str:
        units = units_of_parameters(self.parameters)
        rows = [[label(name, units.get(name, "")), f"{self.parameters[name]:.6g}"] for name in self.varied]
        return html.page(html.text(str(self)), html.table([["parameter", "value"], *rows]))

    @classmethod
    def of_record(cls, record: Record) -> "WorstCase":
        value, time, attained, width = (record.number(name) for name in ("value", "time", "attained", "width"))
        side, parameters = record.text("side", *SIDES), record.numbers("parameters")
        if np.isnan(value):  # files have no infinite numbers
            value, width = np.inf if side == "upper" else -np.inf, np.inf
        varied = record.texts("varied", default=tuple(parameters))
        times = record.whole("times", default=_SEVERAL_TIMES)
        unit = record.text("unit") if "unit" in record else ""
        chosen = record.texts("choices", default=())
        estimate = record.number("estimate") if "estimate" in record else np.nan
        about = parameters, attained, width, varied, times, unit, chosen, estimate
        return cls(record.text("output"), side, value, time, *about)


@dataclass(frozen=True, eq=False, repr=False)
class Worst(Result):
    """The worst cases of an output, with `lower` and `upper`."""

    lower: WorstCase
    upper: WorstCase

    def __str__(self) -> str:
        return "\n".join(aligned(self._rows()))

    def _repr_html_(self) -> str:
        return html.page(html.table(self._rows()))

    def _rows(self) -> list[list[str]]:
        return worst_rows((self.lower, self.upper))

    def _labelled(self) -> Labelled:
        cases = self.lower, self.upper
        variables: dict[str, Any] = {
            name: (("bound",), np.array([getattr(case, name) for case in cases]))
            for name in ("value", "time", "attained")
        }
        names, units = [*self.lower.parameters], units_of_parameters(self.lower.parameters)
        values = np.array([[case.parameters[name] for name in names] for case in cases])
        variables["parameters"] = (("bound", "parameter"), values)
        coordinates: dict[str, Any] = {"bound": (("bound",), texts(SIDES)), **over_parameters(names, units)}
        by_name = ByName(zip(names, values.T, strict=True), units)
        own, unit_of = each_parameter(by_name, ("bound",), [*coordinates, *variables])
        unit_of |= {"time": "s", "value": self.lower.unit, "attained": self.lower.unit}
        return Labelled(coordinates | own, variables, {"output": self.lower.output}, unit_of)


def worst_rows(cases: Sequence[WorstCase]) -> list[list[str]]:
    """Rows of a table of worst cases, without a head, with the parameters that act on the outputs."""
    varied = list(dict.fromkeys(name for case in cases for name in case.varied))
    units = {name: unit for case in cases for name, unit in units_of_parameters(case.parameters).items()}
    words = ["choices"] if any(case.choices for case in cases) else []
    errors = ["±"] if any(np.isfinite(case.estimate) for case in cases) else []
    names = (label(name, units.get(name, "")) for name in varied)
    rows = [["worst case", "bound", *errors, "at [s]", *names, *words, "attained"]]
    for case in cases:
        values = (f"{case.parameters[name] + 0.0:.6g}" if name in case.varied else "" for name in varied)
        when = "" if is_timeless(case._times) else f"{case.time:.6g}"
        chosen = [", ".join(case.choices)] if words else []
        error = [f"{case.estimate:.1g}" if np.isfinite(case.estimate) else "–"] if errors else []
        numbers = f"{case.value + 0.0:.6g}", *error, when, *values, *chosen, f"{case.attained + 0.0:.6g}"
        rows.append([label(f"{case._word} {case.output}", case.unit), *numbers])
    return over_times(rows)


def row_of(owner: str, t: Array, time: object) -> int:
    """Index of the output time that is closest to a time: a number [s], or a text with a unit."""
    own, slack = number_in(f"{owner}: time", "a time", time, "s"), 1e-6 * (t[-1] - t[0])
    if not t[0] - slack <= own <= t[-1] + slack:
        raise DeclarationError(f"{owner}: time must be from {t[0]:g} to {t[-1]:g} s, got {shown(time)}.")
    return int(np.abs(t - own).argmin())
