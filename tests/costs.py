"""What each test costs: a plugin of pytest that measures it, and the lists of slow and long tests of its measurements.

    PYTHONPATH=tests COSTS=build/costs XDG_CACHE_HOME=$(mktemp -d) python -m pytest -n 2 -m "" -p costs
    python tests/costs.py build/costs.*.jsonl

The plugin writes a line of JSON for each test: its name, processor seconds of its own, of programs that it starts and
of fixtures that another test has set up for it, and models that it compiles. The second command writes `slow.txt` and
`long.txt`. Tests that were not measured stay in these lists. Measure with an empty cache, on an idle
machine, and then the fast tests alone as well: a test may compile what a slow test has compiled before. The largest
time of a test counts.
"""

import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import pytest

from symmb.run.codegen import build

SECONDS = {"slow": 0.2, "long": 0.7}
"""Processor seconds of slow and of long tests. README's command leaves out both, and `.ci/run` leaves out long ones."""

FOLDER = Path(__file__).parent
KEPT = frozenset((FOLDER / "kept.txt").read_text(encoding="utf-8").splitlines())
"""Tests that are not listed all the same: without these, the fast tests reach too little of the rooms, or do not catch
enough of the planted faults."""

builds = 0
fixtures: dict[pytest.FixtureDef, float] = {}


def counted(compile_source):
    """`build._built`, with a count."""

    def built(*args):
        global builds
        builds += 1
        return compile_source(*args)

    return built


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef):
    before = sum(os.times()[:4])
    result = yield
    fixtures[fixturedef] = sum(os.times()[:4]) - before
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    before, builds_before = os.times(), builds
    used = [definitions[-1] for definitions in item._fixtureinfo.name2fixturedefs.values()]
    shared = sum(fixtures.get(definition, 0.0) for definition in used if definition.cached_result is not None)
    result = yield
    after = os.times()
    own, children = (sum(after[k : k + 2]) - sum(before[k : k + 2]) for k in (0, 2))
    line = {"test": item.nodeid, "own": round(own, 3), "children": round(children, 3), "shared": round(shared, 3)}
    line["builds"] = builds - builds_before
    with open(f"{os.environ['COSTS']}.{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.jsonl", "a") as file:
        file.write(json.dumps(line) + "\n")
    return result


def costly(lines: Iterable[str], name: str) -> list[str]:
    """Names of tests for a list. One name stands for all parameters of a test if each of them belongs to the list."""
    seconds: dict[str, dict[str, float]] = defaultdict(dict)
    for line in map(json.loads, lines):
        of_function = seconds[line["test"].split("[")[0]]
        cost = line["own"] + line["children"] + line["shared"]
        of_function[line["test"]] = max(of_function.get(line["test"], 0.0), cost)
    earlier = (FOLDER / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    earlier = [test for test in earlier if (FOLDER.parent / test.split("::")[0]).exists()]
    names = {test for test in earlier if test not in seconds and test not in seconds.get(test.split("[")[0], ())}
    for function, by_parameters in seconds.items():
        found = {test for test, cost in by_parameters.items() if cost > SECONDS[name] and test not in KEPT}
        names |= {function} if len(found) == len(by_parameters) else found
    return sorted(names)


if __name__ == "__main__":
    measured = [line for name in sys.argv[1:] for line in open(name)]
    for name in SECONDS:
        (FOLDER / f"{name}.txt").write_text("\n".join([*costly(measured, name), ""]), encoding="utf-8")
elif "COSTS" in os.environ:
    build._built = counted(build._built)
