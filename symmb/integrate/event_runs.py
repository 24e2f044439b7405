"""Runs of many samples from event to event."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._interrupts import carry_runs
from symmb._types import Array, Indices, Mask
from symmb.codegen import REASONS, BlockSwitches, FailureCode, StepEnds, Tolerances
from symmb.events import (
    Event,
    ImpactLaws,
    Location,
    PostImpactState,
    Steps,
    evaluate_padded,
    longest_step,
    time_switches,
)
from symmb.integrate.integration import Integration, Run, pieces_between
from symmb.integrate.problem import Problem, build_problem
from symmb.integrate.stabilization import Projection
from symmb.integrate.step_ends import switched
from symmb.model import DAE, Impacts
from symmb.schemes import StepControl, error_estimates, error_norm, first_step, interpolant, interpolation_error, stages
from symmb.symbolic import common, ranges_along

CROWD_SPAN, CROWD = 1e-12, 1000
"""More events than this within this share of the run's time are an endless sequence. tests/events/test_impacts.py"""
MOST_EVENTS = 50_000
"""Events of a run: more take minutes, and mean a motion that bounces faster and faster."""
_SHORTER = 0.37
"""Longest step of a run that checks another one, over the mean step of that: no simple fraction, so that it rounds
otherwise."""
CONTACT_STEP = 1e-13
"""Share of the run's time: the least step after an event. Shorter ones are lost in rounding."""


class EventIntegration(Integration):
    """Runs of many samples from event to event.

    Attributes
    ----------
    step : Function          (y, p, t, h) -> y at the end of a step, errors of orders 3 and 5, coefficients (n_y, 7)
    rates : Function         (y, p, t) -> y', y = (x, work); the last parameters are the sides of switches
    switches : Function      (x, p, t) -> switches of the state and their rates (2 m,); None if there are none
    bounds : Function        (box, p, t) -> their ranges, see `ranges_along`
    mean_steps : float       steps of one of the last runs, in the mean
    """

    def __init__(self, dae: DAE, impacts: Impacts, times: Array, tolerances: Tolerances, work: bool) -> None:
        self.times, self.n_x, self.n_quad = times, dae.n_q + dae.n_v + dae.n_s, int(work)
        self.rtol, self.atol = tolerances.rtol, tolerances.absolute(self.n_x + self.n_quad)[:, None]
        problem = build_problem(dae, Projection(), algebraic=False, work=work, one_step=True, projections=1)
        self._project, self.n_p = _projection(dae, impacts, problem), problem.p.numel()
        self.switches = self.bounds = None
        self.ends = StepEnds()
        on_sides = switched(problem, dae, times)
        if on_sides is not None and on_sides.switches.numel():
            problem, self.ends = on_sides.problem, replace(on_sides.ends, stops=None)  # `time_switches` tells these
            x, p, t = problem.x, problem.p, problem.t
            box, bounds = ranges_along(on_sides.switches[: len(self.ends.hysteresis)], x, p, t)
            self.switches = ca.Function("switches", [x, p, t], [on_sides.switches])
            self.bounds = common("bounds", [box, p, t], [bounds])
        quad = problem.quad if problem.quad.numel() else ca.SX.zeros(self.n_quad)
        y = ca.vertcat(problem.x, ca.SX.sym("work", self.n_quad))
        arguments = [y, problem.p, problem.t]
        self.rates = common("rates", arguments, [ca.vertcat(problem.ode, quad)])
        self.step = _step_function(self.rates)
        self.laws = ImpactLaws(dae, impacts)
        self.time_switches, self.longest = time_switches(dae, times), longest_step(dae, times)
        self.locate = Location(dae, impacts, self.laws)
        self._steps = self._events = 0
        self.mean_steps = 0.0

    def round_otherwise(self, other: "EventIntegration") -> None:
        """Take steps that are shorter than the mean one of the last runs of another integration."""
        span = float(self.times[-1] - self.times[0])
        self.longest = min(self.longest, _SHORTER * span / max(other.mean_steps, 1.0))

    def statistics(self) -> dict[str, int]:
        return {"steps": self._steps, "events": self._events}

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        raise PropagationError("Lockstep needs a solver with a fixed step, and impacts end steps where they happen.")

    def projected(self, y: Array, p: Array, t: Array) -> Array:
        """States (N, n_y) on the constraints and in their closed contacts."""
        (x,) = evaluate_padded(self._project, y[:, : self.n_x], p[:, : self.n_p], t[:, None])
        return np.hstack([x, y[:, self.n_x :]])

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        runs = EventRuns(self, x0, p)
        try:
            runs.advance()
        except KeyboardInterrupt as interrupt:
            carry_runs(interrupt, self._results(runs, x0))
            raise
        self._steps, self._events = runs.n_steps, sum(map(len, runs.events))
        self.mean_steps = runs.n_steps / max(len(x0), 1)
        return self._results(runs, x0)

    def _results(self, runs: "EventRuns", x0: Array) -> list[Run]:
        Y, n_x = runs.Y, self.n_x
        return [
            self._unstarted() if not np.isfinite(x).all() else Run(y[:, :n_x], y[:, n_x:], t, why, tuple(events))
            for x, y, t, why, events in zip(x0, Y, runs.t_failed, runs.messages, runs.events, strict=True)
        ]


class EventRuns:
    """N runs under way, each with its own steps.

    Attributes
    ----------
    Y : (N, n_t, n_y)            states and work at the output times, nan from a failure on
    t_failed : (N,)              nan where a run did not fail [s]
    messages : list of N         why
    events : list of N lists
    """

    def __init__(self, integration: EventIntegration, x0: Array, p: Array) -> None:
        self._integration, self._times, N = integration, integration.times, len(x0)
        self._span = float(integration.times[-1] - integration.times[0])
        self._y = np.hstack([x0, np.zeros((N, integration.n_quad))])
        self.Y = np.full((N, len(integration.times), self._y.shape[1]), np.nan)
        self.t_failed, self.messages = np.full(N, np.nan), [""] * N
        self.events: list[list[Event]] = [[] for _ in range(N)]
        self._stored = np.zeros(N, dtype=np.intp)  # outputs that are stored
        t = np.full(N, integration.times[0], dtype=float)
        switches, times = integration.time_switches, integration.times
        stops = np.empty((N, 0)) if switches is None else switches(p)
        self._pieces = [[*pieces_between(float(times[0]), float(times[-1]), row)] for row in stops]
        t = np.array([pieces[0][0] for pieces in self._pieces]) if len(times) > 1 else t
        ends = np.array([pieces.pop(0)[1] for pieces in self._pieces]) if len(times) > 1 else t.copy()
        longest = integration.longest
        self._steps = StepControl(t, np.full(N, self._span), ends, self._span, longest if np.isfinite(longest) else 0.0)
        self._steps.live = np.flatnonzero(np.isfinite(x0).all(axis=1))
        self._crowd_start, self._crowd = t.copy(), np.zeros(N, dtype=np.intp)
        values, bounds = (f and partial(_by_columns, f) for f in (integration.switches, integration.bounds))
        self._switches = BlockSwitches(
            lambda _, p, __: p, values, bounds, integration.ends, times, x0.T, p.T, N, width=1
        )

    @property
    def n_steps(self) -> int:
        """Steps of all runs."""
        return int(self._steps.steps.sum())

    def _p(self, lanes: Indices) -> Array:
        """Parameters, and the sides of switches."""
        return self._switches.parameters[:, lanes].T

    def _own_p(self, lanes: Indices) -> Array:
        """Parameters alone."""
        return self._p(lanes)[:, : self._integration.n_p]

    def _x(self, lanes: Indices) -> Array:
        return self._y[lanes, : self._integration.n_x]

    def _settle(self, lanes: Indices) -> None:
        """The sides of switches where a run goes on."""
        self._switches.settle(self._x(lanes).T, self._p(lanes).T, self._steps.t[lanes], lanes)

    def advance(self) -> None:
        """Run all to the end."""
        with np.errstate(all="ignore"):
            if self._steps.live.size:
                self._start()
            while self._steps.live.size:
                self._step()

    def _start(self) -> None:
        """Contacts that are closed at the start, impacts at once, and the first steps."""
        laws, live, t = self._integration.laws, self._steps.live, self._steps.t
        self._y[live] = self._integration.projected(self._y[live], self._p(live), t[live])
        faults = laws.start_faults(self._x(live), self._own_p(live), t[live], self._span)
        self._fail([(int(live[i]), reason) for i, reason in reversed(faults)])
        live = self._steps.live
        if not live.size:
            return
        self._settle(live)
        self._steps.h[live] = self._first_steps(live)
        self._resolve(live, np.full(len(live), -1), np.zeros((len(live), len(laws.flags)), dtype=bool))
        self._finish()

    def _first_steps(self, lanes: Indices) -> Array:
        def rates(y: Array, t: Array) -> Array:
            return evaluate_padded(self._integration.rates, y.T, p, t[:, None])[0].T

        y, p, t, integration = self._y[lanes].T, self._p(lanes), self._steps.t[lanes], self._integration
        return first_step(rates, y, rates(y, t), t, self._span, integration.rtol, integration.atol)

    def _step(self) -> None:
        """A step of every run."""
        integration, control, live = self._integration, self._steps, self._steps.live
        y, p, t = self._y[live], self._p(live), control.t[live]
        t_new, h = control.propose()
        new, e3, e5, F, missed = evaluate_padded(integration.step, y, p, t[:, None], h[:, None])
        tolerances = integration.rtol, integration.atol
        error = np.maximum(
            error_norm(y.T, new.T, [e3.T, e5.T], *tolerances), interpolation_error(y.T, new.T, missed.T, *tolerances)
        )
        accepted, stuck, exhausted = control.judge(error, h)
        rows = np.flatnonzero(accepted)
        if rows.size:
            steps = Steps(y[rows], p[rows], t[rows], h[rows], F.reshape(len(live), -1, 7)[rows])
            self._accept(live[rows], steps, new[rows], t_new[rows])
        for failed, code in ((stuck, FailureCode.STEPS), (exhausted, FailureCode.MANY)):
            self._fail([(int(i), REASONS[code]) for i in live[failed]])
        self._finish()

    def _accept(self, lanes: Indices, steps: Steps, new: Array, t: Array) -> None:
        integration, n_x = self._integration, self._integration.n_x
        states = steps._replace(x=steps.x[:, :n_x], p=steps.p[:, : integration.n_p], F=steps.F[:, :n_x])
        located = integration.locate(states)
        share, number = self._switch_passes(lanes, steps, new, t)
        blind = located.known < np.minimum(share, located.theta)
        share, number = np.where(blind, located.known, share), np.where(blind, -1, number)
        switches = (share < located.theta) | ((share <= 1) & ~located.has_event)
        has_event, theta = located.has_event & ~switches, np.where(switches, share, located.theta)
        rows = np.flatnonzero(has_event | switches)
        if rows.size:
            new[rows] = steps.some(rows).at(theta[rows])
            t[rows] = steps.t[rows] + theta[rows] * steps.h[rows]
        self._store_outputs(lanes, steps, t)
        self._y[lanes], self._steps.t[lanes] = integration.projected(new, steps.p, t), t
        self._change_sides(lanes[switches], new[switches], steps.h[switches], number[switches])
        self._resolve(lanes[has_event], located.closing[has_event], located.released[has_event])

    def _switch_passes(self, lanes: Indices, steps: Steps, new: Array, t: Array) -> tuple[Array, Indices]:
        """The first switches of the state that steps to new states at t pass: shares, inf without one, and numbers."""
        n_x, c = self._integration.n_x, steps.p.T
        F = steps.F[:, :n_x].transpose(2, 1, 0)
        share, _, number = self._switches.first_pass(steps.x[:, :n_x].T, new[:, :n_x].T, F, c, steps.t, t, lanes)
        return share, number

    def _change_sides(self, lanes: Indices, new: Array, h: Array, number: Indices) -> None:
        """Go on behind switches of the state with the numbers (n,), which ended steps of length h (n,) at new."""
        if not lanes.size:
            return
        control, every = self._steps, np.ones(len(lanes), dtype=bool)
        x, p, t = self._x(lanes), self._p(lanes), control.t[lanes]
        end = new[:, : self._integration.n_x].T
        _, sticks = self._switches.change_sides(end, x.T, p.T, t, h, lanes, every, number)
        control.restart(t, self._first_steps(lanes), lanes)
        self._fail([(int(i), REASONS[FailureCode.STICKS]) for i in lanes[sticks[:, 0]]])

    def _store_outputs(self, lanes: Indices, steps: Steps, t: Array) -> None:
        """Store the outputs from the start of the steps up to times t, without those at t."""
        first, last = self._stored[lanes], np.searchsorted(self._times[:-1], t)
        counts = np.maximum(last - first, 0)
        if not counts.any():
            return
        rows = np.repeat(np.arange(len(lanes)), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + first[rows]
        t_output, some = self._times[number], steps.some(rows)
        y = some.at((t_output - some.t) / some.h)
        self.Y[lanes[rows], number] = self._integration.projected(y, some.p, t_output)
        self._stored[lanes] = np.maximum(first, last)

    def _resolve(self, lanes: Indices, closing: Indices, released: Mask) -> None:
        """Continue after events of some runs: contacts that close, -1 for none, and contacts that open."""
        if not lanes.size:
            return
        integration, control = self._integration, self._steps
        p, t = self._own_p(lanes), control.t[lanes]
        after: PostImpactState = integration.laws(self._x(lanes), p, t, closing, released)
        self._y[lanes, : integration.n_x] = after.x
        self._y[lanes, integration.n_x :] += after.work[:, None]
        self._settle(lanes)
        least = CONTACT_STEP * self._span
        control.h[lanes] = np.minimum(control.h[lanes], np.maximum(after.next_contact_time, least))
        for i, event in after.events:
            self.events[lanes[i]].append(event)
        self._fail([(int(lanes[i]), reason) for i, reason in after.failures])
        self._fail([(int(i), self._endless_text(int(i))) for i in lanes[self._is_endless(lanes)]])

    def _is_endless(self, lanes: Indices) -> Mask:
        """Whether events follow each other without end. Counts the events within a short time."""
        t = self._steps.t[lanes]
        moved = t - self._crowd_start[lanes] > CROWD_SPAN * self._span
        self._crowd_start[lanes] = np.where(moved, t, self._crowd_start[lanes])
        self._crowd[lanes] = np.where(moved, 0, self._crowd[lanes] + 1)
        return (self._crowd[lanes] > CROWD) | np.array([len(self.events[i]) > MOST_EVENTS for i in lanes], dtype=bool)

    def _endless_text(self, lane: int) -> str:
        names = dict.fromkeys(event.name for event in self.events[lane][-CROWD:])
        return f"impacts of {', '.join(map(repr, names))} follow each other without end"

    def _finish(self) -> None:
        """Store the last output of runs at the end, and leave these out."""
        control, integration = self._steps, self._integration
        reached = control.live[control.t[control.live] >= control.end[control.live]]
        done = np.array([lane for lane in reached.tolist() if not self._pieces[lane]], dtype=np.intp)
        on = np.setdiff1d(reached, done)
        if on.size:  # behind a switch of time
            begins, ends = zip(*(self._pieces[lane].pop(0) for lane in on.tolist()), strict=True)
            control.t[on], control.end[on] = begins, ends
            self._y[on] = integration.projected(self._y[on], self._p(on), control.t[on])
            self._settle(on)
            control.restart(np.array(begins), self._first_steps(on), on)
        self.Y[done, -1] = self._y[done]
        control.live = np.setdiff1d(control.live, done)

    def _fail(self, failures: Sequence[tuple[int, str]]) -> None:
        for lane, reason in failures:
            self.t_failed[lane], self.messages[lane] = self._steps.t[lane], reason
        self._steps.live = self._steps.live[np.isnan(self.t_failed[self._steps.live])]


def _by_columns(f: ca.Function, x: Array, p: Array, t: Array) -> Array:
    """f of samples that are columns."""
    return evaluate_padded(f, x.T, p.T, t[:, None])[0].T


def _step_function(rates: ca.Function) -> ca.Function:
    """A whole step of the pair as one Function: 15 calls from Python would take longer than a small model's rates."""
    x, p = ca.MX.sym("x", rates.numel_in(0)), ca.MX.sym("p", rates.numel_in(1))
    t, h = ca.MX.sym("t"), ca.MX.sym("h")

    def of_model(x: ca.MX, t: ca.MX) -> ca.MX:
        return rates(x, p, t)

    k, x_new = stages(of_model, x, of_model(x, t), t, h)
    F, missed = interpolant(of_model, x, x_new, [*k, of_model(x_new, t + h)], t, h)
    return ca.Function("step", [x, p, t, h], [x_new, *error_estimates(k, h), ca.horzcat(*F), missed])


def _projection(dae: DAE, impacts: Impacts, problem: Problem) -> ca.Function:
    """(x, p, t) -> x on the constraints and in closed contacts."""
    x = problem.x if problem.projected is None else problem.projected
    q, v = impacts.project(*dae.arguments(x, problem.p, problem.t))
    x = ca.vertcat(q, v, x[dae.n_q + dae.n_v :])
    return common("project", [problem.x, problem.p, problem.t], [x])
