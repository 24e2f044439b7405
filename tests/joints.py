"""One example of every joint, with what theory says: the bodies it makes sense with and its number of rows."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

import symmb as mb
from symmb import compile_dae
from symmb.declare.mechanics.joint import Joint
from symmb.equations.model.dae import DAE

ORIENTED = {"Planar", "Spatial", "Ground"}
ANY = ORIENTED | {"Particle"}
SPATIAL = {"Spatial", "Ground"}
SKEW = (0.3, -0.5, 0.8)
OTHER = (0.4, -0.2, 0.6)
IN_PLANE = (0.6, 0.8, 0)


@dataclass(frozen=True)
class JointExample:
    """A joint as `make(point_a, point_b, **axes)`; axes in space, axes in the plane, and the rows theory gives it."""

    name: str
    make: Callable[..., Joint]
    spatial_rows: int
    planar_rows: int = 0
    a: frozenset[str] = frozenset(ORIENTED)
    b: frozenset[str] = frozenset(ORIENTED)
    axes: tuple[tuple[str, tuple[float, ...]], ...] = (("axis", SKEW), ("axis_b", OTHER))
    planar_axes: tuple[tuple[str, tuple[float, ...]], ...] = ()

    def admits(self, a: str, b: str) -> bool:
        return a in self.a and b in self.b and (a, b) != ("Ground", "Ground")

    def between(self, a: mb.Body | mb.Ground, b: mb.Body | mb.Ground) -> Joint:
        """The joint between points away from the centres of mass; its axes fit the bodies."""
        planar = any(isinstance(body, mb.Body) and isinstance(body.pose, mb.Planar) for body in (a, b))
        s_a, s_b = ((0.2, -0.1), (0.3, 0.4)) if planar else ((0.2, -0.1, 0.3), (0.3, 0.4, -0.2))
        return self.make("joint", a.point(*s_a), b.point(*s_b), **dict(self.planar_axes if planar else self.axes))


def _example(joint, spatial, planar=0, a=ORIENTED, b=ORIENTED, **more):
    return JointExample(joint.__name__, joint, spatial, planar, frozenset(a), frozenset(b), **more)


def _on_curve(name, a, b):
    return mb.PointOnCurve(name, a, b, mb.Curve(lambda s: (s, 0.1 * s**2), -4, 4))


_SLIDE = {"planar_axes": (("axis", IN_PLANE), ("axis_b", (0, 1, 0)))}
ALL_JOINTS = (
    _example(mb.Revolute, 5, 2),
    _example(mb.Prismatic, 5, 2, **_SLIDE),
    _example(mb.Cylindrical, 4, a=SPATIAL, b=SPATIAL),
    _example(mb.Spherical, 3, 2, a=ANY, b=ANY, axes=()),
    _example(mb.Universal, 4, a=SPATIAL, b=SPATIAL),
    _example(mb.PlanarJoint, 3, a=SPATIAL, b=SPATIAL),
    _example(mb.Weld, 6, 3),
    JointExample("Distance", partial(mb.Distance, length=0.9), 1, 1, frozenset(ANY), frozenset(ANY), axes=()),
    _example(mb.PointOnLine, 2, 1, b=ANY, axes=(("axis", SKEW),), planar_axes=(("axis", IN_PLANE),)),
    JointExample("PointOnCurve", _on_curve, 1, 1, frozenset(ORIENTED), frozenset(ANY), axes=()),
    JointExample("Gear", partial(mb.Gear, ratio=-1.5), 1, 1),
    JointExample("Screw", partial(mb.Screw, pitch=0.4), 5, 0, frozenset(SPATIAL), frozenset(SPATIAL)),
)
ALL_POSES = (mb.Planar, mb.Spatial, mb.Particle)
KINDS = ("Planar", "Spatial", "Particle", "Ground")


def make_body(kind: str, name: str) -> mb.Body | mb.Ground:
    """A body of a kind, or the ground."""
    if kind == "Ground":
        return mb.Ground()
    inertia = {"Planar": 0.7, "Spatial": (0.5, 0.8, 0.9), "Particle": 0.0}[kind]
    return mb.Body(name, mass=1.3, inertia=inertia, pose=getattr(mb, kind)())


def random_state(dae: DAE, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates, quaternions of unit length and turned by less than half a turn, and velocities."""
    q, v = rng.uniform(-1, 1, dae.n_q), rng.uniform(-1, 1, dae.n_v)
    for i, name in enumerate(dae.q_names):
        if name.endswith(".e0"):
            q[i : i + 4] = [1.0, *rng.uniform(-0.3, 0.3, 3)]
            q[i : i + 4] /= np.linalg.norm(q[i : i + 4])
    return q, v


def coast(dae: DAE, q: np.ndarray, v: np.ndarray, time: float) -> np.ndarray:
    """Coordinates after a time in which all velocities stay as they are, angular ones in body axes."""
    out, i, k = np.empty(dae.n_q), 0, 0
    while i < dae.n_q:
        if dae.q_names[i].endswith(".e0"):
            half = v[k : k + 3] * time / 2
            angle = np.linalg.norm(half)
            axis = np.sinc(angle / np.pi) * half
            w, u = q[i], q[i + 1 : i + 4]
            out[i : i + 4] = w * np.cos(angle) - u @ axis, *(w * axis + np.cos(angle) * u + np.cross(u, axis))
            i, k = i + 4, k + 3
        else:
            out[i] = q[i] + v[k] * time
            i, k = i + 1, k + 1
    return out


_NODES = np.arange(-4, 5)
_FIRST = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840
_SECOND = np.array([-9, 128, -1008, 8064, -14350, 8064, -1008, 128, -9]) / 5040


def derivative(f: Callable[[float], np.ndarray], order: int = 1, h: float = 0.005) -> np.ndarray:
    """First or second derivative of f at 0, central differences of eighth order."""
    values = np.array([f(k * h) for k in _NODES])
    return np.tensordot({1: _FIRST, 2: _SECOND}[order], values, 1) / h**order


def numbers(f: ca.Function, *arguments) -> np.ndarray:
    """A CasADi Function in NumPy arrays, columns as vectors."""
    value = np.asarray(f(*arguments).full())
    return value[:, 0] if value.shape[1] == 1 else value


def bundle(*elements, parameters: mb.Parameters | None = None) -> tuple[mb.System, DAE]:
    """A system and its compiled equations."""
    system = mb.System(*elements, parameters=parameters)
    return system, compile_dae(system)
