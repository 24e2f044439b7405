"""Laws and masses as expressions: of coordinates, velocities, parameters and time, in SX or SymPy."""

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from joints import bundle, numbers
from numpy.testing import assert_allclose

import symmb as mb

P = mb.Parameters(m=2.0, l=0.5, k=30.0)


def rod():
    return mb.Body("rod", P.m * P.l, P.m * P.l**3 / 12, mb.Planar())


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
    anchor = mb.Ground().point(0, 0)
    stiffness, damping, length = 10 + body.theta**2, 2 * mb.t, 0.1 * body.vx
    element = mb.SpringDamper("s", anchor, body.point(0, 0), stiffness, damping, length)
    d, rate = Q[:2], V[:2]
    distance = np.hypot(*d)
    pull = (10 + 0.49) * (distance - 0.1) + 1.2 * (d @ rate) / distance
    assert_allclose(forces(body, element), [*(-pull * d / distance), 0], atol=1e-13)


def test_a_spring_with_a_law_of_state_or_time_has_no_potential():
    body = rod()
    anchor = mb.Ground().point(0, 0)
    for law, conservative in ((P.k, True), (P.k * (1 + mb.t), False), (P.k + body.x, False), (P.k + body.vx, False)):
        system, _ = bundle(body, mb.Spring("s", anchor, body.point(0, 0), law), parameters=P)
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
        lambda b: mb.Spring("s", mb.Ground().point(0, 0), b.point(0, 0.1), k * (1 + theta**2), l / 3),
        lambda b: mb.Spring("s", mb.Ground().point(0, 0), b.point(0, 0.1), P.k * (1 + b.theta**2), P.l / 3),
    ),
    "torque": (lambda b: mb.Torque("t", b, sp.exp(-t) * vy), lambda b: mb.Torque("t", b, ca.exp(-mb.t) * b.vy)),
}


@pytest.mark.parametrize("element", SAME)
def test_sympy_laws_are_the_same_as_casadi_laws(element):
    in_sympy, in_casadi = SAME[element]
    first, second = rod(), rod()
    assert_allclose(forces(first, in_sympy(first)), forces(second, in_casadi(second)), rtol=1e-14)


def test_masses_and_drives_may_be_sympy():
    body = mb.Body("rod", m * l, m * l**3 / 12, mb.Planar())
    system, dae = bundle(body, mb.Motion("drive", theta, sp.sin(3 * t)), parameters=P)
    assert_allclose(dae.M(Q, V, dae.p_nominal, T).full(), np.diag([1.0, 1.0, 2 * 0.125 / 12]))
    assert_allclose(numbers(dae.Phi, Q, V, dae.p_nominal, T), 0.7 - np.sin(1.8))
    assert system.parts == ("M", "Q", "Phi", "Phi_q", "Phi_t", "gamma")


def test_principal_inertias_and_matrices_may_be_expressions():
    body = mb.Body("b", P.m, [[P.m, 0.1, 0], [0.1, P.m * P.l, 0], [0, 0, P.k]], mb.Spatial())
    _, dae = bundle(body, parameters=P)
    neutral = [0, 0, 0, 1, 0, 0, 0]
    assert_allclose(dae.M(neutral, np.zeros(6), P.nominal, 0).full()[3:, 3:], [[2, 0.1, 0], [0.1, 1, 0], [0, 0, 30]])
    body = mb.Body("b", P.m, (P.m, m * l, 3), mb.Spatial())
    _, dae = bundle(body, parameters=P)
    assert_allclose(dae.M(neutral, np.zeros(6), P.nominal, 0).full()[3:, 3:], np.diag([2.0, 1.0, 3.0]))
