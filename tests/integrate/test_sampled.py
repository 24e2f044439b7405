"""Values held between instants: a discrete controller moves a mass along pieces of polynomials."""

import pickle

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_SOLVERS
from faults import refused
from machines import GROUND, ball, bouncing_ball
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import symmb as mb

M, KP, KD, T, G = 2.0, 30.0, 6.0, 0.05, 9.81
TIMES = np.linspace(0.0, 1.0, 41)  # every second one is an instant
STEPPING = [None, *(solver for solver in ALL_SOLVERS if solver.controls_step), mb.NSTIFFSI2(rtol=1e-8)]
FIXED = [solver for solver in ALL_SOLVERS if not solver.controls_step]


def controlled(law=None, period=T, times=TIMES, more=(), **options):
    """A mass under a discrete PD controller, and its parameters."""
    p = mb.Parameters(kp=KP, x0=1.0)
    cart = mb.Body("cart", M, pose=mb.Particle())
    u = mb.Sampled("u", period, -p.kp * cart.x - KD * cart.vx if law is None else law(cart))
    system = mb.System(cart, u, mb.Force("push", cart.point(0, 0), (u.value, 0)), *more, parameters=p)
    outputs = {"x": cart.x, "v": cart.vx, "u": u.value, "a": system.ddt(cart.vx)}
    return mb.Scene(system, {"cart.x": p.x0, "cart.vx": 0.5}, times, outputs, **options)


def closed_form(times=TIMES, kp=KP, x0=1.0, period=T):
    """(n_t, 4) x, v, u and x'': x_k+1 = x_k + v_k T + u_k T^2 / (2 m), v_k+1 = v_k + u_k T / m."""
    x, v, k, rows = x0, 0.5, 0, []
    u = -kp * x - KD * v
    for t in times:
        while t >= (k + 1) * period - 1e-9:
            x, v, k = x + v * period + u * period**2 / (2 * M), v + u * period / M, k + 1
            u = -kp * x - KD * v
        h = t - k * period
        rows.append([x + v * h + u * h**2 / (2 * M), v + u * h / M, u, u / M])
    return np.array(rows)


@pytest.mark.parametrize("solver", STEPPING, ids=repr)
def test_solvers_that_control_their_steps_end_them_at_instants(solver):
    """The motion between instants is a parabola, which they integrate without error but for their orders below 2."""
    run = mb.simulate(controlled(), solver)
    exact = repr(solver).startswith(("Dor", "Ros", "State", "NSTIFFSI2(rtol"))
    assert_allclose(run.values, closed_form(), atol=1e-11 if solver is None else 1e-9 if exact else 1e-6)
    assert run.energy_drift < 1e-9 or solver is not None


@pytest.mark.parametrize("solver", FIXED, ids=repr)
def test_fixed_steps_need_instants_among_the_times_or_refuse(solver):
    if solver.begins_anew:
        assert_allclose(mb.simulate(controlled(), solver).values, closed_form(), atol=1e-9)
        told = r"DormandPrince\(\) or give times that contain every instant"
        refused(told, mb.simulate, controlled(times=np.linspace(0, 1, 8)), solver)
    else:
        refused(r"do not begin at the instants of sampled values", mb.simulate, controlled(), solver)


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.Rosenbrock(), mb.CVODES()], ids=repr)
@pytest.mark.parametrize("times", [np.linspace(0, 1.03, 7), [0.0, 1.0], [0.0, 0.013, 0.05, 0.9501]], ids=len)
def test_instants_need_not_be_output_times(solver, times):
    atol = 1e-6 if isinstance(solver, mb.CVODES) else 1e-9
    assert_allclose(mb.simulate(controlled(times=times), solver).values, closed_form(times), atol=atol)


@pytest.mark.parametrize("start", [-1.0, 0.3, 1000.0])
def test_instants_count_from_the_start_of_the_times(start):
    """The period 0.1 has no exact binary value: instants and output times differ by rounding."""
    run = mb.simulate(controlled(period=0.1, times=start + np.linspace(0.0, 2.0, 21)))
    assert_allclose(run.values, closed_form(np.linspace(0.0, 2.0, 21), period=0.1), atol=1e-9)


def test_ensembles_run_in_compiled_lanes():
    simulator = mb.DAESimulator(controlled(), mb.DormandPrince())
    P = np.column_stack([np.linspace(20, 40, 11), np.linspace(-1, 1, 11)])
    expected = [closed_form(kp=kp, x0=x0) for kp, x0 in P]
    assert_allclose(simulator.run(P).Y, expected, atol=1e-10)
    bounds = mb.propagate(controlled(box=mb.Box(kp=(20, 40))), mb.Scanning(5))
    assert_allclose(bounds.upper, np.max([closed_form(kp=kp) for kp in np.linspace(20, 40, 5)], axis=0), atol=1e-10)


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.Rosenbrock(), mb.CVODES()], ids=repr)
def test_derivatives_with_respect_to_parameters_hold_across_instants(solver):
    jets = mb.DAESimulator(controlled(), solver).jets(np.array([KP, 1.0]), np.eye(2), 2)
    h = 1e-3

    def course(i, step):
        return closed_form(kp=KP + step * (i == 0), x0=1.0 + step * (i == 1))

    for i in range(2):
        first = (course(i, -2 * h) - 8 * course(i, -h) + 8 * course(i, h) - course(i, 2 * h)) / (12 * h)
        second = (course(i, h) - 2 * course(i, 0) + course(i, -h)) / h**2 / 2
        assert_allclose(jets[1, i], first, atol=1e-8)
        assert_allclose(jets[2, i], second, atol=1e-6)
    bounds = mb.propagate(controlled(box=mb.Box(kp=(29, 31))), mb.Taylor(order=3))
    runs = np.array([closed_form(kp=kp) for kp in np.linspace(29, 31, 9)])
    assert (bounds.upper >= runs.max(axis=0) - 1e-5).all() and (bounds.lower <= runs.min(axis=0) + 1e-5).all()
    assert_allclose(bounds.upper[-1], runs[:, -1].max(axis=0), atol=0.03)


def test_a_law_may_count_on_what_was_held():
    """A discrete integral, each instant counted once: u_k = u_k-1 + (1 - x_k) T with x = t^2 / 2."""
    total = lambda m: mb.Sampled("total", 0.1, law=lambda held: held + 0.1 * (1 - m.ball.x))  # noqa: E731
    machine, times = ball(total, lambda m: mb.Force("push", m.at, (1, 0)), g=None), np.linspace(0, 1, 21)
    scene = machine.scene({"total": machine.total.value}, times, {"total": 5.0})
    instants = 0.1 * np.arange(11)
    sums = 5.0 + np.cumsum(0.1 * (1 - instants**2 / 2))
    for solver in (None, mb.CVODES(), mb.RungeKutta(), mb.StateSpace()):
        assert_allclose(mb.simulate(scene, solver)["total"], sums[(times / 0.1 + 1e-6).astype(int)], atol=1e-9)


def test_values_of_one_instant_follow_the_order_of_declaration():
    """The second value sees the first one of its instant, the first one the second of the instant before."""
    a = mb.Sampled("a", 0.1, law=mb.t)
    b = mb.Sampled("b", 0.2, law=2 * a.value)
    for order, second in ((a, b), [0, 0, 0.4, 0.4, 0.8]), ((b, a), [0, 0, 0.2, 0.2, 0.6]):
        run = ball(*order).run({"a": a.value, "b": b.value}, np.array([0.0, 0.15, 0.2, 0.35, 0.4]))
        assert_allclose(run.values.T, [[0, 0.1, 0.2, 0.3, 0.4], second], atol=1e-12)


def test_laws_of_time_that_jump_at_an_instant_have_their_new_value():
    u = mb.Sampled("u", 0.125, law=ca.if_else(mb.t >= 0.5, 1.0, 0.0))
    machine = ball(u, lambda m: mb.Force("push", m.at, (u.value, 0)), g=None)
    for solver in (mb.DormandPrince(), mb.CVODES(), mb.StateSpace(), mb.RungeKutta()):
        assert_allclose(machine.run("vx", np.linspace(0, 1, 9), solver=solver)["vx"][-1], 0.5, atol=1e-9)


def test_events_and_instants_go_together():
    """A ball that a controller lifts off the ground after it has bounced; impacts as without it before."""
    u = mb.Sampled("u", 0.3, law=ca.if_else(mb.t > 0.5, 2 * G, 0.0))
    machine = bouncing_ball(u, lambda m: mb.Force("lift", m.at, (0, u.value)))
    run = machine.run({"y": machine.ball.y, "u": u.value}, np.linspace(0, 1.2, 13), {"ball.y": 1.0})
    fall = np.sqrt(2 / G)
    up, h = 0.5 * G * fall, 0.6 - fall  # it is lifted from 0.6 s on, for as long again
    assert len(run.events) == 1 and abs(run.events[0].time - fall) < 1e-9
    assert_allclose(run["y"][-1], up * h - G / 2 * h**2 + (up - G * h) * 0.6 + G / 2 * 0.6**2, atol=1e-8)
    assert_allclose(run["u"], np.where(run.t > 0.6 - 1e-9, 2 * G, 0.0), atol=1e-12)


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
def test_a_joint_under_a_sampled_motor(pose):
    """J a'' = u with u = -k a - c a' held: the same closed form with a hinge, constraints and turns."""
    wheel = mb.Body("wheel", 1.0, M if isinstance(pose, mb.Planar) else (1.0, 1.0, M), pose)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), wheel.point(0, 0))
    u = mb.Sampled("u", T, law=-KP * hinge.angle - KD * hinge.angle_rate)
    system = mb.System(wheel, hinge, u, mb.Actuator("motor", hinge, u.value))
    start = {"hinge.angle": 9.0, "hinge.angle_rate": 0.5}
    outputs = {"a": hinge.angle, "w": hinge.angle_rate, "u": u.value, "acceleration": system.ddt(hinge.angle_rate)}
    run = mb.simulate(mb.Scene(system, start, TIMES, outputs))
    assert_allclose(run.values, closed_form(x0=9.0), atol=1e-9 * 9 * KP)


def test_a_law_with_a_kink_is_told_where_derivatives_are_asked_for():
    """The force is limited to 20 N: it is at the limit first."""
    scene = controlled(law=lambda cart: -ca.fmin(20.0, KP * cart.x + KD * cart.vx), box=mb.Box(x0=(0.9, 1.1)))
    time, what = mb.DAESimulator(scene).kink(np.array([KP, 1.0]))
    assert 0.17 < time <= 0.2 + 1e-9 and "kinks" in what  # the first output time behind 30 x + 6 v = 20


def test_an_equilibrium_is_one_of_held_values_as_well():
    """k x = g under a sampled spring; the upright pendulum that a controller holds is no unstable start."""
    machine = ball(
        lambda m: mb.Sampled("u", 0.001, law=-500 * m.ball.y), lambda m: mb.Force("spring", m.at, (0, m.u.value))
    )
    assert_allclose(machine.run("y", [0.0, 0.1], equilibrium=True)["y"], -G / 500, atol=1e-10)
    rod = mb.Body("rod", 1.0, 0.1)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, -0.5))
    hold = mb.Sampled("hold", 0.01, law=-40 * hinge.angle - 4 * hinge.angle_rate)
    upright = mb.System(rod, hinge, hold, mb.Gravity(0, -9.81), mb.Actuator("motor", hinge, hold.value))
    assert not mb.simulate(mb.Scene(upright, times=[0.0, 0.1])).doubts


def test_identity_and_text_tell_the_laws():
    first, second = (mb.DAESimulator(controlled(period=period), mb.DormandPrince()) for period in (0.05, 0.1))
    other = mb.DAESimulator(controlled(law=lambda cart: -cart.x), mb.DormandPrince())
    assert len({first.identity(), second.identity(), other.identity()}) == 3
    assert "sampled      u every 0.05 s" in str(controlled().system)


def test_pickles_run_alike():
    scene = controlled()
    assert np.array_equal(mb.simulate(pickle.loads(pickle.dumps(scene))).values, mb.simulate(scene).values)
    simulator = pickle.loads(pickle.dumps(mb.DAESimulator(scene, mb.DormandPrince())))
    assert_allclose(simulator.run(np.array([[KP, 1.0]])).Y[0], closed_form(), atol=1e-10)


def test_exported_c_has_the_laws(tmp_path):
    assert {file.name for file in mb.compile_dae(controlled().system).save_c(tmp_path)} == {"model.c", "model.h"}
    assert "sampled0" in (tmp_path / "model.h").read_text()


BODY = mb.Body("body", 1.0, pose=mb.Particle())
U = mb.Sampled("u", 0.1, BODY.x)
FAULTS = [
    (lambda: mb.Sampled("u", 0.0, BODY.x), r"Sampled 'u': period 0.0 must be positive"),
    (lambda: mb.Sampled("u", "fast", BODY.x), r"Sampled 'u': period 'fast' is not a number. Pass a number"),
    (lambda: mb.Sampled("u", ca.SX.sym("T"), BODY.x), r"Pass a number, without parameters"),
    (lambda: mb.Sampled("u", 0.1, "x"), r"Sampled 'u': law: 'x' is not a number"),
    (lambda: mb.Sampled("u", 0.1, ca.SX.sym("k")), r"Sampled 'u': law: symbol 'k' does not belong to a parameter"),
    (lambda: mb.Sampled("u", 0.1, lambda u: 1 / 0), r"Sampled 'u': law: the law raises ZeroDivisionError"),
    (lambda: mb.Force("f", BODY.point(0, 0), (U.value, 0)), r"Sampled 'u' is not part of the System. Add it"),
    (
        lambda: (U, mb.Motion("m", BODY.x, U.value)),
        r"'m': the value of Sampled 'u' jumps, but a constraint must be continuous",
    ),
    (lambda: (U, mb.VelocityConstraint("c", (BODY.vx - U.value,))), r"'c': the value of Sampled 'u' jumps"),
]


@pytest.mark.parametrize(("make", "text"), FAULTS)
def test_faults_name_the_value(make, text):
    with pytest.raises(mb.DeclarationError, match=text):
        made = make()
        mb.System(BODY, *(made if isinstance(made, tuple) else (made,)))


INERTIA, ARM, MASS, LIMIT, HELD = 0.1, 0.3, 1.0, 2.0, 0.1


def arm_with_stops(stiffness, damping, parameters, friction):
    """An arm under gravity between two stops. A sampled controller with limits drives it."""
    p = mb.Parameters(**dict(list({"kp": 5.0, "kd": 1.0, "drag": friction}.items())[:parameters]))
    kp, kd, drag = (getattr(p, name, value) for name, value in (("kp", 5.0), ("kd", 1.0), ("drag", friction)))
    arm = mb.Body("arm", MASS, INERTIA)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), arm.point(-ARM, 0))
    u = mb.Sampled("u", HELD, ca.fmax(-LIMIT, ca.fmin(LIMIT, -kp * hinge.angle - kd * hinge.angle_rate)))
    stop = mb.Stop("stop", hinge, -0.2, 0.2, mb.KelvinVoigt(stiffness, damping))
    drive = mb.Actuator("drive", hinge, u.value - drag * hinge.angle_rate * ca.fabs(hinge.angle_rate))
    system = mb.System(arm, hinge, u, stop, drive, mb.Gravity(0, -G), parameters=p)
    return mb.Scene(system, {"hinge.angle_rate": 1.0}, np.linspace(0, 0.4, 9), {"a": hinge.angle, "u": u.value})


def arm_by_scipy(stiffness, damping, friction):
    """(n_t, 2) its angle and torque: SciPy's LSODA from each instant to the next."""
    times = np.linspace(0, 0.4, 9)

    def rates(t, y, u):
        a, w = y
        push = max(0.0, stiffness * (-0.2 - a) - damping * w) if a < -0.2 else 0.0
        push -= max(0.0, stiffness * (a - 0.2) + damping * w) if a > 0.2 else 0.0
        torque = u - friction * w * abs(w) + push - MASS * G * ARM * np.cos(a)
        return [w, torque / (INERTIA + MASS * ARM**2)]

    y, rows = np.array([0.0, 1.0]), []
    for begin in np.arange(0, 0.41, HELD):
        u = float(np.clip(-5 * y[0] - y[1], -LIMIT, LIMIT))
        due = times[(times >= begin - 1e-9) & (times < begin + HELD - 1e-9)]
        options = {"dense_output": True, "args": (u,), "rtol": 1e-9, "atol": 1e-12, "max_step": 5e-3}
        run = solve_ivp(rates, (begin, begin + HELD), y, "LSODA", **options)
        rows += [[run.sol(t)[0], u] for t in due]
        y = run.y[:, -1]
    return np.array(rows)


@pytest.mark.parametrize(
    ("stiffness", "damping", "parameters", "friction"),
    [(1e3, 0.0, 0, 0.0), (1e4, 1e2, 1, 0.0), (1e4, 30.0, 2, 0.7), (1e5, 0.0, 3, 2.0), (1e5, 30.0, 3, 0.1)],
)
def test_sampled_controllers_meet_stops_as_by_scipy_whatever_the_solver(stiffness, damping, parameters, friction):
    scene = arm_with_stops(stiffness, damping, parameters, friction)
    expected = arm_by_scipy(stiffness, damping, friction)
    for solver in (mb.DormandPrince(), mb.CVODES(), mb.CVODES(stiff=True), mb.Rosenbrock()):
        assert_allclose(mb.simulate(scene, solver).values, expected, atol=2e-5, err_msg=repr(solver))
