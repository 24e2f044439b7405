"""Moments of inertia that no body has: the nearest possible ones, and what they change."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.mechanics.robots.algebra import matrix
from symmb.mechanics.robots.description import ENTRIES, SLIDING, TURNING, full_matrix, inertia_fault
from symmb.mechanics.robots.inertia import united
from symmb.mechanics.robots.robot import ORIGIN, Building

_MOST = 0.5
"""Change of the energy of a motion, over this energy, up to which an inertia is repaired. The nearest possible inertia
is closer to the true one than that of the file, but where it is most of the energy the motion would be its own."""


def repaired(building: Building) -> tuple[Building, list[str]]:
    """A machine whose bodies all have possible inertias, and a sentence on what is repaired.

    A link on the base, or on a body that is possible as a whole, keeps its inertia. DeclarationError if a repair would
    change the motion much.
    """
    description, values = building.description, building.values
    numbers = {k: description.numbers[k] if isinstance(value, ca.SX) else value for k, value in values.items()}
    judged = replace(building, values=numbers)
    wrong = [
        link
        for link in description.links
        if inertia_fault(judged.vector(f"{link}.inertia", ENTRIES))
        and not any(isinstance(entry, ca.SX) for entry in building.vector(f"{link}.inertia", ENTRIES))
    ]
    repairs: dict[str, tuple[float, ...]] = {}
    for link in wrong:
        top = description.tops[link]
        parts = [judged.mass(part, judged.places[part]) for part, own in description.tops.items() if own == top]
        J = united(parts).inertia
        is_base = building.fixed_base and top == description.root
        if not is_base and inertia_fault((J[0][0], J[0][1], J[0][2], J[1][1], J[1][2], J[2][2])):
            repairs[link] = nearest_possible(judged.vector(f"{link}.inertia", ENTRIES))
    if not repairs:
        return building, []
    better = {f"{link}.inertia.{e}": x for link, J in repairs.items() for e, x in zip(ENTRIES, J, strict=True)}
    said = accepted(judged, replace(judged, values=numbers | better), repairs)
    description = replace(description, numbers=description.numbers | better)
    return replace(building, description=description, values={**values, **better}), [said]


def accepted(before: Building, after: Building, links: Iterable[str]) -> str:
    """A sentence on repaired inertias of links. DeclarationError if they change the motion much."""
    share, names = _largest_change(before, after), ", ".join(map(repr, links))
    if not share <= _MOST:
        raise DeclarationError(
            f"{before.description.path}: no body has the inertia of {names}. The nearest possible one would change the "
            f"energy of a motion by {min(share, 10):.0%}. Correct the file."
        )
    change = f"it changes the energy of no motion by more than {share:.1g} of itself"
    return f"The nearest possible inertia stands for that of {names}; {change}."


def nearest_possible(moments: tuple[float, ...]) -> tuple[float, ...]:
    """Entries xx, xy, xz, yy, yz, zz of the nearest inertia matrix that a body may have, in the Frobenius norm.

    Each principal moment is the sum of two of three second moments of mass, and none of these is negative.
    """
    principal, axes = np.linalg.eigh(full_matrix(moments))
    found = [np.zeros(3)]
    for used in product((False, True), repeat=3):
        pairs = (1 - np.eye(3))[:, used]
        second = np.linalg.lstsq(pairs, principal)[0]
        found += [pairs @ second] * bool((second >= 0).all())
    best = min(found, key=lambda candidate: float(np.linalg.norm(candidate - principal)))
    J = axes * best @ axes.T
    return tuple(J[np.triu_indices(3)].tolist())


def _largest_change(before: Building, after: Building) -> float:
    """The largest change of the energy of any motion where the file draws a machine, over the energy afterwards."""
    M, better = _mass_matrix(before), _mass_matrix(after)
    scales = 1 / np.sqrt(np.maximum(np.diag(better), np.finfo(float).tiny))
    factor = np.linalg.inv(np.linalg.cholesky(scales * better * scales[:, None] + _RIDGE * np.eye(len(M))))
    return float(
        np.abs(np.linalg.eigvalsh(factor @ (scales * (better - M) * scales[:, None]) @ factor.T)).max(initial=0)
    )


_RIDGE = 1e-12
"""Added to the mass matrix of links without mass, whose diagonal is 1."""


def _mass_matrix(building: Building) -> Array:
    """Mass matrix (n, n) of the tree, where the file draws it, by velocities of its joints."""
    description = building.description
    places, screws = {description.root: ORIGIN}, {description.root: np.zeros((6, 0))}
    if not building.fixed_base:
        screws[description.root] = np.eye(6)
    count = screws[description.root].shape[1]
    for joint in description.joints.values():
        place = places[joint.child] = building.carried(joint, places[joint.parent])
        own = _screws(building, joint.name, joint.kind, np.array(place[0]), np.array(matrix(place[1])))
        known = screws[joint.parent]
        screws[joint.child] = np.hstack([known, np.zeros((6, count - known.shape[1])), own])
        count += own.shape[1]
    M = np.zeros((count, count))
    for link, T in screws.items():
        mass = building.mass(link, places[link])
        n, turns = T.shape[1], T[:3]
        speeds = T[3:] - np.cross(np.array(mass.com), turns, axisb=0).T
        M[:n, :n] += float(mass.mass) * speeds.T @ speeds + turns.T @ np.array(mass.inertia) @ turns
    return M


def _screws(building: Building, name: str, kind: str, at: Array, R: Array) -> Array:
    """Angular velocities, and velocities at the origin, (6, k), of a joint at a place."""
    if kind == "fixed":
        return np.zeros((6, 0))
    if kind == "floating":
        return np.eye(6)
    at = at + R @ [building.values.get(f"{name}.pos.{x}", 0.0) for x in "xyz"]
    around = np.vstack([np.eye(3), np.cross(at, np.eye(3)).T])
    if kind == "ball":
        return around
    axis = R @ np.array(building.vector(f"{name}.axis"))
    axis = axis / np.linalg.norm(axis)
    along = np.vstack([np.zeros((3, 3)), np.eye(3)])
    if kind in SLIDING:
        return along @ axis[:, None]
    turn = around @ axis[:, None]
    return turn if kind in TURNING else np.hstack([turn, along @ (np.eye(3) - np.outer(axis, axis))[:, :2]])
