"""Deviation of bounds from a reference: error, over, under and coverage, one number for each output.

All numbers are relative to the width of the reference. For outputs without width, see `zero_width`.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from symmb._magnitudes import SAME, SLIGHT
from symmb._types import Array


@dataclass(frozen=True)
class Score:
    """Deviation of one method's bounds from the reference. Each entry is (n_y,).

    Attributes
    ----------
    error : (n_y,)          rms over time of the deviations of both bounds, divided by the rms of the width
    outer_error : (n_y,)    error of the outer bounds
    over : (n_y,)           mean distance of the bounds outside of the reference, divided by the mean width
    under : (n_y,)          mean distance of the bounds inside of the reference, divided by the mean width
    coverage : (n_y,)       fraction of times at which the outer bounds contain the reference
    """

    error: Array
    outer_error: Array
    over: Array
    under: Array
    coverage: Array


@dataclass(frozen=True)
class Yardstick:
    """The reference bounds and their uncertainty. `score` compares bounds with the reference.

    Parameters
    ----------
    lower, upper : (n_t, n_y)   reference bounds, in the outputs' units
    uncertainty : (n_y,)        in the norm of `Score.error`; nan if not known
    noise : (n_y,) or None      errors of runs, in the outputs' units; None if not known

    Examples
    --------
    >>> yardstick = Yardstick(np.zeros((3, 1)), np.ones((3, 1)), np.zeros(1))
    >>> score = yardstick.score(np.full((3, 1), -0.1), np.full((3, 1), 0.8))
    >>> print(score.over, score.under, score.error.round(3))
    [0.1] [0.2] [0.158]
    """

    lower: Array
    upper: Array
    uncertainty: Array
    noise: Array | None = None

    @property
    def zero_width(self) -> npt.NDArray[np.bool_]:
        """(n_y,) True if the output is the same at all points of the box. Its errors are absolute."""
        return _largest(self._width) <= self._negligible

    def relative(self, deviation: Array) -> Array:
        """Rms (n_y,) of deviations (..., n_y), divided by the rms of the reference's width.

        If an output has no width, deviations up to 1e-9 of its scale are 0, and larger deviations are absolute.
        """
        return _rms(self._counted(deviation)) / self._unit(_rms(self._width))

    def deviation(self, lower: Array, upper: Array) -> Array:
        """Error (n_y,) of the bounds lower, upper (n_t, n_y), in the norm of `Score.error`."""
        return self.relative(np.stack([_minus(lower, self.lower), _minus(upper, self.upper)]))

    def score(self, lower: Array, upper: Array, estimate: Array | None = None) -> Score:
        """Measure bounds lower, upper (n_t, n_y); `estimate` (n_t, n_y) gives the outer bounds."""
        outer_lower = lower if estimate is None else lower - estimate
        outer_upper = upper if estimate is None else upper + estimate
        outward = np.stack([self._counted(_minus(self.lower, lower)), self._counted(_minus(upper, self.upper))])
        tolerance = self._tolerance()
        inside = (outer_lower <= self.lower + tolerance) & (outer_upper >= self.upper - tolerance)
        return Score(
            error=self.deviation(lower, upper),
            outer_error=self.deviation(outer_lower, outer_upper),
            over=self._share(np.maximum(outward, 0.0)),
            under=self._share(np.maximum(-outward, 0.0)),
            coverage=inside.mean(axis=0),
        )

    @property
    def _width(self) -> Array:
        """The width (n_t, n_y); 0 if an end is infinite, because an event never happens in some runs."""
        return np.where(np.isinf(self.lower) | np.isinf(self.upper), 0.0, _minus(self.upper, self.lower))

    @property
    def slack(self) -> Array:
        """Largest deviations (n_y,) that count as zero, in the outputs' units."""
        return np.maximum(self._tolerance(), self._negligible)

    @property
    def _negligible(self) -> Array:
        scale = np.maximum(_largest(self.lower), _largest(self.upper))
        # An output counts as zero if its largest value is smaller than this multiple of the noise of runs.
        noise = 10.0 * (np.zeros(len(scale)) if self.noise is None else self.noise)
        return np.where(scale <= noise, noise, SAME * scale)

    def _unit(self, size: Array) -> Array:
        """Divisor of deviations; 1 for outputs without width."""
        return np.where(self.zero_width, 1.0, size)

    def _counted(self, deviation: Array) -> Array:
        """The deviations (..., n_y), with 0 for rounding in an output without width."""
        return np.where(self.zero_width & (np.abs(deviation) <= self._negligible), 0.0, deviation)

    def _share(self, amounts: Array) -> Array:
        """Mean over time of the sum of amounts (2, n_t, n_y) at both bounds, divided by the mean width."""
        return amounts.sum(axis=0).mean(axis=0) / self._unit(self._width.mean(axis=0))

    def _tolerance(self) -> Array:
        width = self._width
        known = np.where(np.isnan(self.uncertainty), 0.0, self.uncertainty)
        uncertainty = known * self._unit(_rms(width))
        share = np.maximum(SLIGHT * _largest(width), uncertainty)  # allowed distance outside of bounds
        return np.where(self.zero_width, np.maximum(share, self._negligible), share)


def _minus(a: Array, b: Array) -> Array:
    """The difference a - b; 0 if both are infinite."""
    return np.subtract(a, b, out=np.zeros(np.shape(a)), where=a != b)


def _largest(values: Array) -> Array:
    return np.abs(values).max(axis=tuple(range(values.ndim - 1)), initial=0.0, where=np.isfinite(values))


def _rms(values: Array) -> Array:
    """Root mean square (n_y,). Values are scaled by powers of two, so squares neither overflow nor underflow."""
    power = np.frexp(_largest(values))[1]
    return np.ldexp(np.sqrt(np.square(np.ldexp(values, -power)).mean(axis=tuple(range(values.ndim - 1)))), power)
