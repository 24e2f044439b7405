"""Bounds of the defects of the motion and of its frame over a step."""

import math

import numpy as np

from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove import points
from symmb.prove.curves import TimeStep
from symmb.prove.degrees import degrees_of_equations, highest
from symmb.prove.ellipses import Control, node_counts
from symmb.prove.errors import ProofError
from symmb.prove.patches import largest_on
from symmb.prove.rounding import U, above, of_sum

_MOST_NODES_OF_GRID, _MOST_FRAME_VALUES = 3e5, 5e7
"""Most nodes of a grid, and most values of a frame at all nodes: they take seconds and 2 GB with intermediate results.
A step with 1e9 values took a minute (six bodies in space between short springs)."""
_ALIASED_SHARE = 0.2
"""Fraction of the bound of a defect that may be due to aliasing."""
ALIASED_GROWTH = 1e-3
"""Relative growth of the remainder in a step that may be due to aliasing."""
LEAST_REMAINDER = 1e-2
"""Remainders below this fraction of the largest one count as this fraction."""
_MUCH_ALIASING = 30.0
"""Ratio of the aliasing to its aim above which a step is too long."""

_MOST_EXACT_NUMBERS, _MOST_EXACT_NODES = 2e6, 8e6
"""Most numbers in an array of values for an exact interpolation (16 MB), and most nodes: the bounds of rounding errors
hold for sums of this many terms."""


def exact_defects(step: TimeStep) -> tuple[Array, Array] | None:
    """Bounds of |C d| (n,) and of |C (A B - B')| (n, n) if the rates are polynomials; else None.

    The defects are then polynomials of known degree, so that interpolation in degree + 1 nodes is exact. The result is
    also None if the grid is too large.
    """
    n = step.problem.n
    rates, slopes = degrees_of_equations(step)
    of_C = highest(step.C.reshape(n * n, *step.C.shape[2:]))
    of_defect = np.maximum(rates, highest(step.x.rate))
    together, alone = _grid(of_defect + of_C, n), _grid(of_defect, n)
    of_B = np.array(step.B.c.shape[1:]) - 1.0
    of_frame = _grid(np.maximum(slopes + of_B, highest(step.B.rate)) + of_C, n * n)
    if alone is None or of_frame is None:
        return None
    if together is None:
        return above(step.C_largest @ _sampled_defect(step, alone, in_frame=False)), _sampled_frame(step, of_frame)
    return _sampled_defect(step, together), _sampled_frame(step, of_frame)


def _grid(degrees: Array, numbers: int) -> tuple[int, ...] | None:
    """Nodes for the exact interpolation of `numbers` polynomials of given degrees; None if there are too many nodes."""
    nodes = np.prod(degrees + 1.0)
    if not (nodes <= _MOST_EXACT_NODES and numbers * nodes <= _MOST_EXACT_NUMBERS):
        return None
    return tuple(int(degree) + 1 for degree in degrees)


def _is_large(counts: tuple[int, ...], step: TimeStep) -> bool:
    """Whether the values at a grid of these nodes take too long for a step."""
    nodes = math.prod(counts)
    return nodes > _MOST_NODES_OF_GRID or nodes * step.problem.n**2 > _MOST_FRAME_VALUES


def defect_of_motion(
    step: TimeStep, rho: list[float], C_on: Array, most_rate: Array, w: Array, control: Control
) -> Array:
    """Bounds (n,) of |C d| with d = u' - f(u). ProofError if no grid is fine enough.

    On the ellipses rho, C is at most C_on (n, n), and f(u) at most most_rate (n,). Aliasing may be a small fraction of
    the remainder w (n,).
    """
    k = len(rho)
    most = above(C_on @ (most_rate + largest_on(rho, step.x.rate)))
    small = ALIASED_GROWTH * w / step.h
    # aliasing of this part of the rates is negligible if finer grids are too large
    harmless = np.maximum(small, 1e-10 * (step.C_largest @ ch.sums(step.x.rate, k)))
    harmless = np.maximum(harmless, LEAST_REMAINDER * harmless.max())
    wanted = np.maximum(_ALIASED_SHARE * control.wanted, small)
    counts = node_counts(rho, 0.3 * float((wanted / most).min()))
    if _is_large(counts, step):
        counts = node_counts(rho, 0.3 * float((harmless / most).min()))
    if _is_large(counts, step):
        raise ProofError("polynomials of this order follow the motion too badly, as where a short pulse begins at rest")
    sampled, alias = _sampled_defect(step, counts), above(ch.aliasing(rho, counts) * most)
    for _ in range(2):  # finer grids, until the aliasing is small
        wanted = np.maximum(_ALIASED_SHARE * sampled, small)
        finer = node_counts(rho, 0.3 * float((wanted / most).min()))
        finer = tuple(max(a, b) for a, b in zip(finer, counts, strict=True))
        if (alias <= wanted).all() or finer == counts or _is_large(finer, step):
            break
        counts = finer
        sampled, alias = _sampled_defect(step, counts), above(ch.aliasing(rho, counts) * most)
    if (alias > _MUCH_ALIASING * np.maximum(wanted, harmless)).any():
        raise ProofError("polynomials of this order follow the motion too badly, as where a short pulse begins at rest")
    control.wanted = float(sampled.max())
    return above(sampled + alias)


def _sampled_defect(step: TimeStep, counts: tuple[int, ...], in_frame: bool = True) -> Array:
    """Bounds (n,) of the interpolation of C d, or of d, at nodes."""
    n, k = step.problem.n, len(counts)
    found = step.problem.rate_tape.run(points.OPERATIONS, points.point, step.at_nodes(counts))[0]
    f, f_errors = _stack(found, counts)
    rate, rate_errors = ch.values(step.x.rate, counts)
    d = rate - f
    d_errors = above(rate_errors + f_errors + U * ch.largest(d, k))
    if not in_frame:
        return ch.bound_of_samples(d, d_errors, k)
    C, C_errors = ch.values(step.C, counts)
    d_most, C_most = ch.largest(d, k), ch.largest(C, k)
    g = np.einsum("ij...,j...->i...", C, d)
    errors = above((C_most + C_errors) @ d_errors + C_errors @ d_most + of_sum(n + 2) * (C_most @ d_most))
    return ch.bound_of_samples(g, errors, k)


def defect_of_frame(step: TimeStep, rho: list[float], C_on: Array, most_slope: Array, w: Array) -> Array:
    """Bounds (n, n) of |C (A B - B')|. A is at most most_slope (n, n) on the ellipses."""
    n = step.problem.n
    B_on, rate_on = (largest_on(rho, c).reshape(n, n) for c in (step.B.c, step.B.rate))
    most = above(C_on @ (most_slope @ (B_on + step.B.error_on(rho).reshape(n, n)) + rate_on))
    w = np.maximum(w, LEAST_REMAINDER * w.max())
    ratio = ALIASED_GROWTH * float((w / (step.h * (most @ w))).min())
    counts = node_counts(rho, ratio)
    if _is_large(counts, step):
        raise ProofError("the deviations from the polynomials grow too differently over the box")
    return above(_sampled_frame(step, counts) + ch.aliasing(rho, counts) * most)


def _sampled_frame(step: TimeStep, counts: tuple[int, ...]) -> Array:
    """Bounds (n, n) of the interpolation of C (A B - B') at nodes of time and parameters."""
    n, k = step.problem.n, len(counts)
    found = step.problem.jacobian_tape.run(points.OPERATIONS, points.point, step.at_nodes(counts))[1]
    A, A_errors = (a.reshape(n, n, *a.shape[1:]).swapaxes(0, 1) for a in _stack(found, counts))
    C, C_errors = ch.values(step.C, counts)
    B, B_errors = (a.reshape(n, n, *a.shape[1:]) for a in ch.values(step.B.c, counts))
    B_errors = above(B_errors + step.B.error.reshape(n, n))
    rate, rate_errors = (a.reshape(n, n, *a.shape[1:]) for a in ch.values(step.B.rate, counts))
    A_most, B_most, C_most = (ch.largest(a, k) for a in (A, B, C))
    d = np.einsum("ij...,jk...->ik...", A, B) - rate
    d_most = ch.largest(d, k)
    d_errors = above(A_most @ B_errors + A_errors @ (B_most + B_errors) + of_sum(n + 2) * (A_most @ B_most)
                     + rate_errors + U * d_most)  # fmt: skip
    g = np.einsum("ij...,jk...->ik...", C, d)
    errors = above((C_most + C_errors) @ d_errors + C_errors @ d_most + of_sum(n + 2) * (C_most @ d_most))
    return ch.bound_of_samples(g, errors, k)


def _stack(found: list[points.Point], counts: tuple[int, ...]) -> tuple[Array, Array]:
    """Values (m, *counts) and errors (m,)."""
    return np.stack([np.broadcast_to(a[0], counts) for a in found]), np.array([a[1] for a in found])
