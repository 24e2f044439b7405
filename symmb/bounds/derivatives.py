"""Derivatives of a simulator's responses over the unit box."""

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.black_boxes import Jets, Simulator
from symmb.bounds.method import Method, parameter_columns, parameter_samples
from symmb.model import Box


def unit_jets(method: Method, simulator: Simulator, box: Box, point: Array, directions: Array, order: int) -> Array:
    """Taylor coefficients (order + 1, m, n_t, n_y) about a point (d,) along directions (m, d), all of [-1, 1]^d.

    Raises
    ------
    PropagationError
        If the simulator gives no derivatives, or some that are not finite.
    """
    if not isinstance(simulator, Jets):
        raise PropagationError(
            f"{method!r}: it needs derivatives of the trajectory, but {simulator!r} gives values only. "
            "Use MonteCarlo or PolynomialChaos."
        )
    p0 = parameter_samples(simulator, box, point[None])[0]
    scaled = np.zeros((len(directions), len(p0)))
    scaled[:, parameter_columns(simulator, box)] = directions * box.radius
    jets = np.asarray(simulator.jets(p0, scaled, order), dtype=float)
    if not np.isfinite(jets).all():
        raise PropagationError(f"{method!r}: {simulator!r} gives derivatives that are not finite.")
    return jets
