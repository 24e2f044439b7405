"""Bounds over many parameters. Each output has a separate study, and all studies use the same runs."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from symmb._types import Array
from symmb.bound.adaptive.check_points import select_dispersed
from symmb.bound.adaptive.evidence import Evidence
from symmb.bound.adaptive.output_study import OutputStudy
from symmb.bound.adaptive.requests import Checks, Nodes, Noise, Places, Request
from symmb.bound.adaptive.runs import OutputRuns, Runs
from symmb.bound.adaptive.surrogate import EstimatedRange
from symmb.bound.polynomials.ranges import Piecewise, joined


def range_of_many(
    runs: Runs, tolerance: float, is_patient: bool, known: Mapping[int, EstimatedRange]
) -> EstimatedRange:
    """The ranges of all outputs. The study of an output uses all runs, and requests runs until its error is small.

    `known` contains the ranges of outputs that are known already, by the indices of these outputs.

    A kink may change the response at a few corners only. If runs cost little, the corners next to all extremes are run
    at the end. Studies with larger errors at these corners continue with runs at all corners.
    """
    columns = [k for k in range(runs.shape[1]) if k not in known]
    studies = [OutputStudy(OutputRuns(runs, k), tolerance, is_patient) for k in columns]
    found = _found(runs, studies, studies)
    if studies and studies[0].runs.has_lanes and not runs.clock.is_late:
        runs.check(_distinct([study.corners_of(own) for study, own in found.items()])[: runs.left])
        found = {study: study.with_corners(own) for study, own in found.items()}
        found |= _found(runs, studies, [study for study in studies if study.continues(found[study])])
    every = {**known, **{study.runs.column: own for study, own in found.items()}}
    return _joined(runs, [every[k] for k in range(runs.shape[1])])


def _found(runs: Runs, studies: list[OutputStudy], some: list[OutputStudy]) -> dict[OutputStudy, EstimatedRange]:
    """The ranges of `some` of all studies. These studies advance together and use the same runs."""
    steps, found = {study: study.steps() for study in some}, dict[OutputStudy, EstimatedRange]()

    def predict(points: Array) -> Array:
        values = np.zeros((len(points), *runs.shape))
        for study in studies:
            values[..., study.runs.column : study.runs.column + 1] = study.expansion.values(points)
        return values

    known = None if some is studies else predict  # at first, no interpolant can predict values
    while True:
        requests = list[Request]()
        for study, own in list(steps.items()):
            try:
                requests.append(next(own))
            except StopIteration as end:
                found[study] = end.value
                del steps[study]
        if not requests:
            return found
        _answer(runs, requests, known)
        known = predict


def _answer(runs: Runs, requests: list[Request], predict: Callable[[Array], Array] | None) -> None:
    """Make all requested runs together. Failed nodes get the predicted values (N, n_t, n_y)."""
    if any(isinstance(each, Noise) for each in requests) and not runs.noise_is_known:
        runs.measure_noise()
    for each in requests:
        if isinstance(each, Nodes) and runs.unknown(each.points) <= runs.left:
            runs.at(each.points, predict)
            each.are_run = True
    points = [each.points for each in requests if isinstance(each, Checks)]
    if points:
        runs.check(_distinct(points)[: runs.left])
    chosen = np.empty((0, len(runs.box)))
    for each in sorted((each for each in requests if isinstance(each, Places)), key=lambda each: -each.weights.max()):
        own = select_dispersed(each.places, each.weights, len(runs.box), chosen)
        chosen = np.concatenate([chosen, own])
    if len(chosen):
        runs.check(_distinct([chosen])[: runs.left])


def _distinct(points: Sequence[Array]) -> Array:
    """Points (N, d) without repetitions, in the given order."""
    every = np.concatenate(points)
    _, first = np.unique(every.round(12), axis=0, return_index=True)
    return every[np.sort(first)]


def _together(arrays: Sequence[Array], n_t: int, axis: int) -> Array:
    """Arrays joined along the axis of outputs. The axis of times before it has length n_t, or 1 for a scalar output."""
    return np.concatenate([np.broadcast_to(a, (*a.shape[: axis - 1], n_t, *a.shape[axis:])) for a in arrays], axis=axis)


def _joined(runs: Runs, found: Sequence[EstimatedRange]) -> EstimatedRange:
    """The range of all outputs, from the range of each output."""
    lower, upper = (_together([getattr(each, name) for each in found], runs.shape[0], 1) for name in ("lower", "upper"))
    d = len(runs.box)
    places = [np.zeros((2, *each.lower.shape, d)) if each.places is None else each.places for each in found]
    polynomials = [each.polynomials for each in found]

    def every() -> Piecewise | None:
        return joined([each() if each else None for each in polynomials], runs.shape[0])

    names = list(dict.fromkeys(each.surrogate for each in found))
    return EstimatedRange(
        lower,
        upper,
        Evidence.joined([each.evidence for each in found], runs.shape[0]),
        every,
        ", ".join(names),
        _together(places, runs.shape[0], 2),
        is_enough=all(each.is_enough for each in found),
    )
