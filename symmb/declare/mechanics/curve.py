"""Plane curves of cams, grooves and tracks. On a part of a curve, the distance to a point has only one minimum."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, cast

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._magnitudes import ROUNDING, SAME, SLIGHT
from symmb._options import is_finite_number, numbers_of, require_truth, shown
from symmb._types import Array, Expr
from symmb.declare.mechanics.element import Bind, law_value
from symmb.declare.symbolic import SOFT, Smooth, batch, vector


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve in the xy plane of a body: an expression of its parameter s, or a cubic spline through points.

    Parameters
    ----------
    shape : callable or (n, 2) array
        function of s (SX) that returns x and y [m] as expressions of s and parameters; or points [m] of a spline. The
        parameter s of a spline is the length [m] of the polygon through the points
    start, end : float
        range of s, for a function
    closed : bool
        whether the curve ends at its start
    corners : sequence
        values of s, or indices of points, at which the direction of the curve jumps

    Examples
    --------
    >>> import casadi as ca
    >>> import symmb as mb
    >>> cam = mb.Curve(lambda s: (0.06 * ca.cos(s), 0.04 * ca.sin(s)), 0, 2 * ca.pi, closed=True)
    >>> square = mb.Curve([(0, 0), (1, 0), (1, 1), (0, 1)], closed=True, corners=range(4))
    >>> square.end
    4.0
    """

    expected: ClassVar[str] = "a curve, got {}. Use Curve(...)."

    shape: Callable[[ca.SX], Sequence[Expr]] | Sequence[Sequence[float]] | Array
    start: float = 0.0
    end: float | None = None
    closed: bool = False
    corners: Sequence[float] = ()
    s: ca.SX = field(init=False, repr=False)
    place: ca.SX = field(init=False, repr=False)  # (2,) [m]

    @kept_interrupts()
    def __post_init__(self) -> None:
        object.__setattr__(self, "s", ca.SX.sym("s"))
        require_truth("Curve", "closed", self.closed)
        object.__setattr__(self, "closed", bool(self.closed))
        corners = numbers_of(self.corners if isinstance(self.corners, list | tuple | range | np.ndarray) else "")
        if corners is None or corners.ndim != 1:
            raise DeclarationError(f"Curve: corners must be a list of numbers, got {shown(self.corners)}.")
        if callable(self.shape):
            place = vector(law_value(self.shape, "Curve", self.s), "the position on a Curve")[:2]
            if not (is_finite_number(self.start) and is_finite_number(self.end) and self.start < self.end):  # type: ignore
                raise DeclarationError(
                    f"Curve: start {self.start!r} and end {self.end!r} must be finite, and start must be below end."
                )
            object.__setattr__(self, "start", float(self.start))
            object.__setattr__(self, "end", float(cast(float, self.end)))
        else:
            place, end, corners = _spline(self.shape, self.closed, corners, self.s)
            object.__setattr__(self, "start", 0.0)
            object.__setattr__(self, "end", end)
        if ((corners < self.start) | (corners > self.ends[1])).any():
            raise DeclarationError(
                f"Curve: corners {shown(self.corners)} must be from {self.start:g} to {self.ends[1]:g}, the range of s."
            )
        object.__setattr__(self, "corners", tuple(np.unique(corners).tolist()))
        object.__setattr__(self, "place", place)

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest s."""
        return float(self.start), float(cast(float, self.end))

    def at(self, s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The position (2,) at s, and its first two derivatives with respect to s."""
        first = ca.jacobian(self.place, self.s)
        return tuple(ca.substitute([self.place, first, ca.jacobian(first, self.s)], [self.s], [s]))  # type: ignore

    def nearest(self, P: ca.SX, low: float, high: float, samples: int, follow: Callable[[ca.SX], ca.SX]) -> ca.SX:
        """The s of the point of the curve nearest to P (2,). Newton's method starts from the nearest of n `samples`."""
        ends = low, high - (high - low) / samples * self.closed
        best, squared = ca.SX(low), ca.sumsqr(P - ca.substitute(self.place, self.s, ca.SX(low)))
        for value in np.linspace(*ends, samples).tolist()[1:]:
            s = ca.SX(value)
            distance = ca.sumsqr(P - ca.substitute(self.place, self.s, s))
            is_next = distance - squared < -SOFT
            best, squared = ca.if_else(is_next, s, best), ca.if_else(is_next, distance, squared)
        for _ in range(4):  # each step about squares the relative error of a sample
            best = follow(best)
        return best

    def measured(self, bind: Bind) -> "Measured":
        """The numeric curve at the nominal parameters."""
        p = [symbol for symbol in ca.symvar(self.place) if symbol.element_hash() != self.s.element_hash()]
        values = [float(ca.evalf(bind.nominal(symbol))) for symbol in p]
        f = ca.Function("curve", [self.s, ca.vertcat(ca.SX(0, 1), *p)], [ca.densify(part) for part in self.at(self.s)])
        return Measured(self, lambda s: batch(f, s[:, None], np.array(values)))


_SAMPLES = 400
"""Number of samples of the curvature of a smooth piece. The number does not affect the accuracy of feet."""
_OVERLAP = 0.1
"""Overlap of successive parts / length of a part. At the end of a part, the foot on the next part is then nearer."""


Part = tuple[float, float]
"""A part of a curve from low to high s. The limits of a part without ends are infinite."""


class Measured:
    """A numeric curve: `numbers` returns positions and their first two derivatives (n, 2) at values of s (n,)."""

    def __init__(self, curve: Curve, numbers: Callable[[Array], tuple[Array, ...]]) -> None:
        self.curve, self._numbers = curve, numbers
        start, end = curve.ends
        self.period = end - start
        s = np.linspace(start, end, 4 * _SAMPLES + 1)
        x, d, _ = numbers(s)
        if not np.isfinite([x, d]).all() or not np.hypot(*d.T).min() > 0:
            raise DeclarationError("the curve has a point that is not finite, or a point with a derivative of zero")
        self.length, self.middle = float(np.hypot(*np.diff(x, axis=0).T).sum()), x[:-1].mean(axis=0)
        # The sign of the area (Green's theorem) shows which side of a closed curve is inside.
        moment = x[:, 0] * d[:, 1] - x[:, 1] * d[:, 0]
        self.area = float((moment[1:] + moment[:-1]) @ np.diff(s)) / 4
        if curve.closed and np.hypot(*(x[-1] - x[0])) > SAME * self.length:
            raise DeclarationError("the curve is closed, but its end differs from its start. Use closed=False")
        # If the function of s is periodic, feet can pass the start. Other closed curves must be cut there.
        beyond = np.array([0.0, 0.01]) * self.period
        gap = np.hypot(*(numbers(start + beyond)[0] - numbers(end + beyond)[0]).T)
        self.is_periodic = curve.closed and bool(gap.max() <= SAME * self.length)

    @property
    def _pieces(self) -> list[tuple[float, float]]:
        """The smooth pieces between corners and ends, as pairs of s."""
        start, corners = float(self.curve.start), list(self.curve.corners)
        if self.is_periodic and corners:
            breaks = [*corners, corners[0] + self.period]
        else:
            breaks = sorted({start, *corners, start + self.period})
        return list(pairwise(breaks))

    def groups(self, side: float, most_parts: int = 64) -> list[list[Part]]:
        """Parts of the curve in groups, separated by concave corners. A point touches each group at one point only.

        Points are to the left of the curve for side=1, to the right for side=-1.
        """
        groups: list[list[Part]] = []
        pieces = self._pieces
        for k, (a, b) in enumerate(pieces):
            parts = self._parts(a, b, side)
            if groups and not self._is_concave(pieces[k - 1][1], a, side):
                groups[-1] += parts
            else:
                groups.append(parts)
        if self.curve.closed and len(groups) > 1 and not self._is_concave(pieces[-1][1], pieces[0][0], side):
            groups[0] = groups.pop() + groups[0]
        if sum(map(len, groups)) > most_parts:  # each part adds a state to the equations
            raise DeclarationError(
                f"the curve has {sum(map(len, groups))} bends of at most 90°, but only {most_parts} are possible. Use "
                "a smoother curve"
            )
        return groups

    def _is_concave(self, before: float, behind: float, side: float) -> bool:
        """Whether the curve turns toward the side at a corner. `before` and `behind` are s on its two sides."""
        inset = ROUNDING * self.period  # derivatives jump at the corner itself
        (u, v) = self._numbers(np.array([before - inset, behind + inset]))[1]
        return side * (u[0] * v[1] - u[1] * v[0]) > SLIGHT * np.hypot(*u) * np.hypot(*v)

    def _parts(self, a: float, b: float, side: float) -> list[Part]:
        """The parts of a smooth piece from a to b. On each part the tangent turns in one direction, by up to 90°."""
        inset = ROUNDING * (b - a)  # derivatives jump at the ends
        s = np.linspace(a + inset, b - inset, _SAMPLES + 1)
        _, d, dd = self._numbers(s)
        bend = side * (d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]) / (d**2).sum(axis=1)  # radians for each s
        turn, sign, cuts = 0.0, 0.0, [a + inset]
        whole = self.is_periodic and not self.curve.corners
        if whole and callable(self.curve.shape) and bend.max() <= 0:  # a spline is defined for three periods only
            return [(-np.inf, np.inf)]
        for k in range(_SAMPLES):
            now = np.sign(bend[k]) if abs(bend[k]) * (b - a) > SLIGHT else sign
            turn += abs(bend[k]) * (s[k + 1] - s[k])
            # After a quarter of a turn, a point could have a second foot on the part, or on the tangents at its ends.
            if (sign and now != sign) or turn > np.pi / 2:
                cuts.append(float(s[k]))
                turn = 0.0
            sign = now
        cuts.append(b - inset)
        parts = []
        for low, high in pairwise(cuts):
            more = _OVERLAP * (high - low)
            low -= more * (whole or low > cuts[0])
            parts.append((low, high + more * (whole or high < cuts[-1])))
        return parts

    def corners_at(self, part: Part, side: float) -> tuple[float, float]:
        """Angles [rad] by which corners at the ends of a part turn away from the side; 0 at an end that is smooth."""
        found, (start, end) = [], self.curve.ends
        for s, sign in zip(part, (-1, 1), strict=True):
            beyond = s + sign * 3 * ROUNDING * self.period
            if not self.curve.closed and not start <= beyond <= end:
                found.append(np.pi / 2)
                continue
            if not self.is_periodic or self.curve.corners:
                beyond = start + (beyond - start) % self.period
            u, v = self._numbers(np.array([s, beyond]))[1]
            found.append(max(0.0, float(-side * sign * np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))))
        return found[0], found[1]

    def bend(self, part: Part, side: float) -> float:
        """The lowest curvature [1/m] of a part. The curvature is positive if the part bends away from the side."""
        low, high = part if np.isfinite(part[0]) else self.curve.ends
        inset = _OVERLAP * (high - low)
        _, d, dd = self._numbers(np.linspace(low + inset, high - inset, 100))
        return float((-side * (d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]) / np.hypot(*d.T) ** 3).min())

    def require_room(self, group: list[Part], side: float, radius: float, circle: str) -> None:
        """Raise DeclarationError if a circle touches a group of parts and also intersects the group elsewhere."""
        ends = [(a, b) if np.isfinite(a) else (0.0, self.period) for a, b in group]
        sampled = [self._numbers(np.linspace(a, b, 100)) for a, b in ends]
        x, d, _ = (np.vstack(part) for part in zip(*sampled, strict=True))
        normal = side * np.column_stack([-d[:, 1], d[:, 0]]) / np.hypot(*d.T)[:, None]
        center = x + radius * normal
        distance = np.hypot(*(center[:, None] - x[None]).transpose(2, 0, 1)).min(axis=1)
        if (distance < (1 - SLIGHT) * radius).any():
            place = ", ".join(f"{value:.3g}" for value in x[distance.argmin()])
            raise DeclarationError(
                f"if {circle} of radius {radius:g} touches the curve at ({place}), it intersects the curve at other "
                "points, because the curve bends more tightly than the circle. Use a smaller circle, or one contact "
                "for each part of the curve"
            )


def _spline(points: object, closed: bool, corners: Array, s: ca.SX) -> tuple[ca.SX, float, Array]:
    """The position (2,) on the spline through points (n, 2) as an expression of s, the largest s, and s of corners."""
    from scipy.interpolate import CubicSpline

    x = _points(points, closed)
    if not np.isin(corners, np.arange(len(x))).all():
        raise DeclarationError(f"Curve: corners must be indices of points, from 0 to {len(x) - 1}.")
    at = np.unique(corners).astype(int)
    if closed:
        first = int(at[0]) if at.size else 0
        x, at = np.roll(x, -first, axis=0), at - first
        x = np.vstack([x, x[:1]])
    steps = np.hypot(*np.diff(x, axis=0).T)
    if not steps.all():
        raise DeclarationError("Curve: two successive points are equal. Omit one of them.")
    along = np.concatenate([[0.0], np.cumsum(steps)])
    smooth = closed and not at.size
    breaks = np.unique([0, *at.tolist(), len(x) - 1])
    rows = []
    for i, j in pairwise(breaks):
        piece = CubicSpline(along[i : j + 1], x[i : j + 1], bc_type="periodic" if smooth else "not-a-knot")
        rows.append(np.column_stack([along[i:j], *(piece.c[::-1, :, k].T for k in range(2))]))
    table = np.vstack(rows)
    if smooth:  # parts extend beyond the start and the end of the curve
        shift = np.zeros(9)
        shift[0] = along[-1]
        table = np.vstack([table - shift, table, table + shift])
    begins = table[:, 0]
    for k in range(3 - len(table)):  # Smooth needs three rows: the last polynomial is repeated beyond the end
        begins, table = np.append(begins, (k + 1) * along[-1]), np.vstack([table, table[-1:]])
    pieces = Smooth(np.zeros(len(table)), begins, table)
    begin, *c, _ = pieces(ca.SX(0), s)
    u = s - begin
    place = [c[k] + u * (c[k + 1] + u * (c[k + 2] + u * c[k + 3])) for k in (0, 4)]
    return ca.vertcat(*place), float(along[-1]), along[at]


def _points(points: object, closed: bool) -> Array:
    """The points (n, 2) as an array. The first point of a closed curve is not repeated at the end."""
    x = numbers_of(points)
    if x is None or x.ndim != 2 or x.shape[1] != 2 or not np.isfinite(x).all():
        raise DeclarationError("Curve: shape must be a function of s, or points (n, 2) of finite numbers.")
    if closed and np.allclose(x[0], x[-1], rtol=0, atol=ROUNDING * np.ptp(x)):
        x = x[:-1]
    if len(x) < 2 + closed:
        raise DeclarationError(f"Curve: {len(x)} points are too few. Pass at least {2 + closed} points.")
    return x
