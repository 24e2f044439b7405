"""The pages of the guide: their code runs from top to bottom, and their links lead somewhere."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "examples" / "guide").glob("*.md"))
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
    index = (ROOT / "examples" / "guide" / "index.md").read_text(encoding="utf-8")
    assert {page.name for page in PAGES} == {"index.md", *re.findall(r"\]\((\w+\.md)\)", index)}
