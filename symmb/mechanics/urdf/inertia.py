"""Mass, centre of mass and inertia of links, and of those that are held together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from symmb._types import Expr
from symmb.mechanics.rotation import Rotation
from symmb.symbolic import is_zero


@dataclass(frozen=True, eq=False)
class Mass:
    """Mass [kg], centre of mass (3,) [m], and inertia about it (3, 3) [kg m^2], in axes of the body."""

    mass: ca.SX
    com: ca.SX
    inertia: ca.SX


def mass_of(
    link: str,
    vector: Callable[..., ca.SX],
    values: Mapping[str, Expr],
    turned: Rotation,
    origin: ca.SX,
    rotation: Rotation,
) -> Mass:
    """Of a link whose own frame is at `origin` (3,) and turned by `rotation` in its body.

    `vector` gives the numbers of a name, and `turned` is the rotation of the axes of the inertia in the link.
    """
    diagonal = vector(f"{link}.inertia", ("xx", "yy", "zz"))
    xy, xz, yz = ca.vertsplit(vector(f"{link}.inertia", ("xy", "xz", "yz")))
    J = ca.diag(diagonal) + ca.vertcat(ca.horzcat(0, xy, xz), ca.horzcat(xy, 0, yz), ca.horzcat(xz, yz, 0))
    R = (rotation @ turned).matrix
    com = origin + rotation.matrix @ vector(f"{link}.com")
    return Mass(ca.SX(values[f"{link}.mass"]), com, R @ J @ R.T)


def united(masses: Sequence[Mass]) -> Mass:
    """Of parts that are held together."""
    heavy = [part for part in masses if not is_zero(part.mass)]
    if not heavy:
        com, parts = ca.SX.zeros(3), [part.inertia for part in masses]
        return Mass(ca.SX(0), com, _sum(parts))
    mass = _sum([part.mass for part in heavy])
    com = heavy[0].com if len(heavy) == 1 else _sum([part.mass * part.com for part in heavy]) / mass
    inertia = _sum([part.inertia for part in masses])
    for part in heavy if len(heavy) > 1 else ():
        arm = part.com - com
        inertia += part.mass * (ca.sumsqr(arm) * ca.SX.eye(3) - arm @ arm.T)
    return Mass(mass, com, inertia)


def _sum(parts: Sequence[ca.SX]) -> ca.SX:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
