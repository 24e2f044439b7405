"""Bounds over few parameters, from tensor grids, pieces of the box for rough responses, and check runs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array, Indices, Mask
from symmb.bound.adaptive.check_points import (
    FEW_TIMES,
    PATIENCE,
    PROBES,
    SAFETY,
    evenly_spread_points,
    inflated_error,
    quasi_random_points,
    select_dispersed,
)
from symmb.bound.adaptive.piece import JUDGED_DEGREE, Part, Piece, nodes_of
from symmb.bound.adaptive.runs import CHEAP_RUNS, NOISE_RUNS, TRUST, Runs, relative_errors, relative_rms
from symmb.bound.adaptive.secants import bisected_range, secant_extremes
from symmb.bound.adaptive.small_study import JointStudy, Problem
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.polynomials.ranges import MOST_PARAMETERS, RANGE_ERROR, Piecewise
from symmb.bound.responses import DOUBTFUL, is_doubtful, is_doubtful_in_window

NARROW, MOST_AT_KINKS = 0.01, 8
"""Distance of runs at kinks, divided by that of other check runs. Largest number of runs at kinks in a round."""


SPREAD_SHARE = 12
"""Ratio of all runs of three parameters to check runs that are evenly spread, if there are few times. Values at many
times show more. Smaller ratios take more runs and miss fewer bumps. (tests/benchmarks/silent_errors.py)"""


@dataclass(frozen=True, eq=False)
class _Union:
    """The range of all pieces.

    Attributes
    ----------
    lower, upper : (n_t, n_y) range
    places : (2, n_t, n_y, d) of its minima and maxima
    errors : (k, n_t, n_y) possible excess of each piece over the range
    checkable_error : (2, n_t, n_y) the part of the errors that runs at the places can show; 0 at nodes
    trust : (n_t, n_y) smallest fraction of the largest error that remains after check runs; 1 for errors at events
    """

    pieces: list[Piece]
    lower: Array
    upper: Array
    places: Array
    errors: Array
    checkable_error: Array
    trust: Array

    @classmethod
    def of(cls, pieces: list[Piece]) -> "_Union":
        lows, highs, places = (_stacked(each) for each in zip(*(piece.range for piece in pieces), strict=True))
        lower, upper = lows.min(axis=0), highs.max(axis=0)
        extreme = np.stack([lows.argmin(axis=0), highs.argmax(axis=0)])
        below, above = (_stacked([piece.errors[side] for piece in pieces]) for side in (0, 1))
        beyond = np.maximum(np.maximum(lower - (lows - below), highs + above - upper), 0.0)
        checkable = _stacked([piece.checkable_error for piece in pieces])
        no_event = np.zeros(beyond.shape[1:])
        has_event = [no_event if p.event_errors is None else np.isfinite(p.event_errors[0]) for p in pieces]
        trust = np.where(_select(np.array(has_event, dtype=bool), beyond.argmax(axis=0)), 1.0, TRUST)
        return cls(
            pieces, lower, upper, _select(places, extreme[..., None]), beyond, _select(checkable, extreme), trust
        )

    @property
    def expected(self) -> Array:
        """The largest of the errors (n_t, n_y)."""
        return self.errors.max(axis=0)

    def worst(self, widths: Array) -> Piece:
        """The piece with the largest error over the widths (n_y,)."""
        return self.pieces[int(np.argmax([relative_rms(error, widths) for error in self.errors]))]

    def polynomials(self) -> Piecewise:
        """The interpolants of all pieces, and their error, which is at least the error at check runs."""
        centres, halves = (np.stack([getattr(piece, name) for piece in self.pieces]) for name in ("centre", "half"))
        error = np.max([piece.largest_error for piece in self.pieces], axis=0)
        found = Piecewise(centres, halves, tuple(piece.expansion for piece in self.pieces), error)
        runs = self.pieces[0].runs
        seen = np.abs(found.values(runs.points) - runs.checks).max(axis=0, initial=0.0)
        return replace(found, error=np.maximum(error, SAFETY * seen))


@dataclass(frozen=True)
class TensorGrids(JointStudy):
    """Interpolants on tensor grids, for up to three parameters.

    Attributes
    ----------
    resumes : whether grids that were too costly are refined, because other studies leave large errors
    """

    resumes: bool = False

    name = "tensor grids"

    @property
    def when(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The outputs that the study takes, in words."""
        if self.resumes:
            return "the other studies leave errors above 10 % of the width, or above ten times the tolerance"
        return f"there are up to {MOST_PARAMETERS} parameters, until kinks or three parameters take too many runs"

    def accepts(self, problem: Problem) -> bool:
        return problem.refinement is not None if self.resumes else len(problem.runs.box) <= MOST_PARAMETERS

    def ranges(self, problem: Problem) -> tuple[dict[int, EstimatedRange], Mask]:
        grids, which = problem.refinement or Refinement(problem.runs, problem.tolerance), problem.open
        grids.count_only(which)
        while (found := grids.bounded()) is None:
            if not self.resumes and grids.is_costly:
                problem.refinement = grids
                return {}, ~which
            grids = grids.refined()
        return found.columns(which), which


def is_resolved(problem: Problem) -> bool:
    """Whether the error of the first interpolant is expected to be within the tolerance, and is far from doubtful.

    The error of an oscillation that is not resolved may be estimated as only a few percent.
    """
    grids = Refinement(problem.runs, problem.tolerance)
    grids.count_only(problem.open)
    return grids.is_resolved


class Refinement:
    """Interpolants on tensor grids. Degrees increase in the directions with the largest errors.

    If the response is not smooth, the box is halved. Each half is refined separately as long as it may contain an
    extreme of some output at some time. Errors are estimated from the last coefficients, at the places of the extremes.
    Runs at some of these places then check the estimate. For one parameter, secants predict extremes at kinks. Runs at
    these points attain a fraction of the predictions. The largest fraction (n_y,) is applied to all other predictions,
    and gives the error of these predictions.
    """

    def __init__(self, runs: Runs, tolerance: float) -> None:
        d = len(runs.box)
        self._runs, self._tolerance, self._counts = runs, tolerance, np.full(runs.shape[1], True)
        first = 4 if d == 1 and runs.left >= 5 else 2
        degrees = np.full(d, first) if runs.first is None else runs.first.alpha.max(axis=0)
        part: Part = (np.zeros(d), np.ones(d), degrees)
        runs.at(nodes_of(part))  # widths follow from runs
        self._pieces = [Piece.of(runs, part, self._widths)]
        self._chosen, self._parts = self._pieces[0], list[Part]()
        self._share_of_secants = np.zeros(runs.shape[1])
        self._secants = 0, (np.empty(0), np.empty(0))

    @property
    def is_resolved(self) -> bool:
        """Whether the first interpolant is accurate enough; see `is_resolved`."""
        return relative_rms(self._pieces[0].truncation.least, self._widths) <= min(self._tolerance, DOUBTFUL / 10)

    def bounded(self) -> EstimatedRange | None:
        """The range, if its error is small enough or cannot be reduced.

        Check runs can reduce the estimated error to a fraction. If this fraction is small enough, check runs are made.
        The remaining error must then be small enough. Uncertain bounds are refined further as long as this takes few
        runs.
        """
        runs, tolerance, first, widths = self._runs, self._tolerance, self._pieces[0], self._widths
        if len(self._pieces) == 1 and first.jumps is None:  # if errors are large everywhere, no range is needed
            least = TRUST * first.truncation.least
            if relative_rms(least, widths) > tolerance and self._chooses(first):
                runs.tell("tensor grid", "decay", relative_errors(least, widths))
                return None
        union = _Union.of(self._pieces)
        worst, trusted = union.worst(widths), union.trust * union.expected
        runs.tell(_grids(union), "decay", relative_errors(trusted, widths))
        if relative_rms(trusted, widths) > tolerance and self._chooses(worst):
            return self._at_kinks(union, union.expected) if self._chosen.rough_direction is not None else None
        return self._confirmed(union, worst, trusted)

    def _confirmed(self, union: _Union, worst: Piece, trusted: Array) -> EstimatedRange | None:
        """The range after check runs, unless these runs show that the worst piece must be refined.

        The remaining error is at least `trusted` (n_t, n_y).
        """
        runs, tolerance = self._runs, self._tolerance
        inflated, worst = self._check(union, worst)
        beyond, widths = runs.beyond(union.lower, union.upper), self._widths
        evidence = Evidence.of("check runs", inflated).at_least("decay", trusted).at_least("beyond", beyond)
        if len(runs.box) == 1:
            evidence = evidence.at_least("kinks", self._share_of_secants * self._unseen(union)[1].max(axis=0))
        error = relative_rms(evidence.error, widths)
        estimate = evidence.error
        errors = relative_errors(estimate, widths)
        runs.tell("check runs", evidence.decisive(int(np.argmax(errors))), errors)
        if error > tolerance and self._chooses(worst):
            return self._at_kinks(union, estimate)
        width, varies = union.upper - union.lower, np.isfinite(widths)
        doubtful = is_doubtful(estimate, width, runs.noise) | is_doubtful_in_window(estimate, width, runs.noise)
        if doubtful[:, varies].any() and self._chooses(worst, CHEAP_RUNS - len(runs)):
            return None
        name = "an interpolant on a tensor grid" if len(union.pieces) == 1 else f"interpolants on {_grids(union)}"
        is_enough = max(error, RANGE_ERROR) <= tolerance
        evidence = evidence.plus("range", RANGE_ERROR * width)
        return EstimatedRange(union.lower, union.upper, evidence, union.polynomials, name, union.places, is_enough)

    def _at_kinks(self, union: _Union, estimate: Array) -> EstimatedRange | None:
        """The range from runs near kinks of one parameter and from the estimated range, if its error is small enough.

        The next runs are at intersections of secants, such as the vertex of a V. Rounds continue if the error decreases
        so quickly that they are expected to add half as many runs at most.
        """
        runs, tolerance, widths, sizes = self._runs, self._tolerance, self._widths, list[float]()
        if len(runs.box) > 1:
            return None
        if any(piece.event_errors is not None for piece in union.pieces):
            return bisected_range(runs, widths, tolerance)
        if len(runs.places) <= JUDGED_DEGREE // 2:
            return None
        runs.check(self._probes(PROBES))
        while runs.left > 1 and not runs.clock.is_late:
            places, beyond = self._secant_extremes()
            of_range = np.maximum(estimate, runs.beyond(union.lower, union.upper))
            errors = np.minimum(beyond, np.maximum(of_range, self._share_of_secants * beyond))
            size = relative_rms(errors.max(axis=0), widths)
            if size <= tolerance:
                (is_lowest, is_highest), (lowest, highest) = beyond < of_range, runs.extremes
                lower, upper = np.where(is_lowest, lowest, union.lower), np.where(is_highest, highest, union.upper)
                error = errors.max(axis=0) + RANGE_ERROR * (upper - lower)
                return EstimatedRange(
                    lower, upper, Evidence.of("kinks", error), union.polynomials, "runs near kinks", is_enough=True
                )
            sizes.append(size)
            large = np.where(errors > tolerance / 2 * widths, errors / widths, 0.0)
            half = len(sizes) // 2
            gain = math.log(sizes[-1 - half] / size) / max(half, 1)  # of a round
            takes_few = half == 0 or MOST_AT_KINKS * math.log(size / tolerance) <= len(runs) / 2 * gain
            # Larger distances make the kernel of the choice narrower. Kinks close to each other then get separate runs.
            chosen = select_dispersed(places / NARROW, large, MOST_AT_KINKS)[: runs.left] * NARROW
            if not takes_few or not self._check_secants(union, *self._unseen(union), chosen):
                break
        return None

    def _unseen(self, union: _Union) -> tuple[Array, Array]:
        """Places (2, n_t, n_y, 1) of extremes by secants, and their distance beyond runs and the range."""
        (places, beyond), (lowest, highest) = self._secant_extremes(), self._runs.extremes
        foreseen = np.maximum(np.stack([lowest - union.lower, union.upper - highest]), 0.0)
        return places, np.maximum(beyond - foreseen, 0.0)

    def _check_secants(self, union: _Union, places: Array, unseen: Array, chosen: Array) -> int:
        """Run chosen points, store the attained fraction of secant predictions, and return the number of new runs."""
        runs = self._runs
        lower, upper = np.minimum(runs.extremes[0], union.lower), np.maximum(runs.extremes[1], union.upper)
        points, _ = runs.check(chosen)
        gains = np.maximum(np.stack([lower - runs.extremes[0], runs.extremes[1] - upper]), 0.0)
        is_run = (np.abs(places - points[:, 0]) < SAME).any(axis=-1)
        is_run &= unseen > self._tolerance / 2 * self._widths
        share = np.divide(gains, unseen, out=np.zeros_like(gains), where=is_run).max(axis=(0, 1))
        self._share_of_secants = np.clip(share, self._share_of_secants, 1.0)
        return len(points)

    def _secant_extremes(self) -> tuple[Array, Array]:
        """Places of possible extremes at kinks, from secants through all runs, and their distance beyond the runs."""
        runs, ok, (number, known) = self._runs, self._runs.is_attained, self._secants
        if number != len(runs):
            points = np.concatenate([runs.places[ok], runs.points])
            known = secant_extremes(points, np.concatenate([runs.nodes[ok], runs.checks]), runs.noise)
            self._secants = len(runs), known  # they take longer than the runs of small scenes
        return known

    def _probes(self, number: int) -> Array:
        """Check points: the requested points, and `number` others. With corners, the others are close to corners."""
        d = len(self._runs.box)
        n_even = self._runs.probes + (number if d == 1 else 0)  # kinks may be anywhere
        points = np.concatenate([evenly_spread_points(n_even, d), quasi_random_points(number if d > 1 else 0, d)])
        return points[: self._runs.left]

    def refined(self) -> "Refinement":
        """The grids after the chosen piece was refined or halved, or after the noise was measured."""
        runs, old = self._runs, self._chosen
        # Noise looks rough, so it is measured before a piece is halved.
        is_worth_it = old.rough_direction is not None or self._cost() >= 3 * NOISE_RUNS or len(runs) >= CHEAP_RUNS
        if not runs.noise_is_known and is_worth_it:
            runs.measure_noise()
            self._pieces = [replace(piece, widths=self._widths) for piece in self._pieces]  # errors change too
        else:
            self._pieces = [piece for piece in self._pieces if piece is not old] + old.replaced(
                self._parts, self._widths
            )
        self._chosen = self._pieces[0]  # pieces are large
        return self

    def _chooses(self, piece: Piece, most: int | None = None) -> bool:
        """Choose this piece for refinement if it can be refined, and if enough runs are left for the new nodes."""
        runs, self._chosen, self._parts = self._runs, piece, piece.refined_parts()
        if not self._parts or runs.clock.is_late:
            return False
        cost = self._cost()
        return runs.suffice(cost) and (most is None or cost <= most)

    @property
    def _widths(self) -> Array:
        """Widths (n_y,) by which errors are measured; infinite for outputs that are ignored."""
        return np.where(self._counts, self._runs.rms_widths(), np.inf)

    def count_only(self, which: Mask) -> None:
        """Refine only the outputs of a mask (n_y,) from now on, because the other outputs are known."""
        self._counts = which
        self._pieces = [replace(piece, widths=self._widths) for piece in self._pieces]
        self._chosen, self._parts = self._pieces[0], []

    @property
    def is_costly(self) -> bool:
        """Whether the next step takes too many runs, such as halves along three parameters and large grids.

        For two parameters, this applies to kinks only. Pieces resolve jumps and moving fronts better than searches.
        """
        d, is_rough = len(self._runs.box), self._chosen.rough_direction is not None
        if d < 3:
            return d == 2 and is_rough and len(self._parts) == 1
        return is_rough or self._cost() > PATIENCE * d

    def _cost(self) -> int:
        """Number of nodes of the next parts that were not run yet."""
        return self._runs.unknown(np.concatenate([nodes_of(part) for part in self._parts]))

    def _check(self, union: _Union, worst: Piece) -> tuple[Array, Piece]:
        """Make check runs at some of the extremes, and at quasi-random points.

        Let the estimate of a piece be E(x) at a run with the error e. At a place with the estimate E, the error is then
        taken as e E / E(x). The method returns the error (n_t, n_y) from check runs, and the piece with the largest
        error; without check runs, the worst piece.
        """
        runs, widths = self._runs, self._widths
        n_known, d = len(runs.points), len(runs.box)
        probes = self._probes(PROBES)
        runs.check(probes)
        if len(union.pieces) == 1 and d > 2 and runs.shape[0] <= FEW_TIMES:  # a bump may be between the nodes
            runs.check(evenly_spread_points(len(runs) // SPREAD_SHARE, d)[: runs.left])
        for _ in range(2 if d == 1 else 1):
            places, weights = union.places, union.checkable_error
            if d == 1:  # a response may have kinks
                at_kinks, unseen = self._unseen(union)
                places = np.concatenate([places, at_kinks])
                weights = np.concatenate([weights, np.where(unseen > self._tolerance / 2 * widths, unseen, 0.0)])
            chosen = select_dispersed(places, weights / widths, 2 * d)[: runs.left]
            if d == 1:
                self._check_secants(union, at_kinks, unseen, chosen)
            else:
                runs.check(chosen)
        squares, largest = np.zeros(runs.shape), -1.0
        rows = np.arange(len(runs.points))
        if len(union.pieces) > 1:  # near a jump, earlier check runs do not measure errors of the new pieces
            rows = rows[(rows < len(probes)) | (rows >= n_known)]
        distances = [(np.abs(runs.points[rows] - piece.centre) / piece.half).max(axis=1) for piece in union.pieces]
        home = np.argmin(distances, axis=0)  # the first piece that holds a point
        for k, piece in enumerate(union.pieces):
            own = rows[home == k]
            points, errors = runs.points[own], piece.observed_errors(runs.points[own], runs.checks[own])
            largest_expected = piece.errors.max(axis=0)
            for point, error in zip(points, np.maximum(np.square(errors) - np.square(runs.noise), 0.0), strict=True):
                expected = piece.expected_error(point[None, None])
                ratio = np.divide(largest_expected, expected, out=np.ones_like(expected), where=expected > 0)
                squares = np.maximum(squares, error * np.square(ratio))
                if len(union.pieces) > 1 and (observed := relative_rms(np.sqrt(error), widths)) > largest:
                    largest, worst = observed, piece
        return inflated_error(squares), worst


def _grids(union: _Union) -> str:
    n = len(union.pieces)
    return "tensor grid" if n == 1 else f"{n} tensor grids"


def _stacked(arrays: Sequence[Array]) -> Array:
    """The concatenated arrays. A single array is not copied."""
    return np.stack(arrays) if len(arrays) > 1 else arrays[0][None]


def _select(alternatives: np.ndarray, numbers: Indices) -> np.ndarray:
    """At each place, one of k alternatives (k, ...), by its number at this place."""
    if len(alternatives) == 1:
        return alternatives[0]
    return np.take_along_axis(alternatives, numbers[None], axis=0)[0]
