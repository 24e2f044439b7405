"""A part of the box with its own interpolant on a tensor grid, and the range of this interpolant."""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from symmb._limits import windows
from symmb._types import Array, Indices, Mask
from symmb.bound import adaptive
from symmb.bound.adaptive.check_points import inflated_error
from symmb.bound.adaptive.error_estimate import SMOOTH_DECAY, TruncationError, decay_ratios, event_errors
from symmb.bound.adaptive.runs import CHEAP_RUNS, Runs, relative_errors
from symmb.bound.nodes import Grid
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import HIGHEST_DEGREE, RANGE_ERROR, attained_extremes

REFINED_SHARE = 0.25
"""Directions are refined together if their error is at least this fraction of the largest error. Smaller fractions take
more runs and fewer rounds. The same fraction of the error is expected after a rough piece is halved along every
parameter."""
JUDGED_DEGREE = 16
"""Smallest degree for a decision on smoothness. For halves, the degree is doubled, because one half is usually rough.
With a smaller degree, smooth responses are divided. A larger degree takes more runs at kinks."""
OSCILLATING = 0.3
"""Largest part of the nodes of one parameter at which a response with a kink turns. Oscillations turn at more nodes."""
JUMP_SHARE = 0.35
"""Smallest change between two neighbours on a line of nodes, divided by all changes along the line, that is a jump."""
_DEGREES_OF_TAIL = 4
"""Number of last degrees that give the error at kinks, where coefficients decrease slowly. Larger numbers are safer."""

Part = tuple[Array, Array, Indices]
"""Centre and half width (d,) of a part of the box, and the degrees of an interpolant on this part."""


def nodes_of(part: Part) -> Array:
    """Nodes (N, d) of a part, in the unit box."""
    centre, half, degrees = part
    return centre + half * tensor_grid(*degrees.tolist()).nodes


def higher(degrees: Indices) -> Indices:
    """The next degree of 2, 4, 6, 8, 12, 16, 24, ..., up to the highest degree."""
    power = 1 << np.array([int(k).bit_length() - 1 for k in degrees])
    step = np.where(degrees > power, 2 * power - degrees, np.maximum(power // 2, 2))
    return np.minimum(degrees + step, HIGHEST_DEGREE)


@cache
def tensor_grid(*degrees: int) -> Grid:
    """The grid with all multi-indices up to some degrees."""
    grid = Grid(len(degrees))
    grid.add(grid.missing([degrees]))
    return grid


@dataclass(eq=False)
class Piece:
    """A part of the box with an interpolant.

    Attributes
    ----------
    centre, half : (d,) of the unit box
    expansion : in coordinates of the piece
    nodes : (N, d) in coordinates of the piece
    runs, rows : all runs, and the rows (N,) of the responses at the nodes
    widths : (n_y,) rms widths, the units of errors; infinite for outputs that are ignored
    inherited : (n_t, n_y) expected error at jumps of the response; None for the whole box
    """

    centre: Array
    half: Array
    expansion: Expansion
    nodes: Array
    runs: Runs
    rows: Indices
    widths: Array
    inherited: Array | None

    @classmethod
    def of(cls, runs: Runs, part: Part, widths: Array, parent: "Piece | None" = None) -> "Piece":
        """Run the new nodes. Failed nodes get the values that make the interpolant smoothest."""
        centre, half, degrees = part
        grid = tensor_grid(*degrees.tolist())
        rows = runs.at(centre + half * grid.nodes, parent and parent.values)
        lost = rows[~runs.is_attained[rows]]
        if 0 < len(lost) <= CHEAP_RUNS:  # more failures form a region
            runs.nodes[lost] += _smoothing(grid, runs.nodes, rows, lost)
        expansion = runs.interpolant(grid, rows)
        return cls(centre, half, expansion, grid.nodes, runs, rows, widths, parent and parent.inherited)

    @property
    def Y(self) -> Array:
        """Responses at the nodes (N, n_t, n_y)."""
        return self.runs.nodes[self.rows]

    @cached_property
    def truncation(self) -> TruncationError:
        """The estimated truncation error of the interpolant."""
        return TruncationError.of(self.expansion.alpha, self.expansion.coefficients, self.runs.noise)

    @cached_property
    def _direction_errors(self) -> Array:
        """The relative error (d,) that each direction causes."""
        return relative_errors(self.truncation.directions, self.widths).max(axis=1, initial=0.0)

    @cached_property
    def event_errors(self) -> Array | None:
        """Expected errors (d, n_t, n_y) if events happen between nodes, nan elsewhere; None without events."""
        if self.runs.events is None:
            return None
        degrees, (n_t, n_y) = self.expansion.alpha.max(axis=0), self.expansion.coefficients.shape[1:]
        errors = np.empty((len(degrees), n_t, n_y))
        Y, events = self.runs.nodes, self.runs.events
        for window in windows(n_t, n_y * len(self.rows)):
            errors[:, window] = event_errors(self.nodes, degrees, Y[self.rows, window], events[self.rows, window])
        return errors

    @cached_property
    def rough_direction(self) -> int | None:
        """The parameter with the largest error along which the response is not smooth; None if all are smooth."""
        largest = self._direction_errors.max()
        if self.event_errors is not None:
            errors = relative_errors(np.nan_to_num(self.event_errors), self.widths).max(axis=1, initial=0.0)
            if errors.max() >= largest:
                return int(errors.argmax())
        least = JUDGED_DEGREE if self.inherited is None else JUDGED_DEGREE // 2
        decay = decay_ratios(self.expansion, self.widths, least)
        rough = np.where(decay > SMOOTH_DECAY, self._direction_errors, 0.0)
        return int(rough.argmax()) if rough.max() >= REFINED_SHARE * largest > 0 else None

    def _is_halved(self) -> bool:
        """Whether the error comes from events or jumps; for one parameter, also from kinks.

        At a jump, most of the change along a line of nodes is between two neighbours. The change of an oscillation
        that is not resolved, and the change at a kink, are spread over more nodes. An oscillation has many turns. Parts
        of the box stay so.
        """
        if self.event_errors is not None or self.inherited is not None:
            return True
        if len(self.half) == 1:
            worst = (self.truncation.directions[0] / self.widths).argmax()
            y = self.Y.reshape(len(self.rows), -1)[self.nodes[:, 0].argsort(), worst]
            turns = np.diff(np.sign(np.diff(y))) != 0
            return bool(turns.sum() <= OSCILLATING * len(turns))
        order = np.lexsort(self.nodes.T[::-1])  # grids list nodes by degree; lines need the order of coordinates
        shape = (*(self.expansion.alpha.max(axis=0) + 1).tolist(), *self.expansion.coefficients.shape[1:])
        Y, axes = self.Y[order].reshape(shape), tuple(range(len(self.half) - 1))
        for k, error in enumerate(self._direction_errors):
            change = np.abs(np.diff(Y, axis=k))
            largest = change.max(axis=k)
            jumps = np.where(largest >= JUMP_SHARE * change.sum(axis=k), largest, 0.0).max(axis=axes)
            if (size := relative_errors(jumps, self.widths).max(initial=0.0)) > 0 and size >= error:
                return True
        return False

    @cached_property
    def jumps(self) -> Mask | None:
        """Mask (n_t, n_y) of jumps, where interpolants overshoot and values at nodes give the range; else None."""
        has_event = None if self.event_errors is None else np.isfinite(self.event_errors[0])
        if has_event is not None or self.inherited is None or self.rough_direction is None:
            return has_event
        large = self.truncation.directions >= REFINED_SHARE * self.truncation.directions.max(axis=0)
        return (self.truncation.slow & large).any(axis=0)

    @cached_property
    def range(self) -> tuple[Array, Array, Array]:
        """Minima and maxima (n_t, n_y), and their places (2, n_t, n_y, d) in the unit box."""
        alpha, c = self.expansion.alpha, self.expansion.coefficients
        lower, upper, *at = attained_extremes(alpha, c.reshape(len(alpha), -1))
        lower, upper = lower.reshape(c.shape[1:]), upper.reshape(c.shape[1:])
        places = np.stack(at).reshape(2, *lower.shape, -1)
        if self.jumps is not None:
            Y = self.Y
            lower, upper = np.where(self.jumps, Y.min(axis=0), lower), np.where(self.jumps, Y.max(axis=0), upper)
            nodes = np.stack([self.nodes[f(Y, axis=0)] for f in (np.argmin, np.argmax)])
            places = np.where(self.jumps[..., None], nodes, places)
        return lower, upper, self.centre + self.half * places

    @cached_property
    def errors(self) -> Array:
        """Expected errors (2, n_t, n_y) of the range."""
        return np.stack([self.expected_error(x) for x in self.range[2]])

    @property
    def checkable_error(self) -> Array:
        """The part of the errors (2, n_t, n_y) of the range that runs at its extremes can measure; 0 at nodes."""
        checkable = np.maximum(self.errors - self.truncation.least, 0.0)
        return checkable if self.jumps is None else np.where(self.jumps, 0.0, checkable)

    def expected_error(self, places: Array) -> Array:
        """Expected errors (..., n_t, n_y) at places (..., n_t, n_y, d), or at places (..., 1, 1, d) for all times."""
        smooth = self.truncation.at((places - self.centre) / self.half)
        if self.event_errors is not None:
            events = self.event_errors.sum(axis=0)
            return np.where(np.isnan(events), smooth, events)
        if self.jumps is None or self.inherited is None:
            return smooth
        return np.where(self.jumps, self.inherited, smooth)

    @property
    def largest_error(self) -> Array:
        """Expected error (n_t, n_y) at any point. At jumps, this error is the range of the values at nodes.

        Extremes are mostly at nodes, where errors are smaller. At other points, terms of higher degrees are expected to
        decrease with the same ratio as the last terms. At kinks, all of the last degrees give the error.
        """
        alpha, is_slow = self.expansion.alpha, self.truncation.slow.any(axis=0)
        highest = alpha.max(axis=0)
        error = self.truncation.directions.sum(axis=0) + self.truncation.least
        for of_direction, n in zip(alpha.T, highest, strict=True):
            before, last = (self._size(of_direction == n - k) for k in (1, 0))
            # Further terms with the ratio r of the last two have the sum r / (1 - r) times the last one.
            ratio = np.divide(last, before, out=np.ones_like(last), where=before > last)
            error = np.maximum(error, last * np.minimum(ratio / np.maximum(1 - ratio, ratio), 1.0))
        if is_slow.any():
            tail = self._size((alpha > np.maximum(highest - _DEGREES_OF_TAIL, highest / 2)).any(axis=1))
            error = np.where(is_slow, np.maximum(tail, error), error)
        return error if self.jumps is None else np.where(self.jumps, np.ptp(self.Y, axis=0), error)

    def _size(self, rows: Mask) -> Array:
        """Sum (n_t, n_y) of the sizes of some coefficients, the largest value of their terms."""
        return np.abs(self.expansion.coefficients[rows]).sum(axis=0)

    def values(self, points: Array) -> Array:
        """Interpolated responses (N, n_t, n_y) at points (N, d) of the box."""
        return self.expansion.values((points - self.centre) / self.half)

    def observed_errors(self, points: Array, Y: Array) -> Array:
        """Errors (C, n_t, n_y) of the interpolant at points (C, d) with runs Y; 0 if values at nodes are used."""
        errors = Y - self.values(points)
        return errors if self.event_errors is None else np.where(np.isnan(self.event_errors[0]), errors, 0.0)

    def refined_parts(self) -> list[Part]:
        """The part with higher degrees in the directions of large errors, or its halves if the response is rough.

        The result is empty if the degree or the size of the part is at its limit.
        """
        degrees = self.expansion.alpha.max(axis=0)
        rough = self.rough_direction
        if rough is None or not self._is_halved():
            is_large = self._direction_errors >= REFINED_SHARE * self._direction_errors.max()
            next_degrees = np.where(is_large, higher(degrees), degrees)
            return [(self.centre, self.half, next_degrees)] if (next_degrees > degrees).any() else []
        if self.half[rough] < RANGE_ERROR:  # narrower pieces do not change the range
            return []
        is_along = np.arange(len(degrees)) == rough
        half = np.where(is_along, self.half / 2, self.half)
        degrees = np.where(is_along, JUDGED_DEGREE // 2, degrees)
        return [(self.centre + sign * (self.half - half), half, degrees) for sign in (-1, 1)]

    def replaced(self, parts: list[Part], widths: Array) -> list["Piece"]:
        """Pieces for the parts. Each half inherits a fraction of this piece's error, or a larger measured error."""
        pieces = [Piece.of(self.runs, part, widths, self) for part in parts]
        if len(pieces) > 1:
            own, new = self.Y, np.concatenate([piece.Y for piece in pieces])
            excess = np.maximum(own.min(axis=0) - new.min(axis=0), new.max(axis=0) - own.max(axis=0))
            missed = inflated_error(np.square(np.maximum(excess, 0.0)))
            for piece in pieces:
                share = REFINED_SHARE ** (1 / len(self.half))  # for one halving of one parameter
                beside = adaptive.excess_beside_extremes(piece.nodes, piece.Y, self.runs.noise)
                piece.inherited = np.maximum(np.maximum(missed, beside), share * self.errors.max(axis=0))
        return pieces


def _smoothing(grid: Grid, Y: Array, rows: Indices, lost: Indices) -> Array:
    """Changes (k, n_t, n_y) of the values Y at missing rows that minimise the coefficients of high degree.

    Coefficients of smooth responses decrease by a constant factor per degree. Here the factor is 2.
    """
    weights = 2.0 ** np.minimum(grid.alpha.sum(axis=1), 40)[:, None]
    c = grid.coefficients(Y.reshape(len(Y), -1), rows=rows)
    of_lost = grid.coefficients((rows[:, None] == lost).astype(float))
    change = np.linalg.lstsq(weights * of_lost, -weights * c)[0]
    return change.reshape(-1, *Y.shape[1:])
