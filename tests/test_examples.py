"""Examples run and their assertions hold; the README's code does what it says."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CONF = (ROOT / "examples" / "guide" / "conf.py").read_text(encoding="utf-8")
LONG = re.findall(r'"(\w+)"', re.findall(r"^LONG = (.*)$", CONF, re.MULTILINE)[0])


@pytest.mark.long
@pytest.mark.parametrize("name", LONG)
def test_example(name):
    """The others run where the site is built: `test_site.py`."""
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="example")


README = (ROOT / "README.md").read_text(encoding="utf-8")


NUMBER = re.compile(r"[-+]?\d[\d.e+-]*")


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
