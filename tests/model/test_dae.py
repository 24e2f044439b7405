"""The bundle: each Function is there only if the scene needs it, and they fit together."""

import numpy as np
import pytest
from joints import numbers, random_state
from mechanisms import double_pendulum, spinning_body
from numpy.testing import assert_allclose

import symmb as mb


@pytest.mark.parametrize(("scene", "p"), [(double_pendulum, [1.1, 0.7]), (spinning_body, [1.2, 0.1])])
def test_the_functions_fit_together(scene, p):
    dae = mb.compile_dae(scene().system)
    rng = np.random.default_rng(3)
    q, v = random_state(dae, rng)
    at = (q, v, p, 0.3)
    M, G, Q, gamma = (f(*at).full() for f in (dae.M, dae.G, dae.Q, dae.gamma))
    assert np.linalg.eigvalsh(M).min() > 0
    qdot, vdot = (x.full() for x in dae.rhs(*at))
    a, lam = (x.full() for x in dae.forward(*at, gamma))
    assert_allclose(a, vdot, atol=1e-12)
    assert_allclose(M @ a + G.T @ lam, Q, atol=1e-11)
    assert_allclose(G @ a, gamma, atol=1e-11)
    right = rng.uniform(-1, 1, dae.n_r)
    delta = numbers(dae.min_norm_correction, *at, right)
    assert_allclose(G @ delta, right, atol=1e-12)
    inverse = np.linalg.inv(M)  # the least of all such displacements in the norm of M
    assert_allclose(delta, inverse @ G.T @ np.linalg.solve(G @ inverse @ G.T, right), atol=1e-11)
    T, _ = dae.energy(*at)
    assert_allclose(float(T), 0.5 * v @ M @ v)
    assert_allclose(dae.Phi_q(*at).full() @ qdot[:, 0], numbers(dae.Phi_dot, *at), atol=1e-13)
    h = 1e-6
    assert_allclose((numbers(dae.retract, q, h * v) - q) / h, qdot[:, 0], atol=1e-5)
    assert_allclose(numbers(dae.retract, q, np.zeros(dae.n_v)), q, atol=1e-15)


def test_sizes_and_names():
    dae = mb.compile_dae(double_pendulum().system)
    assert (dae.n_q, dae.n_v, dae.n_s, dae.n_c, dae.n_r) == (6, 6, 0, 4, 4)
    assert dae.rows == {"shoulder": slice(0, 2), "elbow": slice(2, 4)}
    assert dae.p_names == ("l1", "l2")
    assert (dae.Phi_t, dae.power, dae.s_start) == (None, None, None)


def test_the_paper_s_double_pendulum_is_solved_in_few_instructions():
    """Range space by LDL' keeps the count low: the dense KKT matrix takes over a thousand."""
    assert mb.compile_dae(double_pendulum().system).rhs.n_instructions() < 300


def test_instructions_grow_with_the_number_of_bodies_not_its_cube():
    def chain(n):
        rods = [mb.Body(f"rod{i}", 1.0, 1 / 12, mb.Planar()) for i in range(n)]
        anchors = [mb.Ground().point(0, 0), *(rod.point(0, -0.5) for rod in rods)]
        hinges = [mb.Revolute(f"hinge{i}", anchors[i], rod.point(0, 0.5)) for i, rod in enumerate(rods)]
        return mb.compile_dae(mb.System(*rods, *hinges, mb.Gravity(0, -9.81))).rhs.n_instructions() / n

    assert chain(40) < 1.3 * chain(5)


def test_retraction_keeps_quaternions_at_unit_length():
    dae = mb.compile_dae(spinning_body().system)
    q, v = random_state(dae, np.random.default_rng(4))
    assert_allclose(np.linalg.norm(numbers(dae.retract, q, 0.3 * v)[3:]), 1, rtol=1e-15)


@pytest.mark.parametrize("rows", [[1, 0], [0.0, 1.0, 1.0], np.array([1, 0], dtype=np.int8)], ids=repr)
def test_rows_to_keep_are_a_set(rows):
    """In any order, and as numbers of any kind."""
    system = double_pendulum().system
    assert mb.compile_dae(system, rows).row_names == ("shoulder.lam[0]", "shoulder.lam[1]")


@pytest.mark.parametrize("rows, nullities", [([4], (0, 0)), ([0.5], (0, 0)), ([np.nan], (0, 0)), ([0], (0.5, 0))])
def test_rows_and_nullities_that_do_not_exist_are_refused(rows, nullities):
    with pytest.raises(mb.DeclarationError, match=r"compile_dae: (there is no constraint row|a nullity must be)"):
        mb.compile_dae(double_pendulum().system, rows, nullities)
