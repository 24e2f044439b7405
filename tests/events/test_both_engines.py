"""Runs with impacts in C and with NumPy: the same events at the same times."""

from dataclasses import astuple

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from test_impacts import G, dropped, rods

import symmb as mb
from models import bouncing_ball
from symmb.codegen import ArrayEngine, Engine


def flat_rod(e):
    """A rod that falls on both ends, whose impacts at one instant depend on their order."""
    rod = mb.Body("rod", 1.0, 1 / 12, mb.Planar())
    ends = [mb.Impact(name, rod.point(x, 0).y, e) for name, x in (("left", -0.5), ("right", 0.5))]
    return mb.Scene(mb.System(rod, mb.Gravity(0, -G), *ends), {"rod.y": 1.0}, np.linspace(0, 2, 21))


def thrown():
    """A ball that a swinging table throws and catches."""
    ball = mb.Body("ball", 2.0, pose=mb.Particle())
    table = mb.Impact("table", ball.y - 0.1 * ca.sin(15 * mb.t), 0.3)
    start = {"ball.y": 0.0, "ball.vy": 1.5}
    return mb.Scene(mb.System(ball, mb.Gravity(0, -G), table), start, np.linspace(0, 1, 41))


SCENES = {
    "rest": dropped(0.6, np.linspace(0, 4, 41), y=1.0, vx=1.0),
    "rods": rods(0.6, 0.0, np.linspace(0, 3, 31)),
    "flat": flat_rod(0.5),
    "thrown": thrown(),
}


@pytest.mark.filterwarnings("ignore:.*depends on their order")
@pytest.mark.parametrize("name", SCENES)
def test_events_are_the_same(name, monkeypatch):
    scene = SCENES[name]
    compiled = mb.simulate(scene)
    monkeypatch.setattr("symmb.integrate.explicit.has_compiler", lambda: False)
    arrays = mb.simulate(scene)
    assert len(compiled.events) > 1
    for event, other in zip(compiled.events, arrays.events, strict=True):
        assert (event.name, event.what, event.depends_on_order) == (other.name, other.what, other.depends_on_order)
        assert_allclose(astuple(event)[3:6], astuple(other)[3:6], rtol=1e-7, atol=1e-9)
        assert_allclose(event.time, other.time, rtol=1e-9)
    assert_allclose(compiled.values, arrays.values, rtol=1e-7, atol=1e-8)
    assert compiled.doubts == arrays.doubts


def test_samples_and_their_counts_of_events_are_the_same(monkeypatch):
    P = np.column_stack([np.linspace(0.5, 1.2, 15), np.linspace(-0.1, 1.5, 15)])  # some cannot start
    found, kinds = [], []
    for compiles in (True, False):
        if not compiles:
            monkeypatch.setattr("symmb.integrate.explicit.has_compiler", lambda: False)
        simulator = mb.DAESimulator(bouncing_ball.scene())
        found.append(simulator.run(P))
        kinds.append(type(simulator.engine()))
    compiled, arrays = found
    assert kinds == [Engine, ArrayEngine] or kinds == [ArrayEngine] * 2
    assert_allclose(compiled.Y, arrays.Y, rtol=0, atol=1e-9)
    assert_array_equal(compiled.events, arrays.events)
    assert compiled.messages == arrays.messages and len(compiled.messages) == 5
