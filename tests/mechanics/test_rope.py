"""Ropes: slack and taut, over pulleys, wound by a winch; and rods that stand for them."""

import warnings
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned
from numpy.testing import assert_allclose

import symmb as mb

GROUND = mb.Ground()
ORIGIN, NEAR = GROUND.point(0, 0), (GROUND.point(0.05, 0), 0.1)
TIMES = np.linspace(0, 1, 12)


def hanging(way, *rope, start=None, times=(0.0, 1.0), mass=2.0, g=10.0):
    load = mb.Body("load", mass, pose=mb.Particle())
    system = mb.System(load, mb.Rope("rope", [*way, load.point(0, 0)], *rope), mb.Gravity(0, -g))
    return mb.Scene(system, start, list(times), {"x": load.x, "y": load.y, "vy": load.vy})


def led(start, r, x, y, length, times):
    """The end of a rope that goes round a post at the origin is led along a path."""
    end = mb.Body("end", 1.0, pose=mb.Particle())
    rope = mb.Rope("rope", [start, (GROUND.point(0, 0), r), end.point(0, 0)], 10.0, length)
    system = mb.System(end, rope, mb.Motion("x", end.x, x), mb.Motion("y", end.y, y))
    return mb.Scene(system, {"end.z": 0.0}, times, {"pull": system.force("rope")})


def test_a_slack_rope_has_no_force_and_catches_its_load():
    """A fall of 0.5 s, then half a vibration about the sag m g / k, and up again."""
    k, m, g = 200.0, 2.0, 10.0
    w, v = np.sqrt(k / m), 5.0
    phase = np.pi - np.arctan2(v / w, m * g / k)  # where the rope has its length again
    taut = 2 * phase / w
    times = [0.0, 0.5, 0.5 + taut / 2, 0.5 + taut, 0.7 + taut]
    scene = hanging([GROUND.point(0, 1.25)], k, 1.25 + 1.25, start={"load.y": 0.0}, times=times)
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-11))
    deepest = -1.25 - m * g / k - np.hypot(v / w, m * g / k)
    assert_allclose(run["y"], [0, -1.25, deepest, -1.25, -1.25 + 0.2 * v - 0.2], atol=1e-6)
    assert_allclose(run["vy"][[1, 3]], [-v, v], atol=1e-6)
    assert run.energy_drift < 1e-8


def test_damping_never_pushes():
    """A load that flies up from a stretched rope: the damper would push it down."""
    start = {"load.y": -1.2, "load.vy": 4.0}
    run = mb.simulate(hanging([GROUND.point(0, 0)], 1e-3, 1.0, 50.0, start=start, times=[0, 0.1]))
    assert_allclose(run["vy"][-1], 3.0, atol=1e-6)


def test_a_rope_round_a_pulley_is_as_long_as_a_belt():
    """Two points on tangents that are known, a quarter of a turn and three parts of a quarter round two pulleys."""
    r = 0.3
    load = mb.Body("load", 1.0, pose=mb.Particle())
    way = [GROUND.point(-1, r), (GROUND.point(0, 0), -r), (GROUND.point(2 * r, -1), r), load.point(0, 0)]
    system = mb.System(load, mb.Rope("rope", way, 1.0, 0.0))
    wraps = ca.vertcat(*[state.sx for state in system.collected.states])
    pull = ca.Function("pull", [system.q, wraps], [system.Q])(ca.vertcat(2.0, -1 - r, 0), 0.8).full().ravel()
    assert_allclose(pull, [-(1 + np.pi / 2 * r + 1 + np.pi / 2 * r + 2 - 2 * r), 0, 0], atol=1e-12)


def test_a_winch_lifts_and_does_work():
    start = {"load.y": -2.002, "load.vy": 0.5}
    run = mb.simulate(hanging([GROUND.point(0, 0)], 1e4, 2 - 0.5 * mb.t, 200.0, start=start))
    assert_allclose(run["y"], [-2.002, -1.502], atol=1e-9)
    assert_allclose(run.energy.work[-1], 2 * 10 * 0.5, rtol=1e-6)


def test_a_rod_for_a_rope_says_when_it_pushes():
    """A bob thrown round a circle slower than sqrt(5 g): the pull is v^2 + g sin, with v^2 = v0^2 - 2 g (1 + sin)."""
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    rod = mb.Distance("rod", GROUND.point(0, 0), bob.point(0, 0), 1.0, unilateral=True)
    start = {"bob.x": 0.0, "bob.vx": 5.5}
    scene = mb.Scene(mb.System(bob, rod, mb.Gravity(0, -9.81)), start, np.linspace(0, 1, 201), guess={"bob.y": -1.0})
    run = warned(r"Distance 'rod': its force changes sign at t = 0\.4", mb.simulate, scene)
    slack = (5.5**2 - 2 * 9.81) / (3 * 9.81)  # its height
    time = float(run.doubts[0].split("t = ")[1].split()[0])
    assert run["bob.y"][run.t.searchsorted(time) - 1] < slack <= run["bob.y"][run.t.searchsorted(time)] + 1e-9


@pytest.mark.parametrize(
    ("way", "k", "length", "fault"),
    [
        (lambda end: [ORIGIN], 1.0, 1.0, "must be a list of at least two points"),
        (lambda end: end, 1e4, 1.0, "must be a list of at least two points"),
        (lambda end: [ORIGIN, GROUND.point(1, 0)], 1.0, 1.0, "so the rope has no effect"),
        (lambda end: [(ORIGIN, 0.1), end], 1.0, 1.0, "first or the last point is a pulley"),
        (lambda end: [ORIGIN, NEAR, end], 1e4, 1.0, "closer to each other than their pulleys allow"),
        (lambda end: [ORIGIN, end], 0.0, 1.0, "stiffness is 0; it must be above 0"),
        (lambda end: [ORIGIN, end], 1.0, -1.0, "length is -1; it must be at least 0"),
    ],
)
def test_faults(way, k, length, fault):
    load = mb.Body("load", 1.0, pose=mb.Particle())
    refused(f"Rope 'rope': .*{fault}", mb.System, load, mb.Rope("rope", way(load.point(0, 0)), k, length))


def test_a_load_in_its_pulley_is_a_run_that_ends():
    way, start = [GROUND.point(-1, 0), (ORIGIN, 0.1)], {"load.x": 0.05, "load.vx": 0.2}
    run = warned("an end has reached a pulley", mb.simulate, hanging(way, 1e4, 3.0, start=start, g=0.0))
    assert run["x"][-1] == pytest.approx(0.25, abs=1e-9)


@pytest.mark.parametrize(("over", "y"), [(GROUND.point(0, 0), -0.79), (GROUND.point(0.1, 0.05), -0.64)])
def test_a_winch_that_winds_its_load_into_the_pulley_is_told(over, y):
    """Of 1.8 m, 0.8 m and 0.7 m are free, and 1 m is wound each second. A round pulley would let the load fly on."""
    start, times = {"load.x": 0.1, "load.y": y, "load.vy": 1.0}, np.linspace(0, 0.9, 19)
    scene = hanging([GROUND.point(-1, 0.1), over], 1e4, 1.8 - mb.t, 50.0, start=start, times=times, mass=1.0, g=9.81)
    warned(r"Rope 'rope': the rope is too short at t = 0\.[678].*Stop the winch earlier", mb.simulate, scene)


def retracting(speed, r, k=1000.0):
    """An idler that is drawn down from under a rope between two points."""
    p = mb.Parameters(speed=speed, r=r)
    idler = mb.Body("idler", 1.0, 1.0)
    slide = mb.Prismatic("slide", GROUND.point(0, 0), idler.point(0, 0), axis=(0, 1, 0))
    rope = mb.Rope("rope", [GROUND.point(-1, 0), (idler.point(0, 0), -p.r), GROUND.point(1, 0)], k, 1.98)
    drive = mb.Motion("drive", slide.displacement, 0.1 - p.speed * mb.t)
    system = mb.System(idler, slide, rope, drive, parameters=p)
    return mb.Scene(system, {}, TIMES, {"pull": system.force("rope"), "held": system.lam("drive")})


def pull_of_retracting(speed, r, k=1000.0):
    h = 0.1 - speed * TIMES
    d = np.hypot(1, h)
    way = 2 * np.sqrt(d**2 - r**2) + 2 * r * (np.arctan2(h, 1) + np.arcsin(r / d))
    return k * (np.where(h + r > 0, way, 2.0) - 1.98)


@pytest.mark.parametrize(("speed", "r"), [(0.3, 0.05), (0.41, 0.12)])
def test_an_idler_that_retracts_leaves_the_rope(speed, r):
    """In one run, in lanes, and in derivatives with respect to the speed and to the radius."""
    values = {"speed": speed, "r": r}
    scene, right = retracting(**values), pull_of_retracting(**values)
    run = mb.simulate(scene)
    assert_allclose(run["pull"], right, atol=1e-8)
    assert_allclose(run["held"][right == 20.0], 0.0, atol=1e-9)  # the rope does not hold the idler
    assert not run.doubts
    assert_allclose(mb.simulate(scene, parameters=[values])["pull"][0], right, atol=1e-7)
    slopes = mb.sensitivities(scene)
    for name in values:
        up, down = ({**values, name: values[name] * s} for s in (1 + 1e-6, 1 - 1e-6))
        slope = (pull_of_retracting(**up) - pull_of_retracting(**down)) / (2e-6 * values[name])
        assert_allclose(slopes["pull", name], slope, atol=1e-3)


@pytest.mark.parametrize(("turns", "r", "side"), [(2.3, 0.2, -1), (1.1, 0.1, 1), (3.7, 0.05, -1)])
def test_a_rope_winds_on_by_several_turns_and_off(turns, r, side):
    """The end goes round a post on a circle of the radius 1 and back, and further back until the rope is straight."""
    angle = 0.4 - (turns * 2 * np.pi + 0.4) * ca.sin(np.pi * mb.t)
    times = np.linspace(0, 1, 41)
    path = ca.cos(angle), -side * ca.sin(angle)
    run = mb.simulate(led(GROUND.point(-2, -side * r), side * r, *path, 2.2, times))
    a = 0.4 - (turns * 2 * np.pi + 0.4) * np.sin(np.pi * times)
    wrap = np.arcsin(r) - a
    straight = np.hypot(2 + np.cos(a), np.sin(a) - r)
    right = np.where(wrap > 0, 2 + r * wrap + np.sqrt(1 - r**2), straight) - 2.2
    assert (wrap < 0).any() and wrap.max() > 2 * np.pi * turns
    assert_allclose(run["pull"], 10 * np.maximum(right, 0), atol=1e-6)


def longest_way(points, radii):
    """The longest way over some of the pulleys whose wraps are not negative: others meet fewer constraints."""
    best = 0.0, ()
    for kept in ((), (1,), (2,), (1, 2)):
        chain, ends = (0, *kept, 3), []
        for i, j in pairwise(chain):
            d, across = points[j] - points[i], radii[i] - radii[j]
            ends.append((np.sqrt(d @ d - across**2), np.arctan2(d[1], d[0]) + np.arcsin(across / np.hypot(*d))))
        wraps = [np.sign(radii[j]) * (b[1] - a[1]) for j, (a, b) in zip(kept, pairwise(ends), strict=True)]
        length = sum(end[0] for end in ends) + sum(abs(radii[j]) * w for j, w in zip(kept, wraps, strict=True))
        best = max(best, (length, kept)) if min(wraps, default=0) >= 0 else best
    return best


@pytest.mark.parametrize("second", [0.1, -0.1])
def test_of_two_pulleys_a_rope_touches_those_that_it_needs(second):
    """On one side, or on opposite ones, in 25 positions of the load."""
    load = mb.Body("load", 1.0, pose=mb.Particle())
    points, radii = np.array([(-1, 0), (0, 0), (1, 0.35), (2, 0)]), [0, -0.1, second, 0]
    way = [(GROUND.point(*x), r) if r else GROUND.point(*x) for x, r in zip(points[:3], radii, strict=False)]
    system = mb.System(load, mb.Rope("rope", [*way, load.point(0, 0)], 1.0, 0.0))
    states = system.collected.states
    start = ca.vertcat(*[state.value for state in states])
    pull = ca.substitute(system.force("rope"), ca.vertcat(*[state.sx for state in states]), start)
    pull, kinds = ca.Function("pull", [system.q], [pull]), set()
    for y in np.linspace(-1.2, 1.2, 25):
        points[3, 1] = y
        length, kept = longest_way(points, radii)
        kinds.add(kept)
        assert_allclose(float(pull([2.0, y, 0.0])), length, atol=1e-12)
    assert len(kinds) > 1


def test_a_rope_that_meets_its_pulley_from_the_other_side_is_told():
    """The end goes round the fixed point of the rope, until the rope comes to the pulley from below."""
    angle = 0.2 + 6 * mb.t
    first = (2 * np.pi - np.arcsin(0.1) - 0.2) / 6
    for times in (np.linspace(0, 1.02, 103), [0.0, 1.02]):
        scene = led(GROUND.point(-1, 0), -0.1, -1 + 2.2 * ca.cos(angle), 2.2 * ca.sin(angle), 1.0, times)
        with pytest.warns(mb.SymmbWarning, match="meets a pulley at t = .* s from outside"):
            (doubt,) = mb.simulate(scene).doubts
        assert first <= float(doubt.split("t = ")[1].split()[0]) <= first + 0.011


@pytest.mark.parametrize(("turn", "side"), [(-1.3, 1), (-0.4, -1), (0.7, 1), (3.5, -1)])
def test_the_state_of_a_pulley_is_the_turn_of_the_line_through_the_points(side, turn):
    """It is listed by nobody, and grows as the load goes round."""
    angle, times = side * (turn + mb.t), np.array([0.0, 0.5, 7.0])
    scene = led(GROUND.point(-1, 0), side * 0.1, 2 * ca.cos(angle), 2 * ca.sin(angle), 9.0, times).with_outputs(None)
    # some come from the side where the pulley does not lie
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        assert_allclose(mb.simulate(scene, mb.CVODES())["rope.wrap1"], turn + times, atol=1e-6)


@pytest.mark.parametrize(("depth", "count"), [(0.35, 2), (0.2, 3), (0.35, 200)])
def test_a_doubt_between_two_output_times_is_told(depth, count):
    """The load comes to its pulley and leaves it before the next output time."""
    load = mb.Body("load", 1.0, pose=mb.Particle())
    rope = mb.Rope("rope", [GROUND.point(-1, 0), (GROUND.point(0, 0), 0.3), load.point(0, 0)], 1e4, 9.0)
    way = mb.Motion("way", load.x, depth + ca.cos(2 * ca.pi * mb.t) ** 2)
    scene = mb.Scene(mb.System(load, rope, way), {"load.y": 0.0, "load.z": 0.0}, np.linspace(0, 1.5, count + count % 2))
    with warnings.catch_warnings(record=True, action="always") as told:
        mb.simulate(scene)
    assert [("an end has reached a pulley" in str(w.message)) for w in told] == [True] * (depth < 0.3)
