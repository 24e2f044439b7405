"""Live pages by keys alone and by fingers alone: a mechanism, one with contacts, one with jumps, and a function."""

import importlib
import importlib.util
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from browser import NEEDED, Browser

import symmb as mb

COMPILED = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang")
pytestmark = [NEEDED, COMPILED, pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")]
EXAMPLES = Path(mb.__file__).parents[1] / "examples"
CONTROLS = "[...document.querySelectorAll('button, input, select')].filter(e => e.checkVisibility() && !e.disabled)"
FOCUSED = f"""(e => ({{ at: {CONTROLS}.indexOf(e), outline: getComputedStyle(e).outlineStyle,
  seen: (({{ left, right, top, bottom }}) => left >= 0 && right <= innerWidth && top >= 0 && bottom <= innerHeight
    && e.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2)))(e.getBoundingClientRect())
}}))(document.activeElement)"""
SLIDERS = "[...document.querySelectorAll('#panel input[type=range]')]"
THUMB = """(async s => { s.scrollIntoView({ block: 'center' });
  for (let k = 0; k < 2; k++) await new Promise(requestAnimationFrame);  // until the browser knows where the parts are
  const { left, top, width, height } = s.getBoundingClientRect();
  return [left + 8 + (s.value - s.min) / (s.max - s.min) * (width - 16), top + height / 2]; })"""


def slider_crank(path: Path) -> None:
    mb.live(
        importlib.import_module("models.slider_crank").scene(), path, {"x_slider": (None, 3.05), "theta": (-9.0, None)}
    )


def half_car(path: Path) -> None:
    mb.live(importlib.import_module("models.half_car").scene(), path)


def door_latch(path: Path) -> None:
    sys.path.append(str(EXAMPLES))
    own = importlib.import_module("door_latch")
    sys.path.remove(str(EXAMPLES))
    mb.live(own.scene.with_outputs({"angle": own.hinge.angle}), path, {"angle": (None, 1.7)})


def function(path: Path) -> None:
    times = np.linspace(0.0, 2.0, 41)
    decay = mb.FunctionSimulator(
        lambda k, x: x * np.exp(-k * times), mb.Parameters(k=(1.0, "1/s"), x=(2.0, "m")), times, ["x"]
    )
    bounds = mb.propagate(decay, mb.PolynomialChaos(order=4), mb.Box.plus_minus(decay.parameters, k="50%", x=0.5))
    bounds.live(path, {"x": (0.05, None)})


@pytest.fixture(scope="module")
def browser():
    with Browser() as browser:
        yield browser


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
        low, before, high = browser.run(f"(s => [s.min, s.value, s.max].map(Number))({SLIDERS}[{i}])")
        browser.run(f"{SLIDERS}[{i}].focus()")
        browser.press("ArrowRight" if before < high else "ArrowLeft")
        after = browser.run(f"{SLIDERS}[{i}].valueAsNumber")
        assert 0 < (after - before) * (1 if before < high else -1) < 0.1 * (high - low)
    assert browser.run("picture") == 2  # keys of sliders do not move the time
    browser.run("document.activeElement.blur()")
    browser.press("ArrowRight")
    assert browser.run("live.set({}).then(() => picture)") == 3 and not browser.errors


@pytest.mark.parametrize("width", [1200, 390])
def test_fingers_move_sliders_curves_and_the_drawing(browser, path, width):
    opened(browser, path, width)
    for i in range(browser.run(f"{SLIDERS}.length")):
        settle(browser)
        x, y = browser.run(f"{THUMB}({SLIDERS}[{i}])")
        low, before, high = browser.run(f"(s => [s.min, s.value, s.max].map(Number))({SLIDERS}[{i}])")
        to = 25 if before < high else -25
        browser.touch([(x, y)], [(x + to / 2, y)], [(x + to, y)])
        length = browser.run(f"{SLIDERS}[{i}].offsetWidth - 16")
        after = browser.run(f"{SLIDERS}[{i}].valueAsNumber")
        assert after - before == pytest.approx(to / length * (high - low), abs=0.05 * (high - low))
    x, y, width = browser.run("(({ x, y, width }) => [x, y + 50, width])(curves[0].c.getBoundingClientRect())")
    browser.touch([(x + 5, y)], [(x + 0.3 * width, y)], [(x + 0.6 * width, y)])
    assert browser.run("picture / (first.t[1] - 1)") == pytest.approx(0.6, abs=0.05)
    x, y, width, height = browser.run(
        "(({ x, y, width, height }) => [x, y, width, height])(canvas.getBoundingClientRect())"
    )
    assert (width > 0) == (path.stem != "function")  # a function has no drawing
    if width:
        place, (x, y) = "symmb.project([0, 0, 0])", (x + width / 2, y + height / 2)
        before = np.array(browser.run(place))
        browser.touch([(x, y)], [(x + 30, y)], [(x + 30, y - 20)])
        assert np.allclose(np.array(browser.run(place)) - before, [30, -20])
    assert browser.run("live.set({}).then(() => document.scrollingElement.scrollTop)") == 0 and not browser.errors
