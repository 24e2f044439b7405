"""Stiffness of a motion, from eigenvalues of its linearisation along a run, for the choice of the solver."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.declare.symbolic import batch, pattern
from symmb.equations.model import DAE
from symmb.run.integrate.initial_value_problem import build_problem

STIFF = 2e3
"""A motion is stiff if its horizon has more of its shortest time constants. An explicit step covers about one."""


@dataclass(frozen=True)
class Stiffness:
    """The fastest rates of linearised motions.

    Attributes
    ----------
    decay : float            largest rate of decay [1/s]
    growth : float           largest rate of growth [1/s]
    frequency : float        largest angular frequency [rad/s]
    """

    decay: float
    growth: float
    frequency: float

    @property
    def rate(self) -> float:
        """The rate [1/s] that limits the step of explicit methods. The step times the rate must be below about 3."""
        return max(self.decay, self.frequency)

    def is_stiff(self, span: float, most: float = STIFF) -> bool:
        """Whether the decay has more than `most` time constants in a `span` [s], so that steps should not resolve it.

        Near an unstable position, some motions decay as fast as others grow. Steps must resolve this growth.
        """
        return self.decay * span > most and self.decay > 10 * self.growth


def some_states(n: int) -> Indices:
    """Numbers of five of the n states of a run, for an estimate of the stiffness."""
    return np.unique(np.linspace(0, n - 1, 5).astype(np.intp))


def stiffness(dae: DAE, X: Array, p: Array, times: Array) -> Stiffness:
    """The stiffness of x' = f(x, p, t) with parameters p (n_p,), from Jacobians at states X (m, n_x) and times (m,)."""
    decay = growth = frequency = 0.0
    for state, time in zip(X, times, strict=True) if X.size else ():
        eigenvalues = dae.remembered(_Linearization).eigenvalues(state, p, np.array([time]))
        if np.isfinite(eigenvalues).all():
            decay = max(decay, float(-eigenvalues.real.min()))
            growth = max(growth, float(eigenvalues.real.max()))
            frequency = max(frequency, float(np.abs(eigenvalues.imag).max()))
    return Stiffness(decay, growth, frequency)


class _Linearization:
    """The Jacobian of x' = f(x, p, t), from Jacobians of the sparse equations with the multipliers as unknowns z.

    Columns of these Jacobians that have no entries in common rows are computed together, as for different bodies.
    """

    def __init__(self, dae: DAE, _: Array) -> None:
        problem = build_problem(dae, None, algebraic=True, work=False)
        x, z, at = problem.x, problem.z, [problem.x, problem.z, problem.p, problem.t]
        dx, dz, values = ca.SX.sym("dx", x.numel()), ca.SX.sym("dz", z.numel()), ca.vertcat(problem.ode, problem.alg)
        self._z = ca.Function("z", [x, problem.p, problem.t], [problem.z_guess])
        change = ca.jtimes(values, ca.vertcat(x, z), ca.vertcat(dx, dz))
        self._along = ca.Function("along", [*at, dx, dz], [ca.densify(change)])
        f = ca.Function("values", at, [values])
        entries = ca.horzcat(f.jac_sparsity(0, 0), f.jac_sparsity(0, 1))
        colours = entries.uni_coloring()
        self._rows, self._columns = np.array(entries.get_triplet(), dtype=np.intp)
        self._seeds = pattern(colours).T.astype(float)  # (colours, n_x + n_z)
        self._colours = self._seeds.argmax(axis=0)[self._columns]

    def eigenvalues(self, x: Array, p: Array, t: Array) -> Array:
        """Eigenvalues of the Jacobian at a state x (n_x,), of large systems only the largest; nan without Jacobian."""
        n = len(x)
        (z,) = batch(self._z, x, p, t)
        (changes,) = batch(self._along, x, z[0], p, t, self._seeds[:, :n], self._seeds[:, n:])
        values = changes.reshape(len(self._seeds), -1)[self._colours, self._rows]
        # Number of states up to which all eigenvalues are computed. All eigenvalues take n^3 operations, a minute for
        # 3,000 states.
        return self._every(n, values) if n <= 600 else self._largest(n, values)

    def _every(self, n: int, values: Array) -> Array:
        """All eigenvalues, from dense matrices: SciPy's import takes longer than the runs of a small scene."""
        J = np.zeros((self._seeds.shape[1],) * 2)
        J[self._rows, self._columns] = values
        A, B, C, D = (np.ascontiguousarray(part) for part in (J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:]))
        try:
            full = A - B @ np.linalg.solve(D, C)
            return np.linalg.eigvals(full) if np.isfinite(full).all() else np.full(n, np.nan)  # pyright: ignore[reportReturnType]
        except np.linalg.LinAlgError:
            return np.full(n, np.nan)

    def _largest(self, n: int, values: Array) -> Array:
        """Some of the largest eigenvalues, with a relative error of a hundredth."""
        from scipy import sparse

        J = sparse.csc_array((values, (self._rows, self._columns)), shape=(self._seeds.shape[1],) * 2)
        A, B, C, D = J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:]
        try:
            solved = sparse.linalg.splu(D).solve if D.shape[0] else np.copy
            operator = sparse.linalg.LinearOperator((n, n), lambda v: A @ v - B @ solved(C @ v), dtype=float)
            return sparse.linalg.eigs(operator, k=6, tol=1e-2, return_eigenvectors=False)
        except (np.linalg.LinAlgError, sparse.linalg.ArpackError, RuntimeError):
            return np.full(n, np.nan)
