"""Triangles from files of meshes, and fewer triangles of about the same surface."""

import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import LARGEST, SAME
from symmb._types import Array

_HEAD, _EACH = 84, 50
"""Bytes of a binary STL before its triangles, the last four of which count them, and of a triangle."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_LARGEST_FILE = 2**28
"""Bytes of a file that is read: 5 million triangles, which take a few seconds."""
_COARSER = 0.8
"""Cells along a side from one attempt to the next: about two thirds as many triangles."""


def read_mesh(path: Path) -> Array:
    """Corners of the triangles of a mesh, (m, 3, 3). A DeclarationError tells if the file is none, or is damaged."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        raise DeclarationError(f"Mesh: there is no file {str(path)!r}.") from None
    if not path.is_file():
        raise DeclarationError(f"Mesh: {str(path)!r} is no file.")
    if found.st_size > _LARGEST_FILE:
        raise DeclarationError(f"Mesh: {path.name} is larger than {_LARGEST_FILE // 2**20} MiB; reduce it.")
    return _read(path, found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=32)
def _read(path: Path, changed: int, size: int) -> Array:
    """The triangles of a file as it was at a time."""
    try:
        triangles = _stl(path.read_bytes()) if path.suffix.lower() == ".stl" else _by_trimesh(path)
    except OSError as error:
        raise DeclarationError(f"Mesh: {path.name} cannot be read ({error.strerror}).") from None
    except ValueError as error:
        raise DeclarationError(f"Mesh: {path.name} {error}.") from None
    if not len(triangles):
        raise DeclarationError(f"Mesh: {path.name} has no triangle.")
    if not (np.abs(triangles) < LARGEST).all():  # NaN is not either
        raise DeclarationError(f"Mesh: {path.name} has coordinates that are not finite, or beyond {LARGEST:g}.")
    triangles.flags.writeable = False
    return triangles


def _stl(data: bytes) -> Array:
    """Triangles of a binary or ASCII STL; ValueError tells what is wrong with it."""
    if not data.strip():
        raise ValueError("is empty")
    count = int.from_bytes(data[_HEAD - 4 : _HEAD], "little") if len(data) >= _HEAD else -1
    is_text = data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1024]
    if count >= 0 and (len(data) == _HEAD + _EACH * count or not is_text):
        whole = (len(data) - _HEAD) // _EACH
        if whole < count:
            raise ValueError(f"is cut off, or no STL: it says that it has {count:,} triangles and holds {whole:,}")
        return np.frombuffer(data, _TRIANGLE, count, _HEAD)["corners"].astype(float)
    if not is_text:
        raise ValueError(
            "is not STL: it does not begin with 'solid', and it is shorter than the header of a binary file"
        )
    words = np.array(_VERTEX.findall(data)).reshape(-1, 3)
    facets = len(re.findall(rb"\bendfacet\b", data, re.IGNORECASE))
    if len(words) != 3 * facets or not re.search(rb"\bendsolid\b", data, re.IGNORECASE):
        raise ValueError(f"is cut off, or no STL: it has {len(words)} vertices in {facets} whole facets")
    try:
        return words.astype(float).reshape(-1, 3, 3)
    except ValueError:
        raise ValueError("has a vertex that is not three numbers") from None


def _by_trimesh(path: Path) -> Array:
    """Triangles of another file; ValueError tells what is wrong."""
    try:
        import trimesh  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ValueError("is no .stl; install the package trimesh to read it") from None
    try:
        mesh: Any = trimesh.load(path, force="mesh")
        return np.asarray(mesh.vertices, dtype=float)[np.asarray(mesh.faces)]
    except Exception as error:  # of readers of many formats, which say what they miss
        raise ValueError(f"cannot be read by trimesh: {(str(error) or type(error).__name__).splitlines()[0]}") from None


def coarser(triangles: Array, most: int) -> Array:
    """At most so many triangles (m, 3, 3): corners in one cell of a grid become one, and triangles without area go."""
    low, extent, cells = triangles.min(axis=(0, 1)), float(np.ptp(triangles, axis=(0, 1)).max()), 2 * np.sqrt(most)
    fewer = triangles
    while len(fewer) > most:
        cell = np.floor((triangles.reshape(-1, 3) - low) * (cells / (extent or 1.0)) * (1 - SAME)).astype(np.int64)
        _, number = np.unique(cell @ [1, 2**20, 2**40], return_inverse=True)
        sums = [np.bincount(number, column) for column in triangles.reshape(-1, 3).T]
        places = np.stack(sums, axis=1) / np.bincount(number)[:, None]  # the middle of those in the cell
        corners = number.reshape(-1, 3)
        ordered = np.sort(corners, axis=1)
        _, first = np.unique(ordered @ [1, len(places), len(places) ** 2], return_index=True)
        kept = np.sort(first[(np.diff(ordered[first], axis=1) > 0).all(axis=1)])
        fewer = places[corners[kept]]
        cells *= _COARSER
    return fewer
