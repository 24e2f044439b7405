"""The state-space method: independent coordinates are integrated, the others follow from the constraints."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.codegen import REASONS, FailureCode
from symmb.events import longest_step
from symmb.integrate.initial_value_problem import build_problem
from symmb.integrate.integration import Integration, RunAdvance, stateless_integration
from symmb.integrate.side_walk import Stops
from symmb.integrate.solver import Solver
from symmb.integrate.switch_passes import SwitchPasses
from symmb.model import DAE
from symmb.schemes import MOST_STEPS
from symmb.start import independent_rows_and_columns
from symmb.symbolic import batch, common


@dataclass(frozen=True, repr=False)
class StateSpace(Solver):
    """Coordinate partitioning: pair of Dormand and Prince in independent coordinates, Newton's method for the others.

    The independent coordinates are chosen anew when they no longer determine the others well. Samples run in Python one
    after the other: the method is for checks, not for speed.

    Parameters
    ----------
    rtol, atol : float
        as of `CVODES`

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0)
    >>> scene = mb.Scene(mb.System(bob, spring), {"bob.x": 1.0}, [0.0, 1.0, 2.0])
    >>> mb.simulate(scene, mb.StateSpace())["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])

    References
    ----------
    Wehage, Haug (1982), Journal of Mechanical Design 104, 247-255.
    """

    keeps_positions: ClassVar[bool] = True
    gives_derivatives: ClassVar[bool] = False

    rtol: float = 1e-8
    atol: float | None = None

    def has_dense_output(self, dae: DAE) -> bool:
        return True

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        if not dae.n_v + dae.n_s:
            return stateless_integration(dae, times)
        return _Partitioned(self, dae, times, work)


_WORSE = 1.5
"""Growth of the condition number of the dependent coordinates after which they are chosen anew. Errors grow with it: a
spatial mechanism is solved 20 to 50 times less accurately with 3 to 100, in up to twice as many steps."""


class _Partitioned(Integration):
    """Runs by SciPy's DOP853, one sample after the other."""

    def __init__(self, solver: StateSpace, dae: DAE, times: Array, work: bool) -> None:
        problem = build_problem(dae, None, algebraic=False, work=work)
        n_x, n_quad = problem.x.numel(), problem.quad.numel()
        guess = ca.Function("guess", [problem.x, problem.p, problem.t], [ca.SX(0, 1)])
        stops, samples = SwitchPasses(dae, times, solver.rtol).stops, dae.sampling is not None
        super().__init__(times, n_x, n_quad, None, None, guess, problem.projection(), stops=stops, samples=samples)
        self._rates = common(
            "rates", [problem.x, problem.p, problem.t], [ca.densify(ca.vertcat(problem.ode, problem.quad))]
        )
        self._constraints, tolerances = _Constraints(dae), solver.tolerances(dae, n_quad=n_quad)
        atol = tolerances.absolute(n_x + n_quad)
        self._options = {"rtol": tolerances.rtol, "atol": atol, "max_step": longest_step(dae, times)}

    def _pieces(self, p: Array, stops: Stops) -> RunAdvance:
        path = _Path(self._constraints, self._rates, p, self._options, self._statistics)
        least, last = 1e-3 * float(np.ptp(self.times)), float(self.times[-1])

        def piece(begin: float, end: float, x: Array) -> tuple[Array, Array]:
            stop = float(stops.times[stops.times > begin].min(initial=np.inf))
            until = last if stop > last else stop - 4 * float(np.spacing(max(abs(stop), least)))
            try:
                return path.advance(begin, end, max(until, end), x)
            except KeyboardInterrupt:  # the base class keeps what is known, and raises it again
                raise RuntimeError("interrupted") from None

        return piece


class _Path:
    """One sample's motion from stop to stop. Its steps go on over output times, at which states are interpolated."""

    def __init__(
        self, constraints: "_Constraints", rates: ca.Function, p: Array, options: dict[str, Any], counts: Counter[str]
    ) -> None:
        self._constraints, self._rates, self._p, self._options = constraints, rates, p, options
        self._counts, self._n = counts, rates.numel_in(0)
        self._until = -np.inf

    def advance(self, begin: float, end: float, until: float, x: Array) -> tuple[Array, Array]:
        """The state at the end of a piece, and the integrals over it. The next stop is not before a time [s]."""
        if begin > self._until:
            self._until, self._integrals = until, np.zeros(self._rates.numel_out(0) - self._n)
            self._begin(begin, np.concatenate([x, self._integrals]))
        end = min(end, self._until)  # pieces end at a stop but for its rounding
        while self._reached < end:
            self._step(end)
        y, before = self._interpolant(end), self._integrals
        self._integrals = y[self._n :]
        return self._completed(y[: self._n], end), self._integrals - before

    def _begin(self, t: float, y: Array) -> None:
        """Choose independent coordinates, and begin steps in them."""
        from scipy.integrate import DOP853

        self._dependent, self._first_condition = self._constraints.dependent(y[: self._n], self._p, t), np.inf
        self._counts["choices of coordinates"] += 1
        self._reached, self._steps = t, DOP853(self._slopes, t, y, self._until, **self._options)

    def _step(self, end: float) -> None:
        steps = self._steps
        if steps.step() is not None:
            raise RuntimeError(REASONS[FailureCode.STEPS])
        self._counts["steps"] += 1
        if self._counts["steps"] > MOST_STEPS:
            raise RuntimeError(REASONS[FailureCode.MANY])
        self._reached = steps.t
        if steps.t >= end:
            self._interpolant = steps.dense_output()
        if steps.t < self._until:
            x = self._completed(steps.y[: self._n], steps.t)
            condition = self._constraints.condition(x, self._p, steps.t, self._dependent)
            self._first_condition = min(self._first_condition, condition)
            if condition > _WORSE * self._first_condition:
                self._begin(steps.t, np.concatenate([x, steps.y[self._n :]]))

    def _slopes(self, t: float, y: Array) -> Array:
        """Rates at the state whose dependent part follows from the constraints; nan where that is not determined."""
        try:
            x = self._completed(y[: self._n], t)
        except np.linalg.LinAlgError:
            return np.full(len(y), np.nan)
        return batch(self._rates, x, self._p, np.array([t]))[0][0]

    def _completed(self, x: Array, t: float) -> Array:
        return self._constraints.completed(x, self._p, t, self._dependent)


class _Constraints:
    """The constraints of one sample at states x (n_x,), parameters p (n_p,) and a time."""

    def __init__(self, dae: DAE) -> None:
        self._dae = dae
        x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        delta = ca.SX.sym("delta", dae.n_v)
        there = ca.vertcat(dae.retract(x[: dae.n_q, :], delta), x[dae.n_q :, :])
        at = dae.arguments(there, p, t)
        rows = [ca.SX(0, 1) if f is None else f(*at) for f in (dae.Phi, dae.Phi_dot)]
        G = ca.SX(0, dae.n_v) if dae.G is None else dae.G(*at)
        self._moved = common("moved", [x, delta, p, t], [ca.densify(e) for e in (there, *rows, G)])

    def dependent(self, x: Array, p: Array, t: float) -> Indices:
        """Numbers of the velocities that are chosen as dependent, as many as rows."""
        *_, G = self._at(x, p, t)
        return independent_rows_and_columns(G * self._dae.displacement_scales, rank=self._dae.rank)[1]

    def condition(self, x: Array, p: Array, t: float, dependent: Indices) -> float:
        """Condition number of the matrix that determines the dependent velocities."""
        *_, G = self._at(x, p, t)
        G = (G * self._dae.displacement_scales)[:, dependent]
        return float(np.linalg.cond(G / np.linalg.norm(G, axis=1, keepdims=True))) if G.size else 0.0

    def completed(self, x: Array, p: Array, t: float, dependent: Indices) -> Array:
        """x with its dependent coordinates and velocities moved onto the constraints."""
        dae = self._dae
        if dae.Phi_dot is None:
            return x
        x, Phi, Phi_dot, G = self._at(x, p, t)
        for _ in range(8 if dae.n_c else 0):
            delta = np.zeros(dae.n_v)
            delta[dependent] = np.linalg.lstsq(G[: dae.n_c, dependent], -Phi, rcond=None)[0]
            x, Phi, Phi_dot, G = self._at(x, p, t, delta)
            if np.abs(delta / dae.displacement_scales).max() < 1e-9:  # Newton is quadratic
                break
        G = G[:, dependent]
        solved = np.linalg.solve(G, Phi_dot) if dae.vanishing is None else np.linalg.lstsq(G, Phi_dot, rcond=None)[0]
        x[dae.n_q + dependent] -= solved
        return x

    def _at(self, x: Array, p: Array, t: float, delta: Array | float = 0.0) -> tuple[Array, Array, Array, Array]:
        """x moved by displacements delta (n_v,), and there Phi (n_c,), Phi_dot (n_r,) and G (n_r, n_v)."""
        delta = np.broadcast_to(delta, self._dae.n_v)
        there, Phi, Phi_dot, G = (value[0] for value in batch(self._moved, x, delta, p, np.array([t])))
        return there, Phi, Phi_dot, G.reshape(len(Phi_dot), self._dae.n_v)
