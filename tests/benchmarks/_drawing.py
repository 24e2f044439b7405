"""What random scenes are drawn with: units, bodies whose places are known, and places where forces may act."""

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

import symmb as mb
from symmb.declare.mechanics import Rotation
from symmb.declare.mechanics.body import Point

Place = tuple[float, float]


@dataclass(frozen=True)
class Units:
    """Units of a scene, in SI."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def force(self) -> float:
        return self.mass * self.length / self.time**2

    @property
    def torque(self) -> float:
        return self.force * self.length

    @property
    def inertia(self) -> float:
        return self.mass * self.length**2


@dataclass(frozen=True)
class Sensor:
    """A coordinate along which a force can act.

    Attributes
    ----------
    value : SX                 the coordinate
    size, inertia : float      its natural size, and the inertia of the body along it, SI
    push : (name, SX) -> force element along it
    point, axis                of a linear coordinate
    """

    value: ca.SX
    size: float
    inertia: float
    push: Callable[[str, ca.SX], object]
    point: Point | None = None
    axis: tuple[float, ...] = ()


@dataclass
class Mechanism:
    """Bodies, joints and forces of a scene under construction.

    Attributes
    ----------
    start, pose            listed values of the scene, and its other coordinates
    sizes                  body -> size of its motion over the unit of length, where it is not 1
    span                   seconds over the unit of time
    redundant              whether rows are redundant
    """

    kind: str
    rng: np.random.Generator
    units: Units
    spatial: bool = False
    elements: list[object] = field(default_factory=list)
    sensors: list[Sensor] = field(default_factory=list)
    start: dict[str, object] = field(default_factory=dict)
    pose: dict[str, object] = field(default_factory=dict)
    sizes: dict[str, float] = field(default_factory=dict)
    span: float = 4.0
    redundant: bool = False

    def values(self) -> dict[str, float]:
        """All coordinates at the start, and the listed velocities, by the names of the states."""
        known: dict[str, float] = {}
        for key, value in (self.pose | self.start).items():
            if isinstance(value, Rotation):
                quaternion = ca.evalf(value.quaternion).full().ravel()
                known |= {f"{key.removesuffix('rotation')}e{i}": float(e) for i, e in enumerate(quaternion)}
            elif isinstance(value, tuple):
                known |= {f"{key}_{axis}": float(rate) for axis, rate in zip("xyz", value, strict=True)}
            else:
                known[key] = float(value)  # pyright: ignore
        return known

    def at(self, body: mb.Body | mb.Ground, x: float, y: float, z: float = 0.0) -> Point:
        return body.point(*(c * self.units.length for c in ((x, y, z) if self.spatial else (x, y))))

    def body(self, name: str, place: tuple[float, ...], angle: float = 0.0, length: float = 1.0) -> mb.Body:
        """A body of random mass whose centre and angle about z are given."""
        units, mass = self.units, self.rng.uniform(0.5, 2.0)
        inertia = mass * length**2 * self.rng.uniform(0.07, 0.15)
        if self.spatial:
            moments = tuple(inertia * c * units.inertia for c in (1.0, *self.rng.uniform(1.0, 1.7, 2)))
            body = mb.Body(name, mass * units.mass, moments, mb.Spatial())
            self.pose[f"{name}.rotation"] = mb.rotation((0, 0, 1), angle)
        else:
            body = mb.Body(name, mass * units.mass, inertia * units.inertia, mb.Planar())
            self.pose[f"{name}.theta"] = angle
        self.pose |= {f"{name}.{c}": r * units.length for c, r in zip("xyz", (*place, 0.0), strict=False)}
        if not self.spatial:
            self.pose.pop(f"{name}.z", None)
        self.elements.append(body)
        return body

    def rod(self, name: str, begin: Place, end: Place, turns: int = 0) -> mb.Body:
        """A body whose x axis goes from one place to another, its centre halfway."""
        d = np.subtract(end, begin)
        angle = float(np.arctan2(d[1], d[0])) + 2 * np.pi * turns
        body = self.body(name, tuple((np.add(begin, end) / 2).tolist()), angle, float(np.hypot(*d)))
        self.feel(body)
        return body

    def hinge(self, name: str, a: Point, b: Point) -> mb.Revolute:
        joint = mb.Revolute(name, a, b)
        self.elements.append(joint)
        return joint

    def gravity(self, g: float = 1.0) -> None:
        g *= self.units.length / self.units.time**2
        self.elements.append(mb.Gravity(0, -g, 0) if self.spatial else mb.Gravity(0, -g))

    def launch(self, name: str, omega: float, *, held: bool = True) -> None:
        """List a body's angle and angular velocity."""
        key = f"{name}.rotation" if self.spatial else f"{name}.theta"
        if held:
            self.start[key] = self.pose.pop(key)
        rate = omega / self.units.time
        self.start[f"{name}.omega"] = (0.0, 0.0, rate) if self.spatial else rate

    def feel(self, body: mb.Body) -> None:
        """Let forces act on a body."""
        units, mass = self.units, float(body.mass)
        self.sensors += [self.linear(body, k, mass) for k in range(2)]
        if isinstance(body.pose, mb.Planar):
            push = lambda name, torque: mb.Torque(name, body, torque)  # noqa: E731
            self.sensors.append(Sensor(body.theta, 1.0, mass * units.length**2, push))

    def linear(self, body: mb.Body, k: int, mass: float, size: float = 1.0) -> Sensor:
        """The sensor of coordinate k of the centre of a body."""
        point, axis = self.at(body, 0, 0), tuple(float(i == k) for i in range(3 if self.spatial else 2))

        def push(name: str, force: ca.SX) -> object:
            return mb.Force(name, point, tuple(force * a if a else 0 for a in axis))

        return Sensor((body.x, body.y)[k], size * self.units.length, mass, push, point, axis)
