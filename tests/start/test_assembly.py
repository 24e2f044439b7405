"""Assembly along the joints without guesses, and advice that helps."""

import re
from functools import partial

import casadi as ca
import numpy as np
import pytest
from conftest import but_long
from faults import refused
from machines import GROUND, bob, gears, linkage, pendulum
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import symmb as mb

TURN = partial(mb.rotation, (0, 0, 1))
SEEDS = but_long(range(20), *range(6, 20))


def started(scene):
    return mb.DAESimulator(scene, mb.DormandPrince()).start


def assembled(scene):
    start = started(scene)
    return dict(zip(start.dae.q_names, start.nominal()["q"].tolist(), strict=True))


def closed_chain(seed):
    """Links with held angles from a pin on the ground, and two free links from their end to another pin, in any order.

    Returns the scene, the pins and middles of the held links, and the lengths of the free ones.
    """
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 4)
    at, pin = rng.normal(size=2) * 3, None
    pin, links, hinges, start, middles = GROUND.point(*at), [], [], {}, []
    for k in range(n):
        link, length, angle = mb.Body(f"link{k}", 1.0, 0.1), rng.uniform(0.3, 1.5), rng.uniform(-3, 3)
        hinges.append(mb.Revolute(f"hinge{k}", pin, link.point(-length / 2, 0)))
        along = length * np.array([np.cos(angle), np.sin(angle)])
        middles.append(at + along / 2)
        at, pin = at + along, link.point(length / 2, 0)
        start[f"link{k}.theta"] = angle
        links.append(link)
    end = at + rng.normal(size=2) * 1.5
    lengths = rng.uniform(0.55, 0.9, 2) * np.hypot(*(end - at))
    a, b = mb.Body("a", 1.0, 0.1), mb.Body("b", 1.0, 0.1)
    hinges += [
        mb.Revolute("knee", pin, a.point(-lengths[0] / 2, 0)),
        mb.Revolute("middle", a.point(lengths[0] / 2, 0), b.point(lengths[1] / 2, 0)),
        mb.Revolute("foot", GROUND.point(*end), b.point(-lengths[1] / 2, 0)),
    ]
    elements = [*links, a, b, *hinges]
    system = mb.System(*[elements[i] for i in rng.permutation(len(elements))])
    return mb.Scene(system, start), middles, (at, end), lengths


@pytest.mark.parametrize("seed", SEEDS)
def test_held_angles_and_pins_need_no_guess(seed):
    scene, middles, (at, end), lengths = closed_chain(seed)
    q = assembled(scene)
    assert_allclose([[q[f"link{k}.x"], q[f"link{k}.y"]] for k in range(len(middles))], middles, atol=1e-9)
    along = [np.array([np.cos(q[f"{name}.theta"]), np.sin(q[f"{name}.theta"])]) for name in "ab"]
    assert_allclose(at + lengths[0] * along[0], end + lengths[1] * along[1], atol=1e-9)
    assert_allclose([q["a.x"], q["a.y"]], at + lengths[0] / 2 * along[0], atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_guessed_angles_choose_the_side_of_cylinders(seed):
    """An arm as of an excavator: each link on a pin, and on a cylinder whose length two angles satisfy."""
    rng = np.random.default_rng(seed)
    carrier, carrier_at, carrier_turn, pin_at = GROUND, np.zeros(2), 0.0, np.array([0.3, -0.2])
    elements, true, guess = [], {}, {}
    for k in range(3):
        link, angle, side = mb.Body(f"link{k}", 1.0, 0.1), rng.uniform(-2, 2), rng.choice([-1, 1])
        turn, turn_carrier = (Rotation.from_euler("z", a).as_matrix()[:2, :2] for a in (angle, carrier_turn))
        middle = carrier_at + turn_carrier @ pin_at + turn @ [1.0, 0]
        head = middle + turn @ [-0.5, 0.3]
        # The cylinder stands across the lever from the pin to its head, on either side.
        lever = head - (carrier_at + turn_carrier @ pin_at)
        foot = turn_carrier.T @ (head + side * 1.5 * np.array([-lever[1], lever[0]]) - carrier_at)
        length = float(np.linalg.norm(carrier_at + turn_carrier @ foot - head))
        elements += [
            link,
            mb.Distance(f"cylinder{k}", carrier.point(*foot), link.point(-0.5, 0.3), length),
            mb.Revolute(f"pin{k}", carrier.point(*pin_at), link.point(-1.0, 0)),
        ]
        true[f"link{k}.theta"], guess[f"link{k}.theta"] = angle, angle + rng.uniform(-0.3, 0.3)
        carrier, carrier_at, carrier_turn, pin_at = link, middle, angle, np.array([1.0, 0])
    q = assembled(mb.Scene(mb.System(*elements), guess=guess))
    assert_allclose([q[name] for name in true], list(true.values()), atol=1e-6)


def test_a_pinned_body_is_not_turned_where_nothing_asks_for_it():
    arm = mb.Body("arm", 1.0, 0.1)
    q = assembled(mb.Scene(mb.System(arm, mb.Revolute("pin", GROUND.point(3, 4), arm.point(-0.5, 0.2)))))
    assert_allclose([q["arm.x"], q["arm.y"], q["arm.theta"]], [3.5, 3.8, 0], atol=1e-14)


def test_a_guessed_position_turns_a_pinned_body():
    q = assembled(pendulum(g=None).scene(guess={"rod.x": 0.6, "rod.y": 0.8}))
    assert np.arctan2(q["rod.y"], q["rod.x"]) == pytest.approx(q["rod.theta"]) and q["rod.theta"] > 0.3


ROD = partial(pendulum, length=0.5, g=None)
UNASSEMBLED = {
    "one coordinate": lambda: ROD().scene(start={"rod.x": 0.4}),
    "a coordinate and an angle": lambda: ROD().scene(start={"rod.y": 0.2, "rod.theta": 1.0}),
    "all": lambda: ROD().scene(start={"rod.y": 0.2, "rod.x": -0.1, "rod.theta": 1.0}),
    "loop": lambda: linkage(lengths=(0.3, 0.9, 0.7, 1.0)).scene(start={"crank.theta": 0.0}),
    "flipped": lambda: ROD(pose=mb.Spatial(), axis=(1, 0, 0)).scene(guess={"rod.rotation": TURN(3.0)}),
    "rope": lambda: bob(length=2.0, g=None).scene(),
}


@pytest.mark.parametrize("case", UNASSEMBLED)
def test_the_advice_of_a_failed_assembly_helps(case):
    scene = UNASSEMBLED[case]()
    text = refused(None, assembled, scene, error=mb.AssemblyError)
    tried = 0
    for guess in re.findall(r"guess=(\{.*\})", text):
        assembled(mb.Scene(scene.system, scene.start, guess={**scene.guess, **eval(guess, {"rotation": mb.rotation})}))
        tried += 1
    for together, single in re.findall(r"[Rr]emove (?:(\S+ and \S+)|(?:one of )?(.*?)) from start", text):
        for keys in [together.split(" and ")] if together else [[key] for key in single.split(", ")]:
            assembled(mb.Scene(scene.system, {k: v for k, v in scene.start.items() if k not in keys}))
            tried += 1
    assert tried


def test_what_cannot_be_assembled_says_so():
    told = r"residual is 0\.\d+ in joint '.'\. Other guesses and fewer"
    refused(told, assembled, linkage(lengths=(1.0, 1.0, 1.0, 4.0)).scene(), error=mb.AssemblyError)


@pytest.mark.parametrize("angle", [0.5, np.pi, 3.5, 7.0, -20.0])
@pytest.mark.parametrize("listed", [False, True])
@pytest.mark.parametrize("solver", [None, pytest.param(mb.DormandPrince(), marks=pytest.mark.long)], ids=repr)
def test_drives_of_angles_beyond_half_a_turn_start(angle, listed, solver):
    rod = ROD(lambda m: mb.Motion("drive", m.hinge.angle, m.p.angle + mb.t), pose=mb.Spatial(), angle=angle)
    start = {"rod.rotation": TURN(rod.p.angle)} if listed else {}
    scene = rod.scene({"angle": rod.hinge.angle, "y": rod.body.y}, np.linspace(0, 1, 5), start)
    run, simulator = mb.simulate(scene, solver), mb.DAESimulator(scene, mb.DormandPrince())
    assert_allclose(run["y"], 0.5 * np.sin(angle + scene.times), atol=1e-8)
    sample = simulator.run(np.tile(simulator.dae.p_nominal, (2, 1)))
    assert_allclose([run["angle"], sample.Y[1, :, 0]], [angle + scene.times] * 2, atol=1e-8)


@pytest.mark.parametrize("angle", [0.5, 2.0, -3.0])
def test_gears_turn_more_than_once_at_the_start(angle):
    pair = gears(ratio=3.0, inertias=(0.1, 0.2), pose=mb.Spatial())
    start = {"a.rotation": mb.rotation((0, 0, 1), angle), "a.omega": (0, 0, 1.0)}
    run = pair.run({"sin": pair.b.rotation[1, 0]}, np.linspace(0, 1, 5), start)
    assert_allclose(run["sin"], np.sin(3 * (angle + run.t)), atol=1e-8)


@pytest.mark.parametrize("angle", but_long([1.6, 2.0, -2.5, 3.14, 4.0], 2.0, 3.14, 4.0))
@pytest.mark.parametrize("listed", ["a", "b"])
@pytest.mark.parametrize("kind", ["Weld", "Prismatic"])
@pytest.mark.parametrize("pose", [mb.Planar, mb.Spatial])
def test_bodies_that_a_joint_locks_parallel_follow_a_rotation_beyond_a_right_angle(pose, kind, listed, angle):
    flat = pose is mb.Planar
    a, b = (mb.Body(name, 1.0, 0.1 if flat else (0.1, 0.1, 0.1), pose()) for name in "ab")
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), a.point(-0.5, 0))
    more = {} if kind == "Weld" else {"axis": (1, 0, 0)}
    lock = getattr(mb, kind)("lock", b.point(-0.2, 0), a.point(0.5, 0), **more)
    start = {f"{listed}.theta": angle} if flat else {f"{listed}.rotation": mb.rotation((0, 0, 1), angle)}
    place = {"y": 0.5 * np.sin(angle)} if kind == "Weld" else {}
    q = assembled(mb.Scene(mb.System(a, b, hinge, lock), start))
    for body in "ab":
        turned = np.cos(q[f"{body}.theta"] - angle) if flat else abs(q[f"{body}.e0"] / np.cos(angle / 2))
        assert turned == pytest.approx(1)
    assert (q["a.x"], q["a.y"]) == pytest.approx((0.5 * np.cos(angle), 0.5 * np.sin(angle)), abs=1e-9)
    assert not place or q["b.y"] == pytest.approx(1.2 * np.sin(angle), abs=1e-9)


@pytest.mark.parametrize("turn", [1.7, 2.2, 3.0])
def test_hinges_follow_the_axis_of_a_carrier_that_is_turned_far(turn):
    a, b = (mb.Body(name, 1.0, (0.1, 0.1, 0.1), mb.Spatial()) for name in "ab")
    ball = mb.Spherical("ball", GROUND.point(0, 0, 0), a.point(-0.5, 0, 0))
    hinge = mb.Revolute("hinge", a.point(0.5, 0, 0), b.point(-0.5, 0, 0))
    scene = mb.Scene(mb.System(a, b, ball, hinge), {"a.rotation": mb.rotation((1, 0.2, 0), turn)}, times=[0, 1])
    start = started(scene)
    assert start.dae.assembly_cosines(start.q_nominal, []).full().min() == pytest.approx(1)


def test_a_motor_that_contradicts_the_start_is_named():
    angle, x, theta = lambda m: m.hinge.angle, lambda m: m.rod.x, lambda m: m.rod.theta
    for told, start, *drives in (
        (r"hinge\.angle_rate differs by 1 from the value of 'drive0'", {"hinge.angle_rate": 1.0}, (angle, 2 * mb.t)),
        ("in joint 'hinge', against the drive of 'drive0'", {"rod.theta": 0.0, "rod.y": 0.2}, (x, 0.9 + mb.t)),
        ("constraints 'drive0', 'drive1' contradict", {}, (theta, mb.t), (theta, 2 * mb.t)),
    ):
        motors = [lambda m, k=k, d=d: mb.Motion(f"drive{k}", d[0](m), d[1]) for k, d in enumerate(drives)]
        refused(told, started, ROD(*motors).scene(start=start), error=mb.AssemblyError)


def test_a_planar_joint_reminds_that_normals_stay_parallel():
    """A rod that leans by 0.3 cannot stand on a plane by a PlanarJoint; a point of it can, by a Motion."""
    rod = mb.Body("rod", 1.0, (0.01, 0.01, 0.01), mb.Spatial())
    foot, start = rod.point(0, 0, -0.25), {"rod.rotation": mb.rotation((1, 0, 0), 0.3)}
    plate = mb.PlanarJoint("plate", GROUND.point(0, 0, 0), foot, axis=(0, 0, 1))
    scene = mb.Scene(mb.System(rod, plate), start)
    refused("also keeps its normals parallel. Motion", mb.simulate, scene, error=mb.AssemblyError)
    run = mb.simulate(mb.Scene(mb.System(rod, mb.Motion("plate", foot.z, 0)), start, outputs={"z": rod.z}))
    assert run["z"][0] == pytest.approx(0.25 * np.cos(0.3))


INERTIA = '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'


def nearly_square_chain(seed, way, folder):
    """A chain of one to six hinges and slides, each turned by a right angle but for 1e-15 to 1e-6 rad.

    Returns its elements, its joints, their values and their turns at zero.
    """
    rng = np.random.default_rng(seed)
    bodies, joints, values, turns, urdf = [GROUND], [], [], [], '<robot name="chain"><link name="b"/>'
    for k in range(rng.integers(1, 7)):
        angle = rng.choice([-1, 1, 2]) * np.pi / 2 + rng.choice([-1, 1]) * 10 ** rng.uniform(-15, -6)
        side, at, slides = np.eye(3)[rng.integers(2)], rng.uniform(-0.3, 0.3, 3), rng.random() < 0.3
        turns.append(Rotation.from_rotvec(angle * side))
        values.append(rng.uniform(-1, 1))
        zero = {"zero": mb.rotation(axis=tuple(side), angle=angle), "axis_b": tuple(turns[k].inv().apply((0, 0, 1)))}
        bodies.append(mb.Body(f"b{k}", 1.0, (0.01, 0.02, 0.02), mb.Spatial()))
        points = bodies[k].point(*at), bodies[k + 1].point(0, 0, 0)
        kind = mb.Prismatic if slides else mb.Revolute
        joints.append(kind(f"j{k}", *points, axis=(0, 0, 1), **({way: zero[way]} if way in zero else {})))
        place = f'xyz="{" ".join(map(repr, at.tolist()))}" rpy="{" ".join(map(repr, (angle * side).tolist()))}"'
        urdf += f"""<link name="b{k}"><inertial><mass value="1"/>{INERTIA}</inertial></link>
            <joint name="j{k}" type="{"prismatic" if slides else "continuous"}"><parent link="b{k - 1 if k else ""}"/>
            <child link="b{k}"/><axis xyz="0 0 1"/><origin {place}/><limit lower="-9" upper="9"/></joint>"""
    if way == "rpy":
        (folder / "chain.urdf").write_text(urdf + "</robot>")
        robot = mb.load_urdf(folder / "chain.urdf")
        return robot.elements, [*robot.joints.values()], values, turns
    return (*bodies[1:], *joints), joints, values, turns


@pytest.mark.parametrize("way", ["zero", "axis_b", "rpy"])
@pytest.mark.parametrize("seed", but_long(range(12), *range(3, 12)))
def test_axes_that_are_nearly_square_start(seed, way, tmp_path):
    """Rows that nearly vanish where nothing is assembled got scales of 1e-12, and rounding was a violation."""
    elements, joints, values, turns = nearly_square_chain(seed, way, tmp_path)
    handles = {f"{joint.name}.{joint.coordinate}": value for joint, value in zip(joints, values, strict=True)}
    outputs = {name: getattr(joint, joint.coordinate) for name, joint in zip(handles, joints, strict=True)}
    for k, joint in enumerate(joints):
        (A, B), gap = joint.frames, joint.point_b.r - joint.point_a.r
        gap -= A[:, 2] * outputs[f"j{k}.displacement"] if joint.coordinate == "displacement" else 0
        outputs |= {f"gap{k}": ca.norm_2(gap), f"tilt{k}": ca.norm_2(A[:, 2] - B[:, 2])}
    outputs["R"] = joints[-1].point_b.body.frame.R
    system = mb.System(*elements)
    simulator = mb.DAESimulator(mb.Scene(system, handles), mb.DormandPrince())
    turned = [state.sx for joint in joints for state in joint.turn_states]
    evaluate = ca.Function("f", [system.q, ca.vertcat(*turned)], [*outputs.values()])
    found = dict(zip(outputs, evaluate(simulator.start.nominal()["q"], 0), strict=True))
    assert_allclose([float(found[name]) for name in handles], values, atol=1e-12)
    assert max(abs(float(found[f"{what}{k}"])) for what in ("gap", "tilt") for k in range(len(joints))) < 1e-12
    states, failures = simulator.formulation.start.states(simulator.dae.p_nominal[None])
    assert simulator.coordinates == "joint" and not failures[0]
    assert_allclose(states[0, : len(joints)], values, atol=1e-12)
    if way != "axis_b":  # the turn of a file comes before that of its joint
        R = Rotation.identity()
        for joint, value, turn in zip(joints, values, turns, strict=True):
            own = Rotation.from_rotvec([0, 0, value * (joint.coordinate == "angle")])
            R = R * (own * turn if way == "zero" else turn * own)
        assert_allclose(np.asarray(found["R"]), R.as_matrix(), atol=1e-12)
