"""Bounds over few parameters: tensor grids, in pieces of the box where the response is not smooth, and check runs."""

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.check_runs import inflated_error, quasi_random_points, select_dispersed
from symmb.bounds.adaptive.constants import FARTHEST_SCALING, TENSOR_PROBES, TENSOR_RANGE, TRUST
from symmb.bounds.adaptive.piece import Part, Piece, nodes_of
from symmb.bounds.adaptive.runs import EstimatedRange, Runs, relative_rms
from symmb.bounds.adaptive.union import Union


def tensor_bounds(runs: Runs, tolerance: float) -> EstimatedRange:
    """Range of interpolants on tensor grids, whose degrees rise in the directions with the largest errors.

    Where the response is not smooth the box is halved. Each half is refined by itself as long as it may hold an
    extreme, at some time and for some output. Errors are estimated from the last coefficients, at the places of the
    extremes. Runs at some of these places then check the estimate.
    """
    d = len(runs.box)
    pieces = [Piece.of(runs, (np.zeros(d), np.ones(d), np.full(d, 4 if d == 1 else 2)))]
    while True:
        outcome = _range_or_refinement(pieces, runs, tolerance)
        if isinstance(outcome, EstimatedRange):
            return outcome
        old, parts = outcome
        pieces = [piece for piece in pieces if piece is not old] + old.replaced(parts, runs)
        del outcome, old  # pieces are large


def _range_or_refinement(
    pieces: list[Piece], runs: Runs, tolerance: float
) -> EstimatedRange | tuple[Piece, list[Part]]:
    """The range, if its error is small enough or cannot be reduced, or else a piece and the parts that replace it.

    The whole box is refined without a range until its least error, wherever the extremes are, allows for the tolerance.
    Check runs may show that the error is smaller than the estimate, by TRUST at most.
    """
    widths, parts = runs.rms_widths(), pieces[0].refined_parts()
    if len(pieces) == 1 and _affordable(parts, runs):
        if relative_rms(pieces[0].truncation.least, widths) > tolerance / TRUST:
            return pieces[0], parts
    union = Union.of(pieces)
    worst = pieces[int(np.argmax([relative_rms(error, widths) for error in union.errors]))]
    parts = worst.refined_parts()
    estimate = union.errors.max(axis=0)
    if _affordable(parts, runs) and relative_rms(union.trust * estimate, widths) > tolerance:
        return worst, parts
    expected = relative_rms(estimate, widths)
    estimate, worst = _check(runs, union, worst, widths, max(2 * len(runs.box), 4))
    widths = runs.rms_widths()
    error = relative_rms(estimate, widths)
    parts = worst.refined_parts(all_directions=error > FARTHEST_SCALING * expected)
    if error > tolerance and _affordable(parts, runs):
        return worst, parts
    whole = pieces[0].expansion
    estimate = estimate + TENSOR_RANGE * (union.upper - union.lower)
    return EstimatedRange(union.lower, union.upper, estimate, (lambda: whole) if len(pieces) == 1 else None)


def _affordable(parts: list[Part], runs: Runs) -> bool:
    """Whether there are parts, and the budget is enough for their nodes."""
    return bool(parts) and runs.unknown(np.concatenate([nodes_of(part) for part in parts])) <= runs.left


def _check(runs: Runs, union: Union, worst: Piece, widths: Array, number: int) -> tuple[Array, Piece]:
    """Check runs at some of the extremes, and at quasi-random points.

    A run with the error e at a place where the estimate is E(x) suggests the error e E / E(x) where it is E. The factor
    E / E(x) is used up to FARTHEST_SCALING.

    Returns
    -------
    (n_t, n_y) array        the new estimate
    Piece                   the piece to refine next: that with the largest observed error, or else the worst
    """
    estimate = union.errors.max(axis=0)
    n_known, probes = len(runs.points), quasi_random_points(TENSOR_PROBES, len(runs.box))
    selected = select_dispersed(union.places, union.checkable_error / widths, number)
    runs.check(np.concatenate([probes, selected])[: runs.left])
    rows = [k for k in range(len(runs.points)) if k < TENSOR_PROBES or k >= n_known]
    if not rows:
        return estimate, worst
    squares, largest = np.zeros_like(estimate), -1.0
    for row in rows:  # one by one: several errors at once would take more memory than the runs
        x = runs.points[row]
        piece = union.piece_at(x)
        error, expected = piece.observed_error(x, runs.checks[row]), piece.expected_error(x)
        ratio = np.divide(estimate, expected, out=np.ones_like(error), where=expected > estimate / FARTHEST_SCALING)
        ratio = np.where(np.abs(error) > FARTHEST_SCALING * expected, np.maximum(ratio, 1.0), ratio)
        squares = np.maximum(squares, np.square(error * ratio))
        observed = relative_rms(error, widths)
        if observed > largest:
            largest, worst = observed, piece
    return np.maximum(inflated_error(squares), union.trust * estimate), worst
