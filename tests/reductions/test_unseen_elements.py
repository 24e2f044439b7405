"""Elements that act in a small part of the box, in which no run of the grid is."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from unseen_elements import KINDS, case, runs_of, true_range

import symmb as mb
from symmb.run.simulation import FigureSimulator, Subject

PARAMETERS = {"stiffness": 100.0, "rate": 10.0, "damping": 1.0, "mass": 1.0}
BOX = mb.Box(stiffness=(97, 103), rate=(8.5, 11.5), damping=(0.95, 1.05), mass=(0.97, 1.03))


def shaken(element, limit, outputs, times=None, box=BOX):
    """A block that a force shakes near resonance, and an element that acts beyond a limit."""
    p = mb.Parameters(**PARAMETERS)
    ground, block = mb.Ground(), mb.Body("block", p.mass, 1.0)
    rail = mb.Prismatic("rail", ground.point(0, 0), block.point(0, 0), axis=(1, 0, 0))
    x, v = rail.displacement, rail.displacement_rate
    own, force = element(ground, block, rail, limit)
    drive = 0.5 * ca.cos(p.rate * mb.t) - p.stiffness * x - p.damping * v + force
    system = mb.System(block, rail, mb.Actuator("drive", rail, drive), *own, parameters=p)
    times = np.linspace(0, 3, 61) if times is None else times
    return mb.Scene(system, {"rail.displacement": 0.0}, times, outputs(x, v, system), box)


def stop(ground, block, rail, limit):
    return [mb.Stop("end", rail, upper=limit, law=mb.KelvinVoigt(1e4, 5.0))], 0.0


def impact(ground, block, rail, limit):
    return [mb.Stop("end", rail, upper=limit, restitution=0.5)], 0.0


def rope(ground, block, rail, limit):
    return [mb.Rope("end", [ground.point(-1, 0), block.point(0, 0)], 1e4, 1 + limit)], 0.0


def law(ground, block, rail, limit):
    return [], ca.if_else(rail.displacement > limit, -2e3 * (rail.displacement - limit), 0.0)


@pytest.mark.parametrize("element", [stop, impact, rope, law])
def test_runs_note_how_far_they_stay_from_a_switch(element):
    limit, P = 0.06, np.array([[*PARAMETERS.values()], [102.0, 9.7, 0.97, 1.02], [98.0, 8.6, 1.05, 0.98]])
    fine = shaken(element, limit, lambda x, v, s: {"x": x}, np.linspace(0, 3, 6001))
    distance = limit - mb.DAESimulator(fine).run(P).Y[:, :, 0].max(axis=1)
    assert (distance > 0).all()
    coarse = shaken(element, limit, lambda x, v, s: {"x": x}, np.array([0.0, 1.0, 3.0]))
    reach = np.asarray(mb.DAESimulator(coarse).run(P).reach)
    closest = np.abs(reach).min(axis=1)  # an element may have switches of its rate as well
    off = np.abs(closest - distance[:, None]).max(axis=0).min()
    assert off < 1e-3 * limit


def test_conditions_note_how_far_they_are_from_holding():
    scene = shaken(law, 1.0, lambda x, v, s: {"late": mb.first_time(x > 0.05), "far": mb.maximum(x)})
    simulator = Subject.of(scene).over(BOX)[0]
    assert isinstance(simulator, FigureSimulator)
    simulator = simulator.continued()
    runs = simulator.run(np.array([[*PARAMETERS.values()]]))
    assert_allclose(runs.reach[0, :, -1], 0.05 - runs.Y[0, 0, 1], atol=1e-6)


def ridge(element, share):
    """A scene of which a force acts in a share of the box, on an oblique ridge inside of it."""
    free = runs_of(shaken(law, 1.0, lambda x, v, s: {"x": x}))
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 4))
    limit = float(np.quantile(free(points).max(axis=(1, 2)), 1 - share))
    return shaken(element, limit, lambda x, v, s: {"force": s.force("end")})


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize(("element", "share"), [(stop, 0.002), (rope, 0.002), (stop, 0.0005)])
def test_forces_on_a_ridge_inside_of_the_box_are_found(element, share):
    scene = ridge(element, share)
    bounds = mb.propagate(scene)
    _, high = true_range(scene, np.random.default_rng(0))
    assert bounds.upper.max() > 0.95 * high.max() > 0 and "An element acts where" in " ".join(bounds.remarks)
    assert (high <= bounds.outer[1] + 0.02 * high.max()).all() or bounds.doubts


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_a_force_in_less_than_a_thousandth_of_the_box_is_found():
    scene = ridge(stop, 0.0002)
    bounds = mb.propagate(scene)
    worst = bounds.worst("force").upper
    run = mb.simulate(scene, parameters=worst.parameters)["force"]
    assert run.max() > 4 and run.max() <= bounds.upper.max() * (1 + 1e-6)
    assert "violated" in str(bounds.check({"force": (None, 4.0)}))


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("budget", [81, 90, 120, 200])
def test_searches_keep_the_budget(budget):
    bounds = mb.propagate(ridge(stop, 0.002), mb.PolynomialChaos(budget=budget))
    assert bounds.evaluations <= budget


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize(("d", "share"), [(4, 0.002), (5, 0.0015)])
def test_scalar_outputs_beyond_a_quadratic_ridge(d, share):
    """The start speed is largest at a point inside of the box. The force acts in a ball around it."""
    rng = np.random.default_rng(d)
    centre, points = rng.uniform(-0.6, 0.6, d), rng.uniform(-1, 1, (100_000, d))
    radius = float(np.quantile(np.square(points - centre).sum(axis=1), share))
    p = mb.Parameters(**{f"a{i}": 0.0 for i in range(d)})
    speed = 10 * (1 - 0.1 * sum((getattr(p, f"a{i}") - c) ** 2 for i, c in enumerate(centre.tolist())))
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    law = ca.if_else(ball.x > 1 - 0.1 * radius, 1e3 * (ball.x - 1 + 0.1 * radius), 0)
    force = mb.Force("force", ball.point(0, 0), (-100 * ball.x - law, 0))
    box = mb.Box(**{f"a{i}": (-1, 1) for i in range(d)})
    system, times = mb.System(ball, force, parameters=p), np.linspace(0, 0.6, 13)
    scene = mb.Scene(system, {"ball.vx": speed}, times, {"peak": mb.maximum(1e3 * law)}, box)
    bounds = mb.propagate(scene)
    highest = runs_of(scene)(centre[None]).max()
    assert bounds.upper.max() > 0.98 * highest > 0
    assert bounds.worst("peak").upper.attained > 0.98 * highest


CONDITIONS = {
    "a window of one parameter": lambda p: ca.fabs(p.u - 0.3) < 0.002,
    "a box of two parameters": lambda p: ca.logic_and(ca.fabs(p.u - 0.3) < 0.05, ca.fabs(p.v + 0.6) < 0.02),
    "a layer of three parameters": lambda p: ca.fabs(p.u + p.v - p.w - 0.3) < 0.003,
    "a corner": lambda p: p.u + p.v + p.w > 2.8,
}


def pushed(where, condition):
    """A ball under a force that is 5 N larger where a condition of parameters holds."""
    return pushed_by(lambda p: ca.if_else(condition(p), 5.0, 0.0), where)


def pushed_by(law, where="law"):
    """A ball under a force, and a further one that depends on parameters."""
    p = mb.Parameters(u=0.0, v=0.0, w=0.0, force=10.0, mass=2.0)
    ball, more = mb.Body("ball", p.mass, pose=mb.Particle()), law(p)
    push = p.force + p.u + p.v + p.w
    force = mb.Force("force", ball.point(0, 0), (push + more if where == "law" else push, 0))
    outputs = {"x": ball.x if where == "law" else ball.x + more * mb.t**2 / 2 / p.mass}
    box = mb.Box(u=(-1, 1), v=(-1, 1), w=(-1, 1), force=(9.5, 10.5), mass=(1.9, 2.1))
    return mb.Scene(mb.System(ball, force, parameters=p), {}, np.linspace(0, 1, 11), outputs, box)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("where", ["law", "output"])
@pytest.mark.parametrize("kind", CONDITIONS)
def test_conditions_of_parameters_that_hold_in_a_small_part(kind, where):
    bounds = mb.propagate(pushed(where, CONDITIONS[kind]))
    largest = {"a layer of three parameters": 10.5 + 2.303 + 5, "a window of one parameter": 10.5 + 2.302 + 5}
    largest |= {"a box of two parameters": 10.5 + 1 + 0.35 - 0.58 + 5, "a corner": 10.5 + 3 + 5}
    true = largest[kind] / 1.9 / 2
    assert bounds.outer[1][-1, 0] >= 0.98 * true
    if kind != "a layer of three parameters":  # it is oblique, and no part of the box holds only the layer
        assert_allclose(bounds.upper[-1, 0], true, rtol=5e-3)
        assert not bounds.doubts
    assert bounds.lower[-1, 0] == pytest.approx(6.5 / 2.1 / 2, rel=5e-3)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_the_reason_of_an_error_is_that_of_the_part_with_the_largest_error(tmp_path):
    bounds = mb.propagate(pushed("law", CONDITIONS["a corner"]))
    assert [step.round for step in bounds.trace] == [*range(1, len(bounds.trace) + 1)]
    assert sum(step.request == bounds.trace[0].request for step in bounds.trace) == 2  # both studies begin alike
    bounds.save(tmp_path / "bounds.json")
    assert mb.Bounds.load(tmp_path / "bounds.json").why("x", 1.0) == bounds.why("x", 1.0)
    size = [float(np.sqrt(np.square(each).mean())) for each in (bounds.estimate, bounds.upper - bounds.lower)]
    told = [remark for remark in bounds.remarks if "was not reached" in remark]
    assert (size[0] > 0.01 * size[1]) == bool(told)
    assert all(f"{size[0] / size[1]:.2g} times its width" in remark for remark in told)


def hat(x, centre):
    return ca.fmax(1 - ca.fabs(x - centre) / 0.14, 0)


JOINT = {
    "a product of two": lambda p: hat(p.u, 0.3) * hat(p.v, -0.6),
    "a product of three": lambda p: hat(p.u, 0.3) * hat(p.v, -0.6) * hat(p.w, 0.1),
    "a minimum of three": lambda p: ca.fmax(ca.fmin(ca.fmin(1 - ca.fabs(p.u - 0.3) / 0.14, p.v - 0.8), p.w + 0.3), 0),
}


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("kind", JOINT)
def test_forces_of_parameters_that_act_together_in_a_small_part(kind):
    scene, points = pushed_by(lambda p: 20.0 * JOINT[kind](p)), np.random.default_rng(0).uniform(-1, 1, (60_000, 5))
    bounds, values = mb.propagate(scene), runs_of(scene)(points)[:, -1, 0]
    assert values.max() > runs_of(pushed_by(lambda p: 0.0))(points)[:, -1, 0].max() + 0.3
    off = max(values.max() - bounds.outer[1][-1, 0], 0.0)
    assert off <= 0.02 * np.ptp(values)
    kept = bounds.check({"x": (None, float(values.max()) - 0.1)})["x"].kept
    assert kept is False or (kept is None and bounds.doubts)


ODD = {
    "its runs fail": (lambda p: ca.if_else(ca.fabs(p.u - 0.3) < 0.002, ca.sqrt(p.v - 2), 0.0), 6.5, 13.5),
    "its margin is infinite": (lambda p: ca.if_else(p.u / ca.fmax(p.v - 2, 0) < 1, 5.0, 0.0), 7.5, 17.5),
    "its margin is not a number": (lambda p: ca.if_else(ca.sqrt(p.u - 2) < 1, 5.0, 0.0), 6.5, 13.5),
}
"""Name -> law, lowest and highest force [N]. The second one acts if u is negative."""


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("kind", ODD)
def test_conditions_that_cannot_be_followed_leave_the_bounds(kind):
    law, lowest, highest = ODD[kind]
    bounds = mb.propagate(pushed_by(law))
    assert_allclose([bounds.lower[-1, 0], bounds.upper[-1, 0]], [lowest / 2.1 / 2, highest / 1.9 / 2], rtol=2e-2)


def test_conditions_that_hold_nowhere_take_no_run():
    bounds = mb.propagate(pushed("law", lambda p: p.u + p.v > 2.001))
    without = mb.propagate(pushed("law", lambda p: p.u > 2.0))
    assert bounds.evaluations == without.evaluations and not bounds.doubts


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize(("kind", "k"), [("stop", 4), ("law", 1)])
def test_machines_of_the_benchmark_miss_nothing_in_silence(kind, k):
    """In a larger number: tests/benchmarks/unseen_elements.py."""
    rng = np.random.default_rng([0, KINDS.index(kind), k])
    scene = case(rng, kind).scene
    bounds, (low, high) = mb.propagate(scene), true_range(scene, rng)
    off = np.fmax(np.fmax(bounds.outer[0] - low, high - bounds.outer[1]), 0.0)
    assert (off <= 0.02 * (high - low).max(axis=0)).all() or bounds.doubts
