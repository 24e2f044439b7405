"""A tree of boxes with a surrogate in each leaf, and the range of all of them together."""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from symmb._types import Array, Indices
from symmb.bounds.adaptive import INHERITED_SHARE, SMALLEST_HALF_WIDTH, Runs, relative_errors, relative_rms
from symmb.bounds.refinement.constants import GROWTH, HALF_DEGREE, MOST_CHECKS, REFINED_SHARE, ROUGH_DECAY, WHOLE_DEGREE
from symmb.bounds.refinement.hierarchy import Hierarchy, slowness
from symmb.bounds.refinement.surrogate import LeafRange, Surrogate, closed
from symmb.nodes import Index, line
from symmb.polynomials import Expansion


class Leaf:
    """A box with its own interpolant.

    Attributes
    ----------
    centre, half : (d,) of the unit box
    rows : of the runs at the nodes
    parent : the box of which it is a half, or None
    """

    def __init__(self, tree: "Tree", centre: Array, half: Array, parent: "Leaf | None" = None) -> None:
        self.tree, self.centre, self.half, self.parent = tree, centre, half, parent
        self.hierarchy, self.rows = Hierarchy(len(half), tree.runs.shape), np.empty(0, dtype=np.intp)
        self.inherited = None if parent is None else parent.range.errors.max(axis=0)
        d = len(half)
        axes = [tuple(k * (i == j) for j in range(d)) for i in range(d) for k in (1, 2)]
        self.add([(0,) * d, *axes])

    def add(self, indices: list[Index]) -> None:
        """Run nodes. Those that fail have the values that are predicted there."""
        indices = sorted(indices, key=lambda a: (sum(a), a))
        alpha = np.array(indices)
        points = self.centre + self.half * line(int(alpha.max()) + 1)[alpha]
        source = self if len(self.rows) else self.parent
        rows = self.tree.at(points, source and source.values)
        self.rows = np.concatenate([self.rows, rows])
        self.hierarchy.add(indices, self.tree.runs.nodes[rows])
        self.forget()

    def forget(self) -> None:
        """What is known of the surrogate, after other runs."""
        for derived in ("surrogate", "range", "expansion"):
            self.__dict__.pop(derived, None)

    def values(self, points: Array) -> Array:
        """Responses (n, n_t, n_y) at points (n, d) of the unit box."""
        return self.surrogate.values((points - self.centre) / self.half)

    @cached_property
    def surrogate(self) -> Surrogate:
        """The interpolant, continued through other runs in the box."""
        points, Y = self.tree.others(self)
        runs = self.tree.runs
        return Surrogate(self.hierarchy, runs.rms_widths(), runs.noise, (points - self.centre) / self.half, Y)

    @cached_property
    def expansion(self) -> Expansion:
        """The surrogate in Legendre polynomials."""
        return self.surrogate.expansion(self.tree.runs.nodes[self.rows], self.tree.runs.box.names)

    @cached_property
    def range(self) -> LeafRange:
        """The range, in points of the unit box; where the response jumps, that of the runs in the box."""
        found = self.surrogate.range(self.expansion)
        places, errors = self.centre + self.half * found.places, found.errors
        events = self.event_errors
        rough = self.inherited is not None and self.rough_direction is not None
        if events is None and not rough:
            return found._replace(places=places)
        jumps = np.isfinite(events[0]) if events is not None and not rough else np.ones(found.lower.shape, dtype=bool)
        Y, points = self.tree.runs.nodes[self.rows], self.centre + self.half * self.hierarchy.grid.nodes
        lost = INHERITED_SHARE ** (1 / len(self.half)) * self.inherited if self.inherited is not None else np.inf
        lost = np.minimum(lost, np.ptp(Y, axis=0)) if events is None else np.nan_to_num(events.sum(axis=0), nan=0.0)
        nodes = np.stack([points[Y.argmin(axis=0)], points[Y.argmax(axis=0)]])
        return LeafRange(
            np.where(jumps, Y.min(axis=0), found.lower),
            np.where(jumps, Y.max(axis=0), found.upper),
            np.where(jumps[..., None], nodes, places),
            np.where(jumps, lost, errors),
        )

    @property
    def sizes(self) -> dict[Index, float]:
        """Sizes of the surpluses, over the widths."""
        return self.hierarchy.sizes(self.tree.runs.rms_widths(), self.tree.runs.noise)

    @property
    def rough_direction(self) -> int | None:
        """The parameter with the largest surpluses along which they do not decay, or None."""
        sizes = self.hierarchy.sizes(self.tree.runs.rms_widths(), self.tree.runs.noise, of_all=True)
        degrees = self.hierarchy.grid.alpha.max(axis=0)
        least = WHOLE_DEGREE if self.parent is None else HALF_DEGREE
        if degrees.max() < least:
            return None
        last = np.zeros(len(degrees))
        rough = last.copy()
        for i, profile in enumerate(self.hierarchy.profiles(sizes, 1.0)):
            last[i] = max(profile[-2:])
            if degrees[i] >= least:
                rough[i] = last[i] if slowness(profile[:-1]) > ROUGH_DECAY else 0.0
        return int(rough.argmax()) if rough.max() >= REFINED_SHARE * last.max() > 0 else None

    @property
    def event_errors(self) -> Array | None:
        """Expected errors along each parameter (d, n_t, n_y) where events happen between nodes, nan elsewhere.

        An extreme exceeds the runs by the change between two neighbours on an axis at most, between which no event is.
        """
        if self.tree.runs.events is None:
            return None
        events, Y, alpha = self.tree.runs.events[self.rows], self.tree.runs.nodes[self.rows], self.hierarchy.grid.alpha
        between = np.ptp(events, axis=0) > 0
        if not between.any():
            return None
        errors = np.zeros((alpha.shape[1], *Y.shape[1:]))
        for i in range(alpha.shape[1]):
            axis = np.flatnonzero(alpha.sum(axis=1) == alpha[:, i])
            axis = axis[np.argsort(line(int(alpha.max()) + 1)[alpha[axis, i]])]
            change, has_event = np.abs(np.diff(Y[axis], axis=0)), np.diff(events[axis], axis=0)[..., None] != 0
            errors[i] = np.where(
                has_event.all(axis=0), change.max(axis=0), np.where(has_event, 0.0, change).max(axis=0)
            )
        errors[:, ~between] = np.nan
        return errors

    def refined(self) -> "list[Leaf] | None":
        """The leaf with more nodes, or its halves where it is rough; None if there are no runs or places for them."""
        runs, d, along = self.tree.runs, len(self.half), self.rough_direction
        events = self.event_errors
        if events is not None:
            each = relative_errors(np.nan_to_num(events), runs.rms_widths()).max(axis=1)
            smooth = np.where(np.isnan(events[0]), self.range.errors.max(axis=0), 0.0)
            if each.max() >= relative_rms(smooth, runs.rms_widths()):
                along = int(each.argmax())
        if along is not None:
            half = np.where(np.arange(d) == along, self.half / 2, self.half)
            if half.min() < SMALLEST_HALF_WIDTH or runs.left < 2 * (2 * d + 1):
                return None
            return [Leaf(self.tree, self.centre + sign * (self.half - half), half, self) for sign in (-1, 1)]
        n = len(self.rows)
        most = min(max(d, 2, int(GROWTH * n)), runs.left)
        ahead = self.hierarchy.ahead(self.sizes, most)
        order = sorted(ahead, key=lambda a: (-ahead[a], sum(a), a))
        chosen: list[Index] = []
        for a in order:
            if len(chosen) < most and ahead[a] >= REFINED_SHARE * ahead[order[0]]:
                chosen += [b for b in closed([a], ahead) if b not in chosen]
        chosen = sorted(chosen, key=lambda a: (sum(a), a))[: runs.left]
        if not chosen:
            return None
        self.add(chosen)
        return [self]


class Tree:
    """All leaves, and all runs.

    Attributes
    ----------
    places : (N, d) nodes in the order of their rows
    """

    def __init__(self, runs: Runs) -> None:
        d = len(runs.box)
        self.runs, self.places = runs, np.empty((0, d))
        self.leaves = [Leaf(self, np.zeros(d), np.ones(d))]

    def at(self, points: Array, predict: Callable[[Array], Array] | None) -> Indices:
        """Rows of the runs at points, which are run unless they have been."""
        rows = self.runs.at(points, predict)
        new = np.flatnonzero(rows >= len(self.places))
        _, first = np.unique(rows[new], return_index=True)
        self.places = np.concatenate([self.places, points[new[first]]])
        return rows

    def others(self, leaf: Leaf) -> tuple[Array, Array]:
        """Points and responses of the latest runs in a leaf that are not its nodes."""
        points = self.runs.points
        inside = _inside(leaf, points)[-MOST_CHECKS:]
        if len(self.leaves) == 1 and leaf.parent is None:
            return points[inside], self.runs.checks[inside]
        is_other = np.ones(len(self.places), dtype=bool)
        is_other[leaf.rows] = False
        is_other &= self.runs.is_attained[: len(self.places)]
        rows = [k for k in _inside(leaf, self.places) if is_other[k]][-MOST_CHECKS:]
        Y = np.concatenate([self.runs.nodes[rows], self.runs.checks[inside]])
        return np.concatenate([self.places[rows], points[inside]]), Y

    def union(self) -> tuple[Array, Array, Array, Array]:
        """The range (n_t, n_y), its places (2, n_t, n_y, d), and how far each leaf may exceed it (k, n_t, n_y)."""
        ranges = [leaf.range for leaf in self.leaves]
        if len(ranges) == 1:
            lower, upper, places, errors = ranges[0]
            return lower, upper, places, errors.max(axis=0)[None]
        lows, highs = np.stack([r.lower for r in ranges]), np.stack([r.upper for r in ranges])
        lower, upper, which = lows.min(axis=0), highs.max(axis=0), (lows.argmin(axis=0), highs.argmax(axis=0))
        places = np.stack([_taken(np.stack([r.places[s] for r in ranges]), which[s][..., None]) for s in (0, 1)])
        below, above = (np.stack([r.errors[s] for r in ranges]) for s in (0, 1))
        beyond = np.maximum(np.maximum(lower - (lows - below), highs + above - upper), 0.0)
        return lower, upper, places, beyond

    def check(self, points: Array) -> None:
        """Check runs at points (C, d). Leaves that hold some of them have other surrogates then."""
        before = len(self.runs.points)
        self.runs.check(points[: self.runs.left])
        self.forget(self.runs.points[before:])

    def forget(self, points: Array) -> None:
        """What leaves know of their surrogates, after check runs at points (C, d)."""
        for leaf in self.leaves:
            if len(_inside(leaf, points)):
                leaf.forget()


def _taken(alternatives: Array, which: Indices) -> Array:
    return np.take_along_axis(alternatives, which[None], axis=0)[0]


def _inside(leaf: Leaf, points: Array) -> Indices:
    return np.flatnonzero((np.abs(points - leaf.centre) <= leaf.half * (1 + 1e-9)).all(axis=1))
