"""Torsion springs and backlash between axes that do not stay parallel: energy, and torques by SciPy's rotations."""

import numpy as np
import pytest
from joints import bundle, numbers
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import symmb as mb

GROUND = mb.Ground()
MAKE = {
    "spring": lambda a, b, axis: mb.TorsionSpring("t", a, b, 5.0, angle=0.3, axis=axis),
    "backlash": lambda a, b, axis: mb.TorsionContact("t", a, b, 0.2, mb.KelvinVoigt(50.0), axis=axis),
}
CARRIED = {
    "Spherical": lambda b: [mb.Spherical("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3))],
    "Universal": lambda b: [mb.Universal("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3), (1, 0, 0), axis_b=(0, 1, 0))],
    "hinge about another axis": lambda b: [mb.Revolute("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3), axis=(1, 0, 1))],
    "PointOnLine": lambda b: [mb.PointOnLine("j", GROUND.point(0, 0, 0), b.point(0, 0, 0.3), axis=(1, 0, 0))],
    "free": lambda b: [],
}
TURNS = {"Universal": {"b.omega_x": 0.7, "b.omega_y": 1.1}, "hinge about another axis": {"j.angle_rate": 1.5}}


@pytest.mark.parametrize("carried", CARRIED)
@pytest.mark.parametrize("kind", MAKE)
def test_energy_is_conserved_between_axes_that_tilt(kind, carried):
    b = mb.Body("b", 1.0, (0.1, 0.2, 0.15), mb.Spatial())
    system = mb.System(b, *CARRIED[carried](b), MAKE[kind](GROUND, b, (0.2, -0.1, 1.0)))
    start = TURNS.get(carried, {"b.omega": (0.5, 0.4, 1.6)})
    run = mb.simulate(mb.Scene(system, start, np.linspace(0, 2, 21), {"omega": b.omega[2]}))
    assert run.energy_drift < 1e-6
    assert not run.doubts


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", MAKE)
def test_the_torque_is_the_slope_of_the_energy_of_the_twist(kind, seed):
    """The twist of a rotation vector r is 2 atan2 of its quaternion's part along the axis and its scalar part."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turned = [Rotation.from_rotvec(rng.normal(size=3) * 0.7) for _ in range(2)]
    a, b = (mb.Body(name, 1.0, (0.4, 0.4, 0.4), mb.Spatial()) for name in "ab")
    _, dae = bundle(a, b, MAKE[kind](a, b, tuple(axis)))

    def energy(small):
        of_b = turned[1] * Rotation.from_rotvec(small)
        x, y, z, w = (turned[0].inv() * of_b).as_quat()
        twist = 2 * np.arctan2(np.dot((x, y, z), axis), w)
        twist -= 2 * np.pi * np.round(twist / (2 * np.pi))
        return 2.5 * (twist - 0.3) ** 2 if kind == "spring" else 25 * max(abs(twist) - 0.1, 0) ** 2

    quaternions = [np.roll(rotation.as_quat(), 1) for rotation in turned]
    q = np.concatenate([[0, 0, 0], quaternions[0], [0.3, 0.1, 0], quaternions[1]])
    s = numbers(dae.s_start, q, [])
    Q = numbers(dae.Q, q, np.zeros(12), s, [], 0.0)
    h = 1e-6
    slope = [(energy(h * e) - energy(-h * e)) / (2 * h) for e in np.eye(3)]
    assert_allclose(Q[9:], -np.array(slope), atol=1e-7)
    assert_allclose(turned[0].apply(Q[3:6]), -turned[1].apply(Q[9:]), atol=1e-12)
    assert np.abs(Q[9:]).max() > 0.1 or (kind == "backlash" and energy(np.zeros(3)) == 0)
    assert_allclose(float(dae.energy(q, np.zeros(12), s, [], 0.0)[1]), energy(np.zeros(3)))
