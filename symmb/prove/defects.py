"""Bounds of the defects of the motion and of its frame over a step: on grids of nodes, or by Taylor models."""

import math
from functools import partial

import numpy as np

from symmb._magnitudes import SMALL
from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove import points
from symmb.prove.basis import MOST_TERMS_BEYOND, basis_of, richer
from symmb.prove.degrees import degrees_of_equations, highest
from symmb.prove.ellipses import THINNEST, Control, Tried, node_counts, nodes_of_defect
from symmb.prove.errors import ProofError, not_smooth
from symmb.prove.patches import largest_on
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.several_parameters import equations_at_nodes, inputs_on_step, on_step, run
from symmb.prove.taylor_models import OPERATIONS, constant, reach
from symmb.prove.terms import Matrix, at_nodes, matrix_at_nodes
from symmb.prove.time_step import TimeStep

_ALIASED_SHARE = 0.2
"""Fraction of the bound of a defect that may be due to aliasing."""
_MOST_TERMS_OF_TAPE = 1e6
"""Largest number of terms of a defect, times the instructions of the rates. With more, its values take seconds."""
_TOO_ROUGH = "polynomials of this order are not accurate enough; a short pulse on a body at rest may be the cause"


def exact_defects(step: TimeStep) -> tuple[Array, Array] | None:
    """Bounds (3, n) of |C d| and (n, n) of |C (A B - B')| as in `prove`, if the rates are polynomials; otherwise None.

    The defects are then polynomials of known degree. Interpolation in degree + 1 nodes is exact. The result is also
    None if the grid is too large, or for more than two parameters.
    """
    n = step.problem.n
    if step.problem.weights:
        return None
    rates, slopes = degrees_of_equations(step)
    of_C = highest(step.C.reshape(n * n, *step.C.shape[2:]))
    of_defect = np.maximum(rates, highest(step.x.rate))
    together, alone = _grid(of_defect + of_C, n), _grid(of_defect, n)
    of_B = np.array(step.B.c.shape[1:]) - 1.0
    of_frame = _grid(np.maximum(slopes + of_B, highest(step.moved)) + of_C, n * n)
    if alone is None or of_frame is None:
        return None
    if together is None:
        return above(_sampled_defect(step, alone, False) @ step.C_largest.T), _sampled_frame(step, of_frame)
    return _sampled_defect(step, together), _sampled_frame(step, of_frame)


def _grid(degrees: Array, numbers: int) -> tuple[int, ...] | None:
    """Nodes for the exact interpolation of `numbers` polynomials of given degrees; None if values exceed 16 MB."""
    # a larger grid would also exceed the number of terms for which `above` covers rounding
    if not numbers * np.prod(degrees + 1.0) <= 2e6:
        return None
    return tuple(int(degree) + 1 for degree in degrees)


def _is_large(counts: tuple[int, ...], step: TimeStep) -> bool:
    """Whether the values at a grid take too long for a step: seconds, and 2 GB with intermediate results.

    A step with 1e9 values of the frame took a minute (six bodies in space between short springs).
    """
    nodes = math.prod(counts)
    return nodes > 3e5 or nodes * step.problem.n**2 > 5e7


def largest_defects(step: TimeStep, rho: list[float], rates: Array, slopes: Array) -> tuple[Array, Array]:
    """Bounds of C d (n,) and of C (A B - B') (n, n) on ellipses, if rates are at most `rates` and A at most `slopes`.

    Bounds on ellipses are much larger than the defects on the box. They only limit the aliasing.
    """
    n = step.problem.n
    C_on, B_on, rate_on = (largest_on(rho, c.reshape(-1, *c.shape[c.ndim - len(rho) :])).reshape(n, -1)
                           for c in (step.C, step.B.c, step.moved))  # fmt: skip
    of_frame = slopes @ (B_on + step.B.error_on(rho).reshape(n, -1)) + rate_on
    return above(C_on @ (rates + largest_on(rho, step.x.rate))), above(C_on @ of_frame)


def _comparable(w: Array) -> Array:
    """Remainders (n,), raised to 1 % of the largest one. Steps mix remainders, so smaller values are of no use."""
    return np.maximum(w, 1e-2 * w.max())


def _ratio_in_frame(step: TimeStep, most: Array, w: Array) -> float:
    """Allowed ratio of the aliasing to its bound `most` (n, m). Aliasing then has a small effect on w (m,)."""
    own = _comparable(w[-len(most) :])
    return SMALL * float((own / (step.h * (most @ np.concatenate([w[: -len(most)], own])))).min())


def defect_of_motion(step: TimeStep, rho: list[float], most: Array, w: Array, control: Control) -> Array:
    """Bounds (3, n) of |C d| as in `prove`, with d = u' - f(u), which is at most `most` (n,) on the ellipses rho.

    The aliasing is limited to a small fraction of the remainder w (n,). ProofError if no grid is fine enough.
    """
    small = SMALL * w / step.h
    # this aliasing, a small part of the rates, is accepted if finer grids are too large
    harmless = _comparable(np.maximum(small, 1e-10 * (step.C_largest @ ch.sums(step.x.rate, len(rho)))))
    wanted = np.maximum(_ALIASED_SHARE * control.wanted, small)
    counts = node_counts(rho, 0.3 * float((wanted / most).min()))
    if _is_large(counts, step):
        counts = node_counts(rho, 0.3 * float((harmless / most).min()))
    if _is_large(counts, step):
        raise ProofError(_TOO_ROUGH)
    sampled, alias = _sampled_defect(step, counts), above(ch.aliasing(rho, counts) * most)
    for _ in range(2):  # finer grids, until the aliasing is small
        wanted = np.maximum(_ALIASED_SHARE * sampled[2], small)
        finer = node_counts(rho, 0.3 * float((wanted / most).min()))
        finer = tuple(max(a, b) for a, b in zip(finer, counts, strict=True))
        if (alias <= wanted).all() or finer == counts or _is_large(finer, step):
            break
        counts = finer
        sampled, alias = _sampled_defect(step, counts), above(ch.aliasing(rho, counts) * most)
    # a proof with much more aliasing than wanted is valid, but a shorter step has a far smaller remainder
    if (alias > 30.0 * np.maximum(wanted, harmless)).any():
        raise ProofError(_TOO_ROUGH)
    control.wanted = float(sampled[2].max())
    return above(sampled + alias)


def _sampled_defect(step: TimeStep, counts: tuple[int, ...], in_frame: bool = True) -> Array:
    """Bounds (3, n) of the interpolation of C d at nodes, or three times of the interpolation of d."""
    k = len(counts)
    found = step.problem.rate_tape.run(points.OPERATIONS, points.point, step.at_nodes(counts))[0]
    f, f_errors = _stack(found, counts)
    rate, rate_errors = ch.values(step.x.rate, counts)
    d = rate - f
    d_errors = above(rate_errors + f_errors + U * ch.largest(d, k))
    if not in_frame:
        return np.stack([ch.bound_of_samples(d, d_errors, k)] * 3)
    values = _in_frame(step, d, d_errors, counts)
    return np.stack([ch.bound_of_samples(*values, k), *ch.integrals_of_samples(*values, k)])


def _in_frame(step: TimeStep, d: Array, d_errors: Array, counts: tuple[int, ...]) -> tuple[Array, Array]:
    """Values of C d, and their errors, for values d (n, *counts) or (n, n, *counts) at nodes, with errors."""
    k = len(counts)
    C, C_errors = ch.values(step.C, counts)
    d_most, C_most, column = ch.largest(d, k), ch.largest(C, k), "k" * (d_errors.ndim - 1)
    g = np.einsum(f"ij...,j{column}...->i{column}...", C, d)
    errors = (C_most + C_errors) @ d_errors + C_errors @ d_most + of_sum(len(C) + 2) * (C_most @ d_most)
    return g, above(errors)


def defect_of_frame(step: TimeStep, rho: list[float], most: Array, w: Array) -> Array:
    """Bounds (n, n) of |C (A B - B')|, which is at most `most` (n, n) on the ellipses rho."""
    counts = node_counts(rho, _ratio_in_frame(step, most, w))
    if _is_large(counts, step):
        raise ProofError("the growth of small deviations from the computed motion differs too much over the box")
    return above(_sampled_frame(step, counts) + ch.aliasing(rho, counts) * most)


def _sampled_frame(step: TimeStep, counts: tuple[int, ...]) -> Array:
    """Bounds (n, n) of the interpolation of C (A B - B') at nodes of time and parameters."""
    n, k = step.problem.n, len(counts)
    found = step.problem.jacobian_tape.run(points.OPERATIONS, points.point, step.at_nodes(counts))[1]
    A, A_errors = (a.reshape(n, n, *a.shape[1:]).swapaxes(0, 1) for a in _stack(found, counts))
    B, B_errors = (a.reshape(n, n, *a.shape[1:]) for a in ch.values(step.B.c, counts))
    B_errors = above(B_errors + step.B.error.reshape(n, n))
    rate, rate_errors = (a.reshape(n, n, *a.shape[1:]) for a in ch.values(step.moved, counts))
    A_most, B_most = (ch.largest(a, k) for a in (A, B))
    d = np.einsum("ij...,jk...->ik...", A, B) - rate
    d_errors = above(A_most @ B_errors + A_errors @ (B_most + B_errors) + of_sum(n + 2) * (A_most @ B_most)
                     + rate_errors + U * ch.largest(d, k))  # fmt: skip
    return ch.bound_of_samples(*_in_frame(step, d, d_errors, counts), k)


def _stack(found: list[points.Point], counts: tuple[int, ...]) -> tuple[Array, Array]:
    """Values (m, *counts) and errors (m,)."""
    return np.stack([np.broadcast_to(a[0], counts) for a in found]), np.array([a[1] for a in found])


def _tried(step: TimeStep, of_time: float, wanted: float) -> Tried:
    """The ellipse of time with the parameter `of_time`, for real parameters of the box."""
    n, rho = step.problem.n, [of_time, 1.0]
    rates, slopes = (np.array([reach(a) for a in found])
                     for found in on_step(step, step.problem.jacobian_tape, rho=of_time))  # fmt: skip
    return Tried(rho, rates, slopes.reshape(n, n).T, nodes_of_defect(step, rho, rates, slopes, wanted))


def _adapted(step: TimeStep, control: Control) -> Tried:
    """The ellipse of the last step, a smaller one, or a neighbour with fewer nodes. ProofError if no ellipse works."""
    best = _tried(step, control.rho, control.wanted)
    while not np.isfinite(best.nodes) and best.rho[0] > THINNEST:
        best = _tried(step, 1.0 + 0.5 * (best.rho[0] - 1.0), control.wanted)
    if not np.isfinite(best.nodes):
        inputs = inputs_on_step(step, 0.0, best.rho[0])
        number = partial(constant, inputs[2][0].basis)
        lost = step.problem.jacobian_tape.first(OPERATIONS, number, inputs, lambda a: not np.isfinite(reach(a)))
        raise not_smooth(lost)
    # a slightly wider and a slightly thinner ellipse are compared in turn: one comparison a step follows slow changes
    control.turn += 1
    other = _tried(step, 1.0 + (1.2 if control.turn % 2 else 1.0 / 1.2) * (best.rho[0] - 1.0), control.wanted)
    best = min(best, other, key=lambda found: found.nodes)
    control.rho = best.rho[0]
    return best


def defects_of_models(step: TimeStep, w: Array, control: Control) -> tuple[Array, Array, list[float]]:
    """Bounds (3, n) of |C d| and (n, m) of |C (A B - B')| as in `prove`, and the ellipses of the equations.

    This function needs at least two parameters. The aliasing is limited to a small fraction of the remainder w (m,).
    ProofError if the equations may not be analytic.
    """
    chosen = _adapted(step, control)
    rho = chosen.rho
    most, most_of_frame = largest_defects(step, rho, chosen.rates, chosen.slopes)
    # aliasing may be a tenth of the last defect, because the present defect is not known yet
    n = step.problem.n
    wanted = np.maximum(0.1 * control.wanted, SMALL * w[-n:] / step.h)
    (count,) = node_counts(rho, float((wanted / most).min()))
    own = _modelled_defect(step, count)
    defect = above(own + ch.aliasing(rho[:1], [count]) * most)
    control.wanted = float(own[2].max())
    after = np.concatenate([w[:-n], w[-n:] + step.h * defect[2]])
    (count,) = node_counts(rho, _ratio_in_frame(step, most_of_frame, after))
    return defect, above(_modelled_frame(step, count) + ch.aliasing(rho[:1], [count]) * most_of_frame), rho


def _modelled_defect(step: TimeStep, count: int) -> Array:
    """Bounds (3, n) of the interpolation of C d in time."""
    problem, n, source = step.problem, step.problem.n, step.problem.basis(step.x.c.shape[2])
    basis = richer(source, min(MOST_TERMS_BEYOND, _MOST_TERMS_OF_TAPE / problem.rates.n_instructions()))
    (f,) = run(problem.rate_tape, equations_at_nodes(step, count, basis))
    rate = at_nodes(step.x.rate, np.zeros(n), count, source, basis)
    C = matrix_at_nodes(step.C, np.zeros(n * n), n, count, problem.basis(step.C.shape[-1]), basis)
    return C.times(Matrix.of(rate, n).minus(Matrix.of(f, n))).bounds()[:, :, 0]


def _modelled_frame(step: TimeStep, count: int) -> Array:
    """Bounds (n, m) of the interpolation of C (A B - B') in time."""
    problem, n, source = step.problem, step.problem.n, step.problem.basis(step.B.c.shape[2])
    # Taylor models of the defect of a frame have one degree more than the frame
    basis = basis_of(source.weights, source.degree + 1)
    entries = run(problem.jacobian_tape, equations_at_nodes(step, count, basis))[1]
    A = Matrix.of([a for i in range(n) for a in entries[i::n]], n)  # column-major
    parts = (step.B.c, step.B.error), (step.C, np.zeros(n * n)), (step.moved, np.zeros(step.B.error.shape))
    B, C, rate = (matrix_at_nodes(c, error, n, count, source, basis) for c, error in parts)
    return C.times(A.times(B).minus(rate)).bounds()[0]
