"""The recipes of CONTRIBUTING: in a copy of the package, one of each kind is added by the files that they name."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "symmb"

JOINT = '''

class SameDirection(AxisJoint):
    """The axes stay parallel; points are free."""

    poses = (_SPATIAL, _SPATIAL)
    without = "This joint has no coordinate."

    def position_rows(self, bind: Bind) -> ca.SX:
        return self._parallel()
'''
SKETCH = """

@sketch.register
def _(joint: SameDirection, survey: Survey) -> Sketch:
    b = survey.place(joint.point_b)
    axis = _axis(joint, survey)
    u = yield
    yield shape_of(joint, "ring", JOINT, (b,), (2.0 * u, 0.5 * u), direction=unit_vectors(axis))
"""
SOLVER = '''"""The midpoint rule."""

from dataclasses import dataclass

import casadi as ca

from symmb._types import Array
from symmb.declare.symbolic import common
from symmb.equations.model import DAE
from symmb.run.integrate.fixed_step import Advance, fixed_step_integration
from symmb.run.integrate.initial_value_problem import build_problem
from symmb.run.integrate.integration import Integration
from symmb.run.integrate.solver import Solver


@dataclass(frozen=True, repr=False)
class Midpoint(Solver):
    """Steps of order 2 with the slope in their middle."""

    steps: int = 1000

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        problem = build_problem(dae, None, algebraic=False, work=work, one_step=True).jets(order)
        n_x, n_quad = problem.x.numel(), problem.quad.numel()
        rates = common("rates", [problem.x, problem.p, problem.t], [problem.ode, problem.quad])
        w, h = ca.SX.sym("w", n_x + n_quad), ca.SX.sym("h")
        first, _ = rates(w[:n_x], problem.p, problem.t - h)
        slope = ca.vertcat(*rates(w[:n_x] + h / 2 * first, problem.p, problem.t - h / 2))
        start = ca.vertcat(problem.x, ca.SX.zeros(n_quad))
        begin = ca.Function("begin", [problem.x, problem.p, problem.t, h], [start])
        step = common("step", [w, problem.p, problem.t, h], [w + h * slope])
        return fixed_step_integration(Advance(begin, step, n_x, n_quad), times, self.fixed_step(times))
'''
METHOD = '''"""Extremes over the middle of the box and its corners."""

import numpy as np

from symmb._types import Array
from symmb.bound.methods.method import Method
from symmb.bound.nodes import corners
from symmb.bound.responses import RunsOverBox


class Ends(Method):
    """The middle of the box and its corners."""

    kind = "sampled"

    def bounds(self, runs: RunsOverBox) -> tuple[Array, Array]:
        unit = np.concatenate([np.zeros((1, len(runs.box))), corners(len(runs.box))])
        Y = runs(runs.box.from_unit(unit))
        return Y.min(axis=0), Y.max(axis=0)
'''
USES = """
import numpy as np
import symmb as mb
from symmb.show.drawing import draw

block = mb.Body("block", 2.0, (1.0, 2.0, 3.0), mb.Spatial())
keep = mb.SameDirection("keep", mb.Ground().point(0, 0, 0), block.point(0, 0, 0), axis=(0, 0, 1))
p = mb.Parameters(push=4.0)
push = mb.Force("push", block.point(0, 0, 0), (p.push, 0, 0))
pushed = mb.System(block, keep, push, mb.Torque("m", block, (5.0, 0, 6.0)))
scene = mb.Scene(pushed, times=np.linspace(0, 1, 11), outputs={"x": block.x}, box=mb.Box(push=(3.0, 5.0)))
run = mb.simulate(scene)
np.testing.assert_allclose(run(block.x), run.t**2, atol=1e-9)  # 4 N on 2 kg
np.testing.assert_allclose(run(block.omega[2]), 2 * run.t, atol=1e-9)  # 6 N m on 3 kg m^2
np.testing.assert_allclose(run(block.omega[0]), 0, atol=1e-9)  # the joint takes the 5 N m
assert [s.form for s in draw(run).shapes if s.name == "keep"] == ["ring"]

fall = mb.Body("fall", 1.0, pose=mb.Particle())
spring = mb.Spring("spring", mb.Ground().point(0, 0), fall.point(0, 0), 4.0)
swing = mb.Scene(mb.System(fall, spring), {"fall.x": 1.0}, [0.0, 1.0], {"x": fall.x})
errors = [abs(mb.simulate(swing, f"mid:{n}")["x"][-1] - np.cos(2.0)) for n in (100, 200)]
assert 3.5 < errors[0] / errors[1] < 4.5, errors  # order 2
assert repr(mb.Midpoint(steps=7)) == "Midpoint(steps=7)"

bounds = mb.propagate(scene, "ends")
np.testing.assert_allclose([bounds.lower["x"][-1], bounds.upper["x"][-1]], [0.75, 1.25], atol=1e-7)
assert bounds.runs == 3 and "Ends()" in bounds.method
bounds.save("bounds.tsv")
again = mb.Bounds.load("bounds.tsv")
np.testing.assert_array_equal(again.upper, bounds.upper)
"""


def append(path: Path, text: str) -> None:
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) >= 1, f"{path} has no {old!r}"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_additions_touch_the_files_that_contributing_names(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "symmb", ignore=shutil.ignore_patterns("__pycache__"))
    symmb = tmp_path / "symmb"
    names = symmb / "__init__.pyi"

    append(symmb / "declare/mechanics/joint.py", JOINT)
    door = symmb / "declare/mechanics/__init__.pyi"
    replace(door, "    Revolute as Revolute,\n", "    Revolute as Revolute,\n    SameDirection as SameDirection,\n")
    replace(symmb / "show/drawing/joints.py", "    Revolute,\n", "    Revolute,\n    SameDirection,\n")
    append(symmb / "show/drawing/joints.py", SKETCH)
    append(names, "from .declare.mechanics.joint import SameDirection as SameDirection\n")

    (symmb / "run/integrate/midpoint.py").write_text(SOLVER, encoding="utf-8")
    registry = symmb / "run/integrate/registry.py"
    solver = "from symmb.run.integrate.solver"
    replace(registry, solver, f"from symmb.run.integrate.midpoint import Midpoint\n{solver}")
    entry = '    SolverEntry("mid[:STEPS]", "Midpoint(steps=STEPS)", Midpoint),\n'
    replace(registry, ")\nWORDS", f"{entry})\nWORDS")
    append(names, "from .run.integrate.midpoint import Midpoint as Midpoint\n")

    (symmb / "bound/methods/ends.py").write_text(METHOD, encoding="utf-8")
    registry = symmb / "bound/methods/registry.py"
    interval = "from symmb.bound.methods.interval"
    replace(registry, interval, f"from symmb.bound.methods.ends import Ends\n{interval}")
    replace(registry, "] = (\n", '] = (\n    MethodEntry("ends", "Ends()", Ends),\n')
    append(names, "from .bound.methods.ends import Ends as Ends\n")

    form = '    ".tsv": Format("table", _write_tabs, lambda data: _of_table(data.replace(b"\\t", b","))),\n'
    write = """def _write_tabs(file: BinaryIO, columns: Table) -> None:
    text = io.StringIO(newline="")
    csv.writer(text, delimiter="\\t").writerows([columns, *zip(*columns.values(), strict=True)])
    file.write(text.getvalue().encode())


"""
    formats = symmb / "results/files/formats.py"
    replace(formats, "FORMATS = {\n", f"{write}FORMATS = {{\n{form}")

    path = os.pathsep.join([str(tmp_path), str(PACKAGE.parent)])
    environment = os.environ | {"PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", USES], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
