"""Random switches for `random_scenes`, placed where a motion without them passes.

Most act for much less than a default step: walls right before a turning point, narrow zones of position, velocity and
time that give a known impulse. Some act long: friction and drag.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from _drawing import Mechanism, Sensor

import symmb as mb
from symmb._types import Array


@dataclass(frozen=True)
class Switch:
    """A force with switches.

    Attributes
    ----------
    kind : str
    element                force element
    crossings              what changes sign at its switches, with natural sizes
    """

    kind: str
    element: object
    crossings: tuple[tuple[ca.SX, float], ...]


@dataclass(frozen=True)
class Path:
    """A sensor's values (n,) along the motion without switches at times (n,) [s], and the name of the switch there."""

    name: str
    sensor: Sensor
    times: Array
    values: Array
    unit: float

    @property
    def speed(self) -> Array:
        return np.gradient(self.values, self.times)

    @property
    def size(self) -> float:
        """Natural size of the coordinate: not all of them move as much as their mechanism."""
        return float(min(self.sensor.size, np.ptp(self.values)))


def wall(path: Path, rng: np.random.Generator) -> Switch | None:
    """A stop right before the largest or the least value, touched for a short time."""
    side = int(rng.choice([-1, 1]))
    k = int(np.argmax(side * path.values))
    if not 2 < k < len(path.values) - 3:
        return None
    t, sensor = path.times, path.sensor
    bend = abs(np.gradient(path.speed, t)[k])
    duration = 10.0 ** rng.uniform(-3.5, -1.7) * path.unit
    place = float(path.values[k] - side * bend * duration**2 / 8)
    depth, stiffness = side * (sensor.value - place), sensor.inertia * (np.pi / duration) ** 2
    crossings = ((depth, path.size),)
    laws: list[tuple[str, Callable[[], ca.SX]]] = [
        ("wall by if_else", lambda: ca.if_else(depth > 0, depth, 0)),
        ("wall by fmax", lambda: ca.fmax(depth, 0)),
        ("wall by fmin", lambda: -ca.fmin(-depth, 0)),
        ("wall by fabs", lambda: (depth + ca.fabs(depth)) / 2),
        ("wall by sign", lambda: depth * (1 + ca.sign(depth)) / 2),
        ("wall by Contact", lambda: depth),
    ]
    kind, law = laws[int(rng.integers(len(laws)))]
    if kind != "wall by Contact" or sensor.point is None:
        return Switch(kind, sensor.push(path.name, -side * stiffness * law()), crossings)
    damping = 0.0 if rng.random() < 0.5 else rng.uniform(0, 0.5) * stiffness * duration / np.pi
    if damping:
        rate = mb.ddt(depth)
        crossings += ((stiffness * depth + damping * rate, stiffness * path.size),)
    at = mb.Ground().point(*(place * a for a in sensor.axis))
    normal = tuple(-side * a for a in sensor.axis)
    return Switch(kind, mb.Contact(path.name, sensor.point, at, normal, mb.KelvinVoigt(stiffness, damping)), crossings)


def zone(path: Path, rng: np.random.Generator) -> Switch | None:
    """A force over a narrow zone of position, which gives an impulse."""
    speed = path.speed
    fast = np.flatnonzero(np.abs(speed) > 0.3 * np.abs(speed).max())
    k = int(rng.choice(fast[(fast > 2) & (fast < len(speed) - 3)]))
    duration = 10.0 ** rng.uniform(-6, -1.7) * path.unit
    width, place = abs(speed[k]) * duration, float(path.values[k])
    force = rng.choice([1, 1, -0.5]) * rng.uniform(0.1, 0.5) * path.sensor.inertia * speed[k] / duration
    return _pulse("zone", path, path.sensor.value, place, width, force, path.size, rng)


def velocity_zone(path: Path, rng: np.random.Generator) -> Switch | None:
    """A force over a narrow interval of velocity, in the direction of the acceleration."""
    bend = np.gradient(path.speed, path.times)
    strong = np.flatnonzero(np.abs(bend) > 0.3 * np.abs(bend).max())
    k = int(rng.choice(strong[(strong > 2) & (strong < len(bend) - 3)]))
    duration = 10.0 ** rng.uniform(-4, -2) * path.unit
    sensor, impulse = path.sensor, rng.uniform(0.1, 0.5) * path.sensor.inertia * np.sign(bend[k])
    width = 0.5 * rng.uniform(0.1, 0.5) * path.size / path.unit
    force = impulse * path.size / path.unit / duration
    return _pulse(
        "velocity", path, mb.ddt(sensor.value), float(path.speed[k]), width, force, path.size / path.unit, rng
    )


def time_pulse(path: Path, rng: np.random.Generator) -> Switch | None:
    """A force for a short time, which gives an impulse."""
    t = path.times
    duration = 10.0 ** rng.uniform(-6, -1.7) * path.unit
    impulse = rng.uniform(0.1, 0.5) * path.sensor.inertia * path.size / path.unit
    begin = rng.uniform(t[0] + 0.05 * np.ptp(t), t[-1] - 0.1 * np.ptp(t))
    return _pulse("time", path, mb.t, begin, duration, impulse / duration, path.unit, rng)


def _pulse(
    what: str, path: Path, at: ca.SX, begin: float, width: float, force: float, size: float, rng: np.random.Generator
) -> Switch:
    """A force where an expression lies between `begin` and `begin` + `width`."""
    end, middle = begin + width, begin + width / 2
    edges = ((at - begin, size), (at - end, size))
    tip = ((at - middle, size),)
    rising, falling = (at - begin) / width, (end - at) / width
    choices: list[tuple[str, Callable[[], ca.SX], tuple]] = [
        ("if_else", lambda: ca.if_else(ca.logic_and(at > begin, at < end), 1, 0), edges),
        ("sign", lambda: (ca.sign(at - begin) - ca.sign(at - end)) / 2, edges),
        ("fmin and fmax", lambda: 4 * ca.fmax(ca.fmin(rising, falling), 0), edges + tip),
        ("fabs", lambda: 2 * ca.fmax(1 - ca.fabs(2 * (at - middle) / width), 0), edges + tip),
        ("Table", lambda: mb.Table([begin, middle, end], [0.0, 1.6, 0.0])(at), edges + tip),
        (
            "flat Table",
            lambda: mb.Table([begin - 20 * width, begin, middle, end, end + 20 * width], [0.0, 0.0, 1.6, 0.0, 0.0])(at),
            edges + tip,
        ),
    ]
    kind, law, crossings = choices[int(rng.integers(len(choices)))]
    return Switch(f"{what} by {kind}", path.sensor.push(path.name, force * law()), crossings)


def friction(path: Path, rng: np.random.Generator) -> Switch | None:
    """A small dry friction, which turns with the velocity."""
    rate = mb.ddt(path.sensor.value)
    size = float(np.abs(np.gradient(path.speed, path.times)).max()) * path.sensor.inertia
    law = -rng.uniform(0.005, 0.05) * size * ca.sign(rate)
    return Switch("friction by sign", path.sensor.push(path.name, law), ((rate, path.size / path.unit),))


def drag(path: Path, rng: np.random.Generator) -> Switch | None:
    """A quadratic drag."""
    rate = mb.ddt(path.sensor.value)
    law = -rng.uniform(0.02, 0.3) * path.sensor.inertia / path.size * rate * ca.fabs(rate)
    return Switch("drag by fabs", path.sensor.push(path.name, law), ((rate, path.size / path.unit),))


KINDS, SHARES = (wall, zone, velocity_zone, time_pulse, friction, drag), (0.35, 0.3, 0.05, 0.15, 0.05, 0.1)


def place(name: str, mechanism: Mechanism, times: Array, values: Callable[[ca.SX], Array]) -> Switch | None:
    """A switch where the motion passes; `values` evaluates an expression along it. None if there is no such place."""
    rng = mechanism.rng
    sensor = mechanism.sensors[int(rng.integers(len(mechanism.sensors)))]
    path = Path(name, sensor, times, values(sensor.value), mechanism.units.time)
    if not np.ptp(path.values) > 0.05 * sensor.size:
        return None
    return KINDS[int(rng.choice(len(KINDS), p=SHARES))](path, rng)
