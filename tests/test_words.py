"""One word for one thing: texts that users read hold none of the words that another one has replaced."""

import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import symmb as mb

ROOT = Path(__file__).parents[1]
GONE = {
    "warning, uncertain": r"(?<![\w.`])doubt(?:s|ed|ful|fully)?\b(?![`(]| :)",
    "scalar output": r"(?<!new )(?<!matplotlib )(?<!the )\bfigures? (?:of|is|are|has|have|needs?)\b|one number a run",
    "distribution": r"\blaws? of (?:a )?parameters?\b|\bwithout a law\b|\bhave (?:no )?laws?\b|(?<![\w`])laws=",
    "lowest, smallest": r"(?<!at )(?<!At )\bleast\b(?![ -]squares)",
    "highest, largest": r"\bgreatest\b",
    "reported, stated, said": r"\btold\b",
    "left out": r"\b(?:fell|falls?) away\b",
    "a plain sentence": r"evaluations leave|it has thought|times or more|add up to the whole|times to check",
}
"""What is written now, and what it has replaced. Attributes such as `doubts` are code: they keep their names."""
FOUND = re.compile("|".join(GONE.values()))
GONE_FROM_PAGES = {"is not a": r"\bis no (?!longer|more)", "after, beyond": r"\bbehind\b"}
"""What README and the guide say now, and what it has replaced there."""
WORDS = "doubt figure law least greatest told fell fall run times whole thought".split()
LITERAL = re.compile(r'"((?:[^"\\]|\\.)*)"')


def docstrings() -> Iterator[tuple[str, str]]:
    """Docstrings of public names, and of their public methods and properties."""
    for name in mb.__all__:
        thing = getattr(mb, name)
        yield name, inspect.getdoc(thing) or ""
        if not isinstance(thing, type):
            continue
        for base in thing.__mro__:
            for member, value in vars(base).items():
                if base.__module__.startswith("symmb") and not member.startswith("_"):
                    yield f"{name}.{member}", getattr(value, "__doc__", "") or ""


def literals() -> Iterator[tuple[str, str]]:
    """Texts in code, without the values that they show: those of symmb, and those that examples print."""
    for path in [*(ROOT / "symmb").rglob("*.py"), *(ROOT / "examples").glob("*.py")]:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if any(word in line for word in WORDS) and '"""' not in line:
                for text in filter(lambda text: " " in text, LITERAL.findall(line)):
                    yield f"{path.relative_to(ROOT)}:{number}", re.sub(r"\{[^{}]*\}", "", text)


def pages() -> Iterator[tuple[str, str]]:
    """Lines of README and of the guide. Entries of changes keep the words of their day."""
    for path in [*(ROOT / "examples" / "guide").glob("*.md"), ROOT / "README.md"]:
        if path.stem != "changes":
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                yield f"{path.relative_to(ROOT)}:{number}", line


@pytest.mark.parametrize("texts", [docstrings, literals, pages], ids=lambda texts: texts.__name__)
def test_texts_hold_no_word_that_another_one_replaced(texts):
    found = {(place, match[0]) for place, text in texts() for match in FOUND.finditer(text)}
    assert not found, f"write one of {[*GONE]} in the place of {sorted(found)}"


def test_pages_are_plain():
    gone = re.compile("|".join(GONE_FROM_PAGES.values()))
    found = {(place, match[0]) for place, text in pages() for match in gone.finditer(text)}
    assert not found, f"write one of {[*GONE_FROM_PAGES]} in the place of {sorted(found)}"


@pytest.mark.parametrize(
    ("text", "is_gone"),
    [
        ("A run is doubtful.", True), ("`bounds.doubts` and `doubts`", False), ("The least margin", True),
        ("at least two, least squares", False), ("told in a sentence", True), ("parameters without a law", True),
        ("`laws=` is another name", False), ("a law of contact", False), ("a figure is one number", True),
        ("size of a new figure of bounds", False), ("met 3 times or more", True),
    ],
)  # fmt: skip
def test_the_list_finds_words_and_not_code(text, is_gone):
    assert bool(FOUND.search(text)) == is_gone


def test_results_with_doubts_have_them_as_warnings():
    kinds = [kind for kind in (getattr(mb, name) for name in mb.__all__) if isinstance(kind, type)]
    with_doubts = {
        kind.__name__: kind
        for kind in kinds
        if hasattr(kind, "doubts") or any("doubts" in vars(base).get("__annotations__", {}) for base in kind.__mro__)
    }
    assert {"Bounds", "Trajectory", "Sweep", "Calibration", "Comparison", "Linearization"} <= {*with_doubts}
    assert [name for name, kind in with_doubts.items() if not hasattr(kind, "warnings")] == []
    zero = np.zeros((2, 1))
    found = mb.Bounds(np.array([0.0, 1.0]), ("y",), zero, zero + 1, "sampled", "Vertex()", 2, run_doubts=("It slips.",))
    assert found.warnings == found.doubts == ("It slips.",)
