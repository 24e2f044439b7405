"""Ropes over points and round pulleys."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from symmb._errors import DeclarationError
from symmb._magnitudes import MEETING, SLIGHT
from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics.body import AbstractBody, Body, Point
from symmb.declare.mechanics.contact import press
from symmb.declare.mechanics.contact_law import KelvinVoigt
from symmb.declare.mechanics.element import NOT_NEGATIVE, POSITIVE, Bind, bound, pair_faults, point_faults
from symmb.declare.mechanics.force import Action, ForceElement, Load, force_at
from symmb.declare.mechanics.pose import Spatial
from symmb.declare.symbolic import SOFT, Kind, Symbol, Z, ddt, declare

Wrap = Point | tuple[Point, Expr]
"""A point, or the centre of a pulley with its signed radius."""


@dataclass(frozen=True, eq=False)
class Rope(ForceElement):
    """A rope that never pushes. If its path l is longer than `length`, it pulls with k (l - length) + c (l' - length').

    The rope slides without friction over the points between its ends, and round pulleys in the xy plane. The pull is
    the same everywhere in the rope. A slack rope has no force. The rope only pushes pulleys: it leaves a pulley that it
    would have to pull. The rope may go round a pulley several times. The path is computed as if the rope were tight.

    Each pulley has a first-order state, such as `rope.wrap1` for the second point of a rope called `rope`. The state is
    the angle [rad] by which the line through the points turns at the pulley. The angle is positive if the rope touches
    the pulley, and includes whole turns. The initial value of the state follows from the positions at the start.

    Parameters
    ----------
    name : str
    points : sequence
        all points of the rope from end to end: points, or pulleys (centre, radius). The rope goes round a pulley
        anticlockwise if the radius [m] is positive, and clockwise if it is negative. At the start the rope turns by
        less than three quarters of a turn at each pulley
    stiffness : Expr
        stiffness k of the whole rope [N/m]
    length : Expr
        length without load [m], including the parts on pulleys. Use an expression of `t` or of states for a winch
    damping : Expr
        damping c [N s/m]

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
        """The points with the radii of pulleys; empty if `points` is not a sequence."""
        return [_parts(wrap) for wrap in self.points] if isinstance(self.points, list | tuple) else []

    def faults(self) -> Iterator[str]:
        wraps = self._wraps
        if len(wraps) < 2:
            yield f"{self.title}: points must be a list of at least two points, got {shown(self.points)}."
            return
        faults = list(point_faults(self.title, *(point for point, _ in wraps)))
        yield from faults
        if faults:
            return
        yield from pair_faults(self.title, tuple({id(body): body for body in self.bodies()}.values()))
        if len({id(body) for body in self.bodies()}) == 1:
            name = self.bodies()[0].name
            yield f"{self.title}: all points are on body {name!r}, so the rope has no effect. Use points of two bodies."
        are_pulleys = [radius is not None for _, radius in wraps]
        if any(are_pulleys) and any(isinstance(body.pose, Spatial) for body in self.bodies()):
            yield f"{self.title}: pulleys cannot be used with spatial bodies. Use pose=Planar()."
        if are_pulleys[0] or are_pulleys[-1]:
            yield f"{self.title}: the first or the last point is a pulley. Use points at both ends of the rope."
        yield from super().faults()

    def course(self, bind: Bind) -> "Course":
        """The path of the rope, as if it were tight."""
        points = [point for point, _ in self._wraps]
        radii = [bind(0 if r is None else r, f"{self.title}: radius") for _, r in self._wraps]
        straights = self._straights(bind, points, radii)
        triples = [(i, j, k) for i, j in straights for h, k in straights if h == j and not radii[j].is_zero()]
        wraps = {
            (i, j, k): self._wrap(j, straights[i, j], straights[j, k], radii[j])
            for i, j, k in sorted(triples, key=lambda triple: triple[2] - triple[0])  # the first ones declare states
        }
        return Course.taut([point.r for point in points], radii, straights, wraps)

    def _straights(
        self, bind: Bind, points: Sequence[Point], radii: Sequence[ca.SX]
    ) -> "dict[tuple[int, int], Straight]":
        """All straight parts that the rope may have, by the indices (i, j) of their two points.

        The rope may leave the pulleys between points i and j.
        """
        straights: dict[tuple[int, int], Straight] = {}
        for j in range(1, len(points)):
            for i in range(j - 1, -1, -1):
                a, b = points[i], points[j]
                room = a.body is not b.body or float(ca.evalf(bind.nominal(_room(b.s - a.s, radii[i], radii[j]))))
                if room < 0 and i == j - 1:
                    raise DeclarationError(
                        f"{self.title}: points {i} and {j} are closer to each other than their pulleys allow. Move the "
                        "points apart, or use smaller radii."
                    )
                if room > MEETING**2 or i == j - 1:  # there is no straight part between coaxial pulleys
                    straights[i, j] = Straight.between(a.r, b.r, radii[i], radii[j])
                if radii[i].is_zero():
                    break
        return straights

    def _wrap(self, pulley: int, before: "Straight", behind: "Straight", radius: ca.SX) -> ca.SX:
        """Angle [rad] by which the path turns at a pulley between two straight parts; negative without contact.

        Directions determine the angle up to whole turns. A first-order state only chooses the number of turns. For
        point 1, the name of the state is `name.wrap1`. The state follows the angle between the lines to the centres of
        the pulley's neighbours.
        """
        side, (u, v) = ca.sign(radius), (before.direction, behind.direction)
        sine, cosine = side * (u[0] * v[1] - u[1] * v[0]), ca.dot(u, v)
        lean = side * (behind.lean - before.lean)
        if pulley not in self._turns:
            name, start = f"{self.name}.wrap{pulley}", ca.pi / 2 + ca.atan2(-cosine, sine)  # from -1/4 to 3/4 of a turn
            rate = side * (behind.turning - before.turning)
            (state,) = declare([name], Kind.STATE, ca.SX.sym(name), rate, start - lean)
            self._turns[pulley] = state, state.sx + lean
        _, near = self._turns[pulley]
        # `near` is subtracted from the angle before atan2 is used. The difference is far from the jump of atan2 at pi.
        s, c = ca.sin(near), ca.cos(near)
        return near + ca.atan2(sine * c - cosine * s, cosine * c + sine * s)

    @cached_property
    def _turns(self) -> dict[int, tuple[Symbol, ca.SX]]:
        """For each pulley, its state, and its wrap angle with an error of less than half a turn."""
        return {}

    def doubtful(self, bind: Bind) -> Iterator[tuple[ca.SX, str]]:
        course, free, rooms = self.course(bind), self.number(bind, "length"), []
        bodies = self.bodies()
        has_load = len({id(body) for body, r in zip(bodies, course.radii, strict=True) if r.is_zero()}) > 1
        for (i, j), part in course.straights.items():
            rooms.append(course.shares[i, j] * part.room)
            free -= course.shares[i, j] * part.length if has_load and bodies[i] is bodies[j] else 0
        yield (
            ca.vertcat(free, *rooms),
            "the rope is too short{}: an end has reached a pulley, or the rope is shorter than its fixed parts. Stop "
            "the winch earlier.",
        )
        yield (
            ca.vertcat(ca.SX(0, 1), *course.far_sides),
            "the rope meets a pulley{} from outside, and this contact is not modelled. Change the sign of the radius, "
            "or add a point.",
        )

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        points, course, length = [point for point, _ in self._wraps], self.course(bind), self.number(bind, "length")

        def loads(pull: ca.SX) -> tuple[Load, ...]:
            """The loads of the straight parts at each point. The loads of a pulley act at its centre."""
            return tuple(force_at(p, pull * turn) for p, turn in zip(points, course.pulls, strict=True))

        law = bound(KelvinVoigt(self.stiffness, self.damping), bind, self.title)
        yield press(law, course.length - length, loads, length, *course.radii, *(point.s for point in points))


def _parts(wrap: Wrap) -> tuple[Point, Expr | None]:
    """The point and None, or the centre and the radius of a pulley."""
    return (wrap[0], wrap[1]) if isinstance(wrap, tuple) and len(wrap) == 2 else (wrap, None)  # pyright: ignore


def _room(d: ca.SX, r: ca.SX, s: ca.SX) -> ca.SX:
    """Squared length [m^2] of a straight part between circles of signed radii r and s, with d between the centres."""
    return ca.sumsqr(d) - (s - r) ** 2


@dataclass(frozen=True, eq=False)
class Straight:
    """A straight part that a rope may have between two of its points. Other points may be between the two."""

    ends: tuple[ca.SX, ca.SX]  # (3,) each, where it touches the two circles [m]
    room: ca.SX  # squared length, negative if one circle is inside the other [m^2]
    length: ca.SX  # [m]
    direction: ca.SX  # (3,)
    lean: ca.SX  # angle from the line of the centres to the straight part [rad]
    turning: ca.SX  # angular velocity of the line of the centres [rad/s]

    @classmethod
    def between(cls, a: ca.SX, b: ca.SX, r: ca.SX, s: ca.SX) -> "Straight":
        """The straight part between the circles of radii r and s about the centres a and b (3,).

        The sine of the angle from the line of the centres to the straight part is (r - s) / |b - a|.
        """
        d, across = b - a, s - r
        squared = ca.fmax(ca.sumsqr(d), MEETING**2 + across**2)  # inside a pulley the length is 0
        length = ca.sqrt(squared - across**2)
        u = (length * d - across * ca.cross(Z, d)) / squared
        ends = a - r * ca.cross(Z, u), b - s * ca.cross(Z, u)
        turning = ca.dot(ca.cross(Z, d), ddt(d)) / (ca.sumsqr(d) + MEETING**2)
        return cls(ends, _room(d, r, s), length, u, ca.atan2(-across, length), turning)


@dataclass(frozen=True, eq=False)
class Course:
    """The path of a rope, as if the rope were tight."""

    length: ca.SX  # [m]
    radii: Sequence[ca.SX]  # signed radii, 0 for points [m]
    places: Sequence[ca.SX]  # positions (3,) of points and of centres of pulleys [m]
    straights: dict[tuple[int, int], Straight]  # possible straight parts, by the indices of two points
    shares: dict[tuple[int, int], ca.SX]  # 1 for the straight parts of the path, 0 for the others

    @classmethod
    def taut(
        cls,
        places: Sequence[ca.SX],
        radii: Sequence[ca.SX],
        straights: dict[tuple[int, int], Straight],
        wraps: dict[tuple[int, int, int], ca.SX],
    ) -> "Course":
        """The path over `places` (3,) that touches only the pulleys that it must touch.

        On this path no wrap is negative. If the path also touched another pulley, that wrap would not be positive. Only
        one path has these properties. `faults` are sums of violations from the first point up to a straight part.
        """
        lengths = {pair: ca.SX.sym("length") for pair in straights}
        faults: dict[tuple[int, int], ca.SX] = {}
        ways: dict[tuple[int, int], ca.SX] = {}

        def least(arrivals: list[tuple[ca.SX, ca.SX]]) -> tuple[ca.SX, ca.SX]:
            best = arrivals[0]
            for other in arrivals[1:]:
                is_better = other[0] < best[0]
                best = ca.if_else(is_better, other[0], best[0]), ca.if_else(is_better, other[1], best[1])
            return best

        def arrivals(i: int, j: int = -1) -> list[tuple[ca.SX, ca.SX]]:
            """The violation and the length of paths to point i that continue to point j, for each predecessor of i."""
            found = []
            for h in range(i):
                if (h, i) in straights:
                    wrap = wraps.get((h, i, j), ca.SX(0))
                    found.append((faults[h, i] + _above(-wrap), ways[h, i] + ca.fabs(radii[i]) * wrap))
            return found or [(ca.SX(0), ca.SX(0))]

        # Dynamic programming: the best path to each straight part extends a best path to a part before it. Switches
        # choose the best path during a run, so the expression is valid for all sets of touched pulleys.
        for i, j in straights:
            left_out = [_above(wraps[i, m, j]) for m in range(i + 1, j) if (i, m, j) in wraps]
            fault, way = least(arrivals(i, j))
            faults[i, j], ways[i, j] = sum(left_out, fault), way + lengths[i, j]
        _, way = least(arrivals(len(places) - 1))
        # The path's length is linear in the lengths of straight parts. The gradient shows which of them it contains.
        symbols = ca.vertcat(*lengths.values())
        shares = dict(zip(straights, ca.vertsplit(ca.densify(ca.gradient(way, symbols))), strict=True))
        way = ca.substitute(way, symbols, ca.vertcat(*[part.length for part in straights.values()]))
        return cls(way, radii, places, straights, shares)

    @property
    def pulls(self) -> list[ca.SX]:
        """The sums (3,) of the directions of the straight parts away from each point."""
        sums = [ca.SX(3, 1) for _ in self.places]
        for (i, j), part in self.straights.items():
            sums[i] += self.shares[i, j] * part.direction
            sums[j] -= self.shares[i, j] * part.direction
        return sums

    @property
    def far_sides(self) -> Iterator[ca.SX]:
        """Squared distances of straight parts from the pulleys that they do not touch, minus squared radii [m^2]."""
        for (i, j), part in self.straights.items():
            for m in range(i + 1, j):
                start, _ = part.ends
                along = ca.fmin(ca.fmax(ca.dot(self.places[m] - start, part.direction), 0), part.length)
                beside = ca.sumsqr(start + along * part.direction - self.places[m])
                yield self.shares[i, j] * (beside - (1 - SLIGHT) * self.radii[m] ** 2)


def _above(wrap: ca.SX) -> ca.SX:
    """The wrap if it is positive, else 0."""
    return ca.if_else(-wrap < -SOFT, wrap, 0)
