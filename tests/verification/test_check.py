"""simulate(check=True): the estimated error of a run, and from when on digits are lost."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import symmb as mb

INERTIA = (1.0, 2.0, 3.0)


def spinning(omega, end):
    """A free body that spins about its middle axis."""
    body = mb.Body("body", 1.0, INERTIA, mb.Spatial())
    outputs = {"wx": body.omega[0], "wy": body.omega[1]}
    return mb.Scene(mb.System(body), {"body.omega": omega}, np.linspace(0, end, 201), outputs)


def euler(omega, times):
    """Euler's equations by SciPy."""
    a, b, c = INERTIA

    def slope(_, w):
        return [(b - c) / a * w[1] * w[2], (c - a) / b * w[2] * w[0], (a - b) / c * w[0] * w[1]]

    return solve_ivp(slope, times[[0, -1]], omega, "DOP853", times, rtol=1e-13, atol=1e-15).y[:2].T


def test_the_error_of_a_regular_run_is_estimated_and_small():
    scene = spinning((0.3, 1.0, 0.2), 20.0)
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-6), check=True)
    true = np.abs(run.values - euler((0.3, 1.0, 0.2), scene.times))
    assert run.error.shape == run.values.shape and run.doubts == ()
    assert 0.5 * true.max() < run.error.max() < 2 * true.max()
    assert mb.simulate(scene).error is None


def test_digits_that_an_instability_loses_are_told(tmp_path):
    """From 1e-8 the body turns over (Dzhanibekov); each turn takes digits."""
    scene = spinning((1e-8, 1.0, 1e-8), 100.0)
    with pytest.warns(mb.SymmbWarning, match=r"From t = [\d.]+ s on, errors of wx, wy exceed a thousandth"):
        run = mb.simulate(scene, mb.DormandPrince(), check=True)
    since = float(run.doubts[0].split("t = ")[1].split(" s")[0])
    true = np.abs(run.values - euler((1e-8, 1.0, 1e-8), scene.times))
    assert_allclose(run.values[run.t < since], euler((1e-8, 1.0, 1e-8), scene.times)[run.t < since], atol=1e-2)
    assert true[run.t > since].max() > 1e-4
    run.save(tmp_path / "run.json")
    assert json.loads((tmp_path / "run.json").read_text())["doubts"] == list(run.doubts)
    loaded = mb.Trajectory.load(tmp_path / "run.json")
    assert loaded.doubts == run.doubts
    assert_allclose(loaded.error, run.error)
