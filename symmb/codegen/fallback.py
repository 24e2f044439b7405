"""The engine without a compiler: the steps of c/embedded_pair.h on NumPy arrays, many blocks of samples together."""

from collections.abc import Callable

import casadi as ca
import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.codegen.arrays import programs
from symmb.codegen.block_switches import BEYOND, LATE, WIDTH, BlockSwitches
from symmb.codegen.engine import MOST_PASSES, Counts, FailedSamples, StepEnds, Tolerances
from symmb.codegen.graph import graph_of
from symmb.codegen.model_source import FailureCode
from symmb.schemes import (
    MOST_STEPS,
    StepControl,
    error_estimates,
    error_norm,
    first_step,
    interpolant,
    interpolated,
    interpolation_error,
    stages,
)

_TOGETHER = 128
"""Blocks that advance together: enough for long arrays, few enough for the processor's cache."""


class ArrayEngine:
    """An initial value problem for many samples, with the interface of Engine. It is about 30 times slower.

    It uses one thread: most of the time is spent in Python, which runs one thread at a time.
    """

    width = WIDTH
    starts = False
    counts = Counts(0, 0, 0)

    def __init__(self, f: ca.Function, times: Array, control: Tolerances, ends: StepEnds | None = None) -> None:
        self.n_y = f.numel_out("outputs")
        self.times, self.control, self.ends = times, control, ends or StepEnds()
        self.most_steps = MOST_STEPS
        self.prepare, functions = programs(graph_of(f))
        by_name = dict(zip(f.name_out(), functions, strict=True))
        self.rates, self.outputs = by_name["rates"], by_name["outputs"]
        self.project, self.switches, self.bounds = (by_name.get(name) for name in ("project", "switches", "bounds"))

    def values(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, FailedSamples]:
        """Outputs of N samples, x0 (N, n_x), p (N, n_p).

        Returns
        -------
        (N, n_t, n_y) array        nan from the time on at which a sample stopped
        FailedSamples
        """
        Y = np.full((len(x0), len(self.times), self.n_y), np.nan)

        def keep(part: Array, samples: Indices, regular: Mask) -> None:
            Y[samples] = part.transpose(2, 0, 1)

        return Y, self._run(x0, p, keep)

    def extremes(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Array, FailedSamples]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail, and those that did."""
        shape = len(self.times), self.n_y
        lower, upper = [np.full(shape, np.inf)], [np.full(shape, -np.inf)]

        def keep(part: Array, samples: Indices, regular: Mask) -> None:
            part = part if regular.all() else part[:, :, regular]
            lower.append(part.min(axis=2, initial=np.inf))
            upper.append(part.max(axis=2, initial=-np.inf))

        failed_samples = self._run(x0, p, keep)
        return np.min(lower, axis=0), np.max(upper, axis=0), failed_samples

    def _run(self, x0: Array, p: Array, keep: Callable[[Array, Indices, Mask], None]) -> FailedSamples:
        """Run blocks, fixed by sample index. `keep` gets values (n_t, n_y, m), the m samples, and their success."""
        N = len(x0)
        passes = np.full((N, MOST_PASSES), np.nan) if self.switches is not None else None
        failed_samples = FailedSamples(
            np.full(N, np.nan), np.zeros(N, dtype=np.int8), np.full(x0.shape, np.nan), passes
        )
        failed_samples.t_failed[~np.isfinite(x0).all(axis=1)] = self.times[0]
        blocks = [np.arange(start, min(start + WIDTH, N)) for start in range(0, N, WIDTH)]
        with np.errstate(all="ignore"):
            for k in range(0, len(blocks), _TOGETHER):
                part = blocks[k : k + _TOGETHER]
                while part:
                    part = self._part(x0, p, part, failed_samples, keep)
        return failed_samples

    def _part(
        self,
        x0: Array,
        p: Array,
        blocks: list[Indices],
        failed_samples: FailedSamples,
        keep: Callable[[Array, Indices, Mask], None],
    ) -> list[Indices]:
        """Run some blocks. Returns those that must run again without their lost samples."""
        alive = [b[np.isnan(failed_samples.t_failed[b])] for b in blocks]
        alive = [b for b in alive if b.size]
        if not alive:
            return []
        # Lanes without a sample repeat another one, which does not change the common step.
        lanes = np.array([np.resize(b, WIDTH) for b in alive])
        run = _BlockRuns(self, x0[lanes.ravel()].T, p[lanes.ravel()].T)
        run.advance()
        Y, lost, at, x = run.Y, run.lost, run.t_stopped, run.x_stopped
        finite = np.logical_and.reduce(np.isfinite(Y), axis=1).reshape(len(self.times), *lanes.shape)
        passed = ~(self.times[:, None, None] > at[:, None])
        irregular = ~np.logical_and.reduce(finite | ~passed, axis=0)
        # The first failure counts. The block runs again, which shows later ones.
        lost &= ~irregular.any(axis=1)[:, None]
        failed_samples.failure[lanes] = run.code[:, None]
        failed_samples.failure[lanes[irregular]] = FailureCode.OUTPUT
        failed_samples.t_failed[lanes[irregular]] = self.times[np.argmin(finite[:, irregular], axis=0)]
        failed_samples.t_failed[lanes[lost]] = np.broadcast_to(at[:, None], lost.shape)[lost]
        failed_samples.x_failed[lanes[lost]] = x.T[lost.ravel()]
        if failed_samples.passes is not None:
            for sample, when in zip(lanes.ravel().tolist(), run.passes, strict=True):
                failed_samples.passes[sample] = [*when[:MOST_PASSES], *[np.nan] * (MOST_PASSES - len(when))]
        failed = lost | irregular
        again = failed.any(axis=1)
        final = (failed | ~again[:, None]) & (np.arange(WIDTH) < np.array([[b.size] for b in alive]))
        keep(Y if final.all() else Y[:, :, final.ravel()], lanes[final], ~failed[final])
        return [b for b, repeated in zip(alive, again.tolist(), strict=True) if repeated]


class _BlockRuns:
    """B blocks under way, each with its own step size; lanes are columns, 8 for each block.

    Attributes
    ----------
    Y : (n_t, n_y, 8 B)                  outputs
    lost : (B, 8)                        lanes whose errors are too large at the shortest step, or that stick
    t_stopped : (B,)                     when blocks with lost lanes stopped, nan for others [s]
    x_stopped : (n_x, 8 B)               where they did
    code : (B,)                          FailureCode of these
    passes : 8 B lists                   times at which lanes pass switches of the state [s]
    """

    def __init__(self, engine: ArrayEngine, x: Array, p: Array) -> None:
        times, B = engine.times, x.shape[1] // WIDTH
        self._engine = engine
        self.Y = np.full((len(times), engine.n_y, x.shape[1]), np.nan)
        self.lost, self.t_stopped = np.zeros((B, WIDTH), dtype=bool), np.full(B, np.nan)
        self.code = np.full(B, FailureCode.STEPS, dtype=np.int8)
        self.x_stopped = np.full(x.shape, np.nan)
        t = np.full(B, times[0])
        self._switches = BlockSwitches(engine.prepare, engine.switches, engine.bounds, engine.ends, times, x, p, B)
        self._switches.find_stops(t, np.arange(B))
        self._c = engine.prepare(x, self._switches.parameters, _by_lane(t))
        self._x = np.ascontiguousarray(x) if engine.project is None else engine.project(x, self._c, _by_lane(t))
        self._atol_of_size = engine.control.absolute(len(x))[:, None]
        atol = np.repeat(engine.control.least * self._atol_of_size, x.shape[1], axis=1)
        self._atol = np.maximum(atol, engine.control.growth * np.abs(self._x))
        self.passes: list[list[float]] = [[] for _ in range(x.shape[1])]
        self._next = np.ones(B, dtype=int)  # output time to come
        engine.outputs(self._x, self._c, _by_lane(t), self.Y[0])
        self._slope = np.empty_like(self._x)
        span = float(times[-1] - times[0])
        self._steps = StepControl(t, np.full(B, span), self._switches.end, span, engine.control.longest)
        self._steps.most_steps = engine.most_steps
        self._restart(np.ones(B, dtype=bool), settle=np.ones(B, dtype=bool))

    def _rates(self, c: Array, blocks: Indices) -> Callable[[Array, Array], Array]:
        low, high = (_by_lane(a[blocks]) for a in (self._switches.after, self._switches.before))
        return lambda x, t: self._engine.rates(x, c, np.clip(t, low, high))

    def _restart(self, some: Mask, settle: Mask) -> None:
        """Slopes and first steps of some live blocks, where the motion begins or behind a switch."""
        steps, lanes, blocks = self._steps, _lanes(some), self._steps.live[some]
        if settle.any():
            on = _lanes(settle)
            t = _by_lane(np.maximum(steps.t[steps.live[settle]], self._switches.after[steps.live[settle]]))
            self._c[:, on] = self._switches.settle(self._x[:, on], self._c[:, on], t, on)
        x, t = self._x[:, lanes], steps.t[blocks]
        rates = self._rates(self._c[:, lanes], blocks)
        self._slope[:, lanes] = slope = rates(x, _by_lane(t))
        left = float(self._engine.times[-1]) - t
        control = self._engine.control
        to_come = np.minimum(control.growth * control.ahead * np.abs(slope), self._atol_of_size)
        self._atol[:, lanes] = np.maximum(self._atol[:, lanes], to_come)
        h = first_step(rates, x, slope, _by_lane(t), left, control.rtol, self._atol[:, lanes], WIDTH)
        steps.restart(t, h, blocks)

    def advance(self) -> None:
        """Run all blocks to the end."""
        steps, engine = self._steps, self._engine
        if len(engine.times) == 1:
            return
        while steps.live.size:
            t_new, h = steps.propose()
            t, wide = _by_lane(steps.t[steps.live]), _by_lane(h)
            k, x_new = stages(self._rates(self._c, steps.live), self._x, self._slope, t, wide)
            rtol = self._engine.control.rtol
            norm = error_norm(self._x, x_new, error_estimates(k, wide), rtol, self._atol).reshape(-1, WIDTH)
            accepted, stuck, exhausted = steps.judge(norm.max(axis=1), h)
            failed = stuck | exhausted
            if failed.any():
                self._stop(failed, ~(norm[failed] <= 1.0) | exhausted[failed, None])
                self.code[steps.live[exhausted]] = FailureCode.MANY
            if accepted.any():
                failed |= self._accept(accepted, k, x_new, t_new, h)
            self._select((self._next[steps.live] < len(engine.times)) & ~failed)

    def _stop(self, failed: Mask, lost: Mask) -> None:
        """Blocks that cannot go on without their lost lanes."""
        blocks, n_x = self._steps.live[failed], len(self._x)
        self.lost[blocks], self.t_stopped[blocks] = lost, self._steps.t[blocks]
        self.x_stopped.reshape(n_x, -1, WIDTH)[:, blocks] = self._x[:, _lanes(failed)].reshape(n_x, -1, WIDTH)

    def _accept(self, accepted: Mask, k: list[Array], x_new: Array, t_new: Array, h: Array) -> Mask:
        """Outputs and new states of accepted steps, which end at switches. Returns the blocks with lanes that stick."""
        engine, steps, switches = self._engine, self._steps, self._switches
        lanes, blocks = _lanes(accepted), steps.live[accepted]
        t, wide = _by_lane(steps.t[blocks]), _by_lane(h[accepted])
        x, c, end = self._x[:, lanes], self._c[:, lanes], x_new[:, lanes]
        rates = self._rates(c, blocks)
        last = rates(end, _by_lane(t_new[accepted]))
        t_end, F = t_new[accepted], np.empty(0)
        passed, which = np.zeros(x.shape[1], dtype=bool), np.zeros(x.shape[1], dtype=np.intp)
        searched = engine.switches is not None
        due = engine.times[np.minimum(self._next[blocks], len(engine.times) - 1)] <= t_end
        if searched or due.any():
            coefficients, missed = interpolant(rates, x, end, [*[slope[:, lanes] for slope in k], last], t, wide)
            error = interpolation_error(x, end, missed, engine.control.rtol, self._atol[:, lanes])
            error = error.reshape(-1, WIDTH).max(axis=1)
            far_off = ~(error <= 1.0) & (h[accepted] > 1.0000001 * steps.shortest)
            if far_off.any():
                steps.reject(blocks[far_off], error[far_off], h[accepted][far_off])
                return self._accept(_without(accepted, far_off), k, x_new, t_new, h)
            F = np.array(coefficients)
        if searched:
            theta, passed, which = switches.first_pass(x, end, F, c, t, _by_lane(t_new[accepted]), lanes)
            early = (theta < LATE) & (theta * h[accepted] > 10 * steps.shortest)
            if early.any():  # interpolants are as exact as steps near their ends only
                steps.h[blocks[early]] = theta[early] * h[accepted][early] * BEYOND
                switches.forget(lanes)
                return self._accept(_without(accepted, early), k, x_new, t_new, h)
            t_end = np.where(theta <= 1, steps.t[blocks] + theta * h[accepted], t_end)
            end = np.where(_by_lane(theta) <= 1, interpolated(x, F, np.minimum(_by_lane(theta), 1.0)), end)
        if F.size:
            self._sample_outputs(blocks, x, F, c, t_end, h[accepted])
        self._x[:, lanes] = end if engine.project is None else engine.project(end, c, _by_lane(t_end))
        # The slope before the projection serves the next step: it is as far off as the error of this one.
        self._slope[:, lanes] = last
        largest = engine.control.growth * np.abs(self._x[:, lanes])
        self._atol[:, lanes] = np.maximum(self._atol[:, lanes], largest)
        steps.t[blocks] = t_end
        sticks, restarts, settles = (np.zeros(len(steps.live), dtype=bool) for _ in range(3))
        restarts[accepted] = passed.reshape(-1, WIDTH).any(axis=1)
        if restarts.any():
            sticks[accepted] = self._change_sides(accepted, end, _by_lane(t_end), wide, passed, which)
        settles[accepted] = (t_end >= switches.stop[blocks]) & (t_end < engine.times[-1])
        if settles.any():
            switches.find_stops(steps.t, steps.live[settles])
        if (restarts | settles).any():
            self._restart(restarts | settles, settles)
        return sticks

    def _change_sides(self, accepted: Mask, end: Array, t: Array, h: Array, passed: Mask, which: Indices) -> Mask:
        """Change the sides of switches that lanes passed. Stops and returns the blocks with lanes that stick (b,)."""
        lanes, blocks = _lanes(accepted), self._steps.live[accepted]
        x, c = self._x[:, lanes], self._c[:, lanes]
        columns = (WIDTH * blocks[:, None] + np.arange(WIDTH)).ravel()
        located = passed & (which >= 0)
        for column, time in zip(columns[located].tolist(), t[located].tolist(), strict=True):
            self.passes[column].append(time)
        self._c[:, lanes], stuck = self._switches.change_sides(end, x, c, t, h, lanes, passed, which)
        sticks: Mask = np.asarray(stuck.any(axis=1), dtype=bool)
        if sticks.any():
            self._stop(_without(accepted, ~sticks), stuck[sticks])
            self.code[blocks[sticks]] = FailureCode.STICKS
        return sticks

    def _sample_outputs(self, blocks: Indices, x: Array, F: Array, c: Array, t_end: Array, h: Array) -> None:
        """Outputs of blocks that have passed an output time, up to all they have passed."""
        engine, t = self._engine, self._steps.t[blocks]
        Y = self.Y.reshape(*self.Y.shape[:2], -1, WIDTH)
        times, next = np.append(engine.times, np.inf), self._next[blocks]
        while (passed := times[next] <= t_end).any():  # a time at once for all blocks
            lanes, at = _lanes(passed), times[next[passed]]
            share = _by_lane((at - t[passed]) / h[passed])
            y = engine.outputs(interpolated(x[:, lanes], F[:, :, lanes], share), c[:, lanes], _by_lane(at))
            Y[next[passed], :, blocks[passed]] = y.reshape(engine.n_y, -1, WIDTH).transpose(1, 0, 2)
            next[passed] += 1
        self._next[blocks] = next

    def _select(self, going: Mask) -> None:
        """Go on with some blocks only."""
        if going.all():
            return
        lanes = _lanes(going)
        self._x, self._slope, self._c = self._x[:, lanes], self._slope[:, lanes], self._c[:, lanes]
        self._atol = self._atol[:, lanes]
        self._switches.select(lanes)
        self._steps.live = self._steps.live[going]


def _without(accepted: Mask, some: Mask) -> Mask:
    """The accepted blocks without some of them."""
    rest = accepted.copy()
    rest[accepted] = ~some
    return rest


def _by_lane(a: Array) -> Array:
    """One value for each block (B,) to one for each lane (8 B,)."""
    return np.repeat(a, WIDTH)


def _lanes(mask: Mask) -> Mask | slice:
    """The lanes of some blocks; all without a copy."""
    return slice(None) if mask.all() else np.repeat(mask, WIDTH)
