"""The guide, the examples and the README: their code runs and does what they say, and links lead somewhere."""

import re
import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

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
