"""Check runs: methods without an estimate of their error say where runs, their polynomial and their bounds disagree."""

import warnings

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box_bounds, quietly, reloaded, unit_function
from conftest import ALL_MODELS
from faults import refused, warned
from machines import ball, rods
from scipy.special import ellipj, ellipk
from small_scenes import particle

import symmb as mb
from models import double_pendulum
from symmb.equations.model import unused_parameters
from symmb.run.simulation import DAESimulator

FOUND = "Check runs show errors"
T = np.linspace(0.0, 5.0, 101)


def function(f, d=2, **named):
    return unit_function(lambda x: f(*x) * np.ones(len(T)), d, T, **named)


def study(f, method=None, d=2, **named):
    simulator, box = function(f, d, **named)
    return mb.propagate(simulator, method or mb.Vertex(), box)


def oscillator(periods, spread=0.05, number=501):
    """x = cos(sqrt(k) t)."""
    times = np.linspace(0.0, 2 * np.pi * periods, number)
    return particle(lambda p, mass: -p.k * mass.x, times, {"mass.x": 1.0}, k=(1 - spread, 1 + spread))


PAPER, ORDER_8 = mb.PolynomialChaos.paper(2), mb.PolynomialChaos(order=8)


@pytest.mark.parametrize("method", [mb.Taylor(2), mb.Taylor(4), mb.Vertex(), mb.Scanning(7), PAPER, ORDER_8], ids=repr)
@pytest.mark.parametrize("periods", [130, 200])
def test_long_horizons_are_doubted(method, periods):
    bounds = warned(FOUND, mb.propagate, oscillator(periods), method)
    assert len(bounds.doubts) == 1 and bounds.evaluations == method.planned_runs(1)


@pytest.mark.parametrize("method", [mb.Taylor(5), ORDER_8, mb.Scanning(21)], ids=repr)
def test_short_horizons_are_not(method):
    assert not mb.propagate(oscillator(2, number=41), method).doubts


@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_corners_are_right_where_responses_are_monotone(d):
    assert not study(lambda *x: np.exp(0.4 * sum(x) + 0.1 * T), d=d).doubts


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("at", [-0.4, 0.0, 0.3])
def test_extremes_inside_are_found_beyond_corners(d, at):
    warned("outside of the bounds", study, lambda *x: -((x[0] - at) ** 2) + 0.5 * sum(x[1:]), d=d)


@pytest.mark.parametrize("method", [mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(3), mb.Vertex()], ids=repr)
@pytest.mark.parametrize("frequency", [17.0, 29.0, 31.0])
def test_waves_between_the_nodes_are_doubted(method, frequency):
    warned(FOUND, study, lambda a, b: np.sin(frequency * a + T) + b, method)


@pytest.mark.parametrize("factor", [1e-200, 1e-20, 1.0, 1e20, 1e200])
def test_doubts_do_not_depend_on_units(factor):
    wide, other = (warned(FOUND, study, lambda a, b, s=s: s * np.cos(3 * a + T) * (2 + b)) for s in (factor, 1.0))
    assert other.doubts == wide.doubts


def test_noise_that_is_told_is_no_disagreement():
    rng = np.random.default_rng(1)
    f, told = lambda a, b: 1e-3 * a + rng.uniform(-1e-2, 1e-2), "noise of the runs is larger than the width"
    bounds = warned(told, study, f, noise={"y": 2e-2})
    assert len(bounds.doubts) == 1


def test_a_failed_check_run_is_told():
    def response(a, b):
        if abs(a) < 0.5:
            raise ValueError("no equilibrium")
        return a + b

    warned("A check run failed, although no run of the method failed: .*equilibri", study, response)


@pytest.mark.parametrize("d", [10, 13])
def test_many_parts_in_many_parameters_are_refused_with_their_number(d):
    simulator, box = function(lambda *x: 0.0, d)
    object.__setattr__(simulator, "jets", pytest.fail)
    told, method = f"takes {2**d} expansions in {d} parameters", mb.Taylor(3, subintervals=2)
    refused(told, mb.propagate, simulator, method, box, error=mb.PropagationError)


def test_a_comparison_has_the_doubts_of_its_studies(tmp_path):
    """What check runs find stands in the rows: the comparison measures it."""
    scene = oscillator(130)
    methods = [mb.Taylor(2), mb.Vertex(), mb.PolynomialChaos(seconds=600.0)]
    found = mb.compare(scene, methods)
    for method, row in zip(methods[:2], found.rows, strict=False):
        assert row.doubts == warned("", mb.propagate, scene, method).doubts
    assert not found.rows[2].doubts and not found.doubts
    assert reloaded(found, tmp_path / "c.json").rows[0].doubts == found.rows[0].doubts


@pytest.mark.parametrize("budget", [20, 30])
def test_a_comparison_doubts_what_its_studies_doubt(budget):
    scene, method = oscillator(200), mb.PolynomialChaos(budget=budget)
    told = "The estimated error is above 10 % of the width"
    own = warned(told, mb.propagate, scene, method).doubts
    found = warned(told, mb.compare, scene, [method, mb.Scanning(21)])
    assert found.doubts == tuple(f"{method!r}: {doubt}" for doubt in own)


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize(
    "method", [mb.MonteCarlo(50), mb.Vertex(), mb.PolynomialChaos(order=2), mb.Scanning(3)], ids=repr
)
def test_the_number_of_check_runs_is_told(method, d):
    calls = 0

    def f(*x):
        nonlocal calls
        calls += 1
        return sum(x) + 0.1 * x[0] ** 2

    # 50 samples end far before the corners of four parameters
    bounds = quietly(study, f, method, d)
    assert bounds.evaluations == method.planned_runs(d) < calls
    (told,) = [remark for remark in bounds.remarks if "checked these bounds" in remark]
    assert told.startswith(f"{calls - bounds.evaluations} further runs")


def test_methods_with_an_estimate_have_no_check_runs():
    bounds = study(lambda a, b: a + b**2, mb.PolynomialChaos())
    assert not any("checked these bounds" in remark for remark in bounds.remarks)


@pytest.mark.parametrize(("n", "told"), [(1, "1 further run checked"), (2, "2 further runs checked")])
def test_one_check_run_is_told_in_the_singular(monkeypatch, n, told):
    monkeypatch.setattr("symmb.bound.propagation.doubts.check_doubts", lambda *_: ((), n))
    bounds = study(lambda a: a, d=1)
    assert f"{told} these bounds. The number of evaluations does not include them." in bounds.remarks


# Studies look at their nominal run and at one corner of the box in another way

TIMES = np.linspace(0.0, 2.0, 41)


def wrong_simulator(at_nominal):
    """Outputs in coordinates of joints that are wrong at the nominal parameters, or at all others only."""
    simulator = DAESimulator(double_pendulum.scene().with_times(TIMES))
    form = simulator.program.forms.joints
    x, p, t = (ca.SX.sym(name, form.y.numel_in(k)) for k, name in enumerate(("x", "p", "t")))
    y = form.y(x, p, t) + t * (1 if at_nominal else p[0] - simulator.dae.p_nominal[0])
    return simulator._by(simulator.program.with_outputs(ca.Function("y", [x, p, t], [y])))


@pytest.mark.parametrize("method", [mb.Vertex(), mb.PolynomialChaos(), mb.Taylor(2), mb.MonteCarlo(20)], ids=repr)
@pytest.mark.parametrize("at_nominal", [True, False])
def test_what_is_wrong_in_one_way_is_a_doubt(method, at_nominal):
    simulator, box = wrong_simulator(at_nominal), mb.Box(l1=(0.95, 1.05), l2=(0.95, 1.05))
    where = "l1 = 1, l2 = 1" if at_nominal else "l1 = 1.05, l2 = 0.95"
    bounds = warned("exceed a thousandth of their range", mb.propagate, simulator, method, box)
    assert sum(f"s and {where}, " in doubt and "CVODES" in doubt for doubt in bounds.doubts) == 1
    found = warned(where, mb.compare, simulator, method, box, reference=mb.Vertex())
    assert any(where in doubt for doubt in found.doubts)


def test_right_studies_have_no_doubt():
    bounds = mb.propagate(double_pendulum.scene().with_times(TIMES), mb.PolynomialChaos())
    assert not bounds.doubts and not bounds.remarks


def swinging(amplitude, periods, spread):
    """A rod's scene, and the range of its angle (2, n_t) by Jacobi's elliptic functions."""
    machine, box = rods(1), mb.Box(length=(1 - spread, 1 + spread))
    k = np.sin(amplitude / 2) ** 2
    times = np.linspace(0, periods * 4 * ellipk(k) / np.sqrt(1.5 * 9.81), 307)[:-3]
    scene = machine.scene({"angle": machine.body.theta}, times, {"rod0.theta": amplitude}, box=box)
    lengths = np.linspace(1 - spread, 1 + spread, 201)[:, None]
    angles = 2 * np.arcsin(np.sqrt(k) * ellipj(ellipk(k) - np.sqrt(1.5 * 9.81 / lengths) * times, k)[0])
    return scene, np.array([angles.min(axis=0), angles.max(axis=0)])


def miss(bounds, truth):
    """The largest error over the largest width."""
    return np.abs(np.array(bounds["angle"]) - truth).max() / np.ptp(truth, axis=0).max()


@pytest.mark.parametrize("method", [mb.Vertex(), mb.PolynomialChaos()], ids=repr)
@pytest.mark.parametrize(("amplitude", "periods", "spread"), [(2.5, 90, 1e-6), (2.0, 150, 1e-7), (2.8, 60, 1e-6)])
def test_errors_of_runs_that_are_large_beside_the_width_are_a_doubt(method, amplitude, periods, spread):
    scene, truth = swinging(amplitude, periods, spread)
    bounds = warned(r"errors of angle exceed 2% of the width of their bounds: at t = ", mb.propagate, scene, method)
    assert miss(bounds, truth) > 0.02
    bounds = mb.propagate(scene, method, solver=mb.DormandPrince(rtol=1e-12))
    assert miss(bounds, truth) < 0.02 and not bounds.doubts


# A parameter of the box on which nothing of a scene depends is a doubt about its bounds

DOUBT = (
    "length is in the box, but nothing in the scene depends on length. "
    'Use the symbol p.length; p["length"] is a number.'
)


def pendulum(is_symbol, **more):
    """A hanging rod, built of the symbol of its length or of its nominal value."""
    p = mb.Parameters(length=1.0, other=0.1)
    L = p.length if is_symbol else p["length"]
    rod = mb.Body("rod", mass=1.0, inertia=L**2 / 12, pose=mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-L / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    options = {"start": {"rod.theta": 0.0}, "outputs": {"tip": rod.point(L / 2, 0).y}, **more}
    return mb.Scene(system, times=np.linspace(0.0, 0.2, 5), box=mb.Box(length=(0.9, 1.1)), **options)


@pytest.mark.parametrize(
    "method", [mb.PolynomialChaos(), mb.Vertex(), mb.MonteCarlo(5), mb.Taylor(2), mb.TaylorModel()], ids=repr
)
def test_number_in_the_place_of_the_symbol_is_a_doubt(method):
    bounds = warned("nothing in the scene depends on ", mb.propagate, pendulum(False), method)
    assert bounds.doubts.count(DOUBT) == 1
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Check runs show errors", mb.SymmbWarning)  # of few samples
        assert DOUBT not in mb.propagate(pendulum(True), method).doubts


def test_limits_tolerances_and_comparisons_are_doubted():
    scene, limits = pendulum(False), {"tip": (-1.0001, None)}
    told = "nothing in the scene"
    assert "warning" in str(warned(told, mb.propagate, scene, mb.Vertex()).check(limits))
    assert DOUBT in warned(told, mb.tolerances, scene, limits).bounds.doubts
    compared = warned(told, mb.compare, scene, [mb.Vertex(), mb.Scanning(3)], reference=mb.Vertex())
    assert compared.doubts.count(DOUBT) == 1


def test_fixed_parameter_is_no_doubt():
    mb.propagate(pendulum(True), mb.Vertex(), mb.Box(length=(0.9, 1.1), other=(0.1, 0.1)))


def test_start_guess_and_outputs_count():
    scene = pendulum(True)
    p = scene.system.parameters
    others = [{name: {"rod.theta": p.other}} for name in ("start", "guess")]
    for options in ({}, *others, {"outputs": {"y": p.other}}):
        other = mb.Scene(scene.system, times=[0.0], **{"outputs": scene.outputs, **options})
        assert unused_parameters(other, ["length", "other"]) == (() if options else ("other",))


def test_states_events_and_held_values_count():
    elements = (
        lambda m: mb.State("level", rate=lambda z: m.p.rate - z),
        lambda m: mb.Impact("floor", m.ball.y - m.p.gap, restitution=m.p.e),
        lambda m: mb.Sampled("held", period=0.1, law=m.p.law * m.ball.y),
    )
    machine = ball(*elements, rate=1.0, begin=0.2, e=0.5, gap=0.1, law=2.0)
    scene = machine.scene("y", [0.0, 0.1], {"ball.y": 1.0, "level": machine.p.begin})
    assert unused_parameters(scene, machine.p) == ()


@pytest.mark.parametrize("model", ALL_MODELS, ids=lambda model: model.__name__)
def test_shipped_scenes_use_their_parameters(model):
    scene = model.scene()
    assert unused_parameters(scene, scene.box.names) == ()


def test_parameters_of_a_function_that_change_nothing_are_named():
    """The square of b is even, so that no polynomial of first degree sees it: it is not named."""
    box = dict.fromkeys("abc", (-1, 1))
    for method in (mb.PolynomialChaos(), mb.PolynomialChaos(order=1), mb.PolynomialChaos(order=2)):
        bounds = quietly(black_box_bounds, lambda a, b, c, d: a + b**2, method, **box, d=(0, 0))
        (told,) = [text for text in bounds.remarks if "no output" in text]
        assert told.startswith("c changes no output in the runs of the study")
