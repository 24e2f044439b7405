"""The base of constraints and forces."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any, Protocol, TypeVar, cast, get_args, get_origin

import casadi as ca

from symmb._errors import DeclarationError, text_of
from symmb._options import is_real, number_text, python_number, shown
from symmb._types import Array, Expr
from symmb.mechanics.body import AbstractBody, Ground, Point
from symmb.mechanics.pose import Fixed, Planar, Pose, Spatial
from symmb.mechanics.table import Table
from symmb.symbolic import has_irregular_constant, is_zero, vector


class Bind(Protocol):
    """Converts an expression (number, SX or SymPy) into SX. The text names its owner in error messages."""

    def __call__(self, law: Any, what: str, /) -> ca.SX: ...

    def nominal(self, expression: ca.SX, /) -> Array:
        """Values of an expression of parameters at the nominal ones."""
        ...


class Element(ABC):
    """A constraint or a force, with its name, its bodies and the faults of its declaration."""

    name: str

    @property
    def title(self) -> str:
        """Class and name for messages."""
        return f"{type(self).__name__} {self.name!r}"

    @abstractmethod
    def bodies(self) -> tuple[AbstractBody, ...]:
        """The bodies and grounds the element is attached to."""

    def parts(self) -> "tuple[Element, ...]":
        """Other elements that it acts on, which must be in the system as well."""
        return ()

    @abstractmethod
    def faults(self) -> Iterator[str]:
        """Faults of the declaration: a sentence with a remedy for each."""


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


def size_faults(element: Element, *names: str) -> Iterator[str]:
    """Faults of sizes of an element that are negative."""
    for name in names:
        if is_real(value := getattr(element, name)) and not value >= 0:
            yield f"{element.title}: {name} is {number_text(value)}; it must be at least 0."


def body_faults(title: str, *bodies: object) -> Iterator[str]:
    """Faults of the bodies an element is attached to."""
    for body in bodies:
        if not isinstance(body, AbstractBody):
            yield f"{title}: expected a body, got {type(body).__name__}."


def pose_faults(
    title: str, bodies: tuple[AbstractBody, ...], allowed: tuple[tuple[type[Pose], ...], ...]
) -> Iterator[str]:
    """Faults of a joint whose bodies have poses that it does not support."""
    for body, poses in zip(bodies, allowed, strict=True):
        if not isinstance(body.pose, (*poses, Fixed)):
            names = " or ".join(f"pose={p.__name__}()" for p in poses)
            yield f"{title}: makes no sense on {body.pose!r} body {body.name!r}. Use {names}, or another joint."
    yield from pair_faults(title, bodies)


def direction_faults(title: str, what: str, axis: Any) -> Iterator[str]:
    """Fault of an invalid direction."""
    a = vector(axis, f"{what} of {title}")
    if is_zero(a):
        yield f"{title}: {what} {shown(axis)} has no direction. Give a vector that is not zero."
    elif has_irregular_constant(a):
        yield f"{title}: {what} {shown(axis)} contains NaN or infinity. Give a vector of finite numbers."


def turning_faults(title: str, body_a: object, body_b: object, axis: Any) -> Iterator[str]:
    """Faults of an element that turns two bodies about an axis fixed in both."""
    faults = list(body_faults(title, body_a, body_b))
    yield from faults
    if faults:
        return
    bodies = cast(tuple[AbstractBody, ...], (body_a, body_b))
    yield from pose_faults(title, bodies, ((Planar, Spatial), (Planar, Spatial)))
    faults = list(direction_faults(title, "axis", axis))
    yield from faults
    a = vector(axis)
    if not faults and any(isinstance(b.pose, Planar) for b in bodies) and not (is_zero(a[0]) and is_zero(a[1])):
        yield f"{title}: axis {axis} leaves the plane. Planar bodies turn about z; use axis=(0, 0, 1)."


def pair_faults(title: str, bodies: tuple[AbstractBody, ...]) -> Iterator[str]:
    """Fault of an element whose two points cannot move relative to each other."""
    if len(bodies) > 1 and all(isinstance(body, Ground) for body in bodies):
        yield f"{title}: both points are on the ground, nothing is left to act on."
    elif len(bodies) > 1 and bodies[0] is bodies[1]:
        yield f"{title}: both points are on body {bodies[0].name!r}, nothing is left to act on."


def law_value(law: Callable[..., Expr], title: str, *arguments: Any) -> Expr:
    """The value of a user's law. What it raises becomes a DeclarationError."""
    try:
        return law(*arguments)
    except DeclarationError:
        raise
    except Exception as error:  # the law is the user's
        raise DeclarationError(f"{title}: the law raises {text_of(error)}.") from error


Law = TypeVar("Law")


def bound(law: Law, bind: Callable[[Any, str], ca.SX], title: str) -> Law:
    """A law, a dataclass, whose numbers and expressions are bound.

    Tables, functions where these are legal, and options that are None stay.
    """
    laws = {
        f.name: value
        for f in fields(law)  # pyright: ignore[reportArgumentType]
        if f.init
        and not isinstance(value := getattr(law, f.name), Table)
        and (value is not None or f.default is not None)
        if not (callable(value) and any(get_origin(kind) is Callable for kind in get_args(f.type)))
    }
    values = {name: bind(value, f"{title}: {name}") for name, value in laws.items()}
    return replace(law, **values)  # pyright: ignore[reportArgumentType]


def require_number(
    law: object, what: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> None:
    """A number of a law becomes Python's; raise if it is out of its range. Expressions are not checked."""
    if not is_real(value):
        return
    object.__setattr__(law, what, python_number(value))
    if not (value > above and least <= value <= most):
        words = [f"above {above:g}"] if above > -math.inf else []
        words += [f"at least {least:g}"] if least > -math.inf else []
        words += [f"at most {most:g}"] if most < math.inf else []
        text = f"{what} is {number_text(value)}; it must be {' and '.join(words)}."
        raise DeclarationError(f"{type(law).__name__}: {text}")
