"""Solvers that cannot find switches of the state end their steps where a run of DormandPrince passes them."""

import casadi as ca
import numpy as np
import pytest
from faults import warned
from numpy.testing import assert_allclose
from test_step_ends import CONTROLLED, ULP, bouncing, oscillator, pushed
from test_zones import SIDED

import symmb as mb
from symmb.run.integrate.switch_passes import SwitchPasses

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
    """Those of other solvers are in test_zones.py. Trapezoids of power leave a doubt about the work."""
    zone = pushed(lambda p, m: ca.if_else(ca.logic_and(m.x > 2, m.x < 2 + p.width), 1 / p.width, 0), width=width)
    try:
        run = mb.simulate(zone, solver)
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
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), mass.point(0, 0), 1.0, 0.0)
    rough = mb.Force("friction", mass.point(0, 0), (-0.3 * ca.sign(mass.vx), 0))
    return mb.Scene(mb.System(mass, spring, rough), {"mass.x": 1.0}, np.linspace(0, 20, 5), {"x": mass.x})


STOPPED = [mb.CVODES(), mb.CVODES(stabilization=mb.Projection()), mb.IDAS(), mb.StabilizedIndex2(), mb.StateSpace()]


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), *STOPPED], ids=repr)
def test_motions_that_stick_to_a_switch_end_there_at_once(solver):
    with pytest.raises(mb.SimulationError, match=r"fails at t = 6\.28319 s: the motion sticks to a switch"):
        mb.simulate(stuck(), solver)


def test_motions_that_stick_are_doubtful_with_fixed_steps():
    warned(r"sticks to a switch of a force at t = 6\.28319 s", mb.simulate, stuck(), mb.RungeKutta())
