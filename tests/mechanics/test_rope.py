"""Ropes: slack and taut, over pulleys, wound by a winch; and rods that stand for them."""

import casadi as ca
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose

import symmb as mb

GROUND = mb.Ground()


def hanging(*rope, start=None, times=(0.0, 1.0), mass=2.0):
    load = mb.Body("load", mass, pose=mb.Particle())
    line = mb.Rope("rope", [*rope[0], load.point(0, 0)], *rope[1:])
    system = mb.System(load, line, mb.Gravity(0, -10.0))
    return mb.Scene(system, start, list(times), {"x": load.x, "y": load.y, "vy": load.vy})


def test_a_slack_rope_has_no_force_and_catches_its_load():
    """A fall of 0.5 s, then half a vibration about the sag m g / k, and up again."""
    k, m, g = 200.0, 2.0, 10.0
    w, v = np.sqrt(k / m), 5.0
    phase = np.pi - np.arctan2(v / w, m * g / k)  # where the rope has its length again
    taut = 2 * phase / w
    times = [0.0, 0.5, 0.5 + taut / 2, 0.5 + taut, 0.7 + taut]
    run = mb.simulate(
        hanging([GROUND.point(0, 1.25)], k, 1.25 + 1.25, start={"load.y": 0.0}, times=times),
        mb.DormandPrince(rtol=1e-11),
    )
    deepest = -1.25 - m * g / k - np.hypot(v / w, m * g / k)
    assert_allclose(run["y"], [0, -1.25, deepest, -1.25, -1.25 + 0.2 * v - 0.2], atol=1e-6)
    assert_allclose(run["vy"][[1, 3]], [-v, v], atol=1e-6)
    assert run.energy_drift < 1e-8


def test_damping_never_pushes():
    """A load that flies up from a stretched rope: the damper would push it down."""
    run = mb.simulate(
        hanging([GROUND.point(0, 0)], 1e-3, 1.0, 50.0, start={"load.y": -1.2, "load.vy": 4.0}, times=[0, 0.1])
    )
    assert_allclose(run["vy"][-1], 3.0, atol=1e-6)


def test_a_rope_round_a_pulley_is_as_long_as_a_belt():
    """Two points on tangents that are known, a quarter of a turn and three parts of a quarter round two pulleys."""
    r = 0.3
    load = mb.Body("load", 1.0, pose=mb.Particle())
    way = [GROUND.point(-1, r), (GROUND.point(0, 0), -r), (GROUND.point(2 * r, -1), r), load.point(0, 0)]
    system = mb.System(load, mb.Rope("rope", way, 1.0, 0.0))
    wraps = ca.vertcat(*[state.sx for state in system.collected.states])
    pull = ca.Function("pull", [system.q, wraps], [system.Q])(ca.vertcat(2.0, -1 - r, 0), 1.5).full().ravel()
    assert_allclose(pull, [-(1 + np.pi / 2 * r + 1 + np.pi / 2 * r + 2 - 2 * r), 0, 0], atol=1e-12)


def test_a_winch_lifts_and_does_work():
    load = mb.Body("load", 2.0, pose=mb.Particle())
    rope = mb.Rope("rope", [GROUND.point(0, 0), load.point(0, 0)], 1e4, 2 - 0.5 * mb.t, 200.0)
    scene = mb.Scene(mb.System(load, rope, mb.Gravity(0, -10.0)), {"load.y": -2.002, "load.vy": 0.5}, [0.0, 1.0])
    run = mb.simulate(scene)
    assert_allclose(run["load.y"], [-2.002, -1.502], atol=1e-9)
    assert_allclose(run.energy.work[-1], 2 * 10 * 0.5, rtol=1e-6)


def test_a_rod_for_a_rope_says_when_it_pushes():
    """A bob thrown round a circle slower than sqrt(5 g): the pull is v^2 + g sin, with v^2 = v0^2 - 2 g (1 + sin)."""
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    rod = mb.Distance("rod", GROUND.point(0, 0), bob.point(0, 0), 1.0, unilateral=True)
    start = {"bob.x": 0.0, "bob.vx": 5.5}
    scene = mb.Scene(mb.System(bob, rod, mb.Gravity(0, -9.81)), start, np.linspace(0, 1, 201), guess={"bob.y": -1.0})
    with pytest.warns(mb.SymmbWarning, match=r"Distance 'rod': what it stands for lets go at t = 0\.4"):
        run = mb.simulate(scene)
    slack = (5.5**2 - 2 * 9.81) / (3 * 9.81)  # its height
    time = float(run.doubts[0].split("t = ")[1].split()[0])
    assert run["bob.y"][run.t.searchsorted(time) - 1] < slack <= run["bob.y"][run.t.searchsorted(time)] + 1e-9


@pytest.mark.parametrize(
    ("points", "k", "length", "fault"),
    [
        ([GROUND.point(0, 0)], 1.0, 1.0, "are no way"),
        ([GROUND.point(0, 0), GROUND.point(1, 0)], 1.0, 1.0, "nothing is left to act on"),
        ([(GROUND.point(0, 0), 0.1), "load"], 1.0, 1.0, "begins or ends with a pulley"),
        ([GROUND.point(0, 0), "load"], 0.0, 1.0, "stiffness is 0; it must be above 0"),
        ([GROUND.point(0, 0), "load"], 1.0, -1.0, "length is -1; it must be at least 0"),
    ],
)
def test_faults(points, k, length, fault):
    load = mb.Body("load", 1.0, pose=mb.Particle())
    with pytest.raises(mb.DeclarationError, match=f"Rope 'rope': .*{fault}"):
        mb.System(load, mb.Rope("rope", [load.point(0, 0) if p == "load" else p for p in points], k, length))


def test_what_is_no_way_is_told():
    body = mb.Body("body", 1.0, pose=mb.Particle())
    ground = mb.Ground()
    rope = mb.Rope("rope", body.point(0, 0), 1e4, 1.0)
    refused("Give a list of two points or more", mb.System, body, rope)
    rope = mb.Rope("rope", [ground.point(0, 0), (ground.point(0.05, 0), 0.1), body.point(0, 0)], 1e4, 1.0)
    refused("closer than the radius", mb.System, body, rope)


def test_a_load_in_its_pulley_is_a_run_that_ends():
    body = mb.Body("body", 1.0, pose=mb.Particle())
    ground = mb.Ground()
    rope = mb.Rope("rope", [ground.point(-1, 0), (ground.point(0, 0), 0.1), body.point(0, 0)], 1e4, 3.0)
    with pytest.warns(mb.SymmbWarning, match="A load is in its pulley"):
        run = mb.simulate(mb.Scene(mb.System(body, rope), {"body.x": 0.05, "body.vx": 0.2}, [0.0, 1.0]))
    assert run["body.x"][-1] == pytest.approx(0.25, abs=1e-9)


@pytest.mark.parametrize("over", [(GROUND.point(0, 0), -0.1), GROUND.point(0, 0)])
def test_a_winch_that_winds_its_load_into_the_pulley_is_told(over):
    """Without the arc of 0.16 m, 0.8 m of the 1.8 m are free, and 1 m is wound each second."""
    load = mb.Body("load", 1.0, pose=mb.Particle())
    rope = mb.Rope("rope", [GROUND.point(-1, 0.1), over, load.point(0, 0)], 1e4, 1.8 - mb.t, 50.0)
    system = mb.System(load, rope, mb.Gravity(0, -9.81))
    scene = mb.Scene(system, {"load.x": 0.1, "load.y": -0.8}, np.linspace(0, 0.9, 19))
    with pytest.warns(mb.SymmbWarning, match=r"Rope 'rope': it is wound up at t = 0\.[78].*Stop the winch before"):
        mb.simulate(scene)
