"""The search for the largest or the cheapest tolerances with a given yield."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from symmb._errors import PropagationError
from symmb._names import normal_keys
from symmb._types import Array
from symmb.bound.answers import Bounds, Laws, laws_within, rejects_of
from symmb.bound.nodes import Sobol
from symmb.bound.polynomials.ranges import Piecewise
from symmb.study.tolerance_search import MAX_STUDIES, OWNER, SETTLED, Search

ERROR = 0.1
"""Error of rejects in the search, relative to 1 - yield. The yield is reached in spite of this error."""
_SAMPLES = 1024
"""Number of samples for the means and standard deviations that compare tolerances of different parameters."""


@dataclass(frozen=True)
class _Stretched:
    """A distribution whose deviations from a nominal value are multiplied by a factor."""

    law: Any
    nominal: float
    factor: float

    @property
    def dist(self) -> Any:
        return getattr(self.law, "dist", self.law)

    @property
    def args(self) -> tuple[float, ...]:
        return getattr(self.law, "args", ())

    @property
    def kwds(self) -> dict[str, float]:
        return {**getattr(self.law, "kwds", {}), "factor": self.factor}

    def cdf(self, x: Array) -> Array:
        return self.law.cdf(self.nominal + (x - self.nominal) / self.factor)

    def ppf(self, q: Array) -> Array:
        return self.nominal + self.factor * (self.law.ppf(q) - self.nominal)


class YieldSearch(Search):
    """A search whose limits are satisfied if the rejects and their error are at most 1 - yield.

    The distributions are stretched with the box. While costs are minimised, each limit has a margin of the same number
    of standard deviations. This number follows from the largest box with the yield in the direction of the last step.
    """

    def begin(self, yield_: float, laws: object) -> "YieldSearch":
        """Set the yield and the distributions in the given box."""
        shape = self._shape
        self.rejects, self._given = 1.0 - yield_, {} if laws is None else laws
        self.worst_case: Array | None = None
        full = Laws.of(OWNER, laws_within(OWNER, laws, shape), None, shape)
        self._points = np.tile(shape.to_unit(self._nominal), (_SAMPLES, 1))
        uniform = (Sobol().points(_SAMPLES, len(full.names), 0) + 1) / 2
        self._points[:, full.columns] = full.unit_points(uniform, shape)
        self._sigmas = -float(ndtri(self.rejects))
        return self

    def laws(self, factors: Array) -> dict[str, Any] | None:
        """The given distributions in the box with these factors (d,)."""
        if not isinstance(self._given, Mapping) or not self._given:
            return None
        ends, places = np.minimum(factors, self._most), {name: k for k, name in enumerate(self._shape.names)}
        given = [(name, law, places[str(name)]) for name, law in normal_keys(OWNER, self._given).items()]
        return {str(name): _Stretched(law, self._nominal[k], ends[k]) for name, law, k in given}

    def _share(self, factors: Array) -> tuple[Bounds | None, float]:
        """Bounds over the box with these factors, and the largest rejects; None and 1 if runs fail."""
        try:
            bounds = self._study(factors)
            responses = bounds._responses(OWNER)
            p, error, runs = rejects_of(OWNER, responses, self._limits, self.laws(factors), ERROR, self.rejects)
        except PropagationError:
            return None, 1.0
        self.evaluations += runs
        return bounds, p + error

    def largest(self, along: Array) -> tuple[Array, Bounds]:
        """The largest factors (d,) along a ray for which the box has the yield, and bounds over this box."""
        low, high, best, s, most = 0.0, np.inf, None, 1.0, self._most_along(along)
        aim = -float(ndtri(self.rejects))
        if self.worst_case is None:
            self.worst_case, best = super().largest(along)
            low = float((self.worst_case / along).max())
            self._calibrate(best)
            most, s = self._most_along(along), low * (min(max(self._sigmas / aim, 1.02), 4.0) if aim > 0 else 4.0)
        for _ in range(MAX_STUDIES):
            s = min(s, most)
            if low and min(s, high) <= low * (1 + 3 * SETTLED):
                break
            bounds, share = self._share(s * along)
            if share <= self.rejects:
                low, best = s, bounds
            else:
                high = s
            # Distances between mean and limit, in standard deviations, are about proportional to 1 / s.
            size = -float(ndtri(min(max(share, 1e-9), 1.0)))
            s *= min(max(size / aim * (1 - SETTLED), 0.5), 2.0) if aim > 0 else 1.5 if low == s else 0.67
            if not low < s < high:
                s = low + 0.5 * (high - low) if high < np.inf else 2 * low
        if best is None:
            raise PropagationError(f"{OWNER}: no box with the yield was found in {MAX_STUDIES} studies.")
        self.remarks = ()
        factors = np.minimum(low * along, self._most)
        if high > low * (1 + 8 * SETTLED) and low < most:
            self.remarks = ("Larger tolerances may also have the yield: the largest number of studies was reached.",)
        self._calibrate(best)
        return factors, best

    def _calibrate(self, bounds: Bounds) -> None:
        """Set the smallest distance of a mean from its limit over these bounds' box, in standard deviations."""
        surrogate = bounds.good_surrogate(self._columns)
        if surrogate is not None:
            distances, sigma = self._distances(surrogate.part(slice(None), self._columns), self._points)
            with np.errstate(divide="ignore", invalid="ignore"):
                self._sigmas = float(np.nanmin(np.where(sigma > 0, distances / sigma, np.inf)))

    def _distances(self, surrogate: Piecewise, points: Array) -> tuple[Array, Array]:
        """Distances of means from limits, and standard deviations, each (n_t, n_l)."""
        values = surrogate.values(points)
        mean = values.mean(axis=0)
        return self._margins(mean, mean), values.std(axis=0)

    def _margins_on(self, surrogate: Piecewise, wide: Array, factors: Array) -> Array:
        whole, part = self._box(wide), self._box(factors)
        distances, sigma = self._distances(surrogate, whole.to_unit(part.from_unit(self._points)))
        return distances - self._sigmas * sigma + self._shift
