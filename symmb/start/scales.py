"""The size of a scene: scales of coordinates and rows before its motion is known."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.model import DAE, Scales, is_linear

_ROUNDING = 1e-9
"""Coordinates below this share of the lever arms are zero but for the rounding of Newton's method."""
_STEP_BITS = 10
"""Binary digits between coarse scales: lengths from 1/32 to 32 m are usual and get the scale 1."""


def evaluate_at_rest(f: ca.Function, dae: DAE, q: Array, t0: float) -> Array:
    """A Function of the DAE at coordinates q (n_q,), at rest, for nominal parameters."""
    s = (np.zeros(dae.n_s),) if dae.n_s else ()
    return np.asarray(f(q, np.zeros(dae.n_v), *s, dae.p_nominal, t0).full())


def resting(dae: DAE, q: ca.SX) -> tuple[ca.SX, ...]:
    """The arguments (q, v[, s]) of the DAE's Functions at rest."""
    return (q, ca.SX(dae.n_v, 1), *((ca.SX(dae.n_s, 1),) if dae.n_s else ()))


def length_of(dae: DAE, q: Array, G: Array) -> float:
    """The largest coordinate of translation [m]; the largest lever arm if the coordinates are zero; or 0.

    G (n_r, n_v) is the Jacobian of the rows at coordinates q (n_q,).
    """
    length = max((abs(x) for name, x in zip(dae.q_names, q, strict=True) if is_linear(name)), default=0.0)
    linear = np.array([is_linear(name) for name in dae.v_names], dtype=bool)
    along, around = np.abs(G[:, linear]).max(axis=1, initial=0.0), np.abs(G[:, ~linear]).max(axis=1, initial=0.0)
    arm = float((around[along > 0] / along[along > 0]).max(initial=0.0))
    return length if length > _ROUNDING * arm else arm


def with_coarse_scales(dae: DAE, q: Array, t0: float) -> DAE:
    """The DAE with scales at coordinates q (n_q,), at rest, which are 1 in scenes of usual size."""
    G = evaluate_at_rest(dae.G, dae, q, t0) if dae.G is not None else np.zeros((0, dae.n_v))
    scaled = replace(dae, scales=Scales(_coarse(length_of(dae, q, G))))
    rows = np.array([_coarse(row) for row in np.abs(G * scaled.displacement_scales).max(axis=1, initial=0.0)])
    return replace(scaled, scales=Scales(scaled.scales.length, rows=rows))


def _coarse(size: float) -> float:
    return 2.0 ** (_STEP_BITS * round(math.log2(size) / _STEP_BITS)) if 0 < size < math.inf else 1.0
