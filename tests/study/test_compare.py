"""What is run on which simulator, how it is timed, methods that cannot run, and checks of others by proved bounds."""

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from black_boxes import reloaded
from faults import refused, warned
from machines import ball
from mechanisms import double_pendulum, double_pendulum_by_hand, explosion
from small_scenes import state

import symmb as mb
from symmb.bound.methods.method import Method
from symmb.study import compare
from symmb.study.compare import _confronted, _doubt_of_reference, compare_simulator, default_methods
from symmb.study.reference import Reference, _resolutions, find_reference

T = np.linspace(0.0, 1.0, 11)
BOX = mb.Box(k=(0.5, 1.5))


def counted(offset=0.0):
    """The function y = k t + offset, and the list of its runs."""
    runs = []
    return simulator(lambda k: runs.append(k) or k * T + offset), runs


def simulator(f):
    return mb.FunctionSimulator(f, {"k": 1.0}, T, ["y"])


LINE = simulator(lambda k: k * T)


def test_every_method_is_scored_and_timed():
    result = compare_simulator(LINE, [mb.Vertex(), mb.MonteCarlo(20)], BOX, scene="line")
    vertex, random = result.rows
    assert (vertex.name, vertex.kind, vertex.evaluations, vertex.failed) == ("Vertex()", "sampled", 2, 0)
    assert vertex.score.error == pytest.approx([0.0], abs=1e-14)
    assert random.score.under[0] > 0.01 and random.score.over == [0.0]
    assert random.run_seconds > 0.0
    assert result.solver_error is None  # without a tighter simulator
    assert [row.name for row in mb.compare(LINE, mb.Vertex(), BOX).rows] == ["Vertex()"]  # which need not be in a list


def test_the_reference_runs_on_the_tighter_simulator_only():
    (plain, own_runs), (tight, runs) = counted(0.1), counted()
    result = compare_simulator(plain, [mb.Vertex()], BOX, mb.Scanning(5), tighter=tight)
    own = 3  # the solver's own error is taken at the centre and two corners
    assert len(runs) == 5 + own
    assert len(own_runs) >= 4 * 2 + own  # one cold and three warm rounds over two vertices
    rms_width = np.sqrt(np.mean(T**2))
    assert result.solver_error == pytest.approx([0.1 / rms_width])
    assert result.rows[0].score.error == pytest.approx([0.1 / rms_width])


def test_a_method_that_cannot_run_gives_its_reason_and_the_others_if_there_are_any_go_on():
    result = compare_simulator(LINE, [mb.Taylor(2), mb.PolynomialChaos(budget=1), mb.Vertex()], BOX)
    assert [row.name for row in result.rows] == ["Vertex()"]
    taylor, chaos = result.not_run
    assert taylor.name == "Taylor(order=2)" and "derivatives" in taylor.reason
    assert taylor.reason in " ".join(str(result).split())
    assert chaos.reason.startswith("the first level takes")
    for method, message in (
        (mb.PolynomialChaos(budget=1), r"run\. PolynomialChaos\(budget=1\): the first level takes"),  # named once
        (mb.Taylor(1), r"No method could run.*Taylor\(order=1\).*derivatives"),
    ):
        refused(message, compare_simulator, LINE, [method], BOX, error=mb.PropagationError)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], BOX), "methods is empty"),
        (([mb.Vertex], BOX), r"compare: got the class Vertex; call it"),
        ((mb.Vertex, BOX), r"compare: got the class Vertex; call it"),
        (("vertx", BOX), "There is no method 'vertx'. Did you mean 'vertex'"),
        (([mb.Vertex()], {"k": (0.5, 1.5)}), r"box: \{'k': .* is not a Box.*Box\(\*\*intervals\)"),
        (([mb.Vertex()], BOX, mb.Scanning), r"reference: got the class Scanning"),
        (([mb.Vertex()], BOX, None, 7), r"solver: 7 is not a Solver; give an object such as CVODES"),
        (([mb.Vertex()], BOX, None, mb.CVODES), r"solver: got the class CVODES; call it"),
    ],
)
def test_slips_are_told_before_anything_runs(arguments, message):
    own, runs = counted()
    refused(message, mb.compare, own, *arguments)
    assert not runs


def test_threads_change_nothing_but_the_time():
    sim, methods = simulator(lambda k: np.sin(k * T)), [mb.MonteCarlo(300), mb.PolynomialChaos(order=3)]
    alone = compare_simulator(sim, methods, BOX)
    with ThreadPoolExecutor(2) as pool:
        together = compare_simulator(sim, methods, BOX, executor=pool, threads=2)
    for one, other in zip(alone.rows, together.rows, strict=True):
        np.testing.assert_array_equal([one.lower, one.upper], [other.lower, other.upper])
    assert "2 threads" in str(together)


def test_progress_names_what_runs_counts_all_runs_and_tells_the_error():
    seen = []
    kink, watch = simulator(lambda k: np.abs(k * T - 0.4)), lambda *told: seen.append(told)
    compare_simulator(kink, [mb.Scanning(4), mb.PolynomialChaos()], BOX, mb.Vertex(), progress=watch)
    assert {("reference", 2, 2), ("Scanning(4)", 4, 4)} <= {*seen}
    done = [k for label, k, _ in seen if label.startswith("PolynomialChaos()")]
    assert done[:5] == sorted(done[:5]) and "estimated error" in seen[-1][0]


@pytest.mark.parametrize(
    ("durations", "median", "rounds"),
    [
        ([0.4, 0.1, 0.3, 0.2], 0.2, 4),  # the first is cold
        ([9.0, 0.1, 0.2], 0.2, 3),  # long: the first counts
        ([5.0, 7.0, 6.0], 6.0, 3),
        ([0.4, 0.02, 0.02, 0.03, 0.04], 0.025, 5),  # short: until they add up to a tenth of a second
    ],
)
def test_the_median_of_three_leaves_out_a_short_cold_run(monkeypatch, durations, median, rounds):
    clock = iter(np.cumsum([step for duration in durations for step in (0.0, duration)]))
    monkeypatch.setattr(compare.time, "perf_counter", lambda: next(clock))
    made = []
    bounds, seconds = compare._timed(lambda: made.append(len(made)) or made)
    assert seconds == pytest.approx(median) and len(made) == rounds and bounds is made


class WithJets(mb.FunctionSimulator):
    def jets(self, p0, directions, order):
        raise NotImplementedError


def test_default_methods_suit_the_simulator_and_the_number_of_parameters():
    names = [repr(method) for method in default_methods(LINE, BOX)]
    expected = {"PolynomialChaos()", "PolynomialChaos.paper(order=4)", "Scanning(21)", "MonteCarlo(10000)", "Vertex()"}
    assert expected <= {*names}
    assert not [name for name in names if name.startswith(("Taylor", "Interval", "Optimization"))]
    jets = WithJets(lambda k: k * T, {"k": 1.0}, T, ["y"])
    assert [m for m in default_methods(jets, BOX) if isinstance(m, mb.Taylor)] == [mb.Taylor(2), mb.Taylor(3)]
    assert mb.Optimization() in default_methods(jets, BOX)
    boxes = (mb.Box(**{f"k{i}": (0.5, 1.5) for i in range(n)}) for n in (6, 11))  # where grids stay affordable
    six, eleven = (default_methods(simulator(lambda **k: T), box) for box in boxes)
    assert [method for method in six if isinstance(method, mb.Scanning)] == [mb.Scanning(3)]
    assert mb.PolynomialChaos.paper(2) in six and mb.PolynomialChaos.paper(3) not in six
    assert mb.Vertex() in six and mb.Vertex() not in eleven


def test_the_first_run_that_fails_is_told():
    """v = 1 / (1 - a t) ends at t = 1/a."""
    told, own = "Runs failed: 1 of the reference, 1 of Scanning", {"reference": mb.Scanning(5)}
    found = warned(told, mb.compare, explosion(), [mb.Scanning(3)], mb.Box(a=(0.2, 0.6)), **own)
    told = " ".join(str(found).split())
    assert len(found.doubts) == found.rows[0].failed == 1
    assert "The first failed run of Scanning(3): t = 1.6" in told and "s, a = 0.6: the step became too short" in told


def test_a_comparison_announces_its_runs(caplog):
    caplog.set_level("INFO", logger="symmb")
    compare_simulator(LINE, [mb.Vertex(), mb.PolynomialChaos(order=3), mb.PolynomialChaos()], BOX)
    (told,) = caplog.messages
    assert "3002 runs for the reference, 6 for the methods, and a number of runs that is not known yet for" in told
    assert "Each method runs at least 3 times to measure its time, or once if it takes 10 s." in told


def test_the_reference_of_slow_runs_is_smaller(caplog):
    caplog.set_level("INFO", logger="symmb")

    def slow(k):
        time.sleep(0.2 if k == 1.0 else 0.0)
        return k * T

    result = compare_simulator(simulator(slow), [mb.Vertex()], BOX)
    (told,) = caplog.messages
    assert caplog.records[0].levelname == "WARNING"  # which Python shows without settings
    assert result.reference.evaluations < 1000
    assert f"{result.reference.evaluations} runs for the reference" in told
    assert "With faster runs, the reference would take 3002 runs." in told


@pytest.mark.parametrize(
    ("solver", "number"),
    [
        (mb.RungeKutta(steps=1), 101), (mb.RungeKutta(steps=110), 101), (mb.Collocation(degree=2, steps=1), 101),
        (mb.NSTIFFSI2(step=1.0), 501), (mb.NSTIFFSI2(step=1.0, rtol=0.1), 501), (mb.Rosenbrock(rtol=1e-2), 1001),
    ],
    ids=repr,
)  # fmt: skip
def test_the_solvers_own_error_is_known_where_output_times_limit_its_steps(solver, number):
    scene = double_pendulum(np.linspace(0.0, 3.0, number), box=mb.Box(l1=(0.95, 1.05), l2=(0.76, 0.84)))
    precise = isinstance(solver, mb.Rosenbrock)
    with nullcontext() if precise else pytest.warns(mb.SymmbWarning, match="exceed a thousandth of their range"):
        found = mb.compare(scene, [mb.Vertex()], reference=mb.Vertex(), solver=solver)
    points = np.array([found.box.center, found.box.lower, found.box.upper])
    exact = np.array([double_pendulum_by_hand(p, scene.times) for p in points])
    true = found.reference.yardstick.relative(mb.DAESimulator(scene, solver).run(points).Y - exact)
    assert (true > 1e-7).all()
    np.testing.assert_allclose(found.solver_error, true, rtol=0.3)


def test_a_motion_that_every_setting_follows_exactly_has_no_solver_error():
    machine = ball(g=None, a=1.0)
    scene = machine.scene("x", T, {"ball.x": machine.p.a}, box=mb.Box(a=(0.5, 1.5)))
    for solver in (mb.RungeKutta(steps=1), mb.DormandPrince(), mb.CVODES()):
        assert mb.compare(scene, [mb.Vertex()], reference=mb.Vertex(), solver=solver).solver_error == [0.0]


def test_outputs_with_an_uncertain_reference_are_told():
    f = mb.FunctionSimulator(lambda a: [[a**2, a, 1.0]], {"a": 0.5}, [0.0], ["y", "z", "constant"])
    ends = np.zeros((1, 3)), np.array([[1.0, 1.0, 0.0]])
    rough, exact = (Reference("Scanning(3)", *ends, np.array([e, 0.01, 9.0]), 3, 0, 1.0) for e in (0.12, 0.0))
    assert _doubt_of_reference(f, exact) == []
    (told,) = _doubt_of_reference(f, rough)
    assert told.startswith("The reference Scanning(3) is uncertain: y by 0.12 of its width. Errors of bounds below")


# The reference: how fine, how uncertain, from which simulator


def of_many(f, n_p):
    """The reference of a function of parameters p0, p1, ..."""
    names = [f"p{i}" for i in range(n_p)]
    simulator = mb.FunctionSimulator(f, dict.fromkeys(names, 1.0), T, ["y"])
    return find_reference(simulator, mb.Box(**dict.fromkeys(names, (0.5, 1.5))))


@pytest.mark.parametrize("n_p", [1, 2, 3, 4, 5])
def test_nested_grids_of_about_two_thousand_runs(n_p):
    coarse, fine = _resolutions(n_p)
    assert isinstance(coarse, mb.Scanning) and isinstance(fine, mb.Scanning)
    assert fine.points == 2 * coarse.points - 1
    assert 1500 <= fine.points**n_p <= 3200


def test_a_linear_response_has_no_uncertainty():
    found = find_reference(LINE, BOX)
    np.testing.assert_allclose([found.lower[:, 0], found.upper[:, 0]], [0.5 * T, 1.5 * T])
    assert found.uncertainty == pytest.approx([0.0], abs=1e-14)
    assert (found.method, found.evaluations, found.failed) == ("Scanning(2001)", 3002, 0)
    assert found.seconds is not None and found.seconds > 0.0


def test_the_uncertainty_is_larger_than_the_true_error():
    """y = (p0 - p1 t)^2 has its minimum 0 inside the box, between grid points."""
    found = of_many(lambda p0, p1: (p0 - 0.77 * p1 * T) ** 2, 2)
    lower = np.maximum(0.5 - 0.77 * 1.5 * T, 0.0) ** 2
    error = found.yardstick.deviation(lower[:, None], found.upper)
    assert 0.0 < error[0] <= found.uncertainty[0] < 1e-3


def test_beyond_five_parameters_vertices_join_the_samples_up_to_ten():
    found = of_many(lambda **p: sum(p.values()) * (1.0 + T), 6)
    np.testing.assert_allclose([found.lower[:, 0], found.upper[:, 0]], [3.0 * (1.0 + T), 9.0 * (1.0 + T)])
    assert found.method == "MonteCarlo(2048, sampler=Sobol()) with Vertex() with Optimization(budget=2000)"
    assert found.evaluations > 512 + 2048 + 64 and found.uncertainty[0] < 1e-9
    many = of_many(lambda **p: p["p0"] * (1.0 + T), 11)
    assert "Vertex" not in many.method
    np.testing.assert_allclose(many.upper[:, 0], 1.5 * (1.0 + T))


def given(names=("y",), t=T, estimate=None):
    lower = np.zeros((len(t), len(names)))
    return mb.Bounds(t, names, lower, lower + 2.0, "estimate", "by hand", 7, estimate, seconds=1.0)


def test_given_methods_and_bounds_are_used_as_they_are():
    """Bounds state their own uncertainty."""
    found = find_reference(LINE, BOX, mb.Vertex())
    assert (found.method, found.evaluations) == ("Vertex()", 2) and np.isnan(found.uncertainty).all()
    wider = [replace(given(), inner=(given().lower, given().upper))]  # which runs of a method attain
    assert [_confronted(found, by, wider, None)[0].upper[-1] for by in (mb.Vertex(), None)] == [1.5, 2.0]
    found = find_reference(LINE, BOX, given(estimate=np.full((11, 1), 0.02)))
    assert found.uncertainty == pytest.approx([0.01])
    assert (found.method, found.evaluations, found.seconds) == ("by hand", 7, None)


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        (given(names=("z",)), "has the outputs z, but the simulator has the outputs y"), (given(t=T[:-1]), "10 times"),
        (given(t=T + 0.1), "at the same times"),
    ],
    ids=["names", "number", "times"],
)  # fmt: skip
def test_given_bounds_must_fit(bounds, words):
    refused(words, find_reference, LINE, BOX, bounds, error=mb.PropagationError)


# Proved bounds

TIMES = np.linspace(0.0, 2.0, 9)


def _decay():
    """z' = -k z from 2: the true bounds are 2 exp(-1.1 t) and 2 exp(-0.9 t)."""
    return state(lambda p, z: -p.k * z, TIMES, 2.0, k=(0.9, 1.1))


TRUE = 2 * np.exp(-np.outer(TIMES, [1.1, 0.9]))


@dataclass(frozen=True)
class Claim(Method):
    """Bounds that are farther out, or in, than the true ones, with an estimate of their error."""

    kind: ClassVar = "estimate"
    off: float = 0.0
    said: float = 0.0

    def bounds(self, runs):
        ends = TRUE[:, :1] - self.off, TRUE[:, 1:] + self.off
        more = {"estimate": np.full((len(TIMES), 1), self.said)} if self.kind == "estimate" else {"inner": ends}
        return self._result(runs, *ends, 1, **more)


@dataclass(frozen=True)
class Wrong(Claim):
    """The same as attained values."""

    kind: ClassVar = "sampled"


def test_the_reference_is_proved_to_be_near_the_true_bounds(tmp_path):
    found = mb.compare(_decay(), [mb.TaylorModel(order=6), mb.PolynomialChaos(order=4)], reference=mb.Scanning(2))
    reference = found.reference
    np.testing.assert_allclose(np.hstack([reference.lower, reference.upper]), TRUE, atol=1e-7)
    assert reference.proved_by == ("TaylorModel(order=6)",) and 0 < reference.proved[0] < 1e-5
    assert reference.uncertainty[0] == reference.proved[0]  # a scan alone does not know it
    assert "proved by TaylorModel(order=6): the reference misses the true bounds by at most" in str(found)
    assert not found.doubts
    read = reloaded(found, tmp_path / "found.json").reference
    assert read.proved_by == reference.proved_by and (read.proved == reference.proved).all()


def test_a_reference_ends_where_proved_bounds_end():
    scene = _decay()
    found = compare_simulator(mb.DAESimulator(scene), [mb.TaylorModel(order=6)], scene.box, Claim(off=0.2))
    np.testing.assert_allclose(np.hstack([found.reference.lower, found.reference.upper]), TRUE, atol=1e-6)
    assert found.reference.proved is None  # what is not attained may miss either way


def test_a_reference_must_be_finite():
    scene = state(lambda p, z: p.k * z**2, [0.0, 0.5, 0.9, 1.0], 1.0, k=(0.9, 1.1))
    infinite, order_4 = r"TaylorModel\(order=4\) has infinite bounds of z at t = 0.9 s", mb.TaylorModel(order=4)
    refused(infinite, mb.compare, scene, [mb.Vertex()], reference=order_4, error=mb.PropagationError)


def test_runs_outside_of_proved_bounds_are_told():
    """Those of the reference as well."""
    warned(r"Runs of the reference Wrong", mb.compare, _decay(), [mb.TaylorModel(order=6)], reference=Wrong(off=0.01))
    told = r"Runs of Wrong\(off=0.01, said=0.0\) are outside .*: z by 1.0e-02 at t = "
    found = warned(told, mb.compare, _decay(), [mb.TaylorModel(order=6), Wrong(off=0.01), mb.Vertex()])
    assert len(found.doubts) == 1
    # Runs of methods belong to the reference, up to the limit.
    assert (found.reference.upper <= TRUE[:, 1:] + 1e-6).all()


def test_estimates_that_are_too_low_are_told():
    methods = [mb.TaylorModel(order=6), Claim(off=0.02, said=0.03), Claim(off=0.02, said=0.01)]
    low = r"Claim\(off=0.02, said=0.01\) underestimates its error"
    found = warned(low, mb.compare, _decay(), methods, reference=mb.Scanning(3))
    assert len(found.doubts) == 2 and "The estimated error is above 10 % of the width" in found.doubts[0]


def test_bounds_that_are_inside_are_not_doubtful():
    methods = [mb.TaylorModel(order=6), Claim(off=-0.05, said=0.0), Wrong(off=-0.05)]
    found = mb.compare(_decay(), methods, reference=mb.Scanning(3))
    assert not found.doubts and "Check runs show errors of the bounds: z" in found.rows[2].doubts[0]
