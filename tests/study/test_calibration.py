"""Calibration against closed forms of linear regression, and SciPy's curve_fit on solutions by hand."""

import json
import warnings

import casadi as ca
import numpy as np
import pytest
from black_boxes import quietly, reloaded
from faults import refused, warned
from scipy.optimize import curve_fit, least_squares, lsq_linear

import symmb as mb
from symmb.study.measurements import with_signs

T = np.linspace(0.0, 4.0, 41)


def particle() -> mb.Scene:
    """x = speed t + fall t^2 / 2."""
    p = mb.Parameters(speed=1.0, fall=0.5)
    ball = mb.Body("ball", 2.0, pose=mb.Particle())
    push = mb.Force("push", ball.point(0, 0), (2.0 * p.fall, 0))
    return mb.Scene(mb.System(ball, push, parameters=p), {"ball.vx": p.speed}, T, {"x": ball.x}, name="particle")


def sprung(times=T, **nominal: float) -> mb.Scene:
    """A mass m on a spring k with damping c from an amplitude a; what is not given is no parameter."""
    p = mb.Parameters(**nominal)
    m, k, c, a = (getattr(p, n) if n in nominal else v for n, v in {"m": 1.0, "k": 5.0, "c": 0.0, "a": 0.5}.items())
    ball = mb.Body("ball", m, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(-1, 0), ball.point(0, 0), k, c, 1.0)
    return mb.Scene(mb.System(ball, spring, parameters=p), {"ball.x": a}, times, {"x": ball.x, "v": ball.vx})


def oscillator() -> mb.Scene:
    return sprung(m=1.0, k=5.0, c=0.3, unused=2.0)


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
    half = np.array(mb.calibrate(scene, {"x": T}, noise={"x": noise}).box(0.8).radius)
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
    found = warned("'m', 'k', 'c' separately", mb.calibrate, scene, {"x": swing(T, 6.3, 0.21)}, ["m", "k", "c"])
    assert found.parameters["k"] / found.parameters["m"] == pytest.approx(6.3, rel=1e-4)
    refused("do not determine", found.box)
    independent = "'unused': the outputs do not depend on it"
    warned(independent, mb.calibrate, scene, {"x": swing(T, 6.3, 0.21)}, ["k", "unused"])
    found = warned("'unused'", mb.calibrate, scene, {"x": swing(T, 6.3, 0.21)}, ["unused"])
    assert found.parameters == {"unused": 2.0} and found.deviations == {"unused": np.inf}  # the nominal value stays
    assert "1 parameter from 41 values" in str(found)


def test_an_estimate_far_inside_its_deviation_has_a_warning():
    t = np.linspace(1.0, 2.0, 11)

    def fit(rate):
        simulator = mb.FunctionSimulator(
            lambda a, b: (a + np.exp(-rate * b * t))[:, None], {"a": 1.0, "b": 1.0}, t, ["y"]
        )
        data = {"y": 1 + np.exp(-rate * t)}
        return lambda: mb.calibrate(simulator, data, noise={"y": 0.01})

    assert warned("hardly determine 'b'", fit(15.0)).deviations["b"] > 1e3
    assert fit(3.0)().deviations["b"] < 1


@pytest.mark.parametrize("noise", [None, 0.01])
@pytest.mark.parametrize("name", ["a.npz", "a.json"])
def test_what_is_determined_beside_an_undetermined_pair_is_as_without_it(name, noise, tmp_path):
    """Of mass, stiffness and amplitude of a free oscillation only a ratio shows: it comes from the closest pair."""
    scene = sprung(m=1.3, k=7.0, a=0.4)
    data = {"x": 0.38 * np.cos(np.sqrt(7.6 / 1.3) * T) + 0.01 * np.random.default_rng(1).standard_normal(41)}
    given = noise and {"x": noise}
    exact = mb.calibrate(scene, data, ["k", "a"], noise=given)
    found = warned("'m', 'k' separately", mb.calibrate, scene, data, noise=given)
    m, k, a = found.parameters.values()
    assert k / m == pytest.approx(exact.parameters["k"] / 1.3, rel=1e-6)
    share = np.array([1.0, k / m * 1.3 / 7.0])
    assert [m / 1.3, k / 7.0] == pytest.approx(share * share.sum() / (share @ share), rel=1e-4)  # foot of (1, 1)
    assert a == pytest.approx(exact.parameters["a"], rel=1e-6) and found.degrees == exact.degrees
    for one in (found, reloaded(found, tmp_path / name)):
        assert one.deviations == {"m": np.inf, "k": np.inf, "a": pytest.approx(exact.deviations["a"], rel=1e-4)}
        assert str(one) == str(found) and one.correlation[2, 2] == pytest.approx(1)
        for call in (lambda fit=one: fit.laws, one.box):
            refused("do not determine 'm', 'k' separately", call)


@pytest.mark.parametrize("noise", [None, 0.004])
@pytest.mark.parametrize("nominal", [2.6, 4.1, 12.3, 19.0])
def test_an_oscillation_is_found_from_a_wrong_minimum(nominal, noise):
    """From these starts the nearest minimum of the squares is another one, many deviations off."""
    t = np.linspace(0, 9, 101)
    y = swing(t, 6.3, 0.2) + 0.004 * np.random.default_rng(4).standard_normal(101)
    found = mb.calibrate(sprung(t, k=nominal, c=0.1), {"x": y}, noise=noise and {"x": noise})
    exact, _ = curve_fit(swing, t, y, [6.2, 0.2])
    assert list(found.parameters.values()) == pytest.approx(exact, rel=1e-4) and not found.doubts


def fallen(t, k, g):
    """Height of a ball of 1 kg that falls from 1 m on a spring, up to the time when it leaves it."""
    hit, v, w = np.sqrt(2 / g), np.sqrt(2 * g), np.sqrt(k)
    s = w * (t - hit)
    return np.where(t < hit, 1 - g * t**2 / 2, -v / w * np.sin(s) + g / k * (np.cos(s) - 1))


def bounced(t, e, g):
    """Height of a ball that falls from 1 m, up to its second impact."""
    hit = np.sqrt(2 / g)
    return np.where(t < hit, 1 - g * t**2 / 2, e * np.sqrt(2 * g) * (t - hit) - g * (t - hit) ** 2 / 2)


def pushed(t, on, push):
    """A mass of 1 kg that is pushed from a time on."""
    return np.where(t > on, push * (t - on) ** 2 / 2, 0.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("law", [fallen, bounced, pushed])
def test_fits_go_across_contacts_impacts_and_switches(law, seed):
    rng = np.random.default_rng(seed)
    truth = {fallen: (rng.uniform(300, 800), 9.0), bounced: (rng.uniform(0.4, 0.6), 9.0), pushed: (0.4, 2.0)}[law]
    names = {fallen: ("k", "g"), bounced: ("e", "g"), pushed: ("on", "push")}[law]
    p = mb.Parameters(**{n: v * rng.uniform(0.7, 1.4) for n, v in zip(names, truth, strict=True)})
    ball, t = mb.Body("ball", 1.0, pose=mb.Particle()), np.linspace(0, 0.6, 61)
    if law is pushed:
        force = ca.if_else(mb.t > p.on, p.push, 0.0)
    else:
        force = -p.g + (ca.if_else(ball.y < 0, -p.k * ball.y, 0.0) if law is fallen else 0.0)
    floor = [mb.Impact("floor", ball.y, p.e)] if law is bounced else []
    system = mb.System(ball, mb.Force("force", ball.point(0, 0), (0, force)), *floor, parameters=p)
    scene = mb.Scene(system, {"ball.y": 0.0 if law is pushed else 1.0}, t, {"y": ball.y})
    y = law(t, *truth) + 0.002 * rng.standard_normal(61)
    found = mb.calibrate(scene, {"y": y})
    exact, covariance = curve_fit(law, t, y, truth, epsfcn=1e-6)
    error = np.sqrt(np.diag(covariance)).max()
    assert list(found.parameters.values()) == pytest.approx(exact, abs=0.1 * error, rel=1e-3)
    assert found.covariance == pytest.approx(covariance, rel=0.1, abs=1e-9) and not found.doubts
    assert found.evaluations <= 15 * 5  # 15 points, each with two differences for each parameter


@pytest.mark.parametrize("noise", [None, 0.01])
def test_what_is_no_noise_is_doubted(noise, tmp_path):
    rng, given = np.random.default_rng(2), noise and {"x": noise}
    y = 1.3 * T + 0.4 * T**2 + 0.01 * rng.standard_normal(41)
    spoilt = y + np.where(np.arange(41) == 17, 0.2, 0.0)
    outlier = "1 of 41 values of x are outliers: the value at t = 1.7 s is"
    found = warned(outlier, mb.calibrate, particle(), {"x": spoilt}, noise=given)
    assert len(found.doubts) == 1 and "warning" in str(found)
    assert reloaded(found, tmp_path / "a.npz").doubts == found.doubts
    why = "the given noise" if noise else "are correlated in time"
    warned(why, mb.calibrate, particle(), {"x": y + 0.1 * np.sin(3 * T)}, noise=given)
    little = "given noise" if noise else "explains little of x"
    warned(little, mb.calibrate, particle(), {"x": rng.standard_normal(41)}, noise=given)
    assert not mb.calibrate(particle(), {"x": y}, noise=given).doubts


@pytest.mark.parametrize("number", [8, 11, 15, 24])
def test_an_outlier_among_few_values_is_told(number):
    """Fits of few values follow an outlier: it is far from the line through the others."""
    t = np.linspace(0, 4, number)
    y = 1.3 * t + 0.4 * t**2 + 0.01 * np.random.default_rng(number).standard_normal(number)
    assert not mb.calibrate(particle(), {"x": (t, y)}).doubts
    y[number // 3] += 1.0
    told = f"1 of {number} values of x are outliers: the value at t = {t[number // 3]:g}"
    warned(told, mb.calibrate, particle(), {"x": (t, y)})


def test_estimates_are_labelled_and_drawn(tmp_path):
    found = mb.calibrate(particle(), {"x": ([0.5, 1.0, 3.0], [0.7, 1.4, 6.0])})
    data, table = found.to_xarray(), found.to_pandas()
    assert data["covariance"].sel(parameter="fall", other="speed") == found.covariance[0, 1]
    assert data["time"].values.tolist() == [0.5, 1.0, 3.0] and data["output"].values.tolist() == ["x"] * 3
    np.testing.assert_array_equal(data["residual"], found.residuals["x"])
    assert dict(zip(table.parameter, table.estimate, strict=True)) == found.parameters
    assert dict(zip(table.parameter, table.deviation, strict=True)) == found.deviations
    found.plot(tmp_path / "a.png")
    assert "<table" in found._repr_html_()


@pytest.mark.parametrize("changed", [[[-1.0, 0.0], [0.0, 1.0]], [[1.0, 0.5], [0.1, 1.0]]])
def test_a_file_whose_covariance_cannot_be_is_refused(changed, tmp_path):
    path = tmp_path / "a.json"
    mb.calibrate(particle(), {"x": ([0.5, 1.0, 3.0], [0.7, 1.4, 6.0])}).save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"covariance": changed}))
    refused("covariance", mb.Calibration.load, path)


def test_wrong_calls_are_told():
    scene, one = particle(), ([1.0], [1.0])
    refused("expected a Scene", mb.calibrate, 3, {"x": T})
    refused("map outputs to values", mb.calibrate, scene, [1, 2])
    refused("no output 'y'", mb.calibrate, scene, {"y": T})
    refused("level", mb.calibrate(scene, {"x": T}).box, 1.0)
    for why, x, *parameters, options in [
        ("no parameter 'mass'", T, ["mass"], {}),
        ("the list of parameters is empty", T, [], {}),
        ("contains 'fall' twice", T, ["fall", "speed", "fall"], {}),
        ("the 41 output times", T[:3], {}),
        ("the given times", (T[:3], T), {}),
        ("times of 'x' start at -1 s, before", (T - 1, T), {}),
        ("times of 'x' must be finite", ([0.0, np.nan, 1.0], [1.0, 2.0, 3.0]), {}),
        ("are gaps", T * np.nan, {}),
        ("infinite at 0.3 s. Write a gap as nan", np.where(T == T[3], np.inf, T), {}),
        ("1 value cannot determine 2 parameters. Give 2 or more values, or estimate fewer", one, ["fall", "speed"],
         {"noise": {"x": 1.0}}),
        ("1 value cannot determine 1 parameter and the noise. Give 2 or more values, or noise=,", one, ["speed"], {}),
        ("a number for each output with data: x, got {}", T, {"noise": {}}),
        ("for each output with data: x, got {.y", T, {"noise": {"y": 1.0}}),
        ("above 0", T, {"noise": {"x": 0.0}}),
    ]:  # fmt: skip
        refused(why, mb.calibrate, scene, {"x": x}, *parameters, **options)


def test_a_function_is_fitted_as_well():
    t = np.linspace(0.0, 3.0, 31)
    run = lambda k, c: (np.exp(-c * t) * np.cos(np.sqrt(k) * t))[:, None]  # noqa: E731
    simulator = mb.FunctionSimulator(run, {"k": 2.0, "c": 0.5}, times=t, outputs=["x"])
    fit = mb.calibrate(simulator, {"x": (t[::3], run(3.1, 0.2)[::3, 0])})
    assert fit.parameters == pytest.approx({"k": 3.1, "c": 0.2}, rel=1e-9)
    low, high = fit.consistent(0.01).box["c"]
    assert low < 0.2 < high and "FunctionSimulator" in fit.name
    refused("has no output at t = 0.05 s", mb.calibrate, simulator, {"x": ([0.05, 1.0], [1.0, 2.0])})
    refused("has its own solver", mb.calibrate, simulator, {"x": t}, solver=mb.CVODES())


@pytest.mark.parametrize("k", [1.0, 1e-2, 1e-4, 1e-7])
def test_deviations_of_estimates_far_below_the_nominal_value(k):
    """The model is log(k) + t with the nominal value k = 1: the deviation is k times that of a mean."""
    noise = 1e-3 * np.random.default_rng(0).standard_normal(40)
    t = np.linspace(0, 3, 40)
    model = mb.FunctionSimulator(lambda k: np.log(k) + t, {"k": 1.0}, t, ["y"])
    found = mb.calibrate(model, {"y": np.log(k) + t + noise})
    assert found.parameters["k"] == pytest.approx(k * np.exp(noise.mean()), rel=1e-6)
    deviation = found.parameters["k"] * noise.std(ddof=1) / 40**0.5
    assert found.covariance[0, 0] ** 0.5 == pytest.approx(deviation, rel=0.01)


def test_a_fit_to_data_that_no_parameter_attains_has_an_error_about_the_fit():
    t = np.linspace(0, 3, 40)
    model = mb.FunctionSimulator(lambda k: np.sqrt(k) * np.exp(-t), {"k": 1.0}, t, ["y"])
    with np.errstate(invalid="ignore"), pytest.raises(mb.SimulationError, match="the fit has not ended"):
        mb.calibrate(model, {"y": 0.01 * np.random.default_rng(0).standard_normal(40) - 0.2})


def line(seed, sensors=1):
    """The function a + b t + c t^2, data with noise of 0.05, its matrix, true parameters and the generator."""
    rng, t, names = np.random.default_rng(seed), np.linspace(-1.0, 2.0, 40), [f"y{k}" for k in range(sensors)]
    run = lambda a, b, c: np.stack([a + b * t + c * t**2] * sensors, axis=-1)  # noqa: E731
    simulator = mb.FunctionSimulator(run, {"a": 1.0, "b": 1.0, "c": 1.0}, t, names)
    truth, A = rng.uniform(0.6, 1.4, 3), np.vander(t, 3, increasing=True)
    data = {name: A @ truth + 0.05 * rng.standard_normal(40) for name in names}
    return simulator, data, A, truth, rng


@pytest.mark.parametrize("noise", [None, 0.05])
@pytest.mark.parametrize("seed", range(6))
def test_limits_are_those_of_linear_least_squares(seed, noise):
    simulator, data, A, truth, _ = line(seed)
    limits = {"a": (min(1.0, truth[0]) - 0.02, 1.5), "b": (0.5, max(1.0, truth[1] - 0.1))}
    exact = lsq_linear(A, data["y0"], np.transpose([*limits.values(), (-np.inf, np.inf)]), tol=1e-14)
    ends = np.array([*limits.values()]).T
    is_active = np.append(np.isclose(exact.x[:2], ends, rtol=1e-9).any(axis=0), False)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        fit = mb.calibrate(simulator, data, noise=noise and {"y0": noise}, box=mb.Box(**limits))
    assert list(fit.parameters.values()) == pytest.approx(exact.x, rel=1e-6)
    np.testing.assert_array_equal(np.isinf([*fit.deviations.values()]), is_active)
    for name, active in zip("abc", is_active, strict=True):
        assert any(f"The estimate of {name!r} is at its limit" in str(each.message) for each in told) == active
    if is_active.any():
        refused("is at its limit", fit.box)
        refused("is at its limit", fit.consistent, 0.2)


@pytest.mark.parametrize("seed", [1, 2])
def test_no_run_is_beyond_a_limit(seed):
    t, seen = np.linspace(0.0, 1.0, 20), []
    run = lambda a, b: seen.append((a, b)) or b * np.exp(-np.sqrt(a) * t)  # noqa: E731
    simulator = mb.FunctionSimulator(run, {"a": 0.5, "b": 1.0}, t, ["y"])
    y = 1.2 + 0.01 * np.random.default_rng(seed).standard_normal(20) + 0.02 * t
    fit = warned("'a' is at its limit 0,", mb.calibrate, simulator, {"y": y}, box=mb.Box(a=(0.0, 1.0), b=(0.9, 1.4)))
    assert fit.parameters["a"] == 0 and fit.parameters["b"] == pytest.approx(y.mean(), rel=1e-6)
    assert np.min(seen, axis=0)[0] >= 0 and np.min(seen, axis=0)[1] >= 0.9 and np.max(seen, axis=0).tolist() <= [1, 1.4]


def test_a_set_of_consistent_parameters_stays_inside_of_the_limits():
    simulator, data, *_, truth, _ = line(3)
    box = mb.Box(a=(min(1.0, truth[0]) - 0.1, max(1.0, truth[0]) + 0.1))
    fit = mb.calibrate(simulator, data, box=box)
    found = warned("outside of the given limits", fit.consistent, 0.4)
    assert found.box["a"][0] == pytest.approx(box["a"][0], rel=1e-9) and found.box["a"][1] < box["a"][1]
    assert mb.calibrate(simulator, data).consistent(0.4).box["a"][0] < box["a"][0] - 0.1


@pytest.mark.parametrize("seed", range(4))
def test_priors_give_the_posterior_of_normal_distributions(seed, tmp_path):
    simulator, data, A, truth, rng = line(seed)
    priors = {"a": (truth[0] + 0.03 * rng.standard_normal(), 0.03), "c": (truth[2], 0.02)}
    fit = mb.calibrate(simulator, data, noise={"y0": 0.05}, priors=priors)
    precision = A.T @ A / 0.05**2 + np.diag([0.03**-2, 0.0, 0.02**-2])
    pull = A.T @ data["y0"] / 0.05**2 + [priors["a"][0] / 0.03**2, 0.0, priors["c"][0] / 0.02**2]
    assert list(fit.parameters.values()) == pytest.approx(np.linalg.solve(precision, pull), rel=1e-6)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(precision), rtol=1e-4)
    assert mb.calibrate(simulator, data, priors=priors).degrees == 39
    assert f"prior       c: {truth[2]:.6g} ± 0.02" in str(fit)
    for name in ("fit.json", "fit.npz"):
        assert str(reloaded(fit, tmp_path / name)) == str(fit)


def test_a_prior_determines_what_the_data_do_not():
    data = {"x": swing(T, 6.3, 0.21) + 0.01 * np.random.default_rng(1).standard_normal(41)}
    fit = mb.calibrate(oscillator(), data, ["m", "k", "c"], priors={"m": "1.1 ±0.05"})
    ratio = mb.calibrate(oscillator(), data, ["k", "c"]).parameters["k"]
    assert fit.parameters["m"] == pytest.approx(1.1) and fit.deviations["m"] == pytest.approx(0.05, rel=1e-3)
    assert fit.parameters["k"] == pytest.approx(1.1 * ratio, rel=1e-4)


@pytest.mark.parametrize("given", [1.3, 1.5])
@pytest.mark.parametrize("size", [None, 1e-8])
@pytest.mark.parametrize("is_scene", [False, True])
def test_precise_data_and_a_prior_give_the_ratio_and_the_prior(size, given, is_scene):
    """The data determine k / m to many digits. The prior determines m, so that k has the deviation of m times k / m."""
    ratio, t = 7.6 / 1.3, np.linspace(0.0, 3.0, 31)
    run = lambda m, k: 0.4 * np.cos(np.sqrt(k / m) * t)  # noqa: E731
    function = mb.FunctionSimulator(run, {"m": 1.3, "k": 7.0}, t, ["x"])
    scene = sprung(t, m=1.3, k=7.0, a=0.4) if is_scene else function
    y = run(1.3, 7.6) + (size or 0.0) * np.random.default_rng(2).standard_normal(31)
    fit = mb.calibrate(scene, {"x": y}, ["m", "k"], priors={"m": (given, 0.01)}, noise=size and {"x": size})
    assert fit.parameters["k"] / fit.parameters["m"] == pytest.approx(ratio, rel=1e-6)
    assert fit.parameters == pytest.approx({"m": given, "k": given * ratio}, rel=1e-4)
    assert fit.deviations == pytest.approx({"m": 0.01, "k": 0.01 * ratio}, rel=1e-3) and not fit.warnings


def test_a_parameter_with_a_prior_is_known_beside_undetermined_ones():
    data = {"x": swing(T, 6.3, 0.21)}
    fit = warned(
        "determine 'm', 'k' separately", mb.calibrate, sprung(m=1.0, k=6.0, a=0.5), data, priors={"a": (0.5, 9)}
    )
    assert np.isfinite(fit.deviations["a"]) and np.isinf(fit.deviations["m"])
    fit = mb.calibrate(oscillator(), data, ["k", "c", "unused"], priors={"unused": (3.0, 0.2)})
    assert fit.parameters["unused"] == pytest.approx(3.0) and fit.deviations["unused"] == pytest.approx(0.2)


@pytest.mark.parametrize("seed", range(5))
def test_boxes_of_precise_data_contain_the_true_values(seed):
    """Errors of runs are not random, so that they do not average out."""
    rng = np.random.default_rng(seed)
    truth = {"k": rng.uniform(4.0, 9.0), "c": rng.uniform(0.05, 0.4)}
    box = mb.calibrate(sprung(k=5.0, c=0.2), {"x": swing(T, **truth)}).box()
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        assert low < truth[name] < high and high - low < 1e-4


def test_given_noise_belongs_to_outputs_by_name():
    y = {"x": swing(T, 6.3, 0.21), "v": np.gradient(swing(T, 6.3, 0.21), T)}
    sizes = {"x": 1e-3, "v": 0.1}
    fits = [
        mb.calibrate(oscillator(), y, ["k", "c"], noise=dict(pairs))
        for pairs in (sizes.items(), [*sizes.items()][::-1])
    ]
    assert fits[0].parameters == fits[1].parameters and fits[0].noise == fits[1].noise == sizes


def falling_squares(m, t, rng):
    """A damped mass so small that it does not show; with m below 0, the squares of a start that leads fall further."""
    return 0.4 * np.exp(-2.0 * (t + (0.02 if m < 0 else 0.0) * (t > 0))) + 0.004 * rng.standard_normal(len(t))


@pytest.mark.parametrize("m", [0.0, -1.0])
def test_masses_are_not_negative(m, tmp_path):
    t = np.linspace(0.0, 3.0, 61)
    data = {"x": falling_squares(m, t, np.random.default_rng(0))}
    scene = sprung(t, m=1.0, k=2.0, c=0.8, a=0.4)
    if m < 0:
        fit = warned("'m' is at its limit 0.001,", mb.calibrate, scene, data, ["m", "c"])
        assert fit.parameters["m"] == 0.001 and np.isinf(fit.deviations["m"])
        refused("is at its limit", fit.box)
        return
    fit = mb.calibrate(scene, data, ["m", "c"])
    assert 3 * fit.deviations["m"] > fit.parameters["m"]
    for one in (fit, reloaded(fit, tmp_path / "a.json"), reloaded(fit, tmp_path / "a.npz")):
        assert one.limits["m"].tolist() == [0.001, np.inf] and [*one.limits] == ["m"]
        assert one.box()["m"][0] == 0.001 and one.box()["c"][0] < 1.0 < one.box()["c"][1]


def test_limits_are_those_of_numbers_that_cannot_be_negative():
    p = mb.Parameters(density=2.0, width=0.5, extra=0.1, inertia=0.2, stiffness=100.0, damping=0.0, drag=0.3)
    body = mb.Body("body", p.density * p.width**2 + p.extra, p.inertia, pose=mb.Planar())
    floor = mb.KelvinVoigt(p.stiffness, p.damping)
    contact = mb.Contact("floor", body.point(0, 0), mb.Ground().point(0, 0), (0, 1), floor)
    drag = mb.Force("drag", body.point(0, 0), (0, -p.drag * body.vy))
    system = mb.System(body, contact, drag, mb.Gravity(0, -9.81), parameters=p)
    found = with_signs({"inertia": (0.1, 1.0), "damping": (-1.0, 2.0)}, system, dict(p))
    assert found == {"inertia": (0.1, 1.0), "stiffness": (0.1, np.inf), "damping": (0.0, 2.0)}
    ball = mb.Body("ball", p.density * p.width, pose=mb.Particle())
    found = with_signs({}, mb.System(ball, parameters=p), dict(p))
    assert found == {"density": (0.002, np.inf), "width": (0.0005, np.inf)}


@pytest.mark.parametrize("seed", range(4))
def test_outliers_hardly_change_robust_fits(seed):
    simulator, data, A, truth, rng = line(seed)
    data["y0"][rng.permutation(40)[:4]] += rng.uniform(3.0, 9.0, 4)
    exact = least_squares(lambda u: (A @ u - data["y0"]) / 0.05, np.ones(3), loss="soft_l1", f_scale=1.345, xtol=1e-12)
    fits = [warned("4 of 40 values of y0 are outliers", mb.calibrate, simulator, data, noise=noise, robust=True)
            for noise in ({"y0": 0.05}, None)]  # fmt: skip
    assert list(fits[0].parameters.values()) == pytest.approx(exact.x, rel=1e-5)
    for fit in fits:
        off, deviations = np.subtract([*fit.parameters.values()], truth), np.array([*fit.deviations.values()])
        assert (np.abs(off) < 5 * deviations).all() and deviations.max() < 0.03
    assert 0.03 < fits[1].noise["y0"] < 0.08


def test_a_sensor_that_is_wrong_hardly_changes_robust_fits():
    simulator, data, _, truth, _ = line(5, sensors=3)
    data["y1"] = 1.3 * data["y1"]
    for noise in ({name: 0.05 for name in data}, None):
        own = {"noise": noise}
        plain, fit = (quietly(mb.calibrate, simulator, data, robust=flag, **own) for flag in (False, True))
        off = [np.abs(np.subtract(list(each.parameters.values()), truth)).max() for each in (plain, fit)]
        assert off[1] < 0.05 and (noise is None or off[1] < off[0] / 2)


def test_deviations_of_robust_fits_are_those_of_repetitions():
    errors, told = [], []
    for seed in range(60):
        simulator, data, _, truth, _ = line(seed)
        fit = mb.calibrate(simulator, data, noise={"y0": 0.05}, robust=True)
        errors.append(np.subtract(list(fit.parameters.values()), truth))
        told.append([*fit.deviations.values()])
    assert np.std(errors, axis=0) == pytest.approx(np.mean(told, axis=0), rel=0.25)


def test_wrong_limits_and_priors_are_told():
    simulator, data, *_ = line(0)
    for match, options in [
        ("nominal value 1 of 'a' must be between its limits 2 and 3", {"box": mb.Box(a=(2, 3))}),
        ("limits of 'a' are equal", {"box": mb.Box(a=(1, 1))}),
        ("estimated parameter", {"box": mb.Box(d=(1, 2))}),
        ("box", {"box": (1, 2)}),
        ("choices", {"box": mb.Box(a={1, 2})}),
        ("priors must map", {"priors": [1.0]}),
        ("estimated parameter", {"priors": {"d": (1.0, 0.1)}}),
        ("prior of 'a' must be", {"priors": {"a": 1.0}}),
        ("standard deviation above 0", {"priors": {"a": (1.0, 0.0)}}),
        ("prior of 'a' must be", {"priors": {"a": "7.0"}}),
        ("prior of 'a' must be", {"priors": {"a": (np.inf, 1.0)}}),
        ("robust", {"robust": "huber"}),
    ]:
        refused(match, mb.calibrate, simulator, data, **options)


def test_limits_that_are_nearly_equal_are_refused():
    f = mb.FunctionSimulator(lambda k: [[k]], {"k": 1.0}, [0.0], ["y"])
    refused("the limits of 'k' are equal", mb.calibrate, f, {"y": [1.0]}, ["k"], box=mb.Box(k=(1.0, 1.0 + 1e-15)))
