"""A time step: the polynomials of the motion and of its frame, and their values with error bounds."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove import discs, points
from symmb.prove.errors import ProofError
from symmb.prove.flow import Curve
from symmb.prove.patches import Patches
from symmb.prove.problem import Problem
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.tape import Tape
from symmb.prove.terms import parameters_at, product_bound, tensor_nodes


@dataclass(frozen=True, eq=False)
class TimeStep:
    """A step of length h from t0.

    Attributes
    ----------
    x : n polynomials of the motion
    B : n m polynomials of the generators and the frame, row by row
    C : (n, n, ...) coefficients of the approximate inverse of the frame
    decay : (n,) rates of decay of w that a constant frame has, at most 0 [1/s]; None if the frame moves with the motion
    """

    problem: Problem
    t0: float
    h: float
    x: Curve
    B: Curve
    C: Array
    decay: Array | None = None

    @property
    def degrees(self) -> list[int]:
        """Highest degrees of the motion in time and in the parameters."""
        return [m - 1 for m in self.x.c.shape[1:]]

    @cached_property
    def B_largest(self) -> Array:
        """Bounds (n, m) of the generators and the frame."""
        n, most = self.problem.n, above(ch.sums(self.B.c, self.B.c.ndim - 1) + self.B.error)
        return most.reshape(n, len(most) // max(n, 1))

    @cached_property
    def C_largest(self) -> Array:
        """Bounds (n, n) of C."""
        return ch.sums(self.C, self.C.ndim - 2)

    @cached_property
    def moved(self) -> Array:
        """Coefficients (n m, K, ...) of B' + B L, with the diagonal matrix L of the rates of decay."""
        if self.decay is None:
            return self.B.rate
        return self.B.c * np.tile(self.decay, self.problem.n)[(slice(None), *(None,) * (self.B.c.ndim - 1))]

    def with_remainder(self, w: Array) -> "tuple[TimeStep, Array]":
        """The step with the box around all B w as its remainder, for |w| <= w (m,). It takes much less memory."""
        n, e = self.problem.n, above(self.B_largest @ w)
        unit = np.eye(n).reshape(n * n, *(1,) * (self.B.c.ndim - 1))
        return replace(
            self, B=Curve(unit, np.zeros(n * n), np.zeros_like(unit)), C=unit.reshape(n, n, *unit.shape[1:])
        ), e

    def after(self, w: Array, rate: Array) -> Array:
        """Bounds (n,) of |w| at the end, from bounds w (n,) at the begin and of |w' - L w| (n,) during the step."""
        if self.decay is None:
            return above(w + self.h * rate)
        turn = -self.decay * self.h
        # (1 - exp(-z)) / z is at most 1 and at most 1 / z
        mean = np.where(turn > 1e-3, np.minimum(1.0, -np.expm1(-turn) / np.maximum(turn, 1e-3) * (1 + 1e-12)), 1.0)
        return above(np.exp(-turn) * (1 + 1e-12) * w + self.h * mean * rate)

    def at(self, times: Array, curve: Curve) -> tuple[Array, Array]:
        """A curve at times (n_t,) as polynomials of the parameters (m, n_t, N + 1, ...), and their errors (m, n_t).

        An error e of the time changes T_k by at most k^2 e. Constant terms are added last, so that they have the
        rounding error of only one sum.
        """
        c = curve.c
        k = np.arange(1, c.shape[1])
        s = np.clip(2.0 * (times - self.t0) / self.h - 1.0, -1.0, 1.0)
        matrix = np.cos(np.outer(np.arccos(s), k))
        entries = k * k * (6.0 * U * (1.0 + (np.abs(times).max() + abs(self.t0)) / self.h)) + 16.0 * U * (k + 1)
        moved, d = np.abs(c[:, 1:]).sum(axis=tuple(range(2, c.ndim))), c.ndim - 2
        motion = c[:, :1] + ch.along([matrix, *[None] * d], c[:, 1:])
        error = above(moved @ (above(entries) + of_sum(len(k) + 2)) + curve.error + U * ch.sums(motion, d).max(axis=1))
        return motion, np.broadcast_to(error[:, None], motion.shape[:2])

    def reach_at(self, times: Array, w: Array) -> Array:
        """Bounds (n, n_t) of |B w| at times (n_t,) for |w| <= w (m,)."""
        found, B, m = np.zeros((self.problem.n, len(times))), self.B, len(w)
        for i in range(len(found)):
            own = slice(i * m, (i + 1) * m)
            c, errors = self.at(times, Curve(B.c[own], B.error[own], B.rate[own]))
            found[i] = w @ above(ch.sums(c, self.problem.axes) + errors)
        return above(found)

    @cached_property
    def room(self) -> Array:
        """Changes of the states (n,) that change the rates by about 100 %; at least the scales of the states."""
        problem, n = self.problem, self.problem.n
        x = self.x.c[(slice(None), *(0,) * (self.x.c.ndim - 1))]
        p = [float(middle) for middle in problem.middle]
        inputs = [list(x), p, [self.t0 + 0.5 * self.h]]
        rates, slopes = problem.jacobian_tape.run(points.PLAIN, points.plain, inputs)
        A = np.abs(np.array(slopes, dtype=float).reshape(n, n).T)
        with np.errstate(all="ignore"):
            room = 1.0 / (A / np.abs(np.array(rates, dtype=float))[:, None]).max(axis=0, initial=0.0)
        return np.maximum(problem.scales, np.where(np.isfinite(room), room, 0.0))

    def discs_of(
        self, tape: Tape, counts: tuple[int, int], radius: Array | None = None, rho: list[float] | None = None
    ) -> list[list[discs.Disc]]:
        """Discs of the outputs of a tape on patches, for all states within `radius` (n,) of the motion."""
        return tape.run(discs.OPERATIONS, discs.disc, self.on_patches(counts, radius, rho))

    def on_patches(
        self, counts: tuple[int, int], radius: Array | None = None, rho: list[float] | None = None
    ) -> list[list[discs.Disc]]:
        """Discs of the states, parameters and time on patches of the box, or of the polyellipse rho.

        There are counts[0] patches of time, and counts[1] of each parameter. Discs of the states are larger by `radius`
        (n,).

        The discs contain the exact motion. It differs from the computed polynomials by a polynomial that is small on
        [-1, 1] and grows with the ellipses. Errors of parameters are constants.
        """
        degrees = self.degrees
        patches = Patches(rho or [1.0] * len(degrees), [counts[0], *[counts[1]] * (len(degrees) - 1)], degrees)
        problem, rounded = self.problem, self.x.error_on(patches.rho)
        more = rounded if radius is None else rounded + radius
        x = [replace(own, radius=above(own.radius + m)) for own, m in zip(patches.discs(self.x.c), more, strict=True)]
        errors = np.broadcast_to(problem.errors, problem.middle.shape)
        p = [
            discs.disc(float(m)) if j < 0 else patches.linear(m, r, 1 + j, error)
            for m, r, j, error in zip(problem.middle, problem.radius, problem.variables, errors, strict=True)
        ]
        return [x, p, [patches.linear(self.t0 + 0.5 * self.h, 0.5 * self.h, 0)]]

    def at_nodes(self, counts: tuple[int, ...]) -> list[list[points.Point]]:
        """States, parameters and time at nodes, with error bounds."""
        x, errors = ch.values(self.x.c, counts)
        errors = above(errors + self.x.error)
        states = [points.point(values, float(error)) for values, error in zip(x, errors, strict=True)]
        t = (self.t0 + 0.5 * self.h * (1.0 + ch.nodes(counts[0]))).reshape(-1, *(1,) * (len(counts) - 1))
        time = points.point(t, 4.0 * U * (abs(self.t0) + self.h) + self.h * ch.ENTRY_ERROR)
        return [states, parameter_points(self.problem, counts[1:], 1), [time]]

    def inverse_times(self, y: Array) -> Array:
        """Bounds (n,) of |B^-1 z| for all |z| <= y (n,)."""
        return self.solved(above(self.C_largest @ y))

    @cached_property
    def solved(self) -> Callable[..., Array]:
        """`solution_bound` of the frame."""
        n = self.problem.n
        B, error = self.B.c.reshape(n, -1, *self.B.c.shape[1:]), self.B.error.reshape(n, -1)
        return solution_bound(self.problem, self.C, B[:, -n:], error[:, -n:])


def solution_bound(problem: Problem, C: Array, B: Array, B_error: Array) -> Callable[..., Array]:
    """Bounds (n,) of |B^-1 y| for all y with |C y| <= v, as a function of v (n,).

    If a mean of C y over time is at most `mean` (n,), the bounds are those of the same mean of B^-1 y. B^-1 is the
    Neumann series (sum of (I - C B)^k) C. ProofError if a row of |I - C B| may have a sum of 1/2 or more.
    """
    n = len(C)
    E = product_bound(problem, C, B, B_error, np.eye(n))
    eta = above(float(E.sum(axis=1).max()))
    if not eta < 0.5:
        raise ProofError("the growth of small deviations from the computed motion differs too much over the box")
    return lambda v, mean=None: above((v if mean is None else mean) + E @ np.full(n, v.max() / (1.0 - eta)))


def parameter_points(problem: Problem, counts: tuple[int, ...], leading: int) -> list[points.Point]:
    """Parameters at nodes, with error bounds. Arrays have `leading` axes before the axes of the parameters."""
    values = parameters_at(problem, tensor_nodes(counts, leading))
    errors = 4.0 * U * (np.abs(problem.middle) + problem.radius) + problem.radius * ch.ENTRY_ERROR + problem.errors
    return [
        points.point(value, float(error) if isinstance(value, np.ndarray) else 0.0)
        for value, error in zip(values, errors, strict=True)
    ]
