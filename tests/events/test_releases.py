"""Joints that open and close in a run, against closed forms, and in lanes against single runs."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import releases
from conftest import but_long
from faults import refused
from machines import GROUND, ORIGIN, ball, pendulum, run_of
from numpy.testing import assert_allclose

import symmb as mb

G = 9.81


def carts(condition, times=(0.0, 1.0)):
    """Two carts on a rail, 1 m apart, of which the left one comes; a hook between them."""
    a, b = mb.Body("a", 1.0, 1.0), mb.Body("b", 3.0, 1.0)
    rails = [mb.Prismatic(f"rail_{c.name}", ORIGIN, c.point(0, 0), axis=(1, 0, 0)) for c in (a, b)]
    hook = mb.Weld("hook", a.point(0, 0), b.point(0, 0))
    system = mb.System(a, b, *rails, hook, *condition(a, b, hook))
    return mb.Scene(system, {"a.x": 0.0, "a.vx": 2.0, "b.x": 1.0}, np.array(times), {"a": a.x, "b": b.x, "v": b.vx})


def rod(*more, **numbers):
    """A rod of 2 kg and 2 m on a hinge at one end."""
    return pendulum(*more, **{"mass": 2.0, "inertia": 2 / 3} | numbers)


def swinging(*more, **numbers):
    """The rod, which turns about its end at 4 rad/s, without gravity."""
    machine = rod(*more, g=None, **numbers)
    outputs = {"x": machine.rod.x, "y": machine.rod.y, "pull": machine.system.reaction("hinge").fx}
    start, box = {"rod.theta": 0.0, "rod.omega": 4.0}, mb.Box(angle=(0.5, 3.5)) if numbers else None
    return machine.scene(outputs, np.linspace(0, 1, 11), start, box=box)


def test_a_pin_that_opens_lets_the_rod_fly_along_the_tangent():
    run = mb.simulate(swinging(lambda m: mb.Release(m.hinge, m.rod.theta > 1.0)))
    (event,) = run.events
    assert (event.name, event.what, event.work, event.impulse) == ("hinge", "opens", 0.0, ())
    assert_allclose(event.time, 0.25, atol=1e-12)
    after = np.maximum(run.t - 0.25, 0.0)
    turned = np.minimum(4 * run.t, 1.0)
    assert_allclose(run["x"], np.cos(turned) - 4 * np.sin(1.0) * after, atol=1e-10)
    assert_allclose(run["y"], np.sin(turned) + 4 * np.cos(1.0) * after, atol=1e-10)
    assert_allclose(run["pull"], np.where(run.t < 0.25, -32 * np.cos(turned), 0.0), atol=1e-8)
    assert not run.doubts


def test_a_latch_is_an_inelastic_impact_whose_impulse_and_work_balance():
    run = mb.simulate(carts(lambda a, b, hook: [mb.Latch(hook, b.x - a.x < 0.25)]))
    (event,) = run.events
    assert (event.name, event.what) == ("hook", "closes")
    assert_allclose((event.time, event.before, event.after), (0.375, -2.0, 0.0), atol=1e-12)
    assert_allclose(event.work, -0.5 * 0.75 * 2.0**2, rtol=1e-14)
    assert_allclose(event.impulse, (-1.5, 0, 0), atol=1e-14)  # of m b - m a along x
    assert_allclose(run["a"][-1], 0.75 + 0.5 * 0.625, atol=1e-12)
    assert_allclose(run["b"] - run["a"], (1.0, 0.25), atol=1e-12)
    assert_allclose(run.work[-1], event.work, rtol=1e-12)
    assert run.energy_drift < 1e-12


def test_a_joint_opens_closes_and_opens_again():
    def condition(a, b, hook):
        return mb.Latch(hook, b.x - a.x < 0.25), mb.Release(hook, ca.sin(2 * np.pi * mb.t) > 0.5)

    scene = carts(condition, times=(0.0, 0.4))
    a, b = scene.system.bodies
    run = mb.simulate(mb.Scene(scene.system, {"a.x": 0.0, "a.vx": 2.0}, [0.0, 0.4], scene.outputs))
    # It opens at 1/12 s. The condition of the latch holds there, and must first cease to.
    assert [(event.what, round(event.time, 9)) for event in run.events] == [("opens", round(1 / 12, 9))]
    pull = 75.0 * (b.x - a.x - 0.5)  # sqrt(75 / (3 / 4)) = 10 rad/s
    springs = [mb.Force(f"spring_{c.name}", c.point(0, 0), (f, 0)) for c, f in ((a, pull), (b, -pull))]
    system = mb.System(*scene.system.elements, *springs)
    run = mb.simulate(mb.Scene(system, {"a.x": 0.0, "a.vx": 0.0}, np.linspace(0, 1.2, 13), {"d": b.x - a.x}))
    apart = 0.5 - 0.5 * np.cos(10 * (np.maximum(run.t, 1 / 12) - 1 / 12))  # from 0 at rest, opened at 1/12
    closing = 1 / 12 + (2 * np.pi - np.arccos(0.5)) / 10
    kinds = [(event.what, event.time) for event in run.events]
    assert [what for what, _ in kinds] == ["opens", "closes", "opens"]
    assert_allclose([time for _, time in kinds], [1 / 12, closing, 1 + 1 / 12], atol=1e-9)
    expected = np.where(run.t < closing, apart, 0.25)
    again = run.t > 1 + 1 / 12
    expected[again] = 0.5 - 0.25 * np.cos(10 * (run.t[again] - 1 - 1 / 12))
    assert_allclose(run["d"], expected, atol=1e-8)


def test_a_condition_that_holds_at_the_start_is_refused():
    opens = swinging(lambda m: mb.Release(m.hinge, m.rod.theta < 1.0))
    closes = carts(lambda a, b, hook: [mb.Latch(hook, b.x - a.x < 3.0)])
    for what, scene in (("Release 'hinge'", opens), ("Latch 'hook'", closes)):
        refused(f"{what}: its condition is already true at the start", mb.simulate, scene, error=mb.SimulationError)


def test_a_condition_that_begins_to_hold_at_the_start_acts_there():
    run = mb.simulate(swinging(lambda m: mb.Release(m.hinge, m.rod.theta > 0.0)))
    assert [event.time for event in run.events] == [0.0]
    assert_allclose(run["y"], 4 * run.t, atol=1e-12)


def test_conditions_that_are_never_met_or_only_touched_do_nothing():
    for met in (lambda rod: rod.theta > 9, lambda rod: ca.sin(2 * rod.theta) > 1):
        run = mb.simulate(swinging(lambda m, met=met: mb.Release(m.hinge, met(m.rod))))
        assert run.events == ()
        assert_allclose(run["x"], np.cos(4 * run.t), atol=1e-9)
    # A peak just above the limit is found, however narrow.
    run = mb.simulate(swinging(lambda m: mb.Release(m.hinge, ca.sin(2 * m.rod.theta) > 1 - 1e-9)))
    assert_allclose(run.events[0].time, (np.pi / 2 - np.arccos(1 - 1e-9)) / 8, atol=1e-9)


def test_release_and_latch_of_one_joint_at_one_instant():
    run = mb.simulate(
        swinging(lambda m: (mb.Release(m.hinge, m.rod.theta > 1.0), mb.Latch(m.hinge, m.rod.theta > 1.0)))
    )
    assert [event.what for event in run.events] == ["opens", "closes"]
    assert_allclose([event.time for event in run.events], 0.25, atol=1e-12)
    assert_allclose([event.work for event in run.events], 0.0, atol=1e-12)
    assert_allclose(run["x"], np.cos(4 * run.t), atol=1e-9)


def test_one_joint_takes_over_from_another_at_one_instant():
    scene = swinging(
        lambda m: mb.Revolute("hook", GROUND.point(0, 2), m.rod.point(1, 0)),
        lambda m: (mb.Release(m.hinge, m.rod.theta > np.pi / 2), mb.Latch(m.hook, m.rod.theta > np.pi / 2)),
    )
    run = mb.simulate(scene)
    assert {(event.name, event.what) for event in run.events} == {("hinge", "opens"), ("hook", "closes")}
    closing = next(event for event in run.events if event.what == "closes")
    # Before it the rod turns about (0, 0), after it about its other end: angular momentum about that end is
    # I w - m v = 2/3 4 - 2 4 = (2/3 + 2) w', or 0 if the pin holds still; the order of declaration decides.
    rate = (2 / 3 * 4 - 2 * 4) / (2 / 3 + 2)
    assert_allclose(run["rod.omega"][-1], rate, atol=1e-9)
    kinetic = 0.5 * (2 / 3 + 2) * np.array([4.0**2, rate**2])
    assert_allclose(closing.work, kinetic[1] - kinetic[0], atol=1e-9)


def test_two_latches_that_close_at_once():
    bar = mb.Body("bar", 2.0, 0.5)
    hooks = [mb.Revolute(name, GROUND.point(x, -1), bar.point(x, 0)) for name, x in (("left", -1), ("right", 1))]
    latches = [mb.Latch(hook, hook.point_b.y < -1) for hook in hooks]
    run = run_of(bar, *hooks, *latches, mb.Gravity(0, -2.0), times=[0.0, 0.5, 2.0])
    assert sorted(event.name for event in run.events) == ["left", "right"]
    assert_allclose([event.time for event in run.events], 1.0, atol=1e-12)
    assert_allclose(sum(event.work for event in run.events), -0.5 * 2.0 * 2.0**2, rtol=1e-10)
    assert_allclose(run["bar.y"], (0, -0.25, -1), atol=1e-10)
    # Both carry half of the weight: redundant rows share it with least reactions.
    assert_allclose(run.reaction("left")[0][-1, 1], 2.0, atol=1e-6)


def test_a_latch_closes_while_a_contact_is_closed():
    """A block that slides on a floor, and that a rope tied to the ground stops as it gets taut."""
    block = mb.Body("block", 2.0, pose=mb.Particle())
    rope = mb.Distance("rope", mb.Ground().point(0, 1), block.point(0, 0), 2.0)
    far = ca.sqrt(block.x**2 + (block.y - 1) ** 2)
    floor = mb.Impact("floor", block.y, 0.0)
    system = mb.System(block, floor, rope, mb.Latch(rope, far > 2.0), mb.Gravity(0, -G))
    run = mb.simulate(mb.Scene(system, {"block.x": 0.0, "block.vx": 1.0, "block.y": 0.0}, np.linspace(0, 3, 13)))
    closing = next(event for event in run.events if event.name == "rope")
    assert_allclose(closing.time, np.sqrt(3), atol=1e-9)
    # The rope pulls up as well: it leaves the velocity across it, (1, 0) less its part along (sqrt(3), -1) / 2.
    assert_allclose(closing.work, -0.5 * 2 * 0.75, atol=1e-9)
    assert_allclose(closing.impulse, [2 * np.sqrt(3) / 2], atol=1e-9)
    assert run["block.y"].min() > -1e-9
    assert_allclose(run.energy_drift, 0, atol=1e-8)


def test_a_latch_holds_what_lies_on_a_floor():
    """It starts in the hook, lies on the floor from 1/12 s to 0.6 s, and is thrown when the hook opens again."""
    machine = ball(
        lambda m: (mb.Spherical("hook", ORIGIN, m.at), mb.Impact("floor", m.ball.y, 0.0)),
        lambda m: (mb.Latch(m.hook, mb.t > 0.6), mb.Release(m.hook, ca.sin(2 * np.pi * mb.t) > 0.5)),
        lambda m: mb.Force("throw", m.at, (0, ca.if_else(mb.t > 1, 4 * G, 0))),
        mass=2.0,
    )
    run = machine.run(None, [0.0, 0.3, 0.8, 1.05, 2.0], {"ball.y": 0.0})
    known = [("hook", "opens"), ("floor", "closes"), ("hook", "closes"), ("floor", "opens"), ("hook", "opens")]
    assert [(event.name, event.what) for event in run.events] == known
    assert_allclose([event.time for event in run.events], [1 / 12, 1 / 12, 0.6, 0.6, 13 / 12], atol=1e-9)
    assert_allclose(run["ball.y"], [0, 0, 0, 0, G / 2 * (2 - 13 / 12) ** 2], atol=1e-9)
    assert_allclose(run.reaction("hook")[0][:, 1], [2 * G, 0, 2 * G, -2 * G, 0], atol=1e-9)


@pytest.mark.parametrize("kind", but_long(releases.CAUGHT, *(kind for kind in releases.CAUGHT if "space" in kind)))
def test_opening_and_closing_balance_impulse_momentum_and_energy(kind):
    catch, over = releases.imbalance(kind, 0)
    assert catch < 1e-12
    assert over < 1e-8


def test_one_of_two_redundant_joints_opens():
    """A plate that two bolts hold: each alone is a pin, about which it then swings."""
    plate = mb.Body("plate", 1.0, 0.5)
    bolts = [mb.Revolute(name, GROUND.point(x, 0), plate.point(x, 0)) for name, x in (("left", -1), ("right", 1))]
    for first, second, pivot in ((*bolts, 1), (*bolts[::-1], -1)):  # 1 m beside the centre
        opens = mb.Release(first, mb.t > 0.5), mb.Release(second, mb.t > 0.7)
        run = run_of(plate, *bolts, *opens, mb.Gravity(0, -G), times=[0.0, 0.4, 0.6, 1.0])
        assert_allclose(run.reaction("left")[0][1, 1], G / 2, rtol=1e-6)
        assert_allclose(run["plate.theta"][2], pivot * G / 1.5 * 0.1**2 / 2, rtol=1e-2)
        assert_allclose(run.reaction(first.name)[0][2:], 0.0, atol=1e-12)
        assert_allclose(run.reaction(second.name)[0][3], 0.0, atol=1e-12)


def test_a_spatial_weld_closes_on_a_body_that_a_hinge_carries():
    """Five of its six rows are redundant."""
    door = mb.Body("door", 10.0, (1, 2, 3), mb.Spatial())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0, 0), door.point(-0.5, 0, 0))
    latch = mb.Weld("latch", mb.Ground().point(0, 0, 0), door.point(0.5, 0, 0))
    system = mb.System(door, hinge, latch, mb.Latch(latch, hinge.angle > 1.7), mb.Gravity(0, 0, -G))
    run = mb.simulate(mb.Scene(system, {"hinge.angle": 0.0, "hinge.angle_rate": 2.0}, [0, 1, 5], {"a": hinge.angle}))
    assert_allclose(run["a"], (0, 1.7, 1.7), atol=1e-9)
    assert_allclose(run.events[0].work, -0.5 * (3 + 2.5) * 4, rtol=1e-10)
    assert not run.doubts


def test_a_pin_breaks_at_a_force():
    """A rod falls from the horizontal. At an angle a below it the pin bears m g (8 sin^2 a + cos^2 a / 4 + ...)."""
    breaks = rod(lambda m: mb.Release(m.hinge, lambda pull: pull.fx**2 + pull.fy**2 > 40.0**2))
    run = breaks.run(start={"rod.theta": 0.0})  # a' = -3 g cos / 4, w^2 = 3 g sin / 2
    # Along the rod it is m g sin (1 + 3 / 2), across it m g cos (1 - 3 / 4).
    sine = np.sqrt(((40 / (2 * G)) ** 2 - 1 / 16) / (2.5**2 - 1 / 16))
    assert len(run.events) == 1
    assert_allclose(run["rod.omega"][-1], -np.sqrt(1.5 * G * sine), rtol=1e-9)


def test_linearisation_keeps_joints_as_they_are_at_the_start():
    machine = rod(
        lambda m: mb.Revolute("hook", GROUND.point(1, 0), m.rod.point(1, 0)),
        lambda m: (mb.Release(m.hinge, m.rod.theta > 1.0), mb.Latch(m.hook, m.rod.theta > 0.5)),
    )
    scene = machine.scene(start={"rod.theta": -np.pi / 2})
    assert_allclose(np.abs(mb.linearize(scene).eigenvalues.imag), np.sqrt(0.75 * G), rtol=1e-12)


def test_events_are_kept_in_files_and_a_run_goes_on_with_its_joints(tmp_path):
    scene = carts(lambda a, b, hook: [mb.Latch(hook, b.x - a.x < 0.25)], times=(0.0, 0.5))
    run = mb.simulate(scene)
    for suffix in ("npz", "json"):
        run.save(tmp_path / f"run.{suffix}")
        assert mb.Trajectory.load(tmp_path / f"run.{suffix}").events == run.events
    longer = mb.simulate(scene.starting_at(run))
    assert longer.events == ()
    assert_allclose(longer["b"] - longer["a"], 0.25, atol=1e-12)
    assert_allclose(longer["b"][-1], 1.0 + 0.5 * 0.625, atol=1e-12)


def test_lanes_open_at_times_of_their_own():
    scene = swinging(lambda m: mb.Release(m.hinge, m.rod.theta > m.p.angle), angle=2.0)

    def places(angle):
        return np.cos(np.minimum(4 * scene.times, angle)) - 4 * np.sin(angle) * np.maximum(scene.times - angle / 4, 0)

    swept = mb.sweep(scene, {"angle": np.linspace(0.5, 3.5, 7)})
    for values, angle in zip(swept.values, np.linspace(0.5, 3.5, 7), strict=True):
        single = mb.simulate(scene, parameters={"angle": angle})
        assert_allclose(values, single.values, atol=1e-10)
        assert_allclose(single["x"], places(angle), atol=1e-9)
    x = places(np.linspace(0.5, 3.5, 20001)[:, None])
    width = np.ptp(x, axis=0).max()
    for method, off in ((mb.MonteCarlo(300), 0.03), (mb.PolynomialChaos(), 0.01)):
        bounds = mb.propagate(scene, method)
        assert not bounds.failed
        assert_allclose(bounds["x"], (x.min(axis=0), x.max(axis=0)), atol=off * width)


def test_what_has_no_derivative_there_refuses():
    scene = swinging(lambda m: mb.Release(m.hinge, m.rod.theta > m.p.angle), angle=2.0)
    refused("Release 'hinge'", mb.propagate, scene, mb.Taylor(4), error=mb.PropagationError)
    refused("joints that open or close", mb.propagate, scene, mb.TaylorModel(), error=mb.PropagationError)
    refused("'hinge' may open or close", mb.simulate, replace(scene, coordinates="joint"))
    refused("does not locate the events of Release 'hinge'", mb.simulate, scene, mb.CVODES())


def test_faults_of_declarations():
    rod = mb.Body("rod", 1.0, 1.0)
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, 0))
    refused("Revolute 'pin' is not part of the System", mb.System, rod, mb.Release(pin, mb.t > 1))
    refused("expected a joint", mb.System, rod, pin, mb.Release(rod, mb.t > 1))
    refused("is constant", mb.System, rod, pin, mb.Release(pin, 1.0))
    refused("equality", mb.System, rod, pin, mb.Release(pin, rod.theta == 1))
    twice = "Release 'pin': there are two events of this kind. Combine their conditions"
    refused(twice, mb.System, rod, pin, mb.Release(pin, mb.t > 1), mb.Release(pin, mb.t > 2))
    gear = mb.Gear("gear", mb.Ground().point(0, 0), rod.point(0, 0), ratio=2.0)
    refused("a Gear cannot close", mb.System, rod, pin, gear, mb.Latch(gear, mb.t > 1))
