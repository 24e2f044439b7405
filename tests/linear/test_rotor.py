"""Whirl of a Laval rotor against its complex equations, and the speeds at which it becomes unstable."""

import numpy as np
import pytest
from scipy.linalg import eig

import symmb as mb
from models import laval_rotor


def properties(values) -> tuple[np.ndarray, ...]:
    """M, G and K (2, 2) of deflection and slope, from masses and the flexibility of a simply supported beam."""
    mass = laval_rotor.DENSITY * np.pi * values["radius"] ** 2 * values["thickness"]
    polar = mass * values["radius"] ** 2 / 2
    a = values["share"] * values["length"]
    b = values["length"] - a
    EI = values["modulus"] * np.pi * values["diameter"] ** 4 / 64
    flexibility = np.array([[a**2 * b**2, a * b * (b - a)], [a * b * (b - a), a**2 - a * b + b**2]])
    M = np.diag([mass, polar / 2 + mass * values["thickness"] ** 2 / 12])
    return M, np.diag([0.0, polar]), np.linalg.inv(flexibility / (3 * EI * values["length"]))


def whirl(values) -> np.ndarray:
    """Eigenvalues of M w'' + (C + h K - i speed G) w' + (1 - i speed h) K w = 0 with w = y + i z (Genta 2005)."""
    M, G, K = properties(values)
    damping = np.diag([values["external"], 0.0]) + values["internal"] * K - 1j * values["speed"] * G
    stiffness = (1 - 1j * values["speed"] * values["internal"]) * K
    zero, one = np.zeros((2, 2)), np.eye(2)
    found = eig(np.block([[zero, one], [-stiffness, -damping]]), np.block([[one, zero], [zero, M]]), right=False)
    return np.asarray(found)


@pytest.mark.parametrize(("speed", "share"), [(0.0, 0.3), (300.0, 0.3), (900.0, 0.2), (300.0, 0.5)])
def test_forward_and_backward_whirl(speed, share):
    scene = laval_rotor.scene(speed=speed, share=share)
    lin = mb.linearize(scene)
    assert not lin.doubts and len(lin.states) == 8
    complex_ones = whirl(scene.system.parameters)
    expected = np.concatenate([complex_ones, complex_ones.conj()])  # of y + i z, and of y - i z
    order = [np.lexsort((np.round(x.imag, 3), np.round(x.real, 3))) for x in (lin.eigenvalues, expected)]
    np.testing.assert_allclose(lin.eigenvalues[order[0]], expected[order[1]], rtol=1e-8)
    if speed and share != 0.5:
        backward, forward = sorted(np.abs(complex_ones[np.argsort(np.abs(complex_ones))[:2]]))
        assert forward - backward > 0.01 * forward


def test_onset_of_instability_in_the_middle():
    """omega (1 + c / (h k)) with omega^2 = k / m = 48 E I / (m L^3), for other parameters as well."""
    onset = mb.critical(laval_rotor.scene(share=0.5), "speed", (100.0, 2000.0))
    nominal = dict(onset.parameters)
    for changes in ({}, {"length": 0.5, "internal": 2e-4}, {"diameter": 0.018, "external": 30.0}):
        values = nominal | changes
        M, _, _ = properties(values)
        k = 48 * values["modulus"] * np.pi * values["diameter"] ** 4 / 64 / values["length"] ** 3
        expected = np.sqrt(k / M[0, 0]) * (1 + values["external"] / (values["internal"] * k))
        assert onset.run(np.array([list(values.values())])).Y.item() == pytest.approx(expected, rel=1e-8)


def test_critical_speed_is_where_forward_whirl_keeps_up():
    """Without damping the unbalanced disc in the middle resonates at sqrt(k / m), whatever its speed."""
    scene = laval_rotor.scene(share=0.5)
    M, _, K = properties(scene.system.parameters)
    critical = float(np.sqrt(K[0, 0] / M[0, 0]))
    lin = mb.linearize(scene, parameters={"speed": critical, "external": 0.0, "internal": 0.0})
    assert np.min(np.abs(2 * np.pi * lin.frequencies - critical)) < 1e-9 * critical
    locus = mb.root_locus(scene, "speed", (0.0, 600.0), box=mb.Box(speed=(0.0, 600.0)), count=4)
    assert locus.modes.shape == (4, 4) and not np.isnan(locus.modes).any()
