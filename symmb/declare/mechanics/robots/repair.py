"""Impossible moments of inertia: their replacement by the nearest possible moments, and the effect on the motion."""

from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import ROUNDING
from symmb._types import Array
from symmb.declare.mechanics.robots.algebra import matrix, united
from symmb.declare.mechanics.robots.description import ENTRIES, SLIDING, TURNING, XYZ, full_matrix, inertia_fault, named
from symmb.declare.mechanics.robots.robot import ORIGIN, Building


def repaired(building: Building) -> tuple[Building, list[str]]:
    """The building after the repair of impossible inertias, and a sentence about the repaired links.

    A link on the fixed base, or on a body with a possible total inertia, keeps its inertia. DeclarationError is raised
    if a repair would have a large effect on the motion.
    """
    description, values = building.description, building.values
    numbers = {name: description.numbers[name] if isinstance(x, ca.SX) else x for name, x in values.items()}
    before, better = replace(building, values=numbers), {}
    for link, top in description.tops.items():
        moments = tuple(x for x in building.vector(f"{link}.inertia", ENTRIES) if not isinstance(x, ca.SX))
        is_base = building.fixed_base and top == description.root
        # The inertia of a part may be impossible if that of the whole body is possible. Parts do not move separately.
        if not is_base and len(moments) == len(ENTRIES) and inertia_fault(moments):
            parts = [before.mass(part, before.places[part]) for part, own in description.tops.items() if own == top]
            if inertia_fault(tuple(np.array(united(parts).inertia)[np.triu_indices(3)])):
                better |= named(f"{link}.inertia", ENTRIES, nearest_possible(moments))
    if not better:
        return building, []
    M, after = _mass_matrix(before), _mass_matrix(replace(before, values=numbers | better))
    size = np.sqrt(np.maximum(np.diag(after), np.finfo(float).tiny))
    # Links without mass make the scaled mass matrix singular. A small multiple of the identity makes it definite.
    root = np.linalg.inv(np.linalg.cholesky(after / size / size[:, None] + ROUNDING * np.eye(len(M)))) / size
    share = float(np.abs(np.linalg.eigvalsh(root @ (after - M) @ root.T)).max(initial=0.0))
    names = ", ".join(repr(name.removesuffix(".inertia.xx")) for name in better if name.endswith(".inertia.xx"))
    # Largest accepted change of the kinetic energy of a motion by a repair. A larger change would dominate the motion.
    if not share <= 0.5:
        raise DeclarationError(
            f"{description.path}: the inertia of {names} is impossible. The nearest possible inertia would change the "
            f"kinetic energy of a motion by {min(share, 10):.0%}. Correct the file."
        )
    said = f"The inertia of {names} is impossible. The nearest possible inertia is used, changing the kinetic energy "
    description = replace(description, numbers=description.numbers | better)
    changed = replace(building, description=description, values={**values, **better})
    return changed, [f"{said}of a motion by at most {100 * share:.1g} %."]


def nearest_possible(moments: tuple[float, ...]) -> tuple[float, ...]:
    """Entries xx, xy, xz, yy, yz, zz of the nearest possible inertia matrix in the Frobenius norm.

    Each principal moment is the sum of two second moments of mass. None of the three second moments is negative.
    """
    # This is a projection onto a cone with three edges. For each subset of edges, the least squares solution is a
    # candidate if its coefficients are not negative. The nearest candidate is the projection.
    principal, axes = np.linalg.eigh(full_matrix(moments))
    found = [np.zeros(3)]
    for used in product((False, True), repeat=3):
        pairs = (1 - np.eye(3))[:, used]
        second = np.linalg.lstsq(pairs, principal)[0]
        found += [pairs @ second] * bool((second >= 0).all())
    best = min(found, key=lambda candidate: float(np.linalg.norm(candidate - principal)))
    return tuple((axes * best @ axes.T)[np.triu_indices(3)].tolist())


def _mass_matrix(building: Building) -> Array:
    """Mass matrix (n, n) of a tree for joint rates, at the pose of the file. Planar joints count as free joints."""
    root, values = building.description.root, building.values
    places, screws = {root: ORIGIN}, {root: np.eye(6)[:, : 0 if building.fixed_base else 6]}
    count = screws[root].shape[1]
    for joint in building.description.joints.values():
        at, e = places[joint.child] = building.carried(joint, places[joint.parent])
        R, own = np.array(matrix(e)), np.eye(6)[:, : 0 if joint.kind == "fixed" else 6]
        if joint.kind in (*TURNING, "ball"):
            at = at + R @ [values.get(f"{joint.name}.pos.{x}", 0.0) for x in XYZ]
            own = np.vstack([R, np.cross(at, R.T).T])
        elif joint.kind in SLIDING:
            own = np.vstack([np.zeros((3, 3)), R])
        if joint.moves:
            own = own @ np.array(building.vector(f"{joint.name}.axis"))[:, None]
        known = screws[joint.parent]
        screws[joint.child] = np.hstack([known, np.zeros((6, count - known.shape[1])), own])
        count += own.shape[1]
    M = np.zeros((count, count))
    for link, screw in screws.items():
        mass, n = building.mass(link, places[link]), screw.shape[1]
        speeds = screw[3:] - np.cross(np.array(mass.com), screw[:3], axisb=0).T
        M[:n, :n] += float(mass.mass) * speeds.T @ speeds + screw[:3].T @ np.array(mass.inertia) @ screw[:3]
    return M
