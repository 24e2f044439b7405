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
    assert found.runs >= 0
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


def test_answers_that_state_no_error_are_refused():
    bounds = Brake().bounds()
    with pytest.raises(mb.PropagationError, match=r"more than \d+ further runs are needed\. Allow them by runs="):
        bounds.samples(100, LAWS)
    assert bounds.samples(100, LAWS, runs=200)["torque"].shape == (100, len(T))
    with pytest.raises(mb.PropagationError, match=r"Vertex\(\) has no polynomials, and 8 further runs do not suffice"):
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
