"""Machines from URDF files: where links are, what they weigh, and what joints do. Oracles are written out here."""

import warnings
from pathlib import Path
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import run_of
from numpy.testing import assert_allclose
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

import symmb as mb

FILES = Path(__file__).parents[1] / "data" / "urdf"
NAMES = sorted(path.stem for path in FILES.glob("*.urdf"))
ROD = """
<inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial>
"""


def load(tmp_path, text, **options):
    path = tmp_path / "machine.urdf"
    path.write_text(f'<robot name="machine">{text}</robot>')
    return mb.load_urdf(path, **options)


def joint(name, kind, parent, child, inside=""):
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def arm(name="hinge", inside="", kind="continuous", inertial=ROD):
    """A link `arm` on a link `base`."""
    return f'<link name="base"/><link name="arm">{inertial}</link>' + joint(name, kind, "base", "arm", inside)


def numbers(element, attribute, default="0 0 0"):
    return np.array((default if element is None else element.get(attribute, default)).split(), dtype=float)


def transform(xyz, R):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, xyz
    return T


def origin(element):
    at = element.find("origin")
    return transform(numbers(at, "xyz"), Rotation.from_euler("xyz", numbers(at, "rpy")).as_matrix())


def forward_kinematics(path, values):
    """Homogeneous transforms (4, 4) of all links for values of joints, by the definition of the format."""
    joints = ElementTree.parse(path).findall("joint")
    children = {j.find("child").get("link") for j in joints}
    places = {j.find("parent").get("link"): np.eye(4) for j in joints if j.find("parent").get("link") not in children}
    while len(places) < len(joints) + 1:
        for j in joints:
            parent, child = j.find("parent").get("link"), j.find("child").get("link")
            if parent not in places:
                continue
            axis = numbers(j.find("axis"), "xyz", "1 0 0")
            axis, value = axis / np.linalg.norm(axis), values.get(j.get("name"), 0.0)
            turns = j.get("type") in ("revolute", "continuous")
            slide = value * axis if j.get("type") == "prismatic" else np.zeros(3)
            R = Rotation.from_rotvec(value * axis).as_matrix() if turns else np.eye(3)
            places[child] = places[parent] @ origin(j) @ transform(slide, R)
    return places


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("posed", [False, True], ids=["zero pose", "posed"])
def test_links_are_where_the_file_puts_them(name, posed):
    robot = mb.load_urdf(FILES / f"{name}.urdf", fixed_base=name != "satellite")
    free = [j for j in robot.joints.values() if f"{j.name}.{j.coordinate}" in robot.start]
    values = {j.name: 0.3 + 0.4 * k for k, j in enumerate(free)} if posed else {j.name: 0.0 for j in free}
    start = robot.start | {f"{j.name}.{j.coordinate}": values[j.name] for j in free}
    outputs = {f"{n}{k}": robot.bodies[n].point(*np.eye(4)[k, :3]).r for n in robot.bodies for k in range(4)}
    outputs = {f"{n}.{i}": r[i] for n, r in outputs.items() for i in range(3)}
    outputs |= {j.name: getattr(j, j.coordinate) for j in robot.joints.values()}
    run = run_of(*robot.elements, start=start, outputs=outputs)
    if name == "gripper":
        assert_allclose(run["thumb_hinge"][0], 0.25 - 12 * values["left_slide"], atol=1e-12)
        values |= {"right_slide": values["left_slide"], "thumb_hinge": run["thumb_hinge"][0]}
    for link, place in forward_kinematics(FILES / f"{name}.urdf", values).items():
        if link == "world" or isinstance(robot.bodies[link], mb.Ground):
            continue
        found = [[run[f"{link}{k}.{i}"][0] for i in range(3)] for k in range(4)]
        expected = [(place @ [*np.eye(4)[k, :3], 1])[:3] for k in range(4)]
        assert_allclose(found, expected, rtol=0, atol=2e-12)


def test_links_without_a_joint_between_them_weigh_what_their_parts_weigh():
    """The hand with its tool: mass, centre of mass and inertia against sums over points of the same moments."""
    body = mb.load_urdf(FILES / "branch.urdf").bodies["left_hand"]
    tree = ElementTree.parse(FILES / "branch.urdf")
    tool_on_hand = origin(next(j for j in tree.findall("joint") if j.get("name") == "tool_mount"))
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for name, place in (("left_hand", np.eye(4)), ("tool", tool_on_hand)):
        inertial = next(link for link in tree.findall("link") if link.get("name") == name).find("inertial")
        m = float(inertial.find("mass").get("value"))
        i = {key: float(value) for key, value in inertial.find("inertia").items()}
        J = [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
        T = place @ origin(inertial)
        J, c = T[:3, :3] @ np.array(J) @ T[:3, :3].T, T[:3, 3]
        mass, first = mass + m, first + m * c
        second += np.trace(J) / 2 * np.eye(3) - J + m * np.outer(c, c)
    com = first / mass
    central = second - mass * np.outer(com, com)
    assert_allclose(float(body.mass), mass)
    assert_allclose(body.com, com, atol=1e-15)
    assert_allclose(body.inertia, np.trace(central) * np.eye(3) - central, atol=1e-15)


def test_all_joints_move_as_the_format_says(tmp_path):
    """A planar and a floating joint beside a slider that a turned frame carries."""
    links = "".join(f'<link name="{name}">{ROD}</link>' for name in ("plate", "ball", "block"))
    turned = '<origin xyz="1 2 3" rpy="0.3 -0.2 1.1"/>'
    text = '<link name="world"/>' + links
    text += joint("table", "planar", "world", "plate", f'{turned}<axis xyz="0 1 0"/>')
    text += joint("free", "floating", "plate", "ball", '<origin xyz="0 0 1" rpy="0.5 0 0"/>')
    text += joint("slide", "prismatic", "plate", "block", f'{turned}<axis xyz="0 0 1"/><limit lower="0" upper="1"/>')
    robot = load(tmp_path, text)
    assert set(robot.joints) == {"table", "slide"} and "free.angle" not in robot.start
    points = {name: robot.bodies[name].point(0, 0, 0) for name in ("plate", "ball", "block")}
    outputs = {f"{name}.{x}": getattr(point, x) for name, point in points.items() for x in "xyz"}
    scene = {"start": robot.start, "times": [0.0, 0.5], "outputs": outputs}
    start, places = run_of(*robot.elements, **scene), forward_kinematics(tmp_path / "machine.urdf", {})
    for name in points:
        assert_allclose([start[f"{name}.{x}"][0] for x in "xyz"], places[name][:3, 3], atol=1e-12)
    run = run_of(*robot.elements, mb.Gravity(0, 0, -10), **scene)
    ways = {name: np.array([run[f"{name}.{x}"][1] - run[f"{name}.{x}"][0] for x in "xyz"]) for name in points}
    assert_allclose(ways["ball"], [0, 0, -10 * 0.5**2 / 2], atol=1e-8)
    normal = places["plate"][:3, :3] @ [0, 1, 0]
    assert abs(ways["plate"] @ normal) < 1e-8 and np.linalg.norm(ways["plate"]) > 0.1


def test_numbers_are_those_of_the_file_and_can_be_replaced(tmp_path):
    text = arm("elbow", '<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>')
    p = mb.Parameters(m=3.0, x=0.1, c=0.4, turn=0.2)
    replace = {"arm.mass": p.m, "arm.com.x": 0.6, "elbow.damping": p.c}
    robot = load(tmp_path, text, replace=replace | {"elbow.origin.x": p.x, "elbow.origin.pitch": p.turn})
    given = {"arm.mass": 2.0, "arm.com.x": 0.5, "arm.inertia.yy": 0.2, "elbow.origin.z": 0.5, "elbow.axis.y": 1.0}
    assert given.items() <= robot.numbers.items() and robot.numbers["elbow.damping"] == 0.0
    elbow, tip = robot.joints["elbow"], robot.bodies["arm"].point(1, 0, 0)
    system = mb.System(*robot.elements, mb.Gravity(0, 0, -9.81), parameters=p)
    start = robot.start | {"elbow.angle_rate": 2.0}
    scene = mb.Scene(system, start, outputs={"x": tip.x, "z": tip.z, "a": system.ddt(elbow.angle_rate)})
    for values in ({}, {"m": 2.0, "x": -0.2, "c": 0.0, "turn": -0.4}):
        m, x, c, turn = ({**p, **values}[name] for name in ("m", "x", "c", "turn"))
        run = mb.simulate(scene, parameters=values)
        expected = (m * 9.81 * 0.6 * np.cos(turn) - 2 * c) / (0.2 + m * 0.6**2)
        assert_allclose(run["a"][0], expected, rtol=1e-12)
        assert_allclose([run["x"][0], run["z"][0]], [x + np.cos(turn), 0.5 - np.sin(turn)], atol=1e-12)


def test_dry_friction_and_damping_of_a_slider(tmp_path):
    """A block that is stopped by friction after the way m v^2 / (2 F)."""
    slide = '<axis xyz="1 0 0"/><limit lower="-9" upper="9"/><dynamics friction="4"/>'
    robot = load(tmp_path, arm("slide", slide, "prismatic"))
    start, outputs = {"slide.displacement_rate": 2.0}, {"way": robot.joints["slide"].displacement}
    run = run_of(*robot.elements, start=start, times=[0.0, 2.0], outputs=outputs)
    assert abs(run["way"][1] - 2 * 2.0**2 / (2 * 4)) < 1e-4  # it rests after 1 s


@pytest.mark.parametrize("stop", [mb.KelvinVoigt(1e6, 2e3), 0.0], ids=["law", "restitution"])
def test_limits_stop_a_joint_on_request(tmp_path, stop):
    text = arm("hinge", '<axis xyz="0 1 0"/><limit lower="-1" upper="0.5"/>', "revolute")
    idle, stopped = load(tmp_path, text), load(tmp_path, text, stop=stop, replace={"hinge.limit.upper": 0.7})
    assert "the limits of one joint have no effect" in repr(idle)
    assert not any(isinstance(e, mb.Stop) for e in idle.elements)
    times, outputs = np.linspace(0, 2, 21), {"angle": stopped.joints["hinge"].angle}
    run = run_of(*stopped.elements, mb.Gravity(0, 0, -9.81), start=stopped.start, times=times, outputs=outputs)
    assert abs(run["angle"][-1] - 0.7) < 1e-4


def test_rates_of_two_joints_that_a_drive_couples_on_one_body():
    """Both may be listed: they agree with the drive."""
    robot = mb.load_urdf(FILES / "gripper.urdf")
    rates = {"wrist.angle_rate": 1.0, "left_slide.displacement_rate": 0.05, "thumb_hinge.angle_rate": -0.6}
    outputs = {"right": robot.joints["right_slide"].displacement_rate}
    run = run_of(*robot.elements, start=robot.start | rates, outputs=outputs)
    assert abs(run["right"][0] - 0.05) < 1e-12


@pytest.mark.parametrize(
    "name, fixed_base, free",
    [("gripper", True, []), ("gantry", True, []), ("branch", True, []), ("satellite", False, ["hull"])],
)
def test_default_outputs_are_the_joint_values(name, fixed_base, free):
    """And positions of links that no hinge or slider carries. Bodies declared beside a robot have theirs."""
    robot = mb.load_urdf(FILES / f"{name}.urdf", fixed_base=fixed_base)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    scene = mb.Scene(mb.System(*robot.elements, ball, mb.Gravity(0, 0, -9.81)), robot.start, [0.0, 0.1])
    values = {j.name: getattr(j, j.coordinate) for j in robot.joints.values() if j.coordinate}
    placed = {f"{link}.{x}": getattr(robot.bodies[link], x) for link in free for x in "xyz"}
    given = scene.with_outputs(values | placed | {"ball.z": ball.z, "ball.vz": ball.vz})
    assert scene.output_names == given.output_names and scene.units == given.units
    assert ca.is_equal(scene.y, given.y, 9)


def test_the_start_of_a_robot_is_told_in_short():
    robot = mb.load_urdf(FILES / "branch.urdf")
    text = str(mb.simulate(mb.Scene(mb.System(*robot.elements), robot.start)))
    (start,) = (line for line in text.splitlines() if line.startswith("  start "))
    assert len(start) < 600 and all(f"{name}.angle" in start for name in robot.joints) and " more;" in start


def test_a_joint_may_have_the_name_of_a_link(tmp_path):
    robot = load(tmp_path, arm("arm"))
    assert robot.bodies["arm"].name == "arm_link" and robot.joints["arm"].name == "arm"
    mb.System(*robot.elements)


def test_axes_of_a_welded_link():
    """A joint on a link that a fixed joint holds: its axis is given by `direction`."""
    robot = mb.load_urdf(FILES / "branch.urdf")
    tip = robot.bodies["tip"]
    wheel = mb.Body("wheel", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    spin = mb.Revolute("spin", tip.point(0, 0, 0), wheel.point(0, 0, 0), axis=tip.direction(0, 0, 1), axis_b=(0, 0, 1))
    axis = wheel.rotation @ ca.DM([0, 0, 1])
    run = run_of(*robot.elements, wheel, spin, start=robot.start, outputs={x: axis[i] for i, x in enumerate("xyz")})
    assert_allclose(run.values[0], forward_kinematics(FILES / "branch.urdf", {})["tip"][:3, 2], atol=1e-12)


REPLACEMENTS = [
    ({"mast.mas": 1.0}, "no number 'mast.mas'. Did you mean 'mast.mass'"),
    ({"mast.mass": float("nan")}, "'mast.mass' is nan, not a finite number"),
    ({"mast.mass": "heavy"}, "expected one number or CasADi SX"),
    ({"rail.mass": 3.0}, "'rail.mass' has no effect, because the base is fixed"),
    ({"lift.limit.lower": 0.0}, "'lift.limit.lower' has no effect without stop="),
    ({"lift.limit.effort": 1.0}, "'lift.limit.effort' has no effect"),
    ({"mast.inertia.xx": 9.0}, "inertia of 'mast': the largest principal moment"),
    ({"mast.mass": -1.0}, "'mast.mass' is -1; it must not be negative"),
    (["mast.mass"], "expected a mapping from names to expressions"),
]


@pytest.mark.parametrize(("replace", "message"), REPLACEMENTS)
def test_replacements_that_are_refused(replace, message):
    refused(message, mb.load_urdf, FILES / "gantry.urdf", replace=replace)


def test_what_is_no_file_no_link_and_a_free_base_without_mass_are_told(tmp_path):
    refused("no link 'masd'. Did you mean 'mast'", mb.load_urdf(FILES / "gantry.urdf").bodies.__getitem__, "masd")
    refused("expected the path of a file", mb.load_urdf, None)
    refused("expected the path of a file", mb.load_urdf, 5)
    refused(r"none.urdf: this file cannot be read", mb.load_urdf, "none.urdf")
    refused("free base 'base' has no mass", load, tmp_path, arm(), fixed_base=False)


def impossible(seed):
    """Moments that mostly no body has, their nearest possible ones by SciPy, and a hinge about a random axis.

    Returns the matrices (3, 3), mass, centre, axis, and what the repair changes of the energy of the hinge.
    """
    rng = np.random.default_rng(seed)
    R, principal = Rotation.random(rng=rng).as_matrix(), rng.normal(0.3, 1.0, 3) * 10.0 ** rng.integers(-3, 1)
    pairs = 1 - np.eye(3)  # principal moments are sums of two second moments of mass
    best = pairs @ nnls(pairs, principal)[0]
    J, nearest = R * principal @ R.T, R * best @ R.T
    mass, centre, axis = rng.uniform(0.1, 2), rng.normal(0, 0.5, 3), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    energy = axis @ nearest @ axis + mass * np.sum(np.cross(axis, centre) ** 2)
    return J, nearest, mass, centre, axis, abs(axis @ (J - nearest) @ axis) / energy


ENTRIES = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def inertial_of(J, origin='xyz="0.1 0 0"', mass=1):
    moments = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{J[i, j]}"' for i, j in ENTRIES)
    return f'<inertial><origin {origin}/><mass value="{mass}"/><inertia {moments}/></inertial>'


@pytest.mark.parametrize("is_mjcf", [False, True], ids=["urdf", "mjcf"])
@pytest.mark.parametrize("seed", range(16))
def test_the_nearest_possible_inertia_stands_for_one_that_no_body_has(seed, is_mjcf, tmp_path):
    J, nearest, mass, centre, axis, change = impossible(seed)
    xyz, around = (" ".join(map(repr, vector.tolist())) for vector in (centre, axis))
    axis, inertial = f'<axis xyz="{around}"/>', inertial_of(J, f'xyz="{xyz}"', mass)
    text = f'<robot name="r">{arm(inside=axis, inertial=inertial)}</robot>'
    if is_mjcf:
        pytest.importorskip("mujoco")
        entries = " ".join(f"{J[i, j]}" for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        full = f'<inertial pos="{xyz}" mass="{mass}" fullinertia="{entries}"/>'
        text = f'<mujoco><worldbody><body name="arm"><joint axis="{around}"/>{full}</body></worldbody></mujoco>'
    path = tmp_path / f"r.{'xml' if is_mjcf else 'urdf'}"
    path.write_text(text)
    load = mb.load_mjcf if is_mjcf else mb.load_urdf
    if change > 0.5:
        refused("energy of a motion by", load, path)
        return
    with warnings.catch_warnings(record=True, action="always") as told:
        robot = load(path)
    assert len(told) == (not np.allclose(J, nearest, rtol=0, atol=1e-9 * np.abs(J).max()))
    found = np.zeros((3, 3))
    for entry, name in zip(ENTRIES, ("xx", "xy", "xz", "yy", "yz", "zz"), strict=True):
        found[entry] = found[entry[::-1]] = robot.numbers[f"arm.inertia.{name}"]
    if is_mjcf:  # in its principal axes
        R = Rotation.from_euler("xyz", [robot.numbers[f"arm.com.{x}"] for x in ("roll", "pitch", "yaw")]).as_matrix()
        found = R @ found @ R.T
    assert_allclose(found, nearest, rtol=0, atol=1e-9 * np.abs(J).max() + 1e-12)
    if told:
        refused("inertia", load, path, strict=True)


@pytest.mark.parametrize("seed", range(6))
def test_a_moment_that_is_negative_by_rounding_is_repaired(seed, tmp_path):
    rng = np.random.default_rng(seed)
    entries, k = np.diag(rng.uniform(0.01, 1.0) * np.ones(3)), rng.integers(3)
    entries[k, k] = -(10.0 ** -rng.uniform(5, 25))
    axis = '<axis xyz="{} {} {}"/>'.format(*np.eye(3, dtype=int)[k - 1])  # about which it has an inertia
    text = arm(inside=axis, inertial=inertial_of(entries))
    with pytest.warns(mb.SymmbWarning, match="The inertia of 'arm' is impossible. The nearest possible") as told:
        robot = load(tmp_path, text)
    assert len(told) == 1 and robot.numbers[f"arm.inertia.{'xyz'[k] * 2}"] == 0
    assert mb.System(*robot.elements).M.shape
    refused("is negative", load, tmp_path, text, strict=True)


@pytest.mark.parametrize("seed", range(6))
def test_a_rod_that_rounding_makes_negative_where_it_is_turned_is_one(seed, tmp_path):
    rng = np.random.default_rng(seed)
    R, moment = Rotation.random(rng=rng), rng.uniform(0.01, 1.0)
    J = R.as_matrix() * [0, moment, moment] @ R.as_matrix().T
    rpy = " ".join(map(repr, R.inv().as_euler("xyz").tolist()))
    robot = load(tmp_path, arm(inertial=inertial_of(J, f'rpy="{rpy}"')))  # without a warning
    assert mb.System(*robot.elements).M.shape
    assert_allclose(ca.evalf(ca.SX(robot.bodies["arm"].inertia)).full(), np.diag([0, moment, moment]), atol=1e-15)


def test_an_inertia_that_cannot_matter_is_kept(tmp_path):
    """Of links on the base, and on a body that is possible as a whole."""
    bad = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0.005"/></inertial>'
    text = f'<link name="base">{bad}</link><link name="arm">{ROD}</link><link name="lamp">{bad}</link>'
    text += joint("hinge", "continuous", "base", "arm") + joint("screws", "fixed", "arm", "lamp")
    with pytest.warns(mb.SymmbWarning, match=r"impossible inertias \(line 1 and 1 more\)\. With") as told:
        robot = load(tmp_path, text)
    assert "nearest" not in str(told[0].message) and robot.numbers["lamp.inertia.zz"] == 0.005
    assert_allclose(np.diag(ca.evalf(ca.SX(robot.bodies["arm"].inertia)).full()), [0.01, 0.2, 0.205])


def test_dots_in_names_and_followers_of_what_is_not_there(tmp_path):
    text = f'<link name="base"/><link name="link 1.0">{ROD}</link><link name="link_2.0">{ROD}</link>'
    text += joint("a.0", "continuous", "base", "link 1.0")
    text += joint("b", "continuous", "link 1.0", "link_2.0", '<mimic joint="A.0" multiplier="2"/>')
    with pytest.warns(mb.SymmbWarning, match="which are replaced by _ .* followers move freely") as told:
        robot = load(tmp_path, text)
    assert len(told) == 1 and set(robot.joints) == {"a_0", "b"} and set(robot.start) == {"a_0.angle", "b.angle"}
    followed = text.replace("A.0", "a.0")
    with pytest.warns(mb.SymmbWarning):
        assert set(load(tmp_path, followed).start) == {"a_0.angle"}
