"""Proofs with many uncertain numbers, with clocks, and of stiff equations: samples lie inside, faults are found."""

import pickle
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from enclosure_samples import check, ode, parameters, solutions
from machines import rods
from planar_lagrangian import random_mechanism
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk
from verified_problems import laub_loomis, quadrotor, random_oscillator, random_system, robertson, van_der_pols

import symmb as mb
from symmb.prove import clock, enclose, front, march, outputs, problem_of, several_parameters, terms
from symmb.prove.basis import basis_of, terms_of
from symmb.prove.clock import bounds_by_clock
from symmb.prove.flow import Curve
from symmb.prove.orders import MOST_TERMS, with_orders
from symmb.prove.pass_outputs import half_step
from symmb.prove.time_step import TimeStep
from symmb.run.simulation import DAESimulator

INSIDE = 1e-11
"""Error of samples over the size of an output."""


@pytest.mark.parametrize("seed", [1, 3, 9, 10, 11])
def test_samples_of_random_systems_lie_inside(seed):
    """Three to twelve uncertain numbers, with weights and without."""
    problem = random_system(seed)
    found = enclose(problem, 8 if seed % 3 else 3, 1)
    assert not found.why and np.isfinite(found.upper).all()
    result = check(problem, found, 60, seed)
    assert result.outside <= INSIDE and result.filled > 0.2


def _enclosed(scene, order, count):
    """Bounds, and what samples say of them."""
    problem = problem_of("method", DAESimulator(scene), scene.box)
    found = enclose(problem, order, 1)
    return found, check(problem, found, count)


@pytest.mark.parametrize(("make", "end"), [(laub_loomis, 4.0), (quadrotor, 0.5)])
def test_sets_of_the_competition(make, end):
    found, result = _enclosed(make(0.05, end), 8, 200)
    assert not found.why and result.outside <= INSIDE and result.filled > 0.6


@pytest.mark.parametrize(
    "plant",
    [
        lambda patch: patch.setattr(terms.Matrix, "bounds", lambda a: 0.0 * np.abs(a.c[:1, 0]).repeat(3, axis=0)),
        lambda patch: patch.setattr(TimeStep, "after", lambda step, w, rate: 1e-3 * w),
    ],
    ids=["defects", "rates"],
)
def test_planted_faults_are_found(plant, monkeypatch):
    """With polynomials of the first order, the remainder is large, so that samples leave bounds without it."""
    scene = laub_loomis(0.1, 3.0)
    assert _enclosed(scene, 1, 40)[1].outside <= INSIDE
    plant(monkeypatch)
    assert _enclosed(scene, 1, 40)[1].outside > 1e-6


def test_earlier_errors_are_kept_or_bounded():
    """States of a front, at random w, are states of the front with a new frame, up to the bound of its last columns."""
    rng, n, columns = np.random.default_rng(0), 3, 3 + 3 * front._MOST_GENERATORS
    problem = replace(ode(lambda x, p, t: [-x[0], x[1], p[0] * p[1] * p[2] * x[2]], lambda p: [1.0, 1.0, 1.0],
                          [(0, 1)] * 3, [0.0, 1.0]), weights=(1, 1, 1))  # fmt: skip
    B = rng.normal(size=(n, columns, *problem.lengths(1)))
    B[:, -1] = B[:, -2] * (1 + 1e-6)  # nearly dependent, so that a new frame is made
    w = 10.0 ** rng.uniform(-6, -3, columns)
    old = front.Front(0.0, rng.normal(size=(n, *problem.lengths(2))), B, w, np.full(n, 1e-9), np.zeros(B.shape[:2]))
    new = front.well_conditioned(problem, old)
    assert new.B.shape == B.shape and (new.reach >= 0.99 * old.reach).all() and (new.reach <= 3 * old.reach).all()
    kept = [k for k in range(columns) if any((new.B[:, j] == B[:, k]).all() for j in range(columns - n))]
    others = np.setdiff1d(np.arange(columns), kept)
    assert len(others) == n
    inverse = np.linalg.inv(new.B[:, -n:, 0])
    xi = rng.uniform(-1, 1, (200, 3))
    values = np.column_stack([np.ones(200), xi[:, ::-1]])  # products of the first degree, in the order of the basis
    assert (problem.basis(4).exponents[1:] == np.eye(3)[::-1]).all()
    at = np.einsum("nkt,st->snk", B[:, others], values)
    off = np.abs(np.einsum("ij,sjk->sik", inverse, at)) @ w[others]
    assert (off.max(axis=0) <= new.w[-n:]).all() and (off.max(axis=0) >= 0.2 * new.w[-n:]).all()


@pytest.mark.parametrize(("beta", "gamma"), [(1e2, 1e3), (1e3, 1e7)])
def test_stiff_reactions(beta, gamma):
    """The bounds contain the solution by Radau, and the sum of the states, which is 1."""
    bounds = mb.propagate(robertson(beta, gamma), mb.TaylorModel())

    def rates(t, x):
        slow, back, fast = 0.4 * x[0], beta * x[1] * x[2], gamma * x[1] ** 2
        return [back - slow, slow - back - fast, fast]

    x = solve_ivp(rates, (0, 40), [1.0, 0.0, 0.0], method="Radau", rtol=1e-13, atol=1e-20).y[0, -1]
    (low, high), (least, most) = (np.array(bounds[name])[:, -1] for name in ("x", "sum"))
    assert low < x < high and high - low < 1e-9
    assert least < 1.0 < most and most - least < 1e-9


@pytest.mark.parametrize("decay", [0.0, -1e-9, -0.3, -40.0, -1e6])
def test_rates_of_decay(decay):
    """The bound at the end of a step is the solution of w' = L w + r, or slightly larger."""
    none = Curve(np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)))
    problem = ode(lambda x, p, t: [-x[0]], lambda p: [1.0], [], [1.0])
    step = TimeStep(problem, 0.0, 0.7, none, none, np.zeros((1, 1)), np.array([decay]))
    found = step.after(np.array([2.0]), np.array([3.0]))[0]
    exact = 2.0 * np.exp(0.7 * decay) + (3.0 * np.expm1(0.7 * decay) / decay if decay else 3.0 * 0.7)
    assert exact <= found <= exact * (1 + 1e-3)


def test_stiff_equations_with_an_uncertain_number():
    """A fast state follows a line of time. Its equation is linear and has an exact solution."""
    rates = lambda x, p, t: [-1e4 * (x[0] - np.cos(1.0) * p[0] * (1 + t)), -x[1]]  # noqa: E731
    times = np.linspace(0, 5, 6)
    problem = ode(rates, lambda p: [0.0, p[0]], [(0.9, 1.1)], times)
    found = enclose(problem, 3, 1)
    # x = a (1 + t - 1e-4) - a (1 - 1e-4) exp(-1e4 t) with a = cos(1) p
    each = np.cos(1.0) * np.array([[0.9], [1.1]]) * (1 + times - 1e-4 - (1 - 1e-4) * np.exp(-1e4 * times))
    lower, upper = found.lower[:, 0], found.upper[:, 0]
    assert not found.why
    assert (lower <= each.min(axis=0) + 1e-12).all() and (upper >= each.max(axis=0) - 1e-12).all()
    np.testing.assert_allclose(upper - lower, np.ptp(each, axis=0), rtol=1e-6, atol=1e-9)


def test_orders_of_nearly_linear_numbers_are_lower():
    """A number with a strong effect has a higher order than eight numbers with effects that are nearly linear."""
    d = 9
    rates = lambda x, p, t: [p[0] ** 2 * x[0] - x[0] ** 3 + sum(p[k] for k in range(1, d)), -x[1]]  # noqa: E731
    box = [(0.6, 1.4), *[(-1e-3, 1e-3)] * (d - 1)]
    problem, order = with_orders(ode(rates, lambda p: [0.5, 1.0], box, [0.0, 2.0]), 8)
    assert problem.weights[0] == 1 and min(problem.weights[1:]) >= 2 and order >= 6
    assert terms_of(problem.weights, order) == len(basis_of(problem.weights, order).exponents) <= MOST_TERMS


def test_remarks_tell_the_orders():
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        bounds = mb.propagate(quadrotor(0.01, 0.1), mb.TaylorModel(order=12))
        few = mb.propagate(quadrotor(0.01, 0.1), mb.TaylorModel(order=2))
    assert any("Their highest orders are: c1 2, c2 2" in remark for remark in bounds.remarks)
    assert not any("highest orders" in remark for remark in few.remarks)


def _division(method, executor=None):
    """Bounds of two coupled oscillators over a wide box, and the progress that they report."""
    told, scene = [], van_der_pols(2.0)
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        return mb.propagate(scene, method, executor=executor, progress=lambda *done: told.append(done)), told


def test_a_box_divides_by_itself_and_an_executor_gives_the_same_bounds():
    """One box needs many short steps, and its bounds are wider than those of the parts."""
    whole, _ = _division(mb.TaylorModel(order=3, boxes=1))
    parts, told = _division(mb.TaylorModel(order=3, boxes=4))
    assert whole.evaluations == 1 < parts.evaluations <= 4 and told[-1] == (1000, 1000)
    assert ((parts.upper - parts.lower)[-1] < 0.95 * (whole.upper - whole.lower)[-1]).all()
    runs = mb.propagate(van_der_pols(2.0), mb.MonteCarlo(300), solver=mb.DormandPrince(rtol=1e-11))
    assert (parts.lower <= runs.lower + 1e-9).all() and (parts.upper >= runs.upper - 1e-9).all()
    with ProcessPoolExecutor(2) as pool:
        pooled, told = _division(mb.TaylorModel(order=3, boxes=4), pool)
    assert (parts.lower == pooled.lower).all() and (parts.upper == pooled.upper).all()
    assert pooled.evaluations == parts.evaluations and told[-1] == (1000, 1000)


@pytest.mark.parametrize("seed", [5, 6])
def test_random_mechanisms_against_lagrange_s_equations(seed):
    """A loop and a rod with three to twelve uncertain numbers. The equations of the samples come from NumPy alone."""
    scene, motion_of = random_mechanism(seed)
    problem = problem_of("method", DAESimulator(scene), scene.box)
    P = parameters(problem, 4, seed)
    (Y, _), (own, _) = solutions(problem, P), solutions(problem, P, motion_of)
    np.testing.assert_allclose(Y, own, rtol=0, atol=1e-11)
    assert len(pickle.dumps(problem)) > 0  # parts of the box are sent to processes
    found = enclose(problem, 2, 1)
    result = check(problem, found, 100, seed, motion_of)
    assert not found.why and result.outside <= INSIDE and result.filled > 0.2


# Clocks: each set of parameters has its own


def has_clock(problem, order=4):
    return clock.with_clock(with_orders(problem, order)[0]).clock is not None


def phasor(spread, end=20.0, count=41):
    """x = cos(w t), y = sin(w t) and z = w t with w = a + b + c."""

    def rates(x, p, t):
        w = p[0] + p[1] + p[2]
        return [-w * x[1], w * x[0], w]

    box = [(v - spread, v + spread) for v in (0.2, 0.3, 0.5)]
    return ode(rates, lambda p: [1.0, 0.0, 0.0], box, np.linspace(0.0, end, count))


def test_a_turning_phasor():
    """The parameters only delay it. Its range is that of a cosine, up to half a turn."""
    problem = phasor(0.015)
    assert has_clock(problem) and not has_clock(phasor(1e-4))
    found, t = enclose(problem, 4, 1), problem.times
    low, high = 0.955 * t, 1.045 * t
    phase = np.linspace(low, high, 4001)
    least, most = np.cos(phase).min(axis=0), np.cos(phase).max(axis=0)
    assert not found.why and found.boxes == 1
    assert (found.lower[:, 0] <= least + 1e-12).all() and (found.upper[:, 0] >= most - 1e-12).all()
    np.testing.assert_allclose(found.upper[:, 0] - found.lower[:, 0], most - least, atol=1e-3)


def test_a_swinging_rod():
    """A scene against Jacobi's elliptic functions, over seven periods."""
    machine, times = rods(1, angle=1.0), np.linspace(0.0, 12.0, 25)
    box = mb.Box(length=(0.99, 1.01), g=(9.8, 9.82), angle=(0.99, 1.01))
    scene = machine.scene({"theta": machine.body.theta}, times, {"rod0.theta": machine.p.angle}, box=box)
    bounds = mb.propagate(scene, mb.TaylorModel(5))
    length, g, angle = (a[..., None] for a in np.meshgrid(*(np.linspace(*own, 9) for own in box.bounds), indexing="ij"))
    m = np.sin(angle / 2) ** 2
    sn = ellipj(ellipk(m) - np.sqrt(1.5 * g / length) * times, m)[0]
    theta = (2 * np.arcsin(np.sqrt(m) * sn)).reshape(-1, len(times))
    width = np.ptp(theta, axis=0)
    assert (bounds.lower[:, 0] <= theta.min(axis=0) + 1e-11).all()
    assert (bounds.upper[:, 0] >= theta.max(axis=0) - 1e-11).all()
    assert ((bounds.upper - bounds.lower)[:, 0] <= 1.02 * width + 1e-4).all()


@pytest.mark.parametrize("seed", [12, 20, 24])
def test_samples_of_random_oscillators_lie_inside(seed):
    problem = random_oscillator(seed, wide=True)
    assert has_clock(problem)
    found = enclose(problem, 4, 1)
    result = check(problem, found, 100, seed)
    assert not found.why and result.outside <= INSIDE and result.filled > 0.8


def _later(patch):
    """Places in a step are taken for those of 1 % later times."""
    right = several_parameters.places_in_step
    for module in (clock, outputs):
        patch.setattr(module, "places_in_step", lambda step, times, basis: right(step, 1.01 * times, basis))


@pytest.mark.parametrize(
    "plant",
    [
        _later,
        lambda patch: patch.setattr(clock, "half_step", lambda step, variable, side: half_step(step, variable, 1)),
        lambda patch: patch.setattr(march, "bounds_by_clock", lambda steps, *own: bounds_by_clock(steps[-1:], *own)),
    ],
    ids=["places", "halves", "steps"],
)
def test_planted_faults_of_clocks_are_found(plant, monkeypatch):
    """The parameters are in several steps at the last time, since their clocks differ by more than a step."""
    plant(monkeypatch)
    problem = phasor(0.01, 60.0, 41)
    assert check(problem, enclose(problem, 3, 1), 200).outside > 1e-6
