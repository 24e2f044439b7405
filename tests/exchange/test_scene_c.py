"""C of scenes builds without warnings, is clean under sanitizers, and computes what the Python functions do."""

import csv
import ctypes
import shutil
import subprocess
import warnings

import numpy as np
import pytest
from machines import linkage, rods

import symmb as mb
from models import bouncing_ball, double_pendulum, four_bar, heavy_top
from symmb.run.codegen import c_source
from symmb.show.cli.main import main
from symmb.show.exchange import save_scene_c

COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
STRICT = ("-std=gnu11", "-Wall", "-Wextra", "-Wvla", "-Werror")
SANITIZED = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

pytestmark = pytest.mark.skipif(not COMPILERS, reason="needs gcc or clang")


def crane():
    """A load on a rope of two links, in static equilibrium at the start, whose motor has an input."""
    torque = mb.Input("torque")
    side = lambda m: mb.Force("side", m.bodies[1].point(0, 0), (m.p.pull, 0))  # noqa: E731
    motor = lambda m: mb.Actuator("motor", m.hinges[0], torque.value)  # noqa: E731
    outputs = lambda m: {"x": m.bodies[1].x, "load": m.system.reaction("hinge0").fy}  # noqa: E731
    return rods(2, torque, side, motor, pull=3.0).scene(outputs, np.linspace(0, 1, 11), equilibrium=True)


def library(scene, folder, solver=None):
    """The functions of a scene, compiled."""
    simulator = mb.DAESimulator(scene, solver or mb.DormandPrince(1e-10))
    save_scene_c(simulator, folder)
    command = [COMPILERS[0], *STRICT, "-O2", "-shared", "-fPIC", "scene.c", "-o", "scene.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    functions = ctypes.CDLL(str(folder / "scene.so"))
    for name in ("parameters", "outputs"):
        getattr(functions, f"scene_{name}").restype = ctypes.POINTER(ctypes.c_double)
    functions.scene_new.restype = ctypes.c_void_p
    functions.scene_fault.restype = ctypes.c_char_p
    return simulator, functions


def started(functions, end):
    """A run that has started."""
    run = ctypes.c_void_p(functions.scene_new())
    assert functions.scene_start(run, ctypes.c_double(end), ctypes.c_double(0.0))
    return run


@pytest.mark.parametrize("scene", [double_pendulum.scene(), heavy_top.scene(), four_bar.scene(), crane()], ids=repr)
def test_start_outputs_and_rates_are_those_of_the_python_functions(scene, tmp_path):
    simulator, functions = library(scene, tmp_path)
    form, n_p = simulator.formulation, len(simulator.parameters)
    dae, run = form.dae, ctypes.c_void_p(functions.scene_new())
    x, rates = np.empty(form.y.numel_in(0)), np.empty(form.y.numel_in(0))
    for P in dae.p_nominal * np.random.default_rng(2).uniform(0.99, 1.01, (3, n_p)):
        for k, value in enumerate(P.tolist()):
            functions.scene_parameters(run)[k] = value
        assert functions.scene_start(run, ctypes.c_double(simulator.times[-1]), ctypes.c_double(0.0))
        functions.scene_states(run, x.ctypes.data_as(ctypes.c_void_p))
        np.testing.assert_allclose(x, form.start.states(P[None])[0][0], rtol=1e-12, atol=1e-12)
        y = form.y(x, P, simulator.times[0]).full().ravel()
        np.testing.assert_allclose(functions.scene_outputs(run)[: len(y)], y, rtol=1e-12, atol=1e-12 * np.abs(y).max())
        if not dae.n_r:
            functions.scene_rates(run, rates.ctypes.data_as(ctypes.c_void_p))
            q, v = x[: dae.n_q], x[dae.n_q :]
            own = np.concatenate([rate.full().ravel() for rate in dae.rhs(q, v, P, 0.0)])
            np.testing.assert_allclose(rates, own, rtol=1e-12, atol=1e-12 * np.abs(own).max())
    functions.scene_free(run)


@pytest.mark.parametrize(
    ("model", "solver", "compiler"),
    [
        pytest.param(*scene, compiler, marks=() if i % len(COMPILERS) == k else pytest.mark.long)
        for i, scene in enumerate(
            [(double_pendulum, "dopri:1e-10"), (bouncing_ball, "events"), (four_bar, "rosenbrock")]
        )
        for k, compiler in enumerate(COMPILERS)
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_programs_are_clean_under_sanitizers_and_print_the_outputs(model, solver, compiler, tmp_path, capsys):
    name = model.__name__.rpartition(".")[2]
    assert main(["codegen", name, "-o", str(tmp_path), "--solver", solver]) == 0
    assert {"scene.c", "scene.h", "main.c", "model.c"} <= {path.name for path in tmp_path.iterdir()}
    for version in ("fmi2", "fmi3"):
        (tmp_path / f"{version}.c").write_text('#include "scene.h"\n' + c_source("fmu", version))
    command = [compiler, *STRICT, *SANITIZED, "scene.c", "main.c", "fmi2.c", "fmi3.c", "-o", "scene", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    simulator = mb.DAESimulator(model.scene(), mb.DormandPrince(1e-10) if solver.startswith("dopri") else None)
    P = simulator.dae.p_nominal * 0.99
    words = [f"{parameter}={value!r}" for parameter, value in zip(simulator.parameters, P.tolist(), strict=True)]
    run = subprocess.run([str(tmp_path / "scene"), *words], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    head, *rows = csv.reader(run.stdout.splitlines())
    assert head == ["t", *simulator.outputs]
    Y = np.array(rows, dtype=float)
    np.testing.assert_array_equal(Y[:, 0], simulator.times)
    expected = simulator.run(P[None]).Y[0]
    np.testing.assert_allclose(Y[:, 1:], expected, atol=1e-6 * np.abs(expected).max())


def test_faults_of_a_program_end_it_with_a_sentence(tmp_path, capsys):
    main(["codegen", "bouncing_ball", "-o", str(tmp_path)])
    subprocess.run([COMPILERS[0], "scene.c", "main.c", "-lm", "-o", "scene"], cwd=tmp_path, check=True)
    wrong = "{} is not a parameter with a finite number. Write name=number.\n"
    told = {"restitution=1.5": (1, "The run fails at t = 0 s: the start could not be computed.\n")}
    told |= {word: (2, wrong.format(word)) for word in ("restitution=much", "restitution=nan", "elasticity=0.5")}
    for word, expected in told.items():
        run = subprocess.run([str(tmp_path / "scene"), word], capture_output=True, text=True)
        assert (run.returncode, run.stderr) == expected


def test_a_scene_without_states_has_equations_only(tmp_path, capsys):
    with warnings.catch_warnings(action="always"):
        assert main(["codegen", "cubic", "-o", str(tmp_path)]) == 0
    assert "only the equations are written as C, not runs. cubic has no states" in capsys.readouterr().err
    assert not (tmp_path / "scene.c").exists()


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.EventDriven()], ids=repr)
def test_a_loop_closes_at_once_where_a_length_changes(solver, tmp_path):
    """The crank turns at a given rate, so that the other angles follow from the lengths by the law of cosines."""
    turn = lambda m: mb.Motion("turn", m.A.angle, 3 * mb.t)  # noqa: E731
    bars = linkage(turn, lengths=(0.1, 0.3, 0.25, 0.3), inertia=0.01)
    tip, guess = bars.rocker.point(bars.p.c / 2, 0), {"coupler.theta": 0.6, "rocker.theta": 1.5}
    outputs = {"x": tip.x, "y": tip.y}
    scene = bars.scene(outputs, np.linspace(0, 1, 11), {"crank.theta": 0.0}, guess=guess)
    _, functions = library(scene, tmp_path, solver)
    run = started(functions, 1.0)
    assert functions.scene_step(run, ctypes.c_double(0.5))
    for length in (0.27, 0.22):
        functions.scene_parameters(run)[2] = length
        assert functions.scene_change(run)
        x, y = functions.scene_outputs(run)[:2]
        found = [np.hypot(x - 0.3, y), np.hypot(x - 0.1 * np.cos(1.5), y - 0.1 * np.sin(1.5))]
        np.testing.assert_allclose(found, [length, 0.3], rtol=1e-9)
    functions.scene_parameters(run)[2] = 0.9
    assert not functions.scene_change(run)
    assert functions.scene_fault(run) == b"the constraints cannot be satisfied with the new parameters"
    functions.scene_free(run)


def test_parameters_and_inputs_may_change_during_a_run(tmp_path):
    """A step of the torque of a crane at rest moves it as SciPy's solution of its equations."""
    from scipy.integrate import solve_ivp

    simulator, functions = library(crane(), tmp_path)
    dae, n_p = simulator.formulation.dae, len(simulator.parameters)
    run, x = started(functions, 1.0), np.empty(4)
    assert functions.scene_step(run, ctypes.c_double(0.37))
    functions.scene_parameters(run)[n_p] = 1.5  # behind the parameters
    assert functions.scene_change(run)
    assert functions.scene_step(run, ctypes.c_double(1.0))
    functions.scene_states(run, x.ctypes.data_as(ctypes.c_void_p))
    live = mb.DAESimulator(crane().with_inputs(["torque"]), mb.DormandPrince()).formulation.dae
    start = simulator.formulation.start.states(dae.p_nominal[None])[0][0]

    def rates(t, state):
        return np.concatenate([r.full().ravel() for r in live.rhs(state[:2], state[2:], [*dae.p_nominal, 1.5], t)])

    expected = solve_ivp(rates, (0.37, 1.0), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.abs(expected - start).max() > 0.05
    np.testing.assert_allclose(x, expected, atol=1e-8)
    functions.scene_free(run)
