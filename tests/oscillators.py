"""Problems with closed-form bounds, and simulators of them that have every optional capability."""

from dataclasses import dataclass, field
from math import factorial

import casadi as ca
import numpy as np

from symmb import Box
from symmb.connect.simulator import Ensemble, stream

TIMES = np.linspace(0.0, 6.0, 61)
BOX = Box(amplitude=(0.9, 1.1), w=(0.95, 1.05))


def wave(amplitude, w):
    """x'' + w^2 x = 0, x(0) = amplitude, x'(0) = 0: the position."""
    return amplitude * np.cos(w * TIMES)


def wave_bounds(box=BOX):
    """Closed form: the range of the cosine over [w_lower t, w_upper t] times a positive amplitude."""
    (a_low, a_high), (w_low, w_high) = box.bounds
    low, high = _cos_range(w_low * TIMES, w_high * TIMES)
    lower = np.where(low < 0, a_high, a_low) * low
    upper = np.where(high > 0, a_high, a_low) * high
    return lower[:, None], upper[:, None]


def _cos_range(start, end):
    ends = np.cos(start), np.cos(end)
    peak = np.floor(end / (2 * np.pi)) >= np.ceil(start / (2 * np.pi))
    trough = np.floor((end - np.pi) / (2 * np.pi)) >= np.ceil((start - np.pi) / (2 * np.pi))
    return np.where(trough, -1.0, np.minimum(*ends)), np.where(peak, 1.0, np.maximum(*ends))


@dataclass(frozen=True)
class Wave:
    """The closed form as a simulator with jets, march and a plain expression."""

    parameters: dict = field(default_factory=lambda: {"amplitude": 1.0, "w": 1.0})
    times: np.ndarray = field(default_factory=lambda: TIMES)
    outputs: tuple = ("x",)

    def run(self, P):
        Y = (P[:, :1] * np.cos(P[:, 1:] * TIMES))[:, :, None]
        return Ensemble(Y, np.ones(len(P), bool), np.full(len(P), np.nan), ())

    def stream(self, P, reduction, executor=None, progress=None):
        return stream(self, P, reduction, executor, progress)

    def march(self, P):
        for i, t in enumerate(TIMES):
            yield i, P[:, :1] * np.cos(P[:, 1:] * t)

    def jets(self, p0, directions, order):
        (amplitude, w), (rate, change) = np.broadcast_to(p0, directions.shape).T[..., None], directions.T[..., None]
        cosine = [(change * TIMES) ** j * np.cos(w * TIMES + j * np.pi / 2) / factorial(j) for j in range(order + 1)]
        coefficients = [amplitude * cosine[j] + (rate * cosine[j - 1] if j else 0.0) for j in range(order + 1)]
        return np.stack(coefficients)[..., None]

    @property
    def expression(self):
        p, t = ca.SX.sym("p", 2), ca.SX.sym("t")
        return ca.Function("wave", [p, t], [p[0] * ca.cos(p[1] * t)])
