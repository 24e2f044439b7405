"""One oscillator with closed-form bounds against every method."""

import pickle

import numpy as np
import pytest
from conftest import ALL_METHODS
from faults import refused, warned
from oscillators import BOX, TIMES, Wave, wave, wave_bounds

import symmb
from symmb import Box, FunctionSimulator, MonteCarlo, Optimization, PolynomialChaos, Swarm, Taylor, Vertex, propagate
from symmb import _errors as errors
from symmb.bound.bounds.method import Method

# Largest root mean square error over root mean square width; 2e-4 where nothing is said.
LARGEST_ERROR = {
    "PolynomialChaos.paper(order=2)": 0.07,
    "PolynomialChaos.paper(order=3, nodes=SparseGrid())": 0.07,
    "PolynomialChaos.paper(order=4, lockstep=True)": 0.07,
    "Taylor(order=2)": 0.07,
    "Taylor(order=5)": 0.07,
    "Taylor(order=2, subintervals=4)": 5e-3,
    "MonteCarlo(2000)": 0.02,
    "MonteCarlo(500, sampler=LatinHypercube())": 0.03,
    "MonteCarlo(500, sampler=Sobol())": 0.03,
    "Vertex()": 3e-3,
}


def _error(lower, upper, exact):
    deviation = np.concatenate([lower - exact[0], upper - exact[1]], axis=1)
    return np.sqrt(np.mean(deviation**2) / np.mean((exact[1] - exact[0]) ** 2))


@pytest.mark.parametrize("method", ALL_METHODS, ids=repr)
def test_against_closed_form(method):
    exact = wave_bounds()
    result = propagate(Wave(), method, BOX)
    assert result.method == repr(method) and result.kind == method.kind
    assert result.lower.shape == result.upper.shape == (len(TIMES), 1)
    assert _error(result.lower, result.upper, exact) < LARGEST_ERROR.get(repr(method), 2e-4)
    assert result.evaluations > 0 and result.failed == () and result.seconds > 0
    if result.kind == "enclosure":
        assert (result.lower <= exact[0]).all() and (result.upper >= exact[1]).all()
    if result.kind == "sampled":
        assert (result.lower >= exact[0] - 1e-14).all() and (result.upper <= exact[1] + 1e-14).all()
    if result.inner is not None:
        assert (result.inner[0] >= exact[0] - 1e-14).all() and (result.inner[1] <= exact[1] + 1e-14).all()


@pytest.mark.parametrize("method", ALL_METHODS, ids=repr)
def test_constructor_text_gives_the_method_back(method):
    assert eval(repr(method), {name: getattr(symmb, name) for name in symmb.__all__}) == method
    assert pickle.loads(pickle.dumps(method)) == method


@pytest.mark.parametrize("method", [m for m in ALL_METHODS if not isinstance(m, Taylor)], ids=repr)
def test_parameters_out_of_the_box_keep_their_values(method):
    box = Box(w=(0.95, 1.05))
    exact = wave_bounds(Box(amplitude=(1.0, 1.0), w=(0.95, 1.05)))
    result = propagate(Wave(), method, box)
    assert _error(result.lower, result.upper, exact) < LARGEST_ERROR.get(repr(method), 2e-4)


def test_taylor_with_parameters_out_of_the_box():
    result = propagate(Wave(), Taylor(order=3), Box(w=(0.95, 1.05)))
    angle, step = TIMES, 0.05 * TIMES
    even, odd = (-np.cos(angle) * step**2 / 2, np.abs(np.sin(angle) * step) + np.abs(np.sin(angle) * step**3 / 6))
    # x^3 and x are bounded apart, [-1, 1] each.
    np.testing.assert_allclose(result.upper[:, 0], np.cos(angle) + np.maximum(even, 0) + odd, atol=1e-12)
    assert result.evaluations == 4


@pytest.mark.parametrize("method", ALL_METHODS, ids=repr)
def test_function_simulator_serves_every_method_or_says_why_not(method):
    simulator = FunctionSimulator(wave, {"amplitude": 1.0, "w": 1.0}, TIMES, ["x"])
    if isinstance(method, Taylor | Optimization):
        message = r"needs derivatives of the trajectory, but FunctionSimulator\(wave\) gives values only"
    elif getattr(method, "lockstep", False):
        message = r"FunctionSimulator\(wave\) runs each sample separately"
    elif "TaylorModel" in repr(method):
        message = r"needs the equations of a scene, or outputs that.*but FunctionSimulator\(wave\)"
    elif "Interval" in repr(method):
        message = r"plain expressions of parameters and time, but FunctionSimulator\(wave\)"
    else:
        expected = propagate(Wave(), method, BOX).upper
        np.testing.assert_allclose(propagate(simulator, method, BOX).upper, expected, atol=1e-12)
        return
    refused(message, propagate, simulator, method, BOX, error=errors.PropagationError)


def test_what_is_no_parameter_and_no_method_is_told():
    refused(r"no parameter 'amplitud'.*'amplitude'", propagate, Wave(), Vertex(), Box(amplitud=(0, 1)))
    refused("expected a method", propagate, Wave(), 0.5, BOX)
    refused("propagate: got the class Vertex; call it", propagate, Wave(), Vertex, BOX)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MonteCarlo(0), "samples must be an integer of at least 1"),
        (lambda: MonteCarlo(1.5), "got 1.5"),
        (lambda: PolynomialChaos(order=0), "order must be an integer"),
        (lambda: PolynomialChaos(order=2, budget=10), "Leave out order"),
        (lambda: PolynomialChaos(lockstep=True), "give order"),
        (lambda: PolynomialChaos(tolerance=0.0), "tolerance must be a number above 0 and below 1"),
        (lambda: Taylor(0), "order must be an integer of at least 1"),
        (lambda: Taylor(subintervals=0), "subintervals must be an integer of at least 1"),
        (lambda: Optimization(budget=0), "budget must be an integer of at least 1"),
        (lambda: Optimization(tolerance=1), "tolerance must be a number above 0 and below 1, got 1"),
        (lambda: Swarm(particles=0), "particles must be an integer of at least 1"),
        (lambda: Swarm(steps=0), "steps must be an integer of at least 1"),
        (lambda: Swarm(seed=-1), "seed must be an integer of at least 0"),
    ],
)
def test_options_out_of_range(make, message):
    refused(message, make)


def test_a_method_of_ones_own_needs_one_function():
    class Nominal(Method):
        kind = "sampled"

        def _bounds(self, simulator, box, executor, progress):
            return Vertex()._bounds(simulator, Box(amplitude=(1, 1)), executor, progress)

    result = warned("Runs at 9 of 9 other points are outside of the bounds", propagate, Wave(), Nominal(), BOX)
    np.testing.assert_array_equal(result.lower, result.upper)
