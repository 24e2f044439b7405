"""The set of parameters whose outputs stay within an error of all data, by branch and bound over parts of a box.

Milanese et al., Bounding Approaches to System Identification (1996); Jaulin and Walter, Automatica 29 (1993).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, SimulationError, WithWarnings
from symmb._labelled import Counted
from symmb._magnitudes import NOTHING, ROUNDING, SAME
from symmb._names import counted, normal_keys
from symmb._options import require_positive, shown
from symmb._table import aligned
from symmb._types import Array, Indices, Mask
from symmb._units import label, units_of_parameters
from symmb.bound.methods import PolynomialChaos
from symmb.bound.nodes import Sobol
from symmb.bound.polynomials import MultiIndices, basis_values, in_other_coordinates
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.reductions import bounded
from symmb.equations.model import Box, share_of
from symmb.results.files import Record, Saved, entry
from symmb.study.residuals import Residuals

OWNER = "Calibration.consistent"
MOST_VOLUME = 1.6
"""Parts are halved until the volume of all pieces is at most this multiple of the estimated volume of the set. The
estimate contains the fraction of undecided parts at whose points the parameters are consistent."""
_POINTS = 8
"""Number of points in each part. There are hundreds of parts, so that few points for each are enough."""
_LEAST_INSIDE = 0.2
"""Smallest volume of parts inside of the set, divided by the volume of all pieces. Otherwise, the estimate is rough."""
MOST_PARTS = 30_000
"""Largest number of undecided parts. Two such rounds take about two seconds."""
_MOST_NUMBERS = 2**22
"""Largest number of coefficients of undecided parts, which take 34 MB. A round takes about twenty times as much memory.
Without this, a set of three parameters with impacts took all memory of a machine."""
SMALL_ERROR = 0.02
"""Error of polynomials, divided by the depth of the set. With three parameters, it changes the volume by 6 %."""
_ROUNDS = 12
"""Largest number of boxes. Sides at which the set does not end are doubled, so the last box is very large."""
_HALVINGS = 10
"""Number of halvings that search the end of successful runs, between the estimates and an end of the box."""
_LEAST_WIDTH = 0.2
"""Smallest width of a part inside of the set, if the width of the larger part is 2. Narrow parts are too many."""
_CHECKS = 16
"""Number of runs, spread over the box, that check the error of the polynomials."""


@dataclass(frozen=True, eq=False, repr=False)
class ConsistentSet(Counted, WithWarnings, Saved):
    """Parameters whose outputs stay within an error of all data, as a box and as pieces.

    `save` writes a file, and `load` reads it.

    The pieces together contain all consistent parameters near the estimates. In pieces inside of the set, all
    parameters are consistent. The other pieces contain the boundary of the set. If the errors of all data are at most
    the given error, and the model is right, the pieces contain the true parameters.

    Attributes
    ----------
    name : str
        name of the scene
    parameters : dict
        estimates of the fit by name
    error : dict
        output -> largest difference between the output and its data
    lower, upper : (k, n_p)
        ends of the k pieces
    inside : (k,)
        mask of pieces in which all parameters are consistent
    volume : float
        estimated volume of the set, from points in the pieces
    doubts : tuple of str
        warnings
    evaluations, runs : int
        number of runs

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=1.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
    >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 1.0, 2.0], outputs=outputs)
    >>> consistent = mb.calibrate(scene, {"x": [0.0, 1.49, 3.02]}).consistent(0.03)
    >>> bool(consistent.inside.any()), [round(end, 3) for end in consistent.box["speed"]]
    (True, [1.495, 1.52])
    """

    name: str
    parameters: dict[str, float]
    error: dict[str, float]
    lower: Array = field(metadata=entry(Record.array, "inside", "parameters"))
    upper: Array = field(metadata=entry(Record.array, "inside", "parameters"))
    inside: Mask = field(metadata=entry(Record.mask))
    volume: float
    doubts: tuple[str, ...]
    evaluations: int

    @property
    def box(self) -> Box:
        """The smallest box that contains all pieces."""
        return self._box(self.lower.min(axis=0), self.upper.max(axis=0))

    @cached_property
    def pieces(self) -> tuple[Box, ...]:
        """The pieces. They do not overlap."""
        return tuple(map(self._box, self.lower, self.upper))

    def _box(self, lower: Array, upper: Array) -> Box:
        ends = zip(self.parameters, lower.tolist(), upper.tolist(), strict=True)
        return Box(**{name: (low, high) for name, low, high in ends}).with_units(units_of_parameters(self.parameters))

    def __repr__(self) -> str:
        warnings = (f"  warning     {text}" for text in self.doubts)
        return "\n".join([self._head(), *warnings, *aligned(self._rows())])

    def _repr_html_(self) -> str:
        return html.page(html.text("\n".join([self._head(), *self.doubts])), html.table(self._rows()))

    def _head(self) -> str:
        errors = ", ".join(f"{name} ± {value:.3g}" for name, value in self.error.items())
        return (
            f"{self.name}: {counted(len(self.parameters), 'parameter')} consistent with data of {errors}, "
            f"{counted(len(self.lower), 'piece')}, {int(self.inside.sum())} of them inside, {self.evaluations} runs"
        )

    def _rows(self) -> list[list[str]]:
        rows, units = [["parameter", "lower", "estimate", "upper"]], units_of_parameters(self.parameters)
        for (name, value), (low, high) in zip(self.parameters.items(), self.box.bounds, strict=True):
            rows.append([label(name, units.get(name, "")), *(f"{x:.7g}" for x in (low, value, high))])
        return rows


def errors_of(error: object, data: Mapping[str, Array]) -> dict[str, float]:
    """The error of each output: a number, a percentage of the largest value, or a mapping from outputs to these."""
    given = normal_keys(OWNER, error) if isinstance(error, Mapping) else dict.fromkeys(data, error)
    if given.keys() != data.keys():
        raise DeclarationError(f"{OWNER}: error must have a value for each of {', '.join(data)}, got {shown(error)}.")
    errors = dict[str, float]()
    for name, values in data.items():
        value: Any = given[name]
        if isinstance(value, str):
            share = share_of(value)
            if isinstance(share, str):
                raise DeclarationError(
                    f"{OWNER}: error must be a number or a percentage such as '0.1%', got {value!r}."
                )
            value = share * float(np.abs(values).max())
        require_positive(OWNER, f"error {shown(given[name])} of {name!r}", value)
        if value < (least := SAME * float(np.abs(values).max())):  # polynomials of runs are not more accurate
            raise DeclarationError(f"{OWNER}: error {shown(given[name])} of {name!r} must be at least {least:.3g}.")
        errors[name] = float(value)
    return errors


def consistent_set(fit: Residuals, name: str, parameters: dict[str, float], errors: dict[str, float]) -> ConsistentSet:
    """The set around the estimates of a fit."""
    before, scale = fit.runs, np.repeat([*errors.values()], fit.counts)
    estimate = np.array([*parameters.values()]) / fit.sizes
    residuals, slopes = fit(estimate)
    lower, upper, depth = _linear(residuals / scale, slopes / scale[:, None])
    ends, limits = estimate + np.stack([lower, upper]), fit.limits.copy()
    least = np.inf
    for _ in range(_ROUNDS):
        lower, upper = ends = _within_runs(fit, estimate, ends, limits)
        polynomials, failed = _polynomials(fit, lower, upper, scale, depth, estimate)
        low, high, inside, volume = _pieces(polynomials, SMALL_ERROR * depth)
        if not len(low):
            raise SimulationError(
                f"{OWNER}: near the estimates, no run is within the error of all data. Give a larger error, or replace "
                "wrong values by nan."
            )
        width, (first, last) = (upper - lower) / 2, (low.min(axis=0), high.max(axis=0))
        at_end = np.stack([first, -last]) <= ROUNDING - 1
        open_ = at_end & (ends != limits)
        if at_end.all() and (polynomials.error >= 1).all():
            raise SimulationError(
                f"{OWNER}: errors of polynomials are larger than the error of the data, because the set is large. Give "
                "a smaller error."
            )
        middle = (lower + upper) / 2
        low, high = middle + width * low, middle + width * high
        if not open_.any():
            error = float(polynomials.error.max())
            # Polynomials over a much smaller box have smaller errors, unless the outputs are not smooth.
            if error <= SMALL_ERROR * depth or error > 0.9 * least or (last - first >= 1).all():
                break
            least = error
        first, last = low.min(axis=0), high.max(axis=0)
        margin = 0.1 * (last - first)
        ends = np.stack([first, last]) + np.where(open_, 2 * width, margin) * [[-1], [1]]
    else:
        raise SimulationError(f"{OWNER}: the data do not limit the parameters. Give a smaller error.")
    low, high = low * fit.sizes, high * fit.sizes
    volume *= float((width * fit.sizes).prod())
    stops = [f"{fit.names[k]} = {ends[side, k] * fit.sizes[k]:.4g}" for side, k in np.argwhere(at_end & ~open_)]
    doubts = _doubts(float((high - low).prod(axis=1).sum()), volume, failed, stops)
    inside &= not failed
    return ConsistentSet(name, parameters, errors, low, high, inside, volume, tuple(doubts), fit.runs - before)


def _within_runs(fit: Residuals, estimate: Array, ends: Array, limits: Array) -> Array:
    """Ends (2, n_p) of a box inside of the limits (2, n_p). If the run at an end fails, the end becomes a limit.

    Each run changes one parameter, for example a mass that must be positive.
    """
    ends = np.clip(ends, *limits)
    ways = np.concatenate([np.diag(way) for way in ends - estimate])

    def succeed(ways: Array) -> Mask:
        return np.asarray(np.isfinite(fit.values(estimate + ways)).all(axis=1))

    if (lost := ~succeed(ways)).any():
        share = np.zeros(lost.sum())
        for step in 0.5 ** np.arange(1, _HALVINGS + 1):
            share += step * succeed((share + step)[:, None] * ways[lost])
        lost = lost.reshape(ends.shape)
        ends[lost] = limits[lost] = (1 - share) * np.tile(estimate, (2, 1))[lost] + share * ends[lost]
    return ends


def _doubts(outer: float, volume: float, failed: int, stops: Sequence[str]) -> Iterator[str]:
    if outer > 2 * volume:
        ratio = f"about {outer / volume:.2g} times as large as the set" if volume else "much larger than the set"
        yield f"The pieces are {ratio}, because the set is thin, or the outputs are not smooth."
    if failed:
        yield f"{counted(failed, 'run')} failed. The set is only estimated, so no piece counts as inside."
    if stops:
        yield f"The set ends at {', '.join(stops)}, because runs beyond fail or are outside of the given limits."


def _linear(r: Array, slopes: Array) -> tuple[Array, Array, float]:
    """Ends (n_p,) of a box with some margin around the set of the linear model, and the depth of the set.

    Residuals r (N,) and slopes (N, n_p) are divided by the errors. The depth is the largest distance from the bounds
    of the errors.
    """
    from scipy.optimize import linprog

    size = np.abs(slopes).max(axis=0)
    d, A, b = len(size), np.concatenate([slopes, -slopes]) / size, np.concatenate([r, -r])
    free = [(None, None)] * (d + 1)
    least = float(linprog(np.eye(d + 1)[d], np.column_stack([A, -np.ones(len(A))]), b, bounds=free).fun)
    # If the linear model is not consistent with the data, the equations decide in a larger set.
    level = max(1.0, 1.5 * least)
    ends = np.array(
        [sign * linprog(sign * row, A, b + level, bounds=free[:d]).fun for sign in (1, -1) for row in np.eye(d)]
    )
    lower, upper = ends.reshape(2, d) / size
    margin = 0.125 * (upper - lower)
    return lower - margin, upper + margin, level - least


class _Polynomials(NamedTuple):
    """Residuals over a box, divided by the errors of the data: polynomials on parts, and their error (N,)."""

    surrogate: Piecewise
    coefficients: list[Array]
    error: Array


def _polynomials(
    fit: Residuals, lower: Array, upper: Array, scale: Array, depth: float, estimate: Array
) -> tuple[_Polynomials, int]:
    """Polynomials over a box of relative parameters, and the number of failed runs."""
    ends = zip(fit.names, (lower * fit.sizes).tolist(), (upper * fit.sizes).tolist(), strict=True)
    box = Box(**{name: (low, high) for name, low, high in ends})
    widths = np.abs(fit(estimate)[1]) @ (upper - lower) / scale
    least = min(SMALL_ERROR * depth / np.sqrt(np.mean(part**2)) for part in fit.parts(widths))
    bounds = bounded(PolynomialChaos(tolerance=float(np.clip(least, 1e-6, 1e-2))), fit.simulator, box)
    fit.runs += bounds.evaluations
    surrogate = bounds.surrogate
    if surrogate is None or not np.isfinite(surrogate.error).all():
        raise SimulationError(f"{OWNER}: polynomials do not describe the outputs over {box!r}.")
    points = Sobol().points(_CHECKS, len(box), seed=0)
    Y = fit.values((lower + upper) / 2 + (upper - lower) / 2 * points)
    missed = np.nan_to_num(np.abs(Y - fit.placed(surrogate.values(points)))).max(axis=0)
    coefficients = [fit.placed(own.coefficients) / scale for own in surrogate.expansions]
    for own in coefficients:
        own[0] -= fit.data / scale
    error = np.maximum(fit.placed(surrogate.error[None])[0], 2 * missed) / scale
    return _Polynomials(surrogate, coefficients, error), len(bounds.failed)


@dataclass(frozen=True, eq=False)
class _Parts:
    """Parts of a box, and the residuals there.

    Attributes
    ----------
    alpha : (n_b, d) multi-indices
    coefficients : (n_b, k, m) Legendre coefficients of m residuals on k parts
    error : (m,) error of the polynomials
    centres, halves : (k, d)
    """

    alpha: MultiIndices
    coefficients: Array
    error: Array
    centres: Array
    halves: Array

    @property
    def volumes(self) -> Array:
        """Volumes (k,) of the parts."""
        return self.halves.prod(axis=1)

    @property
    def likely_volume(self) -> float:
        """Estimated volume of the set in the parts, from points that are spread over each part."""
        points = Sobol().points(_POINTS, len(self.alpha.T), seed=0)
        values = np.tensordot(basis_values(self.alpha, points), self.coefficients, axes=1)
        return float((np.abs(values) <= 1).all(axis=2).mean(axis=0) @ self.volumes)

    def limits(self, sign: int) -> tuple[Array, Array]:
        """Ends (k, d) of an interval of each parameter, while the other parameters have any values of the part.

        With the sign 1, the interval contains all consistent parameters. With the sign -1, all parameters in the
        interval are consistent. If the lower end is above the upper end, the interval is empty.
        """
        value, rest = self.coefficients[0], self.error + np.abs(self.coefficients[1:]).sum(axis=0)
        lower, upper = -np.ones_like(self.centres), np.ones_like(self.centres)
        for i, unit in enumerate(np.eye(len(self.alpha.T))):
            slope = self.coefficients[(self.alpha == unit).all(axis=1)].sum(axis=0)
            space = 1 + sign * (rest - np.abs(slope))
            is_flat = np.abs(slope) <= NOTHING
            slope = np.where(is_flat, 1.0, slope)
            middle = np.where(is_flat, 0.0, -value / slope)
            radius = np.where(is_flat, np.where(np.abs(value) <= space, np.inf, -np.inf), space / np.abs(slope))
            lower[:, i] = np.maximum(lower[:, i], (middle - radius).max(axis=1, initial=-np.inf))
            upper[:, i] = np.minimum(upper[:, i], (middle + radius).min(axis=1, initial=np.inf))
        return lower, upper

    def within(self, rows: Indices, lower: Array, upper: Array) -> "_Parts":
        """Boxes inside of the parts with the numbers `rows` (n,). Their ends (n, d) are in coordinates of the parts."""
        centres, halves = (lower + upper) / 2, (upper - lower) / 2
        coefficients = self.coefficients[:, rows]
        for i in range(len(self.alpha.T)):
            if (halves[:, i] < 1).any():
                change = centres[:, i], halves[:, i]
                _, coefficients = in_other_coordinates(self.alpha, coefficients, i, *change)
        centres, halves = self.centres[rows] + self.halves[rows] * centres, self.halves[rows] * halves
        return _Parts(self.alpha, coefficients, self.error, centres, halves)

    def divided(self) -> tuple["_Parts", "_Parts"]:
        """Parts inside of the set, and parts that may contain its boundary. The rest is not consistent."""
        lower, upper = self.limits(1)
        some = np.flatnonzero((lower <= upper).all(axis=1))
        own = self.within(some, lower[some], upper[some])
        rows, degrees = np.arange(len(own.centres)), own.alpha.T > 0
        effects = np.stack([np.abs(own.coefficients[some]).sum(axis=0).max(axis=1, initial=0) for some in degrees])
        along = effects.argmax(axis=0)
        first, last = (ends[rows, along] for ends in own.limits(-1))
        # Without a wide part in the middle that is inside of the set, the part is halved.
        is_in = last - first >= _LEAST_WIDTH
        first, last = np.where(is_in, first, 0.0), np.where(is_in, last, 0.0)

        def cut(some: Any, low: Any, high: Any) -> tuple[Indices, Array, Array]:
            lower, upper = -np.ones_like(own.centres), np.ones_like(own.centres)
            lower[rows, along], upper[rows, along] = low, high
            return rows[some], lower[some], upper[some]

        sides: Any = zip(cut(first > -1, -1.0, first), cut(last < 1, last, 1.0), strict=True)
        return own.within(*cut(is_in, first, last)), own.within(*(np.concatenate(each) for each in sides))

    def simplified(self, small: float) -> "_Parts":
        """Parts without residuals that are small enough everywhere. Small terms of high degree become an error."""
        c, degrees = self.coefficients, self.alpha.sum(axis=1)
        is_open = (np.abs(c).sum(axis=0) > 1 - self.error).any(axis=0)
        c, error, is_low = c[..., is_open], self.error[is_open], degrees >= 0
        for degree in range(1, degrees.max(initial=0)):
            rest = np.abs(c[degrees > degree]).sum(axis=0).max(axis=0, initial=0)
            if (rest <= small).all():
                is_low, error = degrees <= degree, error + rest
                break
        return _Parts(self.alpha[is_low], c[is_low], error, self.centres, self.halves)


def _pieces(polynomials: _Polynomials, small: float) -> tuple[Array, Array, Mask, float]:
    """Ends (k, d) of the pieces in the unit box, mask (k,) of pieces inside of the set, and estimated volume."""
    whole = polynomials.surrogate
    left = [
        _Parts(own.alpha, coefficients[:, None], polynomials.error, centre[None], half[None])
        for own, coefficients, centre, half in zip(
            whole.expansions, polynomials.coefficients, whole.centres, whole.halves, strict=True
        )
    ]
    inner = list[_Parts]()
    while True:
        inside, left = zip(*(parts.simplified(0.1 * small).divided() for parts in left), strict=True)
        inner += inside
        known, unknown = (sum(float(parts.volumes.sum()) for parts in some) for some in (inner, left))
        likely = known + sum(parts.likely_volume for parts in left)
        is_fine = known >= _LEAST_INSIDE * (known + unknown) and known + unknown <= MOST_VOLUME * likely
        is_at_side = any((np.abs(parts.centres) + parts.halves >= 1 - ROUNDING).any() for parts in inside)
        is_much = sum(parts.coefficients.size for parts in left) > _MOST_NUMBERS
        if is_fine or is_at_side or not unknown or is_much or sum(len(parts.centres) for parts in left) > MOST_PARTS:
            break
    centres, halves = (np.concatenate([getattr(p, name) for p in (*inner, *left)]) for name in ("centres", "halves"))
    is_inside = np.arange(len(centres)) < sum(len(parts.centres) for parts in inner)
    return centres - halves, centres + halves, is_inside, likely * 2.0 ** len(centres.T)
