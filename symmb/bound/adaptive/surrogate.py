"""The range of a surrogate of the responses over the box."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from symmb._types import Array, Mask
from symmb.bound.adaptive.evidence import Evidence
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import rms


class EstimatedRange(NamedTuple):
    """Range of a surrogate (n_t, n_y), the evidence of its error, and polynomials that approximate the surrogate.

    A call of `polynomials` makes the polynomials. The polynomials need as much memory as the runs, which can then be
    deleted. `places` (2, n_t, n_y, d) are the places of minima and maxima, if known. `is_enough` states whether the
    tolerance is reached. `surrogate` is the name of the surrogate.
    """

    lower: Array
    upper: Array
    evidence: Evidence
    polynomials: Callable[[], Piecewise | None] | None
    surrogate: str
    places: Array | None = None
    is_enough: bool = False

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

        return self._replace(
            lower=self.lower[:, own],
            upper=self.upper[:, own],
            evidence=self.evidence.column(k),
            polynomials=of_column,
            places=None if self.places is None else self.places[:, :, own],
        )

    def better(self, other: "EstimatedRange", widths: Array, tolerance: float) -> "EstimatedRange":
        """For each output, the range with the smaller relative error, and its polynomials. `widths` are (n_y,)."""
        own, its = (rms(each.estimate) / widths for each in (self, other))
        is_other = its < own
        if is_other.all():
            return other
        lower, upper = (np.where(is_other, b, a) for a, b in zip(self[:2], other[:2], strict=True))
        evidence = self.evidence.replaced(is_other, other.evidence)
        surrogate = f"{self.surrogate}, {other.surrogate}" if is_other.any() else self.surrogate
        is_enough = bool(np.minimum(own, its).max() <= tolerance)
        return self._replace(lower=lower, upper=upper, evidence=evidence, surrogate=surrogate, is_enough=is_enough)

    def with_known(self, known: Mapping[int, "EstimatedRange"]) -> "EstimatedRange":
        """The range, with known ranges (n_t, 1) of some outputs, by the indices of these outputs."""
        if not known:
            return self
        lower, upper, evidence = self.lower.copy(), self.upper.copy(), self.evidence
        for k, own in known.items():
            lower[:, [k]], upper[:, [k]] = own[:2]
            evidence = evidence.with_column(k, own.evidence)
        names = dict.fromkeys([*self.surrogate.split(", "), *(own.surrogate for own in known.values())])
        return self._replace(lower=lower, upper=upper, evidence=evidence, surrogate=", ".join(names))
