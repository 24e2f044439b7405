"""Curves, cams, circles, slots and ropes as shapes."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.mechanics import (
    AxisJoint,
    BoxContact,
    CamFollower,
    CircleContact,
    Curve,
    CurveContact,
    Point,
    PointOnCurve,
    Rope,
    SlotContact,
    SphereContact,
    law_value,
)
from symmb.declare.symbolic import unit, vector
from symmb.show.drawing.elements import CONTACT, GUIDE, JOINT, Sketch, shape_of, sketch, supports
from symmb.show.drawing.survey import Survey

_LINES = 96
"""Number of straight lines for a curve."""
_Z = np.array([[0.0, 0.0, 1.0]])


@sketch.register
def _(rope: Rope, survey: Survey) -> Sketch:
    """The straight parts of a rope, dashed while the rope is slack, and its pulleys."""
    points = [wrap if isinstance(wrap, Point) else wrap[0] for wrap in rope.points]
    radii = [0.0 if isinstance(wrap, Point) else wrap[1] for wrap in rope.points]
    places = [survey.place(point) for point in points]
    sizes = [survey.ask(survey.bind(radius, "radius")) for radius in radii]
    course, length = rope.course(survey.bind), survey.bind(rope.length, "length")
    is_slack = survey.ask(length > course.length)
    parts = [
        (pair, [survey.ask(end) for end in part.ends], survey.ask(course.shares[pair]))
        for pair, part in course.straights.items()
    ]
    u = yield from supports(rope, survey, *points)
    for pair, asked, share in parts:
        if not share().any():
            continue
        ends = tuple(
            places[i] if isinstance(radii[i], float) and not radii[i] else survey.tracked(end)
            for i, end in zip(pair, asked, strict=True)
        )
        yield replace(shape_of(rope, "bar", GUIDE, ends, (0.35 * u,)), present=share() * (1 - is_slack()))
        yield replace(shape_of(rope, "dashes", GUIDE, ends, (0.25 * u,)), present=share() * is_slack())
    for place, size in zip(places, sizes, strict=True):
        if radius := abs(float(size.first[0])):
            yield shape_of(rope, "ring", GUIDE, (place,), (radius, 0.4 * u), direction=_Z)
            yield shape_of(rope, "ball", JOINT, (place,), (0.8 * u,))


@sketch.register(CurveContact)
@sketch.register(PointOnCurve)
def _(element: CurveContact | PointOnCurve, survey: Survey) -> Sketch:
    colour = JOINT if isinstance(element, PointOnCurve) else CONTACT
    curve_b = element.curve_b if isinstance(element, CurveContact) else None
    outlines = [_outline(element.point_a, _lines_of(element.curve), survey)]
    if curve_b is not None:
        outlines.append(_outline(element.point_b, _lines_of(curve_b), survey))
    b, radius = survey.place(element.point_b), survey.ask(survey.bind(element.radius, "radius"))
    u = yield
    for outline in outlines:
        yield shape_of(element, "curve", GUIDE, outline(), (0.4 * u,))
    r = float(radius.first[0])
    if curve_b is None:
        yield shape_of(element, "ball", colour, (b,), (max(r, 0.9 * u),), faint=r > u)


def _lines_of(curve: Curve) -> list[ca.SX]:
    """Points (2,) on a curve [m]. The drawing joins these points by straight lines."""
    return [ca.substitute(curve.place, curve.s, s) for s in np.linspace(*curve.ends, _LINES + 1).tolist()]


@sketch.register
def _(cam: CamFollower, survey: Survey) -> Sketch:
    """The cam that lifts the follower's tip by its law, and the tip.

    The law contains neither the size of the cam nor the contact point. The tip of a sliding follower is its point.
    If this point is on the shaft, the tip is drawn two lifts farther. The tip of a rocker is at a right angle to the
    cam's radius.
    """
    shaft, rocker = cam.cam, cam.follower
    angle, moved = (getattr(joint, str(joint.coordinate)) for joint in (shaft, rocker))
    run = survey.run(angle)
    turns, low, high = shaft.coordinate == "angle", float(run.min()), float(run.max())
    if turns:  # one revolution, from a multiple of 2 pi if possible: tables often start at 0
        whole = 2 * np.pi * np.floor(low / (2 * np.pi))
        low = whole if high <= whole + 2 * np.pi else low
        high = low + 2 * np.pi
    values = np.linspace(low, high, _LINES + 1)
    lifts = survey.ask(ca.vertcat(*[survey.bind(law_value(cam.lift, cam.title, ca.SX(v)), "lift") for v in values]))
    now = survey.ask(ca.vertcat(angle, moved))
    axes = survey.ask(ca.horzcat(*[cast(AxisJoint, joint).frames[0][:, 2] for joint in (shaft, rocker)]))
    center, tip = survey.place(shaft.point_a), survey.place(rocker.point_b)
    frames = survey.frame(shaft.point_b.body), survey.frame(rocker.point_b.body)
    u = yield
    h, (turned, lift), (axis, along) = lifts.first, now.first, axes.first.reshape(2, 3)
    c, p = survey.track(center)[0], survey.track(tip)[0]
    if rocker.coordinate == "displacement":
        if np.linalg.norm(p - along * lift - c) < 2 * u:
            p = c + along * (lift + 2 * max(np.nanmax(h) - np.nanmin(h), 2 * u))
        tips = p + (h - lift)[:, None] * along
    else:
        foot = _tip_of_rocker(c, p, along)
        p, tips = foot, np.array([p + _turned(foot - p, along, a - lift) for a in h])
    if turns:
        cam_now = np.array([c + _turned(q - c, axis, turned - v) for q, v in zip(tips, values, strict=True)])
    else:
        cam_now = tips - (values - turned)[:, None] * axis
    outline = [_fixed(survey, frames[0], q) for q in cam_now if np.isfinite(q).all()]
    yield shape_of(cam, "curve", JOINT, tuple(outline), (0.5 * u,))
    yield shape_of(cam, "ball", JOINT, (_fixed(survey, frames[1], p),), (1.2 * u,))
    if rocker.coordinate == "angle" or survey.track(tip)[0] is not p:
        yield shape_of(cam, "bar", JOINT, (_fixed(survey, frames[1], p), tip), (0.6 * u,))


def _tip_of_rocker(c: Array, pivot: Array, axis: Array, length: float = 0.9) -> Array:
    """The contact point of a rocker with a cam around c (3,), on the side from which the rocker moves away.

    The `length` of the rocker is relative to the distance of its pivot from c.
    """
    away = c - pivot - axis * (axis @ (c - pivot))
    return pivot + length**2 * away + length * np.sqrt(1 - length**2) * np.cross(axis, away)


def _turned(a: Array, axis: Array, angle: float) -> Array:
    """A vector (3,) turned about a unit axis (Rodrigues)."""
    return a * np.cos(angle) + np.cross(axis, a) * np.sin(angle) + axis * (axis @ a) * (1 - np.cos(angle))


def _fixed(survey: Survey, frame: int, world: Array) -> int:
    """Index of the place that is fixed in a frame, from its world position (3,) at the start [m]."""
    pose = survey.pose(frame)[0]
    return survey.fixed(frame, pose[:, :3].T @ (world - pose[:, 3]))


@sketch.register
def _(contact: SlotContact, survey: Survey) -> Sketch:
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
    u = yield
    yield shape_of(contact, "curve", GUIDE, outline(), (0.4 * u,))
    yield shape_of(contact, "ball", CONTACT, (b,), (float(pin.first[0]),), faint=True)


def _outline(origin: Point, places: list[ca.SX], survey: Survey) -> Callable[[], tuple[int, ...]]:
    """A function that returns the indices of the places along an outline (2,) around an origin [m]."""
    frame: int = survey.frame(origin.body)
    asked = survey.ask(ca.vertcat(*[origin.s + ca.vertcat(place, 0) for place in places]))
    return lambda: tuple(survey.fixed(frame, corner) for corner in asked.first.reshape(-1, 3))


@sketch.register(CircleContact)
@sketch.register(SphereContact)
def _(contact: CircleContact | SphereContact, survey: Survey) -> Sketch:
    places = survey.place(contact.point_a), survey.place(contact.point_b)
    radii = [survey.ask(survey.bind(radius, "radius")) for radius in (contact.radius_a, contact.radius_b)]
    u = yield
    for place, radius in zip(places, radii, strict=True):
        r = float(radius.first[0])
        if isinstance(contact, SphereContact):
            yield shape_of(contact, "ball", CONTACT, (place,), (max(r, 0.9 * u),), faint=True)
        else:
            yield shape_of(contact, "ring", CONTACT, (place,), (r, 0.4 * u), direction=_Z)


@sketch.register
def _(contact: BoxContact, survey: Survey) -> Sketch:
    center, other = survey.place(contact.point_a), survey.place(contact.point_b)
    sides = survey.ask(ca.vertcat(*[survey.bind(side, "sides") for side in contact.sides]))
    radius = survey.ask(survey.bind(contact.radius, "radius"))
    u = yield
    half = np.append(sides.first, [u] * (3 - len(sides.first))) / 2
    yield shape_of(contact, "solid", CONTACT, (center,), (0.0,), direction=np.diag(half), faint=True)
    if contact.normal is None:
        yield shape_of(contact, "ball", CONTACT, (other,), (max(float(radius.first[0]), 0.9 * u),), faint=True)
