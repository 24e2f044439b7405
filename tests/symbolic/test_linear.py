"""Singular symmetric systems against NumPy's pseudo-inverse, and explicit solutions against LAPACK."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from symmb.declare.symbolic.linear import (
    ExplicitSolver,
    independent,
    least_multipliers,
    saddle_solver,
    singular_solver,
    vanishing_rows,
)


def rows_of_rank(n: int, nullity: int, seed: int, off: float = 0.0) -> np.ndarray:
    """Rows (n, 2 n) of which so many combinations vanish, or almost do, in units from 1e-3 to 1e3."""
    random = np.random.default_rng(seed)
    U, _ = np.linalg.qr(random.normal(size=(n, n)))
    V, _ = np.linalg.qr(random.normal(size=(2 * n, n)))
    sigma = np.concatenate([10.0 ** random.uniform(-1, 0, n - nullity), off * random.uniform(0.1, 1, nullity)])
    return (U * sigma) @ V.T


@pytest.mark.parametrize("nullity", [1, 2, 5])
@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-8, 1e-5])
def test_a_singular_system_is_solved_at_its_rank(nullity, off):
    G = rows_of_rank(12, nullity, 1, off)
    G /= np.linalg.norm(G, axis=1, keepdims=True)
    S, r = ca.SX.sym("S", 12, 12), ca.SX.sym("r", 12)
    solve = ca.Function("solve", [S, r], [singular_solver(S, nullity)(r)])
    right = G @ np.random.default_rng(2).normal(size=24)
    expected = np.linalg.pinv(G @ G.T, rcond=1e-6, hermitian=True) @ right
    assert_allclose(solve(G @ G.T, right).full().ravel(), expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("nullity", [1, 3])
def test_units_of_rows_have_no_effect(nullity):
    G, units = rows_of_rank(9, nullity, 3), 10.0 ** np.random.default_rng(4).uniform(-6, 6, 9)
    S, r, u = ca.SX.sym("S", 9, 9), ca.SX.sym("r", 9), ca.SX.sym("u", 9)
    solve = ca.Function("solve", [S, r, u], [singular_solver(S, nullity, u)(r)])
    right = np.random.default_rng(5).normal(size=18)
    pairs = [(G, np.ones(9)), (units[:, None] * G, units)]
    effects = [(H.T @ solve(H @ H.T, H @ right, own).full()).ravel() for H, own in pairs]
    assert_allclose(effects[1], effects[0], atol=1e-9)


@pytest.mark.parametrize("shrunk", [0.0, 1e-20, 1e-8])
def test_a_row_may_vanish(shrunk):
    """Rows of two directions, of which one turns into another, as those of a nut on a trunnion."""
    G = rows_of_rank(6, 0, 7)
    G[5] = shrunk * G[4]
    S, r = ca.SX.sym("S", 6, 6), ca.SX.sym("r", 6)
    solve = ca.Function("solve", [S, r], [singular_solver(S, 1)(r)])
    motion = np.random.default_rng(8).normal(size=12)
    effect = G.T @ solve(G @ G.T, G @ motion).full().ravel()
    assert_allclose(effect, np.linalg.pinv(G[:5]) @ (G[:5] @ motion), atol=1e-9)
    N = np.array(ca.DM(vanishing_rows(ca.SX(ca.DM(G)), 1)))
    assert_allclose(N.T @ G / np.linalg.norm(N), 0, atol=1e-9)


def test_rows_that_vanish_leave_their_multipliers_at_zero():
    G = rows_of_rank(8, 2, 6)
    N = np.array(ca.DM(vanishing_rows(ca.SX(ca.DM(G)), 2)))
    assert np.linalg.matrix_rank(N) == 2
    assert_allclose(N.T @ G, 0, atol=1e-9)
    lam = ca.SX.sym("lam", 8)
    J = np.array(ca.DM(ca.jacobian(independent(ca.SX(ca.DM(G @ G.T)) @ lam, lam, ca.SX(ca.DM(N))), lam)))
    assert np.linalg.cond(J) < 1e4


@pytest.mark.parametrize("nullity", [0, 1, 5])
def test_multipliers_of_least_norm_are_those_of_the_pseudo_inverse(nullity):
    """Also beside velocities that no row moves, and in units that differ."""
    G = np.hstack([rows_of_rank(12, nullity, 4), np.zeros((12, 2))])
    G[:, :5] *= 1e-6
    force = G.T @ np.random.default_rng(5).normal(size=12)
    unit = np.where(np.arange(26) < 5, 1e6, 1.0)
    units = 10.0 ** np.random.default_rng(6).uniform(-2, 2, 12)  # of the multipliers
    known = units * np.linalg.lstsq((units[:, None] * G * unit).T, force * unit, rcond=1e-9)[0]
    symbols = ca.SX.sym("G", 12, 26), ca.SX.sym("force", 26), ca.SX.sym("units", 12)
    lam = ca.Function("lam", symbols, [least_multipliers(*symbols)])(G, force, units).full().ravel()
    assert_allclose(lam, known, atol=1e-9 * np.abs(known).max())


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 9])
@pytest.mark.parametrize("density", [0.3, 1.0])
def test_explicit_solver_against_lapack(n, density):
    """Blocks one after the other, and halved ones; determinants multiply to that of the matrix, but for its sign."""
    rng = np.random.default_rng(10 * n)
    for _ in range(5):
        at = rng.normal(size=(n, n)) * (rng.random((n, n)) < density)
        at[rng.permutation(n), np.arange(n)] += rng.choice([-1.0, 1.0], n)
        if np.linalg.cond(at) > 1e6:
            continue
        sparsity = ca.sparsify(ca.DM(at)).sparsity()
        x = ca.SX.sym("x", sparsity.nnz())
        A, values = ca.SX(sparsity, x), at[tuple(np.array(sparsity.get_triplet()))]
        solver, r = ExplicitSolver(A, at), rng.normal(size=(n, 2))
        z, determinants = ca.Function("f", [x], [solver(ca.SX(ca.DM(r))), solver.determinants])(values)
        assert_allclose(z, np.linalg.solve(at, r), rtol=1e-9, atol=1e-9)
        assert_allclose(abs(np.prod(determinants)), abs(np.linalg.det(at)), rtol=1e-9)


def test_explicit_solver_of_a_matrix_that_is_singular_by_structure():
    x = ca.SX.sym("x", 2)
    solver = ExplicitSolver(ca.vertcat(ca.horzcat(x[0], 0), ca.horzcat(x[1], 0)))
    assert float(ca.DM(solver.determinants)) == 0.0
    assert np.isnan(ca.DM(solver(ca.SX.ones(2, 1)))).all()


@pytest.mark.parametrize("loops", [0, 2])
@pytest.mark.parametrize("seed", range(3))
def test_rotors_with_their_rows_against_lapack(seed, loops):
    """Blocks of 4 and 3 velocities with a rotor each, one that turns with both, one that is driven, and loops."""
    rng, sizes = np.random.default_rng(seed), [4, 1, 3, 1, 1, 1]
    M = np.zeros((11, 11))
    for at, n in zip(np.cumsum([0, *sizes]), sizes, strict=False):
        A = rng.normal(size=(n, n))
        M[at : at + n, at : at + n] = A @ A.T + np.eye(n)
    G = np.zeros((4 + loops, 11))
    G[:4, [4, 8, 9, 10]] = np.diag(rng.uniform(0.5, 3.0, 4) * rng.choice([-1, 1], 4))
    G[0, 2], G[1, [5, 7]], G[2, [1, 6]] = rng.normal(), rng.normal(size=2), rng.normal(size=2)
    G[4:, [0, 1, 2, 3, 5, 6, 7]] = rng.normal(size=(loops, 7))
    f, g = rng.normal(size=11), rng.normal(size=4 + loops)
    x, y = ca.SX.sym("x", 11), ca.SX.sym("y", 4 + loops)
    solve = saddle_solver(*(ca.sparsify(ca.SX(ca.DM(A))) for A in (M, G)), sizes)
    a, lam = ca.Function("solve", [x, y], [*solve(x, y)])(f, g)
    expected = np.linalg.solve(np.block([[M, G.T], [G, np.zeros((4 + loops,) * 2)]]), np.append(f, g))
    assert_allclose(np.append(a.full(), lam.full()), expected, rtol=0, atol=1e-11 * np.abs(expected).max())
