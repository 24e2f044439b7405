"""The base of constraints and forces, and of their laws: what their fields accept is checked here."""

import math
from abc import ABC
from collections.abc import Callable, Iterator
from dataclasses import Field, fields, replace
from functools import partial
from typing import Any, ClassVar, Protocol, Self, TypeVar, get_args, get_origin

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, text_of
from symmb._options import is_real, number_text, python_number, shown
from symmb._types import Array, Expr
from symmb.declare.mechanics.body import AbstractBody, Ground, Point
from symmb.declare.mechanics.declaration import declared
from symmb.declare.mechanics.pose import Fixed, Planar, Pose
from symmb.declare.mechanics.table import Table
from symmb.declare.symbolic import has_irregular_constant, is_zero, vector


class Bind(Protocol):
    """Converts an expression (number, SX or SymPy) into SX. The text names its owner in error messages."""

    def __call__(self, law: Any, what: str, /) -> ca.SX: ...

    def nominal(self, expression: ca.SX, /) -> Array:
        """Values of an expression of parameters at the nominal ones."""
        ...


class Element(ABC):
    """A constraint or a force, with its name, its bodies and the faults of its declaration.

    The fields of an element say what they accept: points, bodies, laws and curves by their types, directions, numbers
    and truth values by metadata, such as `DIRECTION` and `POSITIVE`. `poses` are those that its bodies may have, one
    after the other; without them any will do.
    """

    poses: ClassVar[tuple[tuple[type[Pose], ...], ...]] = ()

    name: str

    def __new__(cls, *_: Any, **__: Any) -> Self:
        element = super().__new__(cls)
        declared(element)
        return element

    @property
    def kind(self) -> str:
        """An element that a user declares."""
        return type(self).__name__

    @property
    def title(self) -> str:
        """Kind and name for messages."""
        return f"{self.kind} {self.name!r}"

    def bodies(self) -> tuple[AbstractBody, ...]:
        """The bodies and grounds the element is attached to."""
        return _attached(self)

    def number(self, bind: Bind, what: str) -> ca.SX:
        """A field as an expression."""
        return bind(getattr(self, what), f"{self.title}: {what}")

    def parts(self) -> "tuple[Element, ...]":
        """Other elements that it acts on, which must be in the system as well."""
        return ()

    def doubtful(self, bind: Bind) -> Iterator[tuple[ca.SX, str]]:
        """Expressions that are below 0 when a run leaves the range of the element's law, with sentences; {} is the
        time."""
        yield from ()

    def place_faults(self) -> list[str]:
        """Faults of the points and bodies that it is attached to. The others are looked for where there are none."""
        return [fault for kind, place in _places(self) for fault in _PLACES[kind](self.title, place)]

    def faults(self) -> Iterator[str]:
        """Faults of the declaration: a sentence with a remedy for each."""
        yield from pose_faults(self.title, _attached(self), self.poses)
        yield from _field_faults(self.title, self)


def _given(owner: object) -> Iterator[tuple[Field[Any], Any]]:
    """The fields of an element or a law with their values, but for options that are left out by None."""
    for f in fields(owner):  # pyright: ignore[reportArgumentType]
        if f.init and not ((value := getattr(owner, f.name)) is None and f.default is None):
            yield f, value


def _places(element: Element) -> list[tuple[Any, Any]]:
    """The points and bodies that an element is attached to, behind the types of their fields."""
    return [(f.type, value) for f, value in _given(element) if f.type in _PLACES]


def _attached(element: Element) -> tuple[AbstractBody, ...]:
    return tuple(place.body if kind is Point else place for kind, place in _places(element))


def _field_faults(title: str, owner: object) -> Iterator[str]:
    """Faults of the fields of an element or a law by their metadata, and of what is of another class than a field."""
    for f, value in _given(owner):
        kinds: tuple[Any, ...] = get_args(f.type) or (f.type,)
        for kind in kinds:
            if hasattr(kind, "expected") and not isinstance(value, kind):
                got = value.title if isinstance(value, Element) else shown(value)
                yield f"{title}: expected {kind.expected.format(got)}"
        if "faults" in f.metadata:
            yield from f.metadata["faults"](title, f.name, value)


def point_faults(title: str, *points: object) -> Iterator[str]:
    """Faults of the points an element is attached to."""
    for point in points:
        if not isinstance(point, Point):
            yield f"{title}: expected a point, got {type(point).__name__}. Use body.point(x, y) or ground.point(x, y)."
        elif has_irregular_constant(point.s):
            yield f"{title}: contains NaN or infinity in a point of body {point.body.name!r}."
        elif isinstance(point.body.pose, Planar) and not is_zero(point.s[2]):
            yield (
                f"{title}: the point on planar body {point.body.name!r} lies out of its plane (z = {point.s[2]}). "
                "Use z = 0 or pose=Spatial()."
            )


def body_faults(title: str, *bodies: object) -> Iterator[str]:
    """Faults of the bodies an element is attached to."""
    for body in bodies:
        if not isinstance(body, AbstractBody):
            yield f"{title}: expected a body, got {type(body).__name__}."


_PLACES: dict[Any, Callable[..., Iterator[str]]] = {Point: point_faults, AbstractBody: body_faults}
"""Types of fields that an element is attached to, with their faults."""


def pose_faults(
    title: str, bodies: tuple[AbstractBody, ...], allowed: tuple[tuple[type[Pose], ...], ...]
) -> Iterator[str]:
    """Faults of an element whose bodies have poses that it does not support, or cannot move relative to each other."""
    for body, poses in zip(bodies, allowed, strict=False):
        if not isinstance(body.pose, (*poses, Fixed)):
            names = " or ".join(f"pose={p.__name__}()" for p in poses)
            yield f"{title}: makes no sense on {body.pose!r} body {body.name!r}. Use {names}, or another joint."
    yield from pair_faults(title, bodies)


def pair_faults(title: str, bodies: tuple[AbstractBody, ...]) -> Iterator[str]:
    """Fault of an element whose two points cannot move relative to each other."""
    if len(bodies) > 1 and all(isinstance(body, Ground) for body in bodies):
        yield f"{title}: both points are on the ground, nothing is left to act on."
    elif len(bodies) > 1 and bodies[0] is bodies[1]:
        yield f"{title}: both points are on body {bodies[0].name!r}, nothing is left to act on."


def direction_faults(title: str, what: str, axis: Any) -> Iterator[str]:
    """Fault of an invalid direction."""
    a = vector(axis, f"{what} of {title}")
    if is_zero(a):
        yield f"{title}: {what} {shown(axis)} has no direction. Give a vector that is not zero."
    elif has_irregular_constant(a):
        yield f"{title}: {what} {shown(axis)} contains NaN or infinity. Give a vector of finite numbers."


def truth_faults(title: str, what: str, value: object) -> Iterator[str]:
    """Fault of what is neither True nor False."""
    if not isinstance(value, bool | np.bool_):
        yield f"{title}: {what} must be True or False, got {shown(value)}."


def law_faults(title: str, what: str, value: object, *, of: str) -> Iterator[str]:
    """Fault of what is no function."""
    if not callable(value):
        yield f"{title}: {what} {shown(value)} is no law. Give a function of {of}"


def number_faults(
    title: str,
    what: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    remedy: str = "",
) -> Iterator[str]:
    """Fault of a number that is out of its range. Expressions are not checked."""
    if is_real(value) and not (value > above and least <= value <= most):
        words = [f"above {above:g}"] if above > -math.inf else []
        words += [f"at least {least:g}"] if least > -math.inf else []
        words += [f"at most {most:g}"] if most < math.inf else []
        yield f"{title}: {what} is {number_text(value)}; it must be {' and '.join(words)}. {remedy}".rstrip()


def within(**limits: Any) -> dict[str, Any]:
    """Metadata of a field whose numbers are `above` one limit, or from `least` to `most`, with a `remedy` if any."""
    return {"faults": partial(number_faults, **limits)}


def function(of: str) -> dict[str, Any]:
    """Metadata of a field that takes a function. The text says of what, and ends the sentence of its fault."""
    return {"faults": partial(law_faults, of=of)}


POSITIVE, NOT_NEGATIVE = within(above=0.0), within(least=0.0)
DIRECTION, TRUTH = {"faults": direction_faults}, {"faults": truth_faults}


class Law(ABC):
    """A law of an element. Its fields say what they accept, and `expected` says what can replace it."""

    expected: ClassVar[str]

    def __post_init__(self) -> None:
        for f, value in _given(self):
            if is_real(value):
                object.__setattr__(self, f.name, python_number(value))
        for fault in _field_faults(type(self).__name__, self):
            raise DeclarationError(fault)


def law_value(law: Callable[..., Expr], title: str, *arguments: Any) -> Expr:
    """The value of a user's law. What it raises becomes a DeclarationError."""
    try:
        return law(*arguments)
    except DeclarationError:
        raise
    except Exception as error:  # the law is the user's
        raise DeclarationError(f"{title}: the law raises {text_of(error)}.") from error


T = TypeVar("T")


def bound(law: T, bind: Callable[[Any, str], ca.SX], title: str) -> T:
    """A law, a dataclass, whose numbers and expressions are bound.

    Tables and functions where these are legal, and options that are None, stay.
    """
    values = {f.name: bind(value, f"{title}: {f.name}") for f, value in _given(law) if not _stays(f.type, value)}
    return replace(law, **values)  # pyright: ignore[reportArgumentType]


def _stays(kind: Any, value: object) -> bool:
    """Whether a field of a law takes a table or a function as it is."""
    kinds = get_args(kind) or (kind,)
    functions = callable(value) and any(get_origin(each) is Callable for each in kinds)
    return functions or (isinstance(value, Table) and Table in kinds)
