"""One oscillator with closed-form bounds against every method."""

import itertools
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


WHOLE, SHARE = "must be an integer of at least 1", "tolerance must be a number above 0 and below 1"
OPTIONS = [
    (MonteCarlo, {"samples": [0]}, f"samples {WHOLE}"), (MonteCarlo, {"samples": [1.5]}, "got 1.5"),
    (PolynomialChaos, {"order": [0]}, "order must be an integer"),
    (PolynomialChaos, {"order": [2], "budget": [10]}, "Leave out order"),
    (PolynomialChaos, {"lockstep": [True]}, "give order"), (PolynomialChaos, {"tolerance": [0.0]}, SHARE),
    (PolynomialChaos, {"seconds": [0, -1.0, np.nan, "1", True]}, "seconds must be a number above 0"),
    (PolynomialChaos, {"probes": [-1, 1.5]}, "probes"), (PolynomialChaos, {"probes": [10], "order": [3]}, "probes"),
    (PolynomialChaos, {"range": [symmb.LegendreInclusion()]}, "chooses nodes, basis and range itself"),
    *(  # NumPy has a function `indices`, which is what a basis must have
        (PolynomialChaos, {"order": [2], name: [np]}, f"{name} must be an object such as")
        for name in ("nodes", "basis", "range")
    ),
    (Taylor, {"order": [0]}, f"order {WHOLE}"), (Taylor, {"subintervals": [0]}, f"subintervals {WHOLE}"),
    (symmb.TaylorModel, {"order": [0, 2.5]}, WHOLE), (symmb.TaylorModel, {"boxes": [0]}, WHOLE),
    (Optimization, {"budget": [0]}, f"budget {WHOLE}"), (Optimization, {"tolerance": [1]}, f"{SHARE}, got 1"),
    (Swarm, {"particles": [0]}, f"particles {WHOLE}"), (Swarm, {"steps": [0]}, f"steps {WHOLE}"),
    (Swarm, {"seed": [-1]}, "seed must be an integer of at least 0"),
    (symmb.Exact, {"budget": [0]}, "integer of at least 1"),
    (symmb.Exact, {"tolerance": [0.0, 1.0, np.nan]}, "at least 1e-12 and below 1"),
    (symmb.Bernstein, {"boxes": [0, 1.5]}, "integer of at least 1"),
    (symmb.HyperbolicCross, {"q": [0, -0.5, 1.5, np.nan]}, "^HyperbolicCross: q must be .* above 0 and at most 1, got"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "options", "message"), OPTIONS)
def test_options_out_of_range(make, options, message):
    for values in itertools.product(*options.values()):
        refused(message, make, **dict(zip(options, values, strict=True)))


def test_a_method_of_ones_own_needs_one_function():
    class Nominal(Method):
        kind = "sampled"

        def _bounds(self, simulator, box, executor, progress):
            return Vertex()._bounds(simulator, Box(amplitude=(1, 1)), executor, progress)

    result = warned("Runs at 9 of 9 other points are outside of the bounds", propagate, Wave(), Nominal(), BOX)
    np.testing.assert_array_equal(result.lower, result.upper)
