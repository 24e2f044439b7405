"""Reactions against statics by hand: on the second body, at the joint's point there, in world axes."""

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import GROUND, gears, pendulum, run_of
from numpy.testing import assert_allclose

import symmb as mb

G = 9.81


def reaction(system, name, start=None, guess=None, times=(0.0,), **more):
    scene = mb.Scene(system, start=start or {}, guess=guess or {}, times=times)
    force, torque = mb.simulate(scene, **more).reaction(name)
    return force[-1], torque[-1]


def beam(pose):
    return mb.Body("beam", 2.0, 0.3 if isinstance(pose, mb.Planar) else (0.1, 0.2, 0.3), pose)


signs = pytest.mark.parametrize("sign", [1, -1], ids=["ground first", "ground second"])
poses = pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)


@signs
@poses
def test_cantilever_in_the_plane(pose, sign):
    """Clamped 1 m left of the centre of mass; weight there, a force at the tip, a torque."""
    b = beam(pose)
    ends = (GROUND.point(0.5, 0.25), b.point(-1, 0))[::sign]
    loads = mb.Gravity(0, -G), mb.Force("tip", b.point(1, 0), (3, 5)), mb.Torque("twist", b, 0.7)
    force, torque = reaction(mb.System(b, mb.Weld("clamp", *ends), *loads), "clamp")
    assert_allclose(force, sign * np.array([-3, 2 * G - 5, 0]), atol=1e-12)
    assert_allclose(torque, sign * np.array([0, 0, 2 * G - 2 * 5 - 0.7]), atol=1e-12)


@signs
def test_cantilever_in_space(sign):
    """The beam's x axis stands along the world's z: centre of mass 1 m above the clamp, tip 2 m above it."""
    b = beam(mb.Spatial())
    ends, axes = (GROUND.point(0.5, 0.25, -2), b.point(-1, 0, 0)), ((0, 0, 1), (1, 0, 0))
    clamp = mb.Weld("clamp", *ends[::sign], *axes[::sign])
    f, tau, weight = np.array([3.0, 5.0, -7.0]), np.array([0.1, -0.2, 0.4]), np.array([0.5, 0.0, -2 * G])
    loads = mb.Force("tip", b.point(1, 0), tuple(f)), mb.Torque("twist", b, tuple(tau))
    system = mb.System(b, clamp, mb.Gravity(0.25, 0, -G), *loads)
    force, torque = reaction(system, "clamp", {"beam.rotation": mb.rotation((0, 1, 0), -np.pi / 2)})
    by_hand = -(np.cross([0, 0, 1], weight) + np.cross([0, 0, 2], f) + tau)
    assert_allclose(force, -sign * (f + weight), atol=1e-12)
    assert_allclose(torque, sign * by_hand, atol=1e-12)


@signs
@poses
def test_a_carriage_off_its_guide_s_point(pose, sign):
    """Loads across the guide: the moment is taken where the second body's own point is."""
    b = beam(pose)
    guide = mb.Prismatic("guide", *(GROUND.point(0, 0), b.point(0.1, 0))[::sign], axis=(1, 0, 0))
    system = mb.System(b, guide, mb.Gravity(0, -G), mb.Force("push", b.point(0.4, 0.2), (0, -6)))
    force, torque = reaction(system, "guide", {"beam.x": 1.5})
    assert_allclose(force, sign * np.array([0, 2 * G + 6, 0]), atol=1e-12)
    # The carriage's point is 0.1 m right of the centre of mass; the ground's is at the origin.
    weight_arm, push_arm = (-0.1, 0.3) if sign > 0 else (1.5, 1.9)
    assert_allclose(torque, sign * np.array([0, 0, weight_arm * 2 * G + push_arm * 6]), atol=1e-12)


def test_the_pull_in_a_rod_is_its_multiplier():
    """Two weights under each other: the upper rod carries both."""
    upper, lower = mb.Body("upper", 2.0, pose=mb.Particle()), mb.Body("lower", 3.0, pose=mb.Particle())
    rod1 = mb.Distance("rod1", GROUND.point(0, 0), upper.point(0, 0), 1.0)
    rod2 = mb.Distance("rod2", upper.point(0, 0), lower.point(0, 0), 0.5)
    trajectory = run_of(upper, lower, rod1, rod2, mb.Gravity(0, 0, -G), guess={"upper.z": -1, "lower.z": -1.5})
    assert_allclose(trajectory.lam[0], [5 * G, 3 * G])
    assert_allclose(trajectory.reaction("rod1")[0][0], [0, 0, 5 * G], atol=1e-12)
    assert_allclose(trajectory["rod2.lam[0]"], 3 * G)


def test_a_ball_joint_between_two_bodies_acts_on_the_second():
    """A bar hung from a clamped bracket: the bracket pulls it up, at its end, without a moment."""
    bracket, bar = beam(mb.Spatial()), mb.Body("bar", 4.0, (0.4, 0.01, 0.4), mb.Spatial())
    clamp = mb.Weld("clamp", GROUND.point(0, 0), bracket.point(0, 0))
    ball = mb.Spherical("ball", bracket.point(1, 0), bar.point(0, 0.5))
    system = mb.System(bracket, bar, clamp, ball, mb.Gravity(0, -G))
    upright = {"bar.rotation": mb.rotation((0, 0, 1), 0)}
    assert_allclose(reaction(system, "ball", upright), [[0, 4 * G, 0], [0, 0, 0]], atol=1e-12)
    assert_allclose(reaction(system, "clamp", upright), [[0, 6 * G, 0], [0, 0, 4 * G]], atol=1e-12)


def test_a_gear_hands_torque_on_by_its_ratio():
    """b turns -2 times as fast as a; in equilibrium the torques on a and b do no power: T_a - 2 T_b = 0."""
    torques = lambda m: (mb.Torque("drive", m.a, 6.0), mb.Torque("load", m.b, 3.0))  # noqa: E731
    trajectory = gears(torques, ratio=-2.0, inertias=(0.1, 0.1)).run()
    assert_allclose(trajectory.q, np.broadcast_to(trajectory.q[0], trajectory.q.shape), atol=1e-12)
    assert_allclose(trajectory.reaction("gear")[1][0], [0, 0, -3], atol=1e-12)


@poses
def test_a_rod_falling_from_level_pulls_by_five_halves_of_its_weight(pose):
    """Uniform rod released level: at an angle phi below it, 5/2 m g sin(phi) along and 1/4 m g cos(phi) across."""
    m, length = 1.7, 0.8
    machine = pendulum(length=length / 2, mass=m, inertia=m * length**2 / 12, pose=pose)
    trajectory, rod = machine.run(times=np.linspace(0, 0.5, 6), solver=mb.CVODES(rtol=1e-12)), machine.rod
    force, torque = trajectory.reaction("hinge")
    along = np.stack([trajectory(rod.rotation[0, 0]), trajectory(rod.rotation[1, 0])], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    sine, cosine = -along[:, 1], along[:, 0]
    assert sine[-1] > 0.9
    assert_allclose((force[:, :2] * along).sum(axis=1), -2.5 * m * G * sine, atol=1e-8)
    assert_allclose((force[:, :2] * across).sum(axis=1), m * G * cosine / 4, atol=1e-8)
    assert_allclose(torque, 0, atol=1e-10)


def test_an_unknown_joint_is_told():
    b = beam(mb.Planar())
    elbow = mb.Revolute("elbow", GROUND.point(0, 0), b.point(0, 0))
    system = mb.System(b, elbow, mb.Motion("drive", b.theta, mb.t))
    refused(r"no joint 'elbw' between two bodies\. Did you mean 'elbow'\?", system.reaction, "elbw")
    refused("no joint 'drive' between two bodies", system.reaction, "drive")
    refused(r"no constraint 'driv' with multipliers\. Did you mean 'drive'\?", system.lam, "driv")


def hung(k, arm, distance=0.5, reaction="fz"):
    """A frame on two hinges in a row, which carries a weight, in units of 1 / k metres."""
    frame = mb.Body("frame", 4.0, tuple(k**2 * i for i in (0.4, 0.1, 0.4)), mb.Spatial())
    lump = mb.Body("lump", 2.0, (0.01 * k**2,) * 3, mb.Spatial())
    ends = {"left": -distance * k, "right": distance * k}
    pins = [mb.Revolute(name, GROUND.point(0, y, 0), frame.point(0, y, arm * k), (0, 1, 0)) for name, y in ends.items()]
    weld = mb.Weld("weld", frame.point(0, 0.3 * k, 0), lump.point(0, 0, 0))
    system = mb.System(frame, lump, *pins, weld, mb.Gravity(0, 0, -9.81 * k))
    outputs = {name: getattr(system.reaction(name), reaction) / k for name in ends}
    outputs |= {"both": outputs["left"] + outputs["right"], "weld": system.reaction("weld").fz / k}
    return mb.Scene(system, {"left.angle": 0.0}, outputs=outputs)


@pytest.mark.parametrize(("arm", "distance"), [(0.4, 0.5), (0.1, 1.3)])
def test_least_reactions_do_not_depend_on_the_unit_of_length(arm, distance):
    """Each hinge takes moments too: outputs that depend on how they share the load are doubted, their sum is not."""
    with pytest.warns(mb.SymmbWarning, match="Outputs 'left', 'right' depend on how the redundant constraints"):
        run, other = (mb.simulate(hung(k, arm, distance)) for k in (1.0, 1000.0))
    assert_allclose(run.values, other.values, rtol=1e-8)
    assert_allclose(run["both"], 6 * 9.81, rtol=1e-9)
    assert run["left"][0] < run["right"][0] < run["both"][0]


# Forces of elements as outputs: what statics says of a body that hangs, lies or is held.

WEIGHT = 2.0 * 9.81


def hanging(element_of):
    block = mb.Body("block", 2.0, 0.1, mb.Planar())
    element = element_of(block)
    guide = mb.Prismatic("guide", GROUND.point(0, 0), block.point(0, 0), axis=(0, 1, 0))
    return mb.System(block, guide, element, mb.Gravity(0, -9.81))


LAW = mb.KelvinVoigt(1e4, 10.0)
HELD = {
    "spring": lambda b: mb.Spring("it", GROUND.point(0, 1), b.point(0, 0), 500.0, 0.9),
    "strut": lambda b: mb.SpringDamper("it", GROUND.point(0, 1), b.point(0, 0), 500.0, 20.0, 0.9),
    "nonlinear": lambda b: mb.NonlinearSpring("it", GROUND.point(0, 1), b.point(0, 0), lambda d, v: 200 * (d - 0.9)),
    "rope": lambda b: mb.Rope("it", [GROUND.point(0, 1), b.point(0, 0)], 500.0, 0.9),
    "plane": lambda b: mb.Contact("it", b.point(0, 0), GROUND.point(0, 0), (0, 1), LAW),
    "circles": lambda b: mb.CircleContact("it", GROUND.point(0, -0.3), b.point(0, 0), 0.2, 0.1, LAW),
    "curve": lambda b: mb.CurveContact(
        "it", GROUND.point(0, -0.1), mb.Curve(lambda s: (s, s**2), -1, 1), b.point(0, 0), 0.1, LAW
    ),
}


@pytest.mark.parametrize("name", HELD)
def test_a_block_at_rest_is_held_by_its_weight(name):
    system = hanging(HELD[name])
    scene = mb.Scene(system, guess={"block.y": -1e-3}, outputs={"force": system.force("it")}, equilibrium=True)
    assert abs(mb.simulate(scene)["force"][0] / WEIGHT - 1) < 1e-9


def test_a_damper_brakes_with_its_force():
    system = hanging(lambda b: mb.Damper("it", GROUND.point(0, 1), b.point(0, 0), 3.0))
    scene = mb.Scene(system, {"block.vy": -2.0}, outputs={"force": system.force("it")})
    assert mb.simulate(scene)["force"] == pytest.approx([6.0])


def test_torques():
    """A rod of 1 m at rest on a torsion spring, and a motor that gives what its law says."""
    spring = lambda m: mb.TorsionSpring("spring", GROUND, m.rod, 200.0, 1.0)  # noqa: E731
    rod = pendulum(spring, lambda m: mb.Actuator("motor", m.hinge, 2 + 3 * mb.t), length=0.5, mass=2.0)
    outputs = {name: rod.system.force(name) for name in ("spring", "motor")} | {"angle": rod.hinge.angle}
    scene = rod.scene(outputs, equilibrium=True)
    run = mb.simulate(scene)
    assert scene.units[:2] == ("N m", "N m")
    assert run["motor"] == pytest.approx([2.0, 5.0])
    assert run["spring"][0] + 2.0 == pytest.approx(0.5 * WEIGHT * np.cos(run["angle"][0]))


def test_a_slack_rope_and_an_open_contact_have_none():
    system = hanging(lambda b: mb.Rope("it", [GROUND.point(0, 1), b.point(0, 0)], 500.0, 1.1))
    run = mb.simulate(mb.Scene(system, times=[0.0, 0.1], outputs={"force": system.force("it")}))
    np.testing.assert_array_equal(run["force"], 0.0)


def test_forces_that_are_no_number_are_refused():
    block = mb.Body("block", 2.0, 0.1, mb.Planar())
    push = mb.Force("push", block.point(0, 0), (ca.sin(mb.t), 0))
    brake = mb.Clutch("brake", GROUND, block, 1.0)
    system = mb.System(block, push, brake, mb.Spring("spring", GROUND.point(0, 1), block.point(0, 0), 1.0))
    for name in ("push", "spnig", 3):
        refused(r"no element with a force .*spring", system.force, name)
    refused(r"the force of 'brake' is a multiplier\. Use system\.lam\('brake'\)", system.force, "brake")
