"""The worker of live pages: its runs, bounds and drawings are those of Python, and the last change wins."""

import json
import shutil
import subprocess
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import COMPILED, NEEDED, Browser, browser_of_a_module
from faults import refused
from problems import model as shipped
from small_scenes import state

import symmb as mb
from symmb.run.codegen import NoCompilerError
from symmb.show.cli.main import main
from symmb.show.drawing import Page, surveyed
from symmb.show.live.wasm import levels

seen = lambda test: NEEDED(COMPILED(test))  # noqa: E731
pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
browser = browser_of_a_module
WIDTH = 1e-9
"""Largest difference of bounds, as a fraction of their width."""
SINGLE = 1e-6
"""Largest error of polynomials with coefficients in single precision, as a fraction of the width of their range."""
SEEN = 1e-4
"""Largest difference of places [m]. The foot of a contact on its plane is the one of the nominal run."""
DRIVER = """
window.worker = new Worker(URL.createObjectURL(new Blob([document.getElementById("worker").textContent])));
worker.postMessage({ kind: "start", live: page.live });
window.studies = (studies, until) => new Promise((go, stop) => {
  const messages = [], last = studies.at(-1).id;
  worker.onmessage = ({ data }) => {
    if (data.kind !== "ready") messages.push(data);
    if (data.kind === "fault") stop(Error(data.fault));
    if (data.id === last && (data.kind === until || data.fault)) go(JSON.stringify(messages, (_, value) =>
      value instanceof Float64Array ? [...value].map(String) : value));
  };
  for (const study of studies) worker.postMessage({ kind: "study", ...study });
});
"""


class Live:
    """A live page that is open in a browser, without its panel."""

    def __init__(self, browser: Browser, subject: mb.Scene | mb.Bounds, path: Path, limits: Any = None) -> None:
        subject.live(path, limits) if isinstance(subject, mb.Bounds) else mb.live(subject, path, limits)
        self.browser, self.count = browser, 1000  # the page's own worker has other studies
        browser.open(path)
        browser.run(f"{DRIVER}; 0")
        self.data = json.loads(browser.run("JSON.stringify({ ...page.live, wasm: null })"))
        numbers = [(p["value"], p["tolerance"]) for p in self.data["parameters"]]
        self.values, self.tolerances = np.array(numbers, dtype=float).T

    def studies(self, *changes: tuple[Any, Any], limits: Any = (), until: str = "effects") -> list[dict[str, Any]]:
        """All messages until the last of some studies with these values and tolerances ends."""
        asked = []
        for values, tolerances in changes:
            self.count += 1
            own = {"values": np.asarray(values).tolist(), "tolerances": np.asarray(tolerances).tolist()}
            asked.append({"id": self.count, "limits": list(limits), **own})
        messages = json.loads(self.browser.run(f"studies({json.dumps(asked)}, '{until}')"))
        for message in messages:
            n_y = self.data["n_y"]
            sizes = {"rows": self.data["n_out"], "widths": len(self.values), "lower": n_y, "upper": n_y, "error": n_y}
            for key in sizes.keys() & message.keys():
                if message[key] is not None:
                    message[key] = np.array(message[key], dtype=float).reshape(-1, sizes[key])
        return messages


@seen
@pytest.mark.parametrize(
    ("name", "most"), [("double_pendulum", 2), ("four_bar", 3), ("four_bar", 4), ("bouncing_ball", 1)]
)
def test_runs_and_bounds_are_those_of_python(browser, tmp_path, name, most):
    scene = shipped(name)
    live, simulator = Live(browser, scene, tmp_path / "page.html"), mb.prepare(scene)
    live.tolerances[most:] = 0
    run, *bounds, effects = live.studies((live.values, live.tolerances))
    nominal = simulator.run(live.values[None]).Y[0]
    assert np.abs(run["rows"][:, : nominal.shape[1]] - nominal).max() < WIDTH * np.ptp(nominal, axis=0).max()
    varied = np.flatnonzero(live.tolerances)
    grids = levels(len(live.values))[len(varied) - 1]
    for grid, message in zip(grids[-len(bounds) :], bounds, strict=True):  # fast runs have no bounds of the first level
        P = np.tile(live.values, (len(grid.row), 1))
        P[:, varied] += live.tolerances[varied] * grid.nodes
        Y = np.stack([simulator.run(p[None]).Y[0] for p in P])  # samples that share steps differ by the solver's error
        lower, upper = mb.Exact().bounds(grid.alpha, grid.coefficients(Y.reshape(len(P), -1)))
        width = np.reshape(upper - lower, nominal.shape).max(axis=0)
        for side, own in (("lower", lower), ("upper", upper)):
            assert (np.abs(message[side] - own.reshape(nominal.shape)).max(axis=0) <= WIDTH * width).all()
        assert message["runs"] == len(P)
        along = [Y[grid.axis(k)] for k in range(len(varied))]
    line = levels(1)[0][len(grids) - 1]
    for k, values in enumerate(along):
        lower, upper = mb.Exact().bounds(line.alpha, line.coefficients(values.reshape(len(values), -1)))
        widths = (upper - lower).reshape(nominal.shape).max(axis=0)
        assert np.abs(effects["widths"][:, varied[k]] - widths).max() < WIDTH * width.max()
    change = np.maximum(*(np.abs(bounds[-1][side] - bounds[-2][side]) for side in ("lower", "upper")))
    assert np.array_equal(bounds[-1]["error"], change) and np.isinf(bounds[0]["error"]).all()


@seen
def test_bounds_are_possible_values(browser, tmp_path):
    """The lift of a wheel is never negative, but its polynomials are."""
    live = Live(browser, shipped("half_car"), tmp_path / "page.html")
    *_, bounds, _ = live.studies((live.values, live.tolerances))
    lifts = [k for k, own in enumerate(live.data["outputs"]) if own["name"].endswith("lift")]
    assert lifts and (bounds["lower"][:, lifts] == 0).any() and (bounds["lower"][:, lifts] >= 0).all()


@seen
@pytest.mark.parametrize("name", ["half_car", "slider_crank_spatial", "slider_crank_flexible"])
def test_the_drawing_follows_the_parameters(browser, tmp_path, name):
    scene = shipped(name)
    live = Live(browser, scene, tmp_path / "page.html")
    values = live.values * 1.02
    (run,) = [m for m in live.studies((values, 0 * values), until="run") if m["kind"] == "run"]
    parameters = dict(zip(scene.system.parameters, values, strict=True))
    drawing, survey, rows = surveyed(mb.simulate(scene, parameters=parameters))
    nominal, *_ = surveyed(mb.simulate(scene))
    driven = tuple(survey.driven(drawing.shapes))
    assert len(driven) == len(live.data["columns"]) - 1
    for own, column in zip(driven, live.data["columns"][1:], strict=True):
        kind, i, part = own.part
        drawn = getattr(getattr(drawing, kind)[i], part)
        if kind == "shapes":  # arrows are scaled by the largest of their own run
            continue
        begin, n = column["column"], column["width"]
        seen = run["rows"][rows][: column["rows"], begin : begin + n]
        if part == "shift":  # from the base of the nominal run
            place = drawing.places[i]
            drawn = drawn + (0 if place.elastic else place.base - nominal.places[i].base)
        assert np.abs(seen - np.reshape(drawn, (-1, n))).max() < SEEN


@seen
def test_limits_have_worst_cases_and_factors(browser, tmp_path):
    p, ball = mb.Parameters(a=1.0, b=1.0), mb.Body("ball", mass=1.0, pose=mb.Particle())
    system, box = mb.System(ball, mb.Gravity(0, -2), parameters=p), mb.Box(a=(0.9, 1.1), b=(0.8, 1.2))
    start, outputs = {"ball.vx": p.a, "ball.vy": p.a * p.b}, {"x": ball.x, "y": ball.y + mb.t**2}
    scene = mb.Scene(system, start, [0.0, 1.0, 2.0], outputs, box)
    live = Live(browser, scene, tmp_path / "page.html", {"y": (None, 3.0), "x": (-1.0, 2.1)})
    assert live.data["limits"] == [{"output": 1, "low": None, "high": 3.0}, {"output": 0, "low": -1.0, "high": 2.1}]
    *_, bounds, effects = live.studies((live.values, live.tolerances), limits=live.data["limits"])
    y, x = bounds["limits"]
    assert (y["side"], y["time"], y["parameters"]) == ("high", 2, [1.1, 1.2])
    assert np.isclose([y["margin"], x["margin"], y["value"]], [3 - 2.64, -0.1, 2.64]).all()
    worst = np.array(y["rows"], dtype=float).reshape(3, -1)
    assert np.isclose(worst[2, :2], [2.2, 2.64]).all()
    of_y, of_x = effects["limits"]
    factor = (-0.3 + np.sqrt(0.09 + 0.08 * 0.5)) / 0.04  # of the equation 2 (1 + 0.1 f) (1 + 0.2 f) = 3
    assert np.isclose(of_y["factor"], factor, rtol=3e-3)
    assert np.isclose(of_x["factor"], 0.5, rtol=3e-3)
    assert np.isclose(of_y["widths"], [0.2, 0.4]).all() and np.isclose(of_x["widths"], [0.2, 0.0]).all()


def thrown() -> mb.Scene:
    """A ball that is thrown from 1.5 m at 12 m/s and bounces, with scalar outputs of all kinds."""
    p = mb.Parameters(rise=8.0, e=0.7)
    ball = mb.Body("ball", mass=0.2, pose=mb.Particle())
    system = mb.System(ball, mb.Impact("floor", ball.y, restitution=p.e), mb.Gravity(0, -9.81), parameters=p)
    highest = {"height": mb.maximum(ball.y), "second height": mb.maximum(ball.y, window=(2.0, None))}
    others = {"fastest": mb.maximum(ball.vy, window=(1.0, None)), "mean": mb.mean(ball.y, window=(0.0, 1.0))}
    times = {"landing": (mb.first_time(ball.y <= 0), "ms"), "below start": mb.first_time(ball.y < 1.5)}
    ends = {"range": mb.value_at(ball.x, ball.y <= 0), "speed": mb.value_at(ball.vy, ball.y <= 0)}
    outputs = {"y": ball.y, "end": (mb.final(ball.x), "mm")} | highest | others | times | ends
    box = mb.Box(rise=(7.5, 8.5), e=(0.65, 0.75))
    start = {"ball.y": 1.5, "ball.vx": 9.0, "ball.vy": p.rise}
    return mb.Scene(system, start=start, times=np.linspace(0.0, 3.0, 31), outputs=outputs, box=box)


@seen
def test_scalar_outputs(browser, tmp_path):
    scene, g = thrown(), 9.81
    live = Live(browser, scene, tmp_path / "page.html", {"range": (14.0, None), "second height": (None, 2.5)})
    *_, bounds, _ = live.studies((live.values, live.tolerances), limits=live.data["limits"])
    run = live.studies((live.values, live.tolerances))[0]["rows"]
    exact = {}
    for rise, e in ((8.0, 0.7), (7.5, 0.65), (8.5, 0.75)):
        speed = np.sqrt(rise**2 + 3 * g)
        landing = (rise + speed) / g
        exact[rise] = {
            "height": 1.5 + rise**2 / (2 * g),
            "second height": (e * speed) ** 2 / (2 * g),
            "fastest": e * speed,
            "mean": 1.5 + rise / 2 - g / 6,
            "end": 27e3,
            "landing": 1e3 * landing,
            "below start": 2 * rise / g,
            "range": 9 * landing,
            "speed": -speed,
        }
    nominal = mb.simulate(scene)
    for k, own in enumerate(live.data["outputs"]):
        name = own["name"]
        assert own["scalar"] == (name != "y")
        assert np.abs(run[:, k] - nominal[name]).max() < 1e-7 * max(np.abs(run[:, k]).max(), 1)
        if name in exact[8.0]:  # scalar outputs are monotonic in the parameters, and the same at all times
            assert np.allclose(run[:, k], exact[8.0][name], rtol=1e-7)
            ends = np.sort([exact[7.5][name], exact[8.5][name]])
            assert np.allclose(bounds["lower"][:, k], ends[0], rtol=1e-6)
            assert np.allclose(bounds["upper"][:, k], ends[1], rtol=1e-6)
    reach, second = bounds["limits"]
    assert np.isclose(reach["margin"], exact[7.5]["range"] - 14, atol=1e-5) and reach["parameters"][0] == 7.5
    assert np.isclose(second["margin"], 2.5 - exact[8.5]["second height"], atol=1e-5)
    y = scene.system.bodies[0].y
    far = scene.with_outputs({"y": y, "high": mb.first_time(y > 20)})
    *_, failed = Live(browser, far, tmp_path / "far.html").studies((live.values, live.tolerances), until="run")
    assert failed["fault"] == "the condition of output 'high' never holds until the end of the run"
    assert np.isclose(failed["rows"][10, 0], nominal["y"][10])


def growth(n: int = 41) -> mb.FunctionSimulator:
    """Two outputs at n times. The second has a kink at k = 1."""
    times = np.linspace(0.0, 2.0, n) if n > 1 else np.array([1.0])

    def run(k: float, offset: float) -> np.ndarray:
        return np.stack([1e6 + offset + np.exp(k * times), np.maximum(k - 1, 0) * offset + times], axis=1)

    return mb.FunctionSimulator(run, {"k": 1.0, "offset": 0.5}, times, ["x [m]", "y"])


@seen
@pytest.mark.parametrize(("method", "parts"), [(mb.PolynomialChaos(order=6), 1), (mb.PolynomialChaos(), 2)])
def test_bounds_without_a_scene_have_a_page_of_their_polynomials(browser, tmp_path, method, parts):
    bounds = mb.propagate(growth(), method, mb.Box(k=(0.5, 1.5), offset=(0.0, 1.0)))
    assert bounds.surrogate is not None and (len(bounds.surrogate.expansions) > 1) == (parts > 1)
    bounds.save(tmp_path / "bounds.npz")
    loaded = mb.Bounds.load(tmp_path / "bounds.npz")
    live = Live(browser, loaded, tmp_path / "page.html", {"x [m]": (None, 1e6 + 1 + np.exp(3) - 0.1)})
    assert (tmp_path / "page.html").stat().st_size < 400e3
    assert live.data["note"].startswith(f"This page shows a surrogate of {bounds.evaluations} runs, and not the model")
    names = {"simulator": growth()}
    exec(live.browser.run("$('copy').click(), $('copied').textContent"), names)
    assert np.allclose(names["bounds"].upper, bounds.upper, rtol=1e-12, atol=1e-3)
    error, width = bounds.surrogate.error, (bounds.upper - bounds.lower).max(axis=0)
    for value, tolerance in np.array([[[1.0, 0.5], [0.5, 0.5]], [[0.7, 0.4], [0.1, 0.2]]]):
        messages = live.studies((value, tolerance), limits=live.data["limits"])
        (run,), (*_, found, effects) = [m for m in messages if m["kind"] == "run"], messages
        unit = (value - [1.0, 0.5]) / 0.5
        exact = bounds.surrogate.values(unit[None])[0]
        assert np.abs(run["rows"] - exact).max() < SINGLE * width.max()
        lower, upper, _ = bounds.surrogate.range(unit - 2 * tolerance, unit + 2 * tolerance)
        for side, ends in (("lower", lower), ("upper", upper)):
            assert (np.abs(found[side] - ends) <= SINGLE * width).all()
        assert (found["error"] >= 0.999 * error).all()
    (factor,) = [limit["factor"] for limit in effects["limits"]]
    assert factor is None  # larger tolerances would leave the box
    (limit,) = found["limits"]
    assert np.isclose(limit["margin"], 0.3 + np.exp(3) - np.exp(1.6), atol=2 * error[-1, 0] + 1e-6)


@seen
def test_worst_cases_and_factors_at_a_kink(browser, tmp_path):
    """Both are exact in the parts beside the kink of |x - 0.3|, for x = 0.1 ± 0.5. Parameter y has no effect."""
    start = {"x": 0.0, "y": 0.0}
    distance = mb.FunctionSimulator(lambda x, y: np.full((1, 2), abs(x - 0.3)), start, [1.0], ["u", "v"])
    bounds = mb.propagate(distance, mb.PolynomialChaos(), mb.Box(x=(-1.0, 1.0), y=(-1.0, 1.0)))
    live = Live(browser, bounds, tmp_path / "page.html", {"u": (None, 1.0), "v": (0.05, None)})
    *_, found, effects = live.studies(([0.1, 0.0], [0.5, 0.1]), limits=live.data["limits"])
    error = found["error"][0, 0]
    assert len(live.data["surrogate"]["parts"]) > 1 and error < 0.02
    high, low = found["limits"]
    assert np.isclose([high["margin"], low["margin"]], [0.3, -0.05], atol=error).all()
    assert np.isclose([high["parameters"][0], low["parameters"][0]], [-0.4, 0.3], atol=error).all()
    assert np.isclose([own["factor"] for own in effects["limits"]], [1.6, 0.3], atol=3 * error).all()


@seen
def test_a_page_of_polynomials_stays_in_its_box(browser, tmp_path):
    bounds = mb.propagate(growth(1), mb.PolynomialChaos(order=8), mb.Box(k=(0.5, 1.5)))
    bounds.live(tmp_path / "page.html", {"x [m]": (None, 1e6 + 0.5 + np.exp(1.4))})
    browser.open(tmp_path / "page.html")
    browser.run("live.ready")
    words = "$('limits').children[0].children[1].textContent.replaceAll('\u00a0', ' ')"
    assert browser.run(words).startswith("violated: exceeded by 0.42")
    factor = """new Promise(go => { const look = () => $('factor').textContent ? go($('factor').textContent)
                : setTimeout(look, 20); look(); })"""
    assert browser.run(factor) == "With all tolerances 0.8 times as large, the output just reaches the limit."
    browser.run("live.set({k: {value: 1.45, tolerance: 0.05}})")
    assert browser.run(factor) == "The nominal run is already beyond the limit."
    browser.run("live.set({k: {value: 1.2, tolerance: 0.4}})")
    found = browser.run("live.result('x [m]')")
    ends = np.array([found["lower"][0], found["upper"][0]]) - 1e6 - 0.5
    assert np.allclose(ends, np.exp([0.9, 1.5]), rtol=0, atol=1e-6)
    browser.run("live.set({k: {value: 3, tolerance: 0.1}})")
    assert np.isclose(browser.run("live.result('x [m]')")["upper"][0] - 1e6 - 0.5, np.exp(1.5), atol=1e-6)
    assert browser.run("live.set({k: {value: 1, tolerance: 0.2}})") is None and not browser.errors
    assert browser.run(words).startswith("satisfied: smallest margin 0.73")
    assert browser.run(factor) == "With all tolerances 2 times as large, the output just reaches the limit."


@seen
def test_long_curves_have_fewer_times(browser, tmp_path):
    bounds = mb.propagate(growth(5001), mb.PolynomialChaos(order=8), mb.Box(k=(0.5, 1.5), offset=(0.0, 1.0)))
    live = Live(browser, bounds, tmp_path / "page.html")
    n = live.data["n_t"]
    assert (tmp_path / "page.html").stat().st_size < 400e3
    assert f"It has {n} of 5001 times, and decides" in live.data["note"]
    *_, found, _ = live.studies((live.values, live.tolerances))
    rows = np.searchsorted(bounds.t, live.data["times"])
    assert np.abs(found["upper"][:, 0] - bounds.upper[rows, 0]).max() < SINGLE * np.exp(3)


@seen
def test_the_last_change_wins_and_failed_runs_end_a_study(browser, tmp_path):
    scene = shipped("four_bar")
    live = Live(browser, scene, tmp_path / "page.html")
    changes = [(live.values * (1 + 1e-3 * k), live.tolerances) for k in range(20)]
    messages = live.studies(*changes)
    last = [m for m in messages if m["kind"] == "bounds" and m["done"]][-1]
    (alone,) = [m for m in live.studies(changes[-1]) if m["kind"] == "bounds" and m["done"]]
    assert np.array_equal(last["lower"], alone["lower"]) and last["id"] == live.count - 1
    assert sum(m["kind"] == "bounds" and m["done"] for m in messages) == 1
    *_, failed = live.studies((live.values, live.values * 0.9))
    assert "lower" not in failed and "start" in failed["fault"]
    assert not browser.errors
    memory = [live.studies((live.values * (1 + 1e-4 * k), live.tolerances))[-1]["memory"] for k in range(30)]
    assert len({*memory}) == 1


@COMPILED
def test_bounds_and_the_command_write_live_pages(tmp_path, capsys):
    scene = shipped("bouncing_ball")
    mb.propagate(scene, mb.PolynomialChaos(order=2)).live(tmp_path / "a.html")
    assert main(["live", "bouncing_ball", "-o", str(tmp_path / "b.html"), "--limit", "y=:2"]) == 0
    assert '"limits":[{"output":0,"low":null,"high":2.0}]' in (tmp_path / "b.html").read_text()
    for name in "ab":
        assert (tmp_path / f"{name}.html").stat().st_size < 400e3
    page = mb.live(scene)
    assert page is not None and page.text == (tmp_path / "a.html").read_text()


@seen
@pytest.mark.parametrize("given", ["slider_crank", "of_my_crank.py"])
def test_copied_python_is_complete(browser, tmp_path, monkeypatch, given):
    """It runs without further lines, and gives the bounds of the page."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("of_my_crank.py").write_text("import models.slider_crank as own\nscene = own.scene()")
    assert main(["live", given, "-o", "page.html", "--limit", "x_slider=:3.05"]) == 0
    browser.open(tmp_path / "page.html")
    browser.run("live.set({l1: {percent: 1}, l2: {held: true}, m1: {value: 1.5, tolerance: 0.1}})")
    found, names = browser.run("$('copy').click(), live.result('x_slider')"), dict[str, Any]()
    exec(browser.run("$('copied').textContent"), names)
    bounds = names["bounds"]
    for side, values in zip(("lower", "upper"), bounds["x_slider"], strict=True):
        assert np.abs(found[side] - values).max() < 1e-2 * np.ptp(bounds["x_slider"], axis=0).max()
    (limit,) = bounds.check({"x_slider": (None, 3.05)}).limits
    assert bounds.box.names == ("l1", "m1") and bounds.box.percents == {"l1"} and limit.high == 3.05


def _data(page: Page | None) -> dict[str, Any]:
    assert page is not None
    return json.loads(page.text.partition('id="drawing">')[2].partition("</script>")[0])["live"]


@COMPILED
def test_outputs_without_polynomials_are_left_out():
    bounds = mb.propagate(growth(), mb.PolynomialChaos(order=2), mb.Box(k=(0.5, 0.9), offset=(0.5, 0.5)))
    assert bounds.surrogate is not None
    error = bounds.surrogate.error + [0.0, np.inf]
    data = _data(replace(bounds, surrogate=replace(bounds.surrogate, error=error)).live())
    assert [own["name"] for key in ("outputs", "parameters") for own in data[key]] == ["x [m]", "k"]
    assert data["note"].endswith("There are no polynomials for y.")


def test_first_values_are_the_middle_of_the_box(monkeypatch):
    """The run is that of a solver that compiles nothing."""
    own = import_module("symmb.show.live.live")
    monkeypatch.setattr(own, "module", lambda *_: b"")
    monkeypatch.setattr(own, "simulate", lambda motion: mb.simulate(motion.scene, mb.CVODES()))
    scene = state(lambda p, z: -p.k * z, [0.0], 2.0, k=(1.0, 3.0)).with_box(mb.Box(k=(2.0, 4.0)))
    (k,) = _data(mb.live(mb.DAESimulator(scene, mb.DormandPrince())))["parameters"]
    assert (k["value"], k["tolerance"]) == (3.0, 1.0)


NO_BROWSER = """
const told = [], fake = new Proxy(function () {}, { apply: () => fake, construct: () => fake,
  get: (_, key) => key === Symbol.iterator ? function* () {} : key === Symbol.toPrimitive ? () => "" : fake,
  set: (_, key, value) => { if (key === "textContent") told.push(value); return true; } });
const outputs = [{ name: "x", unit: "m" }], limits = [{ output: 0, low: null, high: 1 }];
const worker = { postMessage() {} }, Worker = function () { return worker; };
const live = { n_t: 2, n_y: 1, n_out: 2, times: [0, 3], limits, outputs, parameters: [], columns: [], pictures: [] };
const known = { page: { live, palette: [], runs: [] }, short: String, Blob: fake, URL: fake, Worker };
const scope = new Proxy(known, { has: (_, key) => key in known || !(key in globalThis),
  get: (_, key) => key === Symbol.unscopables ? undefined : known[key] ?? fake });
new Function("scope", `with (scope) (() => { ${require("fs").readFileSync(0)} })()`)(scope);
worker.onmessage({ data: { kind: "run", rows: [0, 9, 2, 9] } });
worker.onmessage({ data: { kind: "bounds", done: true, runs: 1, lower: [], limits: [{ parameters: [] }] } });
console.log(told.join());
"""
"""What a panel says of a run of x = 0 and 2 m, beside numbers 9 of its drawing, if x has to be below 1 m."""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_verdicts_are_those_of_outputs():
    script = (Path(mb.__file__).parent / "show" / "live" / "live.js").read_bytes()
    said = subprocess.run(["node", "-e", NO_BROWSER], input=script, capture_output=True, check=True).stdout
    assert "violated: exceeded by 1\u00a0m at 3\u00a0s" in said.decode()


def test_refusals(monkeypatch):
    scene = shipped("bouncing_ball")
    refused("no box", mb.live, replace(scene, box=None))
    refused("'z'", mb.live, scene, limits={"z": (0, 1)})
    refused("html", mb.live, scene, "page.png")
    refused("no scene and no polynomials", mb.propagate(growth(), mb.Vertex(), mb.Box(k=(0.5, 2.0))).live)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    refused(r"A live page needs the package ziglang. Run `pip install", mb.live, scene, error=NoCompilerError)
