"""Bounds over few parameters: tensor grids, in pieces of the box where the response is not smooth, and check runs."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.check_runs import (
    count_shapes,
    evenly_spread_points,
    inflated_error,
    quasi_random_points,
    select_dispersed,
)
from symmb.bounds.adaptive.constants import (
    CERTAIN_SHARE,
    CHEAP_RUNS,
    CHEAP_SHARE,
    CHECKED_TOGETHER,
    DOUBTED_SHARE,
    FARTHEST_SCALING,
    FEW_SHAPES,
    FIELD_TRUST,
    LEAST_COST,
    MANY_VALUES,
    NOISE_RUNS,
    REACHED_POWER,
    REACHED_SHARE,
    SAFETY,
    SOME_VALUES,
    TENSOR_PROBES,
    TENSOR_RANGE,
    TRUST,
)
from symmb.bounds.adaptive.piece import Part, Piece, nodes_of
from symmb.bounds.adaptive.runs import EstimatedRange, Runs, relative_rms, typical_error
from symmb.bounds.adaptive.union import Union
from symmb.bounds.time_windows import DOUBTFUL, is_doubtful, is_doubtful_in_window


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
        if not runs.noise_is_known and (_cost(parts, runs) >= LEAST_COST * NOISE_RUNS or len(runs) >= CHEAP_RUNS):
            runs.measure_noise()
            pieces = [replace(piece, widths=runs.rms_widths()) for piece in pieces]  # their errors are estimated anew
            continue
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
    is_field = len(pieces) == 1 and pieces[0].jumps is None and runs.shape[0] * runs.shape[1] >= MANY_VALUES
    is_field = is_field and (runs.shape[0] >= MANY_VALUES or _least_shapes(runs) > FEW_SHAPES)
    measure, trust = (typical_error, FIELD_TRUST) if is_field else (relative_rms, TRUST)
    if len(pieces) == 1 and _affordable(parts, runs):
        if measure(pieces[0].truncation.least, widths) > tolerance / trust:
            return pieces[0], parts
    union = Union.of(pieces)
    worst = pieces[0]
    if len(pieces) > 1:
        worst = pieces[int(np.argmax([relative_rms(error, widths) for error in union.errors]))]
    parts = worst.refined_parts()
    estimate = union.errors.max(axis=0)
    share = FIELD_TRUST if is_field else union.trust
    if _affordable(parts, runs) and measure(share * estimate, widths) > tolerance:
        return worst, parts
    expected = relative_rms(estimate, widths)
    runs.tell(expected)
    estimate, inflated, ratio, worst = _check(runs, union, worst, widths, max(2 * len(runs.box), 4))
    beyond = runs.beyond(union.lower, union.upper)
    if len(pieces) > 1 and len(runs.checks) and relative_rms(beyond, widths) > relative_rms(estimate, widths):
        worst = _farthest(runs, union, widths)
    estimate = np.maximum(estimate, beyond)
    widths = runs.rms_widths()
    error = measure(estimate, widths)
    if is_field:
        expected_errors = ratio * union.errors.max(axis=0)
        estimate = np.maximum(np.maximum(inflated, SAFETY * expected_errors), beyond)
    width, varies = union.upper - union.lower, np.isfinite(widths)
    is_doubted = is_doubtful(estimate, width, runs.noise)[:, varies].any()
    for_a_moment = is_doubtful_in_window(estimate, width, runs.noise, CHEAP_SHARE * DOUBTFUL)[:, varies].any()
    parts = worst.refined_parts()
    is_cheap = _affordable(parts, runs) and len(runs) + _cost(parts, runs) <= CHEAP_RUNS
    if is_cheap and (is_doubted or for_a_moment):
        return worst, parts
    if is_field:
        estimate = (
            np.maximum(estimate, DOUBTED_SHARE * union.errors.max(axis=0))
            if is_doubted
            else np.maximum(CERTAIN_SHARE * estimate, beyond)
        )
        error = measure(np.maximum(expected_errors, beyond), widths)
    parts = worst.refined_parts(all_directions=np.isfinite(error) and error > FARTHEST_SCALING * expected)
    if error > tolerance and _affordable(parts, runs):
        return worst, parts
    is_enough = max(error, TENSOR_RANGE) <= tolerance
    is_certain = len(pieces) == 1 and not (
        is_doubted or is_doubtful_in_window(estimate, width, runs.noise)[:, varies].any()
    )
    if is_enough and is_certain and runs.shape[0] * runs.shape[1] >= SOME_VALUES:
        share = min(1.0, REACHED_SHARE * tolerance**REACHED_POWER)
        estimate = np.maximum(share * estimate, beyond)
    estimate = estimate + TENSOR_RANGE * width
    expansion = (lambda: pieces[0].expansion) if len(pieces) == 1 else None
    return EstimatedRange(union.lower, union.upper, estimate, expansion, union.places, is_enough)


def _affordable(parts: list[Part], runs: Runs) -> bool:
    """Whether there are parts, and the budget is enough for their nodes."""
    return bool(parts) and _cost(parts, runs) <= runs.left and not runs.clock.is_late


def _cost(parts: list[Part], runs: Runs) -> int:
    """How many of the nodes of some parts have not run."""
    return runs.unknown(np.concatenate([nodes_of(part) for part in parts]))


def _probes(runs: Runs) -> int:
    """The number of quasi-random check points."""
    shapes = _least_shapes(runs)
    if shapes > FEW_SHAPES:
        shapes = count_shapes(runs.nodes, runs.rms_widths())
    return next((number for most, number in TENSOR_PROBES if shapes <= most), 1)


def _least_shapes(runs: Runs) -> int:
    """The fewest shapes of time of an output that varies: others tell nothing of what these hide."""
    Y, widths = runs.nodes, runs.rms_widths()
    shapes = (count_shapes(Y[..., [k]], widths[[k]]) for k in np.flatnonzero(np.isfinite(widths)))
    return min(shapes, default=0)


def _farthest(runs: Runs, union: Union, widths: Array) -> Piece:
    """The piece that holds the check run which goes farthest beyond the range."""
    beyond = [relative_rms(np.maximum(np.maximum(union.lower - y, y - union.upper), 0.0), widths) for y in runs.checks]
    return union.piece_at(runs.points[int(np.argmax(beyond))])


def _check(runs: Runs, union: Union, worst: Piece, widths: Array, number: int) -> tuple[Array, Array, Array, Piece]:
    """Check runs at some of the extremes, and at quasi-random points.

    A run with the error e at a place where the estimate is E(x) suggests the error e E / E(x) where it is E. The factor
    E / E(x) is used up to FARTHEST_SCALING.

    Returns
    -------
    (n_t, n_y) array        the new estimate
    (n_t, n_y) array        what the check runs alone show
    (n_y,) array            errors to expect over the old one: the ratio of their root mean squares at check runs
    Piece                   the piece to refine next: that with the largest observed error, or else the worst
    """
    estimate = union.errors.max(axis=0)
    n_known, d = len(runs.points), len(runs.box)
    probes = np.concatenate([evenly_spread_points(runs.probes, d), quasi_random_points(_probes(runs), d)])
    selected = select_dispersed(union.places, union.checkable_error / widths, number)
    runs.check(np.concatenate([probes, selected])[: runs.left])
    # Near a jump, errors of former check runs say nothing about the pieces that lie there now.
    whole = len(union.pieces) == 1
    rows = [k for k in range(len(runs.points)) if whole or k < len(probes) or k >= n_known]
    if not rows:
        return estimate, np.zeros_like(estimate), np.ones(runs.shape[1]), worst
    squares, largest = np.zeros_like(estimate), -1.0
    seen, foreseen = np.zeros((2, runs.shape[1]))
    for points, piece, errors in _observed_errors(runs, union, rows):
        expected = piece.expected_error(points[:, None, None])
        ratio = np.divide(estimate, expected, out=np.ones_like(errors), where=expected > estimate / FARTHEST_SCALING)
        ratio = np.where(np.abs(errors) > FARTHEST_SCALING * expected, np.maximum(ratio, 1.0), ratio)
        beyond_noise = np.maximum(np.square(errors) - np.square(runs.noise), 0.0)
        squares = np.maximum(squares, (beyond_noise * np.square(ratio)).max(axis=0))
        seen, foreseen = seen + beyond_noise.sum(axis=(0, 1)), foreseen + np.square(expected).sum(axis=(0, 1))
        if len(union.pieces) > 1 and (observed := relative_rms(np.sqrt(beyond_noise), widths)) > largest:
            largest, worst = observed, piece
    ratio = np.sqrt(np.divide(seen, foreseen, out=np.ones_like(seen), where=foreseen > 0))
    inflated = inflated_error(squares)
    return np.maximum(inflated, union.trust * estimate), inflated, np.maximum(ratio, FIELD_TRUST), worst


def _observed_errors(runs: Runs, union: Union, rows: list[int]) -> Iterator[tuple[Array, Piece, Array]]:
    """Points (C, d) of check runs, the piece that holds them, and the errors (C, n_t, n_y) of its interpolant there.

    They are a few at a time: more errors would take more memory than the runs.
    """
    pieces = [union.piece_at(runs.points[row]) for row in rows]
    for piece in union.pieces:
        own = [row for row, its in zip(rows, pieces, strict=True) if its is piece]
        for start in range(0, len(own), CHECKED_TOGETHER):
            some = own[start : start + CHECKED_TOGETHER]
            yield runs.points[some], piece, piece.observed_errors(runs.points[some], runs.checks[some])
