"""Times between output times, for limits and checks of runs, and the numbers of steps between output times."""

import numpy as np

from symmb._types import Array, Indices

CELLS = 1000
"""Number of parts of a horizon. No part is longer than the horizon divided by this number."""
_LONGEST, _GOLDEN = 1.5, 0.5 * (5**0.5 - 1)
"""Ratio of the longest piece of an interval to the mean piece, and the golden ratio, which makes pieces unequal."""


def refined(times: Array) -> tuple[Array, Indices]:
    """Output times and further times between them as one array (m,), and the indices (n_t,) of the output times in it.

    Longer intervals are cut into unequal pieces. With equal pieces, an oscillation might be at rest at all times. One
    time is very close to the start, so that solvers always begin in the same way.
    """
    spans = np.diff(times)
    if not spans.size:
        return times, np.arange(len(times))
    shares = spans * (CELLS / float(times[-1] - times[0]))
    counts = np.where(shares > 1 + 1e-9, np.ceil(_LONGEST * shares), 1).astype(np.intp)
    ends = np.cumsum(counts)
    k = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
    parts = (k + (_LONGEST - 1) * (k * _GOLDEN % 1)) / np.repeat(counts, counts)
    fine = np.append(np.repeat(times[:-1], counts) + parts * np.repeat(spans, counts), times[-1])
    # Time of an extra point after the start, divided by the horizon. This point determines SUNDIALS' first step, and so
    # all later steps.
    first = float(times[0] + 1e-5 * (times[-1] - times[0]))
    if fine[1] < 2 * first - fine[0]:
        return fine, np.append(0, ends)
    return np.insert(fine, 1, first), np.append(0, ends + 1)


def interval_steps(times: Array, length: float) -> Indices:
    """Numbers (n_t - 1,) of equal steps between output times (n_t,). The steps are not longer than `length` [s]."""
    return np.maximum(np.ceil(np.diff(times) / length - 1e-9).astype(np.intp), 1)
