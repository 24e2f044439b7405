"""Averages over windows of time."""

import numpy as np

from symmb._magnitudes import ROUNDING, SAME
from symmb._types import Array, Mask

WINDOW = 0.02
"""Length of a window divided by the total time. Coefficients and widths of an oscillating response pass 0, so averages
over a window are used."""

DOUBTFUL = 0.1
"""Ratio of estimated error to width above which a warning is issued."""
LEAST_WIDTH = 0.1
"""Smallest width at some times, divided by the width over all times. Bounds may touch at single times, and responses
decay. Errors below 1 % of the width over all times (the usual tolerance) never cause a warning."""


def rms(values: Array) -> Array:
    """Root mean square over the first axis, which is usually the time."""
    return np.sqrt(np.mean(np.square(values), axis=0))


def is_doubtful(estimate: Array, width: Array, floor: Array, share: float = DOUBTFUL) -> Mask:
    """Mask (n_t, n_y) of the times after which an estimated error exceeds a fraction of the width, and a floor (n_y,).

    Error and width are root mean squares from a time to the end. The width is taken as at least LEAST_WIDTH times the
    width over all times.
    """
    error, width = (np.cumsum(np.square(a)[::-1], axis=0)[::-1] for a in (estimate, width))
    n_left = np.arange(len(width), 0, -1)[:, None]
    width = np.maximum(width, LEAST_WIDTH**2 * n_left * width[0] / len(width))
    return np.asarray(error > (share**2 * width + n_left * np.square(floor)) * (1 + SAME))


def is_doubtful_in_window(estimate: Array, width: Array, floor: Array, share: float = DOUBTFUL) -> Mask:
    """Mask (n_t, n_y) of the times at which an estimated error exceeds a fraction of the width, and a floor (n_y,).

    Error and width are root mean squares over a window. The width is taken as at least LEAST_WIDTH times the width over
    all times.
    """
    squares = np.square(width)
    enough = np.maximum(average_over_window(squares), LEAST_WIDTH**2 * squares.mean(axis=0))
    return np.asarray(average_over_window(np.square(estimate)) > (share**2 * enough + np.square(floor)) * (1 + SAME))


def rests_for_a_time(lowest: Array, highest: Array, noise: Array) -> bool:
    """Whether an output (n_t, n_y) is the same in all runs throughout a window, except for noise (n_y,) and rounding.

    The first of several times is ignored, because all motions have the same start.
    """
    scale = np.abs([lowest, highest]).max(axis=(0, 1))
    varies = highest - lowest > np.maximum(ROUNDING * scale, 2 * noise)
    return bool((average_over_window(varies.astype(float))[len(varies) > 1 :] == 0).any())


def average_over_window(squares: Array) -> Array:
    """Moving average over a window of times of squares (..., n_t, n_y)."""
    n_t = squares.shape[-2]
    half = int(WINDOW * n_t / 2)
    if not half:
        return squares
    before, n_y = half + 1, squares.shape[-1]
    sums = np.empty((*squares.shape[:-2], n_t + 2 * half + 1, n_y))
    sums[..., :before, :] = squares[..., :1, :]
    sums[..., before : before + n_t, :] = squares
    sums[..., before + n_t :, :] = squares[..., -1:, :]
    np.cumsum(sums, axis=-2, out=sums)
    means = sums[..., 2 * half + 1 :, :] - sums[..., : -2 * half - 1, :]
    means /= 2 * half + 1
    return np.maximum(means, 0.0, out=means)
