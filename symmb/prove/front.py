"""Fronts: the states at one time, as a polynomial of the parameters and a remainder in a frame."""

from dataclasses import dataclass, replace

import numpy as np

from symmb._magnitudes import SMALL
from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove.errors import ProofError
from symmb.prove.flow import Curve
from symmb.prove.problem import Problem
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.terms import exponents, grid, product_bound, restricted
from symmb.prove.time_step import TimeStep, solution_bound


@dataclass(frozen=True)
class Front:
    """States x(xi) + B(xi) w for all w up to a bound, with the errors x_error of x and B_error of B.

    The last n columns of B are the frame of new errors. The others are generators of earlier errors. Their w are
    constant in a step, so that these errors are transported with the motion and are not wrapped.

    Attributes
    ----------
    t : time [s]
    x : (n, N + 1, ...) coefficients
    B : (n, m, NB + 1, ...) coefficients of the generators and the frame
    w : (m,) bounds of |w|
    x_error : (n,)
    B_error : (n, m)
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


def roughest(problem: Problem, x: Array) -> int:
    """Index of the parameter whose halving reduces the highest orders of x (n, N + 1, ...) most."""
    own, sizes = exponents(problem, x.shape[1:]), np.abs(x).reshape(len(x), -1)
    orders = own.max(axis=1) if not problem.weights else own @ np.array(problem.weights)
    # the two highest orders measure the decay
    is_high = orders >= max(1, orders.max() - 1)
    sizes = (sizes / problem.scales[:, None]).sum(axis=0)[is_high]
    return int(np.argmin((sizes[:, None] * 0.5 ** own[is_high]).sum(axis=0)))


def leaving(step: TimeStep, w: Array) -> Front:
    """The front at the end of a step, with the bounds w (m,) there."""
    n, d = step.problem.n, step.problem.axes
    x, x_error = _end(step.x, d)
    B, B_error = _end(step.B, d)
    return Front(step.t0 + step.h, x, B.reshape(n, -1, *B.shape[1:]), w, x_error, B_error.reshape(n, -1))


def _end(curve: Curve, d: int) -> tuple[Array, Array]:
    """Polynomials of d parameters at the end of a step, and their errors. All T_k of time are 1 there."""
    rest = curve.c[:, 1:]
    value = curve.c[:, 0] + rest.sum(axis=1)
    return value, above(curve.error + of_sum(len(rest[0]) + 2) * ch.sums(rest, d + 1) + U * ch.sums(value, d))


def well_conditioned(problem: Problem, front: Front, worst: float = 30.0) -> Front:
    """The front, in an orthogonal frame if the condition number of its frame with unit columns is `worst` or more.

    The columns of the frame at nodes of the parameters are made orthogonal, with the longest column first. The new
    frame is the polynomial through these columns. If this polynomial is not accurate enough, the new frame is the
    diagonal frame of the scales. |C B| w bounds the new w. C is approximately the inverse of the new frame.

    Source: Lohner (1988), thesis, Karlsruhe, section 3.3; Makino and Berz, International Journal of Differential
    Equations and Applications 10 (2005), section 4.
    """
    if problem.weights:
        return _with_generators(problem, front, min(worst, 3.0))
    n, lengths, scales = len(front.B), front.B.shape[2:], problem.scales
    nodes = grid(problem, lengths, 1)
    at = np.moveaxis(nodes.at(front.B), (0, 1), (-2, -1)) / scales[:, None]
    columns = np.linalg.norm(at, axis=-2, keepdims=True)
    if float(np.linalg.cond(at / np.where(columns > 0, columns, 1.0)).max()) < worst:
        return front
    # Lohner: the first column keeps its direction, so the box about a long thin remainder hardly grows
    order = np.argsort(-columns.reshape(-1, n).mean(axis=0) * front.w)
    Q, R = np.linalg.qr(at[..., order])
    Q = Q * np.where(np.diagonal(R, axis1=-2, axis2=-1) < 0, -1.0, 1.0)[..., None, :]
    B = nodes.fit(np.moveaxis(scales[:, None] * Q, (-2, -1), (0, 1)))
    C = nodes.fit(np.moveaxis(np.swapaxes(Q, -1, -2) / scales, (-2, -1), (0, 1)))
    try:
        return in_frame(problem, front, B, C)
    except ProofError:
        zero = (slice(None), slice(None), *(0,) * len(lengths))
        B, C = np.zeros_like(B), np.zeros_like(C)
        B[zero], C[zero] = np.diag(scales), np.diag(1.0 / scales)
        return in_frame(problem, front, B, C)


_MOST_GENERATORS = 6
"""Largest number of generators of earlier errors, relative to the number of states."""


def _with_generators(problem: Problem, front: Front, worst: float) -> Front:
    """The front with a new frame, if the condition number of the old one is `worst` or more.

    The columns of the old frame become generators. If there are too many, the smallest ones are bounded in the new
    frame (order reduction). The frame is constant over the box.

    Source: Girard (2005), Reachability of uncertain linear systems using zonotopes, HSCC; Kuehn, Computing 61 (1998).
    """
    n, scales = len(front.B), problem.scales
    at = front.B[..., 0] / scales[:, None]
    columns = np.linalg.norm(at[:, -n:], axis=0)
    if np.linalg.cond(at[:, -n:] / np.where(columns > 0, columns, 1.0)) < worst:
        return front
    sizes = (ch.sums(front.B, 1) / scales[:, None]).max(axis=0) * front.w
    order = np.argsort(-sizes)
    kept, others = np.sort(order[: _MOST_GENERATORS * n]), order[_MOST_GENERATORS * n :]
    Q = np.eye(n)
    if len(others) >= n:
        Q = np.linalg.qr(at[:, order[-len(others) :]] * front.w[others])[0]
    B = np.zeros((n, len(kept) + n, front.B.shape[2]))
    B[:, : len(kept)] = front.B[:, kept]
    B[:, len(kept) :, 0] = scales[:, None] * Q
    C = (Q.T / scales)[..., None]
    none = np.zeros((n, n))
    new = solution_bound(problem, C, B[:, len(kept) :, :1], none)
    w = above(np.abs(C[..., 0]) @ above(front.x_error + front.B_error @ front.w))
    if len(others):
        part = product_bound(problem, C, front.B[:, others], np.zeros((n, len(others))), np.zeros((n, len(others))))
        w = above(w + part @ front.w[others])
    return replace(
        front, B=B, w=np.concatenate([front.w[kept], new(w)]), x_error=np.zeros(n), B_error=np.zeros(B.shape[:2])
    )


def in_frame(problem: Problem, front: Front, B: Array, C: Array) -> Front:
    """The front in another frame B (n, n, ...). C is approximately the inverse of B."""
    none = np.zeros(B.shape[:2])
    bound = solution_bound(problem, C, B, none)
    w = above(product_bound(problem, C, front.B, np.zeros(front.B.shape[:2]), np.zeros(front.B.shape[:2])) @ front.w)
    w = above(w + ch.sums(C, C.ndim - 2) @ above(front.x_error + front.B_error @ front.w))
    return replace(front, B=B, w=bound(w), x_error=np.zeros(len(B)), B_error=none)


def half(problem: Problem, front: Front, variable: int, side: int) -> Front:
    """The front over the half of the box in which a variable is negative (side -1) or positive (side 1)."""
    x, x_lost = restricted(problem, front.x, 1, variable, side)
    B, B_lost = restricted(problem, front.B, 2, variable, side)
    return replace(front, x=x, B=B, x_error=above(front.x_error + x_lost), B_error=above(front.B_error + B_lost))
