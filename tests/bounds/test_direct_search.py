"""Local searches without derivatives, against places that are known."""

import numpy as np
import pytest

from symmb.bound.bounds.direct_search import direct_search


def ridge(x):
    """Largest, 0, at (0.2, 0.2): along the axes every other point of the ridge is a summit."""
    return -np.maximum(np.abs(x[:, 0] + x[:, 1] - 0.4), 3 * np.abs(x[:, 0] - x[:, 1]))


def bowl(x):
    """Largest, 2, at the corner (1, -1, 1)."""
    return x @ [1.0, -0.5, 0.5] * (1 + 0.1 * x[:, 1]) + 0.2


def hill(x):
    return 1 - np.square(x - [0.3, -0.1, 0.7, 0.0]).sum(axis=1)


@pytest.mark.parametrize(("f", "place", "value", "tolerance"), [
    (ridge, (0.2, 0.2), 0.0, 0.05), (bowl, (1, -1, 1), 2.0, 1e-12), (hill, (0.3, -0.1, 0.7, 0.0), 1.0, 1e-9),
])  # fmt: skip
def test_it_finds_the_largest_value(f, place, value, tolerance):
    found = direct_search(f, np.array([-0.9 * np.ones(len(place))]), most=1000)
    assert found.value == pytest.approx(value, abs=tolerance) and found.value == f(found.place[None])[0]
    assert found.error < 0.4 and np.abs(found.place - place).max() < 5 * tolerance**0.5


def test_it_ends_early_and_says_so():
    calls = []

    def f(x):
        calls.append(len(x))
        return hill(x)

    starts = -np.ones((1, 4))
    assert direct_search(f, starts, most=20).error == np.inf and sum(calls) < 20 + 9
    assert direct_search(f, starts, most=1000, enough=-4.0).value > -4.0


def test_places_without_a_value_are_left_out():
    found = direct_search(lambda x: np.where(x[:, 0] > 0.5, -np.inf, bowl(x)), np.zeros((1, 3)), most=1000)
    assert found.value == pytest.approx(1.55, abs=0.2) and found.place[0] <= 0.5
    assert direct_search(lambda x: np.full(len(x), -np.inf), np.zeros((1, 3)), most=1000).error == np.inf
