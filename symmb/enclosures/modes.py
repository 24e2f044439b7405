"""Frequencies and damping of a scene at its start as a problem without motion, whose starting equations have modes.

A mode is an eigenvalue lambda and a vector v of the Jacobian J of the equations of motion at the start:

    J v = lambda v,   c' v = 1,

where c is that of the nominal mode. Rows of loops add eigenvalues 0 alone, those of positions off the rows. A simple
mode has one such solution close to it. So the proof of the starting equations follows it over the box.
"""

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.enclosures.independent_velocities import Equations
from symmb.enclosures.problem import StartEquations
from symmb.symbolic import batch, common


def with_modes(
    start: StartEquations, equations: Equations, sizes: Array, modes: Array, p: Array, t: float
) -> StartEquations:
    """Starting equations whose states are 1 + a and b (2 m,) of eigenvalues a + i b, as shares of the sizes of modes.

    Parameters
    ----------
    start : of the states
    sizes : (n_x,) of the states
    modes : (m,) nominal eigenvalues [1/s]
    p, t : nominal parameters (n_p,) and time [s]
    """
    x, P, time = (ca.SX.sym(name, equations.rates.numel_in(i)) for i, name in enumerate("xpt"))
    scaled = ca.diag(1 / sizes) @ ca.jacobian(equations.rates(x, P, time), x) @ ca.diag(sizes)
    jacobian = common("jacobian", [x, P, time], [ca.densify(scaled)])
    n, n_u = len(sizes), start.residual.numel_in(0)

    def matrices(u: Array, samples: Array) -> Array:
        states = batch(start.states, u, samples)[0]
        return batch(jacobian, states, samples, np.full((len(u), 1), t))[0]

    nominal = p[None]
    values, vectors = np.linalg.eig(matrices(start.solve(nominal), nominal)[0])
    own = [int(np.abs(values - mode).argmin()) for mode in modes]
    shapes = vectors[:, own] / np.linalg.norm(vectors[:, own], axis=0)

    def solve(samples: Array) -> Array:
        u = start.solve(samples)
        A = matrices(u, samples)
        A[np.isnan(u).any(axis=1)] = 0.0
        values, vectors = np.linalg.eig(A)
        parts = [u]
        for shape, mode in zip(shapes.T, modes, strict=True):
            overlaps = shape.conj() @ vectors  # (N, n)
            best = np.abs(overlaps).argmax(axis=1)
            rows = np.arange(len(u))
            v, share = vectors[rows, :, best] / overlaps[rows, best][:, None], values[rows, best] / np.abs(mode)
            parts += [v.real, v.imag, share.real[:, None], share.imag[:, None]]
        return np.concatenate(parts, axis=1)

    unknowns = ca.SX.sym("u", n_u + (2 * n + 2) * len(modes))
    u, *blocks = ca.vertsplit(unknowns, [0, *range(n_u, unknowns.numel() + 1, 2 * n + 2)])
    J = jacobian(start.states(u, P, time), P, time)
    rows, shares = [start.residual(u, P, time)], []
    for block, shape, mode in zip(blocks, shapes.T, modes, strict=True):
        real, imag, a, b = ca.vertsplit(block, [0, n, 2 * n, 2 * n + 1, 2 * n + 2])
        size = float(np.abs(mode))
        rows += [
            J @ real / size - a * real + b * imag,
            J @ imag / size - a * imag - b * real,
            ca.dot(shape.real, real) + ca.dot(shape.imag, imag) - 1,
            ca.dot(shape.real, imag) - ca.dot(shape.imag, real),
        ]
        shares += [1 + a, b]  # damping is small beside critical damping: its rounding is no looseness
    arguments = [unknowns, P, time]
    return StartEquations(
        common("residual", arguments, [ca.densify(ca.vertcat(*rows))]),
        common("states", arguments, [ca.densify(ca.vertcat(*shares))]),
        solve,
        "frequencies may cross or come close to each other",
    )
