"""Contacts of circles with curves, and points that are held on curves. One search finds the feet of both."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import chain, product
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._errors import faults_of
from symmb._types import Expr
from symmb.declare.mechanics.axis_joint import Joint
from symmb.declare.mechanics.body import Body, Point
from symmb.declare.mechanics.contact import distance_and_direction, touch
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.curve import Curve, Measured
from symmb.declare.mechanics.element import NOT_NEGATIVE, TRUTH, Bind
from symmb.declare.mechanics.feet import (
    ALL_SAMPLES,
    Bounds,
    Foot,
    Motion,
    Side,
    follow_curve,
    follow_point,
    left,
    require_room,
)
from symmb.declare.mechanics.force import Action
from symmb.declare.mechanics.friction import FrictionLaw
from symmb.declare.mechanics.pose import Particle, Planar, Spatial
from symmb.declare.mechanics.shape_contact import ShapeContact
from symmb.declare.symbolic import SOFT, Symbol, is_zero


def _normal(along: ca.SX, side: float) -> ca.SX:
    """The unit normal (2,) of a curve to the left for a side of 1, to the right for -1."""
    return side * left(along) / ca.norm_2(along)


def _side(measured: Measured, inside: bool) -> float:
    """1 if points lie to the left of the curve, -1 to the right: outside of a closed curve, unless they are inside."""
    outside = -float(np.sign(measured.area)) if measured.curve.closed else 1.0
    return -outside if inside else outside


@dataclass(frozen=True, eq=False)
class CurveContact(ShapeContact):
    """A circle, a point or another curve against a curve in the xy plane of point_a's body: a roller on a cam.

    The foot of the circle on the curve is a first-order state, `name.foot`, which follows the motion, one for each part
    that bends to one side by a quarter of a turn. The nearest one counts. In a corner, the circle can touch at two
    places, with a force at each. An open curve is thin, and has two sides for a circle; a point may be beneath it.

    Two curves have a foot on each, `name.foot.a` and `name.foot.b`, for each pair of parts. They touch with their
    outsides, open ones with their left sides. If one curve bends inward, the other must bend more tightly everywhere.
    One of them may have corners.

    Parameters
    ----------
    name : str
    point_a : Point
        where x and y of the curve are 0
    curve : Curve
    point_b : Point
        centre of the circle
    radius : Expr
        of the circle [m]; 0 is a point. Two curves are apart by it where they touch
    law, friction
        as of `Contact`
    inside : bool
        the circle is inside of a closed curve, or to the right of an open one. It is else outside, or to the left in
        the direction of rising s, as above y(x)
    curve_b : Curve, optional
        of point_b's body, which touches in place of a circle

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
    radius: Expr = field(metadata=NOT_NEGATIVE)
    law: ContactLaw
    friction: FrictionLaw | None = None
    inside: bool = field(default=False, metadata=TRUTH)
    curve_b: Curve | None = None

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if self.curve_b is not None and any(isinstance(body.pose, Spatial) for body in self.bodies()):
            yield f"{self.title}: two curves touch in one plane, which spatial bodies leave. Use pose=Planar()."
        if all(isinstance(curve, Curve) and curve.corners for curve in (self.curve, self.curve_b)):
            yield f"{self.title}: corners of one curve touch no corners of the other. Round these off by short arcs."

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        radius = self.number(bind, "radius")
        with faults_of(self.title, end="."):
            places = self._places(bind, float(ca.evalf(bind.nominal(radius))))
        fixed = [ca.substitute(curve.place, curve.s, 0) for curve in self._curves]  # what else they depend on
        count, number = sum(map(len, places)), 0
        motion = Motion.of(self.offset[:2], (self.point_a.body.frame.R.T @ self.point_b.body.frame.R)[:2, :2])
        for k, place in enumerate(places):
            found = []
            for sides in place:
                number += 1
                name = f"{self.name}.foot" if count == 1 else f"{self.name}.foot_{number}"
                found.append(self._found(sides, motion, name, not (self.curve.closed or is_zero(radius))))
            yield Action((), states=tuple(chain.from_iterable(states for _, states in found)))
            best = reduce(lambda a, b: ca.if_else(b[0] - a[0] < -SOFT, b, a), [feet for feet, _ in found])
            height, normal, on_b = best[1], best[2:4], best[4:]
            b = Point(self.point_b.body, self.point_b.s + ca.vertcat(on_b, 0))
            yield from touch(
                self,
                bind,
                self.point_a.body,
                b,
                radius,
                ca.vertcat(normal, 0),
                height,
                *(self.point_a.s, self.point_b.s, *fixed),
                rate=ca.dot(normal, motion.velocity(on_b)),
                name=self.name if len(places) == 1 else f"{self.name}.{k + 1}",
            )

    @property
    def _curves(self) -> tuple[Curve, ...]:
        return (self.curve,) if self.curve_b is None else (self.curve, self.curve_b)

    def _places(self, bind: Bind, radius: float) -> list[list[tuple[Side, ...]]]:
        """For each place at which there may be contact, the parts of the curve, or pairs of parts of both."""
        measured = [curve.measured(bind) for curve in self._curves]
        groups = [
            [[Side(some, part, side) for part in group] for group in some.groups(side)]
            for some, side in zip(measured, (_side(measured[0], self.inside), _side(measured[-1], False)), strict=False)
        ]
        for own, others in (groups, groups[::-1]) if self.curve_b is not None else [(groups[0], None)]:
            for group in own:
                require_room(group, others, radius)
        if self.curve_b is None:
            return [[(side,) for side in group] for group in groups[0]]
        # Two parts that bend inward cannot touch each other.
        pairs = [[(a, b) for a, b in product(*both) if not (a.is_hollow and b.is_hollow)] for both in product(*groups)]
        return [some for some in pairs if some]

    def _found(
        self, sides: tuple[Side, ...], motion: Motion, name: str, has_back: bool
    ) -> tuple[ca.SX, tuple[Symbol, ...]]:
        """Squared distance, height of b [m], the normal there (2,) and the place on b (2,); and the states.

        A curve that has a back is thin: a circle is on either side of it. Beneath others heights are negative.
        """
        if self.curve_b is not None:
            feet, states = follow_curve(sides[0], sides[1], motion, name)
            return ca.vertcat(feet.cost, ca.dot(feet.offset, feet.normal), feet.normal, feet.on_b), states
        foot, state = follow_point(sides[0], motion.P, name)
        normal, (distance, away) = _normal(foot.along, sides[0].side), distance_and_direction(foot.offset)
        beyond = ca.SX(1) if has_back else foot.beyond
        height, normal = ca.if_else(beyond, distance, ca.dot(foot.offset, normal)), ca.if_else(beyond, away, normal)
        return ca.vertcat(ca.sumsqr(foot.offset), height, normal, 0, 0), (state,)


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
        as of `CurveContact`
    unilateral : bool
        a warning says from when on the curve would have to pull, so that a roller on a cam would lift off

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
    radius: Expr = field(default=0.0, kw_only=True, metadata=NOT_NEGATIVE)
    inside: bool = field(default=False, kw_only=True, metadata=TRUTH)
    unilateral: bool = field(default=False, kw_only=True, metadata=TRUTH)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if isinstance(self.curve, Curve) and self.curve.corners:
            yield f"{self.title}: its curve has corners, at which a motion cannot turn suddenly. Use CurveContact."

    def position_rows(self, bind: Bind) -> ca.SX:
        curve, P = self.curve, (self.point_a.body.frame.R.T @ self.d)[:2]
        with faults_of(self.title, end="."):
            side = _side(curve.measured(bind), self.inside)
        radius = self.number(bind, "radius")

        def foot_at(s: ca.SX) -> Foot:
            return Foot.at(curve, s, P, None if curve.closed else Bounds.of(s, curve.ends))

        foot = foot_at(curve.nearest(P, *curve.ends, ALL_SAMPLES, lambda s: s + foot_at(s).step))
        return ca.dot(foot.offset, _normal(foot.along, side)) - radius

    def pressure(self, lam: ca.SX) -> ca.SX:
        return -lam[0]
