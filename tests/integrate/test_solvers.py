"""Every solver with every stabilization against equations written by hand; fitted orders; drift."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import problems
import pytest
from conftest import ALL_SOLVERS
from mechanisms import MECHANISMS, double_pendulum, double_pendulum_by_hand
from numpy.testing import assert_allclose
from small_scenes import particle

import symmb as mb
from models import heavy_top, n_four_bar

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
    (lambda n: mb.NSTIFFSI2(step=1 / n), 2, (800, 1600, 3200)),
    (lambda n: mb.GeneralizedAlpha(step=1 / n), 2, (800, 1600, 3200)),
    (lambda n: mb.HHT(step=1 / n), 2, (800, 1600, 3200)),
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
    assert free.position_drift > 1e-5
    assert fed_back.position_drift < 0.1 * free.position_drift
    assert projected.position_drift < 1e-14
    assert free.velocity_drift > 1e-5
    assert fed_back.velocity_drift < 0.3 * free.velocity_drift
    assert projected.velocity_drift < 1e-13


def test_solvers_print_what_was_chosen():
    assert repr(mb.CVODES()) == "CVODES()"
    assert repr(mb.IDAS(rtol=1e-7, stabilization=mb.Projection())) == "IDAS(rtol=1e-07, stabilization=Projection())"


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
    (
        lambda: mb.DAESimulator(double_pendulum(), mb.IDAS(stabilization=mb.AugmentedLagrangian())),
        r"is for solvers that eliminate the multipliers: use CVODES\(\)",
    ),
]


@pytest.mark.parametrize(("make", "text"), OPTIONS)
def test_options_that_make_no_sense_are_told(make, text):
    with pytest.raises(mb.DeclarationError, match=text):
        make()


def test_a_solver_without_derivatives_says_so():
    box = mb.Box(l1=(0.9, 1.1))
    with pytest.raises(mb.PropagationError, match="gives no derivatives along the run"):
        mb.propagate(double_pendulum(), mb.Taylor(1), box, solver=mb.StabilizedIndex2())


def test_the_ends_of_what_an_option_may_be_are_legal():
    assert (mb.GeneralizedAlpha(rho=0.0).rho, mb.GeneralizedAlpha(rho=1.0).rho, mb.HHT(alpha=0.0).alpha) == (0, 1, 0)


@pytest.mark.parametrize("stabilization", [None, mb.Baumgarte(1.0, 1.0), mb.Projection()])
def test_one_step_solvers_keep_the_norm_of_quaternions(stabilization):
    """A tumbling free body and one on a ball joint, long enough for a norm that nobody keeps to drift by 1e-4."""
    free = mb.Body("free", 1.0, (1.0, 2.0, 3.0), pose=mb.Spatial())
    held = mb.Body("held", 1.0, (1.0, 2.0, 3.0), pose=mb.Spatial())
    system = mb.System(free, held, mb.Spherical("ball", mb.Ground().point(0, 0, 0), held.point(0, 0, 0)))
    start = {"free.omega": (0.1, 5.0, 0.1), "held.omega": (0.1, 5.0, 0.1)}
    scene = mb.Scene(system, start, np.linspace(0, 300, 31))
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
