"""The engine without a compiler: the steps of c/embedded_pair.h on NumPy arrays, many blocks of samples together."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._interrupts import carry_runs
from symmb._types import Array, Indices, Mask
from symmb.codegen.arrays import programs
from symmb.codegen.block_runs import BlockRuns
from symmb.codegen.block_switches import WIDTH, Values
from symmb.codegen.contacts import Contacts
from symmb.codegen.engine import MOST_PASSES, Counts, FailedSamples, StepEnds, Tolerances
from symmb.codegen.failures import FailureCode
from symmb.codegen.graph import graph_of
from symmb.schemes import MOST_STEPS

_TOGETHER = 128
"""Blocks that advance together: enough for long arrays, few enough for the processor's cache."""


class ArrayEngine:
    """An initial value problem for many samples, with the interface of Engine. It is about 30 times slower.

    It uses one thread: most of the time is spent in Python, which runs one thread at a time.
    """

    starts, width = False, WIDTH
    together = _TOGETHER
    begins_anew = False

    def __init__(
        self,
        f: ca.Function,
        times: Array,
        control: Tolerances,
        ends: StepEnds | None = None,
        contacts: Contacts | None = None,
    ) -> None:
        self.n_y, self.contacts, self.counts = f.numel_out("outputs"), contacts, Counts()
        if contacts is not None:
            self.width, self.together = 1, self.together * WIDTH
        self.times, self.control, self.ends = times, control, ends or StepEnds()
        self.most_steps = MOST_STEPS
        self.prepare, functions = self.functions_of(f)
        by_name = dict(zip(f.name_out(), functions, strict=True))
        self.rates, self.outputs = by_name["rates"], by_name["outputs"]
        self.project, self.switches, self.bounds = (by_name.get(name) for name in ("project", "switches", "bounds"))
        self.notes_passes = len(self.ends.hysteresis) > (len(contacts.names) if contacts else 0)

    def functions_of(self, f: ca.Function) -> tuple[Values, Sequence[Values]]:
        """Values of parameters alone as a function of x, p and t, and each output of f as one of x, these and t."""
        return programs(graph_of(f))

    def at(self, times: Array) -> "ArrayEngine":
        """The same engine with other output times (n_t,), which begin and end as its own."""
        copy = object.__new__(type(self))
        vars(copy).update(vars(self))
        copy.times = np.ascontiguousarray(times, dtype=float)
        return copy

    def values(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, FailedSamples]:
        """Outputs of N samples, x0 (N, n_x), p (N, n_p).

        Returns
        -------
        (N, n_t, n_y) array        nan from the time on at which a sample stopped
        FailedSamples

        Raises
        ------
        KeyboardInterrupt          which carries the outputs so far
        """
        Y = np.full((len(x0), len(self.times), self.n_y), np.nan)

        def keep(part: Array, samples: Indices, regular: Mask) -> None:
            Y[samples] = part.transpose(2, 0, 1)

        try:
            return Y, self._run(x0, p, keep)
        except KeyboardInterrupt as interrupt:
            carry_runs(interrupt, list(Y))
            raise

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
        N, faults = len(x0), {}
        if self.contacts is not None:
            x0, faults = self.contacts.started(self.times, x0, p)
        passes = np.full((N, MOST_PASSES), np.nan) if self.notes_passes else None
        failed_samples = FailedSamples(
            np.full(N, np.nan), np.zeros(N, dtype=np.int8), np.full(x0.shape, np.nan), passes
        )
        failed_samples.t_failed[~np.isfinite(x0).all(axis=1)] = self.times[0]
        blocks = [np.arange(start, min(start + self.width, N)) for start in range(0, N, self.width)]
        events, together = [failed_samples.events], self.together
        self.counts = Counts()
        with np.errstate(all="ignore"):
            for k in range(0, len(blocks), together):
                part = blocks[k : k + together]
                while part:
                    part = self._part(x0, p, part, failed_samples, keep, events)
        if self.contacts is None:
            return failed_samples
        rows = np.concatenate(events)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        return replace(failed_samples, events=rows, contacts=self.contacts.names, faults=faults)

    def _part(
        self,
        x0: Array,
        p: Array,
        blocks: list[Indices],
        failed_samples: FailedSamples,
        keep: Callable[[Array, Indices, Mask], None],
        events: list[Array],
    ) -> list[Indices]:
        """Run some blocks. Returns those that must run again without their lost samples."""
        alive = [b[np.isnan(failed_samples.t_failed[b])] for b in blocks]
        alive = [b for b in alive if b.size]
        if not alive:
            return []
        # Lanes without a sample repeat another one, which does not change the common step.
        lanes = np.array([np.resize(b, self.width) for b in alive])
        run = BlockRuns(self, x0[lanes.ravel()].T, p[lanes.ravel()].T)
        try:
            run.advance()
        except KeyboardInterrupt:
            keep(run.Y, lanes.ravel(), np.ones(lanes.size, dtype=bool))
            raise
        self.counts = replace(self.counts, steps=self.counts.steps + run.n_steps)
        for rows in run.events.rows if run.events else ():
            rows[:, 0] = lanes.ravel()[rows[:, 0].astype(np.intp)]
            events.append(rows)
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
        final = (failed | ~again[:, None]) & (np.arange(self.width) < np.array([[b.size] for b in alive]))
        keep(Y if final.all() else Y[:, :, final.ravel()], lanes[final], ~failed[final])
        return [b for b, repeated in zip(alive, again.tolist(), strict=True) if repeated]
