"""A second look at runs, by another family of solvers and in other coordinates, and the error that it estimates."""

import json
import warnings
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_SOLVERS
from machines import free_body
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from small_scenes import particle

import symmb as mb
from models import double_pendulum, four_bar, slider_crank
from symmb.run.simulation import DAESimulator
from symmb.run.verification import deformation_doubts, other_way
from symmb.run.verification.two_ways import changes_of_outputs


def oscillator(times, k=4.0):
    return particle(lambda p, mass: -p.k * mass.x, times, {"mass.x": 1.0}, k=(0.9 * k, 1.1 * k))


def wrong_by(simulator, shift):
    """The simulator with outputs in coordinates of joints that grow away from the right ones."""
    form = simulator.program.forms.joints
    x, p, t = (ca.SX.sym(name, form.y.numel_in(k)) for k, name in enumerate(("x", "p", "t")))
    y = ca.Function("y", [x, p, t], [form.y(x, p, t) + shift * t])
    return simulator._by(simulator.program.with_outputs(y))


def test_a_body_that_bends_too_far_is_told_with_the_first_and_the_worst_time():
    beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.004), mb.Material(E=2e11, density=8e3, nu=0.3))
    modes = mb.FiniteElements.beams(beam).modes(clamped=0, count=1, planar=True)
    scene, bent = mb.Scene(mb.System(mb.FlexibleBody("rod", modes, mb.Planar()))), np.outer([0, 1, 5, 2], np.eye(8)[3])
    (told,) = deformation_doubts(scene, mb.compile_dae(scene.system), bent, np.empty(0), np.arange(4.0))
    assert "(at t = 2 s), and by more than 0.3 rad from t = 1 s on" in told


def test_differences_of_any_two_states_are_rounding_where_they_are_small():
    """As angles between bodies that move alike, such as the joints of a robot in free fall."""
    x, p, t = ca.SX.sym("x", 40), ca.SX.sym("p", 0), ca.SX.sym("t")
    pairs = [x[i] - sign * x[k] for i in range(40) for k in range(i) for sign in (-1, 1)]
    y = ca.Function("y", [x, p, t], [ca.vertcat(*pairs)])
    sized = SimpleNamespace(state_sizes=np.ones(40))
    changes = changes_of_outputs(y, sized, np.zeros((3, 40)), np.zeros(0), np.zeros(3), 1e-6)
    assert changes.min() > 1e-9 and changes.max() < 4e-6


@pytest.mark.parametrize("model", [double_pendulum, four_bar, slider_crank])
def test_fault_in_one_of_two_coordinates_is_a_doubt_with_both_values(model):
    simulator = DAESimulator(model.scene())
    simulator.second_look()
    assert simulator.coordinates == "joint" and not simulator.doubts
    faulty = wrong_by(simulator, 1.0)
    assert faulty.noise is None and not faulty.doubts
    faulty.second_look()
    (doubt,) = faulty.doubts
    end = simulator.times[-1]
    assert f"at t = {end:g} s" in doubt
    assert "DormandPrince() in coordinates of joints" in doubt
    assert "CVODES(rtol=1e-12) in coordinates of bodies" in doubt
    assert (faulty.noise >= 0.99 * end).all()
    almost = wrong_by(simulator, 1e-9)
    almost.second_look()
    assert not almost.doubts


@pytest.mark.parametrize("solver", [s for s in ALL_SOLVERS if not isinstance(s, mb.EventDriven)], ids=repr)
def test_the_other_way_is_another_solver(solver):
    simulator = DAESimulator(oscillator(np.linspace(0, 2, 11)), solver)
    other = other_way(simulator.program, simulator.times).solver
    of_sundials = mb.CVODES, mb.IDAS, mb.StabilizedIndex2
    assert isinstance(other, of_sundials) != isinstance(solver, of_sundials)


@pytest.mark.parametrize("rate", [0.7, 2.0, 31.0])
@pytest.mark.parametrize("solver", [mb.RungeKutta(steps=60), mb.GeneralizedAlpha(step=0.01), mb.DormandPrince(1e-4)])
def test_errors_of_a_checked_run_are_those_of_the_closed_form(solver, rate):
    times = np.linspace(0, 12 / rate, 41)
    solver = replace(solver, step=solver.step / rate) if isinstance(solver, mb.GeneralizedAlpha) else solver
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        run = mb.simulate(oscillator(times, rate**2), solver, check=True)
    error = np.abs(run["x"] - np.cos(rate * times))
    assert run.error.ravel() == pytest.approx(error, rel=1e-2, abs=1e-6)
    assert any("exceed a thousandth" in doubt for doubt in run.doubts) == (error.max() > 2e-3)


def test_second_way_that_breaks_down_is_told():
    """Explicit steps creep into a singularity of the force, in which no way goes on."""
    law = lambda p, mass: -p.k / mass.x**3  # noqa: E731
    simulator = DAESimulator(particle(law, np.linspace(0, 0.9, 10), {"mass.x": 1.0}, k=(1.0, 1.0)))
    ways = simulator.ways.two(np.array([1.0]))
    assert not ways.unchecked and not ways.doubts
    ways = simulator.ways.two(np.array([2.0]))  # x = sqrt(1 - k t^2) ends at 0.707 s
    assert "A second run by CVODES" in ways.unchecked and "with k = 2, fails at t = 0.7" in ways.unchecked
    assert ways.unchecked.count("t = ") == ways.unchecked.count("k = 2") == 1


INERTIA = (1.0, 2.0, 3.0)


def spinning(omega, end):
    """A free body that spins about its middle axis."""
    outputs = lambda m: {"wx": m.top.omega[0], "wy": m.top.omega[1]}  # noqa: E731
    return free_body(inertia=INERTIA).scene(outputs, np.linspace(0, end, 201), {"top.omega": omega})


def euler(omega, times):
    """Euler's equations by SciPy."""
    a, b, c = INERTIA

    def slope(_, w):
        return [(b - c) / a * w[1] * w[2], (c - a) / b * w[2] * w[0], (a - b) / c * w[0] * w[1]]

    return solve_ivp(slope, times[[0, -1]], omega, "DOP853", times, rtol=1e-13, atol=1e-15).y[:2].T


def test_the_error_of_a_regular_run_is_estimated_and_small():
    scene = spinning((0.3, 1.0, 0.2), 20.0)
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-6), check=True)
    true = np.abs(run.values - euler((0.3, 1.0, 0.2), scene.times))
    assert run.error.shape == run.values.shape and run.doubts == ()
    assert 0.5 * true.max() < run.error.max() < 2 * true.max()
    assert mb.simulate(scene).error is None


def test_digits_that_an_instability_loses_are_told(tmp_path):
    """From 1e-8 the body turns over (Dzhanibekov); each turn takes digits."""
    scene = spinning((1e-8, 1.0, 1e-8), 100.0)
    with pytest.warns(mb.SymmbWarning, match=r"From t = [\d.]+ s on, errors of wx, wy exceed a thousandth"):
        run = mb.simulate(scene, mb.DormandPrince(), check=True)
    since = float(run.doubts[0].split("t = ")[1].split(" s")[0])
    true = np.abs(run.values - euler((1e-8, 1.0, 1e-8), scene.times))
    assert_allclose(run.values[run.t < since], euler((1e-8, 1.0, 1e-8), scene.times)[run.t < since], atol=1e-2)
    assert true[run.t > since].max() > 1e-4
    run.save(tmp_path / "run.json")
    assert json.loads((tmp_path / "run.json").read_text())["doubts"] == list(run.doubts)
    loaded = mb.Trajectory.load(tmp_path / "run.json")
    assert loaded.doubts == run.doubts
    assert_allclose(loaded.error, run.error)
