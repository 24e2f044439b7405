"""Switches, contacts and forces that are short in a step are not passed over; planted faults of passes are doubted."""

from dataclasses import replace
from functools import cache
from itertools import product

import casadi as ca
import machines
import numpy as np
import pytest
from conftest import but_long, in_turns
from faults import warned
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.special import gammaln
from small_scenes import particle
from test_step_ends import ULP, pushed

import symmb as mb
from symmb.run.events import Kinks
from symmb.run.integrate import compiled, multistep


def wheel(act, rate, end, growth=0.0, **more):
    """A wheel that turns evenly or ever faster, and a particle that is pushed by 1 N times act(angle)."""
    body, rotor = mb.Body("body", 1.0, pose=mb.Particle()), mb.Body("rotor", 1.0, 2.0)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rotor.point(0, 0))
    p = mb.Parameters(force=1.0)
    push = mb.Force("push", body.point(0, 0, 0), (p.force * act(hinge.angle), 0, 0))
    motor = [mb.Actuator("motor", hinge, 2.0 * growth)] if growth else []
    system = mb.System(body, rotor, hinge, push, *motor, parameters=p)
    box = mb.Box.around(p, 0.1)
    return mb.Scene(system, {"hinge.angle_rate": rate}, np.linspace(0, end, 7), {"v": body.vx}, box=box, **more)


@cache
def share_of(act, rate, end):
    """The time of action: an integral over many points."""
    t = (np.arange(2_000_000) + 0.5) * end / 2_000_000
    return act(ca.DM(rate * t)).full().mean() * end


ACTS = {
    "kick": lambda a: ca.if_else(ca.cos(a) < -0.9, 1.0, 0.0),
    "short kick": lambda a: ca.if_else(ca.sin(a + 0.3) > 0.999, 1.0, 0.0),
    "cam": lambda a: ca.fmax(ca.cos(3 * a) - 0.8, 0),
    "window": lambda a: ca.if_else(ca.logic_and(ca.fmod(a, 2 * np.pi) > 2.0, ca.fmod(a, 2 * np.pi) < 2.3), 1.0, 0.0),
    "sawtooth": lambda a: a / 2.1 - ca.floor(a / 2.1),
    "remainder": lambda a: ca.remainder(a - 0.2, 1.7),
    "steps": lambda a: ca.ceil(0.4 * a),
    "commutator": lambda a: ca.sign(ca.sin(2 * a + 0.1)) * ca.cos(a),
}


@pytest.mark.parametrize("solver", [None, mb.CVODES()], ids=["chosen", "CVODES"])
@pytest.mark.parametrize("rate", [pytest.param(2 * np.pi, marks=pytest.mark.long), -9.1])
@pytest.mark.parametrize("act", ACTS.values(), ids=ACTS)
def test_a_wheel_that_turns_evenly_acts_in_each_turn(act, rate, solver):
    run = mb.simulate(wheel(act, rate, 5.3), solver)
    assert run["v"][-1] == pytest.approx(share_of(act, rate, 5.3), abs=2e-5) and not run.doubts


def test_bounds_of_a_study_know_each_turn():
    bounds = mb.propagate(wheel(ACTS["kick"], 2 * np.pi, 10.2), mb.PolynomialChaos())
    exact = share_of(ACTS["kick"], 2 * np.pi, 10.2)
    np.testing.assert_allclose([bounds["v"][0][-1], bounds["v"][1][-1]], [0.9 * exact, 1.1 * exact], rtol=1e-4)


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES(), mb.Rosenbrock()], ids=repr)
@pytest.mark.parametrize(("width", "gravity"), [(0.01, 0.0), (0.001, 0.05)])
def test_a_force_contact_that_is_short_in_the_run_acts(width, gravity, solver):
    bump = lambda x: 0.1 / (1 + ((x - 0.48712) / width) ** 2)  # noqa: E731
    law = lambda p, mass: (0, ca.fmax(0, bump(mass.x) - mass.y) * 100 / width - gravity)  # noqa: E731
    scene = particle(law, np.linspace(0, 1, 21), {"mass.vx": 1.0, "mass.y": 0.05}, ("vy",))

    def rates(t, x):
        return [x[1], 100 / width * max(0, bump(t) - x[0]) - gravity]

    exact = solve_ivp(rates, (0, 1), [0.05, 0.0], rtol=1e-10, atol=1e-12, max_step=width / 20).y[1, -1]
    assert mb.simulate(scene, solver)["vy"][-1] == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("width", [0.3, 0.05, 0.01, 0.0004])
def test_an_impact_with_a_narrow_bump_happens(width):
    """A ball at the height of 0.05 m meets a triangle of 0.1 m at half its flank and rebounds without loss."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    gap = ball.y - 0.1 * ca.fmax(0, 1 - ca.fabs((ball.x - 0.48712) / width))
    scene = mb.Scene(mb.System(ball, mb.Impact("wall", gap, 1.0)), {"ball.vx": 1, "ball.y": 0.05}, np.linspace(0, 1, 5))
    run = mb.simulate(scene)
    normal = np.array([-0.1 / width, 1.0]) / np.hypot(0.1 / width, 1.0)
    assert [event.time for event in run.events] == [pytest.approx(0.48712 - width / 2, abs=1e-9)]
    rebound = np.array([1.0, 0.0]) - 2 * normal[0] * normal
    np.testing.assert_allclose([run["ball.vx"][-1], run["ball.vy"][-1]], rebound, atol=1e-8)


PULSE = [0, 0.2, 0.201, 0.202, 0.5], [0, 0, 1e2, 0, 0]
PERIODIC = {
    "PWM": (lambda t: ca.if_else(ca.fmod(t, 0.01) < 0.003, 1.0, 0.0), 3.0, 0.9),
    "PWM by floor": (lambda t: ca.if_else(t / 0.02 - ca.floor(t / 0.02) < 0.1, 1.0, 0.0), 3.0, 0.3),
    "window": (lambda t: ca.if_else(ca.fabs(ca.remainder(t - 0.05, 0.1)) < 1e-4, 1e3, 0.0), 2.0, 4.0),
    "table": (lambda t: mb.Table(*PULSE)(ca.fmod(t, 0.5)), 20.0, 40 * PchipInterpolator(*PULSE).integrate(0, 0.5)),
    "sawtooth": (lambda t: ca.fmod(t, 0.7), 7.0, 2.45),
}


@pytest.mark.parametrize("solver", [None, mb.CVODES(), mb.CVODES(stiff=True)], ids=["chosen", "Adams", "BDF"])
@pytest.mark.parametrize("law", PERIODIC)
def test_each_period_of_a_law_of_time_acts(law, solver):
    law, end, exact = PERIODIC[law]
    run = mb.simulate(particle(lambda p, mass: law(mb.t), np.linspace(0, end, 7), {}, ("vx",)), solver)
    assert run["vx"][-1] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("height", [0.6, 100.0])
@pytest.mark.parametrize("law, width", [(lambda u: 1 - ca.tanh(u) ** 2, 1e-4), (lambda u: 1 / ca.cosh(u) ** 2, 1e-6)])
def test_a_smooth_wall_turns_a_motion_back(law, width, height):
    """Its work is more than the energy of the motion."""
    wall = lambda p, mass: -height * law((mass.x - 0.48712) / width) / (2 * width)  # noqa: E731
    scene = particle(wall, np.linspace(0, 1, 21), {"mass.vx": 1.0}, ("vx",))
    assert mb.simulate(scene, mb.CVODES())["vx"][-1] == pytest.approx(-1.0, abs=1e-8)


@pytest.mark.parametrize("start", [-3.8216, -0.4, -2.2, 1.1, 3.8216])
@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES()], ids=repr)
def test_switches_that_jump_together_at_the_end_of_a_period_all_change_their_sides(start, solver):
    """Where a table's argument jumps from 0 to 1, or back, its four comparisons change at once, in any order."""
    rate, width, turns = np.copysign(5.0 + abs(start), start), 0.007, 12
    table = mb.Table([0.0, 0.3, 0.3 + width / 2, 0.3 + width, 1.0], [0, 0, 1, 0, 0])

    def act(angle):
        phase = (angle - start) / 0.5348
        return table(phase - ca.floor(phase))

    scene, exact = wheel(act, rate, turns * 0.5348 / abs(rate)), turns * width / 2 * 0.5348 / abs(rate)
    run = mb.simulate(scene, solver)
    assert run["v"][-1] == pytest.approx(exact, rel=1e-6) and not run.doubts


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES(), mb.IDAS()], ids=repr)
@pytest.mark.parametrize("rate", [17.433085077951812, 17.60741592873133, 9.1])
def test_windows_of_a_size_of_a_remainder_end_on_time(rate, solver):
    """Where the remainder jumps, its sign changes at once, but not the side of the window, which depends on that."""
    growth, shift, width = 1.928769252190923, 0.26745279129822047, 0.0036916610662172606 * 2 * np.pi

    def act(a):
        return ca.if_else(ca.fabs(ca.remainder(a - shift, 2 * np.pi)) < width, 1.0, 0.0)

    edges = shift + 2 * np.pi * np.arange(40)[:, None] + np.array([-width, width])
    begins, ends = ((np.sqrt(rate**2 + 2 * growth * edges) - rate) / growth).T
    scene = wheel(act, rate, 5.0, growth).with_times(np.linspace(0, 5.085779139075851, 11))
    exact = np.clip(scene.times[:, None] - begins, 0.0, ends - begins).sum(axis=1)
    run = mb.simulate(scene, solver)
    assert_allclose(run["v"], exact, atol=1e-8)
    assert not run.doubts


def test_a_study_of_pulses_that_are_shorter_than_the_steps_of_its_check_is_not_doubted():
    table = mb.Table([0.0, 0.3, 0.3005, 0.301, 1.0], [0, 0, 1, 0, 0])
    bounds = mb.propagate(wheel(lambda a: table(a - ca.floor(a)), 3.0, 7.0), mb.Vertex())
    exact = 21 * 0.0005 / 3.0 * np.array([0.9, 1.1])
    np.testing.assert_allclose([bounds["v"][0][-1], bounds["v"][1][-1]], exact, rtol=1e-6)
    assert not bounds.doubts


@pytest.mark.parametrize(("rate", "growth", "width"), [(-1.2563, -0.0309, 4e-4), (0.83, 0.02, 1e-4), (2.9, 0.0, 2e-3)])
@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES(), mb.CVODES(stiff=True)], ids=repr)
def test_windows_that_are_much_shorter_than_times_of_passes_may_be_off(rate, growth, width, solver):
    """Each window has the impulse of a triangle, its width over the speed there."""
    near = lambda a: width - ca.fabs(ca.fmod(a + 1000 * np.pi, 2 * np.pi) - 1)  # noqa: E731
    end = 60.0
    run = mb.simulate(wheel(lambda a: ca.fmax(near(a), 0) / width, rate, end, growth), solver)
    last = rate * end + growth * end**2 / 2
    angles = 1 + 2 * np.pi * np.arange(-60, 60)
    passed = angles[(angles > min(0.0, last)) & (angles < max(0.0, last))]
    assert run["v"][-1] == pytest.approx((width / np.sqrt(rate**2 + 2 * growth * passed)).sum(), rel=1e-5)


@pytest.mark.parametrize("solver", but_long([mb.CVODES(), mb.IDAS(), mb.DormandPrince()], mb.IDAS()), ids=repr)
@pytest.mark.parametrize("bump", [(0.31, 3e-4, -3000.0), (-0.52, 4e-4, -2500.0), (0.2, 2e-3, 900.0)])
def test_more_passes_of_a_table_than_are_noted_are_a_doubt(solver, bump):
    (centre, width, height), at = bump, np.linspace(-2, 2, 50_001)
    forces = height * np.exp(-np.minimum(((at - centre) / width) ** 2, 100.0))
    body = mb.Body("body", 1.1, 0.1, mb.Planar())
    rail = mb.Prismatic("rail", mb.Ground().point(0, 0), body.point(0, 0), axis=(1, 0))
    x, v = rail.displacement, rail.displacement_rate
    push, lost = mb.Actuator("push", rail, mb.Table(at, forces)(x) - 40 * x - 0.3 * v), mb.State("lost", 0.3 * v**2)
    outputs = {"x": x, "v": v, "lost": lost.value}
    system, times = mb.System(body, rail, push, lost), np.linspace(0, 4, 81)
    run = mb.simulate(mb.Scene(system, {"rail.displacement_rate": 4.0}, times, outputs), solver)
    work = PchipInterpolator(at, forces).antiderivative()(run["x"])  # of the area of the bump, whatever the steps
    energy = 0.55 * run["v"] ** 2 + 20 * run["x"] ** 2 - (work - work[0]) + run["lost"]
    if solver == mb.DormandPrince() or not run.doubts:
        assert_allclose(energy, energy[0], rtol=1e-5)
    else:
        assert any("passes more than 1000 kinks or jumps (table)" in doubt for doubt in run.doubts)


EXPLICIT = [None, mb.DormandPrince(), mb.EventDriven(), mb.StateSpace(), mb.CVODES()]
IMPLICIT = [mb.CVODES(stiff=True), mb.IDAS(), mb.StabilizedIndex2(), mb.NSTIFFSI2(step=1.0, rtol=1e-9)]
PULSES = {
    "Gaussian": lambda u: ca.exp(-(u**2)) / np.sqrt(np.pi),
    "tanh": lambda u: (ca.tanh(u) - ca.tanh(u - 2)) / 4,
    "erf": lambda u: (ca.erf(u) - ca.erf(u - 2)) / 4,
    "cosh": lambda u: 0.5 / ca.cosh(u) ** 2,
    "logistic": lambda u: (1 / (1 + ca.exp(-u)) - 1 / (1 + ca.exp(3 - u))) / 3,
}
"""Functions with an integral of 1. Derivatives of the last two overflow far away, which stops implicit solvers."""


FOLLOWED = *in_turns(EXPLICIT, PULSES, [1e-2, 1e-5, 1e-8]), *product(IMPLICIT, ["Gaussian", "tanh"], [1e-2, 1e-6])


@pytest.mark.parametrize(("solver", "pulse", "width"), FOLLOWED, ids=str)
def test_pulses_of_position_do_their_work(solver, pulse, width):
    run = mb.simulate(pushed(lambda p, m: PULSES[pulse]((m.x - 2.1) / p.width) / p.width, width=width), solver)
    assert_allclose(run["v"][1:], np.sqrt(3), rtol=0, atol=3e-6 + 8 * ULP / width)


TURNING = [None, mb.DormandPrince(), mb.CVODES(), mb.IDAS(), mb.CVODES(stiff=True)]


@pytest.mark.parametrize("solver, power, start", in_turns(TURNING, [9, 30, 50, 200, 5000], [0.3, 5.1, -1.14]), ids=str)
def test_powers_of_a_wheel_s_cosine_act_in_each_turn(solver, power, start):
    """The first force may be 1e-100. The mean of cos(x)**2n over a turn is (2n)! / (2**n n!)**2, here n = power."""
    end = 10 * np.pi / 3
    scene = wheel(lambda a: ((1 + ca.cos(start + a - 2)) / 2) ** power, 6.0, end).with_times([0.0, end])
    mean = np.exp(gammaln(2 * power + 1) - 2 * gammaln(power + 1) - 2 * power * np.log(2))
    assert_allclose(mb.simulate(scene, solver)["v"][-1], end * mean, rtol=2e-6)


@pytest.mark.parametrize("width", [1e-3, 1e-7])
@pytest.mark.parametrize("pulse", ["Gaussian", "erf"])
@pytest.mark.parametrize("solver", [*EXPLICIT, *IMPLICIT], ids=repr)
def test_pulses_of_time_have_their_impulse(solver, pulse, width):
    run = mb.simulate(pushed(lambda p, m: PULSES[pulse]((mb.t - 1.2345) / p.width) / p.width, width=width), solver)
    assert_allclose(run["v"][1:], 2, rtol=0, atol=3e-6 + 4 * ULP / width)


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("solver", [None, mb.DormandPrince()], ids=repr)
def test_a_motion_beside_the_middle_of_a_pulse_in_the_plane(solver, width):
    def push(p, mass):
        return ca.exp(-((mass.x - 2.1) ** 2 + mass.y**2) / p.width**2) / (np.sqrt(np.pi) * p.width)

    start = {"mass.vx": 1.0, "mass.y": width / 3}
    run = mb.simulate(particle(push, [0.0, 5.0], start, ("vx",), width=(width, width)), solver)
    assert_allclose(run["vx"][-1], np.sqrt(1 + 2 * np.exp(-1 / 9)), rtol=0, atol=1e-6 + 8 * ULP / width)


def test_every_sample_has_its_own_pulse():
    def push(p, m):
        return PULSES["Gaussian"]((m.x - p.place) / p.width) / p.width

    simulator = mb.DAESimulator(pushed(push, place=2.0, width=1e-4), mb.DormandPrince())
    places, widths = np.linspace(0.3, 4.2, 40), np.geomspace(1e-6, 1e-2, 40)
    assert_allclose(simulator.run(np.column_stack([places, widths])).Y[:, -1, 1], np.sqrt(3), rtol=0, atol=1e-6)


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), mb.CVODES()], ids=repr)
@pytest.mark.parametrize(("rate", "level"), [(6.3, -0.9), (-2.1, 0.2), (11.0, -0.5)])
def test_a_pass_that_the_states_show_and_the_run_did_not_make_is_doubted(rate, level, solver, monkeypatch):
    act = lambda a: ca.if_else(ca.cos(a) < level, 1.0, 0.0) + ca.fmax(ca.sin(a) - 0.5, 0)  # noqa: E731
    scene = wheel(act, rate, 5.0).with_times(np.linspace(0, 5, 501))
    assert not mb.simulate(scene, solver).doubts

    def without_one(stops):
        return stops._replace(passes=np.where(np.arange(stops.passes.shape[-1]) == 3, np.inf, stops.passes))

    of_engine, of_passes = compiled.stops_at, multistep.SwitchPasses.stops
    monkeypatch.setattr(compiled, "stops_at", lambda passes: without_one(of_engine(passes)))
    monkeypatch.setattr(multistep.SwitchPasses, "stops", lambda self, *of: without_one(of_passes(self, *of)))
    warned("passes a switch after t = .* no step of the run ended", mb.simulate, scene.with_times(scene.times), solver)


def test_values_that_are_rounding_are_on_no_side():
    x, p, t = ca.SX.sym("x", 2), ca.SX.sym("p", 0), ca.SX.sym("t")
    located = np.array([True, True])
    kinks = Kinks(("fabs",), ca.Function("switches", [x, p, t], [x]), located, located)
    times = np.linspace(0, 1, 101)
    X = np.column_stack([np.where(np.arange(101) < 50, 1.0, 1e-9 * (-1.0) ** np.arange(101)), times - 0.7051])
    values = kinks.values(X, np.empty(0), times)
    assert kinks.passed_over(values, times, np.empty(0)) == pytest.approx(0.70)
    assert np.isnan(kinks.passed_over(values, times, np.array([0.7051])))


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("height", [1.0, 1e-3])
def test_a_gap_below_0_is_doubted(restitution, height, monkeypatch):
    times = np.linspace(0, 0.9 * np.sqrt(8 * height / 9.81), 5)
    scene = machines.bouncing_ball(restitution=restitution).scene(None, times, {"ball.y": height})
    assert not mb.simulate(scene).doubts

    def blind(self, x0, p, threads=1, real=compiled.CompiledIntegration.run):
        """The ball falls through the floor."""
        (run,) = real(self, x0, p, threads)
        y, v = height - 9.81 / 2 * self.times**2, -9.81 * self.times
        return [replace(run, X=np.column_stack([y, v, np.zeros_like(y)]), events=())]

    monkeypatch.setattr(compiled.CompiledIntegration, "run", blind)
    told = "gap of Impact 'floor' is -.* m at t = .*the run missed an impact"
    warned(told, mb.simulate, scene.with_times(scene.times))  # nothing is prepared for this one
