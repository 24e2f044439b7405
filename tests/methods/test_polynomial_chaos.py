"""Polynomial chaos: the paper's numbers, failed nodes, lockstep."""

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box_bounds
from faults import refused, warned
from oscillators import BOX, TIMES, Wave, wave, wave_bounds

import symmb as mb
from symmb.bound.nodes.fit import Fit
from symmb.bound.polynomials.legendre import basis_ranges, basis_values, total_degree, univariate_minimum

CUBIC = mb.FunctionSimulator(lambda x: [[x**3 - 2 * x**2 + x]], {"x": 0.5}, [0.0], ["f"])


def test_equation_24_ranges_of_the_basis():
    known = [1, -1, -1 / 2, -1, -3 / 7, -1, -0.414750, -1, -0.409690, -1, -0.407276, -1, -0.405937]
    np.testing.assert_allclose([univariate_minimum(n) for n in range(13)], known, atol=6e-7)
    assert abs(univariate_minimum(4) + 3 / 7) < 1e-14


@pytest.mark.parametrize("d", [1, 2, 3])
def test_ranges_of_products_are_attained_and_never_left(d):
    alpha = total_degree(d, 6)
    line = np.cos(np.linspace(0, np.pi, {1: 4001, 2: 201, 3: 41}[d]))
    values = basis_values(alpha, np.stack(np.meshgrid(*[line] * d), axis=-1).reshape(-1, d))
    low, high = basis_ranges(alpha)
    assert (values >= low - 1e-12).all() and (values <= high + 1e-12).all()
    np.testing.assert_allclose(values.min(axis=0), low, atol=0.02)
    np.testing.assert_allclose(values.max(axis=0), high, atol=1e-12)


def test_equation_21_number_of_terms():
    assert [len(total_degree(d, p)) for d, p in [(1, 3), (2, 2), (3, 2), (6, 4)]] == [4, 6, 10, 210]


@pytest.mark.parametrize(
    "nodes", [mb.Gauss(), mb.ClenshawCurtis(), mb.SparseGrid(), mb.SparseGrid(mb.ClenshawCurtis())], ids=repr
)
def test_equation_25_coefficients(nodes):
    fit = Fit.of(nodes, mb.TotalDegree(), 1, 3)
    values = CUBIC.run((fit.nodes + 1) / 2).Y[:, :, 0]
    coefficients = fit.coefficients(fit.functionals @ values, np.ones(len(fit.nodes), bool))
    np.testing.assert_allclose(coefficients[:, 0], [1 / 12, -1 / 20, -1 / 12, 1 / 20], atol=1e-14)


def test_paper_preset_is_what_it_says():
    given = {"nodes": mb.Gauss(), "basis": mb.TotalDegree(), "range": mb.LegendreInclusion()}
    assert mb.PolynomialChaos.paper(order=2) == mb.PolynomialChaos(order=2, **given)
    assert mb.propagate(Wave(), mb.PolynomialChaos.paper(order=2), BOX).evaluations == 9


@pytest.mark.parametrize(("rule", "total"), [(mb.Gauss(), 681), (mb.ClenshawCurtis(), 34)])
def test_sparse_grid_weights_of_six_parameters(rule, total):
    nodes, weights = mb.SparseGrid(rule).points(6, 4)
    assert round(np.abs(weights).sum()) == total and weights.sum() == pytest.approx(1)
    assert len(np.unique(nodes.round(12), axis=0)) == len(nodes)


def test_basis_beyond_the_nodes_is_refused():
    with pytest.raises(mb.PropagationError, match="do not determine the 16 polynomials of TensorDegree"):
        mb.propagate(Wave(), mb.PolynomialChaos(order=3, nodes=mb.SparseGrid()), BOX)


@pytest.mark.parametrize("order", [2, 3])
def test_lockstep_gives_the_bounds_of_single_runs(order):
    together = mb.propagate(Wave(), mb.PolynomialChaos.paper(order, lockstep=True), BOX)
    single = mb.propagate(Wave(), mb.PolynomialChaos.paper(order), BOX)
    np.testing.assert_allclose([together.lower, together.upper], [single.lower, single.upper], atol=1e-14)
    np.testing.assert_array_equal(together.inner, single.inner)


def _breaks(amplitude, w):
    if amplitude > 1.05 and w > 1.03:
        raise RuntimeError("no convergence")
    return wave(amplitude, w)


def _breaks_at_three(amplitude, w):
    x = wave(amplitude, w)
    return np.where((TIMES >= 3) & (amplitude > 1.05) & (w > 1.03), np.nan, x)


@pytest.mark.parametrize(("f", "time"), [(_breaks, 0.0), (_breaks_at_three, 3.0)])
def test_fit_around_a_failed_node(f, time):
    method = mb.PolynomialChaos(order=2, nodes=mb.Gauss(), basis=mb.TotalDegree())
    result = warned("1 of 9 runs failed", black_box_bounds, f, method, TIMES, "x", amplitude=(0.9, 1.1), w=(0.95, 1.05))
    (failure,) = result.failed
    assert failure.parameters == pytest.approx({"amplitude": 1 + 0.1 * 0.6**0.5, "w": 1 + 0.05 * 0.6**0.5})
    assert failure.time == time
    exact = wave_bounds()
    assert np.abs(result.upper - exact[1]).max() < 0.02 and np.abs(result.lower - exact[0]).max() < 0.02


@pytest.mark.parametrize(
    "method", [mb.PolynomialChaos(order=2), mb.PolynomialChaos.paper(order=2, nodes=mb.SparseGrid())], ids=repr
)
def test_too_few_nodes_left_is_an_error_that_lists_them(method):
    told, box = r"failed(.|\n)*  RuntimeError: no convergence \(amplitude=1\.\d+, w=1\.\d+\)", (0.8, 1.2)
    failing = lambda: black_box_bounds(_breaks, method, TIMES, "x", amplitude=box, w=box)  # noqa: E731
    refused(told, failing, error=mb.PropagationError)


def test_all_nodes_failed():
    failing = lambda: black_box_bounds(lambda x: 1 / 0, mb.PolynomialChaos.paper(order=2), x=(0, 1))  # noqa: E731
    refused("3 of 3 nodes failed", failing, error=mb.PropagationError)


# Bounds stay within what the formula of an output can give, whatever a surrogate says between its nodes

P = mb.Parameters(k=100.0, c=1.0)
BALL = mb.Body("ball", 1.0, pose=mb.Particle())
FLOOR = ca.if_else(BALL.y < 0, ca.fmax(0, -P.k * BALL.y - P.c * BALL.vy), 0)
OUTPUTS = {
    "force": (FLOOR, 0.0, np.inf),
    "share": (ca.tanh(BALL.vy / 0.01), -1.0, 1.0),
    "contact": (ca.if_else(BALL.y < 0, 1.0, 0.0), 0.0, 1.0),
    "depth": (ca.fabs(ca.fmin(BALL.y, 0)), 0.0, np.inf),
    "speed": (ca.norm_2(ca.vertcat(BALL.vx, BALL.vy)), 0.0, np.inf),
    "limited": (ca.fmin(ca.fmax(P.k * BALL.y, -3.0), 5.0), -3.0, 5.0),
    "stiffness": (P.k * ca.fmin(mb.t, 1.0), None, None),
}


@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.PolynomialChaos(order=4)], ids=repr)
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_bounds_stay_within_what_outputs_can_be(method):
    system = mb.System(BALL, mb.Gravity(0, -9.81), mb.Force("floor", BALL.point(0, 0), (0, FLOOR)), parameters=P)
    outputs = {name: y for name, (y, *_) in OUTPUTS.items()}
    scene = mb.Scene(system, {"ball.y": 0.5}, np.linspace(0, 3, 61), outputs, box=mb.Box(k=(90, 110), c=(0.9, 1.1)))
    bounds = mb.propagate(scene, method)
    for i, (_, low, high) in enumerate(OUTPUTS.values()):
        low, high = (90 * np.fmin(bounds.t, 1), 110 * np.fmin(bounds.t, 1)) if low is None else (low, high)
        slack = 1e-12 * np.abs(bounds.upper[:, i])
        assert (bounds.lower[:, i] >= low - slack).all() and (bounds.upper[:, i] <= high + slack).all()
    assert bounds.lower[:, 0].min() == 0.0
