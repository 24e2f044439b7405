"""Triangles of mesh files, and the reduction of their number."""

import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import LARGEST, SAME
from symmb._types import Array

_HEAD = 84
"""Bytes before the triangles of a binary STL file: 80 for the header, and 4 for the number of triangles."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_LARGEST_FILE = 2**28
"""Largest accepted file [bytes]: 5 million triangles, which take a few seconds."""


def read_mesh(path: Path) -> Array:
    """Corners (m, 3, 3) of the triangles of a mesh file. Raises DeclarationError for damaged files."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        raise DeclarationError(f"Mesh: there is no file {str(path)!r}.") from None
    if not path.is_file():
        raise DeclarationError(f"Mesh: {str(path)!r} is not a file. Pass the path of a file.")
    if found.st_size > _LARGEST_FILE:
        raise DeclarationError(f"Mesh: {path.name} is larger than {_LARGEST_FILE // 2**20} MiB. Reduce the mesh.")
    return _read(path, found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=32)
def _read(path: Path, changed: int, size: int) -> Array:
    """The triangles of a file. `changed` and `size` identify the content of the file in the cache."""
    try:
        triangles = _stl(path.read_bytes()) if path.suffix.lower() == ".stl" else _by_trimesh(path)
    except OSError as error:
        raise DeclarationError(f"Mesh: {path.name} cannot be read ({error.strerror}).") from None
    except ValueError as error:
        raise DeclarationError(f"Mesh: {path.name} {error}.") from None
    if not len(triangles):
        raise DeclarationError(f"Mesh: {path.name} has no triangles. Export the surface again.")
    if not (np.abs(triangles) < LARGEST).all():  # this form also refuses NaN
        raise DeclarationError(f"Mesh: {path.name} has coordinates that are not finite, or exceed {LARGEST:g}.")
    triangles.flags.writeable = False
    return triangles


def _stl(data: bytes) -> Array:
    """Triangles (m, 3, 3) of a binary or ASCII STL file. Raises ValueError if the file is damaged."""
    if not data.strip():
        raise ValueError("is empty")
    count = int.from_bytes(data[_HEAD - 4 : _HEAD], "little") if len(data) >= _HEAD else -1
    is_text = data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1024]
    if count >= 0 and (len(data) == _HEAD + _TRIANGLE.itemsize * count or not is_text):
        whole = (len(data) - _HEAD) // _TRIANGLE.itemsize
        if whole < count:
            raise ValueError(
                f"is incomplete or not an STL file: the header says {count:,} triangles, but the file contains "
                f"{whole:,}"
            )
        return np.frombuffer(data, _TRIANGLE, count, _HEAD)["corners"].astype(float)
    if not is_text:
        raise ValueError(
            "is not an STL file: it does not start with 'solid', and it is shorter than the 84 bytes before the "
            "triangles of a binary file"
        )
    words = np.array(_VERTEX.findall(data)).reshape(-1, 3)
    facets = len(re.findall(rb"\bendfacet\b", data, re.IGNORECASE))
    if len(words) != 3 * facets or not re.search(rb"\bendsolid\b", data, re.IGNORECASE):
        raise ValueError(
            f"is incomplete or not an STL file: it contains {len(words)} vertices in {facets} complete facets"
        )
    try:
        return words.astype(float).reshape(-1, 3, 3)
    except ValueError:
        raise ValueError("has a vertex that does not consist of three numbers") from None


def _by_trimesh(path: Path) -> Array:
    """Triangles (m, 3, 3) of a file in another format than STL. Raises ValueError if the file cannot be read."""
    try:
        import trimesh  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ValueError("is not an .stl file. Install the package trimesh to read other formats") from None
    try:
        mesh: Any = trimesh.load(path, force="mesh")
        return np.asarray(mesh.vertices, dtype=float)[np.asarray(mesh.faces)]
    except Exception as error:  # trimesh's readers raise errors of many classes
        raise ValueError(f"cannot be read by trimesh: {(str(error) or type(error).__name__).splitlines()[0]}") from None


def coarser(triangles: Array, most: int) -> Array:
    """At most `most` triangles (m, 3, 3) of about the same surface.

    All corners in a cell of a grid are replaced by their mean. Triangles without area are removed.
    """
    low, extent, cells = triangles.min(axis=(0, 1)), float(np.ptp(triangles, axis=(0, 1)).max()), 2 * np.sqrt(most)
    fewer = triangles
    while len(fewer) > most:
        cell = np.floor((triangles.reshape(-1, 3) - low) * (cells / (extent or 1.0)) * (1 - SAME)).astype(np.int64)
        _, number = np.unique(cell @ [1, 2**20, 2**40], return_inverse=True)
        sums = [np.bincount(number, column) for column in triangles.reshape(-1, 3).T]
        places = np.stack(sums, axis=1) / np.bincount(number)[:, None]  # mean of the corners in each cell
        corners = number.reshape(-1, 3)
        ordered = np.sort(corners, axis=1)
        _, first = np.unique(ordered @ [1, len(places), len(places) ** 2], return_index=True)
        kept = np.sort(first[(np.diff(ordered[first], axis=1) > 0).all(axis=1)])
        fewer = places[corners[kept]]
        cells *= 0.8  # leaves about two thirds of the triangles, so the result is not much coarser than necessary
    return fewer
