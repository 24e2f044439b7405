"""What several test files share: one tuple for each family, so that a new member is tested by one line."""

import functools
import itertools
import os
import signal
import sys
from importlib import import_module
from pathlib import Path

import pytest

# Workers of pytest-xdist share the processors: threads of linear algebra would take them from each other. NumPy reads
# this when it is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Most of a test's time would be the compiler's. Benchmarks, and a stage of continuous integration, compile as users do.
os.environ.setdefault("SYMMB_CFLAGS", "-O0")
sys.path.append(str(Path(__file__).parent / "benchmarks"))  # of which tests make a small draw

from joints import ALL_JOINTS as ALL_JOINTS
from joints import ALL_POSES as ALL_POSES

from symmb import ChebyshevGauss, ClenshawCurtis, Gauss, HyperbolicCross, Leja, SparseGrid, TensorDegree, TotalDegree
from symmb.bound.methods import METHODS
from symmb.run.codegen import build
from symmb.run.integrate import SOLVERS

ALL_SOLVERS = tuple(entry.accurate for entry in SOLVERS if entry.accurate is not None)

ALL_RULES = (Gauss(), ClenshawCurtis(), ChebyshevGauss(), Leja())

ALL_NODES = (*ALL_RULES, *(SparseGrid(rule) for rule in ALL_RULES))

ALL_BASES = (TotalDegree(), TensorDegree(), HyperbolicCross(), HyperbolicCross(q=0.75))

ALL_METHODS = tuple(method for entry in METHODS for method in entry.examples)

NAMES = (
    "cubic double_pendulum slider_crank four_bar n_four_bar andrews bouncing_ball chain spherical_pendulum heavy_top"
    " car_axis rolling_disc six_axis_arm slider_crank_spatial slider_crank_flexible flexible_pendulum spin_up_beam"
    " stick_slip half_car stewart_platform excavator"
)
ALL_MODELS = tuple(import_module(f"models.{name}") for name in NAMES.split())


def but_long(values, *long):
    """The values of a parameter, of which some take seconds more than the others."""
    return [pytest.param(value, marks=[pytest.mark.long] * (value in long)) for value in values]


def in_turns(first, second, third):
    """Every pair of the first two with one of the third: each of these meets each of the first, and of the second."""
    pairs = itertools.product(enumerate(first), enumerate(second))
    return [(a, b, third[(i + k) % len(third)]) for (i, a), (k, b) in pairs]


SMOOTH_MODELS = tuple(model for model in ALL_MODELS if model.__name__ != "models.bouncing_ball")
"""Those that any solver runs."""


@pytest.fixture
def optimised():
    """A test whose runs take longer than the compiler: it optimises models a little, unless a stage says how far."""
    with pytest.MonkeyPatch.context() as patch:
        if os.environ["SYMMB_CFLAGS"] == "-O0":
            patch.setenv("SYMMB_CFLAGS", "-Og")
            patch.setattr(build, "_compiler", functools.cache(build._compiler.__wrapped__))  # it reads the flags once
        yield


LISTED = {
    name: frozenset((Path(__file__).parent / f"{name}.txt").read_text(encoding="utf-8").splitlines())
    for name in ("slow", "long")
}
"""Names of tests that take more than 0.2 s of processor time, and of those that take more than 0.7 s (`costs.py`)."""


@pytest.hookimpl(tryfirst=True)  # before tests are selected by their marks
def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: not item.nodeid.startswith("tests/test_site.py"))  # one worker builds it for minutes
    for item in items:
        for name, listed in LISTED.items():
            if item.nodeid in listed or item.nodeid.split("[")[0] in listed:
                item.add_marker(getattr(pytest.mark, name))


# A shell ignores these signals in what it runs in the background, and programs that tests start inherit this.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGQUIT, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)
