"""Forces in narrow zones of position do their work: against closed forms of the energy."""

import casadi as ca
import numpy as np
import pytest
from conftest import in_turns
from numpy.testing import assert_allclose
from test_step_ends import CONTROLLED, ULP, overdamped_stop, pushed

import symmb as mb

SIDED = [s for s in CONTROLLED if not isinstance(s, mb.Rosenbrock | mb.NSTIFFSI2 | mb.EventDriven)]
"""Solvers whose runs are pieces on one side of each switch."""
WIDTHS = [1e-3, 1e-6, 1e-9]


def inside(x, width):
    return ca.logic_and(x > 2, x < 2 + width)


LAWS = {
    "jump": lambda p, m: ca.if_else(inside(m.x, p.width), 1 / p.width, 0),
    "ramp": lambda p, m: ca.if_else(inside(m.x, p.width), 0.5 / p.width + (m.x - 2) / p.width**2, 0),
    "fabs": lambda p, m: ca.if_else(ca.fabs(m.x - 2 - p.width / 2) < p.width / 2, 1 / p.width, 0),
}
"""Forces of work 1 from 2 to 2 + width."""


NARROW = [pytest.param(s, "Table", WIDTHS[-1], marks=pytest.mark.long) for s in SIDED]  # a minute each for CasADi's


@pytest.mark.parametrize(
    ("solver", "law", "width"),
    [*in_turns(SIDED, LAWS, WIDTHS), *in_turns(SIDED, ["Table"], WIDTHS[:-1]), *NARROW],
    ids=str,
)
def test_zones_do_their_work(solver, law, width):
    table = mb.Table([-9, 2, 2 + width / 2, 2 + width, 19], [0, 0, 2 / width, 0, 0])
    run = mb.simulate(pushed(LAWS.get(law, lambda p, m: table(m.x)), width=width), solver)
    speed, error = np.sqrt(3), 1e-6 + 4 * ULP / width  # work 1 on 1 kg at 1 m/s
    assert_allclose(run["v"][1:], speed, rtol=0, atol=error)
    assert_allclose(run["x"][1:], 2 + speed * (run.t[1:] - 2), rtol=0, atol=4 * error + width)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("solver", SIDED, ids=repr)
def test_motions_that_turn_back_in_a_zone_leave_it_as_fast(solver, width):
    scene = pushed(lambda p, m: -0.8 * ca.if_else(inside(m.x, p.width), 1 / p.width, 0), width=width)
    run = mb.simulate(scene, solver)
    error = 1e-6 + 4 * ULP / width
    assert_allclose(run["v"][1:], -1, rtol=0, atol=error)
    assert_allclose(run["x"][1:], 4 - run.t[1:], rtol=0, atol=4 * error + 3 * width)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("solver", SIDED, ids=repr)
def test_constrained_motions_through_a_zone(solver, width):
    """A particle on a circle under gravity, through a zone where it is fast."""
    p = mb.Parameters(width=width)
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    push = ca.if_else(ca.logic_and(bob.x > 0.3, bob.x < 0.3 + p.width), 4 / p.width, 0)
    rod = mb.Distance("rod", bob.point(0, 0), mb.Ground().point(0, 0), 1.0)
    force = mb.Force("push", bob.point(0, 0), (push, 0))
    system = mb.System(bob, force, rod, mb.Gravity(0, -9.81), parameters=p)
    times = np.linspace(0, 0.4, 5)
    outputs = {"y": bob.y, "energy": (bob.vx**2 + bob.vy**2) / 2 + 9.81 * bob.y, "x": bob.x}
    scene = mb.Scene(system, {"bob.x": 0.0, "bob.y": -1.0, "bob.vx": 2.0}, times, outputs)
    try:
        run = mb.simulate(scene, solver)
    except mb.SimulationError as error:  # its positions are no more exact than that: it may break down, or be right
        assert isinstance(solver, mb.StabilizedIndex2) and width < 1e-8 and "fails at" in str(error)
        return
    gain = np.where(run["x"] > 0.3, 4.0, 0.0)
    assert gain.any()
    assert_allclose(run["energy"], 2 - 9.81 + gain, rtol=0, atol=1e-5 + 16 * ULP / width)


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
