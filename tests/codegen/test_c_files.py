"""The fixed C: each file compiles by itself, without warnings, and generated programs are clean under sanitizers."""

import os
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest

import symmb as mb
from models import bouncing_ball, double_pendulum
from symmb.run.codegen import Engine, Lanes, StepTolerances, model_function
from symmb.run.codegen.c_source import C_FOLDER
from symmb.run.codegen.model_source import _generator

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
  static const double atol[] = {{ {atol} }};
  for (int i = 0; i < {n}; ++i) t_failed[i] = NAN;
  Study s = {{x0, p, times, {n}, {n_t}, {rtol}, {growth}, {ahead}, {least}, atol, {longest}, {newton}, 100000, 0,
             t_failed, failure, x_failed, Y, 0, 0, 0, 0, 0, 0, 0, events, 0, 100}};
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
    ids=repr,
)
def test_generated_programs_are_clean_under_sanitizers(model, solver, tmp_path):
    simulator = mb.DAESimulator(model.scene().with_times(np.linspace(0, 1, 5)), solver)
    P = simulator.dae.p_nominal * np.random.default_rng(0).uniform(0.9, 1.1, (11, 2))
    engine = simulator.program.engine()
    assert isinstance(engine, Engine) and engine.starts == (model is double_pendulum)
    x0 = np.zeros((1, 1)) if engine.starts else simulator.start.states(P)[0]
    controlled = isinstance(engine.control, StepTolerances)
    atol = engine.control.absolute(engine.n_x) if controlled else np.zeros(1)
    numbers = {
        "x0": ", ".join(map(repr, x0.ravel().tolist())),
        "p": ", ".join(map(repr, P.ravel().tolist())),
        "times": ", ".join(map(repr, simulator.times.tolist())),
        "n": len(P),
        "n_t": len(simulator.times),
        "rtol": getattr(engine.control, "rtol", 0.0),
        "growth": getattr(engine.control, "growth", 0.0),
        "ahead": getattr(engine.control, "ahead", 0.0),
        "least": getattr(engine.control, "least", 1.0),
        "atol": ", ".join(map(repr, atol.tolist())),
        "longest": engine.control.longest,
        "newton": engine.newton,
    }
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
