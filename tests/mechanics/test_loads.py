"""Loads of machines against closed forms and equations written by hand."""

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import ORIGIN, ball, run_of
from mechanisms import exact
from numpy.testing import assert_allclose

import symmb as mb

SOLVERS = (mb.DormandPrince(rtol=1e-9), mb.CVODES())
solvers = pytest.mark.parametrize("solver", SOLVERS, ids=repr)
TIMES = np.linspace(0, 0.5, 51)


def piston(pull, times=TIMES, speed=0.0, parameters=None):
    """2 kg on a line, 1 m from the wall."""
    body = mb.Body("piston", 2.0, pose=mb.Particle())
    spring = mb.NonlinearSpring("spring", ORIGIN, body.point(0, 0), pull)
    start = {"piston.x": 1.0, "piston.y": 0.0, "piston.z": 0.0, "piston.vx": speed}
    return mb.Scene(mb.System(body, spring, parameters=parameters), start, times, {"x": body.x, "v": body.vx})


def standing(law, g, times, **start):
    """A run of a foot on soil."""
    foot = mb.Body("foot", 2.0, 0.1, mb.Planar())
    soil = mb.Soil("soil", ORIGIN, foot.point(0, 0), (0, 1, 0), law)
    return run_of(foot, soil, mb.Gravity(0, -g), start={f"foot.{k}": v for k, v in start.items()}, times=times)


def by_hand(pull, speed=0.0, times=TIMES):
    return exact(lambda t, y: [y[1], -pull(y[0], y[1]) / 2], [1.0, speed], times)


@solvers
def test_a_nonlinear_spring_follows_its_law(solver):
    p = mb.Parameters(k=300.0)
    scene = piston(lambda d, v: p.k * (d - 0.9) ** 3 + 4 * v * ca.fabs(v), speed=1.0, parameters=p)
    run = mb.simulate(scene, solver)
    assert_allclose(run.values, by_hand(lambda d, v: 300 * (d - 0.9) ** 3 + 4 * v * abs(v), 1.0), atol=1e-7)
    assert run.energy_drift < 1e-7


def test_a_nonlinear_spring_is_finite_where_its_points_meet():
    run = mb.simulate(piston(lambda d, v: 50 * d, [0.0, np.pi / 5, 2 * np.pi / 5]))  # through the wall's point
    assert_allclose(run["x"], [1, -1, 1], atol=1e-6)


@solvers
def test_a_gas_spring_turns_speed_into_pressure(solver):
    """Pressed until p V0 / (n - 1) ((V / V0)^(1 - n) - 1) is the kinetic energy it had."""
    pressure, volume, area, n = 2e5, 2e-3, 4e-3, 1.3
    gas = mb.GasSpring(pressure, volume, area, length=1.0, exponent=n)
    run = mb.simulate(piston(gas, np.linspace(0, 0.1, 4001), speed=-10.0), solver)
    work = pressure * volume / (n - 1)
    share = (1 + 0.5 * 2.0 * 10.0**2 / work) ** (-1 / (n - 1))
    assert run["x"].min() == pytest.approx(1 - volume * (1 - share) / area, abs=1e-5)
    x, v = run.values.T
    assert_allclose(v**2 + work * ((1 + area * (x - 1) / volume) ** (1 - n) - 1), 100.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("law", "told"),
    [
        (lambda: mb.GasSpring(-1e5, 1e-3, 1e-3, 0.3), "GasSpring: pressure is -100000; it must be at least 0"),
        (lambda: mb.GasSpring(1e5, 0.0, 1e-3, 0.3), "GasSpring: volume is 0; it must be above 0"),
        (lambda: mb.GasSpring(1e5, 1e-3, 1e-3, 0.3, np.nan), "GasSpring: exponent is nan; it must be above 0"),
        (lambda: mb.Orifice(1e-2, 0), "Orifice: opening is 0; it must be above 0"),
        (lambda: mb.Orifice(1e-2, 1e-4, density=-1.0), "Orifice: density is -1; it must be at least 0"),
    ],
)
def test_what_no_gas_and_no_opening_has_is_refused(law, told):
    refused(told, law)


@pytest.mark.parametrize(("damping", "length"), [(-0.7, 0.0), (0.0, -0.4), (-0.3, -1.1)])
def test_dampers_may_drive_and_springs_may_be_closed_under_tension(damping, length):
    machine = ball(lambda m: mb.SpringDamper("strut", ORIGIN, m.at, 3.0, damping, length), mass=2.0, g=None)
    t, start = np.linspace(0.0, 0.3, 4), {"ball.x": 1.0, "ball.vx": 0.5}
    run = machine.run("x", t, start, solver=mb.CVODES(rtol=1e-10))
    expected = exact(lambda t, y: [y[1], -(3 * (y[0] - length) + damping * y[1]) / 2], [1.0, 0.5], t)
    assert_allclose(run["x"], expected[:, 0], rtol=1e-8)
    assert run.doubts == ()


def test_a_recuperator_is_pressed_as_its_points_part():
    force = mb.GasSpring(2e5, 2e-3, -4e-3, length=1.0)
    assert float(force(ca.SX(1.0), ca.SX(0))) == pytest.approx(800.0)
    assert float(force(ca.SX(1.25), ca.SX(0))) == pytest.approx(800.0 * 2**1.4)
    assert float(force(ca.SX(9.0), ca.SX(0))) == pytest.approx(800.0 * 100**1.4)  # bottomed


@solvers
def test_an_orifice_brakes_by_the_square_of_the_speed(solver):
    """v' = -c v^2: v = v0 / (1 + c v0 t), while the flow is turbulent."""
    brake = mb.Orifice(area=2e-3, opening=5e-4, density=870.0, discharge=0.7)
    c = 0.5 * 870 * (2e-3) ** 3 / (0.7 * 5e-4) ** 2 / 2.0
    run = mb.simulate(piston(brake, speed=3.0), solver)
    assert_allclose(run["v"], 3 / (1 + 3 * c * TIMES), rtol=1e-5)
    assert run.energy_drift < 1e-7


@solvers
def test_a_throttling_ring_closes_along_the_stroke(solver):
    """An opening read from a table of the stroke, ten times as large backwards, and a spring that drives it back."""
    ring = mb.Table([0.0, 0.05, 0.1, 0.2], [2e-4, 1.5e-4, 0.5e-4, 0.3e-4])
    brake = mb.Orifice(2e-3, lambda s, v: ca.if_else(v > 0, 1, 10) * ring(s), length=1.0)
    run = mb.simulate(piston(lambda d, v: brake(d, v) + 200 * (d - 1), speed=4.0), solver)
    curve = ca.Function("ring", [X := ca.SX.sym("x")], [ring(X)])

    def pull(d, v):
        area = (1 if v > 0 else 10) * float(curve(d - 1))
        return 0.5 * 870 * (2e-3) ** 3 / (0.7 * area) ** 2 * v * np.sqrt(v**2 + 1e-6) + 200 * (d - 1)

    assert run["v"].min() < -0.1
    assert_allclose(run.values, by_hand(pull, 4.0), atol=1e-5)


def test_soil_carries_and_lets_go():
    """Dropped on soil without damping: a fall, a half swing on the spring, and a flight as high as before."""
    k, g, height = 4e4, 10.0, 0.05
    fall, w = np.sqrt(2 * height / g), np.sqrt(k / 2.0)
    v = g * fall
    touch = 2 * (np.pi - np.arctan2(w * v, g)) / w
    times = [0.0, fall, fall + touch, 2 * fall + touch]
    run = standing(mb.KelvinVoigt(k), g, times, y=height)
    assert_allclose(run["foot.y"], [height, 0, 0, height], atol=1e-8)
    assert_allclose(run["foot.vy"], [0, -v, v, 0], atol=1e-6)
    assert_allclose(run.energy.work, 0)


def test_soil_holds_across_its_normal_and_about_all_axes():
    """Pressed down it is a bushing; above the ground its normal force alone is gone."""
    plate = mb.Body("plate", 2.0, (0.1, 0.2, 0.3), mb.Spatial())
    ends, turning = (ORIGIN, plate.point(0.1, 0.2, 0)), ((20.0, 30.0, 40.0), (2.0, 3.0, 4.0))
    law, across = mb.KelvinVoigt(1e4, 50.0), ((3e3, 5e3, 0), (30.0, 40.0, 0))
    soil = mb.System(plate, mb.Soil("s", *ends, (0, 0, 1), law, *across, *turning))
    bushing = mb.System(plate, mb.Bushing("s", *ends, (3e3, 5e3, 1e4), (30.0, 40.0, 50.0), *turning))
    soil, bushing = (ca.Function("Q", [system.q, system.v], [system.Q]) for system in (soil, bushing))
    v = [0.1, 0.2, -0.3, 0.2, -0.1, 0.4]
    pressed, lifted = ([0.01, -0.02, z, 1, 0.02, -0.03, 0.1] for z in (-0.1, 0.2))
    assert_allclose(soil(pressed, v).full(), bushing(pressed, v).full(), rtol=1e-12)
    difference = (soil(lifted, v) - bushing(lifted, v)).full()[:3, 0]
    assert difference[2] > 1000
    assert_allclose(difference[:2], 0, atol=1e-9)
    assert soil(lifted, v).full()[2, 0] == 0


def test_measured_soil_is_a_table():
    law = mb.Tabulated(mb.Table([0, 0.01, 0.02], [0.0, 15.0, 60.0]), damping=100.0)
    run = standing(law, 10.0, np.linspace(0, 5, 501))
    assert float(law.table(-run["foot.y"][-1])) == pytest.approx(20.0, rel=1e-6)
    assert run.energy_drift < 1e-6
