"""Formulas of four and more parameters over time: their studies end, and their bounds are those of corners."""

import os
import subprocess
import sys
import warnings
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from _directions import directions
from _engineering import cases, monotone_series
from black_boxes import black_box_bounds, quietly, unit_bounds

import symmb as mb
from symmb.bound.adaptive.outputs import OutputProblem
from symmb.bound.adaptive.sparse_grid import SparseGrid

T = np.linspace(0.0, 5.0, 11)


def study(f, box, times=T, method=None):
    """Bounds of f(**parameters) -> (n_t,), and the number of its calls."""
    calls = 0

    def response(**p):
        nonlocal calls
        calls += 1
        return f(**p)

    bounds = quietly(black_box_bounds, response, method, times, **box)
    return bounds, calls


def unit_study(f, d, times=T, method=None):
    """The same of f(x) -> (n_t,) for d parameters x (d,) from -1 to 1."""
    box = {f"x{i}": (-1.0, 1.0) for i in range(d)}
    return study(lambda **p: f(np.array(list(p.values()))), box, times, method)


def errors(bounds, lower, upper):
    return np.abs(np.subtract(bounds["y"], [lower, upper])).max(axis=0)


def at_corners(f, box):
    """Smallest and largest values at all corners."""
    corners = np.array(np.meshgrid(*box.values())).reshape(len(box), -1).T
    values = np.array([f(**dict(zip(box, corner, strict=True))) for corner in corners])
    return values.min(axis=0), values.max(axis=0)


FORMULAS = {
    "deflection of a cantilever under a load that grows": (
        lambda L, E, b, h: 100 * T * L**3 / (3 * E * b * h**3 / 12), {"L": 1.0, "E": 2e11, "b": 0.05, "h": 0.02},
    ),
    "twist of a hollow shaft under a torque that grows": (
        lambda L, G, D, k: 50 * T * L / (G * np.pi * D**4 * (1 - k**4) / 32),
        {"L": 0.8, "G": 8e10, "D": 0.03, "k": 0.6},
    ),
    "deflection of a coil spring": (
        lambda d, D, G, n, F: 8 * F * T * D**3 * n / (G * d**4),
        {"d": 0.004, "D": 0.03, "G": 8e10, "n": 9.0, "F": 20.0},
    ),
}  # fmt: skip


@pytest.mark.parametrize("share", [0.05, 0.02, 0.1])
@pytest.mark.parametrize(("f", "nominal"), FORMULAS.values(), ids=FORMULAS)
def test_studies_of_formulas_end_with_the_bounds_of_corners(f, nominal, share):
    box = {name: ((1 - share) * value, (1 + share) * value) for name, value in nominal.items()}
    bounds, calls = study(f, box)
    lower, upper = at_corners(f, box)
    assert errors(bounds, lower, upper).max() <= 0.01 * np.ptp([lower, upper], axis=0).max()
    assert not bounds.doubts and calls == bounds.evaluations < 150


@pytest.mark.parametrize("budget", [47, 60, 333])
@pytest.mark.parametrize("f", [lambda s: np.arctan(3 * s), lambda s: 1 / (2.5 + s), lambda s: abs(s - 0.2)])
def test_studies_make_no_more_runs_than_their_budget(f, budget):
    shapes = np.stack([np.cos((i + 1) * T + i) for i in range(5)]) / 5**0.5
    bounds, calls = unit_study(lambda x: f(x @ shapes), 5, method=mb.PolynomialChaos(budget=budget))
    assert calls == bounds.evaluations <= budget


@cache
def formulas():
    return *cases(101, 12), *monotone_series(101, 4)


@pytest.mark.parametrize("number", range(12 + 4))
def test_bounds_of_formulas_are_their_ranges(number):
    """True ranges are those of corners and of searches; tests/benchmarks/engineering_formulas.py has more cases."""
    case = formulas()[number]
    bounds, _ = study(lambda **p: np.broadcast_to(case.f(case.t, **p), case.t.shape), case.box, case.t)
    assert errors(bounds, case.lower, case.upper).max() <= 0.02 * (case.upper - case.lower).max() and not bounds.doubts


def swinging(d):
    """Shapes (d, 101) of time, whose signs change at different times."""
    return np.stack([np.cos((i % 5 + 1) * LONG + i) for i in range(d)]) * np.linspace(0.3, 1, d)[:, None]


LONG = np.linspace(0.0, 5.0, 101)


@pytest.mark.parametrize("d", [4, 6, 9])
@pytest.mark.parametrize(
    "law", [lambda s: np.exp(1.2 * s), lambda s: np.arctan(2 * s), lambda s: s + 0.2 * s**3, lambda s: np.tanh(3 * s)]
)
def test_monotone_motions_are_bounded_by_their_corners(d, law):
    """The range of law(s) is that of s = w x. A gradient and all its sign patterns would take half as many runs."""
    w = swinging(d) / d**0.5
    reach = np.abs(w).sum(axis=0)
    patterns = np.unique(np.concatenate([np.sign(w.T), -np.sign(w.T)]), axis=0)
    bounds, calls = unit_study(lambda x: law(x @ w), d, LONG)
    width = (law(reach) - law(-reach)).max()
    np.testing.assert_allclose(bounds["y"], [law(-reach), law(reach)], atol=3e-3 * width)
    assert not bounds.doubts and calls <= 2 * (d + 1 + len(patterns))


def test_expansions_of_monotone_motions_have_moments():
    w = swinging(5) / 5
    bounds, _ = unit_study(lambda x: np.exp(x @ w), 5, LONG)
    mean = np.prod(np.sinh(w) / w, axis=0)
    np.testing.assert_allclose(bounds.moments().mean[:, 0], mean, rtol=1e-2)


def test_a_study_without_time_ends_and_says_so():
    """A step along no axis, of which no surface is sure; the first round is all that there is time for."""
    method = mb.PolynomialChaos(budget=2000, seconds=1e-6)
    bounds, calls = unit_study(lambda x: np.array([float(np.sin(7 * sum(x)) > 0.3)]), 4, T[:1], method)
    assert calls < 100
    assert any("Allow more time by PolynomialChaos(seconds=...)" in doubt for doubt in bounds.doubts)


@pytest.mark.parametrize("d", [2, 4, 5])
@pytest.mark.parametrize("share", [1.0, 3.0])
def test_noise_as_large_as_the_response_is_doubtful(d, share):
    """There was no bound but a fault of an empty sequence."""
    rng = np.random.default_rng(d)
    bounds, _ = unit_study(lambda x: np.array([sum(x) / d + share * rng.normal()]), d, T[:1])
    assert bounds.doubts


def test_bounds_do_not_depend_on_the_threads_of_linear_algebra():
    code = (
        "import numpy as np, symmb as mb, sys; names = list('abcdefg'); w = np.array([1, .7, -.5, .3, .9, -.2, .4]);"
        "f = lambda **p: np.array([np.cos(1 + 2 * (np.array(list(p.values())) @ w))]);"
        "s = mb.FunctionSimulator(f, dict.fromkeys(names, 0.0), [0.0], ['y']);"
        "m = mb.PolynomialChaos(budget=60, seconds=600.0);"
        "b = mb.propagate(s, m, mb.Box(**dict.fromkeys(names, (-1.0, 1.0))));"
        "print(b.evaluations, b.lower[0, 0].hex(), b.upper[0, 0].hex(), b.estimate[0, 0].hex())"
    )
    told = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code], env={**os.environ, "OPENBLAS_NUM_THREADS": threads},
            capture_output=True, text=True, check=True,
        ).stdout
        for threads in "12"
    ]  # fmt: skip
    assert told[0] == told[1] and told[0].startswith(("4", "5", "6"))


@pytest.mark.parametrize(("d", "q"), [(4, 2), (4, 3), (5, 3), (5, 4), (6, 3), (6, 5)])
def test_products_are_bounded_by_all_corners(d, q):
    """A product acts for a while beside a sum: effects of parameters change their signs, and corners are exact."""
    names, when = "abcdef"[:d], np.exp(-(((T - 3) / 0.5) ** 2))
    shapes = np.stack([np.sin(T * (i + 1) / 2 + 0.3) for i in range(d)]) / 2

    def f(**p):
        x = np.array([p[name] for name in names])
        return x @ shapes + np.prod(x[:q]) * when

    box = dict.fromkeys(names, (-1.0, 1.0))
    bounds, calls = study(f, box)
    lower, upper = at_corners(f, box)
    np.testing.assert_allclose(bounds["y"], [lower, upper], atol=1e-6)
    assert calls <= 2**d + 4 * d + 9 and not bounds.doubts


@pytest.mark.parametrize(
    ("kinds", "d"), [((1.6, 0.3), 7), ((2.1, -0.2), 6), ((1.8, 0.6), 7), ((1.9, 0.1), 5), ((1.4, -0.5), 8)]
)
def test_a_range_beyond_what_runs_attain_is_checked(kinds, d):
    """Sines of three parameters and a sum of the others: an interpolant that is far off between its nodes."""
    steepness, phase = kinds
    t = np.linspace(0.0, 1.0, 101)
    rng = np.random.default_rng(d)
    weights = rng.uniform(-1, 1, (d, 1)) * np.cos(rng.uniform(0, 8, (d, 1)) * t + rng.uniform(-1, 1, (d, 1)))
    half = [np.abs(part).sum(axis=0) for part in (weights[:3], weights[3:])]
    values = np.sin(steepness * np.linspace(-1, 1, 2001)[:, None] * half[0] + phase)
    lower, upper = values.min(axis=0) - half[1], values.max(axis=0) + half[1]
    bounds, _ = unit_study(lambda x: np.sin(steepness * x[:3] @ weights[:3] + phase) + x[3:] @ weights[3:], d, t)
    assert errors(bounds, lower, upper).max() < 0.02 * (upper - lower).max() and not bounds.doubts


@pytest.mark.parametrize("number", range(6))
def test_rough_responses_are_bounded_by_what_runs_attain(number):
    """Resonances and kinks along directions: the extremes of an interpolant that does not converge are run."""
    t, rng = np.linspace(0.0, 1.0, 41), np.random.default_rng([137, number])
    d, middle, steepness = 4 + number % 3, rng.uniform(-0.5, 0.5), rng.uniform(1.5, 3)
    weights = rng.uniform(-1, 1, (d, 1)) * np.cos(rng.uniform(0, 6, (d, 1)) * t)

    def law(s):
        return np.abs(s - middle) if number % 2 else 1 / (1 + (steepness * (s - middle)) ** 2)

    values = law(np.linspace(-1, 1, 4001)[:, None] * np.abs(weights).sum(axis=0))
    bounds, _ = unit_study(lambda x: law(x @ weights), d, t)
    lower, upper = values.min(axis=0), values.max(axis=0)
    assert np.sqrt(np.mean(errors(bounds, lower, upper) ** 2)) < 0.05 * (upper - lower).max()
    assert (bounds.outer[0][:, 0] <= lower + 0.02).all() and (bounds.outer[1][:, 0] >= upper - 0.02).all()


@pytest.mark.parametrize("number", range(4))
def test_few_directions_of_many_parameters(number):
    """A draw of the benchmark engineering_formulas.py: right to 2 % of the width, or doubted."""
    case = list(directions(1138, number + 1, times=(1, 21), smooth=True))[number]
    bounds, _ = study(lambda **p: case.f(case.t, **p), case.box, case.t)
    assert bounds.doubts or errors(bounds, case.lower, case.upper).max() < 0.02 * (case.upper - case.lower).max()


@pytest.mark.parametrize(("before", "is_stalled"), [(0.1 * (1 + 1e-9), True), (0.1 * (1 + 1e-3), True), (1.0, False)])
def test_an_error_that_hardly_decreases_is_stalled(before, is_stalled):
    """The number of nodes that the tolerance would take is beyond the largest number."""
    output = OutputProblem(SimpleNamespace(box=range(7), shape=(20, 1), left=1000), 1e-2, False)
    output.grid, output.error, output.errors = SimpleNamespace(row=range(100)), np.float64(0.1), {50: before}
    assert SparseGrid()._is_stalled(output) == is_stalled


# Many outputs: each is bounded among others as well as alone

TIMES, PATIENT = np.linspace(0.0, 1.0, 60), mb.PolynomialChaos(seconds=600.0)
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
        Y = np.exp(0.3 * s) * (1 + TIMES)[:, None]
        Y[:, 0] = law(s[0] - c) * (1 + TIMES)
        return Y

    bounds = quietly(unit_bounds, f, d, PATIENT, TIMES, [f"y{k}" for k in range(20)])
    values = law(np.linspace(-1, 1, 20_001) - c)
    error = np.abs([bounds.lower[-1, 0] / 2 - values.min(), bounds.upper[-1, 0] / 2 - values.max()]).max()
    assert error <= 0.02 * np.ptp(values) or bounds.doubts


@pytest.mark.parametrize(("d", "seed"), [(4, 5), (5, 6)])
def test_a_smooth_output_does_not_pay_for_a_kink(d, seed):
    """exp(a x + t) is bounded as in a study of its own, beside |b x - t| sin(3 b x), whose kink moves."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.1, 0.3, d), rng.uniform(-1, 1, d)

    def f(x):
        return np.stack([np.exp(a @ x + TIMES), np.abs(b @ x - TIMES) * np.sin(3 * b @ x)], axis=1)

    both = quietly(unit_bounds, f, d, PATIENT, TIMES, ["smooth", "kink"])
    own = quietly(unit_bounds, lambda x: f(x)[:, :1], d, PATIENT, TIMES, ["smooth"])
    width = own.upper - own.lower
    for bounds in (both, own):
        assert (np.abs(bounds.lower[:, :1] - np.exp(TIMES - a.sum())[:, None]) < 0.01 * width).all()
        assert (np.abs(bounds.upper[:, :1] - np.exp(TIMES + a.sum())[:, None]) < 0.01 * width).all()
        assert "smooth" not in bounds.doubtful()
    assert both.estimate[:, 0].max() < 1.5 * own.estimate.max() + 1e-12


BUMPS = [
    ((-0.58, -0.87, -0.27), 0.31, (0.04, 0.07, -0.27)),
    ((0.67, 0.27, -0.29), 0.37, (0.2, -0.1, 0.15)),
    ((-0.21, 0.84, -0.81), 0.31, (0.1, 0.2, -0.2)),
    ((0.56, 0.78, -0.18, -0.68), 0.53, (0.2, -0.3, 0.1, 0.25)),
]


@pytest.mark.parametrize(("at", "width", "slope"), BUMPS)
def test_bumps_inside_of_the_box_are_not_missed_in_silence(at, width, slope):
    """The surface knew only some of the runs, or only corners were run. tests/benchmarks/silent_errors.py has more."""
    at, slope = np.array(at), np.array(slope)
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        bounds, _ = unit_study(
            lambda x: [np.exp(-np.square(x - at).sum() / (2 * width**2)) + x @ slope], len(at), T[:1]
        )
    top = 1 + at @ slope
    assert bounds.doubts or bounds.outer[1][0, 0] >= top - 0.02 * (top + np.abs(slope).sum())
