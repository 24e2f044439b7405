"""URDF files as scenes of the command line."""

import json

import numpy as np
import pytest

from symmb.show.cli.main import main
from symmb.show.cli.urdf_scene import parameter_name

PENDULUM = """
<robot name="pendulum"><link name="wall"/>
<link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="wall"/><child link="rod"/><axis xyz="0 1 0"/>
<dynamics damping="0.1"/></joint></robot>
"""


@pytest.fixture
def pendulum(tmp_path):
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM)
    return str(path)


def refused(capsys, *arguments):
    assert main(arguments) == 2
    return capsys.readouterr().err


def test_simulate_with_numbers_of_the_file(pendulum, tmp_path, capsys):
    """The pendulum falls from the horizontal: its acceleration at the start is m g c / (J + m c^2)."""
    out = tmp_path / "run.json"
    assert main(["simulate", pendulum, "--set", "rod.mass=4", "rod.com.x=0.25", "--json", str(out)]) == 0
    run = json.loads(out.read_text())
    assert run["outputs"] == ["hinge"] and run["parameters"] == {"rod_mass": 4.0, "rod_com_x": 0.25}
    angle, t = np.array(run["values"])[:, 0], np.array(run["times"])
    assert angle[0] == 0.0
    assert abs(2 * angle[1] / t[1] ** 2 - 4 * 9.81 * 0.25 / (0.1 + 4 * 0.25**2)) < 0.05


def test_compare_over_uncertain_numbers(pendulum, tmp_path, capsys):
    out = tmp_path / "bounds.json"
    arguments = "--spread 5% --uncertain rod.mass hinge.damping --methods vertex --json".split()
    assert main(["compare", pendulum, *arguments, str(out)]) == 0
    box = json.loads(out.read_text())["box"]
    assert box == {"rod_mass": pytest.approx([1.9, 2.1]), "hinge_damping": pytest.approx([0.095, 0.105])}


def test_view_and_equations(pendulum, tmp_path, capsys):
    page = tmp_path / "page.html"
    assert main(["view", pendulum, "-o", str(page)]) == 0 and page.stat().st_size > 10_000
    assert main(["equations", pendulum, "--joint"]) == 0
    assert "Q = [-0.1⋅q̇_hinge + 9.81⋅cos(q_hinge)]" in capsys.readouterr().out


def test_uncertain_names_parameters_of_any_scene(tmp_path, capsys):
    out = tmp_path / "bounds.json"
    arguments = ["--spread", "2%", "--uncertain", "l2", "--methods", "vertex", "--json", str(out)]
    assert main(["compare", "double_pendulum", *arguments]) == 0
    assert json.loads(out.read_text())["box"] == {"l2": [0.98, 1.02]}


def test_what_is_wrong_is_told(pendulum, tmp_path, capsys):
    compare = ["compare", pendulum, "--methods", "vertex"]
    assert "needs the width of the intervals" in refused(capsys, *compare, "--uncertain", "rod.mass")
    assert "Name the parameters by --uncertain" in refused(capsys, *compare, "--spread", "5%")
    assert "Did you mean 'rod.mass'" in refused(capsys, *compare, "--spread", "5%", "--uncertain", "rod.mas")
    assert "'hinge_origin_x' is 0" in refused(capsys, *compare, "--spread", "5%", "--uncertain", "hinge.origin.x")
    assert "There is no scene file none.urdf" in refused(capsys, "simulate", "none.urdf")
    still = tmp_path / "still.urdf"
    still.write_text('<robot name="still"><link name="wall"/></robot>')
    assert "no joint of this file moves" in refused(capsys, "simulate", str(still))
    still.write_text('<robot name="still"><lnk name="wall"/></robot>')
    assert "still.urdf, line 1, <lnk name='wall'>" in refused(capsys, "simulate", str(still))


def test_names_of_parameters():
    assert [parameter_name(name) for name in ("forearm.mass", "1-link.com.x")] == ["forearm_mass", "_1_link_com_x"]
