"""Mass, centre of mass and inertia of several links that form one body."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

from symmb.declare.mechanics.robots.algebra import Matrix, Scalar, Vector, add, dot, is_nought


@dataclass(frozen=True, eq=False)
class Mass:
    """Mass [kg], centre of mass (3,) [m], and inertia (3, 3) about the centre of mass [kg m^2], in axes of the body."""

    mass: Scalar
    com: Vector
    inertia: Matrix


def united(parts: Sequence[Mass]) -> Mass:
    """The mass, the centre of mass and the inertia of all parts together."""
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
    """Inertia (3, 3) of a point mass about a point. `arm` leads from one to the other (parallel axis theorem)."""
    squared = dot(arm, arm)
    return tuple(tuple(mass * ((squared if i == k else 0.0) - arm[i] * arm[k]) for k in range(3)) for i in range(3))


def _total(vectors: Sequence[Vector]) -> Vector:
    """The sum of vectors."""
    return reduce(add, vectors)


def _sum(matrices: Sequence[Matrix]) -> Matrix:
    """The sum of matrices."""
    return tuple(_total(rows) for rows in zip(*matrices, strict=True))
