"""Calibration against closed forms of linear regression, and SciPy's curve_fit on solutions by hand."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.optimize import curve_fit

import symmb as mb

T = np.linspace(0.0, 4.0, 41)


def particle() -> mb.Scene:
    """x = speed t + fall t^2 / 2."""
    p = mb.Parameters(speed=1.0, fall=0.5)
    ball = mb.Body("ball", 2.0, pose=mb.Particle())
    push = mb.Force("push", ball.point(0, 0), (2.0 * p.fall, 0))
    return mb.Scene(mb.System(ball, push, parameters=p), {"ball.vx": p.speed}, T, {"x": ball.x}, name="particle")


def oscillator() -> mb.Scene:
    p = mb.Parameters(m=1.0, k=5.0, c=0.3, unused=2.0)
    ball = mb.Body("ball", p.m, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(-1, 0), ball.point(0, 0), p.k, p.c, 1.0)
    start = {"ball.x": 0.5, "ball.y": 0.0, "ball.vx": 0.0, "ball.vy": 0.0}
    return mb.Scene(mb.System(ball, spring, parameters=p), start, T, {"x": ball.x, "v": ball.vx}, name="oscillator")


def swing(t, k, c, m=1.0):
    d, w = c / (2 * m), np.sqrt(k / m - (c / (2 * m)) ** 2)
    return 0.5 * np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t))


@pytest.mark.parametrize("noise", [None, 0.02])
def test_a_straight_model_is_linear_regression(noise):
    y = 1.3 * T + 0.5 * 0.8 * T**2 + 0.02 * np.random.default_rng(3).standard_normal(41)
    found = mb.calibrate(particle(), {"x": y}, noise=noise and {"x": noise})
    A = np.stack([T, T**2 / 2], axis=1)
    exact, (rest,), *_ = np.linalg.lstsq(A, y, rcond=None)
    variance = noise**2 if noise else rest / 39
    np.testing.assert_allclose(list(found.parameters.values()), exact, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, variance * np.linalg.inv(A.T @ A), rtol=1e-4)
    np.testing.assert_allclose(found.residuals["x"], y - A @ exact, atol=1e-7)
    assert found.degrees == (0 if noise else 39)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_bent_model_is_fitted_as_by_scipy(seed):
    y = swing(T, 6.3, 0.21) + 0.01 * np.random.default_rng(seed).standard_normal(41)
    found = mb.calibrate(oscillator(), {"x": y}, ["k", "c"])
    exact, covariance = curve_fit(swing, T, y, [5.0, 0.3])
    np.testing.assert_allclose(list(found.parameters.values()), exact, rtol=1e-4)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-2)
    assert found.laws["k"].std() == pytest.approx(found.deviations["k"])
    assert found.correlation[0, 1] == pytest.approx(covariance[0, 1] / np.sqrt(np.prod(np.diag(covariance))), rel=0.01)


def test_boxes_hold_all_true_values_as_often_as_they_promise():
    """Of linear models the distribution is exact: level 0.8 of two parameters, 400 repetitions."""
    scene, rng, hits, noise = particle(), np.random.default_rng(0), 0, 0.05
    fit = mb.calibrate(scene, {"x": T}, noise={"x": noise})
    half = np.array(fit.box(0.8).radius)
    A = np.stack([T, T**2 / 2], axis=1)
    for _ in range(400):
        errors = np.linalg.lstsq(A, noise * rng.standard_normal(41), rcond=None)[0]
        hits += bool((np.abs(errors) <= half).all())
    assert 0.78 <= hits / 400 <= 0.95  # correlated estimates are held more often


def test_outputs_have_times_and_noise_of_their_own_and_gaps():
    rng, t = np.random.default_rng(5), np.array([0.35, 3.3, 1.07])
    v = (swing(t + 1e-6, 6.3, 0.21) - swing(t - 1e-6, 6.3, 0.21)) / 2e-6
    x = swing(T, 6.3, 0.21) + 1e-3 * rng.standard_normal(41)
    x[5:9] = np.nan
    found = mb.calibrate(oscillator(), {"x": x, "v": (t, v)}, ["k", "c"])
    assert found.parameters["k"] == pytest.approx(6.3, abs=5 * found.deviations["k"] + 1e-3)
    assert len(found.data["x"]) == 37 and found.noise["v"] < found.noise["x"]
    np.testing.assert_array_equal(found.times["v"], t)


def test_what_the_data_do_not_determine_is_told():
    scene = oscillator()
    with pytest.warns(mb.SymmbWarning, match="'m', 'k', 'c' together"):
        found = mb.calibrate(scene, {"x": swing(T, 6.3, 0.21)}, ["m", "k", "c"])
    assert found.parameters["k"] / found.parameters["m"] == pytest.approx(6.3, rel=1e-4)
    with pytest.raises(mb.DeclarationError, match="do not determine"):
        found.box()
    with pytest.warns(mb.SymmbWarning, match="'unused': the outputs do not depend on it"):
        mb.calibrate(scene, {"x": swing(T, 6.3, 0.21)}, ["k", "unused"])


def test_files_and_pictures(tmp_path):
    found = mb.calibrate(particle(), {"x": 1.2 * T})
    for name in ("a.npz", "a.json"):
        found.save(tmp_path / name)
        again = mb.Calibration.load(tmp_path / name)
        assert str(again) == str(found)
        np.testing.assert_array_equal(again.residuals["x"], found.residuals["x"])
    found.plot(tmp_path / "a.png")
    assert "<table" in found._repr_html_()
    plt.close("all")


def test_wrong_calls_are_told():
    scene = particle()
    wrong = {
        "expected a Scene": lambda: mb.calibrate(3, {"x": T}),
        "values by output": lambda: mb.calibrate(scene, [1, 2]),
        "no output 'y'": lambda: mb.calibrate(scene, {"y": T}),
        "no parameter 'mass'": lambda: mb.calibrate(scene, {"x": T}, ["mass"]),
        "no parameter to estimate": lambda: mb.calibrate(scene, {"x": T}, []),
        "the 41 times of the scene": lambda: mb.calibrate(scene, {"x": T[:3]}),
        "its own times": lambda: mb.calibrate(scene, {"x": (T[:3], T)}),
        "none of them before": lambda: mb.calibrate(scene, {"x": (T - 1, T)}),
        "finite at some times": lambda: mb.calibrate(scene, {"x": T * np.nan}),
        "cannot determine": lambda: mb.calibrate(scene, {"x": ([1.0, 2.0], [1.0, 2.0])}),
        "for each of x": lambda: mb.calibrate(scene, {"x": T}, noise={"y": 1.0}),
        "above 0": lambda: mb.calibrate(scene, {"x": T}, noise={"x": 0.0}),
        "level": lambda: mb.calibrate(scene, {"x": T}).box(1.0),
    }
    for why, call in wrong.items():
        with pytest.raises(mb.DeclarationError, match=why):
            call()
