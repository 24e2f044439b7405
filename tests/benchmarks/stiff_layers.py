"""Random stiff reactions and circuits whose fast motion at the start takes about 1e-14 of the time, against SciPy.

    stiff_layers.py [scenes, 20] [seed, 0]

Each scene runs with the default solver of studies at both ends of a range of one parameter. The values at the end must
be those of SciPy's Radau with tighter tolerances, within MOST of the largest value that the output has had.
"""

import sys
import time
import warnings
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

MOST = 1e-5
"""Largest error at the end, relative to the largest start."""


def robertson(rng: np.random.Generator) -> tuple[Any, list[float], float]:
    a, b, c = (k * 10 ** rng.uniform(-1, 1) for k in (0.04, 1e4, 3e7))

    def rates(s: Any, *y: Any) -> list:
        first, second, third = s * a * y[0], b * y[1] * y[2], c * y[1] ** 2
        return [second - first, first - second - third, third]

    return rates, [1.0, 0.0, 0.0], 1e14 * float(np.sqrt(1 / a / c)) * 10 ** rng.uniform(-1, 0)


def enzyme(rng: np.random.Generator) -> tuple[Any, list[float], float]:
    """An enzyme binds its substrate fast, and makes the product slowly (Michaelis and Menten)."""
    binds, parts, makes = 10 ** rng.uniform(10, 12), 10 ** rng.uniform(9, 11), 10 ** rng.uniform(-3, -2)

    def rates(s: Any, *y: Any) -> list:
        joined, made = binds * y[0] * y[1] - parts * y[2], s * makes * y[2]
        return [-joined, made - joined, joined - made, made]

    return rates, [1.0, rng.uniform(0.1, 0.5), 0.0, 0.0], 1e14 / binds


def relaxation(rng: np.random.Generator) -> tuple[Any, list[float], float]:
    """A fast state follows the slow branch of a cubic."""
    fast, slow = 10 ** rng.uniform(11, 13), rng.uniform(0.1, 1.0)

    def rates(s: Any, *y: Any) -> list:
        return [fast * (y[1] - y[0] ** 3 - y[0]), -s * slow * y[0]]

    return rates, [rng.uniform(-1, 0), rng.uniform(1, 2)], 1e14 / fast / 10 ** rng.uniform(0, 1)


def ladder(rng: np.random.Generator) -> tuple[Any, list[float], float]:
    """Capacitors that discharge through each other, with time constants of many sizes."""
    conductances, n = np.sort(10 ** rng.uniform(-2, 12, 5))[::-1], 5

    def rates(s: Any, *y: Any) -> list:
        flows = [g * (a - b) for g, a, b in zip(conductances, y, [*y[1:], 0.0], strict=True)]
        return [(flows[k - 1] if k else 0.0) - (s if k == n - 1 else 1.0) * flows[k] for k in range(n)]

    return rates, rng.uniform(0, 1, n).tolist(), 1e14 / conductances[0]


KINDS = (robertson, enzyme, relaxation, ladder)


def make(kind: Any, rng: np.random.Generator) -> tuple[mb.Scene, Any, list[float], float]:
    """A scene with one uncertain factor of a rate, its rates, start and time."""
    rates, start, end = kind(rng)
    p = mb.Parameters(s=1.0)
    names = [f"y{k}" for k in range(len(start))]
    states = mb.States(names, lambda *y: rates(p.s, *y))
    outputs = {state.name: state.value for state in states}
    system = mb.System(states, parameters=p)
    box = mb.Box(s=(0.95, 1.05))
    return mb.Scene(system, dict(zip(names, start, strict=True)), [0.0, end], outputs, box), rates, start, end


def reference(rates: Any, s: float, start: list[float], end: float) -> np.ndarray:
    options = {"method": "Radau", "rtol": 1e-9, "atol": 1e-15}
    return solve_ivp(lambda t, y: rates(s, *y), (0.0, end), start, **options).y[:, -1]


def error(scene: mb.Scene, rates: Any, start: list[float], end: float) -> float:
    """The error of bounds at the end, relative to the largest start."""
    bounds = mb.propagate(scene, mb.Vertex())
    known = np.array([reference(rates, s, start, end) for s in (0.95, 1.05)])
    apart = [bounds.lower[-1] - known.min(axis=0), bounds.upper[-1] - known.max(axis=0)]
    return float(np.abs(apart).max() / np.abs(start).max())


def main() -> None:
    warnings.simplefilter("ignore")
    count, seed = (int(a) for a in (sys.argv[1:] + ["20", "0"][len(sys.argv) - 1 :]))
    rng, bad = np.random.default_rng(seed), 0
    for number in range(count):
        kind, begin = KINDS[number % len(KINDS)], time.process_time()
        try:
            text = f"{(off := error(*make(kind, rng))):.0e}"
        except mb.SymmbError as fault:
            off, text = np.inf, str(fault).replace("\n", " ")[:200]
        bad += not off <= MOST
        print(f"{number:3} {kind.__name__:10} {time.process_time() - begin:5.1f} s, error {text}", flush=True)
    print(f"{count - bad} of {count} scenes are right")


if __name__ == "__main__":
    main()
