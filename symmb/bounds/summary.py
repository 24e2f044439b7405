"""Bounds as a table of text."""

from collections.abc import Sequence

import numpy as np

from symmb._types import Array

MEANING = {
    "enclosure": "proved: no response lies outside",
    "estimate": "of a surrogate: may miss to either side",
    "sampled": "attained by runs: the responses reach at least as far",
}


def widest_bounds(
    t: Array, names: Sequence[str], lower: Array, upper: Array, estimate: Array | None
) -> list[list[str]]:
    """One row of text for each output: the bounds where they are farthest apart, and the largest estimated error.

    Parameters
    ----------
    t : (n_t,) array                       times [s]
    names : n_y outputs
    lower, upper : (n_t, n_y) arrays
    estimate : (n_t, n_y) array or None    estimated error of both
    """
    rows = [["output", "widest at [s]", "lower", "upper", "width", "estimated error"]]
    with np.errstate(over="ignore"):
        width = upper - lower
    widest = np.where(np.isnan(width), np.inf, width).argmax(axis=0)
    for k, (name, i) in enumerate(zip(names, widest.tolist(), strict=True)):
        numbers = [t[i], lower[i, k], upper[i, k], width[i, k]]
        error = "–" if estimate is None else f"≤ {estimate[:, k].max():.1e}"
        rows.append([name, *(f"{number:.6g}" for number in numbers), error])
    return rows
