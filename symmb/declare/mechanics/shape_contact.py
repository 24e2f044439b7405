"""Contacts of circles, slots, spheres and boxes, whose contact points have closed forms."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import product

import casadi as ca

from symmb._options import is_real, shown
from symmb._types import Expr
from symmb.declare.mechanics.body import Body, Point
from symmb.declare.mechanics.contact import SurfaceContact, distance_and_direction, touch
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.element import DIRECTION, NOT_NEGATIVE, TRUTH, Bind
from symmb.declare.mechanics.force import Action
from symmb.declare.mechanics.friction import FrictionLaw
from symmb.declare.mechanics.pose import Planar
from symmb.declare.symbolic import components, unit, vector


class ShapeContact(SurfaceContact):
    """A contact of a shape about point a with a round shape about point b."""

    point_a: Point
    point_b: Point

    @property
    def offset(self) -> ca.SX:
        """Vector from point a to point b in the axes of body a [m], (3,)."""
        return self.point_a.body.frame.R.T @ (self.point_b.r - self.point_a.r)

    def round(self, bind: Bind, d: ca.SX, *fixed: ca.SX, inside: bool) -> Iterator[Action]:
        """Actions between round shapes. d (3,) [m] leads from centre a to centre b, in the axes of body a."""
        radius_a, radius_b = (self.number(bind, what) for what in ("radius_a", "radius_b"))
        # At the centre the direction to the wall is not defined. So the distance has a lower limit, half the play, at
        # which no force acts. Derivatives are then finite at the centre.
        distance, out = distance_and_direction(d, (radius_a - radius_b) / 2 if inside else 0.0)
        axis, height = (-out, radius_a - distance) if inside else (out, distance - radius_a)
        fixed = (self.point_a.s, self.point_b.s, radius_a, *fixed)
        yield from touch(self, bind, self.point_a.body, self.point_b, radius_b, axis, height, *fixed)


class RoundContact(ShapeContact):
    """A contact with a round shape, which is outside or inside the other shape."""

    radius_a: Expr
    radius_b: Expr
    inside: bool

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if self.inside is True and is_real(self.radius_a) and is_real(self.radius_b):
            if not self.radius_b < self.radius_a:
                yield f"{self.title}: with inside=True, radius_b must be below radius_a. Use a smaller radius_b."


@dataclass(frozen=True, eq=False)
class CircleContact(RoundContact):
    """Contact of two circles in the xy plane of point_a's body. One circle is outside or inside the other circle.

    With spatial bodies, the circles are cylinders along the z axis of point_a's body.

    Parameters
    ----------
    name : str
    point_a, point_b : Point
        centres of the circles
    radius_a, radius_b : Expr
        radii of the circles [m]
    law, friction
        see `Contact`
    inside : bool
        whether circle b is inside circle a

    Examples
    --------
    >>> import symmb as mb
    >>> roll = mb.Body("roll", 1.0, pose=mb.Particle())
    >>> law = mb.KelvinVoigt(1e6)
    >>> ring = mb.CircleContact("ring", mb.Ground().point(0, 0), roll.point(0, 0), 0.5, 0.1, law, inside=True)
    >>> scene = mb.Scene(mb.System(roll, ring), {"roll.vx": 1.0}, [0.0, 0.4, 0.5])
    >>> mb.simulate(scene)["roll.vx"].round(3)
    array([ 1.,  1., -1.])
    """

    name: str
    point_a: Point
    point_b: Point
    radius_a: Expr = field(metadata=NOT_NEGATIVE)
    radius_b: Expr = field(metadata=NOT_NEGATIVE)
    law: ContactLaw
    friction: FrictionLaw | None = None
    inside: bool = field(default=False, metadata=TRUTH)

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        d = self.offset
        yield from self.round(bind, ca.vertcat(d[0], d[1], 0), inside=self.inside)


@dataclass(frozen=True, eq=False)
class SphereContact(CircleContact):
    """Contact of two spheres. One sphere is outside or inside the other sphere.

    Parameters
    ----------
    name, point_a, point_b, radius_a, radius_b, law, friction, inside
        see `CircleContact`

    Examples
    --------
    >>> import symmb as mb
    >>> a, b = (mb.Body(name, 1.0, pose=mb.Particle()) for name in "ab")
    >>> hit = mb.SphereContact("hit", a.point(0, 0), b.point(0, 0), 0.1, 0.1, mb.HuntCrossley(1e7, 1.0, 1.0))
    >>> run = mb.simulate(mb.Scene(mb.System(a, b, hit), {"b.x": 0.5, "b.vx": -1.0}, [0.0, 0.4]))
    >>> float((run["b.vx"] - run["a.vx"])[-1].round(6))
    1.0
    """

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        yield from self.round(bind, self.offset, inside=self.inside)


@dataclass(frozen=True, eq=False)
class SlotContact(RoundContact):
    """A pin in a slot with round ends, in the xy plane of point_a's body.

    Parameters
    ----------
    name : str
    point_a : Point
        centre of the slot's first round end
    point_b : Point
        centre of the pin
    axis : tuple
        direction from the first to the second end, in the axes of point_a's body
    length : Expr
        distance between the centres of the ends [m]
    radius_a, radius_b : Expr
        half the width of the slot, and radius of the pin [m]
    law, friction
        see `Contact`
    inside : bool
        False if the shape with round ends is solid, and the circle about point_b is outside

    Examples
    --------
    >>> import symmb as mb
    >>> pin, law = mb.Body("pin", 1.0, pose=mb.Particle()), mb.KelvinVoigt(1e6)
    >>> slot = mb.SlotContact("slot", mb.Ground().point(0, 0), pin.point(0, 0), (1, 0), 0.3, 0.06, 0.05, law)
    >>> scene = mb.Scene(mb.System(pin, slot), {"pin.vx": 1.0}, [0.0, 0.3, 0.4])
    >>> mb.simulate(scene)["pin.vx"].round(3)
    array([ 1.,  1., -1.])
    """

    name: str
    point_a: Point
    point_b: Point
    axis: tuple[Expr, ...] = field(metadata=DIRECTION)
    length: Expr = field(metadata=NOT_NEGATIVE)
    radius_a: Expr = field(metadata=NOT_NEGATIVE)
    radius_b: Expr = field(metadata=NOT_NEGATIVE)
    law: ContactLaw
    friction: FrictionLaw | None = None
    inside: bool = field(default=True, metadata=TRUTH)

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        d, axis, length = self.offset, unit(vector(self.axis)), self.number(bind, "length")
        along = ca.fmin(ca.fmax(ca.dot(d, axis), 0), length)
        across = d - along * axis
        yield from self.round(bind, ca.vertcat(across[0], across[1], 0), axis, length, inside=self.inside)


@dataclass(frozen=True, eq=False)
class BoxContact(ShapeContact):
    """Contact of a box with a sphere, or of the corners of a box with a plane.

    Parameters
    ----------
    name : str
    point_a : Point
        centre of the box. The sides of the box are parallel to the axes of point_a's body
    sides : tuple
        side lengths (x, y, z) of the box, or (x, y) of a rectangle [m]
    point_b : Point
        centre of the sphere, or any point of the plane
    law, friction
        see `Contact`; on a plane, each corner has a normal force and friction
    radius : Expr
        radius of the sphere [m]; 0 for a point
    normal : tuple
        outward normal of the plane, in the axes of point_b's body; None for a sphere

    Examples
    --------
    >>> import symmb as mb
    >>> crate, law = mb.Body("crate", 10.0, 1.0, mb.Planar()), mb.KelvinVoigt(1e5, 1e3)
    >>> floor = mb.BoxContact("floor", crate.point(0, 0), (1.0, 0.5), mb.Ground().point(0, 0), law, normal=(0, 1))
    >>> system = mb.System(crate, floor, mb.Gravity(0, -10.0))
    >>> mb.simulate(mb.Scene(system, {"crate.x": 0.0}, guess={"crate.y": 0.249}, equilibrium=True))["crate.y"].round(6)
    array([0.2495])
    """

    name: str
    point_a: Point
    sides: tuple[Expr, ...]
    point_b: Point
    law: ContactLaw
    radius: Expr = field(default=0.0, metadata=NOT_NEGATIVE)
    normal: tuple[Expr, ...] | None = field(default=None, metadata=DIRECTION)
    friction: FrictionLaw | None = None

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        sides = components(self.sides) or []
        if len(sides) not in (2, 3):
            yield f"{self.title}: sides must be (x, y) or (x, y, z), got {shown(self.sides)}."
        elif any(is_real(side) and not side > 0 for side in sides):
            yield f"{self.title}: sides {shown(self.sides)} must be positive."
        elif len(sides) == 3 and any(isinstance(body.pose, Planar) for body in self.bodies()):
            yield f"{self.title}: a box on a planar body has two sides. Pass sides (x, y) or use pose=Spatial()."

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        half = [bind(side, f"{self.title}: sides") / 2 for side in components(self.sides) or ()]
        yield from self._on_sphere(bind, half) if self.normal is None else self._on_plane(bind, half)

    def _on_plane(self, bind: Bind, half: Sequence[ca.SX]) -> Iterator[Action]:
        """Actions of all corners on the plane. Each corner is a point."""
        a, b, axis = self.point_a.body, self.point_b.body, unit(vector(self.normal))
        for signs in product((-1, 1), repeat=len(half)):
            arm = ca.vertcat(*[sign * h for sign, h in zip(signs, half, strict=True)], *[0] * (3 - len(half)))
            corner = Point(a, self.point_a.s + arm)
            height = ca.dot(axis, b.frame.R.T @ (corner.r - self.point_b.r))
            name = f"{self.name}.{''.join('-+'[sign > 0] for sign in signs)}"
            yield from touch(self, bind, b, corner, ca.SX(0), axis, height, corner.s, self.point_b.s, axis, name=name)

    def _on_sphere(self, bind: Bind, half: Sequence[ca.SX]) -> Iterator[Action]:
        """Actions at the point of the box's surface that is nearest to the centre of the sphere."""
        d, n = self.offset, len(half)
        radius, sizes, flat = self.number(bind, "radius"), ca.vertcat(*half), [0] * (3 - n)
        beside = d[:n] - ca.fmin(ca.fmax(d[:n], -sizes), sizes)
        distance, outward = distance_and_direction(ca.vertcat(beside, *flat))
        out = ca.vertsplit(ca.fabs(d[:n]) - sizes)  # from the planes of the faces
        is_next = [
            reduce(
                ca.logic_and, [out[k] > other if i < k else out[k] >= other for i, other in enumerate(out) if i != k]
            )
            for k in range(n)
        ]
        face = ca.vertcat(*[ca.if_else(test, ca.sign(d[k]), 0) for k, test in enumerate(is_next)], *flat)
        depth = reduce(ca.fmax, out)
        axis, height = ca.if_else(depth < 0, face, outward), ca.if_else(depth < 0, depth, distance)
        yield from touch(self, bind, self.point_a.body, self.point_b, radius, axis, height, self.point_a.s, sizes)
