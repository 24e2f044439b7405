"""Curves through points, as expressions."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import numbers_of, shown
from symmb._types import Array, Expr
from symmb.declare.symbolic import Kind, Pieces, Sides, given, records_in


@dataclass(frozen=True, eq=False)
class Table:
    """A curve through points (x, y): cubic pieces with continuous slopes, and no overshoot between the points.

    The curve is monotone between points, and constant between points of equal y. A spline with continuous curvature
    would oscillate near a steep front, and a positive quantity could become negative. The value is constant before the
    first point and after the last point.

    Bisection finds the piece, so a table of 100,000 points costs little more than a table of ten. If x is time, steps
    of solvers end at each point. If x depends on the state, steps end where the slope changes by more than
    half of the steeper slope.

    Parameters
    ----------
    x : sequence
        n increasing values, n from 2 to 1,000,000
    y : sequence
        n values

    Raises
    ------
    DeclarationError
        If x does not increase, if a number is not finite, or if the lengths of x and y differ

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
    _pieces: Pieces = field(init=False, repr=False)  # start and coefficients of each piece, lowest power first

    def __post_init__(self) -> None:
        x, y = self._points()
        with np.errstate(all="ignore"):
            h = np.diff(x)
            slope = np.diff(y) / h
            m = _slopes(h, slope)
            c, d = (3 * slope - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * slope) / h**2
            # A bound of the terms of all pieces. If it is finite, no evaluation inside a piece can overflow.
            largest = np.abs(slope) + np.abs(m[:-1]) + h * (np.abs(c) + h * np.abs(d))
        if not np.isfinite(8 * h * largest).all() or not np.isfinite([slope, c, d]).all():
            raise DeclarationError(
                "Table: slopes between the points exceed the range of floating-point numbers. Use other units."
            )
        begins = np.concatenate([x[:1], x])
        columns = [begins, [y[0], *y], *(np.pad(part, 1) for part in (m[:-1], c, d))]
        object.__setattr__(self, "_pieces", Pieces(np.zeros(len(begins)), begins, np.column_stack(columns)))

    def _points(self) -> tuple[Array, Array]:
        """The arrays x (n,) and y (n,). Raises DeclarationError if they are not valid points of a curve."""
        x, y = numbers_of(self.x), numbers_of(self.y)
        if any(isinstance(entry, ca.SX) for entry in (*_entries(self.x), *_entries(self.y))):
            raise DeclarationError("Table: x and y must be numbers. Multiply the table by parameters instead.")
        points = len(self.x) if isinstance(self.x, Sequence) else 0 if x is None else x.size
        if points > _MOST_POINTS:
            raise DeclarationError(f"Table: {points} points are too many. Pass at most {_MOST_POINTS} points.")
        if x is None or y is None:
            raise DeclarationError("Table: x and y must be lists of numbers.")
        if x.ndim != 1 or x.shape != y.shape or len(x) < 2:
            raise DeclarationError(
                f"Table: x has the shape {x.shape} and y has {y.shape}. Pass two lists of equal length, at least 2."
            )
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise DeclarationError("Table: x and y must be finite numbers.")
        falls = x[1:] <= x[:-1]
        if falls.any():
            at = int(np.argmax(falls)) + 1
            raise DeclarationError(
                f"Table: x must increase, but x[{at}] = {x[at]:g} follows {x[at - 1]:g}. Sort the points."
            )
        return x, y

    def __call__(self, at: Expr) -> ca.SX:
        """The curve at a number or an expression, such as `mb.t`, a position or a velocity."""
        at, value = given(at), at
        if at is None:
            raise DeclarationError(f"Table: expected a number or a CasADi SX expression, got {value!r}.")
        if at.is_constant():
            places = np.array(ca.DM(ca.densify(at)), dtype=float)
            if not np.isfinite(places).all():
                raise DeclarationError(f"Table: {shown(value)} is not finite. Pass a finite number.")
            begin, y, slope, c, d, _ = self._pieces.read(0, places)
            return ca.SX(y + (places - begin) * (slope + (places - begin) * (c + (places - begin) * d)))
        over_state = any(record.kind is not Kind.PARAMETER for record in records_in(at))
        values = [self._value(part, over_state) for part in ca.vertsplit(ca.vec(ca.densify(at)))]
        return ca.reshape(ca.vertcat(*values), *at.shape)

    def _value(self, at: ca.SX, over_state: bool) -> ca.SX:
        """The value of the curve at an expression `at`. If `at` depends on the state, steps end at large bends."""
        pieces, group = self._pieces, ca.SX(0)
        if over_state:
            sides, pieces = self._grouped
            group = sides(ca.SX(0), at)[-1]
        begin, y, slope, c, d, _ = pieces(group, at)
        u = at - begin
        return y + u * (slope + u * (c + u * d))

    @cached_property
    def _grouped(self) -> tuple[Sides, Pieces]:
        """The points at which the slope changes much, and the pieces in groups between these points.

        A front, a pulse or the table itself starts or ends at such a point. Without these points, a long step of a
        solver could skip a pulse.
        """
        x, y = np.array(self.x, dtype=float), np.array(self.y, dtype=float)
        slope = np.diff(y) / np.diff(x)
        steeper = np.maximum(np.abs(slope[1:]), np.abs(slope[:-1]))
        # Steps end at points where the slope changes by more than half of the steeper of both slopes.
        bends = np.concatenate([[True], np.abs(np.diff(slope)) > 0.5 * steeper, [True]])
        data = self._pieces.data
        return Sides.of(x[bends]), Pieces(np.concatenate([[0], np.cumsum(bends)]), data[1], data[2:-1].T)


def _entries(values: object) -> Sequence[object]:
    """The entries of a list or a tuple; another value as the only entry."""
    return values if isinstance(values, list | tuple) else [values]


_MOST_POINTS = 1_000_000
"""Largest number of points. A table of this size takes 100 MB, and some seconds to declare."""


def _slopes(h: Array, slope: Array) -> Array:
    """Slopes of the curve at all points: weighted harmonic means of the slopes on both sides, and 0 at extrema."""
    if len(h) == 1:
        return np.array([slope[0], slope[0]])
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    before, after = slope[:-1], slope[1:]
    same = before * after > 0
    mean = np.zeros(len(same))
    mean[same] = (w1 + w2)[same] / (w1[same] / before[same] + w2[same] / after[same])
    return np.array([_end(h[0], h[1], slope[0], slope[1]), *mean, _end(h[-1], h[-2], slope[-1], slope[-2])])


def _end(h: float, h_next: float, slope: float, slope_next: float) -> float:
    """Slope at an end: the slope of the parabola through three points, limited so that the curve does not overshoot."""
    m = ((2 * h + h_next) * slope - h * slope_next) / (h + h_next)
    if m * slope <= 0:
        return 0.0
    return 3 * slope if slope * slope_next <= 0 and abs(m) > 3 * abs(slope) else m
