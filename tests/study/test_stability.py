"""What a scene can bear: trials, their limits, errors against equations by hand, and the advice."""

import faulthandler
import json
import os
import time

import casadi as ca
import numpy as np
import pytest
from mechanisms import double_pendulum, double_pendulum_by_hand, explosion

import symmb as mb
from symmb.show.cli.main import main
from symmb.study import trials as trials_module
from symmb.study.stress import lighter, slower, stresses
from symmb.study.trials import Job, run_jobs

SPRUNG = """
import numpy as np
import symmb as mb

def scene():
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(0, 0), ball.point(0, 0), {k}, {c}, 0.0)
    system = mb.System(ball, spring)
    return mb.Scene(system, {{"ball.x": 1.0}}, times=np.linspace(0, 2, 21), outputs={{"x": ball.x}}, name="sprung")
"""


@pytest.fixture(scope="module")
def found():
    return mb.stability(double_pendulum(np.linspace(0, 0.4, 9), box=mb.Box(l1=(0.95, 1.05), l2=(0.76, 0.84))))


def test_errors_are_those_against_equations_by_hand(found):
    exact = double_pendulum_by_hand((1.0, 0.8), found.times)
    spread = exact.std(axis=0)
    for trial in found.trials:
        if not trial.reason and trial.family in ("DormandPrince", "RungeKutta", "NSTIFFSI2"):
            error = (np.sqrt(np.mean((trial.values - exact) ** 2, axis=0)) / spread).max()
            assert found.errors[trial.key] == pytest.approx(error, rel=0.02, abs=1e-8)
    assert found.uncertainty < 1e-8


def test_finer_settings_err_less_and_constraints_are_kept_where_they_should_be(found):
    for family in ("DormandPrince", "CVODES", "StabilizedIndex2", "Rosenbrock", "NSTIFFSI2", "BDFI3", "Newmark"):
        errors = [found.errors[t.key] for t in found.trials if t.family == family and not t.reason]
        assert len(errors) >= 3 and errors[-1] < 0.2 * errors[0]
    for trial in found.trials:
        if trial.family in ("NSTIFFSI2", "GeneralizedAlpha", "HHT", "BDFI3") and not trial.reason:
            assert trial.position.max() < 1e-10


def test_what_was_found_is_told_saved_and_drawn(found, tmp_path):
    text = str(found)
    assert "NSTIFFSI2" in text and "horizon x 100" in text and "the fastest is" in text
    assert "box widened to 50%: none of 4 corners fail" in text
    found.save(tmp_path / "found.json")
    found.save(tmp_path / "found.npz")
    for name in ("found.json", "found.npz"):
        assert str(mb.Stability.load(tmp_path / name)) == text
    told = json.loads((tmp_path / "found.json").read_text())
    assert told["advice"] == found.advice and len(told["trials"]) == len(found.trials) + len(found.stress)
    found.plot(tmp_path / "found.png")
    assert (tmp_path / "found.png").stat().st_size > 10_000


@pytest.mark.long
def test_stiff_scenes_are_told_and_stiffened(tmp_path, capsys):
    (tmp_path / "sprung.py").write_text(SPRUNG.format(k=1e6, c=1e6))
    assert main(["stability", str(tmp_path / "sprung.py"), "--json", str(tmp_path / "out.json")]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "The motion is stiff: the fastest decay is 1.0e+06 1/s" in out and "stiffness x 10000" in out


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
def test_trials_that_take_too_long_or_break_down_are_ended(monkeypatch):
    monkeypatch.setattr(trials_module, "_SETUP", 1.0)

    def slow():
        time.sleep(60)

    def broken():
        faulthandler.disable()  # its report would stand among those of the tests
        os.abort()

    ladder = [(1e-4, mb.CVODES(rtol=1e-4)), (1e-6, mb.CVODES(rtol=1e-6))]
    makes = {"slow": slow, "broken": broken, "fine": explosion}
    jobs = [Job(name, make, "CVODES", ladder) for name, make in makes.items()]
    begin = time.monotonic()
    trials = {(t.scene, t.setting): t.reason for t in run_jobs(jobs, 0.5, begin + 30)}
    assert time.monotonic() - begin < 10
    assert trials["slow", 1e-4] == "took longer than 1.5 s with its set-up"
    assert trials["slow", 1e-6] == "a larger tolerance took too long"
    assert trials["broken", 1e-4] == "the process ended without a result"
    assert trials["fine", 1e-4].startswith("the run fails at t = ")
    late = {t.reason for t in run_jobs(jobs[:1], 0.5, begin)}
    assert late == {"left out for lack of time"}


def test_the_lightest_body_gets_lighter(found):
    scene = double_pendulum(np.linspace(0, 1.5, 31))
    assert {t.scene for t in found.stress} >= {"mass ratio x 100", "mass ratio x 10000", "horizon x 10"}
    first, second = (b.mass for b in lighter(scene, 100.0).system.bodies)
    masses = ca.Function("m", [scene.system.p], [first, second])([1.0, 0.8])
    before = ca.Function("m", [scene.system.p], [ca.SX(b.mass) for b in scene.system.bodies])([1.0, 0.8])
    ratios = sorted(float(a / b) for a, b in zip(before, masses, strict=True))
    np.testing.assert_allclose(ratios, [1.0, 100.0])


def shaken(law=None, speed=3.0):
    """A bead on a spring under gravity on a support that shakes, with a reaction."""
    p = mb.Parameters(k=40.0)
    bead, slider = mb.Body("bead", 2.0, pose=mb.Particle()), mb.Body("slider", 1.0, pose=mb.Particle())
    system = mb.System(
        bead, slider,
        mb.Motion("drive", slider.x, ca.sin(2 * mb.t) if law is None else law),
        mb.Spring("spring", slider.point(0, 0), bead.point(0, 0), p.k, 0.0),
        mb.Gravity(0, -9.81), parameters=p,
    )  # fmt: skip
    start = {"bead.x": 0.1, "bead.vx": speed, "slider.y": 0.0, "slider.vy": speed}
    return mb.Scene(system, start, 1 + np.linspace(0, 2, 21), {"s": slider.x, "x": bead.x, "y": bead.y, "h": slider.y})


def test_another_time_scale_is_that_of_laws_start_velocities_and_gravity():
    """x: a mass on a shaken spring, m x'' = k (s - x), whose spring does not slow down with the rest."""
    sympy = pytest.importorskip("sympy")
    for scene in (shaken(), shaken(sympy.sin(2 * sympy.Symbol("t")))):
        run = mb.simulate(slower(scene, 10.0), mb.DormandPrince(rtol=1e-11))
        t, w = run.t - 1, np.sqrt(40.0 / 2.0)
        np.testing.assert_allclose(run.t[[0, -1]], [1.0, 21.0])
        np.testing.assert_allclose(run["s"], np.sin(2 + 0.2 * t), atol=1e-9)
        driven = 20 / (20 - 0.04)  # of x = driven sin(2 + t/5) + free swinging
        free = 0.1 - driven * np.sin(2), (0.3 - driven * 0.2 * np.cos(2)) / w
        exact = driven * np.sin(2 + 0.2 * t) + free[0] * np.cos(w * t) + free[1] * np.sin(w * t)
        np.testing.assert_allclose(run["x"], exact, atol=1e-7)


def test_without_springs_another_time_scale_is_the_same_motion():
    scene = double_pendulum(np.linspace(0, 1.5, 31))
    plain, fast = (mb.simulate(s, mb.DormandPrince(rtol=1e-11)) for s in (scene, slower(scene, 0.1)))
    np.testing.assert_allclose(fast.t, plain.t / 10)
    np.testing.assert_allclose(fast.q, plain.q, atol=1e-8)
    np.testing.assert_allclose(fast.v, 10 * plain.v, atol=1e-7)


def test_a_time_scale_is_stressed_where_something_sets_it(found):
    assert {"time scale x 0.1", "time scale x 10"} <= {t.scene for t in found.stress}
    assert "time scale x 0.1" in str(found) and "time scale x 10" in json.dumps(found.to_json())
    bead = mb.Body("bead", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), bead.point(0, 0), 1.0, 0.0)
    free = mb.Scene(mb.System(bead, spring), {"bead.x": 1.0}, [0.0, 1.0])
    assert {name for name, _ in stresses(free)} == {
        "stiffness x 100", "stiffness x 10000", "horizon x 10", "horizon x 100"
    }  # fmt: skip


def test_a_scene_without_motion_is_refused():
    with pytest.raises(mb.SimulationError, match="has no motion over time, so solvers cannot be compared"):
        mb.stability(mb.Scene(mb.System(), outputs={"y": mb.t}, times=[0.0, 1.0]))
