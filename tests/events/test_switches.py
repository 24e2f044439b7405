"""Kinks, jumps and pulses: runs against closed forms, and what is told of them."""

import warnings

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import ball
from small_scenes import particle

import symmb as mb
from symmb.run.events.switches import longest_step

TIMES = np.linspace(0, 10, 21)


def driven(law, times=TIMES):
    """A bead on a spring of 1 rad/s, from rest, with a force along x."""
    return particle(lambda p, mass: law - mass.x, times, {}, ("x", "vx"))


FIXED = mb.RungeKutta(steps=1000), mb.GeneralizedAlpha(0.01), mb.HHT(0.01), mb.NSTIFFSI2(0.01)


@pytest.mark.parametrize("solver", FIXED, ids=repr)
@pytest.mark.parametrize("width", [0.3, 1.0, 0.005])
def test_fixed_steps_are_doubted_where_they_are_longer_than_a_pulse(solver, width):
    scene = driven(1 / (1 + ((mb.t - 5.0123) / width) ** 2), np.array([0.0, 10.0]))
    assert longest_step(mb.compile_dae(scene.system), scene.times) < (0.01 if width < 0.01 else np.inf)
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        doubts = mb.simulate(scene, solver).doubts
    assert ("Steps of 0.01 s may miss a pulse" in "".join(doubts)) == (width < 0.01)


def test_pulses_that_are_no_fronts_limit_the_steps():
    # The square of the curve of Agnesi has a known integral.
    run = mb.simulate(driven(2 / np.pi / (0.01 * (1 + ((mb.t - 5) / 0.01) ** 2) ** 2)), mb.StateSpace())
    np.testing.assert_allclose(run["x"][15:], np.sin(TIMES[15:] - 5), atol=1e-4)
    assert "pulses      in functions of time: steps are at most 0.0" in str(run)


@pytest.mark.parametrize(
    ("law", "shortest"),
    [
        (1 / (1 + ((mb.t - 5) / 0.1) ** 4), 2 * 0.1 * 3**0.25),  # between the quarters of its height
        (ca.exp(-(((mb.t - 5) / 0.1) ** 2)), np.inf),  # steps end at its largest value
        (ca.if_else(ca.logic_and(mb.t > 2, mb.t < 2.5), 3, 7), np.inf),  # steps end at its switches
        (ca.sin(2 * np.pi * mb.t), 0.5 - 2 * np.arcsin(0.25) / (2 * np.pi)),
        (ca.exp(-mb.t / 1e-3), np.inf),  # under way at the start
        (ca.tanh((mb.t - 5) / 1e-3), np.inf),  # a step is met by whatever comes after it
        (ca.sin(mb.t) ** 2 + ca.cos(mb.t) ** 2, np.inf),  # rounding
    ],
    ids=("bell", "front", "gap", "sine", "decay", "step", "constant"),
)
def test_pulses_are_as_short_as_they_are(law, shortest):
    assert longest_step(mb.compile_dae(driven(law).system), TIMES) == pytest.approx(shortest / 2, rel=0.01)


def test_kinks_are_told_where_symmb_chooses():
    """A bead falls onto a stiff stop and rises again."""
    law = lambda p, bead: (0, ca.if_else(bead.y < 0, -1e5 * bead.y, 0) - 9.81)  # noqa: E731
    scene = particle(law, np.linspace(0, 1, 2001), {"mass.y": 0.1}, ("y",))
    run = mb.simulate(scene)
    below = np.count_nonzero(np.diff(run["y"] > 0))
    assert below >= 6 and f"the run meets kinks or jumps (comparison) at least {below} times" in run.reason
    assert "; kinks or jumps (comparison)" in mb.DAESimulator(scene).reason
    assert "kinks" not in mb.simulate(scene, mb.CVODES()).reason


def test_a_motion_that_sticks_to_a_jump_ends_with_advice():
    """A slider on a spring comes to rest by dry friction: no steps follow a law that jumps there; a steep one does."""

    def scene(sign):
        return particle(lambda p, mass: -100 * mass.x - 5 * sign(mass.vx), np.linspace(0, 2, 41), {"mass.x": 0.5})

    told = r"jumps \(sign\)\. If the motion sticks to .*tanh"
    refused(told, mb.simulate, scene(ca.sign), mb.CVODES(), error=mb.SimulationError)
    run = mb.simulate(scene(lambda v: ca.tanh(v / 1e-4)))
    # Each half swing is shorter by 2 F/k at both ends: 0.5, -0.4, 0.3, -0.2, 0.1, and 0 after five.
    assert abs(run["x"][-1]) < 1e-3 and abs(run["x"][np.argmin(abs(run.t - np.pi / 10))] + 0.4) < 0.01


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), mb.CVODES(rtol=1e-8, stiff=True)], ids=repr)
def test_pulses_beside_larger_motions_of_a_law_are_not_stepped_over(solver):
    """10 ms of a force beside a sine of its size, and beside a longer pulse ten times as high."""
    short = ca.if_else(mb.t > 7.5, ca.if_else(mb.t < 7.51, 1.0, 0.0), 0.0)
    long = ca.if_else(mb.t > 1, ca.if_else(mb.t < 3, 1.0, 0.0), 0.0)
    for force, gained in ((10 * ca.sin(2 * np.pi * mb.t / 10) + 10 * short, 0.1), (100 * long + 10 * short, 200.1)):
        run = mb.simulate(particle(lambda p, mass, force=force: force, np.linspace(0, 10, 11), {}, ("vx",)), solver)
        assert run["vx"][-1] == pytest.approx(gained, abs=1e-5 * max(gained, 1))


def led_by(*laws):
    machine = ball(lambda m: tuple(mb.Motion(f"drive{i}", m.ball.x, law) for i, law in enumerate(laws)), g=None)
    return machine.scene("x", np.linspace(0, 2, 9))


@pytest.mark.parametrize(
    ("law", "text"),
    [
        (ca.fmax(mb.t - 1, 0), "velocities that jump at t = 1 s"),
        (100 * ca.sin(20 * mb.t) + 0.01 * ca.fabs(mb.t - 0.7), "velocities that jump at t = 0.7 s"),
        (ca.if_else(mb.t > 1.3, 0.1, 0.0), "positions that jump at t = 1.3 s"),
    ],
)
def test_drives_that_break_are_told_by_all_who_integrate_accelerations(law, text):
    scene = led_by(law)
    for run in (mb.simulate, mb.DAESimulator, lambda scene: mb.simulate(scene, mb.IDAS())):
        refused(f"'drive0' requires {text}.*such as NSTIFFSI2", run, scene)
    keeps = mb.simulate(scene, mb.NSTIFFSI2(step=0.01))
    assert not keeps.doubts
    np.testing.assert_allclose(keeps["x"], keeps(law), atol=1e-9)


def test_a_drive_whose_position_jumps_is_refused():
    refused("positions that jump at t = 1.3 s", mb.DAESimulator, led_by(ca.if_else(mb.t > 1.3, 0.1, 0.0)), mb.CVODES())


@pytest.mark.parametrize(
    "law", [ca.if_else(mb.t > 1, (mb.t - 1) ** 2, 0), ca.sin(1e3 * mb.t), ca.tanh((mb.t - 1) / 1e-6), 0.5 * mb.t**2]
)
def test_drives_that_turn_sharply_are_no_breaks(law):
    run = mb.simulate(led_by(law))
    np.testing.assert_allclose(run["x"], run(law), atol=1e-6)


def test_drives_that_contradict_each_other_are_told():
    law = mb.t + mb.t**2
    told = r"'drive0', 'drive1' require accelerations that contradict"
    refused(told, mb.simulate, led_by(law, law + 2 * mb.t**2), error=mb.AssemblyError)
    agree = mb.simulate(led_by(law, law))
    assert agree.position_drift < 1e-9 and "warning" not in str(agree)
    told = r"leaves its constraints at t = .* drives contradict each other"
    refused(told, mb.simulate, led_by(law, law + mb.t**3), error=mb.SimulationError)


def test_a_slider_that_touches_at_the_start_takes_no_more_steps():
    """Eight samples whose contacts close within rounding of each other."""
    p = mb.Parameters(mass=0.1, other=1.1, reach=0.44, rate=9100.0, k=2.6e5, c=76.0, gap=0.0)
    ground, sliders = mb.Ground(), [mb.Body(f"s{i}", m, 1.0, mb.Planar()) for i, m in enumerate((p.mass, p.other))]
    rails = [mb.Prismatic(f"r{i}", ground.point(0, 0), s.point(0, 0), axis=(1, 0)) for i, s in enumerate(sliders)]
    touch = mb.Contact("touch", *(s.point(0, 0) for s in reversed(sliders)), (1, 0), mb.KelvinVoigt(p.k, p.c))
    spring = mb.Actuator("spring", rails[0], -p.rate * rails[0].displacement)
    start = {"r0.displacement": -p.reach, "r1.displacement": -p.reach + p.gap}
    scene = mb.Scene(
        mb.System(*sliders, *rails, touch, spring, parameters=p), start, np.linspace(0, 2e-3, 11), {"v": sliders[1].vx}
    )
    simulator = mb.DAESimulator(scene)
    P = np.array([*scene.system.parameters.values()]) * np.random.default_rng(0).uniform(0.97, 1.03, (8, 7))
    steps = []
    for gap in (1e-5, 0.0):
        P[:, -1] = gap
        assert simulator.run(P.copy()).ok.all()
        steps.append(simulator.program.engine().counts.steps)
    assert steps[1] <= 1.5 * steps[0]
