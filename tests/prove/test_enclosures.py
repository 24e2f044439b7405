"""Enclosures of motions: samples lie inside, bounds are close to them, and planted faults are found."""

from fractions import Fraction

import casadi as ca
import mpmath
import numpy as np
import pytest
from enclosure_samples import EXACT, check, exact, ode, solutions
from enclosure_scenes import SCENES, pendulum, van_der_pol
from faults import refused
from numpy.polynomial.chebyshev import chebval
from small_scenes import state

import symmb as mb
from models import double_pendulum, heavy_top
from symmb.prove import chebyshev, defects, enclose, points, problem_of
from symmb.prove import step as steps
from symmb.prove.degrees import degrees_of_equations
from symmb.prove.ellipses import Choice, Control
from symmb.prove.errors import ProofError
from symmb.prove.flow import Curve, integrated
from symmb.prove.front import Front
from symmb.prove.march import Course, Place, march
from symmb.prove.ranges import ranges
from symmb.prove.start import drifted, first_front, mapped
from symmb.prove.time_step import TimeStep, parameter_points
from symmb.run.simulation import DAESimulator

INSIDE = 1e-11
"""Error of samples over the size of an output."""


def _enclosed(scene, order):
    problem = problem_of("method", DAESimulator(scene), scene.box)
    return problem, enclose(problem, order, 1)


@pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)
def test_samples_of_scenes_lie_inside_and_reach_the_bounds(make):
    problem, found = _enclosed(make(), order=4)
    assert not found.why and np.isfinite(found.upper).all()
    result = check(problem, found)
    assert result.outside <= INSIDE and result.filled > 0.6  # corners and few points: extremes may be inside the box
    assert (found.remainder <= 1e-3 * (found.upper - found.lower).max(axis=0)).all()


@pytest.mark.parametrize(
    ("scene", "spread", "order"),
    [(double_pendulum.scene().with_times(np.linspace(0, 0.6, 13)), 0.05, 6),
     (heavy_top.scene().with_times(np.linspace(0, 0.05, 11)), 0.02, 6)],
    ids=["double pendulum", "heavy top"],
)  # fmt: skip
def test_samples_of_shipped_models_lie_inside(scene, spread, order):
    box = mb.Box.around(scene.system.parameters, spread, names=scene.box.names)
    problem, found = _enclosed(scene.with_box(box), order)
    result = check(problem, found)
    assert not found.why and result.outside <= INSIDE and result.filled > 0.6


def _random_ode(seed):
    """Two states, two parameters, random smooth rates."""
    rng = np.random.default_rng(seed)
    c = rng.uniform(-1.0, 1.0, (2, 8))

    def f(x, p, t):
        features = [x[0], x[1], x[0] * x[1], ca.sin(x[0] + p[0]), ca.exp(-(x[1] ** 2)), p[1] * x[0],
                    x[0] / (2 + ca.cos(x[1])), ca.cos(2 * t) * p[0]]  # fmt: skip
        return [sum(a * g for a, g in zip(row, features, strict=True)) for row in c]

    box = [(0.5, 0.5 + rng.uniform(0.01, 0.1)), (1.0, 1.0 + rng.uniform(0.01, 0.1))]
    return ode(f, lambda p: [0.5 * p[0], -0.3 + 0.2 * p[1]], box, np.linspace(0, 0.8, 5))


@pytest.mark.parametrize("seed", range(8))
def test_samples_of_random_equations_lie_inside(seed):
    problem = _random_ode(seed)
    found = enclose(problem, 5, 1)
    assert np.isfinite(found.upper[0]).all() and check(problem, found, seed=seed).outside <= INSIDE


def test_no_uncertain_parameter():
    problem = ode(lambda x, p, t: [x[1], -p[0] * ca.sin(x[0])], lambda p: [1.0, 0.0], [(2.0, 2.0)], [0.0, 0.1, 0.2])
    found, in_50_digits = enclose(problem, 4, 1), exact(problem, problem.middle)
    assert problem.d == 0 and (found.upper - found.lower).max() < 1e-9
    assert (found.lower <= in_50_digits).all() and (in_50_digits <= found.upper).all()
    sampled, own = solutions(problem, problem.middle[None])
    assert (abs(sampled[0] - in_50_digits) <= own[0] + 1e-15).all()


def test_decay_against_the_closed_form_in_40_digits():
    """x' = -k x: the bounds hold exp(-k t) for both ends of k, to the last digit."""
    problem = ode(lambda x, p, t: [-p[0] * x[0]], lambda p: [1.0], [(0.5, 1.5)], np.linspace(0, 3, 7))
    found = enclose(problem, 10, 1)
    with mpmath.workdps(40):
        for t, low, high in zip(problem.times, found.lower[:, 0], found.upper[:, 0], strict=True):
            ends = mpmath.exp(-mpmath.mpf(1.5) * float(t)), mpmath.exp(-mpmath.mpf(0.5) * float(t))
            assert low <= ends[0] and ends[1] <= high
            assert ends[0] - low < 1e-4 and high - ends[1] < 1e-4


def test_friction_that_is_almost_dry():
    """x'' = -k tanh(x' / 0.01): sliding, until the speed vanishes at 0.1 s."""
    problem = ode(lambda x, p, t: [x[1], -p[0] * ca.tanh(x[1] / 0.01)], lambda p: [0.0, 1.0], [(9.8, 10.2)],
                  np.linspace(0, 0.09, 4))  # fmt: skip
    found = enclose(problem, 6, 1)
    assert not found.why and not found.is_loose.any() and check(problem, found).outside <= INSIDE


def test_halves_of_the_box_are_joined_where_they_are_needed():
    box = [(8.0, 12.0), (1.0, 2.0)]
    problem = ode(lambda x, p, t: [x[1], -p[0] * ca.sin(x[0])], lambda p: [p[1], 0.0], box, np.linspace(0, 3, 7))
    one, four = enclose(problem, 3, 1), enclose(problem, 3, 4)
    assert four.boxes > 1 and check(problem, four, count=20).outside <= INSIDE
    finite = np.isfinite(one.upper)
    assert (four.remainder[-1] < one.remainder[-1]).all() or not finite[-1].any()
    problem, found = _enclosed(pendulum(), order=6)  # of a box that needs no halves
    parts = enclose(problem, 6, 8)
    assert parts.boxes == 1
    np.testing.assert_array_equal(parts.upper, found.upper)


def test_a_choice_that_was_good_for_earlier_steps_is_not_the_end():
    """Ellipses of almost no width: an interpolation needs too many nodes, and no other choice nearby needs fewer."""
    problem = problem_of("method", DAESimulator(scene := pendulum()), scene.box)
    course, narrow = Course.empty(problem), Control(Choice((1e-9, 1e-9), (40, 40)), 0.02)
    course.end = Place(first_front(problem, 4), narrow, problem)
    march(problem, 4, course, 0.0, np.inf, lambda t: None)
    assert course.is_done and check(problem, course.bounds).outside <= INSIDE


@pytest.mark.parametrize(
    ("make", "end", "order"), [pytest.param(pendulum, 10.0, 16, marks=pytest.mark.long), (van_der_pol, 20.0, 8)]
)
def test_long_motions_are_proved_with_their_reactions(make, end, order):
    """The oscillator contracts, and its frame comes close to singular; the rod's reaction is a quotient."""
    problem, found = _enclosed(make(spread=0.05, end=end).with_times(np.linspace(0.0, end, 51)), order)
    assert not found.why and check(problem, found).outside <= INSIDE
    assert (found.remainder <= 5e-3 * (found.upper - found.lower).max(axis=0)).all()


def test_a_lost_proof_keeps_the_part_that_is_proved():
    """x' = x^2 leaves every bound at t = 1 / x(0)."""
    problem = ode(lambda x, p, t: [x[0] ** 2], lambda p: [p[0]], [(0.9, 1.1)], np.linspace(0, 1.2, 13))
    found = enclose(problem, 6, 1)
    assert found.why and 0.7 < found.until < 1 / 1.1
    known = problem.times <= found.until
    exact = np.array([[x / (1 - x * t) for x in (0.9, 1.1)] for t in problem.times[known]])
    assert (found.lower[known, 0] <= exact[:, 0]).all() and (exact[:, 1] <= found.upper[known, 0]).all()
    assert np.isinf(found.upper[~known]).all() and np.isinf(found.lower[~known]).all()


def test_an_output_with_a_corner_has_no_bounds_where_it_is_met():
    problem = ode(
        lambda x, p, t: [p[0]], lambda p: [-1.0], [(0.9, 1.1)], [0.0, 0.5, 1.0, 2.0],
        outputs=lambda x, p, t: [ca.fabs(x[0]), x[0]],
    )  # fmt: skip
    found = enclose(problem, 3, 1)
    assert np.isfinite(found.upper[:, 1]).all() and np.isinf(found.upper[2, 0])
    finite = np.isfinite(found.upper[:, 0])
    exact = np.abs(-1.0 + problem.times)[:, None] * np.ones(2)
    assert (found.lower[finite, 0] <= exact[finite, 0]).all() and (exact[finite, 1] <= found.upper[finite, 0]).all()


def _step_of(f, order=2):
    """A step of x' = f(x, p, t) whose motion has the degree `order` in time and in one parameter."""
    problem = ode(f, lambda p: [0.0, 0.0], [(0.5, 1.5), (2.0, 2.0)], [0.0, 1.0])
    rng = np.random.default_rng(0)
    x = integrated(rng.uniform(-1, 1, (2, order + 1)), rng.uniform(-1, 1, (2, order, order + 1)), 1.0)
    return TimeStep(problem, 0.0, 1.0, x, x, np.zeros((2, 2, 1, 1)))


@pytest.mark.parametrize(
    ("f", "expected"),
    [
        (lambda x, p, t: [p[0] * x[0], x[1] ** 3 - t], (6, 6)),
        (lambda x, p, t: [x[0] / p[1] + ca.sin(p[1]), -(t**2) * x[0] * x[1]], (6, 4)),
        (lambda x, p, t: [(x[0] + 2 * p[0]) ** 4 * p[0], x[1]], (8, 9)),
        (lambda x, p, t: [x[0] / x[1], x[1]], (np.inf, np.inf)),
        (lambda x, p, t: [ca.fabs(x[0]), x[1]], (np.inf, np.inf)),
        (lambda x, p, t: [x[0] ** 2.5, x[1] ** -1], (np.inf, np.inf)),
    ],
)
def test_degrees_of_equations(f, expected):
    assert tuple(degrees_of_equations(_step_of(f))[0]) == expected


def test_states_at_a_time_with_terms_of_the_size_of_rounding():
    """Each of 20 sums to a constant of 1.5 rounds, in a bound that is as small as one rounding."""
    c = np.array([[[1.5], *[[1e-16]] * 20]])
    curve = Curve(c, np.zeros(1), np.zeros((1, 20, 1)))
    times = np.array([0.2, 0.9, 0.99, 1.0])
    step = TimeStep(_step_of(lambda x, p, t: [x[0], x[1]]).problem, 0.0, 1.0, curve, curve, c[None])
    values, errors = step.at(times, curve)
    for t, value, error in zip(times, values[0, :, 0], errors[0], strict=True):
        with mpmath.workdps(40):
            exact = sum(mpmath.mpf(a) * mpmath.chebyt(k, 2 * mpmath.mpf(t) - 1) for k, a in enumerate(c[0, :, 0]))
            assert abs(exact - mpmath.mpf(value)) <= error


@pytest.mark.parametrize("shape", [(4,), (7, 3), (6, 1, 4)])
def test_integrals_of_samples(shape):
    """The bounds contain integrals of the polynomial through the samples by NumPy. The mean of a constant is exact."""
    samples = np.random.default_rng(0).normal(size=shape)
    largest, mean = chebyshev.integrals_of_samples(samples, np.zeros(()), len(shape))
    c = chebyshev.along([chebyshev.coefficients_from_nodes(m) for m in shape], samples)
    places = [np.polynomial.chebyshev.chebvander(np.linspace(-1, 1, 21), m - 1) for m in shape[1:]]
    c = chebyshev.along([None, *places], c)
    integrals = 0.5 * np.polynomial.chebyshev.chebint(c.reshape(shape[0], -1), lbnd=-1)
    values = np.polynomial.chebyshev.chebval(np.linspace(-1, 1, 200), integrals)
    assert np.abs(values).max() <= largest and np.abs(values[:, -1]).max() <= mean <= largest * (1 + 1e-6)
    np.testing.assert_allclose(chebyshev.integrals_of_samples(np.full(shape, 3.0), np.zeros(()), len(shape))[1], 3.0)


@pytest.mark.parametrize(("terms", "rho"), [(5, 1.0), (12, 1.3), (20, 2.0), (20, 4.0), (40, 1.5)])
def test_rounding_of_a_curve_is_bounded_on_ellipses(terms, rho):
    """Against exact fractions: coefficients, and values on the ellipse in 40 digits."""
    rng = np.random.default_rng(terms)
    begin, h, d_rho = rng.uniform(-1, 1, (1, 3)), 0.37, 1.7
    rate = rng.uniform(-1, 1, (1, terms, 3))
    curve = integrated(begin, rate, h)
    exact = _integral_in_fractions(begin[0], rate[0], h)
    pairs = zip(curve.c[0], exact, strict=True)
    lost = [[float(Fraction(float(a)) - b) for a, b in zip(*rows, strict=True)] for rows in pairs]
    assert (np.abs(lost) <= curve.rounded[0]).all()
    with mpmath.workdps(40):
        turns = mpmath.unitroots(7)[2:4]
        points_on = [mpmath.mpc(0.5) * (r * w + 1 / (r * w)) for r, w in zip((rho, d_rho), turns, strict=True)]
        T, S = ([mpmath.chebyt(k, z) for k in range(n)] for z, n in zip(points_on, (terms + 1, 3), strict=True))
        off = abs(sum(T[i] * S[j] * lost[i][j] for i in range(terms + 1) for j in range(3)))
    assert off <= curve.error_on([rho, d_rho])[0]
    assert curve.error_on([1.0, 1.0])[0] == pytest.approx(curve.error[0], rel=1e-6)


def _integral_in_fractions(begin, rate, h):
    """Chebyshev coefficients of begin + h / 2 times the integral from -1, from those of the rate."""
    first, *rows = (np.array([Fraction(float(a)) for a in row]) for row in (begin, *rate))
    c = np.full((len(rows) + 1, len(first)), Fraction(0))
    for k, row in enumerate(rows):  # the integral of T_k is (T_(k + 1) / (k + 1) - T_(k - 1) / (k - 1)) / 2
        c[k + 1] += Fraction(h) / 2 * row * (1 if k == 0 else Fraction(1, 2 * (k + 1)))
        if k > 1:
            c[k - 1] -= Fraction(h) / 2 * row * Fraction(1, 2 * (k - 1))
    c[0] = first - sum((-1) ** k * c[k] for k in range(1, len(c)))
    return c


def test_rounding_on_an_ellipse_is_larger_than_on_the_box():
    """The last of 20 coefficients errs by 1e-17: by 5e11 times as much on the ellipse of parameter 4."""
    rounded = np.zeros((1, 21))
    rounded[0, -1] = 1e-17
    curve = Curve(np.zeros((1, 21)), np.array([1e-17]), np.zeros((1, 20)), rounded)
    with mpmath.workdps(30):
        value = 1e-17 * abs(mpmath.chebyt(20, mpmath.mpf(4 + 1 / 4) / 2))
    assert value > 1e11 * curve.error[0] and value <= curve.error_on([4.0])[0] <= 1.001 * float(value)


def test_a_long_fall_from_rest():
    """Speeds reach a hundred kilometres a second, of which the first step, a fiftieth of the time, is a part."""
    problem = ode(lambda x, p, t: [x[1], -p[0]], lambda p: [1.0, 0.0], [(0.9, 1.1)], [0.0, 0.01, 1e5])
    found, half = enclose(problem, 4, 1), 0.5 * problem.times**2
    assert (found.lower[:, 0] <= 1.0 - 1.1 * half).all() and (1.0 - 0.9 * half <= found.upper[:, 0]).all()
    assert found.upper[:, 0] - found.lower[:, 0] == pytest.approx(0.2 * half, rel=1e-9, abs=1e-9)


def test_an_output_that_is_too_large_leaves_others_their_bounds():
    """1.7e8 a is below the largest number, which sums of its values exceed."""
    problem = ode(lambda x, p, t: [0 * x[0]], lambda p: [0.0], [(1.0, 1e300)], [0.0, 1.0],
                  outputs=lambda x, p, t: [1.7e8 * p[0], p[0]])  # fmt: skip
    found = enclose(problem, 3, 1)
    assert np.isinf(found.upper[:, 0]).all() and (found.lower[:, 1] <= 1.0).all()
    assert (found.upper[:, 1] >= 1e300).all() and (found.upper < 1.1e300)[:, 1].all()


def test_a_range_whose_maximum_is_on_a_surface():
    """Cells as fine as a tolerance of 1e-12 would be 1e12: there the search ends, and bounds are wider."""
    x, y, z = np.meshgrid(*[chebyshev.nodes(3)] * 3, indexing="ij")
    c = chebyshev.along([chebyshev.coefficients_from_nodes(3)] * 3, np.stack([-((x - y + z) ** 2), x - y + z]))
    lower, upper = ranges(c, 1e-12)
    assert lower == pytest.approx([-9.0, -3.0], abs=1e-8) and (lower <= [-9.0, -3.0]).all()
    assert upper == pytest.approx([0.0, 3.0], abs=1e-3) and (upper >= [0.0, 3.0]).all()


def test_middles_of_parts_near_zero():
    """Sums of middles and halves round, and later middles are much smaller than these."""
    problem = ode(lambda x, p, t: [p[0]], lambda p: [0.0], [(-0.0017, 0.0019)], [0.0, 1.0])
    middle, radius = (Fraction(float(a[0])) for a in (problem.middle, problem.radius))
    for k in range(40):
        side = 1 if k == 0 or middle < 0 else -1
        problem, radius = problem.over(0, side), radius / 2
        middle += side * radius
        value, error, *_ = parameter_points(problem, (3,), 0)[0]
        assert abs(Fraction(float(value[1])) - middle) <= Fraction(error)


def test_an_output_of_time_from_a_negative_first_time():
    """-0.1 + 1000 rounds by 1e-14."""
    times = np.array([-1000.0, -0.1, -1e-3])
    _, found = _enclosed(state(lambda p, z: p.a + 0 * z, times, 0.0, lambda z: {"t": mb.t}, a=(0.9, 1.1)), order=2)
    assert (found.lower[:, 0] <= times).all() and (times <= found.upper[:, 0]).all()


def test_states_of_a_front_are_mapped_into_the_new_one():
    rng, n, lengths, of_frame = np.random.default_rng(0), 3, 6, 4
    problem = ode(lambda x, p, t: [0 * x[0]] * n, lambda p: [0.0] * n, [(0.9, 1.1)], [0.0, 1.0])
    decay = 0.3 ** np.arange(lengths)
    old = Front(
        0.7, rng.normal(size=(n, lengths)) * decay, rng.normal(size=(n, n, of_frame)) * decay[:of_frame],
        np.array([0.02, 0.01, 0.03]), np.full(n, 1e-3), np.full((n, n), 1e-2),
    )  # fmt: skip
    x, p, t = ca.SX.sym("x", n), ca.SX.sym("p"), ca.SX.sym("t")
    f = ca.Function("f", [x, p, t], [ca.vertcat(x[0], ca.sin(x[0] + p * t) * x[1], x[2] ** 2 + ca.exp(x[1]))])
    new = mapped(problem, old, f)
    allowed, largest = new.x_error + new.B_error @ new.w, 0.0
    for _ in range(2000):
        xi, w = rng.uniform(-1, 1), old.w * rng.choice([-1.0, 1.0], n)
        off = 0.999 * rng.choice([-1.0, 1.0], n) * (old.x_error + old.B_error @ old.w)
        at, there = (chebval(xi, front.x.T) + chebval(xi, np.moveaxis(front.B, 2, 0)) @ w for front in (old, new))
        error = np.abs(f(at + off, 1.0 + 0.1 * xi, 0.7).full().ravel() - there)
        assert (error <= allowed).all()
        largest = np.maximum(largest, error / allowed)
    assert (largest > 0.2).all()  # bounds are not much too wide


def test_a_front_at_a_time_that_is_late():
    """x' = -x: within 1e-12 s states change by as much of their size."""
    problem = ode(lambda x, p, t: [-x[0]], lambda p: [p[0]], [(0.9, 1.1)], [0.0, 1.0])
    still = Front(0.5, np.array([[2.0, 0.1]]), np.ones((1, 1, 1)), np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    assert 2.1e-12 <= drifted(problem, still, 1e-12).x_error[0] < 2.2e-12


# Planted faults


@pytest.mark.parametrize("name", ["OP_SIN", "OP_SQ"])
@pytest.mark.parametrize("share", [0.0, -1.0], ids=["left out", "the wrong way"])
def test_planted_rounding_is_found(monkeypatch, name, share):
    """With wrong bounds of rounding, an exact value is outside of the computed one's error."""
    x, right = np.random.default_rng(0).uniform(-5, 5, 500), points._rounded
    monkeypatch.setattr(points, "_rounded", lambda v, error, relative=points.U: right(v, error, share * relative))
    values, error, *_ = points.OPERATIONS[getattr(ca, name)](points.point(x))
    with mpmath.workdps(40):
        worst = max(abs(EXACT[name](mpmath.mpf(a)) - mpmath.mpf(float(v))) for a, v in zip(x, values, strict=True))
    assert worst > error


PLANTED = {
    "a defect is left out": {(steps, "defect_of_motion"): lambda step, *rest: np.full((3, step.problem.n), 1e-15)},
    "integrals of a defect are left out": {
        (defects.ch, "integrals_of_samples"): lambda samples, errors, variables: np.zeros((2, *errors.shape))
    },
    "the remainder at the output times is left out": {
        (TimeStep, "reach_at"): lambda step, times, w: np.zeros((step.problem.n, len(times)))
    },
    "aliasing is left out, on as many nodes as there are terms": {
        (defects.ch, "aliasing"): lambda rho, counts: 0.0,
        (defects, "node_counts"): lambda rho, ratio: (20, 1),
    },
    "too few nodes for a polynomial": {(defects, "_grid"): lambda degrees, numbers: (20, 1)},
}


@pytest.mark.parametrize("fault", PLANTED)
def test_planted_defects_are_found(monkeypatch, fault):
    """On too few nodes, a defect is almost invisible. That of van der Pol's equation is a polynomial."""
    scene = van_der_pol(spread=0.1, end=1.0) if "polynomial" in fault else pendulum(spread=0.2)
    problem, found = _enclosed(scene, order=2)
    assert check(problem, found).outside <= INSIDE and not (found.why and "polynomial" in fault)
    for (module, name), wrong in PLANTED[fault].items():
        monkeypatch.setattr(module, name, wrong)
    assert check(problem, enclose(problem, 2, 1)).outside > 100 * INSIDE


def _stiff_step():
    """x' = 3 x over 1 s with a frame that stands still: w grows from 1 to e^3."""
    problem = ode(lambda x, p, t: [3.0 * x[0]], lambda p: [0.0], [(1.0, 1.0)], [0.0, 1.0])
    zero, one = integrated(np.zeros(1), np.zeros((1, 2)), 1.0), integrated(np.ones(1), np.zeros((1, 2)), 1.0)
    return TimeStep(problem, 0.0, 1.0, zero, one, np.array([[[1.0, 0.0]]]))


def test_a_box_that_w_leaves_is_not_proved(monkeypatch):
    refused("grow too fast", steps.prove, _stiff_step(), np.array([1.0]), Control(Choice(), 1.0), error=ProofError)

    monkeypatch.setattr(steps, "stays", lambda end, W: True)  # without the test of the contraction
    assert steps.prove(_stiff_step(), np.array([1.0]), Control(Choice(), 1.0)).end[0] < np.exp(3.0)


@pytest.mark.filterwarnings("ignore:.*share their load:symmb.SymmbWarning")
def test_shared_reactions_of_bars_of_uncertain_length_are_enclosed():
    """The unit in which forces and moments compare depends on the length."""
    p, ground = mb.Parameters(L=0.5), mb.Ground()
    rod = mb.Body("rod", 1.0, (0.01, 0.1, 0.1), mb.Spatial())
    heights = (("low", -0.2), ("high", 0.3))
    hinges = [mb.Revolute(name, ground.point(0, 0, z), rod.point(-p.L, 0, z), axis=(0, 0, 1)) for name, z in heights]
    system = mb.System(rod, *hinges, mb.Gravity(0, -9.81, 0), parameters=p)
    times, outputs, box = np.linspace(0, 0.3, 4), {"low": system.lam("low")[1]}, mb.Box(L=(0.499, 0.501))
    scene = mb.Scene(system, times=times, outputs=outputs, guess={"rod.x": 0.5}, box=box)
    bounds = mb.propagate(scene, mb.TaylorModel(order=4))
    P = np.random.default_rng(0).uniform(0.499, 0.501, (100, 1))
    Y = mb.DAESimulator(scene, mb.DormandPrince(rtol=1e-11)).run(P).Y
    assert (bounds.lower - 1e-8 < Y).all() and (bounds.upper + 1e-8 > Y).all()
    assert (bounds.upper - bounds.lower).max() < 2 * np.ptp(Y, axis=0).max()
