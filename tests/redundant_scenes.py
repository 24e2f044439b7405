"""Random mechanisms with redundant joints, and the same ones without them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from driven_loops import closed
from scipy.spatial.transform import Rotation

import symmb as mb

Vector = np.ndarray
TIMES = np.linspace(0.0, 0.5, 6)
COMPANIONS: dict[str, tuple[str, ...]] = {
    "Revolute": ("Revolute", "Spherical", "Cylindrical", "PointOnLine", "PlanarJoint", "Distance"),
    "Cylindrical": ("Cylindrical", "PointOnLine"),
    "Prismatic": ("Prismatic", "Cylindrical", "PointOnLine"),
    "Screw": ("Cylindrical", "PointOnLine"),
    "Spherical": ("Spherical", "Distance"),
    "Universal": ("Universal", "Spherical", "Distance"),
    "Weld": ("Weld", "Revolute", "Spherical", "Prismatic", "Cylindrical", "PlanarJoint", "PointOnLine", "Distance"),
}
"""Joints between the same two bodies that ask for nothing new, by the joint that carries the second one."""
PLANAR = {
    "Revolute": ("Revolute", "PointOnLine", "Distance", "Spherical"),
    "Prismatic": ("Prismatic", "PointOnLine"),
    "Weld": ("Weld", "Revolute", "Prismatic", "PointOnLine", "Distance"),
}
"""The same for planar bodies."""
EXTRAS = ("", "", "", "chain in a plane", "gear", "drive")
"""What is redundant beside the joints of two bodies."""


@dataclass(frozen=True)
class Mechanism:
    """A mechanism with redundant joints (`redundant`) and without (`plain`), as functions of the coordinates."""

    kind: str
    is_open: bool
    redundant: Callable[[str | None], mb.Scene]
    plain: Callable[[], mb.Scene]


def mechanism(seed: int) -> Mechanism:
    """The mechanism of a seed: a tree of joints, each of which may be doubled, or a loop in a tilted plane."""
    kind = ("tree", "tree", "tree", "planar", "four-bar", "cranks")[int(np.random.default_rng([seed, 1]).integers(6))]
    if kind in ("four-bar", "cranks"):
        scene = _four_bar if kind == "four-bar" else _cranks
        return Mechanism(kind, False, lambda given: scene(seed, True, given), lambda: scene(seed, False, "body"))
    tree = _Tree(seed, kind == "planar", None, 0)
    made = lambda coordinates, doubled: _Tree(seed, kind == "planar", coordinates, doubled).scene  # noqa: E731
    return Mechanism(tree.kind, not tree.driven, lambda given: made(given, 1), lambda: made("body", 0))


def _options(name: str, coordinates: Any) -> dict[str, Any]:
    """What all scenes have."""
    return {"times": TIMES, "coordinates": coordinates, "box": mb.Box(m=(0.9, 1.1), L=(0.97, 1.03)), "name": name}


def _unit(rng: np.random.Generator) -> Vector:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _across(rng: np.random.Generator, axis: Vector) -> Vector:
    v = np.cross(axis, rng.normal(size=3))
    return v / np.linalg.norm(v)


class _Tree:
    """A tree of one to three bodies; with `doubled`, each joint but some has one or two companions."""

    def __init__(self, seed: int, flat: bool, coordinates: Any, doubled: int) -> None:
        rng = self.rng = np.random.default_rng([seed, 2])
        self.flat, self.doubled, self.driven = flat, doubled, False
        self.p = mb.Parameters(m=1.0, L=1.0)
        self.ground, self.bodies, self.joints = mb.Ground(), list[mb.Body](), list[Any]()
        self.start: dict[str, Any] = {}
        self.names: list[str] = []
        table = PLANAR if flat else COMPANIONS
        extra = str(rng.choice(EXTRAS))
        count = int(rng.integers(1, 4)) + (extra == "gear")
        common = _unit(rng)
        for k in range(count):
            com = rng.uniform(-0.3, 0.3, 2 if flat else 3)
            mass, pose = float(rng.uniform(0.5, 2)), mb.Planar() if flat else mb.Spatial()
            inertia = mass * 0.08 if flat else tuple(mass * rng.uniform(0.05, 0.08, 3))
            place = tuple(float(x) * self.p.L for x in com)
            self.bodies.append(mb.Body(f"b{k}", mass * self.p.m, inertia, pose, com=place))
            carrier = int(rng.integers(-1, k))
            joint = str(rng.choice(list(table)))
            if extra == "chain in a plane" and not flat:
                joint, carrier = "Revolute", k - 1
            if extra == "gear" and k < 2:
                joint, carrier = "Revolute", -1
            if joint == "Universal":
                carrier = -1
            if joint == "Weld" and count == 1:
                joint = "Revolute"
            axis = common if extra == "chain in a plane" else _unit(rng)
            self._join(k, carrier, joint, axis, table[joint], extra == "chain in a plane")
        self._extra(extra, common)
        self.kind = " ".join([*(["planar"] if flat else []), *self.names, *([extra] if extra else [])])
        last = self.bodies[-1]
        outputs = {f"{body.name}.{c}": getattr(body, c) for body in self.bodies for c in "xyz"[: 2 if flat else 3]}
        outputs |= {"speed": last.vx, "acceleration": self.system.ddt(last.vy)}
        self.scene = mb.Scene(self.system, self.start, outputs=outputs, **_options("redundant", coordinates))

    @property
    def system(self) -> mb.System:
        gravity = mb.Gravity(1.0, -9.81) if self.flat else mb.Gravity(1.0, 2.0, -9.0)
        return self.__dict__.setdefault("_system", mb.System(*self.bodies, *self.joints, gravity, parameters=self.p))

    def _point(self, k: int, r: Vector):
        """A point on a body, or on the ground, that grows with the size L."""
        r = [float(x) * self.p.L for x in (r[:2] if self.flat else r)]
        return (self.ground if k < 0 else self.bodies[k]).point(*r)

    def _join(self, k: int, carrier: int, kind: str, axis: Vector, companions: tuple[str, ...], in_plane: bool) -> None:
        rng, name = self.rng, f"j{k}"
        at, on = rng.uniform(-0.4, 0.4, (2, 3))
        axis_b = axis if in_plane or kind in ("Prismatic", "Weld") else _unit(rng)
        if self.flat:
            at[2] = on[2] = 0.0
            axis = axis_b = np.array([0, 0, 1.0])
            if kind == "Prismatic":
                axis = axis_b = _across(rng, axis)
        if in_plane:
            at, on = (r - (r @ axis) * axis for r in (at, on))
        if kind == "Universal":
            axis_b = _across(rng, axis)
        self.joints.append(self._joint(name, kind, carrier, k, at, on, axis, axis_b))
        self.names.append(kind)
        value, rate = float(rng.uniform(-2, 2)), float(rng.uniform(-2, 2))
        if kind in ("Revolute", "Cylindrical", "Screw"):
            self.start |= {f"{name}.angle": value, f"{name}.angle_rate": rate}
        if kind in ("Prismatic", "Cylindrical"):
            self.start |= {f"{name}.displacement": 0.2 * value, f"{name}.displacement_rate": 0.3 * rate}
        if kind == "Spherical":
            self.start |= {f"b{k}.rotation": mb.rotation(tuple(_unit(rng)), value), f"b{k}.omega": tuple(_unit(rng))}
        if kind == "Universal":
            values = rng.uniform(-1, 1, 2).tolist()
            self.start[f"b{k}.rotation"] = mb.rotation(tuple(axis), values[0]) @ mb.rotation(tuple(axis_b), values[1])
        number = int(rng.integers(0, 3)) if k else int(rng.integers(1, 3))
        for i in range(number):
            self._companion(f"{name}_{i}", kind, str(rng.choice(companions)), carrier, k, at, on, axis, axis_b)

    def _companion(self, name, kind, second, carrier, k, at, on, axis, axis_b) -> None:
        """A joint that allows what the first one allows."""
        rng = self.rng
        s, u = rng.uniform(-0.5, 0.5, 2)
        x = rng.uniform(-0.5, 0.5, 3)
        across, length = x * (1, 1, 0 if self.flat else 1), None
        along = 0.0 if self.flat and kind != "Prismatic" else 1.0
        if kind == "Weld":  # frames are parallel: any joint at a common point
            at, on = at + x, on + x
            axis = axis_b = np.array([0, 0, 1.0]) if self.flat else _unit(rng)
            if self.flat and second in ("Prismatic", "PointOnLine"):
                axis = axis_b = _across(rng, axis)
            if second == "Distance":
                y = _across(rng, axis) * 0.4
                on, length = on + y, 0.4
        elif kind in ("Spherical", "Universal"):
            if second == "Distance":
                at, length = at + across, 0.0
        elif kind == "Prismatic":
            at, on = at + across + s * axis, on + across + u * axis
        elif second == "Distance":
            at, on, length = at + along * u * axis + across, on + along * u * axis_b, 0.0
        else:
            same = second in ("Revolute", "Spherical", "PlanarJoint")
            at, on = at + along * s * axis, on + along * (s if same else u) * axis_b
        if second == "PointOnLine" and self.flat and kind == "Revolute":
            axis = _across(rng, np.array([0, 0, 1.0]))
        if length == 0.0:
            length = float(np.linalg.norm(across))
        if self.doubled:
            self.joints.append(self._joint(name, second, carrier, k, at, on, axis, axis_b, length))
        self.names.append(f"+{second}")

    def _joint(self, name, kind, carrier, k, at, on, axis, axis_b, length: Any = None):
        a, b = self._point(carrier, at), self._point(k, on)
        if kind == "Distance":
            return mb.Distance(name, a, b, length * self.p.L)
        if kind in ("Spherical", "Weld"):
            return getattr(mb, kind)(name, a, b)
        if kind == "PointOnLine":
            return mb.PointOnLine(name, a, b, axis=tuple(axis))
        more = {"pitch": 0.1 * self.p.L} if kind == "Screw" else {}
        return getattr(mb, kind)(name, a, b, axis=tuple(axis), axis_b=tuple(axis_b), **more)

    def _extra(self, extra: str, common: Vector) -> None:
        n = len(self.bodies)
        if extra == "chain in a plane" and not self.flat and self.doubled:
            a, b = (self._point(k, 0.3 * common) for k in (-1, n - 1))
            self.joints.append(mb.PlanarJoint("plane", a, b, axis=tuple(common)))
        if extra == "gear":
            hinges = [j for j in self.joints if getattr(j, "name", "") in ("j0", "j1")]
            meshed = self.start["j0.angle"] + 1.5 * self.start["j1.angle"]
            for name in ("mesh", "mesh_again")[: 1 + self.doubled]:
                self.joints.append(mb.Motion(name, hinges[0].angle + 1.5 * hinges[1].angle, meshed))
            del self.start["j1.angle_rate"]
        if extra == "drive" and self.names[0] in ("Revolute", "Cylindrical", "Screw"):
            self.driven = True
            hinge = self.joints[0]
            law = self.start["j0.angle"] + 0.7 * mb.t + 0.3 * ca.sin(3 * mb.t)
            for name in ("drive", "drive_again")[: 1 + self.doubled]:
                self.joints.append(mb.Motion(name, hinge.angle, law))
            del self.start["j0.angle_rate"]


def _four_bar(seed: int, spatial: bool, coordinates: Any) -> mb.Scene:
    """A four-bar of spatial bodies in a tilted plane, 3 rows of which are redundant, or of planar ones in its own."""
    rng = np.random.default_rng([seed, 3])
    p, ground = mb.Parameters(m=1.0, L=1.0), mb.Ground()
    tilt = _unit(rng), float(rng.uniform(-3, 3))
    turn, R = mb.rotation(tuple(tilt[0]), tilt[1]), Rotation.from_rotvec(tilt[0] * tilt[1]).as_matrix()
    a, b, c = rng.uniform((0.2, 0.8, 0.7), (0.35, 1.0, 0.9))
    d, angle, rate = 1.0, rng.uniform(0.3, 2.8), rng.uniform(2, 6)
    pull = np.array([*rng.uniform(-9, 9, 2), 0.0])
    A, D = a * np.array([np.cos(angle), np.sin(angle)]), np.array([d, 0.0])
    B = closed(A, D, b, c)
    bodies, guess, ends = {}, {}, {"crank": (0 * A, A), "coupler": (A, B), "rocker": (D, B)}
    half = {name: float(np.linalg.norm(Q - P)) / 2 for name, (P, Q) in ends.items()}
    for name, (P, Q) in ends.items():
        m, inertia = 2 * half[name] * p.m, 2 * half[name] ** 3 / 3 * p.m * p.L**2
        theta = float(np.arctan2(*(Q - P)[::-1]))
        middle = np.array([*(P + Q) / 2, 0.0])
        if spatial:
            bodies[name] = mb.Body(name, m, (1e-2 * inertia, inertia, inertia), mb.Spatial())
            guess[f"{name}.rotation"] = turn @ mb.rotation((0, 0, 1), theta)
            middle = R @ middle
        else:
            bodies[name] = mb.Body(name, m, inertia)
            guess[f"{name}.theta"] = theta
        guess |= {f"{name}.{x}": float(v) for x, v in zip("xyz"[: 3 if spatial else 2], middle, strict=False)}

    def fixed(P: Vector):
        at = (R @ [*P, 0.0]) if spatial else P
        return ground.point(*(float(x) * p.L for x in at))

    def end(name: str, sign: int):
        return bodies[name].point(sign * half[name] * p.L, 0, *([0] if spatial else []))

    axis = {"axis": tuple(R[:, 2]), "axis_b": (0, 0, 1)} if spatial else {}
    foot = mb.Revolute("A", fixed(0 * A), end("crank", -1), **axis)
    pins = mb.Revolute("B", end("crank", 1), end("coupler", -1)), mb.Revolute("C", end("coupler", 1), end("rocker", 1))
    last = mb.Revolute("D", fixed(D), end("rocker", -1), **axis)
    gravity = mb.Gravity(*(R @ pull)) if spatial else mb.Gravity(*pull[:2])
    system = mb.System(*bodies.values(), foot, *pins, last, gravity, parameters=p)
    coupler = bodies["coupler"]
    place = (coupler.x, coupler.y, coupler.z) if spatial else (coupler.x, coupler.y)
    along = [sum(float(R[i, k]) * place[i] for i in range(3)) if spatial else place[k] for k in range(2)]
    # The crank's rotation is listed, so that both start alike whatever the size.
    held = {"crank.rotation": guess.pop("crank.rotation")} if spatial else {"crank.theta": guess.pop("crank.theta")}
    outputs = {"x": along[0], "y": along[1], "rate": foot.angle_rate}
    start = held | {"A.angle_rate": float(rate)}
    return mb.Scene(system, start, guess=guess, outputs=outputs, **_options("four-bar", coordinates))


def _cranks(seed: int, spatial: bool, coordinates: Any) -> mb.Scene:
    """A plate on three parallel cranks in a tilted plane, 11 rows of which are redundant, or the pendulum it equals."""
    rng = np.random.default_rng([seed, 4])
    p, ground = mb.Parameters(m=1.0, L=1.0), mb.Ground()
    tilt = _unit(rng), float(rng.uniform(-3, 3))
    turn, R = mb.rotation(tuple(tilt[0]), tilt[1]), Rotation.from_rotvec(tilt[0] * tilt[1]).as_matrix()
    length, crank, plate = rng.uniform((0.4, 0.3, 0.5), (0.8, 1.0, 2.0)).tolist()
    angle, rate = float(rng.uniform(-3, 3)), float(rng.uniform(-3, 3))
    pins, pull = rng.uniform(-1, 1, (3, 2)), np.array([*rng.uniform(-9, 9, 2), 0.0])
    inertia = crank * length**2 / 12 * p.m * p.L**2
    more = _options("cranks", coordinates)
    if not spatial:
        mass, arm = 3 * crank + plate, length * (1.5 * crank + plate) / (3 * crank + plate)
        whole = length**2 * (3 * crank / 3 + plate) - mass * arm**2
        bob = mb.Body("bob", mass * p.m, whole * p.m * p.L**2, com=(arm * p.L, 0))
        hinge = mb.Revolute("A0", ground.point(0, 0), bob.point(0, 0))
        system = mb.System(bob, hinge, mb.Gravity(*pull[:2]), parameters=p)
        tip = bob.point(length * p.L, 0)
        outputs = {"x": tip.x, "y": tip.y, "rate": bob.omega}
        return mb.Scene(system, {"bob.theta": angle, "bob.omega": rate}, outputs=outputs, **more)
    table = mb.Body("table", plate * p.m, tuple(0.1 * plate * p.m * p.L**2 for _ in range(3)), mb.Spatial())
    elements, guess = [table], {"table.rotation": turn}
    along = length * np.array([np.cos(angle), np.sin(angle), 0.0])
    guess |= {f"table.{c}": float(v) for c, v in zip("xyz", R @ along, strict=True)}
    for i, pin in enumerate(pins):
        foot, half = R @ [*pin, 0.0], length / 2 * p.L
        feet = ground.point(*(float(v) * p.L for v in foot))
        bar = mb.Body(f"c{i}", crank * p.m, (0.1 * inertia, inertia, inertia), mb.Spatial())
        over = table.point(*(float(v) * p.L for v in (*pin, 0.0)))
        low = mb.Revolute(f"A{i}", feet, bar.point(-half, 0, 0), axis=tuple(R[:, 2]), axis_b=(0, 0, 1))
        elements += [bar, low, mb.Revolute(f"B{i}", bar.point(half, 0, 0), over)]
        guess |= {f"c{i}.{c}": float(v) for c, v in zip("xyz", foot + R @ along / 2, strict=True)}
        guess[f"c{i}.rotation"] = turn @ mb.rotation((0, 0, 1), angle)
    start = {"c0.rotation": guess.pop("c0.rotation"), "A0.angle_rate": rate}
    system = mb.System(*elements, mb.Gravity(*(R @ pull)), parameters=p)
    place = (table.x, table.y, table.z)
    outputs = {name: sum(float(R[i, k]) * place[i] for i in range(3)) for k, name in enumerate("xy")}
    outputs["rate"] = elements[2].angle_rate
    return mb.Scene(system, start, guess=guess, outputs=outputs, **more)
