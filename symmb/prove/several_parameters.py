"""Bounds over a step for several parameters: Taylor models in the parameters at nodes of time.

Grids of nodes in all parameters have too many nodes, but polynomials of total degree have few terms. Defects are Taylor
models in the parameters at nodes of time. They are interpolated only in time. The largest value on an ellipse of time,
for all parameters of the box, bounds the error of this interpolation.
"""

import math
from functools import partial

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove import taylor_models as tm
from symmb.prove.basis import Basis, basis_of
from symmb.prove.discs import Disc
from symmb.prove.patches import cosh_powers
from symmb.prove.problem import Problem
from symmb.prove.rounding import ERROR_OF_MODULI, U, above
from symmb.prove.tape import Tape
from symmb.prove.taylor_models import Model
from symmb.prove.terms import at_nodes, monomials
from symmb.prove.time_step import TimeStep

_ADD, _SUBTRACT, _MULTIPLY = (tm.OPERATIONS[code] for code in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL))


def parameter_models(problem: Problem, basis: Basis) -> list[Model]:
    """Taylor models of the parameters. Their variables are the last ones of the basis."""
    first = basis.variables - problem.d
    errors = np.broadcast_to(problem.errors, problem.middle.shape)
    found = []
    for middle, radius, j, error in zip(problem.middle, problem.radius, problem.variables, errors, strict=True):
        has = j >= 0 and basis.weights[first + j] <= basis.degree
        c = np.zeros((basis.counts[basis.weights[first + j]] if has else 1, 1))
        c[0] = middle
        if has:
            c[basis.linear[first + j]] = radius
        left = radius if j >= 0 and not has else 0.0
        found.append(Model(c, above(np.full(1, float(error) + left)), basis))
    return found


def equations_at_nodes(step: TimeStep, count: int, basis: Basis) -> list[list[Model]]:
    """Taylor models of the states, the parameters and the time at nodes of time."""
    x = at_nodes(step.x.c, step.x.error, count, step.problem.basis(step.x.c.shape[2]), basis)
    t = step.t0 + 0.5 * step.h * (1.0 + ch.nodes(count))
    error = 4.0 * U * (abs(step.t0) + step.h) + step.h * ch.ENTRY_ERROR
    return [x, parameter_models(step.problem, basis), [Model(t[None], np.full(1, error), basis)]]


def places_in_step(step: TimeStep, times: Array, basis: Basis) -> Model:
    """Taylor model of the places of times (n_t,) in a step, from -1 to 1, by the clock of the problem."""
    problem, zero = step.problem, tm.constant(basis, 0.0)
    assert problem.clock_tape is not None
    ((rate,),) = run(problem.clock_tape, [[zero] * problem.n, parameter_models(problem, basis), [zero]])
    own = _MULTIPLY(Model(times[None], np.zeros(1), basis), rate.inverse)
    share = _MULTIPLY(_SUBTRACT(own, tm.constant(basis, step.t0)), tm.constant(basis, step.h).inverse)
    return _SUBTRACT(_MULTIPLY(tm.constant(basis, 2.0), share), tm.constant(basis, 1.0))


def motion_at(step: TimeStep, s: Model) -> tuple[list[Model], Model]:
    """Taylor models of the states and of the time at places s in a step."""
    source, one = step.problem.basis(step.x.c.shape[2]), tm.constant(s.basis, 1.0)
    own, lost = monomials(step.x.c, source, s.basis)
    twice, states = _MULTIPLY(tm.constant(s.basis, 2.0), s), []
    for c, errors, error in zip(own, lost, step.x.error, strict=True):
        errors = np.concatenate([[errors[0] + error], errors[1:]])
        after = last = tm.constant(s.basis, 0.0)
        for k in range(len(c) - 1, -1, -1):  # Clenshaw's recurrence
            term = Model(c[k][:, None], above(errors[k : k + 1]), s.basis)
            after, last = _ADD(term, _SUBTRACT(_MULTIPLY(twice if k else s, after), last)), after
        states.append(after)
    half = tm.constant(s.basis, 0.5 * step.h)
    return states, _ADD(tm.constant(s.basis, step.t0), _MULTIPLY(half, _ADD(one, s)))


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

    def models(self, c: Array, error: Array, source: Basis) -> list[Model]:
        """Taylor models of polynomials (q, K, S) with errors (q,) on the patches."""
        basis, size = self.basis, c.shape[1]
        of_parameters = basis_of(basis.weights[1:], basis.degree)
        own, lost = monomials(c, source, of_parameters)
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
    return tape.run(tm.OPERATIONS, partial(tm.constant, inputs[2][0].basis), inputs)


def on_step(step: TimeStep, tape: Tape, radius: Array | float = 0.0, rho: float = 1.0) -> list[list[Model]]:
    """Bounds of the outputs of a tape for complex times in an ellipse, and for all parameters.

    The states change by `radius` (n,) at most.
    """
    return run(tape, inputs_on_step(step, radius, rho))


def discs_on_motion(step: TimeStep, tape: Tape, e: Array, patches: tuple[int, int]) -> list[list[Disc]]:
    """Discs of the outputs of a tape, for all parameters and states within e (n,) of the motion."""
    if step.problem.weights:
        return [[a.disc for a in part] for part in on_step(step, tape, e)]
    return step.discs_of(tape, patches, e)


def inputs_on_step(step: TimeStep, radius: Array | float, rho: float) -> list[list[Model]]:
    """Taylor models of the states within a radius (n,), the parameters and the time on an ellipse of time."""
    basis, problem = basis_of((1,) * (step.problem.d + 1), 2), step.problem  # models of degree 2 on 16 patches
    patches = TimePatches(rho, 16, step.degrees[0], basis)
    x = patches.models(step.x.c, step.x.error_on([rho, 1.0]) + radius, problem.basis(step.x.c.shape[2]))
    c = np.array([[[step.t0 + 0.5 * step.h], [0.5 * step.h]]])
    t = patches.models(c, np.full(1, 2.0 * U * (abs(step.t0) + step.h)), problem.basis(1))
    return [x, parameter_models(step.problem, basis), t]
