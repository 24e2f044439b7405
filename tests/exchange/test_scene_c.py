"""C of scenes builds without warnings, is clean under sanitizers, and computes what the Python functions do."""

import csv
import ctypes
import shutil
import subprocess
import warnings

import numpy as np
import pytest

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
    p = mb.Parameters(length=1.0, mass=2.0, pull=3.0)
    upper, lower = mb.Body("upper", 0.5, 0.04), mb.Body("lower", p.mass, 0.04)
    top = mb.Revolute("top", mb.Ground().point(0, 0), upper.point(0, p.length))
    middle, torque = mb.Revolute("middle", upper.point(0, 0), lower.point(0, p.length)), mb.Input("torque")
    side = mb.Force("side", lower.point(0, 0), (p.pull, 0))
    motor = mb.Actuator("motor", top, torque.value)
    system = mb.System(upper, lower, top, middle, side, torque, motor, mb.Gravity(0, -9.81), parameters=p)
    outputs = {"x": lower.x, "load": system.reaction("top").fy}
    return mb.Scene(system, times=np.linspace(0, 1, 11), outputs=outputs, equilibrium=True)


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
        expected = form.start.states(P[None])[0][0]
        np.testing.assert_allclose(x, expected, rtol=1e-12, atol=1e-12)
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
    for word, status, text in (
        ("restitution=1.5", 1, "The run fails at t = 0 s: the start could not be computed.\n"),
        ("restitution=much", 2, "restitution=much is not a parameter with a finite number. Write name=number.\n"),
        ("restitution=nan", 2, "restitution=nan is not a parameter with a finite number. Write name=number.\n"),
        ("elasticity=0.5", 2, "elasticity=0.5 is not a parameter with a finite number. Write name=number.\n"),
    ):
        run = subprocess.run([str(tmp_path / "scene"), word], capture_output=True, text=True)
        assert (run.returncode, run.stderr) == (status, text)


def test_a_scene_without_states_has_equations_only(tmp_path, capsys):
    with warnings.catch_warnings(action="always"):
        assert main(["codegen", "cubic", "-o", str(tmp_path)]) == 0
    assert "only the equations are written as C, not runs. cubic has no states" in capsys.readouterr().err
    assert not (tmp_path / "scene.c").exists()


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.EventDriven()], ids=repr)
def test_a_loop_closes_at_once_where_a_length_changes(solver, tmp_path):
    """The crank turns at a given rate, so that the other angles follow from the lengths by the law of cosines."""
    p = mb.Parameters(rocker=0.25)
    ground, crank, coupler, rocker = mb.Ground(), *(mb.Body(name, 1.0, 0.01) for name in ("crank", "coupler", "rocker"))
    drive = mb.Revolute("drive", ground.point(0, 0), crank.point(0, 0))
    loop = [
        mb.Revolute("a", crank.point(0.1, 0), coupler.point(0, 0)),
        mb.Revolute("b", coupler.point(0.3, 0), rocker.point(p.rocker, 0)),
        mb.Revolute("c", ground.point(0.3, 0), rocker.point(0, 0)),
    ]
    system = mb.System(crank, coupler, rocker, drive, *loop, mb.Motion("turn", drive.angle, 3 * mb.t), parameters=p)
    outputs = {"x": rocker.point(p.rocker, 0).x, "y": rocker.point(p.rocker, 0).y}
    guess = {"coupler.theta": 0.6, "rocker.theta": 1.5}
    scene = mb.Scene(system, {"crank.theta": 0.0}, np.linspace(0, 1, 11), outputs, guess=guess)
    _, functions = library(scene, tmp_path, solver)
    run = ctypes.c_void_p(functions.scene_new())
    assert functions.scene_start(run, ctypes.c_double(1.0), ctypes.c_double(0.0))
    assert functions.scene_step(run, ctypes.c_double(0.5))
    for length in (0.27, 0.22):
        functions.scene_parameters(run)[0] = length
        assert functions.scene_change(run)
        x, y = functions.scene_outputs(run)[:2]
        found = [np.hypot(x - 0.3, y), np.hypot(x - 0.1 * np.cos(1.5), y - 0.1 * np.sin(1.5))]
        np.testing.assert_allclose(found, [length, 0.3], rtol=1e-9)
    functions.scene_parameters(run)[0] = 0.9
    assert not functions.scene_change(run)
    assert functions.scene_fault(run) == b"the constraints cannot be satisfied with the new parameters"
    functions.scene_free(run)


def test_parameters_and_inputs_may_change_during_a_run(tmp_path):
    """A step of the torque of a crane at rest moves it as SciPy's solution of its equations."""
    from scipy.integrate import solve_ivp

    simulator, functions = library(crane(), tmp_path)
    dae, n_p = simulator.formulation.dae, 3
    run, x = ctypes.c_void_p(functions.scene_new()), np.empty(4)
    assert functions.scene_start(run, ctypes.c_double(1.0), ctypes.c_double(0.0))
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
