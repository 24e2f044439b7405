"""Live pages: their panel with a worker of known answers, all parts after many moves, and keys and fingers alone."""

import importlib
import json
import runpy
import time
from pathlib import Path

import numpy as np
import pytest
from browser import COMPILED, NEEDED, Browser, browser_of_a_module
from faults import refused
from problems import model

import symmb as mb
from symmb.show.drawing import Page

pytestmark = [NEEDED, pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")]
browser = browser_of_a_module
RIGHT_TO_LEFT = "\u05d0\u05d5\u05e8\u05da"
HOSTILE = "\"'</script><img src=x onerror=document.title='HIT'>&lt;" + 10_000 * "W"
FAKE = """
// y = g t / 10 with bounds +- tolerance t / 10. Odd studies answer later than the even studies after them.
let live;
onmessage = ({ data: { kind, id, values, tolerances, limits, live: given } }) => {
  if (kind === "start") { live = given; return; }
  const { n_t, n_y, n_out } = live, of = slope => live.times.map(t => slope * t / 10), [g] = values, [r] = tolerances;
  const rows = slope => {
    const all = new Float64Array(n_t * n_out);
    of(slope).forEach((y, k) => { all[k * n_out] = all[k * n_out + 1] = y; });
    return all;
  };
  setTimeout(() => {
    const fault = values[1] < 0 ? "The mass is negative." : null;
    postMessage({ kind: "run", id, rows: rows(fault ? NaN : g), finished: fault ? 1 : n_t, fault, ms: 1 });
    if (fault) return;
    const lower = new Float64Array(n_t * n_y), upper = lower.slice(), error = upper.slice().fill(1e-3);
    of(g - r).forEach((y, k) => lower.fill(y, k * n_y, k * n_y + n_y));
    of(g + r).forEach((y, k) => upper.fill(y, k * n_y, k * n_y + n_y));
    const told = limits.map(limit => ({ ...limit, side: "high", margin: limit.high - (g + r) / 10, time: n_t - 1,
      error: 1e-3, value: (g + r) / 10, parameters: [g + r, values[1]], rows: rows(g + r) }));
    postMessage({ kind: "bounds", id, runs: 9, lower, upper, error, done: true, ms: 2, limits: told });
    postMessage({ kind: "effects", id, widths: new Float64Array(2 * n_y).fill(r / 5),
      limits: limits.map(({ high }) => ({ widths: [r / 5, 0], factor: r && (10 * high - g) / r })) });
  }, id % 2 ? 40 : 5);
};
"""


FIELD = "document.querySelector('#parameters input[type=number]')"
SLIDER = "document.querySelector('#parameters input[type=range]')"
HOLD = "document.querySelector('#parameters input[type=checkbox]')"
"""Controls of the first parameter, g."""


def falling(*names: str) -> mb.Scene:
    p = mb.Parameters(g=9.0, m=2.0)
    ball = mb.Body("ball", mass=p.m, pose=mb.Particle())
    outputs, system = dict(zip(names, (ball.y, ball.vy), strict=True)), mb.System(ball, mb.Gravity(0, -p.g))
    return mb.Scene(system, times=np.linspace(0.0, 1.0, 11), outputs=outputs, box=mb.Box(g=(8.5, 9.5)), name="fall")


@pytest.fixture
def page(browser, tmp_path, monkeypatch):
    """A page with limit y <= 1 and a worker of known answers."""
    return _faked(browser, tmp_path, monkeypatch, "y", "v")


def _faked(browser: Browser, folder: Path, monkeypatch: pytest.MonkeyPatch, *names: str, hostile: str = "") -> Browser:
    monkeypatch.setattr(importlib.import_module("symmb.show.live.live"), "module", lambda *_: b"")
    path = folder / "page.html"
    mb.live(falling(*names), path, {names[0]: (None, 1.0)})
    begin, text = '<script type="text/plain" id="worker">\n', path.read_text(encoding="utf-8")
    before, _, after = text.partition(begin)
    text = f"{before}{begin}{FAKE}</script>{after.partition('</script>')[2]}"
    if hostile:
        text = text.replace('{"name":"g",', f'{{"name":{json.dumps(hostile)},'.replace("<", "\\u003c"))
    path.write_text(text, encoding="utf-8")
    browser.resize(1200, 800)
    browser.open(path)
    browser.run("live.ready")
    return browser


def _limit(browser: Browser, part: int = 1) -> str:
    return browser.run(f"$('limits').children[0].children[{part}].textContent").replace("\N{NO-BREAK SPACE}", " ")


def _end(browser: Browser, side: str) -> float:
    """The last value of y."""
    return browser.run(f"live.result('y').{side}[10]")


def _moves(browser: Browser, change: str) -> None:
    """A change, and the time until the address has the state."""
    browser.run(f"live.set({change}); new Promise(go => setTimeout(go, 400))")


def test_a_move_gives_a_new_run_bounds_and_words(page):
    assert _limit(page) == "satisfied: smallest margin 0.05 m at 1 s, error up to 0.001 m"
    page.run("live.set({g: {value: 9.2, tolerance: 0.1}})")
    found = page.run("live.result('y')")
    times = np.linspace(0.0, 1.0, 11)
    for name, slope in {"nominal": 9.2, "lower": 9.1, "upper": 9.3}.items():
        assert np.allclose(found[name], slope * times / 10, rtol=1e-12)
    assert np.allclose(found["times"], times) and found["estimate"] == [1e-3] * 11
    assert _limit(page) == "satisfied: smallest margin 0.07 m at 1 s, error up to 0.001 m"
    assert page.run("numbers[page.bounds.upper[0] + 10 * 2]") == pytest.approx(0.93)  # of the viewer
    assert [page.run(f"numbers[page.runs[{k}].values[0] + 10 * 2]") for k in range(2)] == pytest.approx([0.92, 0.93])
    page.run("live.set({g: {tolerance: 0.7995}})")
    told = "undecided: margin 5.00e-5 m at 1 s, error up to 0.001 m. The polynomials are too inaccurate here, as near"
    assert _limit(page) == f"{told} jumps. bounds.check in Python can decide."
    page.run("live.set({g: {tolerance: 0.9}})")
    assert _limit(page) == "violated: exceeded by 0.01 m at 1 s"
    page.run("new Promise(go => { const look = () => $('factor').textContent ? go() : setTimeout(look, 20); look(); })")
    factor = page.run("$('factor').textContent")
    assert factor == "With all tolerances 0.889 times as large, the output just reaches the limit."
    assert page.run("runs.length") == 2 and page.errors == []
    page.run("live.set({g: {value: 1234.567, tolerance: 0.001}})")
    assert _limit(page, 2) == "worst case: \u2068g\u2069 = 1234.568"  # not rounded to a value beyond the tolerance


def test_sliders_fields_and_resets(page):
    page.run(f"{SLIDER}.value = 5.0012; {SLIDER}.oninput(); live.set({{}})")
    assert _end(page, "nominal") == pytest.approx(0.5)  # in steps
    assert page.run(f"{FIELD}.value") == "5"
    for text, value in {"7.25": 0.725, "": 0.725}.items():
        page.run(f"{FIELD}.value = '{text}'; {FIELD}.onchange(); live.set({{}})")
        assert _end(page, "nominal") == pytest.approx(value)
    page.run(f"{HOLD}.click(); live.set({{}})")
    assert _end(page, "upper") == pytest.approx(0.725)  # a parameter that is held is not varied
    assert page.run("$('state').textContent").endswith(". Held at the value, without tolerance: \u2068g\u2069.")
    assert page.run(f"{HOLD}.parentElement.textContent") == "hold at this value"
    page.run("$('reset').click(); live.set({})")
    assert _end(page, "upper") == pytest.approx(0.95)
    lines = page.run("live.csv()").splitlines()
    assert len(lines) == 12 and lines[0].startswith('"time [s]","y [m]","y [m] lower"') and page.errors == []


TOLERANCE = """(row => [row.querySelector('input[type=number]').valueAsNumber, row.querySelector('small').textContent,
  row.querySelector('select').value])(document.querySelector('.tolerance'))"""
"""Number, remark and kind of the first tolerance."""
KIND = "(kind => {{ kind.value = '{}'; kind.onchange(); }})(document.querySelector('.tolerance select'))"


def test_a_tolerance_keeps_its_kind(page):
    """In percent it follows the value, and the page states the other kind."""
    page.run("live.set({g: {value: 10}})")
    assert page.run(TOLERANCE) == [0.5, "= 5\N{NO-BREAK SPACE}%", ""]
    page.run(KIND.format("%"))
    for value in (10, 5, -8, 0, 4):
        page.run(f"live.set({{g: {{value: {value}}}}})")
        assert _end(page, "upper") == pytest.approx(value / 10 + abs(value) / 200)
        assert page.run(TOLERANCE) == [5, f"= {abs(value) / 20:g}", "%"]
    page.run(KIND.format(""))
    page.run("live.set({g: {value: 2}})")
    assert page.run(TOLERANCE) == [0.2, "= 10\N{NO-BREAK SPACE}%", ""]
    page.run("$('reset').click()")
    assert page.run(TOLERANCE) == [0.5, "= 5.556\N{NO-BREAK SPACE}%", ""] and page.errors == []


def test_a_click_on_a_limit_shows_its_worst_case(page):
    page.run("live.set({g: {value: 9.8, tolerance: 0.5}})")  # the run with 10.3 exceeds y <= 1 most at the end
    page.run("symmb.play(true); $('curves').style.height = '140px'; $('curves').scrollTop = 400")
    assert page.run("$('curves').scrollTop") > 50
    page.run("$('limits').children[0].click()")
    assert page.run("[picture, playing, $('curves').scrollTop < 20]") == [10, False, True]
    assert page.run("page.mark") == {"output": 0, "time": 1.0}
    current = "[...document.querySelectorAll('#curves [aria-current=true] p')].map(p => p.firstChild.data)"
    assert page.run(current) == ["y [m]"]
    page.run("symmb.seek(3); live.set({g: {value: 9}})")
    assert page.run("picture") == 3  # only a click moves the time


@pytest.mark.parametrize("held", [False, True])
def test_copied_python_gives_the_study_of_the_page(page, held, capsys):
    page.run(f"live.set({{g: {{value: 10, percent: 4}}, m: {{value: 3, tolerance: 0.5, held: {str(held).lower()}}}}})")
    page.run("$('copy').click()")
    code = page.run("$('copied').textContent")
    assert "held" not in code and code.splitlines()[1] == '# scene: the scene "fall" of this page'
    names = {"scene": falling("y", "v")}
    exec(code, names)
    assert names["bounds"].box.intervals == {"g": (9.6, 10.4)} | ({} if held else {"m": (2.5, 3.5)})
    assert dict(names["bounds"].nominal_parameters) == {"g": 10.0, "m": 3.0}
    assert "y <= 1 m  satisfied" in capsys.readouterr().out  # the ball of the scene falls; that of the worker rises


def test_the_last_move_wins(page):
    moves = ";".join(f"live.set({{g: {{value: {value}}}}})" for value in (5, 6, 7, 8))  # the last one answers first
    page.run(f"{moves}; new Promise(go => setTimeout(go, 100))")
    assert _end(page, "nominal") == pytest.approx(0.8)
    assert page.run("numbers[page.runs[0].values[0] + 20]") == pytest.approx(0.8)


def test_the_address_keeps_the_state(page):
    _moves(page, "{g: {value: 9.25}, m: {value: 3, percent: 5, held: true}}")
    assert page.run("location.hash") == "#p0=9.25,0.5&p1=3,5%,held"
    path = Path(page.run("decodeURI(location.pathname)"))
    page.open(path, "p0=9.25,0.5&p1=3,5%,held")
    page.run("live.ready")
    assert _end(page, "upper") == pytest.approx(0.975)
    held = page.run("[...document.querySelectorAll('#parameters input[type=checkbox]')].map(box => box.checked)")
    assert held == [False, True]
    _moves(page, "{m: {held: false}}")
    assert page.run("location.hash") == "#p0=9.25,0.5&p1=3,5%"
    page.open(path, "p0=nonsense,-1&p1=&p9=3&focus=99")  # of another page
    page.run("live.ready")
    assert _end(page, "nominal") == pytest.approx(0.9) and page.errors == []


def test_state_in_the_address_does_not_stop_the_animation(page):
    path = Path(page.run("decodeURI(location.pathname)"))
    for fragment, playing in (("p0=9.25,0.5", True), ("p0=9.25,0.5&t=0.4", False)):
        page.open(path, fragment)
        page.run("live.ready")
        assert page.run("playing") == playing


def test_pages_work_in_frames_of_notebooks(page, tmp_path):
    """The frame is a sandbox: it has neither an origin nor an address of its own."""
    text = Path(page.run("decodeURI(location.pathname)")).read_text(encoding="utf-8")
    told = "live.set({g: {value: 9.2}}).then(() => parent.postMessage(live.result('y').nominal[10], '*'))"
    frame = Page("fall", text.replace("</body>", f"<script>{told}</script></body>"))._repr_html_()
    said = "<script>window.said = new Promise(go => onmessage = e => go(e.data))</script>"
    (tmp_path / "book.html").write_text(f"<!DOCTYPE html>{said}{frame}")
    page.open(tmp_path / "book.html")
    assert page.run("said") == pytest.approx(0.92) and page.errors == []


def test_a_failed_run_is_stated_and_not_hidden_behind_an_older_one(page):
    said = page.run("live.set({m: {value: -1}}).catch(error => error.message)")
    assert said == page.run("$('state').textContent")
    assert said.replace("\N{NO-BREAK SPACE}", " ") == "The run ended at 0 s: The mass is negative."
    shown = "[page.runs[0].values[0], page.bounds.upper[0]].map(from => String(numbers[from + 20]))"
    assert page.run(shown) == ["NaN", "NaN"] and page.run("runs.length") == 1
    page.run("play(false); symmb.seek(5)")  # numbers are drawn less often while a page plays
    assert page.run("curves.map(curve => curve.value.textContent)") == ["\N{EN DASH}"] * 2


def test_changes_by_scripts_are_checked_before_they_are_made(page):
    for change in ("{g: {value: 5}, x: {value: 1}}", "{g: {value: NaN}}", "{g: {tolerance: -1}}"):
        told = r"There is no parameter x|Parameter g needs"
        refused(told, page.run, f"live.set({change})", error=RuntimeError)
    page.run("live.set({})")
    assert _end(page, "upper") == pytest.approx(0.95)


def test_a_fault_of_an_older_study_is_not_told(page):
    page.run("live.set({m: {value: -1}}); live.set({m: {value: 2}})")
    assert page.run("$('state').textContent").startswith("9 runs, error of \u2068y")


@pytest.mark.parametrize("width", [1200, 390])
def test_names_are_only_texts(browser, tmp_path, monkeypatch, width):
    page = _faked(browser, tmp_path, monkeypatch, "y <b>'\"", "v", hostile=HOSTILE)
    page.resize(width, 800)
    time.sleep(0.1)
    seen = page.run("[document.title, document.images.length, document.scripts.length]")
    assert seen == ["fall", 0, 4]
    assert page.run("document.querySelector('legend').firstChild.data.length") == len(HOSTILE)
    assert page.run("document.documentElement.scrollWidth") <= width
    boxes = page.run(
        "['main', '#panel', '#curves', 'footer'].map(s => document.querySelector(s).getBoundingClientRect())"
        ".map(({ left, top, right, bottom }) => [left, top, right, bottom])"
    )
    for i, (left, top, right, bottom) in enumerate(boxes):
        assert right - left > 150 and bottom - top > 30 and bottom <= 801
        assert all(left >= b[2] - 1 or right <= b[0] + 1 or top >= b[3] - 1 or bottom <= b[1] + 1 for b in boxes[:i])
    assert page.run("document.querySelector('#panel').scrollWidth <= document.querySelector('#panel').clientWidth + 1")
    assert page.errors == []


def test_names_from_right_to_left_do_not_reverse_limits(browser, tmp_path, monkeypatch):
    """The sign and the number of the limit stay at the right of the name."""
    page = _faked(browser, tmp_path, monkeypatch, RIGHT_TO_LEFT, "v", hostile=RIGHT_TO_LEFT)
    left = page.run(
        "(text => [...text.data].map((_, i) => { const at = new Range(); at.setStart(text, i); at.setEnd(text, i + 1);"
        " return at.getBoundingClientRect().left; }))($('limits').querySelector('b').firstChild)"
    )
    text = page.run("$('limits').querySelector('b').textContent")
    assert left[text.index("\u05d0")] < left[text.index("≤")] < left[text.index("1")] and page.errors == []


def test_keys_of_the_panel_do_not_move_the_time(page):
    page.run("symmb.play(false); symmb.seek(3)")
    page.run("$('focus').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }))")
    page.run(f"{HOLD}.dispatchEvent(new KeyboardEvent('keydown', {{ key: ' ', bubbles: true, cancelable: true }}))")
    assert page.run("[picture, playing]") == [3, False]


@COMPILED
def test_memory_does_not_grow_with_moves(browser, tmp_path):
    path = tmp_path / "page.html"
    mb.live(model("slider_crank"), path, {"theta": (None, 1.2)})
    browser.open(path)
    browser.run("live.ready.then(() => symmb.play(false))")
    moves = (
        "(async () => { for (let k = 0; k < 20; k++) {"
        " const done = live.set({l1: {value: 0.9 + 0.2 * Math.random()}}); if (k % 10 === 9) await done;"
        " else await new Promise(go => setTimeout(go, 5)); } })()"
    )
    memory = []  # [MB]. On a busy machine, the browser keeps another MB now and then, so medians are compared
    for _ in range(12):
        browser.run(moves)
        memory.append(browser.memory())
    assert np.median(memory[-5:]) < np.median(memory[:5]) + 0.5 and browser.errors == []


EXAMPLES = Path(mb.__file__).parents[1] / "examples"
CONTROLS = "[...document.querySelectorAll('button, input, select')].filter(e => e.checkVisibility() && !e.disabled)"
FOCUSED = f"""(e => ({{ at: {CONTROLS}.indexOf(e), outline: getComputedStyle(e).outlineStyle,
  seen: (({{ left, right, top, bottom }}) => left >= 0 && right <= innerWidth && top >= 0 && bottom <= innerHeight
    && e.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2)))(e.getBoundingClientRect())
}}))(document.activeElement)"""
SLIDERS = "[...document.querySelectorAll('#panel input[type=range]')]"
RANGE = f"(s => [s.min, s.value, s.max].map(Number))({SLIDERS}[{{}}])"
THUMB = """(async s => { s.scrollIntoView({ block: 'center' });
  for (let k = 0; k < 2; k++) await new Promise(requestAnimationFrame);  // until the browser knows where the parts are
  const { left, top, width, height } = s.getBoundingClientRect();
  return [left + 8 + (s.value - s.min) / (s.max - s.min) * (width - 16), top + height / 2]; })"""


def slider_crank(path: Path) -> None:
    mb.live(model("slider_crank"), path, {"x_slider": (None, 3.05), "theta": (-9.0, None)})


def half_car(path: Path) -> None:
    mb.live(model("half_car"), path)


def door_latch(path: Path) -> None:
    own = runpy.run_path(str(EXAMPLES / "door_latch.py"))
    mb.live(own["scene"].with_outputs({"angle": own["hinge"].angle}), path, {"angle": (None, 1.7)})


def function(path: Path) -> None:
    times = np.linspace(0.0, 2.0, 41)
    p = mb.Parameters(k=(1.0, "1/s"), x=(2.0, "m"))
    decay = mb.FunctionSimulator(lambda k, x: x * np.exp(-k * times), p, times, ["x"])
    bounds = mb.propagate(decay, mb.PolynomialChaos(order=4), mb.Box.plus_minus(decay.parameters, k="50%", x=0.5))
    bounds.live(path, {"x": (0.05, None)})


@pytest.fixture(scope="module", params=[slider_crank, half_car, door_latch, function], ids=lambda make: make.__name__)
def path(request, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("pages") / f"{request.param.__name__}.html"
    request.param(path)
    return path


def opened(browser: Browser, path: Path, width: int) -> None:
    browser.resize(width, 800)
    browser.open(path)
    browser.run("symmb.play(false)")
    settle(browser)


def settle(browser: Browser) -> None:
    """Wait for the last texts of a study, which move the controls below them."""
    browser.run("live.set({})")
    while browser.run("[...document.querySelectorAll('.bar small')].some(e => e.textContent === '…')"):
        time.sleep(0.01)


@COMPILED
@pytest.mark.parametrize("width", [1200, 390])
def test_keys_reach_and_move_all_controls(browser, path, width):
    opened(browser, path, width)
    count, reached = browser.run(f"{CONTROLS}.length"), []
    for _ in range(count + 3):  # the list of curves scrolls by keys too
        browser.press("Tab")
        focused = browser.run(FOCUSED)
        if focused["at"] < 0 or focused["at"] in reached:
            continue
        reached.append(focused["at"])
        assert focused["outline"] != "none" and focused["seen"], focused
    assert reached == list(range(count))
    browser.run("symmb.seek(2)")
    for i in range(browser.run(f"{SLIDERS}.length")):
        low, before, high = browser.run(RANGE.format(i))
        browser.run(f"{SLIDERS}[{i}].focus()")
        browser.press("ArrowRight" if before < high else "ArrowLeft")
        after = browser.run(f"{SLIDERS}[{i}].valueAsNumber")
        assert 0 < (after - before) * (1 if before < high else -1) < 0.1 * (high - low)
    assert browser.run("picture") == 2  # keys of sliders do not move the time
    browser.run("document.activeElement.blur()")
    browser.press("ArrowRight")
    assert browser.run("live.set({}).then(() => picture)") == 3 and not browser.errors


@COMPILED
@pytest.mark.parametrize("width", [1200, 390])
def test_fingers_move_sliders_curves_and_the_drawing(browser, path, width):
    opened(browser, path, width)
    for i in range(browser.run(f"{SLIDERS}.length")):
        settle(browser)
        x, y = browser.run(f"{THUMB}({SLIDERS}[{i}])")
        low, before, high = browser.run(RANGE.format(i))
        to = 25 if before < high else -25
        browser.touch([(x, y)], [(x + to / 2, y)], [(x + to, y)])
        length = browser.run(f"{SLIDERS}[{i}].offsetWidth - 16")
        after = browser.run(f"{SLIDERS}[{i}].valueAsNumber")
        assert after - before == pytest.approx(to / length * (high - low), abs=0.05 * (high - low))
    place = "(({{ x, y, width, height }}) => [x, y, width, height])({}.getBoundingClientRect())"
    x, y, width, _ = browser.run(place.format("curves[0].c"))
    y += 50
    browser.touch([(x + 5, y)], [(x + 0.3 * width, y)], [(x + 0.6 * width, y)])
    assert browser.run("picture / (first.t[1] - 1)") == pytest.approx(0.6, abs=0.05)
    x, y, width, height = browser.run(place.format("canvas"))
    assert (width > 0) == (path.stem != "function")  # a function has no drawing
    if width:
        place, (x, y) = "symmb.project([0, 0, 0])", (x + width / 2, y + height / 2)
        before = np.array(browser.run(place))
        browser.touch([(x, y)], [(x + 30, y)], [(x + 30, y - 20)])
        assert np.allclose(np.array(browser.run(place)) - before, [30, -20])
    assert browser.run("live.set({}).then(() => document.scrollingElement.scrollTop)") == 0 and not browser.errors
