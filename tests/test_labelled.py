"""Results as labelled arrays and tidy tables: nothing is lost, and every row is a time and an output."""

import sys

import numpy as np
import pytest

import symmb as mb
from symmb._labelled import parameter_names

P = mb.Parameters(stiffness=40.0, time=2.0)  # a name that a dimension has
GROUND = mb.Ground()
BALL = mb.Body("ball", mass=P.time, pose=mb.Particle())
SPRING = mb.Spring("spring", GROUND.point(0, 0), BALL.point(0, 0), P.stiffness)
SCENE = mb.Scene(
    mb.System(BALL, SPRING, parameters=P),
    start={"ball.x": 0.1, "ball.y": 0.0, "ball.z": 0.0},
    times=np.linspace(0.0, 1.0, 6),
    outputs={"x": BALL.x, "force": P.stiffness * BALL.x},
    box=mb.Box(stiffness=(36.0, 44.0)),
)
T = np.linspace(0.0, 2.0, 5)


def broken(k, c):
    if k > 1.05 and c > 1.05:
        raise ValueError("it broke")
    return np.stack([np.cos(k * T), c * T**2], axis=1)


RUN = mb.simulate(SCENE)
BOUNDS = mb.propagate(SCENE, mb.PolynomialChaos())
COMPARISON = mb.compare(SCENE, [mb.PolynomialChaos(), mb.Vertex()])


def failing():
    function = mb.FunctionSimulator(broken, {"k": 1.0, "c": 1.0}, T, ["a", "b"])
    with pytest.warns(mb.SymmbWarning):
        return mb.propagate(function, mb.Scanning(5), mb.Box(k=(0.9, 1.1), c=(0.9, 1.1)))


def reread(dataset, path):
    xarray = pytest.importorskip("xarray")
    dataset.to_netcdf(path)
    again = xarray.load_dataset(path)
    xarray.testing.assert_identical(dataset, again)
    return again


@pytest.mark.parametrize("result", [RUN, BOUNDS, COMPARISON], ids=lambda result: type(result).__name__)
def test_netcdf_loses_nothing(result, tmp_path):
    pytest.importorskip("xarray")
    reread(result.to_xarray(), tmp_path / "result.nc")


def test_a_run_by_its_dimensions(tmp_path):
    pytest.importorskip("xarray")
    data = reread(RUN.to_xarray(), tmp_path / "run.nc")
    assert data.value.dims == ("time", "output")
    np.testing.assert_array_equal(data.value.sel(output="x"), RUN["x"])
    np.testing.assert_array_equal(data.time, RUN.t)
    assert data.time.attrs["units"] == "s"
    assert data.unit.values.tolist() == ["m", ""]
    assert (float(data.stiffness), float(data.parameter_time)) == (40.0, 2.0)
    assert data.attrs["units"] == "x: m"
    assert data.attrs["solver"] == RUN.solver


def test_bounds_by_their_dimensions(tmp_path):
    pytest.importorskip("xarray")
    data = reread(BOUNDS.to_xarray(), tmp_path / "bounds.nc")
    lower, upper = BOUNDS["x"]
    np.testing.assert_array_equal(data.value.sel(output="x", bound="lower"), lower)
    np.testing.assert_array_equal(data.value.sel(output="x", bound="upper"), upper)
    np.testing.assert_array_equal(data.outer.sel(bound="upper"), BOUNDS.outer[1])
    np.testing.assert_array_equal(data.inner.sel(bound="lower"), BOUNDS.inner[0])
    np.testing.assert_array_equal(data.estimate, BOUNDS.estimate)
    np.testing.assert_array_equal(data.coefficients, BOUNDS.expansion.coefficients)
    np.testing.assert_array_equal(data.alpha, BOUNDS.expansion.alpha)
    assert data.box.sel(parameter="stiffness").values.tolist() == [36.0, 44.0]
    assert (data.attrs["method"], data.attrs["kind"]) == ("PolynomialChaos()", "estimate")
    assert data.attrs["evaluations"] == BOUNDS.evaluations


def test_failed_runs_are_samples_with_their_parameters(tmp_path):
    pytest.importorskip("xarray")
    bounds = failing()
    data = reread(bounds.to_xarray(), tmp_path / "failed.nc")
    assert data.sizes["sample"] == len(bounds.failed) > 0
    np.testing.assert_array_equal(data.k, [run.parameters["k"] for run in bounds.failed])
    assert data.k.dims == ("sample",)
    assert "it broke" in str(data.failure[0].values)
    assert "runs failed" in data.attrs["doubts"]


def test_a_comparison_by_method(tmp_path):
    pytest.importorskip("xarray")
    data = reread(COMPARISON.to_xarray(), tmp_path / "comparison.nc")
    row = COMPARISON.rows[1]
    chosen = data.sel({"method": row.name, "output": "x"})  # sel(method=...) is something else
    np.testing.assert_array_equal(chosen.value.sel(bound="upper"), row.upper[:, 0])
    np.testing.assert_array_equal(chosen.error, row.score.error[0])
    assert np.isnan(chosen.estimate).all()  # runs at corners estimate nothing
    np.testing.assert_array_equal(data.reference.sel(bound="lower"), COMPARISON.reference.lower)
    assert data.kind.values.tolist() == ["estimate", "sampled"]


def test_a_row_a_time_and_output():
    pytest.importorskip("pandas")
    run, bounds, comparison = RUN.to_pandas(), BOUNDS.to_pandas(), COMPARISON.to_pandas()
    for frame, result in ((run, RUN), (bounds, BOUNDS)):
        assert len(frame) == len(SCENE.times) * 2
        assert not frame.duplicated(["time", "output"]).any()
        assert list(frame.columns[:2]) == ["time", "output"]
        assert list(frame[frame.output == "x"].time) == list(result.t)
    np.testing.assert_array_equal(run[run.output == "force"].value, RUN["force"])
    np.testing.assert_array_equal(bounds[bounds.output == "force"].upper, BOUNDS["force"][1])
    assert len(comparison) == 2 * len(SCENE.times) * 2
    one = comparison[(comparison.method == "Vertex()") & (comparison.output == "x")]
    np.testing.assert_array_equal(one.lower, COMPARISON.rows[1].lower[:, 0])
    assert set(one.kind) == {"sampled"}
    assert bounds.attrs["method"] == "PolynomialChaos()"


def test_bounds_of_a_file_are_the_same_arrays(tmp_path):
    xarray = pytest.importorskip("xarray")
    BOUNDS.save(tmp_path / "bounds.npz")
    again = mb.Bounds.load(tmp_path / "bounds.npz")
    xarray.testing.assert_identical(again.to_xarray(), BOUNDS.to_xarray())


@pytest.mark.parametrize("package", ["xarray", "pandas"])
def test_a_package_that_is_missing_is_named(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"needs {package}.*pip install {package}"):
        getattr(RUN, f"to_{package}")()


def test_a_parameter_may_have_the_name_of_a_dimension():
    pytest.importorskip("pandas")
    p = mb.Parameters(method=1.0)
    block = mb.Body("block", mass=p.method, pose=mb.Particle())
    run = mb.simulate(mb.Scene(mb.System(block, parameters=p), times=[0.0, 1.0], outputs={"x": block.x}))
    assert run.to_pandas().method.tolist() == [1.0, 1.0]


def test_names_that_are_taken():
    assert parameter_names(["k", "time", "a/b"], ["time"]) == ["k", "parameter_time", "a_b"]
