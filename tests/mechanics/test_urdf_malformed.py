"""Files with faults: each is told in one sentence that names the line and the element."""

import re

import numpy as np
import pytest
from faults import refused, warned

import symmb as mb

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BASE = '<link name="base"/>'
HAND = '<link name="hand"/>'
ARM = f'<link name="arm">{INERTIAL}</link>'
ENDS = '<parent link="base"/><child link="arm"/>'
LIMIT = '<limit lower="-1" upper="1"/>'


def joint(name, parent, child):
    return f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/></joint>'


HINGE = joint("elbow", "base", "arm")


def robot(*lines):
    return "\n".join(('<robot name="r">', *lines, "</robot>"))


def written(folder, text, name="bad.urdf"):
    path = folder / name
    path.write_text(text)
    return path


def link(inside):
    """A link in line 2 whose inside stands in line 3."""
    return robot('<link name="arm">', inside, "</link>")


def inertial(inside):
    return link(f"<inertial>{inside}</inertial>")


def moments(**changed):
    values = {"ixx": "1", "ixy": "0", "ixz": "0", "iyy": "1", "iyz": "0", "izz": "1"} | changed
    return "<inertia " + " ".join(f'{name}="{value}"' for name, value in values.items() if value is not None) + "/>"


def shape(inside):
    return link(f"<visual><geometry>{inside}</geometry></visual>")


def elbow(kind, inside, ends=ENDS):
    """A joint in line 4 whose inside stands in line 5."""
    return robot(BASE, ARM, f'<joint name="elbow" type="{kind}">', f"{ends}{inside}", "</joint>")


ELBOW = "<joint name='elbow'>"
ENTITY = ("<!ENTITY a>", "entities are not supported")
CIRCLE = (joint("elbow", "hand", "arm"), joint("wrist", "arm", "hand"))
MALFORMED = [
    ("", 1, "the document", "not well-formed"),
    ("mass = 3", 1, "the document", "not well-formed"),
    ('<robot name="r">\n<link name="arm">\n', 3, "<link name='arm'>", "not well-formed"),
    (robot('<link name="arm">', "</joint>"), 3, "<link name='arm'>", "not well-formed"),
    (robot('<link name="a" name="b"/>'), 2, "<robot name='r'>", "not well-formed"),
    (robot('<link name="&arm;"/>'), 2, "<robot name='r'>", "not well-formed"),
    ('<!DOCTYPE robot [\n<!ENTITY a "x">\n]>\n<robot name="&a;"/>', 2, *ENTITY),
    ('<!DOCTYPE robot [\n<!ENTITY a "xxxxxxxx">\n<!ENTITY b "&a;&a;&a;&a;">\n]>\n<robot name="&b;"/>', 2, *ENTITY),
    ('<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/hostname">]>\n<robot name="r">&a;</robot>', 1, *ENTITY),
    ('<?xml version="1.0" encoding="no-such"?>\n<robot/>', 1, "the document", "not well-formed|decoded"),
    ('<sdf version="1.6">\n</sdf>', 1, "<sdf>", "must be <robot>"),
    ('<robot name="r">\n</robot>', 1, "<robot name='r'>", "no <link>"),
    ('<robot name="">\n<link name="a"/></robot>', 1, "<robot>", "'name' is empty"),
    (robot('<xacro:include filename="a"/>'), 2, "<xacro:include>", "Run it through the program xacro"),
    (robot('<lnk name="arm"/>'), 2, "<lnk name='arm'>", "Did you mean <link>"),
    (robot(BASE, '<jiont name="e"/>'), 3, "<jiont name='e'>", "Did you mean <joint>"),
    (robot(BASE, INERTIAL), 3, "<inertial>", "is a direct child of <robot>"),
    (robot("<link/>"), 2, "<link>", "no attribute 'name'"),
    (robot('<link name=" "/>'), 2, "<link>", "'name' is empty"),
    (robot(f'<link name="{"a" * 101}"/>'), 2, "<link name=", "1 to 100"),
    (robot(BASE, BASE), 3, "<link name='base'>", "line 2 uses this name, too"),
    (robot(BASE, ARM, HAND, HINGE, joint("elbow", "base", "hand")), 6, ELBOW, "line 5 uses this name, too"),
    (link(INERTIAL + INERTIAL), 3, "<inertial> of <link name='arm'>", "second <inertial>"),
    (link("<inertail/>"), 3, "<inertail> of <link name='arm'>", "Did you mean <inertial>"),
    (inertial(moments()), 3, "<inertial> of <link name='arm'>", "no <mass>"),
    (inertial("<mass/>" + moments()), 3, "<mass> of <link name='arm'>", "no attribute 'value'"),
    (inertial('<mass vale="1"/>' + moments()), 3, "<mass> of", "Did you mean 'value'"),
    (inertial('<mass value="heavy"/>' + moments()), 3, "<mass> of", "'heavy', which is not a number"),
    (inertial('<mass value="${m}"/>' + moments()), 3, "<mass> of", "Run the file through xacro first"),
    (inertial('<mass value="-1"/>' + moments()), 3, "<mass> of", "-1 is negative"),
    (inertial('<mass value="inf"/>' + moments()), 3, "<mass> of", "not finite"),
    (inertial('<mass value="1 2"/>' + moments()), 3, "<mass> of", "contains 2 numbers. Write 1"),
    (inertial('<mass value="1"/>'), 3, "<inertial> of <link name='arm'>", "no <inertia>"),
    (inertial('<mass value="1"/>' + moments(izz=None)), 3, "<inertia> of", "no attribute 'izz'"),
    (inertial('<origin xyz="1 2"/>'), 3, "<origin> of <link name='arm'>", "2 numbers. Write 3"),
    (inertial('<orign xyz="1 2 3"/>'), 3, "<orign> of <link name='arm'>", "Did you mean <origin>"),
    (inertial('<origin quat="1 0 0 0"/>'), 3, "<origin> of", "'quat' is not known. Known attributes: xyz"),
    (link("<visual/>"), 3, "<visual> of <link name='arm'>", "no <geometry>"),
    (shape(""), 3, "<geometry> of <link name='arm'>", "this element is empty"),
    (shape('<cylindre radius="1"/>'), 3, "<cylindre> of", "Did you mean <cylinder>"),
    (shape("<box/>"), 3, "<box> of <link name='arm'>", "no attribute 'size'"),
    (shape('<box size="1 0 1"/>'), 3, "<box> of <link name='arm'>", "size 0 is not positive"),
    (shape('<sphere radius="1 2"/>'), 3, "<sphere> of <link name='arm'>", "2 numbers"),
    (shape('<cylinder radius="1"/>'), 3, "<cylinder> of", "no attribute 'length'"),
    (shape("<mesh/>"), 3, "<mesh> of <link name='arm'>", "no attribute 'filename'"),
    (robot(BASE, f'<joint type="fixed">{ENDS}</joint>'), 3, "<joint>", "no attribute 'name'"),
    (robot(BASE, f'<joint name="e">{ENDS}</joint>'), 3, "<joint name='e'>", "'type'"),
    (elbow("hinge", ""), 4, "<joint name='elbow'>", "type 'hinge' is not known"),
    (elbow("fixed", "", '<child link="arm"/>'), 4, "<joint name='elbow'>", "no <parent>"),
    (elbow("fixed", "", '<parent link="base"/>'), 4, "<joint name='elbow'>", "no <child>"),
    (elbow("fixed", "", "<parent/>"), 5, "<parent> of <joint name='elbow'>", "'link'"),
    (elbow("fixed", "", ENDS.replace("arm", "amr")), 5, "<child> of", "no link 'amr'; did you mean"),
    (elbow("fixed", "", ENDS.replace("base", "arm")), 4, "<joint name='elbow'>", "are both 'arm'"),
    (elbow("continuous", '<axis xyz="0 0 0"/>'), 5, "<axis> of <joint name='elbow'>", "no direction"),
    (elbow("continuous", "<axis/>"), 5, "<axis> of <joint name='elbow'>", "no attribute 'xyz'"),
    (elbow("revolute", ""), 4, "<joint name='elbow'>", "must have limits"),
    (elbow("revolute", '<limit lower="2" upper="1"/>'), 5, "<limit> of", "Exchange the two"),
    (elbow("revolute", '<limit effort="-1"/>'), 5, "<limit> of", "effort -1 is negative"),
    (elbow("continuous", '<dynamics damping="-1"/>'), 5, "<dynamics> of", "damping -1 is negative"),
    (elbow("planar", '<dynamics damping="1"/>'), 5, "<dynamics> of", "has several rates"),
    (elbow("continuous", '<mimik joint="a"/>'), 5, "<mimik> of", "Did you mean <mimic>"),
    (
        robot(BASE, ARM, HINGE, joint("other", "base", "arm")),
        5,
        "<child> of <joint name='other'>",
        "joint 'elbow' in line 4 already carries the link 'arm'",
    ),
    (robot(BASE, ARM), 3, "<link name='arm'>", "no joint carries this link, and no joint carries 'base'"),
    (robot(BASE, ARM, HINGE, joint("back", "arm", "base")), 1, "<robot name='r'>", "joints form a closed loop"),
    (robot(BASE, ARM, HAND, *CIRCLE), 5, ELBOW, "this joint form a closed loop"),
]
PASSED_OVER = [
    (robot('<link name="a.b"/>'), 2, "<link name='a.b'>", "cannot be used"),
    (inertial('<mass value="1"/>' + moments(izz="9")), 3, "<inertia> of", "must not exceed the sum"),
    (inertial('<mass value="1"/>' + moments(ixx="-1")), 3, "<inertia> of", "is negative"),
    (inertial('<mass value="1"/>' + moments(ixy="3")), 3, "<inertia> of", "is negative"),
    (elbow("continuous", '<dynamics stiffness="1"/>'), 5, "<dynamics> of", "'stiffness' is not"),
    (elbow("continuous", '<mimic joint="a"/>'), 5, "<mimic> of <joint name='elbow'>", "no joint 'a'"),
    (elbow("fixed", '<mimic joint="elbow"/>'), 5, "<mimic> of", "no angle or displacement, so it cannot follow"),
    (elbow("continuous", '<mimic joint="elbow" offset="0.3"/>'), 5, "<mimic> of", "'elbow' follows itself. Use"),
    (
        robot(HAND, HINGE, *elbow("fixed", "", ENDS.replace("base", "hand").replace("arm", "base")).splitlines()[1:-1])
        .replace("elbow", "wrist", 1)
        .replace("</joint>", '<mimic joint="elbow"/></joint>', 1),
        3,
        "<mimic> of <joint name='wrist'>",
        "fixed joint 'elbow' has no angle or displacement. Use another joint",
    ),
    (
        elbow("continuous", '<limit velocity="1" gear_velocity="9"/>'),
        5,
        "<limit> of <joint name='elbow'>",
        "'gear_velocity' is not known. Did you mean 'velocity'",
    ),
    (elbow("floating", '<mimic joint="elbow"/>'), 5, "<mimic> of", "no angle or displacement, so it cannot follow"),
]


@pytest.mark.parametrize(("text", "line", "element", "fault"), [*MALFORMED, *PASSED_OVER])
def test_a_fault_is_one_sentence_with_line_and_element(text, line, element, fault, tmp_path):
    path = written(tmp_path, text)
    message = refused(None, mb.load_urdf, path, strict=True)
    assert message.startswith(f"bad.urdf, line {line}, {element}"), message
    assert re.search(fault, message), message
    assert "\n" not in message and re.search(r"[.?]$", message), message
    if (text, line, element, fault) in MALFORMED:  # an error by default, too
        assert refused(None, mb.load_urdf, path) == message


@pytest.mark.parametrize(("text", "line", "element", "fault"), PASSED_OVER)
def test_faults_that_do_not_matter_are_told_once(text, line, element, fault, tmp_path):
    with pytest.warns(mb.SymmbWarning) as told:
        mb.load_urdf(written(tmp_path, text, "odd.urdf"))
    assert len(told) == 1 and "odd.urdf: These faults are ignored: " in str(told[0].message)
    assert f" (line {line})" in str(told[0].message) and "strict=True" in str(told[0].message)


def test_all_faults_are_told_at_once(tmp_path):
    text = robot('<link name="a b"/>', '<link name="c"><inertial/></link>', '<joint name="d" type="x"/>')
    error = refused(None, mb.load_urdf, written(tmp_path, text), strict=True)
    assert [re.match(r"bad.urdf, line (\d)", line)[1] for line in error.split("\n")] == ["2", "3", "4"]


def test_extensions_of_other_programs_are_passed_over(tmp_path):
    more = ('<gazebo reference="arm"><mu1>0.2</mu1></gazebo>', '<transmission name="t"><type>x</type></transmission>')
    more += ('<ros2_control name="c"/>', '<material name="red"><color rgba="1 0 0 1"/></material>')
    capsule = '<visual><geometry><drake:capsule radius="1" length="2"/></geometry></visual>'
    mesh = '<visual><geometry><mesh filename="file://[::1"/></geometry></visual>'  # an address that is none
    text = robot(BASE, ARM.replace("<inertial>", f"{capsule}{mesh}<inertial>"), HINGE, *more)
    assert set(mb.load_urdf(written(tmp_path, text)).joints) == {"elbow"}


def beyond(mass, place):
    """Numbers of no machine, whose products are no numbers: the body was called one with NaN."""
    return inertial(f'<origin xyz="{place}"/><mass value="{mass}"/>{moments()}'), r"exceeds 1e\+30. Use SI units\.$"


MORE = [(robot(HINGE), r"no link 'base'\.\n.* no link 'arm'\.$")]
MORE += [beyond("1e200", "0 0 0"), beyond("1", "1e31 0 0"), beyond("1", "0 -1e300 0")]


@pytest.mark.parametrize(("text", "message"), MORE)
def test_joints_without_any_link_and_numbers_beyond_those_of_any_machine(text, message, tmp_path):
    refused(message, mb.load_urdf, written(tmp_path, text))


@pytest.mark.parametrize(
    "options",
    [
        {"fixed_base": "False"}, {"fixed_base": 1}, {"fixed_base": np.array([True])}, {"replace": np.ones(2)},
        {"replace": "arm.mass"}, {"replace": {"arm.mass": True}}, {"stop": True}, {"stop": np.ones(2)},
        {"stop": "hard"},
    ],
    ids=str,
)  # fmt: skip
def test_options_of_other_kinds(options, tmp_path):
    refused(next(iter(options)), mb.load_urdf, written(tmp_path, robot(BASE, ARM, HINGE)), **options)


@pytest.mark.parametrize("prefix", ["", "urdf:", "r0:"])
def test_elements_may_be_in_a_namespace(prefix, tmp_path):
    """Those of other namespaces are extensions, whatever their names are."""
    text = robot(BASE, ARM, HINGE, '<x:link name="other"/>', "<x:jiont/>").replace("<robot", '<robot xmlns:x="a"')
    text = re.sub(r"<(/?)(?!/|x:)", rf"<\1{prefix}", text)
    declared = f'xmlns{prefix.replace("urdf:", ":urdf").replace("r0:", ":r0")}="b" xmlns:x'
    machine = mb.load_urdf(written(tmp_path, text.replace("xmlns:x", declared)), strict=True)
    assert set(machine.joints) == {"elbow"} and set(machine.bodies) == {"base", "arm"}


def test_of_joints_that_follow_each_other_in_a_circle_one_is_free(tmp_path):
    follow = ('<mimic joint="wrist"/>', '<mimic joint="elbow" multiplier="2" offset="0.1"/>')
    joints = [HINGE, HINGE.replace("elbow", "wrist").replace("arm", "hand").replace("base", "arm")]
    joints = [own.replace("</joint>", f"{inside}</joint>") for own, inside in zip(joints, follow, strict=True)]
    path = written(tmp_path, robot(BASE, ARM, ARM.replace("arm", "hand"), *joints))
    machine = warned("follow themselves, so the followers move freely", mb.load_urdf, path)
    assert set(machine.start) == {"elbow.angle"}
    system = mb.System(*machine.elements)
    run = mb.simulate(mb.Scene(system, {"elbow.angle": 0.2}, [0.0], {"wrist": machine.joints["wrist"].angle}))
    assert run["wrist"][0] == pytest.approx(2 * 0.2 + 0.1)
    refused(r"'elbow' follows itself.*\n.*'wrist' follows itself", mb.load_urdf, path, strict=True)
