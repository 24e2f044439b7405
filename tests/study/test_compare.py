"""What is run on which simulator, how it is timed, and what happens to methods that cannot run."""

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
import pytest
from mechanisms import double_pendulum, double_pendulum_by_hand, explosion

import symmb as mb
from symmb.study import compare
from symmb.study.compare import _doubt_of_reference, compare_simulator, default_methods
from symmb.study.reference import Reference

T = np.linspace(0.0, 1.0, 11)
BOX = mb.Box(k=(0.5, 1.5))


@dataclass
class Counted:
    """y = k t + offset; remembers how often it ran."""

    offset: float = 0.0
    runs: int = 0

    def __call__(self, k):
        self.runs += 1
        return k * T + self.offset


def simulator(f):
    return mb.FunctionSimulator(f, {"k": 1.0}, T, ["y"])


def test_every_method_is_scored_and_timed():
    result = compare_simulator(simulator(lambda k: k * T), [mb.Vertex(), mb.MonteCarlo(20)], BOX, scene="line")
    vertex, random = result.rows
    assert (vertex.name, vertex.kind, vertex.evaluations, vertex.failed) == ("Vertex()", "sampled", 2, 0)
    assert vertex.score.error == pytest.approx([0.0], abs=1e-14)
    assert random.score.under[0] > 0.01 and random.score.over == [0.0]
    assert random.run_seconds > 0.0


def test_the_reference_runs_on_the_tighter_simulator_only():
    plain, tight = Counted(offset=0.1), Counted()
    result = compare_simulator(simulator(plain), [mb.Vertex()], BOX, mb.Scanning(5), tighter=simulator(tight))
    own = 3  # the solver's own error is taken at the centre and two corners
    assert tight.runs == 5 + own
    assert plain.runs >= 4 * 2 + own  # one cold and three warm rounds over two vertices
    rms_width = np.sqrt(np.mean(T**2))
    assert result.solver_error == pytest.approx([0.1 / rms_width])
    assert result.rows[0].score.error == pytest.approx([0.1 / rms_width])


def test_without_a_tighter_simulator_its_own_error_is_not_known():
    assert compare_simulator(simulator(lambda k: k * T), [mb.Vertex()], BOX).solver_error is None


def test_a_method_that_cannot_run_gives_its_reason_and_the_others_go_on():
    result = compare_simulator(simulator(lambda k: k * T), [mb.Taylor(2), mb.Vertex()], BOX)
    assert [row.name for row in result.rows] == ["Vertex()"]
    assert result.not_run[0].name == "Taylor(order=2)"
    assert "derivatives" in result.not_run[0].reason
    assert result.not_run[0].reason in " ".join(str(result).split())


def test_reasons_name_their_method_once():
    result = compare_simulator(simulator(lambda k: k * T), [mb.PolynomialChaos(budget=1), mb.Vertex()], BOX)
    assert result.not_run[0].reason.startswith("the first level takes")
    with pytest.raises(mb.PropagationError, match=r"run\. PolynomialChaos\(budget=1\): the first level takes"):
        compare_simulator(simulator(lambda k: k * T), [mb.PolynomialChaos(budget=1)], BOX)


def test_a_single_method_need_not_be_in_a_list():
    assert [row.name for row in mb.compare(simulator(lambda k: k * T), mb.Vertex(), BOX).rows] == ["Vertex()"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
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
    f = Counted()
    with pytest.raises(mb.DeclarationError, match=message):
        mb.compare(simulator(f), *arguments)
    assert f.runs == 0


def test_no_methods_are_told_before_anything_runs():
    with pytest.raises(mb.DeclarationError, match="methods is empty"):
        mb.compare(simulator(pytest.fail), [], BOX)


def test_no_method_that_can_run_is_an_error():
    with pytest.raises(mb.PropagationError, match=r"No method could run.*Taylor\(order=1\).*derivatives"):
        compare_simulator(simulator(lambda k: k * T), [mb.Taylor(1)], BOX)


def test_threads_change_nothing_but_the_time():
    sim, methods = simulator(lambda k: np.sin(k * T)), [mb.MonteCarlo(300), mb.PolynomialChaos(order=3)]
    alone = compare_simulator(sim, methods, BOX)
    with ThreadPoolExecutor(2) as pool:
        together = compare_simulator(sim, methods, BOX, executor=pool, threads=2)
    for one, other in zip(alone.rows, together.rows, strict=True):
        np.testing.assert_array_equal(one.lower, other.lower)
        np.testing.assert_array_equal(one.upper, other.upper)
    assert "2 threads" in str(together)


def test_progress_of_adaptive_methods_counts_all_runs_and_tells_the_error():
    seen = []
    kink, watch = simulator(lambda k: np.abs(k * T - 0.4)), lambda *told: seen.append(told)
    compare_simulator(kink, [mb.PolynomialChaos()], BOX, mb.Vertex(), progress=watch)
    done = [k for label, k, _ in seen if label.startswith("PolynomialChaos()")]
    assert done[:5] == sorted(done[:5]) and "estimated error" in seen[-1][0]


def test_progress_names_what_runs():
    seen = []
    linear = simulator(lambda k: k * T)
    compare_simulator(linear, [mb.Scanning(4)], BOX, mb.Vertex(), progress=lambda *told: seen.append(told))
    assert ("reference", 2, 2) in seen
    assert ("Scanning(4)", 4, 4) in seen


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
    assert seconds == pytest.approx(median)
    assert len(made) == rounds
    assert bounds is made


def test_default_methods_suit_the_simulator():
    sim = simulator(lambda k: k * T)
    names = [repr(method) for method in default_methods(sim, BOX)]
    assert "PolynomialChaos()" in names and "PolynomialChaos.paper(order=4)" in names
    assert "Scanning(21)" in names and "MonteCarlo(10000)" in names and "Vertex()" in names
    assert not [name for name in names if name.startswith(("Taylor", "Interval", "Optimization"))]


def test_default_grids_stay_affordable_in_many_parameters():
    names = {f"k{i}": (0.5, 1.5) for i in range(6)}
    methods = default_methods(simulator(lambda **k: T), mb.Box(**names))
    assert [method for method in methods if isinstance(method, mb.Scanning)] == [mb.Scanning(3)]
    assert mb.PolynomialChaos.paper(2) in methods
    assert mb.PolynomialChaos.paper(3) not in methods
    assert mb.Vertex() in methods
    many = {f"k{i}": (0.5, 1.5) for i in range(11)}
    assert mb.Vertex() not in default_methods(simulator(lambda **k: T), mb.Box(**many))


class WithJets(mb.FunctionSimulator):
    def jets(self, p0, directions, order):
        raise NotImplementedError


def test_taylor_joins_where_there_are_jets():
    sim = WithJets(lambda k: k * T, {"k": 1.0}, T, ["y"])
    assert [m for m in default_methods(sim, BOX) if isinstance(m, mb.Taylor)] == [mb.Taylor(2), mb.Taylor(3)]
    assert mb.Optimization() in default_methods(sim, BOX)


def test_the_first_run_that_fails_is_told():
    """v = 1 / (1 - a t) ends at t = 1/a."""
    with pytest.warns(mb.SymmbWarning, match="Runs failed: 1 of the reference, 1 of Scanning"):
        found = mb.compare(explosion(), [mb.Scanning(3)], mb.Box(a=(0.2, 0.6)), reference=mb.Scanning(5))
    assert len(found.doubts) == 1
    told = " ".join(str(found).split())
    assert found.rows[0].failed == 1
    assert "The first failed run of Scanning(3): t = 1.6" in told and "s, a = 0.6: the step became too short" in told


def test_a_comparison_announces_its_runs(caplog):
    caplog.set_level("INFO", logger="symmb")
    compare_simulator(simulator(lambda k: k * T), [mb.Vertex(), mb.PolynomialChaos(order=3), mb.PolynomialChaos()], BOX)
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
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    p = mb.Parameters(a=1.0)
    scene = mb.Scene(mb.System(ball, parameters=p), {"ball.x": p.a}, T, {"x": ball.x}, box=mb.Box(a=(0.5, 1.5)))
    for solver in (mb.RungeKutta(steps=1), mb.DormandPrince(), mb.CVODES()):
        assert mb.compare(scene, [mb.Vertex()], reference=mb.Vertex(), solver=solver).solver_error == [0.0]


def test_outputs_with_an_uncertain_reference_are_told():
    f = mb.FunctionSimulator(lambda a: [[a**2, a, 1.0]], {"a": 0.5}, [0.0], ["y", "z", "constant"])
    ends = np.zeros((1, 3)), np.array([[1.0, 1.0, 0.0]])
    rough, exact = (Reference("Scanning(3)", *ends, np.array([e, 0.01, 9.0]), 3, 0, 1.0) for e in (0.12, 0.0))
    assert _doubt_of_reference(f, exact) == []
    (told,) = _doubt_of_reference(f, rough)
    assert told.startswith("The reference Scanning(3) is uncertain: y by 0.12 of its width. Errors of bounds below")
