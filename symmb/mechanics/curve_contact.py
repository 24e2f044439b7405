"""Contacts of circles with curves, and points that are held on curves. One search finds the feet of both."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import is_real, number_text, shown
from symmb._types import Expr
from symmb.mechanics.axis_joint import Joint
from symmb.mechanics.body import Body, Point
from symmb.mechanics.contact import distance_and_direction, touch
from symmb.mechanics.contact_law import ContactLaw
from symmb.mechanics.curve import Curve, Measured, Part
from symmb.mechanics.element import Bind
from symmb.mechanics.force import Action
from symmb.mechanics.friction import FrictionLaw
from symmb.mechanics.pose import Particle, Planar, Spatial
from symmb.mechanics.shape_contact import ShapeContact
from symmb.symbolic import SOFT, Kind, Symbol, ddt, declare, is_zero

_CLOSE = 0.2
"""Least slope of the foot's condition, as a share of that of a straight line: it is 0 at a centre of curvature."""
_CATCH_UP = 100.0
"""A foot that is off comes e times nearer while the point moves by this share, 1 / 100, of the curve's length."""
_SAMPLES, _ALL_SAMPLES = 12, 64
"""Places on a part, and on a curve, from which the search of a foot chooses."""
_AT_REST = 1e-6
"""Speed [m/s] of a point at rest by which its foot still approaches."""


class Foot(NamedTuple):
    """The foot of P (2,) at the parameter s of a curve, which goes on straight beyond the ends of a part.

    Attributes
    ----------
    offset, along : (2,)     from the place on the part to P [m], and derivative of the curve by s
    miss, slope              minus half the rate of the squared distance by s, and its slope [m^2]
    beyond                   whether s is beyond the ends
    """

    offset: ca.SX
    along: ca.SX
    miss: ca.SX
    slope: ca.SX
    beyond: ca.SX

    @property
    def step(self) -> ca.SX:
        """Newton's step of s."""
        return self.miss / self.slope


class Bounds(NamedTuple):
    """Ends of a part, and whether its foot is beyond them."""

    low: ca.SX
    high: ca.SX
    before: ca.SX
    behind: ca.SX

    @classmethod
    def of(cls, s: ca.SX, low: Expr, high: Expr) -> "Bounds":
        """Those at the parameter s."""
        return cls(ca.SX(low), ca.SX(high), s < low, s > high)


def _foot(curve: Curve, s: ca.SX, P: ca.SX, bounds: Bounds | None = None) -> Foot:
    """The foot of P (2,) at s, on the curve, or on the tangents at the ends of a part."""
    on, beyond = s, ca.SX(0)
    if bounds is not None:
        on = ca.if_else(bounds.before, bounds.low, ca.if_else(bounds.behind, bounds.high, s))
        beyond = ca.logic_or(bounds.before, bounds.behind)
    place, along, bend = curve.at(on)
    offset = P - place
    straight, curved = ca.sumsqr(along), ca.dot(offset, bend)
    slope = straight - (curved if bounds is None else ca.if_else(beyond, 0, curved))
    is_close = slope - _CLOSE * straight < -SOFT
    slope = ca.if_else(is_close, _CLOSE * straight, slope)
    return Foot(offset, along, ca.dot(along, offset - along * (s - on)), slope, beyond)


def _normal(along: ca.SX, side: float) -> ca.SX:
    """The unit normal (2,) of a curve to the left for a side of 1, to the right for -1."""
    return side * ca.vertcat(-along[1], along[0]) / ca.norm_2(along)


def _side(measured: Measured, inside: bool) -> float:
    """1 if points lie to the left of the curve, -1 to the right: outside of a closed curve, unless they are inside."""
    outside = -float(np.sign(measured.area)) if measured.curve.closed else 1.0
    return -outside if inside else outside


def _curve_faults(title: str, curve: object, radius: Expr) -> Iterator[str]:
    if not isinstance(curve, Curve):
        yield f"{title}: expected a curve, got {shown(curve)}. Use Curve(...)."
    if is_real(radius) and not radius >= 0:
        yield f"{title}: radius is {number_text(radius)}; it must be at least 0."


@dataclass(frozen=True, eq=False)
class CurveContact(ShapeContact):
    """A circle, or a point, against a curve in the xy plane of point_a's body: a roller on a cam, a ball on a track.

    The foot of the circle on the curve is a first-order state, `name.foot`, which follows the motion, one for each part
    that bends to one side by a quarter of a turn. The nearest one counts. In a corner that the circle can lie in it
    touches at two places, with a force at each. An open curve is thin, and has two sides for a circle; a point may
    be beneath it.

    Parameters
    ----------
    name : str
    point_a : Point
        where x and y of the curve are 0
    curve : Curve
    point_b : Point
        centre of the circle
    radius : Expr
        of the circle [m]; 0 is a point
    law : ContactLaw
        `HuntCrossley(...)`, ...
    friction : FrictionLaw, optional
        `Coulomb(...)` or `Bristle(...)`
    inside : bool
        the circle is inside of a closed curve, or to the right of an open one. It is else outside, or to the left in
        the direction of rising s, as above y(x)

    Examples
    --------
    >>> import casadi as ca
    >>> import symmb as mb
    >>> bowl = mb.Curve(lambda s: (s, s**2), -2, 2)
    >>> ball, law = mb.Body("ball", 1.0, pose=mb.Particle()), mb.KelvinVoigt(1e4)
    >>> track = mb.CurveContact("track", mb.Ground().point(0, 0), bowl, ball.point(0, 0), 0.1, law)
    >>> system = mb.System(ball, track, mb.Gravity(0, -10.0))
    >>> scene = mb.Scene(system, {"ball.x": 0.0}, guess={"ball.y": 0.0995}, equilibrium=True)
    >>> mb.simulate(scene)["ball.y"].round(6)
    array([0.099])
    """

    name: str
    point_a: Point
    curve: Curve
    point_b: Point
    radius: Expr
    law: ContactLaw
    friction: FrictionLaw | None = None
    inside: bool = False

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        yield from _curve_faults(self.title, self.curve, self.radius)

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        radius, P = self.number(bind, "radius"), self.offset[:2]
        try:
            measured = self.curve.measured(bind)
            side = _side(measured, self.inside)
            groups = measured.groups(side)
            for group in groups:
                measured.require_room(group, side, float(ca.evalf(bind.nominal(radius))))
        except DeclarationError as error:
            raise DeclarationError(f"{self.title}: {error}.") from None
        count = sum(map(len, groups))
        numbers = iter(range(1, count + 1))
        for k, group in enumerate(groups):
            names = [f"{self.name}.foot" if count == 1 else f"{self.name}.foot_{next(numbers)}" for _ in group]
            feet = [self._following(P, part, name, measured) for part, name in zip(group, names, strict=True)]
            yield Action((), states=tuple(state for *_, state in feet))
            has_back = not (self.curve.closed or is_zero(radius))
            height, normal = _nearest([foot for foot, _ in feet], side, has_back)
            axis, rate = ca.vertcat(normal, 0), ca.dot(normal, ddt(P))
            fixed = (self.point_a.s, self.point_b.s, self._parameters)
            name = self.name if len(groups) == 1 else f"{self.name}.{k + 1}"
            yield from touch(
                self, bind, self.point_a.body, self.point_b, radius, axis, height, *fixed, rate=rate, name=name
            )

    @property
    def _parameters(self) -> ca.SX:
        """The curve without its parameter, to see what else it depends on."""
        return ca.substitute(self.curve.place, self.curve.s, 0)

    def _following(self, P: ca.SX, part: Part, name: str, measured: Measured) -> tuple[Foot, Symbol]:
        """The foot on a part of the curve, and the record of the state that follows it."""
        s, rate = ca.SX.sym(name), ddt(P)
        bounded = bool(np.isfinite(part[0]))

        def bounds_at(s: ca.SX) -> Bounds | None:
            return Bounds.of(s, *part) if bounded else None

        def moved(s: ca.SX, bounds: Bounds | None) -> ca.SX:
            return s + _foot(self.curve, s, P, bounds).step

        bounds = bounds_at(s)
        foot = _foot(self.curve, s, P, bounds)
        catch_up = _CATCH_UP / measured.length * ca.sqrt(ca.sumsqr(rate) + _AT_REST**2)
        following = ca.dot(foot.along, rate) / foot.slope + catch_up * foot.miss / ca.sumsqr(foot.along)
        low, high, samples = (*part, _SAMPLES) if bounded else (*self.curve.ends, _ALL_SAMPLES)
        start = self.curve.nearest(P, low, high, samples, lambda s: moved(s, bounds_at(s)))
        (state,) = declare([name], Kind.STATE, s, following, start)
        # The state only chooses the foot: two of Newton's steps leave of its error the fourth power.
        return _foot(self.curve, moved(moved(s, bounds), bounds), P, bounds), state


def _nearest(feet: Sequence[Foot], side: float, has_back: bool) -> tuple[ca.SX, ca.SX]:
    """Height of the point above the nearest foot [m] and the normal there (2,), which leads to the point at an end.

    A curve that has a back is thin: the point is on either side of it. Beneath others heights are negative.
    """
    found = []
    for foot in feet:
        normal, (distance, away) = _normal(foot.along, side), distance_and_direction(foot.offset)
        beyond = ca.SX(1) if has_back else foot.beyond
        height = ca.if_else(beyond, distance, ca.dot(foot.offset, normal))
        found.append(ca.vertcat(ca.sumsqr(foot.offset), height, ca.if_else(beyond, away, normal)))
    best = reduce(lambda a, b: ca.if_else(b[0] - a[0] < -SOFT, b, a), found)
    return best[1], best[2:]


@dataclass(frozen=True, eq=False)
class PointOnCurve(Joint):
    """Point b, or the centre of a roller about it, is held on a curve in the xy plane of point_a's body: a groove cam.

    Its one multiplier is minus the force on body b along the normal of the curve, which is to its left, or out of it if
    it is closed [N]. There is no friction. An open curve goes on straight beyond its ends.

    Parameters
    ----------
    name : str
    point_a : Point
        where x and y of the curve are 0
    point_b : Point
    curve : Curve
    radius : Expr
        of a roller that rolls on the curve [m]; 0 holds the point itself on it
    inside : bool
        the roller is inside of a closed curve, or to the right of an open one
    unilateral : bool
        a doubt tells from when on the curve would have to pull, so that a roller on a cam would lift off

    Examples
    --------
    >>> import symmb as mb
    >>> bead = mb.Body("bead", 1.0, pose=mb.Particle())
    >>> wire = mb.PointOnCurve("wire", mb.Ground().point(0, 0), bead.point(0, 0), mb.Curve(lambda s: (s, s**2), -2, 2))
    >>> system = mb.System(bead, wire, mb.Gravity(0, -10.0))
    >>> run = mb.simulate(mb.Scene(system, {"bead.x": 1.0}, [0.0, 0.5], guess={"bead.y": 1.0}))
    >>> (run["bead.y"] - run["bead.x"] ** 2).round(9)
    array([0., 0.])
    """

    poses: ClassVar = ((Planar, Spatial), (Planar, Spatial, Particle))
    without: ClassVar[str] = "Use coordinates and points of its bodies."

    curve: Curve
    radius: Expr = field(default=0.0, kw_only=True)
    inside: bool = field(default=False, kw_only=True)
    unilateral: bool = field(default=False, kw_only=True)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        yield from _curve_faults(self.title, self.curve, self.radius)
        if isinstance(self.curve, Curve) and self.curve.corners:
            yield f"{self.title}: its curve has corners, where no motion can turn at once. Use CurveContact."

    def position_rows(self, bind: Bind) -> ca.SX:
        curve, P = self.curve, (self.point_a.body.frame.R.T @ self.d)[:2]
        try:
            side = _side(curve.measured(bind), self.inside)
        except DeclarationError as error:
            raise DeclarationError(f"{self.title}: {error}.") from None
        radius = bind(self.radius, f"{self.title}: radius")
        low, high = curve.ends

        def foot_at(s: ca.SX) -> Foot:
            """The foot at s. Rows and their slopes go over the ends of an open curve without a jump."""
            bounds = Bounds(ca.SX(low), ca.SX(high), s - low < -SOFT, high - s < -SOFT)
            return _foot(curve, s, P, None if curve.closed else bounds)

        foot = foot_at(curve.nearest(P, low, high, _ALL_SAMPLES, lambda s: s + foot_at(s).step))
        return ca.dot(foot.offset, _normal(foot.along, side)) - radius

    def pressure(self, lam: ca.SX) -> ca.SX:
        return -lam[0]
