"""Whether a run gets through, its accuracy and the choice of its solver do not depend on the output times."""

import numpy as np
import pytest
from faults import refused
from mechanisms import double_pendulum, spinning_body

import symmb as mb

pytestmark = pytest.mark.usefixtures("optimised")

HORIZON = 1000.0
GRIDS = (2, 11, 10_001)
GROUND = mb.Ground()


def sprung(stiffness, times):
    """x'' = -k x from x = 1."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", GROUND.point(0, 0), ball.point(0, 0), stiffness, 0.0)
    return mb.Scene(mb.System(ball, spring), {"ball.x": 1.0}, times, {"x": ball.x})


def oscillator(n):
    """x = cos t."""
    return sprung(1.0, np.linspace(0, HORIZON, n))


def wheel(n, omega=1.0, horizon=HORIZON):
    """A bar that turns about its end at omega [rad/s]: its centre is at x = 0.5 cos(omega t)."""
    bar = mb.Body("bar", 1.0, 0.1)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), bar.point(-0.5, 0))
    return mb.Scene(mb.System(bar, hinge), {"bar.omega": omega}, np.linspace(0, horizon, n), {"x": bar.x})


LONG = [
    (mb.DormandPrince(), 5e-6), (mb.CVODES(), 1e-6), (mb.CVODES(stiff=True), 1e-6),
    (mb.CVODES(stabilization=mb.Baumgarte()), 1e-5), (mb.IDAS(), 2e-6), (mb.StabilizedIndex2(rtol=1e-10), 2e-4),
    (mb.Rosenbrock(), 1e-4), (mb.NSTIFFSI2(step=1.0, rtol=1e-7), 0.1), (mb.EventDriven(), 1e-6),
]  # fmt: skip


@pytest.mark.parametrize(("solver", "error"), LONG, ids=lambda value: repr(value))
@pytest.mark.parametrize(("make", "radius"), [(oscillator, 1.0), pytest.param(wheel, 0.5, marks=pytest.mark.long)])
def test_long_runs_get_through_with_few_and_with_many_output_times(make, radius, solver, error):
    steps = []
    for n in GRIDS:
        simulator = mb.DAESimulator(make(n), solver)
        ensemble = simulator.run(np.zeros((1, 0)))
        assert ensemble.ok.all(), ensemble.messages
        assert np.abs(ensemble.Y[0, :, 0] - radius * np.cos(simulator.times)).max() < error
        counts = simulator.program.integration().statistics()
        steps.append(simulator.program.engine().counts.steps if simulator.compiled else counts["steps"])
    if not isinstance(solver, mb.Rosenbrock | mb.NSTIFFSI2):  # their steps end at outputs
        assert steps[0] == steps[1] == steps[2]


@pytest.mark.parametrize("make", [double_pendulum, spinning_body])
def test_all_output_grids_of_a_scene_get_the_same_solver(make):
    runs = [mb.simulate(make(np.linspace(0.0, 2.0, n))) for n in (2, 7, 201, 20_001)]
    assert len({run.solver for run in runs}) == 1
    steps = [run.statistics["integrator"]["steps"] for run in runs]
    assert len(set(steps)) == 1
    assert max(run.energy_drift for run in runs) < 1e-8
    final = runs[0].x[-1]
    for run in runs:
        np.testing.assert_allclose(run.x[-1], final, atol=1e-9)
        assert len(run.drift.position) == len(run.energy.kinetic) == len(run.t)


@pytest.mark.parametrize("periods", [10, 1000])
def test_energy_is_judged_between_output_times_at_which_a_motion_rests(periods):
    run = mb.simulate(oscillator(2).with_times(np.linspace(0.0, 2 * np.pi * periods, 11)))
    assert run.energy.kinetic.max() < 1e-9
    assert 0 < run.energy_drift < 1e-6
    assert run.doubts == ()


def test_a_singular_position_between_output_times_is_told_and_fixed_steps_need_no_second_run():
    crank, rod = mb.Body("crank", 1.0, 0.1), mb.Body("rod", 1.0, 0.1)
    system = mb.System(
        crank, rod,
        mb.Revolute("A", GROUND.point(0, 0), crank.point(-0.5, 0)),
        mb.Revolute("B", crank.point(0.5, 0), rod.point(-0.4, 0)),
        mb.PointOnLine("C", GROUND.point(0, 0), rod.point(0.4, 0), axis=(1, 0, 0)),
        mb.Motion("drive", crank.theta, mb.t),
    )  # fmt: skip
    scene = mb.Scene(system, guess={"crank.x": 0.5, "rod.x": 1.4}, times=np.linspace(0, 3, 31))
    assert np.arcsin(0.8) == pytest.approx(0.927295)  # where sin t is the length of the rod
    told = r"near t = 0\.927\d* s, constraints 'A', 'B', 'C', 'drive'"
    for solver in (mb.CVODES(), mb.IDAS(), mb.StabilizedIndex2(), mb.RungeKutta(), mb.HHT()):
        refused(told, mb.simulate, scene, solver, error=mb.SimulationError)
    refused("cannot be reached", mb.simulate, scene, error=mb.SimulationError)


@pytest.mark.parametrize("begin", [0.0, 100.0])
@pytest.mark.parametrize(("omega", "error"), [(1e-3, 1e-8), (1.0, 1e-7), (20.0, 1e-5), (100.0, 1e-4), (1000.0, 1e-2)])
def test_the_first_step_at_index_2_follows_the_motion_not_the_output_times(omega, error, begin):
    steps = []
    for n in (2, 3, 101):
        scene = wheel(n, omega, 0.5)
        simulator = mb.DAESimulator(scene.with_times(scene.times + begin), mb.StabilizedIndex2())
        ensemble = simulator.run(np.zeros((1, 0)))
        assert ensemble.ok.all(), ensemble.messages
        np.testing.assert_allclose(ensemble.Y[0, :, 0], 0.5 * np.cos(omega * scene.times), rtol=0, atol=error)
        steps.append(simulator.program.integration().statistics()["steps"])
    assert steps[0] == steps[1] == steps[2]


def test_rounding_of_multipliers_rejects_no_steps():
    """With multipliers in the error test, IDAS takes 3,000 to 200,000 steps, as rounding has it."""
    for stabilization in (None, mb.Baumgarte()):
        simulator = mb.DAESimulator(spinning_body(), mb.IDAS(rtol=1e-12, stabilization=stabilization))
        ensemble = simulator.run(simulator.dae.p_nominal[None])
        exact = mb.DAESimulator(spinning_body(), mb.DormandPrince(rtol=1e-13)).run(simulator.dae.p_nominal[None])
        np.testing.assert_allclose(ensemble.Y, exact.Y, rtol=0, atol=1e-8)
        assert simulator.program.integration().statistics()["steps"] < 10_000


@pytest.mark.parametrize("solver", [mb.CVODES(rtol=1e-9), mb.IDAS(rtol=1e-8)], ids=repr)
def test_runs_lost_in_a_short_time_end_there_early_whatever_the_output_times(solver):
    """The stiffness is 1, but up to 4e13 N/m for about 4 ms."""
    stiffness = 1.0 + 4e13 / (1 + ((mb.t - 0.5) / 2e-3) ** 2 / 16) ** 16
    for n in (2, 101, 10_001):
        simulator = mb.DAESimulator(sprung(stiffness, np.linspace(0, 1, n)), solver)
        ensemble = simulator.run(np.zeros((1, 0)))
        assert 0.49 < ensemble.t_failed[0] < 0.501
        assert "TOO_MUCH_WORK" in ensemble.messages[0] or "steps are not enough" in ensemble.messages[0]
        assert simulator.program.integration().statistics()["steps"] < 200_000
