"""The row of small studies: what it prints, what each study decides, and that a tolerance holds or is told."""

import math

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box, black_box_bounds, quietly, rms
from faults import refused
from machines import pendulum, spring_mass

import symmb as mb
from symmb.bound.adaptive import outputs
from symmb.bound.adaptive.check_rounds import IDLE_ROUNDS
from symmb.bound.adaptive.clock import Clock
from symmb.bound.adaptive.first_grid import FirstGrid
from symmb.bound.adaptive.runs import Runs
from symmb.bound.adaptive.small_study import Problem
from symmb.bound.adaptive.studies import decided, row, studies
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.run.simulation import Subject

T = np.linspace(0.0, 2.0, 61)


def problem(simulator, box, tolerance=1e-2, most=5000):
    return Problem(Runs(simulator, box, most, None, None, Clock(None)), tolerance, is_patient=False)


def swing(**box):
    machine = pendulum(angle=0.5)
    scene = machine.scene("theta omega", T, {"rod.theta": machine.p.angle}, box=mb.Box(**box))
    return Subject.of(scene).over()


def test_the_row_says_when_each_study_is_used():
    text = str(mb.PolynomialChaos().studies)
    assert [line.split(",")[0] for line in text.splitlines() if line[0] != " "] == [
        f"{k}. {study.name}" for k, study in enumerate(studies(), 1)
    ]
    assert "1. first grid, if runs of a scene of two" in text and "checks 12" in text
    refused("has one grid", lambda: mb.PolynomialChaos(order=3).studies)


@pytest.mark.parametrize("study", studies(), ids=lambda study: study.name)
def test_numbers_of_a_study_cannot_be_changed(study):
    with pytest.raises(AttributeError):
        study.name = "other"


TWO = {"angle": (0.4, 0.6), "length": (0.9, 1.1)}


@pytest.mark.parametrize("box", [TWO, {**TWO, "g": (9.7, 9.9)}], ids=len)
def test_a_first_grid_decides_smooth_outputs_alone(box):
    own = problem(*swing(**box))
    assert FirstGrid().accepts(own)
    ranges, is_decided = FirstGrid().ranges(own)
    assert is_decided.all() and sorted(ranges) == [0, 1]
    simulator, whole = swing(**box)
    true = mb.propagate(simulator, mb.Scanning(9), whole)
    for k, found in ranges.items():
        width = rms(true.upper[:, k] - true.lower[:, k])
        errors = np.maximum(true.lower[:, k] - found.upper[:, 0], found.lower[:, 0] - true.lower[:, k])
        assert errors.max() <= 1e-2 * width and rms(found.estimate) <= 1e-2 * width


def test_a_first_grid_needs_side_by_side_runs_and_a_budget():
    assert not FirstGrid().accepts(problem(*black_box(lambda a, b: a * b, a=(0, 1), b=(0, 1))))
    assert not FirstGrid().accepts(problem(*swing(**TWO), most=10))
    assert not FirstGrid().accepts(problem(*swing(angle=(0.4, 0.6))))  # secants find kinks of one parameter


def test_outputs_that_a_study_decides_are_left_to_no_other():
    own = problem(*swing(**TWO))
    found = decided(own)
    assert not own.open.any() and found.lower.shape == (len(T), 2)
    first = next(row())
    assert len(own.runs) == len(first._first(own.runs).alpha) + first.checks


@pytest.mark.parametrize("seed", range(4))
def test_an_unresolved_oscillation_is_not_halved(seed):
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(15, 25), rng.uniform(0, 6)
    bounds = black_box_bounds(lambda x: math.sin(rate * x + phase), x=(-1, 1))
    assert bounds.evaluations <= 80 and np.abs([bounds.lower + 1, bounds.upper - 1]).max() < 1e-2


@pytest.mark.parametrize("seed", range(2))
def test_kinks_of_two_parameters_take_few_runs(seed):
    rng = np.random.default_rng(seed)
    (a, b), slope = rng.uniform(-0.6, 0.6, 2), rng.uniform(0.2, 0.8)

    def f(x, y):
        return np.abs(x + slope * y - a) - 0.5 * x + 0.3 * np.abs(y - b)

    bounds = black_box_bounds(f, x=(-1, 1), y=(-1, 1))
    values = f(*np.meshgrid(np.linspace(-1, 1, 801), np.linspace(-1, 1, 801)))
    error = max(abs(bounds.lower[0, 0] - values.min()), abs(bounds.upper[0, 0] - values.max()))
    assert bounds.evaluations <= 600
    assert error <= bounds.estimate[0, 0] + 1e-2 * np.ptp(values)


TOLERANCES = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5]
HARD = {
    "smooth": lambda a, b: np.exp(a - 0.3 * b) * np.sin(3 * T + a),
    "kink": lambda a, b: np.abs(a - 0.4 * b * T),
    "ratio": lambda a, b: 1 / (1.2 + a * np.cos(T + b)),
}


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("law", HARD.values(), ids=HARD)
def test_an_estimate_is_within_the_tolerance_or_a_remark_says_why_not(law, tolerance):
    method = mb.PolynomialChaos(tolerance=tolerance, budget=400)
    bounds = quietly(black_box_bounds, law, method, T, a=(-1, 1), b=(-1, 1))
    told = rms(bounds.estimate, 0) / rms(bounds.upper - bounds.lower, 0)
    assert (told.max() > tolerance) == any("was not reached" in remark for remark in bounds.remarks)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_the_tolerance_of_a_scene_holds_or_is_told(tolerance):
    machine = spring_mass(v=1.0)
    box = mb.Box(stiffness=(3.0, 5.0), v=(0.9, 1.1))
    scene = machine.scene("x vx", T, {"ball.x": 0.1, "ball.vx": machine.p.v}, box=box)
    bounds = quietly(mb.propagate, scene, mb.PolynomialChaos(tolerance=tolerance))
    told = rms(bounds.estimate, 0) / rms(bounds.inner[1] - bounds.inner[0], 0)
    assert (told.max() > tolerance) == any("was not reached" in remark for remark in bounds.remarks)
    assert tolerance < 1e-4 or told.max() <= tolerance


@pytest.mark.parametrize("place", [-0.35, 0.1, 0.45])
def test_a_late_kink_of_one_parameter_is_found_in_scenes(place):
    """Runs of a first grid would not be near the kink, which lasts for a tenth of the time."""
    machine = spring_mass(x=0.0)
    late = 0.2 * machine.p.x * (1 + mb.t) + 3 * ca.exp(-(((mb.t - 1) / 0.2) ** 2)) * ca.fabs(machine.p.x - place)
    bounds = mb.propagate(machine.scene({"y": late}, T, box=mb.Box(x=(-1, 1))))
    lowest = bounds["y"][0][np.argmin(np.abs(T - 1))]
    assert lowest == pytest.approx(0.4 * place, abs=0.02)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_a_tolerance_over_allowed_points_holds_or_is_told(tolerance):
    times = np.linspace(0, 1, 5)
    simulator = mb.FunctionSimulator(lambda a, c: 2 * a * np.cos(times * c) + a * a, {"a": 1.0, "c": 2.0}, times, ["y"])
    box = mb.Box(a=(0.0, 2.0), c=(1.0, 3.0), constraints=[lambda p: p.a + p.c - 3])
    bounds = quietly(mb.propagate, simulator, mb.PolynomialChaos(tolerance=tolerance), box)
    told = rms(bounds.estimate, 0) / rms(bounds.upper - bounds.lower, 0)
    assert (told.max() > tolerance) == any("was not reached" in remark for remark in bounds.remarks)


def test_constraints_of_choices_alone_need_no_polynomials():
    simulator = mb.FunctionSimulator(lambda n, c: [10.0 * n + c], {"n": 2, "c": 1}, [0.0], ["y"])
    bounds = mb.propagate(simulator, box=mb.Box(n={2, 3}, c={1, 2}, constraints=[lambda p: p.n - 2.5]))
    assert (bounds.lower[0, 0], bounds.upper[0, 0]) in {(21.0, 22.0), (31.0, 32.0)}


def test_an_interrupted_study_keeps_the_combinations_that_are_finished():
    class Interrupted:
        def __init__(self):
            self.runs = 0

        def __call__(self, n, a):
            self.runs += n == 3
            if self.runs > 5:
                raise KeyboardInterrupt
            return [10 * n + a**2]

    simulator = mb.FunctionSimulator(Interrupted(), {"n": 2, "a": 1.0}, [0.0], ["y"])
    with pytest.raises(KeyboardInterrupt) as caught:
        mb.propagate(simulator, box=mb.Box(n={2, 3}, a=(0.0, 2.0)))
    partial = caught.value.partial
    assert partial["y"][0][0] == pytest.approx(20.0) and any("interrupted" in doubt for doubt in partial.doubts)


@pytest.mark.parametrize("use", [mb.propagate, mb.compare, mb.sweep, mb.simulate, mb.prepare], ids=lambda f: f.__name__)
def test_a_class_in_place_of_a_scene_is_refused(use):
    more = [{"a": [1.0]}] if use is mb.sweep else []
    refused("Scene", lambda: use(mb.Scene, *more))


def test_the_reason_names_what_would_help():
    cusp = quietly(black_box_bounds, lambda x, y: np.sqrt(np.abs(x + 0.61 * y - 0.13)), x=(-1, 1), y=(-1, 1))
    few = quietly(black_box_bounds, lambda x, y: np.sin(9 * x * y), mb.PolynomialChaos(budget=30), x=(-1, 1), y=(-1, 1))
    for bounds, used_up in ((cusp, False), (few, True)):
        if any("was not reached" in remark for remark in bounds.remarks):
            assert ("budget" in bounds.why("y")) == used_up


@pytest.mark.parametrize("gap", (0.094, 0.0941))
def test_a_stop_that_few_corners_reach_is_seen(gap):
    """The force of the stop is 0 in nearly the whole box. The bounds were 0 and 0, and limits were satisfied."""
    p = mb.Parameters(mass=1.0, stiffness=100.0, speed=1.0, damping=2.0, gap=gap, force=0.0, start=0.0, load=1.0)
    ground, block = mb.Ground(), mb.Body("block", p.mass, 1.0)
    rail = mb.Prismatic("rail", ground.point(0, 0), block.point(0, 0), axis=(1, 0, 0))
    force = 0.1 * (p.load - 1) + p.force - p.stiffness * rail.displacement - p.damping * rail.displacement_rate
    stop = mb.Stop("stop", rail, upper=p.gap, law=mb.KelvinVoigt(1e5, 50.0))
    system = mb.System(block, rail, mb.Actuator("spring", rail, force), stop, parameters=p)
    box = mb.Box.plus_minus(
        p, mass=0.02, stiffness=2.0, speed=0.03, damping=0.2, gap=0.0015, force=0.1, start=0.0015, load=0.1
    )
    start = {"rail.displacement": p.start, "rail.displacement_rate": p.speed}
    scene = mb.Scene(system, start, np.linspace(0, 0.5, 51), {"blow": mb.maximum(system.force("stop"))}, box)
    bounds, vertex = mb.propagate(scene), mb.propagate(scene, mb.Vertex())
    assert bounds["blow"] == pytest.approx(vertex["blow"], rel=1e-3) and vertex["blow"][1] > 10
    assert bounds.check({"blow": (None, 5.0)}).kept is False


def test_an_error_stays_until_further_runs(monkeypatch):
    """A round of check runs that makes no run finds no error, but refutes none either."""
    errors = iter([0.4, 0.0, 0.1])

    class Rounds:
        def __init__(self, *of_study):
            pass

        def steps(self):
            yield from ()
            low, high, error = np.zeros((1, 1)), np.ones((1, 1)), np.full((1, 1), next(errors))
            return EstimatedRange(low, high, Evidence.of("gains", error), None, "a grid")

    monkeypatch.setattr(outputs, "CheckRounds", Rounds)
    problem = object.__new__(outputs.OutputProblem)
    known = {"expansion": None, "grid": None, "sizes": {}, "estimate": None, "tolerance": 0.0}
    vars(problem).update(known, runs=[1], _gain=outputs.Gain(), _checked=(0, None))
    told = []
    for runs in ([1], [1], [1, 2]):
        problem.runs = runs
        with pytest.raises(StopIteration) as end:
            next(problem.corrected(False))
        told.append(end.value.value.estimate[0, 0])
    assert told == [0.4, 0.4, 0.1]


def test_rounds_are_idle_if_their_least_error_stays():
    gain = outputs.Gain()
    assert not any(gain.is_idle(0.8**k) for k in range(40))
    assert [gain.is_idle(1.0) for _ in range(IDLE_ROUNDS)] == [False] * (IDLE_ROUNDS - 1) + [True]
