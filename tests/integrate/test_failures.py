"""Runs that fail: an error with time and parameters, a failed sample whose neighbours are untouched."""

import re

import numpy as np
import problems
import pytest
from conftest import ALL_SOLVERS
from faults import refused
from mechanisms import double_pendulum, explosion
from numpy.testing import assert_allclose, assert_array_equal

import symmb as mb
from symmb.bound.responses.streams import failures
from symmb.run.formulations.ensembles import NAMED_SAMPLES

ADAPTIVE = [s for s in ALL_SOLVERS if isinstance(s, mb.IDAS | mb.CVODES)]


BLOW_UPS = [(s, r"explosion: the run fails at t = 0\.99\d* s \(a = 1\): .") for s in ADAPTIVE]
BLOW_UPS += [
    (mb.RungeKutta(steps=400), r"fails at t = 1\.?\d* s \(a = 1\): the state became infinite or NaN"),
    (mb.DormandPrince(), r"fails at t = (1|0\.99)"),
    (mb.StateSpace(), r"fails at t = \d"),
]


@pytest.mark.parametrize(("solver", "told"), BLOW_UPS, ids=repr)
def test_a_blow_up_is_an_error_with_time_and_parameters(solver, told):
    refused(told, mb.simulate, explosion(), solver, error=mb.SimulationError)


STEPS = mb.NSTIFFSI2(step=1e-2), mb.Rosenbrock(), mb.GeneralizedAlpha(step=1e-2), mb.RungeKutta(steps=2000)
ERRORS = {**dict.fromkeys(ADAPTIVE, 2e-3), mb.DormandPrince(): 1e-3, **dict.fromkeys(STEPS, 0.11)}
"""Of the time at which a run is lost, by solvers."""


@pytest.mark.parametrize("solver", ERRORS, ids=repr)
def test_a_failed_sample_leaves_its_neighbours_alone(solver):
    simulator = mb.DAESimulator(explosion(), solver)
    P = np.array([[0.3], [1.0], [0.25], [2.0], [0.0]])
    ensemble = simulator.run(P)
    assert_array_equal(ensemble.ok, [True, False, True, False, True])
    assert_allclose(ensemble.t_failed, [np.nan, 1.0, np.nan, 0.5, np.nan], atol=ERRORS[solver])
    first, second = ensemble.messages
    alone = simulator.run(P[::2])
    assert alone.ok.all() and alone.messages == ()
    assert_array_equal(ensemble.Y[[0, 2, 4]], alone.Y)
    assert_array_equal(simulator.run(P).extremes(), [alone.Y.min(axis=0), alone.Y.max(axis=0)])
    if solver not in ADAPTIVE:
        assert "a = 1: the step became too short" in first or solver != mb.DormandPrince()
        assert ensemble.t_failed[1] >= 1.0 or not isinstance(solver, mb.RungeKutta)
        return
    assert re.match(r"t = 0\.99\d* s, a = 1: ", first) and re.match(r"t = 0\.49\d* s, a = 2: ", second)
    t = simulator.times
    assert_allclose(ensemble.Y[0, :, 0], 1 / (1 - 0.3 * t), rtol=1e-7)
    assert np.isnan(ensemble.Y[1, 10:]).all()
    assert_allclose(ensemble.Y[1, :10, 0], 1 / (1 - t[:10]), rtol=1e-6)  # up to where it failed, it is a run


def drawn(law, times, **numbers):
    """A bar on a hinge at the origin, whose point at the distance of 1 is drawn to x = law(p)."""
    p = mb.Parameters(**numbers)
    bar = mb.Body("bar", 1.0, 0.1, mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), bar.point(0, 0))
    system = mb.System(bar, hinge, mb.Motion("pull", bar.point(1, 0).x, law(p)), parameters=p)
    return mb.Scene(system, times=times, guess={"bar.theta": 1.0}, outputs={"angle": bar.theta})


def test_a_failed_run_says_nothing_on_the_terminal(capfd):
    mb.DAESimulator(explosion()).run(np.array([[1.0], [0.5]]))
    assert tuple(capfd.readouterr()) == ("", "")


def test_a_sample_that_cannot_be_assembled_fails_at_the_start():
    """A rod of length 1 from the origin reaches a wall at x = w only for w < 1."""
    scene = drawn(lambda p: p.w + 0 * mb.t, [0.0, 1.0], w=0.5)
    ensemble = mb.DAESimulator(scene).run(np.array([[0.5], [1.5], [0.9]]))
    assert_array_equal(ensemble.ok, [True, False, True])
    assert_allclose(ensemble.Y[[0, 2], :, 0], np.arccos([[0.5, 0.5], [0.9, 0.9]]))
    assert ensemble.t_failed[1] == 0.0
    assert ensemble.messages[0].startswith("t = 0 s, w = 1.5: the start could not be computed")
    told = r"t = 0 s \(w = 1\.5\): the start could not be computed.*'pull'"
    refused(told, mb.simulate, scene, parameters={"w": 1.5}, error=mb.SimulationError)


def lines_up():
    """Two windows, whose bars lie on one line at 0.7143555 s; an output ends right before."""
    scene = problems.n_four_bar(2).make().with_times(np.linspace(0, 0.72, 73))
    return scene.with_outputs({"root": (0.715 - mb.t) ** 0.5}), mb.CVODES(rtol=1e-8), "an output is not finite", "foot0"


def beyond_reach():
    """The end of a bar of length 1 from the origin is drawn to x = 0.5 + t; it is as far as it reaches at 0.5 s."""
    scene = drawn(lambda p: p.length - 0.5 + mb.t, np.linspace(0, 1, 9), length=1.0)
    return scene, mb.DormandPrince(), "the step became too short", "hinge"


@pytest.mark.parametrize(("make", "time"), [(lines_up, r"0\.7[12]\d*"), (beyond_reach, r"0\.(5|49)\d*")])
def test_the_first_samples_that_fail_near_a_singular_position_name_its_joints(make, time):
    scene, solver, why, joint = make()
    simulator = mb.DAESimulator(scene, solver)
    ensemble = simulator.run(np.tile(simulator.dae.p_nominal, (NAMED_SAMPLES + 2, 1)))
    start = rf"t = {time} s, length = 1.*: {why}"
    assert len(ensemble.messages) == NAMED_SAMPLES + 2
    for message in ensemble.messages[:NAMED_SAMPLES]:
        assert re.match(rf"{start}.*; near t = {time} s, constraints '{joint}', .* nearly depend on each", message)
    assert re.match(start, ensemble.messages[NAMED_SAMPLES]) and "near t" not in ensemble.messages[NAMED_SAMPLES]


def test_a_run_that_fails_between_outputs_names_the_joints_of_a_singular_position():
    scene, solver, _, _ = beyond_reach()
    told = r"singular: near t = 0\.(5|49)\d* s, constraints 'hinge', 'pull'"
    refused(told, mb.simulate, scene.with_times([0.0, 0.4, 1.0]), solver, error=mb.SimulationError)


def test_derivatives_of_a_failing_run_are_an_error():
    jets, told = mb.DAESimulator(explosion()).jets, r"derivatives fails at t = [01]\.?\d* s"
    refused(told, jets, np.array([1.0]), np.array([[1.0]]), 1, error=mb.SimulationError)


def test_wrong_parameters_are_told():
    refused(r"No parameter 'l11'\. Did you mean 'l1'\?", mb.simulate, double_pendulum(), parameters={"l11": 1.0})
    refused("Parameter 'l1': nan is not a finite number", mb.simulate, double_pendulum(), parameters={"l1": np.nan})
    shapes = r"samples must be numbers of the shape \(N, 2\), one column for each of l1, l2; got the shape \(3, 1\)"
    refused(shapes, mb.DAESimulator(double_pendulum()).stream, np.zeros((3, 1)), failures())


def test_forces_that_are_not_numbers_at_the_start_are_named():
    ball, other = mb.Body("ball", 1.0, pose=mb.Particle()), mb.Body("other", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), ball.point(0, 0), 100.0, length=0.5)
    push = mb.Force("push", other.point(0, 0), (1.0, 0.0))
    scene = mb.Scene(mb.System(ball, other, spring, push), times=[0.0, 1.0])
    told = "fails at t = 0 s: the forces on 'ball' are not numbers at the start"
    refused(told, mb.simulate, scene, error=mb.SimulationError)
