"""Machines from MJCF files: closed forms, poses against MuJoCo, what is told to be left out, and files with faults."""

import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import run_of
from mjcf_machines import Twin, difference, draw, largest_deviation
from numpy.testing import assert_allclose

import symmb as mb

mujoco = pytest.importorskip("mujoco")

ROD = '<inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'


def written(inside, outside=""):
    return f"<mujoco><worldbody>{inside}</worldbody>{outside}</mujoco>"


def write(tmp_path, inside, outside=""):
    path = tmp_path / "machine.xml"
    path.write_text(written(inside, outside))
    return path


def arm(joint=""):
    """A rod on a hinge `j` about y, with other attributes."""
    return f'<body name="arm"><joint name="j" axis="0 1 0" {joint}/>{ROD}</body>'


def load(tmp_path, inside, outside="", **options):
    return mb.load_mjcf(write(tmp_path, inside, outside), **options)


def told(path, **options):
    """The robot of a file and the text of its warning."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        robot = mb.load_mjcf(path, **options)
    return robot, " ".join(str(warning.message) for warning in caught)


def value(robot, expression, start=(), parameters=None):
    """An expression at the start."""
    system = mb.System(*robot.elements, parameters=parameters)
    return mb.simulate(mb.Scene(system, robot.start | dict(start), outputs={"e": expression(system)}))["e"][0]


def acceleration(robot, name="j", *more):
    """That of a hinge at the start."""
    return value(robot, lambda s: s.ddt(robot.joints[name].angle_rate), *more)


def place(robot, point, start, **options):
    run = run_of(*robot.elements, start=start, outputs={x: getattr(point, x) for x in "xyz"}, **options)
    return run.values[0]


@pytest.mark.parametrize("seed", range(3))
def test_random_trees_accelerate_as_in_mujoco(seed, tmp_path):
    assert difference(draw(mujoco, seed, tmp_path, most=3)) < 1e-9


@pytest.mark.parametrize("seed", range(2))
def test_random_loops_accelerate_as_rows_of_mujoco_say(seed, tmp_path):
    assert difference(draw(mujoco, seed, tmp_path, loops=True, most=4)) < 1e-9


def test_numbers_are_those_of_the_file_and_can_be_replaced(tmp_path):
    inside = (
        f'<body name="arm" pos="0 0 0.5"><joint name="elbow" axis="0 1 0" damping="0.3" stiffness="4" springref="30"/>'
        f"{ROD}</body>"
    )
    servo = '<actuator><position name="elbow" joint="elbow" kp="5"/></actuator>'
    p = mb.Parameters(m=3.0, k=5.0, u=0.1)
    replace = {"arm.mass": p.m, "elbow.stiffness": p.k, "elbow_actuator.ctrl": p.u}
    robot = load(tmp_path, inside, servo, replace=replace | {"elbow.damping": 0.0, "gravity.z": -10.0})
    given = {"arm.mass": 2.0, "arm.com.x": 0.5, "elbow.origin.z": 0.5, "elbow.stiffness": 4.0, "elbow.damping": 0.3}
    given |= {"elbow.springref": np.pi / 6, "elbow_actuator.gain": 5.0, "elbow_actuator.bias.length": -5.0}
    assert given.items() <= robot.numbers.items()
    angle = 0.2
    found = acceleration(robot, "elbow", {"elbow.angle": angle}, p)
    spring = 5.0 * (np.pi / 6 - angle) + 5.0 * (0.1 - angle)
    assert_allclose(found, (3 * 10 * 0.5 * np.cos(angle) + spring) / (0.1 + 3 * 0.25), rtol=1e-12)


FRICTION, OFF = 'frictionloss="1" range="-1 1"', '<option><flag constraint="disable"/></option>'


@pytest.mark.parametrize(
    ("joint", "outside", "rate", "armature"), [('armature="0.7"', "", 0.0, 0.7), (FRICTION, OFF, 0.5, 0.0)]
)
def test_armature_acts_on_the_rate_of_its_joint_and_friction_is_a_constraint(joint, outside, rate, armature, tmp_path):
    robot, text = told(write(tmp_path, arm(joint), outside))
    assert not text
    found = acceleration(robot, "j", {"j.angle_rate": rate})
    assert_allclose(found, 2 * 9.81 * 0.5 / (0.1 + 2 * 0.25 + armature), rtol=1e-12)


def test_joints_count_from_their_reference_in_degrees_or_radians(tmp_path):
    for unit, ref in (("degree", "60"), ("radian", repr(np.pi / 3))):
        inside = (
            f'<body name="arm" pos="1 0 0"><joint name="turn" axis="0 0 2" ref="{ref}"/>'
            f'<joint name="slide" type="slide" axis="0 1 0" ref="0.4"/>{ROD}</body>'
        )
        robot = load(tmp_path, inside, f'<compiler angle="{unit}"/>')
        assert_allclose([robot.start["turn.angle"], robot.start["slide.displacement"]], [np.pi / 3, 0.4])
        moved = {"turn.angle": 0, "slide.displacement": 0}
        c, s = np.cos(np.pi / 3), np.sin(np.pi / 3)
        for start, expected in ((robot.start, [2, 0, 0]), (moved, [1 + c - 0.4 * s, -s - 0.4 * c, 0])):
            assert_allclose(place(robot, robot.bodies["arm"].point(1, 0, 0), start), expected, atol=1e-12)


def test_a_planar_four_bar_that_connect_closes(tmp_path):
    """One of the three rows of `connect` is redundant in the plane: MuJoCo's springs are soft, symmb's joint is not."""
    bar = '<inertial pos="{} 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>'
    inside = (
        f'<body name="crank"><joint name="a" axis="0 1 0"/>{bar.format(0.1)}<body name="coupler" pos="0.2 0 0">'
        f'<joint name="b" axis="0 1 0"/>{bar.format(0.3)}</body></body>'
        f'<body name="rocker" pos="0.5 0 0" euler="0 -90 0"><joint name="c" axis="0 1 0"/>{bar.format(0.2)}</body>'
    )
    length = float(np.hypot(0.3, 0.4))
    angle = float(np.degrees(-np.arctan2(0.4, 0.3)))
    inside = inside.replace('pos="0.2 0 0"', f'pos="0.2 0 0" euler="0 {angle!r} 0"')
    pin = f'<connect name="pin" body1="coupler" body2="rocker" anchor="{length!r} 0 0"/>'
    dense = '<option jacobian="dense"><flag contact="disable" limit="disable" frictionloss="disable"/></option>'
    robot, text = told(write(tmp_path, inside, f"{dense}<equality>{pin}</equality>"))
    assert not text
    end, eye = robot.bodies["coupler"].point(length, 0, 0), robot.bodies["rocker"].point(0.4, 0, 0)
    start, outputs = {"a.angle_rate": 1.0}, {"x": end.x - eye.x, "z": end.z - eye.z, "a": robot.joints["a"].angle}
    run = run_of(*robot.elements, start=start, times=[0.0, 1.0], outputs=outputs, guess=robot.start)
    assert_allclose([run["x"], run["z"]], 0, atol=1e-6)
    assert abs(run["a"][1]) > 0.1


def test_a_joint_that_another_one_leads(tmp_path):
    text = '<body name="{0}" pos="0 {1} 0"><joint name="{0}_j" axis="1 0 0"/>{2}</body>'
    inside = text.format("a", 0, ROD) + text.format("b", 1, ROD)
    law = '<equality><joint joint1="a_j" joint2="b_j" polycoef="0.1 2 0.5 0 0"/></equality>'
    robot = load(tmp_path, inside, law, replace={"equality0.polycoef.0": 0.2})
    assert "a_j.angle" not in robot.start
    assert_allclose(value(robot, lambda s: robot.joints["a_j"].angle, {"b_j.angle": 0.3}), 0.2 + 0.6 + 0.5 * 0.09)


def test_armature_leaves_the_other_joints_at_rest_at_the_start(tmp_path):
    """On a free body, too, which no disc holds: the run is that of MuJoCo."""
    inside = (
        '<body name="base"><freejoint/><geom type="sphere" size="0.2" mass="1"/><body name="arm" pos="0.3 0 0">'
        '<joint name="j" axis="0 0 1" armature="0.1"/><geom type="box" size="0.2 0.05 0.05" pos="0.2 0 0" mass="0.5"/>'
        '<body name="hand" pos="0.4 0 0"><joint name="k" axis="0 0 1" armature="0.2"/><geom size="0.1" mass="0.5"/>'
        "</body></body></body>"
    )
    path = write(tmp_path, inside, '<option gravity="0 0 0"><flag contact="disable"/></option>')
    robot = mb.load_mjcf(path)
    base, joints = robot.bodies["base"], robot.joints
    outputs = {"base": base.omega[2], "j": joints["j"].angle_rate, "k": joints["k"].angle_rate}
    for coordinates in ("joint", "body"):
        start = robot.start | {"j.angle_rate": 1.0}
        run = run_of(*robot.elements, start=start, times=[0.0, 0.5], outputs=outputs, coordinates=coordinates)
        model = mujoco.MjModel.from_xml_path(str(path))
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 1e-3
        data = mujoco.MjData(model)
        data.qvel[6] = 1.0
        for k in (0, 1):
            assert_allclose(run.values[k], data.qvel[5:8], atol=1e-9)
            mujoco.mj_step(model, data, 500)


def test_a_weld_without_torque_leaves_its_body_free_to_turn(tmp_path):
    body = f'<body name="b"><freejoint/>{ROD}</body>'
    robot = load(tmp_path, body, '<equality><weld body1="b" torquescale="0"/></equality>')
    found = value(robot, lambda s: s.ddt(robot.bodies["b"].omega[1]))
    assert_allclose(found, 2 * 9.81 * 0.5 / (0.1 + 2 * 0.25), rtol=1e-9)


def test_a_weld_between_sites(tmp_path):
    inside = (
        f'<body name="a" pos="0 0 1"><joint name="j" axis="0 1 0"/>{ROD}<site name="p" pos="1 0 0" euler="0 90 0"/>'
        f'</body><body name="b" pos="1 0 2"><freejoint/>{ROD}<site name="q" pos="0 0.1 0" euler="0 90 0"/></body>'
    )
    robot = load(tmp_path, inside, '<equality><weld site1="p" site2="q"/></equality>')
    found = place(robot, robot.bodies["b"].point(0, 0, 0), {"j.angle": 0.5}, guess=robot.start)
    assert_allclose(found, [np.cos(0.5), -0.1, 1 - np.sin(0.5)], atol=1e-9)


def test_limits_act_on_request(tmp_path):
    path = write(tmp_path, arm('range="-90 40"'))
    idle, text = told(path)
    assert "limits of joints, because stop=... is missing (j)" in text
    stopped, text = told(path, stop=0.0)
    assert not text and not any(isinstance(element, mb.Stop) for element in idle.elements)
    outputs = {"angle": stopped.joints["j"].angle}
    run = run_of(*stopped.elements, start=stopped.start, times=[0.0, 2.0], outputs=outputs)
    assert abs(run["angle"][-1] - np.radians(40)) < 1e-4


MUSCLE = '<actuator><muscle name="biceps" joint="j" lengthrange="0 1"/></actuator>'
MOTOR = '<actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator>'
LEFT_OUT = {
    "contacts": ('<geom type="plane" size="1 1 1"/><body><freejoint/><geom size="1"/></body>', "", "contacts."),
    "a ball's spring": (f'<body><joint type="ball" name="k" stiffness="1"/>{ROD}</body>', "", "free joints (k)"),
    "fluid": (arm(), '<option density="1"/>', "forces of the fluid"),
    "a muscle": (arm(), MUSCLE, "dyntype is muscle (biceps)"),
    "a range": (arm(), MOTOR, "ranges of controls of actuators (m)"),
    "a keyframe": (arm(), '<keyframe><key name="home" qpos="1"/></keyframe>', "(home)"),
    "an equality that is off": (
        f'<body name="a"><joint/>{ROD}</body><body name="b"><joint/>{ROD}</body>',
        '<equality><connect name="e" body1="a" body2="b" anchor="0 0 0" active="false"/></equality>', "off (e)",
    ),
    "a pulley": (
        f'<site name="s"/><body><joint/>{ROD}<site name="a"/></body>',
        '<tendon><spatial name="rope"><site site="s"/><site site="a"/><pulley divisor="2"/><site site="s"/>'
        '<site site="a"/></spatial></tendon>', "over pulleys (rope)",
    ),
    "mocap": (f'<body name="hand" mocap="true"/><body><joint/>{ROD}</body>', "", "mocap bodies (hand)"),
}  # fmt: skip


@pytest.mark.parametrize("case", LEFT_OUT)
def test_what_is_left_out_is_told_by_name(case, tmp_path):
    inside, outside, message = LEFT_OUT[case]
    robot, text = told(write(tmp_path, inside, outside))
    assert text.count("left out") == 1 and message in text
    mb.System(*robot.elements)


def test_a_file_of_which_nothing_is_left_out_does_not_warn(tmp_path):
    robot, text = told(write(tmp_path, arm()))
    assert not text and repr(robot).startswith("Robot('machine': 1 Link, 1 Revolute, 1 Gravity")


def test_classes_includes_and_bodies_without_joints(tmp_path):
    """Defaults and included files are MuJoCo's. A body that nothing moves is part of its parent."""
    (tmp_path / "hand.xml").write_text(f'<mujoco><body name="hand" pos="1 0 0">{ROD}</body></mujoco>')
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><default><default class="stiff"><joint damping="7" axis="0 1 0"/></default></default><worldbody>'
        f'<body><joint class="stiff"/>{ROD}<include file="hand.xml"/></body></worldbody></mujoco>'
    )
    robot = mb.load_mjcf(path)
    assert robot.numbers["joint0.damping"] == 7.0 and robot.numbers["joint0.axis.y"] == 1.0
    assert robot.bodies["hand"].body is robot.bodies["body1"] and float(robot.bodies["body1"].mass) == 4.0


def test_shapes_are_drawn_where_mujoco_has_them(tmp_path):
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], "<f4")
    faces = [bytes(12) + corners[[*face]].tobytes() + bytes(2) for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    (tmp_path / "part.stl").write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + b"".join(faces))
    inside = (
        '<body name="a"><freejoint/><geom type="mesh" mesh="part" pos="1 2 3" euler="20 30 40"/>'
        '<geom type="capsule" size="0.1 0.4" pos="0 0 1"/><geom type="box" size="1 2 3" group="3"/></body>'
    )
    path = write(tmp_path, inside, '<asset><mesh name="part" file="part.stl" scale="2 2 2"/></asset>')
    mesh, *capsule = told(path)[0].bodies["a"].shapes
    assert [type(shape).__name__ for shape in capsule] == ["Cylinder", "Sphere", "Sphere"]
    model = mujoco.MjSpec.from_file(str(path)).compile()
    R, q = np.zeros(9), model.geom_quat[0]
    mujoco.mju_quat2Mat(R, q)
    corners = model.mesh_vert @ R.reshape(3, 3).T + model.geom_pos[0]
    found = mesh.triangles.reshape(-1, 3) @ np.array(ca.DM(mesh.axes)).T + [float(x) for x in mesh.at]
    nearest = np.linalg.norm(found[:, None] - corners, axis=2).min(axis=1)
    assert_allclose(nearest, 0, atol=1e-6)


def test_a_second_of_a_machine_with_tendons_servos_and_filters(tmp_path):
    inside = (
        f'<body name="a"><joint name="j" axis="0 1 0" damping="0.2"/><joint name="k" axis="0 0 1"/>{ROD}'
        f'<site name="s" pos="0.5 0 0.1"/><body name="b" pos="1 0 0"><joint name="l" axis="0 1 0"/>{ROD}</body></body>'
        '<site name="t" pos="0.3 0.2 1"/>'
    )
    outside = (
        '<tendon><spatial name="rope" stiffness="40" damping="1" springlength="0.5 0.8"><site site="s"/>'
        '<site site="t"/></spatial></tendon><actuator>'
        '<position name="m" joint="l" kp="3" kv="0.2" timeconst="0.1"/></actuator>'
    )
    assert largest_deviation(mujoco, write(tmp_path, inside, outside)) < 1e-6


@pytest.mark.long
def test_a_second_of_the_model_that_mujoco_ships():
    assert largest_deviation(mujoco, Path(mujoco.__file__).parent / "testdata" / "model.xml") < 1e-6


def test_the_state_of_a_twin_is_not_trivial(tmp_path):
    """A comparison that compares nothing would pass."""
    twin = Twin(mujoco, write(tmp_path, arm()))
    twin.pose()
    assert np.abs(twin.accelerations()).max() > 0.1
    twin.model.body_mass[1] *= 2
    mujoco.mj_forward(twin.model, twin.data)
    assert difference(twin) > 1e-3


def test_a_tendon_that_another_one_leads(tmp_path):
    """Lengths count from those in the pose of the file: l_1 - 1 = 0.5 (l_2 - 2 * 0.3)."""
    a = f'<body name="a"><joint name="x" type="slide" axis="1 0 0"/>{ROD}<site name="s" pos="1 0 0"/></body>'
    b = f'<body name="b"><joint name="y" type="slide" axis="0 1 0" ref="0.3"/>{ROD}</body>'
    rope = '<spatial name="rope"><site site="o"/><site site="s"/></spatial>'
    both = f'{rope}<fixed name="sum"><joint joint="y" coef="2"/></fixed>'
    law = '<tendon tendon1="rope" tendon2="sum" polycoef="0 0.5 0 0 0"/>'
    outside = f"<tendon>{both}</tendon><equality>{law}</equality>"
    robot = load(tmp_path, f'<site name="o" pos="0 0 0"/>{a}{b}', outside)
    start, outputs = {"y.displacement": 0.7}, {"x": robot.joints["x"].displacement}
    run = run_of(*robot.elements, start=start, outputs=outputs, guess={"x.displacement": 0.1})
    assert_allclose(run["x"], 0.5 * 2 * 0.4, rtol=1e-9)


def test_a_tendon_is_slack_between_two_lengths(tmp_path):
    body = f'<body name="a"><joint name="x" type="slide" axis="1 0 0"/>{ROD}<site name="s"/></body>'
    rope = '<spatial name="rope" stiffness="6" springlength="0 1.5"><site site="o"/><site site="s"/></spatial>'
    path = write(tmp_path, f'<site name="o" pos="-1 0 0"/>{body}', f"<tendon>{rope}</tendon>")
    p = mb.Parameters(k=6.0, far=1.5)
    for replace in ({}, {"rope.stiffness": p.k, "rope.springlength.upper": p.far}):
        robot = mb.load_mjcf(path, replace=replace)
        for x, force in ((0.2, 0.0), (0.9, -6 * 0.4)):
            rate = robot.joints["x"].displacement_rate
            found = value(robot, lambda s, rate=rate: s.ddt(rate), {"x.displacement": x}, p if replace else None)
            assert_allclose(found, force / 2, rtol=1e-12, atol=1e-15)


MALFORMED = [
    ("", "empty file"),
    ("mass = 3", "XML"),
    ("<mujoco><worldbody>", "XML parse error"),
    ("<html/>", "html"),
    ('<?xml version="1.0"?>\n<!-- an arm -->\n<robot name="arm"/>', "this is a URDF file. Use load_urdf"),
    (written("<boddy/>"), "unrecognized element.*boddy"),
    (written('<body poss="0 0 0"/>'), "unrecognized attribute"),
    (written('<body pos="0 zero 0"/>'), "pos|number"),
    (written('<body pos="0 0"/>'), "pos"),
    (written("<joint/>"), "World body cannot have joints"),
    (written('<body name="arm"><joint/></body>'), "mass and inertia of moving bodies.*arm"),
    (written('<body><joint/><inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/></body>'), "mass"),
    (written('<body name="arm"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/></body>'), "inertia"),
    (written(f'<body><joint axis="0 0 0"/>{ROD}</body>'), "axis"),
    (written(arm() + arm()), "repeated name 'arm'"),
    (written(arm(), '<actuator><motor joint="elbw"/></actuator>'), "elbw"),
    (written('<body childclass="none"/>'), "unknown default childclass"),
    ('<mujoco><include file="none.xml"/></mujoco>', "none.xml"),
    (written(arm(), '<asset><mesh file="none.stl"/></asset>'), "none.stl"),
    (written(f"<body><joint/>{ROD}<body><freejoint/>{ROD}</body></body>"), "free joint"),
    (written(f'<body name="a&#1;b"><joint/>{ROD}</body>'), "a.*b"),
]


@pytest.mark.parametrize(("text", "message"), MALFORMED)
def test_a_fault_is_one_sentence(text, message, tmp_path):
    path = tmp_path / "machine.xml"
    path.write_text(text)
    sentence = refused(message, mb.load_mjcf, path, strict=True)
    assert "machine.xml" in sentence and sentence.endswith(".") and "\n" not in sentence


OPTIONS = [
    ({"path": 5}, "expected the path of a file"),
    ({"path": "none.xml"}, "none.xml: this file cannot be read"),
    ({"path": "."}, "this file cannot be read .it is a folder"),
    ({"path": "arm.urdf"}, "Use load_urdf"),
    ({"replace": {"arm.mas": 1.0}}, "no number 'arm.mas'. Did you mean 'arm.mass'"),
    ({"replace": "arm.mass"}, "expected a mapping from names to expressions"),
    ({"replace": {"j.damping": -1.0}}, "must not be negative"),
    ({"replace": {"j.stiffness": float("nan")}}, "not a finite number"),
    ({"replace": {"world.mass": 1.0}}, "'world.mass' has no effect"),
    ({"stop": "hard"}, "stop"),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_options_of_other_kinds(options, message, tmp_path):
    refused(message, mb.load_mjcf, **{"path": write(tmp_path, arm())} | options)


def test_without_the_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    message = r"load_mjcf needs mujoco, which is not installed.*symmb\[mjcf\]"
    refused(message, mb.load_mjcf, tmp_path / "machine.xml", error=ImportError)


@pytest.mark.parametrize("name", ["\xe9", "arm\xfc", "\xb5"])
def test_names_that_are_not_in_utf_8_are_told(name, tmp_path):
    text = f'<mujoco><worldbody><body name="{name}"><joint/><geom size=".1"/></body></worldbody></mujoco>'
    (tmp_path / "a.xml").write_bytes(f'<?xml version="1.0" encoding="latin-1"?>{text}'.encode("latin-1"))
    refused("names in this file are not UTF-8", mb.load_mjcf, tmp_path / "a.xml")
    (tmp_path / "b.xml").write_text(text, encoding="utf-8")
    assert name in mb.load_mjcf(tmp_path / "b.xml").bodies


def test_a_file_that_may_not_be_read_is_told(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "a.xml").write_text("<mujoco/>")
    monkeypatch.setattr(Path, "read_bytes", refuse)
    refused(r"this file cannot be read \(Permission denied\)", mb.load_mjcf, tmp_path / "a.xml")
