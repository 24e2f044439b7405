"""The compiled engine against SciPy's DOP853 and closed forms; lanes that are lost."""

import os
import pickle
import platform
import subprocess
import sys
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

import symmb as mb
from models import cubic, double_pendulum, stewart_platform
from symmb.connect.simulator import Reduction
from symmb.run.codegen import Engine, Lanes, StepTolerances, build, model_function

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
    for threads in (1, 2, 3):
        assert_array_equal(engine.values(x0, p, threads)[0], Y)
        lower, upper, failed_samples = engine.extremes(x0, p, threads)
        assert_array_equal(lower, Y.min(axis=0))
        assert_array_equal(upper, Y.max(axis=0))
        assert np.isnan(failed_samples.t_failed).all()


def test_an_output_that_is_not_finite_fails_its_sample_alone():
    scene = explosion()
    v = scene.system.v[0]  # 1 / (1 - a t)
    simulator = mb.DAESimulator(scene.with_outputs({"root": ca.sqrt(1.55 - v)}), mb.DormandPrince())
    P = np.array([[0.0], [0.3], [0.1]])
    good = simulator.run(P[[0, 2]])
    both = simulator.run(P)
    assert_array_equal(both.ok, [True, False, True])
    assert_allclose(both.t_failed[1], 1.2)
    assert both.messages == ("t = 1.2 s, a = 0.3: an output is not finite",)
    for ensemble in (both, simulator.run(P)):  # from values, and directly
        lower, upper = ensemble.extremes()
        assert_array_equal(ensemble.ok, [True, False, True])
        assert_allclose([lower, upper], [good.Y.min(axis=0), good.Y.max(axis=0)], rtol=1e-9)


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
    p = mb.Parameters(c=0.4)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Force("drag", ball.point(0, 0), (-p.c * ball.vx, 0)), parameters=p)
    run = mb.simulate(mb.Scene(system, {"ball.vx": 1.0}, TIMES), mb.DormandPrince())
    assert_allclose(run["ball.vx"], np.exp(-0.4 * TIMES), atol=1e-8)
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
    lower, upper = simulator.run(P).extremes()
    Y = simulator.run(P).Y
    assert_array_equal([lower, upper], [Y.min(axis=0), Y.max(axis=0)])
