"""Shipped scenes against digits known to be right; every file of tests/data says where its digits come from."""

import numpy as np
import pytest
from problems import model, read

import symmb as mb

DEFAULT = mb.CVODES()
TIGHT = mb.CVODES(rtol=1e-12)

CASES = [
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


@pytest.mark.parametrize(("name", "case", "solver", "tolerance"), CASES)
def test_states(name, case, solver, tolerance):
    known = read(name, case)
    run = mb.simulate(model(name, **known.get("scene", {})), solver, times=known["times"])
    error = deviation(np.column_stack([run[output] for output in known["names"]]), known["values"])
    assert error.max() < tolerance, dict(zip(known["names"], error, strict=True))


@pytest.mark.parametrize(("solver", "tolerance"), [(DEFAULT, 1e-6), (TIGHT, 1e-9)])
def test_multipliers_of_the_double_pendulum(solver, tolerance):
    known = read("double_pendulum")
    run = mb.simulate(model("double_pendulum"), solver, times=known["times"])
    # The paper's third and fourth row place the second rod against the ground, ours against the first rod.
    shoulder, elbow = np.array(known["multipliers"]).T.reshape(2, 2, -1)
    assert deviation(run.lam, np.vstack([shoulder + elbow, elbow]).T).max() < tolerance


def test_andrews_mechanism_starts_with_the_published_multipliers():
    run = mb.simulate(model("andrews"), times=[0.0, 1e-6])
    assert run.values[0, :2] == pytest.approx([-0.06171389001427645, 0.0], abs=1e-15)
    assert run["lam1"][0] == pytest.approx(98.56687039624114, abs=1e-6)
    assert run["lam2"][0] == pytest.approx(-6.122688344255656, abs=1e-6)


def test_multipliers_of_the_car_axis():
    known = read("car_axis")
    run = mb.simulate(model("car_axis"), times=known["times"])
    for column, name in ((-2, "lam1"), (-1, "lam2")):
        reference = np.array(known["values"])[:, column]
        assert np.abs(run[name] - reference).max() < 1e-5 * np.abs(reference).max()


def test_car_axis_meets_the_published_solution():
    known = read("car_axis")
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
    start = {"body.omega": tuple(known["omega"])}
    run = mb.simulate(mb.Scene(mb.System(body), start=start, times=known["times"]))
    values = np.column_stack([run[name] for name in known["names"]])
    assert np.abs(values - known["values"]).max() < 1e-6
