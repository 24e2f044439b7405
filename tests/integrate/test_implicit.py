"""Implicit schemes in compiled lanes: Newton's matrix and iterations, step control, shorter steps, units."""

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_SOLVERS
from mechanisms import double_pendulum, explosion, spinning_body
from numpy.testing import assert_allclose, assert_array_equal
from small_scenes import particle

import symmb as mb
from models import double_pendulum as paper
from symmb.run.schemes.nstiff_si2 import nstiff_si2

RNG = np.random.default_rng(3)
IMPLICIT = [
    s for s in ALL_SOLVERS if isinstance(s, mb.NSTIFFSI2 | mb.GeneralizedAlpha | mb.HHT | mb.Newmark | mb.BDFI3)
]


@pytest.fixture(scope="module")
def eq_8():
    """Residual of the step at a random state, not scaled, in the paper's order of unknowns: function and Jacobian."""
    dae = mb.compile_dae(paper.scene().system)
    step, h = nstiff_si2(dae, work=False), 5e-3
    c = 2 * h / 3
    n, m = dae.n_q, dae.n_c
    size = {"q": (n, c), "v": (n, c**2), "lam": (m, c**2), "mu": (m, c)}
    units = np.concatenate([np.full(count, 1 / tau) for count, tau in size.values()])
    rows = np.concatenate([np.full(n, c**2), np.full(n, c), np.full(m, c), np.full(m, c**2)])  # (8) divides by c
    order = np.r_[n : 2 * n, :n, 2 * n : 2 * n + 2 * m]
    f = ca.Function("f", [step.z, step.w, step.p, step.t, step.h], [step.residual, ca.jacobian(step.residual, step.z)])
    p, x = np.array([1.02, 0.97]), RNG.normal(size=2 * n)
    w = np.concatenate([x, x - h * RNG.normal(size=2 * n), [h]])

    def residual(u):
        return f(u[np.argsort(order)] / units, w, p, h, h)[0].full().ravel() / rows

    def matrix(u):
        return (f(u[np.argsort(order)] / units, w, p, h, h)[1].full() / rows[:, None] / units)[:, order]

    u = RNG.normal(size=2 * n + 2 * m)
    new = (4 * w[: 2 * n] - w[2 * n : -1]) / 3 + c * u[np.r_[n : 2 * n, :n]]
    return dae, residual, matrix, u, new, p, h


def test_newton_s_matrix_is_the_corrected_one_of_eq_8(eq_8):
    dae, _, matrix, u, new, p, h = eq_8
    n, m, c = dae.n_q, dae.n_c, 2 * h / 3
    q, v, vdot, lam, mu = (ca.SX.sym(name, k) for name, k in zip("qvalm", (n, n, n, m, m), strict=True))
    at = (q, v, p, h)
    G, Q = dae.Phi_q(*at), dae.Q(*at)
    none, one = ca.SX(m, m), ca.SX.eye(n)
    blocks = [
        [dae.M(*at) - c * ca.jacobian(Q, v), c * ca.jacobian(dae.M(*at) @ vdot + G.T @ lam - Q, q), G.T, ca.SX(n, m)],
        [c * one, -one + c * ca.jacobian(G.T @ mu, q), ca.SX(n, m), G.T],
        [ca.SX(m, n), G, none, none],
        [G, ca.jacobian(G @ v, q), none, none],
    ]
    values = ca.Function("values", [q, v, vdot, lam, mu], [ca.densify(ca.blockcat(blocks))])
    expected = values(new[:n], new[n:], u[:n], u[2 * n : 2 * n + m], u[2 * n + m :]).full()
    assert_allclose(matrix(u), expected, atol=1e-9)


def test_newton_s_matrix_is_that_of_finite_differences(eq_8):
    _, residual, matrix, u, *_ = eq_8
    eps = 1e-5
    differences = [(residual(u + eps * e) - residual(u - eps * e)) / (2 * eps) for e in np.eye(len(u))]
    assert_allclose(matrix(u), np.transpose(differences), atol=1e-6)


def test_nstiff_si2_takes_three_iterations_and_keeps_positions_and_velocities():
    run = mb.simulate(paper.scene(), mb.NSTIFFSI2(step=5e-3))
    counted = run.statistics["integrator"]
    assert counted["steps"] == 2000 and counted["most in a step"] <= 3
    assert run.position_drift <= 1e-12 and run.velocity_drift <= 1e-11


@pytest.mark.parametrize("make", [lambda rtol: mb.NSTIFFSI2(step=0.5, rtol=rtol), mb.Rosenbrock], ids=["si2", "rodas"])
def test_controlled_steps_follow_the_tolerance(make):
    scene = double_pendulum(np.linspace(0, 2, 5))
    exact = mb.simulate(scene, mb.DormandPrince(rtol=1e-12)).values
    runs = [mb.simulate(scene, make(rtol)) for rtol in (1e-4, 1e-6, 1e-8)]
    errors = [np.abs(run.values - exact).max() for run in runs]
    assert errors[0] > 5 * errors[1] > 25 * errors[2] and errors[2] < 1e-4
    steps = [run.statistics["integrator"]["steps"] for run in runs]
    assert steps[0] < steps[1] < steps[2]


@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_a_step_that_newton_cannot_take_is_cut():
    """x'' = -1e6 x^3 from x = 1 in steps of a fifth of a second: thirty times the time it takes to turn."""
    scene = particle(lambda p, mass: -1e6 * mass.x**3, [0.0, 1.0], {"mass.x": 1.0})
    run = mb.simulate(scene, mb.NSTIFFSI2(step=0.2))
    assert np.isfinite(run.values).all() and run.statistics["integrator"]["steps"] > 5


@pytest.mark.parametrize("solver", IMPLICIT, ids=repr)
def test_newton_s_failure_is_told(solver):
    with pytest.raises(mb.SimulationError, match=r"t = \d\.?\d* s \(a = 1\): Newton's method does not converge"):
        mb.simulate(explosion(), solver)


@pytest.mark.parametrize("solver", [mb.NSTIFFSI2(step=1e-2), mb.GeneralizedAlpha(step=1e-2), mb.Rosenbrock(step=1e-2)])
@pytest.mark.parametrize("scene", [double_pendulum, spinning_body])
@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_casadi_takes_the_same_steps_of_scenes_that_are_too_large_for_compilers(solver, scene, monkeypatch):
    scene = scene(np.linspace(0, 1, 6))
    compiled = mb.simulate(scene, solver)
    monkeypatch.setattr("symmb.run.integrate.implicit.MOST_VELOCITIES", 0)
    scene = scene.with_times(scene.times)  # nothing is prepared for this one
    assert_allclose(mb.simulate(scene, solver).values, compiled.values, atol=1e-8)
    with pytest.raises(mb.PropagationError, match="is possible for at most 0 velocities"):
        mb.simulate(scene, mb.Rosenbrock())


@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_lanes_are_the_runs_of_each_sample():
    scene = double_pendulum(np.linspace(0, 1, 6))
    for solver in (mb.NSTIFFSI2(step=1e-2), mb.GeneralizedAlpha(step=1e-2), mb.Rosenbrock(step=1e-2)):
        simulator = mb.DAESimulator(scene, solver)
        P = np.array([[1.0, 0.8]]) * RNG.uniform(0.9, 1.1, (11, 2))
        together = simulator.run(P)
        for k in (0, 7, 10):
            assert_array_equal(together.Y[k], simulator.run(P[k : k + 1]).Y[0])
            alone = mb.simulate(scene, solver, dict(zip(("l1", "l2"), P[k], strict=True)))
            assert_allclose(together.Y[k], alone.values, atol=1e-12)


PERIOD = 2.367841947576237
"""Of a pendulum of length 1 m released at 90 degrees, over the square root of the length, with g = 9.81."""


@pytest.mark.parametrize("length", [1e-9, *(pytest.param(x, marks=pytest.mark.long) for x in (1.0, 1e9))])
def test_scenes_in_any_unit_of_length_behave_alike(length):
    """A massless rod with a point mass, from the horizontal over a period."""
    period = PERIOD * np.sqrt(length)
    bob = mb.Body("bob", 1e-18 if length < 1 else 1e6 * length, 0.0, mb.Planar())
    pivot = mb.Revolute("pivot", mb.Ground().point(0, 0), bob.point(0, length))
    system = mb.System(bob, pivot, mb.Gravity(0, -9.81))
    scene = mb.Scene(system, {"bob.theta": np.pi / 2}, np.linspace(0, period, 21), outputs={"theta": bob.theta})
    step = period / 1000
    limits = {
        None: 1e-9,
        mb.DormandPrince(): 1e-9,
        mb.RungeKutta(steps=1000): 1e-9,
        mb.CVODES(stiff=True): 1e-9,
        mb.Rosenbrock(): 1e-9,
        mb.NSTIFFSI2(step=step): 1e-5,
        mb.NSTIFFSI2(step=period, rtol=1e-6): 1e-4,
        mb.GeneralizedAlpha(step=step): 5e-8,
        mb.HHT(step=step): 1e-6,
        mb.BDFI3(step=step): 2e-5,
    }
    for solver, limit in limits.items():
        run = mb.simulate(scene, solver)
        assert abs(run["theta"][-1] - np.pi / 2) < limit, solver
        if not isinstance(solver, mb.CVODES | mb.RungeKutta | None):
            assert run.position_drift < 2e-8 * length, solver


@pytest.mark.parametrize("solver", IMPLICIT, ids=repr)
def test_a_single_row_and_a_coordinate_that_nothing_touches(solver):
    bead = mb.Body("bead", 1.0, pose=mb.Particle())
    rod = mb.Distance("rod", mb.Ground().point(0, 0), bead.point(0, 0), 1.0)
    scene = mb.Scene(mb.System(bead, rod, mb.Gravity(0, -9.81)), {"bead.x": 1.0}, [0, 0.5], {"x": bead.x, "y": bead.y})
    exact = mb.simulate(scene, mb.CVODES(rtol=1e-11)).values
    assert_allclose(mb.simulate(scene, solver).values, exact, atol=5e-3)
