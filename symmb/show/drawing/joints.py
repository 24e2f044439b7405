"""Joints as shapes, by their kinds."""

from dataclasses import replace

import numpy as np

from symmb.declare.mechanics import (
    AxisJoint,
    Cylindrical,
    Distance,
    Gear,
    JointEvent,
    PlanarJoint,
    PointOnLine,
    Prismatic,
    Revolute,
    Screw,
    Spherical,
    Universal,
    Weld,
)
from symmb.show.drawing.elements import GUIDE, JOINT, Sketch, shape_of, sketch, supports, unit_vectors
from symmb.show.drawing.survey import Asked, Survey


@sketch.register
def _(joint: Revolute, survey: Survey) -> Sketch:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis = _axis(joint, survey)
    u = yield from supports(joint, survey, joint.point_a, joint.point_b)
    place = b if joint.point_a.body.owner is not joint.point_a.body else a
    yield shape_of(joint, "pin", JOINT, (place,), (1.6 * u, 3.2 * u), direction=unit_vectors(axis))


def _axis(joint: AxisJoint, survey: Survey) -> Asked:
    """The axis of a joint in the frame of body a. For a joint that closes in the run, the axis after closing."""
    return survey.direction(joint.point_a.body, joint.own_frames[0][:, 2])


@sketch.register
def _(joint: Spherical, survey: Survey) -> Sketch:
    a = survey.place(joint.point_a)
    survey.place(joint.point_b)
    u = yield from supports(joint, survey, joint.point_a, joint.point_b)
    yield shape_of(joint, "ball", JOINT, (a,), (1.9 * u,))


@sketch.register
def _(joint: Weld, survey: Survey) -> Sketch:
    a = survey.place(joint.point_a)
    survey.place(joint.point_b)
    axis = _axis(joint, survey)
    u = yield from supports(joint, survey, joint.point_a, joint.point_b)
    yield shape_of(joint, "block", JOINT, (a,), (2.2 * u,) * 3, direction=unit_vectors(axis))


@sketch.register
def _(joint: Universal, survey: Survey) -> Sketch:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axes = [survey.direction(body, axis) for body, axis in zip(joint.bodies(), joint.axes, strict=True)]
    u = yield from supports(joint, survey, joint.point_a, joint.point_b)
    for place, axis in zip((a, b), axes, strict=True):
        yield shape_of(joint, "pin", JOINT, (place,), (0.8 * u, 5.0 * u), direction=unit_vectors(axis))


@sketch.register(Prismatic)
@sketch.register(Cylindrical)
@sketch.register(PointOnLine)
@sketch.register(Screw)
def _(joint: AxisJoint, survey: Survey) -> Sketch:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis = _axis(joint, survey)
    guide, slider = survey.frame(joint.point_a.body), survey.frame(joint.point_b.body)
    square = isinstance(joint, Prismatic | PointOnLine)
    u = yield
    along = unit_vectors(axis)
    offset = survey.track(b) - survey.track(a)
    pose = survey.pose(guide)
    local = (np.swapaxes(pose[:, :, :3], 1, 2) @ offset[:, :, None])[:, :, 0]
    travel, closed = (local * along).sum(axis=1), survey.closed(joint)
    if closed is not None and closed.any():  # an open joint can leave its guide
        travel = np.broadcast_to(travel, len(closed))[closed[:, 0] > 0] if len(closed) > 1 else travel
    rail = [survey.shifted(a, s * along) for s in (travel.min() - 5 * u, travel.max() + 5 * u)]
    yield shape_of(joint, "bar", GUIDE, tuple(rail), (0.5 * u,))
    # The direction of the block is along the guide. It is given in the axes of the frame that carries the block.
    seen = (pose[:, :, :3] @ along[:, :, None])[:, :, 0]
    inside = (np.swapaxes(survey.pose(slider)[:, :, :3], 1, 2) @ seen[:, :, None])[:, :, 0]
    size = (3.6 * u, 2.6 * u, 2.6 * u) if square else (1.6 * u, 5 * u)
    yield shape_of(joint, "block" if square else "pin", JOINT, (b,), size, direction=inside)


@sketch.register
def _(joint: PlanarJoint, survey: Survey) -> Sketch:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis = _axis(joint, survey)
    u = yield
    reach = np.abs(survey.track(b) - survey.track(a)).max() + 6 * u
    yield shape_of(joint, "plane", GUIDE, (a,), (2 * reach,), direction=unit_vectors(axis))
    yield shape_of(joint, "ball", JOINT, (b,), (1.4 * u,))


@sketch.register
def _(joint: Distance, survey: Survey) -> Sketch:
    ends = survey.place(joint.point_a), survey.place(joint.point_b)
    u = yield from supports(joint, survey, joint.point_a, joint.point_b)
    yield shape_of(joint, "bar", JOINT, ends, (0.5 * u,))
    for end in ends:
        yield shape_of(joint, "ball", JOINT, (end,), (1.1 * u,))


@sketch.register
def _(joint: Gear, survey: Survey) -> Sketch:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axes = [survey.direction(body, axis) for body, axis in zip(joint.bodies(), joint.axes, strict=True)]
    ratio = survey.ask(survey.bind(joint.ratio, "ratio"))
    u = yield
    distance, k = float(np.linalg.norm(survey.track(a)[0] - survey.track(b)[0])), float(ratio.first[0])
    apart = abs(1 - k)
    if distance < u or not apart or not k:
        return
    # Radii of the pitch circles: r_a = |k| r_b. The centres are r_a + r_b apart, or |r_a - r_b| for a ring gear.
    for place, axis, radius in zip((a, b), axes, (distance * abs(k) / apart, distance / apart), strict=True):
        yield shape_of(joint, "ring", JOINT, (place,), (radius, 0.5 * u), direction=unit_vectors(axis))


@sketch.register
def _(event: JointEvent, survey: Survey) -> Sketch:
    """An open joint: an eye on body a, and a pin on body b."""
    joint = event.joint
    a, b = (survey.place(getattr(joint, end)) for end in ("point_a", "point_b"))
    axis = survey.direction(joint.point_a.body, joint.axes[0]) if isinstance(joint, AxisJoint) else None
    u = yield
    closed = survey.closed(joint)
    assert closed is not None  # the event opens or closes the joint
    direction = np.array([[0.0, 0.0, 1.0]]) if axis is None else unit_vectors(axis)
    eye = shape_of(event, "ring", JOINT, (a,), (2.0 * u, 0.5 * u), direction=direction)
    pin = shape_of(event, "ball", JOINT, (b,), (1.1 * u,))
    for shape in (eye, pin):
        yield replace(shape, present=1 - closed)
