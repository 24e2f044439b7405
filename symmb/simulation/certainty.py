"""From when on digits of outputs are lost."""

from collections.abc import Sequence

import numpy as np

from symmb._types import Array

_CERTAIN = 1e-3
"""Error of an output, over its range, up to which it counts as certain: three digits."""
_NAMED = 4
"""Outputs that a sentence names."""


def error_doubts(t: Array, names: Sequence[str], values: Array, error: Array) -> tuple[str, ...]:
    """From when on fewer than three digits of outputs (n_t, n_y) are certain, by their estimated error (n_t, n_y)."""
    size = np.ptp(values, axis=0)
    lost = error > np.maximum(_CERTAIN * size, 1e-9 * np.abs(values).max(axis=0, initial=0.0))
    if not lost.any():
        return ()
    since = float(t[int(lost.any(axis=1).argmax())])
    concerned = [name for name, some in zip(names, lost.any(axis=0), strict=True) if some]
    listed = ", ".join(concerned[:_NAMED] + ["..."] * (len(concerned) > _NAMED))
    return (
        f"From t = {since:g} s on, errors of {listed} exceed a thousandth of their range: a run at a tenth of the "
        "tolerance differs by as much.",
    )
