"""Every example runs and its assertions hold; the README's code does what it says."""

import re
import runpy
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy

import symmb as mb

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_example(path):
    runpy.run_path(str(path), run_name="example")


README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_code_of_the_readme(capsys, tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 1 and len(blocks[0].splitlines()) <= 30
    namespace = {}
    exec(blocks[0], namespace)
    lower, upper = namespace["bounds"]["tip_y"]
    run = namespace["run"]["tip_y"]
    assert (lower <= run + 1e-6).all() and (run <= upper + 1e-6).all()
    assert "PolynomialChaos.paper(order=2)" in capsys.readouterr().out
    monkeypatch.chdir(tmp_path)
    exec(re.sub("^    ", "", re.search(r"(    run\.plot.*?)\n\n", README, re.DOTALL)[1], flags=re.MULTILINE), namespace)
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"run.png", "run.csv", "bounds.png", "bounds.npz", "c.png", "c.json"}


def test_law_of_the_readme():
    law = eval(re.search(r"`mb\.Torque\(.*, rod, (.*)\)`", README)[1], {"sympy": sympy})
    p = mb.Parameters(stiffness=40.0)
    rod = mb.Body("rod", mass=1.0, inertia=1.0, pose=mb.Planar())
    torque = mb.System(rod, mb.Torque("detent", rod, law), parameters=p).Q[2]
    assert ca.Function("torque", [p.stiffness, rod.theta], [torque])(40.0, 0.1) == pytest.approx(-40.0 * np.sin(0.4))
