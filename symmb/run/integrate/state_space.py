"""The state-space method. Independent coordinates are integrated, and the constraints determine the other
coordinates."""

from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.declare.symbolic import batch, common
from symmb.equations.model import DAE
from symmb.equations.start import independent_rows_and_columns
from symmb.run.codegen import REASONS, FailureCode
from symmb.run.events import longest_step
from symmb.run.integrate.initial_value_problem import InitialValueProblem, build_problem
from symmb.run.integrate.integration import Integration, RunAdvance
from symmb.run.integrate.one_sided import one_sided
from symmb.run.integrate.side_walk import SideWalk, Stops
from symmb.run.integrate.solver import Solver
from symmb.run.integrate.switch_passes import SwitchPasses
from symmb.run.schemes import MOST_STEPS


@dataclass(frozen=True, repr=False)
class StateSpace(Solver):
    """Coordinate partitioning. The pair of Dormand and Prince integrates independent coordinates; Newton's method
    computes the other coordinates.

    Independent coordinates are chosen again if they no longer determine the other coordinates well. Samples run in
    Python one after the other. The method is for checks, because it is slow.

    Parameters
    ----------
    rtol, atol : float
        relative and absolute tolerance, see `CVODES`

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.StateSpace())["bob.x"].round(4)
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
        return _Partitioned(self, dae, times, work)


class _Partitioned(Integration):
    """Runs by SciPy's DOP853, one sample after the other. Each piece of a run is on one side of each switch."""

    def __init__(self, solver: StateSpace, dae: DAE, times: Array, work: bool) -> None:
        problem = build_problem(dae, None, algebraic=False, work=work)
        n_x, n_quad = problem.x.numel(), problem.quad.numel()
        guess = ca.Function("guess", [problem.x, problem.p, problem.t], [ca.SX(0, 1)])
        passes, project = SwitchPasses(dae, times, solver.rtol), problem.projection()
        samples = dae.sampling is not None
        super().__init__(times, n_x, n_quad, guess, project=project, stops=passes.stops, samples=samples)
        self._equations, tolerances = _Equations(dae, problem), solver.tolerances(dae, n_quad=n_quad)
        atol = tolerances.absolute(n_x + n_quad)
        self._options = {"rtol": tolerances.rtol, "atol": atol, "max_step": longest_step(dae, times)}
        self._sides = one_sided(dae) if passes.are_possible else None
        if self._sides is not None:
            smooth = self._sides.dae
            self._smooth = _Equations(smooth, build_problem(smooth, None, algebraic=False, work=work))

    def _pieces(self, p: Array, stops: Stops) -> RunAdvance:
        path = _Path(self._options, self._statistics)
        span, last = float(np.ptp(self.times)), float(self.times[-1])
        free = partial(path.advance, self._equations)
        advance = partial(free, p=p)
        if self._sides is not None and np.isfinite(stops.passes).any():
            advance = SideWalk(self._sides, p, stops, span, partial(path.advance, self._smooth), free).piece

        def piece(begin: float, end: float, x: Array) -> tuple[Array, Array]:
            stop = float(stops.times[stops.times > begin].min(initial=np.inf))
            path.before_stop = last if stop > last else stop - 4 * float(np.spacing(max(abs(stop), 1e-3 * span)))
            try:
                y = advance(begin, end, np.concatenate([x, np.zeros(self.n_quad)]))
            except KeyboardInterrupt:  # the base class stores the run so far, and raises the interrupt again
                raise RuntimeError("interrupted") from None
            return y[: self.n_x], y[self.n_x :]

        return piece


class _Path:
    """The motion of one sample from stop to stop. Steps pass over output times, at which states are interpolated.

    Attributes
    ----------
    before_stop : float      the time [s] up to which steps may continue
    """

    def __init__(self, options: dict[str, Any], counts: Counter[str]) -> None:
        self._options, self._counts = options, counts
        self.before_stop, self._until, self._known = np.inf, -np.inf, (np.nan, np.empty(0), np.empty(0))

    def advance(self, equations: "_Equations", begin: float, end: float, y: Array, p: Array) -> Array:
        """The state and the integrals y at the time `end` of a piece, which may be before the time `begin`."""
        n = self._n = equations.n
        goes_on = begin < self._until and all(map(np.array_equal, self._known, (begin, y[:n], p)))
        if not goes_on:
            self._equations, self._p, self._until = equations, p, end if end < begin else max(end, self.before_stop)
            self._interpolant, self._integrals = lambda _: y, y[n:]
            self._begin(begin, y)
        end = min(end, self._until)  # pieces end at a stop, up to rounding
        while self._steps.direction * (end - self._steps.t) > 0:
            self._step(end)
        reached, before = self._interpolant(end), self._integrals
        x, self._integrals = self._completed(reached[:n], end), reached[n:]
        self._known = end, x, p
        return np.concatenate([x, y[n:] + self._integrals - before])

    def _begin(self, t: float, y: Array) -> None:
        """Choose independent coordinates, and start steps in these coordinates."""
        from scipy.integrate import DOP853

        self._dependent, self._least = self._equations.dependent(y[: self._n], self._p, t), np.inf
        self._counts["choices of coordinates"] += 1
        self._steps = DOP853(self._slopes, t, y, self._until, **self._options)

    def _step(self, end: float) -> None:
        steps = self._steps
        if steps.step() is not None:
            raise RuntimeError(REASONS[FailureCode.STEPS])
        self._counts["steps"] += 1
        if self._counts["steps"] > MOST_STEPS:
            raise RuntimeError(REASONS[FailureCode.MANY])
        if steps.direction * (steps.t - end) >= 0:
            self._interpolant = steps.dense_output()
        if steps.status == "running":
            x = self._completed(steps.y[: self._n], steps.t)
            now = self._equations.amplification(x, self._p, steps.t, self._dependent)
            self._least = min(self._least, now)
            # If the error amplification by the constraints grows by this factor, coordinates are chosen again.
            if now > 1.5 * self._least:
                self._begin(steps.t, np.concatenate([x, steps.y[self._n :]]))

    def _slopes(self, t: float, y: Array) -> Array:
        """Rates of y. The constraints give the dependent part of the state; nan if they do not determine this part."""
        try:
            x = self._completed(y[: self._n], t)
        except np.linalg.LinAlgError:
            return np.full(len(y), np.nan)
        return batch(self._equations.rates, x, self._p, np.array([t]))[0][0]

    def _completed(self, x: Array, t: float) -> Array:
        return self._equations.completed(x, self._p, t, self._dependent)


class _Equations:
    """The rates and constraints of a DAE for one sample, at a state x (n_x,), parameters p (n_p,) and a time."""

    def __init__(self, dae: DAE, problem: InitialValueProblem) -> None:
        x, p, t = problem.x, problem.p, problem.t
        self._dae, self.n = dae, x.numel()
        self.rates = common("rates", [x, p, t], [ca.densify(ca.vertcat(problem.ode, problem.quad))])
        delta = ca.SX.sym("delta", dae.n_v)
        there = ca.vertcat(dae.retract(x[: dae.n_q, :], delta), x[dae.n_q :, :])
        at = dae.arguments(there, p, t)
        rows = [ca.SX(0, 1) if f is None else f(*at) for f in (dae.Phi, dae.Phi_dot)]
        G = ca.SX(0, dae.n_v) if dae.G is None else dae.G(*at)
        self._moved = common("moved", [x, delta, p, t], [ca.densify(e) for e in (there, *rows, G)])

    def dependent(self, x: Array, p: Array, t: float) -> Indices:
        """Numbers (n_r,) of the dependent velocities, one for each row."""
        *_, G = self._at(x, p, t)
        return independent_rows_and_columns(G * self._dae.displacement_scales, rank=self._dae.rank)[1]

    def amplification(self, x: Array, p: Array, t: float, dependent: Indices) -> float:
        """Largest change of the dependent velocities, divided by the change of the rows; at least 1.

        Rows have norm 1 over all columns. With the norm over dependent columns, a single row would always give 1.
        """
        if not len(dependent):
            return 1.0
        G = self._at(x, p, t)[-1] * self._dae.displacement_scales
        sizes = np.linalg.norm(G, axis=1, keepdims=True)
        least = np.linalg.svd((G / np.where(sizes > 0, sizes, 1.0))[:, dependent], compute_uv=False)[-1]
        return 1 / least if least > 0 else np.inf

    def completed(self, x: Array, p: Array, t: float, dependent: Indices) -> Array:
        """The state x with dependent coordinates and velocities on the constraints."""
        dae = self._dae
        if dae.Phi_dot is None:
            return x
        x, Phi, Phi_dot, G = self._at(x, p, t)
        for _ in range(8 if dae.n_c else 0):
            delta = np.zeros(dae.n_v)
            delta[dependent] = np.linalg.lstsq(G[: dae.n_c, dependent], -Phi, rcond=None)[0]
            x, Phi, Phi_dot, G = self._at(x, p, t, delta)
            if np.abs(delta / dae.displacement_scales).max() < 1e-9:  # Newton's method converges quadratically
                break
        G = G[:, dependent]
        solved = np.linalg.solve(G, Phi_dot) if dae.vanishing is None else np.linalg.lstsq(G, Phi_dot, rcond=None)[0]
        x[dae.n_q + dependent] -= solved
        return x

    def _at(self, x: Array, p: Array, t: float, delta: Array | float = 0.0) -> tuple[Array, Array, Array, Array]:
        """The state x moved by displacements delta (n_v,), and Phi (n_c,), Phi_dot (n_r,) and G (n_r, n_v) there."""
        delta = np.broadcast_to(delta, self._dae.n_v)
        there, Phi, Phi_dot, G = (value[0] for value in batch(self._moved, x, delta, p, np.array([t])))
        return there, Phi, Phi_dot, G.reshape(len(Phi_dot), self._dae.n_v)
