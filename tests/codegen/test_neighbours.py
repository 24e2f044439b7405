"""Samples that share their steps with stiff ones, against the same samples alone."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import symmb as mb
from symmb.run.codegen import Engine, FailureCode, Lanes, StepTolerances, model_function

STEPS = 3000
"""Steps of a run. Those of good samples take less than 100."""
RTOL = 1e-8
BAD = {"k": 1e12, "c": 1e9, "-c": -5000.0, "m": 1e-12}


def spring():
    """m x'' = -k x - c x' - 10 m, with the parameters m, k and c."""
    x, p, t = ca.SX.sym("x", 2), ca.SX.sym("p", 3), ca.SX.sym("t")
    rates = ca.vertcat(x[1], -(p[1] * x[0] + p[2] * x[1]) / p[0] - 10)
    lanes = Lanes(model_function(x, p, t, rates, x, None), StepTolerances(RTOL, RTOL / 100))
    engine = Engine(lanes, np.linspace(0, 1, 11))
    engine.most_steps = STEPS
    return engine


def run(engine, P):
    Y, failed_samples = engine.values(np.full((len(P), 2), 0.1), P)
    return Y, failed_samples, np.isnan(failed_samples.t_failed)


def mixed(rng, n, n_bad):
    """Parameters (n, 3), and the samples (n,) that are bad."""
    P = np.stack([rng.uniform(1, 2, n), rng.uniform(50, 100, n), rng.uniform(0, 1, n)], axis=1)
    bad = np.isin(np.arange(n), rng.choice(n, n_bad, replace=False))
    for i in np.flatnonzero(bad):
        name = rng.choice(list(BAD))
        P[i, "mkc".index(name[-1])] = BAD[name] * rng.uniform(1, 1.5)
    return P, bad


def are_as_alone(engine, P, good):
    """The runs together fail where they fail alone, and others have the values of the good ones of their block."""
    Y, failed_samples, ok = run(engine, P)
    alone = [run(engine, p[None]) for p in P]
    assert_array_equal(ok, good)
    assert_array_equal([one[2][0] for one in alone], good)
    assert_array_equal(failed_samples.failure[good], 0)
    assert_array_equal(np.isfinite(Y).all(axis=(1, 2)), good)
    for y, one in zip(Y[good], np.array([one[0][0] for one in alone])[good], strict=True):
        assert_allclose(y, one, atol=100 * RTOL)
    for begin in range(0, len(P), engine.width):
        block = slice(begin, begin + engine.width)
        if good[block].any():
            assert_array_equal(Y[block][good[block]], run(engine, P[block][good[block]])[0])
    lower, upper, others = engine.extremes(np.full((len(P), 2), 0.1), P, 2)
    assert_array_equal(np.isnan(others.t_failed), good)
    assert_array_equal([lower, upper], [Y[good].min(axis=0), Y[good].max(axis=0)])


@pytest.mark.parametrize("seed", range(6))
def test_samples_beside_stiff_ones_run_as_alone(seed):
    rng, engine = np.random.default_rng(seed), spring()
    for n in rng.integers(2, 21, 3):
        P, bad = mixed(rng, n, rng.integers(1, max(2, n // 2)))
        are_as_alone(engine, P, ~bad)


@pytest.mark.parametrize("name", ["k", "c", "m"])
def test_each_lane_may_be_the_stiff_one(name):
    engine = spring()
    for place in range(8):
        P, _ = mixed(np.random.default_rng(place), 8, 0)
        P[place, "mkc".index(name)] = BAD[name]
        are_as_alone(engine, P, np.arange(8) != place)


def test_one_good_sample_among_bad_ones_of_many_kinds():
    P, _ = mixed(np.random.default_rng(0), 8, 0)
    P[:3, 1], P[3:7, 2] = [1e12, 1e10, 1e8], [1e9, 1e7, -5000, 1e6]
    are_as_alone(spring(), P, np.arange(8) == 7)


def test_samples_that_are_stiff_at_different_times_need_the_steps_of_one():
    """x'' = -k x with k = 1e8 during a tenth of the time, which differs by sample: only all together are too long."""
    x, p, t = ca.SX.sym("x", 2), ca.SX.sym("p", 1), ca.SX.sym("t")
    rates = ca.vertcat(x[1], -(1 + 1e8 * ca.exp(-(((t - p) / 0.05) ** 2))) * x[0])
    times = np.linspace(0, 1, 5)
    engine = Engine(Lanes(model_function(x, p, t, rates, x, None), StepTolerances(1e-8, 1e-10)), times)
    P, x0 = np.linspace(0, 1, 8)[:, None], np.ones((8, 2))
    alone, longest = [], 0
    for k in range(8):
        alone.append(engine.values(x0[:1], P[[k]])[0][0])
        longest = max(longest, engine.counts.steps)
    engine.values(x0, P)
    assert engine.counts.steps > 2 * longest
    engine.most_steps = longest + 1
    Y, failed_samples = engine.values(x0, P)
    assert np.isnan(failed_samples.t_failed).all()
    assert_allclose(Y, alone, atol=1e-5 * np.abs(alone).max())


def test_a_block_of_bad_samples_costs_few_runs():
    """The run of the block, and three runs alone. The other samples are taken to fail alone too."""
    engine, P = spring(), mixed(np.random.default_rng(0), 8, 0)[0]
    P[:, 1] = 1e12
    _, failed_samples, ok = run(engine, P)
    assert not ok.any() and (failed_samples.failure == FailureCode.MANY).all()
    assert engine.counts.steps == 4 * STEPS


def test_failures_beside_too_many_steps_keep_their_reasons():
    """A sample with negative damping grows until its state is infinite; beside a stiff one it has the same reason."""
    P = mixed(np.random.default_rng(1), 3, 0)[0]
    P[:, 2] = [1e9, 0.5, -1e4]
    _, failed_samples, ok = run(spring(), P)
    assert_array_equal(ok, [False, True, False])
    assert_array_equal(failed_samples.failure, [FailureCode.MANY, 0, run(spring(), P[2:])[1].failure[0]])


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.Rosenbrock(), mb.NSTIFFSI2(rtol=1e-4)], ids=repr)
def test_scenes_run_beside_stiff_samples_with_every_solver_with_step_control(solver):
    p = mb.Parameters(m=1.3, k=90.0, c=0.5)
    body = mb.Body("b", p.m, pose=mb.Particle())
    spring_damper = mb.SpringDamper("s", mb.Ground().point(0, 1), body.point(0, 0), p.k, p.c, length=0.8)
    system = mb.System(body, spring_damper, mb.Gravity(0, -9.81), parameters=p)
    scene = mb.Scene(system, {"b.y": 0.1, "b.x": 0.05}, np.linspace(0, 1, 6), {"y": body.y})
    simulator = mb.DAESimulator(scene, solver)
    simulator.program.engine().most_steps = 5000
    good = [[1.3, 90.0, 0.5], [1.5, 70.0, 0.1]]
    P = np.array([good[0], [1.3, 1e12, 0.5], good[1], [1.3, 1e13, 0.5]])
    ensemble = simulator.run(P)
    assert_array_equal(ensemble.ok, [True, False, True, False])
    assert_array_equal(ensemble.Y[[0, 2]], simulator.run(np.array(good)).Y)
    assert "steps are not enough" in ensemble.messages[0]
