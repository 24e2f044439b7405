"""Runs of a scene or a simulator with several values of its parameters."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb._errors import DeclarationError, WithWarnings, warn_of
from symmb._interrupts import kept_interrupts
from symmb._labelled import ByOutput, Labelled, Named, Result, each_parameter, over_outputs, parameter_names, unit_text
from symmb._limits import require_memory, require_runs
from symmb._names import ByName, counted, normal_keys
from symmb._options import require_name, shown
from symmb._progress import shown_runs
from symmb._table import over_times, span_text
from symmb._types import Array, Executor, Expr, Indices, Mask
from symmb._units import label, number_in, numbers_in, units_of_parameters
from symmb.connect import Progress, Reduction, Samples, Simulator
from symmb.equations.model import Scene
from symmb.results import plot
from symmb.results.files import NAMES, NOT_KEPT, TIMES, Record, Saved, entry
from symmb.run.integrate import Solver
from symmb.run.simulation.figure_simulator import SceneSimulator
from symmb.run.simulation.pilots import at_tolerances
from symmb.run.simulation.subject import Device, Subject

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

_NAMED = 3
"""Maximum number of failed runs with printed reasons."""
_MOST_IN_LABELS = 3
"""Largest number of parameters in the label of a curve. With more parameters, the label is the number of the run."""
Part = tuple[Indices, Array, Mask, tuple[str, ...]]
"""Numbers of samples (n,), their outputs (n, n_t, n_y), mask of valid samples (n,), and messages of invalid samples."""


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(plot.OverTime, Result, ByOutput, WithWarnings, Saved):
    """Runs with several values of parameters.

    `runs["x"]` gives an output of all runs. `print` shows extremes. `plot` draws all runs over time,
    and scalar outputs over the parameter that has the most values. `save` writes a file, and `load` reads it.

    Attributes
    ----------
    name : str
        name of the scene or simulator
    t : (n_t,)
        times [s]
    names, units : names of the n_y outputs and their units, '' if the unit is not known
    parameters : dict
        name -> values (N,), for all parameters
    grid : dict
        name -> values (m,). All combinations are run, and the last parameter changes fastest. The grid is empty if the
        runs are a list
    values : (N, n_t, n_y)
        outputs; nan after a failure
    ok : (N,)
        whether a run is valid
    messages : tuple of str
        reasons of the failed runs, in order
    figures : tuple of str
        names of the scalar outputs; each run has one number for each of them
    simulator : SceneSimulator
        the simulator of the runs, so that `view` can draw them; None for functions and programs, and after `load`

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> runs = mb.sweep(scene, {"k": [3.0, 4.0, 5.0]})
    >>> runs["x"].shape, runs["x"][:, -1].round(4)
    ((3, 3), array([-0.9484, -0.6536, -0.2379]))
    """

    name: str
    t: Array = field(metadata=TIMES)
    names: tuple[str, ...] = field(metadata=NAMES)
    units: tuple[str, ...]
    parameters: dict[str, Array] = field(metadata=entry(Record.arrays, "ok"))
    grid: dict[str, Array] = field(metadata=entry(Record.arrays, None))
    values: Array = field(metadata=entry(Record.with_nan, "ok", "t", "names"))
    ok: Mask = field(metadata=entry(Record.mask))
    messages: tuple[str, ...]
    figures: tuple[str, ...] = ()
    simulator: SceneSimulator | None = field(default=None, metadata=NOT_KEPT)

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, name: str) -> Array:
        """An output of all runs: (N, n_t), or (m_1, ..., m_d, n_t) over a grid. A scalar output has no time axis."""
        name = require_name("Sweep", "output", name, self.names)
        values = self.values[:, :, self.names.index(name)].reshape(*self._shape, len(self.t))
        return values[..., 0] if name in self.figures else values

    def __iter__(self) -> Iterator[str]:
        raise DeclarationError(
            'Sweep: a sweep cannot be iterated. runs["x"] is an output of all runs, and runs.values[k] are all outputs '
            "of run k."
        )

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(map(len, self.grid.values())) or (len(self),)

    @property
    def doubts(self) -> tuple[str, ...]:
        """A sentence about the runs that failed; empty if none failed."""
        if self.ok.all():
            return ()
        more = f" and {len(self.messages) - _NAMED} more" if len(self.messages) > _NAMED else ""
        return (
            f"{len(self.messages)} of {counted(len(self), 'run')} failed: {'; '.join(self.messages[:_NAMED])}{more}.",
        )

    def _head(self) -> str:
        times = span_text(self.t)
        units = units_of_parameters(self.parameters)
        varied = ", ".join(
            f"{name} from {values.min():g} to {values.max():g} {units.get(name, '')}".rstrip()
            for name, values in self._varied().items()
        )
        lines = [
            f"{self.name}: {counted(len(self), 'run')}, {times}",
            f"  parameters  {varied or 'the same in all runs'}",
        ]
        return "\n".join([*lines, *(f"  warning     {doubt}" for doubt in self.doubts)])

    def _varied(self) -> dict[str, Array]:
        return {name: values for name, values in self.parameters.items() if np.ptp(values) > 0 or name in self.grid}

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        """Rows of text with the extremes of each output, their times and their runs, counted from 0."""
        rows = [["output", "lowest", "at [s]", "run", "highest", "at [s]", "run"]]
        for k, name in enumerate(names):
            values = self.values[self.ok, :, k]
            cells = [name]
            for place in (values.argmin(), values.argmax()) if values.size else ():
                run, i = np.unravel_index(place, values.shape)
                time = "" if self.names[k] in self.figures else f"{self.t[i]:.6g}"
                cells += [f"{values[run, i]:.6g}", time, f"{np.flatnonzero(self.ok)[run]}"]
            rows.append(cells + ["–"] * (len(rows[0]) - len(cells)))
        return over_times(rows, self.t)

    def _figure(self, columns: list[int] | None, style: plot.Style) -> "Figure":
        varied = self._varied()
        if 0 < len(varied) <= _MOST_IN_LABELS:
            order = np.lexsort([*varied.values()][::-1])
            names = [self._words(varied, k) for k in order]
        else:
            order, names = np.arange(len(self)), [f"run {k}" for k in range(len(self))]
        return plot.plot_family(
            self.t,
            self.values[order],
            self.names,
            names,
            timeless=self.figures if len(self.t) > 1 else self.names,
            over=self._lines(order),
            units=self.units,
            chosen=columns,
            title=self.name,
            style=style,
        )

    def _words(self, parameters: Iterable[str], run: int) -> str:
        """Values of parameters in a run, in words."""
        units = units_of_parameters(self.parameters)
        return ", ".join(f"{n} = {self.parameters[n][run]:g} {units.get(n, '')}".rstrip() for n in parameters)

    def _lines(self, order: Indices) -> plot.RunLines:
        """The runs in this order, as lines over the parameter with the most values. Other parameters define the lines.

        If a list of runs varies several parameters, the runs are points over the numbers of the runs.
        """
        varied = self._varied()
        if not varied or (len(varied) > 1 and not self.grid):
            return plot.RunLines("run", order.astype(float), [("", np.arange(len(order)))], joined=False)
        own = max(varied, key=lambda name: len(np.unique(varied[name])))
        lines: dict[str, list[int]] = {}
        for place, run in enumerate(order.tolist()):
            lines.setdefault(self._words([n for n in varied if n != own], run), []).append(place)
        text = label(own, units_of_parameters(self.parameters).get(own, ""))
        return plot.RunLines(text, varied[own][order], [(name, np.array(runs)) for name, runs in lines.items()])

    def _record(self) -> dict[str, Any]:
        return super()._record() | {"doubts": self.doubts}

    def _labelled(self) -> Labelled:
        coordinates, units = over_outputs(self.t, self.names, self.units, "value")
        variables: dict[str, Named] = {
            "value": (("sample", "time", "output"), self.values),
            "ok": (("sample",), self.ok),
        }
        own, units_of_own = each_parameter(self.parameters, ("sample",), [*coordinates, *variables, "sample"])
        coordinates |= {**own, "sample": (("sample",), np.arange(len(self)))}
        about = {"scene": self.name, "units": unit_text(self.names, self.units), "doubts": "\n".join(self.doubts)}
        return Labelled(coordinates, variables, {k: v or None for k, v in about.items()}, units | units_of_own)

    def to_xarray(self) -> "Dataset":
        """The runs as an xarray.Dataset over time, output and either the parameters of the grid or the samples.

        Raises
        ------
        ImportError
            If xarray is not installed
        """
        whole = self._labelled()
        if not self.grid:
            return whole.to_xarray()
        own = tuple(parameter_names([*self.grid], ["time", "output", "unit", "value", "ok"]))
        same = {name: pair for name, pair in whole.coordinates.items() if "sample" not in pair[0]}
        along: dict[str, Named] = {n: ((n,), v) for n, v in zip(own, self.grid.values(), strict=True)}
        over = self.values.reshape(*self._shape, len(self.t), len(self.names))
        values = {"value": ((*own, "time", "output"), over), "ok": (own, self.ok.reshape(self._shape))}
        return Labelled(same | along, values, whole.attributes, whole.units).to_xarray()


@kept_interrupts()
def sweep(
    scene: Scene | Simulator,
    values: Mapping[str, Sequence[float] | Array],
    solver: Solver | str | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    device: Device = None,
) -> Sweep:
    """Run all combinations of values of some parameters. The other parameters have their nominal values.

    Parameters
    ----------
    scene : Scene or simulator
    values : mapping
        name -> (m,) values, in the unit of the parameter or with a compatible unit, such as ([0.24, 0.25], "m")
    solver, times, outputs
        solver, times and outputs of the runs, if they differ from those of the scene
    executor : an executor, or an object with an ordered `map`; default: runs in this process
    progress : function of the numbers of finished runs and of all runs; default: a bar, in notebooks and terminals
    device : "cuda" for runs on a graphics card of NVIDIA; default: the processor

    Raises
    ------
    DeclarationError
        If a parameter is unknown, or a value is not a number
    AssemblyError
        If the scene cannot be started

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=1.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
    >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 2.0], outputs=outputs)
    >>> mb.sweep(scene, {"speed": [1.0, 2.0, 3.0]})["x"][:, -1].round(9).tolist()
    [2.0, 4.0, 6.0]
    """
    if not isinstance(values, Mapping) or not values:
        raise DeclarationError(f'sweep: expected values by name, such as {{"l1": [1.0, 1.1]}}, got {shown(values)}.')
    simulator = Subject.of(scene, solver, times, outputs, device, "sweep").simulator
    nominal, grid = simulator.parameters, {}
    units = units_of_parameters(nominal)
    for name, some in normal_keys("sweep", values).items():
        require_name("sweep", "parameter", name, nominal)
        column = numbers_in("sweep", f"parameter {name!r}", some, units.get(name, ""))
        if column is None or column.ndim != 1 or not len(column) or not np.isfinite(column).all():
            raise DeclarationError(
                f"sweep: the values of {name!r} must be a list of finite numbers, got {shown(some)}."
            )
        grid[name] = column
    count = math.prod(map(len, grid.values()))
    require_runs("sweep", count, "Pass fewer values.")
    _require_room("sweep", simulator, count)
    P = np.tile([float(value) for value in nominal.values()], (count, 1))
    each = count
    for name, column in grid.items():
        each //= len(column)
        P[:, [*nominal].index(name)] = np.resize(np.repeat(column, each), count)
    return _of_rows(simulator, P, grid, "sweep", executor, progress)


def side_by_side(
    subject: Subject, parameters: Sequence[Mapping[str, float]], check: bool, tolerances: Mapping[str, Any]
) -> Sweep:
    """Runs of a list of parameters; see `simulate`."""
    if check:
        raise DeclarationError(
            "simulate: check=True applies to a single run, not to a list of parameters. Pass one mapping of parameters."
        )
    if tolerances:
        subject = replace(subject, solver=at_tolerances(subject.motion.solver, tolerances))
    return swept(subject.simulator, parameters, "simulate")


def swept(simulator: Simulator, runs: Sequence[Mapping[str, float]], owner: str) -> Sweep:
    """Runs of a simulator. Each mapping replaces some nominal parameters for one run."""
    nominal = simulator.parameters
    if not runs:
        raise DeclarationError(f"{owner}: the list of parameters is empty. Pass one mapping for each run.")
    rows, units = [], units_of_parameters(nominal)
    for run in (normal_keys(owner, run) for run in runs):
        if not isinstance(run, Mapping):
            raise DeclarationError(f'{owner}: each run must be a mapping, such as {{"l1": 1.02}}, got {shown(run)}.')
        for name in run:
            require_name(owner, "parameter", name, nominal)
        own = {n: number_in(f"{owner}: {n!r}", f"parameter {n!r}", v, units.get(n, "")) for n, v in run.items()}
        rows.append([float(own.get(name, value)) for name, value in nominal.items()])
    _require_room(owner, simulator, len(runs))
    return _of_rows(simulator, np.reshape(rows, (len(runs), len(nominal))), {}, owner)


def _require_room(owner: str, simulator: Simulator, runs: int) -> None:
    numbers = len(simulator.parameters) + len(simulator.times) * len(simulator.outputs)
    require_memory(owner, f"{counted(runs, 'run')}, with their outputs,", runs * numbers)


def _of_rows(
    simulator: Simulator,
    P: Array,
    grid: Mapping[str, Array],
    owner: str,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Runs of a simulator with parameters P (N, n_p)."""
    with shown_runs(progress, owner) as progress:
        parts = simulator.stream(P, Reduction(list, _with_block, _joined), executor, progress)
    Y, ok = np.full((len(P), len(simulator.times), len(simulator.outputs)), np.nan), np.zeros(len(P), dtype=bool)
    for indices, values, valid, _ in parts:
        Y[indices], ok[indices] = values, valid
    result = Sweep(
        str(getattr(getattr(simulator, "scene", None), "name", repr(simulator))),
        np.asarray(simulator.times),
        tuple(simulator.outputs),
        tuple(getattr(simulator, "units", ("",) * len(simulator.outputs))),
        ByName(zip(simulator.parameters, P.T, strict=True), units_of_parameters(simulator.parameters)),
        dict(grid),
        Y,
        ok,
        tuple(text for *_, texts in parts for text in texts),
        tuple(getattr(simulator, "figures", ())),
        simulator if isinstance(simulator, SceneSimulator) else None,
    )
    warn_of(result.doubts, owner)
    return result


def _with_block(parts: list[Part], block: Samples, indices: Indices) -> list[Part]:
    return [*parts, (indices, np.array(block.Y), np.array(block.ok), block.messages)]


def _joined(first: list[Part], second: list[Part]) -> list[Part]:
    return first + second
