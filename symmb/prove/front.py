"""Fronts: the states at one time, as a polynomial of the parameters and a remainder in a frame."""

from dataclasses import dataclass, replace

import numpy as np

from symmb._magnitudes import SMALL
from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove.errors import ProofError
from symmb.prove.flow import Curve, fit
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.time_step import TimeStep, solution_bound


@dataclass(frozen=True)
class Front:
    """States x(xi) + B(xi) w for all w up to a bound, with the errors x_error of x and B_error of B.

    Attributes
    ----------
    t : time [s]
    x : (n, N + 1, ...) coefficients
    B : (n, n, NB + 1, ...) coefficients of the frame
    w : (n,) bounds of |w|
    x_error : (n,)
    B_error : (n, n)
    """

    t: float
    x: Array
    B: Array
    w: Array
    x_error: Array
    B_error: Array

    @property
    def middle(self) -> Array:
        """States (n,) in the middle of the box, as the constant terms of the polynomials."""
        return self.x.reshape(len(self.x), -1)[:, 0]

    @property
    def reach(self) -> Array:
        """Bounds (n,) of the distance of the states from the polynomials."""
        return above((ch.sums(self.B, self.x.ndim - 1) + self.B_error) @ self.w + self.x_error)

    def share(self) -> float:
        """Largest ratio of the remainder of a state to its motion with the parameters.

        If the motion of a state is less than a small part of the largest motion, this part is used instead.
        """
        moved = ch.sums(self.x, self.x.ndim - 1) - np.abs(self.middle)
        return float((self.reach / np.maximum(moved, SMALL * moved.max(initial=1e-300))).max(initial=0.0))


def slowest(x: Array) -> int:
    """Index of the parameter with the slowest decay of the coefficients (n, N + 1, ...)."""
    # the two highest orders measure the decay
    tails = [np.abs(x.take(np.arange(max(1, m - 2), m), axis=axis)).sum() for axis, m in enumerate(x.shape[1:], 1)]
    return int(np.argmax(tails))


def leaving(step: TimeStep, w: Array) -> Front:
    """The front at the end of a step, with the bounds w (n,) there."""
    n, d = step.problem.n, step.problem.d
    x, x_error = _end(step.x, d)
    B, B_error = _end(step.B, d)
    return Front(step.t0 + step.h, x, B.reshape(n, n, *B.shape[1:]), w, x_error, B_error.reshape(n, n))


def _end(curve: Curve, d: int) -> tuple[Array, Array]:
    """Polynomials of d parameters at the end of a step, and their errors. All T_k of time are 1 there."""
    rest = curve.c[:, 1:]
    value = curve.c[:, 0] + rest.sum(axis=1)
    return value, above(curve.error + of_sum(len(rest[0]) + 2) * ch.sums(rest, d + 1) + U * ch.sums(value, d))


def well_conditioned(front: Front, scales: Array, worst: float = 30.0) -> Front:
    """The front, in an orthogonal frame if the condition number of its frame with unit columns is `worst` or more.

    The columns of the frame at nodes of the parameters are made orthogonal, with the longest column first. The new
    frame is the polynomial through these columns. If this polynomial is not accurate enough, the new frame is the
    diagonal frame of the scales. |C B| w bounds the new w. C is approximately the inverse of the new frame.

    Source: Lohner (1988), thesis, Karlsruhe, section 3.3; Makino and Berz, International Journal of Differential
    Equations and Applications 10 (2005), section 4.
    """
    n, lengths = len(front.B), front.B.shape[2:]
    counts = [m + 1 for m in lengths]
    at = np.moveaxis(ch.at_nodes(front.B, counts), (0, 1), (-2, -1)) / scales[:, None]
    columns = np.linalg.norm(at, axis=-2, keepdims=True)
    if float(np.linalg.cond(at / np.where(columns > 0, columns, 1.0)).max()) < worst:
        return front
    # Lohner: the first column keeps its direction, so the box about a long thin remainder hardly grows
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
    """The front in another frame B (n, n, ...). C is approximately the inverse of B."""
    none = np.zeros(B.shape[:2])
    bound = solution_bound(C, B, none)
    w = above(ch.product_bound(C, front.B, none, none) @ front.w)
    w = above(w + ch.sums(C, C.ndim - 2) @ above(front.x_error + front.B_error @ front.w))
    return replace(front, B=B, w=bound(w), x_error=np.zeros(len(B)), B_error=none)


def half(front: Front, variable: int, side: int) -> Front:
    """The front over the half of the box in which a variable is negative (side -1) or positive (side 1)."""
    x, x_lost = restricted(front.x, 1, variable, side)
    B, B_lost = restricted(front.B, 2, variable, side)
    return replace(front, x=x, B=B, x_error=above(front.x_error + x_lost), B_error=above(front.B_error + B_lost))


def restricted(c: Array, leading: int, variable: int, side: int) -> tuple[Array, Array]:
    """Coefficients over half of the range of a variable, and bounds of the errors of the polynomials.

    T_k((z + side) / 2) is interpolated. Its values have the error k^2 times the rounding error of the argument.
    """
    axis = leading + variable
    n = c.shape[axis]
    k = np.arange(n)
    z = 0.5 * (ch.nodes(n) + side)
    matrix = ch.coefficients_from_nodes(n) @ np.cos(np.outer(np.arccos(z), k))
    entries = above(k * k * (ch.ENTRY_ERROR + 8 * U) + 16 * U * (k + 1) + 2 * ch.ENTRY_ERROR + 2 * of_sum(n + 2))
    weights = (2.0 * n * entries).reshape([-1 if i == axis else 1 for i in range(c.ndim)])
    lost = above((np.abs(c) * weights).sum(axis=tuple(range(leading, c.ndim))))
    return np.moveaxis(np.tensordot(matrix, c, (1, axis)), 0, axis), lost
