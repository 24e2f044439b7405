"""The forms and colours of shapes, for stills, films and pages. A form consists of parts in axes of the shape."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from symmb._magnitudes import NOTHING
from symmb._types import Array
from symmb.show.drawing.shapes import Shape

COLOURS = {
    "joint": "#343c48",
    "guide": "#9ea8b5",
    "spring": "#218c54",
    "damper": "#735a9e",
    "load": "#cc2929",
    "contact": "#e0800d",
    "trace": "#1a66b3",
    "region": "#b8d4ed",
    "x": "#c62828",
    "y": "#2e7d32",
    "z": "#1565c0",
    "g": "#5b6470",
    "scale": "#3b434d",
}
"""Colours of parts that are not bodies, of axes, of gravity and of the scale."""
NOMINAL = ("guide", "load")
"""Colours of shapes that are drawn only for the nominal run."""
LIGHT = {"direction": (-0.4, 0.6, 0.8), "everywhere": 0.42, "lit": 0.48, "in_front": 0.14}
"""Direction to the light as seen by the viewer, and brightness of surfaces: base, towards the light, to the viewer."""
IN_WORLD = ("arrow", "twist", "support")
"""Forms with a direction in world axes."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a shape. Its axes x, y, z move with the shape.

    Attributes
    ----------
    what : str           box, ball: from -1 to 1; cylinder, cone, drum: z from 0 to 1, the tip of a cone is at z = 1;
                         bar: a cylinder with round ends; line: along `points`;
                         arrow: `size` has the radii of its shaft and of its head, and the length of its head
    axes : str           world; half: half axes of a solid; axis: z along the direction;
                         scaled: y is the direction, and x and z have the same length;
                         ends: z is the distance from one place to the other, and x and y are unit vectors
    size, at : (3,)      sizes, and the place, along x, y and z
    points : (n, 3)      points of a line with the radius size[0]
    """

    what: str
    axes: str
    size: tuple[float, ...]
    at: tuple[float, ...] = (0.0, 0.0, 0.0)
    points: Array | None = None


def circle(turns: Array) -> Array:
    """Points (n, 3) of the unit circle in the xy plane."""
    return np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns), 0 * turns], axis=1)


def parts(shape: Shape, flat: bool) -> Iterator[Part]:
    """The parts of a shape. `flat` is for pictures in a plane. Forms that are drawn as a whole have no parts."""
    return _FORMS[shape.form](shape, flat) if shape.form in _FORMS else iter(())


def directions(shape: Shape) -> Array | None:
    """Directions in the order that parts need: rows of a track, corners of a mesh, or half axes one after the other.

    The length of the direction of a torque is the radius of its round arrow.
    """
    track, r = shape.direction, shape.size[0]
    if track is None or shape.form not in ("solid", "twist"):
        return track
    if shape.form == "solid":
        return track.T.reshape(1, 9)
    lengths = np.linalg.norm(track, axis=1, keepdims=True)
    return track * 7 * np.sqrt(r / (23.4 * np.maximum(lengths, NOTHING)))


def _coil(shape: Shape, flat: bool) -> Iterator[Part]:
    radius, offset = shape.size
    turns, straight = 7, 0.12  # `straight` is the fraction of the length at each end without turns
    angles = np.linspace(0, turns, (4 if flat else 16) * turns + 1)
    swing = radius * (circle(angles)[:, [1, 2, 2]] if flat else circle(angles))
    swing[[0, -1]] = 0.0
    swing[:, 2] = straight + (1 - 2 * straight) * angles / turns
    points = np.vstack([[0, 0, 0], swing, [0, 0, 1]]) + [offset, 0, 0]
    yield Part("line", "ends", ((0.13 if flat else 0.11) * radius,), points=points)


def _dashpot(shape: Shape, flat: bool) -> Iterator[Part]:
    radius, offset = shape.size
    yield Part("cylinder", "ends", (0.35 * radius, 0.35 * radius, 1.0), (offset, 0.0, 0.0))
    yield Part("cylinder", "ends", (radius, radius, 0.45), (offset, 0.0, 0.15))


def _dashes(shape: Shape, flat: bool) -> Iterator[Part]:
    for k in range(0, 9, 2):
        yield Part("line", "ends", shape.size, points=np.array([[0, 0, k / 9], [0, 0, (k + 1) / 9]]))


def _solid(shape: Shape, flat: bool) -> Iterator[Part]:
    if shape.size[0] == 1:
        yield Part("drum", "half", (1.0, 1.0, 2.0), (0.0, 0.0, -1.0))
    else:
        yield Part("ball" if shape.size[0] else "box", "half", (1.0, 1.0, 1.0))


def _spiral(shape: Shape, flat: bool) -> Iterator[Part]:
    share = np.linspace(0, 1, 61)
    points = shape.size[0] * circle(2.5 * share) * (0.25 + 0.75 * share)[:, None]
    yield Part("line", "axis", (0.07 * shape.size[0],), points=points)


def _twist(shape: Shape, flat: bool) -> Iterator[Part]:
    yield Part("line", "scaled", (0.05,), points=circle(np.linspace(0, 0.75, 25))[:, [1, 2, 0]])
    yield Part("cone", "scaled", (0.16, 0.16, 0.45), (-1.0, 0.0, 0.0))


def _support(shape: Shape, flat: bool) -> Iterator[Part]:
    s, deep = shape.size[0], 0.3 if flat else 0.7
    yield Part("cone", "axis", (deep * s, 0.8 * s, -s), (0.0, 0.0, s))
    yield Part("box", "axis", (1.3 * deep * s, 1.3 * s, 0.12 * s), (0.0, 0.0, 1.12 * s))


def _one(part: Callable[..., Part]) -> Callable[[Shape, bool], Iterator[Part]]:
    """A form with one part, from its sizes."""
    return lambda shape, flat: iter([part(*shape.size)])


_FORMS: dict[str, Callable[[Shape, bool], Iterator[Part]]] = {
    "bar": _one(lambda r: Part("bar", "ends", (r, r, 1.0))),
    "ball": _one(lambda r: Part("ball", "world", (r, r, r))),
    "pin": _one(lambda r, length: Part("cylinder", "axis", (r, r, length), (0.0, 0.0, -length / 2))),
    "block": _one(lambda a, b, c: Part("box", "axis", (c / 2, b / 2, a / 2))),
    "ring": _one(lambda r, tube: Part("line", "axis", (tube,), points=r * circle(np.linspace(0, 1, 41)))),
    "plane": _one(lambda s: Part("box", "axis", (s / 2, s / 2, 0.006 * s), (0.0, 0.0, -0.006 * s))),
    "arrow": _one(lambda r: Part("arrow", "axis", (r, 2.2 * r, 4 * r))),
    "solid": _solid,
    "coil": _coil,
    "dashpot": _dashpot,
    "dashes": _dashes,
    "spiral": _spiral,
    "twist": _twist,
    "support": _support,
}
