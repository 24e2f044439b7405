"""How large a scene is: what coordinates and rows are measured by before its motion is known."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.model import DAE, Scales, is_linear

_ROUNDING = 1e-9
"""Share of the lever arms of rows below which coordinates are what Newton's method leaves of zero."""
_UNIT = 10
"""Binary digits between units: lengths from 1/32 to 32 are those of usual scenes and measured by 1."""


def at_rest(f: ca.Function, dae: DAE, q: Array, t0: float) -> Array:
    """A Function of the DAE at coordinates q (n_q,), at rest, for nominal parameters."""
    s = (np.zeros(dae.n_s),) if dae.n_s else ()
    return np.asarray(f(q, np.zeros(dae.n_v), *s, dae.p_nominal, t0).full())


def length_of(dae: DAE, q: Array, G: Array) -> float:
    """The largest coordinate of translation [m], or lever arm of rows where those are zero but for rounding; or 0.

    G (n_r, n_v) is the Jacobian of the rows at coordinates q (n_q,).
    """
    length = max((abs(x) for name, x in zip(dae.q_names, q, strict=True) if is_linear(name)), default=0.0)
    linear = np.array([is_linear(name) for name in dae.v_names], dtype=bool)
    along, around = np.abs(G[:, linear]).max(axis=1, initial=0.0), np.abs(G[:, ~linear]).max(axis=1, initial=0.0)
    arm = float((around[along > 0] / along[along > 0]).max(initial=0.0))
    return length if length > _ROUNDING * arm else arm


def in_units(dae: DAE, q: Array, t0: float) -> DAE:
    """The DAE with coarse scales at coordinates q (n_q,), at rest: all 1 in scenes of usual size."""
    G = at_rest(dae.G, dae, q, t0) if dae.G is not None else np.zeros((0, dae.n_v))
    sized = replace(dae, scales=Scales(_unit(length_of(dae, q, G))))
    rows = np.array([_unit(row) for row in np.abs(G * sized.displacement_scales).max(axis=1, initial=0.0)])
    return replace(sized, scales=Scales(sized.scales.length, rows=rows))


def _unit(size: float) -> float:
    return 2.0 ** (_UNIT * round(math.log2(size) / _UNIT)) if 0 < size < math.inf else 1.0
