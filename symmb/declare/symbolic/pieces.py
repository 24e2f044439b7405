"""Pieces of curves as data: a bisection finds the piece in which a number lies, however many there are.

CasADi evaluates it in a Function that SX expressions call. What is read of a piece are numbers, so that derivatives of
expressions have the pieces of the expressions themselves.
"""

import hashlib
import sys
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from symmb._types import Array, Indices

_FARTHEST = sys.float_info.max
_KNOWN: dict[str, "Pieces"] = {}


class Pieces:
    """Rows of numbers, each for the places from one begin to the next, in groups that follow each other.

    `groups` (n,) are those of the rows: 0, then the same or the next whole number. `begins` (n,) increase; the first
    one does not count. `columns` (n, m) are what is read, the begin first; the number of the row is appended.
    """

    def __init__(self, groups: Array, begins: Array, columns: Array) -> None:
        begins = np.concatenate([[-_FARTHEST], begins[1:]])
        rows = [groups, begins, *columns.T, np.arange(len(begins))]
        self.data = np.ascontiguousarray(rows, dtype=float)  # (2 + m + 1, n)
        # CasADi's names start with a letter.
        self.name = (
            f"{type(self).__name__.strip('_')}_{len(begins)}_{hashlib.sha256(self.data.tobytes()).hexdigest()[:24]}"
        )
        self._last: tuple[int, int, list[ca.SX]] = 0, 0, []

    def __reduce__(self) -> tuple[Callable[..., "Pieces"], tuple[str, Array]]:
        return _from_data, (self.name.partition("_")[0], self.data)

    @property
    def knots(self) -> Array:
        """Places (n - 1,) where pieces meet."""
        return self.data[1, 1:]

    def find(self, group: Array | float, at: Array | float) -> Indices:
        """Rows of the places, or those next to them in the groups."""
        first, last = (np.searchsorted(self.data[0], group, side) for side in ("left", "right"))
        row = np.searchsorted(self.data[1], at, "right") - 1
        return np.clip(np.clip(row, first, last - 1), 0, self.data.shape[1] - 1)

    def read(self, group: Array | float, at: Array | float) -> Array:
        """The columns (m + 1, ...) at some places."""
        return self.data[2:, self.find(group, at)]

    def __call__(self, group: ca.SX, at: ca.SX) -> list[ca.SX]:
        """The columns at a place, in a group, as expressions; the same as the last time for the same arguments."""
        key = group.element_hash(), at.element_hash()
        if self._last[:2] != key or not self._last[2]:
            # The outputs keep the arguments alive, and with these their hashes.
            self._last = *key, list(self.function(group, at))
        return self._last[2]

    @cached_property
    def sided(self) -> tuple["Sides", "Pieces"]:
        """The sides of all knots, and the same rows with a group for each."""
        return Sides.of(self.knots), Pieces(self.data[-1], self.data[1], self.data[2:-1].T)

    @cached_property
    def function(self) -> ca.Function:
        """The Function (group, at) -> columns, which expressions call.

        CasADi needs derivatives that are not zero by structure at the border of SX and MX: they are zero in numbers.
        """
        group, at, n = ca.MX.sym("group"), ca.MX.sym("at"), self.data.shape[1]
        row_of = ca.interpolant("row_of", "linear", [self.knots], np.arange(1.0, n), {"lookup_mode": ["binary"]})
        row_at, zero = _list("row_at", self.data), _list("zero", np.zeros((1, 2)))
        row = ca.fmin(ca.fmax(ca.floor(row_of(at)), 0), n - 1)
        here, behind = row_at(row)[1], row_at(ca.fmin(row + 1, n - 1))[1]
        row = row + ca.logic_and(at >= behind, row < n - 1) - (at < here)  # the interpolant is rounded
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
    """Numbers of the parts into which knots (n,) divide a line, from 0 to n, and a wave that is 0 at the knots.

    The wave is a parabola between two knots and straight beyond, with slopes 1 and -1 at the knots in turn. It is
    above 0 in parts of odd numbers.
    """

    @classmethod
    def of(cls, knots: Array) -> "Sides":
        """The sides of knots."""
        slope = np.where(np.arange(len(knots) + 1) % 2, 1.0, -1.0)
        slope[0] = 1.0
        bend = np.zeros(len(slope))
        bend[1:-1] = -slope[1:-1] / np.diff(knots)
        begins = np.concatenate([knots[:1], knots])
        return cls(np.zeros(len(begins)), begins, np.column_stack([begins, slope, bend]))

    def wave(self, at: ca.SX) -> ca.SX:
        """What changes sign at the knots; the same as the last time for the same place."""
        if self._wave is None or self._wave[0] != at.element_hash():
            begin, slope, bend, _ = self(ca.SX(0), at)
            self._wave = at.element_hash(), (at - begin) * (slope + bend * (at - begin))  # keeps the place alive
        return self._wave[1]

    _wave: tuple[int, ca.SX] | None = None

    @cached_property
    def _nearest(self) -> "_Nearest":
        """The odd and the even numbers next to a place, which change in the middle of parts."""
        knots = self.knots
        number = np.arange(float(len(knots)))
        begins = np.concatenate([knots[:1], (knots[1:] + knots[:-1]) / 2])
        rows = np.column_stack([begins, number + (number % 2 == 0), number + number % 2])
        # There are two knots at least.
        return _Nearest(np.zeros(len(rows) + 1), np.append(begins, knots[-1]), np.vstack([rows, rows[-1:]]))

    def on_side(self, side: ca.SX, at: ca.SX) -> ca.SX:
        """The number of the next part where the wave is above 0 for a side of 1, below for -1."""
        _, odd, even, _ = self._nearest(ca.SX(0), at)
        return ca.if_else(side > 0, odd, even)


class _Nearest(Pieces):
    """Numbers of parts, which jump where a step on a side has gone too far."""


class Smooth(Pieces):
    """Pieces of a spline, whose curvature has no jumps: steps need not end where they meet."""


_KINDS: dict[str, type[Pieces]] = {"Pieces": Pieces, "Smooth": Smooth, "Sides": Sides, "Nearest": _Nearest}


def _from_data(kind: str, data: Array) -> Pieces:
    return _KINDS[kind](data[0], data[1], data[2:-1].T)


class Entry(NamedTuple):
    """A column of pieces: in lists of instructions it stands for an operation on a group and a place."""

    pieces: Pieces
    column: int

    def between(self, group: float, at: float) -> tuple[float, float, float]:
        """The value at a place, and the knots between which all places of the group have it: infinite without one."""
        groups, begins = self.pieces.data[:2]
        row = int(self.pieces.find(group, at))
        first, last = row == 0 or groups[row - 1] != group, row + 1 == len(groups) or groups[row + 1] != group
        ends = -np.inf if first else float(begins[row]), np.inf if last else float(begins[row + 1])
        return float(self.pieces.data[2 + self.column, row]), *ends


def _list(name: str, values: Array) -> ca.Function:
    """A Function from a number k, whole, to column k of values."""
    places = np.arange(float(values.shape[1]))
    return ca.interpolant(name, "linear", [places], values.ravel("F"), {"lookup_mode": ["exact"]})


def called(f: ca.Function) -> dict[int, list[Entry | None]]:
    """What each result of the instructions of an SX Function that call pieces is, by their numbers; None where 0.

    Calls of other Functions are not in it.
    """
    if not f.find_functions():
        return {}
    calls = [k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CALL]
    found: dict[int, list[Entry | None]] = {}
    instructions: Any = f.instructions_sx()
    for k in calls:
        function = instructions[k].which_function()
        count, name = len(f.instruction_output(k)), function.name()
        if name.partition("_")[0] in _KINDS:
            pieces = _pieces_of(function)
            found[k] = [Entry(pieces, column) for column in range(count)]
        elif any(f"_{kind}_" in name for kind in _KINDS):  # such as fwd1_Pieces_...
            found[k] = [None] * count
    return found


def _pieces_of(f: ca.Function) -> Pieces:
    """The pieces that a Function reads, which may come from another process."""
    if f.name() not in _KNOWN:
        rows = f.find_function("row_at").map(int(f.name().split("_")[1]))
        _KNOWN[f.name()] = _from_data(f.name().split("_")[0], np.array(rows(np.arange(rows.size2_in(0))[None])))
    return _KNOWN[f.name()]


def applied(code: Any, *of: ca.SX) -> ca.SX:
    """The result of an operation, or an entry of pieces."""
    if isinstance(code, Entry):
        return code.pieces(*of)[code.column]
    return ca.SX.binary(code, *of) if len(of) == 2 else ca.SX.unary(code, of[0])
