"""Stability limits: the Whipple bicycle against its published equations, and closed forms."""

import itertools

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import GROUND
from scipy.linalg import eig
from scipy.optimize import minimize

import symmb as mb
from models import bicycle, laval_rotor

WEAVE, CAPSIZE = 4.29238253634111, 6.02426201538837
"""Critical speeds of the benchmark [m/s], Meijaard et al. (2007), section 7."""


def published(v, w=1.02, c=0.08, lam=np.pi / 10, xB=0.3, hB=0.9, mB=85.0) -> np.ndarray:
    """A (4, 4) of lean and steer, from M, C1, K0 and K2 of Meijaard et al. (2007), appendix A; z points down there."""
    g, rR, mR, IRxx, IRyy = 9.81, 0.3, 2.0, 0.0603, 0.12
    zB, IBxx, IBxz, IBzz = -hB, 9.2, 2.4, 2.8
    xH, zH, mH, IHxx, IHxz, IHzz = 0.9, -0.7, 4.0, 0.05892, -0.00756, 0.00708
    rF, mF, IFxx, IFyy = 0.35, 3.0, 0.1405, 0.28
    mT = mR + mB + mH + mF
    xT = (xB * mB + xH * mH + w * mF) / mT
    zT = (-rR * mR + zB * mB + zH * mH - rF * mF) / mT
    ITxx = IRxx + IBxx + IHxx + IFxx + mR * rR**2 + mB * zB**2 + mH * zH**2 + mF * rF**2
    ITxz = IBxz + IHxz - mB * xB * zB - mH * xH * zH + mF * w * rF
    ITzz = IRxx + IBzz + IHzz + IFxx + mB * xB**2 + mH * xH**2 + mF * w**2
    mA = mH + mF
    xA, zA = (xH * mH + w * mF) / mA, (zH * mH - rF * mF) / mA
    IAxx = IHxx + IFxx + mH * (zH - zA) ** 2 + mF * (rF + zA) ** 2
    IAxz = IHxz - mH * (xH - xA) * (zH - zA) + mF * (w - xA) * (rF + zA)
    IAzz = IHzz + IFxx + mH * (xH - xA) ** 2 + mF * (w - xA) ** 2
    s, k = np.sin(lam), np.cos(lam)
    uA = (xA - w - c) * k - zA * s
    IAll = mA * uA**2 + IAxx * s**2 + 2 * IAxz * s * k + IAzz * k**2
    IAlx, IAlz = -mA * uA * zA + IAxx * s + IAxz * k, mA * uA * xA + IAxz * s + IAzz * k
    mu, SF = c / w * k, IFyy / rF
    ST, SA = IRyy / rR + SF, mA * uA + mu * mT * xT
    M = np.array([[ITxx, IAlx + mu * ITxz], [IAlx + mu * ITxz, IAll + 2 * mu * IAlz + mu**2 * ITzz]])
    K0 = np.array([[mT * zT, -SA], [-SA, -SA * s]])
    K2 = np.array([[0, (ST - mT * zT) / w * k], [0, (SA + SF * s) / w * k]])
    lean = mu * ST + SF * k
    C1 = np.array([[0, lean + ITxz / w * k - mu * mT * zT], [-lean, IAlz / w * k + mu * (SA + ITzz / w * k)]])
    lower = -np.linalg.solve(M, np.hstack([g * K0 + v**2 * K2, v * C1]))
    return np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), lower])


def limits(**changes) -> list[float]:
    """Weave and capsize speed of the published equations: bisection of what is stable from 2.5 to 9 m/s."""

    def stable(v):
        return np.linalg.eigvals(published(v, **changes)).real.max() < 0

    grid = np.linspace(2.5, 9, 131)
    flags = [stable(v) for v in grid]
    found = []
    for low, high, first, last in zip(grid, grid[1:], flags, flags[1:], strict=False):
        if first != last:
            while high - low > 1e-11:
                middle = (low + high) / 2
                low, high = (middle, high) if stable(middle) == first else (low, middle)
            found.append((low + high) / 2)
    return found


def test_published_digits():
    np.testing.assert_allclose(limits(), [WEAVE, CAPSIZE], rtol=1e-10)


@pytest.mark.parametrize("v", [0.0, 1.0, 3.0, 5.0, 7.0, 10.0])
def test_eigenvalues_of_the_bicycle(v):
    lin = mb.linearize(bicycle.scene(), parameters={"v": v})
    assert not lin.doubts
    expected = np.linalg.eigvals(published(v))
    found = lin.eigenvalues[lin.eigenvalues != 0]
    assert len(found) == len(expected)
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-9)


def test_critical_speeds_of_the_bicycle():
    speeds = mb.critical(bicycle.scene(), "v", (0.1, 10.0))
    assert speeds.outputs == ("v1", "v2")
    assert "v" not in speeds.parameters
    nominal = np.array([list(speeds.parameters.values())])
    np.testing.assert_allclose(speeds.run(nominal).Y[0, 0], [WEAVE, CAPSIZE], rtol=1e-9)


@pytest.mark.long
def test_bounds_of_the_critical_speeds():
    """A scan of 3^6 of the published equations lies inside, and the polynomial needs few evaluations."""
    scene = bicycle.scene()
    bounds = mb.propagate(mb.critical(scene, "v", (0.1, 10.0)), mb.PolynomialChaos(tolerance=1e-2), box=scene.box)
    names = {"wheelbase": "w", "trail": "c", "tilt": "lam", "frame_x": "xB", "frame_z": "hB", "frame_mass": "mB"}

    def at(point):
        return limits(**dict(zip(map(names.get, scene.box.names), point, strict=True)))

    points = np.array([*itertools.product(*[np.linspace(*ends, 3) for ends in scene.box.bounds])])
    values = np.array([at(point) for point in points])
    lower, upper = bounds.outer
    assert (lower[0] <= values.min(axis=0)).all() and (values.max(axis=0) <= upper[0]).all()
    for k in range(2):
        for sign, bound in ((1, bounds.lower[0, k]), (-1, bounds.upper[0, k])):
            begin, speed = points[(sign * values[:, k]).argmin()], lambda x, k=k, sign=sign: sign * at(x)[k]
            extreme = sign * minimize(speed, begin, bounds=scene.box.bounds, options={"eps": 1e-5}).fun
            assert abs(bound - extreme) <= 1e-2 * np.ptp(values[:, k])
    assert bounds.evaluations <= 120


def test_flutter_of_a_follower_force():
    """Ziegler's column without damping: flutter where the frequencies coalesce (Ziegler 1968).

    Masses 2 m and m at the ends of two links of length 1, springs c: P = (7/2 - sqrt(2)) c.
    """
    p = mb.Parameters(c=2.0, P=1.0)
    one, two = mb.Body("one", 2.0, 1e-12), mb.Body("two", 1.0, 1e-12)
    a = mb.Revolute("a", GROUND.point(0, 0), one.point(-1, 0))
    b = mb.Revolute("b", one.point(0, 0), two.point(-1, 0))
    load = mb.Force("load", two.point(0, 0), (-p.P * ca.cos(two.theta), -p.P * ca.sin(two.theta)))
    springs = (mb.Actuator("s1", a, -p.c * a.angle), mb.Actuator("s2", b, -p.c * b.angle))
    flutter = mb.critical(mb.Scene(mb.System(one, two, a, b, load, *springs, parameters=p)), "P", (0.5, 6.0))
    expected = (3.5 - np.sqrt(2)) * np.array([2.0, 1.5])
    np.testing.assert_allclose(flutter.run(np.array([[2.0], [1.5]])).Y.ravel(), expected, rtol=1e-6)


def test_faults():
    scene = bicycle.scene()
    refused("no parameter 'speed'", mb.critical, scene, "speed", (0, 1))
    refused("lower end of the range", mb.critical, scene, "v", (3, 1))
    refused("bicycle is unstable at all tested values of v from 1 to 2", mb.critical, scene, "v", (1, 2))


# Whirl of a Laval rotor against its complex equations, and the speeds at which it becomes unstable.


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
