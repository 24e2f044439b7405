"""Sums over groups of parameters of functions of one direction each: their ranges are the sums of known ranges."""

from collections.abc import Callable, Iterator

import numpy as np
from _engineering import Case

from symmb._types import Array

LAWS: dict[str, Callable[[Array, float, float], Array]] = {
    "linear": lambda s, k, c: s,
    "square": lambda s, k, c: (s - c) ** 2,
    "cubic": lambda s, k, c: (k * s) ** 3 - k * s * c,
    "exp": lambda s, k, c: np.exp(0.6 * k * s),
    "sine": lambda s, k, c: np.sin(k * s + c),
    "arctan": lambda s, k, c: np.arctan(k * (s - c)),
    "tanh": lambda s, k, c: np.tanh(2 * k * (s - c)),
    "gauss": lambda s, k, c: np.exp(-((k * (s - c)) ** 2)),
    "hill": lambda s, k, c: 1 / (1 + (k * (s - c)) ** 2),
    "resonance": lambda s, k, c: 1 / np.hypot(1 - (1 + 0.2 * k * s) ** 2, 0.15 + 0.1 * c**2),
    "kink": lambda s, k, c: np.abs(s - c),
}
"""Functions of the place along a direction, with a steepness k of 0.5 to 3 and a middle c of -0.6 to 0.6."""
GRID = np.linspace(-1.0, 1.0, 4001)[:, None]
"""Places along a direction, over its half width, at which the range of a law is looked for."""


def directions(
    seed: int, number: int = 12, d: tuple[int, int] = (4, 8), times: tuple[int, ...] = (101,), smooth: bool = False
) -> Iterator[Case]:
    """Cases of some numbers of parameters, from and to, and of times. Smooth ones have no kinks."""
    names = [name for name in LAWS if name != "kink" or not smooth]
    for k in range(number):
        yield _case(np.random.default_rng([seed, k]), names, d, times)


def _case(rng: np.random.Generator, laws: list[str], sizes: tuple[int, int], times: tuple[int, ...]) -> Case:
    d, n_t = int(rng.integers(sizes[0], sizes[1] + 1)), int(rng.choice(times))
    t, parts, told = np.linspace(0.0, 1.0, n_t), [], []
    lower, upper = np.zeros((2, n_t))
    cuts = np.sort(rng.choice(np.arange(1, d), min(int(rng.integers(0, 3)), d - 1), replace=False)) if d > 1 else []
    for group in np.split(rng.permutation(d), cuts):
        kind, k, c = str(rng.choice(laws)), rng.uniform(0.5, 3.0), rng.uniform(-0.6, 0.6)
        turns = rng.uniform(0.0, 8.0, len(group)) * (rng.random() < 0.7)
        weights = rng.uniform(-1.0, 1.0, len(group))[:, None] * np.cos(
            turns[:, None] * t + rng.uniform(-1, 1, (len(group), 1))
        )
        weights *= (
            1 / np.abs(weights[:, :1]).sum()
            if rng.random() < 0.5
            else 1.2 / np.linalg.norm(weights[:, 0]) / len(group) ** 0.5
        )
        size = rng.uniform(0.2, 1.0) * np.cos(rng.uniform(0.0, 3.0) * t)
        values = size * LAWS[kind](GRID * np.abs(weights).sum(axis=0), k, c)
        lower, upper = lower + values.min(axis=0), upper + values.max(axis=0)
        parts.append((group, weights, size, LAWS[kind], k, c))
        told.append(f"{kind} of {len(group)}")

    def f(t: Array, **p: Array) -> Array:
        x = np.array(list(p.values()))
        return np.sum([size * law(x[group] @ weights, k, c) for group, weights, size, law, k, c in parts], axis=0)

    box = {f"x{i}": (-1.0, 1.0) for i in range(d)}
    return Case(f"{' + '.join(told)}, {d} parameters, {n_t} times", f, box, t, lower, upper)
