"""Driven loops of bodies in space with redundant rows, whose motion is known in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

import symmb as mb

Vector = np.ndarray


@dataclass(frozen=True)
class DrivenLoop:
    """A scene in given coordinates, and its outputs (n_t, n_y) in closed form."""

    kind: str
    scene: Callable[[str | None], mb.Scene]
    known: Vector


def driven_loop(seed: int) -> DrivenLoop:
    """The loop of a seed, in a random place, whose drive makes one to three turns with a ripple."""
    rng = np.random.default_rng([seed, 5])
    kinds = (jack, jack, four_bar, cardan_shaft)
    return kinds[int(rng.integers(len(kinds)))](rng)


class _Drive:
    """The angle of a drive over time, and the place of the mechanism."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.times = np.linspace(0.0, 1.0, 21)
        begin = float(rng.choice([0.0, np.pi / 2, rng.uniform(-3, 3)]))
        turns = float(rng.choice([-1, 1]) * rng.uniform(1, 3))
        self.begin = begin
        self.law = begin + 2 * np.pi * turns * mb.t + 0.3 * ca.sin(5 * mb.t)
        self.angle = begin + 2 * np.pi * turns * self.times + 0.3 * np.sin(5 * self.times)
        seed = int(rng.integers(1000))
        self.R = Rotation.random(random_state=seed).as_matrix() if rng.random() < 0.5 else np.eye(3)

    def at(self, *r: float) -> tuple[float, ...]:
        """A vector (3,) in axes of the mechanism, in world axes."""
        return tuple(float(x) for x in self.R @ np.array(r))

    def along(self, point, *axis: float):
        """The coordinate of a point along an axis (3,) of the mechanism."""
        return sum(a * x for a, x in zip(self.at(*axis), (point.x, point.y, point.z), strict=True))


def _body(name: str, rng: np.random.Generator) -> mb.Body:
    com = tuple(float(x) for x in rng.uniform(-0.2, 0.2, 3)) if rng.random() < 0.5 else (0, 0, 0)
    return mb.Body(name, float(rng.uniform(0.5, 2)), (0.1, 0.11, 0.12), mb.Spatial(), com=com)


def _either(rng: np.random.Generator, a, b) -> tuple:
    return (a, b) if rng.random() < 0.5 else (b, a)


def _system(rng: np.random.Generator, bodies: list, joints: list, motor: mb.Motion) -> mb.System:
    elements = [joints[k] for k in rng.permutation(len(joints))]
    return mb.System(*[bodies[k] for k in rng.permutation(len(bodies))], *elements, motor, mb.Gravity(1, 2, -9))


def jack(rng: np.random.Generator) -> DrivenLoop:
    """A screw that lifts a carriage, whose nut may have a trunnion: x = lead angle / 2 pi."""
    drive, ground, lead = _Drive(rng), mb.Ground(), float(rng.uniform(0.02, 0.2))
    has_trunnion = bool(rng.random() < 0.5)
    screw, carriage, nut = (_body(name, rng) for name in ("screw", "carriage", "nut"))
    foot, side = rng.uniform(-0.5, 0.5, (2, 3)) if rng.random() < 0.7 else np.zeros((2, 3))
    z = drive.at(0, 0, 1)
    hinge = mb.Revolute("hinge", ground.point(*drive.at(*foot)), screw.point(0, 0, 0), axis=z)
    moved = nut if has_trunnion else carriage
    thread = mb.Screw("thread", *_either(rng, screw.point(0, 0, 0), moved.point(0, 0, 0)), axis=z, pitch=lead)
    ends = ground.point(*drive.at(*(foot + side))), carriage.point(*drive.at(*side))
    joints, bodies = [hinge, thread, mb.Prismatic("rail", *_either(rng, *ends), axis=z)], [screw, carriage]
    if has_trunnion:
        across = float(rng.choice([0.0, rng.uniform(-3, 3)]))
        ends, axis = (nut.point(0, 0, 0), carriage.point(0, 0, 0)), drive.at(np.cos(across), np.sin(across), 0)
        joints, bodies = [*joints, mb.Revolute("trunnion", *_either(rng, *ends), axis=axis)], [*bodies, nut]
    system = _system(rng, bodies, joints, mb.Motion("motor", hinge.angle, drive.law))
    middle = carriage.point(0, 0, 0)
    outputs = {"rise": drive.along(middle, 0, 0, 1), "angle": hinge.angle, "aside": drive.along(middle, 1, 0, 0)}
    rise = foot[2] - lead * drive.angle / (2 * np.pi)
    known = np.column_stack([rise, drive.angle, np.full_like(rise, foot[0])])

    return _loop("jack with a trunnion" if has_trunnion else "jack", drive, system, outputs, known)


def _loop(kind: str, drive: _Drive, system: mb.System, outputs: dict, known: Vector, **options) -> DrivenLoop:
    def scene(coordinates: str | None) -> mb.Scene:
        return mb.Scene(system, {}, drive.times, outputs, coordinates=coordinates, name=kind, **options)

    return DrivenLoop(kind, scene, known)


def closed(A: Vector, D: Vector, b: float, c: float) -> Vector:
    """Places (..., 2) at distances b from A and c from D, by the law of cosines."""
    r = np.linalg.norm(D - A, axis=-1, keepdims=True)
    e, f = (D - A) / r, (b * b - c * c + r * r) / (2 * r)
    return A + f * e + np.sqrt(b * b - f * f) * np.stack([-e[..., 1], e[..., 0]], axis=-1)


def four_bar(rng: np.random.Generator) -> DrivenLoop:
    """A crank that turns and a rocker, as the law of cosines gives it."""
    drive, ground = _Drive(rng), mb.Ground()
    a, b, c, d = *rng.uniform((0.2, 0.9, 0.8), (0.35, 1.1, 0.9)), 1.0
    A = a * np.column_stack([np.cos(drive.angle), np.sin(drive.angle)])
    D = np.array([d, 0.0])
    B = closed(A, D, b, c)
    z = drive.at(0, 0, 1)
    bodies, guess = {}, {}
    for name, (P, Q) in {"crank": (0 * D, A[0]), "coupler": (A[0], B[0]), "rocker": (D, B[0])}.items():
        half = float(np.linalg.norm(Q - P)) / 2
        bodies[name] = mb.Body(name, 1.0, (0.01, 0.1, 0.1), mb.Spatial(), com=drive.at(half, 0, 0))
        guess |= dict(zip((f"{name}.{x}" for x in "xyz"), drive.at(*((P + Q) / 2), 0), strict=True))
        guess[f"{name}.rotation"] = mb.rotation(z, float(np.arctan2(*(Q - P)[::-1])))

    def end(name: str, length: float):
        return bodies[name].point(*drive.at(length, 0, 0))

    foot = mb.Revolute("A", ground.point(0, 0, 0), end("crank", 0), axis=z)
    pairs = {"B": (end("crank", a), end("coupler", 0)), "C": (end("coupler", b), end("rocker", c))}
    pairs["D"] = ground.point(*drive.at(d, 0, 0)), end("rocker", 0)
    joints = [foot, *(mb.Revolute(name, *_either(rng, *pair), axis=z) for name, pair in pairs.items())]
    system = _system(rng, list(bodies.values()), joints, mb.Motion("motor", foot.angle, drive.law))
    tip = end("rocker", c)
    outputs = {"x": drive.along(tip, 1, 0, 0), "y": drive.along(tip, 0, 1, 0), "angle": foot.angle}
    known = np.column_stack([B, drive.angle])

    return _loop("four-bar", drive, system, outputs, known, guess=guess)


def cardan_shaft(rng: np.random.Generator) -> DrivenLoop:
    """Two universal joints between parallel shafts: the second one turns as the first one does."""
    drive, ground, bend = _Drive(rng), mb.Ground(), float(rng.uniform(0.2, 0.7))
    first, middle, last = (_body(name, rng) for name in ("first", "middle", "last"))
    z, across = drive.at(0, 0, 1), drive.at(1, 0, 0)
    slanted = np.array([0.0, np.sin(bend), np.cos(bend)])
    pin = np.cross(slanted, [1.0, 0.0, 0.0])
    begin = drive.angle - drive.angle[0]
    hinge = mb.Revolute("in", ground.point(0, 0, 0), first.point(0, 0, 0), axis=z)
    out = mb.Revolute("out", ground.point(*drive.at(*slanted)), last.point(0, 0, 0), axis=z)
    pins = {"axis": across, "axis_b": drive.at(*pin)}
    before = mb.Universal("U", first.point(0, 0, 0), middle.point(0, 0, 0), **pins)
    behind = mb.Universal("V", last.point(0, 0, 0), middle.point(*drive.at(*slanted)), **pins)
    joints = [hinge, before, behind, out]
    law = drive.law - drive.begin
    system = _system(rng, [first, middle, last], joints, mb.Motion("motor", hinge.angle, law))
    outputs = {"in": hinge.angle, "out": out.angle, "x": drive.along(last.point(*across), 1, 0, 0)}
    known = np.column_stack([begin, begin, np.cos(begin)])

    return _loop("cardan shaft", drive, system, outputs, known)
