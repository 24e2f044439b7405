"""What each test costs: a plugin of pytest that measures it, and the list of slow tests made of its measurements.

    PYTHONPATH=tests COSTS=build/costs XDG_CACHE_HOME=$(mktemp -d) python -m pytest -n 2 -m "not long" -p costs
    python tests/costs.py build/costs.*.jsonl > tests/slow.txt

The plugin writes a line of JSON for each test: its name, processor seconds of its own and of programs that it starts,
and models that it compiles. Measure with an empty cache, on an idle machine.
"""

import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterable

import pytest

from symmb.run.codegen import build

SLOW_SECONDS = 0.1
"""Processor seconds of a slow test. The others take less than three minutes on two cores, with an empty cache."""

KEPT = {
    "tests/bounds/test_noise.py::test_what_has_died_out_is_not_doubtful",
    "tests/drawing/test_page.py::test_pages_show_the_run[stick_slip]",
    "tests/prove/test_proved_switches.py::test_a_law_of_time_that_parameters_move",
    "tests/exchange/test_fmu_export.py::test_an_fmu_is_bounded_as_its_scene",
    "tests/report/test_report.py::test_comparisons",
    "tests/report/test_report.py::test_the_command_line_asks_for_contributions_once",
}
"""Slow tests that run with the fast ones, because these alone reach too little of the rooms."""

builds = 0


def counted(compile_source):
    """`build._built`, with a count."""

    def built(*args):
        global builds
        builds += 1
        return compile_source(*args)

    return built


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    before, builds_before = os.times(), builds
    result = yield
    after = os.times()
    own, children = (sum(after[k : k + 2]) - sum(before[k : k + 2]) for k in (0, 2))
    line = {"test": item.nodeid, "own": round(own, 3), "children": round(children, 3), "builds": builds - builds_before}
    with open(f"{os.environ['COSTS']}.{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.jsonl", "a") as file:
        file.write(json.dumps(line) + "\n")
    return result


def slow_tests(lines: Iterable[str]) -> list[str]:
    """Names of slow tests. One name stands for all parameters of a test if each of them is slow."""
    seconds: dict[str, dict[str, float]] = defaultdict(dict)
    for line in map(json.loads, lines):
        seconds[line["test"].split("[")[0]][line["test"]] = line["own"] + line["children"]
    names = []
    for function, by_parameters in seconds.items():
        slow = [test for test, cost in by_parameters.items() if cost > SLOW_SECONDS and test not in KEPT]
        names += [function] if len(slow) == len(by_parameters) else slow
    return sorted(names)


if __name__ == "__main__":
    print(*slow_tests(line for name in sys.argv[1:] for line in open(name)), sep="\n")
elif "COSTS" in os.environ:
    build._built = counted(build._built)
