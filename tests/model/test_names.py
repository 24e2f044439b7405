"""Names that would break C, LaTeX, tables, pictures or files: refused, or harmless."""

import numpy as np
import pytest
from faults import refused
from processes import printed_lines

import symmb as mb

COMMAND = 'x */ system("touch pwned"); /*'
BAD = [COMMAND, "a\nb", "tab\there", "\x1b[31mred", "", " padded ", "right\u202eleft", "n" * 101, "nul\0"]
BAD += [3, None, ("x",)]
ODD = ["naïve θ", *'a*/b 50% $x_{ back\\slash quo"te <b>&amp; .. ../up #1~^{} -rf {0} %s%n ??/'.split()]


def scene(body="rod", parameter="l", output="x", joint="hinge"):
    p = mb.Parameters(**{parameter: 1.0})
    rod = mb.Body(body, 1.0, 0.1, mb.Planar())
    hinge = mb.Revolute(joint, mb.Ground().point(0, 0), rod.point(-p.symbols[0] / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(system, {}, np.linspace(0, 0.1, 3), {output: rod.x}, box=mb.Box(**{parameter: (0.9, 1.1)}))


@pytest.mark.parametrize("kind", ["body", "parameter", "output", "joint"])
@pytest.mark.parametrize("name", BAD, ids=repr)
def test_bad_names_are_refused(kind, name):
    if kind == "parameter" and not isinstance(name, str):
        pytest.skip("keywords are texts")
    if kind == "output" and name == COMMAND:
        pytest.skip("harmless: test_odd_names_do_no_harm")
    text = refused("(a|the) name must", scene, **{kind: name})
    assert text.isprintable() or "\n" in text


@pytest.mark.parametrize("name", ODD, ids=repr)
def test_odd_parameters_are_refused(name):
    refused("the name must consist of letters, digits and underscores", scene, parameter=name)


@pytest.mark.parametrize("name", [*ODD, COMMAND.replace(" ", "")], ids=repr)
def test_odd_names_do_no_harm(tmp_path, name):
    body = name if not any(c in name for c in ".[] ") else "rod"
    made = scene(body=body, joint=f"{body}'", output=name)
    simulator = mb.DAESimulator(made)
    simulator.dae.save_c(tmp_path / "c", {**simulator.start.nominal(), "times": simulator.times})
    head, *rows = printed_lines(tmp_path / "c")
    assert head.split()[:2] == ["t", f"{body}.x"] and len(rows) == 101
    assert not list(tmp_path.glob("**/pwned"))
    latex = made.system.latex()
    for escaped in (r"\{", r"\}", r"\%", r"\#"):
        latex = latex.replace(escaped, "")
    assert latex.count("{") == latex.count("}") and "%" not in latex and "#" not in latex
    run = mb.simulate(made)
    run.plot(tmp_path / "run.png")
    for suffix in ("csv", "npz", "json"):
        run.save(tmp_path / f"run.{suffix}")
        np.testing.assert_array_equal(mb.Trajectory.load(tmp_path / f"run.{suffix}")[name], run[name])
    comparison = mb.compare(made, mb.Vertex())
    comparison.plot(tmp_path / "c.png")
    assert name in str(comparison)
