"""Runs with impacts: steps of the Dormand-Prince pair from event to event."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Indices, Mask
from symmb.codegen import MOST_STEPS, REASONS
from symmb.events import Event, ImpactLaws, Location, PostImpactState, Steps, evaluate_padded
from symmb.integrate.explicit import DormandPrince
from symmb.integrate.integration import Integration, Run
from symmb.integrate.problem import build_problem
from symmb.integrate.solver import Solver
from symmb.integrate.stabilization import Projection
from symmb.model import DAE, Impacts
from symmb.schemes import error_norm, interpolated, pair_step

CROWD_SPAN, CROWD = 1e-12, 1000
"""More events than this within this share of the run's time do not come to an end. tests/events/test_impacts.py"""
MOST_EVENTS = 50_000
"""Events of a run: more take minutes, and mean a motion that bounces faster and faster."""


@dataclass(frozen=True, repr=False)
class EventDriven(Solver):
    """Explicit pair of order 8 whose steps end where an `Impact` happens, located on their interpolant to rounding.

    Samples run side by side, each with steps of its own. After every step positions and velocities are moved onto the
    constraints, closed contacts among them. At the time of an impact an output tells what is after it.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]

    References
    ----------
    Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, section II.6. Acary, Brogliato (2008),
    Numerical Methods for Nonsmooth Dynamical Systems, chapter 8.
    """

    locates_events: ClassVar[bool] = True

    rtol: float = 1e-10
    atol: float | None = None

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        if dae.impacts is None:
            return DormandPrince(self.rtol, self.atol).integration(dae, times, order=order, work=work)
        if order:
            raise PropagationError(
                f"Derivatives with respect to parameters, and Taylor with them, are not valid across the events of "
                f"{impacts_text(dae.impacts)}. Use PolynomialChaos(), Scanning(...) or MonteCarlo(...)."
            )
        return _EventIntegration(dae, dae.impacts, times, self.rtol, self.absolute_tolerance(dae.scales.size), work)


def impacts_text(impacts: Impacts) -> str:
    """The impacts by name, as messages tell them."""
    return ", ".join(f"Impact {name!r}" for name in impacts.names)


class _EventIntegration(Integration):
    def __init__(self, dae: DAE, impacts: Impacts, times: Array, rtol: float, atol: float, work: bool) -> None:
        self.times, self.n_x, self.n_quad = times, dae.n_q + dae.n_v + dae.n_s, int(work)
        self._rtol, self._atol = rtol, atol
        problem = build_problem(dae, Projection(), algebraic=False, work=work, one_step=True, projections=1)
        quad = problem.quad if problem.quad.numel() else ca.SX.zeros(self.n_quad)
        y = ca.vertcat(problem.x, ca.SX.sym("work", self.n_quad))
        arguments = [y, problem.p, problem.t]
        rates = ca.Function("rates", arguments, [ca.vertcat(problem.ode, quad)], {"cse": True})
        self._step = pair_step(rates)
        x = problem.x if problem.projected is None else problem.projected
        q, v = impacts.project(*dae.arguments(x, problem.p, problem.t))
        x = ca.vertcat(q, v, x[dae.n_q + dae.n_v :])
        self._project = ca.Function("project", [problem.x, problem.p, problem.t], [x], {"cse": True})
        self._laws = ImpactLaws(dae, impacts)
        self._locate = Location(impacts, self._laws)
        self._steps = self._events = 0

    def statistics(self) -> dict[str, int]:
        return {"steps": self._steps, "events": self._events}

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        raise PropagationError("Lockstep needs a solver with a fixed step, and impacts end steps where they happen.")

    def projected(self, y: Array, p: Array, t: Array) -> Array:
        """States (N, n_y) on the constraints and in their closed contacts."""
        (x,) = evaluate_padded(self._project, y[:, : self.n_x], p, t[:, None])
        return np.hstack([x, y[:, self.n_x :]])

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        lanes = _Lanes(self, x0, p)
        with np.errstate(all="ignore"):
            lanes.start()
            while lanes.live.size:
                lanes.advance()
        self._steps, self._events = lanes.steps, sum(map(len, lanes.events))
        Y, n_x = lanes.Y, self.n_x
        return [
            self._unstarted() if not np.isfinite(x).all() else Run(y[:, :n_x], y[:, n_x:], t, why, tuple(events))
            for x, y, t, why, events in zip(x0, Y, lanes.t_failed, lanes.messages, lanes.events, strict=True)
        ]


class _Lanes:
    """N runs under way: y (N, n_y), t (N,), h (N,), and which of them go on."""

    def __init__(self, integration: _EventIntegration, x0: Array, p: Array) -> None:
        self._integration, self._times, N = integration, integration.times, len(x0)
        self._span, self._end = float(integration.times[-1] - integration.times[0]), float(integration.times[-1])
        self.y, self.p = np.hstack([x0, np.zeros((N, integration.n_quad))]), p
        self.t, self.h = np.full(N, integration.times[0], dtype=float), np.full(N, self._span / 100)
        self.Y = np.full((N, len(integration.times), self.y.shape[1]), np.nan)
        self.live: Indices = np.flatnonzero(np.isfinite(x0).all(axis=1))
        self.steps = 0
        self.t_failed, self.messages = np.full(N, np.nan), [""] * N
        self.events: list[list[Event]] = [[] for _ in range(N)]
        self._stored = np.zeros(N, dtype=np.intp)  # outputs that are stored
        self._since, self._crowd = self.t.copy(), np.zeros(N, dtype=np.intp)

    def start(self) -> None:
        """Contacts that are closed at the start, and impacts at once."""
        rebounds = self._integration._laws
        if not self.live.size:
            return
        self.y[self.live] = self._integration.projected(self.y[self.live], self.p[self.live], self.t[self.live])
        x = self.y[self.live, : self._integration.n_x]
        for i, reason in reversed(rebounds.start_faults(x, self.p[self.live], self.t[self.live])):
            self._fail(int(self.live[i]), reason)
        self._drop_failed()
        n = len(rebounds.flags)
        self._resolve(self.live, np.full(len(self.live), -1), np.zeros((len(self.live), n), dtype=bool))
        self._finish()

    def advance(self) -> None:
        """A step of every lane."""
        integration, live = self._integration, self.live
        shortest = 1e-14 * self._span
        left = self._end - self.t[live]
        final = self.h[live] >= left
        h = np.where(final, left, self.h[live])
        y, p, t = self.y[live], self.p[live], self.t[live]
        new, e3, e5, F = evaluate_padded(integration._step, y, p, t[:, None], h[:, None])
        error = error_norm(y, new, e3, e5, integration._rtol, integration._atol)
        self.steps += len(live)
        good = error <= 1
        for i in live[~good & (h <= shortest)]:
            self._fail(int(i), REASONS[0])
        factor = 0.9 * np.maximum(error, 1e-10) ** (-1 / 8)
        self.h[live] = h * np.where(good, factor.clip(0.333, 6.0), factor.clip(0.2, 1.0))
        rows = np.flatnonzero(good)
        if rows.size:
            steps = Steps(y[rows], p[rows], t[rows], h[rows], F.reshape(len(live), -1, 7)[rows])
            self._accept(live[rows], steps, new[rows], final[rows])
        if self.steps > MOST_STEPS * len(self.y):
            for i in self.live:
                self._fail(int(i), REASONS[3])
        self._drop_failed()
        self._finish()

    def _accept(self, lanes: Indices, steps: Steps, new: Array, final: Mask) -> None:
        integration = self._integration
        located = integration._locate(steps._replace(x=steps.x[:, : integration.n_x], F=steps.F[:, : integration.n_x]))
        has_event = located.has_event
        new[has_event] = interpolated(steps.x[has_event], steps.F[has_event], located.theta[has_event])
        t = np.where(has_event, steps.t + located.theta * steps.h, np.where(final, self._end, steps.t + steps.h))
        self._store_outputs(lanes, steps, t)
        self.y[lanes], self.t[lanes] = integration.projected(new, steps.p, t), t
        self._resolve(lanes[has_event], located.closing[has_event], located.released[has_event])

    def _store_outputs(self, lanes: Indices, steps: Steps, t: Array) -> None:
        """Store the outputs from the start of the steps up to times t, without those at t."""
        first, last = self._stored[lanes], np.searchsorted(self._times[:-1], t)
        counts = np.maximum(last - first, 0)
        if not counts.any():
            return
        rows = np.repeat(np.arange(len(lanes)), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + first[rows]
        at, some = self._times[number], steps.some(rows)
        y = interpolated(some.x, some.F, (at - some.t) / some.h)
        self.Y[lanes[rows], number] = self._integration.projected(y, some.p, at)
        self._stored[lanes] = np.maximum(first, last)

    def _resolve(self, lanes: Indices, closing: Indices, released: Mask) -> None:
        if not lanes.size:
            return
        integration, t = self._integration, self.t[lanes]
        x = self.y[lanes, : integration.n_x]
        after: PostImpactState = integration._laws(x, self.p[lanes], t, closing, released)
        self.y[lanes, : integration.n_x] = after.x
        self.y[lanes, integration.n_x :] += after.work[:, None]
        self.h[lanes] = np.minimum(self.h[lanes], np.maximum(after.next_contact_time, 1e-13 * self._span))
        for i, event in after.events:
            self.events[lanes[i]].append(event)
        for i, reason in after.failures:
            self._fail(int(lanes[i]), reason)
        moved = t - self._since[lanes] > CROWD_SPAN * self._span
        self._since[lanes] = np.where(moved, t, self._since[lanes])
        self._crowd[lanes] = np.where(moved, 0, self._crowd[lanes] + 1)
        is_full = np.array([len(self.events[i]) > MOST_EVENTS for i in lanes], dtype=bool)
        for i in lanes[(self._crowd[lanes] > CROWD) | is_full]:
            names = dict.fromkeys(event.name for event in self.events[i][-CROWD:])
            self._fail(int(i), f"impacts of {', '.join(map(repr, names))} follow each other without end")
        self._drop_failed()

    def _finish(self) -> None:
        """Store the last output of lanes at the end of the run, and leave these lanes out."""
        done = self.live[self.t[self.live] >= self._end]
        self.Y[done, -1] = self.y[done]
        self.live = self.live[self.t[self.live] < self._end]

    def _fail(self, lane: int, reason: str) -> None:
        self.t_failed[lane], self.messages[lane] = self.t[lane], reason

    def _drop_failed(self) -> None:
        self.live = self.live[np.isnan(self.t_failed[self.live])]
