"""Limits of curves between output times, against closed forms and finer times."""

import numpy as np
import pytest
from faults import refused
from machines import ORIGIN, ball, bob, bouncing_ball, spring_mass
from small_scenes import formulas

import symmb as mb

pytestmark = pytest.mark.usefixtures("optimised")

G = 9.81
EXCESS = 1e-3
"""Relative distance of limits from closed forms."""


def swung(count: int) -> mb.Scene:
    """A pendulum that starts horizontally. Its largest velocity at the bottom is sqrt(2 g l)."""
    machine = bob()
    outputs = {"speed": (machine.bob.vx**2 + machine.bob.vy**2) ** 0.5, "height": machine.bob.y}
    start, box = {"bob.x": machine.p.length, "bob.y": 0.0}, mb.Box(length=(0.9, 1.1))
    return machine.scene(outputs, np.linspace(0, 2.3, count), start, box=box)


def dropped(count: int) -> mb.Scene:
    """A ball that falls on a spring and is thrown back. The force acts for 22 ms."""
    floor = lambda m: mb.Contact("floor", m.at, ORIGIN, (0, 1, 0), mb.KelvinVoigt(m.p.k, 0.0))  # noqa: E731
    machine, box = ball(floor, k=2e4, h=0.1), mb.Box(k=(1.8e4, 2.2e4), h=(0.095, 0.105))
    outputs = {"force": (machine.system.force("floor"), "N")}
    return machine.scene(outputs, np.linspace(0, 0.25, count), {"ball.y": machine.p.h}, box=box)


def largest_force(k: float, h: float) -> float:
    """Force where the potential energy m g (h + s) is stored in the spring, from k s^2 / 2 = g (h + s)."""
    return G + np.sqrt(G**2 + 2 * k * G * h)


@pytest.mark.parametrize("count", [2, 3, 4, 6, 11, 12, 17, 40, 101])
def test_a_run_that_passes_a_limit_between_two_times_violates_it(count):
    scenes = ((swung, "speed", np.sqrt(2 * G * 1.1)), (dropped, "force", largest_force(2.2e4, 0.105)))
    for scene, name, most in scenes:
        bounds = mb.propagate(scene(count))
        inside, outside = (bounds.check({name: (None, (1 + sign * EXCESS) * most)})[name] for sign in (-1, 1))
        assert inside.kept is False and -1.01 * EXCESS * most < inside.margin.min() < 0
        assert "beyond the limit" in inside.why and outside.kept


def test_the_worst_case_is_the_run_that_passes_the_limit():
    most = largest_force(2.2e4, 0.105)
    worst = mb.propagate(dropped(5)).check({"force": (None, 0.9 * most)}).worst
    assert worst is not None and worst.value == pytest.approx(most, rel=1e-3)
    assert worst.parameters["k"] == 2.2e4 and worst.parameters["h"] == 0.105


@pytest.mark.parametrize("count", [2, 3, 5, 8, 12, 31])
def test_tolerances_do_not_depend_on_the_number_of_times(count):
    """The limits are reached at l = 1.05 and at k = 2.1e4, h = 0.1025 (closed forms)."""
    scenes = ((swung, "speed", np.sqrt(2 * G * 1.05)), (dropped, "force", largest_force(2.1e4, 0.1025)))
    for scene, name, most in scenes:
        half = mb.tolerances(scene(count), {name: (None, most)})
        assert half.factor == pytest.approx(0.5, rel=0.01) and half.check.kept


def test_the_nominal_run_passes_a_limit_between_two_times():
    told = r"the nominal run violates or reaches the limit 4 m/s of speed: 4\.429"
    refused(told, mb.tolerances, swung(2), {"speed": (None, 4.0)}, error=mb.PropagationError)


def test_limits_far_away_have_no_remark():
    bounds = mb.propagate(dropped(11))
    assert not bounds.check({"force": (None, 1.2 * largest_force(2.2e4, 0.105))}).remarks
    assert not mb.propagate(swung(5)).check({"height": (-1.2, 0.1)}).remarks


def bouncing(times, restitution, output="v", /, **plus_minus) -> mb.Scene:
    """A ball that falls from the height h = 0.7 m, and is thrown back with a part of its speed sqrt(2 g h)."""
    machine = bouncing_ball(mass=0.4, restitution=restitution, h=0.7)
    outputs, box = {"v": machine.ball.vy, "y": machine.ball.y}, mb.Box.plus_minus(machine.p, **plus_minus)
    return machine.scene({key: outputs[key] for key in output.split()}, times, {"ball.y": machine.p.h}, box=box)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("seed", range(3))
def test_speeds_at_impacts_count(seed):
    """The speed is largest at the instant of an impact, which is no output time."""
    rng = np.random.default_rng(seed)
    times, e = np.sort([0.0, *rng.uniform(0.05, 0.85, rng.integers(1, 9)), 0.9]), rng.uniform(0.4, 0.8)
    scene, wider = bouncing(times, e, "v y", h="3%", restitution="4%"), rng.uniform(0.7, 2.5)
    fastest = np.sqrt(2 * G * 0.7 * (1 + 0.03 * wider))
    for pair in ((-fastest, None), (None, fastest * e * (1 + 0.04 * wider))):
        found = mb.tolerances(scene, {"v": pair})
        assert found.factor == pytest.approx(wider, rel=0.01) and found.check.kept and found.binding is not None
        assert found.binding.parameters["h"] == pytest.approx(fastest**2 / 2 / G, rel=1e-3)
    bounds = mb.propagate(scene)
    assert bounds.check({"y": (1e-6, None)})["y"].kept is False  # each run touches the floor
    assert bounds.check({"y": (-1e-6, None)})["y"].kept is not False


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize(("count", "share"), [(46, 6), (91, 3), (181, 6)])
def test_a_violation_is_told_by_the_fastest_impact(count, share):
    """Bounds at output times have an error at impacts. The excess of a limit must not depend on it."""
    bounds = mb.propagate(bouncing(np.linspace(0, 0.9, count), 0.6, h=f"{share}%", restitution="4%", g="3%"))
    fastest = np.sqrt(2 * G * 1.03 * 0.7 * (1 + share / 100))
    for part in (0.9, 0.98):
        check = bounds.check({"v": (-part * fastest, None)})
        assert check.kept is False and check.margin.min() == pytest.approx((part - 1) * fastest, rel=1e-6)
        assert check.worst is not None and check.worst.value == pytest.approx(-fastest, rel=1e-6)


def test_both_ends_are_told():
    check = mb.propagate(swung(3)).check({"height": (-1.0, -0.02)})
    assert check.kept is False and len(check.remarks) == 1
    assert "In other cases height may exceed its limit of -0.02" in check.remarks[0]


def test_more_than_a_thousand_times_are_divided():
    """The oscillator is at zero at all output times."""
    machine = spring_mass(stiffness=(6 * np.pi) ** 2, v=2.0)
    scene = machine.scene("x", np.arange(1100) / 6, {"ball.vx": machine.p.v}, box=mb.Box(v=(1.9, 2.1)))
    limit = mb.propagate(scene).check({"x": (None, 2.05 / (6 * np.pi))})["x"]
    assert limit.kept is False and limit.margin.min() == pytest.approx(-0.05 / (6 * np.pi), rel=1e-3)


def test_tolerances_with_costs_are_no_dearer_than_with_one_factor():
    scene = swung(2)
    limits = {"speed": (None, np.sqrt(2 * G * 1.05))}
    assert mb.tolerances(scene, limits, costs={}).cost == pytest.approx(2.0, rel=0.01)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_infinite_bounds_have_infinite_margins():
    """The enclosure of 1 / k^2 is infinite if the interval of k contains 0."""
    scene = formulas(lambda p: {"x": mb.t / p.k**2}, [0.0, 0.5, 1.0], k=(-1.0, 2.0))
    bounds = mb.propagate(scene, mb.TaylorModel())
    assert np.isinf(bounds.upper).any()
    for limits in ((None, 0.5), (-0.5, 0.5), (-1.0, None)):
        check = bounds.check({"x": limits})
        assert not check.kept and check["x"].margin.min() == -np.inf and "-inf" in str(check)
