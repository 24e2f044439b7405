"""Each output of a study is judged by itself: it is bounded among many others as well as alone."""

import numpy as np
import pytest
from black_boxes import quietly, unit_bounds

import symmb as mb

T, PATIENT = np.linspace(0.0, 1.0, 60), mb.PolynomialChaos(seconds=600.0)
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

    bounds = quietly(unit_bounds, f, d, PATIENT, T, [f"y{k}" for k in range(20)])
    values = law(np.linspace(-1, 1, 20_001) - c)
    error = np.abs([bounds.lower[-1, 0] / 2 - values.min(), bounds.upper[-1, 0] / 2 - values.max()]).max()
    assert error <= 0.02 * np.ptp(values) or bounds.doubts


@pytest.mark.parametrize(("d", "seed"), [(4, 5), (5, 6)])
def test_a_smooth_output_does_not_pay_for_a_kink(d, seed):
    """exp(a x + t) is bounded as in a study of its own, beside |b x - t| sin(3 b x), whose kink moves."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.1, 0.3, d), rng.uniform(-1, 1, d)

    def f(x):
        return np.stack([np.exp(a @ x + T), np.abs(b @ x - T) * np.sin(3 * b @ x)], axis=1)

    both = quietly(unit_bounds, f, d, PATIENT, T, ["smooth", "kink"])
    own = quietly(unit_bounds, lambda x: f(x)[:, :1], d, PATIENT, T, ["smooth"])
    width = own.upper - own.lower
    for bounds in (both, own):
        assert (np.abs(bounds.lower[:, :1] - np.exp(T - a.sum())[:, None]) < 0.01 * width).all()
        assert (np.abs(bounds.upper[:, :1] - np.exp(T + a.sum())[:, None]) < 0.01 * width).all()
        assert "smooth" not in bounds.doubtful()
    assert both.estimate[:, 0].max() < 1.5 * own.estimate.max() + 1e-12
