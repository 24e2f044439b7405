"""Events that do not come in a part of the box: closed forms of thrown balls."""

import re
import warnings

import machines
import numpy as np
import pytest

import symmb as mb

G = 9.81


def thrown(outputs, end=1.0, speed=(1.5, 2.5)):
    """A ball that is thrown upwards and falls. It rises to speed^2 / (2 G)."""
    machine = machines.ball(speed=2.0, side=3.0)
    start = {"ball.vy": machine.p.speed, "ball.vx": machine.p.side}
    box = mb.Box(speed=speed, side=(2.5, 3.5))
    return machine.scene(outputs(machine.ball), [0.0, end / 2, end], start, box=box)


def outputs_at(height):
    def outputs(ball):
        above = ball.y >= height
        own = {"y": ball.y, "top": mb.maximum(ball.y), "high": mb.first_time(above), "far": mb.value_at(ball.x, above)}
        return own | {"pace": mb.value_at(ball.vy, above)}

    return outputs


def bounds_of(*arguments):
    """Bounds, whose warnings are only about values at the border of the runs in which an event comes."""
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        bounds = mb.propagate(*arguments)
    assert all(set(re.findall(r"\b(y|top|high|far|pace)\b", text)) <= {"far", "pace"} for text in bounds.doubts), (
        bounds.doubts
    )
    return bounds


def passage(height, speed):
    """The first time at a height."""
    return (speed - np.sqrt(speed**2 - 2 * G * height)) / G


@pytest.mark.parametrize("height", (0.12, 0.2, 0.28))
@pytest.mark.parametrize("method", (mb.PolynomialChaos(), mb.Scanning(21)), ids=repr)
def test_an_event_that_does_not_come_leaves_other_outputs_alone(height, method):
    bounds = bounds_of(thrown(outputs_at(height)), method)
    slow, fast = 1.5, 2.5
    assert bounds["top"] == pytest.approx((slow**2 / (2 * G), fast**2 / (2 * G)), abs=2e-4)
    ends = np.array([[slow], [fast]]) * bounds.t - G * bounds.t**2 / 2
    np.testing.assert_allclose([bounds["y"][0], bounds["y"][1]], ends, atol=1e-8)
    assert not bounds.failed
    least, most = bounds["high"]
    assert least == pytest.approx(passage(height, fast), abs=5e-3) and most == np.inf
    # The slowest ball that reaches the height is there at its top.
    latest = np.sqrt(2 * height / G)
    assert bounds["far"][0] == pytest.approx(2.5 * passage(height, fast), abs=0.02)
    assert 0.8 * 3.5 * latest < bounds["far"][1] < 3.5 * latest + 0.02
    if bounds.estimate is not None:
        assert bounds.outer[1][0, bounds.names.index("far")] >= 3.5 * latest
    told = "\n".join(bounds.remarks)
    assert "The condition of far never holds for" in told and "speed < " in told
    assert "The condition of high never holds in a run" in told


def test_limits_of_events_that_do_not_come(tmp_path):
    bounds = bounds_of(thrown(outputs_at(0.2)))
    check = bounds.check({"high": (None, 0.4), "far": (None, 1.0), "top": (None, 0.33), "pace": (-0.1, 2.0)})
    assert [limit.kept for limit in check.limits] == [False, True, True, True]
    assert check["high"].why == "In a run, high never happens."
    assert bounds.check({"high": (0.05, None)}).kept  # never is above all lower limits
    case = bounds.worst("high").upper
    assert case.parameters["speed"] < np.sqrt(2 * G * 0.2) and str(case).startswith("high never happens: speed = ")
    far = bounds.worst("far").upper
    run = far.run()
    assert run["far"] == pytest.approx(far.attained, rel=1e-6)
    for file in ("a.json", "a.npz"):
        bounds.save(tmp_path / file)
        loaded = mb.Bounds.load(tmp_path / file)
        assert loaded["high"] == bounds["high"] and loaded.check({"high": (None, 0.4)}).kept is False
    bounds.plot(tmp_path / "a.png")
    bounds.report(tmp_path / "a.html", {"high": (None, 0.4)})
    assert "never happens" in (tmp_path / "a.html").read_text()


@pytest.mark.filterwarnings("ignore:Output:symmb.SymmbWarning")
@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.Vertex()], ids=repr)
def test_a_value_that_no_run_has_leaves_other_outputs_alone(method, tmp_path):
    bounds = mb.propagate(thrown(outputs_at(0.5)), method)
    assert bounds["high"][1] == np.inf and bounds["y"][1][1] == pytest.approx(2.5 * 0.5 - G / 8)
    assert bounds["far"] == bounds["pace"] == (-np.inf, np.inf)
    assert "The condition of far holds in none of 1000 random runs" in "\n".join(bounds.remarks)
    lack = "No run has a value of far, so that it has no bounds."
    assert bounds.check({"far": (None, 1.0)})["far"].why == lack and bounds.check({"far": (None, 1.0)}).kept is None
    with pytest.raises(mb.DeclarationError, match=lack):
        bounds.worst("far")
    if bounds.estimate is not None:
        assert bounds.why("far") == lack and bounds.check({"top": (None, 0.33)}).kept
    for file in ("a.json", "a.npz"):
        bounds.save(tmp_path / file)
        assert mb.Bounds.load(tmp_path / file)["far"] == (-np.inf, np.inf)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("low", [0.1, 0.5])
def test_a_value_without_its_condition_is_no_reason_to_lose_another(low):
    """The first condition holds for slow balls only or nowhere, the second one for fast balls only."""

    def outputs(ball):
        first = mb.value_at(ball.x, ball.y <= -low)
        return {"slow": first, "fast": mb.value_at(ball.vy, ball.y >= 0.2), "y": ball.y}

    bounds = mb.propagate(thrown(outputs, end=0.37))
    fastest = np.sqrt(2.5**2 - 2 * G * 0.2)
    assert bounds["fast"][1] == pytest.approx(fastest, abs=0.02)
    latest = 0.37 * 3.5
    slow = bounds["slow"]
    assert slow == (-np.inf, np.inf) if low == 0.5 else slow[1] == pytest.approx(latest, abs=0.05)


def test_bounds_without_and_with_values_are_loaded(tmp_path):
    def outputs(ball):
        return {"late": mb.first_time(ball.y >= 0.2), "none": mb.value_at(ball.y, ball.y > 0.5)}

    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        bounds = mb.propagate(thrown(outputs))
    with pytest.raises(mb.DeclarationError, match="the bounds of late are infinite"):
        bounds.statistical({"late": (None, 0.5)})
    for file in ("a.json", "a.npz"):
        bounds.save(tmp_path / file)
        assert mb.Bounds.load(tmp_path / file)["none"] == (-np.inf, np.inf)


def test_times_may_be_negative():
    machine = machines.ball(speed=2.0)
    outputs = {"high": mb.first_time(machine.ball.y >= 0.2)}
    scene = machine.scene(outputs, [-2.0, -1.0], {"ball.vy": machine.p.speed}, box=mb.Box(speed=(1.5, 2.5)))
    assert mb.propagate(scene)["high"] == pytest.approx((passage(0.2, 2.5) - 2, np.inf), abs=5e-3)


def test_an_event_that_always_comes_costs_nothing():
    both = mb.propagate(thrown(outputs_at(0.05)))
    assert not both.failed and not any("never" in remark for remark in both.remarks)
    assert both["high"] == pytest.approx((passage(0.05, 2.5), passage(0.05, 1.5)), rel=2e-3)


@pytest.mark.filterwarnings("ignore:tolerances. With larger tolerances:symmb.SymmbWarning")
def test_comparisons_and_largest_boxes_contain_events_that_do_not_come():
    scene = thrown(lambda ball: {"top": mb.maximum(ball.y), "high": mb.first_time(ball.y >= 0.2)})
    comparison = mb.compare(scene, [mb.PolynomialChaos(), mb.Vertex(), mb.MonteCarlo(200)])
    assert all((row.upper[:, 1] == np.inf).all() and (row.score.error[1] < 0.1) for row in comparison.rows)
    found = mb.tolerances(scene, {"high": (None, 0.6)})
    lowest = found.box["speed"][0]
    assert lowest == pytest.approx(np.sqrt(2 * G * 0.2), rel=2e-2) and lowest >= np.sqrt(2 * G * 0.2)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_tolerances_name_an_event_that_would_never_happen():
    scene = thrown(outputs_at(0.12))
    found = mb.tolerances(scene, {"high": (None, 0.5)})
    least = np.sqrt(2 * G * 0.12)  # the speed at which the ball just reaches the height
    assert found.factor == pytest.approx((2.0 - least) / 0.5, rel=5e-3)
    assert found.binding is None and "With larger tolerances, high never happens: speed = " in str(found)
    late = mb.tolerances(scene, {"high": (0.05, None)})  # never is above all lower limits
    fastest = (0.12 + G * 0.05**2 / 2) / 0.05
    assert late.factor == pytest.approx((fastest - 2.0) / 0.5, rel=5e-3)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_a_value_that_does_not_exist_satisfies_all_limits():
    """The extreme is at the edge of the region in which the value exists, where it changes like a square root."""
    latest = np.sqrt(2 * 0.2 / G)
    scene = thrown(outputs_at(0.2))
    limit = 3.8 * latest
    found = mb.tolerances(scene, {"far": (None, limit)})
    assert 0.9 * (3.8 - 3.0) / 0.5 < found.factor <= (3.8 - 3.0) / 0.5 * (1 + 1e-4)
    bounds = bounds_of(scene)
    assert bounds.check({"far": (None, 0.99 * 3.5 * latest)})["far"].kept is not True


def test_the_nominal_run_of_a_file_keeps_events_that_never_happen(tmp_path):
    bounds = bounds_of(thrown(outputs_at(0.25)))
    for name in ("bounds.json", "bounds.npz"):
        bounds.save(tmp_path / name)
        loaded = mb.Bounds.load(tmp_path / name)
        np.testing.assert_array_equal(loaded.nominal, bounds.nominal)
        assert str(loaded.check({"high": (None, 0.5)})) == str(bounds.check({"high": (None, 0.5)}))


def test_the_range_of_a_single_value_has_an_unknown_error():
    """The ball is 1 um below the highest point of the fastest throws: one of 1,000 random runs reaches it."""
    height = 2.04**2 / (2 * G) - 1e-6
    scene = thrown(lambda ball: {"far": mb.value_at(ball.x, ball.y >= height)}, speed=(1.96, 2.04))
    with pytest.warns(mb.SymmbWarning, match=r"above 10 % of the width: far"):
        bounds = mb.propagate(scene)
    assert bounds.estimate[0, 0] == np.inf
