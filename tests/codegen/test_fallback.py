"""The engine without a compiler gives the values, failed samples and bounds of the compiled one."""

import math
import os
import pickle
import platform
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from conftest import SMOOTH_MODELS
from mechanisms import explosion
from numpy.testing import assert_allclose, assert_array_equal

import symmb as mb
from models import cubic, double_pendulum, flexible_pendulum
from symmb.black_boxes.simulator import Reduction
from symmb.cli.main import main
from symmb.codegen import Engine, Tolerances, build, model_function
from symmb.codegen.fallback import ArrayEngine

pytestmark = pytest.mark.slow

ROOT = Path(mb.__file__).parents[1]
X, P, T = ca.SX.sym("x", 2), ca.SX.sym("p", 1), ca.SX.sym("t")
MOVING = [model for model in SMOOTH_MODELS if model is not cubic]  # which has no states
FIXED_TOLERANCE = mb.DormandPrince(atol=1e-10)
"""Absolute tolerances that follow states come close to rounding, which then has a part in the choice of steps."""
SWING = ca.vertcat(X[1], -ca.sin(X[0]) - P * X[0] ** 3 + ca.cos(T) / 3)


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "ziglang", None)
    monkeypatch.delenv("CC", raising=False)
    build._compiler.cache_clear()
    yield
    build._compiler.cache_clear()


def swing(kind, times, rtol=1e-9):
    f = model_function(X, P, T, SWING, ca.vertcat(X, X[0] * T), None)
    return kind(f, np.asarray(times), Tolerances(rtol, rtol / 100))


def samples(simulator, n, share=0.02):
    nominal = np.array(list(simulator.parameters.values()))
    factors = np.random.default_rng(0).uniform(1 - share, 1 + share, (n, len(nominal)))
    return nominal * factors


def both(simulator, P):
    """Starts and engines that are given them, compiled and not, of a simulator."""
    form = simulator.formulation
    model, x0 = (form.dae, simulator.times, form.y), form.start.states(P)[0]
    compiled = simulator.solver.engine(*model)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("symmb.integrate.explicit.has_compiler", lambda: False)
        arrays = simulator.solver.engine(*model)
    assert isinstance(compiled, Engine) and isinstance(arrays, ArrayEngine)
    return x0, compiled, arrays


@pytest.mark.parametrize(
    ("solver", "share"),
    [(FIXED_TOLERANCE, 1e-12), pytest.param(mb.DormandPrince(), 1e-8, marks=pytest.mark.long)],
    ids=repr,
)
@pytest.mark.parametrize("model", MOVING, ids=lambda m: getattr(m, "__name__", str(m)))
def test_every_model_runs_as_compiled_over_a_short_time(model, solver, share):
    scene = model.scene() if hasattr(model, "scene") else model()
    begin, end = scene.times[0], scene.times[-1]
    scene = scene.with_times(np.linspace(begin, begin + (end - begin) / 100, 7))
    simulator = mb.DAESimulator(scene, solver)
    P = samples(simulator, 11, 1e-3)
    x0, compiled, arrays = both(simulator, P)
    (expected, lost), (values, lost_too) = compiled.values(x0, P), arrays.values(x0, P)
    assert np.isnan(lost.t_failed).all() and np.isnan(lost_too.t_failed).all()
    share *= 30 if model is flexible_pendulum else 1  # its steps end at the limit of stability: stages magnify rounding
    close = {"rtol": share, "atol": share * max(1.0, np.abs(expected).max())}
    assert_allclose(values, expected, **close)
    assert_allclose(simulator.run(P).Y, expected, **close)  # which starts in compiled lanes unless the model is large


def test_steps_differ_between_blocks_and_times_may_lie_close():
    times = np.concatenate([[0.0], np.linspace(1.0, 1.01, 50), [4.0, 9.0]])
    rng = np.random.default_rng(1)
    x0, p = rng.uniform(-2, 2, (101, 2)), rng.uniform(0, 30, (101, 1))
    (expected, _), (values, _) = (swing(kind, times).values(x0, p) for kind in (Engine, ArrayEngine))
    assert_allclose(values, expected, rtol=0, atol=1e-11)
    alone = np.concatenate([swing(ArrayEngine, times).values(x0[k : k + 8], p[k : k + 8])[0] for k in range(0, 101, 8)])
    assert_allclose(values, alone, rtol=0, atol=1e-12)  # blocks know nothing of each other
    assert_array_equal(values[:, :1], swing(ArrayEngine, times[:1]).values(x0, p)[0])


def test_extremes_are_those_of_the_values():
    rng = np.random.default_rng(2)
    x0, p = rng.uniform(-1, 1, (2100, 2)), rng.uniform(0.5, 1.5, (2100, 1))
    engine = pickle.loads(pickle.dumps(swing(ArrayEngine, np.linspace(0, 1, 4))))
    Y, _ = engine.values(x0, p)
    lower, upper, failed_samples = engine.extremes(x0, p, threads=2)
    assert_array_equal([lower, upper], [Y.min(axis=0), Y.max(axis=0)])
    assert np.isnan(failed_samples.t_failed).all()


def test_the_same_samples_are_lost_at_the_same_time():
    simulator = mb.DAESimulator(explosion(), FIXED_TOLERANCE)
    P = np.concatenate([np.linspace(0, 0.45, 9), [1.0, 0.7], np.linspace(0.1, 0.2, 8), [0.3, 2.0]])[:, None]
    x0, compiled, arrays = both(simulator, P)
    x0[4] = np.nan
    (expected, lost), (values, lost_too) = compiled.values(x0, P), arrays.values(x0, P)
    assert_array_equal(np.flatnonzero(np.isfinite(lost.t_failed)), [4, 9, 10, 20])
    assert_allclose(lost_too.t_failed, lost.t_failed, rtol=1e-9)
    assert_array_equal(lost_too.failure, lost.failure)
    for found in (lost, lost_too):  # y = cos t
        assert_allclose(found.x_failed[[9, 10, 20], 1], np.cos(found.t_failed[[9, 10, 20]]), atol=1e-6)
    good = np.isnan(lost.t_failed)
    assert_allclose(values[good], expected[good], rtol=1e-9)
    assert_array_equal(np.isnan(values), np.isnan(expected))
    for k in (9, 10, 20):  # known until shortly before they explode
        known = simulator.times < 0.9 * lost.t_failed[k]
        assert known.sum() > 1 and np.isfinite(values[k, known]).all()
        assert_allclose(values[k, known], expected[k, known], rtol=1e-9)
    block = good[8:16]
    assert_array_equal(values[8:16][block], arrays.values(x0[8:16][block], P[8:16][block])[0])
    assert_allclose(arrays.extremes(x0, P)[:2], compiled.extremes(x0, P)[:2], rtol=1e-9)


def test_an_output_that_is_not_finite_fails_its_sample_alone():
    scene = explosion()
    scene = scene.with_outputs({"root": ca.sqrt(1.55 - scene.system.v[0])})  # 1 / (1 - a t)
    simulator = mb.DAESimulator(scene, mb.DormandPrince())
    P = np.array([[0.0], [0.3], [0.1]])
    x0, compiled, arrays = both(simulator, P)
    for expected, found in zip(compiled.extremes(x0, P)[:2], arrays.extremes(x0, P)[:2], strict=True):
        assert_allclose(found, expected, rtol=1e-9)
    failed_samples = arrays.extremes(x0, P)[2]
    assert_array_equal(failed_samples.failure, [0, 1, 0])
    assert_allclose(failed_samples.t_failed, [np.nan, 1.2, np.nan])


@pytest.mark.parametrize("kind", [Engine, ArrayEngine])
def test_too_many_steps_fail_the_block(kind):
    engine = swing(kind, [0.0, 100.0])
    engine.most_steps = 3
    Y, failed_samples = engine.values(np.ones((3, 2)), np.ones((3, 1)))
    assert np.isnan(Y[:, 1]).all() and (failed_samples.t_failed < 100.0).all()


def test_remainders_are_those_of_c():
    a, b = np.meshgrid([-7.5, -2.5, -0.5, 0.0, 0.5, 1.5, 2.5, 3.7, 1e300], [-3.0, -1.0, 0.3, 1.0, 2.0, 5.0, 1e308])
    pairs = np.column_stack([a.ravel(), b.ravel()])
    still = ArrayEngine(
        model_function(X, P, T, ca.SX.zeros(2), ca.remainder(X[0], X[1]), None), np.zeros(1), Tolerances(1e-8, 1e-8)
    )
    values = still.values(pairs, np.ones((len(pairs), 1)))[0].ravel()
    assert_array_equal(values, [math.remainder(*pair) for pair in pairs.tolist()])


def test_without_a_compiler_bounds_are_the_same(no_compiler, monkeypatch):
    scene = double_pendulum.scene().with_times(np.linspace(0, 1, 11))
    box = mb.Box.around(scene.system.parameters, 0.05)
    slow = mb.DAESimulator(scene)
    assert isinstance(slow.engine(), ArrayEngine) and repr(slow.solver) == "DormandPrince()"
    methods = mb.MonteCarlo(50), mb.PolynomialChaos(order=2), mb.Taylor(2)
    found = [mb.propagate(slow, method, box) for method in methods]
    monkeypatch.undo()
    build._compiler.cache_clear()
    fast = mb.DAESimulator(scene)
    assert isinstance(fast.engine(), Engine)
    for bounds, method in zip(found, methods, strict=True):
        expected = mb.propagate(fast, method, box)
        scale = np.abs(expected.upper).max(axis=0) + np.abs(expected.lower).max(axis=0)
        for a, b in ((bounds.lower, expected.lower), (bounds.upper, expected.upper)):
            assert np.abs((a - b) / scale).max() < 1e-9


def test_without_a_compiler_it_pickles_and_streams(no_compiler):
    simulator = mb.DAESimulator(explosion())
    copy = pickle.loads(pickle.dumps(simulator))
    P = np.linspace(0, 0.4, 11)[:, None]
    assert_array_equal(copy.run(P).Y, simulator.run(P).Y)
    gathered = copy.stream(P, Reduction(list, lambda s, block, i: [*s, block.extremes()], lambda a, b: a + b))
    assert_array_equal(gathered[0][1], simulator.run(P).Y.max(axis=0))


def test_the_command_line_says_that_runs_are_slow(no_compiler, tmp_path, capsys):
    file = tmp_path / "scene.py"
    file.write_text(
        "import symmb as mb\np = mb.Parameters(c=0.4)\nball = mb.Body('ball', 1.0, pose=mb.Particle())\n"
        "drag = mb.Force('drag', ball.point(0, 0), (-p.c * ball.vx, 0))\n"
        "def scene():\n    return mb.Scene(mb.System(ball, drag, parameters=p), {'ball.vx': 1.0}, [0.0, 0.5, 1.0],\n"
        "                    {'v': ball.vx}, box=mb.Box(c=(0.3, 0.5)))\n"
    )
    told = (
        "No C compiler found. Without a C compiler runs take about 30 times as long. "
        "Install gcc or clang, or run `pip install 'symmb[compiler]'`, or set CC.\n"
    )
    assert main(["compare", str(file), "--methods", "vertex"]) == 0
    assert capsys.readouterr().err.startswith(told)
    assert main(["compare", str(file), "--methods", "vertex", "--solver", "cvodes"]) == 0
    assert "compiler" not in capsys.readouterr().err


SHOW = """
import sys; sys.path.insert(0, "tests/codegen")
import numpy as np, test_fallback as here
from symmb.codegen.engine import Engine
engine = here.swing(Engine, np.linspace(0, 1, 4))
print(engine.width, repr(engine.values(here.STARTS, here.SPRINGS)[0].tolist()))
"""
STARTS, SPRINGS = np.linspace(-1, 1, 22).reshape(11, 2), np.linspace(0, 2, 11)[:, None]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="options of x86-64 compilers")
@pytest.mark.parametrize("narrow", ["-mno-avx512f", "-mno-avx"], ids=["four lanes", "two lanes"])
def test_narrower_processors_share_steps_among_as_many_samples(narrow, tmp_path):
    compiler = tmp_path / "cc"
    compiler.write_text(f'#!/bin/sh\nexec {build._compiler().path} "$@" {narrow}\n')
    compiler.chmod(0o755)
    run = subprocess.run(
        [sys.executable, "-c", SHOW], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "CC": str(compiler), "XDG_CACHE_HOME": str(tmp_path),
             "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(ROOT / "models")])},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    width, values = run.stdout.split(maxsplit=1)
    here = swing(Engine, np.linspace(0, 1, 4))
    assert int(width) == here.width == ArrayEngine.width == 8
    assert_allclose(eval(values), here.values(STARTS, SPRINGS)[0], rtol=1e-12, atol=1e-13)
