"""Ranges of many polynomials at once: time, share left unproved, and dense sampling.

Seconds are the processor's on one core, compiled and warm. Sampling evaluates every polynomial at 10,000 points, by one
matrix product; "finds" is the share of the widths that it sees.
"""

# ruff: noqa: E402, I001  (pinned before NumPy starts its threads)
import time

from _timing import median, pin

pin()
import numpy as np
from models import double_pendulum

import symmb as mb
from symmb._types import Array
from symmb.run.codegen.build import has_compiler
from symmb.bound.nodes.fit import Fit
from symmb.bound.polynomials.legendre import MultiIndices, basis_values, tensor_degree, total_degree

TOLERANCE = 1e-3
SAMPLES = 10_000


def pendulum(order: int, share: float, times: int = 1001) -> tuple[MultiIndices, Array]:
    """Expansions of the paper's double pendulum with lengths uncertain by a share, 12 outputs."""
    scene = double_pendulum.scene().with_times(np.linspace(0.0, 10.0, times))
    simulator, box = mb.DAESimulator(scene), mb.Box.around(scene.system.parameters, share)
    fit = Fit.of(mb.ClenshawCurtis(), mb.TensorDegree(), 2, order)
    Y = simulator.run(box.from_unit(fit.nodes)).Y.reshape(len(fit.nodes), -1)
    return fit.alpha, fit.coefficients(fit.functionals @ Y, np.ones(len(Y), dtype=bool))


def random(alpha: MultiIndices, m: int, decay: float) -> tuple[MultiIndices, Array]:
    """Normal coefficients that fall with the degree."""
    rng = np.random.default_rng(0)
    return alpha, rng.normal(size=(len(alpha), m)) * decay ** alpha.sum(axis=1)[:, None]


def row(name: str, alpha: MultiIndices, coefficients: Array) -> None:
    """One line of the table."""
    m, exact = coefficients.shape[1], mb.Exact(TOLERANCE)
    found = exact.search(alpha, coefficients)
    seconds = median(lambda: exact.search(alpha, coefficients))
    few = np.ascontiguousarray(coefficients[:, :: max(1, m // 200)])
    points = np.random.default_rng(1).uniform(-1, 1, (SAMPLES, alpha.shape[1]))
    begin = time.process_time()
    Y = basis_values(alpha, points) @ few
    low, high = Y.min(axis=0), Y.max(axis=0)
    sampling = (time.process_time() - begin) * m / few.shape[1]
    lower, upper = exact.bounds(alpha, few)
    wide = upper - lower > 1e-9 * np.abs(few[0])
    share = np.mean(((high - low) / (upper - lower))[wide])
    unproved = np.mean(found.gap > 0)
    print(
        f"{name:34s}{m:8d}{1e3 * seconds:12.1f}{1e6 * seconds / m:10.2f}{100 * unproved:10.1f}"
        f"{1e3 * sampling:14.0f}{share:10.3f}", flush=True,
    )  # fmt: skip


if __name__ == "__main__":
    begin = time.perf_counter()
    mb.Exact().bounds(tensor_degree(1, 1), np.ones((2, 1)))
    print(f"compiler: {has_compiler()}; built or found in {time.perf_counter() - begin:.2f} s; tolerance {TOLERANCE:g}")
    print(f"{'':34s}{'m':>8s}{'all, ms':>12s}{'each, us':>10s}{'open, %':>10s}{'sampling, ms':>14s}{'finds':>10s}")
    for order in (4, 8, 16):
        for share in (0.05, 0.2):
            row(f"pendulum +-{share:.0%}, d = 2, p = {order}", *pendulum(order, share))
    row("pendulum +-5%, d = 2, p = 4", *pendulum(4, 0.05, 5339))
    for decay in (0.3, 0.6):
        row(f"random {decay}, d = 2, p = 4", *random(tensor_degree(2, 4), 12_012, decay))
        row(f"random {decay}, d = 1, p = 32", *random(tensor_degree(1, 32), 12_012, decay))
        row(f"random {decay}, d = 3, p = 4", *random(tensor_degree(3, 4), 2_000, decay))
        row(f"random {decay}, d = 6, total degree 3", *random(total_degree(6, 3), 1_000, decay))
        row(f"random {decay}, d = 10, total degree 2", *random(total_degree(10, 2), 500, decay))
        row(f"random {decay}, d = 10, total degree 3", *random(total_degree(10, 3), 50, decay))
