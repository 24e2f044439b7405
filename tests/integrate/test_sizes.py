"""Absolute tolerances follow the size of each state, against closed forms; systems of many bodies and of one state."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ALL_SOLVERS
from numpy.testing import assert_allclose
from scipy.special import ellipj, ellipk
from small_scenes import state, two_masses

import symmb as mb
from symmb.run.integrate import stiffness

GROUND = mb.Ground()
TOLERANCES = [None, mb.CVODES(), mb.CVODES(stiff=True), mb.DormandPrince(), mb.IDAS(), mb.StabilizedIndex2()]
TOLERANCES += [mb.StateSpace(), mb.Rosenbrock(), mb.EventDriven()]


def two_oscillators(large: float, small: float, rate: float, span: float) -> mb.Scene:
    """x'' = -x from `large`, and y'' = -rate^2 y from `small`, of particles that do not act on each other."""
    scene = two_masses(lambda p, a, b: ((-a.x, 0, 0), (0, -(p.rate**2) * b.y, 0)), rate=rate)
    return replace(scene, start={"a.x": large, "b.y": small}, times=np.linspace(0, span, 41))


@pytest.mark.parametrize(("large", "small", "rate"), [(10.0, 1e-9, 3.0), (1e3, 1e-7, 0.5), (1e-3, 1e-12, 2.0)])
@pytest.mark.parametrize("solver", TOLERANCES, ids=repr)
def test_a_small_motion_beside_a_large_one_is_as_accurate(solver, large, small, rate):
    run = mb.simulate(two_oscillators(large, small, rate, 20.0), solver)
    assert_allclose(run["x"] / large, np.cos(run.t), rtol=0, atol=1e-6)
    coarse = isinstance(solver, mb.Rosenbrock | mb.StabilizedIndex2)  # of low order, with errors of this size alone
    assert_allclose(run["y"] / small, np.cos(rate * run.t), rtol=0, atol=2e-5 if coarse else 1e-6)


def test_a_given_absolute_tolerance_holds_for_all():
    run = mb.simulate(two_oscillators(10.0, 1e-9, 3.0, 20.0), mb.DormandPrince(atol=1e-6))
    assert 1e-5 < np.abs(run["y"] / 1e-9 - np.cos(3 * run.t)).max() < 1e-3


@pytest.mark.parametrize("amplitude", [1e-3, 1e-6])
def test_a_small_swing_of_a_large_pendulum_is_accurate(amplitude):
    """Its height is 1 m, and its swing follows from Jacobi's elliptic functions."""
    rod = mb.Body("rod", 1.0, 0.0)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, 1.0))
    scene = mb.Scene(
        mb.System(rod, hinge, mb.Gravity(0, -9.81)), {"rod.theta": amplitude}, np.linspace(0, 10, 41),
        {"theta": rod.theta},
    )  # fmt: skip
    k = np.sin(amplitude / 2)
    sn = ellipj(ellipk(k**2) - np.sqrt(9.81) * scene.times, k**2)[0]
    run = mb.simulate(scene, mb.DormandPrince())
    assert_allclose(run["theta"] / amplitude, 2 * np.arcsin(k * sn) / amplitude, rtol=0, atol=1e-5)


def test_angles_of_tiny_mechanisms_are_not_held_below_their_rounding():
    """A plate on four cranks of a micrometre: units do not change the number of steps much."""

    def steps(length: float, rate: float) -> int:
        plate, ground = mb.Body("plate", 1.0, length**2 / 3), mb.Ground()
        pins, cranks, joints = [(0.0, 0.0), (1.0, 0.2), (0.4, 0.9)], [], []
        for i, pin in enumerate(pins):
            place = tuple(c * length for c in pin)
            cranks.append(crank := mb.Body(f"crank{i}", 1.0, length**2 / 12))
            joints.append(mb.Revolute(f"A{i}", ground.point(*place), crank.point(-length / 2, 0)))
            joints.append(mb.Revolute(f"B{i}", crank.point(length / 2, 0), plate.point(*place)))
        guess = {"plate.x": length * np.cos(1.3), "plate.y": length * np.sin(1.3)}
        for i, pin in enumerate(pins):
            guess |= {f"crank{i}.x": length * (pin[0] + np.cos(1.3) / 2), f"crank{i}.theta": 1.3}
            guess |= {f"crank{i}.y": length * (pin[1] + np.sin(1.3) / 2)}
        del guess["crank0.theta"]
        system = mb.System(plate, *cranks, *joints, mb.Gravity(0, -length * rate**2))
        start = {"crank0.theta": 1.3, "crank0.omega": 1.5 * rate}
        scene = mb.Scene(system, start, np.linspace(0, 5 / rate, 21), guess=guess)
        return mb.simulate(scene, mb.DormandPrince()).statistics["integrator"]["steps"]

    assert steps(1e-6, 3e4) < 2 * steps(1.0, 1.0)


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_a_single_state(solver):
    """z' = -k z alone: exp(-k t)."""
    scene = state(lambda p, z: -p.k * z, np.linspace(0.0, 1.0, 3), 1.0, k=(0.9, 1.1))
    bounds = mb.propagate(scene, mb.Vertex(), solver=solver)
    assert_allclose(bounds["z"], (np.exp(-1.1 * bounds.t), np.exp(-0.9 * bounds.t)), atol=1e-6)


def test_a_long_chain_of_particles_runs():
    """300 particles on springs: the memory grows with their number, and the fastest frequency is that of a chain."""
    n, k = 300, 100.0
    bodies = [mb.Body(f"b{i}", 1.0, pose=mb.Particle()) for i in range(n)]
    ends = [mb.Ground().point(0, 0), *(body.point(0, 0) for body in bodies)]
    springs = [mb.Spring(f"s{i}", ends[i], ends[i + 1], k, 1.0) for i in range(n)]
    start = {f"b{i}.x": 1.0 + i + (0.1 if i == n - 1 else 0.0) for i in range(n)}
    scene = mb.Scene(mb.System(*bodies, *springs), start, [0.0, 0.05], {"x": bodies[-1].x})
    simulator = mb.prepare(scene)
    x = simulator.start.states(simulator.dae.p_nominal[None])[0]
    fastest = stiffness(simulator.dae, x, simulator.dae.p_nominal, np.zeros(1))
    assert fastest.frequency == pytest.approx(2 * np.sqrt(k) * np.cos(np.pi / (4 * n + 2)), rel=0.03)
    assert mb.simulate(scene)["x"][-1] == pytest.approx(n + 0.1 * np.cos(10 * 0.05), rel=1e-4)
