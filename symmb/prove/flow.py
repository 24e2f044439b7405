"""The approximate motion over a step, and its frame, as polynomials. `step` proves bounds of their errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._magnitudes import LAST_DIGITS, ROUNDING
from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove.errors import ProofError
from symmb.prove.patches import largest_on
from symmb.prove.points import PLAIN, plain
from symmb.prove.problem import Problem
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.terms import grid

_MOST_PICARD_ITERATIONS = 60
"""Largest number of Picard iterations. Each one at least halves the error, or the step is too long."""
_STATES_IN_CACHE = 2**14
"""Number of states that are evaluated at once. They stay in the processor's cache."""


@dataclass(frozen=True)
class Curve:
    """Polynomials (m, K + 1, N + 1, ...) of time and parameters.

    The exact polynomials are the start + h / 2 times the integral of `rate` from s = -1. `c` has their computed
    coefficients. The error of the polynomials is at most `error` (m,) if all variables are in [-1, 1]. `rounded` bounds
    the errors of the coefficients and has the shape of c; None if the coefficients are exact.
    """

    c: Array
    error: Array
    rate: Array
    rounded: Array | None = None

    def error_on(self, rho: Sequence[float]) -> Array:
        """Bounds (m,) of the errors of the polynomials on a polyellipse.

        The error is a polynomial. Its coefficients are the errors of the coefficients in `c`. On the ellipses
        |T_k| <= cosh(k log rho). With rho = 1 the bounds are `error`.
        """
        return np.zeros(len(self.c)) if self.rounded is None else largest_on(rho, self.rounded)


def integrated(begin: Array, rate: Array, h: float) -> Curve:
    """The curve over a step h [s] from begin (m, N + 1, ...) with the rate (m, K, N + 1, ...)."""
    matrix = ch.integral(rate.shape[1])
    others = [None] * (rate.ndim - 2)
    c = 0.5 * h * ch.along([matrix, *others], rate)
    c[:, 0] += begin
    d = rate.ndim - 1
    terms = 0.5 * h * ch.along([np.abs(matrix), *others], np.abs(rate))
    # Entries of the first row are differences, 1 / (k^2 - 1). Their relative errors are up to (k / 2 + 2) U.
    rounded = above(of_sum(2 * len(matrix) + 4) * terms + 2 * U * np.abs(c))
    return Curve(c, ch.sums(rounded, d), rate, rounded)


def motion(problem: Problem, x0: Array, t0: float, h: float, terms: int, A: Array | None = None) -> Curve:
    """The motion from x0 (n, N + 1, ...) at t0 over a step h. Its rate has `terms` terms in time.

    Picard iteration computes the motion at all Chebyshev nodes of time and of the parameters at once. If a Jacobian A
    (n, n) is given, the iteration is Newton's with this Jacobian.
    """
    # with two more nodes than terms, the aliasing of removed terms is small
    at = grid(problem, x0.shape[1:], 2)
    begin = at.at(x0)
    s = ch.nodes(terms)
    p = at.parameters(1)
    t = (t0 + 0.5 * h * (1.0 + s)).reshape(-1, *(1,) * len(at.shape))
    step = _integration(terms, h)
    newton = None if A is None else np.linalg.inv(np.eye(len(A) * terms) - np.kron(A, step))
    x = np.repeat(begin[:, None], terms, axis=1)
    others = tuple(range(1, x.ndim))
    size = np.maximum(problem.scales, np.abs(x).max(axis=others))
    last, most = np.inf, None
    for _ in range(_MOST_PICARD_ITERATIONS):
        f = rates_at(problem, x, p, t)
        new = begin[:, None] + ch.along([step, *[None] * len(at.shape)], f)
        if newton is not None:
            new = x + (newton @ (new - x).reshape(len(newton), -1)).reshape(x.shape)
        difference, moved = np.abs(new - x).max(axis=others), np.maximum(size, np.abs(new).max(axis=others))
        change = float((difference / size).max(initial=0.0))
        # the first iteration may grow much, because its states are constant in time;
        # a state that grows more after the first iteration diverges: the step is too long
        x, most = new, 1e3 * moved if most is None else most
        if not np.isfinite(change):
            raise ProofError("the computed motion is not a number, or changes too fast, even in the shortest step")
        if (moved > most).any():
            raise ProofError("the motion changes too fast for the shortest step")
        if change <= 2.0 * LAST_DIGITS or (change > 0.5 * last and (difference < ROUNDING * moved).all()):
            break
        last = change
    else:
        raise ProofError("the motion changes too fast for the shortest step")
    f = ch.along([ch.coefficients_from_nodes(terms), *at.fits], rates_at(problem, x, p, t))
    return integrated(x0, _without_noise(f, 4e-16), h)


def _integration(terms: int, h: float) -> Array:
    """(terms, terms) matrix from values at nodes of a step h [s] to the integrals from its start to the nodes."""
    return 0.5 * h * (ch.values_at_nodes(terms, terms + 1) @ ch.integral(terms) @ ch.coefficients_from_nodes(terms))


def rates_at(problem: Problem, x: Array, p: list[Array | float], t: Array) -> Array:
    """f (n, terms, ...) at states (n, terms, ...). If there are many states, the times are evaluated in parts."""
    if x[0].size > _STATES_IN_CACHE and x.shape[1] > 1:
        k = x.shape[1] // 2
        return np.concatenate([rates_at(problem, x[:, :k], p, t[:k]), rates_at(problem, x[:, k:], p, t[k:])], axis=1)
    found = problem.rate_tape.run(PLAIN, plain, [list(x), p, [t]])[0]
    return np.stack([np.broadcast_to(value, x.shape[1:]) for value in found])


def frame(problem: Problem, x: Array, B0: Array, t0: float, h: float, terms: int = 11) -> tuple[Curve, Array]:
    """The frame B from B0 (n, m, NB + 1, ...) with B' = A B, row by row, and C (n, n, terms, ...).

    C is approximately the inverse of the last n columns of B.

    The frame has fewer terms in time than the motion, because its defect increases the remainder only by a small part.
    The motion has the coefficients x (n, K + 1, N + 1, ...).
    """
    n, lengths = problem.n, B0.shape[2:]
    at = grid(problem, lengths, 1)
    p = at.parameters(1)
    s = ch.nodes(terms)
    t = (t0 + 0.5 * h * (1.0 + s)).reshape(-1, *(1,) * len(at.shape))
    states = ch.along([ch.values_at_nodes(terms, x.shape[1]), *at.values(x.shape[2:])], x)
    found = problem.jacobian_tape.run(PLAIN, plain, [list(states), p, [t]])[1]
    A = np.stack([np.broadcast_to(value, states.shape[1:]) for value in found], axis=-1)
    A = A.reshape(*states.shape[1:], n, n).swapaxes(-1, -2)  # column-major
    generators, begin = np.split(np.moveaxis(at.at(B0), (0, 1), (-2, -1)), [-n], axis=-1)
    step = _integration(terms, h)
    B = np.repeat(begin[None], terms, axis=0)
    last = np.inf
    for _ in range(_MOST_PICARD_ITERATIONS):
        new = begin + np.tensordot(step, A @ B, (1, 0))
        change = float(np.abs(new - B).max() / np.abs(new).max())
        B = new
        if not np.isfinite(change) or change > 1e3:
            raise ProofError("small deviations from the computed motion grow too fast, even in the shortest step")
        # a frame need not be as accurate as the motion
        if change < 1e-10 or (change < ROUNDING and change > 0.5 * last):
            break
        last = change
    fits = [ch.coefficients_from_nodes(terms), *at.fits]
    try:
        inverse = np.moveaxis(np.asarray(np.linalg.inv(B), dtype=float), (-2, -1), (0, 1))
        B = np.concatenate([B @ np.linalg.solve(begin, generators), B], axis=-1)
    except np.linalg.LinAlgError:
        raise ProofError("in one step, some deviations from the computed motion grow much faster than others") from None
    rate = ch.along(fits, np.moveaxis(A @ B, (-2, -1), (0, 1)))
    rate = _without_noise(rate.reshape(-1, terms, *lengths), 1e-11)
    C = _without_noise(ch.along(fits, inverse).reshape(n * n, terms, *lengths), 1e-11)
    return integrated(B0.reshape(-1, *lengths), rate, h), C.reshape(n, n, *rate.shape[1:])


def _without_noise(c: Array, share: float) -> Array:
    """Polynomials (m, n0, ...). Coefficients below `share` times the largest one are rounding errors, and become 0.

    These coefficients would grow on ellipses, and bounds there would be too large. Their removal needs no proof: the
    polynomials are approximate anyway, and their defects are bounded afterwards.
    """
    return np.where(np.abs(c) < share * np.abs(c).max(axis=tuple(range(1, c.ndim)), keepdims=True), 0.0, c)
