"""MJCF files with faults: each is told in one sentence that names the file."""

import sys
from pathlib import Path

import pytest
from faults import refused

import symmb as mb

mujoco = pytest.importorskip("mujoco")

ROD = '<inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'
ARM = f'<body name="arm"><joint name="elbow" axis="0 1 0"/>{ROD}</body>'


def scene(inside, outside=""):
    return f"<mujoco><worldbody>{inside}</worldbody>{outside}</mujoco>"


MALFORMED = [
    ("", "empty file"),
    ("mass = 3", "XML"),
    ("<mujoco><worldbody>", "XML parse error"),
    ("<html/>", "html"),
    ('<?xml version="1.0"?>\n<!-- an arm -->\n<robot name="arm"/>', "this is a URDF file. Use load_urdf"),
    (scene("<boddy/>"), "unrecognized element.*boddy"),
    (scene('<body poss="0 0 0"/>'), "unrecognized attribute"),
    (scene('<body pos="0 zero 0"/>'), "pos|number"),
    (scene('<body pos="0 0"/>'), "pos"),
    (scene("<joint/>"), "World body cannot have joints"),
    (scene('<body name="arm"><joint/></body>'), "mass and inertia of moving bodies.*arm"),
    (scene('<body><joint/><inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/></body>'), "mass"),
    (scene('<body name="arm"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/></body>'), "inertia"),
    (scene(f'<body><joint axis="0 0 0"/>{ROD}</body>'), "axis"),
    (scene(ARM + ARM), "repeated name 'arm'"),
    (scene(ARM, '<actuator><motor joint="elbw"/></actuator>'), "elbw"),
    (scene('<body childclass="none"/>'), "unknown default childclass"),
    ('<mujoco><include file="none.xml"/></mujoco>', "none.xml"),
    (scene(ARM, '<asset><mesh file="none.stl"/></asset>'), "none.stl"),
    (scene(f"<body><joint/>{ROD}<body><freejoint/>{ROD}</body></body>"), "free joint"),
    (scene(f'<body name="a&#1;b"><joint/>{ROD}</body>'), "a.*b"),
]


@pytest.mark.parametrize(("text", "message"), MALFORMED)
def test_a_fault_is_one_sentence(text, message, tmp_path):
    path = tmp_path / "machine.xml"
    path.write_text(text)
    caught = refused(message, mb.load_mjcf, path, strict=True)
    sentence = caught
    assert "machine.xml" in sentence and sentence.endswith(".") and "\n" not in sentence


OPTIONS = [
    ({"path": 5}, "expected the path of a file"),
    ({"path": "none.xml"}, "none.xml: this file cannot be read"),
    ({"path": "."}, "this file cannot be read .it is a folder"),
    ({"path": "arm.urdf"}, "Use load_urdf"),
    ({"replace": {"arm.mas": 1.0}}, "no number 'arm.mas'. Did you mean 'arm.mass'"),
    ({"replace": "arm.mass"}, "expected a mapping from names to expressions"),
    ({"replace": {"elbow.damping": -1.0}}, "must not be negative"),
    ({"replace": {"elbow.stiffness": float("nan")}}, "not a finite number"),
    ({"replace": {"world.mass": 1.0}}, "'world.mass' has no effect"),
    ({"stop": "hard"}, "stop"),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_options_of_other_kinds(options, message, tmp_path):
    path = tmp_path / "machine.xml"
    path.write_text(scene(ARM))
    refused(message, mb.load_mjcf, **{"path": path} | options)


def test_without_the_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"load_mjcf needs mujoco, which is not installed.*symmb\[mjcf\]"):
        mb.load_mjcf(tmp_path / "machine.xml")


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
