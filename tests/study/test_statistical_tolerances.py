"""Rejects, root sums of squares and tolerances with a yield, against closed forms, quadrature and plain Monte Carlo."""

import casadi as ca
import numpy as np
import pytest
import scipy.stats as st
from black_boxes import black_box, black_box_bounds, reloaded
from faults import refused
from numpy.testing import assert_allclose
from scipy.integrate import quad

import symmb as mb

NOMINAL = {"bore": 40.0, "spacer": 25.0, "ring": 2.0, "shoulder": 10.0}
TOLERANCE = np.array([0.10, 0.05, 0.03, 0.05])
"""The stack of metricmech.com/articles/tolerance-stackup-worked-example.html in mm."""


SUM = lambda a, b: [[a + b]]  # noqa: E731
PAIR = {"a": (0.9, 1.1), "b": (1.95, 2.05)}


def gap() -> mb.FunctionSimulator:
    f = lambda bore, spacer, ring, shoulder: [[bore - spacer - ring - shoulder]]  # noqa: E731
    return mb.FunctionSimulator(f, NOMINAL, [0.0], ["gap"])


def box_of(factor: float = 1.0) -> mb.Box:
    return mb.Box(**{n: (p - factor * h, p + factor * h) for (n, p), h in zip(NOMINAL.items(), TOLERANCE, strict=True)})


def sum_of_two(a: float, b: float, limit: float) -> float:
    """P(|X + Y| > limit) of normal numbers that are cut at three standard deviations a / 3 and b / 3."""
    x, y = (st.truncnorm(-3, 3, 0, h / 3) for h in (a, b))
    return 1 - quad(lambda v: x.pdf(v) * (y.cdf(limit - v) - y.cdf(-limit - v)), -a, a, epsabs=1e-10, limit=200)[0]


def test_a_textbook_stack():
    """The worked example has a gap of 3.00 mm, a worst case of ±0.23 mm, and ±0.126 mm by root sum squares."""
    found = mb.propagate(gap(), mb.PolynomialChaos(), box_of()).statistical({"gap": (2.874, 3.126)})
    assert found.mean == pytest.approx(3.0, abs=1e-4) and found.worst == pytest.approx(0.23)
    assert found.rss == pytest.approx(np.sqrt(np.square(TOLERANCE).sum())) and f"{found.rss[0]:.3f}" == "0.126"
    sigma = found.rss / 3 * st.truncnorm(-3, 3).std()
    assert found.sigma == pytest.approx(sigma, rel=3e-3)
    assert found.cp == pytest.approx(0.126 / (3 * sigma), rel=3e-3)
    assert found.any_law == pytest.approx((sigma / 0.126) ** 2, rel=1e-2)  # Chebyshev


@pytest.mark.parametrize("allowed", [0.11, 0.13, 0.2])
def test_normal_distributions_that_are_not_cut(allowed):
    laws = {n: st.norm(p, h / 3) for (n, p), h in zip(NOMINAL.items(), TOLERANCE, strict=True)}
    bounds = mb.propagate(gap(), mb.PolynomialChaos(), box_of(2))
    found = bounds.statistical({"gap": (3 - allowed, 3 + allowed)}, laws, runs=2000)
    exact = 2 * st.norm.sf(allowed / (np.linalg.norm(TOLERANCE) / 3))
    assert found.total[0] == pytest.approx(exact, abs=found.total[1]) and found.total[1] < 0.15 * exact


@pytest.mark.parametrize("share", [0.6, 0.72, 0.85])
def test_rejects_of_two_lengths_by_quadrature(share):
    exact = sum_of_two(0.1, 0.05, 0.15 * share)
    limits = {"y": (3 - 0.15 * share, 3 + 0.15 * share)}
    p, error = black_box_bounds(SUM, **PAIR).statistical(limits, runs=2000).total
    assert p == pytest.approx(exact, abs=error) and error < 0.15 * exact


def test_a_violation_of_any_limit_is_one_reject():
    """Two limits of y and of 2 y reject the same mechanisms; those of y and z, which is independent, are added."""
    bounds = black_box_bounds(lambda a, b: [[a, 2 * a, b]], outputs="y double z", a=(0.9, 1.1), b=(0.9, 1.1))
    one = st.truncnorm(-3, 3).sf(1.8)
    same = bounds.statistical({"y": (None, 1.06), "double": (None, 2.12)})
    assert same.rejects == pytest.approx([one, one], rel=0.1) and same.total[0] == pytest.approx(one, rel=0.1)
    both = bounds.statistical({"y": (None, 1.06), "z": (None, 1.06)})
    assert both.total[0] == pytest.approx(1 - (1 - one) ** 2, abs=both.total[1])
    assert np.isnan(both.cp).all() and both.cpk == pytest.approx(0.6 / st.truncnorm(-3, 3).std(), rel=5e-3)


@pytest.mark.parametrize("yield_", [0.9, 0.9973, 0.99999])
def test_largest_tolerances_with_a_yield(yield_):
    chain, box = black_box(SUM, **PAIR)
    found = mb.tolerances(chain, {"y": (2.9, 3.1)}, box, yield_=yield_)
    exact = sum_of_two(0.1 * found.factor, 0.05 * found.factor, 0.1)
    assert 0.8 * (1 - yield_) < exact < 1 - yield_
    assert found.worst_case["a"] == pytest.approx(2 / 3, rel=3e-3) and found.factor > found.worst_case["a"]
    assert found.check.kept is False and "yield of at least" in str(found)


@pytest.mark.parametrize("end", ["npz", "json"])
def test_statistics_are_saved(tmp_path, end):
    chain, box = black_box(lambda a, b: [[a + b, a]], outputs="y a", **PAIR)
    found = mb.tolerances(chain, {"y": (2.9, 3.1), "a": (None, 1.5)}, box, yield_=0.9)
    again = reloaded(found, tmp_path / f"own.{end}").statistics
    assert str(again) == str(found.statistics) and again.yield_ == found.statistics.yield_


def test_cheapest_tolerances_with_a_yield():
    """The sum of 1 / s_i with a given sum of (s_i h_i)^2 is least for s_i proportional to h_i^(-2/3)."""
    found = mb.tolerances(gap(), {"gap": (2.874, 3.126)}, box_of(), costs={}, yield_=0.9973)
    factors = np.array([*found.factors.values()])
    best = TOLERANCE ** (-2 / 3)
    assert factors == pytest.approx(best * factors[0] / best[0], rel=0.02)
    assert sum(found.statistics.total) <= 0.0027


def test_own_distributions_are_stretched():
    chain, box = black_box(SUM, a=(0.9, 1.1), b=(1.9, 2.1))
    laws = {"a": st.uniform(0.9, 0.2), "b": st.uniform(1.9, 0.2)}
    found = mb.tolerances(chain, {"y": (2.7, 3.3)}, box, yield_=0.99, laws=laws)
    # P(|X + Y| > w) of two uniform numbers in [-h, h] is (1 - w / (2 h))^2.
    assert (1 - 0.3 / (0.2 * found.factor)) ** 2 == pytest.approx(0.01, rel=0.2)
    assert "factor=" in found.statistics.laws


def test_a_slider_crank_against_monte_carlo():
    turn = np.linspace(0, 2 * np.pi, 37)

    def error(crank, rod, offset):
        x = crank * np.cos(turn) + np.sqrt(rod**2 - (crank * np.sin(turn) - offset) ** 2)
        return x - (0.05 * np.cos(turn) + np.sqrt(0.15**2 - (0.05 * np.sin(turn) - 0.01) ** 2))

    middle = np.array([0.05, 0.15, 0.01])
    nominal = dict(zip(("crank", "rod", "offset"), middle, strict=True))
    mechanism = mb.FunctionSimulator(error, nominal, turn, ["error"])
    bounds = mb.propagate(mechanism, mb.PolynomialChaos(), mb.Box.plus_minus(nominal, **dict.fromkeys(nominal, 1e-4)))
    p, reported = bounds.statistical({"error": (-1.2e-4, 1.2e-4)}).total
    P = middle + 1e-4 * st.truncnorm.rvs(-3, 3, size=(100_000, 3), random_state=0) / 3
    wrong = sum((np.abs(error(*own.T[:, :, None])).max(axis=1) > 1.2e-4).sum() for own in np.split(P, 10))
    rejects = wrong / len(P)
    assert p == pytest.approx(rejects, abs=reported + 4 * np.sqrt(rejects / len(P)))


def test_a_stop_makes_cpk_useless_but_not_the_rejects():
    """The output is 0.1 a, and 2 higher behind the stop; Cpk would mean a fifth of the mechanisms."""
    bounds = black_box_bounds(lambda a, b: [[np.where(a + b > 3.02, 1.0, -1.0) + 0.1 * a]], a=(0.9, 1.1), b=(1.9, 2.1))
    found = bounds.statistical({"y": (None, 0.5)})
    x = st.truncnorm(-3, 3, 0, 0.1 / 3)
    exact = quad(lambda v: x.pdf(v) * x.sf(0.02 - v), -0.1, 0.1)[0]
    assert found.total[0] == pytest.approx(exact, abs=found.total[1])
    assert st.norm.sf(3 * found.cpk[0]) < 0.8 * exact


@pytest.mark.parametrize(
    ("f", "quantile"),
    [
        (lambda x: x, 0.99), (lambda x: x, 0.05), (np.exp, 0.95), (lambda x: 1 / (3 + x), 0.01), (np.sin, 0.9),
        (lambda x: (2 + x) ** 3, 0.5),
    ],
    ids=["99 %", "5 %", "exponential", "reciprocal", "sine", "cubic"],
)  # fmt: skip
def test_uncertain_mean_and_deviation_against_a_double_loop(f, quantile):
    """A monotonic function of a normal number with mean and standard deviation in intervals: a p-box."""
    law = lambda mean, sigma, z: f(mean + sigma * z)  # noqa: E731
    bounds = black_box_bounds(law, mean=(-0.1, 0.1), sigma=(0.1, 0.2), z=(-4, 4))
    found = bounds.quantiles("y", quantile, {"z": st.norm()})
    z = st.norm.rvs(size=20_000, random_state=1)
    loop = [np.quantile(f(m + s * z), quantile) for m in np.linspace(-0.1, 0.1, 11) for s in np.linspace(0.1, 0.2, 11)]
    width, error = found.upper[0, 0] - found.lower[0, 0], found.estimate[0, 0]
    assert found.lower[0, 0] == pytest.approx(min(loop), abs=error + 0.03 * width)
    assert found.upper[0, 0] == pytest.approx(max(loop), abs=error + 0.03 * width)


def test_outputs_that_are_constant_and_yields_that_are_none():
    for wrong in (0, 1, 1.2, "much", float("nan")):
        refused("above 0 and below 1", mb.tolerances, gap(), {"gap": (2.8, 3.2)}, box_of(), yield_=wrong)
    bounds = black_box_bounds(lambda a: [[a, 3.0]], outputs="y constant", a=(0.9, 1.1))
    assert bounds.statistical({"constant": (2, None)}).total == (0.0, 0.0)
    assert bounds.statistical({"constant": (4, None)}).total[0] == 1


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("middle", [0.1, 0.45])
@pytest.mark.parametrize("has_lanes", [True, False])
def test_means_of_distances_are_exact_or_state_their_error(middle, has_lanes):
    """A distance has a kink at one point. Polynomials of its square root are wrong by up to a tenth of its width."""
    box, p = mb.Box(x=(-1, 1), y=(-1, 1)), mb.Parameters(x=0.0, y=0.0)
    square = (p.x - middle) ** 2 + (p.y + middle) ** 2
    simulator = mb.Scene(mb.System(parameters=p), {}, [0.0], {"distance": ca.sqrt(square)}, box)
    if not has_lanes:
        simulator = mb.FunctionSimulator(
            lambda x, y: [[np.hypot(x - middle, y + middle)]], {"x": 0.0, "y": 0.0}, [0.0], ["distance"]
        )
    found = mb.propagate(simulator, mb.PolynomialChaos(budget=60), box).statistical({"distance": (None, 0.5)})
    drawn = st.truncnorm(-3, 3, scale=1 / 3).rvs((2, 400_000), random_state=0)
    expected = np.hypot(drawn[0] - middle, drawn[1] + middle)
    of_polynomials = any("Polynomials replace runs" in remark for remark in found.remarks)
    assert of_polynomials == (found.runs < 1000) and not (has_lanes and of_polynomials)
    tolerance = 0.1 if of_polynomials else 0.005
    assert_allclose([found.mean[0], found.sigma[0]], [expected.mean(), expected.std()], rtol=tolerance)
