"""Optimisation of the responses: quadratics against brute force, bounds against closed forms and the pendulum's."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from faults import refused, warned
from oscillators import BOX, TIMES, Wave, wave, wave_bounds

import symmb as mb
from symmb import Box, FunctionSimulator, MonteCarlo, Optimization, PropagationError, Swarm, propagate
from symmb.bound.searches.quadratic_models import _box_minima, quadratics
from symmb.connect.simulator import Ensemble, stream

SQUARE, ABOVE = Box(a=(-1, 1), b=(-1, 1)), "estimated error is above 10 % of the width"


def _quadratic(rng, d, m):
    """Values and gradients, as functions of points (N, d), of m random quadratics."""
    H = rng.normal(size=(d, d, m))
    H += H.transpose(1, 0, 2)
    g = rng.normal(size=(d, m))
    value = lambda X: X @ g + np.einsum("ni,ijm,nj->nm", X, H, X) / 2  # noqa: E731
    return H, value, lambda X: g + np.einsum("ijm,nj->nim", H, X)


def _models(X, F, G):
    """Models of m functions from their values F (N, m) and gradients G (N, d, m)."""
    jets = np.concatenate([F[:, None], G], axis=1).transpose(0, 2, 1)
    return quadratics(X, jets, np.arange(F.shape[1]), F.argmin(axis=0))


@pytest.mark.parametrize(("d", "N"), [(1, 2), (2, 4), (3, 8), (6, 20)])
def test_curvatures_of_quadratics_are_exact(d, N):
    rng = np.random.default_rng(d)
    H, value, gradient = _quadratic(rng, d, 50)
    X = rng.uniform(-1, 1, (N, d))
    models = _models(X, value(X), gradient(X))
    np.testing.assert_allclose(models.hessian, np.broadcast_to(H, models.hessian.shape), atol=1e-9)
    change = np.diag(value((models.origin + models.step).T) - value(models.origin.T))
    np.testing.assert_allclose(models.change(models.step), change, atol=1e-9)
    assert (np.abs(models.origin + models.step) <= 1 + 1e-12).all() and models.gain.max() > 0.1


def test_negative_outputs_have_negative_models():
    jets = np.random.default_rng(2).normal(size=(4, 5, 3))
    X, lowest = np.array([[-0.5, 0.2], [0.1, 0.3], [0.7, -0.6], [0.0, 0.9]]), np.array([0, 1, 2, 3, 0])
    models, negative = (quadratics(X, side * jets, np.arange(5) + start, lowest) for side, start in [(1, 0), (-1, 5)])
    np.testing.assert_allclose(models.hessian, negative.hessian)
    np.testing.assert_allclose(models.step, negative.step)


def test_one_point_predicts_the_corner_of_steepest_descent():
    models = _models(np.zeros((1, 2)), np.zeros((1, 3)), np.array([[[1.0, -2.0, 0.5], [1.0, 3.0, -4.0]]]))
    np.testing.assert_array_equal(models.step, [[-1, 1, -1], [-1, -1, 1]])
    np.testing.assert_array_equal(models.gain, [2.0, 5.0, 4.5])


def test_steps_minimise_convex_quadratics_over_the_box():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(2, 2, 40))
    H = np.einsum("ikm,jkm->ijm", root, root) + 0.5 * np.eye(2)[..., None]
    g = 2 * rng.normal(size=(2, 40))
    line = np.linspace(-1, 1, 201)
    grid = np.stack(np.meshgrid(line, line)).reshape(2, -1)
    values = grid.T @ g + np.einsum("in,ijm,jn->nm", grid, H, grid) / 2
    s = _box_minima(g, H, -np.ones((2, 40)), np.ones((2, 40)))
    least = (g * s).sum(0) + np.einsum("im,ijm,jm->m", s, H, s) / 2
    assert (least <= values.min(axis=0) + 1e-4).all() and (np.abs(s) <= 1).all()


def test_a_point_is_not_chosen_twice():
    X = np.array([[-0.5], [0.5]])
    F, G = np.array([[1.0, 1.0, 0.1], [2.0, 2.0, 2.0]]), np.array([[[-4.0, -4.0, 0.2]], [[4.0, 4.0, 4.0]]])
    models = _models(X, F, G)
    points = models.promising(np.full(3, 1e-6), 5)
    assert len(points) == 2 and points[0] != points[1]
    assert len(models.promising(np.full(3, 1e-6), 1)) == 1 and len(models.promising(np.full(3, 1e6), 5)) == 0


@dataclass
class Valley:
    """y_k = (a - c_k)^2 + (b - c_k a)^2, its least value 0 where a = c_k, b = c_k^2; counts what it is asked for."""

    centers: np.ndarray = field(default_factory=lambda: np.linspace(-0.8, 0.8, 9))
    broken: float = np.inf
    parameters: dict = field(default_factory=lambda: {"a": 0.0, "b": 0.0})
    outputs: tuple = ("y",)
    runs: int = 0

    @property
    def times(self):
        return np.arange(len(self.centers), dtype=float)

    def _y(self, a, b):
        return (a - self.centers) ** 2 + (b - self.centers * a) ** 2

    def run(self, P):
        self.runs += len(P)
        Y = self._y(P[:, :1], P[:, 1:])[..., None]
        ok = P[:, 0] < self.broken
        Y[~ok] = np.nan
        return Ensemble(Y, ok, np.where(ok, np.nan, 0.0), ("broken",) * int((~ok).sum()))

    def stream(self, P, reduction, executor=None, progress=None):
        return stream(self, P, reduction, executor, progress)

    def jets(self, p0, directions, order):
        assert order == 1
        self.runs += len(np.unique(p0, axis=0)) + len(directions)
        (a, b), (da, db), c = p0.T[..., None], directions.T[..., None], self.centers
        slope = da * (2 * (a - c) - 2 * c * (b - c * a)) + db * 2 * (b - c * a)
        return np.stack([self._y(a, b), slope])[..., None]


def test_minima_inside_are_found_and_every_run_is_counted():
    valley = Valley()
    result = propagate(valley, Optimization(), SQUARE)
    assert result.evaluations == valley.runs <= 300
    highest = np.max([valley._y(a, b) for a in (-1, 1) for b in (-1, 1)], axis=0)
    np.testing.assert_allclose(result.upper[:, 0], highest, rtol=1e-14)
    assert (result.lower >= 0).all() and (result.lower[:, 0] <= 1e-4 * highest).all()
    assert (result.lower - result.estimate <= 0).all() and np.shares_memory(result.inner[0], result.lower)


def test_the_estimate_falls_with_the_budget():
    few = warned(ABOVE, propagate, Valley(), Optimization(20), SQUARE)
    more = propagate(Valley(), Optimization(100), SQUARE)
    assert few.evaluations <= 20 and more.evaluations <= 100
    assert more.estimate.max() < 0.1 * few.estimate.max()


def test_a_looser_tolerance_spends_less():
    loose, tight = (propagate(Wave(), Optimization(tolerance=share), BOX) for share in (1e-2, 1e-4))
    assert loose.evaluations < tight.evaluations
    exact = wave_bounds()
    assert (loose.upper >= exact[1] - 0.02).all() and (tight.upper >= exact[1] - 2e-4).all()


def test_outputs_without_width_promise_nothing():
    @dataclass(frozen=True)
    class Constant(Wave):
        def jets(self, p0, directions, order):
            return 0 * super().jets(p0, directions, order) + np.array([5.0, 0.0])[:, None, None, None]

        def run(self, P):
            return replace(super().run(P), Y=np.full((len(P), len(TIMES), 1), 5.0))

    result = propagate(Constant(), Optimization(), BOX)
    assert result.evaluations == 15  # the centre and the corners
    expected = np.full((3, 61, 1), [[[5]], [[5]], [[0]]])
    np.testing.assert_array_equal([result.lower, result.upper, result.estimate], expected)


def test_a_monotone_output_needs_the_corners_only():
    @dataclass
    class Plane(Valley):
        def _y(self, a, b):
            return self.centers + a - 2 * b

        def jets(self, p0, directions, order):
            slopes = np.tile(directions @ [[1.0], [-2.0]], len(self.centers))
            return np.stack([self._y(*p0.T[..., None]), slopes])[..., None]

    result = propagate(Plane(), Optimization(), SQUARE)
    assert result.evaluations == 15
    expected = np.add.outer([-3.0, 3.0], Plane().centers)[..., None]
    np.testing.assert_allclose([result.lower, result.upper], expected, atol=1e-14)
    np.testing.assert_array_equal(result.estimate, 0)


def test_failed_runs_are_told():
    result = warned(r"\d of \d+ runs failed", propagate, Valley(broken=0.1), Optimization(budget=40), SQUARE)
    assert result.failed and all(run.parameters["a"] >= 0.1 for run in result.failed)
    assert np.isfinite(result.lower).all() and np.isfinite(result.upper).all()


def test_a_budget_below_one_run_with_derivatives():
    told = r"in 2 parameters counts as 3.*Give a budget of at least 6"
    refused(told, propagate, Wave(), Optimization(budget=5), BOX, error=mb.PropagationError)
    assert warned(ABOVE, propagate, Wave(), Optimization(budget=6), BOX).evaluations <= 6


# Particle swarms: cost, failures, and what every executor gives

FEW = np.array([0.0, 3.0, 6.0])


def fragile(amplitude, w):
    """The wave at a few times; breaks where both parameters are large."""
    if amplitude + w > 2.1:
        raise ValueError("too large")
    return amplitude * np.cos(w * FEW)


def simulator(f):
    return FunctionSimulator(f, {"amplitude": 1.0, "w": 1.0}, FEW, ["x"])


def test_every_swarm_searches_for_itself():
    method = Swarm(particles=4, steps=15, seed=1)
    result = propagate(simulator(lambda amplitude, w: wave(amplitude, w)[[0, 30, 60]]), method, BOX)
    assert result.evaluations == 2 * 3 * 4 * 15
    exact = wave_bounds()
    np.testing.assert_allclose([result.lower, result.upper], np.array(exact)[:, [0, 30, 60]], atol=1e-6)
    as_many = propagate(Wave(), MonteCarlo(result.evaluations), BOX)
    assert np.abs(as_many.upper - exact[1])[[0, 30, 60]].max() > 1e-3


def test_failed_runs_are_told_and_left_behind():
    result = warned(r"\d+ of 1200 runs failed", propagate, simulator(fragile), Swarm(), BOX)
    assert 0 < len(result.failed) < result.evaluations / 2
    assert all(run.parameters["amplitude"] + run.parameters["w"] > 2.1 for run in result.failed)
    assert result.upper[0, 0] == pytest.approx(1.1, abs=1e-3)  # amplitude 1.1 wherever w <= 1
    assert np.isfinite(result.lower).all()


def test_all_runs_failed():
    method, box = Swarm(particles=4, steps=5), Box(amplitude=(1.5, 1.6))
    refused("all 120 runs failed", propagate, simulator(fragile), method, box, error=PropagationError)


def test_same_seed_same_bounds_whatever_the_executor():
    alone = propagate(Wave(), Swarm(particles=3, steps=4), BOX)
    with ThreadPoolExecutor(2) as executor:
        spread = propagate(Wave(), Swarm(particles=3, steps=4), BOX, executor=executor)
    other = propagate(Wave(), Swarm(particles=3, steps=4, seed=1), BOX)
    np.testing.assert_array_equal(alone.upper, spread.upper)
    assert len(alone.t) == len(TIMES) and (alone.upper != other.upper).any()


def test_progress_counts_all_runs():
    told = []
    propagate(Wave(), Swarm(particles=2, steps=3), BOX, progress=lambda done, n: told.append((done, n)))
    assert told == [(244, 732), (488, 732), (732, 732)]
