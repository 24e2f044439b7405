"""Singular positions of a motion: positions at which independent constraint rows become dependent."""

from dataclasses import dataclass
from typing import cast

import casadi as ca
import numpy as np

from symmb._magnitudes import ROUNDING
from symmb._types import Array, Indices, Mask
from symmb.declare.symbolic import evaluated, nonzeros, pattern, rotation_matrix
from symmb.equations.model import DAE

_NEARLY_SINGULAR = 1e-2
"""A position is nearly singular if the ratio of smallest to largest singular value of unit rows is below this limit.
Lower limits miss singular positions between output times. Higher limits find regular positions.
tests/test_problems.py"""


@dataclass(frozen=True)
class Singularity:
    """Time of the nearly singular position [s], ratio of smallest to largest singular value, and constraints."""

    time: float
    ratio: float
    names: tuple[str, ...]

    def __str__(self) -> str:
        joints = ", ".join(repr(name) for name in self.names)
        return f"near t = {self.time:g} s, constraints {joints} nearly depend on each other (ratio {self.ratio:.0e})"


def singularity(dae: DAE, X: Array, p: Array, times: Array) -> Singularity | None:
    """The position among states X (m, n_x) that is closest to singular; None if all positions are regular.

    Rows of joints that open and close are not included.
    """
    lasting = dae.lasting
    if dae.G is None or not len(X) or not lasting.size:
        return None
    rank = dae.rank + lasting.size - dae.n_r
    if (k := _closest(dae, X, p, times, rank)) is None:
        return None
    cuts = [dae.n_q, dae.n_q + dae.n_v] if dae.n_s else [dae.n_q]
    G = evaluated(dae.G, *np.split(X[k], cuts), p, times[k : k + 1])[lasting] * dae.displacement_scales
    scale = np.linalg.norm(G, axis=1, keepdims=True)
    U, sigma, _ = np.linalg.svd(G / np.where(scale > 0, scale, 1.0), full_matrices=False)
    share = np.zeros(dae.n_r)
    share[lasting] = np.abs(U[:, rank - 1])
    shares = {name: float(share[where].max()) for name, where in dae.rows.items()}
    # Smaller limits also name constraints that hardly take part in the vanishing combination of unit rows.
    names = tuple(name for name, share in shares.items() if share > 0.1)
    return Singularity(float(times[k]), float(sigma[rank - 1] / sigma[0]), names)


def _unit_rows(dae: DAE, _: Array) -> tuple[ca.Function, Mask]:
    """The Jacobian (n_r, n_v) in scales of displacements, with rows of norm 1 and rotations about the world's axes.

    Rotations about body axes give the same singular values, but with world axes a spinning wheel does not change the
    matrix. A function of x, p and t computes the entries row by row of its pattern.
    """
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    turned = ca.diag(ca.SX(ca.DM(dae.displacement_scales)))
    for i, name in enumerate(dae.q_names):
        if name.endswith(".e0"):
            k = dae.v_names.index(f"{name.removesuffix('e0')}omega_x")
            turned[k : k + 3, k : k + 3] = rotation_matrix(x[i : i + 4]).T
    rows = ca.sparsify(cast(ca.Function, dae.G)(*dae.arguments(x, p, t))[dae.lasting.tolist(), :] @ turned)
    lengths = ca.sqrt(ca.sum2(rows**2))
    rows = ca.diag(1 / ca.densify(lengths + (lengths == 0))) @ rows
    return ca.Function("unit_rows", [x, p, t], [rows.T]), pattern(rows.sparsity())


def _closest(dae: DAE, X: Array, p: Array, times: Array, rank: int) -> int | None:
    """Index of the state in X (m, n_x) at which unit rows are closest to dependent; None if no position is nearly
    singular.

    Singular values change at most by the norm of the change of the matrix (Weyl). The Frobenius norm is an upper bound
    of this norm. A matrix close to a matrix with known singular values is skipped if its ratio cannot be below the
    limit and below the smallest ratio so far.
    """
    rows, where = dae.remembered(_unit_rows)
    entries = nonzeros(rows, X, p, times[:, None]).T  # (n, m)
    squares = np.einsum("nm,nm->m", entries, entries)
    closest, smallest, count = None, _NEARLY_SINGULAR, 1
    rest: Indices = np.arange(len(X), dtype=np.intp)
    while len(rest):
        step = -(-len(rest) // count)
        asked = rest[::step]
        matrices = np.zeros((len(asked), *where.shape))
        matrices[:, where] = entries[:, asked].T
        least, largest = np.linalg.svd(matrices, compute_uv=False)[:, [rank - 1, 0]].T
        k = int((least / largest).argmin())
        if least[k] < smallest * largest[k]:
            closest, smallest = int(asked[k]), float(least[k] / largest[k])
        rest = np.delete(rest, slice(None, None, step))
        products = entries[:, rest].T @ entries[:, asked]
        # |a - b|^2 from products of all pairs: the differences themselves would need much more memory.
        apart = np.maximum(squares[rest, None] + squares[asked] - 2 * products, 0.0) + ROUNDING * len(matrices[0])
        distance = np.sqrt(apart)
        rest, count = rest[(least - distance < smallest * (largest + distance)).all(axis=1)], 2 * count
    return closest
