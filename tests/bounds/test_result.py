"""Bounds: what they give, saving and loading; failed samples of sampling methods."""

import numpy as np
import pytest
from oscillators import BOX, TIMES, Wave, wave

from symmb._errors import DeclarationError, PropagationError
from symmb.bounds import (
    Bounds,
    Box,
    LatinHypercube,
    MonteCarlo,
    PolynomialChaos,
    Random,
    Scanning,
    Sobol,
    Vertex,
    propagate,
)
from symmb.simulate import FunctionSimulator


def _fails_above(amplitude, w):
    if w > 1.04:
        raise RuntimeError("blew up")
    return wave(amplitude, w)


FAILING = FunctionSimulator(_fails_above, {"amplitude": 1.0, "w": 1.0}, TIMES, ["x"])


@pytest.mark.parametrize(
    ("simulator", "method"),
    [(Wave(), PolynomialChaos()), (Wave(), PolynomialChaos(order=3)), (FAILING, Scanning(5))],
)
def test_save_and_load(tmp_path, simulator, method):
    bounds = propagate(simulator, method, BOX)
    bounds.save(tmp_path / "wave.npz")
    loaded = Bounds.load(tmp_path / "wave.npz")
    for name in ("t", "lower", "upper", "estimate", "inner"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(bounds, name))
    for name in ("names", "kind", "method", "evaluations", "failed", "seconds"):
        assert getattr(loaded, name) == getattr(bounds, name)


def test_outer_is_wider_by_the_estimate():
    bounds = propagate(Wave(), PolynomialChaos(), BOX)
    np.testing.assert_array_equal(bounds.outer[0], bounds.lower - bounds.estimate)
    np.testing.assert_array_equal(bounds.outer[1], bounds.upper + bounds.estimate)
    fixed = propagate(Wave(), PolynomialChaos(order=2), BOX)
    assert fixed.outer[0] is fixed.lower and fixed.outer[1] is fixed.upper


def test_output_by_name():
    bounds = propagate(Wave(), Vertex(), BOX)
    np.testing.assert_array_equal(bounds["x"], (bounds.lower[:, 0], bounds.upper[:, 0]))
    with pytest.raises(DeclarationError, match="no output 'y'"):
        bounds["y"]


def test_text_says_the_kind():
    assert repr(propagate(Wave(), Vertex(), BOX)) == "Bounds(sampled, Vertex(), 1 outputs x 61 times, 4 evaluations)"


def test_failed_samples_are_recorded_and_the_others_count():
    bounds = propagate(FAILING, Scanning(5), BOX)
    assert bounds.evaluations == 25 and len(bounds.failed) == 5
    assert bounds.failed[0].parameters == pytest.approx({"amplitude": 0.9, "w": 1.05})
    assert "RuntimeError: blew up" in bounds.failed[0].message
    fine = propagate(Wave(), Scanning(5), Box(amplitude=(0.9, 1.1), w=(0.95, 1.05)))
    assert np.isfinite(bounds.lower).all() and (bounds.lower >= fine.lower).all()
    assert repr(bounds).endswith("25 evaluations, 5 failed)")


def test_all_samples_failed():
    with pytest.raises(PropagationError, match=r"all 4 runs failed(.|\n)*blew up"):
        propagate(FAILING, Vertex(), Box(w=(1.041, 1.05), amplitude=(1, 1)))


@pytest.mark.parametrize("sampler", [Random(), Sobol(), LatinHypercube()], ids=repr)
def test_samplers_fill_the_box_and_repeat_by_seed(sampler):
    points = sampler.points(300, 3, seed=5)
    assert points.shape == (300, 3) and np.abs(points).max() <= 1
    np.testing.assert_array_equal(points, sampler.points(300, 3, seed=5))
    assert (points != sampler.points(300, 3, seed=6)).any()
    # Mean square 1/3 with a standard deviation of 0.3 / sqrt(300) for independent points.
    np.testing.assert_allclose((points**2).mean(axis=0), 1 / 3, atol=0.09)


def test_latin_hypercube_has_one_point_a_slice():
    slices = np.floor((LatinHypercube().points(50, 2, 0) + 1) * 25)
    assert (np.sort(slices, axis=0) == np.arange(50)[:, None]).all()


def test_same_seed_same_bounds():
    first, second = (propagate(Wave(), MonteCarlo(50, seed=3), BOX) for _ in range(2))
    np.testing.assert_array_equal(first.lower, second.lower)
    assert (propagate(Wave(), MonteCarlo(50, seed=4), BOX).lower != first.lower).any()
