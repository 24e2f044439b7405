"""Frames for stiff steps, in which some deviations decay much faster than the motion changes.

The columns of the frame V are eigenvectors of the Jacobian in the middle of the step. They are constant, and w' = L w +
V^-1 (A V - V L) w + ... with the diagonal matrix L of negative rates. Deviations in fast directions thus decay, and the
length of a step is not limited by the fastest rate.

Source: Dahlquist (1959), logarithmic norms; Hairer and Wanner (1996), Solving Ordinary Differential Equations II,
sections I.10 and IV.12.
"""

import numpy as np

from symmb._types import Array
from symmb.prove.points import PLAIN, plain
from symmb.prove.problem import Problem

_FAST = 5.0
"""A step is stiff if a deviation decays by the exponential of this number."""


def jacobian(problem: Problem, x: Array, t: float) -> Array:
    """The Jacobian (n, n) of the rates at a state, in the middle of the box."""
    found = problem.jacobian_tape.run(PLAIN, plain, [list(x), [float(middle) for middle in problem.middle], [t]])[1]
    return np.array(found, dtype=float).reshape(problem.n, problem.n).T


def is_stiff(A: Array, h: float) -> bool:
    """Whether deviations decay much in a step h [s]."""
    return bool(np.isfinite(A).all() and len(A) and np.linalg.eigvals(A).real.min() * h < -_FAST)


def decaying(A: Array, scales: Array) -> tuple[Array, Array]:
    """The eigenvectors (n, n) of a Jacobian, as real columns, and the rates (n,) of decay, at most 0.

    Entries have 24 bits, so that the products of a column and its rate are exact.
    """
    values, vectors = map(np.asarray, np.linalg.eig(A * scales / scales[:, None]))
    # a pair of complex vectors has real and imaginary parts as its columns
    V = np.where(np.imag(values) < 0, np.imag(vectors), np.real(vectors))
    V = scales[:, None] * V / np.linalg.norm(V, axis=0)
    return V.astype(np.float32).astype(float), np.minimum(np.real(values), 0.0).astype(np.float32).astype(float)
