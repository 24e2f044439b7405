"""Forces against virtual work, balance of forces and moments, dissipation, and laws of any kind."""

import warnings

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from faults import refused
from joints import bundle, derivative, make_body, numbers, random_state
from machines import GROUND, run_of
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import symmb as mb

POSES = ("Planar", "Spatial", "Particle")


def free_body(kind, name):
    """A body whose moments of inertia are equal, so that no gyroscopic torque stands among the forces."""
    return make_body(kind, name) if kind != "Spatial" else mb.Body(name, 1.3, (0.7, 0.7, 0.7), mb.Spatial())


def planar(a, b):
    return any(isinstance(body, mb.Body) and isinstance(body.pose, mb.Planar) for body in (a, b))


def points(a, b):
    ends = ((0.2, -0.1), (0.5, 0.4)) if planar(a, b) else ((0.2, -0.1, 0.3), (0.5, 0.4, -0.2))
    return a.point(*ends[0]), b.point(*ends[1])


def axis_of(a, b):
    return (0, 0, 1) if planar(a, b) else (0.3, -0.5, 0.8)


def normal_of(a, b):
    return (0.6, 0.8, 0) if planar(a, b) else (0.3, -0.5, 0.8)


def sides_of(a, b, size=1):
    return np.multiply(size, (0.4, 0.3) if planar(a, b) else (0.4, 0.3, 0.35))


HERTZ = mb.HuntCrossley(30.0, 1.0, 1.0)
LINEAR = mb.KelvinVoigt(30.0)
LOSSY = mb.HuntCrossley(30.0, 0.9, 5.0)
SLIP, STICK = mb.Coulomb(0.3, 0.1), mb.Bristle(0.3, 10.0, 1.0)

CONSERVATIVE = {
    "gravity": lambda a, b: mb.Gravity(1.0, -9.81),
    "spring": lambda a, b: mb.Spring("s", *points(a, b), 30.0, 0.4),
    "spring of length 0": lambda a, b: mb.Spring("s", *points(a, b), 30.0),
    "bushing": lambda a, b: mb.Bushing("s", *points(a, b), (10.0, 20.0, 40.0)),
    "contact": lambda a, b: mb.Contact("s", *points(a, b), normal_of(a, b), HERTZ, radius=4.0),
    "bush contact": lambda a, b: mb.BushContact("s", *points(a, b), axis_of(a, b), 0.05, HERTZ),
    "tooth contact": lambda a, b: mb.ToothContact("s", *points(a, b), normal_of(a, b), 0.02, LINEAR),
    "soil": lambda a, b: mb.Soil("s", *points(a, b)[::-1], normal_of(a, b), LINEAR, 7.0),
    "circle contact": lambda a, b: mb.CircleContact("s", *points(a, b), 2.0, 1.5, HERTZ),
    "circle in a circle": lambda a, b: mb.CircleContact("s", *points(a, b), 0.3, 0.2, HERTZ, inside=True),
    "slot contact": lambda a, b: mb.SlotContact("s", *points(a, b), normal_of(a, b), 0.1, 0.2, 0.1, HERTZ),
    "sphere contact": lambda a, b: mb.SphereContact("s", *points(a, b), 2.0, 1.5, HERTZ),
    "box and sphere": lambda a, b: mb.BoxContact("s", points(a, b)[0], sides_of(a, b), points(a, b)[1], HERTZ, 4.0),
    "point in a box": lambda a, b: mb.BoxContact("s", points(a, b)[0], sides_of(a, b, 20), points(a, b)[1], HERTZ),
    "box on a plane": lambda a, b: mb.BoxContact(
        "s", points(a, b)[0], sides_of(a, b), b.point(*np.multiply(4, normal_of(a, b))), HERTZ, normal=normal_of(a, b)
    ),
    "rope": lambda a, b: mb.Rope("s", [*points(a, b), GROUND.point(0.1, 0.3), a.point(0.1, 0.3)], 30.0, 0.1),
}
PAIRS = [
    *(("Planar", b) for b in ("Planar", "Ground")),
    *(("Spatial", b) for b in ("Spatial", "Particle", "Ground")),
    *(("Particle", b) for b in ("Particle", "Spatial", "Ground")),
    *(("Ground", b) for b in POSES),
]


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
@pytest.mark.parametrize("force", CONSERVATIVE)
def test_a_conservative_force_is_minus_the_slope_of_its_potential(force, kinds):
    a, b = (free_body(kind, name) for kind, name in zip(kinds, "ab", strict=True))
    system, dae = bundle(a, b, CONSERVATIVE[force](a, b))
    q, v = random_state(dae, np.random.default_rng(5))
    V = ca.Function("V", [system.q], [system.potential_energy])
    slope = [derivative(lambda h, e=e: numbers(V, q + h * e))[0] for e in np.eye(dae.n_q)]
    N = ca.Function("N", [system.q], [system.N])(q).full()
    Q = numbers(dae.Q, q, v, [], 0.0)
    assert np.abs(Q).max() > 0.1
    assert_allclose(Q, -N.T @ slope, atol=1e-8)


@pytest.mark.parametrize("kind", ["Planar", "Spatial"])
def test_a_torsion_spring_turns_its_bodies_back(kind):
    """Bodies turned about a common axis, by 0.2 and by 1.1; the spring is without load at 0.25."""
    a, b = free_body(kind, "a"), free_body(kind, "b")
    axis = np.array(axis_of(a, b)) / np.linalg.norm(axis_of(a, b))
    _, dae = bundle(a, b, mb.TorsionSpring("s", a, b, 3.0, 0.0, 0.25, axis=tuple(3 * axis)))

    def turned(angle):
        return [0.1, 0.2, angle] if kind == "Planar" else [0.1, 0.2, 0.3, np.cos(angle / 2), *np.sin(angle / 2) * axis]

    q = np.array([*turned(0.2), *turned(1.1)])
    s = (numbers(dae.s_start, q, []),) if dae.n_s else ()
    at = (q, np.zeros(dae.n_v), *s, [], 0.0)
    torque = -3.0 * (0.9 - 0.25)
    expected = torque * (axis[2:] if kind == "Planar" else axis)
    Q = numbers(dae.Q, *at).reshape(2, -1)
    n = len(expected)
    assert_allclose(Q[1], [*np.zeros(dae.n_v // 2 - n), *expected], atol=1e-12)
    assert_allclose(Q[0], -Q[1], atol=1e-12)
    assert_allclose(float(dae.energy(*at)[1]), 0.5 * 3.0 * (0.9 - 0.25) ** 2)


INTERNAL = {
    "spring": lambda a, b: mb.Spring("s", *points(a, b), 30.0, 0.4),
    "spring of length 0": lambda a, b: mb.Spring("s", *points(a, b), 30.0),
    "damper": lambda a, b: mb.Damper("s", *points(a, b), 4.0),
    "spring and damper": lambda a, b: mb.SpringDamper("s", *points(a, b), 30.0, 4.0, 0.4),
    "spring of length 0 and damper": lambda a, b: mb.SpringDamper("s", *points(a, b), 30.0, 4.0),
    "bushing": lambda a, b: mb.Bushing("s", *points(a, b), (10.0, 20.0, 40.0), (1.0, 2.0, 3.0), (5.0, 6.0, 7.0), 0.5),
    "torsion spring": lambda a, b: mb.TorsionSpring("s", a, b, 3.0, 0.4, 0.2, axis=axis_of(a, b)),
    "contact": lambda a, b: mb.Contact("s", *points(a, b), normal_of(a, b), LOSSY, 4.0, SLIP),
    "sticking contact": lambda a, b: mb.Contact("s", *points(a, b), normal_of(a, b), LOSSY, 4.0, STICK),
    "bush contact": lambda a, b: mb.BushContact("s", *points(a, b), axis_of(a, b), 0.05, LOSSY),
    "tooth contact": lambda a, b: mb.ToothContact("s", *points(a, b), normal_of(a, b), 0.02, LOSSY),
    "torsion contact": lambda a, b: mb.TorsionContact("s", a, b, 0.02, LINEAR, axis=axis_of(a, b)),
    "circle contact": lambda a, b: mb.CircleContact("s", *points(a, b), 2.0, 1.5, LOSSY, SLIP),
    "sphere contact": lambda a, b: mb.SphereContact("s", *points(a, b), 2.0, 1.5, LOSSY, STICK),
    "box and sphere": lambda a, b: mb.BoxContact(
        "s", points(a, b)[0], sides_of(a, b), points(a, b)[1], LOSSY, 4.0, friction=SLIP
    ),
    "taut rope": lambda a, b: mb.Rope("s", [*points(a, b), a.point(0, 0), b.point(0, 0)], 30.0, 0.1, 2.0),
    "friction": lambda a, b: mb.Friction("s", *points(a, b), normal_of(a, b), 5.0, mb.Coulomb(0.3, 0.1)),
    "nonlinear spring": lambda a, b: mb.NonlinearSpring("s", *points(a, b), lambda d, v: 3 * d**2 + v),
    "soil": lambda a, b: mb.Soil("s", *points(a, b), normal_of(a, b), mb.KelvinVoigt(30.0, 2.0), 7.0, 1.0, 2.0, 0.5),
}


def wrenches(dae, system, q, v):
    """Force and torque about the centre of mass of every body in world axes, from Q."""
    s = (numbers(dae.s_start, q, []),) if dae.n_s else ()
    Q = numbers(dae.Q, q, v, *s, [], 0.0)
    out, at, at_q = [], 0, 0
    for body in system.bodies:
        R, n = ca.Function("R", [system.q], [body.rotation])(q).full(), 6 if isinstance(body.pose, mb.Spatial) else 3
        f = Q[at : at + n]
        r = np.array([*q[at_q : at_q + 2], 0 if isinstance(body.pose, mb.Planar) else q[at_q + 2]])
        if isinstance(body.pose, mb.Planar):
            out.append((r, np.array([f[0], f[1], 0]), np.array([0, 0, f[2]])))
        else:
            out.append((r, f[:3], R @ f[3:] if n == 6 else np.zeros(3)))
        at, at_q = at + n, at_q + (7 if n == 6 else 3)
    return out


@pytest.mark.parametrize("kind", ["Planar", "Spatial"])
@pytest.mark.parametrize("force", INTERNAL)
def test_internal_forces_balance_in_force_and_moment(force, kind):
    a, b = free_body(kind, "a"), free_body(kind, "b")
    system, dae = bundle(a, b, INTERNAL[force](a, b))
    rng = np.random.default_rng(6)
    for _ in range(3):
        q, v = random_state(dae, rng)
        loads = wrenches(dae, system, q, v)
        assert max(np.abs(np.concatenate(load[1:])).max() for load in loads) > 0.05
        assert_allclose(sum(f for _, f, _ in loads), 0, atol=1e-12)
        assert_allclose(sum(np.cross(r, f) + tau for r, f, tau in loads), 0, atol=1e-12)


@pytest.mark.parametrize("length", [0, 0.4])
def test_forces_between_particles_point_along_their_line(length):
    a, b = free_body("Particle", "a"), free_body("Particle", "b")
    _, dae = bundle(a, b, mb.SpringDamper("s", a.point(0, 0), b.point(0, 0), 30.0, 4.0, length))
    q, v = random_state(dae, np.random.default_rng(7))
    Q = numbers(dae.Q, q, v, [], 0.0)
    d, rate = q[3:] - q[:3], v[3:] - v[:3]
    distance = np.linalg.norm(d)
    pull = 30 * (distance - length) + 4 * (d @ rate) / distance
    assert_allclose(Q, pull / distance * np.hstack([d, -d]), atol=1e-12)


def test_a_spring_of_length_0_and_its_damper_are_finite_where_the_points_meet():
    a = free_body("Particle", "a")
    system, dae = bundle(a, mb.SpringDamper("s", GROUND.point(0, 0), a.point(0, 0), 30.0, 4.0))
    slopes = ca.Function("slopes", [system.q, system.v], [ca.jacobian(system.Q, ca.vertcat(system.q, system.v))])
    assert_allclose(numbers(dae.Q, np.zeros(3), np.ones(3), [], 0.0), 0)
    assert_allclose(slopes(np.zeros(3), np.ones(3)).full()[:, :3], -30 * np.eye(3))


@pytest.mark.parametrize("force", ["spring", "bushing", "damper"])
def test_a_force_out_of_the_plane_of_a_planar_body_is_refused(force):
    a, b = free_body("Planar", "a"), free_body("Spatial", "b")
    told = r"'s': force along z acts out of the plane of planar body 'a'\. Leave it out"
    refused(told, mb.System, a, b, INTERNAL[force](a, b))


DAMPERS = {
    "damper": INTERNAL["damper"],
    "bushing": lambda a, b: mb.Bushing("s", *points(a, b), 0.0, (1.0, 2.0, 3.0), 0.0, (0.5, 0.6, 0.7)),
    "torsion spring": lambda a, b: mb.TorsionSpring("s", a, b, 0.0, 0.4, axis=axis_of(a, b)),
}


@pytest.mark.parametrize("kind", ["Planar", "Spatial"])
@pytest.mark.parametrize("force", DAMPERS)
def test_dampers_take_power_out(force, kind):
    a, b = free_body(kind, "a"), free_body(kind, "b")
    system, dae = bundle(a, b, DAMPERS[force](a, b))
    rng = np.random.default_rng(8)
    for _ in range(5):
        q, v = random_state(dae, rng)
        if force == "torsion spring" and kind == "Spatial":
            q[10:14] = q[3:7]  # its axis is common to both bodies
        s = (numbers(dae.s_start, q, []),) if dae.n_s else ()
        power = v @ numbers(dae.Q, q, v, *s, [], 0.0)
        assert power < 0
        assert_allclose(float(dae.power(q, v, *s, [], 0.0, [])), power)
    if force == "damper":
        pa, pb = points(a, b)
        rate = ca.Function("rate", [system.q, system.v], [mb.ddt(ca.norm_2(pb.r - pa.r))])
        assert_allclose(power, -4.0 * float(rate(q, v)) ** 2)


def test_a_bushing_resists_by_the_sine_of_the_angle_about_each_axis():
    b = free_body("Spatial", "b")
    _, dae = bundle(b, mb.Bushing("s", GROUND.point(0, 0), b.point(0, 0), 0.0, 0.0, (3.0, 5.0, 7.0)))
    for unit, stiffness in zip(np.eye(3), (3.0, 5.0, 7.0), strict=True):
        q = [0, 0, 0, np.cos(0.3), *np.sin(0.3) * unit]
        torque = -stiffness * np.sin(0.6) * unit
        assert_allclose(numbers(dae.Q, q, np.zeros(6), [], 0.0)[3:], torque, atol=1e-14)


def test_gyroscopic_torques_of_a_spatial_body():
    J = np.array([[0.5, 0.1, 0.0], [0.1, 0.8, -0.2], [0.0, -0.2, 0.9]])
    body = mb.Body("b", 1.0, J, mb.Spatial())
    _, dae = bundle(body)
    omega = np.array([1.0, -2.0, 0.5])
    Q = numbers(dae.Q, [0, 0, 0, 1, 0, 0, 0], np.hstack([np.zeros(3), omega]), [], 0.0)
    assert_allclose(Q, np.hstack([np.zeros(3), -np.cross(omega, J @ omega)]))
    assert_allclose(dae.M(np.zeros(7), np.zeros(6), [], 0.0).full()[3:, 3:], J)


@pytest.mark.parametrize("write", [list, tuple, np.array, ca.DM, lambda values: ca.vertcat(*values)])
def test_vectors_are_written_in_any_way(write):
    body = mb.Body("b", 1.0, (1.0, 2.0, 3.0), mb.Spatial())
    load = mb.Force("f", body.point(0, 0, 0), write([1.0, -2.0, 3.0]))
    _, dae = bundle(body, load, mb.Torque("t", body, write([4.0, 5.0, -6.0])))
    assert_allclose(numbers(dae.Q, [0, 0, 0, 1.0, 0, 0, 0], np.zeros(6), [], 0.0), [1, -2, 3, 4, 5, -6])
    _, dae = bundle(body, mb.Torque("t", body, body.x * ca.DM([4.0, 5.0, -6.0])))
    assert_allclose(numbers(dae.Q, [2.0, 0, 0, 1.0, 0, 0, 0], np.zeros(6), [], 0.0)[3:], [8, 10, -12])


@pytest.mark.parametrize(
    ("angle", "stiffness", "doubted"),
    [(0.45, 2.0, False), (0.55, 2.0, True), (3.5, (0, 0, 1.0), True), (2.0, 0.0, False)],
)
def test_a_bushing_that_turns_far_is_doubted(angle, stiffness, doubted):
    body = mb.Body("body", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0, 0), body.point(0, 0, 0))
    mount = mb.Bushing("mount", GROUND.point(0, 0, 0), body.point(0, 0, 0), 5.0, 0.0, stiffness, 0.0)
    with warnings.catch_warnings(record=True, action="always") as found:
        run_of(body, hinge, mount, start={"hinge.angle": angle})
    told = "Bushing 'mount': the mount turns by more than 0.5 rad at t = 0 s"
    assert any(told in str(w.message) for w in found) == doubted


# Torsion springs and backlash between axes that do not stay parallel.

MAKE = {
    "spring": lambda a, b, axis: mb.TorsionSpring("t", a, b, 5.0, angle=0.3, axis=axis),
    "backlash": lambda a, b, axis: mb.TorsionContact("t", a, b, 0.2, mb.KelvinVoigt(50.0), axis=axis),
}
CARRIED = {
    "Spherical": lambda b: [mb.Spherical("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3))],
    "Universal": lambda b: [mb.Universal("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3), (1, 0, 0), axis_b=(0, 1, 0))],
    "hinge about another axis": lambda b: [mb.Revolute("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3), axis=(1, 0, 1))],
    "PointOnLine": lambda b: [mb.PointOnLine("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3), axis=(1, 0, 0))],
    "free": lambda b: [],
}
TURNS = {"Universal": {"b.omega_x": 0.7, "b.omega_y": 1.1}, "hinge about another axis": {"j.angle_rate": 1.5}}


@pytest.mark.parametrize("carried", CARRIED)
@pytest.mark.parametrize("kind", MAKE)
def test_energy_is_conserved_between_axes_that_tilt(kind, carried):
    b = mb.Body("b", 1.0, (0.1, 0.2, 0.15), mb.Spatial())
    start, element = TURNS.get(carried, {"b.omega": (0.5, 0.4, 1.6)}), MAKE[kind](GROUND, b, (0.2, -0.1, 1.0))
    run = run_of(b, *CARRIED[carried](b), element, start=start, times=np.linspace(0, 2, 21))
    assert run.energy_drift < 1e-6
    assert not run.doubts


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", MAKE)
def test_the_torque_is_the_slope_of_the_energy_of_the_twist(kind, seed):
    """The twist of a rotation vector r is 2 atan2 of its quaternion's part along the axis and its scalar part."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turned = [Rotation.from_rotvec(rng.normal(size=3) * 0.7) for _ in range(2)]
    a, b = (mb.Body(name, 1.0, (0.4, 0.4, 0.4), mb.Spatial()) for name in "ab")
    _, dae = bundle(a, b, MAKE[kind](a, b, tuple(axis)))

    def energy(small):
        of_b = turned[1] * Rotation.from_rotvec(small)
        x, y, z, w = (turned[0].inv() * of_b).as_quat()
        twist = 2 * np.arctan2(np.dot((x, y, z), axis), w)
        twist -= 2 * np.pi * np.round(twist / (2 * np.pi))
        return 2.5 * (twist - 0.3) ** 2 if kind == "spring" else 25 * max(abs(twist) - 0.1, 0) ** 2

    quaternions = [np.roll(rotation.as_quat(), 1) for rotation in turned]
    q = np.concatenate([[0, 0, 0], quaternions[0], [0.3, 0.1, 0], quaternions[1]])
    s = numbers(dae.s_start, q, [])
    Q = numbers(dae.Q, q, np.zeros(12), s, [], 0.0)
    h = 1e-6
    slope = [(energy(h * e) - energy(-h * e)) / (2 * h) for e in np.eye(3)]
    assert_allclose(Q[9:], -np.array(slope), atol=1e-7)
    assert_allclose(turned[0].apply(Q[3:6]), -turned[1].apply(Q[9:]), atol=1e-12)
    assert np.abs(Q[9:]).max() > 0.1 or (kind == "backlash" and energy(np.zeros(3)) == 0)
    assert_allclose(float(dae.energy(q, np.zeros(12), s, [], 0.0)[1]), energy(np.zeros(3)))


# Laws and masses as expressions: of coordinates, velocities, parameters and time, in SX or SymPy.

P = mb.Parameters(m=2.0, l=0.5, k=30.0)


def rod():
    return mb.Body("rod", P.m * P.l, P.m * P.l**3 / 12, mb.Planar())


ANCHOR = GROUND.point(0, 0)
Q, V, T = np.array([0.3, -0.4, 0.7]), np.array([1.0, 2.0, -3.0]), 0.6


def forces(*elements):
    _, dae = bundle(*elements, parameters=P)
    return numbers(dae.Q, Q, V, dae.p_nominal, T)


def test_a_force_follows_its_law_of_state_parameters_and_time():
    body = rod()
    law = (P.k * body.x * ca.sin(2 * mb.t), -body.vy * ca.fabs(body.vy) + body.theta)
    fx, fy = 30.0 * 0.3 * np.sin(1.2), -4.0 + 0.7
    s, c = np.sin(0.7), np.cos(0.7)
    tz = (0.5 * c - 0.1 * s) * fy - (0.5 * s + 0.1 * c) * fx
    assert_allclose(forces(body, mb.Force("f", body.point(P.l, 0.1), law)), [fx, fy, tz])


def test_stiffness_damping_and_length_follow_their_laws():
    body = rod()
    element = mb.SpringDamper("s", ANCHOR, body.point(0, 0), 10 + body.theta**2, 2 * mb.t, 0.1 * body.vx)
    d, rate = Q[:2], V[:2]
    distance = np.hypot(*d)
    pull = (10 + 0.49) * (distance - 0.1) + 1.2 * (d @ rate) / distance
    assert_allclose(forces(body, element), [*(-pull * d / distance), 0], atol=1e-13)


def test_a_spring_with_a_law_of_state_or_time_has_no_potential():
    body = rod()
    for law, conservative in ((P.k, True), (P.k * (1 + mb.t), False), (P.k + body.x, False), (P.k + body.vx, False)):
        system, _ = bundle(body, mb.Spring("s", ANCHOR, body.point(0, 0), law), parameters=P)
        assert (ca.sparsify(system.potential_energy).nnz() > 0) == conservative
        assert (ca.sparsify(system.power).nnz() == 0) == conservative


def test_gravity_may_change_with_time():
    body = rod()
    assert_allclose(forces(body, mb.Gravity(mb.t, -9.81 * P.l)), [0.6, -9.81 * 0.5, 0])


def test_a_law_that_is_only_lifted_into_space_gives_world_torques():
    body = mb.Body("b", 1.0, (1.0, 2.0, 3.0), mb.Spatial())
    _, dae = bundle(body, mb.Torque("t", body, (1.0, 2 * mb.t, 0)))
    half = np.sqrt(0.5)  # a quarter turn about z: the world's x is the body's -y, the world's y the body's x
    Q = numbers(dae.Q, [0, 0, 0, half, 0, 0, half], np.zeros(6), [], 0.25)
    assert_allclose(Q, [0, 0, 0, 0.5, -1.0, 0], atol=1e-15)


x, theta, vy, t, k, m, l = sp.symbols("rod.x rod.theta rod.vy t k m l")  # noqa: E741
SAME = {
    "force": (
        lambda b: mb.Force("f", b.point(0.1, 0.2), (k * x * sp.sin(2 * t), sp.Abs(vy) + theta)),
        lambda b: mb.Force("f", b.point(0.1, 0.2), (P.k * b.x * ca.sin(2 * mb.t), ca.fabs(b.vy) + b.theta)),
    ),
    "spring": (
        lambda b: mb.Spring("s", ANCHOR, b.point(0, 0.1), k * (1 + theta**2), l / 3),
        lambda b: mb.Spring("s", ANCHOR, b.point(0, 0.1), P.k * (1 + b.theta**2), P.l / 3),
    ),
    "torque": (lambda b: mb.Torque("t", b, sp.exp(-t) * vy), lambda b: mb.Torque("t", b, ca.exp(-mb.t) * b.vy)),
}


@pytest.mark.parametrize("element", SAME)
def test_sympy_laws_are_the_same_as_casadi_laws(element):
    in_sympy, in_casadi = SAME[element]
    body = rod()
    assert_allclose(forces(body, in_sympy(body)), forces(body, in_casadi(body)), rtol=1e-14)


def test_masses_and_drives_may_be_sympy():
    body = mb.Body("rod", m * l, m * l**3 / 12, mb.Planar())
    system, dae = bundle(body, mb.Motion("drive", theta, sp.sin(3 * t)), parameters=P)
    assert_allclose(dae.M(Q, V, dae.p_nominal, T).full(), np.diag([1.0, 1.0, 2 * 0.125 / 12]))
    assert_allclose(numbers(dae.Phi, Q, V, dae.p_nominal, T), 0.7 - np.sin(1.8))
    assert system.parts == ("M", "Q", "Phi", "Phi_q", "Phi_t", "gamma")


def test_principal_inertias_and_matrices_may_be_expressions():
    matrix = [[P.m, 0.1, 0], [0.1, P.m * P.l, 0], [0, 0, P.k]]
    known = [[2, 0.1, 0], [0.1, 1, 0], [0, 0, 30]]
    for inertia, expected in ((matrix, known), ((P.m, m * l, 3), np.diag([2.0, 1.0, 3.0]))):
        _, dae = bundle(mb.Body("b", P.m, inertia, mb.Spatial()), parameters=P)
        assert_allclose(dae.M([0, 0, 0, 1, 0, 0, 0], np.zeros(6), P.nominal, 0).full()[3:, 3:], expected)
