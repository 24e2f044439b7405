"""Inverse dynamics: forces that given motions need, against Newton-Euler solutions of our own and of Pinocchio."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from machines import rods
from numpy.testing import assert_allclose

import symmb as mb
from models import stewart_platform
from models.stewart_platform import FEET, HEADS, MASS, PART, wanted_pose

TIGHT = mb.CVODES(rtol=1e-12)
GRAVITY = np.array([0, 0, -9.81])
N = 6


def links():
    """For each link its hinge on the carrier, axis, mass, centre of mass from the hinge, and inertia about it."""
    rng = np.random.default_rng(7)
    for k in range(N):
        axis, root = rng.normal(size=3), rng.normal(size=(3, 3))
        inertia = 0.05 * (np.trace(root @ root.T) * np.eye(3) - root @ root.T)  # of masses: it meets the triangle
        yield rng.normal(size=3) * (k > 0), axis / np.linalg.norm(axis), 1 + rng.random(), rng.normal(size=3), inertia


def motion(t, sin=np.sin, cos=np.cos):
    """Angles of the joints [rad], their rates and accelerations, (3, N) together."""
    rows = [(k * sin(2 * t + k) + cos(3 * t), 2 * k * cos(2 * t + k) - 3 * sin(3 * t)) for k in range(N)]
    return [q for q, _ in rows], [v for _, v in rows], [-4 * k * sin(2 * t + k) - 9 * cos(3 * t) for k in range(N)]


def arm(times, coordinates=None):
    """The arm whose joints follow the motion; the outputs are the torques of the motors."""
    elements, bodies = [mb.Gravity(*GRAVITY)], []
    for k, (hinge, axis, mass, com, inertia) in enumerate(links()):
        body = mb.Body(f"link{k}", mass, inertia, mb.Spatial(), com=tuple(com))
        end = bodies[-1].point(*hinge) if bodies else mb.Ground().point(0, 0, 0)
        joint = mb.Revolute(f"joint{k}", end, body.point(0, 0, 0), axis=tuple(axis))
        elements += [body, joint, mb.Motion(f"motor{k}", joint.angle, motion(mb.t, ca.sin, ca.cos)[0][k])]
        bodies.append(body)
    system = mb.System(*elements)
    torques = {f"torque{k}": -system.lam(f"motor{k}")[0] for k in range(N)}
    return mb.Scene(system, times=times, outputs=torques, coordinates=coordinates, name="arm")


def newton_euler(q, v, a):
    """Torques (N,) of the joints by the recursion of Luh, Walker and Paul (1980), in world axes."""
    R, omega, alpha, hinge, accelerated = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), -GRAVITY
    forward = []
    for k, (on_carrier, axis, mass, com, inertia) in enumerate(links()):
        s = R @ on_carrier
        hinge, accelerated = hinge + s, accelerated + np.cross(alpha, s) + np.cross(omega, np.cross(omega, s))
        u, skew = R @ axis, np.cross(axis, -np.eye(3))
        alpha = alpha + u * a[k] + np.cross(omega, u) * v[k]
        omega = omega + u * v[k]
        R = R @ (np.eye(3) + np.sin(q[k]) * skew + (1 - np.cos(q[k])) * skew @ skew)
        c, inertia = R @ com, R @ inertia @ R.T
        force = mass * (accelerated + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c)))
        moment = inertia @ alpha + np.cross(omega, inertia @ omega)
        forward.append((u, hinge, hinge + c, force, moment))
    f, n, torques, last = np.zeros(3), np.zeros(3), np.empty(N), np.zeros(3)
    for k in reversed(range(N)):
        u, hinge, center, force, moment = forward[k]
        n = n + np.cross(last - hinge, f) + np.cross(center - hinge, force) + moment
        f, last = f + force, hinge
        torques[k] = u @ n
    return torques


def pinocchio(q, v, a):
    """Torques (N,) of the joints by Pinocchio."""
    pin = pytest.importorskip("pinocchio")
    model, joint = pin.Model(), 0
    for hinge, axis, mass, com, inertia in links():
        joint = model.addJoint(joint, pin.JointModelRevoluteUnaligned(axis), pin.SE3(np.eye(3), hinge), "")
        model.appendBodyToJoint(joint, pin.Inertia(mass, com, inertia), pin.SE3.Identity())
    return pin.rnea(model, model.createData(), q, v, a)


@pytest.mark.parametrize("by, coordinates", [(newton_euler, "body"), (newton_euler, "joint"), (pinocchio, None)])
def test_torques_of_an_arm(by, coordinates):
    times = np.linspace(0, 1, 6)
    run = mb.simulate(arm(times, coordinates), TIGHT)
    expected = np.array([by(*np.array(motion(t))) for t in times])
    assert_allclose(run.values, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert not run.doubts


def moving_frames(leg_mass):
    """The Function t -> place, rotation, acceleration, omega and its rate of the platform, and of all parts of legs.

    The axis of a leg points from foot to head, and its first axis on the base stays at right angles to its second axis.
    """
    t = ca.SX.sym("t")
    middle, angle = wanted_pose(t)
    c, s = ca.cos(angle), ca.sin(angle)
    turn = ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
    frames, axes = [(middle, turn)], []
    for foot, head in zip(FEET, HEADS, strict=True):
        start = np.array([0, 0, stewart_platform.HEIGHT]) + head - foot
        first = np.array([-start[1], start[0], 0]) / np.hypot(*start[:2])
        along = middle + turn @ head - foot
        u = along / ca.norm_2(along)
        across = ca.cross(u, first)
        second = across / ca.norm_2(across)
        # In body axes the second one is at right angles to z and to the first one at the start.
        own = ca.horzcat(ca.cross(second, u), second, u)
        m = np.array([-first[1], first[0], 0])
        R = own @ np.column_stack([np.cross(m, [0, 0, 1]), m, [0, 0, 1]]).T
        frames += [(foot + PART / 2 * u, R), (middle + turn @ head - PART / 2 * u, R)]
        axes.append((u, ca.cross(first, second)))
    outputs = []
    for r, R in frames:
        spin = ca.jacobian(ca.vec(R), t)
        W = ca.reshape(spin, 3, 3) @ R.T
        omega = ca.vertcat(W[2, 1], W[0, 2], W[1, 0])
        outputs.append(ca.horzcat(r, R, ca.jacobian(ca.jacobian(r, t), t), omega, ca.jacobian(omega, t)))
    return ca.Function("frames", [t], [*outputs, ca.horzcat(*[ca.vertcat(*pair) for pair in axes])])


def leg_forces(time, frames, load, leg_mass):
    """Forces (6,) of the cylinders: balances of each leg about its foot, and of the platform, for forces on the heads.

    A universal joint bears a torque about the normal of its two axes only.
    """
    *parts, axes = (value.full() for value in frames(time))
    slender = np.diag([leg_mass * PART**2 / 12, leg_mass * PART**2 / 12, 0.01])

    def wrench(part, mass, inertia):
        r, R, a, omega, alpha = part[:, 0], part[:, 1:4], part[:, 4], part[:, 5], part[:, 6]
        turned = R @ inertia @ R.T
        return r, mass * (a - GRAVITY), turned @ alpha + np.cross(omega, turned @ omega)

    center, force, moment = wrench(parts[0], MASS + load, np.diag(stewart_platform.INERTIA))
    A, b = np.zeros((24, 24)), np.zeros(24)  # unknowns: forces on the legs at their heads, torques of the feet
    A[:6, :18] = np.vstack([np.tile(-np.eye(3), 6), np.zeros((3, 18))])
    b[:6] = np.concatenate([force, moment])
    inner = []
    for i in range(6):
        arm = parts[0][:, 1:4] @ HEADS[i]
        A[3:6, 3 * i : 3 * i + 3] = -_cross(arm)
        A[6 + 3 * i : 9 + 3 * i, 3 * i : 3 * i + 3] = _cross(center + arm - FEET[i])
        A[6 + 3 * i : 9 + 3 * i, 18 + i] = axes[3:, i] / np.linalg.norm(axes[3:, i])
        for k in (1, 2):
            r, f, n = wrench(parts[2 * i + k], leg_mass, slender)
            b[6 + 3 * i : 9 + 3 * i] += np.cross(r - FEET[i], f) + n
        inner.append(f)  # of the rod
    x = np.linalg.solve(A, b)
    return np.array([axes[:3, i] @ (inner[i] - x[3 * i : 3 * i + 3]) for i in range(6)])


def _cross(a):
    return np.cross(a, -np.eye(3))


@pytest.mark.parametrize("coordinates", ["body", "joint"])
def test_forces_of_a_stewart_platform_by_newton_and_euler(coordinates):
    scene = replace(stewart_platform.scene(prescribed=True, leg_mass=9.0), coordinates=coordinates)
    scene = scene.with_times(np.linspace(0, 1.3, 6))
    run = mb.simulate(scene, TIGHT, {"load": 130.0})
    frames = moving_frames(9.0)
    expected = np.array([leg_forces(t, frames, 130.0, 9.0) for t in scene.times])
    assert_allclose(run.values[:, 4:], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_bounds_of_the_torque_that_a_pendulum_needs():
    times, box = np.linspace(0, 1, 6), mb.Box(mass=(1.9, 2.1), length=(0.7, 0.9))
    machine = rods(1, lambda m: mb.Motion("motor", m.hinges[0].angle, 0.5 * mb.t**2), mass=2.0, length=0.8)
    scene = machine.scene({"torque": -machine.system.lam("motor")[0]}, times, box=box)
    bounds = mb.propagate(scene, mb.PolynomialChaos())

    def torque(m, length):
        return m * length**2 / 3 + m * 9.81 * length / 2 * np.sin(0.5 * times**2)

    assert_allclose(bounds["torque"], [torque(1.9, 0.7), torque(2.1, 0.9)], rtol=1e-6)
