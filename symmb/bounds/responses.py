"""What questions about responses over a box are put to: a surrogate, or runs where none is good."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from symmb._options import require_name
from symmb._types import Array
from symmb.model import Box
from symmb.polynomials.ranges import Piecewise

FEWEST = 1e-12
"""Half width in the unit box below which a parameter is fixed."""


class Runs(Protocol):
    """Further runs: a range with its error and their number, values, and bounds by PolynomialChaos()."""

    def range(self, box: Box) -> tuple[Array, Array, Array, int]: ...

    def values(self, points: Array) -> Array: ...

    @property
    def adaptive(self) -> Any: ...

    @property
    def sample(self) -> tuple[Array, Array]: ...


@dataclass(frozen=True, eq=False)
class Responses:
    """Responses over a box.

    Attributes
    ----------
    t : (n_t,)                 times [s]
    names, units : n_y outputs and their units; units may be empty
    box : Box
    nominal : (d,)             nominal parameters in the unit box, or the closest point of it
    lower, upper : (n_t, n_y)  their bounds
    estimate : (n_t, n_y)      estimated error of these
    surrogate : Piecewise      None if none is good enough
    runs : Runs                None if no runs can be made
    method : str               where the surrogate comes from
    extra_runs : int           further runs that were made for it
    remarks : sentences        what else is known
    """

    t: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    box: Box
    nominal: Array
    lower: Array
    upper: Array
    estimate: Array
    surrogate: Piecewise | None
    runs: Runs | None
    method: str
    extra_runs: int
    remarks: tuple[str, ...]

    def column(self, owner: str, output: object) -> int:
        """Number of an output."""
        require_name(owner, "output", output, self.names)
        return self.names.index(str(output))

    def range(self, lower: Array, upper: Array) -> tuple[Array, Array, Array, int]:
        """Bounds (n_t, n_y) over a part of the unit box, their estimated error (n_t, n_y), and how many runs they took.

        Parameters with equal ends are fixed. The part must hold the nominal values of those that are fixed.
        """
        if self.surrogate is not None:
            low, high, _ = self.surrogate.range(lower, upper)
            return np.maximum(low, self.lower), np.minimum(high, self.upper), self.surrogate.error, 0
        assert self.runs is not None
        free = upper - lower > FEWEST
        low, high = self.box.from_unit(np.stack([lower, upper])).tolist()
        part = {name: (a, b) for name, a, b, is_free in zip(self.box.names, low, high, free, strict=True) if is_free}
        if not part:
            value = self.runs.values(self.nominal[None])[0]
            return value, value, np.zeros_like(value), 1
        return self.runs.range(Box(**part))
