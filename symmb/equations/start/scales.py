"""The size of a scene: scales of coordinates and rows, computed before the motion is known."""

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from symmb._magnitudes import ROUNDING, SMALL
from symmb._types import Array, Indices, Mask
from symmb.declare.symbolic import evaluated
from symmb.equations.model import DAE, Scales, is_linear
from symmb.equations.start.residual_limits import SOLVED

Arguments = tuple[Any, ...]
"""The arguments (q, v[, s], p, t) of the DAE's Functions."""
_STEP_BITS = 10
"""Coarse scales are powers of 2**10: usual lengths from 1/32 to 32 m get the scale 1."""
_USUAL_RATE = 2.0**_STEP_BITS
"""Largest usual rate [1/s], of mechanisms with stiff springs and fast rotors. The reciprocal is the smallest usual
rate, of slow machines. Absolute tolerances of velocities are the same for all usual rates."""


def evaluate_at_rest(f: ca.Function, dae: DAE, q: Array, t0: float) -> Array:
    """The value of a Function of the DAE at coordinates q (n_q,), at rest, for nominal parameters."""
    s = (rest_states(dae),) if dae.n_s else ()
    return evaluated(f, q, np.zeros(dae.n_v), *s, dae.p_nominal, np.array([t0]))


def jacobian_at_rest(dae: DAE, q: Array, t0: float) -> Array:
    """The velocity Jacobian at coordinates q (n_q,), at rest, for nominal parameters, (n_r, n_v)."""
    return evaluate_at_rest(dae.G, dae, q, t0) if dae.G is not None else np.zeros((0, dae.n_v))


def resting(dae: DAE, q: ca.SX, p: ca.SX) -> tuple[ca.SX, ...]:
    """The arguments (q, v[, s]) of the DAE's Functions at rest. First-order states have their start values."""
    if dae.s_start is None:
        return q, ca.SX(dae.n_v, 1)
    s, begin, moving = ca.SX(ca.DM(rest_states(dae))), dae.s_start(q, p), dae.s_start.jac_sparsity(0, 0)
    # States with a start value that depends on coordinates rest at s_rest, so that angles count their turns from there.
    for k in set(range(dae.n_s)).difference(moving.row()):
        s[k] = begin[k]
    return q, ca.SX(dae.n_v, 1), s


def rest_states(dae: DAE) -> Array:
    """First-order states at rest at the nominal parameters, (n_s,)."""
    return np.zeros(dae.n_s) if dae.s_rest is None else dae.s_rest


def length_of(dae: DAE, q: Array, G: Array, part: Mask | None = None) -> float:
    """The largest coordinate of translation [m]; the largest lever arm if the coordinates are zero; or 0.

    G (n_r, n_v) is the Jacobian of the rows at coordinates q (n_q,). `part` (n_x,) selects the states to use.
    """
    linear_q, linear = _is_linear(dae.q_names), _is_linear(dae.v_names)
    own_q, own = (slice(None),) * 2 if part is None else (part[: dae.n_q], part[dae.n_q : dae.n_q + dae.n_v])
    length = float(np.abs(q[own_q][linear_q[own_q]]).max(initial=0.0))
    G, linear = G[:, own], linear[own]
    along, around = np.abs(G[:, linear]).max(axis=1, initial=0.0), np.abs(G[:, ~linear]).max(axis=1, initial=0.0)
    arm = float((around[along > 0] / along[along > 0]).max(initial=0.0))
    return length if length > SOLVED * arm else arm


def distances(dae: DAE, at: Arguments, span: float) -> Array:
    """Distances (n_v,) that speeds and accelerations cover in a time [s], from the arguments of the DAE's Functions.

    Accelerations count as zero if they are rounding errors of accelerations at later times and positions.
    """
    q, v, *others, begin = at

    def accelerations(share: float, moved: float) -> Array:
        there = dae.retract(q, moved * span * np.asarray(v).ravel())
        return np.abs(dae.rhs(there, v, *others, begin + share * span)[1].full().ravel())

    first = accelerations(0.0, 0.0)
    # Few periodic laws have equal values at all these fractions of the span. At the fractions, a wheel has many angles.
    fractions = 0.13, 0.37, 0.71, 0.05, 0.29, 0.53, 0.83, 0.97
    later = [accelerations(share, moved) for share in fractions for moved in (0.0, share)]
    first[first < SOLVED * np.fmax.reduce(later)] = 0.0
    return np.abs(at[1]) * span + first * span**2 / 2


def sizes_of_parts(dae: DAE, at: Arguments, G: Array, span: float, size: float) -> tuple[Array, float]:
    """Sizes of the states (n_x,), computed for each independent part of the scene, and the largest rate [1/s].

    Lengths above 1 m are replaced by coarse scales, which are 1 for usual lengths. Most scenes have slow and fast
    motions, so only rates below 1/1024 or above 1024 per second change sizes of velocities. `size` is the size of the
    whole scene, and replaces the size of a part that is so small that its motion may be a rounding error.
    """
    labels = _parts(dae)
    sizes, rates = np.full(len(labels), size), [coarse(min(1.0, _USUAL_RATE / span)) if span else 1.0]
    own_v = slice(dae.n_q, dae.n_q + dae.n_v)
    names = [*dae.q_names, *dae.v_names, *dae.s_names]
    lengths = _is_linear(names)
    of_body = np.arange(len(names)) < own_v.stop
    angular = ~lengths & (of_body | np.array([name.endswith(".angle") for name in names], dtype=bool))
    accelerations = np.abs(dae.rhs(*at)[1].full().ravel())
    far, linear = distances(dae, at, span), _is_linear(dae.v_names)
    for label in np.unique(labels):
        part = labels == label
        own = part[own_v]
        length = length_of(dae, at[0], G, part)
        has_length = length > ROUNDING * far[own & linear].max(initial=0.0)
        if not has_length:
            angles = np.abs(at[0][part[: dae.n_q] & ~_is_linear(dae.q_names)]).max(initial=0.0)
            length = float(max(angles, far[own].max(initial=0.0)))
        # The motion of a much smaller part may be rounding of forces that balance.
        if labels.any() and length > ROUNDING * size:
            sizes[part] = min(1.0, power_of_two(length))
        if has_length:  # small arms do not make angles small
            sizes[part & angular] = 1.0
        sizes[: dae.n_q][(part & lengths)[: dae.n_q]] *= coarse(max(1.0, length))
        arms = np.where(linear, length or 1.0, 1.0)
        speeds = np.maximum(np.abs(at[1]) / arms, np.sqrt(accelerations / arms))[own]
        rate = float(speeds.max(initial=1.0 / span if span else 1.0))
        rates.append(coarse(rate))
        slow = min(1.0, rate * _USUAL_RATE)
        sizes[own_v][own & linear] *= power_of_two(slow * max(1.0, max(1.0, length) * rate / _USUAL_RATE))
        sizes[own_v][own & ~linear] *= power_of_two(slow * max(1.0, rate / _USUAL_RATE))
    return sizes, max(rates)


def _parts(dae: DAE) -> Indices:
    """Indices (n_x,) of the part of each state. Parts of the scene do not act on each other.

    Two states are in the same part if a rate depends on both, or if the rate of one state depends on the other state.
    """
    sizes = [dae.n_q, dae.n_v, *([dae.n_s] if dae.n_s else [])]
    first = np.cumsum([0, *sizes])
    pairs = [np.tile(np.arange(first[-1]), (2, 1))]
    for k, rates in enumerate(first[:-1]):
        for j, states in enumerate(first[:-1]):
            rows, columns = dae.rhs.jac_sparsity(k, j).get_triplet()
            pairs.append(np.array([rows, columns], dtype=np.intp) + [[rates], [states]])
    rates, states = np.hstack(pairs)
    parts = np.arange(first[-1])
    while True:  # the smallest index propagates along the pairs
        least = parts.copy()
        np.minimum.at(least, rates, parts[states])
        np.minimum.at(least, states, least[rates])
        least = least[least]  # shortens chains of states, so that few passes suffice
        if np.array_equal(least, parts):
            return parts
        parts = least


def _is_linear(names: Sequence[str]) -> Mask:
    return np.array([is_linear(name) for name in names], dtype=bool)


def power_of_two(value: float, bits: int = 1) -> float:
    """The power of 2**bits closest to a value; 1 for 0 and for values that are not positive and finite."""
    return 2.0 ** (bits * round(math.log2(value) / bits)) if 0 < value < math.inf else 1.0


def with_coarse_scales(dae: DAE, q: Array, t0: float) -> DAE:
    """The DAE with coarse scales at coordinates q (n_q,), at rest. The scales are 1 for scenes of usual size."""
    G = jacobian_at_rest(dae, q, t0)
    length = coarse(length_of(dae, q, G))
    scales = dae.scaled(lambda: Scales(length)).displacement_scales
    own, usual = (np.abs(A * scales).max(axis=1, initial=0.0) for A in (G, general_entries(dae, q, t0)))
    rows = np.array([coarse(row) for row in np.where(own > SMALL * usual, own, usual)])
    return dae.scaled(lambda: Scales(length, rows=rows))


def own_scales(dae: DAE, q: Array, t0: float) -> Array:
    """Scales of displacements (n_v,) from the unrounded size of the scene at q (n_q,)."""
    length = length_of(dae, q, jacobian_at_rest(dae, q, t0)) or 1.0
    return np.where(_is_linear(dae.v_names), length, 1.0)


def general_entries(dae: DAE, q: Array, t0: float) -> Array:
    """General sizes of the entries of the velocity Jacobian, (n_r, n_v): the largest absolute values around q (n_q,).

    The positions need not satisfy the constraints.
    """
    random, scales = np.random.default_rng(0), own_scales(dae, q, t0)
    # Far enough to leave positions at which an entry vanishes by chance. test_assembly.py
    distance = 0.3 * scales  # [m, rad]
    general = np.abs(jacobian_at_rest(dae, q, t0))
    for _ in range(3):
        step = distance * random.uniform(-1, 1, dae.n_v)
        there = jacobian_at_rest(dae, np.asarray(dae.retract(q, step)).ravel(), t0)
        general = np.fmax(general, np.where(np.isfinite(there), np.abs(there), 0.0))
    return general


def row_sizes(A: Array, general: Array) -> Array:
    """Sizes (m,) of the rows of A (m, n): their norms, or their general sizes if the norms are small.

    For A (k, m, n) at several positions, the largest norms are used. If a row is much smaller than the norm of its
    entries in `general` (m, n), it is 0 except for rounding.
    """
    own, usual = np.atleast_2d(np.linalg.norm(A, axis=-1)).max(axis=0), np.linalg.norm(general, axis=1)
    # A row of rounding errors (1e-16) must not be scaled up to norm 1. test_redundancy.py
    return above_zero(np.where(own > SMALL * usual, own, usual))


def above_zero(sizes: Array) -> Array:
    return np.where(sizes > 0, sizes, 1.0)


def coarse(size: float) -> float:
    """The coarse scale of a size."""
    return power_of_two(size, _STEP_BITS)
