"""Quantiles, probabilities and samples against closed forms."""

import numpy as np
import pytest
import scipy.stats as st
from black_boxes import black_box_bounds, errors_of
from faults import refused

import symmb as mb

T = np.array([0.0, 1.0, 2.0])


def sums(a=(-9.0, 9.0), b=(-9.0, 9.0), method=None):
    """Bounds of y = a + b t."""
    return black_box_bounds(lambda a, b: a + b * T, method, T, nominal={"a": 0.0, "b": 0.0}, a=a, b=b)


NORMAL = {"a": st.norm(0.5, 1.0), "b": st.norm(0.0, 2.0)}
LEVELS = [0.01, 0.5, 0.9]


@pytest.mark.parametrize("rho", [None, 0.8, -0.5, 1.0, -1.0])
@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.Vertex()], ids=repr)
def test_quantiles_of_sums_of_normal_parameters(rho, method):
    bounds = sums(method=method)
    runs = None if isinstance(method, mb.PolynomialChaos) else 100  # the polynomials need more runs than corners
    matrix = None if rho is None else [[1, rho], [rho, 1]]
    found = bounds.quantiles("y", LEVELS, laws=NORMAL, correlation=matrix, runs=runs)
    deviation = np.sqrt(1 + 4 * T**2 + 4 * T * (rho or 0.0))
    exact = 0.5 + st.norm.ppf(LEVELS)[:, None] * deviation
    assert (np.abs(found.lower - exact) <= found.estimate).all()
    assert (found.lower == found.upper).all()
    assert (found.estimate < 0.1 * deviation).all()
    beyond = bounds.probability("y", above=2.0, laws=NORMAL, correlation=matrix, runs=runs)
    assert (np.abs(beyond.lower - st.norm.sf(1.5 / deviation)) <= beyond.estimate).all()
    under = bounds.probability("y", below=2.0, laws=NORMAL, correlation=matrix, runs=runs)
    assert np.allclose(under.upper, 1 - beyond.lower, atol=1e-12)


def test_parameters_without_a_law_give_two_quantiles():
    bounds = sums(a=(-9, 9), b=(-1, 3))
    found = bounds.quantiles("y", LEVELS, laws={"a": NORMAL["a"]})
    exact = 0.5 + st.norm.ppf(LEVELS)[:, None]
    assert (errors_of(found, exact - T, exact + 3 * T) <= found.estimate).all()
    assert "b: any value in the box" in str(found)


def test_an_extreme_inside_of_an_interval_counts():
    """y = a + 4 b (1 - b): the largest value is at b = 1/2."""
    bounds = black_box_bounds(lambda a, b: a + 4 * b * (1 - b), nominal={"b": 0.0}, a=(-9, 9), b=(0, 1))
    found = bounds.quantiles("y", 0.5, {"a": st.norm()})
    assert errors_of(found, 0.0, 1.0)[0, 0] <= found.estimate[0, 0]
    chance = bounds.probability("y", above=1.0, laws={"a": st.norm()})
    assert errors_of(chance, st.norm.sf(1), 0.5)[0] <= chance.estimate[0]


def test_laws_are_cut_to_the_box():
    bounds = sums(a=(0.0, 1.0), b=(0.0, 0.0))
    found = bounds.quantiles("y", LEVELS, {"a": st.expon()})
    cut = st.truncexpon(1.0)
    assert np.allclose(found.lower[:, 0], cut.ppf(LEVELS), atol=found.estimate[:, 0])
    told = "The distribution of a is cut to its interval. The part outside has a probability of 0.37. "  # exp(-1)
    assert found.remarks == (told + "Bounds over wider intervals include this part.",)


def test_laws_that_are_cut_are_told_together():
    bounds = sums(a=(0.0, 1.0), b=(0.0, 1.0))
    (told,) = bounds.quantiles("y", 0.5, {"a": st.expon(), "b": st.uniform(0, 2)}).remarks
    assert told.startswith("The distributions of a, b are cut to their intervals.")
    assert "The part outside has a probability of 0.37 for a, 0.5 for b. Bounds over wider intervals" in told
    (told,) = bounds.quantiles("y", 0.5, {"a": st.expon(), "b": st.expon()}).remarks
    assert "a probability of 0.37 for a, 0.37 for b." in told


def test_a_parameter_without_a_law_gives_two_reject_rates():
    """b is from -1 to 3. At t = 1, a + b t must leave (-3, 4) if a > 5 or a < -6, and may if a > 1 or a < -2."""
    bounds = sums(a=(-9, 9), b=(-1, 3))
    law = NORMAL["a"]
    found = bounds.probability("y", above=4.0, below=-3.0, laws={"a": law})
    assert errors_of(found, law.sf(5) + law.cdf(-6), law.sf(1) + law.cdf(-2))[1] <= found.estimate[1]


@pytest.mark.parametrize(
    ("response", "above", "exact"),
    [
        (lambda a, b: a + b, 7.2, st.norm.sf(7.2 / 2**0.5)),
        (lambda a, b: np.hypot(a, b), 4.5, np.exp(-(4.5**2) / 2)),
        (lambda a, b: np.maximum(a, b), 4.0, 1 - st.norm.cdf(4.0) ** 2),
    ],
    ids=["plane", "circle", "two planes"],
)
def test_rare_events_are_found_by_runs_near_the_limit(response, above, exact):
    """Probabilities of 2e-7 to 6e-5 of standard normal parameters."""
    bounds = black_box_bounds(response, a=(-7, 7), b=(-7, 7))
    laws = {"a": st.norm(), "b": st.norm()}
    found = bounds.probability("y", above=above, laws=laws, runs=1500)
    value, _, error = found.ever
    assert abs(value - exact) <= error <= 0.1 * value
    assert found.runs <= 1500
    if exact < 1e-5:
        assert "Allow them by runs=" in str(bounds.probability("y", above=above, laws=laws))


def test_an_error_of_a_probability_that_is_asked_for_takes_more_samples():
    bounds = sums()
    coarse, fine = (bounds.probability("y", above=9.0, laws=NORMAL, error=error) for error in (0.5, 0.02))
    assert fine.samples > coarse.samples
    assert fine.ever[2] <= 0.02 * fine.ever[0]
    assert abs(coarse.ever[0] - fine.ever[0]) <= coarse.ever[2]


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_intervals_without_good_polynomials_give_two_quantiles():
    """y = |a| + b with jumps of 0.2 in a: quantiles by the law of a, and b from -1 to 1."""
    stairs = lambda a: np.abs(a) + 0.2 * np.sign(np.sin(9 * a))  # noqa: E731
    method, law = mb.PolynomialChaos(budget=27), st.uniform(-1, 2)
    bounds = black_box_bounds(lambda a, b: stairs(a) + b, method, nominal={"a": 0.1}, a=(-1, 1), b=(-1, 1))
    found = bounds.quantiles("y", LEVELS, {"a": law}, runs=2000)
    exact = np.quantile(stairs(law.ppf((np.arange(100_000) + 0.5) / 100_000)), LEVELS)
    assert found.runs > 0
    assert (errors_of(found, exact[:, None] - 1, exact[:, None] + 1) <= found.estimate).all()


def test_a_probability_is_printed_and_labelled():
    found = sums().probability("y", above=2.0, laws=NORMAL)
    for text in ("Probability of y above 2", "at any output time", "highest, at 2 s"):
        assert text in str(found) and text in found._repr_html_()
    assert np.array_equal(found.to_xarray()["lower"], found.lower)
    assert found.to_xarray().attrs["ever_lower"] == found.ever[0]


def test_samples_follow_their_laws():
    bounds = sums()
    found = bounds.samples(20_000, NORMAL, [[1, 0.6], [0.6, 1]], seed=3)
    a, b = found.parameters["a"], found.parameters["b"]
    assert st.kstest(a, NORMAL["a"].cdf).pvalue > 1e-3
    assert np.corrcoef(a, b)[0, 1] == pytest.approx(0.6, abs=0.02)
    assert np.allclose(found["y"], a[:, None] + b[:, None] * T)
    assert np.array_equal(found["y"], bounds.samples(20_000, NORMAL, [[1, 0.6], [0.6, 1]], seed=3)["y"])


def test_monte_carlo_draws_from_laws():
    method = mb.MonteCarlo(4000, laws={"a": st.norm(0, 0.1)})
    assert repr(method) == "MonteCarlo(4000, distributions={'a': norm(0, 0.1)})"
    bounds = sums(b=(0, 0), method=method)
    assert bounds.upper[0, 0] == pytest.approx(0.36, abs=0.1)  # largest of 4000 normal numbers
    assert not bounds.doubts


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"output": "z"}, "no output 'z'"), ({"levels": 1.5}, "above 0 and below 1"),
        ({"levels": []}, "above 0 and below 1"), ({"laws": {}}, "must be given by name"),
        ({"laws": {"a": 3.0}}, "cdf and ppf"), ({"laws": {"c": st.norm()}}, "'c' is not a parameter of the box"),
        ({"laws": {"a": st.norm(99, 1)}}, "probability of 0 in its interval"),
        ({"correlation": [[1, 2], [2, 1]]}, "not positive semidefinite"), ({"correlation": [[1]]}, "2 x 2 matrix"),
        ({"correlation": [[1, 0.5], [0.1, 1]]}, "symmetric"), ({"laws": {"a": st.multivariate_normal([0, 0])}}, "cdf"),
    ],
)  # fmt: skip
def test_what_is_malformed_is_told_in_a_sentence(change, text):
    bounds = sums()
    refused(text, bounds.quantiles, **{"output": "y", "levels": 0.5, "laws": NORMAL} | change)


def test_other_malformed_calls():
    bounds = sums()
    refused("pass a number as above=", bounds.probability, "y", laws=NORMAL)
    refused("below must not exceed above", bounds.probability, "y", above=1.0, below=2.0, laws=NORMAL)
    refused("error must be above 0 and below 1", lambda: bounds.probability("y", above=1.0, laws=NORMAL, error=0.0))
    refused("need a distribution of every parameter", bounds.samples, 3, {"a": st.norm()})
    refused("n must be", bounds.samples, 0, NORMAL)
    refused("correlation", mb.MonteCarlo, 3, correlation=[[1.0]])


def test_distributions_is_another_name_of_laws():
    bounds = sums()
    asked = {
        "quantiles": lambda **own: bounds.quantiles("y", LEVELS, **own).lower,
        "probability": lambda **own: bounds.probability("y", above=1.0, **own).lower,
        "samples": lambda **own: bounds.samples(9, **own)["y"],
        "MonteCarlo": lambda **own: sums(method=mb.MonteCarlo(9, **own)).lower,
    }
    for name, ask in asked.items():
        assert (ask(distributions=NORMAL) == ask(laws=NORMAL)).all(), name
        refused("two names of one argument", ask, laws=NORMAL, distributions=NORMAL)
        if name != "MonteCarlo":
            refused("distributions must be given by name", ask)


@pytest.mark.parametrize("level", [0.001, 0.01, 0.999])
def test_extreme_quantiles_are_as_accurate_as_asked(level, monkeypatch):
    """A sum of two normal parameters. The bounds have a width of 40."""
    bounds = black_box_bounds(lambda a, b: [[a + b]], nominal={"a": 0.0, "b": 0.0}, a=(-10, 10), b=(-10, 10))
    laws, exact = {"a": st.norm(), "b": st.norm()}, st.norm.ppf(level, scale=np.sqrt(2))
    found = bounds.quantiles("y", level, laws, error=2e-3)
    assert found.samples > 4096 and found.estimate[0, 0] <= 0.1
    assert abs(found.lower[0, 0] - exact) <= found.estimate[0, 0]
    monkeypatch.setattr("symmb.bound.answers.probabilities._MOST_VALUES", 2**17)
    short = bounds.quantiles("y", level, laws, error=1e-6)
    assert "The error of sampling is" in str(short) and short.samples == 2**16
    refused("error must be above 0 and below 1", lambda: bounds.quantiles("y", level, laws, error=2.0))


def test_statistics_of_many_output_times_are_those_of_single_times():
    """Outputs at 20,000 times take several windows. The mean of exp(-k t) for a normal k is known."""
    t = np.linspace(0.0, 1.0, 20_001)
    f = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["y"])
    bounds = mb.propagate(f, mb.PolynomialChaos(order=4), mb.Box(k=(0.4, 1.6)))
    found = bounds.statistical({"y": (None, 1.5)}, {"k": st.norm(1.0, 0.1)}, runs=1000)
    at = found.time[0]
    assert found.mean[0] == pytest.approx(np.exp(-at + 0.005 * at**2), rel=1e-4)
    assert found.sigma[0] == pytest.approx(found.mean[0] * np.sqrt(np.expm1(0.01 * at**2)), rel=0.02, abs=1e-6)


def test_distributions_that_scipy_calls_by_values_are_laws():
    """Histograms and discrete distributions have no other parameters, unlike families such as scipy.stats.norm."""
    bounds = sums(a=(0.0, 3.0), b=(-1.0, 1.0))
    weights = st.rv_discrete(values=([0, 1, 3], [0.2, 0.5, 0.3]))
    histogram = st.rv_histogram((np.array([1.0, 2.0, 2.0]), np.array([0.0, 1.0, 2.0, 3.0])))
    for law, median in ((weights, 1.0), (histogram, 1.75)):
        found = bounds.quantiles("y", [0.5], {"a": law, "b": st.uniform(-1, 2)})
        assert np.abs(found.lower[0, 0] - median) <= found.estimate[0, 0] + 1e-9
    refused("give numbers to the distribution of 'a'", bounds.quantiles, "y", 0.5, {"a": st.norm})
