"""Random steady motions and states that are none, with their frequencies in closed form."""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

import symmb as mb

GROUND = mb.Ground()
G = 9.81


@dataclass(frozen=True)
class SteadyMotion:
    """A scene, eigenvalues that its linearisation must have [1/s], and whether its motion is steady."""

    name: str
    scene: mb.Scene
    eigenvalues: np.ndarray
    steady: bool = True


def random_motions(seed: int) -> Iterator[SteadyMotion]:
    """One motion of each kind."""
    rng = np.random.default_rng(seed)
    for make in (rolling_disc, sleeping_top, precessing_top, conical_pendulum, governor, orbit, swing, hanging):
        yield make(rng)


def rolling_disc(rng: np.random.Generator) -> SteadyMotion:
    """An upright disc that rolls along a line: A (A + m R^2) s^2 + C (C + m R^2) w^2 = A m g R."""
    R, m, w = rng.uniform(0.2, 1.5), rng.uniform(0.3, 4.0), rng.uniform(0.5, 8.0)
    A = m * R * R * rng.uniform(0.2, 0.45)
    disc = mb.Body("disc", m, (A, A, 2 * A), mb.Spatial())
    n = disc.rotation[:, 2]
    level = ca.sqrt(n[0] ** 2 + n[1] ** 2)
    arm = -R * ca.vertcat(-n[0] * n[2], -n[1] * n[2], level**2) / level
    slip = ca.vertcat(disc.vx, disc.vy, disc.vz) + ca.cross(disc.rotation @ disc.omega, arm)
    rolling = mb.VelocityConstraint("rolling", (slip[0], slip[1]))
    system = mb.System(disc, mb.Motion("contact", disc.z + arm[2], 0), rolling, mb.Gravity(0, 0, -G))
    heading = mb.rotation((0, 0, 1), rng.uniform(-3, 3))
    start = {"disc.x": 0.3, "disc.y": 0.0, "disc.omega": (0.0, 0.0, w)}
    start["disc.rotation"] = heading @ mb.rotation((1, 0, 0), np.pi / 2)
    root = np.emath.sqrt(-(2 * A * (2 * A + m * R * R) * w**2 - A * m * G * R) / (A * (A + m * R * R)))
    return SteadyMotion("rolling disc", mb.Scene(system, start, [0, 1], guess={"disc.z": R}), np.array([root, -root]))


def _top(rng, tilt: float, spin: float, precession: float, A: float, C: float, m: float, h: float) -> mb.Scene:
    top = mb.Body("top", m, (A - m * h * h, A - m * h * h, C), mb.Spatial())
    system = mb.System(top, mb.Spherical("tip", GROUND.point(0, 0, 0), top.point(0, 0, -h)), mb.Gravity(0, 0, -G))
    turned = mb.rotation((0, 0, 1), rng.uniform(-3, 3)) @ mb.rotation((1, 0, 0), tilt)
    start = {"top.rotation": turned, "top.omega": (0.0, precession * np.sin(tilt), spin)}
    coordinates = "joint" if not tilt else str(rng.choice(["joint", "body"]))
    return mb.Scene(system, start, [0.0, 1.0], coordinates=coordinates)


def _sizes(rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Moments of inertia about the tip across and along, the mass, and the height of its centre above the tip."""
    m, h = rng.uniform(0.3, 3.0), rng.uniform(0.1, 0.6)
    C = m * h * h * rng.uniform(0.3, 1.0)
    return m * h * h + C * rng.uniform(0.6, 0.9), C, m, h


def sleeping_top(rng: np.random.Generator) -> SteadyMotion:
    """An upright top: A r^2 - C w r + m g h = 0, in coordinates that turn with it."""
    A, C, m, h = _sizes(rng)
    w = rng.uniform(0.6, 2.5) * 2 * np.sqrt(A * m * G * h) / C
    rates = np.roots([A, -C * w, m * G * h])
    return SteadyMotion("sleeping top", _top(rng, 0.0, w, 0.0, A, C, m, h), 1j * (rates - w))


def precessing_top(rng: np.random.Generator) -> SteadyMotion:
    """Steady precession: the nutation oscillates in the effective potential of the tilt (Goldstein, sec. 5.7)."""
    A, C, m, h = _sizes(rng)
    tilt, precession = rng.uniform(0.3, 1.4), rng.uniform(0.3, 1.5) * np.sqrt(G / h)
    spin = (m * G * h + A * precession**2 * np.cos(tilt)) / (C * precession)
    a, b = A * precession * np.sin(tilt) ** 2 + C * spin * np.cos(tilt), C * spin

    def potential(angle: float) -> float:
        return (a - b * np.cos(angle)) ** 2 / (2 * A * np.sin(angle) ** 2) + m * G * h * np.cos(angle)

    bends = [(potential(tilt + d) - 2 * potential(tilt) + potential(tilt - d)) / d**2 for d in (1e-3, 2e-3)]
    scene = _top(rng, tilt, spin, precession, A, C, m, h)
    return SteadyMotion("precessing top", scene, np.array([1j * np.sqrt((4 * bends[0] - bends[1]) / 3 / A)]))


def conical_pendulum(rng: np.random.Generator) -> SteadyMotion:
    """A particle on a rod that circles: it oscillates at rate sqrt(1 + 3 cos^2) times that of the circles."""
    L, tilt = rng.uniform(0.2, 3.0), rng.uniform(0.2, 1.3)
    rate = np.sqrt(G / L / np.cos(tilt))
    p = mb.Body("p", rng.uniform(0.2, 5.0), pose=mb.Particle())
    system = mb.System(p, mb.Distance("rod", GROUND.point(0, 0, 0), p.point(0, 0, 0), L), mb.Gravity(0, 0, -G))
    phase, r = rng.uniform(-3, 3), L * np.sin(tilt)
    start = {"p.x": r * np.cos(phase), "p.y": r * np.sin(phase)}
    start |= {"p.vx": -rate * r * np.sin(phase), "p.vy": rate * r * np.cos(phase)}
    scene = mb.Scene(system, start, [0.0, 1.0], guess={"p.z": -L})
    return SteadyMotion("conical pendulum", scene, np.array([1j * rate * np.sqrt(1 + 3 * np.cos(tilt) ** 2)]))


def governor(rng: np.random.Generator) -> SteadyMotion:
    """A pendulum on a shaft that a drive turns evenly: it oscillates at about sin(angle) times its rate."""
    L, m, tilt = rng.uniform(0.2, 2.0), rng.uniform(0.3, 3.0), rng.uniform(0.3, 1.3)
    rate = np.sqrt(G / L / np.cos(tilt))
    shaft = mb.Body("shaft", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    J = m * (rng.uniform(0.05, 0.5) * L) ** 2
    ball = mb.Body("ball", m, (J, J, J), mb.Spatial())
    turn = mb.Revolute("turn", GROUND.point(0, 0, 0), shaft.point(0, 0, 0))
    swing = mb.Revolute("swing", shaft.point(0, 0, 0), ball.point(0, 0, L), axis=(0, 1, 0))
    system = mb.System(shaft, ball, turn, swing, mb.Motion("drive", turn.angle, rate * mb.t), mb.Gravity(0, 0, -G))
    coordinates = str(rng.choice(["joint", "body"]))
    scene = mb.Scene(system, {"swing.angle": -tilt}, [0.0, 1.0], coordinates=coordinates)
    return SteadyMotion("governor", scene, np.array([1j * rate * np.sin(tilt) / np.sqrt(1 + J / (m * L * L))]))


def orbit(rng: np.random.Generator) -> SteadyMotion:
    """A circular orbit under a force k / r^n: epicycles at rate sqrt(3 - n) times its own, and across it at its own."""
    k, r, n, m = rng.uniform(0.5, 5.0), rng.uniform(0.3, 2.0), rng.uniform(-0.9, 2.7), rng.uniform(0.2, 5.0)
    p = mb.Body("p", m, pose=mb.Particle())
    place = ca.vertcat(p.x, p.y, p.z)
    force = -k * place / ca.norm_2(place) ** (n + 1)
    plane = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rate = np.sqrt(k / m / r ** (n + 1))
    start = dict(zip(("p.x", "p.y", "p.z"), r * plane[0], strict=True))
    start |= dict(zip(("p.vx", "p.vy", "p.vz"), r * rate * plane[1], strict=True))
    scene = mb.Scene(mb.System(p, mb.Force("pull", p.point(0, 0, 0), force)), start, [0.0, 1.0])
    return SteadyMotion("orbit", scene, 1j * rate * np.array([np.sqrt(3 - n), 1.0]))


def swing(rng: np.random.Generator, angle: float | None = None) -> SteadyMotion:
    """A pendulum that is let go away from its equilibrium, beside a spring that has nothing to do with it."""
    angle = rng.choice([-1, 1]) * rng.uniform(0.15, 2.8) if angle is None else angle
    L = rng.uniform(0.3, 3.0)
    rod, other = mb.Body("rod", 1.0, L * L / 12), mb.Body("other", 1.0, pose=mb.Particle())
    k = 10.0 ** rng.uniform(0, 9)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(-L / 2, 0))
    rail = mb.PointOnLine("rail", GROUND.point(3, 0), other.point(0, 0), axis=(0, 1, 0))
    spring = mb.SpringDamper("spring", GROUND.point(3, 1), other.point(0, 0), k, 0.0, 1 - G / k)
    system = mb.System(rod, other, hinge, rail, spring, mb.Gravity(0, -G))
    scene = mb.Scene(system, {"rod.theta": angle - np.pi / 2, "other.y": 0.0}, [0.0, 1.0])
    return SteadyMotion("swing" if angle else "hanging", scene, np.array([1j * np.sqrt(1.5 * G / L)]), not angle)


def hanging(rng: np.random.Generator) -> SteadyMotion:
    """The same at rest."""
    return swing(rng, 0.0)
