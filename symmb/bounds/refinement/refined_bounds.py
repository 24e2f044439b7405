"""Bounds by a tree of hierarchical interpolants that are refined where their surpluses are largest."""

from functools import partial

import numpy as np

from symmb.bounds.adaptive import (
    CHEAP_RUNS,
    FEW_SHAPES,
    MANY_VALUES,
    SPARSE_PROBES,
    TENSOR_PARAMETERS,
    EstimatedRange,
    Runs,
    adaptive_bounds,
    count_shapes,
    evenly_spread_points,
    monotone_bounds,
    quasi_random_points,
    relative_rms,
    screen,
    select_dispersed,
    typical_error,
)
from symmb.bounds.refinement.constants import (
    EARLY,
    HOPELESS_NODES,
    HOPELESS_SHARE,
    MOST_GROWTH,
    MOST_STEPS,
    PROGRESS,
    RANGE,
    REFUTATIONS,
)
from symmb.bounds.refinement.tree import Leaf, Tree
from symmb.bounds.time_windows import is_doubtful, rests_for_a_time


def refined_range(runs: Runs, tolerance: float, is_patient: bool) -> EstimatedRange:
    """Range of the surrogate, whose nodes and check runs are added until its expected error is small enough.

    Nodes are added where the predicted surpluses are largest, or a leaf is halved where they do not decay or events lie
    between nodes. When the error that is expected anywhere is near the tolerance, runs at the extremes of the surrogate
    show how far the response is from them; the surrogate is continued through these runs.
    """
    d, tree, checked, before, probed, n_checked = len(runs.box), Tree(runs), 0, np.inf, False, 2 * len(runs.box)
    is_many = d > TENSOR_PARAMETERS
    if is_many:
        found = monotone_bounds(runs, tolerance, lambda: tree.leaves[0].expansion)
        tree.forget(runs.points)
        if found is not None and not _is_refuted(found, runs, tree, tolerance):
            return found
    while True:
        whole = tree.leaves[0]
        is_field = len(tree.leaves) == 1 and runs.shape[0] * runs.shape[1] >= MANY_VALUES
        measure = typical_error if is_field else relative_rms
        is_first = before == np.inf and len(whole.rows) == 2 * d + 1 and is_many
        if not is_first and len(tree.leaves) == 1 and not runs.clock.is_late and checked == 0:
            predicted = measure(whole.surrogate.expected, runs.rms_widths())
            is_rare = not is_many or len(whole.rows) < MOST_GROWTH * n_checked
            if (predicted > EARLY * tolerance and is_rare and runs.left > 2 * d) and (parts := whole.refined()):
                tree.leaves = parts
                _measure_noise(runs, tree)
                continue
        _check(runs, tree, not probed)
        probed, n_checked = True, len(whole.rows)
        lower, upper, places, beyond = tree.union()
        estimate, widths = np.maximum(beyond.max(axis=0), runs.beyond(lower, upper)), runs.rms_widths()
        error = measure(estimate, widths)
        runs.tell(error)
        varies = np.isfinite(widths)
        doubtful = is_doubtful(estimate, upper - lower, runs.noise)[:, varies].any()
        is_done = error <= tolerance and (not doubtful or len(runs) >= CHEAP_RUNS)
        hopeless = len(whole.rows) >= HOPELESS_NODES * d and error > HOPELESS_SHARE and is_many and not is_patient
        if not (is_done or hopeless or runs.left < 1 or runs.clock.is_late):
            checked += 1
            if is_many and checked < 3 and error < PROGRESS * before:
                before = error
                continue  # more runs at extremes: those before have shown much
            k = int(np.argmax([relative_rms(each, widths) for each in beyond]))
            if parts := tree.leaves[k].refined():
                if len(tree.leaves) > 1:
                    parts = _grown(parts, runs, tolerance)
                tree.leaves[k : k + 1] = parts
                checked, before = 0, np.inf
                _measure_noise(runs, tree)
                continue
        attained = runs.extremes[1] - runs.extremes[0]
        estimate = np.minimum(estimate + RANGE * (upper - lower), 2 * attained)  # nothing is known then
        expansion = partial(getattr, whole, "expansion") if len(tree.leaves) == 1 else None
        return EstimatedRange(lower, upper, estimate, expansion, places, is_enough=error <= tolerance)


def _is_refuted(corners: EstimatedRange, runs: Runs, tree: Tree, tolerance: float) -> bool:
    """Whether runs at extremes of the surrogate that are beyond all corners exceed these, as at a kink inside."""
    for _ in range(REFUTATIONS):
        lower, upper, places, _ = tree.union()
        beyond = np.maximum(np.stack([corners.lower - lower, upper - corners.upper]) / runs.rms_widths(), 0.0)
        if relative_rms(beyond.max(axis=0), np.ones(runs.shape[1])) <= tolerance or runs.clock.is_late:
            return False
        tree.check(select_dispersed(places, beyond, min(len(runs.box) // 2, runs.left)))
        if relative_rms(runs.beyond(corners.lower, corners.upper), runs.rms_widths()) > tolerance / 2:
            return True
    return False


def _grown(parts: list[Leaf], runs: Runs, tolerance: float) -> list[Leaf]:
    """A leaf that grows until its expected error is near the tolerance, or so many times."""
    for _ in range(MOST_STEPS):
        near = len(parts) > 1 or relative_rms(parts[0].surrogate.expected, runs.rms_widths()) <= EARLY * tolerance
        if near or runs.left < 1 or runs.clock.is_late or not (more := parts[0].refined()):
            break
        parts = more
    return parts


def _check(runs: Runs, tree: Tree, is_first: bool) -> None:
    """Runs at some of the extremes where errors are expected, and, at first, at quasi-random points."""
    d = len(runs.box)
    if is_first:
        few = count_shapes(runs.nodes, runs.rms_widths()) <= FEW_SHAPES
        tree.check(evenly_spread_points(runs.probes, d))
        number = 3 * SPARSE_PROBES if few and d <= TENSOR_PARAMETERS else SPARSE_PROBES
        tree.check(quasi_random_points(number, d))
        if d > TENSOR_PARAMETERS and (few or rests_for_a_time(*runs.extremes, runs.noise)):
            screen(runs, runs.left // 2)
            tree.forget(runs.points)
    _, _, places, beyond = tree.union()
    weights = np.stack([beyond.max(axis=0)] * 2) / runs.rms_widths()
    number = min(max(d, 4) if d > TENSOR_PARAMETERS else max(2 * d, 4), runs.left)
    tree.check(select_dispersed(places, weights, number))


def _measure_noise(runs: Runs, tree: Tree) -> None:
    """Measure the noise before the study becomes expensive."""
    if not runs.noise_is_known and len(runs) >= 0.7 * CHEAP_RUNS:
        runs.measure_noise()
        tree.forget(tree.places)


refined_bounds = partial(adaptive_bounds, engine=refined_range)
"""The bounds as `adaptive_bounds` gives them, by one surrogate."""
