"""Results as labelled arrays and tidy tables: nothing is lost, and every row is a time and an output."""

import sys
from functools import cache

import numpy as np
import pytest
from faults import refused
from machines import ball

import symmb as mb
from symmb._labelled import parameter_names

P = mb.Parameters(stiffness=40.0, time=2.0)  # a name that a dimension has
BALL = mb.Body("ball", mass=P.time, pose=mb.Particle())
SPRING = mb.Spring("spring", mb.Ground().point(0, 0), BALL.point(0, 0), P.stiffness)
START, OUTPUTS = {"ball.x": 0.1, "ball.y": 0.0, "ball.z": 0.0}, {"x": BALL.x, "force": P.stiffness * BALL.x}
BOX = mb.Box(stiffness=(36.0, 44.0))
SCENE = mb.Scene(mb.System(BALL, SPRING), START, np.linspace(0.0, 1.0, 6), OUTPUTS, BOX)
T = np.linspace(0.0, 2.0, 5)


def broken(k, c):
    if k > 1.05 and c > 1.05:
        raise ValueError("it broke")
    return np.stack([np.cos(k * T), c * T**2], axis=1)


@cache
def a_run():
    return mb.simulate(SCENE)


@cache
def some_bounds():
    return mb.propagate(SCENE, mb.PolynomialChaos())


def test_iteration_gives_the_outputs_and_in_says_what_can_be_looked_up():
    run, bounds = a_run(), some_bounds()
    for result in (run, bounds, bounds.check({"x": (-1.0, 1.0), "force": (None, 9.0)})):
        assert [*result] == ["x", "force"] and "x" in result and "y" not in result and 0 not in result
    assert "ball.x" in run and "ball.x" not in bounds
    runs = mb.sweep(SCENE, {"stiffness": [39.0, 41.0]})
    assert "force" in runs and "ball.x" not in runs
    refused(r"a sweep cannot be iterated\. runs\[", list, runs)


@cache
def a_comparison():
    return mb.compare(SCENE, [mb.PolynomialChaos(), mb.Vertex()])


def failing():
    function = mb.FunctionSimulator(broken, {"k": 1.0, "c": 1.0}, T, ["a", "b"])
    with pytest.warns(mb.SymmbWarning):
        return mb.propagate(function, mb.Scanning(5), mb.Box(k=(0.9, 1.1), c=(0.9, 1.1)))


def reread(result, folder):
    """The dataset of a result, from a file of netCDF."""
    xarray, path = pytest.importorskip("xarray"), folder / "result.nc"
    result.to_xarray().to_netcdf(path)
    again = xarray.load_dataset(path)
    xarray.testing.assert_identical(result.to_xarray(), again)
    return again


@pytest.mark.parametrize("result", [a_run, some_bounds, a_comparison])
def test_netcdf_loses_nothing(result, tmp_path):
    reread(result(), tmp_path)


def test_a_run_by_its_dimensions(tmp_path):
    data = reread(a_run(), tmp_path)
    assert data.value.dims == ("time", "output")
    np.testing.assert_array_equal(data.value.sel(output="x"), a_run()["x"])
    np.testing.assert_array_equal(data.time, a_run().t)
    assert data.time.attrs["units"] == "s"
    assert data.unit.values.tolist() == ["m", ""]
    assert (float(data.stiffness), float(data.parameter_time)) == (40.0, 2.0)
    assert data.attrs["units"] == "x: m"
    assert data.attrs["solver"] == a_run().solver


def test_bounds_by_their_dimensions(tmp_path):
    data = reread(some_bounds(), tmp_path)
    own = some_bounds()
    for found, expected in (
        (data.value.sel(output="x", bound="lower"), own["x"][0]),
        (data.value.sel(output="x", bound="upper"), own["x"][1]),
        (data.outer.sel(bound="upper"), own.outer[1]), (data.inner.sel(bound="lower"), own.inner[0]),
        (data.estimate, own.estimate), (data.coefficients, own.expansion.coefficients),
        (data.alpha, own.expansion.alpha),
    ):  # fmt: skip
        np.testing.assert_array_equal(found, expected)
    assert data.box.sel(parameter="stiffness").values.tolist() == [36.0, 44.0]
    assert (data.attrs["method"], data.attrs["kind"]) == ("PolynomialChaos()", "estimate")
    assert data.attrs["evaluations"] == some_bounds().evaluations


def test_failed_runs_are_samples_with_their_parameters(tmp_path):
    bounds = failing()
    data = reread(bounds, tmp_path)
    assert data.sizes["sample"] == len(bounds.failed) > 0
    np.testing.assert_array_equal(data.k, [run.parameters["k"] for run in bounds.failed])
    assert data.k.dims == ("sample",)
    assert "it broke" in str(data.failure[0].values)
    assert "runs failed" in data.attrs["doubts"]


def test_a_comparison_by_method(tmp_path):
    data = reread(a_comparison(), tmp_path)
    row = a_comparison().rows[1]
    chosen = data.sel({"method": row.name, "output": "x"})  # sel(method=...) is something else
    np.testing.assert_array_equal(chosen.value.sel(bound="upper"), row.upper[:, 0])
    np.testing.assert_array_equal(chosen.error, row.score.error[0])
    assert np.isnan(chosen.estimate).all()  # runs at corners estimate nothing
    np.testing.assert_array_equal(data.reference.sel(bound="lower"), a_comparison().reference.lower)
    assert data.kind.values.tolist() == ["estimate", "sampled"]


def test_a_row_a_time_and_output():
    pytest.importorskip("pandas")
    run, bounds, comparison = a_run().to_pandas(), some_bounds().to_pandas(), a_comparison().to_pandas()
    for frame, result in ((run, a_run()), (bounds, some_bounds())):
        assert len(frame) == len(SCENE.times) * 2
        assert not frame.duplicated(["time", "output"]).any()
        assert list(frame.columns[:2]) == ["time", "output"]
        assert list(frame[frame.output == "x"].time) == list(result.t)
    np.testing.assert_array_equal(run[run.output == "force"].value, a_run()["force"])
    np.testing.assert_array_equal(bounds[bounds.output == "force"].upper, some_bounds()["force"][1])
    assert len(comparison) == 2 * len(SCENE.times) * 2
    one = comparison[(comparison.method == "Vertex()") & (comparison.output == "x")]
    np.testing.assert_array_equal(one.lower, a_comparison().rows[1].lower[:, 0])
    assert set(one.kind) == {"sampled"}
    assert bounds.attrs["method"] == "PolynomialChaos()"


def test_bounds_of_a_file_are_the_same_arrays(tmp_path):
    xarray = pytest.importorskip("xarray")
    some_bounds().save(tmp_path / "bounds.npz")
    again = mb.Bounds.load(tmp_path / "bounds.npz")
    xarray.testing.assert_identical(again.to_xarray(), some_bounds().to_xarray())


@pytest.mark.parametrize("package", ["xarray", "pandas"])
def test_a_package_that_is_missing_is_named(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    told = f"needs {package}.*pip install {package}"
    refused(told, getattr(a_run(), f"to_{package}"), error=ImportError)


def test_a_parameter_may_have_the_name_of_a_dimension():
    pytest.importorskip("pandas")
    run = ball(g=None, method=1.0).run("x")
    assert run.to_pandas().method.tolist() == [1.0, 1.0]


def test_names_that_are_taken():
    assert parameter_names(["k", "time", "a/b"], ["time"]) == ["k", "parameter_time", "a_b"]
