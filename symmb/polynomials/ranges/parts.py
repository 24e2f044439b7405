"""Many independent polynomials dealt to threads, for compiled loops."""

import ctypes
from collections.abc import Callable

from symmb.codegen import cores, side_by_side

_FEWEST = 128
"""Polynomials for which a thread pays."""


def on_threads(work: Callable[[ctypes.c_long], object], m: int) -> None:
    """Call work once on each of several threads, with the counter by which they deal themselves m polynomials."""
    side_by_side(work, [ctypes.c_long(0)] * max(1, min(cores(), m // _FEWEST)))
