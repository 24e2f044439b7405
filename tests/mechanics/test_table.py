"""Tables against SciPy's interpolants, outside their points, in every derivative and in compiled lanes."""

import pickle
import time
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import symmb as mb
from symmb.run.codegen import Engine, Lanes, StepTolerances, model_function

RNG = np.random.default_rng(11)
CURVES = {
    "two points": ([0.0, 2.0], [1.0, -3.0]),
    "three points": ([0.0, 0.5, 2.0], [1.0, 1.0, 4.0]),
    "a peak": ([0.0, 1e-3, 4e-3, 9e-3], [0.0, 300e6, 120e6, 0.0]),
    "a step": ([-1.0, 0.0, 1e-6, 1.0], [0.0, 0.0, 1.0, 1.0]),
    "ups and downs": (np.cumsum(RNG.uniform(0.01, 1, 30)), RNG.normal(size=30)),
    "turning at the ends": ([0.0, 1.0, 1.1, 3.0, 3.1], [0.0, 1.0, -2.0, -2.1, 5.0]),
}
X = ca.SX.sym("x")


@pytest.mark.parametrize("curve", CURVES)
def test_a_table_is_scipy_s_monotone_interpolant_and_keeps_beyond_its_points_to_its_ends(curve):
    x, y = (np.array(values) for values in CURVES[curve])
    at = np.sort(np.concatenate([x, RNG.uniform(x[0], x[-1], 300)]))
    expression, pchip = mb.Table(x, y)(X), PchipInterpolator(x, y)
    f = ca.Function("f", [X], [expression, ca.jacobian(expression, X)])
    for order in range(4):
        values = ca.Function("f", [X], [expression])(at[None]).full()[0]
        known = pchip.derivative(order)(at) if order else pchip(at)
        where = ~np.isin(at, x) | (order == 0)  # second derivatives jump at the points
        assert_allclose(values[where], known[where], rtol=1e-9, atol=1e-11 * max(1.0, np.abs(known).max()))
        expression = ca.jacobian(expression, X)
    values, slopes = (a.full()[0] for a in f(np.array([[x[0] - 1e9, x[0] - 1e-3, x[-1] + 1e-3, x[-1] + 1e9]])))
    assert_array_equal(values, [y[0], y[0], y[-1], y[-1]])
    assert_array_equal(slopes, 0)
    fine = f(np.linspace(x[0], x[-1], 4001)[None])[0].full()[0]
    assert fine.min() >= y.min() - 1e-12 * np.ptp(y) and fine.max() <= y.max() + 1e-12 * np.ptp(y)
    assert_allclose(f(x[None])[0].full()[0], y, rtol=1e-14, atol=1e-14 * np.ptp(y))


def test_lanes_read_a_table_each_at_its_own_place():
    x, y = CURVES["ups and downs"]
    table, p, t = mb.Table(x, y), ca.SX.sym("p"), ca.SX.sym("t")
    outputs = ca.vertcat(table(X), ca.jacobian(table(X), X), table(t))
    f = model_function(X, p, t, ca.SX(0.0), outputs, None)
    engine = Engine(Lanes(f, StepTolerances(1e-8, 1e-8)), np.array([2.5]))
    at = np.linspace(x[0] - 1, x[-1] + 1, 101)
    Y, _ = engine.values(at[:, None], np.ones((101, 1)))
    expected = ca.Function("f", [X, t], [outputs])(at[None], 2.5).full().T
    assert_allclose(Y[:, 0], expected, rtol=1e-12, atol=1e-12)


def block(points, argument):
    """A block that a table of its position, speed or of time pushes, and the same force as a function."""
    x = np.linspace(-2.5, 2.5, points) + np.where(np.arange(points) % 2, 0.7, 0) / points
    y = np.sin(1.7 * x) + 0.3 * np.cos(4.1 * x)
    p, body = mb.Parameters(k=3.1), mb.Body("block", mass=1.0, pose=mb.Particle())
    push = mb.Force("push", body.point(0, 0), (mb.Table(x, y)(argument(body, p)) - p.k * body.x, 0))
    start, times, outputs = {"block.x": 0.9, "block.vx": -0.35}, np.linspace(0, 2, 9), {"x": body.x, "v": body.vx}
    scene = mb.Scene(mb.System(body, push, parameters=p), start, times, outputs, mb.Box.around(p, 0.02))
    return scene, PchipInterpolator(x, y)


ARGUMENTS = {
    "time": (lambda b, p: mb.t - 0.8, lambda z, t: t - 0.8),
    "position": (lambda b, p: 2 * b.x, lambda z, t: 2 * z[0]),
    "speed": (lambda b, p: b.vx, lambda z, t: z[1]),
    "period": (lambda b, p: 4 * ca.fmod(mb.t, 0.45) - 1, lambda z, t: 4 * np.fmod(t, 0.45) - 1),
    "parameter": (lambda b, p: p.k / 2, lambda z, t: 1.55),
}


@pytest.mark.parametrize("points", [*(pytest.param(n, marks=pytest.mark.long) for n in (10, 100_000)), 1_000])
@pytest.mark.parametrize("argument", ARGUMENTS)
def test_runs_are_driven_by_tables_of_any_size(argument, points):
    of, known = ARGUMENTS[argument]
    scene, pchip = block(points, of)
    end = [scene.times[0], scene.times[-1]]
    ends = np.union1d(end, np.arange(0.45, 2, 0.45)) if argument == "period" else end
    z, reference = [0.9, -0.35], []
    for a, b in pairwise(ends):  # periods one by one

        def rates(t, z, a=a, b=b):
            at = known(z, np.clip(t, a, np.nextafter(b, a)))
            return [z[1], pchip(np.clip(at, pchip.x[0], pchip.x[-1])) - 3.1 * z[0]]

        own = scene.times[(scene.times >= a) & (scene.times < b)]
        part = solve_ivp(rates, (a, b), z, "DOP853", [*own, b], rtol=1e-9, atol=1e-11, max_step=0.005)
        reference, z = [*reference, *part.y.T[:-1]], part.y[:, -1]
    reference = np.array([*reference, z])
    solvers = [mb.DormandPrince(), mb.CVODES(stiff=True), mb.Rosenbrock(), mb.RungeKutta()]
    of_time = argument in ("time", "period")
    for solver in solvers[: 1 if points == 100_000 else 3 if of_time else 4]:  # fixed steps doubt what they pass over
        run = mb.simulate(scene, solver)
        allowed = 1e-4 if isinstance(solver, mb.RungeKutta) else 2e-6
        assert_allclose(run["x"], reference[:, 0], rtol=0, atol=allowed)
        assert_allclose(run["v"], reference[:, 1], rtol=0, atol=10 * allowed)


def test_a_value_costs_the_same_for_any_number_of_points():
    x = np.linspace(0, 1, 100_000)
    f, g = (ca.Function("f", [X], [ca.jacobian(mb.Table(x[::step], x[::step] ** 2)(X), X)]) for step in (11_111, 1))
    assert f.n_instructions() == g.n_instructions() < 60
    assert float(g(0.437)) == pytest.approx(0.874, abs=1e-9)


def test_a_large_table_is_ready_as_soon_as_a_small_one():
    """But for a second, beside the compiler, whose sources differ in names and sizes alone."""
    seconds = []
    for points in (10, 100_000):
        begin = time.process_time()
        scene, _ = block(points, lambda b, p: b.x)
        mb.simulate(scene, mb.DormandPrince())
        seconds.append(time.process_time() - begin)
    assert seconds[1] < seconds[0] + 2.0


def test_taylor_proofs_and_copies_read_tables():
    scene, _ = block(12, lambda b, p: p.k / 2)
    copy = pickle.loads(pickle.dumps(scene))
    assert_allclose(mb.simulate(copy)["x"], mb.simulate(scene)["x"], rtol=0, atol=1e-9)
    proved, sampled = mb.propagate(scene, mb.TaylorModel()), mb.propagate(scene, mb.Scanning(5))
    assert (proved["x"][0] < sampled["x"][0] + 1e-8).all() and (proved["x"][1] > sampled["x"][1] - 1e-8).all()
    assert np.ptp([proved["x"][0], proved["x"][1]], axis=0).max() < 1.1 * np.ptp(sampled["x"], axis=0).max() + 1e-8


TABLE = mb.Table([0, 1], [0, 1])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([0.0, 1.0, 1.0], [1, 2, 3]), r"Table: x must increase, but x\[2\] = 1 follows 1"),
        (([0.0, 1.0], [1, 2, 3]), r"x has the shape \(2,\) and y has \(3,\)\. Pass two lists of equal length"),
        (([0.0], [1.0]), "at least 2"),
        (([0.0, np.nan], [1.0, 2.0]), "Table: x and y must be finite"),
        (([0.0, "one"], [1.0, 2.0]), "Table: x and y must be lists of numbers"),
        ((np.arange(2e6), np.zeros(2_000_000)), "Table: 2000000 points are too many. Pass at most 1000000"),
        (([0.0, 1.0], [1.0, X]), "must be numbers. Multiply the table by"),
        (("x",), "Table: expected a number or a CasADi SX expression, got 'x'"),
        *(((place,), r"Table: .* is not finite") for place in (np.nan, -np.inf, [0.3, np.nan])),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_points_that_make_no_curve_and_places_that_are_no_expression_are_refused(arguments, text):
    refused(text, mb.Table if len(arguments) == 2 else TABLE, *arguments)
