"""Bounds from recorded runs: sparse polynomials, their ranges, and errors from runs that were left out."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import ROUNDING, SAME
from symmb._names import ByName, counted
from symmb._types import Array, Mask
from symmb._units import units_of_parameters
from symmb.bound.answers import Bounds
from symmb.bound.nodes import GROUPS, SparseFit, Terms
from symmb.bound.polynomials import Expansion, TotalDegree, basis_values, in_other_coordinates, with_fixed, with_lower
from symmb.bound.polynomials.ranges import Piecewise, joined
from symmb.bound.responses import DOUBTFUL, failed_region, failure_records, failure_text, gathered, parameter_columns
from symmb.connect import RecordedRuns, note_attained
from symmb.equations.model import Box

_FEWEST = 2 * GROUPS
"""Smallest number of different runs. Each group then contains two runs."""
_SAFETY_OF_OTHERS, _SAFETY_OF_REST = 1.5, 3.0
"""Factors of the two parts of an error. With smaller factors, errors are above their estimate more often.
tests/methods/test_recorded_runs.py"""
_FILLED = 0.01
"""Smallest eigenvalue of the Gram matrix of Legendre polynomials up to degree two over the runs. It is 1 for many
evenly spread runs, and 0 if a square or a product cannot be known, such as for runs along the axes or at corners."""
_HOPELESS = 2.0
"""Estimated error divided by the width of the runs above which polynomials are no better than the runs, for example at
steps and narrow peaks."""


def recorded_bounds(text: str, simulator: RecordedRuns, box: Box) -> Bounds:
    """Bounds over a box by sparse polynomials through all recorded runs.

    The estimated error of a bound has two parts. The first is the largest difference of polynomials that do not know
    some runs, at the place of the bound. The second is the half width times the ratio of the left-out residuals to the
    standard deviation of the runs, and times the square root of the number of parameters. In corners, far from all
    runs, unknown terms of all parameters add up. If the error is far above the width of the runs, the extremes of the
    runs are the bounds.
    """
    ok = simulator.ok
    bad = gathered(simulator, simulator.X[~ok], None)[1] if not ok.all() else ()
    failed = failure_records(simulator, box, simulator.X[~ok], bad)
    points, Y = _different(simulator.X[ok], simulator.Y[ok])
    if len(points) < _FEWEST:
        reasons = f"\n{failure_text(failed)}" if failed else ""
        raise PropagationError(
            f"{text}: polynomials need at least {_FEWEST} different runs that did not fail, got {len(points)}.{reasons}"
        )
    region = _Region.of(simulator, box, points)
    inside = ok & region.contains(simulator.X)
    lowest, highest = simulator.Y[inside].min(axis=0, initial=np.inf), simulator.Y[inside].max(axis=0, initial=-np.inf)
    if inside.any():
        note_attained(lowest, highest, simulator.X[inside], simulator.Y[inside])
    outputs = [_OutputRange(region, points, Y[:, :, k]) for k in range(Y.shape[2])]
    surrogate = joined([output.polynomials for output in outputs], len(simulator.times))
    assert surrogate is not None
    lower, upper, estimate = np.stack([(own.lower, own.upper, own.estimate) for own in outputs], axis=2)
    if inside.any():
        is_open = 0.5 / _HOPELESS * estimate > 0.5 * highest - 0.5 * lowest  # the difference may overflow
        lower, upper = np.where(is_open, lowest, lower), np.where(is_open, highest, upper)
    remarks = list[str]()
    if box == simulator.box:
        remarks.append("The box is the smallest box that contains all recorded runs. Pass box=... for another box.")
    if outside := int((ok & ~inside).sum()):
        remarks.append(f"{counted(outside, 'run')} outside of the box also determined the polynomials.")
    return Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=np.minimum(lower, lowest),
        upper=np.maximum(upper, highest),
        kind="estimate",
        method=text,
        evaluations=len(simulator.X),
        estimate=np.maximum(estimate, np.maximum(lower - lowest, highest - upper)),
        inner=(lowest, highest) if inside.any() else None,
        failed=failed,
        failed_region=failed_region(simulator.box, simulator.box.to_unit(simulator.X), ~ok),
        run_doubts=region.doubts(simulator.X[ok]),
        remarks=tuple(remarks),
        surrogate=surrogate,
        expansion=surrogate.expansions[0],
        range_of="sparse polynomials through recorded runs",
        next_run=region.parameters_at(max(outputs, key=lambda own: own.gain).place),
    )


@dataclass(frozen=True, eq=False)
class _Region:
    """The box, and the coordinates of the fit. All runs and the box are in [-1, 1]^d.

    Attributes
    ----------
    low, high : (d,)           intervals of all parameters of the simulator; others than those of the box are fixed
    middle, radius : (d,)      coordinates are (p - middle) / radius for parameters p
    columns : parameters of the box among the d parameters
    varied : (d,)              mask of the parameters that vary in the runs
    """

    simulator: RecordedRuns
    box: Box
    low: Array
    high: Array
    middle: Array
    radius: Array
    columns: list[int]
    varied: Mask

    @classmethod
    def of(cls, simulator: RecordedRuns, box: Box, points: Array) -> "_Region":
        low, high = np.array([[*map(float, simulator.parameters.values())]] * 2)
        columns = parameter_columns(simulator, box)
        low[columns], high[columns] = box.lower, box.upper
        least, most = np.minimum(points.min(axis=0), low), np.maximum(points.max(axis=0), high)
        radius = np.where(most > least, 0.5 * (most - least), 1.0)
        varied = np.ptp(points, axis=0) > ROUNDING * np.abs(points).max(axis=0)
        return cls(simulator, box, low, high, least + 0.5 * (most - least), radius, columns, varied)

    def contains(self, X: Array) -> Mask:
        """Mask (N,) of the parameters (N, d) in the box, up to rounding."""
        slack = ROUNDING * np.abs(X).max(axis=0)
        return np.asarray(((X >= self.low - slack) & (X <= self.high + slack)).all(axis=1))

    def coordinates(self, X: Array) -> Array:
        """Coordinates (N, n_varied) of parameters (N, d)."""
        return ((X - self.middle) / self.radius)[:, self.varied]

    def coordinates_of(self, places: Array) -> Array:
        """Coordinates (N, n_varied) of places (N, len(box)) of the unit box."""
        X = np.tile(self.low, (len(places), 1))
        X[:, self.columns] = self.box.from_unit(places)
        return self.coordinates(X)

    def parameters_at(self, place: Array) -> ByName[float]:
        """The parameters at a place (len(box),) of the unit box."""
        own = self.simulator.parameters
        values = {name: float(value) for name, value in own.items()}
        inside = zip(self.box.names, self.box.from_unit(place[None])[0].tolist(), strict=True)
        return ByName({**values, **dict(inside)}, units_of_parameters(own))

    def expansion(self, terms: Terms) -> Expansion:
        """Polynomials of m responses as an expansion over the box, with coefficients (n_b, m, 1)."""
        (alpha, coefficients), d = terms, len(self.low)
        own = np.zeros((len(alpha), d), dtype=np.intp)
        own[:, self.varied] = alpha
        indices = sorted(with_lower(map(tuple, own.tolist())), key=lambda index: (sum(index), index))
        rows = {index: k for k, index in enumerate(indices)}
        c = np.zeros((len(indices), coefficients.shape[1]))
        c[[rows[tuple(index)] for index in own.tolist()]] = coefficients
        own, half = np.array(indices), 0.5 * (self.high - self.low)
        centre = (self.low + half - self.middle) / self.radius
        free = half > 0
        rest, c = with_fixed(own, c, ~free, centre[~free])
        own = np.zeros((len(rest), d), dtype=np.intp)
        own[:, free] = rest
        for i in np.flatnonzero(free).tolist():
            own, c = in_other_coordinates(own, c, i, float(centre[i]), float(half[i] / self.radius[i]))
        return Expansion(own[:, self.columns], c[:, :, None], self.box.names)

    def doubts(self, X: Array) -> tuple[str, ...]:
        """Warnings about intervals that are partly or entirely outside of the runs (N, d)."""
        doubts = list[str]()
        ends = self.low.tolist(), self.high.tolist(), X.min(axis=0).tolist(), X.max(axis=0).tolist()
        for name, low, high, least, most in zip(self.simulator.parameters, *ends, strict=True):
            if max(least - low, high - most) > max(DOUBTFUL * (high - low), SAME * max(abs(low), abs(high))):
                doubts.append(
                    f"The recorded runs have {name} from {least:.6g} to {most:.6g}, but the bounds are for {name} from "
                    f"{low:.6g} to {high:.6g}. The polynomials are not reliable outside of the runs."
                )
        return tuple(doubts) or self._gaps(self.coordinates(X))

    def _gaps(self, x: Array) -> tuple[str, ...]:
        """The warning about pairs of parameters whose runs (N, n_varied) do not show all effects up to degree two."""
        names = np.array([*self.simulator.parameters])[self.varied].tolist()
        alpha = TotalDegree().indices(2, 2)
        for i, j in itertools.combinations(range(len(names)), 2):
            V = basis_values(alpha, x[:, [i, j]]) * np.sqrt(2 * alpha + 1).prod(axis=1)
            if np.linalg.eigvalsh(V.T @ V / len(x))[0] < _FILLED:
                return (
                    f"The recorded runs do not fill the intervals of {names[i]} and {names[j]}, so that squares or "
                    "products of these parameters may be unknown. The bounds may be too narrow.",
                )
        return ()


class _OutputRange:
    """The range of one output over the box, from responses Y (N, n_t) of different runs (N, d).

    Attributes
    ----------
    polynomials : Piecewise
    lower, upper, estimate : (n_t,)    bounds and their estimated error
    place, gain : (len(box),), float   place of the most uncertain bound in the unit box; its error over the width
    """

    def __init__(self, region: _Region, points: Array, Y: Array) -> None:
        size = 2.0 ** (int(np.frexp(np.abs(Y).max())[1]) - 1)  # squares may overflow
        Y, one = Y / size, np.ones(len(region.columns))
        fit = SparseFit.through(region.coordinates(points), Y)
        polynomials = Piecewise.whole(region.expansion(fit.terms), fit.error[:, None])
        lower, upper, places = polynomials.range(-one, one)
        ends, places = np.stack([lower, upper])[..., 0], places[:, :, 0]
        at = [region.coordinates_of(place) for place in places]
        others = [[np.einsum("jb,bj->j", basis_values(alpha, x), c) for x in at] for alpha, c in fit.others]
        apart = np.abs(np.array(others) - ends).max(axis=0)
        half = 0.5 * (np.maximum(ends[1], Y.max(axis=0)) - np.minimum(ends[0], Y.min(axis=0)))
        deviation = Y.std(axis=0)
        rest = np.divide(fit.error, deviation, out=np.zeros_like(deviation), where=deviation > ROUNDING)
        estimate = _SAFETY_OF_OTHERS * apart.max(axis=0) + _SAFETY_OF_REST * region.varied.sum() ** 0.5 * rest * half
        estimate = np.where(estimate > ROUNDING * np.abs(Y).max(), estimate, 0.0)
        self.lower, self.upper, self.estimate = size * ends[0], size * ends[1], size * estimate
        own = polynomials.expansions[0]
        large = replace(own, coefficients=size * own.coefficients)
        self.polynomials = Piecewise.whole(large, size * fit.error[:, None])
        self.place = places[np.unravel_index(apart.argmax(), apart.shape)]
        self.gain = float(apart.max() / max(half.max(), ROUNDING * np.abs(Y).max(), 1e-300))


def _different(points: Array, Y: Array) -> tuple[Array, Array]:
    """Different rows of points (N, d), and the means of their responses (N, n_t, n_y)."""
    rows, which, counts = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    means = np.zeros((len(rows), *Y.shape[1:]))
    np.add.at(means, which.ravel(), Y / counts[which.ravel(), None, None])
    return rows, means
