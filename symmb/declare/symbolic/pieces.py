"""Pieces of curves as data. A bisection finds the piece of an argument, so many pieces cost little.

SX expressions call a CasADi Function that reads the numbers of a piece. Derivatives of expressions therefore use the
same pieces as the expressions.
"""

import hashlib
import sys
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from symmb._types import Array, Indices

_FARTHEST = sys.float_info.max
_KNOWN: dict[str, "Pieces"] = {}
_LONG = 100
"""Number of rows above which the comparison of two calls takes more than 0.3 ms."""


class Pieces:
    """Rows of numbers. Each row is for arguments from its start to the start of the next row. Rows belong to groups.

    `groups` (n,) are the groups of the rows: 0, then the same or the next whole number. `begins` (n,) are increasing
    starts; the first start is ignored. `columns` (n, m) are the numbers that are read. The start of the row is inserted
    as the first column, and the index of the row is appended.
    """

    def __init__(self, groups: Array, begins: Array, columns: Array) -> None:
        begins = np.concatenate([[-_FARTHEST], begins[1:]])
        rows = [groups, begins, *columns.T, np.arange(len(begins))]
        self.data = np.ascontiguousarray(rows, dtype=float)  # (2 + m + 1, n)
        # Names in CasADi must start with a letter.
        self.name = (
            f"{type(self).__name__.strip('_')}_{len(begins)}_{hashlib.sha256(self.data.tobytes()).hexdigest()[:24]}"
        )
        self._last: tuple[int, int, list[ca.SX]] = 0, 0, []

    def __reduce__(self) -> tuple[Callable[..., "Pieces"], tuple[str, Array]]:
        return _from_data, (self.name.partition("_")[0], self.data)

    @property
    def knots(self) -> Array:
        """Arguments (n - 1,) at which two pieces meet."""
        return self.data[1, 1:]

    def find(self, group: Array | float, at: Array | float) -> Indices:
        """Indices of the rows of the groups that contain the arguments `at`, or of the nearest rows of these groups."""
        first, last = (np.searchsorted(self.data[0], group, side) for side in ("left", "right"))
        row = np.searchsorted(self.data[1], at, "right") - 1
        return np.clip(np.clip(row, first, last - 1), 0, self.data.shape[1] - 1)

    def read(self, group: Array | float, at: Array | float) -> Array:
        """The columns (m + 1, ...) for arguments `at` in groups."""
        return self.data[2:, self.find(group, at)]

    def __call__(self, group: ca.SX, at: ca.SX) -> list[ca.SX]:
        """The columns for an argument `at` in a group, as expressions. Repeated calls give the same expressions."""
        key = group.element_hash(), at.element_hash()
        if self._last[:2] != key or not self._last[2]:
            # The outputs keep the arguments alive, so their hashes stay valid.
            self._last = *key, list(self.function(group, at))
        return self._last[2]

    @cached_property
    def sided(self) -> tuple["Sides", "Pieces"]:
        """The sides of all knots, and the same rows as pieces, where each row is a group."""
        return Sides.of(self.knots), Pieces(self.data[-1], self.data[1], self.data[2:-1].T)

    @cached_property
    def function(self) -> ca.Function:
        """The Function (group, at) -> columns that expressions call.

        If SX expressions call an MX function, CasADi needs derivatives that are not structurally zero. These
        derivatives are numerical zeros.
        """
        group, at, n = ca.MX.sym("group"), ca.MX.sym("at"), self.data.shape[1]
        row_of = ca.interpolant("row_of", "linear", [self.knots], np.arange(1.0, n), {"lookup_mode": ["binary"]})
        row_at, zero = _list("row_at", self.data), _list("zero", np.zeros((1, 2)))
        row = ca.fmin(ca.fmax(ca.floor(row_of(at)), 0), n - 1)
        here, behind = row_at(row)[1], row_at(ca.fmin(row + 1, n - 1))[1]
        row = row + ca.logic_and(at >= behind, row < n - 1) - (at < here)  # corrects rounding of the interpolant
        if self.data[0, -1]:
            _, first = np.unique(self.data[0], return_index=True)
            limits = _list("limits", np.array([first, [*first[1:] - 1, n - 1]], dtype=float))
            last = int(self.data[0, -1])
            first_last = limits(ca.fmin(ca.fmax(group, 0), last))
            row = ca.fmin(ca.fmax(row, first_last[0]), first_last[1])
        columns = row_at(row)[2:] + zero(ca.MX(0)) * (ca.sin(at) + ca.sin(group))
        _KNOWN[self.name] = self
        return ca.Function(self.name, [group, at], ca.vertsplit(columns), {"never_inline": True})


class Sides(Pieces):
    """The parts (0 to n) into which knots (n,) divide a line, and a wave that is 0 at the knots.

    The wave is a parabola between two knots and straight outside, with alternating slopes 1 and -1 at the knots. The
    wave is positive in parts with odd numbers.
    """

    @classmethod
    def of(cls, knots: Array) -> "Sides":
        """The sides for increasing knots (n,)."""
        slope = np.where(np.arange(len(knots) + 1) % 2, 1.0, -1.0)
        slope[0] = 1.0
        bend = np.zeros(len(slope))
        bend[1:-1] = -slope[1:-1] / np.diff(knots)
        begins = np.concatenate([knots[:1], knots])
        return cls(np.zeros(len(begins)), begins, np.column_stack([begins, slope, bend]))

    def wave(self, at: ca.SX) -> ca.SX:
        """The wave, which changes its sign at the knots. A repeated argument gives the same expression."""
        if self._wave is None or self._wave[0] != at.element_hash():
            begin, slope, bend, _ = self(ca.SX(0), at)
            self._wave = at.element_hash(), (at - begin) * (slope + bend * (at - begin))  # the product keeps `at` alive
        return self._wave[1]

    _wave: tuple[int, ca.SX] | None = None

    @cached_property
    def _nearest(self) -> "_Nearest":
        """The nearest odd and the nearest even part number. These numbers change in the middle of a part."""
        knots = self.knots
        number = np.arange(float(len(knots)))
        begins = np.concatenate([knots[:1], (knots[1:] + knots[:-1]) / 2])
        rows = np.column_stack([begins, number + (number % 2 == 0), number + number % 2])
        # There are at least two knots.
        return _Nearest(np.zeros(len(rows) + 1), np.append(begins, knots[-1]), np.vstack([rows, rows[-1:]]))

    def on_side(self, side: ca.SX, at: ca.SX) -> ca.SX:
        """The number of the nearest part with a positive wave for side 1, or with a negative wave for side -1."""
        _, odd, even, _ = self._nearest(ca.SX(0), at)
        return ca.if_else(side > 0, odd, even)


class _Nearest(Pieces):
    """Numbers of parts, as columns. The numbers jump only if a step goes too far beyond its side."""


class Smooth(Pieces):
    """Pieces of a spline. The curvature has no jumps, so steps need not end at knots."""


_KINDS: dict[str, type[Pieces]] = {"Pieces": Pieces, "Smooth": Smooth, "Sides": Sides, "Nearest": _Nearest}


def _from_data(kind: str, data: Array) -> Pieces:
    return _KINDS[kind](data[0], data[1], data[2:-1].T)


class Entry(NamedTuple):
    """A column of pieces. In lists of instructions, it is an operation on a group and an argument."""

    pieces: Pieces
    column: int

    def between(self, group: float, at: float) -> tuple[float, float, float]:
        """The value at an argument, and the knots that bound the interval of this value (infinite without a knot)."""
        groups, begins = self.pieces.data[:2]
        row = int(self.pieces.find(group, at))
        first, last = row == 0 or groups[row - 1] != group, row + 1 == len(groups) or groups[row + 1] != group
        ends = -np.inf if first else float(begins[row]), np.inf if last else float(begins[row + 1])
        return float(self.pieces.data[2 + self.column, row]), *ends


def _list(name: str, values: Array) -> ca.Function:
    """A Function from an integer k to column k of values."""
    places = np.arange(float(values.shape[1]))
    return ca.interpolant(name, "linear", [places], values.ravel("F"), {"lookup_mode": ["exact"]})


def entries_of(f: ca.Function, count: int) -> Sequence[Entry | None]:
    """The `count` entries that a called Function reads from pieces; None for a derivative, which is 0. Other Functions
    have no entries."""
    name = f.name()
    if name.partition("_")[0] in _KINDS:
        pieces = _pieces_of(f)
        return [Entry(pieces, column) for column in range(count)]
    return [None] * count if _is_derivative(name) else ()


def _is_derivative(name: str) -> bool:
    return any(f"_{kind}_" in name for kind in _KINDS)  # such as fwd1_Pieces_...


def is_compared_fast(f: ca.Function) -> bool:
    """Whether CasADi compares the calls in an SX Function fast, and finds all values that are 0.

    CasADi compares calls by the texts of the called Functions, which are long for long tables. It does not detect that
    derivatives of pieces are 0.
    """
    names = [each.name() for each in f.find_functions(0)]
    is_long = any(int(n.split("_")[1]) > _LONG for n in names if n.partition("_")[0] in _KINDS)
    return not (is_long or any(map(_is_derivative, names)))


def _pieces_of(f: ca.Function) -> Pieces:
    """The pieces that a Function reads. The Function may come from another process."""
    if f.name() not in _KNOWN:
        rows = f.find_function("row_at").map(int(f.name().split("_")[1]))
        _KNOWN[f.name()] = _from_data(f.name().split("_")[0], np.array(rows(np.arange(rows.size2_in(0))[None])))
    return _KNOWN[f.name()]


def applied(code: Any, *of: ca.SX) -> ca.SX:
    """The result of an operation, or of reading an entry of pieces."""
    if isinstance(code, Entry):
        return code.pieces(*of)[code.column]
    return ca.SX.binary(code, *of) if len(of) == 2 else ca.SX.unary(code, of[0])
