"""Smooth forces that act for much less than a step are not passed over: against the work and the impulse they do."""

import casadi as ca
import numpy as np
import pytest
from conftest import in_turns
from numpy.testing import assert_allclose
from scipy.special import gammaln
from small_scenes import particle
from test_passed_over import wheel
from test_step_ends import ULP, pushed

import symmb as mb

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


def check_work(solver, pulse, width):
    run = mb.simulate(pushed(lambda p, m: PULSES[pulse]((m.x - 2.1) / p.width) / p.width, width=width), solver)
    assert_allclose(run["v"][1:], np.sqrt(3), rtol=0, atol=3e-6 + 8 * ULP / width)


@pytest.mark.parametrize(("solver", "pulse", "width"), in_turns(EXPLICIT, PULSES, [1e-2, 1e-5, 1e-8]), ids=str)
def test_pulses_of_position_do_their_work(solver, pulse, width):
    check_work(solver, pulse, width)


@pytest.mark.parametrize("width", [1e-2, 1e-6])
@pytest.mark.parametrize("pulse", ["Gaussian", "tanh"])
@pytest.mark.parametrize("solver", IMPLICIT, ids=repr)
def test_implicit_solvers_follow_pulses_of_position(solver, pulse, width):
    check_work(solver, pulse, width)


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
