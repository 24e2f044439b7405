"""The engine without a compiler: the steps of c/embedded_pair.h on NumPy arrays, all blocks of samples together."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.codegen.arrays import programs
from symmb.codegen.engine import MOST_STEPS, Counts, FailedSamples, Tolerances
from symmb.codegen.graph import graph_of
from symmb.schemes import dop853

WIDTH = 8
"""Samples that share a step, as in lanes.h."""
_TOGETHER = 128
"""Blocks advanced together: enough for long arrays, few enough for the processor's cache."""


class ArrayEngine:
    """An initial value problem for many samples; takes and gives what Engine does, some 30 times slower.

    It takes a number of threads as Engine does, but uses one: NumPy spends its time between arrays in Python, where
    threads take turns.
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
        """Blocks of samples, fixed by sample index, some together; `keep` takes (n_t, n_y, m), and whether m ended."""
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
        """Some blocks, and those of them that run again, as if the samples that were lost had not been there."""
        alive = [b[np.isnan(failed_samples.t_failed[b])] for b in blocks]
        alive = [b for b in alive if b.size]
        if not alive:
            return []
        # Lanes without a sample repeat one that has: they do not change the common step.
        lanes = np.array([np.resize(b, WIDTH) for b in alive])
        Y, lost, at, x = _advance(self, x0[lanes.ravel()].T, p[lanes.ravel()].T)
        finite = np.logical_and.reduce(np.isfinite(Y), axis=1).reshape(len(self.times), *lanes.shape)
        passed = ~(self.times[:, None, None] > at[:, None])
        irregular = ~np.logical_and.reduce(finite | ~passed, axis=0)
        # What happens first counts; what else would have happened shows when the block runs again.
        lost &= ~irregular.any(axis=1)[:, None]
        failed_samples.failure[lanes[irregular]] = 1
        failed_samples.t_failed[lanes[irregular]] = self.times[np.argmin(finite[:, irregular], axis=0)]
        failed_samples.t_failed[lanes[lost]] = np.broadcast_to(at[:, None], lost.shape)[lost]
        failed_samples.x_failed[lanes[lost]] = x.T[lost.ravel()]
        failed = lost | irregular
        again = failed.any(axis=1)
        final = (failed | ~again[:, None]) & (np.arange(WIDTH) < np.array([[b.size] for b in alive]))
        keep(Y if final.all() else Y[:, :, final.ravel()], lanes[final], ~failed[final])
        return [b for b, repeated in zip(alive, again.tolist(), strict=True) if repeated]


@dataclass
class _Blocks:
    """B blocks under way: x, slope (n_x, 8 B) and c (n_c, 8 B) by lane; number, t, h, next, before (B,) by block."""

    x: Array
    slope: Array
    c: Array
    number: Indices  # which of the blocks that were begun with
    t: Array
    h: Array
    next: Indices  # output time to come
    before: Array  # error of the step before

    def select(self, mask: Mask) -> None:
        """Go on with some blocks only."""
        lanes = _lanes(mask)
        self.x, self.slope, self.c = self.x[:, lanes], self.slope[:, lanes], self.c[:, lanes]
        for name in ("number", "t", "h", "next", "before"):
            setattr(self, name, getattr(self, name)[mask])


def _advance(engine: ArrayEngine, x: Array, p: Array) -> tuple[Array, Mask, Array, Array]:
    """From x (n_x, L), p (n_p, L): outputs (n_t, n_y, L), lost lanes (B, 8), and of blocks that stopped when (B,) and
    in what states (n_x, L), nan if they did not."""
    times, n_t, B = engine.times, len(engine.times), x.shape[1] // WIDTH
    Y, lost, at = np.full((n_t, engine.n_y, x.shape[1]), np.nan), np.zeros((B, WIDTH), dtype=bool), np.full(B, np.nan)
    left = np.full(x.shape, np.nan)
    t = np.full(B, times[0])
    c = engine.prepare(x, np.ascontiguousarray(p), _spread(t))
    x = np.ascontiguousarray(x) if engine.project is None else engine.project(x, c, _spread(t))
    engine.outputs(x, c, _spread(t), Y[0])
    if n_t == 1:
        return Y, lost, at, left
    end = times[-1]
    slope = engine.rates(x, c, _spread(t))
    h = _first_step(engine, x, c, slope, t, end - times[0])
    b = _Blocks(x, slope, c, np.arange(B), t, h, np.ones(B, dtype=int), np.full(B, 1e-4))
    shortest, longest = 1e-14 * (end - times[0]), engine.control.longest or np.inf
    for _ in range(MOST_STEPS):
        h = np.maximum(np.minimum(b.h, longest), shortest)
        final = b.t + h >= end
        t_new, h = np.where(final, end, b.t + h), np.where(final, end - b.t, h)
        k, x_new = _stages(engine, b, h)
        norm = _error_norm(engine, b.x, x_new, k, h)
        e = norm.max(axis=1)
        good = e <= 1.0
        stuck = ~good & (h <= shortest * 1.0000001)
        if stuck.any():
            lost[b.number[stuck]], at[b.number[stuck]] = ~(norm[stuck] <= 1.0), b.t[stuck]
            left.reshape(-1, B, WIDTH)[:, b.number[stuck]] = b.x.reshape(len(left), -1, WIDTH)[:, stuck]
        if good.any():
            lanes, t_good = _lanes(good), _spread(t_new[good])
            k[12][:, lanes] = engine.rates(x_new[:, lanes], b.c[:, lanes], t_good)
            _output(engine, b, good & (times[np.minimum(b.next, n_t - 1)] <= t_new), t_new, h, k, x_new, Y)
            # The slope before the projection serves the next step: it is as far off as the error of this one.
            x, b.slope[:, lanes] = x_new[:, lanes], k[12][:, lanes]
            b.x[:, lanes] = x if engine.project is None else engine.project(x, b.c[:, lanes], t_good)
            b.t = np.where(good, t_new, b.t)
        # A controller with memory keeps the step from swinging.
        longer = (0.9 * e ** (-1 / 8 + 0.2 * 0.04) * b.before**0.04).clip(0.333, 6.0)
        shorter = np.fmax(np.where(e < 1e300, 0.9 * e ** (-1 / 8), 0.1), 0.2)
        b.h = h * np.where(good, longer, shorter)
        b.before = np.where(good, np.fmax(e, 1e-4), 1e-4)
        going = (b.next < n_t) & ~stuck
        if not going.all():
            b.select(going)
        if not b.number.size:
            break
    lost[b.number], at[b.number] = True, b.t  # too many steps
    return Y, lost, at, left


def _stages(engine: ArrayEngine, b: _Blocks, h: Array) -> tuple[Array, Array]:
    """Slopes (16, n_x, L) before the end of the step, and x there."""
    k = np.empty((16, *b.x.shape))
    k[0] = b.slope
    for s in range(1, 12):
        _stage(engine, b.x, b.c, b.t, h, k, s)
    x_new = b.x + _spread(h) * _sum(dop853.B, k)
    return k, x_new


def _stage(engine: ArrayEngine, x: Array, c: Array, t: Array, h: Array, k: Array, s: int) -> None:
    at = _sum(dop853.A[s], k)
    at *= _spread(h)
    at += x
    engine.rates(at, c, _spread(t + dop853.C[s] * h), k[s])


def _output(
    engine: ArrayEngine, b: _Blocks, due: Mask, t_new: Array, h: Array, k: Array, x_new: Array, Y: Array
) -> None:
    """Outputs of those blocks that have passed an output time, up to all they have passed."""
    if not due.any():
        return
    lanes, was_due = _lanes(due), due
    x, x_new, c, k = b.x[:, lanes], x_new[:, lanes], b.c[:, lanes], k[:, :, lanes]
    t, h, t_new, due = b.t[due], h[due], t_new[due], np.ones(int(due.sum()), dtype=bool)
    for s in range(13, 16):
        _stage(engine, x, c, t, h, k, s)
    wide, d = _spread(h), x_new - x
    F = np.array([d, wide * k[0] - d, 2 * d - wide * (k[12] + k[0]), *(wide * _sum(row, k) for row in dop853.D)])
    Y = Y.reshape(*Y.shape[:2], -1, WIDTH)
    times, next, number = engine.times, b.next[was_due], b.number[was_due]
    while due.any():  # a time at once for all blocks
        due = (next < len(times)) & (times[np.minimum(next, len(times) - 1)] <= t_new)
        lanes, at = _lanes(due), times[next[due]]
        s = _spread((at - t[due]) / h[due])
        r, f = 1 - s, F[:, :, lanes]
        at_s = x[:, lanes] + s * (f[0] + r * (f[1] + s * (f[2] + r * (f[3] + s * (f[4] + r * (f[5] + s * f[6]))))))
        y = engine.outputs(at_s, c[:, lanes], _spread(at)).reshape(engine.n_y, -1, WIDTH)
        Y[next[due], :, number[due]] = y.transpose(1, 0, 2)
        next[due] += 1
    b.next[was_due] = next


def _error_norm(engine: ArrayEngine, x: Array, x_new: Array, k: Array, h: Array) -> Array:
    """The norm of Hairer's DOP853 (B, 8); lanes that are not finite show as NaN."""
    scale = 1.0 / (engine.control.atol + engine.control.rtol * np.maximum(np.abs(x), np.abs(x_new)))
    sum3, sum5 = (np.square(_sum(weights, k) * scale).sum(axis=0) for weights in dop853.E)
    denominator = sum5 + 0.01 * sum3
    norm = np.where(denominator > 0.0, _spread(h) * sum5 / np.sqrt(denominator * len(x)), denominator)
    return norm.reshape(-1, WIDTH)


def _first_step(engine: ArrayEngine, x: Array, c: Array, slope: Array, t: Array, span: float) -> Array:
    scale = 1.0 / (engine.control.atol + engine.control.rtol * np.abs(x))

    def worst(a: Array) -> Array:
        return np.sqrt(np.square(a * scale).sum(axis=0).reshape(-1, WIDTH).max(axis=1) / len(x))

    n0, n1 = worst(x), worst(slope)
    h0 = np.where((n0 < 1e-5) | (n1 < 1e-5), 1e-6, 0.01 * n0 / n1)
    h0 = np.where(h0 < span, h0, span)
    k1 = engine.rates(x + _spread(h0) * slope, c, _spread(t + h0))
    n2 = worst(k1 - slope) / h0
    most = np.where(n1 > n2, n1, n2)
    h1 = np.where(most <= 1e-15, np.fmax(1e-6, h0 * 1e-3), (0.01 / most) ** (1 / 8))
    h = np.where(100.0 * h0 < h1, 100.0 * h0, h1)
    return np.where(h < span, h, span)


def _sum(weights: Mapping[int, float], k: Array) -> Array:
    """Weighted slopes (n_x, L)."""
    (first, weight), *others = weights.items()
    total, term = weight * k[first], np.empty_like(k[0])
    for j, weight in others:
        total += np.multiply(k[j], weight, out=term)
    return total


def _spread(a: Array) -> Array:
    """One value for each block (B,) to one for each lane (8 B,)."""
    return np.repeat(a, WIDTH)


def _lanes(mask: Mask) -> Mask | slice:
    """The lanes of some blocks; all without a copy."""
    return slice(None) if mask.all() else np.repeat(mask, WIDTH)
