"""Modes of structures with parameters: fixed shapes, and inertia, stiffness and damping as expressions."""

from dataclasses import dataclass
from os import PathLike

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array, Expr
from symmb.declare.structures.inertia_invariants import OF_MODES, Shapes, cleaned
from symmb.declare.structures.modes import SHAPES, Family, Modes
from symmb.declare.structures.terms import Terms
from symmb.declare.structures.validation import is_law


@dataclass(frozen=True, eq=False)
class ParametricModes(Modes):
    """Modes of a structure with parameters. Inertia, stiffness and damping are expressions.

    The shapes are the same for all values of the parameters. The numbers in the fields of `Modes` are for the middles
    of the intervals of the parameters.
    """

    family: Family  # type: ignore[misc]

    def save(self, path: str | PathLike[str]) -> None:
        raise DeclarationError(
            f"Modes.save: {str(path)!r} can contain only numbers, but these modes contain expressions of parameters. "
            "Save the modes of a structure without parameters, or do not save the modes, but compute them in a script."
        )


def with_parameters(
    modes: Modes, terms: Terms, shapes: Shapes, zeta: Expr | Array, box: dict[str, tuple[float, float]], error: float
) -> Modes:
    """Modes with inertia, stiffness and damping as expressions from the terms of their structure.

    Each shape is damped like a mode with the same stiffness and inertia. The damping is exact if no parameter changes
    the shapes of modes.
    """
    n, stiffness = len(modes.stiffness), modes.stiffness
    masses = tuple((ca.SX(law), shapes.invariants(M, samples)) for law, M, samples in terms.mass)
    energies = [(law, shapes.X.T @ (K @ shapes.X)) for law, K in terms.stiffness]
    if len(energies) == 1:  # a single term has no rounding
        energies = [(law / terms.middle(law), np.diag(stiffness)) for law, _ in energies]
    size = OF_MODES * np.sqrt(np.outer(stiffness, stiffness))
    K = _sum([(law, cleaned((A + A.T) / 2, size)) for law, A in energies])
    inertia = _sum([(law, np.diag(part.modal)) for law, part in masses])
    ratio = zeta if is_law(zeta) else ca.DM(np.broadcast_to(zeta, n).tolist())
    damping = 2 * ratio * ca.sqrt(ca.diag(K) * inertia) if n else ca.SX(0, 1)
    family = Family(masses, K, ca.sparsify(damping), box, error)
    return ParametricModes(**{name: getattr(modes, name) for name in SHAPES}, family=family)


def _sum(parts: list[tuple[Expr, Array]]) -> ca.SX:
    first, *more = [law * ca.SX(ca.sparsify(ca.DM(array))) for law, array in parts]
    for part in more:
        first = first + part
    return first
