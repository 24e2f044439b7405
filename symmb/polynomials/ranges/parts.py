"""Many independent polynomials distributed to threads, for compiled loops."""

import ctypes
from collections.abc import Callable

from symmb.codegen import cores, side_by_side

_FEWEST = 128
"""Polynomials for each additional thread: fewer take less time than the start of a thread."""


def on_threads(work: Callable[[ctypes.c_long], object], m: int) -> None:
    """Call `work` once on each of several threads, with a common counter of the m polynomials."""
    side_by_side(work, [ctypes.c_long(0)] * max(1, min(cores(), m // _FEWEST)))
