"""Springs, dampers, contacts and loads as shapes, by their kinds."""

from typing import cast

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Expr
from symmb.declare.mechanics import (
    AbstractBody,
    Actuator,
    AxisJoint,
    BushContact,
    Bushing,
    Clutch,
    Contact,
    Element,
    Force,
    Friction,
    GasSpring,
    Ground,
    Motor,
    NonlinearSpring,
    Orifice,
    Point,
    Soil,
    Spherical,
    SpringDamper,
    Stop,
    ToothContact,
    Torque,
    TorsionContact,
    TorsionSpring,
)
from symmb.show.drawing.elements import (
    CONTACT,
    DAMPER,
    GUIDE,
    LOAD,
    SPRING,
    Sketch,
    begun,
    shape_of,
    shapes_of,
    sketch,
    supports,
    unit_vectors,
)
from symmb.show.drawing.survey import Survey


@sketch.register
def _(spring: SpringDamper, survey: Survey) -> Sketch:
    ends = survey.place(spring.point_a), survey.place(spring.point_b)
    pulls, brakes = not _is_none(spring.stiffness), not _is_none(spring.damping)
    u = yield from supports(spring, survey, spring.point_a, spring.point_b)
    offset = 1.9 * u if pulls and brakes else 0.0
    if pulls:
        yield shape_of(spring, "coil", SPRING, ends, (1.7 * u, offset))
    if brakes:
        yield shape_of(spring, "dashpot", DAMPER, ends, (1.2 * u, -offset))


def _is_none(law: object) -> bool:
    return isinstance(law, int | float) and not law


@sketch.register
def _(spring: NonlinearSpring, survey: Survey) -> Sketch:
    """Gas springs and hydraulic dampers as cylinders, and other laws as a coil around a rod."""
    ends = survey.place(spring.point_a), survey.place(spring.point_b)
    u = yield from supports(spring, survey, spring.point_a, spring.point_b)
    if isinstance(spring.pull, GasSpring | Orifice):
        colour = SPRING if isinstance(spring.pull, GasSpring) else DAMPER
        yield shape_of(spring, "dashpot", colour, ends, (1.3 * u, 0.0))
    else:
        yield shape_of(spring, "coil", SPRING, ends, (1.7 * u, 0.0))
        yield shape_of(spring, "bar", SPRING, ends, (0.4 * u,))


@sketch.register(Bushing)
@sketch.register(Friction)
@sketch.register(ToothContact)
def _(element: Bushing | Friction | ToothContact, survey: Survey) -> Sketch:
    ends = survey.place(element.point_a), survey.place(element.point_b)
    form, colour = ("coil", SPRING) if isinstance(element, Bushing) else ("dashes", CONTACT)
    u = yield from supports(element, survey, element.point_a, element.point_b)
    yield shape_of(element, form, colour, ends, (1.3 * u, 0.0) if form == "coil" else (0.4 * u,))
    yield shape_of(element, "ball", colour, ends[:1], (1.1 * u,))


@sketch.register
def _(contact: BushContact, survey: Survey) -> Sketch:
    a, b = survey.place(contact.point_a), survey.place(contact.point_b)
    axis = survey.direction(contact.point_a.body, contact.axis)
    u = yield
    yield shape_of(contact, "ring", CONTACT, (a,), (2.6 * u, 0.7 * u), direction=unit_vectors(axis))
    yield shape_of(contact, "ball", CONTACT, (b,), (0.9 * u,))


@sketch.register
def _(contact: Contact, survey: Survey) -> Sketch:
    ball, plane = survey.place(contact.point), survey.place(contact.plane_point)
    normal = survey.direction(contact.plane_point.body, contact.normal)
    radius = survey.ask(survey.bind(contact.radius, "radius"))
    u = yield
    r = float(radius.first[0])
    yield shape_of(contact, "ball", CONTACT, (ball,), (max(r, 0.9 * u),), faint=r > u)
    # The part of the infinite plane next to the ball when the ball is nearest.
    frame = survey.frame(contact.plane_point.body)
    pose, n, base = survey.pose(frame), unit_vectors(normal)[0], survey.base(plane)
    away = ((survey.track(ball) - pose[:, :, 3])[:, None] @ pose[:, :, :3])[:, 0] - base
    gap = away @ n
    feet = (away - gap[:, None] * n)[gap <= gap.min() + max(r, 2 * u)]
    low, high = feet.min(axis=0), feet.max(axis=0)
    side = 2.5 * max(r, 2 * u) + float(np.linalg.norm(high - low))
    foot = survey.shifted(plane, (low + high) / 2)
    yield shape_of(contact, "plane", GUIDE, (foot,), (side,), direction=unit_vectors(normal))


@sketch.register
def _(soil: Soil, survey: Survey) -> Sketch:
    under, foot = survey.place(soil.ground_point), survey.place(soil.point)
    normal = survey.direction(soil.ground_point.body, soil.normal)
    u = yield
    yield shape_of(soil, "plane", GUIDE, (under,), (10 * u,), direction=unit_vectors(normal))
    yield shape_of(soil, "ball", CONTACT, (foot,), (1.4 * u,))


@sketch.register(TorsionSpring)
@sketch.register(TorsionContact)
@sketch.register(Clutch)
def _(element: TorsionSpring | TorsionContact | Clutch, survey: Survey) -> Sketch:
    place = _shared_place(element.body_a, element.body_b, survey)
    body = element.body_b if not isinstance(element.body_b, Ground) else element.body_a
    axis = survey.direction(body, element.axis)
    form, colour = ("spiral", SPRING) if isinstance(element, TorsionSpring) else ("ring", CONTACT)
    u = yield
    size = (4.5 * u,) if form == "spiral" else (3.0 * u, 0.5 * u)
    yield shape_of(element, form, colour, (place,), size, direction=unit_vectors(axis))


def _shared_place(a: AbstractBody, b: AbstractBody, survey: Survey) -> int:
    """The point of body b in a joint of both bodies. Without a joint, the origin of b, or of a if b is the ground."""
    pair = {survey.frame(a), survey.frame(b)}
    for joint in survey.scene.system.elements:
        if isinstance(joint, AxisJoint | Spherical) and {survey.frame(body) for body in joint.bodies()} == pair:
            return survey.place(joint.point_b)
    return survey.place(origin(a if isinstance(b, Ground) else b))


def origin(body: AbstractBody) -> Point:
    """The origin of a body's frame."""
    return body.point(*body.com)


@sketch.register
def _(force: Force, survey: Survey) -> Sketch:
    yield from _arrow(force, "arrow", force.point, (*force.force, 0)[:3], survey)


@sketch.register
def _(torque: Torque, survey: Survey) -> Sketch:
    law = torque.torque if isinstance(torque.torque, tuple | list) else (0, 0, torque.torque)
    yield from _arrow(torque, "twist", origin(torque.body), tuple(law), survey)


@sketch.register(Actuator)
@sketch.register(Motor)
def _(actuator: Actuator | Motor, survey: Survey) -> Sketch:
    """A motor around the joint, or a cylinder with a rod along the joint; and the arrow of the force or torque."""
    joint, turns = cast(AxisJoint, actuator.joint), actuator.handle == "angle"
    law = actuator.law if isinstance(actuator, Actuator) else actuator.torque
    load = survey.bind(law, actuator.title) * actuator.axis
    arrow = begun(_arrow(actuator, "twist" if turns else "arrow", joint.point_b, tuple(ca.vertsplit(load)), survey))
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis = survey.direction(joint.point_a.body, joint.axes[0])
    u = yield
    along = unit_vectors(axis)
    if turns:
        yield shape_of(actuator, "ring", LOAD, (a,), (2.6 * u, 0.7 * u), direction=along)
    else:
        yield shape_of(actuator, "bar", GUIDE, (a, b), (0.8 * u,))
        middle = survey.shifted(a, -3 * u * along[0])
        yield shape_of(actuator, "pin", LOAD, (middle,), (1.7 * u, 6 * u), direction=along)
    if arrow:
        yield from shapes_of(arrow, u)


@sketch.register
def _(stop: Stop, survey: Survey) -> Sketch:
    place = survey.place(stop.joint.point_b)
    axis = survey.direction(stop.joint.point_a.body, cast(AxisJoint, stop.joint).axes[0])
    u = yield
    yield shape_of(stop, "ring", CONTACT, (place,), (3.0 * u, 0.5 * u), direction=unit_vectors(axis))


def _arrow(element: Element, form: str, point: Point, law: tuple[Expr, ...], survey: Survey) -> Sketch:
    place = survey.place(point)
    try:
        vector = survey.ask(ca.vertcat(*[survey.bind(part, element.title) for part in law]))
    except DeclarationError:  # the law contains multipliers or states that the run lacks
        return
    u = yield
    largest = np.linalg.norm(vector(), axis=1).max()
    if largest:
        yield shape_of(element, form, LOAD, (place,), (0.6 * u,), direction=vector() * (14 * u / largest))
