"""Many independent polynomials distributed to threads, for compiled loops."""

import ctypes
from collections.abc import Callable

from symmb.codegen import cores, side_by_side

_FEWEST = 128
"""Polynomials from which on one more thread pays: fewer last less than a thread takes to start."""


def on_threads(work: Callable[[ctypes.c_long], object], m: int) -> None:
    """Call work once on each of several threads, with the common counter of the polynomials that are taken, of m."""
    side_by_side(work, [ctypes.c_long(0)] * max(1, min(cores(), m // _FEWEST)))
