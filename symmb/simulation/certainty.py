"""How far outputs follow changes of the states."""

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.model import DAE
from symmb.symbolic import batch

_ROUNDING, _SHIFT = 1e-12, 1e-6
"""Changes of states, over their sizes, that no solver resolves; and those that tell how outputs follow them."""
_AROUND, _OF_STEPS = 10, 0.1
"""States from which noise is told, and errors of steps over rtol and the sizes of states: atol is a hundredth of it."""


def changes_of_outputs(y: ca.Function, dae: DAE, X: Array, p: Array, t: Array, level: float = _ROUNDING) -> Array:
    """Changes of outputs y(x, p, t) along a run X (n_t, n_x) if states change by a level of their sizes, (n_y,).

    Without a level, these are the changes that rounding of the states can make.
    """
    signs = np.where(np.cos(np.arange(1, X.shape[1] + 1) ** 1.5) > 0, 1.0, -1.0)  # that no symmetry lets cancel
    shifted, here = (batch(y, states, p, t[:, None])[0] for states in (X + _SHIFT * signs * dae.state_sizes, X))
    change = np.nan_to_num(np.abs(shifted - here), posinf=0.0)
    return level / _SHIFT * change.reshape(len(t), -1).max(axis=0)


def noise_of_outputs(y: ca.Function, dae: DAE, x: Array, p: Array, t: float, rtol: float | None) -> Array:
    """How far outputs y(x, p, t) are off (n_y,) if states are off by what a solver's steps leave.

    The state x (n_x,) may be a special one, such as rest: the median over states around it counts.
    """
    around = np.random.default_rng(0).uniform(-1, 1, (_AROUND, len(x))) * dae.state_sizes
    states = x + np.vstack([np.zeros(len(x)), around])
    shift = np.random.default_rng(1).uniform(-1, 1, states.shape) * _SHIFT * dae.state_sizes
    there, here = (batch(y, some, p, np.full((len(some), 1), t))[0] for some in (states + shift, states))
    level = _ROUNDING if rtol is None else max(_OF_STEPS * rtol, _ROUNDING)
    return level / _SHIFT * np.median(np.nan_to_num(np.abs(there - here), posinf=0.0), axis=0)
