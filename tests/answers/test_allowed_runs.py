"""Numbers of further runs of answers, which a user may limit, and their executor."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.stats as st

import symmb as mb

pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
T = np.linspace(0.0, 3.9, 40)
LAWS = {"force": st.norm(2000, 20), "friction": st.norm(0.38, 0.004), "inertia": st.norm(3, 0.03)}
ASKED = {
    "contributions": lambda bounds, **own: bounds.contributions(**own),
    "quantiles": lambda bounds, **own: bounds.quantiles("torque", 0.9, LAWS, **own),
    "probability": lambda bounds, **own: bounds.probability("torque", above=195.0, laws=LAWS, **own),
    "statistical": lambda bounds, **own: bounds.statistical({"torque": (None, 230.0)}, LAWS, **own),
    "one interval": lambda bounds, **own: bounds.quantiles("torque", 0.9, {"force": LAWS["force"]}, **own),
}


class Brake:
    """The torque of a brake, which jumps to 0 at standstill. It counts its runs."""

    def __init__(self):
        self.runs = 0

    def __call__(self, force, friction, inertia):
        self.runs += 1
        torque = 0.242 * force * friction
        return np.stack([np.where(T < 80 * inertia / torque, torque, 0.0), torque + 0 * T], axis=1)

    def bounds(self, method=None, executor=None):
        nominal = {"force": 2000.0, "friction": 0.38, "inertia": 3.0}
        simulator = mb.FunctionSimulator(self, nominal, T, ["torque", "moving"])
        box = mb.Box.plus_minus(nominal, force="5%", friction="10%", inertia="3%")
        return mb.propagate(simulator, method or mb.PolynomialChaos(budget=50), box, executor=executor)


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize("allowed", [None, 0, 20, 300])
def test_answers_make_at_most_the_allowed_runs(asked, allowed):
    brake = Brake()
    bounds = brake.bounds()
    study, brake.runs = bounds.evaluations, 0
    found = ASKED[asked](bounds, runs=allowed)
    assert brake.runs <= (study if allowed is None else allowed)
    if "do not suffice" in str(found):  # runs that were of no use were made as well
        assert found.runs == brake.runs
    if allowed == 0:
        assert "0 further runs do not suffice. More are allowed by runs=." in str(found)


@pytest.mark.parametrize("runs", [[[1, 2], [3]], -1, "x", 1.5])
def test_what_is_no_number_of_runs_is_refused(runs):
    with pytest.raises(mb.DeclarationError, match="runs must be an integer of at least 0"):
        Brake().bounds().contributions(runs=runs)


def test_a_check_makes_at_most_as_many_runs_as_the_study():
    brake = Brake()
    bounds = brake.bounds(mb.PolynomialChaos(budget=30))
    study, brake.runs = bounds.evaluations, 0
    bounds.check({"torque": (None, float(bounds["torque"][1].max()) + 1e-3)})
    assert 0 < brake.runs <= study


def hills(a, b, c):
    """The highest hill is where few runs are."""
    waves = np.sin(4.459 * a - 1.698) * np.cos(5.379 * b + 1.155)
    rest = -0.08 * a * b - 0.276 * np.abs(b + 0.3295) - 0.557 * c * c
    return [[waves - 0.618 * c * np.sin(4.38 * a + 1.624) + rest]]


def test_few_runs_near_one_extreme_do_not_decide_against_a_warning():
    simulator = mb.FunctionSimulator(hills, {"a": 0.0, "b": 0.0, "c": 0.0}, [0.0], ["y"])
    bounds = mb.propagate(simulator, mb.PolynomialChaos(budget=150), mb.Box(a=(-1, 1), b=(-1, 1), c=(-1, 1)))
    assert bounds.warnings
    for limit in np.linspace(bounds.upper[0, 0], bounds.upper[0, 0] + 0.2, 5):
        assert bounds.check({"y": (None, limit)}).kept is not True


def test_a_check_whose_runs_are_used_up_is_undecided():
    t = np.linspace(0, 2, 11)

    def outputs(a, b, c, d):
        return np.stack([np.sin(5 * a * t) + b * np.tanh(20 * (c - 0.2)) + 0.1 * d, np.exp(a * t) * b + abs(c) * d], 1)

    simulator = mb.FunctionSimulator(outputs, dict.fromkeys("abcd", 0.0), t, ["y", "z"])
    bounds = mb.propagate(simulator, mb.PolynomialChaos(budget=90), mb.Box(**dict.fromkeys("abcd", (-1, 1))))
    assert bounds.check({"y": (-2.1, 2.1), "z": (-9, 9)}).kept is None


def test_contributions_of_even_responses_count_in_rss():
    simulator = mb.FunctionSimulator(lambda a, b: [[a * a + b * b]], {"a": 0.0, "b": 0.0}, [0.0], ["y"])
    bounds = mb.propagate(simulator, mb.PolynomialChaos(), mb.Box(a=(-1, 1), b=(-1, 1)))
    assert bounds.statistical({"y": (None, 1.5)}).rss == pytest.approx(0.5**0.5)


def test_answers_that_state_no_error_are_refused():
    bounds = Brake().bounds()
    with pytest.raises(mb.PropagationError, match=r"more than \d+ further runs are needed\. Allow them by runs="):
        bounds.samples(100, LAWS)
    assert bounds.samples(100, LAWS, runs=200)["torque"].shape == (100, len(T))
    with pytest.raises(mb.PropagationError, match=r"Vertex\(\) made no polynomials, and 8 further runs do not suffice"):
        Brake().bounds(mb.Vertex()).contributions()


def test_means_of_few_runs_state_their_standard_errors():
    bounds = Brake().bounds()
    few = ASKED["statistical"](bounds, runs=150)
    assert "follow from 50 runs. Their standard errors are 14% and about 10% of the standard deviations." in str(few)
    exact = ASKED["statistical"](bounds, runs=4000)
    assert "standard errors" not in str(exact)
    assert np.abs(few.mean - exact.mean) <= 3 * 0.14 * exact.sigma


def test_answers_use_the_executor_as_long_as_it_works():
    brake = Brake()
    with ThreadPoolExecutor(2) as pool:
        bounds = brake.bounds(executor=pool)
        first = bounds.quantiles("torque", 0.9, LAWS)
    later = bounds.quantiles("torque", 0.9, LAWS)  # the executor is shut down
    np.testing.assert_array_equal(first.lower, later.lower)


def test_a_doubtful_output_does_not_change_the_samples_of_another():
    brake = Brake()
    bounds = brake.bounds(mb.PolynomialChaos(budget=200))
    both = bounds.samples(100, LAWS, runs=200)["moving"]
    torque = 0.242 * bounds.samples(100, LAWS, runs=200).parameters["force"]
    torque = torque * bounds.samples(100, LAWS, runs=200).parameters["friction"]
    np.testing.assert_allclose(both, np.repeat(torque[:, None], len(T), axis=1), rtol=1e-9)
    surrogate = bounds.surrogate.part(slice(None), [1])
    points = bounds.box.to_unit(
        np.stack([bounds.samples(100, LAWS, runs=200).parameters[name] for name in bounds.box.names], axis=1)
    )
    np.testing.assert_allclose(both, surrogate.values(points)[:, :, 0], rtol=1e-13)


def test_samples_of_named_outputs_make_no_runs_for_others():
    bounds = Brake().bounds(mb.PolynomialChaos(budget=200))
    both, own = bounds.samples(100, LAWS, runs=200), bounds.samples(100, LAWS, outputs=["moving"], runs=40)
    assert own.names == ("moving",)
    np.testing.assert_array_equal(own["moving"], both["moving"])
    with pytest.raises(mb.DeclarationError, match=r"no output 'movin'\. Did you mean 'moving'"):
        bounds.samples(100, LAWS, outputs=["movin"])
    with pytest.raises(mb.DeclarationError, match="outputs is empty"):
        bounds.samples(100, LAWS, outputs=[])


def test_a_probability_that_misses_a_peak_of_the_bounds_has_an_error():
    """True by 2e6 samples: 0.00124."""
    peak = mb.FunctionSimulator(
        lambda a, b, c: [[np.exp(-((a - 1.15) ** 2 + (b - 0.88) ** 2 + (c - 1.1) ** 2) / 1e-3)]],
        dict.fromkeys("abc", 1.0), [0.0], ["y"],
    )  # fmt: skip
    bounds = mb.propagate(peak, mb.PolynomialChaos(), mb.Box(**dict.fromkeys("abc", (0.8, 1.2))))
    laws = dict.fromkeys("abc", st.uniform(0.8, 0.4))
    low, high, error = bounds.probability("y", above=0.5, laws=laws, runs=2000).ever
    assert low - error <= 0.00124 <= high + error
