"""Curves through points: smooth interpolants as expressions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import numbers_of
from symmb._types import Array, Expr, Mask
from symmb.symbolic import SOFT, Kind, given, lookup, symbols_in


@dataclass(frozen=True, eq=False)
class Table:
    """A curve through points (x, y): cubic pieces with continuous slopes, and no overshoot between the points.

    The curve is monotone between points, and constant between equal ones. A spline of continuous curvature would
    oscillate beside a steep front, and an area could become negative. Beyond the first and the last point the value is
    constant.

    Each point adds terms to the expression. A scene with 500 points takes seconds to compile, one with 10,000 minutes.

    Parameters
    ----------
    x : sequence           n >= 2 places, increasing, at most 10,000
    y : sequence           n values

    Raises
    ------
    DeclarationError       if the points make no curve

    References
    ----------
    Fritsch, Butland (1984), A method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci. Stat.
    Comput. 5.

    Examples
    --------
    >>> import symmb as mb
    >>> pressure = mb.Table([0.0, 1e-3, 4e-3, 9e-3], [0.0, 300e6, 120e6, 0.0])
    >>> breech = mb.Body("breech", mass=900.0, pose=mb.Particle())
    >>> push = mb.Force("gas", breech.point(0, 0), (-0.019 * pressure(mb.t), 0))
    >>> float(pressure(1e-3))
    300000000.0
    """

    x: Sequence[float] | Array
    y: Sequence[float] | Array
    _pieces: Array = field(init=False, repr=False)  # (n - 1, 6): begin, end, coefficients of rising powers

    def __post_init__(self) -> None:
        x, y = numbers_of(self.x), numbers_of(self.y)
        if any(isinstance(entry, ca.SX) for entry in (*_entries(self.x), *_entries(self.y))):
            raise DeclarationError("Table: x and y must be finite numbers; multiply the table itself by parameters.")
        points = len(self.x) if isinstance(self.x, Sequence) else 0 if x is None else x.size
        if points > _MOST_POINTS:  # perhaps too many for an array of them
            raise DeclarationError(
                f"Table: {points} points, at most {_MOST_POINTS}: each adds terms to the expression. Leave out points "
                "where the curve through the others is as close as the data are known."
            )
        if x is None or y is None:
            raise DeclarationError("Table: x and y must be lists of numbers.")
        if x.ndim != 1 or x.shape != y.shape or len(x) < 2:
            raise DeclarationError(f"Table: x {x.shape} and y {y.shape} must be lists of one length, at least 2.")
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise DeclarationError("Table: x and y must be finite numbers.")
        falls = x[1:] <= x[:-1]
        if falls.any():
            at = int(np.argmax(falls)) + 1
            raise DeclarationError(f"Table: x must increase, but x[{at}] = {x[at]:g} follows {x[at - 1]:g}. Sort it.")
        with np.errstate(all="ignore"):
            h = np.diff(x)
            slope = np.diff(y) / h
            m = _slopes(h, slope)
            c, d = (3 * slope - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * slope) / h**2
            largest = np.abs(slope) + np.abs(m[:-1]) + h * (np.abs(c) + h * np.abs(d))
        if not np.isfinite(8 * h * largest).all() or not np.isfinite([slope, c, d]).all():
            raise DeclarationError(
                "Table: points so far from each other, or so close, that their slopes are no numbers. Use other units."
            )
        object.__setattr__(self, "_pieces", np.column_stack([x[:-1], x[1:], y[:-1], m[:-1], c, d]))

    def __call__(self, at: Expr) -> ca.SX:
        """The curve at a number or an expression, such as `mb.t`, a position or a velocity."""
        at, value = given(at), at
        if at is None:
            raise DeclarationError(f"Table: {value!r} is no number and no CasADi SX expression.")
        records = (lookup(symbol) for symbol in symbols_in(at))
        over_state = any(record is not None and record.kind is not Kind.PARAMETER for record in records)

        def before(end: float, bends: bool) -> ca.SX:
            return at < end if bends or not over_state else at - end < -SOFT

        curve = ca.SX(float(self.y[-1]))
        bends = _bends(np.array(self.x, dtype=float), np.array(self.y, dtype=float))
        for (begin, end, a, b, c, d), bend in zip(self._pieces[::-1].tolist(), bends[:0:-1].tolist(), strict=True):
            u = at - begin
            curve = ca.if_else(before(end, bend), a + u * (b + u * (c + u * d)), curve)
        return ca.if_else(before(float(self.x[0]), True), float(self.y[0]), curve)


def _entries(values: object) -> Sequence[object]:
    return values if isinstance(values, list | tuple) else [values]


_MOST_POINTS = 10_000
"""Points of which the expression is still compiled, in minutes: CasADi's recursion runs out of stack with 100,000."""
_BEND = 0.5
"""Change of the slope at a point, over the steeper of both slopes, from which on steps over the state end there."""


def _bends(x: Array, y: Array) -> Mask:
    """Points (n,) where a front, a pulse or the table itself begins or ends. A step might otherwise pass over it.

    Steps follow a smooth part of the curve without an end at each point of it.
    """
    slope = np.diff(y) / np.diff(x)
    steeper = np.maximum(np.abs(slope[1:]), np.abs(slope[:-1]))
    return np.concatenate([[True], np.abs(np.diff(slope)) > _BEND * steeper, [True]])


def _slopes(h: Array, slope: Array) -> Array:
    """Slopes at the points: harmonic means of those on both sides, 0 at extremes, those of parabolas at the ends."""
    if len(h) == 1:
        return np.array([slope[0], slope[0]])
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    before, after = slope[:-1], slope[1:]
    same = before * after > 0
    mean = np.zeros(len(same))
    mean[same] = (w1 + w2)[same] / (w1[same] / before[same] + w2[same] / after[same])
    return np.array([_end(h[0], h[1], slope[0], slope[1]), *mean, _end(h[-1], h[-2], slope[-1], slope[-2])])


def _end(h: float, h_next: float, slope: float, slope_next: float) -> float:
    """Slope at an outer point of the parabola through three points, limited so that the curve does not overshoot."""
    m = ((2 * h + h_next) * slope - h * slope_next) / (h + h_next)
    if m * slope <= 0:
        return 0.0
    return 3 * slope if slope * slope_next <= 0 and abs(m) > 3 * abs(slope) else m
