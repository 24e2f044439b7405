"""Scenes and runs are pickled, and simulate bitwise alike in another process."""

import importlib
import pickle
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import symmb as mb

CHILD = """
import pickle, sys
import numpy as np
import symmb as mb
scene, run = pickle.load(sys.stdin.buffer)
again = mb.simulate(scene)
sys.stdout.buffer.write(pickle.dumps((again.values, again.lam, run.values, run.energy, str(run))))
"""
MODELS = (
    "double_pendulum slider_crank_spatial heavy_top rolling_disc flexible_pendulum bouncing_ball stick_slip".split()
)


@pytest.mark.parametrize("name", MODELS)
def test_scenes_and_runs_are_the_same_in_another_process(name):
    scene = importlib.import_module(f"models.{name}").scene()
    scene = scene.with_times(np.linspace(scene.times[0], scene.times[0] + 0.2 * np.ptp(scene.times), 21))
    run = mb.simulate(scene)
    options = {"input": pickle.dumps((scene, run)), "capture_output": True, "check": True}
    end = subprocess.run([sys.executable, "-c", CHILD], cwd=Path(__file__).parents[2], **options)
    values, lam, values_before, energy, text = pickle.loads(end.stdout)
    assert np.array_equal(values, run.values) and np.array_equal(lam, run.lam)
    assert np.array_equal(values_before, run.values) and np.array_equal(energy, run.energy) and text == str(run)


def test_symbols_stay_themselves():
    p = mb.Parameters(k=3.0)
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    spring = p.k * (mass.x - mb.initial(mass.x)) * (1 + ca.sin(mb.t))
    hold = mb.Motion("hold", mass.y, 0.1 * ca.sin(mb.t))
    system = mb.System(mass, hold, mb.Force("pull", mass.point(0, 0), (1 - spring, 0)), parameters=p)
    outputs = {"x": mass.x, "force": system.lam("hold"), "a": system.ddt(mass.vx), "law": ca.cos(mb.t)}
    scene = mb.Scene(system, {"mass.x": 0.5}, np.linspace(0, 2, 5), outputs, mb.Box(k=(2.0, 4.0)))
    copy = pickle.loads(pickle.dumps(scene))
    run, again = mb.simulate(scene), mb.simulate(copy)
    assert np.array_equal(run.values, again.values)
    assert np.array_equal(run(mass.x * p.k), again(copy.system.bodies[0].x * copy.system.parameters.k))
    assert mb.simulate(pickle.loads(pickle.dumps(copy)))["law"][-1] == np.cos(2.0)
    with pytest.raises(mb.DeclarationError, match="belongs to another body"):
        again(mass.x)
    assert copy.box == scene.box and copy.name == scene.name
