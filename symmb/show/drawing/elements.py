"""Elements as shapes. `joints` and `forces` register one function for each kind of element with `sketch`."""

from collections.abc import Callable, Iterator
from functools import singledispatch

import numpy as np

from symmb._types import Array
from symmb.declare.mechanics import Element, Ground, Point
from symmb.show.drawing.shapes import Shape
from symmb.show.drawing.survey import Asked, Survey

Build = Callable[[float], Iterator[Shape]]
"""A function that draws an element for a unit of length [m], after the numbers are computed."""
JOINT, GUIDE, SPRING, DAMPER, LOAD, CONTACT = "joint", "guide", "spring", "damper", "load", "contact"
"""Colours of elements; colours of bodies are numbers."""


@singledispatch
def sketch(element: Element, survey: Survey) -> Build | None:
    """The function that draws an element. It requests places from the survey now; None if the element has no place."""
    return None


def shape_of(
    element: Element,
    form: str,
    colour: str,
    places: tuple[int, ...],
    size: tuple[float, ...],
    direction: Array | None = None,
    *,
    faint: bool = False,
) -> Shape:
    """A shape with the name and the kind of the element."""
    return Shape(form, element.name, element.kind, colour, places, size, direction, faint)


def supports(element: Element, survey: Survey, *points: Point) -> Build:
    """Supports at the points that are fixed to the ground."""
    grounded = [survey.place(p) for p in points if isinstance(p.body, Ground)]
    return lambda u: (
        Shape("support", "ground", element.name, GUIDE, (place,), (3.2 * u,), survey.away(place)) for place in grounded
    )


def unit_vectors(asked: Asked) -> Array:
    """Unit vectors, (1, 3) or (n_f, 3)."""
    values = asked()
    return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-300)
