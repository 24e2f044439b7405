"""Random mechanisms for `random_scenes`: oscillators, chains, loops, redundant loops, drives and bodies in space.

They give all their coordinates at the start, and places where a force may act along a coordinate.
"""

from collections.abc import Iterator

import casadi as ca
import numpy as np
from _drawing import Mechanism, Units

import symmb as mb


def oscillators(m: Mechanism) -> None:
    """Particles that swing along x, each by itself or coupled weakly, with amplitudes that may differ much."""
    rng, units = m.rng, m.units
    n, apart = int(rng.integers(1, 4)), rng.random() < 0.5
    bodies: list[mb.Body] = []
    for i in range(n):
        size, omega, phase = 10.0 ** rng.uniform(-9, 0) if apart and i else 1.0, rng.uniform(0.7, 3), rng.uniform(0, 6)
        body = mb.Body(f"b{i}", rng.uniform(0.5, 2) * units.mass, pose=mb.Particle())
        k = float(body.mass) * (omega / units.time) ** 2
        m.elements += [body, mb.Force(f"spring{i}", body.point(0, 0), (-k * body.x, 0))]
        m.start |= {
            f"b{i}.x": size * units.length * np.cos(phase),
            f"b{i}.vx": -size * omega * units.length / units.time * np.sin(phase),
        }
        m.sizes[f"b{i}"] = size
        m.sensors.append(m.linear(body, 0, float(body.mass), size))
        bodies.append(body)
    if n > 1 and not apart:
        k = rng.uniform(0.1, 1) * units.mass / units.time**2
        force = k * (bodies[1].x - bodies[0].x)
        m.elements += [
            mb.Force("pull", bodies[0].point(0, 0), (force, 0)),
            mb.Force("back", bodies[1].point(0, 0), (-force, 0)),
        ]
    m.span = rng.uniform(5, 15)


def links(m: Mechanism, most: int, turns: int = 0) -> Iterator[tuple[str, mb.Body | mb.Ground, float, mb.Body, float]]:
    """Rods of which each begins at the tip of the one before.

    Yields a rod's number, the body before, the place of the tip on it, the rod, and the place of its beginning on it.
    Angles may be beyond pi by up to `turns` turns.
    """
    base, at, shift = mb.Ground(), (0.0, 0.0), 0.0
    for i in range(int(m.rng.integers(1, most + 1))):
        angle, length = m.rng.uniform(-np.pi, np.pi), m.rng.uniform(0.5, 1.2)
        tip = (at[0] + length * np.cos(angle), at[1] + length * np.sin(angle))
        body = m.rod(f"b{i}", at, tip, int(m.rng.integers(-turns, turns + 1)))
        yield str(i), base, shift, body, -length / 2
        base, at, shift = body, tip, length / 2


def chain(m: Mechanism) -> None:
    """Rods that hang from each other, springs in their joints, in a plane."""
    rng, units = m.rng, m.units
    for i, base, shift, body, begin in links(m, 3, 0 if m.spatial else 2):
        m.hinge(f"j{i}", m.at(base, shift, 0), m.at(body, begin, 0))
        if rng.random() < 0.5:
            k, rest = rng.uniform(0.2, 2) * units.torque, rng.uniform(-6, 6)
            m.elements.append(mb.TorsionSpring(f"t{i}", base, body, k, 0.1 * k * units.time, rest))
        m.launch(f"b{i}", rng.uniform(-4, 4))
    m.gravity()
    m.span = rng.uniform(2, 5)


def four_bar(m: Mechanism) -> None:
    """A crank that turns round, in a plane; of spatial bodies it has three rows too many."""
    rng = m.rng
    crank, rod, rocker, frame = rng.uniform(0.3, 0.5), rng.uniform(1.0, 1.3), rng.uniform(0.9, 1.1), 1.2
    angle = rng.uniform(-np.pi, np.pi)
    a, d = np.array([crank * np.cos(angle), crank * np.sin(angle)]), np.array([frame, 0.0])
    reach = float(np.hypot(*(d - a)))
    along = (rod**2 - rocker**2 + reach**2) / (2 * reach)
    toward = (d - a) / reach
    b = a + along * toward + np.sqrt(rod**2 - along**2) * np.array([-toward[1], toward[0]])
    ground = mb.Ground()
    first, second, third = m.rod("crank", (0.0, 0.0), tuple(a)), m.rod("rod", tuple(a), tuple(b)), m.rod(
        "rocker", tuple(d), tuple(b)
    )  # fmt: skip
    m.hinge("A", m.at(ground, 0, 0), m.at(first, -crank / 2, 0))
    m.hinge("B", m.at(first, crank / 2, 0), m.at(second, -rod / 2, 0))
    m.hinge("C", m.at(second, rod / 2, 0), m.at(third, rocker / 2, 0))
    m.hinge("D", m.at(ground, frame, 0), m.at(third, -rocker / 2, 0))
    m.launch("crank", rng.choice([-1, 1]) * rng.uniform(2, 6))
    m.gravity(0.5)
    m.span, m.redundant = rng.uniform(2, 6), m.spatial


def slider_crank(m: Mechanism) -> None:
    """Crank, rod and slider; of spatial bodies it has three rows too many."""
    rng = m.rng
    crank, rod, angle = rng.uniform(0.3, 0.6), rng.uniform(1.0, 1.5), rng.uniform(-np.pi, np.pi)
    a = (crank * np.cos(angle), crank * np.sin(angle))
    b = (a[0] + np.sqrt(rod**2 - a[1] ** 2), 0.0)
    ground, first, second = mb.Ground(), m.rod("crank", (0.0, 0.0), a), m.rod("rod", a, b)
    slider = m.body("slider", b)
    m.feel(slider)
    m.hinge("A", m.at(ground, 0, 0), m.at(first, -crank / 2, 0))
    m.hinge("B", m.at(first, crank / 2, 0), m.at(second, -rod / 2, 0))
    m.hinge("C", m.at(second, rod / 2, 0), m.at(slider, 0, 0))
    m.elements.append(mb.Prismatic("guide", m.at(ground, 0, 0), m.at(slider, 0, 0), axis=(1, 0, 0)))
    m.launch("crank", rng.choice([-1, 1]) * rng.uniform(2, 6))
    m.gravity(0.5)
    m.span, m.redundant = rng.uniform(2, 6), m.spatial


def parallelogram(m: Mechanism) -> None:
    """A plate on three or four equal cranks, whose pins are not on one line: one or two rows too many."""
    rng = m.rng
    r, angle, ground = rng.uniform(0.4, 0.8), rng.uniform(-np.pi, np.pi), mb.Ground()
    d = (r * np.cos(angle), r * np.sin(angle))
    plate = m.body("plate", d)
    m.feel(plate)
    pins = [(0.0, 0.0), (1.0, rng.uniform(-0.3, 0.3)), (rng.uniform(0.2, 0.8), rng.uniform(0.6, 1.2)), (0.3, -0.9)]
    for i, pin in enumerate(pins[: int(rng.integers(3, 5))]):
        end = (pin[0] + d[0], pin[1] + d[1])
        if rng.random() < 0.5 or i == 0:
            crank = m.rod(f"c{i}", pin, end)
            m.hinge(f"A{i}", m.at(ground, *pin), m.at(crank, -r / 2, 0))
            m.hinge(f"B{i}", m.at(crank, r / 2, 0), m.at(plate, *pin))
        else:
            m.elements.append(mb.Distance(f"bar{i}", m.at(ground, *pin), m.at(plate, *pin), r * m.units.length))
    m.launch("c0", rng.choice([-1, 1]) * rng.uniform(1, 5))
    m.gravity()
    m.span, m.redundant = rng.uniform(2, 6), True


def trammel(m: Mechanism) -> None:
    """A rod whose ends slide on two lines, and a bar to its centre: any two rows depend on each other somewhere."""
    rng, units = m.rng, m.units
    half, angle, ground = rng.uniform(0.4, 0.8), rng.uniform(-np.pi, np.pi), mb.Ground()
    d = (half * np.cos(angle), half * np.sin(angle))
    body = m.rod("rod", (0.0, 2 * d[1]), (2 * d[0], 0.0))
    rows = [
        mb.PointOnLine("upright", m.at(ground, 0, 0), m.at(body, -half, 0), axis=(0, 1, 0)),
        mb.PointOnLine("level", m.at(ground, 0, 0), m.at(body, half, 0), axis=(1, 0, 0)),
        mb.Distance("bar", m.at(ground, 0, 0), m.at(body, 0, 0), half * units.length),
    ]
    m.elements += [rows[k] for k in rng.permutation(3)]
    m.launch("rod", rng.choice([-1, 1]) * rng.uniform(1, 4))
    m.gravity()
    m.span, m.redundant = rng.uniform(2, 8), True


def bricard(m: Mechanism) -> None:
    """Six rods along the edges of a cube, hinged at right angles, one of them the ground: one row too many."""
    rng, units = m.rng, m.units
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], dtype=float)
    centres = (corners + np.roll(corners, -1, axis=0)) / 2
    bodies: list[mb.Body | mb.Ground] = [m.body(f"b{i}", tuple(centres[i])) for i in range(5)] + [mb.Ground()]
    m.sensors += [m.linear(body, k, float(body.mass)) for body in bodies[1:4] for k in range(2)]
    centres[5] = 0
    axes = np.eye(3)[[1, 2, 0, 1, 2, 0]]
    for i in range(6):
        a, b = (i - 1) % 6, i
        points = m.at(bodies[a], *(corners[i] - centres[a])), m.at(bodies[b], *(corners[i] - centres[b]))
        m.elements.append(mb.Revolute(f"j{i}", *points, axis=tuple(axes[i])))
    m.start["b0.rotation"] = m.pose.pop("b0.rotation")
    m.start["b0.omega"] = (0.0, rng.choice([-1, 1]) * rng.uniform(0.3, 1) / units.time, 0.0)
    m.gravity()
    m.span, m.redundant = rng.uniform(1.5, 4), True


def door(m: Mechanism) -> None:
    """Leaves on two hinges each about one axis, with a spring wound by more than a turn: five rows too many a leaf."""
    rng, units = m.rng, m.units
    for i, base, shift, body, begin in links(m, 2):
        for k, z in enumerate((0.0, 0.4)):
            m.hinge(f"j{i}{k}", m.at(base, shift, 0, z), m.at(body, begin, 0, z))
        k = rng.uniform(0.5, 2) * units.torque
        m.elements.append(mb.TorsionSpring(f"t{i}", base, body, k, angle=rng.choice([-1, 1]) * rng.uniform(4, 9)))
        m.launch(f"b{i}", rng.uniform(-4, 4))
    m.gravity()
    m.span, m.redundant = rng.uniform(2, 4), True


def top(m: Mechanism) -> None:
    """A spinning body on a ball joint, perhaps with a second one on it."""
    for i, base, shift, body, begin in links(m, 2):
        m.elements.append(mb.Spherical(f"j{i}", m.at(base, shift, 0), m.at(body, begin, 0)))
        m.launch(f"b{i}", 0.0)
        m.start[f"b{i}.omega"] = tuple(m.rng.uniform(-4, 4, 3) / m.units.time)
    m.gravity()
    m.span = m.rng.uniform(2, 4)


def driven(m: Mechanism) -> None:
    """A crank driven from beyond pi, and a pendulum that hangs on it."""
    rng, units = m.rng, m.units
    begin, rate, r = rng.uniform(3.3, 9), rng.uniform(-2, 2), rng.uniform(0.2, 0.6)
    a = (r * np.cos(begin), r * np.sin(begin))
    ground, crank = mb.Ground(), m.rod("crank", (0.0, 0.0), a)
    m.pose["crank.theta"] = begin
    hung = rng.uniform(-np.pi, np.pi)
    tip = (a[0] + np.cos(hung), a[1] + np.sin(hung))
    bob = m.rod("bob", a, tip)
    hinge = m.hinge("drive", m.at(ground, 0, 0), m.at(crank, -r / 2, 0))
    m.hinge("hang", m.at(crank, r / 2, 0), m.at(bob, -0.5, 0))
    tau = mb.t / units.time
    m.elements.append(mb.Motion("motor", hinge.angle, begin + rate * tau + 0.3 * (1 - ca.cos(tau))))
    m.launch("bob", rng.uniform(-3, 3))
    m.sensors = m.sensors[3:]  # those of the crank would do nothing
    m.gravity()
    m.span = rng.uniform(2, 6)


PLANAR, SPATIAL = (oscillators, trammel, driven), (bricard, door, top)
EITHER = (chain, four_bar, slider_crank, parallelogram)


def draw(rng: np.random.Generator) -> Mechanism:
    """A mechanism; half of them in units of their own from 1e-6 to 1e6."""
    make = rng.choice([*PLANAR, *SPATIAL, *EITHER])  # pyright: ignore
    units = Units(*(10.0 ** rng.uniform(-6, 6, 3)).tolist()) if rng.random() < 0.5 else Units()
    spatial = make in SPATIAL or (make in EITHER and rng.random() < 0.3)
    kind = make.__name__ + (" in space" if make in EITHER and spatial else "")
    m = Mechanism(kind, rng, units, spatial)
    make(m)
    return m
