"""Values at the start of a run: kept along it, for every sample, and followed by Taylor's method."""

import numpy as np
import pytest
from faults import refused

import symmb as mb

G = 9.81


def hanging() -> mb.Scene:
    """A mass on a spring in equilibrium at -m g / k, which a force pulls from 0 on: F/k (1 - cos) more."""
    p = mb.Parameters(stiffness=40.0)
    block = mb.Body("block", mass=2.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), block.point(0, 0), p.stiffness)
    pull = mb.Force("pull", block.point(0, 0), (0, -3.0 * mb.Table([0.0, 1e-9], [0.0, 1.0])(mb.t)))
    system, times = mb.System(block, spring, pull, mb.Gravity(0, -G), parameters=p), np.linspace(0.0, 1.0, 11)
    outputs = {"way": block.y - mb.initial(block.y), "start": mb.initial(block.y)}
    return mb.Scene(system, {}, times, outputs, mb.Box(stiffness=(36.0, 44.0)), equilibrium=True)


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES()], ids=repr)
def test_every_sample_keeps_its_own(solver):
    scene = hanging()
    Y = mb.DAESimulator(scene, solver).run(np.array([[36.0], [44.0]])).Y
    for values, k in zip(Y, (36.0, 44.0), strict=True):
        way = -3.0 / k * (1 - np.cos(np.sqrt(k / 2.0) * scene.times))
        assert values[:, 0] == pytest.approx(way, abs=1e-7)
        assert values[:, 1] == pytest.approx(np.full(11, -2.0 * G / k), abs=1e-9)


def test_taylor_follows_it():
    low, high = mb.propagate(hanging(), mb.Taylor(order=4))["start"]
    assert low == pytest.approx(np.full(11, -2.0 * G / 36.0), rel=1e-3)
    assert high == pytest.approx(np.full(11, -2.0 * G / 44.0), rel=2e-2)  # even powers count from 0


def test_what_has_no_start_to_be_kept_is_refused():
    block = mb.Body("block", mass=2.0, pose=mb.Particle())
    for expression in (block.vy, block.y * mb.t, 0 * block.y):
        refused("coordinates and parameters only", mb.initial, expression)
