"""Linkages that move though their joints have too many rows: runs and checks against Lagrange's equation."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from overconstrained import LINKAGES, bennett

import symmb as mb


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda linkage: linkage.__name__)
def test_overconstrained_linkages_move_and_are_checked(linkage, seed):
    ring, rate = linkage(seed), float(np.random.default_rng(seed).uniform(2, 5))
    times, known = ring.motion(3.0, rate)
    run = mb.simulate(ring.scene(times, rate), check=True)
    assert_allclose(run.values, known, rtol=0, atol=1e-6 * np.abs(known).max())
    assert run.error is not None and run.error.max() < 1e-6 * np.abs(known).max()
    assert not run.doubts


@pytest.mark.parametrize("solver", [mb.DormandPrince(rtol=1e-12, stabilization=None), mb.DormandPrince()], ids=repr)
@pytest.mark.parametrize("seed", [4])
def test_rows_that_vanish_in_passing_do_not_magnify_the_drift(seed, solver):
    """In coordinates of joints a row of the last hinge of Bennett's linkage passes 0."""
    ring, rate = bennett(seed), float(np.random.default_rng(seed).uniform(2, 5))
    times, known = ring.motion(3.0, rate)
    run = mb.simulate(replace(ring.scene(times, rate), coordinates="joint"), solver)
    assert_allclose(run.values, known, rtol=0, atol=1e-6 * np.abs(known).max())
