"""Particle swarms: cost, failures, and what every executor gives."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from faults import refused, warned
from oscillators import BOX, TIMES, Wave, wave, wave_bounds

from symmb import Box, FunctionSimulator, MonteCarlo, PropagationError, Swarm, propagate

FEW = np.array([0.0, 3.0, 6.0])


def fragile(amplitude, w):
    """The wave at a few times; breaks where both parameters are large."""
    if amplitude + w > 2.1:
        raise ValueError("too large")
    return amplitude * np.cos(w * FEW)


def simulator(f):
    return FunctionSimulator(f, {"amplitude": 1.0, "w": 1.0}, FEW, ["x"])


def test_every_swarm_searches_for_itself():
    method = Swarm(particles=4, steps=15, seed=1)
    result = propagate(simulator(lambda amplitude, w: wave(amplitude, w)[[0, 30, 60]]), method, BOX)
    assert result.evaluations == 2 * 3 * 4 * 15
    exact = wave_bounds()
    np.testing.assert_allclose([result.lower, result.upper], np.array(exact)[:, [0, 30, 60]], atol=1e-6)
    as_many = propagate(Wave(), MonteCarlo(result.evaluations), BOX)
    assert np.abs(as_many.upper - exact[1])[[0, 30, 60]].max() > 1e-3


def test_failed_runs_are_told_and_left_behind():
    result = warned(r"\d+ of 1200 runs failed", propagate, simulator(fragile), Swarm(), BOX)
    assert 0 < len(result.failed) < result.evaluations / 2
    assert all(run.parameters["amplitude"] + run.parameters["w"] > 2.1 for run in result.failed)
    assert result.upper[0, 0] == pytest.approx(1.1, abs=1e-3)  # amplitude 1.1 wherever w <= 1
    assert np.isfinite(result.lower).all()


def test_all_runs_failed():
    method, box = Swarm(particles=4, steps=5), Box(amplitude=(1.5, 1.6))
    refused("all 120 runs failed", propagate, simulator(fragile), method, box, error=PropagationError)


def test_same_seed_same_bounds_whatever_the_executor():
    alone = propagate(Wave(), Swarm(particles=3, steps=4), BOX)
    with ThreadPoolExecutor(2) as executor:
        spread = propagate(Wave(), Swarm(particles=3, steps=4), BOX, executor=executor)
    other = propagate(Wave(), Swarm(particles=3, steps=4, seed=1), BOX)
    np.testing.assert_array_equal(alone.upper, spread.upper)
    assert len(alone.t) == len(TIMES) and (alone.upper != other.upper).any()


def test_progress_counts_all_runs():
    told = []
    propagate(Wave(), Swarm(particles=2, steps=3), BOX, progress=lambda done, n: told.append((done, n)))
    assert told == [(244, 732), (488, 732), (732, 732)]
