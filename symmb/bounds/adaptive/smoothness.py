"""Where a response is not smooth: coefficients that do not decay, and events between nodes."""

import numpy as np

from symmb._types import Array, Indices
from symmb.polynomials import Expansion


def decay_ratios(expansion: Expansion, widths: Array, least: int) -> Array:
    """Decay of the coefficients of each direction over two degrees, (d,); 0 in directions of less than a least degree.

    With S_k the norm of all coefficients of degrees k - 1 and k, relative to the widths (n_y,), and n the highest
    degree, the decay is the larger of S_(n-2) / S_(n-4) and S_(n-4) / S_(n-6). The two highest degrees do not
    count: an interpolant that does not resolve the response halves them.
    """
    decay = np.zeros(expansion.alpha.shape[1])
    for i, degrees in enumerate(expansion.alpha.T):
        top = degrees.max()
        if top >= least:
            shells = ((degrees > k - 2) & (degrees <= k) for k in (top - 2, top - 4, top - 6))
            a, b, c = (np.linalg.norm(expansion.coefficients[rows] / widths) for rows in shells)
            decay[i] = max(a / b if b > 0 else 0.0, b / c if c > 0 else 0.0)
    return decay


def event_errors(nodes: Array, degrees: Indices, Y: Array, events: Indices) -> Array:
    """Expected errors along each parameter (d, n_t, n_y) where events happen between nodes, nan elsewhere.

    Responses have kinks and jumps there. In between, an extreme exceeds the values at the nodes by at most the change
    of the response over the distance of two nodes, at the largest slope that occurs away from events.

    Parameters
    ----------
    nodes : (N, d)              of a tensor grid with these degrees (d,)
    Y : (N, n_t, n_y)           responses there
    events : (N, n_t)           number of events up to each time; -1 where it is not known
    """
    order, axes = np.lexsort(nodes.T[::-1]), tuple(range(len(degrees)))
    shape = tuple(degrees + 1)
    Y_grid = Y[order].reshape(*shape, *Y.shape[1:])
    events_grid = events[order].reshape(*shape, -1, 1)
    is_between = np.ptp(events_grid, axis=axes) > 0
    errors = np.zeros((len(degrees), *Y.shape[1:]))
    for i, x in enumerate(nodes[order].T.reshape(len(degrees), *shape)):
        distance = np.diff(x, axis=i)[..., None, None]
        change, has_event = np.abs(np.diff(Y_grid, axis=i)), np.diff(events_grid, axis=i) != 0
        slope = np.where(has_event, 0.0, change / distance).max(axis=axes)
        widest = np.where(has_event, distance, 0.0).max(axis=axes)
        errors[i] = np.where(has_event.all(axis=axes), change.max(axis=axes), slope * widest)
    return np.where(is_between, errors, np.nan)
