"""MJCF files with faults: each is told in one sentence that names the file."""

import sys

import pytest

import symmb as mb

mujoco = pytest.importorskip("mujoco")

ROD = '<inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'
ARM = f'<body name="arm"><joint name="elbow" axis="0 1 0"/>{ROD}</body>'


def scene(inside, outside=""):
    return f"<mujoco><worldbody>{inside}</worldbody>{outside}</mujoco>"


MALFORMED = {
    "empty": ("", "empty file"),
    "no XML": ("mass = 3", "XML"),
    "cut off": ("<mujoco><worldbody>", "XML parse error"),
    "another document": ("<html/>", "html"),
    "a URDF": ('<?xml version="1.0"?>\n<!-- an arm -->\n<robot name="arm"/>', "this is a URDF file. Use load_urdf"),
    "an unknown element": (scene("<boddy/>"), "unrecognized element.*boddy"),
    "an unknown attribute": (scene('<body poss="0 0 0"/>'), "unrecognized attribute"),
    "a text for a number": (scene('<body pos="0 zero 0"/>'), "pos|number"),
    "too few numbers": (scene('<body pos="0 0"/>'), "pos"),
    "a joint of the world": (scene("<joint/>"), "World body cannot have joints"),
    "a body without mass": (scene('<body name="arm"><joint/></body>'), "mass and inertia of moving bodies.*arm"),
    "a negative mass": (scene('<body><joint/><inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/></body>'), "mass"),
    "an inertia that no body has": (
        scene('<body name="arm"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/></body>'), "inertia",
    ),
    "an axis without direction": (scene(f'<body><joint axis="0 0 0"/>{ROD}</body>'), "axis"),
    "a name that is used twice": (scene(ARM + ARM), "repeated name 'arm'"),
    "a joint that is not there": (scene(ARM, '<actuator><motor joint="elbw"/></actuator>'), "elbw"),
    "a class that is not there": (scene('<body childclass="none"/>'), "unknown default childclass"),
    "an include that is not there": ('<mujoco><include file="none.xml"/></mujoco>', "none.xml"),
    "a mesh that is not there": (scene(ARM, '<asset><mesh file="none.stl"/></asset>'), "none.stl"),
    "a free joint inside": (scene(f'<body><joint/>{ROD}<body><freejoint/>{ROD}</body></body>'), "free joint"),
    "a name with a line break": (scene(f'<body name="a&#1;b"><joint/>{ROD}</body>'), "a.*b"),
}  # fmt: skip


@pytest.mark.parametrize("case", MALFORMED)
def test_a_fault_is_one_sentence(case, tmp_path):
    text, message = MALFORMED[case]
    path = tmp_path / "machine.xml"
    path.write_text(text)
    with pytest.raises(mb.DeclarationError, match=message) as caught:
        mb.load_mjcf(path)
    sentence = str(caught.value)
    assert "machine.xml" in sentence and sentence.endswith(".") and "\n" not in sentence


OPTIONS = {
    "no path": ({"path": 5}, "expected the path of a file"),
    "no file": ({"path": "none.xml"}, "none.xml: this file cannot be read"),
    "a folder": ({"path": "."}, "this file cannot be read .it is a folder"),
    "a URDF": ({"path": "arm.urdf"}, "Use load_urdf"),
    "an unknown number": ({"replace": {"arm.mas": 1.0}}, "no number 'arm.mas'. Did you mean 'arm.mass'"),
    "no mapping": ({"replace": "arm.mass"}, "expected .* expressions by names"),
    "a negative damping": ({"replace": {"elbow.damping": -1.0}}, "must not be negative"),
    "NaN": ({"replace": {"elbow.stiffness": float("nan")}}, "not a finite number"),
    "the world": ({"replace": {"world.mass": 1.0}}, "nothing depends on 'world.mass'"),
    "a stop": ({"stop": "hard"}, "stop"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_options_of_other_kinds(case, tmp_path):
    options, message = OPTIONS[case]
    path = tmp_path / "machine.xml"
    path.write_text(scene(ARM))
    with pytest.raises(mb.DeclarationError, match=message):
        mb.load_mjcf(**({"path": path} | options))


def test_without_the_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"load_mjcf needs mujoco, which is not installed.*symmb\[mjcf\]"):
        mb.load_mjcf(tmp_path / "machine.xml")
