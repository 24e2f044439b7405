"""Bounds of the outputs at times of a step."""

import math
from typing import NamedTuple

import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._types import Array, Mask
from symmb.prove import chebyshev as ch
from symmb.prove import points
from symmb.prove.basis import Basis, basis_of
from symmb.prove.degrees import degrees_of_outputs
from symmb.prove.ellipses import MOST_PATCHES, Choice, Control, ellipses, node_counts, nodes_needed, reaches
from symmb.prove.errors import ProofError
from symmb.prove.ranges import cut, ranges
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.several_parameters import motion_at, on_step, parameter_models, places_in_step, run
from symmb.prove.taylor_models import Model, reach
from symmb.prove.terms import monomials
from symmb.prove.time_step import TimeStep, parameter_points

EXTRA_NODES = 4
"""Nodes of the first grid minus terms of the motion, for each parameter."""
_MOST_NODES_OF_ALL_TIMES = 3e6
"""Largest number of nodes in the grids for all times. The values at so many nodes take seconds."""

_PART = 0.1
"""Part of `rtol` for aliasing and removed coefficients. Larger values widen bounds, smaller ones take more nodes."""


class OutputBounds(NamedTuple):
    """Lower and upper bounds of the outputs, remainders (n_t, n_y), and sizes (n_y,) of the terms of the outputs.

    A remainder is the part of the bounds that is not the range of a polynomial. The sizes are sizes of the states times
    sensitivities; 0 if they are not known.
    """

    lower: Array
    upper: Array
    remainder: Array
    terms: Array

    @classmethod
    def unknown(cls, n_t: int, n_y: int) -> "OutputBounds":
        """Infinite bounds."""
        infinite = np.full((n_t, n_y), np.inf)
        return cls(-infinite, infinite, infinite.copy(), np.zeros(n_y))

    @classmethod
    def nothing(cls, n_t: int, n_y: int) -> "OutputBounds":
        """Bounds of the empty set."""
        infinite = np.full((n_t, n_y), np.inf)
        return cls(infinite, -infinite, np.zeros((n_t, n_y)), np.zeros(n_y))

    def at(self, times: slice | Mask) -> "OutputBounds":
        """The bounds at some of the times."""
        return OutputBounds(self.lower[times], self.upper[times], self.remainder[times], self.terms)

    def put(self, times: slice | Mask, other: "OutputBounds") -> None:
        """Replace the bounds at some of the times."""
        for own, values in zip(self[:3], other[:3], strict=True):
            own[times] = values
        np.maximum(self.terms, other.terms, out=self.terms)

    def joined(self, other: "OutputBounds") -> "OutputBounds":
        """Bounds of the union of both sets."""
        return OutputBounds(
            np.minimum(self.lower, other.lower), *(np.maximum(a, b) for a, b in zip(self[1:], other[1:], strict=True))
        )


@np.errstate(all="ignore")  # bounds that are not finite are treated later
def output_bounds(step: TimeStep, w: Array, times: Array, control: Control, rtol: float = SLIGHT) -> OutputBounds:
    """Bounds of the outputs at times (n_t,) of a step for |w| <= w (n,).

    The outputs y(u(xi, t), p, t) are interpolated in xi. Their ranges are widened by the aliasing, the rounding, and
    the largest sensitivity dy/dx times the largest B w. Outputs that cannot be shown to be smooth have infinite bounds.
    `control.rough` marks these outputs. `rtol` is the allowed excess of the bounds, relative to their width.
    """
    problem, e, sizes = step.problem, above(step.B_largest @ w), ch.sums(step.x.c, step.x.c.ndim - 1)
    bounds = OutputBounds.unknown(len(times), problem.outputs.numel_out(0))
    fill = _model_bounds if problem.weights else _grid_bounds
    # with a clock, the parameters reach a time at different places of the step
    e_at = step.reach_at(times, w) if problem.clock is None else np.repeat(e[:, None], len(times), axis=1)
    terms = fill(step, e, e_at, times, control, rtol, bounds) @ sizes
    return bounds._replace(terms=np.where(np.isfinite(terms), terms, 0.0))


def _grid_bounds(
    step: TimeStep, e: Array, e_at: Array, times: Array, control: Control, rtol: float, found: OutputBounds
) -> Array:
    """Write bounds to `found` for states within e (n,) of the motion, and return the sensitivities (n_y, n).

    The states at the times are within `e_at` (n, n_t) of the motion.
    """
    problem, n_y = step.problem, len(found.terms)
    smooth, is_refused = np.zeros(n_y, dtype=bool), np.array([*map(bool, problem.refused or [""] * n_y)], dtype=bool)
    # quotients of positive sums, such as reactions, may need many patches
    for patches in (count for count in (1, 8, 24, 64) if count ** (1 + problem.d) <= MOST_PATCHES):
        rho, most, nodes = _ellipses(step, control.choice, patches)
        counts = max(patches, Choice().patches[0]), patches
        slopes = reaches(step.discs_of(problem.sensitivity_tape, counts, e)[1]).reshape(problem.n, n_y).T
        of_states = above(slopes @ e_at)
        smooth = np.isfinite(most) & np.isfinite(of_states).all(axis=1)
        # an output that was rough in the last step is tried with one patch only
        is_hopeless = control.rough if patches > 1 else False
        # more patches are tried only if 50 nodes of each parameter are not enough
        if (smooth | is_refused | is_hopeless).all() and nodes <= 50**problem.d:
            break
    control.rough = ~smooth
    pending = [np.flatnonzero(smooth)] if smooth.any() else []
    while pending:
        part = pending.pop()
        try:
            bounds = _good_bounds(step, times, tuple(part.tolist()), rho[1:], most[part], of_states[part], rtol)
        except ProofError:  # a single output may be the cause
            pending += np.split(part, len(part)) if len(part) > 1 else []
        else:
            found.lower[:, part], found.upper[:, part], found.remainder[:, part] = bounds
    return slopes


def _ellipses(step: TimeStep, choice: Choice, patches: int) -> tuple[list[float], Array, float]:
    """The ellipses of the parameters with the fewest nodes, bounds of the outputs, and the number of nodes."""
    found = []
    # spreads relative to the spread of the ellipses on which the rates are bounded
    for factor in (1.0, 0.3, 3.0, 10.0):
        rho = [1.0, *ellipses(step, (choice.spread[0], factor * choice.spread[1]))[1:]]
        counts = patches, max(patches, choice.patches[1])
        most = reaches(step.discs_of(step.problem.output_tape, counts, rho=rho)[0])
        smooth = most[np.isfinite(most)]
        nodes = nodes_needed(rho[1:], SLIGHT / float(smooth.max(initial=1.0)))
        found.append((len(smooth), -nodes, rho, most))
    _, nodes, rho, most = max(found, key=lambda choice: choice[:2])
    return rho, most, -nodes


def _good_bounds(
    step: TimeStep, times: Array, which: tuple[int, ...], rho: list[float], most: Array, of_states: Array, rtol: float
) -> tuple[Array, Array, Array]:
    """Bounds of some outputs. On the ellipses rho of the parameters, these outputs are at most `most`."""
    d = len(rho)
    degrees = degrees_of_outputs(step)[list(which)]
    c, remainder = interpolation(step, times, which, rho, most, of_states.max(axis=1), rtol, degrees)
    width = (ch.sums(c, d) - np.abs(c[(..., *(0,) * d)])).max(axis=1)
    kept, removed = cut(c.reshape(-1, *c.shape[2:]), np.repeat(_PART * rtol * width, len(times)))
    remainder = above(remainder + of_states + removed.reshape(remainder.shape))
    low, high = _widened(*ranges(kept, rtol, _PART * remainder.ravel()), remainder.ravel())
    return low.reshape(remainder.shape).T, high.reshape(remainder.shape).T, remainder.T


def _widened(low: Array, high: Array, remainder: Array) -> tuple[Array, Array]:
    """Bounds widened by remainders. They are rounded outward."""
    low, high = low - remainder, high + remainder
    return low - 4 * U * np.abs(low), high + 4 * U * np.abs(high)


def interpolation(
    step: TimeStep,
    times: Array,
    which: tuple[int, ...],
    rho: list[float],
    most: Array,
    other_errors: Array,
    rtol: float = SLIGHT,
    degrees: Array | float = np.inf,
) -> tuple[Array, Array]:
    """Coefficients (m, n_t, n1, ...) of outputs in the parameters, and bounds (m, n_t) of the errors.

    Parameters
    ----------
    rho : d sizes of Bernstein ellipses around the intervals of the parameters
    most : (m,) bounds of the outputs on these ellipses
    other_errors : (m,) errors of the outputs from other causes. Aliasing errors need not be much smaller
    rtol : allowed aliasing errors, relative to the width
    degrees : (m, d) degrees of outputs that are polynomials; infinite for other outputs
    """
    d = len(rho)
    lengths = step.x.c.shape[2:]
    counts = tuple(m + EXTRA_NODES for m in lengths)
    while True:
        values, errors = _values(step, times, counts, which)
        mean = values.mean(axis=tuple(range(2, values.ndim)))
        moved = values - mean[(..., *(None,) * d)]
        c = ch.along([ch.coefficients_from_nodes(m) for m in counts], moved)
        width = ch.sums(c, d).max(axis=1)
        if not np.isfinite(width).all():
            raise ProofError("an output is too large")
        is_exact = np.broadcast_to(degrees < np.array(counts), (len(most), d)).all(axis=1)
        alias = np.where(is_exact, 0.0, above(ch.aliasing(rho, counts) * most))
        allowed = _PART * (rtol * width + other_errors) + errors
        if (alias <= allowed).all():
            break
        wanted = node_counts(rho, float((allowed / most).min()))
        finer = tuple(max(a, b) for a, b in zip(wanted, counts, strict=True))
        if finer == counts or math.prod(finer) * len(times) > _MOST_NODES_OF_ALL_TIMES:
            break
        counts = finer
    c[(..., *(0,) * d)] += mean
    lost = 2.0**d * np.prod(counts, dtype=float) * ch.rounding_of(counts, 2 * ch.ENTRY_ERROR) * ch.largest(moved, d)
    lebesgue = np.prod([2.0 / np.pi * np.log(m) + 1.0 for m in counts])
    peak = ch.largest(values, d)
    return c, above(lost + lebesgue * (errors[:, None] + 2 * U * peak) + 2 * U * peak + alias[:, None])


def _values(step: TimeStep, times: Array, counts: tuple[int, ...], which: tuple[int, ...]) -> tuple[Array, Array]:
    """Outputs (m, n_t, *counts) at times and nodes of the parameters, and bounds of the errors (m,)."""
    problem, d = step.problem, len(counts)
    at = step.at(times, step.x)
    x, errors = ch.values(at[0], counts)
    errors = above(errors + at[1]).max(axis=1)
    states = [points.point(values, float(error)) for values, error in zip(x, errors, strict=True)]
    p = parameter_points(problem, counts, 1)
    t = [points.point(times.reshape(-1, *(1,) * d), U * np.abs(times).max())]  # differences from the first time
    found = problem.tape_of_outputs(which).run(points.OPERATIONS, points.point, [states, p, t])[0]
    shape = (len(times), *counts)
    return np.stack([np.broadcast_to(a[0], shape) for a in found]), np.array([a[1] for a in found])


def _model_bounds(
    step: TimeStep, e: Array, e_at: Array, times: Array, control: Control, rtol: float, found: OutputBounds
) -> Array:
    """Write bounds to `found`, as `_grid_bounds` does, for several parameters. Return the sensitivities (n_y, n)."""
    problem = step.problem
    slopes = np.array([reach(a) for a in on_step(step, problem.sensitivity_tape, e)[1]])
    slopes = slopes.reshape(problem.n, len(found.terms)).T
    of_states = above(slopes @ e_at)
    source = problem.basis(step.x.c.shape[2])
    # two degrees above those of the motion keep most terms of products of states
    basis = basis_of(source.weights, source.degree + 2)
    x, t = _at_times(step, times, basis)
    for k, y in enumerate(run(problem.output_tape, [x, parameter_models(problem, basis), [t]])[0]):
        if np.isfinite(reach(y)) and np.isfinite(of_states[k]).all():
            bounds = _range_of_model(y, of_states[k], len(times), rtol)
            found.lower[:, k], found.upper[:, k], found.remainder[:, k] = bounds
    return slopes


def _at_times(step: TimeStep, times: Array, basis: Basis) -> tuple[list[Model], Model]:
    """Taylor models of the states and of the time of a step, at times (n_t,) of the scene."""
    if step.problem.clock is not None:
        return motion_at(step, places_in_step(step, times, basis))
    at, errors = step.at(times, step.x)
    c, lost = monomials(at, step.problem.basis(step.x.c.shape[2]), basis)
    x = [Model(own.T, above(error + removed), basis) for own, error, removed in zip(c, errors, lost, strict=True)]
    return x, Model(times[None], np.full(1, U * np.abs(times).max()), basis)


def _range_of_model(a: Model, other_errors: Array, n_t: int, rtol: float) -> tuple[Array, Array, Array]:
    """Bounds and remainders (n_t,) of an output.

    The highest degrees are removed if they are small relative to the width or the remainder, or if a tensor has more
    than 1e5 coefficients at one time.
    """
    basis, d = a.basis, a.basis.variables
    other_errors = a.radius + other_errors
    c = a.in_chebyshev(n_t)
    sums = np.add.reduceat(np.abs(c), [0, *basis.counts[:-1]], axis=0)
    tails = np.cumsum(sums[::-1], axis=0)[::-1]
    degree = basis.degree
    while degree > 1 and (
        (tails[degree] <= _PART * (rtol * tails[1] + other_errors)).all() or (degree + 1.0) ** d > 1e5
    ):
        degree -= 1
    kept = basis.counts[degree]
    removed = tails[degree + 1] if degree < basis.degree else np.zeros(n_t)
    whole = np.zeros((n_t, *(degree + 1,) * d))
    whole[(slice(None), *basis.exponents[:kept].T)] = c[:kept].T
    remainder = above(other_errors + removed + of_sum(len(c) + 2) * a.norm)
    return *_widened(*ranges(whole, rtol, _PART * remainder), remainder), np.broadcast_to(remainder, n_t)
