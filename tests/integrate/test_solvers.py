"""Solvers and stabilizations against equations by hand: orders, drift, partitioned coordinates, implicit schemes."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import problems
import pytest
from conftest import ALL_SOLVERS
from faults import refused
from machines import bob
from mechanisms import MECHANISMS, double_pendulum, double_pendulum_by_hand, explosion, spinning_body
from numpy.testing import assert_allclose, assert_array_equal
from small_scenes import particle

import symmb as mb
from models import double_pendulum as paper
from models import heavy_top, n_four_bar
from symmb.run.schemes.nstiff_si2 import nstiff_si2

STABILIZATIONS = (None, mb.Baumgarte(), mb.Projection(), mb.AugmentedLagrangian())
SECOND_ORDER = (mb.NSTIFFSI2, mb.GeneralizedAlpha, mb.HHT, mb.Newmark, mb.BDFI3)


def stabilized():
    for solver in ALL_SOLVERS:
        if hasattr(solver, "stabilization"):
            keeps = isinstance(solver, mb.IDAS | mb.Collocation)  # the multipliers
            yield from (replace(solver, stabilization=s) for s in (STABILIZATIONS[:3] if keeps else STABILIZATIONS))
        else:
            yield solver


@cache
def scene_of(name):
    """A scene remembers its equations, which all solvers share."""
    return MECHANISMS[name].scene()


@pytest.fixture(scope="module")
def by_hand():
    return {name: mechanism.by_hand(mechanism.nominal) for name, mechanism in MECHANISMS.items()}


@pytest.mark.parametrize("solver", tuple(stabilized()), ids=repr)
@pytest.mark.parametrize("name", MECHANISMS)
def test_solvers_agree_with_equations_by_hand(name, solver, by_hand):
    run = mb.simulate(scene_of(name), solver)
    tolerance = 4e-3 if isinstance(solver, SECOND_ORDER) else 2e-7
    if isinstance(solver, mb.Newmark):
        tolerance = 8e-2
    elif isinstance(solver, mb.StabilizedIndex2):
        tolerance = 5e-6
    elif isinstance(getattr(solver, "stabilization", None), mb.AugmentedLagrangian):
        tolerance = 5e-5  # its feedback is stiff: steps of 1 ms lose order
    assert_allclose(run.values, by_hand[name], atol=tolerance)
    assert run.energy_drift < tolerance / 10
    if isinstance(getattr(solver, "stabilization", None), mb.Projection):
        # The compiled pair projects after its steps and interpolates between them.
        share = 1e4 if isinstance(solver, mb.DormandPrince) else 1.0
        assert run.position_drift < 1e-14 * share and run.velocity_drift < 1e-13 * share


ORDERS = [
    (lambda n: mb.RungeKutta(steps=n), 4, (400, 800, 1600)),
    (lambda n: mb.RungeKutta(steps=n, stabilization=mb.Baumgarte(2.0, 2.0)), 4, (400, 800, 1600)),
    (lambda n: mb.Collocation(degree=1, steps=n), 1, (2000, 4000, 8000)),
    (lambda n: mb.Collocation(degree=2, steps=n), 3, (80, 160, 320)),
    (lambda n: mb.Collocation(degree=3, steps=n), 5, (60, 80, 120)),
    (lambda n: mb.Collocation(degree=4, steps=n), 7, (70, 80, 100)),
    *((lambda n, kind=kind: kind(step=1 / n), 2, (800, 1600, 3200)) for kind in SECOND_ORDER[:3]),
    (lambda n: mb.Newmark(step=1 / n), 1, (1600, 3200, 6400)),
    (lambda n: mb.BDFI3(step=1 / n), 2, (1600, 3200, 6400)),
    (lambda n: mb.Rosenbrock(step=1 / n), 4, (1000, 1200, 1600)),
]
SCENES = {
    "planar": cache(lambda: double_pendulum(np.linspace(0, 1, 6))),
    "spatial": cache(lambda: heavy_top.scene().with_times(np.linspace(0, 0.5, 6))),
}


@pytest.fixture(scope="module")
def exact():
    return {name: mb.simulate(make(), mb.DormandPrince(rtol=1e-13)).values for name, make in SCENES.items()}


@pytest.mark.parametrize(("solver", "order", "steps"), ORDERS, ids=[repr(o[0](o[2][0])) for o in ORDERS])
@pytest.mark.parametrize("name", SCENES)
def test_the_order_is_the_one_of_the_method(name, solver, order, steps, exact):
    simulators = [mb.DAESimulator(SCENES[name](), solver(n)) for n in steps]
    runs = [simulator.run(np.array([list(simulator.parameters.values())])).Y[0] for simulator in simulators]
    errors = [np.abs(values - exact[name]).max() for values in runs]
    slope = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(slope - order) < 0.15, errors


def test_orders_are_measured_against_what_equations_by_hand_give(exact):
    assert_allclose(exact["planar"], double_pendulum_by_hand((1.0, 0.8), np.linspace(0, 1, 6)), atol=1e-11)


@pytest.mark.parametrize("make", [mb.CVODES, mb.IDAS, mb.StabilizedIndex2], ids=lambda c: c.__name__)
def test_the_error_follows_the_tolerance(make):
    exact = double_pendulum_by_hand((1.0, 0.8))
    errors = [np.abs(mb.simulate(double_pendulum(), make(rtol=r)).values - exact).max() for r in (1e-5, 1e-7, 1e-9)]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]


def test_tighter_solvers_err_less():
    exact = double_pendulum_by_hand((1.0, 0.8))
    coarse = (mb.CVODES(rtol=1e-5), mb.IDAS(rtol=1e-5), mb.RungeKutta(steps=150), mb.Collocation(degree=2, steps=100))
    for solver in (*coarse, mb.NSTIFFSI2(), mb.GeneralizedAlpha(step=5e-3), mb.HHT(step=5e-3)):
        both = (solver, solver.tighter(100.0))
        first, second = (np.abs(mb.simulate(double_pendulum(), s).values - exact).max() for s in both)
        assert second < 0.2 * first, solver


def test_stabilization_takes_the_drift_away():
    times = np.linspace(0, 10, 101)
    solvers = [mb.RungeKutta(steps=1500, stabilization=s) for s in (None, mb.Baumgarte(10.0, 10.0), mb.Projection())]
    scene = replace(double_pendulum(times), coordinates="body")
    free, fed_back, projected = (mb.simulate(scene, s) for s in solvers)
    for drift, share, rounding in (("position_drift", 0.1, 1e-14), ("velocity_drift", 0.3, 1e-13)):
        assert getattr(free, drift) > 1e-5 and getattr(projected, drift) < rounding
        assert getattr(fed_back, drift) < share * getattr(free, drift)


OPTIONS = [
    (lambda: mb.CVODES(rtol=-1), r"CVODES: rtol=-1 must be a number above 1e-15"),
    (lambda: mb.CVODES(atol=0.0), r"CVODES: atol=0\.0 must be a number above 1e-30"),
    (lambda: mb.IDAS(rtol="1e-3"), r"IDAS: rtol='1e-3' must be a number"),
    (lambda: mb.IDAS(rtol=np.nan), r"IDAS: rtol=nan must be a number above 1e-15"),
    (lambda: mb.RungeKutta(steps=0), r"RungeKutta: steps=0 must be a number above 0"),
    (lambda: mb.Collocation(degree=0), r"Collocation: degree=0 must be a number from 1 to 9"),
    (lambda: mb.NSTIFFSI2(step=0), r"NSTIFFSI2: step=0 must be a number above 0"),
    (lambda: mb.GeneralizedAlpha(rho=1.2), r"GeneralizedAlpha: rho=1\.2 must be a number from 0 to 1"),
    (lambda: mb.HHT(alpha=0.4), r"HHT: alpha=0\.4 must be a number from 0 to 0\.333"),
    (lambda: mb.CVODES(stabilization="Projection"), "stabilization='Projection' is not a stabilization: use Baumgarte"),
    (lambda: mb.CVODES(rtol=0, atol=-1), r"rtol=0 .*\nCVODES: atol=-1"),
    (lambda: mb.Newmark(gamma=0.4), r"Newmark: gamma=0\.4 must be a number from 0\.5 to 1"),
    (lambda: mb.DAESimulator(double_pendulum(), mb.IDAS(stabilization=mb.AugmentedLagrangian())),
     r"is for solvers that eliminate the multipliers: use CVODES\(\)"),
    (lambda: mb.propagate(double_pendulum(), mb.Taylor(1), mb.Box(l1=(0.9, 1.1)), solver=mb.StabilizedIndex2()),
     "gives no derivatives along the run"),
    (lambda: mb.DAESimulator(double_pendulum(), mb.StateSpace()).jets(np.array([1.0, 0.8]), np.eye(2), 1),
     "gives no derivatives"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "text"), OPTIONS)
def test_options_that_make_no_sense_are_told(make, text):
    refused(text, make, error=mb.PropagationError if "derivatives" in text else mb.DeclarationError)


def test_the_ends_of_what_an_option_may_be_are_legal_and_solvers_print_what_was_chosen():
    assert repr(mb.CVODES()) == "CVODES()"
    assert repr(mb.IDAS(rtol=1e-7, stabilization=mb.Projection())) == "IDAS(rtol=1e-07, stabilization=Projection())"
    assert (mb.GeneralizedAlpha(rho=0.0).rho, mb.GeneralizedAlpha(rho=1.0).rho, mb.HHT(alpha=0.0).alpha) == (0, 1, 0)


@pytest.mark.parametrize("stabilization", [None, mb.Baumgarte(1.0, 1.0), mb.Projection()])
def test_one_step_solvers_keep_the_norm_of_quaternions(stabilization):
    """A tumbling free body and one on a ball joint, long enough for a norm that nobody keeps to drift by 1e-4."""
    _, held = bodies = [mb.Body(name, 1.0, (1.0, 2.0, 3.0), mb.Spatial()) for name in ("free", "held")]
    system = mb.System(*bodies, mb.Spherical("ball", mb.Ground().point(0, 0, 0), held.point(0, 0, 0)))
    scene = mb.Scene(system, {f"{body.name}.omega": (0.1, 5.0, 0.1) for body in bodies}, np.linspace(0, 300, 31))
    by_tolerance = mb.DormandPrince(rtol=1e-5, stabilization=stabilization)
    for solver in (by_tolerance, mb.RungeKutta(steps=6000, stabilization=stabilization)):
        run = mb.simulate(scene, solver)
        for body in ("free", "held"):
            norm = np.sqrt(sum(run[f"{body}.e{k}"] ** 2 for k in range(4)))
            assert_allclose(norm, 1.0, atol=2e-5)


def test_the_augmented_method_goes_on_through_singular_positions():
    """All cranks lie flat ten times in 10 s, and the rows lose rank: against the closed form of the benchmark."""
    times = np.linspace(0, 10, 201)
    data = problems.read("n_four_bar")
    run = mb.simulate(n_four_bar.scene(2), mb.CVODES(rtol=1e-10, stabilization=mb.AugmentedLagrangian()), times=times)
    assert_allclose(run["B0_x"][::20], data["B0_x_of_2_at_0_to_10_s"], atol=1e-4)
    assert run.energy_drift < 1e-6 and run.position_drift < 1e-7


def test_stabilised_index_2_keeps_positions_and_velocities():
    run = mb.simulate(double_pendulum(np.linspace(0, 10, 101)), mb.StabilizedIndex2(rtol=1e-7))
    assert run.drift.position.max() < 1e-8 and run.drift.velocity.max() < 1e-6
    assert run.position_drift < 1e-7 and run.velocity_drift < 1e-6  # between output times as well


@pytest.mark.parametrize("solver", [None, mb.CVODES(stiff=True), mb.Rosenbrock()], ids=repr)
def test_output_times_may_be_close_together(solver):
    """A particle under a force that grows with time, over 10 ns, and with two outputs less than 1 ns apart."""
    for times in (np.linspace(0, 1e-8, 21), np.array([0, 0.5, 0.5 + 9e-10, 1, 2])):
        end = times[-1]
        run = mb.simulate(particle(lambda p, mass, end=end: 6 / end**3 * mb.t, times, {}, ("x", "vx")), solver)
        assert_allclose(run["x"], (times / end) ** 3, atol=1e-9)
        assert_allclose(np.diff(run["x"]), np.diff((times / end) ** 3), rtol=1e-3)


@pytest.mark.parametrize(
    "solver", [mb.CVODES(), mb.CVODES(stiff=True), mb.IDAS(), mb.DormandPrince(), mb.Rosenbrock()], ids=repr
)
@pytest.mark.parametrize("rectified", [False, True])
@pytest.mark.parametrize("begin", [0.25, 10.25])
def test_forces_that_start_at_their_rounding_tell_no_size(solver, rectified, begin):
    """sin(4 pi t) is 1e-16 at t = 0.25 s, which is no size of the motion. The integral is known."""
    force = ca.sin(4 * np.pi * mb.t)
    times = begin + np.linspace(0, 3.25, 14)
    run = mb.simulate(particle(lambda p, mass: ca.fmax(force, 0) if rectified else force, times, {}, ("vx",)), solver)
    cycles, phase = np.divmod(2 * (times - begin), 1)  # the force is -sin(2 pi phase)
    swing = (np.cos(2 * np.pi * phase) - 1) / (4 * np.pi)
    exact = cycles / (2 * np.pi) + np.where(phase > 0.5, 1 / (2 * np.pi) + swing, 0) if rectified else swing
    assert_allclose(run["vx"], exact, atol=1e-5)


@pytest.mark.parametrize("name", MECHANISMS)
def test_it_agrees_with_equations_by_hand(name):
    mechanism = MECHANISMS[name]
    run = mb.simulate(mechanism.scene(), mb.StateSpace(rtol=1e-10))
    np.testing.assert_allclose(run.values, mechanism.by_hand(mechanism.nominal), atol=2e-8)
    assert run.position_drift < 1e-12 and run.velocity_drift < 1e-11 and run.energy_drift < 1e-8
    assert name != "spatial" or run.statistics["integrator"]["choices of coordinates"] > 1


def test_it_passes_a_dead_point():
    """Where the crank's angle does not tell where the rod is."""
    known = problems.KNOWN["dead_point"]
    run = mb.simulate(problems.slider_crank("dead_point").make().with_times(known["times"][:5]), mb.StateSpace())
    assert np.abs(run["theta"] - np.array(known["values"])[:5, 0]).max() < 1e-4


def test_bounds_by_it_are_those_by_others():
    scene = double_pendulum(np.linspace(0, 0.5, 6), box=mb.Box(l1=(0.95, 1.05), l2=(0.76, 0.84)))
    found, known = (mb.propagate(scene, mb.PolynomialChaos(order=2), solver=s) for s in (mb.StateSpace(), None))
    np.testing.assert_allclose(found.lower, known.lower, atol=1e-6)


RNG = np.random.default_rng(3)
IMPLICIT = [solver for solver in ALL_SOLVERS if isinstance(solver, SECOND_ORDER)]
COARSE = mb.NSTIFFSI2(step=1e-2), mb.GeneralizedAlpha(step=1e-2), mb.Rosenbrock(step=1e-2)


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


@pytest.mark.parametrize("solver", COARSE)
@pytest.mark.parametrize("scene", [double_pendulum, spinning_body])
@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_casadi_takes_the_same_steps_of_scenes_that_are_too_large_for_compilers(solver, scene, monkeypatch):
    scene = scene(np.linspace(0, 1, 6))
    compiled = mb.simulate(scene, solver)
    monkeypatch.setattr("symmb.run.integrate.implicit.MOST_VELOCITIES", 0)
    scene = scene.with_times(scene.times)  # nothing is prepared for this one
    assert_allclose(mb.simulate(scene, solver).values, compiled.values, atol=1e-8)
    refused("is possible for at most 0 velocities", mb.simulate, scene, mb.Rosenbrock(), error=mb.PropagationError)


@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_lanes_are_the_runs_of_each_sample():
    scene = double_pendulum(np.linspace(0, 1, 6))
    for solver in COARSE:
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
    fine = None, mb.DormandPrince(), mb.RungeKutta(steps=1000), mb.CVODES(stiff=True), mb.Rosenbrock()
    limits = dict.fromkeys(fine, 1e-9) | {
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
    scene = bob().scene("x y", [0, 0.5], {"bob.x": 1.0})
    exact = mb.simulate(scene, mb.CVODES(rtol=1e-11)).values
    assert_allclose(mb.simulate(scene, solver).values, exact, atol=5e-3)
