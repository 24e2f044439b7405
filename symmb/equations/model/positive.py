"""Expressions that must be above 0 for all parameters: masses, moments of inertia, lengths."""

from collections.abc import Iterator, Sequence

import casadi as ca

from symmb.declare.mechanics import TRIANGLE, Body, Constraint, Spatial
from symmb.declare.symbolic import is_zero
from symmb.equations.model.binding import Binding

Inertia = tuple[Body, tuple[ca.SX, ca.SX]]
"""A body with its mass and its inertia matrix (3, 3)."""


def positive(
    inertial: Sequence[Inertia], constraints: Sequence[Constraint], bind: Binding
) -> Iterator[tuple[str, ca.SX]]:
    """Expressions of parameters that must be above 0, with their names."""
    for body, (mass, J) in inertial:
        triangle = (
            ("triangle inequality of moments of inertia (a leading minor of tr(J) / 2 - J)", m)
            for m in _triangle_minors(body, J)
        )
        for what, value in (("mass", mass), *(("inertia", J[k, k]) for k in range(3)), *triangle):
            if not is_zero(value) and bind.has_parameters_alone(value):
                yield f"Body {body.name!r}: {what}", value
    for constraint in constraints:
        value = constraint.positive(bind)
        if value.numel() and bind.has_parameters_alone(value):
            yield f"{constraint.title}: length", value


def _triangle_minors(body: Body, J: ca.SX) -> list[ca.SX]:
    """Three expressions that are positive if no principal moment of a spatial body exceeds the sum of the others.

    They are the leading minors of tr(J) / 2 - J, which are the second moments of the mass, with an allowance for
    rounding. The first minor is half of the sum of two moments minus the third moment.
    """
    if not isinstance(body.pose, Spatial) or is_zero(J):
        return []
    moments = ca.densify((0.5 + TRIANGLE) * ca.trace(J) * ca.SX.eye(3) - J)
    return [ca.det(moments[:k, :k]) for k in (1, 2, 3)]
