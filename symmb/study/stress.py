"""Harder variants of a scene: stiffer springs, lighter bodies, another time scale, longer horizons."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import casadi as ca
import numpy as np

from symmb.declare.mechanics import Gravity, Point
from symmb.declare.symbolic import from_sympy, is_sympy, t
from symmb.equations.model import Scene, System

_LARGER, _SCALES, _LONGER = (1e2, 1e4), (0.1, 10.0), (10, 100)
"""Factors for stiffness and mass ratios, for time scales, and for horizons. All values occur in real machines."""


def stresses(scene: Scene) -> list[tuple[str, Callable[[], Scene]]]:
    """Name of each variant that differs from the scene, and a function that makes it."""
    variants: list[tuple[str, Callable[[], Scene]]] = []
    if any(_stiffnesses(element) for element in scene.system.elements):
        variants += [(f"stiffness x {factor:g}", lambda k=factor: stiffer(scene, k)) for factor in _LARGER]
    if len(scene.system.bodies) > 1:
        variants += [(f"mass ratio x {factor:g}", lambda k=factor: lighter(scene, k)) for factor in _LARGER]
    if _velocities(scene) or any(_slowed(element, scene, 2.0) for element in _elements(scene.system)):
        variants += [(f"time scale x {scale:g}", lambda c=scale: slower(scene, c)) for scale in _SCALES]
    begin = scene.times[0]
    for factor in _LONGER:
        longer = begin + factor * (scene.times - begin)
        variants.append((f"horizon x {factor}", lambda longer=longer: scene.with_times(longer)))
    return variants


def stiffer(scene: Scene, factor: float) -> Scene:
    """The scene with springs stiffer by a factor."""
    changed = [
        _changed(e, {name: _divided(getattr(e, name), 1 / factor) for name in _stiffnesses(e)})
        for e in _elements(scene.system)
    ]
    return _with(scene, changed)


def lighter(scene: Scene, factor: float) -> Scene:
    """The scene with its lightest body lighter by a factor. Bodies without mass are not considered."""
    system = scene.system
    elements = copy.deepcopy(_elements(system))
    values = ca.Function("masses", [system.p], [ca.vertcat(*[ca.SX(body.mass) for body in system.bodies])])
    masses = values(system.parameters.nominal).full().ravel()
    lightest = elements[int(np.argmin(np.where(masses > 0, masses, np.inf)))]
    for name in ("mass", "inertia"):
        object.__setattr__(lightest, name, _divided(getattr(lightest, name), factor))
    return _with(scene, elements)


def slower(scene: Scene, scale: float) -> Scene:
    """The scene on a slower time scale, over a horizon that is longer by the same factor.

    Functions of time become slower, and start velocities become smaller. Gravity is divided by the square of the
    factor. A mechanism without springs, dampers and constant forces then moves along the same path at another speed.
    Springs, dampers and forces do not change, so the scene becomes stiffer or softer relative to the motion.
    """
    begin = float(scene.times[0])
    elements = [_changed(e, _slowed(e, scene, scale)) for e in _elements(scene.system)]
    start = {
        key: value if key not in _velocities(scene) else _divided(value, scale) for key, value in scene.start.items()
    }
    return replace(_with(scene, elements), start=start, times=begin + scale * (scene.times - begin))


def _velocities(scene: Scene) -> list[str]:
    """Start values that are velocities."""
    return [key for key in scene.start if key.rpartition(".")[2] in ("vx", "vy", "vz", "omega")]


def _slowed(element: object, scene: Scene, scale: float) -> dict[str, Any]:
    """The components of gravity, and the functions of time, of an element on another time scale."""
    begin, system = float(scene.times[0]), scene.system

    def law(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(law(part) for part in value)
        if isinstance(value, Point):
            return replace(value, s=law(value.s))
        if is_sympy(value):
            value = from_sympy(value, system.bind.by_name)
        return ca.substitute(value, t, begin + (t - begin) / scale) if isinstance(value, ca.SX) else value

    own = {f.name: getattr(element, f.name) for f in fields(element) if f.init}  # pyright: ignore[reportArgumentType]
    laws = {name: law(value) for name, value in own.items() if _depends_on_time(value)}
    gravity = ("gx", "gy", "gz") if isinstance(element, Gravity) else ()
    return {name: _divided(getattr(element, name), scale**2) for name in gravity} | laws


def _depends_on_time(value: Any) -> bool:
    if isinstance(value, tuple):
        return any(_depends_on_time(part) for part in value)
    if isinstance(value, Point):
        return _depends_on_time(value.s)
    if is_sympy(value):
        return any(symbol.name == t.name() for symbol in value.free_symbols)
    return isinstance(value, ca.SX) and bool(ca.depends_on(value, t))


def _divided(value: Any, by: float) -> Any:
    return tuple(part / by for part in value) if isinstance(value, tuple) else value / by


def _stiffnesses(element: object) -> list[str]:
    return [name for name in ("stiffness", "rotational_stiffness") if hasattr(element, name)]


def _elements(system: System) -> tuple[Any, ...]:
    return (*system.bodies, *(e for e in system.elements if e not in system.bodies))


def _changed(element: Any, changes: Mapping[str, Any]) -> Any:
    """The element, or a copy with other fields and the same symbols."""
    changed = copy.copy(element) if changes else element
    for name, value in changes.items():
        object.__setattr__(changed, name, value)
    return changed


def _with(scene: Scene, elements: Sequence[Any]) -> Scene:
    system = System(*elements, parameters=scene.system.parameters)
    system.lam, system.vdot = scene.system.lam, scene.system.vdot  # outputs may contain these symbols
    return replace(scene, system=system)
