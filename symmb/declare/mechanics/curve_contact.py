"""Contacts of circles with curves, and joints that hold a point on a curve."""

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
    """The unit normal (2,) of a curve with tangent `along`: to the left for side=1, to the right for side=-1."""
    return side * left(along) / ca.norm_2(along)


def _side(measured: Measured, inside: bool) -> float:
    """The side of the curve on which points are: 1 for the left side, -1 for the right side.

    Points are outside a closed curve, or to the left of an open curve, unless `inside` is true.
    """
    outside = -float(np.sign(measured.area)) if measured.curve.closed else 1.0
    return -outside if inside else outside


@dataclass(frozen=True, eq=False)
class CurveContact(ShapeContact):
    """Contact of a circle, point or curve with a curve in the xy plane of point_a's body, such as a roller and a cam.

    A foot is the point of the curve that is nearest to the circle. First-order states, `name.foot`, follow the feet.
    The curve is divided into parts that bend to one side by at most a quarter of a turn. Each part has a foot, and
    forces act at the nearest foot. In a concave corner, the circle can touch at two points, with a force at each point.
    A circle may touch an open curve from both sides. A point (radius 0) that is below an open curve is in contact.

    For two curves, each pair of parts has a foot on each curve, with the states `name.foot.a` and `name.foot.b`. Closed
    curves touch with their outer sides, open curves with their left sides. If one curve bends inward, the curvature of
    the other curve must be larger everywhere. Only one of the two curves may have corners.

    Parameters
    ----------
    name : str
    point_a : Point
        origin of the coordinates x and y of the curve
    curve : Curve
    point_b : Point
        centre of the circle, or origin of the coordinates x and y of `curve_b`
    radius : Expr
        radius of the circle [m]; 0 for a point. Two curves touch if their distance is `radius`
    law, friction
        see `Contact`
    inside : bool
        True: the circle is inside a closed curve, or to the right of an open curve. False: the circle is outside a
        closed curve, or to the left of an open curve, in the direction of increasing s, such as above y(x)
    curve_b : Curve, optional
        curve on point_b's body in place of the circle

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
            yield f"{self.title}: two curves cannot be used with spatial bodies. Use pose=Planar()."
        if all(isinstance(curve, Curve) and curve.corners for curve in (self.curve, self.curve_b)):
            yield f"{self.title}: only one of two curves may have corners. Replace corners of one curve by short arcs."

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        radius = self.number(bind, "radius")
        with faults_of(self.title, end="."):
            places = self._places(bind, float(ca.evalf(bind.nominal(radius))))
        fixed = [ca.substitute(curve.place, curve.s, 0) for curve in self._curves]  # parameters of the curves
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
        """For each possible contact, the parts of the curve, or the pairs of parts of both curves."""
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
        """The vector (6,) of squared distance [m^2], height of b [m], normal (2,) and point of b (2,); and the states.

        With `has_back`, a circle may be on either side of the curve. Without, heights below the curve are negative.
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
    """A joint that holds point b, or a roller about point b, on a curve in the xy plane of point_a's body.

    An example is a groove cam. The joint has one multiplier: minus the force [N] on body b along the normal of the
    curve. The normal points to the left of an open curve, and out of a closed curve. The joint has no friction. An open
    curve continues along its tangents beyond its ends.

    Parameters
    ----------
    name : str
    point_a : Point
        origin of the coordinates x and y of the curve
    point_b : Point
    curve : Curve
    radius : Expr
        radius of a roller on the curve [m]; with 0 the point itself is on the curve
    inside : bool
        see `CurveContact`
    unilateral : bool
        True: a warning gives the time at which the curve would have to pull, so that a roller lifts off

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> bead = mb.Body("bead", 1.0, pose=mb.Particle())
    >>> wire = mb.PointOnCurve("wire", mb.Ground().point(0, 0), bead.point(0, 0), mb.Curve(lambda s: (s, s**2), -2, 2))
    >>> system = mb.System(bead, wire, mb.Gravity(0, -10.0))
    >>> run = mb.simulate(mb.Scene(system, {"bead.x": 1.0}, [0.0, 0.5], guess={"bead.y": 1.0}))
    >>> np.abs(run["bead.y"] - run["bead.x"] ** 2).max().round(9)
    np.float64(0.0)
    """

    poses: ClassVar = ((Planar, Spatial), (Planar, Spatial, Particle))
    without: ClassVar[str] = "Use coordinates and points of the joint's bodies."

    curve: Curve
    radius: Expr = field(default=0.0, kw_only=True, metadata=NOT_NEGATIVE)
    inside: bool = field(default=False, kw_only=True, metadata=TRUTH)
    unilateral: bool = field(default=False, kw_only=True, metadata=TRUTH)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if isinstance(self.curve, Curve) and self.curve.corners:
            yield f"{self.title}: the curve must be smooth, but it has corners. Use CurveContact."

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
