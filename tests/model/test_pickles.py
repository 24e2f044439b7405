"""Scenes and runs are pickled, and simulate bitwise alike in another process."""

import importlib
import pickle
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from faults import refused

import symmb as mb

CHILD = """
import pickle, sys
import numpy as np
import symmb as mb
found = []
for scene, run in pickle.load(sys.stdin.buffer):
    again = mb.simulate(scene)
    found.append((again.values, again.lam, run.values, run.energy, str(run)))
sys.stdout.buffer.write(pickle.dumps(found))
"""
MODELS = (
    "double_pendulum slider_crank_spatial heavy_top rolling_disc flexible_pendulum bouncing_ball stick_slip".split()
)


@pytest.fixture(scope="module")
def here_and_there():
    """Name -> a run in this process, and what one other process has made of all scenes and runs."""
    scenes = [importlib.import_module(f"models.{name}").scene() for name in MODELS]
    scenes = [s.with_times(np.linspace(s.times[0], s.times[0] + 0.2 * np.ptp(s.times), 21)) for s in scenes]
    runs = [mb.simulate(scene) for scene in scenes]
    options = {"input": pickle.dumps([*zip(scenes, runs, strict=True)]), "capture_output": True, "check": True}
    end = subprocess.run([sys.executable, "-c", CHILD], cwd=Path(__file__).parents[2], **options)
    return dict(zip(MODELS, zip(runs, pickle.loads(end.stdout), strict=True), strict=True))


@pytest.mark.parametrize("name", MODELS)
def test_scenes_and_runs_are_the_same_in_another_process(name, here_and_there):
    run, (values, lam, values_before, energy, text) = here_and_there[name]
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
    refused("belongs to an object outside the System", again, mass.x)
    assert copy.box == scene.box and copy.name == scene.name
