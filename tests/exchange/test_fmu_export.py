"""FMUs of scenes are valid, run in FMPy as closed forms and SciPy tell, and as the scenes do."""

import shutil
import subprocess
import zipfile

import casadi as ca
import machines
import numpy as np
import pytest
from faults import refused
from fmi_orders import compile_orders
from machines import ORIGIN, ball
from scipy.integrate import solve_ivp

import symmb as mb
from models import bouncing_ball, double_pendulum, four_bar
from symmb.run.codegen import has_compiler

fmpy = pytest.importorskip("fmpy")
from fmpy.build import build_platform_binary  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler")
BODY = mb.Body("body", 1.0, 0.1)


def pendulum():
    """A pendulum whose force switches with the time, and with its speed."""
    p = mb.Parameters(length=1.0, drive=0.5, until=0.8)
    rod = mb.Body("rod", mass=1.0, inertia=0.01)
    pin = mb.Revolute("pin", ORIGIN, rod.point(0, p.length))
    push = mb.Torque("push", rod, ca.if_else(mb.t < p.until, p.drive, 0.0) - 0.1 * ca.fabs(rod.omega) * rod.omega)
    system = mb.System(rod, pin, push, mb.Gravity(0, -9.81), parameters=p)
    outputs = {"angle": rod.theta, "rod.omega": rod.omega, "lowest <point>": rod.y}
    return mb.Scene(system, {"rod.theta": 0.4}, np.linspace(0, 2, 41), outputs, name="A driven pendulum")


def by_scipy(times, length, drive, until):
    """Angle and its rate (n_t, 2)."""

    def rates(t, x):
        torque = drive * (t < until) - 0.1 * abs(x[1]) * x[1] - 9.81 * length * np.sin(x[0])
        return [x[1], torque / (0.01 + length**2)]

    exact = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    begin = solve_ivp(rates, (0.0, until), [0.4, 0.0], t_eval=[*times[times < until], until], **exact).y
    rest = solve_ivp(rates, (until, times[-1]), begin[:, -1], t_eval=times[times >= until], **exact).y
    return np.hstack([begin[:, :-1], rest]).T


def release():
    """A pendulum whose pin opens."""
    bob = machines.pendulum(lambda m: mb.Release(m.hinge, mb.t > m.p.until), inertia=0.05, until=0.7)
    return bob.scene("x y", np.linspace(0, 1.5, 31), {"rod.theta": 1.0 - np.pi / 2})


def controlled():
    """A cart with a digital brake."""
    brake = lambda m: mb.Sampled("brake", period=0.11, law=-m.p.gain * m.ball.x - 2 * m.ball.vx)  # noqa: E731
    cart = ball(brake, lambda m: mb.Force("push", m.at, (m.brake.value, 0)), g=None, gain=8.0)
    return cart.scene({"x": cart.ball.x, "force": cart.brake.value}, np.linspace(0, 2, 41), {"ball.x": 1.0})


def bumpy():
    """A mass on a spring, pushed by a table of time, which is stretched by a parameter, and by dry friction."""
    values = [0, 1, 0, 2, 0, -1, 0, 3, 0]
    push = lambda m: mb.Table(np.linspace(0, 1, 9), values)(m.p.rate * mb.t - 0.5) - 0.1 * ca.fabs(m.ball.vx)  # noqa: E731
    spring = lambda m: mb.SpringDamper("spring", ORIGIN, m.at, 30.0, 0.4)  # noqa: E731
    bob = ball(spring, lambda m: mb.Force("push", m.at, (push(m), 0)), g=None, rate=2.0)
    return bob.scene("x", np.linspace(0, 2, 41), {"ball.x": 0.3})


def run_fmu(path, times, outputs, parameters, kind="CoSimulation", **options):
    """Outputs (n_t, n_y) of an FMU in FMPy."""
    options |= {"stop_time": times[-1], "output_interval": float(np.diff(times).max())}
    rows = fmpy.simulate_fmu(str(path), start_values=parameters, fmi_type=kind, output=list(outputs), **options)
    last = np.searchsorted(rows["time"], times + 1e-9, "right") - 1  # behind the events of model exchange
    return np.array([rows[name][last] for name in outputs]).T


@pytest.mark.parametrize("version", [2, 3])
def test_a_pendulum_agrees_with_scipy(version, tmp_path):
    scene, path = pendulum(), tmp_path / "pendulum.fmu"
    mb.save_fmu(mb.prepare(scene, mb.DormandPrince(1e-10)), path, version=version)
    assert validate_fmu(str(path)) == []
    units = {unit.name: unit.baseUnit for unit in fmpy.read_model_description(path).unitDefinitions}
    assert (units["rad/s"].rad, units["rad/s"].s, units["m"].m) == (1, -1, 1)
    parameters = {"length": 1.3, "drive": 0.7, "until": 1.03}
    expected = by_scipy(scene.times, **parameters)
    for kind, error in (("CoSimulation", 1e-9), ("ModelExchange", 1e-6)):
        Y = run_fmu(path, scene.times, scene.outputs, parameters, kind, relative_tolerance=1e-10)
        np.testing.assert_allclose(Y[:, :2], expected, atol=error)
        np.testing.assert_allclose(Y[:, 2], -1.3 * np.cos(expected[:, 0]), atol=error)


@pytest.mark.parametrize(
    ("make", "solver"),
    [
        (double_pendulum.scene, mb.DormandPrince(1e-10)), (four_bar.scene, mb.Rosenbrock()),
        (bouncing_ball.scene, mb.EventDriven()), (release, mb.EventDriven()), (controlled, mb.DormandPrince()),
        (bumpy, mb.DormandPrince()),
    ],
    ids=["double_pendulum", "four_bar", "bouncing_ball", "release", "controlled", "bumpy"],
)  # fmt: skip
def test_fmus_run_as_their_scenes(make, solver, tmp_path):
    simulator, path = mb.DAESimulator(make(), solver), tmp_path / "model.fmu"
    mb.save_fmu(simulator, path)
    assert validate_fmu(str(path)) == []
    nominal = simulator.dae.p_nominal
    for P in nominal * np.random.default_rng(3).uniform(0.98, 1.02, (3, len(nominal))):
        parameters = dict(zip(simulator.parameters, P.tolist(), strict=True))
        Y = run_fmu(path, simulator.times, simulator.outputs, parameters)
        expected = simulator.run(P[None]).Y[0]
        np.testing.assert_allclose(Y, expected, atol=1e-7 * np.abs(expected).max())


def test_an_impact_in_a_communication_step_is_exact(tmp_path):
    """A ball that falls from 1.25 m at 10 m/s^2 is at the floor after 0.5 s."""
    times, path = np.linspace(0, 1, 5), tmp_path / "ball.fmu"
    mb.save_fmu(machines.bouncing_ball(g=10.0, restitution=0.8).scene("y vy", times, {"ball.y": 1.25}), path)
    Y = run_fmu(path, times, ["y", "vy"], {"restitution": 0.6})
    heights = [1.25, 0.9375, 0, 0.6 * 5 * 0.25 - 5 * 0.25**2, 0.6 * 5 * 0.5 - 5 * 0.5**2]
    np.testing.assert_allclose(Y[:, 0], heights, atol=1e-12)
    np.testing.assert_allclose(Y[3:, 1], [0.5, -2.0], atol=1e-12)
    with pytest.raises(Exception, match="fmi3ExitInitializationMode"):  # FMPy tells the call
        run_fmu(path, times, ["y"], {"restitution": 1.6})


def test_the_same_scene_gives_the_same_file_with_sources(tmp_path):
    for name in ("a", "b"):
        mb.save_fmu(pendulum(), tmp_path / f"{name}.fmu")
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()
    names = zipfile.ZipFile(tmp_path / "a.fmu").namelist()
    assert {"sources/scene.c", "sources/fmi.c", "sources/buildDescription.xml"} <= set(names)
    assert any(name.startswith("binaries/") and "/A_driven_pendulum." in name for name in names)


@pytest.mark.skipif(shutil.which("cmake") is None, reason="FMPy builds by CMake")
@pytest.mark.parametrize("version", [2, 3])
def test_sources_build_elsewhere(version, tmp_path):
    mb.save_fmu(pendulum(), tmp_path / "pendulum.fmu", version=version)
    folder = tmp_path / "extracted"
    fmpy.extract(str(tmp_path / "pendulum.fmu"), str(folder))
    shutil.rmtree(folder / "binaries")
    (tmp_path / "build").mkdir()
    build_platform_binary(folder, tmp_path / "build")
    times = np.linspace(0, 2, 41)
    Y = run_fmu(folder, times, ["angle", "rod.omega"], {})
    np.testing.assert_allclose(Y, by_scipy(times, 1.0, 0.5, 0.8), atol=1e-7)


def test_an_fmu_is_bounded_as_its_scene(tmp_path):
    scene, box, path = pendulum(), mb.Box(length=(0.9, 1.1), drive=(0.4, 0.6)), tmp_path / "pendulum.fmu"
    mb.save_fmu(scene, path)
    powers = {unit.name: unit.baseUnit for unit in fmpy.read_model_description(path).unitDefinitions}
    assert [powers["rad/s"].s, powers["rad/s"].rad, powers["m"].m] == [-1, 1, 1]
    simulator = mb.FMUSimulator(path, {"length": 1.0, "drive": 0.5}, times=scene.times, outputs=[*scene.outputs])
    method = mb.PolynomialChaos(order=4)
    of_fmu, of_scene = mb.propagate(simulator, method, box), mb.propagate(scene, method, box)
    np.testing.assert_allclose(of_fmu.lower, of_scene.lower, atol=1e-7)
    np.testing.assert_allclose(of_fmu.upper, of_scene.upper, atol=1e-7)


def test_inputs_hold_between_communication_points(tmp_path):
    """A cart behind a motor with lag: its speed and its force after two steps of inputs, in closed form."""
    push, wind = mb.Input("push"), mb.Input("wind")
    motor = lambda m: mb.State("motor", rate=lambda z: (push.value - z) / m.p.lag)  # noqa: E731
    force = lambda m: mb.Force("force", m.at, (m.motor.value + wind.value, 0))  # noqa: E731
    cart = ball(push, wind, motor, force, g=None, mass=2.0, lag=0.3)
    scene = cart.scene({"v": cart.ball.vx, "wind outside": wind.value}, np.linspace(0, 2, 21))
    assert not mb.simulate(scene).values.any()
    mb.save_fmu(scene, tmp_path / "cart.fmu")
    assert validate_fmu(str(tmp_path / "cart.fmu")) == []
    columns = [("time", float), ("push", float), ("wind", float)]
    signals = np.array([(0.0, 0, 0), (0.5, 0, 0), (0.5, 1, 0), (1.0, 1, 0), (1.0, 1, -2), (2.0, 1, -2)], dtype=columns)
    expected = (1.5 - 0.3 * (1 - np.exp(-1.5 / 0.3)) - 2 * 1.0) / 2
    for kind, error in (("CoSimulation", 1e-8), ("ModelExchange", 1e-6)):
        Y = run_fmu(tmp_path / "cart.fmu", scene.times, ["v", "wind outside"], {}, kind, input=signals)
        np.testing.assert_allclose(Y[-1], [expected, -2], atol=error)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("make", [pendulum, bouncing_ball.scene], ids=["pendulum", "bouncing_ball"])
def test_calls_in_any_order_are_answered(make, version, tmp_path):
    """The longer study is `tests/benchmarks/exported_fmus.py`."""
    program = compile_orders(make(), version, tmp_path)
    run = subprocess.run([program, "0", "300"], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stdout + run.stderr


def test_an_input_is_one_of_a_linearisation():
    u = mb.Input("u")
    scene = ball(u, lambda m: mb.Force("motor", m.at, (8 * u.value - m.ball.vx, 0)), g=None, mass=2.0).scene("vx")
    np.testing.assert_allclose(mb.linearize(scene, inputs=["u"]).B.ravel(), [0, 4])
    refused("no actuator, input or parameter 'w'", mb.linearize, scene, inputs=["w"])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda u: mb.System(u, parameters=mb.Parameters(u=1.0)), "Input 'u': a parameter or the time has this name"),
        (lambda u: mb.System(u, mb.Input("u")), "Input 'u': the name is used twice"),
        (lambda u: mb.System(mb.Input("a.b")), "Input 'a.b': a name must not contain"),
        (lambda u: mb.Input(3), "Input: the name must be a text, got 3"),
        (lambda u: mb.System(mb.State("z", rate=u.value)), "Input 'u' is not part of the System. Add it"),
        (lambda u: mb.System(u, BODY, mb.Revolute("pin", mb.Ground().point(u.value, 0), BODY.point(0, 0))),
         "Input 'u': a point, mass or shape depends on this input"),
    ],
)  # fmt: skip
def test_faults_of_inputs(make, text):
    refused(text, make, mb.Input("u"))


@pytest.mark.parametrize(
    ("made", "options", "text"),
    [
        (lambda own: own, {"version": 1}, "version must be 2 or 3, a version of FMI, got 1"),
        (lambda own: own, {"name": "model.zip"}, "must end in .fmu"),
        (lambda own: own, {"name": "none/model.fmu"}, "cannot be written: No such file or directory"),
        (lambda own: own.system, {}, "Expected a Scene, got System"),
        (lambda own: mb.prepare(own, mb.CVODES()), {}, r"CVODES\(\) cannot be exported"),
        (lambda own: mb.prepare(own, mb.RungeKutta()), {}, "RungeKutta.* cannot be exported"),
        (lambda own: mb.prepare(own, mb.Rosenbrock()), {}, "cannot end its steps at the kinks"),
        (lambda own: own.with_outputs({"peak": mb.maximum(own.system.bodies[0].y)}), {}, "'peak' is a scalar output"),
        (lambda own: own.with_outputs({"drive": own.system.bodies[0].y}), {},
         "'drive' is the name of two FMU variables"),
    ],
)  # fmt: skip
def test_faults_are_told_in_one_sentence(made, options, text, tmp_path):
    name, version = options.get("name", "model.fmu"), options.get("version", 3)
    refused(text, lambda: mb.save_fmu(made(pendulum()), tmp_path / name, version=version), error=mb.SymmbError)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("chirp", [20.0, 33.0])
def test_narrow_windows_of_a_chirp_are_time_events_of_model_exchange(chirp, version, tmp_path):
    """A push of 1 N while sin(c t^2) > 0.97: speeds are its durations, which arcsin tells."""
    window = ca.if_else(ca.sin(chirp * mb.t**2) > 0.97, 1.0, 0.0)
    cart = ball(lambda m: mb.Force("push", m.at, (window, 0)), g=None)
    scene = cart.scene("vx", np.linspace(0, 2, 21))
    mb.save_fmu(mb.prepare(scene, mb.DormandPrince()), tmp_path / "a.fmu", version=version)
    k = np.arange(60)
    ends = np.sqrt((np.pi / 2 + 2 * np.pi * k + np.arccos(0.97) * np.array([[-1], [1]])) / chirp)
    exact = [np.diff(np.clip(ends, 0, t), axis=0).sum() for t in scene.times]
    Y = run_fmu(tmp_path / "a.fmu", scene.times, ["vx"], {}, "ModelExchange")
    np.testing.assert_allclose(Y[:, 0], exact, atol=1e-5)
