"""The values of a parameter at which a scene becomes stable or unstable."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._interrupts import kept_interrupts
from symmb._names import ByName
from symmb._options import is_finite_number, require_name, shown
from symmb._types import Array
from symmb._units import units_of_parameters
from symmb.connect import BlackBox
from symmb.equations.model import Box, Scene
from symmb.run.linear.eigenvalues import Eigenvalues
from symmb.run.linear.family import LinearFamily
from symmb.run.simulation import scene_of

_ROUNDING = 1e-12
"""Error of a critical value, divided by the range, at which the search ends."""


@kept_interrupts()
def critical(scene: Scene, parameter: str, range: tuple[float, float]) -> "CriticalSimulator":
    """A simulator of critical values of a parameter. At a critical value, the smallest damping of the scene is zero.

    The parameters of the simulator are the other parameters of the scene. Therefore critical values have bounds like
    any output.

    Parameters
    ----------
    scene : Scene
        a scene that starts in equilibrium, or in a steady motion, for every value in the range
    parameter : str
        name of the parameter, such as a speed
    range : (lower, upper)
        range of the search, in the unit of the parameter

    Raises
    ------
    DeclarationError
        If the parameter is unknown, the range is empty, or stability does not change in the range

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> p = mb.Parameters(k=9.0, load=1.0)
    >>> rod = mb.Body("rod", mass=1.0, inertia=1.0)
    >>> pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, 0))
    >>> spring = mb.Torque("spring", rod, -p.k * rod.theta + p.load * rod.theta - rod.omega)
    >>> buckling = mb.critical(mb.Scene(mb.System(rod, pin, spring, parameters=p)), "load", (0.0, 20.0))
    >>> buckling.run(np.array([[9.0], [4.0]])).Y.ravel().round(9)
    array([9., 4.])
    """
    return CriticalSimulator(scene, parameter, range)


class CriticalSimulator(BlackBox):
    """The result of `critical`. If there are several critical values of a parameter v, their names are v1, v2, ..."""

    def __init__(self, scene: Scene, parameter: str, range: tuple[float, float]) -> None:
        scene = scene_of(scene)
        lower, upper = require_range("critical", scene, parameter, range)
        self.family, self.range = LinearFamily(scene), (lower, upper)
        self.doubts, self.scene = self.family.doubts, self.family.scene
        names = list(scene.system.parameters)
        # Number of parameter values at which stability is tested. A range between two of them can be missed.
        self.number, self._grid = names.index(parameter), np.linspace(lower, upper, 65)
        self.name, self._parameter = scene.name, parameter
        self.box = scene.box and scene.box.without(parameter)
        own, units = scene.system.parameters, units_of_parameters(scene.system.parameters)
        nominal = ByName({name: value for name, value in own.items() if name != parameter}, units)
        found = self._values(nominal)
        if not found:
            state = "unstable" if _growth(self._eigen(self._rows(nominal)[:1])[0]) > 0 else "not unstable"
            raise DeclarationError(
                f"critical: {scene.name} is {state} at all tested values of {parameter} from {lower:g} to {upper:g}. "
                "Pass another range."
            )
        if parameter in units:
            self.units = (units[parameter],) * len(found)
        outputs = [parameter] if len(found) == 1 else [f"{parameter}{k + 1}" for k, _ in enumerate(found)]
        noise = dict.fromkeys(outputs, _ROUNDING * (upper - lower))
        self._declare(nominal, [0.0], outputs, noise)

    def response(self, values: Mapping[str, float]) -> Any:
        """The critical values (1, n_y) for values of the other parameters."""
        found = self._values(values)
        if len(found) != len(self.outputs):
            raise SimulationError(
                f"stability changes at {len(found)} values of {self._parameter} in the range, but at "
                f"{len(self.outputs)} values for the nominal parameters"
            )
        return np.array(found)[None]

    def _values(self, others: Mapping[str, float]) -> list[float]:
        P = self._rows(others)
        grows = [_growth(found) > 0 for found in self._eigen(P)]
        return [self._root(P[k], P[k + 1]) for k in np.flatnonzero(np.diff(grows))]

    def _rows(self, others: Mapping[str, float]) -> Array:
        """All parameters (n, n_p) at the n values of the grid."""
        fixed = np.insert(np.array(list(others.values())), self.number, 0.0)
        P = np.tile(fixed, (len(self._grid), 1))
        P[:, self.number] = self._grid
        return P

    def _root(self, below: Array, above: Array) -> float:
        from scipy.optimize import brentq

        ends = np.stack([below, above])
        marginal = max(map(_marginal, self._eigen(ends)))

        def growth(value: float) -> float:
            p = below.copy()
            p[self.number] = value
            (found,) = self._eigen(p[None])
            return 0.0 if _marginal(found) > marginal else _growth(found)  # here the damping is zero up to rounding

        width = _ROUNDING * np.ptp(self._grid)
        return cast(float, brentq(growth, *ends[:, self.number], xtol=width))

    def _eigen(self, P: Array) -> list[Eigenvalues]:
        """Eigenvalues for each row of parameters P (N, n_p)."""
        return [eigen for eigen, _ in self.family.eigen_of(P)]

    def __repr__(self) -> str:
        return f"critical({self.name!r}, {self._parameter!r}, ({self._grid[0]:g}, {self._grid[-1]:g}))"


def require_range(owner: str, scene: Scene, parameter: str, range: tuple[float, float]) -> tuple[float, float]:
    """The ends of the range of a parameter. DeclarationError is raised if the name or the range is not valid."""
    require_name(owner, "parameter", parameter, list(scene.system.parameters))
    if isinstance(range, str) or (
        isinstance(range, tuple | list) and any(isinstance(end, str | tuple) for end in range)
    ):
        units = units_of_parameters(scene.system.parameters)
        range = Box(**{parameter: range}).with_units(units)[parameter]
    if not (isinstance(range, tuple | list) and len(range) == 2 and all(map(is_finite_number, range))):
        raise DeclarationError(f"{owner}: range must be two numbers, lower and upper, got {shown(range)}.")
    lower, upper = map(float, range)
    if not lower < upper:
        raise DeclarationError(f"{owner}: the lower end of the range must be below the upper end, got {shown(range)}.")
    if not np.isfinite(upper - lower):
        raise DeclarationError(
            f"{owner}: the range from {lower:g} to {upper:g} is wider than the largest number. Pass a narrower range."
        )
    return lower, upper


def _growth(found: Eigenvalues) -> float:
    """The largest real part of the eigenvalues [1/s]. Real parts that are 0 up to rounding are ignored."""
    real = found.values.real
    growing, decaying = real[real > found.errors], real[real < -found.errors]
    return float(growing.max(initial=0.0) or decaying.max(initial=-np.inf))


def _marginal(found: Eigenvalues) -> int:
    """Number of eigenvalues with a real part that is 0 up to rounding."""
    return int(np.count_nonzero(np.abs(found.values.real) <= found.errors))
