"""Joints as shapes, by their kinds."""

from collections.abc import Iterator

import numpy as np

from symmb.drawing.elements import GUIDE, JOINT, Build, shape_of, sketch, supports, unit_vectors
from symmb.drawing.shapes import Shape
from symmb.drawing.survey import Survey
from symmb.mechanics import (
    AxisJoint,
    Cylindrical,
    Distance,
    Gear,
    PlanarJoint,
    Point,
    PointOnLine,
    Prismatic,
    Revolute,
    Screw,
    Spherical,
    Universal,
    Weld,
)

_BLOCK = (3.6, 2.6, 2.6)
"""Sides of a slider, in units."""


@sketch.register
def _(joint: Revolute, survey: Survey) -> Build:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis, support = survey.direction(joint.point_a.body, joint.axes[0]), supports(joint, survey, *_ends(joint))

    def build(u: float) -> Iterator[Shape]:
        yield from support(u)
        place = b if joint.point_a.body.owner is not joint.point_a.body else a
        yield shape_of(joint, "pin", JOINT, (place,), (1.6 * u, 3.2 * u), direction=unit_vectors(axis))

    return build


def _ends(joint: AxisJoint | Spherical | Distance) -> tuple[Point, Point]:
    return joint.point_a, joint.point_b


@sketch.register
def _(joint: Spherical, survey: Survey) -> Build:
    a, support = survey.place(joint.point_a), supports(joint, survey, *_ends(joint))
    survey.place(joint.point_b)

    def build(u: float) -> Iterator[Shape]:
        yield from support(u)
        yield shape_of(joint, "ball", JOINT, (a,), (1.9 * u,))

    return build


@sketch.register
def _(joint: Weld, survey: Survey) -> Build:
    a, support = survey.place(joint.point_a), supports(joint, survey, *_ends(joint))
    survey.place(joint.point_b)
    axis = survey.direction(joint.point_a.body, joint.axes[0])

    def build(u: float) -> Iterator[Shape]:
        yield from support(u)
        yield shape_of(joint, "block", JOINT, (a,), (2.2 * u,) * 3, direction=unit_vectors(axis))

    return build


@sketch.register
def _(joint: Universal, survey: Survey) -> Build:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    support = supports(joint, survey, *_ends(joint))
    axes = [survey.direction(body, axis) for body, axis in zip(joint.bodies(), joint.axes, strict=True)]

    def build(u: float) -> Iterator[Shape]:
        yield from support(u)
        for place, axis in zip((a, b), axes, strict=True):
            yield shape_of(joint, "pin", JOINT, (place,), (0.8 * u, 5.0 * u), direction=unit_vectors(axis))

    return build


@sketch.register(Prismatic)
@sketch.register(Cylindrical)
@sketch.register(PointOnLine)
@sketch.register(Screw)
def _(joint: AxisJoint, survey: Survey) -> Build:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis = survey.direction(joint.point_a.body, joint.axes[0])
    guide, slider = survey.frame(joint.point_a.body), survey.frame(joint.point_b.body)
    square = isinstance(joint, Prismatic | PointOnLine)

    def build(u: float) -> Iterator[Shape]:
        along = unit_vectors(axis)
        offset = survey.track(b) - survey.track(a)
        pose = survey.pose(guide)
        local = (np.swapaxes(pose[:, :, :3], 1, 2) @ offset[:, :, None])[:, :, 0]
        travel = (local * along).sum(axis=1)
        ends = [survey.base(a) + s * along[0] for s in (travel.min() - 5 * u, travel.max() + 5 * u)]
        rail = survey.fixed(guide, ends[0]), survey.fixed(guide, ends[1])
        yield shape_of(joint, "bar", GUIDE, rail, (0.5 * u,))
        # The block lies along the guide, as seen from the frame that it moves with.
        seen = (pose[:, :, :3] @ along[:, :, None])[:, :, 0]
        inside = (np.swapaxes(survey.pose(slider)[:, :, :3], 1, 2) @ seen[:, :, None])[:, :, 0]
        size = tuple(side * u for side in _BLOCK) if square else (1.6 * u, 5 * u)
        yield shape_of(joint, "block" if square else "pin", JOINT, (b,), size, direction=inside)

    return build


@sketch.register
def _(joint: PlanarJoint, survey: Survey) -> Build:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axis = survey.direction(joint.point_a.body, joint.axes[0])

    def build(u: float) -> Iterator[Shape]:
        reach = np.abs(survey.track(b) - survey.track(a)).max() + 6 * u
        yield shape_of(joint, "plane", GUIDE, (a,), (2 * reach,), direction=unit_vectors(axis))
        yield shape_of(joint, "ball", JOINT, (b,), (1.4 * u,))

    return build


@sketch.register
def _(joint: Distance, survey: Survey) -> Build:
    ends = survey.place(joint.point_a), survey.place(joint.point_b)
    support = supports(joint, survey, *_ends(joint))

    def build(u: float) -> Iterator[Shape]:
        yield from support(u)
        yield shape_of(joint, "bar", JOINT, ends, (0.5 * u,))
        for end in ends:
            yield shape_of(joint, "ball", JOINT, (end,), (1.1 * u,))

    return build


@sketch.register
def _(joint: Gear, survey: Survey) -> Build:
    a, b = survey.place(joint.point_a), survey.place(joint.point_b)
    axes = [survey.direction(body, axis) for body, axis in zip(joint.bodies(), joint.axes, strict=True)]
    ratio = survey.ask(survey.bind(joint.ratio, "ratio"))

    def build(u: float) -> Iterator[Shape]:
        distance, k = float(np.linalg.norm(survey.track(a)[0] - survey.track(b)[0])), float(ratio.first[0])
        apart = abs(1 - k)
        if distance < u or not apart or not k:
            return
        # Pitch circles: r_a = |k| r_b, and the centres are r_a + r_b apart, or |r_a - r_b| for a ring gear.
        for place, axis, radius in zip((a, b), axes, (distance * abs(k) / apart, distance / apart), strict=True):
            yield shape_of(joint, "ring", JOINT, (place,), (radius, 0.5 * u), direction=unit_vectors(axis))

    return build
