"""Narrow zones of position and short contacts, also by solvers whose steps end where a run of DormandPrince passes."""

from itertools import product

import casadi as ca
import numpy as np
import pytest
from conftest import in_turns
from faults import refused, warned
from machines import bob
from numpy.testing import assert_allclose
from small_scenes import particle
from test_step_ends import CONTROLLED, ULP, bouncing, oscillator, overdamped_stop, pushed
from test_step_ends import WIDTHS as ALL_WIDTHS

import symmb as mb
from symmb.run.integrate.switch_passes import SwitchPasses

SIDED = [s for s in CONTROLLED if not isinstance(s, mb.Rosenbrock | mb.NSTIFFSI2 | mb.EventDriven)]
"""Solvers whose runs are pieces on one side of each switch."""
WIDTHS = [1e-3, 1e-6, 1e-9]


def inside(x, width, begin=2):
    return ca.logic_and(x > begin, x < begin + width)


LAWS = {
    "jump": lambda p, m: ca.if_else(inside(m.x, p.width), 1 / p.width, 0),
    "ramp": lambda p, m: ca.if_else(inside(m.x, p.width), 0.5 / p.width + (m.x - 2) / p.width**2, 0),
    "fabs": lambda p, m: ca.if_else(ca.fabs(m.x - 2 - p.width / 2) < p.width / 2, 1 / p.width, 0),
}
"""Forces of work 1 from 2 to 2 + width."""
THROUGH = {"jump": np.sqrt(3) - 1, "ramp": np.arcsinh(np.sqrt(3)) - np.arcsinh(np.sqrt(1 / 3)), "fabs": np.sqrt(3) - 1}
"""Times from 2 to 2 + width at 1 m/s before, over the width: v'= 1 / width of a jump."""


NARROW = [pytest.param(s, "Table", WIDTHS[-1], marks=pytest.mark.long) for s in SIDED]  # a minute each for CasADi's


@pytest.mark.parametrize(
    ("solver", "law", "width"),
    [*product([mb.DormandPrince()], LAWS, ALL_WIDTHS), *in_turns(SIDED, LAWS, WIDTHS),
     *in_turns(SIDED, ["Table"], WIDTHS[:-1]), *NARROW],
    ids=str,
)  # fmt: skip
def test_zones_do_their_work(solver, law, width):
    table = mb.Table([-9, 2, 2 + width / 2, 2 + width, 19], [0, 0, 2 / width, 0, 0])
    run = mb.simulate(pushed(LAWS.get(law, lambda p, m: table(m.x)), width=width), solver)
    speed, error = np.sqrt(3), 1e-6 + 4 * ULP / width  # work 1 on 1 kg at 1 m/s
    assert_allclose(run["v"][1:], speed, rtol=0, atol=error)
    through = width * THROUGH.get(law, (1 + 1 / speed) / 2)  # that of a table is between 1 and 1 / speed
    x = 2 + width + speed * (run.t[1:] - 2 - through)
    assert_allclose(run["x"][1:], x, rtol=0, atol=4 * error + width * (law not in THROUGH))


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("solver", [*SIDED, mb.DormandPrince()], ids=repr)
def test_motions_that_turn_back_in_a_zone_leave_it_as_fast(solver, width):
    """By the switch by which they came, also of a zone as narrow as the rounding of its switches."""
    scene = pushed(lambda p, m: -0.8 * ca.if_else(inside(m.x, p.width), 1 / p.width, 0), width=width)
    run = mb.simulate(scene, solver)
    error = 1e-6 + 4 * ULP / width
    assert_allclose(run["v"][1:], -1, rtol=0, atol=error)
    assert_allclose(run["x"][1:], 4 - run.t[1:], rtol=0, atol=4 * error + 3 * width)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("solver", SIDED, ids=repr)
def test_constrained_motions_through_a_zone(solver, width):
    """A particle on a circle under gravity, through a zone where it is fast."""

    def push(m):
        return mb.Force("push", m.at, (ca.if_else(inside(m.bob.x, m.p.width, 0.3), 4 / m.p.width, 0), 0))

    start = {"bob.x": 0.0, "bob.y": -1.0, "bob.vx": 2.0}
    scene = bob(push, width=width).scene("x y vx vy", np.linspace(0, 0.4, 5), start)
    try:
        run = mb.simulate(scene, solver)
    except mb.SimulationError as error:  # its positions are no more exact than that: it may break down, or be right
        assert isinstance(solver, mb.StabilizedIndex2) and width < 1e-8 and "fails at" in str(error)
        return
    gain = np.where(run["x"] > 0.3, 4.0, 0.0)
    assert gain.any()
    energy = (run["vx"] ** 2 + run["vy"] ** 2) / 2 + 9.81 * run["y"]
    assert_allclose(energy, 2 - 9.81 + gain, rtol=0, atol=1e-5 + 16 * ULP / width)


@pytest.mark.parametrize("solver", SIDED, ids=repr)
def test_samples_pass_zones_of_their_own(solver):
    runs = mb.DAESimulator(pushed(LAWS["jump"], width=1e-6), solver).run(np.geomspace(1e-8, 1e-2, 7)[:, None])
    assert_allclose(runs.Y[:, -1, 1], np.sqrt(3), rtol=0, atol=1e-6)


@pytest.mark.parametrize("damping", [25.0, 500.0])
@pytest.mark.parametrize("solver", SIDED, ids=repr)
def test_switches_that_jump_with_another(solver, damping):
    """The force of a damper jumps when its contact begins."""
    scene, rate = overdamped_stop(damping)
    assert_allclose(mb.simulate(scene, solver)["mass.vx"][-1], rate, rtol=1e-5)


COARSE = mb.StabilizedIndex2 | mb.Rosenbrock | mb.NSTIFFSI2
"""Solvers whose own errors over three turns are of this size."""


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("solver", CONTROLLED, ids=repr)
def test_short_contacts_by_every_solver_that_controls_its_steps(solver, gap):
    times = np.linspace(0, 20, 41)
    run = mb.simulate(oscillator(1e6, gap, times), solver)
    error = 1e-3 if isinstance(solver, COARSE) else 1e-6
    assert_allclose(run["x"], bouncing(1e6, gap, times), rtol=0, atol=error)


@pytest.mark.parametrize("width", [1e-3, 1e-6])
@pytest.mark.parametrize("solver", [s for s in CONTROLLED if s not in SIDED], ids=repr)
def test_zones_of_position_are_right_or_refused(solver, width):
    """Those of other solvers are above. Trapezoids of power leave a doubt about the work."""
    try:
        run = mb.simulate(pushed(LAWS["jump"], width=width), solver)
    except (mb.SimulationError, mb.SymmbWarning):
        assert isinstance(solver, mb.NSTIFFSI2)
    else:
        error = 1e-4 if isinstance(solver, COARSE) else 1e-6
        assert_allclose(run["v"][1:], np.sqrt(3), rtol=0, atol=error + 4 * ULP / width)


def test_passes_are_those_of_the_closed_form():
    simulator = mb.DAESimulator(oscillator(1e6, 1e-2, np.linspace(0, 4, 5)))
    x0, _ = simulator.start.states(simulator.dae.p_nominal[None])
    passes = SwitchPasses(simulator.dae, simulator.times, 1e-10)(x0, simulator.dae.p_nominal[None])
    touch = np.arcsin(0.99)
    assert_allclose(passes[0, 0], touch, rtol=0, atol=1e-8)
    middle, rate = 0.99 * 1e6 / (1e6 + 1), np.sqrt(1e6 + 1)
    contact = 2 * np.arctan2(np.cos(touch) / rate, 0.99 - middle) / rate  # symmetric about its turning point
    assert_allclose(passes[0, 1] - passes[0, 0], contact, rtol=0, atol=1e-8)


@pytest.mark.parametrize("solver", [mb.RungeKutta(), mb.GeneralizedAlpha(step=5e-3)], ids=repr)
def test_fixed_steps_that_may_pass_over_a_contact_are_doubtful(solver):
    times = np.linspace(0, 20, 41)
    run = warned("may miss contacts or pulses", mb.simulate, oscillator(1e6, 1e-4, times), solver)
    assert any("Two switches of the equations are" in doubt for doubt in run.doubts)
    run = mb.simulate(oscillator(1e2, 0.1, times), solver)
    assert run.doubts == ()
    assert_allclose(run["x"], bouncing(1e2, 0.1, times), rtol=0, atol=2e-2)


def stuck():
    """x'' = -x - 0.3 sign x': from 1 m the mass turns at -0.4 m, and stops at t = 2 pi at -0.2 m, where it stays."""
    return particle(lambda p, mass: -mass.x - 0.3 * ca.sign(mass.vx), np.linspace(0, 20, 5), {"mass.x": 1.0})


STOPPED = [mb.CVODES(), mb.CVODES(stabilization=mb.Projection()), mb.IDAS(), mb.StabilizedIndex2(), mb.StateSpace()]


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), *STOPPED], ids=repr)
def test_motions_that_stick_to_a_switch_end_there_at_once(solver):
    told = r"fails at t = 6\.28319 s: the motion sticks to a switch"
    refused(told, mb.simulate, stuck(), solver, error=mb.SimulationError)


def test_motions_that_stick_are_doubtful_with_fixed_steps():
    warned(r"sticks to a switch of a force at t = 6\.28319 s", mb.simulate, stuck(), mb.RungeKutta())
