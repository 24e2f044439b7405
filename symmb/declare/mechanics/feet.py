"""Feet on curves: the points of a curve that are nearest to a point or to another curve. States follow the feet."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import MEETING, SLIGHT, SMALL
from symmb.declare.mechanics.curve import Curve, Measured, Part
from symmb.declare.symbolic import SOFT, Kind, Symbol, ddt, declare

_CLOSE = 0.2
"""Lower limit of (slope of a foot's condition) / (slope for a line). The slope is 0 at a centre of curvature."""
_CATCH_UP = 100.0
"""The error of a foot decreases by the factor e while the point moves by 1/100 of the length of the curve."""
_SAMPLES, ALL_SAMPLES = 12, 64
"""Numbers of samples of a part and of a whole curve. Newton's method for a foot starts from the nearest sample."""
_AT_REST = SLIGHT
"""Speed [m/s] that is added to the speed of the point. The error of a foot then decreases for a point at rest, too."""


class Bounds(NamedTuple):
    """The ends of a part, and whether a parameter s is below the low end or above the high end."""

    low: ca.SX
    high: ca.SX
    before: ca.SX
    behind: ca.SX

    @classmethod
    def of(cls, s: ca.SX, part: Part) -> "Bounds | None":
        """The bounds of a part for a parameter s; None for a part without ends."""
        low, high = part
        return cls(ca.SX(low), ca.SX(high), s - low < -SOFT, high - s < -SOFT) if np.isfinite(low) else None

    def inside(self, s: ca.SX) -> ca.SX:
        """The parameter s, limited to the ends of the part."""
        return ca.if_else(self.before, self.low, ca.if_else(self.behind, self.high, s))


class Foot(NamedTuple):
    """The condition for a foot of P (2,) at the parameter s. A part continues along its tangents beyond its ends."""

    offset: ca.SX  # (2,), from the point of the part to P [m]
    along: ca.SX  # (2,), derivative of the curve by s
    miss: ca.SX  # minus half the derivative of the squared distance by s [m^2]; 0 at the foot
    slope: ca.SX  # minus the derivative of `miss` by s [m^2]
    beyond: ca.SX  # whether s is beyond the ends

    @classmethod
    def at(cls, curve: Curve, s: ca.SX, P: ca.SX, bounds: Bounds | None = None) -> "Foot":
        """The condition for a foot at s, on the curve or on the tangents at the ends of a part."""
        on, beyond = s, ca.SX(0)
        if bounds is not None:
            on, beyond = bounds.inside(s), ca.logic_or(bounds.before, bounds.behind)
        place, along, bend = curve.at(on)
        offset = P - place
        straight, curved = ca.sumsqr(along), ca.dot(offset, bend)
        slope = straight - (curved if bounds is None else ca.if_else(beyond, 0, curved))
        # At a centre of curvature all points of the curve are equally near, and Newton's step would be infinite.
        is_close = slope - _CLOSE * straight < -SOFT
        slope = ca.if_else(is_close, _CLOSE * straight, slope)
        return cls(offset, along, ca.dot(along, offset - along * (s - on)), slope, beyond)

    @property
    def step(self) -> ca.SX:
        """Newton's step of s."""
        return self.miss / self.slope


class Side(NamedTuple):
    """A part of a curve, and the side on which it may touch: 1 for the left side, -1 for the right side."""

    measured: Measured
    part: Part
    side: float

    @property
    def bend(self) -> float:
        """The lowest curvature [1/m] of the part. The curvature is positive if the part bends away from the side."""
        return self.measured.bend(self.part, self.side)

    @property
    def is_hollow(self) -> bool:
        """Whether the part is concave: it bends toward the side."""
        return self.bend * self.measured.length < -SLIGHT

    @property
    def samples(self) -> tuple[float, float, int]:
        """The lowest s, the highest s, and the number of samples between them."""
        return (*self.part, _SAMPLES) if np.isfinite(self.part[0]) else (*self.measured.curve.ends, ALL_SAMPLES)

    def spot(self, s: ca.SX, bounds: Bounds | None) -> "Spot":
        """The point of the part at s. If s is beyond an end, the point is the end, and the tangent turns with s."""
        # Beyond an end, the tangent turns with s. It makes a whole turn if s changes by its whole range. So the foot on
        # the other curve passes the corner without a jump.
        fan = -self.side * 2 * np.pi / self.measured.period
        on = s if bounds is None else bounds.inside(s)
        place, along, bend = self.measured.curve.at(on)
        length = ca.norm_2(along)
        tangent, speed, turn, excess = self.side * along / length, self.side * length, cross(along, bend), ca.SX(0)
        turn /= length**2
        if bounds is not None:
            beyond, angle = ca.logic_or(bounds.before, bounds.behind), fan * (s - on)
            tangent = ca.cos(angle) * tangent + ca.sin(angle) * left(tangent)
            before, behind = self.measured.corners_at(self.part, self.side)
            excess = ca.if_else(bounds.before, self.side * angle - before, -self.side * angle - behind)
            excess = ca.if_else(ca.logic_and(beyond, -excess < -SOFT), excess, 0)
            turn, speed = ca.if_else(beyond, fan, turn), ca.if_else(beyond, 0, speed)
        return Spot(place, tangent, speed, turn, excess)


class Spot(NamedTuple):
    """A point of a curve with its tangent."""

    place: ca.SX  # (2,), position [m]
    tangent: ca.SX  # (2,), unit tangent; its left normal leads away from the curve
    speed: ca.SX  # derivative of the arc length by s [m]
    turn: ca.SX  # derivative of the tangent's angle by s [rad]
    excess: ca.SX  # angle of the tangent beyond the angle of the corner [rad]


class Feet(NamedTuple):
    """Points of two curves a and b at the parameters s (2,), in the axes of a."""

    offset: ca.SX  # (2,), from the point of a to the point of b [m]
    normal: ca.SX  # (2,), normal of a
    on_b: ca.SX  # (2,), point of b in the axes of b [m]
    step: ca.SX  # (2,), Newton's step of s
    rate: ca.SX  # (2,), rate of s with which the points stay nearest to each other
    cost: ca.SX  # squared distance, increased if a tangent leaves its corner [m^2]

    @classmethod
    def at(cls, a: Side, b: Side, s: ca.SX, bounds: Sequence[Bounds | None], motion: "Motion") -> "Feet":
        """The points at s. At feet, the offset is normal to the mean tangent, and the tangents are opposite."""
        p, q = (side.spot(s[k], bounds[k]) for k, side in enumerate((a, b)))
        u, v, R = p.tangent, motion.R @ q.tangent, motion.R
        offset, middle = motion.P + R @ q.place - p.place, (u - v) / 2
        miss = ca.vertcat(ca.dot(offset, middle), ca.atan2(cross(u, v), -ca.dot(u, v)))
        # Derivatives of both conditions by the parameter of a, and by that of b. The angle of the tangents changes by
        # `turn`, and the mean tangent by half of it.
        by_a = ca.vertcat(-p.speed * ca.dot(u, middle) + p.turn * ca.dot(offset, left(u)) / 2, p.turn)
        by_b = ca.vertcat(q.speed * ca.dot(v, middle) - q.turn * ca.dot(offset, left(v)) / 2, -q.turn)
        sign, lengths = -a.side * b.side, (a.measured.length, b.measured.length)
        # If both conditions are nearly dependent, Newton's steps would be too large. So the determinant has a lower
        # limit, a small fraction of the determinant of two circles with the lengths of the curves.
        least = SMALL * 2 * np.pi * sum(lengths) / (a.measured.period * b.measured.period)
        touching = _CLOSE * sign * (p.speed * q.turn + q.speed * p.turn)
        touching = ca.if_else(touching - least < -SOFT, least, touching)
        det = sign * cross(by_a, by_b)
        det = sign * ca.if_else(det - touching < -SOFT, touching, det)

        # The foot on the part with the larger curvature keeps the tangents opposite. The other foot may move both ways.
        is_first = a.bend > b.bend
        turn = [-side.side * spot.turn for side, spot in ((a, p), (b, q))][not is_first]
        least_turn = SMALL * 2 * np.pi / (a if is_first else b).measured.period
        turn = ca.if_else(turn - least_turn < -SOFT, least_turn, turn)

        def solved(r: ca.SX) -> ca.SX:
            if is_first:
                on_b = -cross(by_a, r) / det
                return ca.vertcat((r[1] + by_b[1] * on_b) * a.side / turn, on_b)
            on_a = -cross(r, by_b) / det
            return ca.vertcat(on_a, -(r[1] + by_a[1] * on_a) * b.side / turn)

        by_motion = ca.vertcat(
            ca.dot(motion.velocity(q.place), middle) - motion.omega * ca.dot(offset, left(v)) / 2, -motion.omega
        )
        step = solved(miss)
        # The rate preserves the conditions. The catch-up term reduces the integration error of the state. The term is
        # proportional to the speed of the motion, so it is not stiffer than the motion itself.
        speed = ca.sqrt(ca.sumsqr(motion.rates[0]) + (motion.omega * lengths[1] / 6) ** 2 + _AT_REST**2)
        catch_up = _CATCH_UP / lengths[0] * speed
        cost = ca.sumsqr(offset) + (lengths[0] * (p.excess + q.excess)) ** 2
        normal = left(middle) / ca.sqrt(ca.sumsqr(middle) + MEETING**2)  # equal tangents have no mean direction
        return cls(offset, normal, q.place, step, solved(by_motion) + catch_up * step, cost)


class Motion(NamedTuple):
    """Motion of b in the axes of a: position P (2,) [m], rotation R (2, 2), rates of P and R, and angular velocity."""

    P: ca.SX
    R: ca.SX
    rates: tuple[ca.SX, ca.SX]
    omega: ca.SX

    @classmethod
    def of(cls, P: ca.SX, R: ca.SX) -> "Motion":
        """The motion with a position and a rotation that are expressions of coordinates."""
        turning = ddt(R)
        return cls(P, R, (ddt(P), turning), cross(R[:, 0], turning[:, 0]))

    def velocity(self, place: ca.SX) -> ca.SX:
        """Velocity (2,) [m/s] of a point of b at the position `place` (2,) in the axes of b."""
        return self.rates[0] + self.rates[1] @ place


def cross(a: ca.SX, b: ca.SX) -> ca.SX:
    """The z component of the cross product of two vectors (2,)."""
    return a[0] * b[1] - a[1] * b[0]


def left(a: ca.SX) -> ca.SX:
    """The vector (2,) turned to the left by a quarter of a turn."""
    return ca.vertcat(-a[1], a[0])


def follow_point(side: Side, P: ca.SX, name: str) -> tuple[Foot, Symbol]:
    """The foot of P (2,) on a part of a curve, and the record of the state that follows it."""
    measured, rate = side.measured, ddt(P)

    def moved(s: ca.SX, bounds: Bounds | None) -> ca.SX:
        return s + _short(Foot.at(measured.curve, s, P, bounds).step, measured)

    s = ca.SX.sym(name)
    bounds = Bounds.of(s, side.part)
    foot = Foot.at(measured.curve, s, P, bounds)
    # The catch-up term reduces the integration error of the state. It is proportional to the speed, so it is not stiff.
    catch_up = _CATCH_UP / measured.length * ca.sqrt(ca.sumsqr(rate) + _AT_REST**2)
    following = ca.dot(foot.along, rate) / foot.slope + catch_up * foot.miss / ca.sumsqr(foot.along)
    start = measured.curve.nearest(P, *side.samples, lambda s: moved(s, Bounds.of(s, side.part)))
    (state,) = declare([name], Kind.STATE, s, following, start)
    # The state only chooses the foot: two of Newton's steps reduce its error to about the fourth power.
    return Foot.at(measured.curve, moved(moved(s, bounds), bounds), P, bounds), state


def follow_curve(a: Side, b: Side, motion: Motion, name: str) -> tuple[Feet, tuple[Symbol, ...]]:
    """The feet of two parts of curves on each other, and the records of the states that follow them."""
    names = [f"{name}.a", f"{name}.b"]
    s = ca.vertcat(*map(ca.SX.sym, names))

    def bounds_at(s: ca.SX) -> list[Bounds | None]:
        return [Bounds.of(s[k], side.part) for k, side in enumerate((a, b))]

    def feet(s: ca.SX, bounds: Sequence[Bounds | None]) -> Feet:
        return Feet.at(a, b, s, bounds, motion)

    bounds = bounds_at(s)
    first = feet(s, bounds)
    start = _start(a, b, motion)

    def moved(s: ca.SX, bounds: Sequence[Bounds | None]) -> ca.SX:
        step = feet(s, bounds).step
        return s + ca.vertcat(*[_short(step[k], side.measured) for k, side in enumerate((a, b))])

    for _ in range(6):  # the samples are coarse, and steps are limited
        start = moved(start, bounds_at(start))
    states = declare(names, Kind.STATE, s, first.rate, start)
    return feet(moved(moved(s, bounds), bounds), bounds), states


def _short(step: ca.SX, measured: Measured) -> ca.SX:
    """A step, smoothly limited to an eighth of the range of s, so that Newton's method stays on the curve."""
    return step / ca.sqrt(1 + (step / (measured.period / 8)) ** 2)


def _start(a: Side, b: Side, motion: Motion) -> ca.SX:
    """Parameters s (2,) of two samples that are nearest to each other, found by alternating searches."""
    P = motion.P + motion.R @ b.measured.middle
    on_a, on_b = a.measured.curve, b.measured.curve
    stay: Callable[[ca.SX], ca.SX] = lambda s: s  # noqa: E731
    for _ in range(2):  # the second search starts from a point that is already on b
        s = on_a.nearest(P, *a.samples[:2], 2 * _SAMPLES, stay)
        u = on_b.nearest(motion.R.T @ (on_a.at(s)[0] - motion.P), *b.samples[:2], 2 * _SAMPLES, stay)
        P = motion.P + motion.R @ on_b.at(u)[0]
    return ca.vertcat(s, u)


def require_room(group: Sequence[Side], others: Sequence[Sequence[Side]] | None, radius: float) -> None:
    """Raise DeclarationError if a circle or another curve may touch a group of parts at several points.

    The check uses the largest circle of curvature of the other curve.
    """
    measured, parts, side = group[0].measured, [one.part for one in group], group[0].side
    if others is not None:
        bends = [one.bend for some in others for one in some if not one.is_hollow]
        least = min(bends, default=0.0)
        is_flat = least * others[0][0].measured.length < SLIGHT
        if is_flat and any(one.bend * measured.length < SLIGHT for one in group):
            raise DeclarationError(
                "a straight part of one curve may touch the other curve at several points, or along a line. Bend the "
                "straight part slightly outward, or declare the parts that touch as separate curves"
            )
        if not any(one.is_hollow for one in group):
            return
        radius += 1 / least
    measured.require_room(parts, side, radius, "the circle" if others is None else "the other curve's largest circle")
