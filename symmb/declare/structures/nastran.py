"""Nodes and matrices from files of Nastran: the cards GRID and DMIG in small, large and free field format."""

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike, stat
from pathlib import Path

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.declare.structures.mass_samples import Sparse
from symmb.results.files import told

SUFFIXES = ".bdf", ".dat", ".nas", ".pch"
"""Suffixes of text files of Nastran."""
_BARE_EXPONENT = re.compile(r"(?<=[\d.])(?=[+-])")
"""Position at which Nastran omits the letter of an exponent: 1.5-3 means 1.5e-3."""


@dataclass(frozen=True, eq=False)
class _Card:
    """A card: its file, its first line, its name, and its other fields as texts."""

    path: Path
    line: int
    name: str
    fields: list[str]

    def fault(self, text: str) -> DeclarationError:
        return DeclarationError(f"{self.path}, line {self.line}, {self.name}: {text}")

    def text(self, k: int) -> str:
        return self.fields[k] if k < len(self.fields) else ""

    def whole(self, k: int, what: str) -> int:
        text = self.text(k)
        if not re.fullmatch(r"[+-]?\d{1,9}", text):
            raise self.fault(f"{what} must be a whole number, got {text!r}.")
        return int(text)

    def real(self, k: int, what: str) -> float:
        text = self.text(k) or "0.0"
        try:
            number = float(_BARE_EXPONENT.sub("e", text.lower().replace("d", "e")) if "_" not in text else "")
        except ValueError:
            raise self.fault(f"{what} must be a number, got {text!r}.") from None
        if not math.isfinite(number):
            raise self.fault(f"{what} must be finite, got {text!r}.")
        return number


@dataclass(frozen=True, eq=False)
class Matrix:
    """A matrix DMIG: entries by row and column. Rows and columns are pairs (node, component from 1 to 6)."""

    entries: dict[tuple[tuple[int, int], tuple[int, int]], float]

    @property
    def degrees(self) -> set[tuple[int, int]]:
        """The degrees of freedom (node, component) with an entry."""
        return {degree for pair in self.entries for degree in pair}

    def sparse(self, nodes: list[int], per_node: int) -> Sparse:
        """The matrix for the given nodes, with `per_node` degrees of freedom for each node."""
        from scipy.sparse import csc_array

        row_of = {node: per_node * k - 1 for k, node in enumerate(nodes)}
        at = np.array([[row_of[node] + part for node, part in pair] for pair in self.entries], dtype=int).reshape(-1, 2)
        size = per_node * len(nodes)
        return csc_array((list(self.entries.values()), (at[:, 0], at[:, 1])), shape=(size, size))


def is_nastran(source: object) -> bool:
    """Whether a source is the path of a file of Nastran, by its suffix."""
    return isinstance(source, str | PathLike) and Path(source).suffix.lower() in SUFFIXES


def read_grids(path: str | PathLike[str]) -> dict[int, Array]:
    """Positions (3,) of the nodes of a file, by number."""
    grids: dict[int, Array] = {}
    for card in _cards(path):
        if card.name == "GRDSET" and any(card.text(k) not in ("", "0") for k in (1, 5)):
            raise card.fault("all nodes are in another coordinate system. Export them in the basic coordinate system.")
        if card.name != "GRID":
            continue
        node = card.whole(0, "the number of the node")
        if node in grids:
            raise card.fault(f"node {node} appears twice. Remove one of the two cards.")
        for k, what in ((1, "position"), (5, "displacement")):
            if card.text(k) not in ("", "0"):
                raise card.fault(
                    f"the {what} of node {node} is in coordinate system {card.text(k)}. Use the basic system."
                )
        grids[node] = np.array([card.real(k, f"{x} of node {node}") for k, x in zip((2, 3, 4), "xyz", strict=True)])
    if not grids:
        raise DeclarationError(f"{path}: the file has no GRID card. Export the nodes, too.")
    return grids


def read_dmig(path: str | PathLike[str], letter: str) -> Matrix:
    """The DMIG matrix of a file. If there are several matrices, the name must start with `letter`."""
    cards: dict[str, list[_Card]] = {}
    for card in _cards(path):
        if card.name == "DMIG":
            cards.setdefault(card.text(0), []).append(card)
    chosen = [*cards] if len(cards) == 1 else [name for name in cards if name.startswith(letter)]
    if len(chosen) != 1:
        names = f"the matrices {', '.join(cards)}" if cards else "no matrix DMIG"
        raise DeclarationError(
            f"{path}: the file has {names}. Pass a file with one matrix, or with exactly one matrix whose name "
            f"starts with {letter}."
        )
    header, *columns = cards[chosen[0]]
    if header.text(1) != "0" or (form := header.whole(2, "the form")) not in (1, 6):
        raise header.fault(f"{chosen[0]} must start with a header of form 1 (square) or 6 (symmetric).")
    if header.whole(3, "the type") not in (1, 2):
        raise header.fault(f"{chosen[0]} is complex. Export a real matrix.")
    entries = _entries(columns)
    if not entries:
        raise header.fault(f"{chosen[0]} has no entries.")
    mirrored = {(column, row): value for (row, column), value in entries.items()} if form == 6 else {}
    return Matrix(mirrored | entries)


def _entries(columns: list[_Card]) -> dict[tuple[tuple[int, int], tuple[int, int]], float]:
    """The entries of a matrix by row and column, from the cards of its columns."""
    entries: dict[tuple[tuple[int, int], tuple[int, int]], float] = {}
    for card in columns:
        column = _degree(card, 1)
        for k in range(4, len(card.fields), 4):
            if not any(card.fields[k : k + 4]):
                continue
            row = _degree(card, k)
            if (row, column) in entries:
                raise card.fault(f"the entry of node {row[0]}, component {row[1]} appears twice in this column.")
            entries[row, column] = card.real(k + 2, "an entry")
    return entries


def _degree(card: _Card, k: int) -> tuple[int, int]:
    node, part = card.whole(k, "a node"), card.whole(k + 1, "a component")
    if not 1 <= part <= 6:
        raise card.fault(f"node {node} has the component {part}, not 1 to 6. Scalar points cannot be read.")
    return node, part


def _cards(path: str | PathLike[str]) -> tuple[_Card, ...]:
    """All cards of a file. The last two files are cached, because K and M are often in one file."""
    with told(path, "read"):
        found = stat(path)
        return _read(Path(path), found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=2)
def _read(path: Path, changed: int, size: int) -> tuple[_Card, ...]:
    cards: list[_Card] = []
    for number, text in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        line = text.split("$", 1)[0].expandtabs(8).rstrip()
        if not line:
            continue
        name, fields = _fields(line)
        if name.upper() == "ENDDATA":
            break
        if name and name[0] not in "+*":
            cards.append(_Card(path, number, name.rstrip("*").upper(), fields))
        elif cards:  # a continuation
            cards[-1].fields.extend(fields)
    return tuple(cards)


def _fields(line: str) -> tuple[str, list[str]]:
    """The name of a card (or a continuation mark) and the fields of one line."""
    first = line.split(",", 1)[0] if "," in line[:9] else line[:8]
    count, width = (4, 16) if "*" in first else (8, 8)
    if "," in line:
        name, *fields = (field.strip() for field in line.split(","))
        return name, (fields + [""] * count)[:count]
    return line[:8].strip(), [line[8 + width * k : 8 + width * (k + 1)].strip() for k in range(count)]
