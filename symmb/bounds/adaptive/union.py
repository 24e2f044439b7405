"""All pieces of the box together: their range, and the errors of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices
from symmb.bounds.adaptive.constants import TRUST
from symmb.bounds.adaptive.piece import Piece


@dataclass(frozen=True, eq=False)
class Union:
    """The range of all pieces.

    Attributes
    ----------
    lower, upper : (n_t, n_y) range
    places : (2, n_t, n_y, d) of its minima and maxima
    errors : (k, n_t, n_y) how far each piece may exceed the range
    checkable_error : (2, n_t, n_y) the part of the errors that runs at the places can show: none at nodes
    trust : (n_t, n_y) least share of the largest error that check runs leave; 1 where it comes from events
    """

    pieces: list[Piece]
    lower: Array
    upper: Array
    places: Array
    errors: Array
    checkable_error: Array
    trust: Array

    @classmethod
    def of(cls, pieces: list[Piece]) -> "Union":
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

    def piece_at(self, point: Array) -> Piece:
        """A piece that holds the point."""
        return min(self.pieces, key=lambda piece: float((np.abs(point - piece.centre) / piece.half).max()))


def _stacked(arrays: Sequence[Array]) -> Array:
    """The arrays as one; a single one is not copied."""
    return np.stack(arrays) if len(arrays) > 1 else arrays[0][None]


def _select(alternatives: np.ndarray, numbers: Indices) -> np.ndarray:
    """At each place, the one of k alternatives (k, ...) with the number there."""
    if len(alternatives) == 1:
        return alternatives[0]
    return np.take_along_axis(alternatives, numbers[None], axis=0)[0]
