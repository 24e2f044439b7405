"""Coordinate partitioning against equations by hand, known digits and another solver."""

import numpy as np
import problems
import pytest
from faults import refused
from mechanisms import MECHANISMS, double_pendulum

import symmb as mb


@pytest.mark.parametrize("name", MECHANISMS)
def test_it_agrees_with_equations_by_hand(name):
    mechanism = MECHANISMS[name]
    run = mb.simulate(mechanism.scene(), mb.StateSpace(rtol=1e-10))
    np.testing.assert_allclose(run.values, mechanism.by_hand(mechanism.nominal), atol=2e-8)
    assert run.position_drift < 1e-12 and run.velocity_drift < 1e-11 and run.energy_drift < 1e-8
    assert name != "spatial" or run.statistics["integrator"]["choices of coordinates"] > 1


def test_it_passes_a_dead_point():
    """Where the crank's angle does not tell where the rod is."""
    known = problems.KNOWN["dead_point"]
    run = mb.simulate(problems.slider_crank("dead_point").make().with_times(known["times"][:5]), mb.StateSpace())
    assert np.abs(run["theta"] - np.array(known["values"])[:5, 0]).max() < 1e-4


def test_bounds_by_it_are_those_by_others():
    scene = double_pendulum(np.linspace(0, 0.5, 6), box=mb.Box(l1=(0.95, 1.05), l2=(0.76, 0.84)))
    found, known = (mb.propagate(scene, mb.PolynomialChaos(order=2), solver=s) for s in (mb.StateSpace(), None))
    np.testing.assert_allclose(found.lower, known.lower, atol=1e-6)


def test_it_gives_no_derivatives():
    simulator = mb.DAESimulator(double_pendulum(), mb.StateSpace())
    refused("gives no derivatives", simulator.jets, np.array([1.0, 0.8]), np.eye(2), 1, error=mb.PropagationError)
