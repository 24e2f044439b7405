"""Frequencies, damping and stability limits as problems without motion. Their starting equations contain eigenvectors.

A mode is an eigenvalue lambda and an eigenvector v of the Jacobian J of the equations of motion at the start:

    J v = lambda v,   c' v = 1,

Here c is the eigenvector of the nominal mode. Rows of loops add only eigenvalues 0. Near a simple mode there is one
solution. The proof of the starting equations thus follows the mode over the box.

At a stability limit, lambda is imaginary or 0. The critical parameter replaces its real part as an unknown.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._types import Array
from symmb.declare.symbolic import batch, common
from symmb.prove.independent_velocities import Equations
from symmb.prove.problem import StartEquations

_SAME_EIGENVALUE = 1e-5
"""Largest relative distance of equal eigenvalues: double eigenvalues have errors of the square root of rounding."""
_ZERO_SINGULAR_VALUE = 1e-7
"""A smaller singular value, relative to the largest one, counts as 0, because critical parameters are rounded."""


@dataclass(frozen=True, eq=False)
class LinearStart:
    """The start of a scene, and the Jacobian of its equations there.

    Attributes
    ----------
    start : starting equations of the states
    equations : equations of motion
    sizes : (n_x,) sizes of the states
    t : time of the start [s]
    """

    start: StartEquations
    equations: Equations
    sizes: Array
    t: float

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, p, t) -> Jacobian (n_x, n_x) of the rates, scaled by the sizes of the states [1/s]."""
        rates = self.equations.rates
        x, p, t = rates.sx_in()
        scaled = ca.diag(1 / self.sizes) @ ca.jacobian(rates(x, p, t), x) @ ca.diag(self.sizes)
        return common("jacobian", [x, p, t], [ca.densify(scaled)])

    def solved(self, P: Array) -> tuple[Array, Array]:
        """Approximate unknowns (N, n_u) of the start, and Jacobians (N, n_x, n_x), for parameters P (N, n_p)."""
        u = self.start.solve(P)
        states = batch(self.start.states, u, P)[0]
        A = batch(self.jacobian, states, P, np.full((len(u), 1), self.t))[0]
        A[np.isnan(u).any(axis=1)] = 0.0
        return u, A

    def at(self, u: ca.SX, p: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Residual (n_u,) of the start, and the Jacobian, as expressions."""
        return self.start.residual(u, p, t), self.jacobian(self.start.states(u, p, t), p, t)

    def has(self, P: Array, eigenvalues: Sequence[Array]) -> bool:
        """Whether the Jacobians have the given eigenvalues at parameters P (N, n_p).

        If a motion is steady only in rotating coordinates, its Jacobian has other eigenvalues.
        """
        own = np.linalg.eigvals(self.solved(P)[1])  # (N, n_x)
        return all(
            (np.abs(some[:, None] - values).min(axis=1) <= _SAME_EIGENVALUE * np.abs(values).max()).all()
            for some, values in zip(eigenvalues, own, strict=True)
        )


def with_modes(linear: LinearStart, modes: Array, p: Array) -> StartEquations:
    """Starting equations with the states 1 + a and b (2 m,). a + i b is an eigenvalue, divided by its nominal modulus.

    Parameters
    ----------
    linear : start and Jacobian
    modes : (m,) nominal eigenvalues [1/s]
    p : (n_p,) nominal parameters
    """
    n = len(linear.sizes)
    u, A = linear.solved(p[None])
    values, vectors = np.linalg.eig(A[0])
    own = [int(np.abs(values - mode).argmin()) for mode in modes]
    shapes = list((vectors[:, own] / np.linalg.norm(vectors[:, own], axis=0)).T)
    sizes = np.abs(modes).tolist()
    nominal = [u[0]]
    for shape, share in zip(shapes, values[own] / sizes, strict=True):
        nominal += [shape.real, shape.imag, [share.real, share.imag]]

    def equations(p: ca.SX, t: ca.SX, u: ca.SX, *blocks: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
        residual, J = linear.at(u, p, t)
        rows, shares = [residual], []
        for block, shape, size in zip(blocks, shapes, sizes, strict=True):
            real, imag, a, b = ca.vertsplit(block, [0, n, 2 * n, 2 * n + 1, 2 * n + 2])
            rows += _rows_of_mode(J / size, shape, real, imag, a, b)
            shares += [1 + a, b]  # so errors of a are compared with critical damping
        return rows, shares

    blocks = [len(u[0]), *[2 * n + 2] * len(modes)]
    return _start_equations(
        linear, equations, blocks, np.concatenate(nominal), p, "frequencies may cross or come close to each other"
    )


def with_limits(linear: LinearStart, number: int, width: float, values: Array, p: Array) -> StartEquations:
    """Starting equations with the critical values (m,) of a parameter, minus the nominal ones, as states.

    Parameters
    ----------
    linear : start and Jacobian
    number : position of the parameter among all parameters
    width : width of the range of the parameter, which is the unit of the states
    values : (m,) nominal critical values
    p : (n_p - 1,) nominal values of the other parameters

    Raises
    ------
    ValueError         if an eigenvalue at a limit is not simple
    """
    n, n_u = len(linear.sizes), linear.start.residual.numel_in(0)
    nominal, shapes = [], []
    for value in values:
        u, A = linear.solved(np.insert(p, number, value)[None])
        shape, size, oscillates = _critical_shape(A[0])
        shapes.append((float(value), shape, size, oscillates))
        nominal += [u[0], [0.0], shape.real, *([shape.imag, [1.0]] if oscillates else [])]

    def equations(p: ca.SX, t: ca.SX, *blocks: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
        rows, states = [], []
        for block, (value, shape, size, oscillates) in zip(blocks, shapes, strict=True):
            u, m, vector = ca.vertsplit(block, [0, n_u, n_u + 1, block.numel()])
            others = ca.vertsplit(p)
            others.insert(number, value + width * m)
            residual, J = linear.at(u, ca.vertcat(*others), t)
            rows.append(residual)
            states.append(m)
            if oscillates:
                real, imag, b = ca.vertsplit(vector, [0, n, 2 * n, 2 * n + 1])
                rows += _rows_of_mode(J / size, shape, real, imag, ca.SX(0), b)
            else:
                rows += [J @ vector / size, ca.dot(shape, vector) - 1]
        return rows, states

    blocks = [n_u + 1 + (2 * n + 1 if oscillates else n) for *_, oscillates in shapes]
    return _start_equations(linear, equations, blocks, np.concatenate(nominal), p, "two critical values may be equal")


def _continued(residual: ca.Function, nominal: Array, p: Array, t: float, samples: Array) -> Array:
    """Approximate solutions u (N, n) of the residual at samples (N, n_p), continued from the nominal solution.

    The path from the nominal parameters to a sample has eight parts, so Newton's method stays on the same mode.
    """
    arguments = residual.sx_in()
    rows = residual(*arguments)
    both = common("newton", arguments, [rows, ca.densify(ca.jacobian(rows, arguments[0]))])
    u = np.tile(nominal, (len(samples), 1))
    for share in np.linspace(0, 1, 9)[1:]:
        for _ in range(4):  # iterations of Newton's method
            r, J = batch(both, u, p + share * (samples - p), np.full((len(u), 1), t))
            try:
                u = u - np.linalg.solve(J, r[..., None])[..., 0]
            except np.linalg.LinAlgError:  # the proof of the start then fails
                return u
    return u


def _critical_shape(A: Array) -> tuple[Array, float, bool]:
    """The eigenvector (n,) of A (n, n) with an imaginary or zero eigenvalue, a scale, and whether it oscillates.

    ValueError if there is no such eigenvalue, or more than one.
    """
    _, sizes, vectors = np.linalg.svd(A)
    none = int(np.count_nonzero(sizes <= _ZERO_SINGULAR_VALUE * sizes[0]))
    if none == 1:
        return vectors[-1], float(sizes[0]), False
    values, complex_vectors = np.linalg.eig(A)
    on_axis = (np.abs(np.real(values)) <= SLIGHT * np.abs(values).max()) & (np.imag(values) > 0)
    if none or np.count_nonzero(on_axis) != 1:
        raise ValueError
    k = int(on_axis.argmax())
    vector: Any = complex_vectors[:, k]
    return vector / np.linalg.norm(vector), float(values[k].imag), True


def _rows_of_mode(J: ca.SX, shape: Array, real: ca.SX, imag: ca.SX, a: ca.SX, b: ca.SX) -> list[ca.SX]:
    """Real and imaginary parts of the equations J v = (a + i b) v and c' v = 1."""
    return [
        J @ real - a * real + b * imag,
        J @ imag - a * imag - b * real,
        ca.dot(np.real(shape), real) + ca.dot(np.imag(shape), imag) - 1,
        ca.dot(np.real(shape), imag) - ca.dot(np.imag(shape), real),
    ]


def _start_equations(
    linear: LinearStart,
    equations: Callable[..., tuple[list[ca.SX], list[ca.SX]]],
    sizes: Sequence[int],
    nominal: Array,
    p: Array,
    unproved: str,
) -> StartEquations:
    """Starting equations from a function (p, t, *blocks) -> residuals, states. Blocks are parts of the unknowns."""
    arguments = ca.SX.sym("u", int(sum(sizes))), ca.SX.sym("p", len(p)), ca.SX.sym("t")
    u, *others = arguments
    rows, states = equations(*others, *ca.vertsplit(u, [0, *np.cumsum(sizes).tolist()]))
    residual = common("residual", [*arguments], [ca.densify(ca.vertcat(*rows))])
    solve = partial(_continued, residual, nominal, p, linear.t)
    return StartEquations(residual, common("states", [*arguments], [ca.densify(ca.vertcat(*states))]), solve, unproved)
