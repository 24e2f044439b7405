"""Curves, circles, slots and ropes as shapes."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import casadi as ca
import numpy as np

from symmb.drawing.elements import CONTACT, GUIDE, JOINT, Build, shape_of, sketch, supports
from symmb.drawing.shapes import Shape
from symmb.drawing.survey import Survey
from symmb.mechanics import (
    BoxContact,
    CircleContact,
    Curve,
    CurveContact,
    Point,
    PointOnCurve,
    Rope,
    SlotContact,
    SphereContact,
)
from symmb.symbolic import unit, vector

_LINES = 96
"""Straight lines by which a curve is drawn."""


@sketch.register
def _(rope: Rope, survey: Survey) -> Build:
    points = [wrap if isinstance(wrap, Point) else wrap[0] for wrap in rope.points]
    radii = [0.0 if isinstance(wrap, Point) else wrap[1] for wrap in rope.points]
    places = [survey.place(point) for point in points]
    sizes = [survey.ask(survey.bind(radius, "radius")) for radius in radii]
    support = supports(rope, survey, *points)

    def build(u: float) -> Iterator[Shape]:
        yield from support(u)
        for a, b in pairwise(places):
            yield shape_of(rope, "bar", GUIDE, (a, b), (0.25 * u,))
        for place, size in zip(places, sizes, strict=True):
            if radius := abs(float(size.first[0])):
                yield shape_of(rope, "ring", GUIDE, (place,), (radius, 0.4 * u), direction=np.array([[0.0, 0.0, 1.0]]))

    return build


@sketch.register(CurveContact)
@sketch.register(PointOnCurve)
def _(element: CurveContact | PointOnCurve, survey: Survey) -> Build:
    colour = JOINT if isinstance(element, PointOnCurve) else CONTACT
    curve_b = element.curve_b if isinstance(element, CurveContact) else None
    outlines = [_outline(element.point_a, _lines_of(element.curve), survey)]
    if curve_b is not None:
        outlines.append(_outline(element.point_b, _lines_of(curve_b), survey))
    b, radius = survey.place(element.point_b), survey.ask(survey.bind(element.radius, "radius"))

    def build(u: float) -> Iterator[Shape]:
        for outline in outlines:
            for line in outline():
                yield shape_of(element, "bar", GUIDE, line, (0.4 * u,))
        r = float(radius.first[0])
        if curve_b is None:
            yield shape_of(element, "ball", colour, (b,), (max(r, 0.9 * u),), faint=r > u)

    return build


def _lines_of(curve: Curve) -> list[ca.SX]:
    """Places (2,) on a curve between which it is drawn straight [m]."""
    return [ca.substitute(curve.place, curve.s, s) for s in np.linspace(*curve.ends, _LINES + 1).tolist()]


@sketch.register
def _(contact: SlotContact, survey: Survey) -> Build:
    axis, radius = unit(vector(contact.axis)), survey.bind(contact.radius_a, "radius_a")
    across = ca.vertcat(-axis[1], axis[0])
    half = np.linspace(-np.pi / 2, np.pi / 2, _LINES // 4)
    ends = ca.SX(2, 1), axis[:2] * survey.bind(contact.length, "length")
    lines = [
        end - turn * radius * (axis[:2] * np.cos(w) + across * np.sin(w))
        for end, turn in zip(ends, (1, -1), strict=True)
        for w in half.tolist()
    ]
    outline, b = _outline(contact.point_a, [*lines, lines[0]], survey), survey.place(contact.point_b)
    pin = survey.ask(survey.bind(contact.radius_b, "radius_b"))

    def build(u: float) -> Iterator[Shape]:
        for line in outline():
            yield shape_of(contact, "bar", GUIDE, line, (0.4 * u,))
        yield shape_of(contact, "ball", CONTACT, (b,), (float(pin.first[0]),), faint=True)

    return build


def _outline(origin: Point, places: list[ca.SX], survey: Survey) -> Callable[[], list[tuple[int, int]]]:
    """What gives the pairs of places between which an outline (2,) [m] from a point is drawn."""
    frame: int = survey.frame(origin.body)
    asked = survey.ask(ca.vertcat(*[origin.s + ca.vertcat(place, 0) for place in places]))

    def lines() -> list[tuple[int, int]]:
        corners = [survey.fixed(frame, corner) for corner in asked.first.reshape(-1, 3)]
        return list(pairwise(corners))

    return lines


@sketch.register(CircleContact)
@sketch.register(SphereContact)
def _(contact: CircleContact | SphereContact, survey: Survey) -> Build:
    places = survey.place(contact.point_a), survey.place(contact.point_b)
    radii = [survey.ask(survey.bind(radius, "radius")) for radius in (contact.radius_a, contact.radius_b)]

    def build(u: float) -> Iterator[Shape]:
        for place, radius in zip(places, radii, strict=True):
            r = float(radius.first[0])
            if isinstance(contact, SphereContact):
                yield shape_of(contact, "ball", CONTACT, (place,), (max(r, 0.9 * u),), faint=True)
            else:
                yield shape_of(contact, "ring", CONTACT, (place,), (r, 0.4 * u), direction=np.array([[0.0, 0.0, 1.0]]))

    return build


@sketch.register
def _(contact: BoxContact, survey: Survey) -> Build:
    center, other = survey.place(contact.point_a), survey.place(contact.point_b)
    sides = survey.ask(ca.vertcat(*[survey.bind(side, "sides") for side in contact.sides]))
    radius = survey.ask(survey.bind(contact.radius, "radius"))

    def build(u: float) -> Iterator[Shape]:
        half = np.append(sides.first, [u] * (3 - len(sides.first))) / 2
        yield shape_of(contact, "solid", CONTACT, (center,), (0.0,), direction=np.diag(half), faint=True)
        if contact.normal is None:
            yield shape_of(contact, "ball", CONTACT, (other,), (max(float(radius.first[0]), 0.9 * u),), faint=True)

    return build
