"""Digests of functions: what changes the runs changes the digest, in all processes alike."""

import contextlib
import functools
import os
import subprocess
import sys
import threading
import types

import numpy as np
import pandas
import pytest
from faults import refused, told_in_a_line
from scipy.interpolate import CubicSpline

import symmb as mb
from symmb.connect.identity import digest

FACTOR = "def f(k):\n    return FACTOR * k"
HELPED = "def g(k):\n    return {} * k\ndef f(k):\n    return g(k)"
METHOD = "class A:\n    c = {}\n    def __call__(self, k):\n        return self.c * k\nf = A()"
CACHED = """
import abc, dataclasses, enum, functools
class Kind(enum.Enum):
    A = {}
@dataclasses.dataclass
class Base(abc.ABC):
    x: float = 0.0
    @abc.abstractmethod
    def g(self, k): ...
class A(Base):
    @functools.cached_property
    def c(self):
        return {}
    def g(self, k):
        return self.c * k * Kind.A.value
f = A().g
"""
INSIDE = "class A:\n    def g(self, k):\n        return {} * k\ndef f(k):\n    return A().g(k)"


def defined(code, **names):
    """The function f of a module with some code and names."""
    module = types.ModuleType("written")
    vars(module).update(names)
    exec(code, vars(module))
    return module.f


def closed(value):
    return lambda k: (value, k)


def with_default(value):
    return lambda k, *, value=value: value * k


def doubled(f, factor):
    @functools.wraps(f)
    def g(k):
        return factor * f(k)

    return g


class Slots:
    __slots__ = ("c", "other")

    def __init__(self, c):
        self.c, self.other = c, self


class Holder:
    def __init__(self, c):
        self.inner = types.SimpleNamespace(c=[c, self])

    def f(self, k):
        return self.inner.c[0] * k


def one_line(c):
    f, g = (lambda k: 2.0 * k), (lambda k: 3.0 * k)
    return f if c == 1 else g


KINDS = {
    "one line": one_line,
    "wraps": lambda c: doubled(np.sin, c),
    "wrapped": lambda c: doubled(closed(c), 2),
    "lru_cache": lambda c: functools.lru_cache(closed(c)),
    "partial": lambda c: functools.partial(closed(c), k=1.0),
    "contextmanager": lambda c: contextlib.contextmanager(closed(c)),
    "keyword-only default": with_default,
    "frame": lambda c: closed(pandas.DataFrame({"x": [1.0, c]})),
    "spline": lambda c: closed(CubicSpline([0.0, 1.0, 2.0], [0.0, c, 1.0])),
    "spline itself": lambda c: CubicSpline([0.0, 1.0, 2.0], [0.0, c, 1.0]),
    "closure over a function": lambda c: closed(closed(c)),
    "inside self": lambda c: Holder(c).f,
    "slots": lambda c: closed(Slots(c)),
    "class attribute": lambda c: defined(METHOD.format(c)),
    "class with all that there is": lambda c: defined(CACHED.replace("{}", str(c))),
    "class of a global": lambda c: defined(INSIDE.format(c)),
    "global number": lambda c: defined(FACTOR, FACTOR=c),
    "global array": lambda c: defined(FACTOR, FACTOR=np.array([c])),
    "array of objects": lambda c: closed(np.array([c, "text", None], dtype=object)),
    "masked array": lambda c: closed(np.ma.masked_array([1.0, 2.0, 3.0], mask=[c == 1, False, False])),
    "global list": lambda c: defined(FACTOR, FACTOR=["x", c]),
    "global function": lambda c: defined(HELPED.format(c)),
    "global in a nested function": lambda c: defined("def f(k):\n    return (lambda: FACTOR)() * k", FACTOR=c),
    "set": lambda c: closed({"one", "two", "three", c}),
    "vectorize": lambda c: np.vectorize(closed(c)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_changes_a_function_changes_its_digest(kind):
    made = [digest(KINDS[kind](c)) for c in (1, 2, 1)]
    assert made[0] == made[2] != made[1]


def test_comments_and_lines_do_not_count():
    text = "\n\ndef f(k):\n    # a comment\n    return FACTOR * k"
    assert digest(defined(text, FACTOR=1)) == digest(defined(FACTOR, FACTOR=1))


def test_what_cannot_be_seen_asks_for_a_version(tmp_path):
    lock = threading.Lock()
    made, other = (mb.FunctionSimulator(f, {"k": 1.0}, [0.0], ["x"]) for f in (closed(lock), doubled(closed(lock), 2)))
    with told_in_a_line("Pass version="):
        mb.StoredSimulator(made, tmp_path / "runs.db")
    one, two = (mb.StoredSimulator(own, tmp_path / "runs.db", version="1").identity for own in (made, other))
    assert one != two


def test_too_deep_is_told():
    nest = []
    for _ in range(100000):
        nest = [nest]
    refused("too deeply nested", digest, closed(nest))
    while nest:  # one by one: the interpreter would free them by recursion
        nest = nest.pop()


def test_digests_are_those_of_other_processes():
    code = "import test_identity as t\nprint(*(t.digest(make(1)) for make in t.KINDS.values()))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    told = [
        subprocess.check_output([sys.executable, "-c", code], env={**environment, "PYTHONHASHSEED": seed}, text=True)
        for seed in ("1", "2")
    ]
    assert told[0] == told[1] and len(set(told[0].split())) == len(KINDS)
