"""The states at one time, a polynomial of the parameters and a remainder in a frame, and what is done with them."""

from dataclasses import dataclass, replace

import numpy as np

from symmb._types import Array
from symmb.enclosures import chebyshev as ch
from symmb.enclosures.curves import Step
from symmb.enclosures.errors import ProofError
from symmb.enclosures.flow import Curve
from symmb.enclosures.rounding import U, above, of_sum

_WORST = 30.0
"""Condition of the frame, with columns of length 1, from which on it is made orthogonal."""

_UNMOVED = 1e-3
"""Least motion of a state that counts, over that of the one that moves most."""
_LAST = 2
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
        return float((e / np.maximum(moved, _UNMOVED * moved.max(initial=1e-300))).max(initial=0.0))

    def slowest(self) -> int:
        """Number of the parameter whose coefficients decay the least."""
        tails = [
            np.abs(self.x.take(np.arange(max(1, m - _LAST), m), axis=axis)).sum()
            for axis, m in enumerate(self.x.shape[1:], 1)
        ]
        return int(np.argmax(tails))


def entering(front: Front, step: Step) -> Array:
    """|w| (n,) at the start of a step whose motion and frame begin with the polynomials of the front."""
    return above(front.w + step.inverse_times(front.x_error + front.B_error @ front.w))


def leaving(step: Step, w: Array) -> Front:
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


def well_conditioned(front: Front, scales: Array) -> Front:
    """The front in the frame B T where its own frame B is badly conditioned in the middle of the box.

    T is about the inverse of R in B = Q R in the middle, the longest columns first, so that w = T w', |w'| <= |R| w.

    Source: Lohner (1988), thesis, Karlsruhe, section 3.3; Makino and Berz, International Journal of Differential
    Equations and Applications 10 (2005), section 4.
    """
    n, lengths = len(front.B), front.B.shape[2:]
    middle = front.B
    for m in lengths:  # T_k(0) = 1, 0, -1, 0, 1, ...
        middle = np.tensordot(middle, np.cos(0.5 * np.pi * np.arange(m)), (2, 0))
    middle = middle / scales[:, None]
    lengths = np.linalg.norm(middle, axis=0)
    if float(np.linalg.cond(middle / lengths)) < _WORST:
        return front
    order = np.argsort(-lengths * front.w)
    R = np.zeros((n, n))
    R[:, order] = np.linalg.qr(middle[:, order])[1]
    T = np.linalg.inv(R)
    off = np.abs(np.eye(n) - R @ T) + of_sum(n + 2) * (np.abs(R) @ np.abs(T))  # T^-1 = (I - (I - R T))^-1 R
    eta = float(above(off).sum(axis=1).max())
    if not eta < 0.5:
        raise ProofError("the frame cannot be made orthogonal")
    w = above(np.abs(R) @ front.w)
    w = above(w + above(off) @ np.full(n, w.max() / (1.0 - eta)))
    B = np.moveaxis(np.tensordot(front.B, T, (1, 0)), -1, 1)
    size = ch.sums(front.B, front.B.ndim - 2)
    error = above((front.B_error + of_sum(n + 2) * size) @ np.abs(T))
    return replace(front, B=B, w=w, B_error=error)


def half(front: Front, variable: int, side: int) -> Front:
    """The front over the half of the box where a variable is negative (side -1) or positive (1)."""
    x, x_lost = _restricted(front.x, 1, variable, side)
    B, B_lost = _restricted(front.B, 2, variable, side)
    return replace(front, x=x, B=B, x_error=above(front.x_error + x_lost), B_error=above(front.B_error + B_lost))


def _restricted(c: Array, leading: int, variable: int, side: int) -> tuple[Array, Array]:
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
