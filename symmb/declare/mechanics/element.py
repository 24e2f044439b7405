"""The base classes of constraints, forces and their laws. These classes check the values of all fields."""

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
from symmb.declare.mechanics.declaration import enter
from symmb.declare.mechanics.pose import Fixed, Planar, Pose
from symmb.declare.mechanics.table import Table
from symmb.declare.symbolic import has_irregular_constant, is_zero, vector


class Bind(Protocol):
    """Converts an expression (number, SX or SymPy) into SX. The text `what` names the expression in error messages."""

    def __call__(self, law: Any, what: str, /) -> ca.SX: ...

    def nominal(self, expression: ca.SX, /) -> Array:
        """The values of an expression of parameters at the nominal parameters."""
        ...


class Element(ABC):
    """A constraint or a force, with its name, its bodies and the faults of its declaration.

    The type of a field determines which points, bodies, laws and curves are accepted. The metadata of a field, such as
    `DIRECTION` and `POSITIVE`, determine the accepted directions, numbers and truth values. `poses` lists the accepted
    poses of each body. If `poses` is empty, every pose is accepted.
    """

    poses: ClassVar[tuple[tuple[type[Pose], ...], ...]] = ()
    of_start: ClassVar[str | None] = None
    """End of the name of the state whose value the start of a scene may give; None: no state."""

    name: str

    def __new__(cls, *_: Any, **__: Any) -> Self:
        element = super().__new__(cls)
        enter(element)
        return element

    @property
    def kind(self) -> str:
        """The name of the element's class in messages."""
        return type(self).__name__

    @property
    def title(self) -> str:
        """The kind and the name of the element in messages."""
        return f"{self.kind} {self.name!r}"

    def bodies(self) -> tuple[AbstractBody, ...]:
        """The bodies and grounds the element is attached to."""
        return _attached(self)

    def number(self, bind: Bind, what: str) -> ca.SX:
        """The number or expression of a field as SX."""
        return bind(getattr(self, what), f"{self.title}: {what}")

    def parts(self) -> "tuple[Element, ...]":
        """Other elements on which this element acts. The system must contain these elements, too."""
        return ()

    def doubtful(self, bind: Bind) -> Iterator[tuple[ca.SX, str]]:
        """Expressions that become negative if a run leaves the range of validity of the element's law, each
        with the text of a warning. The time replaces {} in the text."""
        yield from ()

    def place_faults(self) -> list[str]:
        """Faults of the points and bodies to which the element is attached. If this list is not empty, other faults
        are not searched."""
        return [fault for kind, place in _places(self) for fault in _PLACES[kind](self.title, place)]

    def faults(self) -> Iterator[str]:
        """Faults of the declaration. Each fault is a sentence with a remedy."""
        yield from pose_faults(self.title, _attached(self), self.poses)
        yield from _field_faults(self.title, self)


def _given(owner: object) -> Iterator[tuple[Field[Any], Any]]:
    """The fields of an element or a law with their values. Options that are None are left out."""
    for f in fields(owner):  # pyright: ignore[reportArgumentType]
        if f.init and not ((value := getattr(owner, f.name)) is None and f.default is None):
            yield f, value


def _places(element: Element) -> list[tuple[Any, Any]]:
    """The types of an element's fields for points and bodies, each with the value of the field."""
    return [(f.type, value) for f, value in _given(element) if f.type in _PLACES]


def _attached(element: Element) -> tuple[AbstractBody, ...]:
    return tuple(place.body if kind is Point else place for kind, place in _places(element))


def _field_faults(title: str, owner: object) -> Iterator[str]:
    """Faults of the fields of an element or a law: a wrong class, or a value that the metadata do not allow."""
    for f, value in _given(owner):
        kinds: tuple[Any, ...] = get_args(f.type) or (f.type,)
        for kind in kinds:
            if hasattr(kind, "expected") and not isinstance(value, kind):
                got = value.title if isinstance(value, Element) else shown(value)
                yield f"{title}: expected {kind.expected.format(got)}"
        if "faults" in f.metadata:
            yield from f.metadata["faults"](title, f.name, value)


def point_faults(title: str, *points: object) -> Iterator[str]:
    """Faults of the points to which an element is attached."""
    for point in points:
        if not isinstance(point, Point):
            yield f"{title}: expected a point, got {type(point).__name__}. Use body.point(x, y) or ground.point(x, y)."
        elif has_irregular_constant(point.s):
            yield f"{title}: a point of body {point.body.name!r} contains NaN or infinity. Use finite coordinates."
        elif isinstance(point.body.pose, Planar) and not is_zero(point.s[2]):
            yield (
                f"{title}: the point on planar body {point.body.name!r} has z = {point.s[2]}, but planar bodies have "
                "points with z = 0 only. Use z = 0 or pose=Spatial()."
            )


def body_faults(title: str, *bodies: object) -> Iterator[str]:
    """Faults of the bodies to which an element is attached."""
    for body in bodies:
        if not isinstance(body, AbstractBody):
            yield f"{title}: expected a body, got {type(body).__name__}. Pass a Body or Ground()."


_PLACES: dict[Any, Callable[..., Iterator[str]]] = {Point: point_faults, AbstractBody: body_faults}
"""Types of the fields for points and bodies, each with the function that checks a value."""


def pose_faults(
    title: str, bodies: tuple[AbstractBody, ...], allowed: tuple[tuple[type[Pose], ...], ...]
) -> Iterator[str]:
    """Faults of an element with bodies of a pose that is not allowed, or with bodies that have no relative motion."""
    # Not strict: elements with more bodies than `poses` accept every pose of the others.
    for body, poses in zip(bodies, allowed, strict=False):
        if not isinstance(body.pose, (*poses, Fixed)):
            names = " or ".join(f"pose={p.__name__}()" for p in poses)
            yield f"{title}: body {body.name!r} has {body.pose!r}, which cannot be used. Use {names} or other elements."
    yield from pair_faults(title, bodies)


def pair_faults(title: str, bodies: tuple[AbstractBody, ...]) -> Iterator[str]:
    """Fault of an element with two points that cannot move relative to each other."""
    if len(bodies) > 1 and all(isinstance(body, Ground) for body in bodies):
        yield f"{title}: both points are on the ground, so the element has no effect. Use points of two bodies."
    elif len(bodies) > 1 and bodies[0] is bodies[1]:
        name = bodies[0].name
        yield f"{title}: both points are on body {name!r}, so the element has no effect. Use points of two bodies."


def direction_faults(title: str, what: str, axis: Any) -> Iterator[str]:
    """Fault of a direction that is zero or not finite."""
    a = vector(axis, f"{what} of {title}")
    if is_zero(a):
        yield f"{title}: {what} {shown(axis)} has no direction. Pass a vector that is not zero."
    elif has_irregular_constant(a):
        yield f"{title}: {what} {shown(axis)} contains NaN or infinity. Pass a vector of finite numbers."


def truth_faults(title: str, what: str, value: object) -> Iterator[str]:
    """Fault of a value that is neither True nor False."""
    if not isinstance(value, bool | np.bool_):
        yield f"{title}: {what} must be True or False, got {shown(value)}."


def law_faults(title: str, what: str, value: object, *, of: str) -> Iterator[str]:
    """Fault of a value that is not a function."""
    if not callable(value):
        yield f"{title}: {what} {shown(value)} is not a function. Pass a function of {of}"


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
    """Fault of a number outside its range. Expressions are not checked."""
    if is_real(value) and not (value > above and least <= value <= most):
        words = [f"above {above:g}"] if above > -math.inf else []
        words += [f"at least {least:g}"] if least > -math.inf else []
        words += [f"at most {most:g}"] if most < math.inf else []
        yield f"{title}: {what} is {number_text(value)}; it must be {' and '.join(words)}. {remedy}".rstrip()


def within(**limits: Any) -> dict[str, Any]:
    """Metadata of a field for numbers `above` a limit, or from `least` to `most`. Error messages end with `remedy`."""
    return {"faults": partial(number_faults, **limits)}


def function(of: str) -> dict[str, Any]:
    """Metadata of a field for functions. Error messages end with the text `of`, which names the arguments."""
    return {"faults": partial(law_faults, of=of)}


POSITIVE, NOT_NEGATIVE = within(above=0.0), within(least=0.0)
DIRECTION, TRUTH = {"faults": direction_faults}, {"faults": truth_faults}


class Law(ABC):
    """A law of an element. Types and metadata of its fields determine the accepted values, as for elements.

    `expected` is the end of the error message for a value of another class.
    """

    expected: ClassVar[str]

    def __post_init__(self) -> None:
        for f, value in _given(self):
            if is_real(value):
                object.__setattr__(self, f.name, python_number(value))
        for fault in _field_faults(type(self).__name__, self):
            raise DeclarationError(fault)


def law_value(law: Callable[..., Expr], title: str, *arguments: Any) -> Expr:
    """The value of a user's law. An exception in the law becomes a DeclarationError."""
    try:
        return law(*arguments)
    except DeclarationError:
        raise
    except Exception as error:  # the law is the user's
        raise DeclarationError(f"{title}: the law raises {text_of(error)}.") from error


T = TypeVar("T")


def bound(law: T, bind: Callable[[Any, str], ca.SX], title: str) -> T:
    """A copy of a law with numbers and expressions as SX.

    Tables, functions, and options that are None are not changed.
    """
    values = {f.name: bind(value, f"{title}: {f.name}") for f, value in _given(law) if not _stays(f.type, value)}
    return replace(law, **values)  # pyright: ignore[reportArgumentType]


def positive_numbers(title: str, owner: object, bind: Bind) -> Iterator[tuple[str, ca.SX]]:
    """Expressions of an element and its laws that must be above 0, with their names.

    Where 0 is allowed, too, the expression is 1 unless the value is negative.
    """
    for f, value in _given(owner):
        if isinstance(value, Law):
            yield from positive_numbers(title, value, bind)
        limits = getattr(f.metadata.get("faults"), "keywords", {})
        if 0.0 in (limits.get("above"), limits.get("least")) and not is_real(value) and not _stays(f.type, value):
            name = f"{title}: {f.name}"
            own = bind(value, name)
            yield name, own if "above" in limits else ca.if_else(own >= 0, 1, own)


def _stays(kind: Any, value: object) -> bool:
    """Whether `bound` keeps a value unchanged: a table or a function that the field of a law accepts."""
    kinds = get_args(kind) or (kind,)
    functions = callable(value) and any(get_origin(each) is Callable for each in kinds)
    return functions or (isinstance(value, Table) and Table in kinds)
