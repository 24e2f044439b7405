"""Responses over a box, from polynomials, or from runs if polynomials are not accurate enough."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from symmb._errors import PropagationError
from symmb._options import require_name
from symmb._types import Array, Mask
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses.time_windows import is_doubtful
from symmb.equations.model import Box
from symmb.run.formulations import CardEnsemble

GOOD = 0.25
"""Largest error of usable polynomials, divided by the widths. The results contain this error."""
FINE = 0.02
"""Largest error of polynomials, divided by the widths, in answers that state no error, such as means and samples."""


class RunsUsedUpError(PropagationError):
    """An answer needs more further runs than are allowed."""


class Runs(Protocol):
    """Functions for further runs: ranges, values, reductions, samples, and bounds by PolynomialChaos().

    `allowing` is a context in which at most a number of runs are made. `left` is the number of runs left.
    """

    def allowing(self, runs: float) -> AbstractContextManager[None]: ...

    @property
    def left(self) -> float: ...

    def range(self, box: Box, label: str, studies: int) -> tuple[Array, Array, Array, int]: ...

    def attempted(self, points: Array) -> tuple[Array, tuple[Any, ...]]: ...

    def of_output(self, k: int, points: Array) -> tuple[Array, int]: ...

    def values(self, points: Array) -> Array: ...

    def reduced(self, points: Array, reduce: Callable[[CardEnsemble], Any]) -> Any: ...

    @property
    def on_card(self) -> bool: ...

    @property
    def has_lanes(self) -> bool: ...

    @property
    def adaptive(self) -> Any: ...

    @property
    def nominal(self) -> tuple[Array | None, Array | None]: ...

    def extremes(self, names: tuple[str, ...], points: Array) -> Array: ...

    def at_many_times(self, place: Array) -> tuple[Array, Array]: ...

    def sample(self, n: int) -> tuple[Array, Array]: ...


@dataclass(frozen=True, eq=False)
class Responses:
    """Responses over a box.

    Attributes
    ----------
    t : (n_t,)                 times [s]
    names, units : n_y outputs and their units; units may be empty
    box : Box
    nominal : (d,)             nominal parameters in the unit box, or the closest point of this box
    lower, upper : (n_t, n_y)  bounds of the outputs
    estimate : (n_t, n_y)      estimated error of the bounds
    floor : (n_y,)             errors that are noise or rounding
    surrogate : Piecewise      None if there is none
    is_good : (n_y,)           mask of outputs with a good enough surrogate; all outputs if no runs can be made
    runs : Runs                None if no runs can be made
    method : str               method of the surrogate
    extra_runs : int           number of further runs for the surrogate
    remarks : sentences        further information
    """

    t: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    box: Box
    nominal: Array
    lower: Array
    upper: Array
    estimate: Array
    floor: Array
    surrogate: Piecewise | None
    is_good: Mask
    runs: Runs | None
    method: str
    extra_runs: int
    remarks: tuple[str, ...]

    def column(self, owner: str, output: object) -> int:
        """Number of an output."""
        return self.names.index(require_name(owner, "output", output, self.names))

    def own(self, k: int) -> Piecewise | None:
        """The accurate polynomials of output k only."""
        return self.surrogate.part(slice(None), [k]) if self.surrogate is not None and self.is_good[k] else None

    def by_runs(self, points: Array, k: int) -> Array:
        """Values (N, n_t) of output k by runs at points (N, d)."""
        assert self.runs is not None
        return self.runs.values(points)[:, :, k]

    def are_good(self, error: Array, columns: Sequence[int], share: float = GOOD) -> Mask:
        """Mask of outputs with an error (n_t, n) of polynomials below a share of the width, or with only noise."""
        lower, upper, floor = self.lower[:, columns], self.upper[:, columns], self.floor[[*columns]]
        power = np.frexp(np.abs([lower, upper]).max(axis=(0, 1), initial=0.0))[1]  # squares may overflow
        error, lower, upper, floor = (np.ldexp(each, -power) for each in (error, lower, upper, floor))
        return np.logical_not(is_doubtful(error, upper - lower, floor, share).any(axis=0))

    def range(self, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
        """Bounds (n_t, n_y) by the polynomials over a part of the unit box, and their error (n_t, n_y).

        Bounds are nan for outputs without accurate polynomials. Parameters with equal ends are fixed.
        """
        low, high, error = np.full((3, *self.lower.shape), np.nan)
        if self.surrogate is not None and self.is_good.any():
            good = np.flatnonzero(self.is_good).tolist()
            own = self.surrogate.part(slice(None), good)
            low[:, good], high[:, good], _ = own.range(lower, upper)
            error[:, good] = own.error
        return np.maximum(low, self.lower), np.minimum(high, self.upper), error

    def range_by_runs(self, free: Mask, label: str, studies: int) -> tuple[Array, Array, Array, int]:
        """The range of a study, its error and number of runs. Only `free` parameters (mask, (d,)) vary.

        It is the first of several `studies`, which use equal parts of the runs that are left.
        """
        assert self.runs is not None
        if not free.any():
            value = self.runs.values(self.nominal[None])[0]
            return value, value, np.zeros_like(value), 1
        fixed, own = self.box.from_unit(self.nominal).tolist(), zip(self.box.names, self.box.bounds, free, strict=True)
        part = {name: ends if is_free else (x, x) for (name, ends, is_free), x in zip(own, fixed, strict=True)}
        return self.runs.range(Box(**part), label, studies)
