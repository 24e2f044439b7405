"""Threads of linear algebra: one thread if results must not depend on the number of processors."""

import ctypes
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

_FUNCTIONS = (
    *(
        (f"{p}openblas_get_num_threads{s}", f"{p}openblas_set_num_threads{s}")
        for p in ("", "scipy_")
        for s in ("", "64_")
    ),
    ("MKL_Get_Max_Threads", "MKL_Set_Num_Threads"),
)
"""Names of functions of OpenBLAS, its copies and MKL. Each pair gets and sets the number of threads."""
_LOCK = threading.Lock()
_users = 0
_before: dict[str, int] = {}


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which NumPy and SciPy use one thread for linear algebra, if their library is OpenBLAS or MKL."""
    _enter()
    try:
        yield
    finally:
        _leave()


@contextmanager
def threads_as_before() -> Iterator[None]:
    """A context inside `one_thread` for the user's code. This code may use all threads."""
    _leave()
    try:
        yield
    finally:
        _enter()


def _enter() -> None:
    global _users
    with _LOCK:
        _users += 1
        for path, (get, put) in _libraries("scipy.linalg" in sys.modules).items():
            if (number := get()) > 1:
                _before[path] = number
                put(1)


def _leave() -> None:
    global _users
    with _LOCK:
        _users -= 1
        if not _users:  # other threads of this process may be in the context as well
            for path, (_, put) in _libraries("scipy.linalg" in sys.modules).items():
                if path in _before:
                    put(_before.pop(path))


@cache
def _libraries(with_scipy: bool) -> dict[str, tuple[Callable[[], int], Callable[[int], None]]]:
    """Path of each loaded library -> its two functions. SciPy and NumPy may load different libraries."""
    found = {}
    for path in _paths(with_scipy):
        try:
            library = ctypes.CDLL(path)
        except OSError:  # the file is removed, or is not a library
            continue
        for get, put in _FUNCTIONS:
            if hasattr(library, get) and hasattr(library, put):
                found[path] = getattr(library, get), getattr(library, put)
    return found


def _paths(with_scipy: bool) -> list[str]:
    """Files of the libraries that this process has loaded. If /proc/self/maps is missing, files beside the packages."""
    maps = Path("/proc/self/maps")
    if maps.exists():
        lines = maps.read_text().splitlines()
        paths = {line.split(maxsplit=5)[-1] for line in lines if "/" in line}
    else:
        folders = [Path(sys.modules[name].__file__ or "").parent for name in ("numpy", "scipy")[: 1 + with_scipy]]
        inside = (part for f in folders for part in (f.parent / f"{f.name}.libs", f / ".dylibs"))
        paths = {str(path) for folder in inside if folder.exists() for path in folder.iterdir()}
    return sorted(path for path in paths if "openblas" in Path(path).name or "mkl_rt" in Path(path).name)
