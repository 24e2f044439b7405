"""The equations in coordinates of joints, against those in coordinates of bodies, Pinocchio and MuJoCo."""

import casadi as ca
import numpy as np
import pytest
from conftest import SMOOTH_MODELS, but_long
from numpy.testing import assert_allclose

import symmb as mb
from symmb.declare.mechanics import Flywheel

KINDS = ("Revolute", "Prismatic", "Cylindrical", "Screw", "Spherical", "Universal", "PlanarJoint", "Weld")
GROUND = mb.Ground()


def spatial_joint(rng, kind, name, a, b, tilted):
    """A joint of this kind with random axes between two points, which are exchanged half of the time."""
    a, b = (a, b) if rng.random() < 0.5 else (b, a)
    axes = {"axis": tilted(rng.normal(size=3)), "axis_b": tilted(rng.normal(size=3))} if kind != "Spherical" else {}
    more = {"pitch": 0.3} if kind == "Screw" else {}
    return getattr(mb, kind)(name, a, b, **axes, **more)


def tree(seed, planar, uncertain_axes=False):
    """A system of 2 to 7 bodies on a random tree of joints, some of them free, with forces of all kinds."""
    rng = np.random.default_rng(seed)
    p = mb.Parameters(m=1.3, l=0.7, e=0.1, f=-0.2)

    def tilted(axis):
        x, y, *z = axis
        return (x + p.e * y, y - p.f * x, *(c + p.e + p.f for c in z)) if uncertain_axes else (*axis,)

    elements, points = [mb.Gravity(0.3, -9.0, *([] if planar else [0.7]))], [GROUND.point(0.1, 0.2)]
    for k in range(rng.integers(2, 8)):
        com = rng.normal(size=2 if planar else 3) * 0.1
        inertia, pose = (0.2 + 0.1 * k, mb.Planar()) if planar else ((0.3, 0.25 + 0.1 * p.l, 0.2), mb.Spatial())
        body = mb.Body(f"b{k}", p.m * (1 + k), inertia, pose, com=tuple(com))

        def point(body=body):
            return body.point(*(x * p.l for x in rng.normal(size=2 if planar else 3)))

        at, own = points[rng.integers(len(points))], point()
        if rng.random() > 0.85:
            pass  # this body flies
        elif planar:
            a, b = (at, own) if rng.random() < 0.5 else (own, at)
            kind = rng.choice(["Revolute", "Prismatic", "Spherical", "Weld"])
            axes = [(*tilted(rng.normal(size=2)), 0) for _ in range(2)] if kind == "Prismatic" else []
            axes = dict(zip(("axis", "axis_b"), axes, strict=False))
            elements.append(getattr(mb, kind)(f"j{k}", a, b, **axes))
        else:
            elements.append(spatial_joint(rng, rng.choice(KINDS), f"j{k}", at, own, tilted))
        elements += [body, mb.SpringDamper(f"s{k}", own, GROUND.point(1, 2), 3.0, 0.4, 0.5)]
        points += [point(), point()]
    return mb.System(*elements, parameters=p)


def random_state(rng, system):
    """Coordinates and velocities of a system in joint space."""
    q = rng.normal(size=system.q.numel())
    names = system.collected.q_names
    for k, name in enumerate(names):
        if name.endswith(".e0"):
            q[k : k + 4] /= np.linalg.norm(q[k : k + 4])
    return q, rng.normal(size=system.v.numel())


def both(system):
    """The DAE of the bodies, that of the joints, and Functions between their states and accelerations."""
    joints = system.joint_space()
    q, v, s = joints.joints.of_bodies
    a = ca.SX.sym("a", joints.v.numel())
    rates = ca.jtimes(v, joints.q, joints.qdot) + ca.jtimes(v, joints.v, a)
    to_bodies = ca.Function("to_bodies", [joints.q, joints.v, joints.s, a, system.p], [q, v, s, ca.densify(rates)])
    to_joints = ca.Function("to_joints", [system.q, system.v, system.s, system.p], [*joints.joints.of_joints[:2]])
    return mb.compile_dae(system), joints, mb.compile_dae(joints), to_bodies, to_joints


@pytest.mark.parametrize("uncertain_axes", [False, True])
@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("seed", but_long(range(20), *range(8, 20)))
def test_trees_move_as_their_bodies_do(seed, planar, uncertain_axes):
    """Axes that depend on parameters are tilted to two corners of their box, in turns."""
    bodies, in_joints, joints, to_bodies, to_joints = both(tree(seed, planar, uncertain_axes))
    assert joints.Phi is None and joints.n_v == bodies.n_v - bodies.n_r
    rng, t = np.random.default_rng(seed), 0.0
    for corner in 4 * [(0.4, 0.1), (-0.2, -0.5)]:
        p = np.array([1.3, 0.7, *corner])
        q, v = random_state(rng, in_joints)
        a = joints.rhs(q, v, p, t)[1]
        q_b, v_b, s_b, a_b = (part.full() for part in to_bodies(q, v, [], a, p))
        at = (q_b, v_b, *([s_b] if bodies.n_s else []), p, t)
        if bodies.Phi is not None:
            assert_allclose(bodies.Phi(*at).full(), 0, atol=1e-12)
            assert_allclose(bodies.Phi_dot(*at).full(), 0, atol=1e-12)
        expected = bodies.rhs(*at)[1].full()
        assert_allclose(a_b, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        M, Q = joints.M(q, v, p, t).full(), joints.Q(q, v, p, t).full()
        assert_allclose(M @ a.full(), Q, rtol=0, atol=1e-10 * (np.abs(M) @ np.abs(a.full())).max())
        q_again, v_again, *_ = (part.full() for part in to_bodies(*to_joints(q_b, v_b, s_b, p), [], a, p))
        assert_allclose(v_again, v_b, rtol=0, atol=1e-11 * np.abs(v_b).max())
        assert_allclose(np.abs(q_again), np.abs(q_b), rtol=0, atol=1e-11 * np.abs(q_b).max())
        energies, expected = joints.energy(q, v, p, t), bodies.energy(*at)
        assert_allclose([float(e) for e in energies], [float(e) for e in expected], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_rotors_that_turn_with_joints_move_as_in_coordinates_of_bodies(seed):
    """A chain of hinges and slides with rotors, whose rows hold nothing but the rates of the joints."""
    rng = np.random.default_rng([58, seed])
    elements, carrier, rows = [mb.Gravity(0.3, -0.5, -9.81)], mb.Ground(), []
    for k in range(3):
        body = mb.Body(f"b{k}", rng.uniform(1, 2), tuple(rng.uniform(1, 2, 3)), mb.Spatial())
        kind = mb.Prismatic if k == 1 else mb.Revolute
        points = carrier.point(*rng.normal(size=3)), body.point(*rng.normal(size=3))
        points = points[::-1] if rng.uniform() < 0.5 else points
        joint = kind(f"j{k}", *points, axis=tuple(rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)]))
        rate = joint.displacement_rate if k == 1 else joint.angle_rate
        rotor = Flywheel(f"r{k}", 0.3, (0.4 + k,) * 3, mb.Spatial())
        bearing = mb.Revolute(f"f{k}", mb.Ground().point(0, 0, 0), rotor.point(0, 0, 0))
        rows.append(mb.VelocityConstraint(f"c{k}", (rotor.omega[2] - 2.5 * rate,)))
        elements += [body, joint, rotor, bearing, rows[-1]]
        carrier = body
    bodies, in_joints, joints, to_bodies, _ = both(mb.System(*elements))
    assert in_joints.G.nnz() == 2 * len(rows) and all(e.is_constant() for e in in_joints.G.nonzeros())
    q, v = random_state(rng, in_joints)
    at = np.array([joints.v_names.index(f"f{k}.angle_rate") for k in range(3)])
    of = [joints.v_names.index(f"j{k}.{'displacement' if k == 1 else 'angle'}_rate") for k in range(3)]
    v[at] = 2.5 * v[of]
    a = joints.rhs(q, v, [], 0.0)[1]
    q_b, v_b, _, a_b = (part.full() for part in to_bodies(q, v, [], a, []))
    expected = bodies.rhs(q_b, v_b, [], 0.0)[1].full()
    assert_allclose(a_b, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("model", SMOOTH_MODELS, ids=lambda m: getattr(m, "__name__", str(m)))
def test_models_move_as_their_bodies_do(model):
    scene = model.scene() if hasattr(model, "scene") else model()
    bodies, in_joints, joints, to_bodies, _ = both(scene.system)
    start = mb.DAESimulator(scene.with_times(scene.times[:1]), mb.DormandPrince()).start
    if start.rows is not None or not bodies.n_v:
        pytest.skip("constraints are redundant, or nothing moves")
    x = start.nominal()
    arguments = [scene.system.q, scene.system.v, scene.system.s, scene.system.p]
    measured = ca.Function("measured", arguments, list(in_joints.joints.of_joints))
    q, v, s = measured(x["q"], x["v"], x["s"], x["p"])
    a = joints.rhs(q, v, *([s] if joints.n_s else []), x["p"], start.t0)[1]
    q_b, v_b, _, a_b = (part.full().ravel() for part in to_bodies(q, v, s, a, x["p"]))
    expected = bodies.rhs(x["q"], x["v"], *([x["s"]] if bodies.n_s else []), x["p"], start.t0)[1].full().ravel()
    assert_allclose(np.abs(q_b), np.abs(x["q"]), rtol=0, atol=1e-10 * np.abs(q_b).max())
    assert_allclose(v_b, x["v"], rtol=0, atol=1e-10 * max(1e-3, np.abs(v_b).max()))
    assert_allclose(a_b, expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))


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
    bodies, elements = [], [mb.Gravity(0, 0, -9.81)]
    for k, (carrier, hinge, axis, mass, com, inertia) in enumerate(links(carriers)):
        body = mb.Body(f"b{k}", mass, tuple(inertia), mb.Spatial(), com=tuple(com))
        on = GROUND.point(0, 0) if carrier < 0 else bodies[carrier].point(*hinge)
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
