"""Mass, centre of mass and inertia of links that are held together."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

from symmb.declare.mechanics.robots.algebra import Matrix, Scalar, Vector, add, dot, is_nought


@dataclass(frozen=True, eq=False)
class Mass:
    """Mass [kg], centre of mass [m], and inertia about it [kg m^2], in axes of the body."""

    mass: Scalar
    com: Vector
    inertia: Matrix


def united(parts: Sequence[Mass]) -> Mass:
    """The mass, the centre and the inertia of parts that are held together."""
    heavy = [part for part in parts if not is_nought(part.mass)]
    inertias = [part.inertia for part in parts]
    if not heavy:
        return Mass(parts[0].mass, (0.0, 0.0, 0.0), _sum(inertias))
    if len(heavy) == 1:
        return Mass(heavy[0].mass, heavy[0].com, _sum(inertias))
    mass = reduce(lambda a, b: a + b, [part.mass for part in heavy])
    moments = [tuple(part.mass * x for x in part.com) for part in heavy]
    com = tuple(x / mass for x in _total(moments))
    offsets = [_offset(part.mass, tuple(x - c for x, c in zip(part.com, com, strict=True))) for part in heavy]
    return Mass(mass, com, _sum([*inertias, *offsets]))


def _offset(mass: Scalar, arm: Vector) -> Matrix:
    """Inertia of a mass about a point at a distance from it (Steiner)."""
    squared = dot(arm, arm)
    return tuple(tuple(mass * ((squared if i == k else 0.0) - arm[i] * arm[k]) for k in range(3)) for i in range(3))


def _total(vectors: Sequence[Vector]) -> Vector:
    return reduce(add, vectors)


def _sum(matrices: Sequence[Matrix]) -> Matrix:
    return tuple(_total(rows) for rows in zip(*matrices, strict=True))
