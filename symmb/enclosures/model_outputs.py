"""Bounds of the outputs at times of a step, for several parameters."""

import numpy as np

from symmb._types import Array
from symmb.enclosures.curves import TimeStep
from symmb.enclosures.ranges import ranges
from symmb.enclosures.rounding import U, above, of_sum
from symmb.enclosures.several_parameters import monomials, on_step, parameter_models, run
from symmb.enclosures.taylor_models import Model, basis_of, reach

_MORE = 2
"""Degrees of Taylor models of outputs beyond those of the motion."""
_NUMBERS = 1e5
"""Most coefficients of the polynomial of an output at a time, whose range is sought."""


def model_output_bounds(step: TimeStep, e: Array, times: Array, sharp: float) -> tuple[Array, Array, Array, Array]:
    """Lower and upper bounds of the outputs (n_t, n_y), the remainder in them, and sensitivities (n_y, n).

    States are within e (n,) of the motion.
    """
    problem, n_t = step.problem, len(times)
    n_y = problem.outputs.numel_out(0)
    slopes = np.array([reach(a) for a in on_step(step, problem.sensitivity_tape, e)[1]]).reshape(problem.n, n_y).T
    of_states = above(slopes @ e)
    basis = basis_of(problem.d, step.x.c.shape[2] - 1 + _MORE)
    at, errors = step.at(times)
    c, lost = monomials(at, basis)
    x = [Model(own.T, above(error + gone), basis) for own, error, gone in zip(c, errors, lost, strict=True)]
    t = Model(times[None], np.full(1, U * np.abs(times).max()), basis)
    lower, upper, remainder = np.full((3, n_t, n_y), np.inf)
    for k, found in enumerate(run(problem.output_tape, [x, parameter_models(step, basis), [t]])[0]):
        if np.isfinite(reach(found)) and np.isfinite(of_states[k]):
            low, high, rest = _range(found, of_states[k], n_t, sharp)
            lower[:, k], upper[:, k], remainder[:, k] = -low, high, rest
    return -lower, upper, remainder, slopes


def _range(a: Model, beside: float, n_t: int, sharp: float) -> tuple[Array, Array, Array]:
    """Bounds (n_t,) of an output, and the remainder in them.

    The highest degrees are cut where they are a small share of the width, or too many.
    """
    basis, d = a.basis, a.basis.variables
    c = np.broadcast_to(basis.to_chebyshev @ a.coefficients(), (basis.counts[-1], n_t))
    sums = np.add.reduceat(np.abs(c), [0, *basis.counts[:-1]], axis=0)
    tails = np.cumsum(sums[::-1], axis=0)[::-1]
    degree = basis.degree
    while degree > 1 and ((tails[degree] <= 0.1 * sharp * tails[1]).all() or (degree + 1.0) ** d > _NUMBERS):
        degree -= 1
    kept = basis.counts[degree]
    gone = tails[degree + 1] if degree < basis.degree else np.zeros(n_t)
    whole = np.zeros((n_t, *(degree + 1,) * d))
    whole[(slice(None), *basis.exponents[:kept].T)] = c[:kept].T
    rest = above(a.radius + gone + beside + of_sum(len(c) + 2) * a.norm)
    low, high = ranges(whole, sharp)
    low, high = low - rest, high + rest
    return low - 4 * U * np.abs(low), high + 4 * U * np.abs(high), np.broadcast_to(rest, n_t)
