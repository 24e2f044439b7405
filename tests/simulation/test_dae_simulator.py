"""The simulator of a scene: the same bits under every executor, pickles, runs samples as single runs go."""

import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import cache
from multiprocessing import get_context

import numpy as np
import pytest
from conftest import ALL_SOLVERS
from mechanisms import double_pendulum, explosion, spinning_body
from numpy.testing import assert_allclose, assert_array_equal

import symmb as mb
from symmb.connect.simulator import Jets, March, run_blocks

TIMES = np.linspace(0.0, 0.5, 6)
RNG = np.random.default_rng(11)
SAMPLES = np.array([1.0, 0.8]) * (1 + 0.1 * RNG.uniform(-1, 1, (300, 2)))


@cache
def pendulum():
    """It remembers its equations, which the tests share."""
    return double_pendulum(TIMES)


@cache
def spinning():
    return spinning_body(TIMES)


def test_results_are_the_same_bits_under_every_executor():
    simulator = mb.DAESimulator(pendulum())
    serial = run_blocks(simulator, SAMPLES)
    assert serial.ok.all() and serial.Y.shape == (300, 6, 4)
    with ThreadPoolExecutor(2) as threads:
        assert_array_equal(run_blocks(simulator, SAMPLES, threads).Y, serial.Y)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        assert_array_equal(run_blocks(simulator, SAMPLES, processes).Y, serial.Y)


def test_extremes_are_the_same_bits_under_every_executor():
    simulator = mb.DAESimulator(pendulum())
    box, method = mb.Box.around(simulator.parameters, 0.05), mb.MonteCarlo(9000)
    simulator.threads = 1
    serial = mb.propagate(simulator, method, box)
    simulator.threads = 3
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        for executor in (None, threads, processes):
            bounds = mb.propagate(simulator, method, box, executor=executor)
            assert bounds.lower.tobytes() == serial.lower.tobytes()
            assert bounds.upper.tobytes() == serial.upper.tobytes()


def test_failed_samples_are_the_same_under_every_executor():
    simulator = mb.DAESimulator(explosion(np.linspace(0, 1, 5)))
    samples = np.linspace(0.0, 1.3, 150)[:, None]
    serial = run_blocks(simulator, samples)
    assert 0 < (~serial.ok).sum() < 150
    with ThreadPoolExecutor(2) as threads:
        threaded = run_blocks(simulator, samples, threads)
    for name in ("Y", "ok", "t_failed", "messages"):
        assert_array_equal(getattr(threaded, name), getattr(serial, name))


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_a_sample_runs_as_it_does_alone(solver):
    simulator = mb.DAESimulator(spinning(), solver)
    samples = np.array([[1.5, 0.0], [1.4, 0.1], [1.7, -0.1]])
    together = simulator.run(samples)
    for k, sample in enumerate(samples):
        # Lanes share their step: alone, a sample takes others, within the tolerance.
        shared = 1e-9 if isinstance(solver, mb.DormandPrince | mb.Rosenbrock) else 0.0
        assert_allclose(simulator.run(sample[None]).Y[0], together.Y[k], rtol=0, atol=shared)
        run = mb.simulate(spinning(), solver, dict(zip(("m", "c"), sample, strict=True)))
        assert_allclose(run.values, together.Y[k], atol=1e-8)


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_simulators_pickle(solver):
    simulator = mb.DAESimulator(pendulum(), solver)
    copy = pickle.loads(pickle.dumps(simulator))
    assert_array_equal(copy.run(SAMPLES[:3]).Y, simulator.run(SAMPLES[:3]).Y)
    assert repr(copy) == f"DAESimulator('double pendulum', {solver!r})"
    assert (copy.parameters, copy.outputs) == ({"l1": 1.0, "l2": 0.8}, ("theta1", "theta2", "omega1", "omega2"))


def test_the_bundle_pickles():
    dae = mb.compile_dae(double_pendulum().system)
    copy = pickle.loads(pickle.dumps(dae))
    at = (RNG.uniform(-1, 1, 6), RNG.uniform(-1, 1, 6), [1.0, 0.8], 0.0)
    for first, second in zip(dae.rhs(*at), copy.rhs(*at), strict=True):
        assert_array_equal(first.full(), second.full())
    assert (copy.q_names, copy.rows) == (dae.q_names, dae.rows)


ADAPTIVE = mb.IDAS | mb.CVODES | mb.DormandPrince | mb.StabilizedIndex2 | mb.Rosenbrock
FIXED_STEP = [*(s for s in ALL_SOLVERS if not isinstance(s, ADAPTIVE)), mb.Rosenbrock(step=1e-3)]


@pytest.mark.parametrize("solver", FIXED_STEP, ids=repr)
def test_marching_samples_side_by_side_is_the_same_run(solver):
    simulator = mb.DAESimulator(pendulum(), solver)
    expected = simulator.run(SAMPLES[:5]).Y
    steps = list(simulator.march(SAMPLES[:5]))
    assert [i for i, _ in steps] == list(range(6))
    assert_allclose(np.stack([y for _, y in steps], axis=1), expected, atol=1e-9)


def test_marching_needs_a_fixed_step():
    with pytest.raises(mb.PropagationError, match="needs a solver with a fixed step, such as RungeKutta"):
        next(mb.DAESimulator(pendulum()).march(SAMPLES[:2]))


def test_capabilities_are_told_by_type():
    simulator = mb.DAESimulator(pendulum())
    assert isinstance(simulator, Jets) and isinstance(simulator, March) and not hasattr(simulator, "expression")
    plain = mb.Scene(mb.System(parameters=mb.Parameters(a=1.0)), outputs={"t": mb.t})
    assert hasattr(mb.DAESimulator(plain), "expression")


def test_no_samples_and_no_times_but_the_start():
    simulator = mb.DAESimulator(double_pendulum([0.0]))
    assert simulator.run(np.zeros((0, 2))).Y.shape == (0, 1, 4)
    assert_allclose(simulator.run(SAMPLES[:2]).Y, np.broadcast_to([0.9, -0.4, 1.0, -2.0], (2, 1, 4)))


def test_times_do_not_start_at_zero_and_need_not_be_even():
    early = mb.simulate(double_pendulum(np.array([0.0, 0.1, 0.35, 0.5])), mb.CVODES(rtol=1e-11))
    late = mb.simulate(double_pendulum(np.array([7.0, 7.1, 7.35, 7.5])), mb.CVODES(rtol=1e-11))
    assert_allclose(late.values, early.values, atol=1e-8)


def test_simulate_takes_times_and_outputs_in_place_of_the_scene_s():
    scene = pendulum()
    rod1, _ = scene.system.bodies
    run = mb.simulate(scene, times=[0.0, 0.25], outputs={"x": rod1.x})
    assert run.names == ("x",) and run.values.shape == (2, 1)
    assert scene.output_names == ("theta1", "theta2", "omega1", "omega2")
