"""What a scene can bear: trials, errors against equations by hand, advice, and references that are not fooled."""

import faulthandler
import json
import os
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np
import pytest
from black_boxes import reloaded
from faults import refused
from machines import spring_mass
from matplotlib.figure import Figure
from mechanisms import double_pendulum, double_pendulum_by_hand, explosion
from scipy.integrate import solve_ivp
from small_scenes import two_masses

import symmb as mb
from models import bicycle, car_axis, slider_crank_spatial, spherical_pendulum
from symmb.run.integrate import Stiffness
from symmb.show.cli.main import main
from symmb.study import trials as trials_module
from symmb.study.advice import advice
from symmb.study.ladders import finer_steps, ladders, start_rate, under_stress
from symmb.study.standard import standard_of
from symmb.study.stress import lighter, slower, stiffer, stresses
from symmb.study.trials import Job, Trial, processor_time, run_jobs

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
    require_saved_and_drawn(found, tmp_path)
    told = json.loads((tmp_path / "found.json").read_text())
    assert told["advice"] == found.advice and len(told["trials"]) == len(found.trials) + len(found.stress)


def require_saved_and_drawn(found, folder):
    for name in ("found.json", "found.npz"):
        assert str(reloaded(found, folder / name)) == str(found)
    found.plot(folder / "found.png")
    assert (folder / "found.png").stat().st_size > 10_000


@pytest.mark.long
def test_stiff_scenes_are_told_and_stiffened(tmp_path, capsys):
    (tmp_path / "sprung.py").write_text(SPRUNG.format(k=1e6, c=1e6))
    assert main(["stability", str(tmp_path / "sprung.py"), "--json", str(tmp_path / "out.json")]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "The motion is stiff: the fastest decay is 1.0e+06 1/s" in out and "stiffness x 10000" in out


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
def test_trials_that_take_too_long_or_break_down_are_ended(monkeypatch):
    monkeypatch.setattr(trials_module, "_SETUP", 1.0)

    def broken():
        faulthandler.disable()  # its report would stand among those of the tests
        os.abort()

    ladder = [(1e-4, mb.CVODES(rtol=1e-4)), (1e-6, mb.CVODES(rtol=1e-6))]
    makes = {"horizon x 10": endless, "horizon x 100": explosion, "broken": broken, "fine": explosion}
    jobs = [Job(name, make, "CVODES", ladder) for name, make in makes.items()]
    begin = processor_time()
    trials = {(t.scene, t.setting): t.reason for t in run_jobs(jobs, 0.5, begin + 30)}
    assert processor_time() - begin < 10
    assert trials["horizon x 10", 1e-4] == "took more than 0.5 s of processor time"
    assert trials["horizon x 10", 1e-6] == "a larger tolerance took too long"
    assert trials["horizon x 100", 1e-4] == trials["horizon x 100", 1e-6] == "an easier variant took too long"
    assert trials["broken", 1e-4] == "the process ended without a result"
    assert trials["fine", 1e-4].startswith("the run fails at t = ")
    assert {t.reason for t in run_jobs(jobs[-1:], 0.5, begin)} == {"left out for lack of time"}


def endless():
    while True:
        pass


def test_the_lightest_body_gets_lighter(found):
    scene = double_pendulum(np.linspace(0, 1.5, 31))
    assert {t.scene for t in found.stress} >= {"mass ratio x 100", "mass ratio x 10000", "horizon x 10"}
    before, masses = (
        ca.Function("m", [scene.system.p], [ca.SX(b.mass) for b in own.system.bodies])([1.0, 0.8])
        for own in (scene, lighter(scene, 100.0))
    )
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
    scene = double_pendulum(np.linspace(0, 1.5, 31))  # without springs it is the same motion
    plain, fast = (mb.simulate(s, mb.DormandPrince(rtol=1e-11)) for s in (scene, slower(scene, 0.1)))
    np.testing.assert_allclose(fast.t, plain.t / 10)
    np.testing.assert_allclose(fast.q, plain.q, atol=1e-8)
    np.testing.assert_allclose(fast.v, 10 * plain.v, atol=1e-7)


def test_a_time_scale_is_stressed_where_something_sets_it(found):
    assert {"time scale x 0.1", "time scale x 10"} <= {t.scene for t in found.stress}
    assert "time scale x 0.1" in str(found) and "time scale x 10" in json.dumps(found.to_json())
    names = {name for name, _ in stresses(sprung(1.0, times=[0.0, 1.0]))}
    assert names == {"stiffness x 100", "stiffness x 10000", "horizon x 10", "horizon x 100"}


def test_a_scene_without_motion_is_refused():
    scene = mb.Scene(mb.System(), outputs={"y": mb.t}, times=[0.0, 1.0])
    refused("has no motion over time, so solvers cannot be compared", mb.stability, scene, error=mb.SimulationError)


# References, failures and advice

T = np.linspace(0.0, 2.0, 51)
SLOW_MOTION = Stiffness(0.0, 0.0, 1.0)


def sprung(k, damping=0.0, times=T, length=0.0, *more):
    """A ball of 1 kg on a spring, released at 1 m: x = cos(sqrt(k) t) without damping, length and other elements."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(0, 0), ball.point(0, 0), k, damping, length)
    outputs = {"x": ball.x, "vx": ball.vx}
    return mb.Scene(mb.System(ball, spring, *more), {"ball.x": 1.0}, times, outputs, name="sprung")


def runs(scene, *solvers, name="", family="CVODES"):
    return list(Job(name, lambda: scene, family, [(10.0**-i, s) for i, s in enumerate(solvers)]).run())


def trial(solver, y, setting=1e-6, family=None, energy=1e-9, reason="", scene=""):
    values = np.array(y, dtype=float)[:, None]
    return Trial(scene, solver, family or solver, setting, reason, 1e-3, T, T, energy, T, values)


def told(trials, stress=()):
    standards = {name: standard_of([t for t in (*trials, *stress) if t.scene == name], ("m",)) for name in ("", "hard")}
    return advice(trials, stress, standards, {}, SLOW_MOTION, 2.0, ())


def test_a_single_run_that_finishes_is_no_reference():
    """A spring pendulum, released level. The Rosenbrock run alone finishes; its energy is off by factors."""
    scene = stiffer(sprung(1e8, 0.0, np.linspace(0, 10, 51), 1.0, mb.Gravity(0, -9.81)), 1e4)
    stress = runs(scene, mb.Rosenbrock(step=0.0125), name="hard", family="Rosenbrock")
    stress += runs(scene, mb.CVODES(rtol=1e-10), name="hard")
    standard = standard_of(stress, ("m", "m/s"))
    assert standard.fault.startswith("no solver finishes at two tolerances") and np.isnan(standard.uncertainty)
    assert all(standard.error(t) is None for t in stress)
    text = told([trial("DormandPrince", np.cos(T), r) for r in (1e-8, 1e-6)], stress)
    assert "hard  no setting is known to be good: no solver finishes at two tolerances" in text
    assert "too slow: CVODES" in text and "Rosenbrock(" not in text


def test_finished_runs_whose_energy_is_lost_are_failures():
    scene = sprung(1e6, times=np.linspace(0, 2, 11))
    lost, broken, damped = runs(scene, mb.RungeKutta(steps=10), mb.RungeKutta(steps=30), mb.NSTIFFSI2(step=0.1))
    assert np.isfinite(lost.values).all() and lost.reason.startswith("the energy is off by ")
    assert np.isfinite(broken.values).all() and broken.reason == "the energy is not finite"
    assert damped.reason == "the energy is off by 1 of the largest kinetic energy"
    (good,) = runs(sprung(1e6), mb.RungeKutta(steps=40_000))
    assert not good.reason and good.energy < 1e-4
    np.testing.assert_allclose(good.values[:, 0], np.cos(1e3 * T), atol=1e-4)


def burst(t, exp=np.exp):
    return 1.0 + 1e10 * exp(-(((t - 0.5) / 2e-3) ** 2))


@pytest.mark.parametrize("solver", [mb.CVODES(rtol=1e-9), mb.StabilizedIndex2(rtol=1e-7)], ids=repr)
def test_a_run_of_many_steps_between_two_output_times_is_no_breakdown(solver):
    scene = sprung(burst(mb.t, ca.exp), times=np.linspace(0, 1, 1001))
    (found,) = runs(scene, solver)
    options = {"t_eval": scene.times, "rtol": 1e-12, "max_step": 1e-3}
    exact = solve_ivp(lambda t, z: [z[1], -burst(t) * z[0]], (0, 1), [1.0, 0.0], "DOP853", **options).y[0]
    assert not found.reason
    np.testing.assert_allclose(found.values[:, 0], exact, atol=1e-4 * np.abs(exact).max())


def test_why_nothing_finishes_is_told():
    """A ball flies off as exp(1000 t), another swings too often, and a scene does not start."""
    (slow,) = runs(sprung(1e12, times=[0.0, 10.0]), mb.DormandPrince(), family="DormandPrince")
    assert slow.slow and slow.reason.startswith("has taken too many steps at t = ")
    (singular,) = runs(sprung(-1e6), mb.CVODES())
    assert singular.reason and not singular.slow
    fault = standard_of([singular, slow], ("m", "m/s")).fault
    assert fault.startswith("no solver finishes at two tolerances (too slow: DormandPrince; breaks down at t = 0.")

    def unable():
        raise mb.AssemblyError("No static equilibrium was found near the guess.\nMore.")

    trials = [*Job("hard", unable, "CVODES", [(1e-6, mb.CVODES()), (1e-8, mb.CVODES())]).run()]
    assert standard_of(trials, ("m",)).fault == "No static equilibrium was found near the guess."


def test_two_tolerances_have_to_agree():
    chaotic = np.where(T > 1.0, 0.1 * (T - 1.0), 0.0)
    apart = [trial("CVODES(rtol=1e-06)", np.cos(T), 1e-6, "CVODES")]
    apart += [trial("CVODES(rtol=1e-08)", np.cos(T) + chaotic, 1e-8, "CVODES")]
    fault = standard_of(apart, ("m",)).fault
    assert "CVODES(rtol=1e-06) and CVODES(rtol=1e-08), which agree best, differ from t = 1.04 s on" in fault
    no_reference = "No setting is known to be good, because there is no reference: CVODES(rtol=1e-06) and"
    assert told(apart).startswith(no_reference)


def test_solvers_that_agree_with_themselves_have_to_agree_with_each_other():
    one = [trial("CVODES", np.cos(T), r) for r in (1e-6, 1e-8)]
    other = [trial("DormandPrince", np.cos(T) + 0.01, r) for r in (1e-6, 1e-8)]
    fault = standard_of([*one, *other], ("m",)).fault
    assert fault == f"CVODES and DormandPrince differ by {0.01 / np.cos(T).std():.1g} of the motion"
    standard = standard_of([*one, *other[:1]], ("m",))  # one run confirms nothing
    assert not standard.fault and standard.error(other[0]) == pytest.approx(0.01 / np.cos(T).std())


def test_fixed_steps_and_lost_energy_are_no_reference_and_not_advised():
    """Damped too much by both steps, two runs agree."""
    runs = [trial(f"NSTIFFSI2(step={h:g})", np.cos(T), h, "NSTIFFSI2") for h in (0.1, 0.01)]
    assert standard_of(runs, ("m",)).fault.startswith("no solver finishes at two tolerances")
    same = [trial("CVODES", np.cos(T), r, energy=2e-3) for r in (1e-6, 1e-8)]
    assert standard_of(same, ("m",)).fault == "the energy of CVODES is off by 0.002 of the largest kinetic energy"
    fine = [trial("DormandPrince", np.cos(T), r) for r in (1e-8, 1e-6)]
    leaky = trial("NSTIFFSI2(step=0.01)", np.cos(T), 0.01, "NSTIFFSI2", energy=2e-3)
    assert "NSTIFFSI2(" not in told([*fine, leaky]) and "NSTIFFSI2 0.01" not in told([*fine, leaky])


def filtering(energy, apart):
    """Runs of two solvers with fixed steps, whose finer steps differ."""
    values = {"GeneralizedAlpha": (0.1, 1.0), "NSTIFFSI2": (0.9, 1.0 + 1e4 * apart)}
    return [
        trial(f"{family}(step={h:g})", np.cos(T) * (1 + 1e-4 * off), h, family, energy)
        for family, offs in values.items()
        for h, off in zip((0.01, 0.0025), offs, strict=True)
    ]


def test_two_solvers_that_damp_oscillations_confirm_a_solution_without_them():
    tight = trial("CVODES", np.cos(T), 1e-6, reason="took more than 1.5 s of processor time")
    runs = [tight, *filtering(energy=4e-6, apart=1e-4)]
    standard = standard_of(runs, ("m",))
    assert not standard.fault and standard.damped == pytest.approx(2e-3) and standard.uncertainty < 2e-4
    text = told(runs, [replace(t, scene="hard") for t in runs])
    assert text.count("fast oscillations with up to 0.002 of the largest velocity are left out") == 2
    for lacking in (filtering(1e-2, 1e-4), filtering(4e-6, 1e-2), runs[1:3]):
        assert standard_of([tight, *lacking], ("m",)).fault.startswith("no solver finishes at two tolerances")
    resolved = standard_of([*runs, *(trial("DormandPrince", np.cos(T), r) for r in (1e-8, 1e-6))], ("m",))
    assert np.isnan(resolved.damped)


def test_an_output_that_is_rounding_does_not_hide_agreement():
    noise = np.random.default_rng(0).normal(size=(2, len(T))) * 1e-17
    values = [np.stack([np.cos(T), z], axis=1) for z in noise]
    trials = [
        Trial("", *["CVODES"] * 2, r, times=T, values=v, energy=0.0) for r, v in ((1e-6, values[0]), (1e-8, values[1]))
    ]
    assert standard_of(trials, ("m", "m")).uncertainty < 1e-12
    assert standard_of(trials, ("m", "N")).fault  # nothing tells how large a force is that does not count


@pytest.mark.parametrize("k", [1e4, 1e7])
def test_fixed_steps_follow_the_fastest_motion(k):
    """Fast decay as well: x'' = -2e3 x' - 1e3 x has rates of about 2e3 and 0.5 1/s."""
    assert start_rate(sprung(1e3, 2e3)) == pytest.approx(1e3 + np.sqrt(1e6 - 1e3))
    scene, w = sprung(k), np.sqrt(k)
    assert start_rate(scene) == pytest.approx(w)
    assert start_rate(stiffer(scene, 100.0)) == pytest.approx(10 * w)
    assert start_rate(slower(scene, 10.0)) == pytest.approx(w)
    assert finer_steps(scene, 0.1)[0][0] == pytest.approx(2 / w, rel=0.01)
    step, solver = ladders(2.0, w)["RungeKutta"][-1]
    assert step < 0.126 / w
    (run,) = runs(scene, solver)
    np.testing.assert_allclose(run.values[:, 0], np.cos(w * T), atol=2 * w * (step * w) ** 4 / 100)


@pytest.mark.parametrize("k", [1e2, pytest.param(1e6, marks=pytest.mark.long)])
def test_what_is_advised_under_stress_follows_the_closed_form(k):
    """The motion is cos(w t), with w ten times as large under this stress."""
    step = 2.0 / 800
    jobs = [
        Job("hard", partial(stiffer, sprung(k), 100.0), family, ladder, partial(finer_steps, longest=step / 64))
        for family, ladder in under_stress(step).items()
        if family in ("DormandPrince", "NSTIFFSI2", "Rosenbrock")
    ]
    trials = [own for job in jobs for own in job.begin().run()]
    w, fine = 10 * np.sqrt(k), [trial("DormandPrince", np.cos(T), r) for r in (1e-8, 1e-6)]
    exact = np.stack([np.cos(w * T), -w * np.sin(w * T)], axis=1)
    standards = {"": standard_of(fine, ("m",)), "hard": standard_of(trials, ("m", "m/s"))}
    lines = advice(fine, trials, standards, {}, SLOW_MOTION, 2.0, ()).splitlines()
    (text,) = (line for line in lines if line.startswith("  hard  "))
    assert standards["hard"].uncertainty < 1e-4
    finished = {t.solver: t for t in trials if not t.reason}
    rms = {solver: np.sqrt(np.mean((t.values - exact) ** 2, axis=0)) for solver, t in finished.items()}
    errors = {solver: (error / exact.std(axis=0)).max() for solver, error in rms.items()}
    assert errors[text.split("hard  ")[1].split(" (")[0]] <= 1e-3
    found = {solver: standards["hard"].error(t) for solver, t in finished.items()}
    assert found == pytest.approx(errors, rel=0.01, abs=2e-4)


def test_harder_variants_keep_outputs_of_multipliers_and_leave_the_scene_itself_whole():
    """The pull of the rod of a pendulum on a time scale ten times as long is a hundredth."""
    scene = spherical_pendulum.scene().with_times(np.linspace(0, 1, 11))
    plain, slow = (mb.simulate(s, mb.DormandPrince(rtol=1e-11))["pull"] for s in (scene, slower(scene, 10.0)))
    np.testing.assert_allclose(slow, plain / 100, rtol=1e-7)
    assert dict(stresses(car_axis.scene()))["stiffness x 10000"]().output_names[-1] == "lam2"
    scene = slider_crank_spatial.scene().with_times([0.0, 0.01])  # copies of its joints, and their angles, come and go
    before = mb.simulate(scene).values
    for _ in range(2):
        lighter(scene, 100.0)
    np.testing.assert_array_equal(mb.simulate(scene.with_times(scene.times)).values, before)


def test_a_study_without_a_reference_is_told_saved_and_drawn(tmp_path):
    apart = [trial("CVODES(rtol=1e-06)", np.cos(T), 1e-6, "CVODES"), trial("CVODES", np.sin(T), 1e-8)]
    found = mb.Stability("lost", T, tuple(apart), (), {}, float("nan"), {}, told(apart))
    text = str(found)
    assert "lost: 2 runs from 0 to 2 s, errors are not known" in text and "there is no reference" in text
    assert [line.split()[2] for line in text.splitlines()[2:4]] == ["–", "–"]
    require_saved_and_drawn(found, tmp_path)


# Root loci against closed forms and published eigenvalues.


def oscillators() -> mb.Scene:
    """Two masses of 1 kg on springs and dampers that do not act on each other."""
    law = lambda p, a, b: ((-p.k1 * a.x - p.c1 * a.vx, 0, 0), (-p.k2 * b.x - p.c2 * b.vx, 0, 0))  # noqa: E731
    return two_masses(law, box=mb.Box(k1=(90.0, 110.0)), k1=100.0, c1=0.0, k2=104.0, c2=0.5)


def test_frequencies_cross_over_the_parameter():
    locus = mb.root_locus(oscillators(), "k2", (50.0, 150.0), mb.Vertex(), count=11)
    k2 = np.linspace(50.0, 150.0, 11)
    np.testing.assert_allclose(locus.values, k2)
    np.testing.assert_allclose(2 * np.pi * locus.frequencies, np.sqrt(np.stack([k2, 100 + 0 * k2], 1)), rtol=1e-12)
    np.testing.assert_allclose(locus.damping, np.stack([0.25 / np.sqrt(k2), 0 * k2], 1), atol=1e-14)
    assert len(locus.remarks) == 1 and locus.remarks[0].startswith("f1 and f2 cross between k2 = ")
    lower, upper = (2 * np.pi * end for end in locus.bands["f"])
    np.testing.assert_allclose(lower, np.sqrt(np.stack([k2, 90 + 0 * k2], 1)), rtol=1e-12)
    np.testing.assert_allclose(upper, np.sqrt(np.stack([k2, 110 + 0 * k2], 1)), rtol=1e-12)
    assert locus.evaluations == 2 and "bands over Box(k1=(90, 110)) by Vertex()" in str(locus)


def test_an_oscillation_that_ends_and_one_that_begins():
    """c1 passes the critical damping 2 sqrt(k1), from 19 on somewhere in the box; c1 < 0 is unstable."""
    locus = mb.root_locus(oscillators(), "c1", (-24.0, 24.0), mb.Vertex(), count=25)
    c1 = np.linspace(-24.0, 24.0, 25)
    (late,) = [k for k in range(locus.modes.shape[1]) if np.isnan(locus.modes[0, k])]
    np.testing.assert_array_equal(np.isnan(locus.modes[:, late]), np.abs(c1) >= 20)
    inside = np.abs(c1) < 20
    np.testing.assert_allclose(locus.damping[inside, late], c1[inside] / 20, atol=1e-12)
    least, most = (end[:, late] for end in locus.bands["zeta"])
    known = np.abs(c1) < 2 * np.sqrt(90)
    np.testing.assert_array_equal(~np.isnan(least), known)
    ends = np.sort(c1[known, None] / (2 * np.sqrt([90, 110])), axis=1)
    np.testing.assert_allclose(np.stack([least, most], 1)[known], ends, atol=1e-12)


def test_eigenvalues_of_the_bicycle():
    """Meijaard et al. (2007), table 2: eigenvalues at 0 and 5 m/s; weave begins at 0.684 m/s."""
    locus = mb.root_locus(bicycle.scene(), "v", (0.0, 10.0), box=mb.Box(v=(0.0, 10.0)), count=21)
    assert not locus.bands and locus.box is None  # the box names the parameter alone
    at_rest = locus.eigenvalues[0][locus.eigenvalues[0] != 0]
    np.testing.assert_allclose(np.sort(at_rest.real)[:2], [-5.53094371765393, -3.13164324790656], rtol=1e-9)
    assert np.isnan(locus.modes[:2]).all() and not np.isnan(locus.modes[2:]).any()
    assert locus.modes[10, 0] == pytest.approx(-0.77534188219585 + 4.46486771378823j, rel=1e-9)


def test_pictures_and_files(tmp_path):
    locus = mb.root_locus(oscillators(), "c1", (-24.0, 24.0), mb.Vertex(), count=9)
    assert isinstance(locus.plot(tmp_path / "locus.png"), Figure) and "<table" in locus._repr_html_()
    assert (tmp_path / "locus.png").read_bytes().startswith(b"\x89PNG")
    axes = Figure().subplots(1, 2)
    assert locus.plot(ax=list(axes)) is axes[0].figure and axes[1].get_ylabel() == "frequency [Hz]"
    refused("there are three diagrams, got 4 axes", locus.plot, ax=list(Figure().subplots(1, 4)))
    reloaded(locus, tmp_path / "locus.json").plot()
    refused(r"does not hold a result of Linearization.save", mb.Linearization.load, tmp_path / "locus.json")


def test_faults():
    scene = oscillators()
    refused(r"root_locus: no parameter 'k3'", mb.root_locus, scene, "k3", (0, 1))
    refused("range must be two numbers", mb.root_locus, scene, "k1", (0, float("nan")))
    refused("lower end of the range must be below", mb.root_locus, scene, "k1", (2, 1))
    for study in (mb.root_locus, mb.critical):
        refused("wider than the largest number", study, scene, "c1", (-1.7e308, 1.7e308))
    refused("count must be an integer of at least 2", mb.root_locus, scene, "k1", (1, 2), count=1)
    refused("Expected a Scene, got System", mb.root_locus, scene.system, "k1", (1, 2))
    refused("the box has 'q', which is not a parameter", mb.root_locus, scene, "k1", (1, 2), box=mb.Box(q=(1, 2)))
    refused("root_locus: box: expected a Box", mb.root_locus, scene, "k1", (1, 2), box={"k2": (1, 2)})


def test_scenes_without_oscillations():
    p = mb.Parameters(rate=2.0)
    decay = mb.Scene(mb.System(mb.State("z", rate=lambda z: -p.rate * z), parameters=p), box=mb.Box(rate=(1.0, 3.0)))
    locus = mb.root_locus(decay, "rate", (1.0, 3.0), count=3)
    np.testing.assert_allclose(locus.eigenvalues, [[-1], [-2], [-3]])
    assert str(locus) == "scene: 0 oscillations over 3 values, rate = 1 to 3"
    assert isinstance(locus.plot(), Figure)
    refused("scene has no oscillation", mb.ModalSimulator, decay)


@pytest.mark.parametrize(
    ("name", "given", "why"),
    [
        ("mass", (-1.0, 1.0), "mass is -1, not positive at mass = -1"),
        ("stiffness", (1.0, 1e307), r"matrix A are infinite or undefined at stiffness = 1e\+307"),
    ],
)
def test_scenes_that_do_not_start_and_matrices_beyond_the_largest_number_are_refused(name, given, why):
    scene = mb.Scene(spring_mass(mass=1e-3).system)
    refused(why, mb.root_locus, scene, name, given, count=2, error=mb.SimulationError)


@pytest.mark.parametrize("end", [5e-324, 1e-320, 1e-300, 1e-200, 1e-100, 1e100, 1e200, 1e300])
def test_stiffnesses_and_dampings_of_any_size(end):
    """A stiffness without normal digits counts as zero, so that the mass moves freely."""
    locus = mb.root_locus(oscillators(), "k1", (0.0, end), count=2)
    own = np.abs(locus.eigenvalues[-1].imag).min() if end < 1 else np.abs(locus.eigenvalues[-1].imag).max()
    assert own == pytest.approx(np.sqrt(end) if end > 1e-307 else 0.0, rel=1e-9)
    locus = mb.root_locus(oscillators(), "c1", (0.0, 1.7e308), count=3)
    np.testing.assert_allclose(locus.eigenvalues[1:, -1].real, [-0.85e308, -1.7e308], rtol=1e-9)
