"""The engine without a compiler: the steps of c/embedded_pair.h on NumPy arrays, many blocks of samples together."""

from collections.abc import Callable

import casadi as ca
import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.codegen.arrays import programs
from symmb.codegen.c_source import c_number
from symmb.codegen.engine import Counts, FailedSamples, Tolerances
from symmb.codegen.graph import graph_of
from symmb.codegen.model_source import FailureCode
from symmb.schemes import StepControl, error_estimates, error_norm, first_step, interpolant, interpolated, stages

WIDTH = int(c_number("lanes", "WIDTH"))
"""Samples that share a step."""
_TOGETHER = 128
"""Blocks that advance together: enough for long arrays, few enough for the processor's cache."""


class ArrayEngine:
    """An initial value problem for many samples, with the interface of Engine. It is about 30 times slower.

    It uses one thread: most of the time is spent in Python, which runs one thread at a time.
    """

    width = WIDTH
    starts = False
    counts = Counts(0, 0, 0)

    def __init__(self, f: ca.Function, times: Array, control: Tolerances) -> None:
        self.n_y = f.numel_out("outputs")
        self.times, self.control = times, control
        self.prepare, (self.rates, self.outputs, *project) = programs(graph_of(f))
        self.project = project[0] if project else None

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
        failed_samples = FailedSamples(np.full(N, np.nan), np.zeros(N, dtype=np.int8), np.full(x0.shape, np.nan))
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
        failed_samples.failure[lanes[run.exhausted]] = FailureCode.MANY
        failed_samples.failure[lanes[irregular]] = FailureCode.OUTPUT
        failed_samples.t_failed[lanes[irregular]] = self.times[np.argmin(finite[:, irregular], axis=0)]
        failed_samples.t_failed[lanes[lost]] = np.broadcast_to(at[:, None], lost.shape)[lost]
        failed_samples.x_failed[lanes[lost]] = x.T[lost.ravel()]
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
    lost : (B, 8)                        lanes whose errors are too large at the shortest step
    t_stopped : (B,)                     when blocks with lost lanes stopped, nan for others [s]
    x_stopped : (n_x, 8 B)               where they did
    exhausted : (B,)                     blocks that took too many steps
    """

    def __init__(self, engine: ArrayEngine, x: Array, p: Array) -> None:
        times, B = engine.times, x.shape[1] // WIDTH
        self._engine, self._tolerances = engine, (engine.control.rtol, engine.control.atol)
        self.Y = np.full((len(times), engine.n_y, x.shape[1]), np.nan)
        self.lost, self.t_stopped = np.zeros((B, WIDTH), dtype=bool), np.full(B, np.nan)
        self.exhausted = np.zeros(B, dtype=bool)
        self.x_stopped = np.full(x.shape, np.nan)
        t = np.full(B, times[0])
        self._c = engine.prepare(x, np.ascontiguousarray(p), _by_lane(t))
        self._x = np.ascontiguousarray(x) if engine.project is None else engine.project(x, self._c, _by_lane(t))
        self._next = np.ones(B, dtype=int)  # output time to come
        engine.outputs(self._x, self._c, _by_lane(t), self.Y[0])
        self._slope = engine.rates(self._x, self._c, _by_lane(t))
        span = float(times[-1] - times[0])
        h = first_step(self._rates(self._c), self._x, self._slope, _by_lane(t), span, *self._tolerances, WIDTH)
        self._steps = StepControl(t, h, times[-1], span, engine.control.longest)

    def _rates(self, c: Array) -> Callable[[Array, Array], Array]:
        return lambda x, t: self._engine.rates(x, c, t)

    def advance(self) -> None:
        """Run all blocks to the end."""
        steps, engine = self._steps, self._engine
        if len(engine.times) == 1:
            return
        while steps.live.size:
            t_new, h = steps.propose()
            t, wide = _by_lane(steps.t[steps.live]), _by_lane(h)
            k, x_new = stages(self._rates(self._c), self._x, self._slope, t, wide)
            norm = error_norm(self._x, x_new, error_estimates(k, wide), *self._tolerances).reshape(-1, WIDTH)
            accepted, stuck, exhausted = steps.judge(norm.max(axis=1), h)
            failed = stuck | exhausted
            if failed.any():
                self._stop(failed, exhausted, norm)
            if accepted.any():
                self._accept(accepted, k, x_new, t_new, h)
            self._select((self._next[steps.live] < len(engine.times)) & ~failed)

    def _stop(self, failed: Mask, exhausted: Mask, norm: Array) -> None:
        """Blocks that cannot go on: their lanes with too large an error are lost, or all after too many steps."""
        blocks, n_x = self._steps.live[failed], len(self._x)
        self.lost[blocks] = ~(norm[failed] <= 1.0) | exhausted[failed, None]
        self.exhausted[blocks], self.t_stopped[blocks] = exhausted[failed], self._steps.t[blocks]
        self.x_stopped.reshape(n_x, -1, WIDTH)[:, blocks] = self._x[:, _lanes(failed)].reshape(n_x, -1, WIDTH)

    def _accept(self, accepted: Mask, k: list[Array], x_new: Array, t_new: Array, h: Array) -> None:
        engine, steps, lanes, t_end = self._engine, self._steps, _lanes(accepted), _by_lane(t_new[accepted])
        last = np.empty_like(x_new)
        last[:, lanes] = engine.rates(x_new[:, lanes], self._c[:, lanes], t_end)
        due = accepted & (engine.times[np.minimum(self._next[steps.live], len(engine.times) - 1)] <= t_new)
        if due.any():
            self._sample_outputs(due, [*k, last], x_new, t_new, h)
        # The slope before the projection serves the next step: it is as far off as the error of this one.
        x, self._slope[:, lanes] = x_new[:, lanes], last[:, lanes]
        self._x[:, lanes] = x if engine.project is None else engine.project(x, self._c[:, lanes], t_end)
        steps.t[steps.live[accepted]] = t_new[accepted]

    def _sample_outputs(self, due: Mask, k: list[Array], x_new: Array, t_new: Array, h: Array) -> None:
        """Outputs of blocks that have passed an output time, up to all they have passed."""
        engine, lanes, blocks = self._engine, _lanes(due), self._steps.live[due]
        x, c, t, h, t_new = self._x[:, lanes], self._c[:, lanes], self._steps.t[blocks], h[due], t_new[due]
        slopes = [slope[:, lanes] for slope in k]
        F = np.array(interpolant(self._rates(c), x, x_new[:, lanes], slopes, _by_lane(t), _by_lane(h)))
        Y = self.Y.reshape(*self.Y.shape[:2], -1, WIDTH)
        times, next = np.append(engine.times, np.inf), self._next[blocks]
        while (passed := times[next] <= t_new).any():  # a time at once for all blocks
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
        self._steps.live = self._steps.live[going]


def _by_lane(a: Array) -> Array:
    """One value for each block (B,) to one for each lane (8 B,)."""
    return np.repeat(a, WIDTH)


def _lanes(mask: Mask) -> Mask | slice:
    """The lanes of some blocks; all without a copy."""
    return slice(None) if mask.all() else np.repeat(mask, WIDTH)
