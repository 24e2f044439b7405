"""Systems of many bodies."""

import numpy as np
import pytest

import symmb as mb
from symmb.run.integrate import stiffness


def test_a_long_chain_of_particles_runs():
    """300 particles on springs: the memory grows with their number, and the fastest frequency is that of a chain."""
    n, k = 300, 100.0
    bodies = [mb.Body(f"b{i}", 1.0, pose=mb.Particle()) for i in range(n)]
    ends = [mb.Ground().point(0, 0), *(body.point(0, 0) for body in bodies)]
    springs = [mb.Spring(f"s{i}", ends[i], ends[i + 1], k, 1.0) for i in range(n)]
    start = {f"b{i}.x": 1.0 + i + (0.1 if i == n - 1 else 0.0) for i in range(n)}
    scene = mb.Scene(mb.System(*bodies, *springs), start, [0.0, 0.05], {"x": bodies[-1].x})
    simulator = mb.prepare(scene)
    x = simulator.start.states(simulator.dae.p_nominal[None])[0]
    fastest = stiffness(simulator.dae, x, simulator.dae.p_nominal, np.zeros(1))
    assert fastest.frequency == pytest.approx(2 * np.sqrt(k) * np.cos(np.pi / (4 * n + 2)), rel=0.03)
    assert mb.simulate(scene)["x"][-1] == pytest.approx(n + 0.1 * np.cos(10 * 0.05), rel=1e-4)
