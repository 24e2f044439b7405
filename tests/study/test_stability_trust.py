"""A stability study is not fooled: what counts as a reference, as a failure and as a good setting."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import symmb as mb
from models import car_axis, slider_crank_spatial, spherical_pendulum
from symmb.run.integrate import Stiffness
from symmb.study.advice import advice
from symmb.study.ladders import finer_steps, ladders, start_rate, under_stress
from symmb.study.standard import standard_of
from symmb.study.stress import lighter, slower, stiffer, stresses
from symmb.study.trials import Job, Trial

T = np.linspace(0.0, 2.0, 51)
SLOW_MOTION = Stiffness(0.0, 0.0, 1.0)


def sprung(k, damping=0.0, times=T):
    """A ball of 1 kg on a spring without length, released at 1 m: x = cos(sqrt(k) t) without damping."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(0, 0), ball.point(0, 0), k, damping, 0.0)
    return mb.Scene(mb.System(ball, spring), {"ball.x": 1.0}, times, {"x": ball.x, "vx": ball.vx}, name="sprung")


def spring_pendulum(k):
    """A ball of 1 kg on a spring of 1 m, released level."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), ball.point(0, 0), k, 1.0)
    system = mb.System(ball, spring, mb.Motion("plane", ball.z, 0), mb.Gravity(0, -9.81))
    return mb.Scene(system, {"ball.x": 1.0, "ball.y": 0.0}, np.linspace(0, 10, 51), {"x": ball.x, "y": ball.y})


def runs(scene, *solvers, name="", family="CVODES"):
    return list(Job(name, lambda: scene, family, [(10.0**-i, s) for i, s in enumerate(solvers)]).run())


def trial(solver, y, setting=1e-6, family=None, energy=1e-9, reason="", scene=""):
    values = np.array(y, dtype=float)[:, None]
    return Trial(scene, solver, family or solver, setting, reason, 1e-3, T, T, energy, T, values)


def told(trials, stress=()):
    standards = {name: standard_of([t for t in (*trials, *stress) if t.scene == name], ("m",)) for name in ("", "hard")}
    return advice(trials, stress, standards, {}, SLOW_MOTION, 2.0, ())


def test_a_single_run_that_finishes_is_no_reference():
    """Of these, the Rosenbrock run alone finishes; its energy is off by factors."""
    scene = stiffer(spring_pendulum(1e8), 1e4)
    stress = runs(scene, mb.Rosenbrock(step=0.0125), name="hard", family="Rosenbrock")
    stress += runs(scene, mb.CVODES(rtol=1e-10), name="hard")
    standard = standard_of(stress, ("m", "m"))
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


def burst(t):
    return 1.0 + 1e10 * np.exp(-(((t - 0.5) / 2e-3) ** 2))


@pytest.mark.parametrize("solver", [mb.CVODES(rtol=1e-9), mb.StabilizedIndex2(rtol=1e-7)], ids=repr)
def test_a_run_of_many_steps_between_two_output_times_is_no_breakdown(solver):
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    stiffness = 1.0 + 1e10 * ca.exp(-(((mb.t - 0.5) / 2e-3) ** 2))
    spring = mb.Spring("spring", mb.Ground().point(0, 0), ball.point(0, 0), stiffness, 0.0)
    scene = mb.Scene(mb.System(ball, spring), {"ball.x": 1.0}, np.linspace(0, 1, 1001), {"x": ball.x})
    (found,) = runs(scene, solver)
    options = {"t_eval": scene.times, "rtol": 1e-12, "max_step": 1e-3}
    exact = solve_ivp(lambda t, z: [z[1], -burst(t) * z[0]], (0, 1), [1.0, 0.0], "DOP853", **options).y[0]
    assert not found.reason
    np.testing.assert_allclose(found.values[:, 0], exact, atol=1e-4 * np.abs(exact).max())


def test_a_run_without_time_is_slow_and_a_run_that_breaks_down_is_not():
    (slow,) = runs(sprung(1e12, times=[0.0, 10.0]), mb.DormandPrince())
    assert slow.slow and slow.reason.startswith("has taken too many steps at t = ")
    (singular,) = runs(sprung(-1e6), mb.CVODES())
    assert singular.reason and not singular.slow


def test_why_nothing_finishes_is_told():
    """A ball flies off as exp(1000 t), another swings too often, and a scene does not start."""
    second = runs(sprung(1e12, times=[0.0, 10.0]), mb.DormandPrince(), family="DormandPrince")
    done = [*runs(sprung(-1e6), mb.CVODES()), *second]
    fault = standard_of(done, ("m", "m/s")).fault
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
    assert told(apart).startswith(
        "No setting is known to be good, because there is no reference: CVODES(rtol=1e-06) and"
    )


def test_the_energy_of_a_reference_has_to_hold():
    same = [trial("CVODES", np.cos(T), r, energy=2e-3) for r in (1e-6, 1e-8)]
    assert standard_of(same, ("m",)).fault == "the energy of CVODES is off by 0.002 of the largest kinetic energy"


def test_solvers_that_agree_with_themselves_have_to_agree_with_each_other():
    one = [trial("CVODES", np.cos(T), r) for r in (1e-6, 1e-8)]
    other = [trial("DormandPrince", np.cos(T) + 0.01, r) for r in (1e-6, 1e-8)]
    fault = standard_of([*one, *other], ("m",)).fault
    assert fault == f"CVODES and DormandPrince differ by {0.01 / np.cos(T).std():.1g} of the motion"
    standard = standard_of([*one, *other[:1]], ("m",))  # one run confirms nothing
    assert not standard.fault and standard.error(other[0]) == pytest.approx(0.01 / np.cos(T).std())


def test_fixed_steps_are_no_reference():
    """Damped too much by both steps, two runs agree."""
    runs = [trial(f"NSTIFFSI2(step={h:g})", np.cos(T), h, "NSTIFFSI2") for h in (0.1, 0.01)]
    assert standard_of(runs, ("m",)).fault.startswith("no solver finishes at two tolerances")


def test_settings_that_lose_energy_are_not_advised():
    fine = [trial("DormandPrince", np.cos(T), r) for r in (1e-8, 1e-6)]
    leaky = trial("NSTIFFSI2(step=0.01)", np.cos(T), 0.01, "NSTIFFSI2", energy=2e-3)
    assert "NSTIFFSI2(" not in told([*fine, leaky]) and "NSTIFFSI2 0.01" not in told([*fine, leaky])


def test_an_output_that_is_rounding_does_not_hide_agreement():
    noise = np.random.default_rng(0).normal(size=(2, len(T))) * 1e-17
    trials = [
        Trial("", "CVODES", "CVODES", setting, times=T, values=np.stack([np.cos(T), z], axis=1), energy=0.0)
        for setting, z in zip((1e-6, 1e-8), noise, strict=True)
    ]
    assert standard_of(trials, ("m", "m")).uncertainty < 1e-12
    assert standard_of(trials, ("m", "N")).fault  # nothing tells how large a force is that does not count


@pytest.mark.parametrize("k", [1e4, 1e7])
def test_fixed_steps_follow_the_fastest_motion(k):
    scene, w = sprung(k), np.sqrt(k)
    assert start_rate(scene) == pytest.approx(w)
    assert start_rate(stiffer(scene, 100.0)) == pytest.approx(10 * w)
    assert start_rate(slower(scene, 10.0)) == pytest.approx(w)
    assert finer_steps(scene, 0.1)[0][0] == pytest.approx(2 / w, rel=0.01)
    step, solver = ladders(2.0, w)["RungeKutta"][-1]
    assert step < 0.126 / w
    (run,) = runs(scene, solver)
    np.testing.assert_allclose(run.values[:, 0], np.cos(w * T), atol=2 * w * (step * w) ** 4 / 100)


def test_fast_decay_is_followed_as_well():
    """x'' = -2e3 x' - 1e3 x has rates of about 2e3 and 0.5 1/s."""
    assert start_rate(sprung(1e3, 2e3)) == pytest.approx(1e3 + np.sqrt(1e6 - 1e3))


@pytest.mark.parametrize("k", [1e2, pytest.param(1e6, marks=pytest.mark.long)])
def test_what_is_advised_under_stress_follows_the_closed_form(k):
    """The motion is cos(w t), with w ten times as large under this stress."""
    step = 2.0 / 800
    jobs = [
        Job("hard", partial(stiffer, sprung(k), 100.0), family, ladder, partial(finer_steps, longest=step))
        for family, ladder in under_stress(step).items()
        if family in ("DormandPrince", "NSTIFFSI2", "Rosenbrock")
    ]
    trials = [trial for job in jobs for trial in job.begin().run()]
    w, fine = 10 * np.sqrt(k), [trial("DormandPrince", np.cos(T), r) for r in (1e-8, 1e-6)]
    exact = np.stack([np.cos(w * T), -w * np.sin(w * T)], axis=1)
    standards = {"": standard_of(fine, ("m",)), "hard": standard_of(trials, ("m", "m/s"))}
    lines = advice(fine, trials, standards, {}, SLOW_MOTION, 2.0, ()).splitlines()
    (text,) = (line for line in lines if line.startswith("  hard  "))
    assert standards["hard"].uncertainty < 1e-4
    finished = [t for t in trials if not t.reason]
    rms = {t.solver: np.sqrt(np.mean((t.values - exact) ** 2, axis=0)) for t in finished}
    errors = {solver: (error / exact.std(axis=0)).max() for solver, error in rms.items()}
    assert errors[text.split("hard  ")[1].split(" (")[0]] <= 1e-3
    for t in finished:
        assert standards["hard"].error(t) == pytest.approx(errors[t.solver], rel=0.01, abs=2e-4)


def test_harder_variants_keep_outputs_of_multipliers():
    """The pull of the rod of a pendulum on a time scale ten times as long is a hundredth."""
    scene = spherical_pendulum.scene().with_times(np.linspace(0, 1, 11))
    plain, slow = (mb.simulate(s, mb.DormandPrince(rtol=1e-11))["pull"] for s in (scene, slower(scene, 10.0)))
    np.testing.assert_allclose(slow, plain / 100, rtol=1e-7)
    assert dict(stresses(car_axis.scene()))["stiffness x 10000"]().output_names[-1] == "lam2"


def test_variants_leave_the_scene_itself_whole():
    """Copies of its joints, and their angles, come and go."""
    scene = slider_crank_spatial.scene().with_times([0.0, 0.01])
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
    for name in ("lost.json", "lost.npz"):
        found.save(tmp_path / name)
        assert str(mb.Stability.load(tmp_path / name)) == text
    found.plot(tmp_path / "lost.png")
    assert (tmp_path / "lost.png").stat().st_size > 10_000
