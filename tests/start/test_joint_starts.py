"""Coordinates of joints in start and guess: forward kinematics as the oracle, on trees and in loops."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from faults import refused
from machines import GROUND, LINKS, gears, linkage, rods
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from test_start import started

import symmb as mb

AXES = ((0, 0, 1), (0, 1, 0), (0.3, 1, 0.2), (1, 0, 0), (0, 1, 0.4), (1, 0, 0))
REACH = ((0, 0, 0.3), (0.1, 0, 0.5), (0.4, 0.1, 0), (0.3, 0, 0), (0.2, 0, 0.1), (0.1, 0, 0))
ANGLES = (0.3, -2.9, 8.0, 3.1, -13.0, 1.0)
RATES = (0.5, -1.0, 2.0, 0.3, -0.7, 1.1)


def arm(backwards=False):
    """Six links on hinges with skew axes. Every second joint has its bodies the other way round if asked for."""
    p = mb.Parameters(first=ANGLES[0], rate=RATES[0], length=0.3)
    carrier, bodies, joints = GROUND.point(0, 0, 0), [], []
    for k, (axis, end) in enumerate(zip(AXES, REACH, strict=True)):
        link = mb.Body(f"link{k}", 1.0, (0.1, 0.2, 0.15), mb.Spatial(), com=(0.05, 0.0, 0.02))
        ends = (link.point(0, 0, 0), carrier) if backwards and k % 2 else (carrier, link.point(0, 0, 0))
        bodies, joints = [*bodies, link], [*joints, mb.Revolute(f"j{k}", *ends, axis=axis)]
        carrier = link.point(*end[:2], p.length if k == 0 else end[2])
    return mb.System(*bodies, *joints, mb.Gravity(0, 0, -9.81), parameters=p), p, joints, carrier


def forward(angles, length, signs=(1,) * 6):
    """Rotations of the links and the position of the tip."""
    R, r, rotations = Rotation.identity(), np.zeros(3), []
    for k, (axis, end, angle, sign) in enumerate(zip(AXES, REACH, angles, signs, strict=True)):
        R = R * Rotation.from_rotvec(sign * angle * np.array(axis) / np.linalg.norm(axis))
        r = r + R.apply((*end[:2], length if k == 0 else end[2]))
        rotations.append(R)
    return rotations, r


@pytest.mark.parametrize("backwards", [False, True])
def test_an_arm_with_all_angles_listed_needs_no_guess(backwards):
    system, p, joints, tip = arm(backwards)
    start = {f"j{k}.angle": angle for k, angle in enumerate(ANGLES)} | {"j0.angle": p.first}
    start |= {f"j{k}.angle_rate": rate for k, rate in enumerate(RATES)} | {"j0.angle_rate": p.rate}
    outputs = {f"a{k}": joint.angle for k, joint in enumerate(joints)}
    outputs |= {f"w{k}": joint.angle_rate for k, joint in enumerate(joints)}
    outputs |= {"x": tip.x, "y": tip.y, "z": tip.z, "vx": tip.vx, "vy": tip.vy, "vz": tip.vz}
    P = np.array([[ANGLES[0], RATES[0], 0.3], [-7.0, 1.5, 0.35]])  # more than half a turn from the nominal angle
    simulator = mb.DAESimulator(mb.Scene(system, start, np.linspace(0, 1e-3, 2), outputs), mb.DormandPrince())
    first = dict(zip(simulator.outputs, simulator.run(P).Y[:, 0].T, strict=True))
    signs = (1, -1, 1, -1, 1, -1) if backwards else (1,) * 6
    for i, (angle, rate, length) in enumerate(P):
        angles, rates = np.array((angle, *ANGLES[1:])), np.array((rate, *RATES[1:]))
        assert_allclose([first[f"a{k}"][i] for k in range(6)], angles, atol=1e-12)
        assert_allclose([first[f"w{k}"][i] for k in range(6)], rates, atol=1e-12)
        assert_allclose([first[c][i] for c in "xyz"], forward(angles, length, signs)[1], atol=1e-12)
        h = 1e-5
        ahead, behind = (forward(angles + s * h * rates, length, signs)[1] for s in (1, -1))
        assert_allclose([first[f"v{c}"][i] for c in "xyz"], (ahead - behind) / (2 * h), atol=1e-8)


def test_derivatives_of_the_start_follow_listed_angles():
    system, p, _, _ = arm()
    start = {f"j{k}.angle": angle for k, angle in enumerate(ANGLES)} | {"j0.angle": p.first * p.length / 0.3}
    start |= {"j0.angle_rate": p.rate**2}
    prepared, _ = started(mb.Scene(system, start))
    p0, direction = np.array([ANGLES[0], RATES[0], 0.3]), np.array([[0.4, -1.0, 0.2]])
    jets = prepared.jets(p0, direction, 2)
    h = 1e-3
    x = [prepared.states(p0[None] + k * h * direction)[0] for k in range(-2, 3)]
    first = (x[0] - 8 * x[1] + 8 * x[3] - x[4]) / (12 * h)
    second = (-x[0] + 16 * x[1] - 30 * x[2] + 16 * x[3] - x[4]) / (12 * h**2) / 2
    assert_allclose(jets[1], first, atol=1e-9)
    assert_allclose(jets[2], second, atol=1e-6)


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
@pytest.mark.parametrize("key", ["start", "guess"])
@pytest.mark.parametrize("angle", [2.0, 7.0, -15.0])
def test_whole_turns_count(pose, key, angle):
    """A gear with a second wheel shows the turns: its angle is a third of the first one's."""
    wheels = gears(ratio=1 / 3, pose=pose)
    run = wheels.run({"a": wheels.A.angle, "b": wheels.B.angle}, [0.0], **{key: {"A.angle": angle}})
    atol = 1e-12 if key == "start" else 0.7 * abs(angle)  # a guess is met nearly, on its branch
    assert_allclose(run["a"][0], angle, atol=atol)
    assert_allclose(run["b"][0], run["a"][0] / 3, atol=1e-12)


def test_displacements_of_sliders_cylinders_and_screws():
    bodies = [mb.Body(n, 1.0, (1, 1, 1), mb.Spatial()) for n in "abc"]
    axis = np.array((1.0, 2.0, -1.0))
    unit = axis / np.linalg.norm(axis)
    slide = mb.Prismatic("slide", GROUND.point(0.1, 0, 0), bodies[0].point(0, 0.2, 0), axis=(1, 2, -1))
    tube = mb.Cylindrical("tube", bodies[0].point(0, 0, 0), bodies[1].point(0, 0, 0.1), axis=(0, 0, 1))
    screw = mb.Screw("screw", bodies[1].point(0, 0, 0), bodies[2].point(0, 0, 0), axis=(0, 0, 1), pitch=0.2)
    start = {"slide.displacement": 0.7, "slide.displacement_rate": -0.4, "tube.angle": 4.0, "tube.displacement": -0.3}
    start |= {"tube.angle_rate": 1.0, "tube.displacement_rate": 0.5, "screw.angle": -20.0, "screw.angle_rate": 3.0}
    outputs = {"at": screw.angle, "d": screw.displacement, "v": screw.displacement_rate, "x": bodies[0].x}
    outputs |= {"tube": tube.angle, "y": bodies[0].y, "z": bodies[0].z}
    run = mb.simulate(mb.Scene(mb.System(*bodies, slide, tube, screw), start, outputs=outputs))
    assert_allclose([run[c][0] for c in "xyz"], np.array((0.1, -0.2, 0)) + 0.7 * unit, atol=1e-13)
    assert_allclose([run["tube"][0], run["at"][0]], [4.0, -20.0], atol=1e-13)
    assert_allclose((run["d"][0], run["v"][0]), np.array((-20.0, 3.0)) * 0.2 / (2 * np.pi), atol=1e-13)


def test_flexible_bodies_are_placed_by_their_nodes():
    steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=4)
    bars = [mb.FlexibleBody(n, mb.FiniteElements.beams(beam).modes(count=2)) for n in "ab"]
    first = mb.Revolute("first", GROUND.point(0, 0), bars[0].point(0, 0, 0))
    second = mb.Revolute("second", bars[0].point(1, 0, 0), bars[1].point(0, 0, 0), axis=(0, 1, 0))
    start = {"first.angle": 2.5, "second.angle": -9.0}
    tip = bars[1].point(1, 0, 0)
    outputs = {"x": tip.x, "y": tip.y, "z": tip.z, "a": second.angle}
    run = mb.simulate(mb.Scene(mb.System(*bars, first, second), start, outputs=outputs))
    about_z, about_y = Rotation.from_euler("z", 2.5), Rotation.from_euler("y", -9.0)
    expected = about_z.apply((1, 0, 0)) + (about_z * about_y).apply((1, 0, 0))
    assert_allclose([run[c][0] for c in "xyz"], expected, atol=1e-12)
    assert_allclose(run["a"][0], -9.0, atol=1e-12)


def four_bar(pose=None, **more):
    """Crank 1, coupler 2, rocker 1.5, base 2; the joint at the coupler's end closes the loop."""
    return linkage(
        pose=pose or mb.Planar(), closing=mb.Spherical if isinstance(pose, mb.Spatial) else mb.Revolute, **more
    )


def closures(a):
    """Both angles (b, d) of the four-bar at the crank's angle a."""
    B = np.array([np.cos(a), np.sin(a)])
    to = np.array([2.0, 0.0]) - B
    length, direction = np.hypot(*to), np.arctan2(to[1], to[0])
    inner = np.arccos((4 + length**2 - 2.25) / (4 * length))
    for sign in (1, -1):
        b = direction + sign * inner
        C = B + 2 * np.array([np.cos(b), np.sin(b)])
        yield b - a, np.arctan2(C[1], C[0] - 2)


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
@pytest.mark.parametrize("branch", [0, 1])
@pytest.mark.parametrize("hint", ["B", "D"])
def test_a_guessed_angle_picks_the_branch_of_a_loop(pose, branch, hint):
    bars, (b, d) = four_bar(pose), [*closures(0.8)][branch]
    outputs = {joint.name: joint.angle for joint in bars.joints[:3]}
    guess = {f"{hint}.angle": (b if hint == "B" else d) + 0.2}
    run = bars.run(outputs, [0.0], {"A.angle": 0.8}, guess=guess)
    for name, expected in (("A", 0.8), ("B", b), ("D", d)):
        assert_allclose(np.angle(np.exp(1j * (run[name][0] - expected))), 0, atol=1e-12)


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
def test_one_listed_rate_turns_the_whole_loop(pose):
    bars, (b, d) = four_bar(pose), next(closures(0.8))
    outputs, start = {joint.name: joint.angle_rate for joint in bars.joints[:3]}, {"A.angle": 0.8, "A.angle_rate": 1.3}
    run = bars.run(outputs, [0.0], start, guess={"B.angle": b, "D.angle": d})
    h = 1e-5
    (b1, d1), (b0, d0) = next(closures(0.8 + h)), next(closures(0.8 - h))
    slopes = (1.0, (b1 - b0) / (2 * h), (d1 - d0) / (2 * h))
    assert_allclose([run[name][0] for name in "ABD"], 1.3 * np.array(slopes), atol=1e-8)


def test_a_listed_rate_of_a_joint_far_from_the_ground():
    """The rate of the last joint alone: all before it are at rest."""
    system, _, joints, _ = arm()
    start = {f"j{k}.angle": angle for k, angle in enumerate(ANGLES)} | {"j5.angle_rate": 2.0}
    outputs = {f"w{k}": joint.angle_rate for k, joint in enumerate(joints)}
    run = mb.simulate(mb.Scene(system, start, outputs=outputs))
    assert_allclose(run.values[0], [0, 0, 0, 0, 0, 2.0], atol=1e-12)


def test_an_angle_may_be_listed_in_an_equilibrium():
    """Two hanging rods; the first is held at 0.5 by its listed angle, the second hangs straight down."""
    pair = rods(2)
    outputs = {hinge.name: hinge.angle for hinge in pair.hinges}
    run = pair.run(outputs, [0.0], {"hinge0.angle": 0.5}, equilibrium=True)
    assert_allclose(run.values[0], [0.5, -0.5], atol=1e-9)


def test_consistent_values_may_be_listed_twice():
    b, d = next(closures(0.8))
    start = {"A.angle": 0.8, "B.angle": b, "D.angle": d, "crank.theta": 0.8, "A.angle_rate": 1.0, "crank.omega": 1.0}
    assert_allclose(four_bar().run(times=[0.0], start=start)["crank.theta"], 0.8, atol=1e-12)


@pytest.mark.parametrize("order", [1, -1])
def test_a_guessed_rotation_stays_and_carries_the_body_on_a_listed_angle(order):
    first, second = (mb.Body(n, 1.0, (0.1, 0.2, 0.15), mb.Spatial()) for n in ("first", "second"))
    ball = mb.Spherical("ball", GROUND.point(0, 0, 0), first.point(-0.5, 0, 0))
    hinge = mb.Revolute("hinge", first.point(0.5, 0, 0), second.point(0, 0, 0), axis=(0, 1, 0))
    system = mb.System(*[first, second][::order], ball, hinge)
    guess = {"first.rotation": mb.rotation((1, 2, 3), 2.0)}
    start = mb.DAESimulator(mb.Scene(system, {"hinge.angle": 2.5}, guess=guess), mb.DormandPrince()).start
    q = dict(zip(start.dae.q_names, start.q_nominal, strict=True))
    carrier = Rotation.from_rotvec(2.0 * np.array((1, 2, 3)) / np.sqrt(14))
    for name, R in (("first", carrier), ("second", carrier * Rotation.from_euler("y", 2.5))):
        found = Rotation.from_quat([q[f"{name}.e{k}"] for k in (1, 2, 3, 0)])
        assert_allclose(found.as_matrix(), R.as_matrix(), atol=1e-12)


CONTRADICTING = {
    "start violates Phi = 0.*Remove": {"A.angle": 0.8, "B.angle": 1.5, "D.angle": 1.0},
    "listed A.angle. Remove one of A.angle, crank.theta": {"A.angle": 0.8, "crank.theta": 0.9},
    "velocities contradict the constraints: .*Remove one of A.angle_rate, D.angle_rate from start": {
        "A.angle": 0.8, "A.angle_rate": 1.0, "D.angle_rate": 4.0,
    },
}  # fmt: skip
WRONG = {
    "no coordinate or velocity 'A.angel'. Did you mean 'A.angle'": {"A.angel": 0.8},
    "Revolute 'A' has no displacement. This joint does not slide": {"A.displacement": 1.0},
    "start 'A.angle': 'up' is not a number": {"A.angle": "up"},
    "start 'A.angle': the value may depend on parameters only": {"A.angle": mb.t},
}


@pytest.mark.parametrize("text", CONTRADICTING | WRONG)
def test_faults_name_the_joint(text):
    error = mb.AssemblyError if text in CONTRADICTING else mb.DeclarationError
    refused(text, lambda: mb.DAESimulator(four_bar().scene(start=(CONTRADICTING | WRONG)[text])), error=error)


def test_rates_of_joints_need_no_guess():
    refused("guess: velocities need no guess", four_bar().scene, guess={"A.angle_rate": 1.0})


def test_samples_that_contradict_the_constraints_fail():
    """The rocker's angle is consistent at the nominal parameter only."""
    bars, (_, d) = four_bar(angle=0.8), next(closures(0.8))
    scene = bars.scene(start={"A.angle": bars.p.angle, "D.angle": d}, guess={"B.angle": 0.1})
    simulator = mb.DAESimulator(scene, mb.DormandPrince())
    P = np.array([[*bars.p.values()][:-1] + [angle] for angle in (0.8, 0.9)])
    _, reasons = simulator.start.states(P)
    assert reasons[0] == "" and "could not be computed" in reasons[1]
    assert simulator.run(P).ok.tolist() == [True, False]


def test_pickled_scenes_start_alike():
    bars = four_bar(mb.Spatial())
    scene = bars.scene({"a": bars.A.angle}, [0.0], {"A.angle": 7.0}, guess={"B.angle": 0.3})
    again = pickle.loads(pickle.dumps(scene))
    assert np.array_equal(mb.simulate(again).values, mb.simulate(scene).values)
    assert_allclose(mb.simulate(again)["a"], 7.0, atol=1e-12)


def test_the_printed_start_tells_listed_joints():
    assert "A.angle" in str(four_bar().run(None, [0.0], {"A.angle": 0.8}, guess={"B.angle": 0.3}))


def test_coordinates_of_bodies_and_of_joints_go_together():
    """The crank's angle by its body, the branch by the rocker's hinge."""
    bars, (b, d) = four_bar(), [*closures(0.8)][1]
    run = bars.run({"b": bars.B.angle}, [0.0], {"crank.theta": 0.8}, guess={"D.angle": d})
    assert_allclose(np.angle(np.exp(1j * (run["b"][0] - b))), 0, atol=1e-12)


def test_springs_and_gears_count_the_turns_of_listed_angles():
    """A spring between the ground and the second link of two on parallel hinges winds by the sum of their angles."""
    links = [mb.Body(n, 1.0, (1, 1, 1), mb.Spatial()) for n in "ab"]
    first = mb.Revolute("first", GROUND.point(0, 0), links[0].point(0, 0))
    second = mb.Revolute("second", links[0].point(1, 0), links[1].point(0, 0), axis=(0, 0, -1))
    spring = mb.TorsionSpring("spring", GROUND, links[1], 2.0)
    turned = mb.Actuator("motor", second, 3.0 * second.angle)
    system = mb.System(*links, first, second, spring, turned)
    run = mb.simulate(mb.Scene(system, {"first.angle": 12.0, "second.angle": 5.0}))
    assert_allclose(run.energy.potential[0], (12.0 - 5.0) ** 2, atol=1e-10)


LONG = (False, -3, -0.4668), (False, 2, -2.9), (True, 2, -2.5), (True, -1, 0.5)


@pytest.mark.parametrize(
    ("is_driven", "turns", "begin"),
    [(False, 1, 3.0), (True, 0, 4.2), *(pytest.param(*case, marks=pytest.mark.long) for case in LONG)],
)
def test_angles_and_drives_beyond_half_a_turn_keep_the_assembly_of_loops(is_driven, turns, begin):
    """A crank that is turned by whole turns is where it was. The assembly is that of the guess, in closed form.

    The angle is listed; or the law of a drive is there when it starts, and the guess has the rotation alone.
    """
    a, side = (0.4, -1) if is_driven else (0.45, 1)
    foot, angle = np.array([0.95, 0.0]), begin + 2 * np.pi * turns
    drive = [lambda m: mb.Motion("drive", m.A.angle, angle + 2 * mb.t)] if is_driven else []
    bars = linkage(*drive, lengths=(a, 0.9, 0.9, 0.95), inertia=0.05, g=9.81, pose=mb.Spatial())
    pin = a * np.array([np.cos(begin), np.sin(begin)])
    apart = foot - pin
    across, half = np.array([-apart[1], apart[0]]) / np.linalg.norm(apart), np.linalg.norm(apart) / 2
    tip = pin + apart / 2 + side * np.sqrt(0.9**2 - half**2) * across
    angles = (begin, np.arctan2(*(tip - pin)[::-1]), np.arctan2(*(tip - foot)[::-1]))
    middles = (pin / 2, (pin + tip) / 2, (foot + tip) / 2)
    guess = {f"{name}.rotation": mb.rotation((0, 0, 1), at) for name, at in zip(LINKS, angles, strict=True)}
    guess |= {f"{name}.{axis}": at[k] for name, at in zip(LINKS, middles, strict=True) for k, axis in enumerate("xy")}
    start = {} if is_driven else {"A.angle": angle, "A.angle_rate": -1.4}
    outputs = {"x": bars.coupler.x, "y": bars.coupler.y, "turned": bars.A.angle}
    scene = bars.scene(outputs, [0.0, 0.05], start, guess=guess, box=mb.Box(b=(0.899, 0.901)))
    for coordinates in ("body", "joint") if is_driven else (None,):
        own = replace(scene, coordinates=coordinates)
        study = mb.propagate(own, mb.Vertex())
        for at in (study.lower[0], study.upper[0], mb.simulate(own).values[0]):
            np.testing.assert_allclose(at, [*middles[1], angle], atol=2e-3)
