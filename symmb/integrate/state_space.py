"""The state-space method: independent coordinates are integrated, the others follow from the constraints."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._interrupts import carry_runs
from symmb._types import Array, Indices
from symmb.codegen import REASONS, FailureCode
from symmb.events import longest_step
from symmb.integrate.integration import Integration, Run, pieces_between, stateless_integration
from symmb.integrate.one_sided import one_sided
from symmb.integrate.projection import sampled
from symmb.integrate.side_walk import Advance, SideWalk, Stops
from symmb.integrate.solver import Solver
from symmb.integrate.switch_passes import SwitchPasses
from symmb.model import DAE
from symmb.schemes import (
    StepControl,
    error_estimates,
    error_norm,
    first_step,
    interpolant,
    interpolated,
    interpolation_error,
    stages,
)
from symmb.start import independent_rows_and_columns
from symmb.symbolic import batch, common


@dataclass(frozen=True, repr=False)
class StateSpace(Solver):
    """Coordinate partitioning: pair of Dormand and Prince in independent coordinates, Newton's method for the others.

    The independent coordinates are chosen anew when they no longer determine the others well. Samples run in Python one
    after the other: the method is for checks, not for speed.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]

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
        if not dae.n_v:
            return stateless_integration(dae, times)
        with_work = work and dae.power is not None
        atol = self.tolerances(dae, n_quad=int(with_work)).absolute(dae.n_q + dae.n_v + dae.n_s + int(with_work))
        return _Partitioned(dae, times, self.rtol, atol[:, None], longest_step(dae, times), with_work)


_WORSE = 1.5
"""Growth of the condition number of the dependent coordinates after which they are chosen anew. Errors grow with it: a
spatial mechanism is solved 20 to 50 times less accurately with 3 to 100, in up to twice as many steps."""


class _Partitioned(Integration):
    def __init__(self, dae: DAE, times: Array, rtol: float, atol: Array, longest: float, work: bool) -> None:
        self.times, self.n_x, self.n_quad = times, dae.n_q + dae.n_v + dae.n_s, int(work)
        self._rtol, self._atol, self._longest = rtol, atol, longest
        self._stops, self._one_sided = SwitchPasses(dae, times, rtol), one_sided(dae)
        daes = [dae] if self._one_sided is None else [dae, self._one_sided.dae]
        self._equations = [_Equations.of(dae, work) for dae in daes]
        self._counts = {"steps": 0, "choices of coordinates": 0}
        at = ca.SX.sym("x", self.n_x), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        self._held = None if dae.sampling is None else common("held", [*at], [sampled(dae, *at)])

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        self._counts = dict.fromkeys(self._counts, 0)
        return [self._one(x, values) for x, values in zip(x0, p, strict=True)]

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        raise PropagationError("Lockstep needs a solver with a fixed step, such as RungeKutta().")

    def statistics(self) -> dict[str, int]:
        return dict(self._counts)

    def _one(self, x0: Array, p: Array) -> Run:
        if not np.isfinite(x0).all():
            return self._unstarted()
        times, n_x = self.times, self.n_x
        Y = np.full((len(times), n_x + self.n_quad), np.nan)
        Y[0] = y = np.concatenate([x0, np.zeros(self.n_quad)])
        t, stored, before, message = float(times[0]), 1, 1, ""

        def along(begin: float, end: float, y: Array, p: Array) -> Array:
            nonlocal t, stored
            t, stored = begin, before
            while t < end:
                motion = self._motion(y, p, t)
                try:
                    y, stored = self._advance(motion, y, Y, stored, end)
                finally:
                    t = motion.t
            return y

        stops = self._stops.stops(x0[None], p[None]).of(0)
        piece = self._pieces_of(p, stops, along)
        with np.errstate(all="ignore"):
            try:
                for begin, end in pieces_between(t, float(times[-1]), stops.times):
                    if begin > stops.sticks:
                        t = float(stops.sticks)
                        raise _Breakdown(REASONS[FailureCode.STICKS])
                    before = stored
                    y = piece(begin, end, self._sampled(y, p, begin))
                Y[stored:] = self._sampled(y, p, float(times[-1]))  # an output time that is a switch of time
            except np.linalg.LinAlgError:
                message = "the dependent coordinates are not determined"
            except _Breakdown as breakdown:
                message = str(breakdown)
            except KeyboardInterrupt as interrupt:
                carry_runs(interrupt, [Run(Y[:, :n_x], Y[:, n_x:], t, "interrupted")])
                raise
        return Run(Y[:, :n_x], Y[:, n_x:], t if message else np.nan, message)

    def _sampled(self, y: Array, p: Array, t: float) -> Array:
        """y with the sampled values of a time."""
        if self._held is None:
            return y
        return np.concatenate([batch(self._held, y[: self.n_x], p, np.array([t]))[0][0], y[self.n_x :]])

    def _pieces_of(self, p: Array, stops: Stops, along: Advance) -> Callable[[float, float, Array], Array]:
        """(begin, end, y) -> y at the end of pieces between stops."""
        if self._one_sided is None or not np.isfinite(stops.passes).any():
            return lambda begin, end, y: along(begin, end, y, p)

        def shift(begin: float, end: float, y: Array, p: Array) -> Array:
            """By one step."""
            motion, h, at = self._motion(y, p, begin), np.array([end - begin]), np.array([begin])
            rates, x = motion.columns, y[:, None]
            _, x_new = stages(rates, x, rates(x, at), at, h)
            return motion.completed(x_new[:, 0], end)

        return SideWalk(self._one_sided, p, stops, float(np.ptp(self.times)), along, shift, along).piece

    def _motion(self, y: Array, p: Array, t: float) -> "_Motion":
        (equations,) = (e for e in self._equations if len(e.dae.p_names) == len(p))
        self._counts["choices of coordinates"] += 1
        return _Motion(equations, p, equations.dependent(y[: self.n_x], p, t), t)

    def _advance(self, motion: "_Motion", y: Array, Y: Array, stored: int, end: float) -> tuple[Array, int]:
        """Steps from y until an end or until the coordinates no longer suit: y there, and how many outputs Y holds."""
        times, tolerances = self.times, (self._rtol, self._atol)
        span = float(times[-1] - times[0])
        rates = motion.columns
        x, at = y[:, None], np.array([motion.t])
        slope = rates(x, at)
        h = first_step(rates, x, slope, at, float(times[-1]) - motion.t, *tolerances)
        control = StepControl(at, h, end, span, self._longest)
        while True:
            t_new, h = control.propose()
            k, x_new = stages(rates, x, slope, control.t, h)
            accepted, stuck, exhausted = control.judge(error_norm(x, x_new, error_estimates(k, h), *tolerances), h)
            self._counts["steps"] += 1
            if stuck[0] or exhausted[0]:
                code = FailureCode.MANY if exhausted[0] else FailureCode.STEPS
                raise _Breakdown(REASONS[code])
            if not accepted[0]:
                continue
            slope, due = rates(x_new, t_new), times[stored:][times[stored:] <= t_new]
            if due.size:
                F, missed = interpolant(rates, x, x_new, [*k, slope], control.t, h)
                error = interpolation_error(x, x_new, missed, *tolerances)
                if not error[0] <= 1.0 and h[0] > control.shortest * 1.0000001:
                    slope = k[0]
                    control.reject(control.live, error, h)
                    continue
                states = interpolated(x, F, (due - control.t) / h)
                for y_output, t_output in zip(states.T, due, strict=True):
                    Y[stored] = motion.completed(y_output, float(t_output))
                    stored += 1
            x, control.t = x_new, t_new
            motion.t = float(t_new[0])
            y = motion.completed(x[:, 0], motion.t)
            if motion.t >= end or motion.condition(y, motion.t) > _WORSE * motion.first_condition:
                return y, stored


class _Breakdown(RuntimeError):
    """A run cannot go on."""


@dataclass(frozen=True)
class _Equations:
    """The equations of one sample in few calls: each takes longer than what it evaluates.

    dae : DAE
    moved : (x, delta, p, t) -> x moved by displacements (n_v,), and there Phi, Phi_dot and G
    rates : (x, p, t) -> x', and the power if it is integrated
    """

    dae: DAE
    moved: ca.Function
    rates: ca.Function

    @classmethod
    def of(cls, dae: DAE, work: bool) -> "_Equations":
        x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        delta, none = ca.SX.sym("delta", dae.n_v), ca.SX(0, 1)
        there = ca.vertcat(dae.retract(x[: dae.n_q], delta), x[dae.n_q :])
        at = dae.arguments(there, p, t)
        rows = [none if f is None else f(*at) for f in (dae.Phi, dae.Phi_dot)]
        G = ca.SX(0, dae.n_v) if dae.G is None else dae.G(*at)
        moved = common("moved", [x, delta, p, t], [ca.densify(e) for e in (there, *rows, G)])
        at = dae.arguments(x, p, t)
        rates = list(dae.rhs.call(list(at)))
        if work and dae.power is not None:
            rates.append(dae.power(*at, dae.forward(*at, none if dae.gamma is None else dae.gamma(*at))[1]))
        return cls(dae, moved, common("rates", [x, p, t], [ca.densify(ca.vertcat(*rates))]))

    def at(self, x: Array, p: Array, t: float, delta: Array | float = 0.0) -> tuple[Array, Array, Array, Array]:
        """The state x (n_x,) moved by delta (n_v,), and there Phi (n_c,), Phi_dot (n_r,) and G (n_r, n_v)."""
        delta = np.broadcast_to(delta, self.dae.n_v)
        x, Phi, Phi_dot, G = (value[0] for value in batch(self.moved, x, delta, p, np.array([t])))
        return x, Phi, Phi_dot, G.reshape(len(Phi_dot), self.dae.n_v)

    def dependent(self, x: Array, p: Array, t: float) -> Indices:
        """Velocities that depend on the others: as many as rows."""
        *_, G = self.at(x, p, t)
        return independent_rows_and_columns(G * self.dae.displacement_scales, rank=self.dae.rank)[1]


class _Motion:
    """The equations of motion with chosen dependent velocities, at time t so far."""

    def __init__(self, equations: _Equations, p: Array, dependent: Indices, t: float) -> None:
        self._equations, self._dae, self._p, self._dependent, self.t = equations, equations.dae, p, dependent, t
        self._n_x = equations.moved.numel_in(0)
        self.first_condition = np.inf

    def condition(self, y: Array, t: float) -> float:
        """Of the matrix that determines the dependent velocities; the first is kept."""
        if not self._dependent.size:
            return 0.0
        *_, G = self._equations.at(y[: self._n_x], self._p, t)
        G = (G * self._dae.displacement_scales)[:, self._dependent]
        condition_number = float(np.linalg.cond(G / np.linalg.norm(G, axis=1, keepdims=True)))
        if self.first_condition == np.inf:
            self.first_condition = condition_number
        return condition_number

    def rates(self, t: float, y: Array) -> Array:
        """y' at the state whose dependent part follows from the constraints."""
        return batch(self._equations.rates, self.completed(y, t)[: self._n_x], self._p, np.array([t]))[0][0]

    def columns(self, y: Array, t: Array) -> Array:
        """The rates with states and times as columns."""
        return self.rates(float(t[0]), y[:, 0])[:, None]

    def completed(self, y: Array, t: float) -> Array:
        """y with its dependent coordinates and velocities moved onto the constraints."""
        dae, which = self._dae, self._dependent
        if dae.Phi_dot is None:
            return y
        x, Phi, Phi_dot, G = self._equations.at(y[: self._n_x], self._p, t)
        for _ in range(8 if dae.n_c else 0):
            delta = np.zeros(dae.n_v)
            delta[which] = np.linalg.lstsq(G[: dae.n_c, which], -Phi, rcond=None)[0]
            x, Phi, Phi_dot, G = self._equations.at(x, self._p, t, delta)
            if np.abs(delta / dae.displacement_scales).max() < 1e-9:  # Newton is quadratic
                break
        G, y = G[:, which], np.concatenate([x, y[self._n_x :]])
        solved = np.linalg.solve(G, Phi_dot) if dae.vanishing is None else np.linalg.lstsq(G, Phi_dot, rcond=None)[0]
        y[dae.n_q + which] -= solved
        return y
