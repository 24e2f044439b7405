"""CasADi Functions over many samples at once, in and out as plain arrays."""

import casadi as ca
import numpy as np

from symmb._types import Array


def batch(f: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """Evaluate f for N samples; matrices come back dense.

    Parameters
    ----------
    f : casadi.Function      with vector inputs
    *arguments : (N, n) or (n,) arrays; one without the sample axis holds for all samples

    Returns
    -------
    tuple of (N, m) arrays for column outputs and (N, m, k) arrays for matrices
    """
    N = max((a.shape[0] for a in arguments if a.ndim == 2), default=1)
    columns = [ca.DM(a.T if a.ndim == 2 else a) for a in arguments]
    results = f.call(columns)
    out = []
    for i, result in enumerate(results):
        rows, cols = f.size_out(i)
        dense = result.full()
        if dense.shape[1] != cols * N:  # no argument carried samples, or the function has none
            dense = np.tile(dense, (1, N))
        value = dense.reshape(rows, N, cols).transpose(1, 0, 2)
        out.append(np.ascontiguousarray(value[:, :, 0] if cols == 1 else value))
    return tuple(out)
