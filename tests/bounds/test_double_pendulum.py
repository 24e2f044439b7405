"""The paper's double pendulum: its bounds and the true ones, against independent computations of both."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from symmb.bounds import Box, PolynomialChaos, Taylor, propagate
from symmb.simulate import Ensemble, stream

DATA = json.loads((Path(__file__).parents[1] / "data" / "double_pendulum_bounds.json").read_text())
TIMES = np.linspace(0.0, 10.0, 101)
AT = [int(np.flatnonzero(np.isclose(TIMES, t))[0]) for t in DATA["times"]]
G = 9.81


def _rates(angles, speeds, l1, l2):
    """Accelerations of two homogeneous rods of 1 kg/m; angles from the vertical."""
    (a, b), (u, v), c = angles, speeds, np.cos(angles[0] - angles[1])
    s = np.sin(a - b)
    m11, m12, m22 = l1**3 / 3 + l2 * l1**2, l2 * l1 * l2 / 2 * c, l2**3 / 3
    f1 = -l2 * l1 * l2 / 2 * s * v**2 - (l1 / 2 + l2) * G * l1 * np.sin(a)
    f2 = l2 * l1 * l2 / 2 * s * u**2 - l2 * G * l2 / 2 * np.sin(b)
    determinant = m11 * m22 - m12**2
    return np.stack([m22 * f1 - m12 * f2, m11 * f2 - m12 * f1]) / determinant


def _states(angles, speeds, l1, l2):
    (a, b), (u, v) = angles, speeds
    elbow, elbow_rate = (l1 * np.sin(a), l1 * np.cos(a)), (l1 * np.cos(a) * u, -l1 * np.sin(a) * u)
    half, half_rate = (
        (l2 / 2 * np.sin(b), l2 / 2 * np.cos(b)),
        (l2 / 2 * np.cos(b) * v, -l2 / 2 * np.sin(b) * v),
    )
    first = [elbow[0] / 2, elbow[1] / 2, a, elbow[0] + half[0], elbow[1] + half[1], b]
    rates = [
        elbow_rate[0] / 2,
        elbow_rate[1] / 2,
        u,
        elbow_rate[0] + half_rate[0],
        elbow_rate[1] + half_rate[1],
        v,
    ]
    return np.stack([*first, *rates], axis=-1)


@dataclass(frozen=True)
class Pendulum:
    """Minimal coordinates, RK4 with 1000 steps (error 5e-7), all samples at once; jets by differences."""

    parameters: dict = field(default_factory=lambda: {"l1": 1.0, "l2": 1.0})
    times: np.ndarray = field(default_factory=lambda: TIMES)
    outputs: tuple = tuple(DATA["names"])

    def run(self, P):
        l1, l2 = P.T
        q = np.repeat([[np.pi / 4], [np.pi / 3]], len(P), axis=1)
        v = np.zeros_like(q)
        Y, h = [_states(q, v, l1, l2)], 0.01
        for step in range(1, 1001):
            k1 = v, _rates(q, v, l1, l2)
            k2 = v + h / 2 * k1[1], _rates(q + h / 2 * k1[0], v + h / 2 * k1[1], l1, l2)
            k3 = v + h / 2 * k2[1], _rates(q + h / 2 * k2[0], v + h / 2 * k2[1], l1, l2)
            k4 = v + h * k3[1], _rates(q + h * k3[0], v + h * k3[1], l1, l2)
            q, v = (x + h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]) for i, x in enumerate((q, v)))
            if step % 10 == 0:
                Y.append(_states(q, v, l1, l2))
        return Ensemble(np.stack(Y, axis=1), np.ones(len(P), bool), np.full(len(P), np.nan), ())

    def stream(self, P, reduction, executor=None, progress=None):
        return stream(self, P, reduction, executor, progress)

    def jets(self, p0, directions, order):
        m, h = len(directions), 0.02
        steps = np.array([-2, -1, 0, 1, 2]) * h
        Y = self.run((p0 + np.multiply.outer(steps, directions)).reshape(-1, 2)).Y.reshape(5, m, len(TIMES), 12)
        first = (Y[0] - 8 * Y[1] + 8 * Y[3] - Y[4]) / (12 * h)
        second = (-Y[0] + 16 * Y[1] - 30 * Y[2] + 16 * Y[3] - Y[4]) / (12 * h**2)
        return np.stack([Y[2], first, second / 2])


@pytest.fixture(scope="module")
def bounds():
    """Bounds of a method, run once for each spread."""
    known = {}

    def of(method, spread):
        key = repr(method), spread
        if key not in known:
            simulator = Pendulum()
            known[key] = propagate(simulator, method, Box.around(simulator.parameters, spread))
        return known[key]

    return of


def _deviation(result, case):
    """Largest deviation of either bound, over the root mean square width, an array of 12 outputs."""
    lower, upper = np.array(case["lower"]).T, np.array(case["upper"]).T
    width = np.sqrt(np.mean((upper - lower) ** 2, axis=0))
    return np.maximum(np.abs(result.lower[AT] - lower), np.abs(result.upper[AT] - upper)).max(axis=0) / width


@pytest.mark.parametrize("spread", [0.05, 0.2])
def test_paper_method_gives_the_paper_s_bounds(bounds, spread):
    case = DATA["cases"][f"{spread:.0%}"]["paper"]
    assert _deviation(bounds(PolynomialChaos.paper(order=2), spread), case).max() < 5e-5


def test_taylor_gives_the_bounds_from_variational_equations(bounds):
    assert _deviation(bounds(Taylor(order=2), 0.05), DATA["cases"]["5%"]["taylor"]).max() < 2e-3


def test_order_four_meets_the_true_bounds(bounds):
    result = bounds(PolynomialChaos(order=4), 0.05)
    assert result.evaluations == 25
    assert _deviation(result, DATA["cases"]["5%"]["true"]).max() < 5e-3


def test_adaptive_order_keeps_its_tolerance(bounds):
    result = bounds(PolynomialChaos(), 0.05)
    true = DATA["cases"]["5%"]["true"]
    assert _deviation(result, true).max() < 1e-2
    lower, upper = result.outer
    width = np.array(true["upper"]).T - np.array(true["lower"]).T
    assert (lower[AT] <= np.array(true["lower"]).T + 1e-4 * width).all()
    assert (upper[AT] >= np.array(true["upper"]).T - 1e-4 * width).all()


def test_paper_method_is_much_wider_than_the_true_bounds(bounds):
    paper, best = bounds(PolynomialChaos.paper(order=2), 0.05), bounds(PolynomialChaos(order=4), 0.05)
    assert (paper.upper - paper.lower).mean() > 1.2 * (best.upper - best.lower).mean()
