"""Contacts in motion: published impacts, momentum, energy, clearances, and bounds over an uncertain gap."""

import casadi as ca
import numpy as np
import problems
import pytest
import sympy as sp
from faults import refused
from machines import GROUND, ball, run_of
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

import symmb as mb
from symmb.declare.symbolic.jets import jets
from symmb.run.codegen import Engine, Lanes, StepTolerances, model_function

KNOWN = problems.read("contact")
SOLVERS = (mb.DormandPrince(rtol=1e-9), mb.CVODES(), mb.Rosenbrock())
solvers = pytest.mark.parametrize("solver", SOLVERS, ids=repr)
LAWS = {"LankaraniNikravesh": mb.LankaraniNikravesh, "Flores2011": mb.Flores, "HuntCrossley": mb.HuntCrossley}


def falling(law, times, *, height=0.0, speed=0.0, g=0.0, p=None, **contact):
    """A ball of 1 kg above a floor."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    floor = mb.Contact("floor", ball.point(0, 0), GROUND.point(0, 0), (0, 1), law, **contact)
    system, start = mb.System(ball, floor, mb.Gravity(0, -g), parameters=p), {"ball.y": height, "ball.vy": -speed}
    return mb.Scene(system, start, times, {"y": ball.y, "vy": ball.vy}, name="falling")


@solvers
@pytest.mark.parametrize("case", [name for name in KNOWN["hertz"] if name != "undamped"])
def test_a_ball_rebounds_as_the_energy_integral_tells(case, solver):
    known = KNOWN["hertz"][case]
    p = mb.Parameters(k=known["k"], e=known["e_nominal"], v=known["v_impact"])
    law = LAWS[case.split("_e")[0]](p.k, p.e, p.v)
    run = mb.simulate(falling(law, np.linspace(0.0, 4e-3, 2001), speed=p.v, p=p), solver)
    assert run["vy"][-1] == pytest.approx(known["v_rebound"], rel=1e-6)
    assert -run["y"].min() == pytest.approx(known["delta_max"], rel=1e-5)
    assert run.energy.work[-1] == pytest.approx((known["v_rebound"] ** 2 - 1) / 2, rel=1e-5)
    assert run.energy_drift < 1e-6


@solvers
def test_a_contact_without_losses_stores_the_energy(solver):
    known = KNOWN["hertz"]["undamped"]
    law, half, depth = mb.HuntCrossley(known["k"], 1.0, 1.0), known["duration"] / 2, known["delta_max"]
    run = mb.simulate(falling(law, [0.0, half, 2 * half, 3 * half], speed=1.0), solver)
    assert_allclose(run["vy"], [-1, 0, 1, 1], atol=1e-6)
    assert_allclose(run["y"], [0, -depth, 0, half], atol=1e-9)
    assert_allclose(run.energy.work, 0)
    assert run.energy_drift < 1e-6
    assert float(law.force(ca.SX(depth), ca.SX(0))) == pytest.approx(known["F_max"], rel=1e-12)


@solvers
def test_a_linear_impact_ends_where_the_force_does(solver):
    known = KNOWN["linear"]
    p, end = known["parameters"], known["exit_at_zero_force"]
    times = np.append(np.linspace(0.0, end["t"], 1001), 0.004)
    run = mb.simulate(falling(mb.KelvinVoigt(float(p["k"]), float(p["c"])), times, speed=float(p["v0"])), solver)
    assert -run["y"].min() == pytest.approx(known["delta_max"], rel=1e-5)
    assert_allclose(run["vy"][-2:], -end["v"], rtol=1e-6)
    assert -run["y"][-2] == pytest.approx(end["penetration"], rel=1e-5)
    assert run.energy_drift < 1e-6


@solvers
def test_no_step_passes_over_a_bounce(solver):
    """Contacts of 2 ms in flights of up to 0.9 s, in which a step might become as long as it likes."""
    known = KNOWN["drop"]
    law = mb.HuntCrossley(known["k"], 1 - 2 / 3 * known["chi"], 1.0)
    events = np.array(known["values"])
    times, speeds = events[:, [0, 2]].ravel(), events[:, [1, 3]].ravel()
    run = mb.simulate(falling(law, np.insert(times, 0, 0.0), height=1.0, g=known["g"]), solver)
    assert_allclose(run["vy"][1:], speeds, atol=2e-5)


@pytest.mark.parametrize("solver", [SOLVERS[0], pytest.param(SOLVERS[1], marks=pytest.mark.long)], ids=repr)
def test_two_colliding_bodies_keep_their_momentum(solver):
    """A spinning sphere hits a tumbling plate, with friction, off both centres."""
    plate = mb.Body("plate", 2.0, (0.3, 0.2, 0.4), mb.Spatial())
    ball = mb.Body("ball", 1.5, (0.05, 0.06, 0.07), mb.Spatial())
    law, friction = mb.HuntCrossley(1e5, 0.8, 1.0), mb.Coulomb(0.3, 0.01)
    contact = mb.Contact("hit", ball.point(0.01, 0, 0), plate.point(0, 0, 0.1), (0.1, 0, 1), law, 0.2, friction)
    start = {"ball.z": 0.5, "ball.x": 0.3, "ball.vz": -3.0, "ball.omega": (2, -5, 1), "plate.omega": (0.3, 0.1, 0.2)}
    run = run_of(plate, ball, contact, start=start, times=np.linspace(0, 0.2, 101), solver=solver)
    linear, angular = 0, 0
    for body, m, J in ((plate, 2.0, [0.3, 0.2, 0.4]), (ball, 1.5, [0.05, 0.06, 0.07])):
        linear += m * body.frame.velocity
        angular += m * ca.cross(body.frame.r, body.frame.velocity) + body.rotation @ (ca.DM(J) * body.omega)
    assert run["ball.vz"][-1] > -1.5
    assert np.ptp(run["plate.omega_y"]) > 0.5
    for momentum in (run(linear), run(angular)):
        assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-6)
    assert run.energy.work[-1] < -0.5
    assert run.energy_drift < 1e-6


@solvers
def test_a_pin_flies_across_its_bush_and_back(solver):
    """Along a diameter, without failed_samples: from wall to wall at constant speed, half a Hertz contact at each."""
    clearance, speed, k = 0.01, 2.0, 1e8
    pin = mb.Body("pin", 1.0, 0.1, mb.Planar())
    law = mb.HuntCrossley(k, 1.0, 1.0)
    bush = mb.BushContact("bush", GROUND.point(0, 0), pin.point(0, 0), (0, 0, 1), clearance, law)
    # The duration of a Hertz contact goes with the fifth root of 1 / v, its depth with v^(4 / 5).
    hertz = KNOWN["hertz"]["undamped"]
    flight, touch = 2 * clearance / speed, hertz["duration"] * speed**-0.2
    times = np.array([0.0, flight / 2 + touch / 2, flight + touch, 1.5 * flight + 1.5 * touch, 2 * flight + 2 * touch])
    start = {"pin.vx": speed * 0.6, "pin.vy": speed * 0.8}
    run = run_of(pin, bush, start=start, times=times, outputs={"x": pin.x, "y": pin.y}, solver=solver)
    far = clearance + hertz["delta_max"] * speed**0.8
    assert_allclose(run.values, np.outer([0, far, 0, -far, 0], [0.6, 0.8]), atol=1e-8)
    assert run.energy_drift < 1e-6


@pytest.mark.parametrize("clearance", [0.0, 1e-3])
def test_a_bush_is_smooth_where_the_axes_coincide(clearance):
    pin = mb.Body("pin", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    ends, law = (GROUND.point(0, 0, 0), pin.point(0, 0, 0)), mb.HuntCrossley(1e8, 0.8, 1.0)
    system = mb.System(pin, mb.BushContact("bush", *ends, (0, 0, 1), clearance, law))
    x, expression = ca.vertcat(system.q, system.v), system.Q
    for _ in range(4):
        f = ca.Function("f", [x], [expression])
        for state in ([0] * 3 + [1] + [0] * 9, [0] * 3 + [1] + [0] * 3 + [1] * 6, [1e-9, 0, 0, 1] + [0] * 3 + [1] * 6):
            assert np.isfinite(f(state).full()).all()
        expression = ca.jtimes(expression, x, ca.DM.ones(x.numel()))


@solvers
def test_backlash_lets_go_both_ways(solver):
    """A tooth and a coupling of the same numbers move alike; SciPy integrates the equation by hand."""
    k, play, m = 4e4, 0.02, 2.0
    law = mb.KelvinVoigt(k, 20.0)
    rack = mb.Body("rack", m, pose=mb.Particle())
    rotor = mb.Body("rotor", 1.0, m, mb.Planar())
    tooth = mb.ToothContact("tooth", GROUND.point(0.3, 0), rack.point(0, 0), (1, 0, 0), play, law)
    coupling, times = mb.TorsionContact("coupling", GROUND, rotor, play, law, angle=0.3), np.linspace(0, 0.1, 41)
    start = {"rack.x": 0.3, "rack.vx": 1.5, "rotor.theta": 0.3, "rotor.omega": 1.5}
    run = run_of(rack, rotor, tooth, coupling, start=start, times=times, solver=solver)

    def rates(t, y):
        depth, rate = abs(y[0]) - play / 2, np.sign(y[0]) * y[1]
        force = max(k * depth + 20 * rate, 0) if depth > 0 else 0.0
        return [y[1], -np.sign(y[0]) * force / m]

    x, v = solve_ivp(rates, (0, 0.1), [0, 1.5], "DOP853", times, rtol=1e-10, atol=1e-12, max_step=1e-4).y
    assert x.max() > play / 2 and x.min() < -play / 2
    assert_allclose(run["rack.x"] - 0.3, x, atol=1e-6)
    assert_allclose(run["rotor.theta"] - 0.3, x, atol=1e-6)
    assert_allclose(run["rack.vx"], v, atol=1e-4)
    assert run.energy_drift < 1e-6


def test_exponent_and_radius_may_be_parameters_and_laws_sympy():
    p = mb.Parameters(n=1.5, r=0.1, k=1e8)
    law = mb.LankaraniNikravesh(sp.Symbol("k"), 0.9, 1.0, p.n)
    scene = falling(law, [0.0, 4e-3], height=0.1, speed=1.0, p=p, radius=p.r)
    known = KNOWN["hertz"]["LankaraniNikravesh_e0.9"]
    assert mb.simulate(scene)["vy"][-1] == pytest.approx(known["v_rebound"], rel=1e-6)


def test_a_plane_that_time_moves_does_work():
    """A floor that rises at constant speed is, to the ball, a ball that falls faster."""
    law, floor = mb.HuntCrossley(1e8, 1.0, 1.0), GROUND.point(0, 0.4 * mb.t)
    machine = ball(lambda m: mb.Contact("floor", m.at, floor, (0, 1), law), g=None)
    run = machine.run("vy", [0.0, 1e-3, 4e-3], {"ball.vy": -0.6})
    assert run["vy"][-1] == pytest.approx(1.4, rel=1e-6)
    assert run.energy.work[-1] == pytest.approx((1.4**2 - 0.6**2) / 2, rel=1e-6)
    assert run.energy_drift < 1e-6


def uncertain_gap():
    """A ball above a spring, and the true bounds of its height: whether it has met the spring depends on the gap."""
    p, k, g = mb.Parameters(gap=0.2), 5e4, 9.81
    times = np.linspace(0.0, 0.3, 31)
    scene = falling(mb.KelvinVoigt(k), times, height=p.gap, g=g, p=p).with_box(mb.Box(gap=(0.15, 0.25)))
    w = np.sqrt(k)

    def height(gap):
        """Fall; y'' = -k y - g from y = 0 with the speed of impact; and up again."""
        begin, v = np.sqrt(2 * gap / g), -np.sqrt(2 * gap * g)
        s, out = times - begin, 2 * (np.pi - np.arctan2(-w * v, g)) / w
        touching = v / w * np.sin(w * s) - g / w**2 * (1 - np.cos(w * s))
        away = -v * (s - out) - g / 2 * (s - out) ** 2
        return np.where(s < 0, gap - g / 2 * times**2, np.where(s < out, touching, away))

    known = np.array([height(gap) for gap in np.linspace(0.15, 0.25, 20001)])
    return scene, known.min(axis=0), known.max(axis=0)


def test_over_an_uncertain_gap_polynomial_chaos_is_honest_and_monte_carlo_is_attained():
    scene, lower, upper = uncertain_gap()
    bounds, sampled = mb.propagate(scene, mb.PolynomialChaos()), mb.propagate(scene, mb.MonteCarlo(2000))["y"]
    error = np.abs(np.subtract(bounds["y"], [lower, upper])).max(axis=0)
    assert error.max() < 0.02 * np.ptp(upper)
    assert (error <= bounds.estimate[:, bounds.names.index("y")] + 1e-6).all()
    assert (sampled[0] >= lower - 1e-6).all() and (sampled[1] <= upper + 1e-6).all()
    assert_allclose(sampled, [lower, upper], atol=1e-3)


def test_taylor_goes_through_a_smooth_contact():
    """The stiffness decides how long the ball stays, and so how high it is later: 2.94 (m^2 / k^2 v)^(1/5) of Hertz."""
    known, end = KNOWN["hertz"]["undamped"], 4e-3
    p = mb.Parameters(k=known["k"])
    scene = falling(mb.HuntCrossley(p.k, 1.0, 1.0), [0.0, end], speed=1.0, p=p).with_box(mb.Box.around(p, 0.02))
    bounds = mb.propagate(scene, mb.Taylor(order=2))["y"]
    attained = [end - known["duration"] * share**-0.4 for share in (0.98, 1.02)]
    assert_allclose([edge[1] for edge in bounds], attained, atol=5e-7)  # in a width of 3e-5


# Laws of contact: their formulas, no pull, and derivatives that stay finite at and beyond touch, however evaluated.

K, E, V = 1e8, 0.7, 2.0
RING = mb.Table([0.0, 1e-3, 3e-3], [0.0, 4e4, 9e5])
FORMULAS = {
    "HuntCrossley": (mb.HuntCrossley(K, E, V), 3 * (1 - E) / (2 * V)),
    "LankaraniNikravesh": (mb.LankaraniNikravesh(K, E, V), 3 * (1 - E**2) / (4 * V)),
    "Flores": (mb.Flores(K, E, V), 8 * (1 - E) / (5 * E * V)),
    "HuntCrossley, other exponent": (mb.HuntCrossley(K, E, V, exponent=2.2), 3 * (1 - E) / (2 * V)),
    "HuntCrossley, linear": (mb.HuntCrossley(K, E, V, exponent=1), 3 * (1 - E) / (2 * V)),
    "spring": (mb.HuntCrossley(K, 1.0, V), 0.0),
}
EVERY = {name: law for name, (law, _) in FORMULAS.items()} | {
    "KelvinVoigt": mb.KelvinVoigt(1e6, 210.0),
    "Tabulated": mb.Tabulated(RING, 150.0),
}
D, RATE = ca.SX.sym("d"), ca.SX.sym("rate")
DEPTHS = (-1.0, -1e-3, -1e-300, -0.0, 0.0, 5e-324, 1e-13, 1e-11, 1e-9, 1e-4, 2e-3)
STATES = np.array([(d, rate) for d in DEPTHS for rate in (-9.0, -0.5, 0.0, 0.5, 9.0)])
every = pytest.mark.parametrize("law", EVERY.values(), ids=EVERY)


def evaluated(expression):
    return ca.Function("f", [D, RATE], [expression])(*STATES.T[:, None, :]).full().T


@pytest.mark.parametrize("name", [*FORMULAS, "KelvinVoigt"])
def test_a_force_is_that_of_its_formula_and_pushes_only(name):
    law, (d, rate) = EVERY[name], STATES.T
    expected = np.where(d > 0, np.maximum(1e6 * d + 210 * rate, 0), 0)
    if name in FORMULAS:
        d, chi = np.maximum(d, 0), FORMULAS[name][1]
        expected = np.where(d > 1e-12, K * d ** float(law.exponent) * np.maximum(1 + chi * rate, 0), 0)
    assert_allclose(evaluated(law.force(D, RATE))[:, 0], expected, rtol=1e-14)


def test_a_tabulated_force_pushes_only():
    values = evaluated(EVERY["Tabulated"].force(D, RATE))[:, 0]
    at = dict(zip(map(tuple, STATES.tolist()), values.tolist(), strict=True))
    assert at[2e-3, 0.5] == pytest.approx(float(RING(2e-3)) + 75)
    assert at[2e-3, -9.0] == pytest.approx(float(RING(2e-3)) - 1350)
    assert at[1e-4, -0.5] == pytest.approx(float(RING(1e-4)) - 75)
    assert at[1e-9, -9.0] == at[-1e-3, 9.0] == 0


@every
def test_forces_and_derivatives_are_finite_and_vanish_before_touch(law):
    expression, apart = law.force(D, RATE), STATES[:, 0] <= 0
    for order in range(4):
        values = evaluated(expression)
        assert np.isfinite(values).all(), order
        assert_array_equal(values[apart], 0)
        assert np.abs(values[STATES[:, 0] == 2e-3]).max() > 0 or order > 1
        expression = ca.vec(ca.jacobian(expression, ca.vertcat(D, RATE)))


@every
def test_taylor_coefficients_are_finite_and_those_of_differences(law):
    curve = [[ca.SX.sym(f"{name}{k}") for k in range(4)] for name in ("d", "rate")]
    coefficients = ca.vertcat(*jets(law.force(curve[0][0], curve[1][0]), curve))
    f = ca.Function("jets", [ca.vertcat(*curve[0], *curve[1])], [coefficients])
    rng = np.random.default_rng(1)
    for state in STATES:
        assert np.isfinite(f([state[0], *rng.uniform(-1, 1, 3), state[1], *rng.uniform(-1, 1, 3)]).full()).all()
    d, rate, h = np.array([1.1e-3, 0.2, -0.3, 0.5]), np.array([0.4, -0.6, 0.2, 0.1]), 1e-5
    force = ca.Function("force", [D, RATE], [law.force(D, RATE)])
    at = [float(force(np.polyval(d[::-1], k * h), np.polyval(rate[::-1], k * h))) for k in (-2, -1, 0, 1, 2)]
    slope = (at[0] - 8 * at[1] + 8 * at[3] - at[4]) / 12
    curvature = (-at[0] + 16 * at[1] - 30 * at[2] + 16 * at[3] - at[4]) / 12
    expected = [at[2], slope / h, curvature / (2 * h**2)]
    assert_allclose(f([*d, *rate]).full()[:3, 0], expected, rtol=1e-4)


@every
def test_compiled_lanes_agree_with_casadi(law):
    x, p, t = ca.SX.sym("x", 2), ca.SX.sym("p"), ca.SX.sym("t")
    parts = [law.force(x[0], x[1])]
    for _ in range(3):
        parts.append(ca.vec(ca.jacobian(parts[-1], x)))
    outputs = ca.densify(ca.vertcat(*parts))
    f = model_function(x, p, t, ca.SX.zeros(2), outputs, None)
    engine = Engine(Lanes(f, StepTolerances(1e-8, 1e-8)), np.array([0.0]))
    Y, losses = engine.values(STATES, np.ones((len(STATES), 1)))
    assert np.isnan(losses.t_failed).all()
    expected = ca.Function("f", [x], [outputs])(STATES.T).full().T
    assert_allclose(Y[:, 0], expected, rtol=1e-13, atol=1e-300)


@pytest.mark.parametrize(
    ("law", "text"),
    [
        (lambda: mb.HuntCrossley(-1.0, 0.5, 1.0), r"HuntCrossley: stiffness is -1; it must be above 0\."),
        (lambda: mb.Flores(1.0, 1.5, 1.0), "Flores: restitution is 1.5; it must be above 0 and at most 1"),
        (lambda: mb.Flores(1.0, 0.0, 1.0), "Flores: restitution is 0; it must be above 0"),
        (lambda: mb.LankaraniNikravesh(1.0, 0.5, 0.0), "LankaraniNikravesh: speed is 0; it must be above 0"),
        (lambda: mb.HuntCrossley(1.0, 0.5, 1.0, exponent=0.5), "exponent is 0.5; it must be at least 1"),
        (lambda: mb.KelvinVoigt(1.0, -2.0), "KelvinVoigt: damping is -2; it must be at least 0"),
        (lambda: mb.KelvinVoigt(float("nan")), "KelvinVoigt: stiffness is nan"),
        (lambda: mb.Tabulated(RING, -1.0), "Tabulated: damping is -1"),
        (lambda: mb.Coulomb(0.3, 1e-3, static=0.2), "Coulomb: static is 0.2; it must be at least 0.3"),
        (lambda: mb.Coulomb(0.3, 0.0), "Coulomb: speed is 0; it must be above 0"),
        (lambda: mb.Bristle(0.3, 0.0), "Bristle: stiffness is 0; it must be above 0"),
        (lambda: mb.Bristle(0.0, 1e5), "Bristle: kinetic is 0; it must be above 0"),
    ],
)
def test_numbers_out_of_range_are_refused(law, text):
    refused(text, law)


@every
@pytest.mark.parametrize("number", [np.longdouble("2e-3"), np.float32(2e-3), np.array(2e-3)])
def test_a_law_takes_every_kind_of_number(law, number):
    assert_allclose(float(law.force(number, np.longdouble(0.5))), float(law.force(ca.SX(float(number)), ca.SX(0.5))))


@every
def test_a_law_refuses_what_is_no_number(law):
    refused("expected one number", law.force, "deep", RATE)
