"""Bounds from recorded runs: sparse polynomials, their ranges, and errors from runs that were left out."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from symmb._doubt import Doubt
from symmb._errors import PropagationError
from symmb._magnitudes import ROUNDING, SAME
from symmb._names import ByName, counted
from symmb._types import Array, Indices, Mask
from symmb._units import units_of_parameters
from symmb.bound.bounds.failures import failed_region, failure_text
from symmb.bound.bounds.method import parameter_columns
from symmb.bound.bounds.reductions import failure_records
from symmb.bound.bounds.result import Bounds
from symmb.bound.bounds.sparse_regression import GROUPS, SparseFit
from symmb.bound.bounds.time_windows import DOUBTFUL, rms
from symmb.bound.polynomials import Expansion, MultiIndices, in_other_coordinates, with_lower
from symmb.bound.polynomials.ranges import Piecewise, joined
from symmb.connect import RecordedRuns, note_attained
from symmb.equations.model import Box

_FEWEST = 2 * GROUPS
"""Smallest number of different runs. Each group then contains two runs."""
_SAFETY_OF_OTHERS, _SAFETY_OF_REST = 1.5, 3.0
"""Factors of the differences of polynomials without some runs at an extreme, and of the part that no polynomial
explains. For smaller factors, errors of bounds were above the estimate more often. tests/bounds/test_recorded_runs.py"""


def recorded_bounds(text: str, simulator: RecordedRuns, box: Box) -> Bounds:
    """Bounds over a box by sparse polynomials through all recorded runs.

    The estimated error of a bound has two parts. The first is the largest difference of polynomials that do not know
    some runs, at the place of the bound. The second is the half width times the ratio of the left-out residuals to the
    standard deviation of the runs. In corners, far from all runs, unknown terms add up as known terms do.
    """
    points, Y = _different(simulator.X[simulator.ok], simulator.Y[simulator.ok])
    failed = _failed(simulator, box)
    if len(points) < _FEWEST:
        raise PropagationError(
            f"{text}: {counted(len(points), 'different run')} did not fail, but polynomials need at least {_FEWEST}."
            + (f"\n{failure_text(failed)}" if failed else "")
        )
    inside = _is_inside(simulator, box) & simulator.ok
    lower, upper = np.full((2, *Y.shape[1:]), [[[np.inf]], [[-np.inf]]])
    if inside.any():
        lower, upper = simulator.Y[inside].min(axis=0), simulator.Y[inside].max(axis=0)
        note_attained(lower, upper, simulator.X[inside], simulator.Y[inside])
    frame = _Frame.of(simulator, box, points)
    fits = [_OutputRange(frame, points, Y[:, :, k]) for k in range(Y.shape[2])]
    surrogate = joined([fit.polynomials for fit in fits], len(simulator.times))
    assert surrogate is not None
    ends = [np.stack([getattr(fit, name) for fit in fits], axis=-1) for name in ("lower", "upper", "estimate")]
    bounds = Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=np.minimum(ends[0], lower),
        upper=np.maximum(ends[1], upper),
        kind="estimate",
        method=text,
        evaluations=len(simulator.X),
        estimate=np.maximum(ends[2], np.maximum(ends[0] - lower, upper - ends[1])),
        inner=(lower, upper) if inside.any() else None,
        failed=failed,
        failed_region=failed_region(simulator.box, simulator.box.to_unit(simulator.X), ~simulator.ok),
        run_doubts=_beyond_runs(simulator, box),
        remarks=_of_box(simulator, box, inside),
        surrogate=surrogate,
        expansion=surrogate.expansions[0],
        range_of="sparse polynomials through recorded runs",
        next_run=_next_run(simulator, box, fits),
    )
    return bounds


@dataclass(frozen=True, eq=False)
class _Frame:
    """The coordinates of the fit, and the box in them. All runs and the box are in [-1, 1]^d.

    Attributes
    ----------
    middle, radius : (d,)      coordinates are (p - middle) / radius for parameters p in the order of the simulator
    centre, half : (d,)        the box in these coordinates; parameters outside of the box are fixed, half is 0
    columns : parameters of the box among the d parameters
    varied : (d,)              mask of the parameters that vary in the runs
    names : names of the parameters of the box
    """

    middle: Array
    radius: Array
    centre: Array
    half: Array
    columns: list[int]
    varied: Mask
    names: tuple[str, ...]

    @classmethod
    def of(cls, simulator: RecordedRuns, box: Box, points: Array) -> "_Frame":
        columns = parameter_columns(simulator, box)
        low, high = _intervals(simulator, box)
        least, most = np.minimum(points.min(axis=0), low), np.maximum(points.max(axis=0), high)
        middle, radius = least + 0.5 * (most - least), 0.5 * (most - least)
        radius[radius == 0] = 1.0
        centre, half = (low + 0.5 * (high - low) - middle) / radius, 0.5 * (high - low) / radius
        varied = np.ptp(points, axis=0) > ROUNDING * np.abs(points).max(axis=0)
        return cls(middle, radius, centre, half, columns, varied, box.names)

    def at(self, points: Array) -> Array:
        """Coordinates (N, n_varied) of parameters (N, d)."""
        return ((points - self.middle) / self.radius)[:, self.varied]

    def of_box(self, places: Array) -> Array:
        """Coordinates (N, n_varied) of places (N, len(box)) of the unit box."""
        own = np.tile(self.centre, (len(places), 1))
        own[:, self.columns] += places * self.half[self.columns]
        return own[:, self.varied]

    def expansion(self, alpha: MultiIndices, coefficients: Array) -> Expansion:
        """The polynomials (n_b, n_varied), (n_b, m) on the box, as an expansion with the shape (n_b', m, 1)."""
        whole = np.zeros((len(alpha), len(self.centre)), dtype=np.intp)
        whole[:, self.varied] = alpha
        indices = sorted(with_lower(map(tuple, whole.tolist())), key=lambda index: (sum(index), index))
        row = {index: k for k, index in enumerate(indices)}
        c = np.zeros((len(indices), coefficients.shape[1]))
        c[[row[tuple(index)] for index in whole.tolist()]] = coefficients
        own, left = np.array(indices), [*range(len(self.centre))]
        for i in reversed(range(len(self.centre))):
            if (self.centre[i], self.half[i]) != (0.0, 1.0):
                own, c = in_other_coordinates(own, c, i, float(self.centre[i]), float(self.half[i]))
                left = left if self.half[i] else [k for k in left if k != i]
        inside = np.zeros((len(own), len(self.columns)), dtype=np.intp)
        for k, column in enumerate(self.columns):
            if column in left:  # a parameter of the box without width has no terms
                inside[:, k] = own[:, left.index(column)]
        order = np.argsort(inside.sum(axis=1), kind="stable")
        return Expansion(inside[order], c[order][:, :, None], self.names)


class _OutputRange:
    """The range of one output over the box, from responses Y (N, n_t) of different runs (N, d).

    Attributes
    ----------
    polynomials : Piecewise
    lower, upper, estimate : (n_t,)    bounds and their estimated error
    places : (2, n_t, len(box))        places of the bounds in the unit box
    gain : (2, n_t)                    error that a run at these places would remove, divided by the width
    """

    def __init__(self, frame: _Frame, points: Array, Y: Array) -> None:
        scale = float(np.abs(Y).max()) or 1.0  # squares may overflow
        fit = SparseFit.through(frame.at(points), Y / scale)
        error = fit.error * (fit.error > SAME)
        expansion = frame.expansion(fit.terms.alpha, fit.terms.coefficients)
        own = Piecewise.whole(expansion, error[:, None])
        one = np.ones(len(frame.columns))
        lower, upper, places = own.range(-one, one)
        lower, upper, self.places = lower[:, 0], upper[:, 0], places[:, :, 0]
        at = [frame.of_box(place) for place in self.places]
        others = np.abs([[each.each_at(x) - end for x, end in zip(at, (lower, upper), strict=True)] for each in fit.others])
        apart = others.max(axis=0)
        deviation = (Y / scale).std(axis=0)
        rest = np.divide(error, deviation, out=np.zeros_like(error), where=deviation > SAME)
        estimate = _SAFETY_OF_OTHERS * apart.max(axis=0) + _SAFETY_OF_REST * rest * (upper - lower) / 2
        estimate = np.where(estimate > SAME, estimate, 0.0)
        self.gain = apart / max(float(rms(upper - lower)), SAME)
        self.lower, self.upper, self.estimate = scale * lower, scale * upper, scale * estimate
        self.polynomials = own.changed(lambda each: _scaled(each, scale), scale * own.error)


def _scaled(own: Expansion, scale: float) -> Expansion:
    return Expansion(own.alpha, scale * own.coefficients, own.parameters)


def _different(points: Array, Y: Array) -> tuple[Array, Array]:
    """Different rows of points (N, d), and the means of their responses (N, n_t, n_y)."""
    rows, which, counts = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(rows), *Y.shape[1:]))
    np.add.at(sums, which.ravel(), Y / counts[which.ravel()][:, None, None])
    return rows, sums


def _intervals(simulator: RecordedRuns, box: Box) -> tuple[Array, Array]:
    """Lower and upper ends (d,) of all parameters. Parameters outside of the box have their nominal values."""
    low, high = np.array([[float(value) for value in simulator.parameters.values()]] * 2)
    columns = parameter_columns(simulator, box)
    low[columns], high[columns] = box.lower, box.upper
    return low, high


def _is_inside(simulator: RecordedRuns, box: Box) -> Mask:
    """Mask (N,) of the runs in the box. Parameters outside of the box must have their nominal values."""
    low, high = _intervals(simulator, box)
    slack = ROUNDING * np.abs(simulator.X).max(axis=0)
    return np.asarray(((simulator.X >= low - slack) & (simulator.X <= high + slack)).all(axis=1))


def _failed(simulator: RecordedRuns, box: Box) -> tuple[Any, ...]:
    bad = np.flatnonzero(~simulator.ok)
    if not len(bad):
        return ()
    runs = simulator.run(simulator.X[bad])
    found = tuple(zip(range(len(bad)), runs.t_failed.tolist(), runs.messages, strict=True))
    return failure_records(simulator, box, simulator.X[bad], found)


def _beyond_runs(simulator: RecordedRuns, box: Box) -> tuple[str, ...]:
    """Warnings about intervals that are partly or entirely outside of the runs."""
    low, high = _intervals(simulator, box)
    least, most = (end(simulator.X[simulator.ok], axis=0) for end in (np.min, np.max))
    doubts = list[str]()
    for i, name in enumerate(simulator.parameters):
        beyond = max(least[i] - low[i], high[i] - most[i])
        if beyond > max(DOUBTFUL * (high[i] - low[i]), SAME * max(abs(low[i]), abs(high[i]))):
            what = f"the value {low[i]:.6g}" if low[i] == high[i] else f"values from {low[i]:.6g} to {high[i]:.6g}"
            doubts.append(
                f"The recorded runs have {name} from {least[i]:.6g} to {most[i]:.6g}, but the bounds are for {what}. "
                "The polynomials are not reliable outside of the runs."
            )
    return tuple(doubts)


def _of_box(simulator: RecordedRuns, box: Box, inside: Mask) -> tuple[str, ...]:
    """Remarks about the box."""
    remarks = list[str]()
    if box.bounds == simulator.box.bounds and box.names == simulator.box.names:
        remarks.append("The box is the smallest box that contains all recorded runs. Pass box=... for another box.")
    if outside := int((simulator.ok & ~inside).sum()):
        remarks.append(f"{counted(outside, 'run')} outside of the box also determined the polynomials.")
    return tuple(remarks)


def _next_run(simulator: RecordedRuns, box: Box, fits: list[_OutputRange]) -> ByName:
    """Parameters of the bound at which polynomials without some runs differ most, relative to the width."""
    fit = max(fits, key=lambda each: each.gain.max())
    end, row = np.unravel_index(int(fit.gain.argmax()), fit.gain.shape)
    values = dict(zip(box.names, box.from_unit(fit.places[end, row][None])[0].tolist(), strict=True))
    own = simulator.parameters
    return ByName({name: values.get(name, float(own[name])) for name in own}, units_of_parameters(own))
