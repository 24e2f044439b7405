"""FunctionSimulator: shapes, failures and what is told of them."""

import numpy as np
import pytest

from symmb import DeclarationError, FunctionSimulator

TIMES = np.array([0.0, 1.0, 2.0])


def _simulator(f, outputs=("x",)):
    return FunctionSimulator(f, {"a": 1.0}, TIMES, outputs)


def test_one_output_may_come_without_its_axis():
    assert _simulator(lambda a: a * TIMES).run(np.array([[2.0]])).Y.tolist() == [[[0.0], [2.0], [4.0]]]


def test_wrong_shape_names_both():
    ensemble = _simulator(lambda a: np.zeros(2)).run(np.array([[1.0]]))
    assert not ensemble.ok.any()
    assert "returned the shape (2,), expected numbers of the shape (3, 1)" in ensemble.messages[0]


@pytest.mark.parametrize(
    "result", ["text", None, [[1.0], [1.0, 2.0], [3.0]], {"x": 1.0}, [1j, 0, 0], ["1", "2", "3"], object()]
)
def test_what_is_no_array_of_numbers_is_a_failed_sample(result):
    ensemble = _simulator(lambda a: TIMES if a > 0 else result).run(np.array([[1.0], [-1.0]]))
    assert ensemble.ok.tolist() == [True, False]
    assert (
        "the function returned" in ensemble.messages[0]
        and "expected numbers of the shape (3, 1)" in ensemble.messages[0]
    )


def test_exception_is_a_failed_sample():
    def f(a):
        if a > 1:
            raise RuntimeError("stuck")
        return a * TIMES

    ensemble = _simulator(f).run(np.array([[1.0], [3.0]]))
    assert ensemble.ok.tolist() == [True, False]
    assert ensemble.t_failed[1] == 0.0 and np.isnan(ensemble.t_failed[0])
    assert ensemble.messages == ("RuntimeError: stuck (a=3)",)
    assert np.isnan(ensemble.Y[1]).all()


def test_value_that_is_not_finite_fails_from_its_time_on():
    ensemble = _simulator(lambda a: np.stack([TIMES, [0, np.inf, 1]], axis=1), ["x", "y"]).run(np.array([[1.0]]))
    assert not ensemble.ok[0] and ensemble.t_failed[0] == 1.0
    assert ensemble.Y[0, 0].tolist() == [0, 0] and np.isnan(ensemble.Y[0, 1:]).all()
    assert ensemble.messages == ("not finite at t = 1 (a=1)",)


@pytest.mark.parametrize(
    "masked",
    [
        np.ma.array([0, 1, 2], mask=[False, True, False]),
        np.ma.array([[0.0], [1.0], [2.0]], mask=[[False], [True], [False]]),
        [0.0, np.ma.masked, 2.0],
        (np.ma.array([0.0]), np.ma.array([1.0], mask=[True]), [2.0]),
    ],
)
def test_a_masked_value_fails_from_its_time_on(masked):
    ensemble = _simulator(lambda a: masked).run(np.array([[1.0]]))
    assert ensemble.messages == ("not finite at t = 1 (a=1)",)
    assert ensemble.Y[0, 0, 0] == 0 and np.isnan(ensemble.Y[0, 1:]).all()


def test_an_exception_without_a_text_is_a_failed_sample():
    class Odd(Exception):
        def __str__(self):
            raise ValueError

    def f(a):
        raise Odd

    assert _simulator(f).run(np.array([[1.0]])).messages == ("Odd (a=1)",)


@pytest.mark.parametrize("times", [[0.0, 0.0], [1.0, 0.0], [0.0, np.nan], [], [[0.0]]])
def test_times_must_increase(times):
    with pytest.raises(DeclarationError, match="times must be finite and increase"):
        FunctionSimulator(lambda a: 0, {"a": 1.0}, times, ["x"])


@pytest.mark.parametrize("outputs", [[], ["x", "x"]])
def test_outputs_must_differ(outputs):
    with pytest.raises(DeclarationError, match="one or more different names"):
        _simulator(lambda a: TIMES, outputs)
