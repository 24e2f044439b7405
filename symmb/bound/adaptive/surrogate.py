"""The range of a surrogate of the responses over the box."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from symmb._types import Array, Mask
from symmb.bound.adaptive.evidence import Evidence
from symmb.bound.polynomials.ranges import Piecewise, joined


class EstimatedRange(NamedTuple):
    """Range of a surrogate (n_t, n_y), the evidence of its error, and polynomials that approximate the surrogate.

    A call of `polynomials` makes the polynomials. The polynomials need as much memory as the runs, which can then be
    deleted. `places` (2, n_t, n_y, d) are the places of minima and maxima, if known. `is_enough` states whether the
    tolerance is reached. `surrogate` is the name of the surrogate. `whole` is the range of all outputs, of which this
    range is one.
    """

    lower: Array
    upper: Array
    evidence: Evidence
    polynomials: Callable[[], Piecewise | None] | None
    surrogate: str
    places: Array | None = None
    is_enough: bool = False
    whole: "EstimatedRange | None" = None

    @property
    def estimate(self) -> Array:
        """The estimated error (n_t, n_y)."""
        return self.evidence.error

    def columns(self, which: Mask) -> dict[int, "EstimatedRange"]:
        """The ranges (n_t, 1) of the outputs of a mask (n_y,), by their indices."""
        return {k: self._column(k) for k in np.flatnonzero(which).tolist()}

    def _column(self, k: int) -> "EstimatedRange":
        polynomials, own = self.polynomials, slice(k, k + 1)

        def of_column() -> Piecewise | None:
            every = polynomials() if polynomials else None
            return every and every.part(slice(None), own)

        places = None if self.places is None else self.places[:, :, own]
        evidence = self.evidence.column(k)
        return self._replace(
            lower=self.lower[:, own],
            upper=self.upper[:, own],
            evidence=evidence,
            polynomials=of_column,
            places=places,
            whole=self,
        )

    @classmethod
    def joined(cls, found: Sequence["EstimatedRange"], n_t: int, d: int) -> "EstimatedRange":
        """The range of all outputs over d parameters, from the range of each output."""
        wholes = [each.whole for each in found]
        if wholes[0] is not None and all(each is wholes[0] for each in wholes):
            return wholes[0]
        places = [np.zeros((2, *each.lower.shape, d)) if each.places is None else each.places for each in found]

        def every() -> Piecewise | None:
            for whole in filter(None, wholes):
                # Interpolants on parts of the box are for all outputs. They are known to more runs than others.
                if whole.polynomials and (own := whole.polynomials()) and len(own.expansions) > 1:
                    return own
            return joined([each.polynomials and each.polynomials() for each in found], n_t)

        return cls(
            _together([each.lower for each in found], n_t, 1),
            _together([each.upper for each in found], n_t, 1),
            Evidence.joined([each.evidence for each in found], n_t),
            every,
            ", ".join(dict.fromkeys(each.surrogate for each in found)),
            _together(places, n_t, 2),
            is_enough=all(each.is_enough for each in found),
        )


def _together(arrays: Sequence[Array], n_t: int, axis: int) -> Array:
    """Arrays joined along the axis of outputs. The axis of times before it has length n_t, or 1 for a scalar output."""
    return np.concatenate([np.broadcast_to(a, (*a.shape[: axis - 1], n_t, *a.shape[axis:])) for a in arrays], axis=axis)
