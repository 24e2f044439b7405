"""The range of a surrogate of the responses over the box, and the evidence of its error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.bound.polynomials.ranges import Piecewise, joined
from symmb.bound.responses import RULES

_NUMBERS = {name: k for k, name in enumerate(RULES)}


@dataclass(frozen=True, eq=False)
class Evidence:
    """Estimated errors, and the number of the rule that decides each of them.

    Attributes
    ----------
    error : (n_t, n_y)      at least 0
    rule : (n_t, n_y)       positions in RULES of `bounds.trace`
    """

    error: Array
    rule: Indices

    @classmethod
    def of(cls, rule: str, error: Array) -> "Evidence":
        """Errors that one rule decides."""
        return cls(error, np.full(error.shape, _NUMBERS[rule], dtype=np.intp))

    @classmethod
    def joined(cls, parts: Sequence["Evidence"], n_t: int) -> "Evidence":
        """The evidence of outputs side by side. Scalar outputs have one time."""
        shape = n_t, 1
        errors, rules = zip(
            *((np.broadcast_to(e.error, shape), np.broadcast_to(e.rule, shape)) for e in parts), strict=True
        )
        return cls(np.concatenate(errors, axis=1), np.concatenate(rules, axis=1))

    def at_least(self, rule: str, error: Array | float) -> "Evidence":
        """Errors that are at least those of another rule."""
        return self._where(self.error < error, rule, error)

    def at_most(self, rule: str, error: Array | float) -> "Evidence":
        """Errors that are at most those of another rule."""
        return self._where(self.error > error, rule, error)

    def _where(self, is_other: Mask, rule: str, error: Array | float) -> "Evidence":
        rules = self.rule.copy()
        rules[is_other] = _NUMBERS[rule]
        return Evidence(np.where(is_other, error, self.error), rules)

    def limited(self, most: Array) -> "Evidence":
        """Errors that are at most (n_t, n_y), by the same rules."""
        return Evidence(np.minimum(self.error, most), self.rule)

    def plus(self, rule: str, error: Array) -> "Evidence":
        """Errors that are larger by those of another rule, which decides if its errors are the larger part."""
        return Evidence(self.error + error, self._where(self.error < error, rule, error).rule)

    def attributed(self, which: Mask, rule: str) -> "Evidence":
        """The same errors, which another rule decides where a mask (n_t, n_y) is True."""
        return self._where(which, rule, self.error)

    def replaced(self, which: Mask, other: "Evidence") -> "Evidence":
        """The other evidence where a mask (n_t, n_y) or (n_y,) is True."""
        return Evidence(np.where(which, other.error, self.error), np.where(which, other.rule, self.rule))

    def column(self, k: int) -> "Evidence":
        """The evidence (n_t, 1) of one output."""
        return Evidence(self.error[:, k : k + 1], self.rule[:, k : k + 1])

    def decisive(self, output: int = 0) -> str:
        """The name of the rule that decides the largest error of an output."""
        return (*RULES,)[self.rule[self.error[:, output].argmax(), output]]


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
