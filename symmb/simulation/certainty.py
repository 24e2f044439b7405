"""From when on digits of outputs are lost."""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.model import DAE
from symmb.symbolic import batch

_CERTAIN = 1e-3
"""Error of an output, over its range, up to which it counts as certain: three digits."""
_ROUNDING, _SHIFT = 1e-12, 1e-6
"""Changes of states, over their sizes, that no solver resolves; and those that tell how outputs follow them."""
_AROUND, _OF_STEPS = 10, 0.1
"""States from which noise is told, and errors of steps over rtol and the sizes of states: atol is a hundredth of it."""
_NAMED = 4
"""Outputs that a sentence names."""


def rounding_of_outputs(y: ca.Function, dae: DAE, X: Array, p: Array, t: Array) -> Array:
    """Changes of outputs y(x, p, t) along a run X (n_t, n_x) that rounding of its states can make, (n_y,)."""
    signs = np.where(np.cos(np.arange(1, X.shape[1] + 1) ** 1.5) > 0, 1.0, -1.0)  # that no symmetry lets cancel
    shifted, here = (batch(y, states, p, t[:, None])[0] for states in (X + _SHIFT * signs * dae.state_sizes, X))
    change = np.nan_to_num(np.abs(shifted - here), posinf=0.0)
    return _ROUNDING / _SHIFT * change.reshape(len(t), -1).max(axis=0)


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


def error_doubts(
    t: Array, names: Sequence[str], values: Array, error: Array, rounding: Callable[[], Array]
) -> tuple[str, ...]:
    """From when on fewer than three digits of outputs (n_t, n_y) are certain, by their estimated error (n_t, n_y).

    `rounding` gives the changes of outputs (n_y,) that rounding of the states can make. It is asked only if needed.
    """
    size = np.ptp(values, axis=0)
    lost = error > np.maximum(_CERTAIN * size, 1e-9 * np.abs(values).max(axis=0, initial=0.0))
    if lost.any():
        lost &= error > rounding()
    if not lost.any():
        return ()
    since = float(t[int(lost.any(axis=1).argmax())])
    concerned = [name for name, some in zip(names, lost.any(axis=0), strict=True) if some]
    listed = ", ".join(concerned[:_NAMED] + ["..."] * (len(concerned) > _NAMED))
    return (
        f"From t = {since:g} s on, errors of {listed} exceed a thousandth of their range: a run that is ten times as "
        "accurate differs by as much.",
    )
