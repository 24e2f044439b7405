"""Means, standard deviations, Cpk, rejects and Sobol indices of responses that polynomials follow poorly.

    PYTHONPATH=. python tests/benchmarks/poor_statistics.py [SEED] [CASES]

Responses have bumps, kinks, steep walls, jumps, waves, or act in a corner only. In every second case, the study may
make 60 runs only. A figure is silently wrong if it differs by more than 2 % of the width (indices and rejects: by more
than 0.02) beyond its printed error and three standard errors of the samples, and neither the bounds nor the answer has
a remark. True figures are those of half a million samples of the function itself.
"""

import contextlib
import itertools
import sys
import warnings
from collections.abc import Callable, Iterator

import numpy as np
from scipy.stats import qmc, truncnorm

import symmb as mb

MISS, SAMPLES = 0.02, 2**19
Case = tuple[str, int, Callable[[np.ndarray], np.ndarray]]


def cases(seed: int) -> Iterator[Case]:
    """Kind, number of parameters, and function of unit points (N, d)."""
    rng = np.random.default_rng(seed)
    for k in itertools.count():
        d, kind = 2 + k // 6 % 4, ("bump", "kink", "wall", "jump", "wave", "corner")[k % 6]
        at, u = rng.uniform(-0.7, 0.7, d), rng.normal(size=d)
        u, slope, r = u / np.linalg.norm(u), rng.uniform(-0.3, 0.3, d), rng.uniform(0.0, 1.0)
        yield (
            kind,
            d,
            {
                "bump": lambda X, at=at, s=slope, r=r: np.exp(-np.square(X - at).sum(-1) / (0.1 + 0.3 * r)) + X @ s,
                "kink": lambda X, at=at, u=u, s=slope: np.abs((X - 0.5 * at) @ u) + X @ s,
                "wall": lambda X, at=at, u=u, r=r: np.tanh((5 + 25 * r) * ((X - 0.5 * at) @ u)) + 0.2 * X[:, 0],
                "jump": lambda X, at=at, u=u, s=slope: ((X - 0.5 * at) @ u > 0) + X @ s,
                "wave": lambda X, u=u, s=slope, r=r: np.sin((6 + 10 * r) * (X @ u)) + X @ s,
                "corner": lambda X, u=u, r=r: np.maximum(0.0, X @ np.sign(u) - (0.2 + 0.5 * r) * len(u)),
            }[kind],
        )


def shares(f: Callable[[np.ndarray], np.ndarray], d: int) -> tuple[np.ndarray, np.ndarray]:
    """First-order and total indices of independent uniform parameters."""
    both = 2 * qmc.Sobol(2 * d, seed=1).random(SAMPLES // 2) - 1
    A, B = both[:, :d], both[:, d:]
    ya, yb = f(A), f(B)
    mixed = [f(np.where(np.arange(d) == i, B, A)) for i in range(d)]
    variance = np.concatenate([ya, yb]).var()
    first = np.array([np.mean((yb - yb.mean()) * (ym - ya)) for ym in mixed])
    return first / variance, np.array([np.mean((ya - ym) ** 2) / 2 for ym in mixed]) / variance


def wrong_figures(case: Case, limited: bool) -> tuple[list[str], list[str], int, bool]:
    """Silent errors and errors beside a remark in words, the number of figures, and whether there was a remark."""
    kind, d, f = case
    names = [f"p{i}" for i in range(d)]
    simulator = mb.FunctionSimulator(
        lambda **p: [[float(f(np.array([[p[n] for n in names]]))[0])]], dict.fromkeys(names, 0.05), [0.0], ["y"]
    )
    box = mb.Box(**dict.fromkeys(names, (-1.0, 1.0)))
    bounds = mb.propagate(simulator, mb.PolynomialChaos(budget=60) if limited else mb.PolynomialChaos(), box)
    normal = truncnorm(-3, 3, scale=1 / 3)
    y = f(normal.ppf(qmc.Sobol(d, seed=2).random(SAMPLES)))
    grid = f(2 * qmc.Sobol(d, seed=3).random(SAMPLES) - 1)
    width, limit = np.ptp(grid), float(np.quantile(y, 0.97))
    wrong, warned, number = list[str](), list[str](), 0
    told = bool(bounds.warnings or bounds.remarks)

    def compare(name: str, figure: object, true: object, error: object, miss: float, remarks: tuple[str, ...]) -> None:
        nonlocal number, told
        off = np.abs(np.asarray(figure, dtype=float) - np.asarray(true)) - np.asarray(error, dtype=float)
        number, told = number + off.size, told or bool(remarks)
        if (off > miss).any():
            is_silent = not (bounds.warnings or remarks)
            (wrong if is_silent else warned).append(
                f"{kind} {d}{' 60 runs' if limited else ''}: {name} {figure} for {true}, told {error}"
            )

    with contextlib.suppress(mb.PropagationError):  # too few runs, which is told
        found = bounds.statistical({"y": (None, limit)})
        n = 1024 if found.runs > 100 else 1e9
        compare("mean", found.mean[0], y.mean(), 3 * y.std() / n**0.5, MISS * width, found.remarks)
        compare("sigma", found.sigma[0], y.std(), 3 * y.std() / n**0.5, MISS * width, found.remarks)
        compare("rejects", found.rejects[0], (y > limit).mean(), found.error[0], MISS, found.remarks)
    with contextlib.suppress(mb.PropagationError):
        c = bounds.contributions()
        first, total = shares(f, d)
        compare("first", c.first[0, 0], first, c.share_estimate[0, 0], MISS, c.remarks)
        compare("total", c.total[0, 0], total, c.share_estimate[0, 0], MISS, c.remarks)
    with contextlib.suppress(mb.PropagationError):
        drawn = bounds.samples(4000, dict.fromkeys(names, normal)).values[:, 0, 0]
        compare("mean of samples", drawn.mean(), y.mean(), 4 * y.std() / 4000**0.5, MISS * width, ())
        compare("sigma of samples", drawn.std(), y.std(), 4 * y.std() / 4000**0.5, MISS * width, ())
    with contextlib.suppress(mb.PropagationError):
        found = bounds.quantiles("y", [0.05, 0.5, 0.95], dict.fromkeys(names, normal))
        truth = np.quantile(y, [0.05, 0.5, 0.95])
        compare("quantiles", found.lower[:, 0], truth, found.estimate[:, 0], MISS * width, found.remarks)
    return wrong, warned, number, told


if __name__ == "__main__":
    seed, number = (int(x) for x in [*sys.argv[1:], 1, 40][:2])
    warnings.simplefilter("ignore")
    silent, beside, figures, told = 0, 0, 0, 0
    for k, case in enumerate(itertools.islice(cases(seed), number)):
        wrong, warned, more, is_told = wrong_figures(case, (k + k // 6) % 2 == 1)
        silent, beside = silent + len(wrong), beside + len(warned)
        figures, told = figures + more, told + is_told
        for text in wrong:
            print(" ", text, flush=True)
    print(
        f"{number} studies, {figures} figures: {silent} silent errors, {beside} with a remark; {told} studies have one"
    )
