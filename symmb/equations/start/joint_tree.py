"""The tree of joints that determines the order of start velocities, and the loops of this tree."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

GROUND = -1
"""Index of the ground; bodies have the indices from 0."""


@dataclass(frozen=True)
class Group:
    """Bodies (indices) in common loops, whose velocities are computed together, relative to their carrier `base`."""

    base: int
    bodies: tuple[int, ...]


class JointTree:
    """The bodies, each after its carrier, and the groups of bodies in common loops.

    `connected` has the bodies of each constraint row. `roots` are all bodies in order of preference: if bodies have no
    connection to the ground, the first of these bodies carries the others. `carriers` has the carrier of each body.
    """

    def __init__(self, connected: Iterable[frozenset[int]], roots: Sequence[int]) -> None:
        rows = set(connected)
        neighbours: dict[int, set[int]] = {body: set() for body in (GROUND, *roots)}
        for group in rows:
            for body in group:
                neighbours[body] |= group
        self.carriers: dict[int, int] = {}
        for root in (GROUND, *roots):
            if root in self.carriers:
                continue
            if root != GROUND:
                self.carriers[root] = GROUND
            reached = [root]
            for body in reached:  # the list grows in the loop
                followers = sorted(neighbours[body] - self.carriers.keys() - {GROUND})
                self.carriers |= dict.fromkeys(followers, body)
                reached += followers
        self._order = {body: k for k, body in enumerate((GROUND, *self.carriers))}
        self._group = {body: (body,) for body in self.carriers}
        for bodies in rows:
            first, *others = bodies
            self._join([body for other in others for body in self._path(first, other)])

    def groups(self) -> list[Group]:
        """The groups. Each group comes after the group of its base."""
        bases = {bodies: self.carriers[min(bodies, key=self._order.__getitem__)] for bodies in self._group.values()}
        return [Group(base, bodies) for bodies, base in sorted(bases.items(), key=lambda item: self._order[item[1]])]

    def join(self, group: Group) -> None:
        """Join a group with the group of its base."""
        self._join([group.bodies[0], group.base])

    def _path(self, a: int, b: int) -> list[int]:
        """The bodies on the path of the tree between bodies a and b."""
        path = []
        while a != b:
            a, b = sorted((a, b), key=self._order.__getitem__)
            path.append(b)
            b = self.carriers[b]
        return path

    def _join(self, bodies: Sequence[int]) -> None:
        joined = tuple(sorted({member for body in bodies for member in self._group[body]}))
        self._group |= dict.fromkeys(joined, joined)
