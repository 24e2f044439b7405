"""Without a C compiler scenes run by CasADi's integrators, and what needs compiled C is refused by name."""

import sys

import casadi as ca
import numpy as np
import pytest
from faults import refused, refused_command, warned
from machines import bouncing_ball
from numpy.testing import assert_allclose, assert_array_equal
from small_scenes import particle

import symmb as mb
from symmb.bound.polynomials import basis_values
from symmb.bound.polynomials.legendre import tensor_degree, total_degree
from symmb.bound.polynomials.ranges import attained_extremes
from symmb.connect.simulator import Reduction
from symmb.run.codegen import NoCompilerError, build
from symmb.show.cli.main import main

INSTALL = r"Install gcc or clang, or run `pip install 'symmb\[compiler\]'`, or set CC\."
TOLD = f"No C compiler found. Without a C compiler runs take about 100 times as long. {INSTALL}"
TIMES = np.linspace(0.0, 2.0, 21)


@pytest.fixture(autouse=True)
def _no_compiler(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "ziglang", None)
    monkeypatch.delenv("CC", raising=False)
    build._compiler.cache_clear()
    yield
    build._compiler.cache_clear()


def spring(law=lambda k, x: -k * x):
    """A mass of 1 kg on a spring of k in [3, 5] N/m, x = cos(sqrt(k) t), or under another force."""
    return particle(lambda p, mass: law(p.k, mass.x), TIMES, {"mass.x": 1.0}, k=(3.0, 5.0))


def known(k):
    return np.cos(np.sqrt(np.asarray(k)[:, None]) * TIMES)


@pytest.mark.filterwarnings("error")
def test_a_smooth_scene_runs():
    run = mb.simulate(spring())
    assert run.solver == "CVODES()" and not run.doubts
    assert_allclose(run["x"], known([4.0])[0], atol=1e-8)
    assert not mb.simulate(spring(lambda k, x: ca.if_else(mb.t < 0.3, -x, 0))).doubts
    checked = mb.simulate(spring(), check=True)
    assert not checked.doubts and checked.error.max() < 1e-6


def test_a_stiff_scene_runs():
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    drag = mb.Force("drag", bob.point(0, 0), (-1e6 * bob.vx + 1e6 * ca.cos(mb.t), 0))
    damper = mb.Damper("damper", mb.Ground().point(0, -1), bob.point(0, 0), 1e-9)  # its guard is no switch
    run = mb.simulate(mb.Scene(mb.System(bob, drag, damper), {"bob.vx": 1.0}, TIMES, {"v": bob.vx}))
    assert not run.doubts and run.solver.startswith("CVODES") and "stiff=True" in run.solver
    assert_allclose(run["v"], np.cos(TIMES), atol=1e-5)


def test_switches_are_left_to_the_control_of_steps():
    """A wall of 1 kN/m at x = 0, which throws the mass back in a motion about k / (k + 1000)."""
    with pytest.warns(mb.SymmbWarning, match=f"steps do not end at switches: short pulses .*{INSTALL}"):
        run = mb.simulate(spring(lambda k, x: -k * x + ca.if_else(x < 0, -1000 * x, 0)))
    fast = np.sqrt(1004.0)
    half, back = np.pi / 4, np.pi / fast  # from x = 1 to the wall, and in it
    t = TIMES % (2 * half + back)
    free = np.where(t < half, np.cos(2 * t), np.sin(2 * (t - half - back)))
    inside = -2 / fast * np.sin(fast * (t - half))
    assert_allclose(run["x"], np.where((t > half) & (t < half + back), inside, free), atol=1e-6)


def test_studies_run_and_say_that_they_are_slow():
    k = np.linspace(3, 5, 2001)
    lower, upper = known(k).min(axis=0), known(k).max(axis=0)
    assert_allclose(warned(TOLD, mb.propagate, spring(), mb.PolynomialChaos())["x"], [lower, upper], atol=2e-3)
    with pytest.warns(mb.SymmbWarning, match=TOLD):
        swept = mb.sweep(spring(), {"k": [3.0, 4.0, 5.0]})
        assert "Not tried: DormandPrince, " in mb.stability(spring(), seconds=0.6).advice
    assert_allclose(swept.values[:, :, 0], known([3.0, 4.0, 5.0]), atol=1e-6)
    scene = spring()
    for method, error in ((mb.MonteCarlo(100), 0.05), (mb.PolynomialChaos(order=5), 0.02)):
        assert_allclose(mb.propagate(scene, method, solver=mb.CVODES())["x"], [lower, upper], atol=error)
    bounds = mb.propagate(scene, mb.Taylor(3), mb.Box(k=(3.9, 4.1)), solver=mb.CVODES())
    near = known(np.linspace(3.9, 4.1, 101))
    assert_allclose(bounds["x"], [near.min(axis=0), near.max(axis=0)], atol=2e-3)


def test_simulators_stream():
    simulator = mb.DAESimulator(spring(), mb.CVODES())
    samples = np.linspace(3, 5, 11)[:, None]
    extremes = Reduction(list, lambda s, block, i: [*s, block.extremes()], lambda a, b: a + b)
    gathered = simulator.stream(samples, extremes)
    assert_array_equal(gathered[0][1], simulator.run(samples).Y.max(axis=0))


@pytest.mark.parametrize(
    "solver", [mb.DormandPrince(), mb.EventDriven(), mb.Rosenbrock(), mb.NSTIFFSI2(), mb.HHT()], ids=repr
)
def test_solvers_that_are_compiled_are_refused_by_name(solver):
    told = rf"^{type(solver).__name__}\(.*\) needs a C compiler, and none was found\. {INSTALL}$"
    refused(told, mb.simulate, spring(), solver, error=NoCompilerError)


def test_scenes_with_events_are_refused():
    scene = bouncing_ball().scene(times=TIMES, start={"ball.y": 1.0})
    told = r"^EventDriven\(\), which locates the events of Impact 'floor', needs a C compiler"
    refused(told, mb.simulate, scene, error=NoCompilerError)
    refused(r"^The export of an FMU needs a C compiler", mb.save_fmu, scene, "scene.fmu", error=NoCompilerError)
    assert mb.linearize(scene).modes is not None


SCENE = "from models.double_pendulum import scene as whole\n\n"
SCENE += "def scene():\n    return whole().with_times([0, 0.2, 0.4])\n"


@pytest.mark.filterwarnings("default::symmb.SymmbWarning")
def test_the_command_line_compares_and_says_that_it_is_slow(tmp_path, capsys):
    file, told = tmp_path / "scene.py", TOLD.replace("\\", "")
    file.write_text(SCENE)
    outputs = [str(tmp_path / name) for name in ("out.json", "out.png")]
    methods = ["--methods", "pce:2:paper", "taylor:2", "pce", "mc:20"]
    assert main(["compare", str(file), *methods, "--json", outputs[0], "--plot", outputs[1]]) in (0, 3)
    assert capsys.readouterr().err.count(told) == 1
    assert all((tmp_path / name).stat().st_size for name in ("out.json", "out.png"))
    assert main(["compare", str(file), "--methods", "vertex", "--solver", "cvodes"]) in (0, 3)
    assert "compiler" not in capsys.readouterr().err
    assert "DormandPrince() needs a C compiler" in refused_command(capsys, "simulate", str(file), "--solver", "dopri")


@pytest.mark.parametrize("alpha", [tensor_degree(1, 8), tensor_degree(2, 6), tensor_degree(3, 3), total_degree(8, 2)])
def test_extremes_lie_beyond_those_of_samples_and_within_bounds(alpha):
    rng = np.random.default_rng(0)
    c = rng.normal(size=(len(alpha), 60)) * 0.4 ** alpha.sum(axis=1)[:, None]
    lower, upper, at_lower, at_upper = attained_extremes(alpha, c)
    attained = [np.einsum("mb,bm->m", basis_values(alpha, at), c) for at in (at_lower, at_upper)]
    assert_allclose(attained, [lower, upper], atol=1e-12)
    points = rng.uniform(-1, 1, (4000, alpha.shape[1]))
    points[:1000] = np.sign(points[:1000])
    values = basis_values(alpha, points) @ c
    short = np.maximum(lower - values.min(axis=0), values.max(axis=0) - upper) / np.ptp(values, axis=0)
    assert np.quantile(short, 0.9) < 1e-9 and short.max() < 0.1  # a valley beside the deepest one may be found
    found = mb.Exact().search(alpha, c)
    assert (found.lower <= np.minimum(lower, values.min(axis=0)) + 1e-12).all()
    assert (found.upper >= np.maximum(upper, values.max(axis=0)) - 1e-12).all()
    assert_allclose([found.lower + found.below, found.upper - found.above], [lower, upper], atol=1e-12)
    assert found.gap.max() > 0
