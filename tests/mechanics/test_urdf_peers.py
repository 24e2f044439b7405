"""Accelerations and motions of machines from URDF files against Pinocchio, where it is installed."""

from pathlib import Path
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import symmb as mb

FILES = Path(__file__).parents[1] / "data" / "urdf"
TIMES = np.linspace(0.0, 2.0, 11)
START = {
    "branch": {
        "turntable": (0.4, 1.0), "left_shoulder": (-0.8, -0.5), "left_wrist": (0.6, 2.0), "right_shoulder": (2.0, 0.3),
    },
    "gantry": {"travel": (0.3, 0.5), "tilt": (0.5, -1.0), "lift": (-0.1, 0.2)},
    "gripper": {"wrist": (0.7, 1.5), "left_slide": (0.03, 0.05)},
    "four_bar": {"a": (0.9, 2.0)},
    "satellite": {"hinge": (0.5, -0.4), "boom": (0.2, 0.1)},
}  # fmt: skip
"""Values and rates of the free joints, which are the file's own."""


class Peer:
    """A file in Pinocchio, with the damping and the friction that stand in it."""

    def __init__(self, pin, name):
        self.pin, path = pin, str(FILES / f"{name}.urdf")
        free = [pin.JointModelFreeFlyer()] if name == "satellite" else []
        self.model = pin.buildModelFromUrdf(path, *free)
        self.data = self.model.createData()
        self.names = [joint for joint in self.model.names if joint in {*START[name], "b", "c", *FOLLOWERS[name]}]
        self.at = {joint: self.model.joints[self.model.getJointId(joint)].idx_v for joint in self.names}
        self.damping, self.friction = np.zeros(self.model.nv), np.zeros(self.model.nv)
        for joint in ElementTree.parse(path).iter("joint"):
            for dynamics in joint.iter("dynamics"):
                self.damping[self.at[joint.get("name")]] = float(dynamics.get("damping", 0))
                self.friction[self.at[joint.get("name")]] = float(dynamics.get("friction", 0))

    def torques(self, v):
        u = v / 0.01
        size = np.sqrt(u**2 + 1e-8)
        return -self.damping * v - self.friction * np.tanh(4 * size) / size * u

    def rows(self, q, v):
        """What the mechanism has beyond the tree: Jacobian (n, n_v) and right side (n,) of J v' = c."""
        return np.zeros((0, self.model.nv)), np.zeros(0)

    def accelerations(self, q, v):
        pin, model, data = self.pin, self.model, self.data
        J, c = self.rows(q, v)
        free = self.torques(v) - pin.rnea(model, data, q, v, np.zeros(model.nv))
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        n = len(c)
        K = np.block([[M, J.T], [J, np.zeros((n, n))]])
        return np.linalg.solve(K, np.concatenate([free, c]))[: model.nv]

    def motion(self, q, v, times):
        """Coordinates (n_t, n_q) of Pinocchio."""
        n = self.model.nq

        def rate(t, y):
            q, v = y[:n].copy(), y[n:]
            return np.concatenate([self.rate(q, v), self.accelerations(q, v)])

        start = np.concatenate([q, v])
        return solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-12).y[:n].T

    def rate(self, q, v):
        """Rates of coordinates: those of a free base are in its own axes, those of continuous joints cos and sin."""
        rates = np.empty(self.model.nq)
        for joint in list(self.model.joints)[1:]:
            at, own = joint.idx_q, v[joint.idx_v : joint.idx_v + joint.nv]
            if joint.nq == 7:
                x, y, z, w = e = q[at + 3 : at + 7]
                e /= np.linalg.norm(e)
                rates[at : at + 3] = self.pin.Quaternion(e).matrix() @ own[:3]
                a, b, c = own[3:]
                turned = [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c]
                rates[at + 3 : at + 7] = np.divide(turned, 2)
            elif joint.nq == 2:
                rates[at : at + 2] = -q[at + 1] * own[0], q[at] * own[0]
            else:
                rates[at] = own[0]
        return rates

    def place(self, q, link):
        """Position (3,) of the origin of a link."""
        self.pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.model.getFrameId(link)].translation.copy()


FOLLOWERS = {name: {} for name in START} | {"gripper": {"right_slide": (1.0, 0.0), "thumb_hinge": (-12.0, 0.25)}}
"""Joints that follow `left_slide`, with multiplier and offset."""


class Gripper(Peer):
    def rows(self, q, v):
        J = np.zeros((2, self.model.nv))
        for row, (joint, (factor, _)) in zip(J, FOLLOWERS["gripper"].items(), strict=True):
            row[self.at[joint]], row[self.at["left_slide"]] = 1.0, -factor
        return J, np.zeros(2)


PIN_AT, ON_ROCKER = np.array([0.6, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])


class FourBar(Peer):
    def rows(self, q, v):
        """The x and z of a point of the rocker stand still."""
        pin, model, data = self.pin, self.model, self.data
        frame = model.getFrameId("rocker")
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        a = pin.getFrameAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        u = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        arm = data.oMf[frame].rotation @ ON_ROCKER
        of_point = J[:3] - np.cross(arm, J[3:], axisa=0, axisb=0).T @ np.eye(J.shape[1])
        drift = a.linear + np.cross(u.angular, u.linear) + np.cross(a.angular, arm)
        drift += np.cross(u.angular, np.cross(u.angular, arm))
        return of_point[[0, 2]], -drift[[0, 2]]


def peer_of(name):
    pin = pytest.importorskip("pinocchio")
    return {"gripper": Gripper, "four_bar": FourBar}.get(name, Peer)(pin, name)


def scene_of(name, times=TIMES):
    robot = mb.load_urdf(FILES / f"{name}.urdf", fixed_base=name != "satellite")
    joints, moving = robot.joints, {}
    for j, (value, rate) in START[name].items():
        moving |= {f"{j}.{joints[j].coordinate}": value, f"{j}.{joints[j].coordinate}_rate": rate}
    start, guess, more = robot.start | moving, {}, []
    if name == "four_bar":
        pin = mb.Ground().point(*PIN_AT)
        more = [mb.PointOnLine("loop", pin, robot.bodies["rocker"].point(*ON_ROCKER), axis=(0, 1, 0))]
        guess, start = {"b.angle": 0.3, "c.angle": 0.8}, moving
    if name == "satellite":
        start |= {"hull.vx": 0.2, "hull.vz": 0.5, "hull.omega": (0.3, -0.2, 0.6)}
    outputs = {j: getattr(joint, joint.coordinate) for j, joint in joints.items()}
    outputs |= {f"{j}_rate": getattr(joint, f"{joint.coordinate}_rate") for j, joint in joints.items()}
    system = mb.System(*robot.elements, *more, mb.Gravity(0, 0, -9.81))
    last = robot.bodies[{"satellite": "hull", "branch": "tip"}.get(name, list(robot.bodies)[-1])]
    outputs |= {axis: getattr(last.point(0, 0, 0), axis) for axis in "xyz"}
    return mb.Scene(system, start, times, outputs, guess=guess), robot, last


def pin_state(peer, name, run, robot):
    """Coordinates and velocities of Pinocchio at the start of a run of symmb."""
    pin, model = peer.pin, peer.model
    step, v = np.zeros(model.nv), np.zeros(model.nv)
    for joint in peer.names:
        step[peer.at[joint]], v[peer.at[joint]] = run[joint][0], run[f"{joint}_rate"][0]
    q = pin.integrate(model, pin.neutral(model), step)
    if name == "satellite":
        hull = robot.bodies["hull"]
        R, origin = np.array(run(ca.vec(hull.rotation)))[0].reshape(3, 3).T, hull.point(0, 0, 0)
        q[:3], q[3:7] = run(origin.r)[0], pin.Quaternion(R).coeffs()
        v[:3], v[3:6] = R.T @ run(origin.velocity)[0], [0.3, -0.2, 0.6]
    return q, v


@pytest.mark.parametrize("name", START)
def test_accelerations(name):
    peer = peer_of(name)
    scene, robot, _ = scene_of(name, TIMES[:1])
    rates = {j: scene.system.ddt(getattr(joint, f"{joint.coordinate}_rate")) for j, joint in robot.joints.items()}
    run = mb.simulate(scene.with_outputs(scene.outputs | {f"{j}_acceleration": rate for j, rate in rates.items()}))
    expected = peer.accelerations(*pin_state(peer, name, run, robot))
    found = [run[f"{joint}_acceleration"][0] for joint in peer.names]
    wanted = np.array([expected[peer.at[joint]] for joint in peer.names])
    assert_allclose(found, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("name", START)
def test_two_seconds_of_motion(name):
    peer = peer_of(name)
    scene, robot, last = scene_of(name)
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-12))
    Q = peer.motion(*pin_state(peer, name, run, robot), TIMES)
    places = [peer.place(q, last.name) for q in Q]
    assert_allclose(np.stack([run[axis] for axis in "xyz"], axis=1), places, rtol=0, atol=1e-8)
    for joint in peer.names:
        at = peer.model.joints[peer.model.getJointId(joint)]
        if at.nq == 1:
            assert_allclose(run[joint], Q[:, at.idx_q], rtol=0, atol=1e-8)
        else:
            turned = np.stack([np.cos(run[joint]), np.sin(run[joint])], axis=1)
            assert_allclose(turned, Q[:, at.idx_q : at.idx_q + 2], rtol=0, atol=1e-8)
