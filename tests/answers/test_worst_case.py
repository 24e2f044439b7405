"""Worst cases: their values, times and parameters against closed forms, and against runs with these parameters."""

import pickle

import numpy as np
import pytest
from black_boxes import black_box_bounds, reloaded
from faults import refused, told_in_a_line, warned

import symmb as mb
from models import double_pendulum

T = np.linspace(0.0, 2.0, 21)


def waves(method=None, calls=None):
    """Bounds of y = a sin t + b^2 t. It is least at a = 0.9 and b = 0 while the sine is positive."""
    calls = [] if calls is None else calls
    f = lambda a, b: calls.append(a) or a * np.sin(T) + b**2 * T  # noqa: E731
    return black_box_bounds(f, method, T, a=(0.9, 1.1), b=(-0.5, 0.7))


@pytest.mark.parametrize(
    "method", [mb.PolynomialChaos(), mb.Scanning(7), mb.PolynomialChaos(order=3), mb.Swarm(20, 20)], ids=repr
)
def test_worst_cases_are_those_of_the_closed_form(method):
    calls = []
    bounds = waves(method, calls)
    made = len(calls)
    worst = bounds.worst("y")
    assert len(calls) == made  # what a black box attained is known
    exact = 1.1 * np.sin(T) + 0.49 * T
    assert worst.upper.time == pytest.approx(T[exact.argmax()])
    assert worst.upper.attained == pytest.approx(exact.max(), rel=0.02)
    for case in (worst.lower, worst.upper, bounds.worst("y", time=1.0).lower):
        i = int(np.abs(T - case.time).argmin())
        p = case.parameters
        assert case.attained == pytest.approx(p["a"] * np.sin(T[i]) + p["b"] ** 2 * T[i], abs=1e-12)
        assert case.run()[i, 0] == pytest.approx(case.attained, abs=1e-12)
        assert -1e-9 <= case.shortfall <= 0.1 * case.width + 1e-9
        assert case.value == bounds[case.output][case.side == "upper"][i]


@pytest.mark.parametrize("share", [0.25, 0.5, 0.85])
def test_a_time_may_have_a_unit(share):
    bounds = waves()
    time = float(T[int(share * len(T))])
    for text in (f"{time} s", (time, "s"), f"{1e3 * time} ms", (time / 60, "min"), f"{time / 3600!r} h"):
        assert bounds.worst("y", time=text).upper.time == bounds.worst("y", time=time).upper.time == time
    for wrong, why in [
        ("250 mm", "'mm' does not fit a time"), (f"{time}", "is not a finite number"),
        ("soon", "is not a finite number"),
        (np.nan, "is not a finite number"), (True, "is not a finite number"), ([1, 2], "is not a finite number"),
        ("0,25 s", "has a comma"), (f"{1e6 * T[-1]} ms", "must be from 0 to"), ("-1 ms", "must be from 0 to"),
    ]:  # fmt: skip
        refused(f"Bounds.worst: time.*{why}", bounds.worst, "y", time=wrong)


@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.MonteCarlo(3000), mb.Vertex()], ids=repr)
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_worst_cases_of_a_scene_are_runs_of_it(method):
    bounds = mb.propagate(double_pendulum.scene().with_times(np.linspace(0, 3, 61)), method)
    for name, time in (("y2", None), ("theta2", 2.2)):
        worst = bounds.worst(name, time)
        for case in (worst.lower, worst.upper):
            run = case.run()
            assert run.parameters == case.parameters
            assert run[name][np.abs(run.t - case.time).argmin()] == pytest.approx(case.attained, abs=1e-6)
            assert dict(case.scene.system.parameters) == case.parameters
            assert abs(case.shortfall) <= 0.02 * case.width + 1e-9
    assert "l1" in str(worst) and str(worst.upper).startswith("highest theta2")
    assert worst.to_xarray()["parameters"].dims == ("bound", "parameter")
    (row,) = worst.to_pandas().to_dict("records")
    assert (row["l1_lower"], row["l1_upper"]) == (worst.lower.parameters["l1"], worst.upper.parameters["l1"])


def test_files_hold_the_worst_cases_over_all_times(tmp_path):
    bounds = waves()
    for name in ("a.npz", "a.json"):
        again = reloaded(bounds, tmp_path / name)
        assert str(again.worst("y")) == str(bounds.worst("y"))
        assert str(reloaded(again, tmp_path / name).worst("y").upper) == str(bounds.worst("y").upper)
        refused("file", again.worst, "y", 1.0)
        refused("file", again.worst("y").upper.run)
        refused("file", lambda own=again: own.worst("y").upper.scene)


def test_a_run_is_made_where_the_polynomials_have_their_extreme():
    """The expansion of y = a is exact, and Gauss's points are inside of the box."""
    case = black_box_bounds(lambda a: a, mb.PolynomialChaos(order=2, nodes=mb.Gauss()), a=(-1, 1)).worst("y").upper
    assert (case.value, case.attained, case.parameters["a"]) == pytest.approx((1.0, 1.0, 1.0))


@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.PolynomialChaos(order=3)], ids=repr)
def test_parameters_that_do_not_act_are_not_told(tmp_path, method):
    """c changes nothing, b only the second output y by little, and d is fixed. The runs have all of them."""

    def study(method):
        both = lambda a, b, c, d: np.stack([a * np.sin(T), a + 1e-6 * b * T + 0 * c], 1)  # noqa: E731
        return black_box_bounds(both, method, T, "x y", d=(2, 2), **dict.fromkeys("abc", (0.9, 1.1)))

    bounds = study(method)
    for own in (bounds, reloaded(bounds, tmp_path / "b.npz")):
        worst = own.worst("y")
        assert worst.upper.varied == worst.lower.varied == ("a", "b")
        assert {*worst.upper.parameters} == {*"abcd"} and worst.upper.parameters["d"] == 2
        errors = ["±"] if worst.upper.estimate >= 0 else []  # Vertex and a fixed order have no estimate
        assert worst._rows()[0] == ["worst case", "bound", *errors, "at [s]", "a", "b", "attained"]
        assert own.worst("x").upper.varied == ("a",)
    assert study(mb.Vertex()).worst("x").upper.varied == ("a", "b", "c")  # runs do not tell it


def test_a_constant_output_has_no_parameters():
    flat = black_box_bounds(lambda a: np.full_like(T, 3.0), None, T, a=(0, 2))
    assert str(flat.worst("y").upper) == "highest y 3 at 0 s"


def test_a_run_that_falls_short_of_the_bound_says_so():
    method = mb.PolynomialChaos(order=5, nodes=mb.Gauss())
    case = warned("", black_box_bounds, lambda a: np.tanh(50 * a), method, a=(-1, 1)).worst("y").upper
    assert case.value > 1.1 and case.attained <= 1
    assert case.is_short and "; the closest run, with these parameters, attains" in str(case)


def test_what_has_no_worst_case_is_told(tmp_path):
    bounds = waves(mb.Scanning(3))
    refused("no output 'x'", bounds.worst, "x")
    refused("from 0 to 2", bounds.worst, "y", 3.0)
    refused("pickled bounds contain no worst cases", pickle.loads(pickle.dumps(bounds)).worst, "y")
    with told_in_a_line(r"a .csv file contains no worst cases. Save the bounds as .npz or .json"):
        reloaded(bounds, tmp_path / "a.csv").worst("y")
    taylor = mb.propagate(double_pendulum.scene().with_times(np.linspace(0, 0.1, 3)), mb.Taylor(2))
    for bounds in (taylor, pickle.loads(pickle.dumps(taylor))):
        refused(r"Taylor\(.*makes no runs that attain its bounds", bounds.worst, "y2")


@pytest.mark.parametrize("seed", range(3))
def test_a_bound_is_as_close_to_the_range_as_its_error_tells(tmp_path, seed):
    c = np.random.default_rng(seed).uniform(0.5, 2.0, 3)
    wave = lambda a, b: np.sin(c[0] * a * T + c[1] * b) + c[2] * a * b  # noqa: E731
    bounds = black_box_bounds(wave, None, T, a=(0.8, 1.2), b=(0.7, 1.3))
    Y = wave(np.linspace(0.8, 1.2, 201)[:, None, None], np.linspace(0.7, 1.3, 201)[:, None])
    for own in (bounds, reloaded(bounds, tmp_path / "b.json")):
        worst = own.worst("y")
        assert worst.upper.estimate in own.estimate["y"]
        assert abs(worst.upper.value - Y.max()) <= worst.upper.estimate + 1e-4 * np.ptp(Y)
        assert abs(worst.lower.value - Y.min()) <= worst.lower.estimate + 1e-4 * np.ptp(Y)
