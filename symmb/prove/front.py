"""The states at one time, a polynomial of the parameters and a remainder in a frame, and what is done with them."""

from dataclasses import dataclass, replace

import numpy as np

from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove.curves import TimeStep
from symmb.prove.errors import ProofError
from symmb.prove.flow import Curve, fit
from symmb.prove.rounding import U, above, of_sum

_WORST_CONDITION = 30.0
"""Condition of the frame, with columns of length 1, from which on it is made orthogonal."""

_LEAST_MOTION = 1e-3
"""Least motion of a state that counts, over that of the one that moves most."""
_TAIL = 2
"""Orders that tell how fast coefficients decay."""


@dataclass(frozen=True)
class Front:
    """States x(xi) + B(xi) w with |w| <= w, up to errors x_error of x and B_error of B.

    Attributes
    ----------
    t : time [s]
    x : (n, N + 1, ...) coefficients
    B : (n, n, NB + 1, ...) coefficients of the frame
    w : (n,)
    x_error : (n,)
    B_error : (n, n)
    """

    t: float
    x: Array
    B: Array
    w: Array
    x_error: Array
    B_error: Array

    def share(self) -> float:
        """Largest remainder of a state over how far it moves with the parameters.

        A state that hardly moves beside others counts with a small part of their motion.
        """
        d = self.x.ndim - 1
        e = (ch.sums(self.B, d) + self.B_error) @ self.w + self.x_error
        moved = ch.sums(self.x, d) - np.abs(self.x[(slice(None), *(0,) * d)])
        return float((e / np.maximum(moved, _LEAST_MOTION * moved.max(initial=1e-300))).max(initial=0.0))


def slowest(x: Array) -> int:
    """Number of the parameter in which the coefficients (n, N + 1, ...) decay the least."""
    tails = [np.abs(x.take(np.arange(max(1, m - _TAIL), m), axis=axis)).sum() for axis, m in enumerate(x.shape[1:], 1)]
    return int(np.argmax(tails))


def leaving(step: TimeStep, w: Array) -> Front:
    """The front at the end of a step with |w| there."""
    n, d = step.problem.n, step.problem.d
    x, x_error = _end(step.x, d)
    B, B_error = _end(step.B, d)
    return Front(step.t0 + step.h, x, B.reshape(n, n, *B.shape[1:]), w, x_error, B_error.reshape(n, n))


def _end(curve: Curve, d: int) -> tuple[Array, Array]:
    """Polynomials of d parameters at the end of a step, where T_k = 1, and their errors."""
    rest = curve.c[:, 1:]
    value = curve.c[:, 0] + rest.sum(axis=1)
    return value, above(curve.error + of_sum(len(rest[0]) + 2) * ch.sums(rest, d + 1) + U * ch.sums(value, d))


def well_conditioned(front: Front, scales: Array, worst: float = _WORST_CONDITION) -> Front:
    """The front in an orthogonal frame where its own has the condition `worst` or more.

    The columns of the frame at nodes of the parameters, the longest first, are made orthogonal. The new frame is a
    polynomial through these, or the frame of the scales where that polynomial is far from them. |C B| w bounds the new
    w, with C about the inverse of the new frame.

    Source: Lohner (1988), thesis, Karlsruhe, section 3.3; Makino and Berz, International Journal of Differential
    Equations and Applications 10 (2005), section 4.
    """
    n, lengths = len(front.B), front.B.shape[2:]
    counts = [m + 1 for m in lengths]
    at = ch.along([ch.values_at_nodes(m, k) for m, k in zip(counts, lengths, strict=True)], front.B)
    at = np.moveaxis(at, (0, 1), (-2, -1)) / scales[:, None]
    columns = np.linalg.norm(at, axis=-2, keepdims=True)
    if float(np.linalg.cond(at / np.where(columns > 0, columns, 1.0)).max()) < worst:
        return front
    order = np.argsort(-columns.reshape(-1, n).mean(axis=0) * front.w)
    Q, R = np.linalg.qr(at[..., order])
    Q = Q * np.where(np.diagonal(R, axis1=-2, axis2=-1) < 0, -1.0, 1.0)[..., None, :]
    B = fit(np.moveaxis(scales[:, None] * Q, (-2, -1), (0, 1)), lengths)
    C = fit(np.moveaxis(np.swapaxes(Q, -1, -2) / scales, (-2, -1), (0, 1)), lengths)
    B, C = ch.graded(B, len(lengths)), ch.graded(C, len(lengths))
    try:
        return _in_frame(front, B, C)
    except ProofError:
        zero = (slice(None), slice(None), *(0,) * len(lengths))
        B, C = np.zeros_like(B), np.zeros_like(C)
        B[zero], C[zero] = np.diag(scales), np.diag(1.0 / scales)
        return _in_frame(front, B, C)


def _in_frame(front: Front, B: Array, C: Array) -> Front:
    """The front in another frame (n, n, ...), where C is about the inverse of that."""
    n, none = len(B), np.zeros(B.shape[:2])
    E = ch.product_bound(C, B, none, np.eye(n))
    eta = above(float(E.sum(axis=1).max()))
    if not eta < 0.5:
        raise ProofError("the deviations from the polynomials grow too differently over the box")
    w = above(ch.product_bound(C, front.B, none, none) @ front.w)
    w = above(w + ch.sums(C, C.ndim - 2) @ above(front.x_error + front.B_error @ front.w))
    w = above(w + E @ np.full(n, w.max() / (1.0 - eta)))
    return replace(front, B=B, w=w, x_error=np.zeros(n), B_error=none)


def half(front: Front, variable: int, side: int) -> Front:
    """The front over the half of the box where a variable is negative (side -1) or positive (1)."""
    x, x_lost = restricted(front.x, 1, variable, side)
    B, B_lost = restricted(front.B, 2, variable, side)
    return replace(front, x=x, B=B, x_error=above(front.x_error + x_lost), B_error=above(front.B_error + B_lost))


def restricted(c: Array, leading: int, variable: int, side: int) -> tuple[Array, Array]:
    """Coefficients in half of the range of a variable, and bounds of the errors of the polynomials.

    The coefficients of T_k((z + side) / 2) are interpolated. Its values err by k^2 times the rounding of the argument.
    """
    axis = leading + variable
    n = c.shape[axis]
    k = np.arange(n)
    z = 0.5 * (ch.nodes(n) + side)
    matrix = ch.coefficients_from_nodes(n) @ np.cos(np.outer(np.arccos(z), k))
    entries = above(k * k * (ch.ENTRY + 8 * U) + 16 * U * (k + 1) + 2 * ch.ENTRY + 2 * of_sum(n + 2))
    weights = (2.0 * n * entries).reshape([-1 if i == axis else 1 for i in range(c.ndim)])
    lost = above((np.abs(c) * weights).sum(axis=tuple(range(leading, c.ndim))))
    return np.moveaxis(np.tensordot(matrix, c, (1, axis)), 0, axis), lost
