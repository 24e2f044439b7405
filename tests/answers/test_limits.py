"""Limits of bounds, where what is true is known in closed form."""

import pickle
import re

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest
from black_boxes import black_box_bounds, reloaded
from faults import refused
from machines import spring_mass
from small_scenes import formulas, particle

import symmb as mb
from symmb._doubt import Doubt
from symmb.bound.answers.further_runs import FurtherRun
from symmb.bound.answers.limits import by_further_run

T = np.linspace(0.0, 2.0, 21)


def waves(method=None, cap=np.inf):
    """Bounds of y = a sin t + b^2 t, from 0 up to 1.1 sin t + 0.25 t, and of z. A cap limits both."""
    f = lambda a, b: np.stack([a * np.sin(T) + b**2 * T, -a * np.sin(2 * T)], axis=1).clip(-cap, cap)  # noqa: E731
    return black_box_bounds(f, method, T, "y z", nominal={"b": 0.1}, a=(0.9, 1.1), b=(-0.5, 0.5))


TOP = float((1.1 * np.sin(T) + 0.25 * T).max())


def test_a_limit_close_to_a_stop_is_decided():
    """All parameters act on the motion, but only the place of the stop acts on the largest way."""
    v = {"mass": 75.0, "push": 450.0, "mu": 0.15, "stop": 0.2, "rebound": 0.4, "preload": 27.0}
    p, ground = mb.Parameters(**v), mb.Ground()
    slide = mb.Body("slide", p.mass, 6.0)
    rail = mb.Prismatic("rail", ground.point(0, 0), slide.point(0, 0), axis=(1, 0, 0))
    push = p.push * ca.fmax(1 - mb.t / 1.5, 0) + 200 * (p.stop - rail.displacement)
    shoes = mb.Friction(
        "shoes", ground.point(0, 0), slide.point(0, 0), (1, 0), p.mass * 9.81 + p.preload, mb.Coulomb(p.mu, 0.02)
    )
    stop = mb.Stop("end", rail, None, p.stop, restitution=p.rebound)
    system = mb.System(slide, rail, mb.Actuator("push", rail, push), shoes, stop, parameters=p)
    box = mb.Box(**{name: (0.96 * x, 1.04 * x) for name, x in v.items()} | {"stop": (0.1995, 0.2005)})
    bounds = mb.propagate(mb.Scene(system, times=np.linspace(0, 1.2, 121), outputs={"way": rail.displacement}, box=box))
    assert_kept(bounds, {0.2005 + 1e-5: True, 0.2005 - 1e-5: False}, "way")  # 2 % of the tolerance of the stop


def known(upper, error=None, kind="estimate", method="PolynomialChaos()", **more):
    """Bounds from 0 up to values (2, n_y) at 0 s and 1 s."""
    names = ("y", "z")[: upper.shape[1]]
    return mb.Bounds(np.array([0.0, 1.0]), names, 0 * upper, upper, kind, method, 9, estimate=error, **more)


def assert_kept(bounds, kept, name="y"):
    """Whether upper limits are satisfied."""
    assert {high: bounds.check({name: (None, high)}).kept for high in kept} == kept


def test_an_estimate_that_straddles_a_limit_does_not_decide():
    lower, upper = np.zeros((2, 1)), np.ones((2, 1))
    bounds = known(upper, np.full((2, 1), 0.1), inner=(lower + 0.05, upper - 0.05))
    assert_kept(bounds, {0.89: False, 0.92: False, 0.97: None, 1.05: None, 1.11: True})


@pytest.mark.parametrize(("inside", "kept", "word"), [(3.36e-4, True, "is larger"), (4e-9, None, "is not larger")])
def test_the_margin_of_further_runs_is_told_beside_the_error_of_the_search(inside, kept, word):
    run = FurtherRun("upper", np.zeros(1), np.array([1.0 - inside]), -inside, 6e-9, 42, 0, False)
    found = by_further_run(run, 1.0, np.array([1e-4]), 1e-12, " m")
    assert found.kept is kept
    assert found.why.startswith(f"The closest of 42 further runs is {inside:.3g} m inside the limit.")
    assert found.why.endswith(f" This margin {word} than the error of the search, 6e-09 m.")


def test_errors_count_at_their_times():
    """An error that is a large share of the width, at a time when the limit is far, decides nothing."""
    bounds = known(np.array([[1.0], [0.2]]), np.array([[0.01], [0.5]]))
    assert bounds.doubtful() and bounds.check({"y": (-0.1, None)}).kept is None
    assert_kept(bounds, {1.02: True, 0.95: False})


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("seed", [0, 6, 8])
def test_a_peak_that_passes_output_times_has_many_hills(seed):
    """It is highest where it meets an output time, and lower at later ones by a few parts of a thousand."""
    rng = np.random.default_rng(seed)
    fall, width, first = rng.uniform(0.01, 0.04), rng.uniform(0.06, 0.09), rng.uniform(0.42, 0.48)
    intervals = {"peak": (first, 0.9)} | dict.fromkeys("abcdef", (-1.0, 1.0))

    def pulse(p: mb.Parameters) -> dict:
        height = (1 - fall * p.peak) * ca.exp(0.3 * (p.a + p.b + p.c + p.d + p.e + p.f))
        return {"y": height * ca.exp(-(((mb.t - p.peak) / width) ** 2))}

    bounds = mb.propagate(formulas(pulse, T, **intervals), mb.PolynomialChaos(budget=200))
    peak = np.linspace(first, 0.9, 20_001)[:, None]
    top = float(((1 - fall * peak) * np.exp(1.8 - ((T - peak) / width) ** 2)).max())
    assert_kept(bounds, {top * (1 + share): share > 0 for share in (-0.01, -0.003, 0.003, 0.01)})


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("kink", [0.31, 0.7, -0.2, 0.123])
def test_a_parameter_without_effect_at_the_time_of_the_extreme_leaves_a_limit_decided(kink):
    """The cusp of x is at 0 s. The extreme 1.5 sin a is at 1 s, and the search ends at any x inside the box."""

    def cusp_then_sine(p: mb.Parameters) -> dict:
        return {"y": ca.if_else(mb.t < 0.5, ca.fabs(p.x - kink) ** 0.6, 1.5 * ca.sin(p.a))}

    scene = formulas(cusp_then_sine, np.array([0.0, 1.0]), a=(0.0, 1.5), x=(-1.0, 1.0))
    bounds, margin = mb.propagate(scene, mb.PolynomialChaos()), 4e-4
    (limit,) = bounds.check({"y": (None, 1.5 * np.sin(1.5) + margin)}).limits
    assert bounds.estimate.max() > margin  # of the cusp
    assert limit.kept is True and limit.further.error < margin, limit.why


@pytest.mark.parametrize(("low", "high", "also"), [(-0.5, 0.5, True), (-1.2, 0.5, False), (-0.5, 1.2, False)])
def test_both_violated_ends_of_a_limit_are_told(low, high, also):
    """x goes from -1 at 1 s to 1 at 2 s."""
    bounds = black_box_bounds(lambda k: [0.0, -k, k], None, [0.0, 1.0, 2.0], "x", nominal={"k": 0.7}, k=(0.1, 1.0))
    check = bounds.check({"x": (low, high)})
    told = [remark for remark in check.remarks if remark.startswith("In other cases x may")]
    assert check.kept is False and len(told) == also
    if also:
        pattern = r"In other cases x may (fall below|exceed) its limit of -?0\.5 by 0\.5 at [12] s\."
        assert re.fullmatch(pattern, told[0])


@pytest.mark.parametrize(("noise", "over", "kept"), [
    (None, 1e-15, None), (None, 1e-8, False), (1e-6, 1e-8, None), (1e-6, 1e-5, False), (0.0, 1e-15, None),
])  # fmt: skip
@pytest.mark.parametrize("kind", ["sampled", "estimate"])
def test_runs_beyond_a_limit_by_rounding_or_noise_decide_nothing(kind, noise, over, kept):
    lower, upper = np.zeros((2, 1)), np.array([[3.0], [2.0]])
    own = {"inner": (lower, upper), "noise": None if noise is None else np.array([noise])}
    bounds = known(upper, lower if kind == "estimate" else None, kind=kind, method="Vertex()", **own)
    check = bounds.check({"y": (None, 3.0 - over)})
    assert check.kept is kept and ("rounding or noise" in str(check)) == (kept is None)


@pytest.mark.parametrize("cap", [0.37, 0.711, 1 / 3])
def test_an_output_that_is_limited_to_a_value_satisfies_a_limit_of_this_value(cap):
    """Any looser limit as well. No run exceeds the value, but the polynomials do."""
    bounds = waves(cap=cap)
    for most in (cap, cap + 1e-3, cap + 0.1):
        check = bounds.check({"y": (None, most), "z": (-most, most)})
        assert check.kept and not any(" y may come closer" in remark for remark in check.remarks)
    why = bounds.check({"y": (None, cap)})["y"].why
    assert "further runs attain the limit exactly. No run is beyond the limit." in why
    assert bounds.check({"y": (None, cap * (1 - 1e-6))}).kept is False
    nearly = bounds.check({"y": (None, cap * (1 + 1e-12))})["y"]
    assert nearly.kept is None and nearly.why.endswith("For a decision, move the limit by more than this number.")


@pytest.mark.parametrize("cap", [2.9, 0.43])
def test_the_maximum_of_an_output_that_is_limited_to_a_value_is_this_value(cap):
    machine = spring_mass(v=1.0)
    pull = ca.fmin(10 * machine.ball.x, cap)
    outputs = {"pull": pull, "most": mb.maximum(pull), "least": mb.minimum(ca.fmax(-10 * machine.ball.x, -cap))}
    box = mb.Box(stiffness=(3.9, 4.1), v=(0.95, 1.05))
    bounds = mb.propagate(machine.scene(outputs, np.linspace(0, 2, 101), {"ball.x": machine.p.v}, box=box))
    assert np.all(np.array(bounds["most"]) == cap) and np.all(np.array(bounds["least"]) == -cap)
    assert bounds.check({"pull": (None, cap), "most": (None, cap), "least": (-cap, None)}).kept


def test_runs_hand_over_their_noise():
    machine = spring_mass(a=1.0)
    scene = machine.scene("x", np.pi * np.arange(5.0), {"ball.x": machine.p.a})
    bounds = mb.propagate(scene, mb.Vertex(), mb.Box(a=(0.9, 1.1)))  # x = a cos 2 t
    beyond = bounds["x"][1].max() - 1.1
    assert bounds.noise is not None and abs(beyond) < bounds.noise[0]
    assert bounds.check({"x": (None, 1.1 - bounds.noise[0] / 2)}).kept is None


def test_samples_only_violate():
    bounds = waves(mb.Scanning(5))
    assert_kept(bounds, {TOP - 0.01: False})
    check = bounds.check({"y": (None, TOP + 1)})
    assert check.kept is None and "25 runs satisfy the limit" in str(check)


def test_enclosures_prove():
    scene = particle(lambda p, mass: -p.k * mass.x, np.linspace(0, 1, 5), {"mass.x": 1.0}, k=(1.9, 2.1))
    bounds = mb.propagate(scene, mb.TaylorModel())
    low = np.cos(np.sqrt(2.1))
    assert bounds.check({"x": (low - 0.01, 1.01)}).kept is True
    assert "proved" in str(bounds.check({"x": (low - 0.01, None)}))
    assert bounds.check({"x": (low + 0.01, None)})["x"].why == "A run is beyond the limit."  # a run at the corner 2.1
    assert bounds.check({"x": (0.9, None)}).kept is False


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("method", "pce pce:2 vertex mc:3 taylor:2 tm:2 swarm:3".split())
def test_the_nominal_run_violates_a_limit_with_any_method(method):
    """x = a cos(sqrt(k) t) is above 1.2 at the nominal a, in all cases below 1.5, and the box may leave out this a."""
    machine = spring_mass(stiffness=2.0, a=1.3)
    box, start = mb.Box(stiffness=(1.9, 2.1), a=(1.1, 1.5)), {"ball.x": machine.p.a}
    scene = machine.scene("x", np.linspace(0, 1, 5), start, box=box)
    bounds = mb.propagate(scene, method)
    assert bounds.check({"x": (None, 1.3 - 1e-4)}).kept is False
    assert bounds.check({"x": (None, 1.6)}).kept is not False and not bounds.check({"x": (None, 1.6)}).remarks
    check = mb.propagate(scene, method, mb.Box(stiffness=(1.9, 2.1), a=(1.0, 1.1))).check({"x": (None, 1.2)})
    assert check.kept is not False
    remark = "The nominal values (a = 1.3) are outside of the box. The check does not include the nominal run."
    assert check.remarks == (remark,) and f"remark: {remark}" in str(check)


@pytest.mark.parametrize(("low", "high", "is_left_out"), [
    (0.3, 0.4, False), (0.2, 0.1 * 3, False), (0.3, 0.3, False), (0.31, 0.31, True), (0.1, 0.2, True),
])  # fmt: skip
@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e3), ("in", 1 / 0.0254)])
def test_ends_of_an_interval_hold_the_nominal_value(low, high, is_left_out, unit, factor):
    """Rounding moves ends, by another unit too. A fixed value that is not the nominal one leaves it out."""
    p, box = mb.Parameters(arm=(0.3, "m")), mb.Box(arm=(low * factor, high * factor, unit))
    scene = mb.Scene(mb.System(parameters=p), times=T, outputs={"y": p.arm * mb.t}, box=box)
    assert bool(mb.propagate(scene, mb.Vertex()).check({"y": (None, 9)}).remarks) == is_left_out


def test_a_run_is_made_for_the_nominal_values_where_nothing_else_decides():
    """A sample of a black box has no run there; one more decides, and a second check makes none."""
    calls = []
    f = lambda k: calls.append(k) or np.exp(-((k - 1) ** 2) / 1e-6) * T  # noqa: E731
    bounds = black_box_bounds(f, mb.MonteCarlo(9), T, nominal={"k": 1.0}, k=(0.5, 2.0))
    made = len(calls)
    for _ in range(2):
        assert bounds.check({"y": (None, 1.0)}).kept is False and calls[made:] == [1.0]
    assert bounds.check({"y": (None, 3.0)}).kept is None


def doubted(*doubts: str, estimate: tuple[float, float] = (0.0, 0.0)) -> mb.Bounds:
    """y and z between 0 and 1, with doubts about runs."""
    return known(np.ones((2, 2)), np.tile(estimate, (2, 1)), run_doubts=doubts)


def test_a_doubt_about_one_output_leaves_limits_of_others(tmp_path):
    limits = {"y": (-2, 2), "z": (-2, 2)}
    bounds = doubted(Doubt("The noise of y is large.", ["y"]))
    copies = [reloaded(bounds, tmp_path / f"a.{end}") for end in ("npz", "json")]
    for each in (bounds, pickle.loads(pickle.dumps(bounds)), *copies):
        check = each.check(limits)
        assert (check["y"].kept, check["z"].kept) == (None, True) and "noise of y" in check["y"].why
    everywhere = doubted("Runs are doubtful.")  # and no limit is satisfied
    for each in (everywhere, reloaded(everywhere, tmp_path / "b.json")):
        assert [limit.kept for limit in each.check(limits).limits] == [None, None]


def test_an_early_end_is_no_doubt_beside_the_estimated_error():
    """Bounds from 0 to 1 that may be off by 0.2 keep limits that are far from them."""
    bounds = doubted(Doubt("The study was ended."), estimate=(0.2, 0.0))
    assert bounds.doubtful().keys() == {"y"}
    assert_kept(bounds, {0.3: False, 0.9: None, 1.1: None, 1.3: True})
    assert bounds.check({"z": (None, 1.01)}).kept is True


def test_limits_are_drawn_and_labelled(tmp_path):
    check = waves().check({"z": (-1.0, None), "y": (-1, 2)})
    assert check.kept is False and check.margin.shape == (21,)
    figure = check.plot(tmp_path / "a.png")
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["z", "y"]
    dashed = [[line.get_ydata()[0] for line in axes.lines if len(set(line.get_ydata())) == 1] for axes in figure.axes]
    assert -1.0 in dashed[0] and {-1, 2} <= set(dashed[1])
    data = check.to_xarray()
    assert data["result"].values.tolist() == ["violated", "satisfied"] and data["margin"].dims == ("time", "output")
    assert "<table" in check._repr_html_()
    (axes,) = check.plot(outputs="y").axes
    assert axes.get_title(loc="left") == "y" and 2 in [line.get_ydata()[0] for line in axes.lines]
    refused("no output 'x'", check.plot, outputs=["x"])
    plt.close("all")


@pytest.mark.parametrize(
    ("limits", "why"),
    [
        ({}, "a dictionary"), (3, "a dictionary of pairs"), ({"x": (0, 1)}, "no output 'x'"), ({"y": 3}, "pair"),
        ({"y": (None, None)}, "pair"), ({"y": (1, 0)}, "is above"), ({"y": (np.nan, 1)}, "numbers or None"),
        ({"y": (np.inf, np.inf)}, "must be finite"), ({"y": (-np.inf, np.inf)}, "must be finite"),
        ({"y": (np.inf, None)}, "must be finite"), ({"y": (None, -np.inf)}, "must be finite"),
        ({"y": ("a", 1)}, "not a finite number"), ({"y": (1, 2, 3)}, "pair"), ({"y": (True, 2)}, "numbers or None"),
    ],
)  # fmt: skip
def test_what_is_no_limit_is_told(limits, why):
    refused(why, waves(mb.Scanning(5)).check, limits)


@pytest.mark.parametrize("seed", range(8))
def test_limits_that_curves_pass_between_output_times_are_told(seed):
    """The least value of a cos(w t) is -a, and outputs at few times miss it."""
    rng = np.random.default_rng(seed)
    w, n = rng.uniform(2.0, 6.0), int(rng.integers(8, 15))
    t = np.linspace(0.0, 2 * np.pi / w * rng.uniform(1.0, 1.3), n)
    bounds = black_box_bounds(lambda a: a * np.cos(w * t), None, t, "x", a=(0.9, 1.1))
    least = float(bounds.lower.min())
    check = bounds.check({"x": (0.5 * (least - 1.1), None)})
    assert check.kept and (least < -1.0995 or "Between two output times x may come closer" in str(check))
    for low in (-2.0, -1.4):
        assert not bounds.check({"x": (low, None)}).remarks


@pytest.mark.parametrize(
    ("interval", "told"),
    [((340, 360), "far from"), ((0.34, 0.36), None), ((0.351, 0.36), "outside of"), ((0.37, 0.38), "outside of")],
)
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_nominal_values_outside_of_their_interval_are_told(interval, told):
    bounds = black_box_bounds(lambda load: load * T, None, T, nominal={"load": 0.35}, load=interval)
    assert any("is outside of the interval" in remark for remark in bounds.remarks) == (told is not None)
    assert any("is far from the nominal value" in doubt for doubt in bounds.doubts) == (told == "far from")
