"""Angles of joints count their turns: revolutes, gears, screws and torsion springs, in the plane and in space."""

import numpy as np
import pytest
from conftest import ALL_SOLVERS
from faults import refused
from machines import GROUND, gears, pendulum
from numpy.testing import assert_allclose

import symmb as mb

TIMES = np.linspace(0.0, 3.0, 31)
TIGHT = mb.CVODES(rtol=1e-11)
AXIS = (0.48, 0.64, 0.6)
POSES = [mb.Planar(), mb.Spatial()]


def wheel(name, pose, inertia=0.5):
    return mb.Body(name, 1.0, inertia if isinstance(pose, mb.Planar) else (inertia,) * 3, pose)


def axis_of(pose):
    return (0, 0, 1) if isinstance(pose, mb.Planar) else AXIS


def spin(pose, rate):
    if isinstance(pose, mb.Planar):
        return {"rod.omega": rate}
    return {"rod.rotation": mb.rotation((0, 0, 1), 0), "rod.omega": tuple(rate * a for a in AXIS)}


def turning(pose, *more, **options):
    """A `rod` on a `hinge` through its centre, about an axis of its own in space."""
    return pendulum(*more, **{"length": 0.0, "inertia": 0.5, "g": None} | options, pose=pose, axis=axis_of(pose))


def angle(machine):
    return {"angle": machine.hinge.angle}


@pytest.mark.parametrize("pose", POSES, ids=repr)
@pytest.mark.parametrize("ground_is_b", [False, True])
@pytest.mark.parametrize("rate", [11.0, -11.0])
def test_the_angle_of_a_hinge_grows_over_several_turns(pose, ground_is_b, rate):
    body = wheel("rod", pose)
    points = (body.point(0, 0), GROUND.point(0, 0)) if ground_is_b else (GROUND.point(0, 0), body.point(0, 0))
    hinge = mb.Revolute("hinge", *points, axis=axis_of(pose))
    outputs = {"angle": hinge.angle, "rate": mb.ddt(hinge.angle)}
    run = mb.simulate(mb.Scene(mb.System(body, hinge), spin(pose, rate), TIMES, outputs), TIGHT)
    sign = -1 if ground_is_b else 1
    assert_allclose(run["angle"], sign * rate * TIMES, atol=1e-8)  # 33 rad, more than five turns
    assert_allclose(run["rate"], sign * rate, atol=1e-8)


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_every_solver_counts_turns(solver):
    run = turning(mb.Spatial()).run(angle, TIMES, spin(mb.Spatial(), 11.0), solver=solver)
    assert_allclose(run["angle"], 11 * TIMES, atol=1e-3)


def test_an_angle_may_start_beyond_a_quarter_turn_and_stand_beside_a_reaction():
    body = wheel("wheel", mb.Spatial())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0, 0), body.point(0.3, 0, 0))
    system = mb.System(body, hinge, mb.Gravity(0, 0, -9.81))
    start = {"wheel.rotation": mb.rotation((0, 0, 1), -2.5), "wheel.omega": (0, 0, -4.0)}
    outputs = {"angle": hinge.angle, "fz": system.reaction("hinge").fz}
    run = mb.simulate(mb.Scene(system, start, TIMES, outputs), TIGHT)
    assert_allclose(run["angle"], -2.5 - 4 * TIMES, atol=1e-8)
    for fz in (run["fz"], run(system.reaction("hinge").fz), run.reaction("hinge")[0][:, 2]):
        assert_allclose(fz, 9.81, atol=1e-9)


def test_an_angle_asked_for_after_the_run_must_be_an_output():
    machine = turning(mb.Spatial())
    refused(r"'hinge\.angle' counts turns during the run, so it must be", machine.run(), machine.hinge.angle)


@pytest.mark.parametrize("pose", POSES, ids=repr)
def test_a_gear_keeps_its_ratio_over_several_turns(pose):
    """Torque T on wheel a: (J_a + r^2 J_b) alpha = T."""
    torque, axis = tuple(3.0 * x for x in axis_of(pose)), axis_of(pose)
    pair = gears(lambda m: mb.Torque("drive", m.a, torque), ratio=-2.5, inertias=(0.5, 0.2), pose=pose, axis=axis)
    run = pair.run({"a": pair.A.angle, "b": pair.B.angle}, TIMES, solver=TIGHT)
    alpha = 3.0 / (0.5 + 2.5**2 * 0.2)
    assert_allclose(run["a"], alpha * TIMES**2 / 2, atol=1e-7)
    assert_allclose(run["b"], -2.5 * run["a"], atol=1e-7)
    assert abs(run["b"][-1]) > 4 * np.pi


def planetary(pose, r_sun, r_planet, carried=True, held=False):
    """Sun, arm and planet, the ring being the ground or absent; the arm is driven at 2 rad/s if the sun is held."""
    axis, pins = axis_of(pose), {}
    sun, arm, planet = (wheel(name, pose, 0.1) for name in ("sun", "arm", "planet"))
    side = np.cross(axis, (1.0, 0.3, 0.0))
    place = (r_sun + r_planet) * side / np.linalg.norm(side)
    for at, body in ((GROUND.point(0, 0), sun), (GROUND.point(0, 0), arm), (arm.point(*place), planet)):
        pins[body.name] = mb.Revolute(f"pin_{body.name}", at, body.point(0, 0), axis=axis)
    options = {"axis": axis, "carrier": arm if carried else None}
    mesh = mb.Gear("mesh", sun.point(0, 0), planet.point(0, 0), ratio=-r_sun / r_planet, **options)
    ring = mb.Gear("ring", GROUND.point(0, 0), planet.point(0, 0), ratio=2 + r_sun / r_planet, **options)
    angle = pins["sun"].angle
    drives = [mb.Motion("hold", angle, 0), mb.Motion("drive", pins["arm"].angle, 2 * mb.t)]
    drives = drives if held else [ring, mb.Motion("drive", angle, 9 * mb.t)]
    outputs = {"arm": pins["arm"].angle_rate, "planet": pins["arm"].angle_rate + pins["planet"].angle_rate}
    return mb.Scene(mb.System(sun, arm, planet, *pins.values(), mesh, *drives), times=TIMES, outputs=outputs)


@pytest.mark.parametrize(("r_sun", "r_planet"), [(0.3, 0.2), (0.21, 0.47)])
@pytest.mark.parametrize("pose", POSES, ids=repr)
def test_gears_on_a_carrier_turn_as_willis_has_it(pose, r_sun, r_planet):
    """Held ring: the arm turns at r_s / (r_s + r_r) of the sun. Held sun: the planet at 1 + r_s / r_p of the arm."""
    run = mb.simulate(planetary(pose, r_sun, r_planet), TIGHT)
    arm = 9 * r_sun / (2 * r_sun + 2 * r_planet)
    assert_allclose(run["arm"], arm, atol=1e-8)
    assert_allclose(run["planet"], arm * (1 - (2 + r_sun / r_planet)), atol=1e-8)
    run = mb.simulate(planetary(pose, r_sun, r_planet, held=True), TIGHT)
    assert_allclose(run["planet"], 2 * (1 + r_sun / r_planet), atol=1e-8)
    assert not run.doubts


def test_a_gear_whose_axis_a_turning_body_holds_is_doubted():
    """Coaxial shafts, ratio 1 and carriers that only slide make no difference between the carrier and the ground."""
    with pytest.warns(mb.SymmbWarning, match="Body 'arm' holds the axis of 'planet' and may turn.*carrier=arm"):
        mb.simulate(planetary(mb.Planar(), 0.3, 0.2, carried=False, held=True))
    shaft, hollow, cabin, disc = (wheel(name, mb.Planar(), 0.1) for name in ("shaft", "hollow", "cabin", "disc"))
    pin = mb.Revolute("pin", GROUND.point(1, 0), shaft.point(0, 0))
    pins = [pin, mb.Revolute("bush", shaft.point(0, 0), hollow.point(0, 0))]
    lift = mb.Prismatic("lift", GROUND.point(0, 0), cabin.point(0, 0), axis=(0, 1, 0))
    pins += [lift, mb.Revolute("hub", cabin.point(0.2, 0), disc.point(0, 0))]
    gears = [mb.Gear(f"gear_{b.name}", shaft.point(0, 0), b.point(0, 0), ratio=0.5) for b in (hollow, disc)]
    mb.simulate(mb.Scene(mb.System(shaft, hollow, cabin, disc, *pins, *gears), {"pin.angle_rate": 2.0}, TIMES[:3]))


def test_a_screw_advances_by_its_pitch_with_every_turn():
    """A nut of mass m on a vertical screw: (J + m (h / 2 pi)^2) alpha = -m g h / (2 pi)."""
    nut = wheel("nut", mb.Spatial(), 0.02)
    pitch = 0.6
    screw = mb.Screw("screw", GROUND.point(0, 0), nut.point(0, 0), pitch=pitch)
    system = mb.System(nut, screw, mb.Gravity(0, 0, -9.81))
    run = mb.simulate(mb.Scene(system, {"nut.z": 0.0}, TIMES, {"angle": screw.angle, "z": nut.z}), TIGHT)
    lead = pitch / (2 * np.pi)
    alpha = -9.81 * lead / (0.02 + lead**2)
    assert_allclose(run["angle"], alpha * TIMES**2 / 2, rtol=1e-7, atol=1e-7)
    assert_allclose(run["z"], lead * run["angle"], rtol=1e-7, atol=1e-7)
    assert abs(run["angle"][-1]) > 10 * np.pi
    assert run.energy_drift < 1e-7


@pytest.mark.parametrize("pose", POSES, ids=repr)
def test_a_torsion_spring_winds_up_over_several_turns(pose):
    """J alpha'' = -k alpha - c alpha' from a spin that winds it by more than two turns."""
    spring = lambda m: mb.TorsionSpring("spring", GROUND, m.rod, 2.0, 0.1, 0.0, axis=axis_of(pose))  # noqa: E731
    run = turning(pose, spring).run(angle, TIMES, spin(pose, 40.0), solver=TIGHT)
    damping, frequency = 0.1, np.sqrt(2.0 / 0.5 - 0.1**2)
    assert_allclose(run["angle"], 40 / frequency * np.exp(-damping * TIMES) * np.sin(frequency * TIMES), atol=1e-7)
    assert run["angle"].max() > 4 * np.pi
    assert run.energy_drift < 1e-8


def test_a_drive_turns_a_hinge_through_several_turns():
    driven = turning(mb.Spatial(), lambda m: mb.Motion("drive", m.hinge.angle, 4 * mb.t**2), length=0.2)
    run = driven.run(angle, TIMES, solver=mb.CVODES(rtol=1e-11, stabilization=mb.Projection()))
    assert_allclose(run["angle"], 4 * TIMES**2, atol=1e-12)
    assert run.position_drift < 1e-12
    assert run.energy_drift < 1e-8
