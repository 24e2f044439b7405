"""Reports in a browser: nothing fails, nothing is cut, on a screen, on a telephone and on paper."""

import base64
import re

import numpy as np
import pytest
from browser import NEEDED, browser_of_a_module

import symmb as mb
from models import double_pendulum

browser = browser_of_a_module
pytestmark = [NEEDED, pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")]
SCREEN, TELEPHONE, PAPER = 1200, 390, 694
"""Widths [px]; that of paper is A4 within its margins."""
DPI, LETTERS = 150, 8
"""Resolution of pictures [1/inch], and height of their letters [point]."""
MOST_PAGES, MOST_BYTES = 6, 5_000_000


def pendulum():
    scene = double_pendulum.scene().with_times(np.linspace(0, 1, 51))
    return mb.propagate(scene, mb.PolynomialChaos()), {"y2": (None, 1.6), "x1": (-0.5, 0.5)}


def black_box():
    t = np.linspace(0.0, 1.0, 51)
    names = ["a name of an output that is as long as names of outputs may well be", "y"]
    decay = mb.FunctionSimulator(lambda k: np.exp(-k * t[:, None] * [1, 2]), {"k": 1.0}, t, names)
    return mb.propagate(decay, mb.PolynomialChaos(), mb.Box(k=(0.5, 2.0))), {"y": (0.2, None)}


def many():
    """Thirty outputs with long names, of which a third violates its limit."""
    t, names = np.linspace(0.0, 1.0, 11), [f"a rather long name of the output number {k}" for k in range(30)]
    growth = mb.FunctionSimulator(lambda k, m: np.outer(t, k * np.arange(30) + m), {"k": 1.0, "m": 1.0}, t, names)
    bounds = mb.propagate(growth, mb.PolynomialChaos(), mb.Box(k=(0.9, 1.1), m=(0.9, 1.1)))
    return bounds, {name: (None, 20.0) for name in names}


def comparison():
    scene = double_pendulum.scene().with_times(np.linspace(0, 1, 51))
    return mb.compare(scene, [mb.PolynomialChaos(), mb.Vertex(), mb.MonteCarlo(10)]), None


@pytest.fixture(scope="module", params=[pendulum, black_box, many, comparison])
def path(request, tmp_path_factory):
    result, limits = request.param()
    path = tmp_path_factory.mktemp("report") / "r.html"
    result.report(path, *([limits] if limits else []))
    return path


def opened(browser, path, width, media="screen", features=(), height=900):
    browser._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
    browser._call("Emulation.setEmulatedMedia", media=media, features=[*features])
    browser.open(path)


@pytest.mark.parametrize(("width", "scheme"), [(SCREEN, "light"), (TELEPHONE, "dark")])
def test_on_a_screen(browser, path, width, scheme):
    opened(browser, path, width, features=[{"name": "prefers-color-scheme", "value": scheme}])
    assert browser.run("document.documentElement.scrollWidth") <= width
    of_checks = "[...document.querySelectorAll('.limits, .limits *')]"
    assert browser.run(f"{of_checks}.every(e => e.scrollWidth <= e.clientWidth || !e.clientWidth)")
    light = [int(x) > 128 for x in re.findall(r"\d+", browser.run("getComputedStyle(document.body).backgroundColor"))]
    assert light == [scheme == "light"] * 3
    pictures = "[...document.querySelectorAll('.pictures img')]"
    letters = browser.run(f"{pictures}.map(e => e.clientWidth / e.naturalWidth * {DPI} * {LETTERS} / 72)")
    columns = browser.run(f"new Set({pictures}.map(e => e.getBoundingClientRect().left)).size")
    assert all(height > 8.5 for height in letters)
    if letters:
        assert columns == 1 if width == TELEPHONE else columns > 1
    assert not browser.errors


def test_on_paper(browser, path):
    opened(browser, path, PAPER, "print")
    assert browser.run("document.documentElement.scrollWidth") <= PAPER
    hidden = "[...document.querySelectorAll('iframe, details, summary')]"
    assert browser.run(f"{hidden}.every(e => !e.getClientRects().length)")
    heads = "[...document.querySelectorAll('h2, .contributions pre')]"  # none stands alone at the foot of a page
    assert browser.run(f"{heads}.every(e => getComputedStyle(e).breakAfter === 'avoid')")
    assert browser.run("[...document.querySelectorAll('.printed img')].every(e => e.clientHeight > 100)")
    sheets = base64.b64decode(browser._call("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", sheets)) <= MOST_PAGES
    assert path.stat().st_size <= MOST_BYTES


def test_the_inner_page_works(browser, tmp_path):
    """Its scripts run without an error. The browser shows it in a process of its own, so it is opened alone here."""
    bounds, limits = pendulum()
    bounds.report(tmp_path / "r.html", limits)
    opened(browser, tmp_path / "r.html", TELEPHONE, height=640)
    (tmp_path / "inner.html").write_text(browser.run("document.querySelector('iframe').srcdoc"))
    browser.open(tmp_path / "inner.html")
    assert browser.run("symmb.parts().length") > 3
    assert browser.run("document.getElementById('view').clientWidth") > 0.9 * TELEPHONE
    assert not browser.errors
