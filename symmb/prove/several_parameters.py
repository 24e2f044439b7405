"""Bounds over a step for several parameters: Taylor models in the parameters at nodes of time.

Grids of nodes in all parameters have too many nodes, but polynomials of total degree have few terms. Defects are Taylor
models in the parameters at nodes of time. They are interpolated only in time. The largest value on an ellipse of time,
for all parameters of the box, bounds the error of this interpolation.
"""

import math

import numpy as np
from numpy.polynomial.chebyshev import cheb2poly

from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove import taylor_models as tm
from symmb.prove.patches import cosh_powers
from symmb.prove.rounding import ERROR_OF_MODULI, U, above, of_sum
from symmb.prove.tape import Tape
from symmb.prove.taylor_models import Basis, Model, basis_of
from symmb.prove.time_step import TimeStep


def _to_monomials(n: int) -> Array:
    """(n, n) matrix from coefficients of T_0, ..., T_(n - 1) to those of powers. Its entries are integers."""
    matrix = np.zeros((n, n))
    for k in range(n):
        matrix[: k + 1, k] = cheb2poly(np.eye(k + 1)[k])
    return matrix


def monomials(c: Array, basis: Basis) -> tuple[Array, Array]:
    """Coefficients (..., T) of the monomials of polynomials (..., n1, ..., nd), and bounds (...) of missing terms."""
    d = basis.variables
    first, lengths = c.ndim - d, c.shape[c.ndim - d :]
    matrices = [_to_monomials(n) for n in lengths]
    own, sizes = ch.along(matrices, c), ch.along([np.abs(matrix) for matrix in matrices], np.abs(c))
    lost = sizes.sum(axis=tuple(range(first, c.ndim))) * of_sum(sum(lengths) + 2)
    fits = (basis.exponents < np.array(lengths)).all(axis=1)
    there = tuple(basis.exponents[fits].T)
    found = np.zeros((*c.shape[:first], len(basis.exponents)))
    found[..., fits] = own[(..., *there)]
    left = np.abs(own)
    left[(..., *there)] = 0.0
    return found, above(lost + left.sum(axis=tuple(range(first, c.ndim))))


def at_nodes(c: Array, error: Array, count: int, basis: Basis) -> list[Model]:
    """Taylor models, in the parameters, of polynomials (q, K, n1, ..., nd) with errors (q,) at nodes of time.

    Constant terms are added last, so that they have the rounding error of only one sum.
    """
    found, lost = monomials(c, basis)
    constant = found[:, 0, 0].copy()
    found[:, 0, 0] = 0.0
    matrix = ch.values_at_nodes(count, c.shape[1])
    rest = np.abs(found).sum(axis=(1, 2))
    values = np.einsum("mk,qkt->qtm", matrix, found, optimize=True)
    values[:, 0] += constant[:, None]
    radius = above(lost.sum(axis=1) + rest * ch.rounding_of([c.shape[1]]) + U * (np.abs(constant) + rest) + error)
    return [Model(own, np.full(1, r), basis) for own, r in zip(values, radius, strict=True)]


def parameter_models(step: TimeStep, basis: Basis) -> list[Model]:
    """Taylor models of the parameters. Their variables are the last ones of the basis."""
    problem, first = step.problem, basis.variables - step.problem.d
    errors = np.broadcast_to(problem.errors, problem.middle.shape)
    found = []
    for middle, radius, j, error in zip(problem.middle, problem.radius, problem.variables, errors, strict=True):
        c = np.zeros((1 if j < 0 else basis.counts[1], 1))
        c[0] = middle
        if j >= 0:
            c[basis.places(np.eye(basis.variables, dtype=np.intp)[first + j][None])] = radius
        found.append(Model(c, above(np.full(1, float(error))), basis))
    return found


def equations_at_nodes(step: TimeStep, count: int, basis: Basis) -> list[list[Model]]:
    """Taylor models of the states, the parameters and the time at nodes of time."""
    x = at_nodes(step.x.c, step.x.error, count, basis)
    t = step.t0 + 0.5 * step.h * (1.0 + ch.nodes(count))
    error = 4.0 * U * (abs(step.t0) + step.h) + step.h * ch.ENTRY_ERROR
    return [x, parameter_models(step, basis), [Model(t[None], np.full(1, error), basis)]]


class TimePatches:
    """Patches of the boundary of an ellipse of time, with T_k there as Taylor polynomials of the place in a patch.

    Values at conjugate points are conjugate, so half the ellipse is enough. If rho is 1, the time is real.
    """

    def __init__(self, rho: float, count: int, degree: int, basis: Basis) -> None:
        self.basis = basis
        k, n = np.arange(degree + 1), basis.degree
        angles = (np.arange(count) + 0.5) * math.pi / count
        turn, top = k * (0.5 * math.pi / count), cosh_powers(rho, degree + 1)
        there, back = (0.5 * np.exp(sign * k * math.log(rho)) * np.exp(sign * 1j * np.outer(angles, k))
                       for sign in (1, -1))  # fmt: skip
        is_small = turn < 1.0
        small = np.where(is_small, turn, 0.0)
        factors = [(1j * small) ** m / math.factorial(m) * (there + (-1) ** m * back) for m in range(n + 1)]
        self._factors = [factor.real if rho == 1.0 else factor for factor in factors]
        self._sizes = [above(small**m / math.factorial(m) * top) for m in range(n + 1)]
        self._rest = above(np.where(is_small, turn ** (n + 1) / math.factorial(n + 1), np.minimum(2.0, turn)) * top)

    def models(self, c: Array, error: Array) -> list[Model]:
        """Taylor models of polynomials (q, K, n1, ..., nd) with errors (q,) on the patches."""
        basis, d = self.basis, c.ndim - 2
        of_parameters, size = basis_of(d, basis.degree), c.shape[1]
        own, lost = monomials(c, of_parameters)
        modulus = np.abs(own)
        found = np.zeros((len(c), basis.counts[-1], len(self._factors[0])), dtype=self._factors[0].dtype)
        whole = modulus.sum(axis=2) + lost
        sizes = np.sum(self._sizes, axis=0)[:size]
        radius = whole @ self._rest[:size] + lost @ sizes + error
        for m, (factor, most) in enumerate(zip(self._factors, self._sizes, strict=True)):
            count = of_parameters.counts[basis.degree - m]
            exponents = np.column_stack([np.full(count, m), of_parameters.exponents[:count]])
            found[:, basis.places(exponents)] = np.einsum("pk,qkt->qtp", factor[:, :size], own[..., :count])
            radius = radius + modulus[..., count:].sum(axis=2) @ most[:size]
        radius = above(radius + ERROR_OF_MODULI * (modulus.sum(axis=2) @ sizes))
        return [Model(values, np.full(1, r), basis) for values, r in zip(found, radius, strict=True)]


def run(tape: Tape, inputs: list[list[Model]]) -> list[list[Model]]:
    """The outputs of a tape for Taylor models."""
    return tape.run(tm.OPERATIONS, inputs[2][0].basis.constant, inputs)


def on_step(step: TimeStep, tape: Tape, radius: Array | float = 0.0, rho: float = 1.0) -> list[list[Model]]:
    """Bounds of the outputs of a tape for complex times in an ellipse, and for all parameters.

    The states change by `radius` (n,) at most.
    """
    return run(tape, inputs_on_step(step, radius, rho))


def inputs_on_step(step: TimeStep, radius: Array | float, rho: float) -> list[list[Model]]:
    """Taylor models of the states within a radius (n,), the parameters and the time on an ellipse of time."""
    basis, d = basis_of(step.problem.d + 1, 2), step.problem.d  # models of degree 2 on 16 patches
    patches = TimePatches(rho, 16, step.degrees[0], basis)
    x = patches.models(step.x.c, step.x.error_on([rho, *[1.0] * d]) + radius)
    c = np.zeros((1, 2, *(1,) * d))
    c[0, 0], c[0, 1] = step.t0 + 0.5 * step.h, 0.5 * step.h
    t = patches.models(c, np.full(1, 2.0 * U * (abs(step.t0) + step.h)))
    return [x, parameter_models(step, basis), t]
