"""Accelerations in coordinates of joints against Pinocchio and MuJoCo, where they are installed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import symmb as mb

AXES = ((0, 0, 1), (1, 0, 0), (0, 1, 0))
CARRIERS = {"arm of 6": [*range(-1, 5)], "arm of 20": [*range(-1, 19)], "tree of 30": [(k - 1) // 2 for k in range(30)]}


def links(carriers):
    """For each link its carrier, hinge on the carrier, axis, mass, centre of mass from the hinge, and inertia."""
    rng = np.random.default_rng(7)
    for k, carrier in enumerate(carriers):
        hinge = rng.normal(size=3) * (carrier >= 0)
        yield carrier, hinge, AXES[k % 3], 1 + rng.random(), rng.normal(size=3), 0.1 + 0.05 * rng.random(3)


def accelerations(carriers, q, v):
    """By symmb."""
    ground, bodies, elements = mb.Ground(), [], [mb.Gravity(0, 0, -9.81)]
    for k, (carrier, hinge, axis, mass, com, inertia) in enumerate(links(carriers)):
        body = mb.Body(f"b{k}", mass, tuple(inertia), mb.Spatial(), com=tuple(com))
        on = ground.point(0, 0) if carrier < 0 else bodies[carrier].point(*hinge)
        elements += [body, mb.Revolute(f"j{k}", on, body.point(0, 0, 0), axis=axis)]
        bodies.append(body)
    system = mb.System(*elements).joint_space()
    order = [int(name[1 : name.index(".")]) for name in system.collected.q_names]
    found = np.empty(len(q))
    found[order] = mb.compile_dae(system).rhs(q[order], v[order], [], 0.0)[1].full().ravel()
    return found


def agrees(carriers, peer):
    """Accelerations are those of a peer at random states."""
    rng = np.random.default_rng(1)
    for _ in range(3):
        q, v = rng.normal(size=(2, len(carriers)))
        expected = peer(q, v)
        assert_allclose(accelerations(carriers, q, v), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.fixture(params=CARRIERS)
def carriers(request):
    return CARRIERS[request.param]


def test_pinocchio_s_articulated_bodies(carriers):
    pin = pytest.importorskip("pinocchio")
    model, joints = pin.Model(), []
    for carrier, hinge, axis, mass, com, inertia in links(carriers):
        turn, on = pin.JointModelRevoluteUnaligned(np.array(axis, float)), joints[carrier] if carrier >= 0 else 0
        joints.append(model.addJoint(on, turn, pin.SE3(np.eye(3), hinge), ""))
        model.appendBodyToJoint(joints[-1], pin.Inertia(mass, com, np.diag(inertia)), pin.SE3.Identity())
    at = [model.joints[j].idx_q for j in joints]

    def aba(q, v):
        q, v = (x[np.argsort(at)] for x in (q, v))
        return pin.aba(model, model.createData(), q, v, np.zeros(len(q)))[at]

    agrees(carriers, aba)


def test_mujoco_s_accelerations(carriers):
    mujoco = pytest.importorskip("mujoco")
    spec = mujoco.MjSpec()
    bodies = []
    for k, (carrier, hinge, axis, mass, com, inertia) in enumerate(links(carriers)):
        on = bodies[carrier] if carrier >= 0 else spec.worldbody
        body = on.add_body(name=f"b{k}", pos=hinge, mass=mass, ipos=com, inertia=inertia, explicitinertial=True)
        body.add_joint(name=f"j{k}", axis=axis)
        bodies.append(body)
    model = spec.compile()
    data = mujoco.MjData(model)
    at = [model.joint(f"j{k}").qposadr[0] for k in range(len(carriers))]

    def forward(q, v):
        data.qpos[at], data.qvel[at] = q, v
        mujoco.mj_forward(model, data)
        return data.qacc[at]

    agrees(carriers, forward)
