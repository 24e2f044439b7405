"""The size of a scene: scales of coordinates and rows before its motion is known."""

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from symmb._magnitudes import ROUNDING, SMALL
from symmb._types import Array, Indices, Mask
from symmb.declare.symbolic import evaluated
from symmb.equations.model import DAE, Scales, is_linear
from symmb.equations.start.tolerances import SOLVED

Arguments = tuple[Any, ...]
"""(q, v[, s], p, t)"""
PART_ROUNDING = ROUNDING
"""Size of a part of the scene, over that of the scene, below which its motion may be rounding of forces in balance; and
coordinates, over how far speeds and accelerations lead, below which they are rounding of an assembly."""
_LATER = (0.13, 0.37, 0.71, 0.05, 0.29, 0.53, 0.83, 0.97)
"""Times at which accelerations are compared with the first ones, over the span: fractions that few laws repeat at, and
so many that a wheel is near each of its positions at one of them."""
_STEP_BITS = 10
"""Binary digits between coarse scales: lengths from 1/32 to 32 m are usual and get the scale 1."""
_USUAL_RATE = 2.0**_STEP_BITS
"""Rates [1/s] of mechanisms with stiff springs and fast rotors, and its reciprocal those of slow machines: absolute
tolerances of velocities stay in between."""
_SMALL = SMALL
"""Norm of a row over its size in general from which on it is measured by its own norm. What is below keeps its share:
a row that has vanished but for rounding (1e-16) is none. test_redundancy.py"""
_AROUND, _DISTANCE = 3, 0.3
"""Positions around one where entries of Jacobians have their general sizes, and how far off they are [rad, share of the
size]: far from places where an entry vanishes by chance. test_assembly.py"""


def evaluate_at_rest(f: ca.Function, dae: DAE, q: Array, t0: float) -> Array:
    """A Function of the DAE at coordinates q (n_q,), at rest, for nominal parameters."""
    s = (rest_states(dae),) if dae.n_s else ()
    return evaluated(f, q, np.zeros(dae.n_v), *s, dae.p_nominal, np.array([t0]))


def jacobian_at_rest(dae: DAE, q: Array, t0: float) -> Array:
    """The velocity Jacobian at coordinates q (n_q,), at rest, for nominal parameters, (n_r, n_v)."""
    return evaluate_at_rest(dae.G, dae, q, t0) if dae.G is not None else np.zeros((0, dae.n_v))


def resting(dae: DAE, q: ca.SX, p: ca.SX) -> tuple[ca.SX, ...]:
    """The arguments (q, v[, s]) of the DAE's Functions at rest. States that start anywhere have their start."""
    if dae.s_start is None:
        return q, ca.SX(dae.n_v, 1)
    s, begin, moving = ca.SX(ca.DM(rest_states(dae))), dae.s_start(q, p), dae.s_start.jac_sparsity(0, 0)
    for k in set(range(dae.n_s)).difference(moving.row()):
        s[k] = begin[k]
    return q, ca.SX(dae.n_v, 1), s


def rest_states(dae: DAE) -> Array:
    """First-order states at rest at the nominal parameters, (n_s,)."""
    return np.zeros(dae.n_s) if dae.s_rest is None else dae.s_rest


def length_of(dae: DAE, q: Array, G: Array, part: Mask | None = None) -> float:
    """The largest coordinate of translation [m]; the largest lever arm if the coordinates are zero; or 0.

    G (n_r, n_v) is the Jacobian of the rows at coordinates q (n_q,). `part` (n_x,) tells which states count.
    """
    linear_q, linear = _is_linear(dae.q_names), _is_linear(dae.v_names)
    own_q, own = (slice(None),) * 2 if part is None else (part[: dae.n_q], part[dae.n_q : dae.n_q + dae.n_v])
    length = float(np.abs(q[own_q][linear_q[own_q]]).max(initial=0.0))
    G, linear = G[:, own], linear[own]
    along, around = np.abs(G[:, linear]).max(axis=1, initial=0.0), np.abs(G[:, ~linear]).max(axis=1, initial=0.0)
    arm = float((around[along > 0] / along[along > 0]).max(initial=0.0))
    return length if length > SOLVED * arm else arm


def distances(dae: DAE, at: Arguments, span: float) -> Array:
    """How far speeds and accelerations lead in a time [s] (n_v,), from the arguments of the DAE's Functions.

    Accelerations count as zero if they are rounding beside those that laws give later, or where the speeds lead.
    """
    q, v, *others, begin = at

    def accelerations(share: float, moved: float) -> Array:
        there = dae.retract(q, moved * span * np.asarray(v).ravel())
        return np.abs(dae.rhs(there, v, *others, begin + share * span)[1].full().ravel())

    first = accelerations(0.0, 0.0)
    later = [accelerations(share, moved) for share in _LATER for moved in (0.0, share)]
    first[first < SOLVED * np.fmax.reduce(later)] = 0.0
    return np.abs(at[1]) * span + first * span**2 / 2


def sizes_of_parts(dae: DAE, at: Arguments, G: Array, span: float, size: float) -> tuple[Array, float]:
    """Sizes of the states (n_x,), those of each part of the scene that acts on no other, and the largest rate [1/s].

    Lengths above 1 m count by their coarse scales: usual ones are 1. Sizes of velocities follow rates beyond usual ones
    only, since slow motions go along with fast ones. `size` is that of the whole scene. It stands where a part is so
    small that its motion may be rounding.
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
        has_length = length > PART_ROUNDING * far[own & linear].max(initial=0.0)
        if not has_length:
            angles = np.abs(at[0][part[: dae.n_q] & ~_is_linear(dae.q_names)]).max(initial=0.0)
            length = float(max(angles, far[own].max(initial=0.0)))
        if labels.any() and length > PART_ROUNDING * size:
            sizes[part] = min(1.0, power_of_two(length))
        if has_length:  # angles do not shrink with their arms
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
    """Numbers (n_x,) of the parts of the scene that do not act on each other.

    States are in the same part if a rate depends on both, or if one is that of a rate that depends on the other.
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
    while True:  # the least number passes on along the pairs
        least = parts.copy()
        np.minimum.at(least, rates, parts[states])
        np.minimum.at(least, states, least[rates])
        least = least[least]
        if np.array_equal(least, parts):
            return parts
        parts = least


def _is_linear(names: Sequence[str]) -> Mask:
    return np.array([is_linear(name) for name in names], dtype=bool)


def power_of_two(value: float) -> float:
    """The power of 2 next to a value, 1 if it is 0 or not finite."""
    return 2.0 ** round(math.log2(value)) if 0 < value < math.inf else 1.0


def with_coarse_scales(dae: DAE, q: Array, t0: float) -> DAE:
    """The DAE with scales at coordinates q (n_q,), at rest, which are 1 in scenes of usual size."""
    G = jacobian_at_rest(dae, q, t0)
    length = coarse(length_of(dae, q, G))
    scales = dae.scaled(lambda: Scales(length)).displacement_scales
    own, usual = (np.abs(A * scales).max(axis=1, initial=0.0) for A in (G, general_entries(dae, q, t0)))
    rows = np.array([coarse(row) for row in np.where(own > _SMALL * usual, own, usual)])
    return dae.scaled(lambda: Scales(length, rows=rows))


def own_scales(dae: DAE, q: Array, t0: float) -> Array:
    """Scales of displacements (n_v,) by the size of the scene at q (n_q,), which the coarse ones of the DAE round."""
    length = length_of(dae, q, jacobian_at_rest(dae, q, t0)) or 1.0
    return np.where(_is_linear(dae.v_names), length, 1.0)


def general_entries(dae: DAE, q: Array, t0: float) -> Array:
    """Sizes of the entries of the velocity Jacobian in general, (n_r, n_v): the largest ones around q (n_q,).

    The positions need not be on the constraints.
    """
    random, scales = np.random.default_rng(0), own_scales(dae, q, t0)
    general = np.abs(jacobian_at_rest(dae, q, t0))
    for _ in range(_AROUND):
        step = _DISTANCE * scales * random.uniform(-1, 1, dae.n_v)
        there = jacobian_at_rest(dae, np.asarray(dae.retract(q, step)).ravel(), t0)
        general = np.fmax(general, np.where(np.isfinite(there), np.abs(there), 0.0))
    return general


def row_sizes(A: Array, general: Array) -> Array:
    """Sizes (m,) by which the rows of A (m, n) are judged: their norms, unless they are small.

    Of A (k, m, n) at several positions, the largest norms count. A row far below the norm of its entries in `general`
    (m, n) is one that vanishes, or rounding of it.
    """
    own, usual = np.atleast_2d(np.linalg.norm(A, axis=-1)).max(axis=0), np.linalg.norm(general, axis=1)
    return above_zero(np.where(own > _SMALL * usual, own, usual))


def above_zero(sizes: Array) -> Array:
    return np.where(sizes > 0, sizes, 1.0)


def coarse(size: float) -> float:
    """The coarse scale of a size, 1 if it is not positive or not finite."""
    return 2.0 ** (_STEP_BITS * round(math.log2(size) / _STEP_BITS)) if 0 < size < math.inf else 1.0
