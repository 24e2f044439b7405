"""The README's example in a notebook: every result shows as a table, as typeset equations, or as a picture."""

import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import symmb as mb
from symmb.bound.bounds.worst_case import Worst, WorstCase

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")

README = Path(__file__).parents[1] / "README.md"


def example():
    """The first block of Python in the README, without its prints."""
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    return "\n".join(line for line in code[1].splitlines() if not line.startswith("print("))


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


@pytest.mark.parametrize("name", ["scene", "run", "bounds", "comparison"])
def test_results_are_tables(shown, name):
    page = shown(name)["text/html"]
    assert "<table" in page and "tip_y" in page
    assert "data:image/png;base64," in page


@pytest.mark.parametrize("name", ["box", "parameters", "worst cases", "a worst case", "moments", "expansion"])
def test_small_results_are_tables(shown, name):
    page = shown(name)["text/html"]
    assert "<table" in page and "length" in page and "stiffness" in page


def test_a_drawing_is_a_page_of_its_own(shown):
    html = shown("drawing")["text/html"]
    frame = re.fullmatch('<iframe srcdoc="([^"<>]*)" title="drawing of rod on a spring"[^<>]*></iframe>', html)
    assert frame is not None
    page = unescape(frame[1])
    assert page.startswith("<!DOCTYPE html>") and "rod on a spring" in page and page.rstrip().endswith("</html>")


def test_a_file_is_written_without_a_page(tmp_path):
    fall = mb.Scene(mb.System(mb.Body("ball", mass=1.0, pose=mb.Particle())), times=np.array([0.0, 1.0]), name="<b>&")
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
    rods = [mb.Body(f"rod{i}", mass=1.0, inertia=0.1) for i in range(40)]
    points = [mb.Ground().point(0, 0), *(rod.point(0.5, 0) for rod in rods)]
    hinges = [mb.Revolute(f"hinge{i}", points[i], rod.point(-0.5, 0)) for i, rod in enumerate(rods)]
    page = mb.System(*rods, *hinges)._repr_html_()
    assert len(page) < 100_000
    assert "too large for a notebook" in page
