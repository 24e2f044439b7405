"""Sentences of reports: their numbers are those of the check, and the tolerances that they name satisfy the limits."""

import html
import re

import casadi as ca
import numpy as np
import pytest
from _machines_a import door_closer, rod
from black_boxes import black_box_bounds
from faults import refused
from machines import ball

import symmb as mb
from symmb.show.report.verdict import next_steps, verdict

pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
SEEDS = range(6)
T = np.linspace(0.0, 1.0, 9)
NAMES = ["x", "peak_force", "tip y", "Kraft_µ", "<b>&$z$", "a name that is as long as names of outputs may well be"]


def machine(rng):
    """Two outputs that three parameters change, with a random name and random numbers, and its box."""
    name, parameters = str(rng.choice(NAMES)), [f"{letter}{rng.integers(100)}" for letter in "pqr"]
    c, scale = rng.uniform(0.5, 2.0, 3), 10.0 ** rng.integers(-3, 4)

    def own(**p):
        a, b, d = (p[n] for n in parameters)
        return scale * np.stack([c[0] * a + c[1] * b * T - 0.1 * d * T**2, 1 + c[2] * d * T], axis=1)

    simulator = mb.FunctionSimulator(own, dict.fromkeys(parameters, 1.0), T, [name, "other"])
    return simulator, mb.Box(**{n: (1 - w, 1 + w) for n, w in zip(parameters, rng.uniform(0.02, 0.2, 3), strict=True)})


def told(bounds, limits):
    """The check, the sentences of the verdict, and the next steps."""
    check = None if limits is None else bounds.check(limits)
    bounds = bounds if check is None or check.kept else bounds._with_nominal()
    shares = bounds._known_contributions() if bounds.range_of else None
    return check, verdict(bounds, check), next_steps(bounds, check, shares)


def bounded(seed, method=None):
    rng = np.random.default_rng(seed)
    simulator, box = machine(rng)
    bounds = mb.propagate(simulator, method or mb.PolynomialChaos(), box)
    return rng, simulator, box, bounds, float(bounds.lower[:, 0].min()), float(bounds.upper[:, 0].max())


@pytest.mark.parametrize("seed", SEEDS)
def test_a_kept_limit(seed):
    rng, _, _, bounds, low, high = bounded(seed)
    limit = float(high + rng.uniform(0.1, 1) * (high - low))
    check, ((state, head), (_, text), *_), steps = told(bounds, {bounds.names[0]: (None, limit)})
    least = check.limits[0].margin[check.limits[0].row]
    assert state == "satisfied" and head == "The limit is satisfied in all cases within the tolerances."
    assert text.startswith(f"'{bounds.names[0]}' is at most {limit:.6g} in all cases within the tolerances.")
    assert f"The smallest margin is {least:.3g}, at {T[check.limits[0].row]:.4g} s" in text
    assert steps[0] == "No tolerance needs to be tightened."


@pytest.mark.parametrize("side", ["lower", "upper"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_violated_limit_and_what_keeps_it(seed, side):
    """The run that attains the excess is told, and each tolerance that is named satisfies the limit."""
    rng, simulator, box, bounds, low, high = bounded(seed + 10)
    middle = bounds.nominal[:, 0]
    inner, outer = (middle.min(), low) if side == "lower" else (middle.max(), high)
    end = float(outer + rng.uniform(0.05, 0.7) * (inner - outer))
    ends = (end, None) if side == "lower" else (None, end)
    check, ((state, head), (own, text), *_), steps = told(bounds, {bounds.names[0]: ends})
    limit, excess = check.limits[0], abs(end - outer)
    assert state == own == "violated" and head == "The limit is violated in some cases."
    verb = "fall below" if side == "lower" else "exceed"
    start = f"'{bounds.names[0]}' may {verb} its limit of {end:.6g} by {-limit.margin[limit.row]:.3g}"
    assert text.startswith(start) and -limit.margin[limit.row] == pytest.approx(excess, rel=1e-3)
    when = re.findall(r"(\w+) is (high|low) \(([^)]+)\)", text)
    changes = re.findall(r"(\w+) from 1 ± (\S+) to 1 ± ([\d.e-]+\d)", steps[0])
    assert when and changes and "nominal values" not in text
    for name, word, value in when:
        assert f"{check.worst.parameters[name]:.4g}" == value
        assert (check.worst.parameters[name] > 1) == (word == "high")
    narrowed = [{name: (1 - float(half), 1 + float(half))} for name, _, half in changes]
    narrowed = narrowed if "tighten" in steps[0] else [{k: v for part in narrowed for k, v in part.items()}]

    def times(factor):
        """All intervals with their tolerances times a factor."""
        return {name: (1 + factor * (low - 1), 1 + factor * (high - 1)) for name, (low, high) in box.intervals.items()}

    if shared := re.search(r"Or multiply the tolerances of (.+) by ([\d.]+)\.$", steps[0]):
        names = re.findall(r"[pqr]\d+", shared[1])
        assert names == [name for name, _, _ in changes]
        narrowed.append({name: times(float(shared[2]))[name] for name in names})
    assert bool(shared) == ("one of these" in steps[0])
    whole = float(re.search(r"by ([\d.]+),", steps[0])[1]) - 0.005 if "multiply all" in steps[0] else 1.0
    for part in narrowed:
        smaller = mb.propagate(simulator, mb.PolynomialChaos(), mb.Box(**times(whole) | part))
        assert smaller.check({bounds.names[0]: ends}).kept is True


@pytest.mark.parametrize("is_scalar", [False, True])
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_without_good_polynomials_runs_tell_which_tolerances_satisfy_a_limit(is_scalar, monkeypatch):
    """A block is pushed against a stop. The output is the force of the stop, or its largest value."""
    p = mb.Parameters(k=400.0, push=30.0, gap=0.05)
    block = mb.Body("block", 2.0, 1.0)
    rail = mb.Prismatic("rail", mb.Ground().point(0, 0), block.point(0, 0), axis=(1, 0, 0))
    stop = mb.Stop("stop", rail, upper=p.gap, law=mb.KelvinVoigt(5e4, 50.0))
    force = mb.Actuator("push", rail, p.push - p.k * rail.displacement - 8 * rail.displacement_rate)
    system = mb.System(block, rail, stop, force, parameters=p)
    box = mb.Box.around(p, 0.06)
    blow = system.force("stop")
    outputs = {"blow": mb.maximum(blow) if is_scalar else blow}
    scene = mb.Scene(system, {}, np.linspace(0, 0.5, 26), outputs, box)
    bounds = mb.propagate(scene)
    if is_scalar:  # its polynomials are good
        monkeypatch.setattr(mb.Bounds, "good_surrogate", lambda *_: None)
    assert bounds.good_surrogate() is None
    high = float(bounds.nominal.max() + 0.5 * (bounds.upper.max() - bounds.nominal.max()))
    first, second, *_ = told(bounds, {"blow": (None, high)})[2]
    assert second == "Further runs verify these tolerances."
    factor = float(re.search(r"multiply all tolerances by (0\.\d+), such as", first)[1])
    smaller = mb.Box.around(p, factor * 0.06)
    runs = mb.sweep(scene, {name: [low, (low + high) / 2, high] for name, (low, high) in smaller.intervals.items()})
    assert 0.97 * high < runs["blow"].max() <= high


@pytest.mark.parametrize("seed", SEEDS)
def test_nominal_values_beyond_a_limit(seed):
    rng, _, _, bounds, low, _ = bounded(seed + 20)
    peak = float(bounds.nominal[:, 0].max())
    limit = float(peak - rng.uniform(0.1, 0.9) * (peak - low))
    _, sentences, steps = told(bounds, {bounds.names[0]: (None, limit)})
    least = float(bounds.lower[:, 0].max()) - limit
    if least > 0:
        assert sentences[0][1] == "The limit is violated in all cases."
        assert f"limit of {limit:.6g} in all cases, by at least {least:.3g}" in sentences[1][1]
    else:
        assert f"exceeds its limit of {limit:.6g} by {peak - limit:.3g} at the nominal values, and" in sentences[1][1]
    assert steps[0].startswith(f"The nominal values violate the limit of '{bounds.names[0]}' by {peak - limit:.3g}: ")
    assert not any("ighten" in step for step in steps)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_samples_leave_undecided(seed):
    _, _, _, bounds, low, high = bounded(seed + 30, mb.Vertex())
    limit = float(2 * high - low)
    check, sentences, steps = told(bounds, {bounds.names[0]: (None, limit), "other": (-abs(limit) - 1, 1e9)})
    assert [state for state, _ in sentences[:3]] == ["undecided"] * 3
    assert sentences[0][1] == "Both limits are not decided."
    least = check.limits[0].margin[check.limits[0].row]
    start = f"It is not decided whether '{bounds.names[0]}' is at most {limit:.6g}. The smallest margin is {least:.3g}"
    assert sentences[1][1].startswith(start)
    assert f"Only the {bounds.evaluations} cases that were run are known" in sentences[3][1]
    assert steps[0] == f"'{bounds.names[0]}': {check.limits[0].why}"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_proved_limit(seed):
    rng = np.random.default_rng(seed + 40)
    rolling = ball(g=None, speed=float(rng.uniform(1, 3)))
    p, box = rolling.p, mb.Box.around(rolling.p, 0.1, ["speed"])
    bounds = mb.propagate(rolling.scene("x", T, {"ball.vx": p.speed}, box=box), mb.TaylorModel(order=2))
    limit = float(1.2 * 1.1 * p["speed"])
    check, sentences, _ = told(bounds, {"x": (None, limit)})
    assert check.kept and sentences[0][0] == "satisfied"
    assert f"'x' is at most {limit:.6g} m in all cases" in sentences[1][1]
    assert f"The smallest margin is {limit - 1.1 * p['speed']:.3g} m" in sentences[1][1]
    assert sentences[-1][1] == "The bounds for these sentences are proved."


@pytest.mark.parametrize("method", ["tm:2", "pce"])
@pytest.mark.parametrize("seed", SEEDS)
def test_all_cases_violate_a_limit(seed, method):
    """x = speed t. The interval of the speed leaves out its nominal value at times."""
    rng = np.random.default_rng(seed + 60)
    rolling = ball(g=None, speed=float(rng.uniform(1, 3)), idle=1.0)
    p, outputs = rolling.p, {"x": rolling.ball.x, "y": rolling.p.idle}
    low, high = sorted(p["speed"] * rng.uniform(0.7, 1.3, 2))
    scene = rolling.scene(outputs, T, {"ball.vx": p.speed}, box=mb.Box(speed=(low, high), idle=(0.9, 1.1)))
    limit = float(low * rng.uniform(0.5, 0.9))
    bounds = mb.propagate(scene, method)
    is_inside = low <= p["speed"] <= high
    _, sentences, steps = told(bounds, {"x": (None, limit)})
    assert sentences[0] == ("violated", "The limit is violated in all cases.")
    least, most = f"{low - limit:.3g} m", f"{high - limit:.3g} m"
    start = f"'x' exceeds its limit of {limit:.6g} m in all cases, by at least {least} and up to {most}, at 1 s"
    assert sentences[1][1].startswith(start) and "idle" not in sentences[1][1]
    assert any("are outside of the box" in text for _, text in sentences) != is_inside
    who, change = ("The nominal values", "them") if is_inside else ("All cases", "the intervals")
    excess = p["speed"] - limit if is_inside else low - limit
    assert steps[0] == f"{who} violate the limit of 'x' by {excess:.3g} m: change {change}, or the limit."


@pytest.mark.parametrize("method", ["vertex", "pce:2", "pce", "mc:200"])
@pytest.mark.parametrize("seed", SEEDS)
def test_parameters_without_an_effect_are_not_named(seed, method):
    """`other` depends on the third parameter alone. At times the box leaves out the nominal value of the first one."""
    simulator, box = machine(np.random.default_rng(seed + 70))
    if seed % 2:
        (low, high), name = box.bounds[0], box.names[0]
        box = mb.Box(**(box.intervals | {name: (low + 1, high + 1)}))
    bounds = mb.propagate(simulator, method, box)
    low, high = bounds.lower[-1, 1], bounds.upper[-1, 1]
    for share in (0.3, 2.0):
        _, sentences, _ = told(bounds, {"other": (None, float(low + share * (high - low)))})
        assert re.findall(r"(\w+) is (high|low) \(", sentences[1][1]) == [(box.names[2], "high")]


@pytest.mark.parametrize("seed", SEEDS)
def test_ranges_without_limits(seed):
    _, _, _, bounds, low, high = bounded(seed + 50)
    _, sentences, steps = told(bounds, None)
    assert sentences[1] == ("", f"'{bounds.names[0]}' is between {low:.4g} and {high:.4g}.")
    assert steps[0].startswith("Give limits")
    assert any(step.startswith(f"The spread of '{bounds.names[0]}', ") for step in steps)


def test_urgent_limits_come_first_and_the_annex_has_the_rest(tmp_path):
    limits = {f"y{k}": (None, 40.0 if k < 28 else 30.5) for k in range(30)}
    bounds = black_box_bounds(lambda k: np.outer(k * T, np.arange(1.0, 31.0)), None, T, " ".join(limits), k=(0.9, 1.1))
    _, sentences, steps = told(bounds, limits)
    assert sentences[0] == ("violated", "Of 30 limits, 2 are violated in some cases and 28 are satisfied.")
    assert [state for state, _ in sentences[1:7]] == ["violated"] * 2 + ["satisfied"] * 4
    assert sentences[7] == ("", "The annex contains the other 24 sentences.")
    assert "k from 1 ± 0.1 to 1 ± 0.016" in steps[0]
    bounds.report(tmp_path / "r.html", limits)


def test_runs_that_fail_are_told():
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = black_box_bounds(lambda k: T / (k <= 1.05), mb.MonteCarlo(40), T, "x", k=(0.9, 1.1))
    texts = [text for _, text in told(bounds, {"x": (None, 2.0)})[1]]
    assert f"{len(bounds.failed)} of 40 runs failed: these cases are not known." in texts and bounds.failed


def test_boxes_without_widths_and_intervals_beside_the_nominal_values():
    bounds = black_box_bounds(lambda k: k * T, None, T, "x", k=(2.0, 2.0))
    for limit, state in ((3.0, "satisfied"), (1.5, "violated")):
        _, sentences, steps = told(bounds, {"x": (None, limit)})
        assert sentences[0][0] == state and " when " not in sentences[1][1]
        assert not any("spread" in step or "ighten one" in step for step in steps)
    bounds = black_box_bounds(lambda k, m: (k + m) * T, None, T, "x", nominal={"k": 2.0}, k=(1.9, 2.4), m=(1.0, 1.0))
    _, sentences, steps = told(bounds, {"x": (None, 3.2)})
    assert sentences[1][1] == "'x' may exceed its limit of 3.2 by 0.2, at 1 s, when k is high (2.4)."
    above, below = map(float, re.search(r"k from 2 \+0.4 −0.1 to 2 \+(\S+) −(\S+)\.$", steps[0]).groups())
    assert 0.19 < above < 0.2 and above == pytest.approx(4 * below, rel=0.01)


def test_the_title_block(tmp_path):
    bounds, path = black_box_bounds(lambda k: k * T, mb.Vertex(), T, "x", k=(1.0, 2.0)), tmp_path / "r.html"
    bounds.report(path, company="A & B <Ltd>", revision=3)
    block = path.read_text().partition("<h1>")[0].partition('class="block"')[2]
    assert "<dt>company</dt><dd>A &amp; B &lt;Ltd&gt;</dd>" in block and "<dt>revision</dt><dd>3</dd>" in block
    assert "author" not in block
    refused("no part of the title block 'autor'", bounds.report, path, autor="A. B.")


def test_names_in_sentences_are_no_markup(tmp_path):
    name, path = "<script>x</script>", tmp_path / "r.html"
    bounds = black_box_bounds(lambda **p: p[name] * T, None, T, name, **{name: (1.0, 3.0)})
    bounds.report(path, {name: (None, 2.5)})
    page = path.read_text()
    assert "<script" not in page
    assert f"'{name}' may exceed its limit of 2.5 by 0.5, at 1 s, when {name} is high (3)." in html.unescape(page)


# A door closer in the units of its drawing, from declaration to report, is that of the benchmark in SI units.


FACTORS = {"angle": 180 / np.pi, "speed": 180 / np.pi, "slam": 1.0, "shut after": 1.0}


def drawn():
    """The door closer of `_machines_a` in mm, degrees, N m: no number is converted by hand."""
    p = mb.Parameters(
        main="240 mm", fore="330 mm", bracket="450 mm", mass="45 kg", preload="7 N m", spring=(4, "N m/rad"),
        sweep="9 N m s/rad", latch="4 N m s/rad", seal="0.6 N m", width="90 cm", pinion_x="220 mm", pinion_y="60 mm",
        shoe_y="60 mm", valve="15 deg", shut="1.55 rad", fading="0.02 rad/s", open="1.4 rad",
    )  # fmt: skip
    ground = mb.Ground()
    leaf = mb.Body("leaf", p.mass, p.mass * p.width**2 / 12, mb.Planar(), com=(p.width / 2, 0))
    main, fore = rod("main", p.main, 0.6), rod("fore", p.fore, 0.5)
    hinge = mb.Revolute("hinge", ground.point(0, 0), leaf.point(0, 0))
    pinion = mb.Revolute("pinion", leaf.point(p.pinion_x, p.pinion_y), main.point(0, 0))
    oil = ca.if_else(hinge.angle > p.valve, p.sweep, p.latch)
    torque = p.preload + p.spring * (p.shut - pinion.angle) - oil * pinion.angle_rate
    system = mb.System(
        leaf, main, fore, hinge, pinion,
        mb.Revolute("elbow", main.point(p.main, 0), fore.point(0, 0)),
        mb.Revolute("shoe", fore.point(p.fore, 0), ground.point(p.bracket, p.shoe_y)),
        mb.Actuator("closer", pinion, torque),
        mb.Actuator("bearing", hinge, -p.seal * ca.tanh(hinge.angle_rate / p.fading)),
        mb.Stop("frame", hinge, 0.0, None, mb.KelvinVoigt(6e4, 150.0)),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"hinge.angle": p.open},
        guess={"main.theta": 0.25, "fore.theta": -0.76},
        times=np.linspace(0, 6, 151),
        outputs={
            "angle": (hinge.angle, "deg"),
            "speed": (hinge.angle_rate, "deg/s"),
            "slam": (mb.maximum(system.force("frame")), "N m"),
            "shut after": (mb.first_time(hinge.angle <= 0), "s"),
        },
        box=mb.Box.plus_minus(
            p, main="240 mm ±0.3 mm", fore="±0.3 mm", mass="45 ±1 kg", preload="7 ±10%", spring="±0.2 N m/rad",
            sweep=0.6, latch=0.3, seal="20%",
        ),
        name="door closer",
    )  # fmt: skip


@pytest.fixture(scope="module")
def both():
    return drawn(), door_closer(None)


def test_its_runs_are_those_in_si_units(both):
    runs = [mb.simulate(scene) for scene in both]
    for name, factor in FACTORS.items():
        size = np.abs(factor * runs[1][name]).max()
        np.testing.assert_allclose(runs[0][name], factor * runs[1][name], rtol=0, atol=1e-7 * size)
    assert both[0].units == ("deg", "deg/s", "N m", "s")


def test_its_box_is_that_in_si_units(both):
    si = dict(zip(both[0].box.names, both[0].box.units, strict=True))
    expected = {"main": (0.2397, 0.2403), "fore": (0.3297, 0.3303)}
    for name, ends in dict(both[1].box).items():
        factor = 1e-3 if si[name] == "mm" else 1.0
        assert np.multiply(both[0].box[name], factor) == pytest.approx(expected.get(name, ends), rel=1e-12)
        assert ends == pytest.approx(expected.get(name, ends), rel=1e-12)


def test_its_report_is_in_units(both, tmp_path):
    times, names = np.linspace(0, 2, 21), ("angle", "speed")
    few = (scene.with_times(times).with_outputs({k: scene.outputs[k] for k in names}) for scene in both)
    bounds, si = (mb.propagate(scene, mb.Vertex()) for scene in few)
    size = np.abs(si.upper).max(axis=0) * 180 / np.pi
    assert np.all(np.abs(bounds.upper - si.upper * 180 / np.pi) <= 1e-6 * size)
    check = bounds.check({"speed": ("-75 deg/s", None), "angle": (None, "1.5 rad")})
    assert check["angle"].high == pytest.approx(1.5 * 180 / np.pi, rel=1e-15)
    bounds.report(tmp_path / "report.html", {"speed": ("-75 deg/s", None)})
    text = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", (tmp_path / "report.html").read_text())))
    for shown in ("main [mm]", "spring [N m/rad]", "°/s", "239.7 240.3"):
        assert shown in text
