"""The compiled engine against closed forms and SciPy; lanes that are lost or share steps with stiff ones; threads."""

import os
import pickle
import platform
import subprocess
import sys
import threading
from dataclasses import replace
from functools import cache
from operator import attrgetter
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from conftest import SMOOTH_MODELS, but_long
from mechanisms import exact, explosion
from numpy.testing import assert_allclose, assert_array_equal
from processes import program
from scipy import special
from small_scenes import particle

import symmb as mb
from models import cubic, double_pendulum, stewart_platform
from symmb.connect.simulator import Reduction
from symmb.run.codegen import Engine, FailureCode, Lanes, StepTolerances, build, model_function, threads

ROOT = Path(mb.__file__).parents[1]
TIMES = np.linspace(0, 5, 41)
X, P, T = ca.SX.sym("x", 2), ca.SX.sym("p", 1), ca.SX.sym("t")
DUFFING = ca.vertcat(X[1], -X[0] - P * X[0] ** 3 + ca.cos(T) / 3)


def duffing(rtol=1e-9, times=TIMES):
    return Engine(Lanes(model_function(X, P, T, DUFFING, X, None), StepTolerances(rtol, rtol / 100)), times)


def test_runs_are_those_of_scipy_s_dop853():
    x0, p = np.array([[1.0, 0.0], [0.5, -1.0], [2.0, 1.0]]), np.array([[0.5], [1.0], [2.0]])
    Y, failed_samples = duffing().values(x0, p)
    assert np.isnan(failed_samples.t_failed).all()
    for start, k, y in zip(x0, p[:, 0], Y, strict=True):
        rates = lambda t, x, k=k: (x[1], -x[0] - k * x[0] ** 3 + np.cos(t) / 3)  # noqa: E731
        assert_allclose(y, exact(rates, start, TIMES), atol=2e-8)


def test_the_error_follows_the_tolerance():
    x0, p = np.array([[1.0, 0.0]]), np.array([[1.0]])
    finest = duffing(1e-13).values(x0, p)[0]
    errors = [np.abs(duffing(rtol).values(x0, p)[0] - finest).max() for rtol in (1e-5, 1e-7, 1e-9)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


@pytest.mark.parametrize(("seed", "rtol"), [(1, 1e-5), (2, 1e-5), (3, 1e-8), (4, 1e-8), (5, 1e-10)])
def test_outputs_within_a_step_of_stiff_lanes_are_those_of_the_closed_form(seed, rtol):
    # A state at rest lets steps grow beyond its stability, until it or a neighbour follows a pulse.
    rng, x, p, t = np.random.default_rng(seed), ca.SX.sym("x"), ca.SX.sym("p", 3), ca.SX.sym("t")
    rate = p[0] * (ca.exp(-(((t - p[2]) / p[1]) ** 2)) - x)
    times, ranges = np.linspace(0, 1, 201), ((3, 4.5), (5e-3, 2e-2), (0.3, 0.7))
    exponent, w, c = (rng.uniform(*limits, 1600) for limits in ranges)
    P = np.column_stack([10**exponent, w, c])
    lanes = Lanes(model_function(x, p, t, rate, x, None), StepTolerances(rtol, rtol / 100))
    Y, failed_samples = Engine(lanes, times).values(np.zeros((len(P), 1)), P)
    assert np.isnan(failed_samples.t_failed).all()
    k, w, z = P[:, :1], P[:, 1:2], (times - P[:, 2:]) / P[:, 1:2]
    u = k * w / 2 - z
    early = np.exp(-(z**2)) * special.erfcx(np.maximum(u, 0))
    late = np.exp(np.minimum(u**2 - z**2, 0)) * special.erfc(np.minimum(u, 0))
    assert_allclose(Y[..., 0], np.where(u > 0, early, late) * k * w * np.sqrt(np.pi) / 2, atol=100 * rtol)


def test_extremes_are_those_of_the_values_whatever_the_threads():
    rng = np.random.default_rng(0)
    x0, p = rng.uniform(-1, 1, (203, 2)), rng.uniform(0.5, 1.5, (203, 1))
    engine = duffing()
    Y, _ = engine.values(x0, p)
    for number in (1, 2, 3):
        assert_array_equal(engine.values(x0, p, number)[0], Y)
        lower, upper, failed_samples = engine.extremes(x0, p, number)
        assert_array_equal([lower, upper], [Y.min(axis=0), Y.max(axis=0)])
        assert np.isnan(failed_samples.t_failed).all()


def test_an_output_that_is_not_finite_fails_its_sample_alone():
    scene = explosion()
    v = scene.system.v[0]  # 1 / (1 - a t)
    simulator = mb.DAESimulator(scene.with_outputs({"root": ca.sqrt(1.55 - v)}), mb.DormandPrince())
    P = np.array([[0.0], [0.3], [0.1]])
    good, both = simulator.run(P[::2]), simulator.run(P)
    assert_array_equal(both.ok, [True, False, True])
    assert_allclose(both.t_failed[1], 1.2)
    assert both.messages == ("t = 1.2 s, a = 0.3: an output is not finite",)
    for ensemble in (both, simulator.run(P)):  # from values, and directly
        assert_allclose(ensemble.extremes(), [good.Y.min(axis=0), good.Y.max(axis=0)], rtol=1e-9)
        assert_array_equal(ensemble.ok, [True, False, True])


@cache
def scene_of(model):
    return model.scene()


@pytest.mark.parametrize("model", but_long(SMOOTH_MODELS, stewart_platform), ids=attrgetter("__name__"))
def test_every_model_runs_as_with_cvodes(model):
    scene = scene_of(model)
    compiled = mb.simulate(scene, mb.DormandPrince(rtol=1e-10))
    reference = mb.simulate(scene, mb.CVODES(rtol=1e-12))
    scale = np.maximum(1.0, np.abs(reference.values).max(axis=0))
    assert (np.abs(compiled.values - reference.values) / scale).max() < 2e-6
    assert compiled.position_drift < 1e-8


def test_too_many_steps_fail_the_block():
    engine = duffing(times=np.array([0.0, 100.0]))
    engine.most_steps = 3
    Y, failed_samples = engine.values(np.ones((3, 2)), np.ones((3, 1)))
    assert np.isnan(Y[:, 1]).all() and (failed_samples.t_failed < 100.0).all()


NARROW = """
import sys; sys.path.insert(0, "tests/codegen")
import numpy as np, test_engine as here
engine = here.duffing(times=np.linspace(0, 1, 4))
print(engine.width, repr(engine.values(here.STARTS, here.SPRINGS)[0].tolist()))
"""
STARTS, SPRINGS = np.linspace(-1, 1, 22).reshape(11, 2), np.linspace(0, 2, 11)[:, None]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="options of x86-64 compilers")
@pytest.mark.parametrize("narrow", ["-mno-avx512f", "-mno-avx"], ids=["four lanes", "two lanes"])
def test_narrower_processors_share_steps_among_as_many_samples(narrow, tmp_path):
    compiler = program(tmp_path / "cc", f'exec {build._compiler().path} "$@" {narrow}')
    run = subprocess.run(
        [sys.executable, "-c", NARROW], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "CC": str(compiler), "XDG_CACHE_HOME": str(tmp_path),
             "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(ROOT / "models")])},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    width, values = run.stdout.split(maxsplit=1)
    here = duffing(times=np.linspace(0, 1, 4))
    assert int(width) == here.width == 8
    assert_allclose(eval(values), here.values(STARTS, SPRINGS)[0], rtol=1e-12, atol=1e-13)


def test_work_is_integrated_along():
    scene = particle(lambda p, mass: -p.c * mass.vx, TIMES, {"mass.vx": 1.0}, ("vx",), c=(0.3, 0.5))
    run = mb.simulate(scene, mb.DormandPrince())
    assert_allclose(run["vx"], np.exp(-0.4 * TIMES), atol=1e-8)
    assert run.energy_drift < 1e-8 and run.energy.work[-1] < -0.3


def test_it_pickles_and_streams():
    simulator = mb.DAESimulator(explosion(), mb.DormandPrince())
    copy = pickle.loads(pickle.dumps(simulator))
    P = np.linspace(0, 0.4, 11)[:, None]
    assert_array_equal(copy.run(P).Y, simulator.run(P).Y)
    gathered = simulator.stream(P, Reduction(list, lambda s, block, i: [*s, (i, block.extremes())], lambda a, b: a + b))
    assert len(gathered) == 1 and len(gathered[0][0]) == 11


MOVING = [model for model in SMOOTH_MODELS if model is not cubic]  # which has no states


@pytest.mark.parametrize("model", but_long(MOVING, stewart_platform), ids=attrgetter("__name__"))
def test_compiled_lanes_start_where_newton_s_method_says(model):
    scene = scene_of(model)
    simulator = mb.DAESimulator(scene.with_times(scene.times[:1]))
    engine = simulator.program.engine()
    if not engine.starts:
        assert simulator.dae.n_v > 50
        return
    nominal = np.array(list(simulator.parameters.values()))
    P = nominal * np.random.default_rng(0).uniform(0.97, 1.03, (11, len(nominal)))
    x, reasons = simulator.start.states(P)
    Y, failed_samples = engine.values(np.empty((11, 0)), P)
    assert_array_equal(np.isnan(failed_samples.t_failed), [not why for why in reasons])
    good = np.isnan(failed_samples.t_failed)
    expected = simulator.y.map(int(good.sum()))(x[good].T, P[good].T, simulator.times[0]).full().T
    assert_allclose(Y[good, 0], expected, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("stabilization", [None, mb.Baumgarte(2.0, 2.0), mb.Projection()])
def test_fixed_steps_are_those_of_casadi_s_loop(stabilization):
    scene = replace(double_pendulum.scene().with_times(np.linspace(0, 2, 21)), coordinates="body")  # as single runs
    solver = mb.RungeKutta(steps=290, stabilization=stabilization)
    run = mb.simulate(scene, solver)
    simulator = mb.DAESimulator(scene, solver)
    P = np.array([[1.0, 1.0], [1.05, 0.9]])
    assert_allclose(simulator.run(P).Y[0], run.values, rtol=0, atol=1e-12)
    Y = simulator.run(P).Y
    assert_array_equal(simulator.run(P).extremes(), [Y.min(axis=0), Y.max(axis=0)])


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
    alone, steps = zip(*[(engine.values(x0[:1], p[None])[0][0], engine.counts.steps) for p in P], strict=True)
    longest = max(steps)
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
    force = mb.SpringDamper("s", mb.Ground().point(0, 1), body.point(0, 0), p.k, p.c, length=0.8)
    system = mb.System(body, force, mb.Gravity(0, -9.81), parameters=p)
    simulator = mb.DAESimulator(
        mb.Scene(system, {"b.y": 0.1, "b.x": 0.05}, np.linspace(0, 1, 6), {"y": body.y}), solver
    )
    simulator.program.engine().most_steps = 5000
    good = [[1.3, 90.0, 0.5], [1.5, 70.0, 0.1]]
    P = np.array([good[0], [1.3, 1e12, 0.5], good[1], [1.3, 1e13, 0.5]])
    ensemble = simulator.run(P)
    assert_array_equal(ensemble.ok, [True, False, True, False])
    assert_array_equal(ensemble.Y[[0, 2]], simulator.run(np.array(good)).Y)
    assert "steps are not enough" in ensemble.messages[0]


@pytest.fixture(params=[0, 1, 3])
def few(request, monkeypatch):
    """How many threads can be started at the same time."""
    start, before = threading.Thread.start, threading.active_count()

    def limited(thread):
        if threading.active_count() - before >= request.param:
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", limited)
    return request.param


def test_cores_are_as_many_as_threads_can_be_started(few, monkeypatch):
    monkeypatch.setattr(threads.os, "sched_getaffinity", lambda process: range(8), raising=False)
    assert threads.cores() == max(few, 1)


def test_all_arguments_get_their_result(few):
    assert threads.side_by_side(lambda k: k**2, range(6)) == [0, 1, 4, 9, 16, 25]


def test_all_pieces_are_done(few):
    lock, done = threading.Lock(), []

    def work(counter):
        while True:
            with lock:
                counter.value += 1
                if counter.value > 1000:
                    return
                done.append(counter.value)

    threads.on_threads(work, 1000, 1.0)
    assert done == list(range(1, 1001))
