"""Every joint with every pose it admits: rows as many as theory says, derivatives equal to finite differences."""

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_JOINTS
from faults import refused
from joints import KINDS, bundle, coast, derivative, make_body, numbers, random_state
from numpy.testing import assert_allclose

import symmb as mb

PAIRS = [(a, b) for a in KINDS for b in KINDS if (a, b) != ("Ground", "Ground")]
ADMITTED = [pytest.param(j, a, b, id=f"{j.name}-{a}-{b}") for j in ALL_JOINTS for a, b in PAIRS if j.admits(a, b)]
REFUSED = [pytest.param(j, a, b, id=f"{j.name}-{a}-{b}") for j in ALL_JOINTS for a, b in PAIRS if not j.admits(a, b)]


def declared(joint, a, b):
    bodies = make_body(a, "a"), make_body(b, "b")
    return bundle(*bodies, joint.between(*bodies))


def arguments(dae, q, v, time=0.3):
    """(q, v[, s], p, t) with states where they start, so that no turn has been counted."""
    s = (numbers(dae.s_start, q, []),) if dae.n_s else ()
    return (q, v, *s, dae.p_nominal, time)


def assert_derivatives(system, dae, seed):
    """Phi_q, Phi_t, G and gamma of a system against differences of Phi at a random state."""
    rng = np.random.default_rng(seed)
    q, v = random_state(dae, rng)
    eye, at = np.eye(dae.n_q), arguments(dae, q, v)

    def Phi(q, time=0.3):
        return numbers(dae.Phi, q, *at[1:-1], time)

    columns = [derivative(lambda h, e=e: Phi(q + h * e)) for e in eye]
    assert_allclose(dae.Phi_q(*at).full(), np.transpose(columns), atol=1e-9)
    N = ca.Function("N", [system.q], [system.N])(q).full()
    assert_allclose(dae.G(*at).full(), dae.Phi_q(*at).full() @ N, atol=1e-13)
    Phi_t = derivative(lambda h: Phi(q, 0.3 + h))
    assert_allclose(numbers(dae.Phi_t, *at) if dae.Phi_t else 0 * Phi_t, Phi_t, atol=1e-9)

    def along(h):  # a motion with constant velocities: the second derivative of Phi is -gamma
        return Phi(coast(dae, q, v, h), 0.3 + h)

    assert_allclose(numbers(dae.Phi_dot, *at), derivative(along), atol=1e-9)
    assert_allclose(numbers(dae.gamma, *at), -derivative(along, 2), atol=2e-8)


@pytest.mark.parametrize(("joint", "a", "b"), ADMITTED)
def test_a_joint_has_the_rows_theory_gives_it_and_their_derivatives(joint, a, b):
    system, dae = declared(joint, a, b)
    assert_derivatives(system, dae, seed=1)
    # The other side of a planar body may leave the plane, so that all rows stay.
    expected = joint.planar_rows if {a, b} <= {"Planar", "Ground"} else joint.spatial_rows
    assert system.Phi.numel() == expected
    assert system.Phi_q.shape == (expected, system.q.numel())


@pytest.mark.parametrize(("joint", "a", "b"), REFUSED)
def test_bodies_that_make_no_sense_are_refused_by_name(joint, a, b):
    refused(rf"{joint.name} 'joint': body '[ab]' has .*, which cannot be used\. Use ", declared, joint, a, b)


@pytest.mark.parametrize("joint", ALL_JOINTS, ids=lambda j: j.name)
def test_both_points_on_one_body_or_on_the_ground_are_refused(joint):
    body = make_body("Spatial", "a")
    refused("both points are on body 'a'", bundle, body, joint.between(body, body))
    refused("both points are on the ground", bundle, body, joint.between(mb.Ground(), mb.Ground()))


@pytest.mark.parametrize(("joint", "a", "b"), ADMITTED)
def test_rows_are_independent_where_the_joint_is_assembled(joint, a, b):
    bodies = make_body(a, "a"), make_body(b, "b")
    guess = {f"{body.name}.x": 0.3 for body in bodies if body.name in "ab"}
    scene = mb.Scene(mb.System(*bodies, joint.between(*bodies)), guess=guess)
    simulator = mb.DAESimulator(scene, mb.DormandPrince())  # redundant rows would be an AssemblyError
    dae = simulator.dae
    (x,), _ = simulator.start.states(np.zeros((1, 0)))
    q = x[: dae.n_q]
    at = arguments(dae, q, np.zeros(dae.n_v))
    assert np.abs(numbers(dae.Phi, *at)).max() < 1e-12
    assert np.linalg.matrix_rank(dae.G(*at).full()) == dae.n_c


LAWS = {
    "polynomial": (mb.t**3 - 2 * mb.t, lambda t: t**3 - 2 * t),
    "harmonic": (ca.sin(3 * mb.t), lambda t: np.sin(3 * t)),
}


@pytest.mark.parametrize("law", LAWS)
def test_a_drive_of_any_position_expression(law):
    expression, value = LAWS[law]
    body, arm = make_body("Spatial", "a"), make_body("Planar", "b")
    driven = body.point(0.1, 0.2, 0.3).x * arm.theta + ca.sin(arm.y)
    system, dae = bundle(body, arm, mb.Motion("drive", driven, expression))
    assert system.Phi.numel() == 1
    assert_derivatives(system, dae, seed=2)
    at_rest = numbers(dae.Phi, np.eye(7 + 3)[3], np.zeros(9), [], 0.7)
    assert_allclose(at_rest, -value(0.7))


def test_a_drive_of_a_hinge_s_angle():
    ground, body = mb.Ground(), make_body("Spatial", "b")
    hinge = mb.Revolute("hinge", ground.point(0, 0, 0), body.point(0.3, 0, 0), axis=(1, 2, -1))
    system, dae = bundle(body, hinge, mb.Motion("drive", hinge.angle, mb.t**2))
    assert (dae.n_c, dae.n_s) == (6, 1)
    assert_derivatives(system, dae, seed=3)


def test_axes_may_contain_parameters():
    p = mb.Parameters(skew=0.1)
    a, b = make_body("Spatial", "a"), make_body("Spatial", "b")
    hinge = mb.Revolute("hinge", a.point(0, 0.1, 0), b.point(0.3, 0, 0), axis=(p.skew, 0, 1), axis_b=(0, 1, p.skew))
    system, dae = bundle(a, b, hinge, parameters=p)
    assert_derivatives(system, dae, seed=4)


def test_a_velocity_row_adds_to_G_and_gamma_but_not_to_Phi():
    """Skate: the velocity across the blade vanishes, -sin(theta) vx + cos(theta) vy = 0."""
    skate = make_body("Planar", "skate")
    across = -ca.sin(skate.theta) * skate.vx + ca.cos(skate.theta) * skate.vy
    system, dae = bundle(skate, mb.VelocityConstraint("blade", (across,)))
    assert (system.Phi.numel(), dae.n_r, dae.Phi) == (0, 1, None)
    q, v = np.array([0.3, -0.2, 0.7]), np.array([1.1, 0.4, -2.0])
    c, s = np.cos(0.7), np.sin(0.7)
    assert_allclose(dae.G(q, v, [], 0.0).full(), [[-s, c, 0]])
    assert_allclose(numbers(dae.gamma, q, v, [], 0.0), -v[2] * (-c * v[0] - s * v[1]))


FAULTS = [
    (
        lambda a, b: mb.Revolute("elbow", a, b, axis=(1, 0, 0)),
        "Planar",
        r"can turn about z only, but the axis is \(1, 0, 0\)",
    ),
    (
        lambda a, b: mb.Revolute("elbow", a, b, axis_b=(0, 1, 0)),
        "Planar",
        r"can turn about z only, but the axis is \(0, 1, 0\)",
    ),
    (lambda a, b: mb.Prismatic("elbow", a, b), "Planar", r"xy plane only, but the axis is \(0, 0, 1\)"),
    (lambda a, b: mb.PointOnLine("elbow", a, b), "Planar", r"needs an axis with z = 0, but the axis is \(0, 0, 1\)"),
    (lambda a, b: mb.Gear("elbow", a, b, axis=(0, 1, 0), ratio=2), "Planar", "can turn about z only"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis=(0, 0, 0)), "Spatial", "has no direction"),
    (lambda a, b: mb.Universal("elbow", a, b), "Spatial", "axis_b is missing"),
    (lambda a, b: mb.Distance("elbow", a, b, 0.0), "Spatial", "length is 0; it must be above 0.* Use Spherical"),
    (lambda a, b: mb.Distance("elbow", a, b, -1), "Spatial", "length is -1; it must be above 0"),
    (lambda a, b: mb.Revolute("elbow", a, "b"), "Spatial", "expected a point, got str"),
    (lambda a, b: mb.Revolute("elbow", a.body, b), "Spatial", r"expected a point, got Body\. Use body\.point"),
    (lambda a, b: mb.Screw("elbow", a, b, pitch="steep"), "Spatial", "pitch: 'steep' is not a number"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis=(0, 1)), "Planar", "can turn about z only"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis=(0, 1, 0, 0)), "Spatial", "elbow.* has 4 components"),
]


@pytest.mark.parametrize(("joint", "poses", "text"), FAULTS)
def test_faults_of_a_joint_name_it(joint, poses, text):
    a, b = make_body(poses, "a"), make_body(poses, "b")
    refused(f"'elbow'.*{text}|{text}", mb.System, a, b, joint(a.point(0, 0), b.point(0, 0)))
