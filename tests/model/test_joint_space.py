"""The equations in coordinates of joints against textbooks, and against those in coordinates of bodies."""

import casadi as ca
import numpy as np
import pytest
import sympy
from conftest import SMOOTH_MODELS, but_long
from mechanisms import double_pendulum
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
        if planar:
            body = mb.Body(f"b{k}", p.m * (1 + k), 0.2 + 0.1 * k, mb.Planar(), com=(*com, 0))
        else:
            body = mb.Body(f"b{k}", p.m * (1 + k), (0.3, 0.25 + 0.1 * p.l, 0.2), mb.Spatial(), com=tuple(com))

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


def test_the_double_pendulum_is_the_textbook_s():
    """Lagrange's equations of two rods in their relative angles."""
    parts = double_pendulum().system.joint_space().to_sympy("M", "Q")
    names = ("l1", "l2", "shoulder_angle", "elbow_angle", "shoulder_angle_rate", "elbow_angle_rate")
    symbols = {s.name.replace(".", "_"): s for e in parts.values() for s in e.free_symbols}
    l1, l2, a, b, wa, wb = (symbols[name] for name in names)
    g, half = sympy.Float(9.81), sympy.Rational(1, 2)
    heights = -l1 / 2 * sympy.cos(a), -l1 * sympy.cos(a) - l2 / 2 * sympy.cos(a + b)
    places = (l1 / 2 * sympy.sin(a), heights[0]), (l1 * sympy.sin(a) + l2 / 2 * sympy.sin(a + b), heights[1])
    q, v = (a, b), (wa, wb)
    spins, masses, inertias = (wa, wa + wb), (l1, l2), (l1**3 / 12, l2**3 / 12)
    T = sum(
        half * m * sum(sum(x.diff(c) * w for c, w in zip(q, v, strict=True)) ** 2 for x in place) + half * J * w**2
        for m, J, place, w in zip(masses, inertias, places, spins, strict=True)
    )
    V = sum(m * g * y for m, y in zip(masses, heights, strict=True))
    M = sympy.Matrix(2, 2, lambda i, j: T.diff(v[i], v[j]))
    Q = [T.diff(q[i]) - V.diff(q[i]) - sum(T.diff(v[i], q[j]) * v[j] for j in range(2)) for i in range(2)]
    assert (parts["M"] - M).applyfunc(sympy.simplify) == sympy.zeros(2, 2)
    assert sympy.simplify(sympy.nsimplify(parts["Q"] - sympy.Matrix(Q), rational=True)) == sympy.zeros(2, 1)


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
