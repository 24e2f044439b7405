"""Names that would break C, LaTeX, tables, pictures or files: refused, or harmless."""

import shutil
import subprocess

import numpy as np
import pytest

import symmb as mb

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
BAD = [
    'x */ system("touch pwned"); /*',
    "a\nb",
    "tab\there",
    "\x1b[31mred",
    "",
    " padded ",
    "right\u202eleft",
    "n" * 101,
    3,
    None,
    ("x",),
    "nul\0",
]
ODD = [
    "a*/b",
    "50%",
    "$x_{",
    "back\\slash",
    'quo"te',
    "<b>&amp;",
    "..",
    "../up",
    "naïve θ",
    "#1~^{}",
    "-rf",
    "{0}",
    "%s%n",
    "??/",
]


def scene(body="rod", parameter="l", output="x", joint="hinge"):
    p = mb.Parameters(**{parameter: 1.0})
    rod = mb.Body(body, 1.0, 0.1, mb.Planar())
    length = p.symbols[0]
    hinge = mb.Revolute(joint, mb.Ground().point(0, 0), rod.point(-length / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(
        system, times=np.linspace(0, 0.1, 3), outputs={output: rod.x}, box=mb.Box(**{parameter: (0.9, 1.1)})
    )


@pytest.mark.parametrize("kind", ["body", "parameter", "output", "joint"])
@pytest.mark.parametrize("name", BAD, ids=repr)
def test_bad_names_are_refused(kind, name):
    if kind == "parameter" and not isinstance(name, str):
        pytest.skip("keywords are texts")
    if kind == "output" and name == BAD[0]:
        pytest.skip("harmless: test_odd_names_do_no_harm")
    with pytest.raises(mb.DeclarationError, match=r"a name (is|has)") as error:
        scene(**{kind: name})
    assert str(error.value).isprintable() or "\n" in str(error.value)


@pytest.mark.parametrize("name", ODD, ids=repr)
def test_odd_parameters_are_refused(name):
    with pytest.raises(mb.DeclarationError, match="a name has letters, digits and underscores"):
        scene(parameter=name)


@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler")
@pytest.mark.parametrize("name", [*ODD, BAD[0].replace(" ", "")], ids=repr)
def test_odd_names_do_no_harm(tmp_path, name):
    body = name if not any(c in name for c in ".[] ") else "rod"
    made = scene(body=body, joint=f"{body}'", output=name)
    simulator = mb.DAESimulator(made)
    simulator.dae.save_c(tmp_path / "c", {**simulator.start.nominal(), "times": simulator.times})
    program = tmp_path / "c" / "program"
    subprocess.run([COMPILER, "main.c", "model.c", "-lm", "-o", str(program)], cwd=tmp_path / "c", check=True)
    printed = subprocess.run([str(program)], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert printed.split()[:2] == ["t", f"{body}.x"] and len(printed.splitlines()) == 102
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
