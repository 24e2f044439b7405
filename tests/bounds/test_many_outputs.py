"""Each output of a study is judged by itself: it is bounded among many others as well as alone."""

import warnings

import numpy as np
import pytest
from unit_functions import unit_function

import symmb as mb

T = np.linspace(0.0, 1.0, 60)
LAWS = {
    "kink": np.abs,
    "clipped": lambda z: np.clip(3 * z, -1, 1),
    "bump": lambda z: np.exp(-np.square(z) / 0.125),
    "resonance": lambda z: 1 / np.hypot(1 - (1 + 0.3 * z) ** 2, 0.1 * (1 + 0.3 * z)),
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize(("d", "seed"), [(1, 0), (1, 1), (1, 2), (2, 3)])
def test_a_hard_output_among_smooth_ones_is_bounded(law, d, seed):
    """law(z - c) (1 + t) among 19 exponentials. Its range is that over 20,001 numbers z."""
    rng = np.random.default_rng(seed)
    a, c = rng.normal(size=(20, d)), rng.uniform(-0.6, 0.6)
    a /= np.abs(a).sum(axis=1, keepdims=True)

    def f(x):
        s = a @ x
        Y = np.exp(0.3 * s) * (1 + T)[:, None]
        Y[:, 0] = law(s[0] - c) * (1 + T)
        return Y

    simulator, box = unit_function(f, d, T, [f"y{k}" for k in range(20)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        bounds = mb.propagate(simulator, mb.PolynomialChaos(seconds=600.0), box)
    values = law(np.linspace(-1, 1, 20_001) - c)
    error = np.abs([bounds.lower[-1, 0] / 2 - values.min(), bounds.upper[-1, 0] / 2 - values.max()]).max()
    assert error <= 0.02 * np.ptp(values) or bounds.doubts
