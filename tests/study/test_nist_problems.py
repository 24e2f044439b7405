"""Calibration against NIST's reference data of nonlinear regression: certified estimates and deviations.

https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml
"""

from typing import NamedTuple

import numpy as np
import pytest

import symmb as mb


class Problem(NamedTuple):
    """A model f(t, *parameters), data, NIST's second start, and certified estimates and standard deviations."""

    model: object
    t: object
    y: list
    start: list
    estimates: list
    deviations: list


def _two_decays(t, a, b, c, d, e):
    return a + b * np.exp(-t * d) + c * np.exp(-t * e)


def _three_decays(t, a, b, c, d, e, f):
    return a * np.exp(-b * t) + c * np.exp(-d * t) + e * np.exp(-f * t)


PROBLEMS = {
    "Misra1a": Problem(
        lambda t, a, b: a * (1 - np.exp(-b * t)),
        [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0],
        [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78],
        [250.0, 0.0005],
        [238.94212918, 0.00055015643181],
        [2.7070075241, 7.2668688436e-06],
    ),
    "MGH09": Problem(
        lambda t, a, b, c, d: a * (t**2 + t * b) / (t**2 + t * c + d),
        [0.0625, 0.0714, 0.0833, 0.1, 0.125, 0.167, 0.25, 0.5, 1.0, 2.0, 4.0],
        [0.0246, 0.0235, 0.0323, 0.0342, 0.0456, 0.0627, 0.0844, 0.16, 0.1735, 0.1947, 0.1957],
        [0.25, 0.39, 0.415, 0.39],
        [0.19280693458, 0.19128232873, 0.12305650693, 0.13606233068],
        [0.011435312227, 0.19633220911, 0.080842031232, 0.090025542308],
    ),
    "MGH10": Problem(
        lambda t, a, b, c: a * np.exp(b / (t + c)),
        np.arange(50.0, 126.0, 5.0),
        [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872],
        [0.02, 4000.0, 250.0],
        [5.6096364710e-03, 6.1813463463e03, 3.4522363462e02],
        [1.5687892471e-04, 2.3309021107e01, 7.8486103508e-01],
    ),
    "MGH17": Problem(
        _two_decays,
        np.arange(0.0, 321.0, 10.0),
        [0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603,
         0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411,
         0.406],
        [0.5, 1.5, -1.0, 0.01, 0.02],
        [0.37541005211, 1.9358469127, -1.4646871366, 0.01286753464, 0.022122699662],
        [0.0020723153551, 0.22031669222, 0.22175707739, 0.00044861358114, 0.00089471996575],
    ),
    "Lanczos2": Problem(
        _three_decays,
        np.arange(24) / 20,
        [2.5134, 2.04433, 1.6684, 1.36642, 1.12323, 0.92689, 0.767934, 0.638878, 0.533784, 0.447936, 0.377585, 0.319739,
         0.272013, 0.232497, 0.199659, 0.17227, 0.149341, 0.13007, 0.113812, 0.100042, 0.0883321, 0.0783354, 0.0697669,
         0.0623931],
        [0.5, 0.7, 3.6, 4.2, 4.0, 6.3],
        [0.096251029939, 1.0057332849, 0.86424689056, 3.0078283915, 1.5529016879, 5.00287981],
        [0.00066770575477, 0.0033989646176, 0.0017185846685, 0.0041707005856, 0.0023744381417, 0.0013958787284],
    ),
    "BoxBOD": Problem(
        lambda t, a, b: a * (1 - np.exp(-b * t)),
        [1.0, 2.0, 3.0, 5.0, 7.0, 10.0],
        [109, 149, 149, 191, 213, 224],
        [100.0, 0.75],
        [213.80940889, 0.54723748542],
        [12.354515176, 0.10455993237],
    ),
}  # fmt: skip


@pytest.mark.parametrize("is_certified_start", [False, True])
@pytest.mark.parametrize("name", PROBLEMS)
def test_estimates_and_deviations_are_the_certified_values(name, is_certified_start):
    model, t, y, start, estimates, deviations = PROBLEMS[name]
    t, names = np.array(t), "abcdef"[: len(start)]
    own = dict(zip(names, estimates if is_certified_start else start, strict=True))
    arguments = ", ".join(names)
    run = eval(f"lambda {arguments}: model(t, {arguments})", {"model": model, "t": t})
    fit = mb.calibrate(mb.FunctionSimulator(run, own, t, ["y"]), {"y": y})
    off = np.subtract([*fit.parameters.values()], estimates) / deviations
    assert np.abs(off).max() < 1e-3
    assert [*fit.deviations.values()] == pytest.approx(deviations, rel=1e-3)
    assert not fit.warnings
