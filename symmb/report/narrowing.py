"""How far tolerances have to be narrowed until polynomials keep limits."""

from collections.abc import Mapping, Sequence

import numpy as np

from symmb._types import Array
from symmb.bounds import KeptLimit
from symmb.model import Box
from symmb.polynomials.ranges import Piecewise

_STEPS, _SAFE = 8, 0.99
"""Bisections, and a factor that covers the rounding of tolerances that are told."""
Parts = Sequence[tuple[KeptLimit, Piecewise]]
"""Limits, with the polynomials of their outputs."""


class Narrowing:
    """Boxes in which intervals of some parameters are multiplied by a factor about the nominal values."""

    def __init__(self, box: Box, nominal: Mapping[str, float], parts: Parts) -> None:
        values = [nominal.get(name, middle) for name, middle in zip(box.names, box.center, strict=True)]
        self._box, self._nominal = box, np.clip(box.to_unit(np.array(values)), -1.0, 1.0)
        self._parts = list[tuple[KeptLimit, Piecewise]]()
        for limit, part in parts:  # times at which the whole box keeps the limit need no second look
            low, high = self._range(part, 1.0, ())
            rows = np.flatnonzero((low < limit.low) | (high > limit.high))
            self._parts += [(limit, part.part(rows, [0]))] if len(rows) else []

    def _range(self, part: Piecewise, factor: float, names: Sequence[str]) -> tuple[Array, Array]:
        """The range (n_t,) of polynomials over such a box, widened by their error."""
        low, high, _ = part.range(*self._ends(factor, names))
        return (low - part.error)[:, 0], (high + part.error)[:, 0]

    def _ends(self, factor: float, names: Sequence[str]) -> tuple[Array, Array]:
        low, high = (self._nominal + factor * (end - self._nominal) for end in (-1.0, 1.0))
        is_chosen = np.isin(self._box.names, names)
        return np.where(is_chosen, low, -1.0), np.where(is_chosen, high, 1.0)

    def _keeps(self, factor: float, names: Sequence[str]) -> bool:
        ranges = ((limit, self._range(part, factor, names)) for limit, part in self._parts)
        return all((low >= limit.low).all() and (high <= limit.high).all() for limit, (low, high) in ranges)

    def factor(self, names: Sequence[str]) -> float:
        """The largest factor at which the polynomials keep all limits by more than their error; 0 if none does."""
        if self._keeps(1.0, names) or not self._keeps(0.0, names):
            return float(self._keeps(1.0, names))
        low, high = 0.0, 1.0
        for _ in range(_STEPS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._keeps(middle, names) else (low, middle)
        return _SAFE * low

    def change(self, name: str, factor: float) -> str:
        """The tolerance of a parameter, and what a factor makes of it."""
        i, nominal = self._box.names.index(name), self._box.from_unit(self._nominal)
        old, new = ([self._box.from_unit(end)[i] for end in self._ends(f, [name])] for f in (1.0, factor))
        return f"{name} from {_tolerance(nominal[i], *old)} to {_tolerance(nominal[i], *new)}"


def _tolerance(nominal: float, low: float, high: float) -> str:
    """An interval as drawings tell it."""
    above, below = high - nominal + 0.0, nominal - low + 0.0
    is_even = abs(above - below) <= 1e-6 * (high - low)
    return f"{nominal:.6g} ± {above:.3g}" if is_even else f"{nominal:.6g} +{above:.3g} −{below:.3g}"
