"""Growing grids, their estimated errors, and bounds that choose their own runs."""

import tracemalloc
from contextlib import nullcontext

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box_bounds, unit_bounds, unit_function
from conftest import but_long
from faults import refused, warned
from numpy.testing import assert_allclose
from small_scenes import formulas

import symmb as mb
from models import double_pendulum
from symmb import ClenshawCurtis, Exact
from symmb.bound.adaptive.continuation import Continuation, Corrected, extrapolated_sizes
from symmb.bound.adaptive.error_estimate import TruncationError
from symmb.bound.nodes.grid import Grid, line
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.legendre import basis_values, tensor_degree
from symmb.bound.polynomials.ranges.dense import dense_extremes

RNG = np.random.default_rng(7)


def grown(d, indices):
    grid = Grid(d)
    grid.add(grid.missing(indices))
    return grid


@pytest.mark.parametrize("degree", [2, 4, 8, 16, 32])
def test_the_first_nodes_are_those_of_clenshaw_and_curtis(degree):
    assert_allclose(np.sort(line(degree + 1)), ClenshawCurtis().line(degree)[0], atol=1e-15)


def test_the_nodes_are_spread_at_every_degree():
    x = np.linspace(-1, 1, 2001)
    for n in range(2, 34):
        nodes = line(n)
        cardinals = [np.prod([(x - b) / (a - b) for b in nodes if b != a], axis=0) for a in nodes]
        assert np.abs(cardinals).sum(axis=0).max() < 4 * n  # Lebesgue's constant


@pytest.mark.parametrize(
    ("d", "indices"), [(1, [(7,)]), (2, [(4, 4)]), (2, [(5, 0), (2, 3), (0, 6)]), (4, [(2, 1, 0, 3), (0, 0, 2, 2)])]
)
def test_polynomials_of_a_grid_are_found_again(d, indices):
    grid = grown(d, indices)
    assert all(b in grid.row for a in grid.row for b in [(*a[:i], max(a[i] - 1, 0), *a[i + 1 :]) for i in range(d)])
    expected = RNG.normal(size=(len(grid.row), 3))
    assert_allclose(grid.coefficients(basis_values(grid.alpha, grid.nodes) @ expected), expected, atol=1e-12)


def test_grids_grow_by_indices_whose_lower_ones_are_there():
    assert grown(2, [(2, 0), (0, 1)]).ahead() == {(3, 0), (1, 1), (0, 2)}


def test_expected_errors_are_of_the_size_of_true_ones_and_small_at_nodes():
    grid = grown(2, [(6, 6)])
    c = np.linspace(0.3, 0.7, 41)
    points = RNG.uniform(-1, 1, (4000, 2))

    def f(x):
        return np.stack([1 / (1.6 + c + x[:, :1] - c * x[:, 1:])], axis=2)

    coefficients = grid.coefficients(f(grid.nodes).reshape(49, -1)).reshape(49, 41, 1)
    tails = TruncationError.of(grid.alpha, coefficients)
    errors = np.abs(f(points) - np.tensordot(basis_values(grid.alpha, points), coefficients, axes=1)).max(axis=0)
    largest = np.max([tails.at(np.array([x, x])) for x in np.linspace(-1, 1, 41)], axis=0)
    assert (largest > 0.5 * errors).all() and (largest < 20 * errors).all()
    assert (tails.at(np.array([1.0, 1.0])) < 0.2 * largest).all() and (tails.least <= largest).all()


def test_a_grid_continues_most_likely_through_other_points():
    """Errors are laid to the parameter along which coefficients fall off slowly."""
    grid = grown(2, [(3, 3)])
    size = np.array([2.0 ** -a[0] * 8.0 ** -a[1] for a in grid.row])
    continuation = Continuation.of(grid, extrapolated_sizes(grid, size))
    assert dict(zip(map(tuple, continuation.alpha.tolist()), continuation.sizes, strict=True))[4, 0] == 2.0**-4
    points = np.array([[0.4, 0.9]])
    checks = np.array([[[0.1, -0.2]]])
    base = Expansion(grid.alpha, np.zeros((len(grid.alpha), 1, 2)), ("a", "b"))
    own = Corrected.of(base, continuation, points, checks).expansion()
    assert_allclose(own.values(points), checks, rtol=1e-4)
    assert_allclose(own.values(grid.nodes), 0.0, atol=1e-12)
    first = {tuple(a): abs(f[0, 0]) for a, f in zip(own.alpha.tolist(), own.coefficients, strict=True)}
    assert first[4, 0] > 10 * first[0, 4]


def test_both_forms_of_the_most_likely_continuation_agree():
    grid = grown(2, [(3, 3)])
    continuation = Continuation.of(grid, extrapolated_sizes(grid, np.ones(len(grid.row))))
    base = Expansion(grid.alpha, np.zeros((len(grid.alpha), 1, 1)), ("a", "b"))
    n = len(continuation.alpha)
    points, places = RNG.uniform(-1, 1, (n + 1, 2)), RNG.uniform(-1, 1, (5, 2)).round(1)
    many = Corrected.of(base, continuation, points, points[:, :1, None])
    free, there = (continuation.free(grid.alpha, x) for x in (points, places))
    products = free @ free.T + continuation.noise * np.eye(n + 1)
    likely = free.T @ np.linalg.solve(products, points[:, 0])
    assert_allclose(many.expansion().coefficients[-n:, 0, 0], continuation.sizes * likely, rtol=1e-5, atol=1e-9)
    explained = (there @ free.T * np.linalg.solve(products, free @ there.T).T).sum(axis=1)
    assert_allclose(many.expected_error(places) ** 2, np.square(there).sum(axis=1) - explained, rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize(("d", "order"), [(1, 9), (2, 4), (2, 9), (3, 3)])
def test_dense_search_finds_the_extremes_that_branch_and_bound_proves(d, order):
    alpha = RNG.permutation(tensor_degree(d, order))
    coefficients = RNG.normal(size=(len(alpha), 203)) * 0.5 ** alpha.sum(axis=1)[:, None]
    lower, upper, at_lower, at_upper = dense_extremes(alpha, coefficients)
    proved = Exact(1e-7).search(alpha, coefficients)
    width = proved.upper - proved.lower
    values = [np.einsum("mb,bm->m", basis_values(alpha, at), coefficients) for at in (at_lower, at_upper)]
    assert_allclose(values, [lower, upper], atol=1e-12)
    short = np.maximum(lower - proved.lower, proved.upper - upper) / width
    assert short.min() > -1e-9 and np.quantile(short, 0.9) < 1e-5 and short.max() < 2e-2


def test_many_parameters_with_few_runs():
    """Ten parameters, of which products of three matter: exp and its extremes are known."""
    weights = 0.7 ** np.arange(10)
    method = mb.PolynomialChaos(tolerance=2e-2)
    bounds = unit_bounds(lambda x: [np.exp(weights @ x / 2), 0.0], 10, method, [0.0, 1.0])
    extremes = np.exp(np.array([-0.5, 0.5]) * weights.sum())
    errors = np.abs([bounds.lower[0, 0] - extremes[0], bounds.upper[0, 0] - extremes[1]])
    assert bounds.evaluations < 400 and errors.max() < 0.02 * np.ptp(extremes)
    assert errors.max() <= bounds.estimate[0, 0]
    assert_allclose(bounds.moments().mean[0, 0], np.prod(np.sinh(weights / 2) / (weights / 2)), rtol=1e-2)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("budget", [9, 20, 30])
def test_scenes_of_two_parameters_keep_budgets(budget):
    bounds = mb.propagate(double_pendulum.scene(), mb.PolynomialChaos(budget=budget))
    assert bounds.evaluations <= budget


def test_budgets_are_spent_on_nodes_and_checks():
    simulator, box = unit_function(lambda x: np.sin(1 + 30 * sum(x**2)), 5)
    for budget in (11, 40, 41, 100):
        told, method = "estimated error is above 10 % of the width: y", mb.PolynomialChaos(budget=budget, seconds=600.0)
        bounds = warned(told, mb.propagate, simulator, method, box)
        assert 0.8 * budget <= bounds.evaluations <= budget
    told, method = "the first level takes 11 runs, more than the budget of 10", mb.PolynomialChaos(budget=10)
    refused(told, mb.propagate, simulator, method, box, error=mb.PropagationError)


@pytest.mark.parametrize("d", [2, 4])
def test_nodes_that_fail_are_told_and_predicted(d):
    """A run fails close to one corner: the other ones still give the bounds of a response that goes on smoothly."""

    def f(x):
        if np.abs(x - 0.7).max() < 0.1:
            raise ValueError("no convergence")
        return np.exp(sum(x) / 4)

    with pytest.warns(mb.SymmbWarning, match=r"1 of \d+ runs failed") if d == 2 else nullcontext():
        bounds = unit_bounds(f, d, mb.PolynomialChaos(tolerance=1e-4 if d == 2 else 1e-3))
    if d == 2:
        assert "no convergence" in str(bounds)
        (failed,) = bounds.failed
        assert failed.parameters == pytest.approx({"x0": 0.5**0.5, "x1": 0.5**0.5})
    extremes = np.exp(np.array([-1, 1]) * d / 4)
    assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], extremes, atol=1e-3 * np.ptp(extremes))


def test_too_many_failures_at_first_are_an_error():
    def f(x):
        if x[0] > -0.5:
            raise ValueError("no convergence")
        return sum(x)

    refused(r"6 of the first 9 runs failed(.|\n)*no convergence", unit_bounds, f, 2, error=mb.PropagationError)


@pytest.mark.parametrize(
    ("f", "highest", "runs"),
    [(lambda x: abs(x - 0.123), 1.123, 130), (lambda x: float(x > 0.123), 1.0, 55)],
    ids=["kink", "jump"],
)
def test_a_response_that_is_not_smooth_is_bounded_in_pieces(f, highest, runs):
    """A polynomial overshoots at a jump by 9 % of it, whatever its degree."""
    for tolerance, most in ((1e-2, runs), (1e-4, 500)):
        bounds = unit_bounds(lambda x: f(x[0]), 1, mb.PolynomialChaos(tolerance=tolerance))
        error = max(abs(bounds.lower[0, 0]), abs(bounds.upper[0, 0] - highest))
        assert error <= bounds.estimate[0, 0] <= 1.01 * tolerance * highest and bounds.evaluations <= most


@pytest.mark.parametrize("budget", [1000, None])
@pytest.mark.filterwarnings("ignore:.*estimated error is above 10 %:symmb.SymmbWarning")
def test_pieces_are_refined_where_and_when_they_hold_extremes(budget):
    """A front runs through the box from 0.5 s on: no degree resolves it, and few runs are far from the extremes.

    Without a budget, the study takes from 400 to 5000 runs, which depends on rounding. It ends without a warning.
    """
    t, points = np.linspace(0, 1, 21), []

    def law(x, y):
        return np.array([np.sin(3 * x + time) + (time > 0.5) * (x + 0.3 * y**2 > 0.1 + time / 2) for time in t])

    method = mb.PolynomialChaos(tolerance=3e-2, budget=budget)
    bounds = unit_bounds(lambda x: points.append((*x,)) or law(*x), 2, method, t)
    assert bounds.evaluations == len(points) == len(set(points)) <= (budget or 5000)
    assert budget or not bounds.doubts
    true = law(*np.meshgrid(np.linspace(-1, 1, 401), np.linspace(-1, 1, 401)))
    errors = np.maximum(np.abs(bounds.lower[:, 0] - true.min((1, 2))), np.abs(bounds.upper[:, 0] - true.max((1, 2))))
    assert (errors <= bounds.estimate[:, 0] + 5e-3).mean() >= 0.95 and errors.max() < 0.1
    assert errors[t <= 0.5].max() < 1e-2


def test_kinks_of_many_parameters_are_bounded_by_what_runs_attain():
    t = np.linspace(0, 2, 41)
    method = mb.PolynomialChaos(seconds=600.0)
    bounds = unit_bounds(lambda x: abs(np.sin(3 * t) - 0.4 * (x @ np.arange(1, 7))), 6, method, t)
    assert bounds.evaluations < 700 and not bounds.doubtful()  # fewer if the default time ends the study
    highest = 8.4 + np.abs(np.sin(3 * t))  # and the lowest is 0
    error = np.maximum(np.abs(bounds.lower), np.abs(bounds.upper - highest[:, None]))
    assert (error <= bounds.estimate).all() and (error < 0.01 * highest[:, None]).all()


@pytest.mark.parametrize("method", [mb.Scanning(21), mb.Vertex()], ids=repr)
def test_grids_of_too_many_points_are_an_error(method):
    told = r"takes .* runs, more than the .* allowed\. Use PolynomialChaos"
    refused(told, unit_bounds, lambda x: 0.0, 40, method, error=mb.PropagationError)


def test_500_runs_are_enough_for_ten_parameters():
    """Five rods whose lengths and masses are known to 5 %: the 1,024 corners are where most extremes lie."""
    p = mb.Parameters(**{f"{name}{i}": 0.2 for i in range(5) for name in ("l", "m")})
    sizes = [(getattr(p, f"l{i}"), getattr(p, f"m{i}")) for i in range(5)]
    rods = [mb.Body(f"rod{i}", m, m * length**2 / 12, mb.Planar()) for i, (length, m) in enumerate(sizes)]
    ends = [mb.Ground().point(0, 0), *(rod.point(0, -length / 2) for rod, (length, _) in zip(rods, sizes, strict=True))]
    joints = [mb.Revolute(f"joint{i}", ends[i], rods[i].point(0, sizes[i][0] / 2)) for i in range(5)]
    system = mb.System(*rods, *joints, mb.Gravity(0, -9.81), parameters=p)
    start = {f"rod{i}.theta": 0.5 for i in range(5)}
    outputs = {f"{kind}{rod.name}": getattr(rod, kind) for rod in rods for kind in ("theta", "omega")}
    scene = mb.Scene(system, start, np.linspace(0.0, 1.0, 51), outputs, box=mb.Box.around(p, 0.05))
    simulator = mb.DAESimulator(scene, mb.DormandPrince(rtol=1e-9))
    method = mb.PolynomialChaos(budget=500, seconds=600.0)
    bounds = mb.propagate(simulator, method, scene.box)
    attained = mb.propagate(simulator, mb.Vertex(), scene.box)
    width = np.sqrt(np.mean((attained.upper - attained.lower) ** 2, axis=0))
    others = (mb.propagate(simulator, method, mb.Box.around(p, share)) for share in (0.049, 0.0495, 0.0505, 0.051))
    for study in (bounds, *others):
        assert not study.doubts
        assert (np.sqrt(np.mean(study.estimate**2, axis=0)) <= 1.01e-2 * width).all()
    short = np.maximum(np.maximum(bounds.lower - attained.lower, attained.upper - bounds.upper), 0.0)
    assert (np.sqrt(np.mean(short**2, axis=0)) < 5e-3 * width).all()
    assert (short <= bounds.estimate + 1e-6 * width).mean() > 0.98


@pytest.mark.parametrize("seed", range(5))
def test_a_kink_at_one_of_256_corners_is_found(seed):
    """A sum of waves has its maximum at one corner or another. For a moment, one of these corners has a kink."""
    rng, d, t = np.random.default_rng(seed), 8, np.linspace(0.0, 1.0, 101)
    rate, phase, moment = rng.uniform(3, 15, d), rng.uniform(0, 6, d), rng.uniform(0.3, 0.7)
    signs = np.sign(np.cos(rate * moment + phase))

    def response(x, time, positive, cos, exp):
        waves = sum(cos(rate[i] * time + phase[i]) * x[i] for i in range(d))
        excess = positive(sum(signs[i] * x[i] for i in range(d)) - (d - 1.5))
        return waves + 1.5 * exp(-(((time - moment) / 0.015) ** 2)) * excess

    def wave(p):
        return {"y": response([getattr(p, name) for name in p], mb.t, lambda z: ca.fmax(z, 0), ca.cos, ca.exp)}

    bounds = mb.propagate(formulas(wave, t, **{f"x{i}": (-1.0, 1.0) for i in range(d)}))
    corners = np.indices((2,) * d).reshape(d, -1, 1) * 2.0 - 1
    exact = response(corners, t, lambda z: np.maximum(z, 0), np.cos, np.exp).max(axis=0)
    assert (exact - bounds.upper[:, 0] - bounds.estimate[:, 0]).max() < 0.01 * (exact + exact).max()


@pytest.mark.parametrize("d", but_long([2, 4], 4))
def test_long_studies_take_little_memory_beside_their_runs_and_result(d):
    times, rates = np.linspace(0.0, 10.0, 100_000), np.array([1.0, 2.0])

    def response(a, b, **others):
        return np.sin(a * rates * times[:, None] + b) * (1 + 0.1 * sum(others.values()))

    box = dict.fromkeys("abcde"[:d], (0.9, 1.1))
    tracemalloc.start()
    bounds = black_box_bounds(response, mb.PolynomialChaos(tolerance=0.05), times, "x y", **box)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    array = bounds.lower.nbytes
    assert peak < bounds.expansion.coefficients.nbytes + (bounds.evaluations + 40) * array + 100e6
