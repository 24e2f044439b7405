"""Malformed calls of the API and of the command line are told in sentences: a tenth of the benchmark's."""

import random
import warnings
from functools import cache
from importlib import import_module
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy
from faults import refused
from scipy.interpolate import PchipInterpolator

import symmb as mb
from symmb._options import numbers_of


@cache
def malformed():
    """The benchmark, whose import makes runs."""
    with warnings.catch_warnings(action="ignore"):
        return import_module("malformed")


@pytest.mark.parametrize("seed", range(3))
def test_malformed_calls_are_told_in_sentences(seed):
    assert malformed().study(50, 100 + 50 * seed) == []


def test_a_fault_would_be_found(monkeypatch):
    def fails(value):
        raise ValueError(value)

    monkeypatch.setattr(malformed(), "CALLS", [(fails, (1,), {})])
    assert len(malformed().study(3)) == 2


@pytest.mark.parametrize(
    ("call", "number", "text"),
    [(lambda n: n, 3, "accepts"), (lambda n: 2 * np.int8(n), 3, "Overflow"), (lambda n: n * n, 100, "gives")],
)
def test_nonsense_overflows_and_other_results_would_be_found(monkeypatch, call, number, text):
    monkeypatch.setattr(malformed(), "CALLS", [(call, (number,), {})])
    assert any(text in malformed().api_fault(random.Random(seed)) for seed in range(60))


@pytest.mark.parametrize("value", [0, "x", None, np.array(1.0), ca.MX.sym("x"), sympy.Symbol("x"), lambda: 0])
def test_initial_of_no_expression(value):
    refused("initial", mb.initial, value)


CALLS = {
    "inputs": lambda: mb.linearize(malformed().SCENE, inputs=np.array([1.0])),
    "outputs": lambda: mb.linearize(malformed().SCENE, outputs=3),
    "critical": lambda: mb.critical(malformed().SCENE, np.array(["k"]), (0, 1)),
    "range": lambda: mb.critical(malformed().SCENE, "k", np.array([1.0, 2.0, 3.0])),
    "locus": lambda: mb.root_locus(malformed().SCENE, ["k"], (0, 1)),
    "modes": lambda: mb.FiniteElements.beams(malformed().BEAM).modes(interfaces=3),
    "executor that is a module": lambda: mb.propagate(malformed().DECAY, mb.Vertex(), malformed().BOX, executor=np),
    "executor with another map": lambda: mb.propagate(
        malformed().DECAY, mb.Vertex(), malformed().BOX, executor=_Maps()
    ),
    "names": lambda: mb.Scene(malformed().SCENE.system, outputs=np.ones(3)),
    "start": lambda: mb.Scene(malformed().SCENE.system, start=np.ones(3)),
    "a symbol of nothing": lambda: malformed().in_a_scene(mb.BushContact)(
        "bush", malformed().A, malformed().B, (ca.SX.sym("a"), 0, 1), 1e-3, mb.HuntCrossley(1e5, 0.5, 0.1)
    ),
}


class _Maps:
    """An executor whose map keeps no order."""

    def map(self, f, items):
        return [f(item) for item in items][::-1]


@pytest.mark.parametrize("name", CALLS)
def test_calls_that_ended_in_foreign_exceptions(name):
    with warnings.catch_warnings(action="ignore"), pytest.raises(mb.SymmbError) as error:
        CALLS[name]()
    assert str(error.value).endswith((".", ")", "'")) and len(str(error.value)) < 1000


def test_files_that_cannot_be_written_or_read(tmp_path):
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "file").touch()
    for call in (
        lambda: malformed().RUN.save(tmp_path / "folder.npz"),
        lambda: malformed().RUN.save(tmp_path / "none" / "run.npz"),
        lambda: malformed().DAE.save_c(tmp_path / "file"),
        lambda: mb.Bounds.load(tmp_path / "none.npz"),
        lambda: mb.FiniteElements.matrices(np.eye(3), tmp_path / "none.mtx", np.eye(9)),
    ):
        with pytest.raises(mb.SymmbError, match=r"cannot be (written|made|read): .*\.$") as error:
            call()
        assert isinstance(error.value, OSError)  # as Python's own


def test_numbers_of_what_users_give():
    assert numbers_of(np.longdouble(1.5)) == 1.5 and numbers_of([10**30, 1]).tolist() == [1e30, 1.0]
    others = "1", b"1", {}, {1}, 1j, [1j], None, [[1], [1, 2]], np.timedelta64(1), [ca.SX.sym("x")], object()
    truths, buffers = (True, [0, True], np.array([True])), (memoryview(b"x"), bytearray(b"x"), [memoryview(b"x")])
    for value in (*others, *truths, *buffers, np.ma.masked):
        assert numbers_of(value) is None


OPTIONS = {
    mb.Swarm: {"particles": 50, "steps": 10},
    mb.PolynomialChaos: {"order": 100},
    mb.MonteCarlo: {"samples": 100, "seed": 7},
    mb.Taylor: {"order": 3, "subintervals": 2},
    mb.RungeKutta: {"steps": 100},
    mb.Collocation: {"degree": 4, "steps": 50},
    mb.CVODES: {"rtol": 0.5, "atol": 0.25},
    mb.Exact: {"tolerance": 0.5, "budget": 20},
    mb.HyperbolicCross: {"q": 0.5},
    mb.Baumgarte: {"alpha": 2, "beta": 0.5},
    mb.AugmentedLagrangian: {"penalty": 100.0, "iterations": 3},
}


@pytest.mark.parametrize("kind", OPTIONS)
@pytest.mark.parametrize("number", [np.int8, np.uint16, np.int64, np.float16, np.longdouble])
def test_numbers_of_options_become_pythons(kind, number):
    whole = issubclass(number, np.integer)
    given = {name: number(value) if isinstance(value, int) == whole else value for name, value in OPTIONS[kind].items()}
    made = kind(**given)
    assert repr(made) == repr(kind(**OPTIONS[kind]))
    assert all(type(getattr(made, name)) is type(value) for name, value in OPTIONS[kind].items())


@pytest.mark.parametrize("rate", [1e200, 1e304, np.inf])
def test_rates_whose_squares_are_no_numbers(rate):
    for make in (lambda: mb.Baumgarte(beta=rate), lambda: mb.AugmentedLagrangian(omega=rate)):
        refused(r"at most 1e\+60", make)


@pytest.mark.parametrize("make", [lambda: mb.IDAS(atol=10**400), lambda: mb.HHT(step=10**400)])
def test_numbers_beyond_doubles(make):
    refused("must be a number above", make)


@pytest.mark.parametrize("make", [mb.PolynomialChaos, mb.PolynomialChaos.paper])
@pytest.mark.parametrize("nodes", [mb.Sobol(), mb.Random(), mb.LatinHypercube()])
def test_samplers_are_no_rules(make, nodes):
    refused("nodes", make, 2, nodes=nodes)


def test_an_order_does_not_overflow():
    bounds = mb.propagate(malformed().DECAY, mb.Swarm(np.int8(50), np.int8(10)), malformed().BOX)
    assert bounds.evaluations == 2 * len(malformed().T) * 500
    bounds = mb.propagate(malformed().DECAY, mb.PolynomialChaos(order=np.int8(100)), malformed().BOX)
    np.testing.assert_allclose(bounds.lower[:, 0], np.exp(-1.05 * malformed().T), rtol=1e-12)


@pytest.mark.parametrize("value", [True, False, np.True_, "1e-3", 1j, np.ma.masked, np.array([0.1]), None])
@pytest.mark.parametrize(
    ("kind", "name"),
    [(mb.CVODES, "rtol"), (mb.HHT, "step"), (mb.RungeKutta, "steps"), (mb.Exact, "tolerance"), (mb.Baumgarte, "beta"),
     (mb.AugmentedLagrangian, "iterations"), (mb.GeneralizedAlpha, "rho"), (mb.Swarm, "steps"),
     (mb.Bernstein, "boxes")],
)  # fmt: skip
def test_what_is_no_number_is_no_option(kind, name, value):
    refused(name, kind, **{name: value})


def sampled(period):
    held = mb.Sampled("held", period, malformed().ROD.theta)
    system = mb.System(malformed().ROD, held, parameters=malformed().SCENE.system.parameters)
    return mb.simulate(mb.Scene(system, times=malformed().T))


COSTS = {
    "swarm": (lambda: mb.propagate(malformed().DECAY, mb.Swarm(10**5, 10**5), malformed().BOX), "1.0e\\+11 runs"),
    "steps": (lambda: mb.simulate(malformed().SCENE, mb.RungeKutta(10**20)), "1.0e\\+20 steps in each"),
    "collocation": (lambda: mb.simulate(malformed().SCENE, mb.Collocation(steps=10**30)), "1.0e\\+30 steps in each"),
    "beyond doubles": (lambda: mb.simulate(malformed().SCENE, mb.RungeKutta(10**400)), "more than 1e300 steps"),
    "memory": (lambda: mb.simulate(malformed().SCENE, mb.RungeKutta(2**31)), "2.1e\\+09 steps in each"),
    "step": (lambda: mb.simulate(malformed().SCENE, mb.HHT(1e-300)), "steps in each"),
    "longest step": (lambda: mb.simulate(malformed().SCENE, mb.NSTIFFSI2(1e-300, rtol=1e-3)), "steps in each"),
    "ensemble": (
        lambda: mb.propagate(malformed().SCENE, mb.Vertex(), solver=mb.RungeKutta(10**9)),
        "1.0e\\+09 steps in each",
    ),
    "probes": (
        lambda: mb.propagate(malformed().DECAY, mb.PolynomialChaos(probes=10**12), malformed().BOX),
        "1.0e\\+12 runs",
    ),
    "instants": (lambda: sampled(1e-12), "steps in each"),
    "instants without end": (lambda: sampled(1e-300), "steps in each"),
    "table": (lambda: mb.Table(range(10**12), range(10**12)), "1000000000000 points are too many"),
    "locus": (lambda: mb.root_locus(malformed().SCENE, "k", (4.0, 5.0), count=10**9), "at most"),
    "mesh": (
        lambda: mb.Beam([(0, 0, 0), (1, 0, 0)], malformed().BEAM.section, malformed().BEAM.material, 10**9),
        "at most",
    ),
    "corrections": (lambda: mb.AugmentedLagrangian(iterations=10**9), "at most"),
}


@pytest.mark.parametrize("name", COSTS)
def test_what_cannot_be_afforded_is_told_before_it_starts(name):
    call, text = COSTS[name]
    refused(text, call, error=mb.SymmbError)


@pytest.mark.parametrize(("x", "y"), [([0, 1], [-1e308, 1e308]), ([-1e308, 1e308], [0, 1]), ([0, 5e-324], [0, 1])])
def test_tables_whose_slopes_are_no_numbers(x, y):
    refused("slopes between the points exceed", mb.Table, x, y)


@pytest.mark.parametrize("size", [1e-100, 1.0, 1e100])
def test_tables_of_large_and_small_numbers_are_finite(size):
    table, other = mb.Table([0, 1, 2], [-size, size, 0]), PchipInterpolator([0, 1, 2], [-size, size, 0])
    places = np.linspace(0, 2, 9)
    np.testing.assert_allclose([float(table(x)) for x in places], other(places), rtol=1e-12, atol=1e-15 * size)


def test_a_budget_without_end_costs_no_memory():
    bounds = [mb.propagate(malformed().SCENE, mb.Optimization(budget=budget)) for budget in (300, 10**15)]
    np.testing.assert_allclose(bounds[0].upper, bounds[1].upper, rtol=1e-9)


def test_errors_are_no_longer_than_a_screen():
    error = refused(None, malformed().SCENE.with_name, "a" * 10_000)
    assert len(error) < 2000 and error.startswith("name 'aaa")


NUMBERS = {
    "box": lambda v: mb.Box(l=(v, 1)),
    "nominal": lambda v: mb.Box.around({"l": v}, 0.05),
    "area": lambda v: mb.Section(area=v, Iy=1, Iz=1, J=1),
    "points": lambda v: mb.Beam([(0, 0, 0), (v, 0, 0)], malformed().BEAM.section, malformed().BEAM.material),
    "mass": lambda v: mb.System(mb.Body("b", v, 0.1)),
    "doubtful": lambda v: malformed().BOUNDS.doubtful(v),
    "gas": lambda v: malformed().in_a_scene(mb.NonlinearSpring)(
        "gas", malformed().A, malformed().B, mb.GasSpring(1e5, 1e-3, v, 0.1)
    ),
    "time": lambda v: mb.Scene(malformed().SCENE.system, times=[v, 1]),
    "table": lambda v: mb.Table([0, 1], [0, v]),
    "sample": lambda v: malformed().DECAY.run([[v]]),
}


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", ["1", True, b"1", memoryview(b"x"), np.ma.masked, np.timedelta64(1, "s"), 1j])
def test_what_is_no_number_is_refused_by_name(name, value):
    with pytest.raises(mb.SymmbError):
        NUMBERS[name](value)


def test_calls_write_into_a_folder_of_the_generator(monkeypatch, tmp_path):
    def writes(value):
        Path("written").write_text("x")
        raise mb.DeclarationError("f: no.")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(malformed(), "CALLS", [(writes, (1,), {})])
    for seed in range(9):
        assert malformed().api_fault(random.Random(seed)) == ""
    assert [*tmp_path.iterdir()] == [] and Path.cwd() == tmp_path
