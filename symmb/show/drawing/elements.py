"""Elements as shapes. `joints` and `forces` register one function for each kind of element with `sketch`."""

from collections.abc import Generator, Iterator
from contextlib import suppress
from functools import singledispatch
from typing import Any

import numpy as np

from symmb._magnitudes import NOTHING
from symmb._types import Array
from symmb.declare.mechanics import Element, Ground, Point
from symmb.show.drawing.shapes import Shape
from symmb.show.drawing.survey import Asked, Survey

Sketch = Generator[Any, float, Any]
"""A generator that draws an element. It requests numbers, waits for the unit of length [m], and yields shapes."""
JOINT, GUIDE, SPRING, DAMPER, LOAD, CONTACT = "joint", "guide", "spring", "damper", "load", "contact"
"""Colours of elements; colours of bodies are numbers."""


@singledispatch
def sketch(element: Element, survey: Survey) -> Sketch:
    """Draw an element. If the element has no place in the drawing, the generator ends before its first `yield`."""
    yield from ()


def begun(drawn: Sketch) -> Sketch | None:
    """The generator of an element after it has requested its numbers; None if the element is not drawn."""
    return drawn if next(drawn, False) is None else None


def shapes_of(drawn: Sketch, unit: float) -> Iterator[Shape]:
    """The shapes of an element. The survey must have been evaluated."""
    with suppress(StopIteration):  # some elements have no shape, such as forces that are always zero
        yield drawn.send(unit)
        yield from drawn


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


def supports(element: Element, survey: Survey, *points: Point) -> Generator[Shape | None, float, float]:
    """Draw supports at the points that are fixed to the ground, and return the unit of length."""
    grounded = [survey.place(p) for p in points if isinstance(p.body, Ground)]
    u = yield
    for place in grounded:
        yield Shape("support", "ground", element.name, GUIDE, (place,), (3.2 * u,), survey.away(place))
    return u


def unit_vectors(asked: Asked) -> Array:
    """Unit vectors, (1, 3) or (n_f, 3)."""
    values = asked()
    return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), NOTHING)
