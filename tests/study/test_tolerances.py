"""Tolerances against closed forms, and limits in many runs."""

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box
from faults import refused, warned
from machines import ORIGIN, ball, spring_mass
from small_scenes import particle

import symmb as mb
from models import four_bar


def chain(limits, box=None, *costs):
    f = mb.FunctionSimulator(lambda a, b, c: [[a + b - c]], {"a": 1.0, "b": 2.0, "c": 2.9}, [0.0], ["gap"])
    return mb.tolerances(f, limits, box or BOX, *costs)


def found_for(f, limits, costs=None, nominal=None, outputs="y", **box):
    """Tolerances of a black box: of its first output if the limits are a pair."""
    simulator, intervals = black_box(f, outputs=outputs, nominal=nominal, **box)
    return mb.tolerances(simulator, limits if isinstance(limits, dict) else {"y": limits}, intervals, costs=costs)


BOX = mb.Box(a=(0.9, 1.1), b=(1.98, 2.02), c=(2.85, 2.95))
HALF = np.array([0.1, 0.02, 0.05])


@pytest.mark.parametrize(("nominal", "low", "high"), [(2.0, 1.5, 2.1), (-2.0, -2.1, -1.8), (2.0, 1.0, 2.5)])
@pytest.mark.parametrize("costs", [None, {}])
def test_parameters_whose_interval_has_one_sign_keep_it(nominal, low, high, costs):
    """A mass or a length below 0 is none: far limits are no reason for one."""
    found = found_for(lambda a: a, (-50.0, 50.0), costs, {"a": nominal}, a=(low, high))
    assert found.remarks == ("The search ends here, because with larger tolerances a would reach 0.",)
    if costs is None:
        assert found.binding is None
    closest = found.box.lower[0] if nominal > 0 else -found.box.upper[0]
    assert 0 < closest < 0.03


@pytest.mark.parametrize(("nominal", "low", "high"), [(0.05, 0.0, 0.1), (-0.05, -0.07, 0.0), (0.05, 1e-4, 0.1)])
@pytest.mark.parametrize("costs", [None, {}])
def test_an_interval_that_ends_at_0_keeps_its_sign(nominal, low, high, costs):
    """A stiffness or a damping may be 0, but it cannot be below 0. The given box is not reduced."""
    found = found_for(lambda a, b: a + b, (-50.0, 50.0), costs, {"a": nominal}, a=(low, high), b=(2.0, 4.0))
    assert found.factors["a"] == pytest.approx(1, rel=2e-3)
    a = found.box["a"]
    assert a == pytest.approx((low, high), abs=1e-4) and min(a) * max(a) >= 0
    assert found.factors["b"] == pytest.approx(1 if costs is None else 0.99 * 3, rel=2e-3)
    assert found.remarks[-1].startswith("The search ends here, because with larger tolerances a")


@pytest.mark.parametrize(("costs", "most"), [(None, 30.0), ({}, 3.6)])
def test_a_parameter_without_effect_is_named_and_does_not_end_the_search(costs, most):
    """Before the limit is reached, the interval of `idle` would contain 0."""
    f = lambda a, idle: [a, 2 * idle]  # noqa: E731
    found = found_for(f, (None, most), costs, outputs="y other", a=(2.9, 3.1), idle=(0.2, 1.8))
    text = "In this box idle has no effect on outputs with limits."
    assert found.remarks == (text,) and text in str(found)
    assert found.factors["idle"] == pytest.approx(0.99 * 1.25) and found.box.lower[1] > 0
    assert found.factor == found.factors["a"] == pytest.approx(16 if costs is None else 6, rel=2e-3)
    assert (found.binding is None) == (costs is None)


def test_no_limit_binds_if_no_parameter_has_an_effect():
    found = found_for(lambda a, idle: [a, 2 * idle], (None, 4.0), None, {"a": 3.0}, "y other", idle=(0.2, 1.8))
    assert found.remarks[0].startswith("In this box idle has no effect") and len(found.remarks) == 1
    assert found.binding is None and found.check.kept


def test_a_parameter_that_cancels_in_a_scene_is_named():
    machine = ball(lambda m: mb.Spring("spring", ORIGIN, m.at, m.p.k * m.p.mass), k=4.0, g=None)
    scene = machine.scene("x", [0.0, 0.5, 1.0], {"ball.x": 1.0}, box=mb.Box(mass=(0.5, 1.5), k=(3.9, 4.1)))
    found = mb.tolerances(scene, {"x": (-0.45, None)})
    assert [text for text in found.remarks if text.startswith("In this box mass has no effect")]
    assert found.factor == pytest.approx(1.51, rel=1e-2) and found.binding


def test_an_interval_from_a_nominal_value_of_0_is_scaled():
    found = found_for(lambda a: a, (None, 0.3), None, {"a": 0.0}, a=(0.0, 0.1))
    assert found.factor == pytest.approx(3, rel=2e-3) and found.box.lower[0] == 0


def test_the_cheapest_chain():
    """The least sum of 1 / s_i with sum s_i h_i = w has s_i = w / (sqrt(h_i) sum sqrt(h))."""
    found = chain({"gap": (None, 0.25)}, BOX, {})
    assert found.cost == pytest.approx(np.sqrt(HALF).sum() ** 2 / 0.15, rel=2e-3)
    best = 0.15 / np.sqrt(HALF).sum() / np.sqrt(HALF)
    assert np.allclose([*found.factors.values()], best, rtol=0.02)
    assert found.factor == min(found.factors.values())
    own = chain({"gap": (None, 0.25)}, BOX, {"a": lambda h: 9 / h, "b": lambda h: 1 / h})
    weights = np.array([9 * 10, 1 * 50, 1.0]) / [1, 1, 1]  # costs over 1 / s_i
    best = np.sqrt(weights / HALF)
    best *= 0.15 / (best @ HALF)
    assert np.allclose([*own.factors.values()], best, rtol=0.05)
    assert own.cost == pytest.approx((weights / best).sum(), rel=5e-3)


def test_deviations_to_one_side_stay_there():
    found = chain({"gap": (None, 0.25)}, mb.Box(a=(1.0, 1.1), b=(2.0, 2.0)))
    assert found.box.bounds[0] == (1.0, pytest.approx(1.15, rel=1e-3))
    assert found.box.bounds[1] == (2.0, 2.0)


@pytest.mark.long
def test_the_box_of_a_four_bar_keeps_its_limits_in_many_runs():
    scene = four_bar.scene()
    found = mb.tolerances(scene, {"coupler_angle": (0.47, None)})
    simulator = mb.DAESimulator(scene)
    P = np.tile(np.array([*simulator.parameters.values()]), (10_000, 1))
    columns = [[*simulator.parameters].index(name) for name in found.box.names]
    rng = np.random.default_rng(5)
    sides = rng.choice([-1, 0, 1], (len(P), 4))
    inside = rng.uniform(found.box.lower, found.box.upper, (len(P), 4))
    P[:, columns] = np.where(sides < 0, found.box.lower, np.where(sides > 0, found.box.upper, inside))
    y = simulator.run(P).Y[:, :, simulator.outputs.index("coupler_angle")]
    least = y.min()
    k = found.bounds.names.index("coupler_angle")
    assert least >= 0.47 - found.bounds.estimate[:, k].max()
    assert least == pytest.approx(0.47, abs=5e-3 * abs(y[:, 0].mean() - 0.47))  # the box is not much too small


def test_outputs_without_a_limit_take_no_part():
    scene = particle(lambda p, mass: -p.k * mass.x, np.linspace(0, 1, 5), {"mass.x": 1.0}, k=(1.9, 2.1))
    both = scene.with_outputs({"wave": ca.sin(40 * scene.outputs["x"]), **scene.outputs})
    limits = {"x": (0.1, None)}
    found, beside = (mb.tolerances(each, limits) for each in (scene, both))
    assert (beside.factor, beside.evaluations, beside.bounds.names) == (found.factor, found.evaluations, ("x",))
    assert found.factor == pytest.approx((np.arccos(0.1) ** 2 - 2) / 0.1, rel=2e-3)


def test_parameter_that_acts_on_an_output_without_a_limit_is_used():
    machine = spring_mass(stiffness=2.0, w=1.0)
    x, w, box = machine.ball.x, machine.p.w, mb.Box(stiffness=(1.9, 2.1), w=(0.9, 1.1))
    outputs = {"x": x, "wave": w * x, "peak": mb.maximum(w * x)}
    scene = machine.scene(outputs, np.linspace(0, 1, 5), {"ball.x": 1.0}, box=box)
    found = mb.tolerances(scene, {"x": (0.1, None)})
    assert found.check.kept and not found.bounds.doubts and found.binding
    assert found.factor == pytest.approx((np.arccos(0.1) ** 2 - 2) / 0.1, rel=2e-3)


def test_no_limit_binds():
    narrow = mb.Box(a=(0.99, 1.01), b=(1.98, 2.02), c=(2.85, 2.95))
    found = chain({"gap": (None, 100.0)}, narrow)
    assert found.factor == pytest.approx(16) and found.binding is None
    assert "At least this box" in str(found) and "no limit up to 16 times" in str(found)


def test_runs_that_fail_bound_the_box():
    def root(a):
        if a < 0.5:
            raise ValueError("too thin")
        return a

    found = warned("runs failed", found_for, root, (-9.0, 9.0), a=(0.9, 1.1))
    assert found.factor == pytest.approx(5, rel=5e-3) and found.box.bounds[0][0] >= 0.5


@pytest.mark.parametrize("edge, most, factor", [(0.06, 3.9, 0.5), (0.2, 3.1, 1 / 1.2), (0.01, 3.08, 1 / 12)])
def test_the_reason_that_ends_the_search_is_named(edge, most, factor):
    """Runs fail if a + b is too large, or the limit is reached. tests/benchmarks/failing_tolerances.py has more."""

    def f(a, b):
        if a + b > 3 + edge:
            raise ValueError("does not assemble")
        return a + b

    fails = edge < most - 3
    call = dict(a=(0.9, 1.1), b=(1.98, 2.02))
    found = (
        warned("does not assemble", found_for, f, (None, most), **call) if fails else found_for(f, (None, most), **call)
    )
    assert found.factor == pytest.approx(factor, rel=1e-2)
    assert (found.binding is None) == fails == ("Runs fail with larger tolerances" in str(found))


@pytest.mark.parametrize(("at", "jump"), [(2.031, 0.05), (2.044, 0.02), (1.957, -0.03)])
@pytest.mark.parametrize("costs", [{}, {"a": lambda h: 0.05 / h}])
@pytest.mark.parametrize("most", [1.08, 1.2])
@pytest.mark.filterwarnings("ignore:tolerances. Larger tolerances:symmb.SymmbWarning")
def test_the_cheapest_box_is_found_with_inaccurate_polynomials(at, jump, costs, most):
    """Polynomials do not follow a jump, which the cheapest box may contain. Verified steps lead to this box."""
    sign = np.sign(at - 2.0)
    f = lambda a, b: a + 0.1 * (b - 2.0) + jump * (sign * (b - at) > 0)  # noqa: E731
    found = found_for(f, (None, most), costs, a=(0.95, 1.05), b=(1.99, 2.01))
    assert found.check.kept
    half_b = np.linspace(1e-3, 0.16, 10001)
    half_a = np.minimum(most - 1.0 - 0.1 * half_b - np.where(half_b > abs(at - 2.0), max(jump, 0.0), 0.0), 0.8)
    cheapest = (0.05 / half_a[half_a > 0] + 0.01 / half_b[half_a > 0]).min()
    assert cheapest * (1 - 1e-3) < found.cost < 1.02 * cheapest


def test_it_is_printed_and_labelled():
    found = chain({"gap": (None, 0.25)}, BOX, {})
    assert "cost" in str(found) and "highest gap" in str(found) and "<table" in found._repr_html_()
    assert found.to_xarray()["factor"].sel(parameter="b") == found.factors["b"]
    table = found.to_pandas()
    assert dict(zip(table.parameter, table.factor, strict=True)) == found.factors


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (({"no": (0, 1)}, BOX), "no output 'no'"), (({"gap": (1, 0)}, BOX), "is above"), (({}, BOX), "a dictionary"),
        (({"gap": (0, 1)}, mb.Box(a=(2, 3))), "outside of its"), (({"gap": (0, 1)}, BOX, 3), "costs must be"),
        (({"gap": (0, 1)}, BOX, {"q": abs}), "not in the box"), (({"gap": (0, 1)}, BOX, {"a": 3}), "function"),
        (({"gap": (0, 1)}, BOX, {"a": lambda h: np.nan}), "is not a number"),
        (({"gap": (0, 1)}, BOX, lambda h: 0), "costs must decrease with the tolerance. Give costs such as"),
        (({"gap": (0, 1)}, BOX, lambda h: 3 * h), "costs must decrease with the tolerance"),
    ],
)  # fmt: skip
def test_what_is_malformed_is_told(arguments, text):
    refused(text, chain, *arguments)


def test_all_limits_that_the_nominal_run_violates_are_named():
    with pytest.raises(mb.PropagationError, match=r"nominal run violates or reaches the limit .* of gap"):
        chain({"gap": (None, 0.05)})
    limits = {"x": (None, 0.9), "y": (None, 3.0), "z": (3.1, None)}
    with pytest.raises(mb.PropagationError, match=r"the limit 0.9 of x: 1; the limit 3.1 of z: 3\. "):
        found_for(lambda a: [a, 2 * a, 3 * a], limits, outputs="x y z", a=(0.9, 1.1))


@pytest.mark.parametrize("costs", [None, {}])
def test_runs_that_fail_next_to_the_nominal_parameters_leave_no_tolerances(costs):
    f = mb.FunctionSimulator(lambda k: [[k if k <= 1.0 else np.nan]], {"k": 1.0}, [0.0], ["y"])
    with pytest.raises(mb.PropagationError, match="runs next to the nominal parameters fail"):
        mb.tolerances(f, {"y": (None, 2.0)}, mb.Box(k=(0.5, 1.5)), costs)
