"""Limits of bounds, where what is true is known in closed form."""

import pickle
import re

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest
from faults import refused
from small_scenes import formulas, particle

import symmb as mb
from symmb._doubt import Doubt
from symmb.bound.bounds.further_runs import FurtherRun
from symmb.bound.bounds.limits import by_further_run

T = np.linspace(0.0, 2.0, 21)
BOX = mb.Box(a=(0.9, 1.1), b=(-0.5, 0.5))


def waves() -> mb.FunctionSimulator:
    """y = a sin t + b^2 t, from 0 up to 1.1 sin t + 0.25 t; z = -y."""

    def f(a: float, b: float) -> np.ndarray:
        y = a * np.sin(T) + b**2 * T
        return np.stack([y, -y], axis=1)

    return mb.FunctionSimulator(f, {"a": 1.0, "b": 0.1}, T, ["y", "z"])


TOP = float((1.1 * np.sin(T) + 0.25 * T).max())


@pytest.mark.parametrize(
    ("limits", "kept"),
    [
        ({"y": (None, TOP + 0.01)}, True), ({"y": (None, TOP - 0.01)}, False), ({"y": (-0.01, None)}, True),
        ({"y": (0.01, None)}, False), ({"z": (-TOP - 0.01, 0.5)}, True), ({"y": (-1, 9), "z": (-1, 9)}, False),
        ({"y": (None, TOP)}, None),
    ],
)  # fmt: skip
def test_limits_of_estimates_are_kept_violated_or_undecided(limits, kept):
    bounds = mb.propagate(waves(), mb.PolynomialChaos(tolerance=1e-2), BOX)
    check = bounds.check(limits)
    assert check.kept is kept
    for name, (low, high) in limits.items():
        lower, upper = bounds[name]
        exact = np.minimum(lower - (-np.inf if low is None else low), (np.inf if high is None else high) - upper)
        np.testing.assert_array_equal(check[name].margin, exact)
    assert check.margin.shape == (21,)
    assert {True: "satisfied", False: "violated", None: "undecided"}[check.kept] in str(check)


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
    for share in (0.02, -0.02):  # of the tolerance of the stop
        assert bounds.check({"way": (None, 0.2005 + share * 5e-4)}).kept is (share > 0)


def test_an_estimate_that_straddles_a_limit_does_not_decide():
    lower, upper, error = np.zeros((2, 1)), np.ones((2, 1)), np.full((2, 1), 0.1)
    bounds = mb.Bounds(np.array([0.0, 1.0]), ("y",), lower, upper, "estimate", "PolynomialChaos()", 9, estimate=error)
    bounds = mb.Bounds(**{**vars(bounds), "inner": (lower + 0.05, upper - 0.05)})
    results = {high: bounds.check({"y": (None, high)}).kept for high in (0.89, 0.92, 0.97, 1.05, 1.11)}
    assert results == {0.89: False, 0.92: False, 0.97: None, 1.05: None, 1.11: True}


@pytest.mark.parametrize(("inside", "kept", "word"), [(3.36e-4, True, "is larger"), (4e-9, None, "is not larger")])
def test_the_margin_of_further_runs_is_told_beside_the_error_of_the_search(inside, kept, word):
    run = FurtherRun("upper", np.zeros(1), np.array([1.0 - inside]), -inside, 6e-9, 42, 0, False)
    found = by_further_run(run, 1.0, np.array([1e-4]), 1e-12, " m")
    assert found.kept is kept
    assert found.why.startswith(f"The closest of 42 further runs is {inside:.3g} m inside the limit.")
    assert found.why.endswith(f" This margin {word} than the error of the search, 6e-09 m.")


def test_errors_count_at_their_times():
    """An error that is a large share of the width, at a time when the limit is far, decides nothing."""
    upper, error = np.array([[1.0], [0.2]]), np.array([[0.01], [0.5]])
    t, lower = np.array([0.0, 1.0]), np.zeros((2, 1))
    bounds = mb.Bounds(t, ("y",), lower, upper, "estimate", "PolynomialChaos()", 9, estimate=error)
    assert bounds.doubtful() and bounds.check({"y": (None, 1.02)}).kept is True
    assert bounds.check({"y": (None, 0.95)}).kept is False and bounds.check({"y": (-0.1, None)}).kept is None


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_further_runs_decide_limits_that_are_close():
    """The responses go from -1.06, in a valley on a face, to 2.5 at corners."""
    t = np.linspace(0.1, 1.0, 10)
    nominal = dict.fromkeys("abcde", 0.0)
    f = mb.FunctionSimulator(lambda a, b, c, d, e: t * (abs(a - 0.3 * b) + c * d + 0.2 * e * a), nominal, t, ["y"])
    bounds = mb.propagate(f, mb.PolynomialChaos(seconds=60.0), mb.Box(**dict.fromkeys("abcde", (-1.0, 1.0))))
    for share in (0.003, 0.03, -0.003, -0.03):
        for pair in ((-1.06 - 3.56 * share, None), (None, 2.5 + 3.56 * share)):
            check = bounds.check({"y": pair})
            assert check.kept is (share > 0), str(check)
            case = check.worst
            assert case.run()[-1, 0] == pytest.approx(case.attained)
            assert case.attained == pytest.approx(-1.06 if pair[0] else 2.5, rel=0.02)


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
    for share in (-0.01, -0.003, 0.003, 0.01):
        assert bounds.check({"y": (None, top * (1 + share))}).kept is (share > 0)


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
    f = mb.FunctionSimulator(lambda k: [0.0, -k, k], {"k": 0.7}, [0.0, 1.0, 2.0], ["x"])
    check = mb.propagate(f, mb.PolynomialChaos(), mb.Box(k=(0.1, 1.0))).check({"x": (low, high)})
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
    t, lower, upper = np.array([0.0, 1.0]), np.zeros((2, 1)), np.array([[3.0], [2.0]])
    extra = {"estimate": np.zeros((2, 1))} if kind == "estimate" else {}
    own = {"inner": (lower, upper), "noise": None if noise is None else np.array([noise])} | extra
    check = mb.Bounds(t, ("y",), lower, upper, kind, "Vertex()", 9, **own).check({"y": (None, 3.0 - over)})
    assert check.kept is kept and ("rounding or noise" in str(check)) == (kept is None)


@pytest.mark.parametrize("cap", [0.37, 0.711, 1 / 3])
def test_an_output_that_is_limited_to_a_value_satisfies_a_limit_of_this_value(cap):
    """Any looser limit as well. No run exceeds the value, but the polynomials do."""
    limited = mb.FunctionSimulator(
        lambda a, b: np.clip(np.stack([a * np.sin(T) + b**2 * T, -a * np.sin(2 * T)], axis=1), -cap, cap),
        {"a": 1.0, "b": 0.1}, T, ["y", "z"],
    )  # fmt: skip
    bounds = mb.propagate(limited, mb.PolynomialChaos(), BOX)
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
    p = mb.Parameters(k=4.0, v=1.0)
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    pull = ca.fmin(10 * bob.x, cap)
    outputs = {"pull": pull, "most": mb.maximum(pull), "least": mb.minimum(ca.fmax(-10 * bob.x, -cap))}
    box = mb.Box(k=(3.9, 4.1), v=(0.95, 1.05))
    bounds = mb.propagate(mb.Scene(mb.System(bob, spring), {"bob.x": p.v}, np.linspace(0, 2, 101), outputs, box))
    assert np.all(np.array(bounds["most"]) == cap) and np.all(np.array(bounds["least"]) == -cap)
    assert bounds.check({"pull": (None, cap), "most": (None, cap), "least": (-cap, None)}).kept


def test_runs_hand_over_their_noise():
    p = mb.Parameters(a=1.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(-2, 0), ball.point(0, 0), 4.0, 0.0, 2.0)
    start, outputs = {"ball.x": p.a, "ball.y": 0.0}, {"x": ball.x}
    scene = mb.Scene(mb.System(ball, spring, parameters=p), start, np.pi * np.arange(5.0), outputs)
    bounds = mb.propagate(scene, mb.Vertex(), mb.Box(a=(0.9, 1.1)))  # x = a cos 2 t
    beyond = bounds["x"][1].max() - 1.1
    assert bounds.noise is not None and abs(beyond) < bounds.noise[0]
    assert bounds.check({"x": (None, 1.1 - bounds.noise[0] / 2)}).kept is None


def test_samples_only_violate():
    bounds = mb.propagate(waves(), mb.Scanning(5), BOX)
    assert bounds.check({"y": (None, TOP - 0.01)}).kept is False
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


ODD = "pce", "pce:2", "vertex", "mc:3", "taylor:2", "tm:2", "swarm:3"


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("method", ODD)
def test_the_nominal_run_violates_a_limit_with_any_method(method):
    """x = a cos(sqrt(k) t) is above 1.2 at the nominal a, in all cases below 1.5, and the box may leave out this a."""
    scene = particle(lambda p, mass: -p.k * mass.x, np.linspace(0, 1, 5), {"mass.x": 0.0}, k=(1.9, 2.1), a=(1.1, 1.5))
    scene = mb.Scene(scene.system, {"mass.x": scene.system.parameters.a}, scene.times, scene.outputs, scene.box)
    bounds = mb.propagate(scene, method)
    assert bounds.check({"x": (None, 1.3 - 1e-4)}).kept is False
    assert bounds.check({"x": (None, 1.6)}).kept is not False and not bounds.check({"x": (None, 1.6)}).remarks
    check = mb.propagate(scene, method, mb.Box(k=(1.9, 2.1), a=(1.0, 1.1))).check({"x": (None, 1.2)})
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
    f = mb.FunctionSimulator(lambda k: calls.append(k) or np.exp(-((k - 1) ** 2) / 1e-6) * T, {"k": 1.0}, T, ["y"])
    bounds = mb.propagate(f, mb.MonteCarlo(9), mb.Box(k=(0.5, 2.0)))
    made = len(calls)
    for _ in range(2):
        assert bounds.check({"y": (None, 1.0)}).kept is False and calls[made:] == [1.0]
    assert bounds.check({"y": (None, 3.0)}).kept is None


def test_doubted_bounds_keep_nothing():
    t = np.array([0.0])
    bounds = mb.Bounds(
        t, ("y",), -np.ones((1, 1)), np.ones((1, 1)), "estimate", "PolynomialChaos()", 9,
        estimate=np.zeros((1, 1)), run_doubts=("Runs are doubtful.",),
    )  # fmt: skip
    assert bounds.check({"y": (-2, 2)}).kept is None


def doubted(*doubts: str, estimate: tuple[float, float] = (0.0, 0.0)) -> mb.Bounds:
    """y and z between 0 and 1, with doubts about runs."""
    t, lower, names = np.array([0.0, 1.0]), np.zeros((2, 2)), ("y", "z")
    error = np.tile(estimate, (2, 1))
    return mb.Bounds(t, names, lower, lower + 1, "estimate", "PolynomialChaos()", 9, estimate=error, run_doubts=doubts)


def test_a_doubt_about_one_output_leaves_limits_of_others(tmp_path):
    limits = {"y": (-2, 2), "z": (-2, 2)}
    bounds = doubted(Doubt("The noise of y is large.", ["y"]))
    bounds.save(tmp_path / "a.npz")
    bounds.save(tmp_path / "a.json")
    copies = [mb.Bounds.load(tmp_path / f"a.{end}") for end in ("npz", "json")]
    for each in (bounds, pickle.loads(pickle.dumps(bounds)), *copies):
        check = each.check(limits)
        assert (check["y"].kept, check["z"].kept) == (None, True) and "noise of y" in check["y"].why
    everywhere = doubted("Runs are doubtful.")
    everywhere.save(tmp_path / "b.json")
    for each in (everywhere, mb.Bounds.load(tmp_path / "b.json")):
        assert [limit.kept for limit in each.check(limits).limits] == [None, None]


def test_an_early_end_is_no_doubt_beside_the_estimated_error():
    """Bounds from 0 to 1 that may be off by 0.2 keep limits that are far from them."""
    bounds = doubted(Doubt("The study was ended."), estimate=(0.2, 0.0))
    assert bounds.doubtful().keys() == {"y"}
    kept = {high: bounds.check({"y": (None, high)}).kept for high in (0.3, 0.9, 1.1, 1.3)}
    assert kept == {0.3: False, 0.9: None, 1.1: None, 1.3: True}
    assert bounds.check({"z": (None, 1.01)}).kept is True


def test_limits_are_drawn_and_labelled(tmp_path):
    check = mb.propagate(waves(), mb.PolynomialChaos(), BOX).check({"z": (-1.0, None), "y": (-1, 2)})
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
    refused(why, mb.propagate(waves(), mb.Scanning(5), BOX).check, limits)


@pytest.mark.parametrize("seed", range(8))
def test_limits_that_curves_pass_between_output_times_are_told(seed):
    """The least value of a cos(w t) is -a, and outputs at few times miss it."""
    rng = np.random.default_rng(seed)
    w, n = rng.uniform(2.0, 6.0), int(rng.integers(8, 15))
    t = np.linspace(0.0, 2 * np.pi / w * rng.uniform(1.0, 1.3), n)
    f = mb.FunctionSimulator(lambda a: a * np.cos(w * t), {"a": 1.0}, t, ["x"])
    bounds = mb.propagate(f, box=mb.Box(a=(0.9, 1.1)))
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
    f = mb.FunctionSimulator(lambda load: load * T, {"load": 0.35}, T, ["y"])
    bounds = mb.propagate(f, box=mb.Box(load=interval))
    assert any("is outside of the interval" in remark for remark in bounds.remarks) == (told is not None)
    assert any("is far from the nominal value" in doubt for doubt in bounds.doubts) == (told == "far from")
