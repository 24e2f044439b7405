"""Switches of forces in runs with impacts, against closed forms."""

import casadi as ca
import numpy as np
import pytest

import symmb as mb

GRAVITY, RESTITUTION, ZONE = 9.81, 0.8, 0.5
TIMES = np.linspace(0, 3, 31)


def ball(force, times=TIMES):
    """A ball that falls from 1 m and bounces, under a force of its body and the parameters."""
    body = mb.Body("ball", 1.0, pose=mb.Particle())
    p = mb.Parameters(work=2.0)
    push = mb.Force("push", body.point(0, 0), (0, force(body, p) - GRAVITY))
    system = mb.System(body, push, mb.Impact("floor", body.y, restitution=RESTITUTION), parameters=p)
    return mb.Scene(system, {"ball.x": 0.0, "ball.y": 1.0}, times, {"y": body.y, "v": body.vy}, name="ball")


def zone(width):
    """A force that does a work over a width, upwards."""
    return ball(lambda b, p: ca.if_else(ca.logic_and(b.y > ZONE, b.y < ZONE + width), p.work / width, 0))


def exact(work, width, times=TIMES):
    """Positions and velocities: parabolas from edge to edge of the zone and from impact to impact."""
    t, y, v, pieces = 0.0, 1.0, 0.0, []
    while t < times[-1]:
        inside = ZONE < y < ZONE + width or (y == ZONE and v > 0) or (y == ZONE + width and v < 0)
        a = (work / width if inside else 0.0) - GRAVITY
        pieces.append((t, y, v, a))
        ways = [(time, edge) for edge in (0.0, ZONE, ZONE + width) for time in passes(y - edge, v, a)]
        ahead, y = min(ways)
        t, v = t + ahead, v + a * ahead
        v = -RESTITUTION * v if y == 0.0 else v
    begin, y, v, a = np.array([next(p for p in reversed(pieces) if p[0] <= now) for now in times]).T
    ahead = times - begin
    return y + v * ahead + a * ahead**2 / 2, v + a * ahead


def passes(y, v, a):
    """Times at which y + v t + a t^2 / 2 is 0 after the start."""
    square = v**2 - 2 * a * y
    roots = [(-v + sign * np.sqrt(square)) / a for sign in (-1, 1)] if square >= 0 else []
    return [t for t in roots if t > 1e-12 or (y != 0 and t > 0)]


@pytest.mark.parametrize("work", [2.0, -2.0, 3.0])
@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_narrow_zones_do_their_work_between_impacts(width, work):
    run = mb.simulate(zone(width), parameters={"work": work})
    y, v = exact(work, width)
    near = 1e-6 + 4 * np.spacing(1.0) / width
    assert "EventDriven" in run.solver and len(run.events) >= 6
    np.testing.assert_allclose(run["y"], y, atol=near)
    np.testing.assert_allclose(run["v"], v, atol=near)


def test_samples_pass_zones_at_their_own_times():
    works = np.linspace(-3, 4, 11)
    Y = mb.DAESimulator(zone(1e-6)).run(works[:, None]).Y
    for values, work in zip(Y, works, strict=True):
        np.testing.assert_allclose(values.T, exact(work, 1e-6), atol=1e-6)


def test_a_motion_that_sticks_to_a_switch_between_impacts_ends_with_the_reason():
    rough = ball(lambda b, p: ca.if_else(b.y < ZONE, -20 * ca.sign(b.vy), 0))
    with pytest.raises(mb.SimulationError, match="switch"):
        mb.simulate(rough)


def test_bounces_on_a_floor_behind_an_elastic_layer():
    stiff = 1e4
    run = mb.simulate(ball(lambda b, p: ca.if_else(b.y < 0.1, stiff * (0.1 - b.y), 0)))
    weak = GRAVITY / stiff
    speed = np.sqrt(2 * GRAVITY * 0.9)
    depth = weak + np.sqrt(weak**2 + speed**2 / stiff)
    assert depth < 0.1 and not run.events
    omega = np.sqrt(stiff)
    in_layer = 2 * (np.pi - np.arctan(speed / (omega * weak))) / omega
    fall = np.sqrt(2 * 0.9 / GRAVITY)
    now = TIMES % (2 * fall + in_layer)
    flying = (now < fall) | (now > fall + in_layer)
    ahead = np.where(now < fall, now, 2 * fall + in_layer - now)[flying]
    np.testing.assert_allclose(run["y"][flying], 1 - GRAVITY * ahead**2 / 2, atol=1e-6)
