"""Ropes over fixed points and round pulleys."""

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
"""A point, or a pulley with its signed radius."""
_TOUCHING = SLIGHT
"""Share of the square of a radius by which a rope that touches its pulley may be within it, by rounding."""


@dataclass(frozen=True, eq=False)
class Rope(ForceElement):
    """A rope that pulls k (l - length) + c (l' - length') if its way l is longer than its length, and never pushes.

    It slides without friction over the points between its ends, and round pulleys in the xy plane. Its pull is the same
    everywhere. A slack rope has no force. It leaves a pulley when it would have to pull the pulley, and is then
    straight. It may wind round a pulley several times. Both are found as if it were always tight.

    Each pulley has a first-order state, `rope.wrap1` for the second point of a rope of this name: the angle [rad] by
    which the line through the points turns there, positive where the rope lies on the pulley. It counts whole turns,
    and the start determines it.

    Parameters
    ----------
    name : str
    points : sequence
        the ends and what the rope goes over, in order: points, or pulleys (centre, radius). A positive radius [m] is
        one that the rope goes round anticlockwise, a negative one clockwise. At the start it lies on a pulley by less
        than three quarters of a turn
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

    def course(self, bind: Bind) -> "Course":
        """The way that it takes."""
        points = [point for point, _ in self._wraps]
        radii = [bind(0 if r is None else r, f"{self.title}: radius") for _, r in self._wraps]
        straights = self._straights(bind, points, radii)
        triples = [(i, j, k) for i, j in straights for h, k in straights if h == j and not radii[j].is_zero()]
        wraps = {
            (i, j, k): self._wrap(j, straights[i, j], straights[j, k], radii[j])
            for i, j, k in sorted(triples, key=lambda triple: triple[2] - triple[0])  # first those between neighbours
        }
        return Course.taut([point.r for point in points], radii, straights, wraps)

    def _straights(
        self, bind: Bind, points: Sequence[Point], radii: Sequence[ca.SX]
    ) -> "dict[tuple[int, int], Straight]":
        """The straight parts that it may have, by the numbers of two points: pulleys between these may be left."""
        straights: dict[tuple[int, int], Straight] = {}
        for j in range(1, len(points)):
            for i in range(j - 1, -1, -1):
                a, b = points[i], points[j]
                room = a.body is not b.body or float(ca.evalf(bind.nominal(_room(b.s - a.s, radii[i], radii[j]))))
                if room < 0 and i == j - 1:
                    raise DeclarationError(
                        f"{self.title}: two of its points are closer than the radius of their pulley."
                    )
                if room > MEETING**2 or i == j - 1:  # coaxial pulleys have no straight part between them
                    straights[i, j] = Straight.between(a.r, b.r, radii[i], radii[j])
                if radii[i].is_zero():
                    break
        return straights

    def _wrap(self, pulley: int, before: "Straight", behind: "Straight", radius: ca.SX) -> ca.SX:
        """Angle by which a pulley turns the way between two straight parts [rad]: below 0 the rope has left it.

        Directions determine it up to whole turns. A first-order state named `name.wrap1`, by the pulley's place in the
        rope, follows the angle between the lines to the centres of its neighbours. It only chooses the number of turns.
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
        s, c = ca.sin(near), ca.cos(near)
        return near + ca.atan2(sine * c - cosine * s, cosine * c + sine * s)

    @cached_property
    def _turns(self) -> dict[int, tuple[Symbol, ca.SX]]:
        """The states of its pulleys, which live as long as the rope, and angles next to which wraps are."""
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
            "it is wound up{}. A load is in its pulley, or it is shorter than its fixed part. Stop the winch before.",
        )
        yield ca.vertcat(ca.SX(0, 1), *course.far_sides), "it meets a pulley{} on the side where it does not lie."

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        points, course, length = [point for point, _ in self._wraps], self.course(bind), self.number(bind, "length")

        def loads(pull: ca.SX) -> tuple[Load, ...]:
            """The pull of the straight parts on both sides of each point. Round a pulley it acts on the centre."""
            return tuple(force_at(p, pull * turn) for p, turn in zip(points, course.pulls, strict=True))

        law = bound(KelvinVoigt(self.stiffness, self.damping), bind, self.title)
        yield press(law, course.length - length, loads, length, *course.radii, *(point.s for point in points))


def _parts(wrap: Wrap) -> tuple[Point, Expr | None]:
    """The point, or the centre of a pulley and its radius."""
    return (wrap[0], wrap[1]) if isinstance(wrap, tuple) and len(wrap) == 2 else (wrap, None)  # pyright: ignore


def _room(d: ca.SX, r: ca.SX, s: ca.SX) -> ca.SX:
    """Square of the length of a straight part between circles of signed radii whose centres are apart by d [m^2]."""
    return ca.sumsqr(d) - (s - r) ** 2


@dataclass(frozen=True, eq=False)
class Straight:
    """A straight part that a rope may have between two of its points, which need not be neighbours."""

    ends: tuple[ca.SX, ca.SX]  # (3,) each, where it touches the two circles [m]
    room: ca.SX  # square of its length, below 0 where one circle is within the other [m^2]
    length: ca.SX  # [m]
    direction: ca.SX  # (3,)
    lean: ca.SX  # angle from the line of the centres to it [rad]
    turning: ca.SX  # angular velocity of the line of the centres [rad/s]

    @classmethod
    def between(cls, a: ca.SX, b: ca.SX, r: ca.SX, s: ca.SX) -> "Straight":
        """The straight part between circles of radii r and s about a and b (3,), whose centres are apart by d.

        It is turned from the line of the centres by an angle of sine (r - s) / |d|.
        """
        d, across = b - a, s - r
        squared = ca.fmax(ca.sumsqr(d), MEETING**2 + across**2)  # in a pulley the straight part has no length
        length = ca.sqrt(squared - across**2)
        u = (length * d - across * ca.cross(Z, d)) / squared
        ends = a - r * ca.cross(Z, u), b - s * ca.cross(Z, u)
        turning = ca.dot(ca.cross(Z, d), ddt(d)) / (ca.sumsqr(d) + MEETING**2)
        return cls(ends, _room(d, r, s), length, u, ca.atan2(-across, length), turning)


@dataclass(frozen=True, eq=False)
class Course:
    """The way of a rope that is tight, or would be."""

    length: ca.SX  # [m]
    radii: Sequence[ca.SX]  # signed ones, 0 of points [m]
    places: Sequence[ca.SX]  # (3,) each, of points and centres of pulleys [m]
    straights: dict[tuple[int, int], Straight]  # the straight parts that it may have, by the numbers of two points
    shares: dict[tuple[int, int], ca.SX]  # 1 of those that it has, 0 of the others

    @classmethod
    def taut(
        cls,
        places: Sequence[ca.SX],
        radii: Sequence[ca.SX],
        straights: dict[tuple[int, int], Straight],
        wraps: dict[tuple[int, int, int], ca.SX],
    ) -> "Course":
        """The way over places (3,) that leaves the pulleys that it need not touch.

        On this way no wrap is negative, and none would be positive of a pulley that it leaves out: there is one such
        way. `faults` sum up by how much others fail, from the first point up to each straight part.
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
            """What it costs to reach point i from its predecessors, and to go on to point j."""
            found = []
            for h in range(i):
                if (h, i) in straights:
                    wrap = wraps.get((h, i, j), ca.SX(0))
                    found.append((faults[h, i] + _above(-wrap), ways[h, i] + ca.fabs(radii[i]) * wrap))
            return found or [(ca.SX(0), ca.SX(0))]

        for i, j in straights:
            left_out = [_above(wraps[i, m, j]) for m in range(i + 1, j) if (i, m, j) in wraps]
            fault, way = least(arrivals(i, j))
            faults[i, j], ways[i, j] = sum(left_out, fault), way + lengths[i, j]
        _, way = least(arrivals(len(places) - 1))
        symbols = ca.vertcat(*lengths.values())
        shares = dict(zip(straights, ca.vertsplit(ca.densify(ca.gradient(way, symbols))), strict=True))
        way = ca.substitute(way, symbols, ca.vertcat(*[part.length for part in straights.values()]))
        return cls(way, radii, places, straights, shares)

    @property
    def pulls(self) -> list[ca.SX]:
        """The sum (3,) of the directions in which it leaves each point."""
        sums = [ca.SX(3, 1) for _ in self.places]
        for (i, j), part in self.straights.items():
            sums[i] += self.shares[i, j] * part.direction
            sums[j] -= self.shares[i, j] * part.direction
        return sums

    @property
    def far_sides(self) -> Iterator[ca.SX]:
        """Squared distances of straight parts from the pulleys that they leave out, less squared radii [m^2]."""
        for (i, j), part in self.straights.items():
            for m in range(i + 1, j):
                start, _ = part.ends
                along = ca.fmin(ca.fmax(ca.dot(self.places[m] - start, part.direction), 0), part.length)
                beside = ca.sumsqr(start + along * part.direction - self.places[m])
                yield self.shares[i, j] * (beside - (1 - _TOUCHING) * self.radii[m] ** 2)


def _above(wrap: ca.SX) -> ca.SX:
    """A wrap where it is above 0, else 0."""
    return ca.if_else(-wrap < -SOFT, wrap, 0)
