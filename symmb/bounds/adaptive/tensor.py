"""Bounds over few parameters: tensor grids, in pieces of the box where the response is not smooth, and check runs."""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.bounds.adaptive.check_runs import TRUST, generic, seen, spread
from symmb.bounds.adaptive.runs import Found, Runs, share
from symmb.bounds.adaptive.truncation_error import Tails
from symmb.codegen import has_compiler
from symmb.nodes import Grid
from symmb.polynomials import Expansion
from symmb.polynomials.ranges import HIGHEST_DEGREE, Exact, dense_extremes

_PROBES = 1
"""Runs at points that nothing singles out: what nodes on halves, ends and middles see may be the same by symmetry."""
_REFINED = 0.25
"""Directions whose errors are at least this share of the largest are refined together."""
_SMOOTH = 0.6
"""Coefficients of a direction that fall off by less in two degrees are those of a response that is not smooth, ..."""
_WHOLE, _HALVES = 16, 8
"""... from the first degree on, or the second in halves of a rough piece, of which one is expected to be rough."""
_SMALL, _SMALLEST = 0.05, 1e-6
"""Half widths of a rough piece on which a smooth response is as good as linear, and that is not halved any more."""
_INHERITED = 0.25
"""Share of the error that is left after a rough piece has been halved along every parameter."""
_FARTHEST = 10.0
"""Errors of check runs are scaled from what is expected there to what is elsewhere by so much at most."""
_ROUNDING = 1e-6
"""Share of an expected error below which a place is a node."""
_RANGE = 1e-5
"""Share of a range to which it is found."""

_Part = tuple[Array, Array, Array]
"""Centre and half width (d,) of a part of the box, and degrees of an interpolant on it."""


def tensor_bounds(runs: Runs, tolerance: float) -> Found:
    """Range of interpolants on tensor grids, whose degrees rise in the directions from which most of the error comes.

    Where the response is not smooth the box is halved, and the halves are refined each by itself as long as they may
    hold an extreme: at the times and for the outputs for which they may. Errors are estimated from the last
    coefficients, at the places of the extremes. Runs at some of these places then check the estimate.
    """
    d = len(runs.box)
    whole = _Piece.of(runs, (np.zeros(d), np.ones(d), np.full(d, 4 if d == 1 else 2)))
    pieces, checks, enough = [whole], max(2 * d, 4), tolerance / TRUST  # checks may show that much less
    while True:
        unit = runs.unit()
        if len(pieces) == 1:
            (whole,) = pieces
            wanted = whole.next()
            if _affordable(wanted, runs) and share(whole.tails.least, unit) > enough:
                pieces = whole.replaced(wanted, runs)  # too large wherever the extremes are
                continue
        union = _Union.of(pieces)
        worst = pieces[int(np.argmax([share(error, unit) for error in union.errors]))]
        wanted = worst.next()
        last = not _affordable(wanted, runs)
        estimate = union.errors.max(axis=0)
        if last or share(union.trust * estimate, unit) <= tolerance:
            foreseen = _FARTHEST * share(estimate, unit)
            estimate, worst = _checked(runs, union, worst, unit, checks)
            unit = runs.unit()
            wanted = worst.next(surprised=share(estimate, unit) > foreseen)
            if share(estimate, unit) <= tolerance or not _affordable(wanted, runs):
                found = estimate + _RANGE * (union.upper - union.lower)
                return Found(union.lower, union.upper, found, whole.expansion if len(pieces) == 1 else None)
        pieces = [piece for piece in pieces if piece is not worst] + worst.replaced(wanted, runs)


def _affordable(wanted: list[_Part], runs: Runs) -> bool:
    if not wanted:
        return False
    return runs.unknown(np.concatenate([_nodes(part) for part in wanted])) <= runs.left


def _nodes(part: _Part) -> Array:
    centre, half, degrees = part
    return centre + half * _grid(*degrees.tolist()).nodes


@cache
def _grid(*degrees: int) -> Grid:
    grid = Grid(len(degrees))
    grid.add(grid.missing([degrees]))
    return grid


@dataclass(eq=False)
class _Piece:
    """A part of the box with an interpolant, and its range.

    Attributes
    ----------
    centre, half : (d,) of the unit box
    expansion : in coordinates of the piece
    nodes : (N, d) in coordinates of the piece
    runs, rows : where the responses at the nodes are (N,)
    unit : (n_y,) what outputs are measured by
    inherited : (n_t, n_y) error that is expected where the piece jumps
    """

    centre: Array
    half: Array
    expansion: Expansion
    nodes: Array
    runs: Runs
    rows: Indices
    unit: Array
    inherited: Array | None

    @classmethod
    def of(cls, runs: Runs, part: _Part, before: "_Piece | None" = None) -> "_Piece":
        """Run what is missing; nodes that fail are predicted by the piece before, which holds this one."""
        centre, half, degrees = part
        grid = _grid(*degrees.tolist())
        rows = runs.at(centre + half * grid.nodes, before and before.values)
        coefficients = grid.coefficients(runs.nodes.reshape(len(runs.nodes), -1), rows).reshape(-1, *runs.shape)
        expansion = Expansion(grid.alpha, coefficients, runs.box.names)
        return cls(centre, half, expansion, grid.nodes, runs, rows, runs.unit(), before and before.inherited)

    @property
    def Y(self) -> Array:
        """Responses at the nodes (N, n_t, n_y)."""
        return self.runs.nodes[self.rows]

    @cached_property
    def rough(self) -> int | None:
        """The parameter along which the response is not smooth, that from which most of the error comes; or None."""
        if self.crossed is not None:
            shares = np.array([share(np.nan_to_num(error), self.unit) for error in self.crossed])
            if shares.max() >= self._shares.max():
                return int(shares.argmax())
        falls = _falls(self.expansion, self.unit, _WHOLE if self.inherited is None else _HALVES)
        wrong = np.where(falls > _SMOOTH, self._shares, 0.0)
        return int(wrong.argmax()) if wrong.max() >= _REFINED * self._shares.max() > 0 else None

    @cached_property
    def _shares(self) -> Array:
        """Error from each direction (d,)."""
        return np.array([share(error, self.unit) for error in self.tails.directions])

    @cached_property
    def crossed(self) -> Array | None:
        """Expected errors along each parameter (d, n_t, n_y) where there are events between nodes, nan elsewhere.

        Kinks and jumps are there. In between an extreme lies beyond the nodes by no more than what the responses change
        on such a distance, at the largest slope that is seen away from events.
        """
        if self.runs.events is None:
            return None
        degrees = self.expansion.alpha.max(axis=0)
        order = np.lexsort(self.nodes.T[::-1])
        Y = self.Y[order].reshape(*(degrees + 1), *self.runs.shape)
        events = self.runs.events[self.rows[order]].reshape(*(degrees + 1), -1, 1)
        across = np.ptp(events, axis=tuple(range(len(degrees)))) > 0
        errors = np.zeros((len(degrees), *self.runs.shape))
        for i, x in enumerate(self.nodes[order].T.reshape(len(degrees), *(degrees + 1))):
            ahead, axes = np.diff(x, axis=i)[..., None, None], tuple(range(len(degrees)))
            change, met = np.abs(np.diff(Y, axis=i)), np.diff(events, axis=i) != 0
            slope = np.where(met, 0.0, change / ahead).max(axis=axes)
            widest = np.where(met, ahead, 0.0).max(axis=axes)
            errors[i] = np.where(met.all(axis=axes), change.max(axis=axes), slope * widest)
        return np.where(across, errors, np.nan)

    @cached_property
    def jumps(self) -> Mask | None:
        """Where a half of a rough piece (n_t, n_y) is taken as it is at the nodes: interpolants overshoot at a jump."""
        met = None if self.crossed is None else np.isfinite(self.crossed[0])
        if self.rough is None or self.inherited is None or met is not None:
            return met
        large = self.tails.directions >= _REFINED * self.tails.directions.max(axis=0)
        return ((self.tails.falls > _SMOOTH) & large).any(axis=0) | (self.half.min() < _SMALL)

    @cached_property
    def tails(self) -> Tails:
        return Tails.of(self.expansion.alpha, self.expansion.coefficients)

    @cached_property
    def range(self) -> tuple[Array, Array, Array]:
        """Minima and maxima (n_t, n_y), and their places (2, n_t, n_y, d) in the box."""
        alpha, shape = self.expansion.alpha, self.runs.shape
        flat = self.expansion.coefficients.reshape(len(alpha), -1)
        if has_compiler():
            lower, upper, *at = dense_extremes(alpha, flat)
        else:
            found = Exact(_RANGE, budget=300).search(alpha, flat)
            lower, upper, at = found.lower + found.below, found.upper - found.above, [found.at_lower, found.at_upper]
        lower, upper, places = lower.reshape(shape), upper.reshape(shape), np.stack(at).reshape(2, *shape, -1)
        if self.jumps is not None:
            Y = self.Y
            lower, upper = np.where(self.jumps, Y.min(axis=0), lower), np.where(self.jumps, Y.max(axis=0), upper)
            nodes = np.stack([self.nodes[f(Y, axis=0)] for f in (np.argmin, np.argmax)])
            places = np.where(self.jumps[..., None], nodes, places)
        return lower, upper, self.centre + self.half * places

    @cached_property
    def errors(self) -> Array:
        """Expected errors (2, n_t, n_y) of the range."""
        return np.stack([self.expected(x) for x in self.range[2]])

    @property
    def told(self) -> Array:
        """What runs at the places of the range may see of its errors (2, n_t, n_y)."""
        told = self.errors - self.tails.least
        told[told < _ROUNDING * self.errors] = 0.0
        return told if self.jumps is None else np.where(self.jumps, 0.0, told)

    def expected(self, places: Array) -> Array:
        """Expected errors (n_t, n_y) at places (n_t, n_y, d) of the box, or (d,) for all times and outputs."""
        smooth = self.tails.at((places - self.centre) / self.half)
        if self.crossed is not None:
            met = self.crossed.sum(axis=0)
            return np.where(np.isnan(met), smooth, met)
        if self.jumps is None or self.inherited is None:
            return smooth
        return np.where(self.jumps, self.inherited, smooth)

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d) of the box."""
        return self.expansion.values((points - self.centre) / self.half)

    def error(self, point: Array, y: Array) -> Array:
        """What a run y (n_t, n_y) at a point shows of the errors of the expansion, where it is used."""
        error = y - self.values(point[None])[0]
        return error if self.crossed is None else np.where(np.isnan(self.crossed[0]), error, 0.0)

    def next(self, surprised: bool = False) -> list[_Part]:
        """The piece with twice the degree where errors are large, or its halves; nothing where that goes too far.

        What comes as a surprise may come from any direction.
        """
        degrees = self.expansion.alpha.max(axis=0)
        if self.rough is None:
            large = surprised | (self._shares >= _REFINED * self._shares.max())
            higher = np.where(large & (2 * degrees <= HIGHEST_DEGREE), 2, 1) * degrees
            return [(self.centre, self.half, higher)] if (higher > degrees).any() else []
        if self.half[self.rough] < _SMALLEST:
            return []
        along = np.arange(len(degrees)) == self.rough
        half = np.where(along, self.half / 2, self.half)
        degrees = np.where(along, _HALVES, degrees)
        return [(self.centre + sign * (self.half - half), half, degrees) for sign in (-1, 1)]

    def replaced(self, parts: list[_Part], runs: Runs) -> list["_Piece"]:
        """Pieces for the parts; halves of a rough one inherit a share of its error, or what it did not see."""
        pieces = [_Piece.of(runs, part, self) for part in parts]
        if len(pieces) > 1:
            own, new = self.Y, np.concatenate([piece.Y for piece in pieces])
            unseen = np.maximum(own.min(axis=0) - new.min(axis=0), new.max(axis=0) - own.max(axis=0))
            for piece in pieces:
                piece.inherited = np.maximum(
                    seen(np.maximum(unseen, 0.0)[None]), _INHERITED ** (1 / len(self.half)) * self.errors.max(axis=0)
                )
        return pieces


def _falls(expansion: Expansion, unit: Array, least: int) -> Array:
    """By how much the last coefficients of each direction fall off in two degrees; 0 of degrees below the least.

    The two highest degrees are left out: what an interpolant does not resolve halves them.
    """
    falls = np.zeros(expansion.alpha.shape[1])
    for i, degrees in enumerate(expansion.alpha.T):
        top = degrees.max()
        if top >= least:
            rows = ((degrees > k - 2) & (degrees <= k) for k in (top - 2, top - 4, top - 6))
            a, b, c = (np.linalg.norm(expansion.coefficients[some] / unit) for some in rows)
            falls[i] = max(a / b if b > 0 else 0.0, b / c if c > 0 else 0.0)
    return falls


@dataclass(frozen=True, eq=False)
class _Union:
    """All pieces.

    Attributes
    ----------
    lower, upper : (n_t, n_y) range
    places : (2, n_t, n_y, d) of its minima and maxima
    errors : (k, n_t, n_y) how far each piece may reach beyond
    told : (2, n_t, n_y) errors that runs at the places may see: none at nodes
    trust : (n_t, n_y) least share of the largest error that check runs leave: all of one between events
    """

    pieces: list[_Piece]
    lower: Array
    upper: Array
    places: Array
    errors: Array
    told: Array
    trust: Array

    @classmethod
    def of(cls, pieces: list[_Piece]) -> "_Union":
        lows, highs, places = (np.stack(each) for each in zip(*(piece.range for piece in pieces), strict=True))
        lower, upper = lows.min(axis=0), highs.max(axis=0)
        first = np.stack([lows.argmin(axis=0), highs.argmax(axis=0)])
        below, above = (np.stack([piece.errors[side] for piece in pieces]) for side in (0, 1))
        beyond = np.maximum(np.maximum(lower - (lows - below), highs + above - upper), 0.0)
        told = np.stack([piece.told for piece in pieces])
        between = [np.zeros(beyond.shape[1:]) if p.crossed is None else np.isfinite(p.crossed[0]) for p in pieces]
        trust = np.where(_chosen(np.array(between, dtype=bool), beyond.argmax(axis=0)), 1.0, TRUST)
        return cls(pieces, lower, upper, _chosen(places, first[..., None]), beyond, _chosen(told, first), trust)

    def piece(self, point: Array) -> _Piece:
        """One that holds the point."""
        return min(self.pieces, key=lambda piece: float((np.abs(point - piece.centre) / piece.half).max()))


def _chosen(each: np.ndarray, numbers: Indices) -> np.ndarray:
    """Of k alternatives (k, ...) at each place that with the number there."""
    return each[0] if len(each) == 1 else np.take_along_axis(each, numbers[None], axis=0)[0]


def _checked(runs: Runs, union: _Union, worst: _Piece, unit: Array, number: int) -> tuple[Array, _Piece]:
    """The estimate (n_t, n_y), changed where runs at some of the extremes see other errors than expected there.

    Also the piece to refine next: that where they see the largest error, or else the worst.
    """
    estimate = union.errors.max(axis=0)
    known, probes = len(runs.points), generic(_PROBES, len(runs.box))
    runs.check(np.concatenate([probes, spread(union.places, union.told / unit, number)])[: runs.left])
    rows = [k for k in range(len(runs.points)) if k < _PROBES or k >= known]
    points, Y = runs.points[rows], runs.checks[rows]
    if not rows:
        return estimate, worst
    pieces = [union.piece(x) for x in points]
    errors = np.stack([piece.error(x, y) for x, y, piece in zip(points, Y, pieces, strict=True)])
    expected = np.stack([piece.expected(x) for x, piece in zip(points, pieces, strict=True)])
    ratios = np.divide(estimate, expected, out=np.ones_like(errors), where=expected > estimate / _FARTHEST)
    ratios = np.where(np.abs(errors) > _FARTHEST * expected, np.maximum(ratios, 1.0), ratios)  # not foreseen at all
    largest = pieces[int(np.argmax([share(error, unit) for error in errors]))]
    return np.maximum(seen(errors * ratios), union.trust * estimate), largest
