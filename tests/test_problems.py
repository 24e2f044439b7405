"""Hard problems and shipped scenes to the digits that are known, and what symmb does with them without a solver."""

import re
from contextlib import nullcontext

import numpy as np
import problems
import pytest
from faults import refused, warned
from machines import ORIGIN, ball, run_of
from problems import model, read
from small_scenes import particle

import symmb as mb
from symmb.run.simulation import pilots

DEFAULT = mb.CVODES()
TIGHT = mb.CVODES(rtol=1e-12)

STATES = [
    ("double_pendulum", None, DEFAULT, 1e-6), ("double_pendulum", None, TIGHT, 1e-9),
    ("slider_crank", "free_spin", DEFAULT, 1e-5), ("slider_crank", "gravity_release", DEFAULT, 1e-5),
    ("slider_crank", "near_dead", DEFAULT, 1e-5), ("four_bar", "grashof", DEFAULT, 1e-5),
    ("four_bar", "near_change_point", DEFAULT, 1e-5), ("n_four_bar", "1", DEFAULT, 1e-6),
    ("n_four_bar", "2", DEFAULT, 1e-6), ("n_four_bar", "10", DEFAULT, 1e-6), ("chain", "3", DEFAULT, 1e-6),
    ("chain", "5", DEFAULT, 1e-6), ("andrews", None, DEFAULT, 1e-6), ("andrews", None, TIGHT, 1e-8),
    ("car_axis", None, DEFAULT, 1e-5), ("car_axis", None, TIGHT, 1e-8),
    ("slider_crank_spatial", None, DEFAULT, 1e-5),
]  # fmt: skip


def deviation(values, reference):
    """Largest deviation of each output, relative where the output is larger than 1."""
    values, reference = np.asarray(values), np.asarray(reference)
    return np.abs(values - reference).max(axis=0) / np.maximum(1.0, np.abs(reference).max(axis=0))


@pytest.mark.parametrize(("name", "case", "solver", "tolerance"), STATES)
def test_states_and_multipliers_of_the_double_pendulum(name, case, solver, tolerance):
    known = read(name, case)
    run = mb.simulate(model(name, **known.get("scene", {})), solver, times=known["times"])
    error = deviation(np.column_stack([run[output] for output in known["names"]]), known["values"])
    assert error.max() < tolerance, dict(zip(known["names"], error, strict=True))
    if name == "double_pendulum":
        # The paper's third and fourth row place the second rod against the ground, ours against the first rod.
        shoulder, elbow = np.array(known["multipliers"]).T.reshape(2, 2, -1)
        assert deviation(run.lam, np.vstack([shoulder + elbow, elbow]).T).max() < tolerance


def test_andrews_mechanism_starts_with_the_published_multipliers():
    run = mb.simulate(model("andrews"), times=[0.0, 1e-6])
    assert run.values[0, :2] == pytest.approx([-0.06171389001427645, 0.0], abs=1e-15)
    assert run["lam1"][0] == pytest.approx(98.56687039624114, abs=1e-6)
    assert run["lam2"][0] == pytest.approx(-6.122688344255656, abs=1e-6)


def test_multipliers_of_the_car_axis_and_its_published_end():
    known = read("car_axis")
    run = mb.simulate(model("car_axis"), times=known["times"])
    for column, name in ((-2, "lam1"), (-1, "lam2")):
        reference = np.array(known["values"])[:, column]
        assert np.abs(run[name] - reference).max() < 1e-5 * np.abs(reference).max()
    run = mb.simulate(model("car_axis"), TIGHT, times=[0.0, 3.0])
    assert np.abs(run.values[-1] - known["published"]).max() < 1e-9


def euler_zxz(phi, theta, psi):
    """First and third column of Rz(phi) Rx(theta) Rz(psi), six rows."""
    c, s, C = (np.cos(phi), np.cos(psi)), (np.sin(phi), np.sin(psi)), np.cos(theta)
    first = c[0] * c[1] - s[0] * C * s[1], s[0] * c[1] + c[0] * C * s[1], np.sin(theta) * s[1]
    third = np.sin(theta) * s[0], -np.sin(theta) * c[0], C
    return np.stack([*first, *third])


@pytest.mark.parametrize("case", ["steady_slow", "loop", "sleeping_perturbed", "slow_spin"])
def test_attitude_of_the_heavy_top(case):
    known = read("heavy_top", case)
    run = mb.simulate(model("heavy_top", **known["scene"]), times=known["times"])
    theta, _, phi, psi = np.array(known["values"]).T
    assert deviation(run.values[:, :6], euler_zxz(phi, theta, psi).T).max() < 1e-5
    assert np.abs(run["theta"] - theta).max() < 1e-5


def test_free_body():
    known = read("torque_free_body")
    body = mb.Body("body", mass=1.0, inertia=tuple(known["inertia"]), pose=mb.Spatial())
    run = run_of(body, start={"body.omega": tuple(known["omega"])}, times=known["times"])
    values = np.column_stack([run[name] for name in known["names"]])
    assert np.abs(values - known["values"]).max() < 1e-6


AUGMENTED = mb.DormandPrince(rtol=1e-10, stabilization=mb.AugmentedLagrangian())
LIMITS = {
    problems.andrews(): {mb.DormandPrince(1e-12): 1e-11, mb.Rosenbrock(1e-9): 1e-8, mb.CVODES(1e-12, stiff=True): 1e-9},
    problems.car_axis(): {mb.DormandPrince(1e-12): 1e-10, mb.Rosenbrock(1e-9): 1e-7},
    problems.flexible_crank(): {mb.DormandPrince(1e-11): 1e-9, mb.Rosenbrock(): 1e-5},
    problems.flexible_crank("consistent"): {mb.CVODES(1e-12): 1e-8},
    problems.stiff_spring(1e6, "slow_manifold"): {mb.CVODES(1e-11, stiff=True): 1e-7},
    problems.stiff_spring(1e6, "natural_length"): {mb.DormandPrince(1e-11): 1e-7, mb.Rosenbrock(1e-9): 1e-5},
    problems.fast_top(): {mb.DormandPrince(1e-12): 1e-10, mb.Rosenbrock(1e-10): 1e-8},
    problems.four_bar_in_space(): {mb.DormandPrince(1e-12): 1e-9},
    problems.slider_crank("massless_coupler"): {mb.DormandPrince(1e-12): 1e-10, mb.Rosenbrock(): 1e-5},
    problems.slider_crank("dead_point"): {AUGMENTED: 1e-8},
    problems.pendulum_period_2(): {mb.DormandPrince(1e-13): 1e-6},
    problems.pendulum_179(): {mb.DormandPrince(1e-13): 1e-3},
}
"""Errors of problems by solvers."""
CASES = [(problem, solver, limit) for problem, rows in LIMITS.items() for solver, limit in rows.items()]


@pytest.mark.parametrize(("problem", "solver", "limit"), CASES, ids=[f"{p.name}, {s!r}" for p, s, _ in CASES])
def test_digits(problem, solver, limit):
    run = mb.simulate(problem.make(), solver)
    assert problem.error(run.values) < limit
    assert run.energy_drift < 1e-7


def test_the_crank_meets_the_published_end():
    """To six digits in every position, as does any solution of index 2 with the published start."""
    published = np.array(problems.read("slider_crank_flexible")["published_end"])
    run = mb.simulate(problems.flexible_crank().make())
    largest = np.abs(problems.read("slider_crank_flexible")["index_2"]["values"]).max(axis=0)
    assert (run.values[-1] * largest)[:6] == pytest.approx(published, rel=1e-6)


@pytest.mark.parametrize(
    "solver",
    [AUGMENTED, pytest.param(mb.NSTIFFSI2(step=1e-3), marks=pytest.mark.long), mb.GeneralizedAlpha(step=1e-3)],
    ids=repr,
)
def test_singular_positions_are_passed(solver):
    """Two windows over 10 s, ten times through the position where all bars lie on one line."""
    run = mb.simulate(problems.n_four_bar(2).make(), solver)
    assert run.energy_drift < 1e-3
    assert abs(np.hypot(run["B0_x"], run["B0_y"]) - 1).max() < 1e-6


@pytest.mark.long
def test_forty_windows_hold_energy_through_their_singular_positions():
    """Forty windows over 20 s; what the penalty leaves of the constraints turns the phase by 1e-4 at most."""
    problem = problems.n_four_bar(40, 20)
    run = mb.simulate(problem.make(), mb.DormandPrince(rtol=1e-6, stabilization=mb.AugmentedLagrangian()))
    assert run.energy_drift < 1e-6 and problem.error(run.values) < 1e-3


@pytest.mark.parametrize("solver", [mb.CVODES(rtol=1e-8), mb.Rosenbrock(), AUGMENTED], ids=repr)
def test_a_wrong_branch_is_doubted(solver):
    """Through the dead point the closed form tells the right branch."""
    problem = problems.slider_crank("dead_point")
    told = pytest.warns(mb.SymmbWarning, match="may have taken a wrong branch")
    with nullcontext() if solver == AUGMENTED else told:
        run = mb.simulate(problem.make(), solver)
    assert any("wrong branch" in doubt for doubt in run.doubts) == (problem.error(run.values) > 0.1)


def test_usual_drift_raises_no_doubt():
    for problem in (problems.car_axis(), problems.slider_crank("massless_coupler")):
        for solver in (mb.CVODES(rtol=1e-6), mb.CVODES(rtol=1e-8, stiff=True), mb.Rosenbrock(rtol=1e-5)):
            assert not mb.simulate(problem.make(), solver).doubts


PAIR = "DormandPrince(rtol=1e-11)"
SMOOTH = problems.andrews(), problems.fast_top(), *map(problems.slider_crank, ("massless_coupler", "dead_point"))
CHOSEN = [
    *((PAIR, problem) for problem in SMOOTH),
    pytest.param("AugmentedLagrangian", problems.n_four_bar(2), marks=pytest.mark.long),
]


@pytest.mark.parametrize(("solver", "problem"), CHOSEN, ids=lambda value: getattr(value, "name", value))
def test_a_solver_is_chosen_that_gets_through(solver, problem):
    run = mb.simulate(problem.make())
    assert solver in run.solver and run.reason in str(run)
    assert problem.error(run.values) < 1e-4
    if solver != PAIR:
        assert run.reason.startswith(f"{PAIR} fails: ")


def sprung(k):
    """A bead on a spring and a damper so strong that it creeps."""
    holder = lambda m: mb.SpringDamper("holder", ORIGIN, m.at, k, k, 0.0)  # noqa: E731
    bead = ball(holder, lambda m: mb.Force("push", m.at, (m.p.f * k * mb.t, 0)), g=None, f=1.0)
    return bead.scene("x", np.linspace(0, 2, 21), {"ball.x": 1.0})


def test_stiff_scenes_get_implicit_solvers():
    exact = 2 * np.exp(-np.linspace(0, 2, 21)) + np.linspace(0, 2, 21) - 1  # k (x' + x) = k t, but for x'' / k
    run = mb.simulate(sprung(1e6))
    assert "stiff=True" in run.solver and "too fast for explicit steps" in run.reason
    np.testing.assert_allclose(run["x"], exact, atol=1e-5)
    study = mb.DAESimulator(sprung(1e6))
    assert repr(study.solver) == "Rosenbrock()" and "too fast for explicit steps" in study.reason
    np.testing.assert_allclose(study.run(np.array([[1.0, 1.0]])).Y[0, :, 0], exact, atol=1e-5)


def test_studies_go_through_singular_positions(optimised):
    """A pilot run takes a million steps before it is given up."""
    study = mb.DAESimulator(problems.n_four_bar(2).make())
    assert "AugmentedLagrangian" in repr(study.solver) and study.reason.startswith("DormandPrince() fails: ")


def test_what_nothing_gets_through_is_told_with_every_solver():
    burst = particle(lambda p, mass: 2 * mass.vx**2, [0.0, 1.0], {"mass.vx": 1.0})
    told = r"fails at t = .*Other solvers fail as well: CVODES\(\) at t = .*CVODES\(stiff=True\) at t = "
    assert "\n" not in refused(told, mb.simulate, burst, error=mb.SimulationError)


def test_singular_positions_are_told():
    scene = problems.n_four_bar(2).make().with_times(np.linspace(0, 1, 101))
    run = mb.simulate(scene, AUGMENTED)
    assert run.singularity is not None and abs(run.singularity.time - 0.7143555) < 1e-3
    assert re.search(r"singular    near t = 0\.714\d* s, constraints ", str(run))
    told = r"position may be singular: near t = 0\.71[34]\d* s, constraints '"
    refused(told, mb.simulate, scene, mb.CVODES(), error=mb.SimulationError)
    assert mb.simulate(problems.andrews().make()).singularity is None


def test_runs_that_drift_are_told(monkeypatch):
    """A small fast pendulum: three hundred turns, over which a solver without projection leaves its circle."""
    bob, pivot = problems.pendulum(1e-3)
    system = mb.System(bob, pivot, mb.Gravity(0, -9.81))
    scene = mb.Scene(system, {"bob.theta": 1.0, "bob.omega": 300.0}, np.linspace(0, 20, 11), coordinates="body")
    run = mb.simulate(scene)
    assert run.solver == PAIR and run.position_drift < 1e-9 and run.energy_drift < 1e-4
    monkeypatch.setattr(pilots, "has_compiler", lambda: False)
    run = warned("The run violates its constraints by", mb.simulate, scene)
    assert run.reason.startswith("CVODES(): positions violate the constraints") and run.reason.count(";") >= 2


def test_bounds_of_a_stiff_scene():
    """x = exp(-t) + f (t - 1 + exp(-t)) but for x'' / k: linear in f, whose ends give the bounds."""
    scene = sprung(1e6)
    bounds = mb.propagate(scene, mb.PolynomialChaos(), mb.Box(f=(0.8, 1.2)))
    t = np.asarray(scene.times)
    for f, found in ((0.8, bounds.lower), (1.2, bounds.upper)):
        np.testing.assert_allclose(found[:, 0], np.exp(-t) + f * (t - 1 + np.exp(-t)), atol=1e-5)
    # One shape of time hides as much as a single number, so that 6 of these runs are quasi-random checks.
    assert not bounds.failed and bounds.evaluations < 12


def test_windows_in_space_move_as_in_the_plane():
    space = mb.simulate(problems.windows_in_space(2))
    assert len(space.statistics["start"]["redundant"]) > 0
    plane = mb.simulate(problems.n_four_bar(2).make().with_times(space.t), mb.CVODES(rtol=1e-12))
    np.testing.assert_allclose(space.values, plane.values, atol=1e-6)
