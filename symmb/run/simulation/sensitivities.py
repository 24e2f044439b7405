"""Derivatives of outputs over time with respect to parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._labelled import Labelled, Result, over_outputs, over_parameters, unit_text
from symmb._names import counted, normal
from symmb._options import require_name, shown
from symmb._table import over_times
from symmb._types import Array, Expr
from symmb._units import label, units_of_parameters
from symmb.connect import Simulator
from symmb.equations.model import Scene
from symmb.results import plot
from symmb.results.files import NAMES, TIMES, Record, Saved, entry
from symmb.run.integrate import Solver
from symmb.run.simulation.derivatives import Differentiable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(plot.OverTime, Result, Saved):
    """Derivatives dy/dp of outputs y over time, at nominal values of parameters p.

    `slopes["x", "k"]` returns one derivative (n_t,). `print` shows the largest derivatives. `plot` draws the changes of
    outputs if a parameter changes by 1 %. `save` writes a file, and `load` reads it.

    Attributes
    ----------
    name : str
        name of the scene
    t : (n_t,)
        times [s]
    names, units : names of the n_y outputs and their units, '' if the unit is not known
    parameters : dict
        n_p nominal values by name
    run : (n_t, n_y)
        outputs of the nominal run
    values : (n_t, n_y, n_p)
        derivatives dy/dp, in units of the output divided by units of the parameter

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> slopes = mb.sensitivities(scene)
    >>> slopes["x", "k"].round(4)
    array([ 0.    , -0.2273,  0.3784])
    """

    name: str
    t: Array = field(metadata=TIMES)
    names: tuple[str, ...] = field(metadata=NAMES)
    units: tuple[str, ...]
    parameters: dict[str, float]
    run: Array = field(metadata=entry(Record.array, "t", "names"))
    values: Array = field(metadata=entry(Record.array, "t", "names", "parameters"))

    _left = (0, 1)

    def __getitem__(self, key: tuple[str, str]) -> Array:
        """The derivative dy/dp (n_t,) of an output with respect to a parameter, by their names."""
        if not isinstance(key, tuple) or len(key) != 2:
            raise DeclarationError(
                f'Sensitivities: expected an output and a parameter, as ["x", "k"], got {shown(key)}.'
            )
        name, parameter = map(normal, key)
        for what, one, known in (("output", name, self.names), ("parameter", parameter, self.parameters)):
            require_name("Sensitivities", what, one, known)
        return self.values[:, self.names.index(name), [*self.parameters].index(parameter)]

    @property
    def _labels(self) -> list[str]:
        """Names of the parameters with their units."""
        units = units_of_parameters(self.parameters)
        return [label(name, units.get(name, "")) for name in self.parameters]

    def _head(self) -> str:
        return f"{self.name}: dy/dp of {counted(len(self.names), 'output')} at the nominal parameters"

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        """Rows of text: the largest dy/dp for each output and parameter, and the change if p changes by 1 %."""
        rows = [["output", "parameter", "nominal", "largest dy/dp", "at [s]", "change for 1 %"]]
        for k, name in enumerate(names):
            places = np.abs(self.values[:, k]).argmax(axis=0)
            for j, (parameter, nominal) in enumerate(zip(self._labels, self.parameters.values(), strict=True)):
                slope = self.values[places[j], k, j]
                numbers = [f"{nominal:g}", f"{slope:.4g}", f"{self.t[places[j]]:.4g}", f"{0.01 * nominal * slope:.2g}"]
                rows.append([name, parameter, *numbers])
        return over_times(rows, self.t)

    def _figure(self, columns: list[int] | None, style: plot.Style) -> "Figure":
        changes = 0.01 * self.values * np.array(list(self.parameters.values()))
        return plot.plot_family(
            self.t,
            np.moveaxis(changes, -1, 0),
            self.names,
            self._labels,
            units=self.units,
            chosen=columns,
            title=f"{self.name}: change for 1 % of each parameter",
            style=style,
        )

    def _labelled(self) -> Labelled:
        coordinates, units = over_outputs(self.t, self.names, self.units, "value")
        coordinates |= over_parameters(self.parameters, units_of_parameters(self.parameters))
        nominal = np.array(list(self.parameters.values()))
        variables = {
            "value": (("time", "output"), self.run),
            "sensitivity": (("time", "output", "parameter"), self.values),
            "nominal": (("parameter",), nominal),
        }
        about = {"scene": self.name, "units": unit_text(self.names, self.units)}
        return Labelled(coordinates, variables, about, units)


@kept_interrupts()
def sensitivities(
    scene: Scene | Simulator,
    parameters: Sequence[str] | None = None,
    solver: Solver | str | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> Sensitivities:
    """Derivatives of all outputs over time with respect to parameters, along the nominal run.

    The derivatives of the equations of motion are integrated together with the equations, as in `Taylor`. If the run
    meets a switch or an event, or the simulator is a black box, the derivatives are differences of runs with eight
    steps. If an event happens at an output time, a warning names the time.

    Parameters
    ----------
    scene : Scene
        scene or simulator
    parameters : list of str
        names of the parameters p of dy/dp; default: all
    solver, times, outputs
        solver, times and outputs of the run, if they differ from those of the scene

    Raises
    ------
    DeclarationError
        If a parameter is unknown or listed twice, or there are no parameters
    AssemblyError
        If the scene cannot be started
    SimulationError
        If a run fails

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=1.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
    >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 2.0], outputs=outputs)
    >>> mb.sensitivities(scene)["x", "speed"].round(9).tolist()
    [0.0, 2.0]
    """
    runs = Differentiable("sensitivities", scene, parameters, solver, times, outputs)
    simulator = runs.simulator
    return Sensitivities(
        str(getattr(getattr(simulator, "scene", None), "name", repr(simulator))),
        np.asarray(simulator.times),
        tuple(simulator.outputs),
        tuple(getattr(simulator, "units", ("",) * len(simulator.outputs))),
        runs.parameters,
        *runs.at_nominal(),
    )
