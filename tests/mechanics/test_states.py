"""First-order states of the user's own against closed forms and SciPy."""

import pickle

import casadi as ca
import numpy as np
import pytest
import sympy
from conftest import ALL_SOLVERS
from faults import refused
from machines import GROUND, run_of
from mechanisms import exact
from numpy.testing import assert_allclose

import symmb as mb

TIMES = np.linspace(0.0, 1.0, 11)


def cart():
    return mb.Body("cart", 2.0, pose=mb.Particle())


def pushed(rate, start, solver=None):
    """The run of a cart that a state z of the given rate(cart, z) pushes."""
    body = cart()
    z = mb.State("z", rate=lambda z: rate(body, z))
    push, values = mb.Force("push", body.point(0, 0), (z.value, 0)), {"x": body.x, "vx": body.vx, "z": z.value}
    return run_of(body, z, push, start={"z": start}, times=TIMES, outputs=values, solver=solver)


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_a_filtered_motor_moves_as_its_linear_equations_say(solver):
    """2 x'' = z, z' = (3 - z) / 0.2 - 4 x'; all solvers."""
    run = pushed(lambda body, z: (3.0 - z) / 0.2 - 4 * body.vx, 0.5, solver)
    x, _, z = exact(lambda t, y: [y[1], y[2] / 2, (3 - y[2]) / 0.2 - 4 * y[1]], [0, 0, 0.5], TIMES).T
    assert_allclose(run["x"], x, atol=2e-3)
    assert_allclose(run["z"], z, atol=2e-2)


def test_errors_are_those_of_the_tolerance():
    run = pushed(lambda body, z: -z / 0.2, 1.0)
    assert_allclose(run["z"], np.exp(-TIMES / 0.2), atol=1e-9)
    assert_allclose(run["vx"], 0.1 * (1 - np.exp(-TIMES / 0.2)), atol=1e-9)
    assert run.energy_drift < 1e-9


def test_states_may_depend_on_others_and_on_angles_in_space():
    """The controller's state follows an angle that counts turns; a second state follows the first."""
    wheel = mb.Body("wheel", 1.0, (1, 1, 1), mb.Spatial())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), wheel.point(0, 0))
    slow = mb.State("slow", rate=lambda z: (hinge.angle - z) / 0.5)
    slower = mb.State("slower", rate=lambda z: slow.value - z)
    start, outputs = {"hinge.angle": 9.0, "hinge.angle_rate": 2.0, "slow": 9.0}, {"a": slow.value, "b": slower.value}
    run = run_of(wheel, hinge, slower, slow, start=start, times=TIMES, outputs=outputs)
    lag = lambda t: 9.0 + 2 * (t - 0.5 * (1 - np.exp(-t / 0.5)))  # noqa: E731
    assert_allclose(run["a"], lag(TIMES), atol=1e-8)
    assert_allclose(run["b"], exact(lambda t, y: lag(t) - y, [0.0], TIMES)[:, 0], atol=1e-8)


def test_lanes_start_at_expressions_of_parameters_and_have_derivatives():
    p = mb.Parameters(k=2.0, z0=1.5)
    z = mb.State("z", rate=lambda z: -p.k * z)
    system, box = mb.System(cart(), z, parameters=p), mb.Box.around(p, 0.1)
    scene = mb.Scene(system, {"z": p.z0**2}, TIMES, {"z": z.value}, box)
    simulator = mb.DAESimulator(scene, mb.DormandPrince())
    P = np.array([[2.0, 1.5], [1.0, -0.5], [3.0, 2.0]])
    expected = P[:, 1:] ** 2 * np.exp(-P[:, :1] * TIMES)
    assert_allclose(simulator.run(P).Y[:, :, 0], expected, atol=1e-9)
    jets = simulator.jets(np.array([2.0, 1.5]), np.eye(2), 1)
    e = np.exp(-2 * TIMES)
    assert_allclose(jets[1, :, :, 0], [-TIMES * 2.25 * e, 3.0 * e], atol=1e-8)
    assert_allclose(mb.propagate(scene, mb.Taylor(order=2)).upper[-1, 0], 1.65**2 * np.exp(-1.8), rtol=1e-2)


def test_a_state_may_drive_a_position_and_does_its_work():
    """The carriage follows z, z' = -3 z: x = exp(-3 t), force m x''; start velocities follow from z'."""
    body = cart()
    z = mb.State("z", rate=lambda z: -3 * z)
    system = mb.System(body, z, mb.Motion("servo", body.x, z.value))
    scene = mb.Scene(system, {"z": 1.0}, TIMES, {"x": body.x, "v": body.vx, "force": -system.lam("servo")})
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-10))
    e = np.exp(-3 * TIMES)
    assert_allclose(run["x"], e, atol=1e-8)
    assert_allclose(run["v"], -3 * e, atol=1e-8)
    assert_allclose(run["force"], 2 * 9 * e, atol=1e-7)
    assert run.energy_drift < 1e-8


def test_a_mass_may_be_a_state():
    """Rocket: m' = -q, exhaust speed c: v = c ln(m0 / m). The mass that leaves has the rocket's velocity in `Q`."""
    flow, c = 0.5, 10.0
    m = mb.State("m", rate=-flow + 0 * mb.t)
    rocket = mb.Body("rocket", m.value, pose=mb.Particle())
    thrust, outputs = mb.Force("thrust", rocket.point(0, 0), (flow * c, 0)), {"v": rocket.vx, "m": m.value}
    run = run_of(rocket, m, thrust, start={"m": 2.0}, times=TIMES, outputs=outputs)
    assert_allclose(run["v"], c * np.log(2.0 / (2.0 - flow * TIMES)), atol=1e-8)
    assert run.energy_drift < 1e-8


def test_an_equilibrium_counts_the_force_of_a_state():
    body, z = cart(), mb.State("z", rate=lambda z: -z)
    spring = mb.Spring("spring", GROUND.point(0, 0), body.point(0, 0), 50.0)
    push = mb.Force("push", body.point(0, 0), (z.value, 0, 0))
    run = run_of(body, z, spring, push, start={"z": 5.0}, outputs={"x": body.x}, equilibrium=True)
    assert_allclose(run["x"][0], 0.1, atol=1e-10)


@pytest.mark.parametrize("solver", [None, *ALL_SOLVERS, mb.NSTIFFSI2(rtol=1e-6), mb.StateSpace()], ids=repr)
def test_a_system_of_states_alone_is_an_initial_value_problem(solver):
    """Logistic growth, z' = k z (1 - z)."""
    p = mb.Parameters(k=3.0)
    z = mb.State("z", rate=lambda z: p.k * z * (1 - z))
    scene = mb.Scene(mb.System(z, parameters=p), {"z": 0.1}, TIMES, {"z": z.value})
    atol = 1e-8 if solver is None else 1e-5
    assert_allclose(mb.simulate(scene, solver)["z"], 1 / (1 + 9 * np.exp(-3 * TIMES)), atol=atol)
    if solver is not None:
        return
    simulator = mb.DAESimulator(scene, mb.DormandPrince())
    expected = [1 / (1 + 9 * np.exp(-k * TIMES)) for k in (1.0, 4.0)]
    assert_allclose(simulator.run(np.array([[1.0], [4.0]])).Y[:, :, 0], expected, atol=1e-8)


@pytest.mark.parametrize("held", ["welded", "driven"])
@pytest.mark.parametrize("solver", [None, mb.StateSpace(), *ALL_SOLVERS], ids=repr)
def test_a_state_beside_a_body_that_cannot_move(solver, held):
    """z' = -k z is all that moves by itself: coordinates of the joints have no states but this one."""
    p = mb.Parameters(k=3.0)
    body, z = mb.Body("body", 2.0, 1.0), mb.State("z", rate=lambda z: -p.k * z)
    joint = mb.Weld if held == "welded" else mb.Revolute
    joint = joint("joint", GROUND.point(0, 0), body.point(0.5, 0))
    drive = [mb.Motion("drive", joint.angle, 0.5 * mb.t)] if held == "driven" else []
    system, box = mb.System(body, z, joint, *drive, parameters=p), mb.Box(k=(2.9, 3.1))
    scene = mb.Scene(system, {"z": 1.0}, TIMES, {"z": z.value, "x": body.x}, box, coordinates="joint")
    run = mb.simulate(scene, solver)
    assert_allclose(run["z"], np.exp(-3 * TIMES), atol=2e-2)
    angle = 0.5 * TIMES if held == "driven" else 0.0 * TIMES
    assert_allclose(run["x"], -0.5 * np.cos(angle), atol=2e-3)
    if solver is None:
        bounds = mb.propagate(scene, mb.TaylorModel(order=6))
        assert_allclose([bounds.lower[-1, 0], bounds.upper[-1, 0]], np.exp([-3.1, -2.9]), rtol=1e-8)
        assert_allclose(mb.linearize(scene).A[-1, -1], -3.0)


def test_a_study_of_one_state_with_a_switch():
    p = mb.Parameters(a=0.7)
    z = mb.State("z", rate=lambda z: ca.fabs(z - 0.5) + p.a)
    scene = mb.Scene(mb.System(z, parameters=p), {"z": 0.1}, [0.0, 0.125, 0.25, 1.0], {"z": z.value})
    bounds = mb.propagate(scene, mb.PolynomialChaos(), box=mb.Box(a=(0.5, 1.0)))
    for a, edge in zip((0.5, 1.0), bounds["z"], strict=True):
        when = np.log((a + 0.4) / a)  # z is 0.5, and grows from a
        below, above = a + 0.5 - (a + 0.4) * np.exp(-scene.times), 0.5 - a + a * np.exp(scene.times - when)
        assert_allclose(edge, np.where(scene.times < when, below, above), rtol=1e-7)


def test_laws_in_sympy_know_states_by_name():
    body = cart()
    z = mb.State("z", rate=lambda z: 1.0 - z)
    system = mb.System(body, z, mb.Force("push", body.point(0, 0), (sympy.Symbol("z") ** 2, 0)))
    assert_allclose(np.asarray(ca.Function("Q", [system.s], [system.Q])(3.0)).ravel()[0], 9.0)


def test_the_rate_is_called_once():
    calls = []
    z = mb.State("z", rate=lambda z: calls.append(z) or -z)
    scene = mb.Scene(mb.System(cart(), z), {"z": 1.0}, TIMES, {"z": z.value})
    assert np.array_equal(mb.simulate(pickle.loads(pickle.dumps(scene))).values, mb.simulate(scene).values)
    assert len(calls) == 1


BODY, K = cart(), ca.SX.sym("k")
Z = mb.State("z", rate=lambda z: -z)
FAST = mb.State("fast", rate=lambda z: BODY.vx)
FAULTS = [
    (lambda: mb.State("z", rate=lambda z: "fast"), r"State 'z': rate: expected one number or CasADi SX, got 'fast'"),
    (lambda: mb.State("z", rate=lambda z: 1 / 0), r"State 'z': rate: the law raises ZeroDivisionError"),
    (lambda: mb.State("z", rate=lambda z: ca.SX.sym("a", 2)), r"State 'z': rate: expected one number"),
    (lambda: mb.State(3, rate=lambda z: -z), r"State: the name must be a text, got 3"),
    (lambda: mb.System(BODY, mb.State("z", lambda z: K)), r"State 'z': rate: symbol 'k' does not belong to"),
    (lambda: mb.System(BODY, mb.Force("f", BODY.point(0, 0), (Z.value, 0))), r"State 'z' is not part of the System"),
    (lambda: mb.System(BODY, mb.State("a", rate=lambda z: Z.value)), r"State 'z' is not part of the System. Add it"),
    (lambda: mb.Scene(mb.System(BODY), outputs={"z": Z.value}), r"output 'z': State 'z' is not part of the System"),
    (lambda: mb.System(BODY, mb.State("k", rate=1.0), parameters=mb.Parameters(k=1.0)), r"State 'k': a parameter or"),
    (lambda: mb.System(BODY, mb.State("t", rate=1.0)), r"State 't': a parameter or the time has this name"),
    (lambda: mb.System(BODY, Z, mb.State("z", rate=1.0)), r"State 'z': the name is used twice"),
    (lambda: mb.System(BODY, FAST, mb.Motion("m", BODY.x, FAST.value)), r"rate of State 'fast' contains velocities"),
    (lambda: mb.Scene(mb.System(BODY, Z), {"zz": 1.0}), r"no coordinate or velocity 'zz'. Did you mean 'z'"),
    (lambda: mb.Scene(mb.System(BODY, Z), {"z": BODY.x}), r"start 'z': the value may depend on parameters only"),
    (lambda: mb.Scene(mb.System(BODY, Z), guess={"z": 1.0}), r"guess: 'z' is a first-order state and needs no guess"),
]


@pytest.mark.parametrize(("make", "text"), FAULTS)
def test_faults_name_the_state(make, text):
    refused(text, make)
