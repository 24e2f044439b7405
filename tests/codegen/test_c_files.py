"""Emitted C against CasADi, operation by operation; the fixed C: strict compilers, and programs under sanitizers."""

import functools
import math
import os
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import symmb as mb
from models import bouncing_ball, double_pendulum
from symmb.run.codegen import Engine, Lanes, StepTolerances, model_function
from symmb.run.codegen.c_source import C_FOLDER
from symmb.run.codegen.model_source import _generator

RNG = np.random.default_rng(3)
STEPS = StepTolerances(1e-8, 1e-8)
X, P, T = ca.SX.sym("x", 2), ca.SX.sym("p", 2), ca.SX.sym("t")


def values(outputs, x0, p, times=(0.5,)):
    """Outputs at rest: an engine whose state does not move."""
    engine = Engine(Lanes(model_function(X, P, T, ca.SX.zeros(2), outputs, None), STEPS), np.array(times))
    Y, failed_samples = engine.values(np.asarray(x0), np.asarray(p))
    assert np.isnan(failed_samples.t_failed).all()
    return Y


UNARY = {
    "neg": lambda a: -a, "sq": lambda a: a**2, "twice": lambda a: 2 * a, "inv": lambda a: 1 / a,
    "asin": lambda a: ca.asin(a / 4), "acos": lambda a: ca.acos(a / 4), "acosh": lambda a: ca.acosh(1 + a),
    "atanh": lambda a: ca.atanh(a / 4), "fabs": lambda a: ca.fabs(a - 1), "sign": lambda a: ca.sign(a - 1),
    "cube": lambda a: a**3, "fourth": lambda a: a**4, "minus_two": lambda a: a**-2, "power": lambda a: a**1.7,
    "not": lambda a: ca.logic_not(a > 1),
}  # fmt: skip
UNARY |= {name: getattr(ca, name) for name in "sqrt sin cos tan atan sinh cosh tanh asinh exp log floor ceil".split()}
UNARY |= {"erf": ca.erf, "log1p": ca.log1p, "expm1": ca.expm1}
BINARY = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "div": lambda a, b: a / b,
    "pow": lambda a, b: a**b, "atan2": ca.atan2, "fmod": ca.fmod, "copysign": lambda a, b: ca.copysign(a, b - 1),
    "fmin": ca.fmin, "fmax": ca.fmax, "lt": lambda a, b: a < b, "le": lambda a, b: a <= b, "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b, "and": lambda a, b: ca.logic_and(a > 1, b > 1),
    "or": lambda a, b: ca.logic_or(a > 1, b > 1),
    "and a number": lambda a, b: ca.logic_and(a > 1, 1) + 2 * ca.logic_and(0, b > 1) + ca.logic_or(0, b > 1),
    "least with a number": lambda a, b: ca.fmin(a, 1) + 10 * ca.fmax(1, b) + 100 * ca.fmax(2, a - b),
    "sign of -0": lambda a, b: ca.copysign(a, -0.0 * b),
    "if_else": lambda a, b: ca.if_else(a > b, a, -b), "hypot": ca.hypot, "remainder": ca.remainder,
}  # fmt: skip


OPERATIONS = (*UNARY, *BINARY)


@functools.cache
def operation_values():
    """Each operation, and its sum with a parameter, by the engine and by CasADi, (13, 2 n): one model for all."""

    def build(name):
        return UNARY[name](X[0]) if name in UNARY else BINARY[name](X[0], X[1])

    outputs = ca.vertcat(*[e for name in OPERATIONS for e in (build(name), build(name) + P[0])])
    rng = np.random.default_rng(3)
    x0, p = rng.uniform(0.1, 2.5, (13, 2)), rng.uniform(0.5, 2, (13, 2))
    x0[3] = [1.0, 1.0]
    return values(outputs, x0, p)[:, 0], ca.Function("f", [X, P, T], [outputs])(x0.T, p.T, 0.5).full().T


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_casadi_s(name):
    found, expected = operation_values()
    own = slice(2 * OPERATIONS.index(name), 2 * OPERATIONS.index(name) + 2)
    assert_allclose(found[:, own], expected[:, own], rtol=4e-15, atol=4e-15)


def test_a_branch_not_taken_cannot_spoil_the_value():
    outputs = ca.if_else(X[0] > 0, ca.sqrt(ca.fmax(X[0], 0)), 7.0)
    assert_allclose(values(outputs, [[-1.0, 0], [4.0, 0]], np.ones((2, 2)))[:, 0, 0], [7.0, 2.0])
    comparison = ca.vertcat(ca.fmin(X[0], X[1]), ca.fmax(X[0], X[1]))
    below = np.nextafter(1, 0)
    assert_allclose(values(comparison, [[below, 1.0]], np.ones((1, 2)))[0, 0], [below, 1.0])


def test_remainders_are_those_of_c():
    a, b = np.meshgrid([-7.5, -2.5, -0.5, 0.0, 0.5, 1.5, 2.5, 3.7, 1e300], [-3.0, -1.0, 0.3, 1.0, 2.0, 5.0, 1e308])
    pairs = np.column_stack([a.ravel(), b.ravel()])
    found = values(ca.remainder(X[0], X[1]), pairs, np.ones((len(pairs), 2)))[:, 0, 0]
    assert_array_equal(found, [math.remainder(*pair) for pair in pairs.tolist()])


def test_long_functions_are_cut_and_carry_their_values():
    terms, a = [], X[0]
    for k in range(1500):
        a = ca.sin(a + P[k % 2] / (k + 1)) * X[1]
        terms.append(a)
    outputs = ca.vertcat(sum(terms), terms[0] * terms[-1], T, 3.0, P[1], P[0] * P[1], X[1])
    x0, p = RNG.uniform(0.9, 1.1, (3, 2)), RNG.uniform(0.5, 2, (3, 2))
    expected = ca.Function("f", [X, P, T], [outputs])(x0.T, p.T, 0.25).full().T
    assert_allclose(values(outputs, x0, p, [0.25])[:, 0], expected, rtol=1e-12)


def test_parts_of_a_large_model_are_compiled_on_their_own(monkeypatch, tmp_path):
    """The same values as from one file, and again from the cache."""
    a, b = X[0], X[1]
    for k in range(900):
        a, b = b, ca.sin(a) + b * P[k % 2] / (k + 1)
    outputs = ca.vertcat(a, b, T, P[0])
    x0, p = RNG.uniform(0.9, 1.1, (3, 2)), RNG.uniform(0.5, 2, (3, 2))
    whole = values(outputs, x0, p)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("symmb.run.codegen.emit._PART", 2)
    assert np.array_equal(values(outputs, x0, p), whole)
    assert len([*tmp_path.rglob("*.so")]) == 1
    expected = ca.Function("f", [X, P, T], [outputs])(x0.T, p.T, 0.5).full().T
    assert_allclose(values(outputs, x0, p)[:, 0], expected, rtol=1e-12)


@pytest.mark.parametrize("chunk", [2, 400])
def test_angles_of_a_large_model_are_computed_before_their_sines(monkeypatch, chunk):
    """Angles that are states, sums of these, results themselves, or depend on other sines; in one piece and in many."""
    monkeypatch.setattr("symmb.run.codegen.emit.LARGE_MODEL", 0)
    monkeypatch.setattr("symmb.run.codegen.emit._CHUNK", chunk)
    together = X[0] + X[1]
    late = ca.sin(X[0]) * P[0] + together
    angles = ca.vertcat(X, together, together * P[0], T, late, P, 2 * T + P[1], ca.sin(P[0]), ca.cos(late))
    outputs = ca.vertcat(ca.cos(angles), angles, ca.sin(angles) * angles, 3.0, ca.cos(5 * X[1]))
    x0, p = RNG.uniform(-3, 3, (20, 2)), RNG.uniform(-3, 3, (20, 2))
    expected = ca.Function("f", [X, P, T], [outputs])(x0.T, p.T, 0.7).full().T
    assert_allclose(values(outputs, x0, p, [0.7])[:, 0], expected, rtol=1e-14, atol=1e-14)


def test_sines_and_cosines_of_any_angle():
    """Near multiples of pi / 2, where digits cancel, on both sides of the limit of the reduction, and infinite."""
    turns = RNG.integers(-60_000, 60_000, 4000) * (np.pi / 2)
    large = RNG.uniform(-1, 1, 200) * 10.0 ** RNG.uniform(4.9, 300, 200)
    a = np.concatenate([turns, turns * (1 + 1e-12), RNG.uniform(-10, 10, 1000), large, [0.0, -0.0, 1e5, 1e-300]])
    x0 = np.column_stack([a, np.zeros_like(a)])
    found = values(ca.vertcat(ca.sin(X[0]), ca.cos(X[0])), x0, np.ones((len(a), 2)))[:, 0]
    exact = np.column_stack([np.sin(a), np.cos(a)])
    assert (np.abs(found - exact) <= 3 * np.spacing(np.abs(exact))).all()
    chosen = ca.if_else(P[0] > 0, ca.sin(P[1]), 7.0)
    engine = Engine(Lanes(model_function(X, P, T, ca.SX.zeros(2), chosen, None), STEPS), np.zeros(1))
    Y, failed_samples = engine.values(np.zeros((3, 2)), np.array([[1.0, np.inf], [1.0, np.nan], [1.0, 0.5]]))
    assert np.isnan(Y[:2]).all() and np.isfinite(failed_samples.t_failed[:2]).all()
    assert_allclose(Y[2], np.sin(0.5), rtol=1e-15)


COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
STRICT = ("-std=gnu11", "-Wall", "-Wextra", "-Wvla", "-Werror", "-fsyntax-only")
SANITIZED = ("-std=gnu11", "-O0", "-g", "-march=native", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FILLED = {**os.environ, "ASAN_OPTIONS": "max_malloc_fill_size=1000000000:malloc_fill_byte=255"}
"""Memory that nobody has written to is full of NaN."""
MAIN = """
#include <stdio.h>
int main(void) {{
  static const double x0[] = {{ {x0} }}, p[] = {{ {p} }}, times[] = {{ {times} }};
  static double events[800], t_failed[{n}], x_failed[{n} * N_X], Y[{n} * {n_t} * N_Y];
  static char failure[{n}];
  static const double atol[] = {{ {atol} }}, numbers[] = {{ {numbers} }};
  for (int i = 0; i < {n}; ++i) t_failed[i] = NAN;
  Study s = {{x0, p, times, {n}, {n_t}, {rtol}, {growth}, {ahead}, {least}, atol, {longest}, {newton}, 100000, 0,
             t_failed, failure, x_failed, Y, .events = events, .most_events = 100, .numbers = numbers}};
  if (!work(&s, NULL, NULL)) return 1;
  for (int i = 0; i < {n} * {n_t} * N_Y; ++i) printf("%.17g ", Y[i]);
  return 0;
}}
"""


CPP = [C_FOLDER / "scalar.h", C_FOLDER / "kernel.h"]
"""Files of C++ for graphics cards, see test_card.py."""


@pytest.mark.parametrize("path", sorted({*C_FOLDER.glob("*.h")}.difference(CPP)), ids=lambda path: path.stem)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_each_file_compiles_by_itself(compiler, path):
    for options in ([], ["-march=native"]):  # narrow lanes, and those of this processor
        command = [compiler, "-x", "c", *STRICT, *options, str(path)]
        run = subprocess.run(command, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("model", "solver"),
    [
        (double_pendulum, mb.DormandPrince()),
        (double_pendulum, mb.Rosenbrock()),
        (double_pendulum, mb.RungeKutta(steps=50)),
        (bouncing_ball, mb.EventDriven()),
        pytest.param(double_pendulum, mb.NSTIFFSI2(step=0.05), marks=pytest.mark.long),
    ],
    ids=lambda value: getattr(value, "__name__", repr(value)),
)
def test_generated_programs_are_clean_under_sanitizers(model, solver, tmp_path):
    simulator = mb.DAESimulator(model.scene().with_times(np.linspace(0, 1, 5)), solver)
    P = simulator.dae.p_nominal * np.random.default_rng(0).uniform(0.9, 1.1, (11, 2))
    engine = simulator.program.engine()
    assert isinstance(engine, Engine) and engine.starts == (model is double_pendulum)
    x0 = np.zeros((1, 1)) if engine.starts else simulator.start.states(P)[0]
    controlled = isinstance(engine.control, StepTolerances)
    atol = engine.control.absolute(engine.n_x) if controlled else np.zeros(1)
    arrays = {"x0": x0, "p": P, "times": simulator.times, "atol": atol}
    arrays["numbers"] = np.array([*engine._source.numbers, 0.0])
    numbers = {name: ", ".join(map(repr, values.ravel().tolist())) for name, values in arrays.items()}
    numbers |= {"n": len(P), "n_t": len(simulator.times), "longest": engine.control.longest, "newton": engine.newton}
    for name, default in (("rtol", 0.0), ("growth", 0.0), ("ahead", 0.0), ("least", 1.0)):
        numbers[name] = getattr(engine.control, name, default)
    source, program = tmp_path / "study.c", tmp_path / "study"
    source.write_text(engine.source + MAIN.format(**numbers), encoding="utf-8")
    subprocess.run([COMPILERS[0], *SANITIZED, str(source), "-o", str(program), "-lm"], check=True, capture_output=True)
    run = subprocess.run([str(program)], capture_output=True, text=True, env=FILLED)
    assert run.returncode == 0, run.stderr
    Y = np.array(run.stdout.split(), dtype=float).reshape(len(P), len(simulator.times), -1)
    np.testing.assert_allclose(Y, simulator.run(P).Y, rtol=1e-9, atol=1e-9)


def test_no_array_of_the_models_size_stands_on_the_stack():
    x, p, t = ca.SX.sym("x", 1500), ca.SX.sym("p", 2), ca.SX.sym("t")
    rates = -x + ca.vertcat(x[1:], p[0]) * ca.sin(p[1] + t)
    engine = Engine(Lanes(model_function(x, p, t, rates, x[:2], x), StepTolerances(1e-6, 1e-8)), np.linspace(0, 1, 3))
    command = [COMPILERS[0], "-x", "c", "-std=gnu11", "-O1", "-march=native", "-Wframe-larger-than=65536", "-S"]
    run = subprocess.run([*command, "-", "-o-"], input=engine.source, capture_output=True, text=True)
    assert run.returncode == 0 and "frame-larger-than" not in run.stderr, run.stderr[:1000]


def test_the_key_of_a_kept_source_covers_every_file_of_the_package(tmp_path, monkeypatch):
    package = tmp_path / "symmb"
    shutil.copytree(C_FOLDER.parents[2], package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr("symmb.run.codegen.model_source.__file__", str(package / "run" / "codegen" / "model_source.py"))
    keys = set()
    inner = "run/schemes/dop853.py declare/symbolic/instructions.py run/codegen/c/lanes.h run/codegen/tableau.py"
    for name in (None, *inner.split()):
        if name is not None:
            (package / name).write_text((package / name).read_text(encoding="utf-8") + "\n", encoding="utf-8")
        _generator.cache_clear()
        keys.add(_generator())
    _generator.cache_clear()
    assert len(keys) == 5
