"""The reference: how fine, how uncertain, from which simulator."""

import numpy as np
import pytest

from symmb import Bounds, Box, FunctionSimulator, PropagationError, Scanning, Vertex
from symmb.study.reference import _resolutions, find_reference

T = np.linspace(0.0, 1.0, 11)


def simulator(f, n_p=1):
    return FunctionSimulator(f, {f"p{i}": 1.0 for i in range(n_p)}, T, ["y"])


def box(n_p=1):
    return Box(**{f"p{i}": (0.5, 1.5) for i in range(n_p)})


@pytest.mark.parametrize("n_p", [1, 2, 3, 4, 5])
def test_nested_grids_of_about_two_thousand_runs(n_p):
    coarse, fine = _resolutions(n_p)
    assert isinstance(coarse, Scanning) and isinstance(fine, Scanning)
    assert fine.points == 2 * coarse.points - 1
    assert 1500 <= fine.points**n_p <= 3200


def test_a_linear_response_has_no_uncertainty():
    found = find_reference(simulator(lambda p0: p0 * T), box())
    np.testing.assert_allclose(found.lower[:, 0], 0.5 * T)
    np.testing.assert_allclose(found.upper[:, 0], 1.5 * T)
    assert found.uncertainty == pytest.approx([0.0], abs=1e-14)
    assert (found.method, found.evaluations, found.failed) == ("Scanning(2001)", 3002, 0)
    assert found.seconds is not None and found.seconds > 0.0


def test_the_uncertainty_is_larger_than_the_true_error():
    """y = (p0 - p1 t)^2 has its minimum 0 inside the box, between grid points."""
    found = find_reference(simulator(lambda p0, p1: (p0 - 0.77 * p1 * T) ** 2, 2), box(2))
    lower = np.maximum(0.5 - 0.77 * 1.5 * T, 0.0) ** 2
    error = found.yardstick.deviation(lower[:, None], found.upper)
    assert 0.0 < error[0] <= found.uncertainty[0] < 1e-3


def test_beyond_five_parameters_vertices_join_the_samples():
    found = find_reference(simulator(lambda **p: sum(p.values()) * (1.0 + T), 6), box(6))
    np.testing.assert_allclose(found.lower[:, 0], 3.0 * (1.0 + T))
    np.testing.assert_allclose(found.upper[:, 0], 9.0 * (1.0 + T))
    optimized = "Optimization(budget=2000)"
    assert found.method == f"MonteCarlo(2048, sampler=Sobol()) with Vertex() with {optimized}"
    assert found.evaluations > 512 + 2048 + 64
    assert found.uncertainty[0] < 1e-9


def test_too_many_vertices_are_left_out():
    found = find_reference(simulator(lambda **p: p["p0"] * (1.0 + T), 11), box(11))
    assert "Vertex" not in found.method
    np.testing.assert_allclose(found.upper[:, 0], 1.5 * (1.0 + T))


def test_a_given_method_is_used_as_it_is():
    found = find_reference(simulator(lambda p0: p0 * T), box(), Vertex())
    assert (found.method, found.evaluations) == ("Vertex()", 2)
    assert np.isnan(found.uncertainty).all()


def given(names=("y",), t=T, estimate=None):
    lower = np.zeros((len(t), len(names)))
    return Bounds(t, names, lower, lower + 2.0, "estimate", "by hand", 7, estimate, seconds=1.0)


def test_given_bounds_state_their_own_uncertainty():
    found = find_reference(simulator(lambda p0: p0 * T), box(), given(estimate=np.full((11, 1), 0.02)))
    assert found.uncertainty == pytest.approx([0.01])
    assert (found.method, found.evaluations, found.seconds) == ("by hand", 7, None)


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        (given(names=("z",)), "are z, but the outputs of the simulator are y"),
        (given(t=T[:-1]), "10 times"),
        (given(t=T + 0.1), "same times"),
    ],
)
def test_given_bounds_must_fit(bounds, words):
    with pytest.raises(PropagationError, match=words):
        find_reference(simulator(lambda p0: p0 * T), box(), bounds)
