"""A plugin of pytest that writes what each test costs: a line of JSON with its name, processor seconds and builds.

    PYTHONPATH=tests COSTS=costs python -m pytest -n 2 -p costs
"""

import json
import os

import pytest

from symmb.codegen import build

compiled = 0


def _count(built):
    def counted(*args):
        global compiled
        compiled += 1
        return built(*args)

    return counted


build._built = _count(build._built)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    before, builds = os.times(), compiled
    result = yield
    after = os.times()
    own, children = (sum(after[k : k + 2]) - sum(before[k : k + 2]) for k in (0, 2))
    line = {"test": item.nodeid, "own": round(own, 3), "children": round(children, 3), "builds": compiled - builds}
    with open(f"{os.environ['COSTS']}.{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.jsonl", "a") as file:
        file.write(json.dumps(line) + "\n")
    return result
