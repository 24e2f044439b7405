"""A planar and a spatial scene whose equations of motion are also written down by hand, for solvers to agree on."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

G = 9.81
TIMES = np.linspace(0.0, 1.5, 7)


def double_pendulum(times=TIMES, **more):
    """Two rods of 1 kg/m on hinges, y upwards, angles from the downward vertical; p = (l1, l2)."""
    p = mb.Parameters(l1=1.0, l2=0.8)
    rod1 = mb.Body("rod1", p.l1, p.l1**3 / 12, mb.Planar())
    rod2 = mb.Body("rod2", p.l2, p.l2**3 / 12, mb.Planar())
    shoulder = mb.Revolute("shoulder", mb.Ground().point(0, 0), rod1.point(0, p.l1 / 2))
    elbow = mb.Revolute("elbow", rod1.point(0, -p.l1 / 2), rod2.point(0, p.l2 / 2))
    system = mb.System(rod1, rod2, shoulder, elbow, mb.Gravity(0, -G), parameters=p)
    start = {"rod1.theta": 0.9, "rod2.theta": -0.4, "rod1.omega": 1.0, "rod2.omega": -2.0}
    outputs = {"theta1": rod1.theta, "theta2": rod2.theta, "omega1": rod1.omega, "omega2": rod2.omega}
    return mb.Scene(system, start, times, outputs, name="double pendulum", **more)


def double_pendulum_by_hand(p, times=TIMES):
    """(n_t, 4) angles and rates from Lagrange's equations in the two angles."""
    l1, l2 = p

    def rate(_, z):
        a, b, wa, wb = z
        coupling = l2 * l1 * l2 / 2
        M = np.array([[l1**3 / 3 + l2 * l1**2, coupling * np.cos(a - b)], [coupling * np.cos(a - b), l2**3 / 3]])
        f = np.array([
            -coupling * np.sin(a - b) * wb**2 - (l1**2 / 2 + l2 * l1) * G * np.sin(a),
            coupling * np.sin(a - b) * wa**2 - l2**2 / 2 * G * np.sin(b),
        ])  # fmt: skip
        return [wa, wb, *np.linalg.solve(M, f)]

    return exact(rate, [0.9, -0.4, 1.0, -2.0], times)


J = np.array([0.02, 0.029, 0.01])
ARM = np.array([0.0, 0.0, 0.4])


def spinning_body(times=TIMES, **more):
    """A body on a ball joint 0.4 (1 + c) m below its centre of mass, spinning and tilted; p = (m, c)."""
    p = mb.Parameters(m=1.5, c=0.0)
    top = mb.Body("top", p.m, tuple(J), mb.Spatial())
    tip = mb.Spherical("tip", mb.Ground().point(0, 0), top.point(0, 0, -0.4 * (1 + p.c)))
    system = mb.System(top, tip, mb.Gravity(0, 0, -G), parameters=p)
    tilt = mb.rotation((0, 1, 0), 0.5)
    outputs = {c: getattr(top, c) for c in "xyz"} | {f"w{c}": top.omega[i] for i, c in enumerate("xyz")}
    start = {"top.rotation": tilt, "top.omega": (0.2, -0.5, 15.0)}
    return mb.Scene(system, start, times, outputs, name="spinning body", **more)


def spinning_body_by_hand(p, times=TIMES):
    """(n_t, 6) centre of mass and angular velocity in body axes from Euler's equations about the tip."""
    m, c = p
    arm = ARM * (1 + c)
    J_tip = np.diag(J) + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))

    def rotation(e):
        w, u = e[0], e[1:]
        cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
        return (w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * cross

    def rate(_, z):
        e, w = z[:4] / np.linalg.norm(z[:4]), z[4:]
        torque = np.cross(arm, rotation(e).T @ [0, 0, -m * G])
        spin = np.linalg.solve(J_tip, torque - np.cross(w, J_tip @ w))
        return [*(0.5 * np.hstack([-e[1:] @ w, e[0] * w + np.cross(e[1:], w)])), *spin]

    z = exact(rate, [np.cos(0.25), 0, np.sin(0.25), 0, 0.2, -0.5, 15.0], times)
    return np.array([[*(rotation(row[:4] / np.linalg.norm(row[:4])) @ arm), *row[4:]] for row in z])


def exact(rate, start, times):
    """States (n_t, n) of x' = rate(t, x) from a start."""
    return solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-13).y.T


def swing(k, times, angle=0.0, rate=0.0):
    """(n_t, 2) angle and rate of a pendulum, angle'' = -k cos(angle)."""
    return exact(lambda _, z: (z[1], -k * np.cos(z[0])), (angle, rate), times)


@dataclass(frozen=True)
class Mechanism:
    """A scene and its motion by hand."""

    scene: object
    by_hand: object
    nominal: tuple[float, ...]


PLANAR = Mechanism(double_pendulum, double_pendulum_by_hand, (1.0, 0.8))
MECHANISMS = {"planar": PLANAR, "spatial": Mechanism(spinning_body, spinning_body_by_hand, (1.5, 0.0))}


def explosion(times=None):
    """v' = a v^2 from v = 1: finite until t = 1/a."""
    p = mb.Parameters(a=1.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Force("push", ball.point(0, 0), (p.a * ball.vx**2, -ball.y)))
    start, times = {"ball.vx": 1.0, "ball.y": 1.0}, np.linspace(0, 2, 21) if times is None else times
    return mb.Scene(system, start, times, {"v": ball.vx, "y": ball.y}, name="explosion")


def four_bar(pose, shift=0.0):
    """Parallel four-bar linkage on hinges about z, which is redundant in space."""
    inertia = 0.1 if isinstance(pose, mb.Planar) else (0.1, 0.1, 0.1)
    ground = mb.Ground()
    left, coupler, right = (mb.Body(name, 1.0, inertia, pose) for name in ("left", "coupler", "right"))
    return mb.System(
        left, coupler, right,
        mb.Revolute("A", ground.point(0, 0), left.point(0, -0.5)),
        mb.Revolute("B", left.point(0, 0.5), coupler.point(-1, 0)),
        mb.Revolute("C", coupler.point(1, 0), right.point(0, 0.5)),
        mb.Revolute("D", ground.point(2 + shift, 0), right.point(0, -0.5)),
        mb.Gravity(0, -G),
    )  # fmt: skip
