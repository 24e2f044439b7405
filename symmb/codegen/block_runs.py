"""Steps of many blocks of samples together: those of c/embedded_pair.h on NumPy arrays."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.codegen.block_switches import BEYOND, LATE, BlockSwitches, Values
from symmb.codegen.contacts import ContactEvents, Contacts
from symmb.codegen.engine import StepEnds, Tolerances
from symmb.codegen.failures import FailureCode
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


class Equations(Protocol):
    """What an engine gives for its steps. Functions take x, values of parameters alone and t, lanes being columns.

    `begins_anew` tells whether the state where the last step ended is the begin of another motion.
    """

    times: Array
    n_y: int
    control: Tolerances
    ends: StepEnds
    contacts: Contacts | None
    width: int
    most_steps: int
    begins_anew: bool
    prepare: Values
    rates: Values
    outputs: Callable[..., Array]
    project: Values | None
    switches: Values | None
    bounds: Values | None


class BlockRuns:
    """B blocks under way, each with its own step size; lanes are columns, W for each block: 8, or 1 with contacts.

    Attributes
    ----------
    Y : (n_t, n_y, W B)                  outputs
    lost : (B, W)                        lanes whose errors are too large at the shortest step, or that stick
    t_stopped : (B,)                     when blocks with lost lanes stopped, nan for others [s]
    x_stopped : (n_x, W B)               where they did
    code : (B,)                          FailureCode of these
    passes : W B lists                   times at which lanes pass switches of the state [s]
    events : ContactEvents               None without contacts
    """

    def __init__(self, engine: Equations, x: Array, p: Array) -> None:
        self._width = engine.width
        times, B = engine.times, x.shape[1] // self._width
        self._engine = engine
        self.Y = np.full((len(times), engine.n_y, x.shape[1]), np.nan)
        self.lost, self.t_stopped = np.zeros((B, self._width), dtype=bool), np.full(B, np.nan)
        self.code = np.full(B, FailureCode.STEPS, dtype=np.int8)
        self.x_stopped = np.full(x.shape, np.nan)
        t = np.full(B, times[0])
        own = engine.prepare, engine.switches, engine.bounds, engine.ends
        self._switches = BlockSwitches(*own, times, x, p, B, self._width, engine.contacts)
        self._switches.find_stops(t, np.arange(B))
        self._c = engine.prepare(x, self._switches.parameters, self._by_lane(t))
        self._x = np.ascontiguousarray(x) if engine.project is None else engine.project(x, self._c, self._by_lane(t))
        self._atol_of_size = engine.control.absolute(len(x))[:, None]
        atol = np.repeat(engine.control.least * self._atol_of_size, x.shape[1], axis=1)
        self._atol = np.maximum(atol, engine.control.growth * np.abs(self._x))
        self.passes: list[list[float]] = [[] for _ in range(x.shape[1])]
        self._next = np.ones(B, dtype=int)  # output time to come
        engine.outputs(self._x, self._c, self._by_lane(t), self.Y[0])
        self._slope = np.empty_like(self._x)
        span = float(times[-1] - times[0])
        self._steps = StepControl(t, np.full(B, span), self._switches.end, span, engine.control.longest)
        self._steps.most_steps = engine.most_steps
        every, self.events = np.ones(B, dtype=bool), None
        self._restart(every, settle=every)
        if engine.contacts is not None:
            self.events = ContactEvents(engine.contacts, t, span)
            self._next[:] = 0
            self._select(~self._meet(every, np.full(B, -1)))

    @property
    def n_steps(self) -> int:
        """Steps of all blocks."""
        return int(self._steps.steps.sum())

    def _rates(self, c: Array, blocks: Indices) -> Callable[[Array, Array], Array]:
        low, high = (self._by_lane(a[blocks]) for a in (self._switches.after, self._switches.before))
        return lambda x, t: self._engine.rates(x, c, np.clip(t, low, high))

    def _between(self, t: Array, blocks: Indices) -> Array:
        """Times t (b,) at which laws of time have their values on the side of their jumps where the blocks are."""
        return np.clip(t, self._switches.after[blocks], self._switches.before[blocks])

    def _restart(self, some: Mask, settle: Mask) -> None:
        """Slopes and first steps of some live blocks, where the motion begins or behind a switch."""
        steps, lanes, blocks = self._steps, self._lanes(some), self._steps.live[some]
        if settle.any():
            on = self._lanes(settle)
            t = self._by_lane(np.maximum(steps.t[steps.live[settle]], self._switches.after[steps.live[settle]]))
            self._c[:, on] = self._switches.settle(self._x[:, on], self._c[:, on], t, on)
        x, t = self._x[:, lanes], steps.t[blocks]
        rates = self._rates(self._c[:, lanes], blocks)
        self._slope[:, lanes] = slope = rates(x, self._by_lane(t))
        left = float(self._engine.times[-1]) - t
        control = self._engine.control
        to_come = np.minimum(control.growth * control.ahead * np.abs(slope), self._atol_of_size)
        self._atol[:, lanes] = np.maximum(self._atol[:, lanes], to_come)
        h = first_step(rates, x, slope, self._by_lane(t), left, control.rtol, self._atol[:, lanes], self._width)
        steps.restart(t, h, blocks)

    def advance(self) -> None:
        """Run all blocks to the end."""
        steps, engine = self._steps, self._engine
        if len(engine.times) == 1:
            return
        while steps.live.size:
            t_new, h = steps.propose()
            t, wide = self._by_lane(steps.t[steps.live]), self._by_lane(h)
            k, x_new = stages(self._rates(self._c, steps.live), self._x, self._slope, t, wide)
            rtol = self._engine.control.rtol
            norm = error_norm(self._x, x_new, error_estimates(k, wide), rtol, self._atol).reshape(-1, self._width)
            accepted, stuck, exhausted = steps.judge(norm.max(axis=1), h)
            failed = stuck | exhausted
            if failed.any():
                self._stop(failed, ~(norm[failed] <= 1.0) | exhausted[failed, None])
                self.code[steps.live[exhausted]] = FailureCode.MANY
            failed |= self._accept(accepted, k, x_new, t_new, h)
            self._select((self._next[steps.live] < len(engine.times)) & ~failed)

    def _stop(self, failed: Mask, lost: Mask) -> None:
        """Blocks that cannot go on without their lost lanes."""
        blocks, n_x = self._steps.live[failed], len(self._x)
        self.lost[blocks], self.t_stopped[blocks] = lost, self._steps.t[blocks]
        self.x_stopped.reshape(n_x, -1, self._width)[:, blocks] = self._x[:, self._lanes(failed)].reshape(
            n_x, -1, self._width
        )

    def _accept(self, accepted: Mask, k: list[Array], x_new: Array, t_new: Array, h: Array) -> Mask:
        """Outputs and new states of accepted steps, which end at switches. Returns the blocks with lanes that stick."""
        engine, steps, switches = self._engine, self._steps, self._switches
        if not accepted.any():
            return accepted
        lanes, blocks = self._lanes(accepted), steps.live[accepted]
        t, wide = self._by_lane(steps.t[blocks]), self._by_lane(h[accepted])
        x, c, end = self._x[:, lanes], self._c[:, lanes], x_new[:, lanes]
        rates = self._rates(c, blocks)
        last = rates(end, self._by_lane(t_new[accepted]))
        t_end, F = t_new[accepted], np.empty(0)
        passed, which = np.zeros(x.shape[1], dtype=bool), np.zeros(x.shape[1], dtype=np.intp)
        searched = engine.switches is not None
        due = engine.times[np.minimum(self._next[blocks], len(engine.times) - 1)] <= t_end
        if searched or due.any():
            coefficients, missed = interpolant(rates, x, end, [*[slope[:, lanes] for slope in k], last], t, wide)
            error = interpolation_error(x, end, missed, engine.control.rtol, self._atol[:, lanes])
            error = error.reshape(-1, self._width).max(axis=1)
            far_off = ~(error <= 1.0) & (h[accepted] > 1.0000001 * steps.shortest)
            if far_off.any():
                steps.reject(blocks[far_off], error[far_off], h[accepted][far_off])
                return self._accept(_without(accepted, far_off), k, x_new, t_new, h)
            F = np.array(coefficients)
        if searched:
            until = self._by_lane(self._between(t_new[accepted], blocks))
            theta, passed, which = switches.first_pass(x, end, F, c, t, np.maximum(until, t), lanes)
            early = (theta < LATE) & (theta * h[accepted] > 10 * steps.shortest)
            if early.any():  # interpolants are as exact as steps near their ends only
                steps.h[blocks[early]] = theta[early] * h[accepted][early] * BEYOND
                switches.forget(lanes)
                return self._accept(_without(accepted, early), k, x_new, t_new, h)
            t_end = np.where(theta <= 1, steps.t[blocks] + theta * h[accepted], t_end)
            end = np.where(self._by_lane(theta) <= 1, interpolated(x, F, np.minimum(self._by_lane(theta), 1.0)), end)
        by_contacts = passed & (which >= switches.n_sided)
        meets = by_contacts
        if engine.contacts:
            # A law of time may jump where a step ends, and margins of joints by that.
            jumps = (t_end >= switches.stop[blocks]) & bool(engine.contacts.joints)
            meets = by_contacts | jumps | (t_end >= engine.times[-1])
        if F.size:
            until = np.where(meets, np.nextafter(t_end, -np.inf), t_end) if meets.any() else t_end
            self._sample_outputs(blocks, x, F, c, until, h[accepted])
        self._x[:, lanes] = end if engine.project is None else engine.project(end, c, self._by_lane(t_end))
        # The slope before the projection serves the next step: it is as far off as the error of this one.
        self._slope[:, lanes] = last
        largest = engine.control.growth * np.abs(self._x[:, lanes])
        self._atol[:, lanes] = np.maximum(self._atol[:, lanes], largest)
        steps.t[blocks] = t_end
        return self._go_on(_Ends(accepted, end, t_end, wide, passed & ~by_contacts, which), meets, by_contacts)

    def _go_on(self, ends: "_Ends", meets: Mask, by_contacts: Mask) -> Mask:
        """Go on from the ends of steps, some of which are switches or events. Returns the blocks with lanes that stick.

        Some ends (b,) meet contacts, of which some are steps that contacts end (b,).
        """
        steps, switches, accepted, t_last = self._steps, self._switches, ends.accepted, self._engine.times[-1]
        sticks, restarts, settles = (np.zeros(len(steps.live), dtype=bool) for _ in range(3))
        restarts[accepted] = ends.passed.reshape(-1, self._width).any(axis=1) | self._engine.begins_anew
        if ends.passed.any():
            sticks[accepted] = self._change_sides(ends)
        settles[accepted] = (ends.t >= switches.stop[steps.live[accepted]]) & (ends.t < t_last)
        if settles.any():
            switches.find_stops(steps.t, steps.live[settles])
        if (restarts | settles).any():
            self._restart(restarts | settles, settles)
        if meets.any():
            events = accepted.copy()
            events[accepted] = meets
            sticks |= self._meet(events, np.where(by_contacts, ends.which - switches.n_sided, -1)[meets])
        return sticks

    def _change_sides(self, ends: "_Ends") -> Mask:
        """Change the sides of switches that lanes passed. Stops and returns the blocks with lanes that stick (b,)."""
        lanes, blocks = self._lanes(ends.accepted), self._steps.live[ends.accepted]
        t = self._by_lane(self._between(ends.t, blocks))
        x, c = self._x[:, lanes], self._c[:, lanes]
        columns = (self._width * blocks[:, None] + np.arange(self._width)).ravel()
        located = ends.passed & (ends.which >= 0)
        for column, time in zip(columns[located].tolist(), t[located].tolist(), strict=True):
            self.passes[column].append(time)
        self._c[:, lanes], stuck = self._switches.change_sides(ends.x, x, c, t, ends.h, lanes, ends.passed, ends.which)
        sticks: Mask = np.asarray(stuck.any(axis=1), dtype=bool)
        if sticks.any():
            self._stop(_without(ends.accepted, ~sticks), stuck[sticks])
            self.code[blocks[sticks]] = FailureCode.STICKS
        return sticks

    def _meet(self, some: Mask, contact: Indices) -> Mask:
        """Go on after events of contacts in some live lanes. Stops and returns the live lanes that fail."""
        events, lanes, steps, engine = cast(ContactEvents, self.events), np.flatnonzero(some), self._steps, self._engine
        blocks, fails = steps.live[lanes], np.zeros(len(steps.live), dtype=bool)
        t, p = steps.t[blocks], self._switches.parameters[:, lanes]
        behind = self._between(t, blocks)
        after = events.meet(blocks, self._x[:, lanes].T, p.T, t, behind, contact)
        self._x[:, lanes] = x = after.x.T
        self._c[:, lanes] = c = self._switches.settle(x, self._c[:, lanes], behind, lanes)
        self._switches.lift(lanes, after.lift.T)
        self._slope[:, lanes] = self._rates(c, blocks)(x, t)
        steps.h[blocks] = np.minimum(steps.h[blocks], after.soon)
        fails[lanes] = lost = after.failure >= 0
        if lost.any():
            self.code[blocks[lost]] = after.failure[lost]
            self._stop(fails, np.ones((np.count_nonzero(lost), 1), dtype=bool))
        due = np.append(engine.times, np.inf)[self._next[blocks]] <= t
        at = blocks[due]
        self.Y[self._next[at], :, at] = engine.outputs(x[:, due], c[:, due], t[due]).T
        self._next[at] += 1
        return fails

    def _sample_outputs(self, blocks: Indices, x: Array, F: Array, c: Array, t_end: Array, h: Array) -> None:
        """Outputs of blocks that have passed an output time, up to all they have passed."""
        engine, t = self._engine, self._steps.t[blocks]
        Y = self.Y.reshape(*self.Y.shape[:2], -1, self._width)
        times, next = np.append(engine.times, np.inf), self._next[blocks]
        while (passed := times[next] <= t_end).any():  # a time at once for all blocks
            lanes, at = self._lanes(passed), times[next[passed]]
            share = self._by_lane((at - t[passed]) / h[passed])
            y = engine.outputs(interpolated(x[:, lanes], F[:, :, lanes], share), c[:, lanes], self._by_lane(at))
            Y[next[passed], :, blocks[passed]] = y.reshape(engine.n_y, -1, self._width).transpose(1, 0, 2)
            next[passed] += 1
        self._next[blocks] = next

    def _by_lane(self, a: Array) -> Array:
        """One value for each block (B,) to one for each lane (W B,)."""
        return np.repeat(a, self._width)

    def _lanes(self, mask: Mask) -> Mask | slice:
        """The lanes of some blocks; all without a copy."""
        return slice(None) if mask.all() else np.repeat(mask, self._width)

    def _select(self, going: Mask) -> None:
        """Go on with some blocks only."""
        if going.all():
            return
        lanes = self._lanes(going)
        self._x, self._slope, self._c = self._x[:, lanes], self._slope[:, lanes], self._c[:, lanes]
        self._atol = self._atol[:, lanes]
        self._switches.select(lanes)
        self._steps.live = self._steps.live[going]


@dataclass(frozen=True, eq=False)
class _Ends:
    """Ends of the accepted steps of b live blocks.

    States before a projection x (n_x, W b), times t (b,), lengths h of the steps (W b,), which lanes passed switches of
    sides (W b,), and numbers of these.
    """

    accepted: Mask
    x: Array
    t: Array
    h: Array
    passed: Mask
    which: Indices


def _without(accepted: Mask, some: Mask) -> Mask:
    """The accepted blocks without some of them."""
    rest = accepted.copy()
    rest[accepted] = ~some
    return rest
