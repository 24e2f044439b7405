"""The guide, the examples and the README: their code runs and does what they say, and links lead somewhere.

Results in a notebook are tables, typeset equations and pictures, and long work shows its progress there or not.
"""

import inspect
import io
import re
import runpy
import sys
import time
from html import unescape
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from machines import ball, rods

import symmb as mb
from symmb._progress import Progress
from symmb.bound.responses.worst_case import Worst, WorstCase

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "examples" / "guide"
PAGES = sorted(GUIDE.glob("*.md"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"[-+]?\d[\d.e+-]*")
CODE = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
WITH_CODE = [page for page in PAGES if CODE.search(page.read_text(encoding="utf-8"))]
"""Notebooks, which have cells in the place of blocks, run where the site is built: `test_site.py`."""


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.stem)
def test_code(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "guide"}
    for block in CODE.findall(page.read_text(encoding="utf-8")):
        exec(block, namespace)
    plt.close("all")


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.stem)
def test_links(page):
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        assert "://" in target or (page.parent / target).exists(), target


COLUMNS = 95
"""Of code: more do not fit into the site's column of text."""


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.stem)
def test_code_fits_into_its_column(page):
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```.*\n([\s\S]*?)^```|^((?: {4}.*\n)+)", text, re.MULTILINE)
    lines = [line for block in blocks for line in "".join(block).splitlines()]
    # README's commands are one line each, for one copy; the site breaks them where its column ends.
    assert not [line for line in lines if len(line) > COLUMNS and "python3 -m venv" not in line]


LISTS = "index", "changes"


@pytest.mark.parametrize("page", [page for page in PAGES if page.stem not in LISTS], ids=lambda page: page.stem)
def test_every_page_ends_with_where_to_go_next(page):
    end = page.read_text(encoding="utf-8").split("\n## ")[-1]
    assert end.startswith("Where to go next\n") and "](" in end


def test_every_page_is_in_the_index():
    index = (GUIDE / "index.md").read_text(encoding="utf-8")
    assert {page.name for page in PAGES} == {"index.md", *re.findall(r"\]\((\w+\.md)\)", index)}


CONF = (GUIDE / "conf.py").read_text(encoding="utf-8")
LONG = re.findall(r'"(\w+)"', re.findall(r"^LONG = (.*)$", CONF, re.MULTILINE)[0])


@pytest.mark.long
@pytest.mark.parametrize("name", LONG)
def test_example(name):
    """The others run where the site is built: `test_site.py`."""
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="example")


def test_code_of_the_readme(capsys, tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 1 and len(blocks[0].splitlines()) <= 30
    script = (ROOT / "examples" / "rod_on_a_spring.py").read_text(encoding="utf-8")
    assert blocks[0].removeprefix("import numpy as np\n") in script
    namespace = {}
    exec(blocks[0], namespace)
    (said,), printed = re.findall(r"It prints\n\n```text\n(.*?)```", README, re.DOTALL), capsys.readouterr().out
    assert NUMBER.sub("#", said).split() == NUMBER.sub("#", printed).split()
    for a, b in zip(NUMBER.findall(said), NUMBER.findall(printed), strict=True):
        assert a == b or float(a) == pytest.approx(float(b), rel=0.02)
    lower, upper = namespace["bounds"]["tip_y"]
    run = namespace["run"]["tip_y"]
    assert (lower <= run + 1e-6).all() and (run <= upper + 1e-6).all()
    monkeypatch.chdir(tmp_path)
    views = re.search(r"(    mb\.view.*?)\n\n", README, re.DOTALL)
    assert views is not None
    exec(re.sub("^    ", "", views[1], flags=re.MULTILINE), namespace)
    assert {path.name for path in tmp_path.iterdir()} == {"rod.html", "report.html"}


TIMES = np.array([0.0, 1.0])


def packages():
    """Of notebooks; without them a test is skipped."""
    return [pytest.importorskip(name) for name in ("nbclient", "nbformat", "ipykernel")]


def example():
    """The first block of Python in the README, without its prints."""
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    return "\n".join(line for line in code.splitlines() if not line.startswith("print("))


CELLS = {
    "system": "system",
    "scene": "scene",
    "run": "run",
    "bounds": "bounds",
    "comparison": "comparison = mb.compare(scene, [mb.PolynomialChaos(), mb.Vertex()]); comparison",
    "box": "scene.box",
    "parameters": "p",
    "worst cases": 'bounds.worst("tip_y")',
    "a worst case": 'bounds.worst("tip_y").lower',
    "moments": "mb.propagate(scene, mb.PolynomialChaos(order=3)).moments()",
    "expansion": "mb.propagate(scene, mb.PolynomialChaos(order=3)).expansion",
    "drawing": "mb.view(bounds, point=tip)",
    "figure": 'run.plot(outputs="tip_y")',
    "figure of bounds": "bounds.plot()",
    "figure of a comparison": "comparison.plot()",
}


@pytest.fixture(scope="module")
def notebook(tmp_path_factory):
    nbclient, nbformat, _ = packages()
    cells = [nbformat.v4.new_code_cell(source) for source in (example(), *CELLS.values())]
    book = nbformat.v4.new_notebook(cells=cells)
    folder = str(tmp_path_factory.mktemp("notebook"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TQDM_DISABLE", "1")  # whether a bar appears depends on the machine's speed
        nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": folder}}).execute()
    return book


@pytest.fixture
def shown(notebook):
    def shown(name):
        cell = notebook.cells[1 + list(CELLS).index(name)]
        (data,) = [output.data for output in cell.outputs if output.output_type == "execute_result"]
        return data

    return shown


def test_no_cell_fails_or_writes_noise(notebook):
    for cell in notebook.cells:
        kinds = [output.output_type for output in cell.outputs]
        assert kinds in ([], ["execute_result"]), cell.outputs


def test_equations_are_typeset(shown):
    page = shown("system")["text/html"]
    assert page.count("$$") == 2 * 8  # the equation of motion, its unknowns, M, Q, Phi, Phi_q, gamma, and names
    assert r"\theta_{\mathrm{rod}}" in page
    assert "1 Revolute" in page


SMALL = "box", "parameters", "worst cases", "a worst case", "moments", "expansion"


@pytest.mark.parametrize("name", ["scene", "run", "bounds", "comparison", *SMALL])
def test_results_are_tables(shown, name):
    page = shown(name)["text/html"]
    parts = ("length", "stiffness") if name in SMALL else ("tip_y", "data:image/png;base64,")
    assert all(part in page for part in ("<table", *parts))


def test_a_drawing_is_a_page_of_its_own(shown):
    html = shown("drawing")["text/html"]
    frame = re.fullmatch('<iframe srcdoc="([^"<>]*)" title="drawing of rod on a spring"[^<>]*></iframe>', html)
    page = unescape(frame[1])
    assert page.startswith("<!DOCTYPE html>") and "rod on a spring" in page and page.rstrip().endswith("</html>")


def test_a_file_is_written_without_a_page(tmp_path):
    fall = ball(g=None).scene(name="<b>&")
    assert mb.view(fall, tmp_path / "fall.html") is None
    page = mb.view(fall)
    assert page is not None and page.text == (tmp_path / "fall.html").read_text(encoding="utf-8")
    assert "<b>" not in page._repr_html_() and 'title="drawing of &lt;b&gt;&amp;"' in page._repr_html_()


def test_modes_are_a_table():
    steel = mb.Material(E=2.1e11, density=7850.0, nu=0.3)
    rod = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.01), steel, elements=4)
    modes = mb.FiniteElements.beams(rod).modes(count=2)
    page = modes._repr_html_()
    assert page.count("<tr>") == 1 + len(modes.stiffness) and f"{modes.frequencies[0]:.6g}" in page


@pytest.mark.parametrize("name", [name for name in CELLS if name.startswith("figure")])
def test_figures_show_without_magic(shown, name):
    assert len(shown(name)["image/png"]) > 10_000


def test_texts_of_names_are_no_markup():
    rod = mb.Body("<b>rod</b>", mass=1.0, inertia=0.1)
    page = mb.Scene(mb.System(rod), outputs={"a<i>$x$": rod.x + rod.y})._repr_html_()
    assert "<i>" not in page and "<b>" not in page
    assert 'class="tex2jax_ignore mathjax_ignore"' in page
    box = mb.Box(**{"a<i>$x$": (0.0, 1.0)})
    case = WorstCase("<b>y", "lower", 0.0, 0.0, {"a<i>$x$": 0.5}, 0.0, 1.0, box.names)
    t, values = np.zeros(1), np.ones((1, 1))
    moments = mb.Moments(t, ("<b>y",), box.names, values, values, values[None], values[None])
    expansion = mb.Expansion(np.zeros((1, 1)), np.ones((1, 1, 1)), box.names)
    for result in (box, case, Worst(case, case), moments, expansion):
        page = result._repr_html_()
        assert "<i>" not in page and "<b>" not in page and "a&lt;i&gt;" in page


def test_a_scene_that_cannot_start_shows_why():
    rod = mb.Body("rod", mass=1.0, inertia=0.1)
    hinges = [mb.Revolute(f"h{x}", mb.Ground().point(x, 0), rod.point(x / 2, 0)) for x in (0, 1)]
    page = mb.Scene(mb.System(rod, *hinges))._repr_html_()
    assert "data:image" not in page
    assert "No picture: " in page and ("h0" in page or "h1" in page)  # both stay open by the same distance


def test_large_equations_are_left_to_text():
    page = rods(40).system._repr_html_()
    assert len(page) < 100_000 and "too large for a notebook" in page


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr("symmb._progress._PATIENCE", 0.0)
    monkeypatch.setattr("symmb._progress._PERIOD", 0.01)


def standard_error(monkeypatch, stream=None):
    """A terminal in its place. A fixture cannot put it there: pytest replaces it before the test is called."""
    stream = stream or Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def told(stream, text):
    deadline = time.monotonic() + 10.0
    while text not in stream.getvalue() and time.monotonic() < deadline:
        time.sleep(0.01)
    return text in stream.getvalue()


def test_a_terminal_shows_runs_rate_and_time_left_and_other_work_anew(monkeypatch, impatient):
    terminal = standard_error(monkeypatch)
    with Progress("working") as progress:
        assert told(terminal, "working")
        progress("MonteCarlo(100)", 0, 100)
        assert told(terminal, "0 of 100 runs")
        progress("MonteCarlo(100)", 25, 100)
        assert all(told(terminal, text) for text in ("25 of 100 runs", "left", "runs/s"))
        progress("Vertex()", 1, 4)
        assert told(terminal, "Vertex()") and told(terminal, "1 of 4 runs")
    assert terminal.getvalue().endswith("\r")  # nothing is left on the line
    assert not terminal.getvalue().splitlines()[-1].strip()


def test_what_is_no_terminal_shows_none(monkeypatch, impatient):
    stream = standard_error(monkeypatch, io.StringIO())
    with Progress("working") as progress:
        progress("MonteCarlo(100)", 25, 100)
        time.sleep(0.05)
    assert stream.getvalue() == ""


def test_what_is_done_at_once_shows_none(monkeypatch):
    terminal = standard_error(monkeypatch)
    with Progress("working"):
        pass
    assert terminal.getvalue() == ""


def test_work_inside_of_work_has_no_bar_of_its_own(monkeypatch, impatient):
    terminal = standard_error(monkeypatch)
    with Progress("outer"):
        with Progress("inner"):
            assert told(terminal, "outer")
        assert "inner" not in terminal.getvalue()
    with Progress("next"):
        assert told(terminal, "next")


@pytest.mark.parametrize("start", [mb.simulate, mb.prepare])
def test_a_start_tells_what_it_does(monkeypatch, impatient, start):
    """Equations first, then runs. Each is shown in tests for 20 ms at least."""
    terminal, stage = standard_error(monkeypatch), "symmb._progress.Progress.__call__"
    own = Progress.__call__
    monkeypatch.setattr(stage, lambda *arguments: (time.sleep(0.02), own(*arguments), time.sleep(0.02)))
    start(ball().scene(times=TIMES, start={"ball.vx": 2.0}, name="fall"))
    assert "fall: equations" in terminal.getvalue()
    assert "fall: running" in terminal.getvalue() or "fall: nominal run in two ways" in terminal.getvalue()


def slow(k):
    time.sleep(0.02)
    return np.exp(-k * TIMES)


@pytest.mark.parametrize("own", [False, True])
def test_bounds_tell_terminals_unless_the_caller_watches(monkeypatch, impatient, own):
    terminal, seen = standard_error(monkeypatch), []
    decay = mb.FunctionSimulator(slow, {"k": 1.0}, TIMES, ["x"])
    watch = (lambda done, total: seen.append((done, total))) if own else None
    mb.propagate(decay, mb.Scanning(20), mb.Box(k=(0.5, 2.0)), progress=watch)
    assert ("Scanning(20)" in terminal.getvalue()) is not own
    assert bool(seen) is own


IN_NOTEBOOK = f"""
import time
import numpy as np
import symmb as mb
import symmb._progress as progress

TIMES = np.array([0.0, 1.0])
progress._PATIENCE, progress._PERIOD = 0.0, 0.05

{inspect.getsource(slow)}
decay = mb.FunctionSimulator(slow, {{"k": 1.0}}, TIMES, ["x"])
for n in (19, 23):
    mb.propagate(decay, mb.Scanning(n), mb.Box(k=(0.5, 2.0)))
"""


def test_a_cell_of_a_notebook_shows_one_line_which_is_empty_at_the_end():
    nbclient, nbformat, _ = packages()
    lines = []

    class Watching(nbclient.NotebookClient):
        def process_message(self, msg, *cell):
            lines.append(msg["content"].get("data", {}).get("text/plain", ""))
            return super().process_message(msg, *cell)

    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(IN_NOTEBOOK)])
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("TQDM_DISABLE", raising=False)
        Watching(book, timeout=300).execute()
    assert all(any(f"Scanning({n}) " in line and f"of {n} runs" in line for line in lines) for n in (19, 23))
    (output,) = book.cells[0].outputs
    assert output["output_type"] == "display_data" and output["data"] == {"text/plain": ""}
