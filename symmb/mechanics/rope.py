"""Ropes over fixed points and round pulleys."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import casadi as ca

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import Expr
from symmb.mechanics.body import AbstractBody, Body, Point
from symmb.mechanics.contact import press
from symmb.mechanics.contact_law import KelvinVoigt
from symmb.mechanics.element import NOT_NEGATIVE, POSITIVE, Bind, bound, pair_faults, point_faults
from symmb.mechanics.force import MEETING, Action, ForceElement, Load, force_at
from symmb.mechanics.pose import Spatial
from symmb.symbolic import Z

Wrap = Point | tuple[Point, Expr]
"""A point, or a pulley with its signed radius."""


@dataclass(frozen=True, eq=False)
class Rope(ForceElement):
    """A rope that pulls k (l - length) + c l' where its way l is longer than it is, and never pushes.

    It slides without friction over the points between its ends, and round pulleys in the xy plane. Its pull is the same
    everywhere. Where it is slack, it has no force.

    Parameters
    ----------
    name : str
    points : sequence
        the ends and what the rope goes over, in order: points, or pulleys (centre, radius). A positive radius [m] is
        one that the rope goes round anticlockwise, a negative one clockwise, by less than three quarters of a turn
    stiffness : Expr
        k of the whole rope [N/m]
    length : Expr
        without load [m], with what lies on pulleys; of a winch an expression of `t` or of states
    damping : Expr
        c [N s/m]

    Examples
    --------
    >>> import symmb as mb
    >>> ground, load = mb.Ground(), mb.Body("load", 10.0, pose=mb.Particle())
    >>> rope = mb.Rope("rope", [ground.point(-1, 2), ground.point(0, 2), load.point(0, 0)], 1e4, length=2.5)
    >>> system = mb.System(load, rope, mb.Gravity(0, -10.0))
    >>> mb.simulate(mb.Scene(system, guess={"load.y": 0.4}, equilibrium=True))["load.y"].round(4)
    array([0.49])
    """

    name: str
    points: Sequence[Wrap]
    stiffness: Expr = field(metadata=POSITIVE)
    length: Expr = field(metadata=NOT_NEGATIVE)
    damping: Expr = field(default=0.0, metadata=NOT_NEGATIVE)

    def bodies(self) -> tuple[AbstractBody, ...]:
        return tuple(point.body for point, _ in self._wraps)

    @property
    def _wraps(self) -> list[tuple[Point, Expr | None]]:
        """The points with the radii of pulleys; none if `points` is no sequence."""
        return [_parts(wrap) for wrap in self.points] if isinstance(self.points, list | tuple) else []

    def faults(self) -> Iterator[str]:
        wraps = self._wraps
        if len(wraps) < 2:
            yield f"{self.title}: points {shown(self.points)} are no way. Give a list of two points or more."
            return
        faults = list(point_faults(self.title, *(point for point, _ in wraps)))
        yield from faults
        if faults:
            return
        yield from pair_faults(self.title, tuple({id(body): body for body in self.bodies()}.values()))
        if len({id(body) for body in self.bodies()}) == 1:
            yield f"{self.title}: all its points are on body {self.bodies()[0].name!r}, nothing is left to act on."
        are_pulleys = [radius is not None for _, radius in wraps]
        if any(are_pulleys) and any(isinstance(body.pose, Spatial) for body in self.bodies()):
            yield f"{self.title}: pulleys turn in the xy plane, which spatial bodies leave. Use pose=Planar()."
        if are_pulleys[0] or are_pulleys[-1]:
            yield f"{self.title}: it begins or ends with a pulley. Give a point, where it is fixed."
        yield from super().faults()

    def course(self, bind: Bind) -> tuple[list[tuple[ca.SX, ca.SX]], ca.SX]:
        """World ends (3,) [m] of its straight parts, and by how much it is longer than its way [m]."""
        points = [point.r for point, _ in self._wraps]
        radii = [bind(0 if r is None else r, f"{self.title}: radius") for _, r in self._wraps]
        way, directions = _way(points, radii)
        parts = [
            (a - r * ca.cross(Z, u), b - s * ca.cross(Z, u))  # beside the centres, where it touches the pulleys
            for ((a, r), (b, s)), u in zip(pairwise(zip(points, radii, strict=True)), directions, strict=True)
        ]
        return parts, bind(self.length, f"{self.title}: length") - way

    def room(self, bind: Bind) -> ca.SX:
        """What is above 0 until the rope is wound up: squares of straight parts [m^2], and the length of free parts."""
        free = bind(self.length, f"{self.title}: length")
        parts = []
        for (a, r), (b, s) in pairwise(self._wraps):
            parts.append(ca.sumsqr(b.r - a.r) - (bind(s or 0, "radius") - bind(r or 0, "radius")) ** 2)
            free -= ca.sqrt(ca.fmax(parts[-1], 0)) if a.body is b.body else 0
        return ca.vertcat(free, *parts)

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        radii = [bind(0 if r is None else r, f"{self.title}: radius") for _, r in self._wraps]
        points = [point for point, _ in self._wraps]
        for (a, r), (b, s) in pairwise(zip(points, radii, strict=True)):
            room = ca.sumsqr(b.s - a.s) - (s - r) ** 2
            if a.body is b.body and float(ca.evalf(bind.nominal(room))) < 0:
                raise DeclarationError(f"{self.title}: two of its points are closer than the radius of their pulley.")
        length = bind(self.length, f"{self.title}: length")
        way, directions = _way([point.r for point in points], radii)

        def loads(pull: ca.SX) -> tuple[Load, ...]:
            """The pull of the straight parts on both sides of each point. Round a pulley it acts on the centre."""
            before, behind = [ca.SX(3, 1), *directions], [*directions, ca.SX(3, 1)]
            return tuple(force_at(p, pull * (v - u)) for p, u, v in zip(points, before, behind, strict=True))

        law = bound(KelvinVoigt(self.stiffness, self.damping), bind, self.title)
        yield press(law, way - length, loads, length, *radii, *(point.s for point in points))


def _parts(wrap: Wrap) -> tuple[Point, Expr | None]:
    """The point, or the centre of a pulley and its radius."""
    return (wrap[0], wrap[1]) if isinstance(wrap, tuple) and len(wrap) == 2 else (wrap, None)  # pyright: ignore


def _way(places: Sequence[ca.SX], radii: Sequence[ca.SX]) -> tuple[ca.SX, list[ca.SX]]:
    """Length of the way over places (3,) [m], and the directions (3,) of its straight parts.

    A straight part touches both circles of radii r and s, whose centres are apart by d: its length is
    sqrt(d^2 - (r - s)^2), and it is turned from the line of the centres by an angle of sine (r - s) / |d|.
    """
    way, directions = ca.SX(0), []
    for (a, r), (b, s) in pairwise(zip(places, radii, strict=True)):
        d, across = b - a, s - r
        squared = ca.fmax(ca.sumsqr(d), MEETING**2 + across**2)  # in a pulley the straight part has no length
        straight = ca.sqrt(squared - across**2)
        directions.append((straight * d - across * ca.cross(Z, d)) / squared)
        way += straight
    for radius, (before, behind) in zip(radii[1:-1], pairwise(directions), strict=True):
        if not radius.is_zero():
            # Angles from -1/4 to 3/4 of a turn: a rope that leaves its pulley has none below 0.
            side = ca.sign(radius)
            sine, cosine = side * (before[0] * behind[1] - before[1] * behind[0]), ca.dot(before, behind)
            way += ca.fabs(radius) * (ca.pi / 2 + ca.atan2(-cosine, sine))
    return way, directions
