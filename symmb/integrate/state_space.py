"""The state-space method: independent coordinates are integrated, the others follow from the constraints."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from symmb._errors import PropagationError
from symmb._interrupts import carry_runs
from symmb._types import Array, Indices
from symmb.codegen import REASONS, FailureCode
from symmb.events import longest_step
from symmb.integrate.integration import Integration, Run, pieces_between, stateless_integration
from symmb.integrate.one_sided import one_sided
from symmb.integrate.side_walk import Advance, SideWalk, Stops
from symmb.integrate.solver import Solver
from symmb.integrate.switch_passes import SwitchPasses
from symmb.model import DAE
from symmb.schemes import StepControl, error_estimates, error_norm, first_step, interpolant, interpolated, stages
from symmb.start import independent_rows_and_columns
from symmb.symbolic import batch


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
        self._dae, self._rtol, self._atol, self._longest = dae, rtol, atol, longest
        self._stops, self._equations = SwitchPasses(dae, times, rtol), one_sided(dae)
        self._counts = {"steps": 0, "choices of coordinates": 0}

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
                    before = stored
                    y = piece(begin, end, y)
                Y[stored:] = y  # an output time that is a switch of time
            except np.linalg.LinAlgError:
                message = "the dependent coordinates are not determined"
            except _Breakdown as breakdown:
                message = str(breakdown)
            except KeyboardInterrupt as interrupt:
                carry_runs(interrupt, [Run(Y[:, :n_x], Y[:, n_x:], t, "interrupted")])
                raise
        return Run(Y[:, :n_x], Y[:, n_x:], t if message else np.nan, message)

    def _pieces_of(self, p: Array, stops: Stops, along: Advance) -> Callable[[float, float, Array], Array]:
        """(begin, end, y) -> y at the end of pieces between stops."""
        if self._equations is None or not np.isfinite(stops.passes).any():
            return lambda begin, end, y: along(begin, end, y, p)

        def shift(begin: float, end: float, y: Array, p: Array) -> Array:
            """By one step."""
            motion, h, at = self._motion(y, p, begin), np.array([end - begin]), np.array([begin])
            rates, x = motion.columns, y[:, None]
            _, x_new = stages(rates, x, rates(x, at), at, h)
            return motion.completed(x_new[:, 0], end)

        return SideWalk(self._equations, p, stops, float(np.ptp(self.times)), along, shift, along).piece

    def _motion(self, y: Array, p: Array, t: float) -> "_Motion":
        dae = self._dae
        if self._equations is not None and len(p) > len(dae.p_names):
            dae = self._equations.dae
        self._counts["choices of coordinates"] += 1
        return _Motion(dae, p, _chosen(dae, y[: self.n_x], p, t), t)

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
                F = interpolant(rates, x, x_new, [*k, slope], control.t, h)
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


class _Motion:
    """The equations of motion with chosen dependent velocities, at time t so far."""

    def __init__(self, dae: DAE, p: Array, dependent: Indices, t: float = 0.0) -> None:
        self._dae, self._p, self._dependent, self.t = dae, p, dependent, t
        self.first_condition = np.inf

    def condition(self, y: Array, t: float) -> float:
        """Of the matrix that determines the dependent velocities; the first is kept."""
        if not self._dependent.size:
            return 0.0
        dae = self._dae
        G = (_matrix(dae, y, self._p, t) * dae.displacement_scales)[:, self._dependent]
        condition_number = float(np.linalg.cond(G / np.linalg.norm(G, axis=1, keepdims=True)))
        if self.first_condition == np.inf:
            self.first_condition = condition_number
        return condition_number

    def rates(self, t: float, y: Array) -> Array:
        """y' at the state whose dependent part follows from the constraints."""
        dae, at = self._dae, self._at(self.completed(y, t), t)
        parts = [rate[0] for rate in batch(dae.rhs, *at)]
        if dae.power is not None and len(y) > dae.n_q + dae.n_v + dae.n_s:
            gamma = batch(dae.gamma, *at)[0] if dae.gamma is not None else np.zeros((1, 0))
            lam = batch(dae.forward, *at, gamma)[1]
            parts.append(batch(dae.power, *at, lam)[0][0])
        return np.concatenate(parts)

    def columns(self, y: Array, t: Array) -> Array:
        """The rates with states and times as columns."""
        return self.rates(float(t[0]), y[:, 0])[:, None]

    def completed(self, y: Array, t: float) -> Array:
        """y with its dependent coordinates and velocities moved onto the constraints."""
        dae, which = self._dae, self._dependent
        if dae.Phi_dot is None:
            return y
        y = y.copy()
        y[: dae.n_q] = batch(dae.retract, y[: dae.n_q], np.zeros(dae.n_v))[0][0]
        for _ in range(8):
            if dae.Phi is None:
                break
            (violation,) = batch(dae.Phi, *self._at(y, t))[0]
            delta = np.zeros(dae.n_v)
            G = _matrix(dae, y, self._p, t)[: dae.n_c, which]
            delta[which] = np.linalg.lstsq(G, -violation, rcond=None)[0]
            y[: dae.n_q] = batch(dae.retract, y[: dae.n_q], delta)[0][0]
            if np.abs(delta / dae.displacement_scales).max() < 1e-9:  # Newton is quadratic
                break
        (rate,) = batch(dae.Phi_dot, *self._at(y, t))[0]
        G = _matrix(dae, y, self._p, t)[:, which]
        solved = np.linalg.solve(G, rate) if dae.vanishing is None else np.linalg.lstsq(G, rate, rcond=None)[0]
        y[dae.n_q + which] -= solved
        return y

    def _at(self, y: Array, t: float) -> tuple[Array, ...]:
        dae = self._dae
        cuts = [dae.n_q, dae.n_q + dae.n_v, dae.n_q + dae.n_v + dae.n_s]
        q, v, s, _ = np.split(y, cuts)
        return (q, v, *((s,) if dae.n_s else ()), self._p, np.array([t]))


def _matrix(dae: DAE, y: Array, p: Array, t: float) -> Array:
    if dae.G is None:
        return np.zeros((0, dae.n_v))
    return batch(dae.G, *_Motion(dae, p, np.arange(0))._at(y, t))[0][0].reshape(dae.n_r, dae.n_v)


def _chosen(dae: DAE, x: Array, p: Array, t: float) -> Indices:
    """Velocities that depend on the others: as many as rows."""
    if dae.G is None:
        return np.arange(0)
    return independent_rows_and_columns(_matrix(dae, x, p, t) * dae.displacement_scales)[1]
