"""Sweeps and sensitivities against closed forms and other ways to the same runs."""

from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt
import numpy as np
import pytest
from faults import refused

import symmb as mb

T = np.linspace(0.0, 3.0, 31)


def oscillator(scale: float = 1.0) -> mb.Scene:
    """A mass m on a spring k, let go at the amplitude a."""
    p = mb.Parameters(m=1.3 * scale, k=7.0 * scale, a=0.4)
    ball = mb.Body("ball", p.m, pose=mb.Particle())
    system = mb.System(ball, mb.Spring("spring", mb.Ground().point(-1, 0), ball.point(0, 0), p.k, 1.0), parameters=p)
    return mb.Scene(system, {"ball.x": p.a, "ball.y": 0.0}, T, {"x": ball.x, "vx": ball.vx}, name="oscillator")


def exact(m, k, a):
    w = np.sqrt(k / m)
    return np.stack([a * np.cos(w * T), -a * w * np.sin(w * T)], axis=-1)


def test_a_grid_runs_all_combinations_in_order():
    k, a = [5.0, 6.0, 8.0], [0.1, 0.3]
    runs = mb.sweep(oscillator(), {"k": k, "a": a})
    assert len(runs) == 6 and runs.ok.all() and not runs.doubts
    truth = np.array([[exact(1.3, one, other) for other in a] for one in k])
    np.testing.assert_allclose(runs["x"], truth[..., 0], atol=1e-7)
    np.testing.assert_allclose(runs["vx"], truth[..., 1], atol=1e-6)
    np.testing.assert_array_equal(runs.parameters["k"], np.repeat(k, 2))
    np.testing.assert_array_equal(runs.parameters["m"], 1.3)


def test_a_list_of_parameters_runs_each():
    sets = [{"k": 5.0}, {}, {"m": 2.0, "a": -0.2}]
    runs = mb.simulate(oscillator(), parameters=sets)
    assert isinstance(runs, mb.Sweep) and not runs.grid
    for row, own in zip(runs.values, sets, strict=True):
        np.testing.assert_allclose(row, exact(**{"m": 1.3, "k": 7.0, "a": 0.4, **own}), atol=1e-6)
        np.testing.assert_allclose(row, mb.simulate(oscillator(), parameters=own).values, atol=1e-6)


def test_other_simulators_are_swept_on_any_executor():
    decay = mb.FunctionSimulator(lambda k, c: c * np.exp(-k * T)[:, None], {"k": 1.0, "c": 2.0}, T, ["x"])
    values = {"k": np.linspace(0, 1, 300)}
    runs = mb.sweep(decay, values)
    np.testing.assert_allclose(runs["x"], 2 * np.exp(-values["k"][:, None] * T))
    with ThreadPoolExecutor(2) as pool:
        np.testing.assert_array_equal(mb.sweep(decay, values, executor=pool).values, runs.values)


def test_failed_runs_are_told_and_the_others_stay():
    def f(k: float) -> np.ndarray:
        if k > 2:
            raise mb.SimulationError("too stiff")
        return k * T[:, None]

    with pytest.warns(mb.SymmbWarning, match="2 of 4 runs failed: too stiff"):
        runs = mb.sweep(mb.FunctionSimulator(f, {"k": 1.0}, T, ["x"]), {"k": [3.0, 1.0, 4.0, 2.0]})
    assert runs.ok.tolist() == [False, True, False, True] and "warning" in str(runs)
    np.testing.assert_allclose(runs["x"][3], 2 * T)
    assert np.isnan(runs["x"][0]).all()
    assert [line.split() for line in str(runs).splitlines()][-1] == "x 0 0 1 6 3 3".split()


def test_sweeps_become_labelled_arrays_tables_and_pictures(tmp_path):
    runs = mb.sweep(oscillator(), {"k": [5.0, 6.0, 8.0], "a": [0.1, 0.3]})
    data = runs.to_xarray()
    assert data["value"].dims == ("k", "a", "time", "output") and data.attrs["scene"] == "oscillator"
    np.testing.assert_array_equal(data["value"].sel({"k": 6.0, "a": 0.3, "output": "x"}), runs["x"][1, 1])
    frame = runs.to_pandas()
    row = frame[(frame.k == 6.0) & (frame.a == 0.3) & (frame.output == "x")]
    np.testing.assert_array_equal(row["value"], runs["x"][1, 1])
    some = mb.simulate(oscillator(), parameters=[{}, {"k": 5.0}]).to_xarray()
    assert some["value"].dims == ("sample", "time", "output")
    figure = runs.plot(tmp_path / "a.png", outputs=["x"])
    assert len(figure.axes) == 1 and len(figure.axes[0].lines) == 6 and (tmp_path / "a.png").stat().st_size > 5000
    _, axes = plt.subplots()
    runs.plot(outputs="x", ax=axes)
    assert len(axes.lines) == 6
    labels = [f"k = {k}, a = {a}" for k in (5, 6, 8) for a in (0.1, 0.3)]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == labels
    assert "<table" in runs._repr_html_()
    plt.close("all")


def peak():
    p = mb.Parameters(k=(1.0, "N/m"), a=2.0)
    outputs = {"peak": mb.maximum(p.k * p.a * mb.t), "ramp": p.k * mb.t}
    return mb.Scene(mb.System(parameters=p), times=[0.0, 1.0], outputs=outputs)


@pytest.mark.parametrize("given", [False, True])
def test_scalar_outputs_are_drawn_over_the_parameter_with_the_most_values(given):
    runs = mb.sweep(peak(), {"a": [2.0, 3.0], "k": [3.0, 1.0, 2.0]})
    axes = plt.subplots(1, 2)[1] if given else runs.plot().axes
    runs.plot(**({"ax": axes} if given else {}))
    scalar, ramp = axes
    for line, a in zip(scalar.lines, (2.0, 3.0), strict=True):
        np.testing.assert_allclose(line.get_xydata(), [[k, k * a] for k in (1.0, 2.0, 3.0)])
        assert line.get_label() == f"a = {a:g}"
    assert scalar.get_xlabel() == "k [N/m]" and scalar.get_xlim() == (1.0, 3.0)
    looks = [(line.get_color(), line.get_linestyle()) for line in (*scalar.lines, *ramp.lines)]
    assert len({colour for colour, _ in looks}) == 8 and [dashes for _, dashes in looks] == ["--"] * 2 + ["-"] * 6
    assert len(ramp.lines) == 6 and ramp.get_xlabel() == "time [s]" and ramp.get_xlim() == (0.0, 1.0)
    alone = runs.plot(outputs="peak", color=["r", "g"], label=["soft", "hard"])
    assert [text.get_text() for text in alone.legends[0].get_texts()] == ["soft", "hard"]
    assert {line.get_linestyle() for line in alone.axes[0].lines} == {"-"}
    assert str(runs).splitlines()[-2].split() == ["peak", "2", "1", "9", "3"]
    plt.close("all")


def test_runs_of_one_time_are_drawn_over_the_parameter_and_lists_over_their_numbers():
    box = mb.FunctionSimulator(lambda k, a: [[k * a]], {"k": 1.0, "a": 2.0}, [0.0], ["x"])
    (axes,) = mb.sweep(box, {"k": [1.0, 2.0]}).plot().axes
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[1.0, 2.0], [2.0, 4.0]])
    axes, _ = mb.simulate(peak(), parameters=[{"k": 2.0}, {"k": 3.0, "a": 1.0}, {}]).plot().axes
    (line,) = axes.lines
    assert sorted(map(tuple, line.get_xydata())) == [(0.0, 4.0), (1.0, 3.0), (2.0, 2.0)] and axes.get_xlabel() == "run"
    plt.close("all")


@pytest.mark.parametrize("scale", [1.0, 1e-3])
@pytest.mark.parametrize("solver", [None, mb.CVODES(rtol=1e-10), mb.Rosenbrock()], ids=repr)
def test_sensitivities_are_the_derivatives_of_the_closed_form(scale, solver):
    found = mb.sensitivities(oscillator(scale), solver=solver)
    values = {"m": 1.3 * scale, "k": 7.0 * scale, "a": 0.4}
    assert found.parameters == values
    np.testing.assert_allclose(found.run, exact(**values), atol=1e-6)
    for name, value in values.items():
        h = 1e-30j * value  # the complex step, exact to rounding
        w = np.sqrt((values["k"] + h * (name == "k")) / (values["m"] + h * (name == "m")))
        x = (values["a"] + h * (name == "a")) * np.cos(w * T)
        np.testing.assert_allclose(found["x", name] * value, x.imag / 1e-30, atol=2e-5)


def test_sensitivities_of_some_parameters_and_their_outside(tmp_path):
    found = mb.sensitivities(oscillator(), ["a"])
    assert found.values.shape == (31, 2, 1) and "change for 1 %" in str(found)
    np.testing.assert_allclose(found.to_xarray()["sensitivity"][:, 0, 0], np.cos(np.sqrt(7 / 1.3) * T), atol=1e-6)
    found.plot(tmp_path / "a.png")
    assert "<table" in found._repr_html_()
    plt.close("all")


def test_wrong_calls_are_told():
    scene = oscillator()
    black_box = mb.FunctionSimulator(lambda k: k * T[:, None], {"k": 1.0}, T, ["x"])
    without_parameters = mb.Scene(mb.System(mb.Body("ball", 1.0, pose=mb.Particle())), times=T)
    no_lists = [], "x", 1.0, [np.inf], [[1.0]], None
    wrong = {
        "expected values by name": [lambda: mb.sweep(scene, {}), lambda: mb.sweep(scene, 3)],
        "list of finite numbers": [lambda v=v: mb.sweep(scene, {"k": v}) for v in no_lists],
        "no parameter 'kk'": [lambda: mb.sweep(scene, {"kk": [1]}), lambda: mb.simulate(scene, None, [{"kk": 1}])],
        "parameters is empty": [lambda: mb.simulate(scene, parameters=[])],
        "nan is not a finite number": [lambda: mb.simulate(scene, parameters=[{"k": np.nan}])],
        "check=True applies to a single run": [lambda: mb.simulate(scene, parameters=[{}], check=True)],
        "Scene or a simulator": [lambda: mb.sweep("scene", {"k": [1.0]})],
        "has its own solver": [lambda: mb.sweep(black_box, {"k": [1.0]}, times=[0, 1])],
        "no output 'y'": [lambda: mb.sweep(scene, {"k": [1.0]})["y"]],
        "no parameter 'b'": [lambda: mb.sensitivities(scene, ["b"]), lambda: mb.sensitivities(scene)["x", "b"]],
        "the list of parameters is empty": [lambda: mb.sensitivities(scene, [])],
        "contains 'k' twice": [lambda: mb.sensitivities(scene, ["k", "a", "k"])],
        "sensitivities: expected a Scene or a simulator": [lambda: mb.sensitivities(None)],
        "there are no parameters": [lambda: mb.sensitivities(without_parameters)],
        "an output and a parameter": [lambda: mb.sensitivities(scene)["x"]],
    }
    for why, call in ((why, call) for why, calls in wrong.items() for call in calls):
        refused(why, call)


def test_more_runs_than_anybody_can_afford_are_refused_before_they_are_listed():
    scene, many = oscillator(), np.linspace(1, 2, 50_000)
    long = mb.FunctionSimulator(lambda k, c: k * c, {"k": 1.0, "c": 1.0}, np.arange(1e4), ["x"])
    for told, what, values in (
        (r"takes 2\.5e\+09 runs, more than the 1e\+08 allowed", scene, {"k": many, "m": many}),
        (r"100000000 runs, with their outputs, take .* GB", long, {"k": many[:10_000], "c": many[:10_000]}),
    ):
        refused(told, mb.sweep, what, values, error=mb.PropagationError)
