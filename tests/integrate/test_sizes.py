"""Absolute tolerances follow the size of each state: small motions beside large ones, against closed forms."""

import numpy as np
import pytest
from conftest import ALL_SOLVERS
from numpy.testing import assert_allclose
from scipy.special import ellipj, ellipk

import symmb as mb

GROUND = mb.Ground()
TOLERANCES = [None, mb.CVODES(), mb.CVODES(stiff=True), mb.DormandPrince(), mb.IDAS(), mb.StabilizedIndex2()]
TOLERANCES += [mb.StateSpace(), mb.Rosenbrock(), mb.EventDriven()]


def two_oscillators(large: float, small: float, rate: float, span: float) -> mb.Scene:
    """x'' = -x from `large`, and y'' = -rate^2 y from `small`, of particles that do not act on each other."""
    a, b = (mb.Body(name, 1.0, 0.0, mb.Particle()) for name in "ab")
    springs = [mb.Force("slow", a.point(0, 0), (-a.x, 0)), mb.Force("fast", b.point(0, 0), (-(rate**2) * b.x, 0))]
    outputs = {"x": a.x, "y": b.x}
    return mb.Scene(mb.System(a, b, *springs), {"a.x": large, "b.x": small}, np.linspace(0, span, 41), outputs)


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
            foot = ground.point(*(c * length for c in pin))
            crank = mb.Body(f"crank{i}", 1.0, length**2 / 12)
            cranks.append(crank)
            joints.append(mb.Revolute(f"A{i}", foot, crank.point(-length / 2, 0)))
            joints.append(mb.Revolute(f"B{i}", crank.point(length / 2, 0), plate.point(*(c * length for c in pin))))
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
    p = mb.Parameters(k=1.0)
    z = mb.State("z", rate=lambda z: -p.k * z)
    scene = mb.Scene(mb.System(z, parameters=p), {"z": 1.0}, np.linspace(0.0, 1.0, 3), {"z": z.value})
    bounds = mb.propagate(scene, mb.Vertex(), mb.Box(k=(0.9, 1.1)), solver=solver)
    np.testing.assert_allclose(bounds.lower[:, 0], np.exp(-1.1 * bounds.t), atol=1e-6)
    np.testing.assert_allclose(bounds.upper[:, 0], np.exp(-0.9 * bounds.t), atol=1e-6)
