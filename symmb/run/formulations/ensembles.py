"""Ensembles: the outputs of many runs of a DAE, and the messages of failed runs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import RLock
from typing import TYPE_CHECKING, cast

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb._units import values_text
from symmb.connect import BLOCK, Ensemble
from symmb.declare.symbolic import batch
from symmb.run.codegen import BLAMED, REASONS, Engine, FailedSamples
from symmb.run.formulations.formulation import Formulation
from symmb.run.integrate import Run

if TYPE_CHECKING:
    from symmb.run.codegen import CardEngine, Summary

LOCK = RLock()
"""A lock for Python threads that call CasADi, because CasADi's reference counts are not atomic. CasADi's own threads do
the computation."""
IRREGULAR_OUTPUT = REASONS[1]
NAMED_SAMPLES = 5
"""Number of failed samples of a block with messages that name joints. No more messages are printed."""
NUMBERS_ON_CARD = 2**25
"""Largest number of numbers that a card sends for a block, which take 0.3 GB."""

FAR = 1e100
"""Distance from a switch of parameters in place of infinity. Its differences do not overflow."""


def block_size(n_x: int, values: int, compiled: bool, keeps_trajectories: bool, on_card: bool = False) -> int:
    """Number of samples of a block, for n_x states and `values` output values of each sample. If the block is on a
    card, `values` are all numbers that the card sends for each sample."""
    small = max(1, min(8, 100 // max(n_x, 1)))  # small models have larger blocks
    if on_card:  # cards run many samples at once
        return max(BLOCK, NUMBERS_ON_CARD // values) if keeps_trajectories else 2**17 * small
    if not n_x:
        # Number of values of a block of a scene without states. A call takes much longer than its overhead.
        return max(BLOCK, 10**6 // values)
    if not compiled:
        return BLOCK
    # Number of samples of a block for the engine. tests/benchmarks/ensemble.py
    return 1024 * (1 if keeps_trajectories else small)


def ensemble_of_runs(form: Formulation, times: Array, Y: Array, runs: list[Run], P: Array) -> Ensemble:
    """The Ensemble of N runs with parameters P (N, d) and outputs Y (N, n_t, n_y) at times (n_t,)."""
    ok = np.array([not run.message and bool(np.isfinite(y).all()) for run, y in zip(runs, Y, strict=True)], dtype=bool)
    t_failed = np.full(len(runs), math.nan)
    for k in np.flatnonzero(~ok):
        first_irregular = times[int(np.argmin(np.isfinite(Y[k]).all(axis=1)))]
        t_failed[k] = runs[k].t_failed if runs[k].message else first_irregular
    reasons = [run.message or IRREGULAR_OUTPUT for run in runs]
    events = None
    if form.dae.impacts is not None:
        event_times = [[event.time for event in run.events] for run in runs]
        events = np.array([np.searchsorted(when, times, "right") for when in event_times], dtype=np.intp)
    texts = failure_texts(form, P, t_failed, reasons, lambda k: (runs[k].X, times))
    return Ensemble(Y, ok, t_failed, texts, events, reach_of_parameters(form, P, ok))


def ensemble_of_expressions(form: Formulation, P: Array, times: Array, threads: int) -> Ensemble:
    """The outputs of a scene without states for N samples P (N, d), in one call."""
    N, n_t = len(P), len(times)
    arguments = (np.zeros((N * n_t, 0)), np.repeat(P, n_t, axis=0), np.tile(times, N)[:, None])
    Y = batch(form.y, *arguments, threads=threads)[0].reshape(N, n_t, -1)
    faults = form.start.states(P)[1]  # no state can be nan
    Y[[k for k, fault in enumerate(faults) if fault]] = np.nan
    finite = np.asarray(np.isfinite(Y).all(axis=2), dtype=bool)
    ok: Mask = np.asarray(finite.all(axis=1), dtype=bool)
    t_failed = np.where(ok, np.nan, times[finite.argmin(axis=1)])
    no_states, reasons = (np.zeros((0, 0)), times[:0]), [fault or IRREGULAR_OUTPUT for fault in faults]
    texts = failure_texts(form, P, t_failed, reasons, lambda k: no_states)
    return Ensemble(Y, ok, t_failed, texts, reach=reach_of_parameters(form, P, ok))


def reach_of_parameters(form: Formulation, P: Array, ok: Mask) -> Array | None:
    """Values (N, 2, m) of the switches of parameters in samples P (N, d), nan for samples that are not ok; None without
    such switches. See `Ensemble`."""
    if (switches := form.parameter_switches) is None:
        return None
    values = np.nan_to_num(batch(switches, P)[0].reshape(len(P), -1), posinf=FAR, neginf=-FAR)
    values = np.where(ok[:, None], values, np.nan)
    return np.repeat(values[:, None], 2, axis=1)


def failure_texts(
    form: Formulation, P: Array, t_failed: Array, reasons: Sequence[str], states: Callable[[int], tuple[Array, Array]]
) -> tuple[str, ...]:
    """A text for each failed sample, with time, parameters and reason.

    The first texts name the joints of a singular position, if there is one. `states` gives for a sample some states
    (m, n_x), which may be nan, and their times (m,).
    """
    texts = []
    for k in np.flatnonzero(np.isfinite(t_failed)).tolist():
        values = values_text(form.dae.p_names, P[k], form.dae.p_units)
        near = None
        if len(texts) < NAMED_SAMPLES:
            near = form.singularity(*states(k), P[k])
        texts.append(f"t = {t_failed[k]:g} s{values and f', {values}'}: {reasons[k]}{f'; {near}' if near else ''}")
    return tuple(texts)


@dataclass(eq=False)
class CompiledEnsemble:
    """An Ensemble from the engine. Trajectories or extremes are computed at their first use."""

    form: Formulation
    engine: Engine
    P: Array
    t_start: float
    threads: int

    def __post_init__(self) -> None:
        self._x0 = np.empty((len(self.P), 0)) if self.engine.starts else self.form.start.states(self.P)[0]
        self._failed: FailedSamples | None = None

    @property
    def Y(self) -> Array:
        """Outputs (N, n_t, n_y), which are nan after a sample failed."""
        return self._trajectories

    @cached_property
    def _trajectories(self) -> Array:
        Y, self._failed = self.engine.values(self._x0, self.P, self.threads)
        return Y

    @property
    def attaining(self) -> Indices | None:
        """Numbers (2, n_t, n_y) of the samples that attain the extremes; None if they are not known."""
        return None

    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail; inf and -inf if all failed."""
        if "_trajectories" in self.__dict__:
            return Ensemble(self.Y, self.ok, self.t_failed, ()).extremes()
        lower, upper, self._failed = self.engine.extremes(self._x0, self.P, self.threads)
        return lower, upper

    @property
    def failed_samples(self) -> FailedSamples:
        """The failed samples, as the engine reports them."""
        if self._failed is None:
            _ = self.Y
        return cast(FailedSamples, self._failed)

    @property
    def events(self) -> Indices | None:
        """Number (N, n_t) of events of contacts up to each time; None in scenes without contacts."""
        if self.engine.contacts is None:
            return None
        rows = self.failed_samples.events
        rows = rows[rows[:, 2] != BLAMED]
        counts = np.zeros((len(self.P), len(self.engine.times) + 1), dtype=np.intp)
        np.add.at(counts, (rows[:, 0].astype(np.intp), np.searchsorted(self.engine.times, rows[:, 3])), 1)
        return np.cumsum(counts[:, :-1], axis=1)

    @property
    def reach(self) -> Array | None:
        """Smallest and largest values (N, 2, m) over time of the switches; see `Ensemble`."""
        own = (reach_of_parameters(self.form, self.P, self.ok), self.failed_samples.reach)
        known = [each for each in own if each is not None]
        return np.concatenate(known, axis=2) if known else None

    @property
    def t_failed(self) -> Array:
        """Time (N,) at which a sample failed [s]; nan if it did not fail."""
        return self.failed_samples.t_failed

    @property
    def ok(self) -> Mask:
        """Mask (N,) of the samples that did not fail."""
        return np.isnan(self.t_failed)

    @property
    def messages(self) -> tuple[str, ...]:
        """A message for each failed sample, in order."""
        failed = self.failed_samples
        if self.ok.all():
            return ()
        reasons = failed.reasons
        at_start = np.flatnonzero(self.t_failed == self.t_start)
        with LOCK:
            start_faults = self.form.start.states(self.P[at_start])[1] if at_start.size else ()
        for k, fault in zip(at_start.tolist(), start_faults, strict=True):
            reasons[k] = fault or reasons[k]
        X = failed.x_failed[:, : self.form.y.numel_in(0)]
        return failure_texts(self.form, self.P, failed.t_failed, reasons, lambda k: (X[[k]], failed.t_failed[[k]]))


@dataclass(eq=False)
class CardEnsemble(CompiledEnsemble):
    """An Ensemble from a graphics card, which also reduces the outputs, because their transfer takes longer than runs.

    In a second, a card makes 1e7 runs of the double pendulum with outputs of 1 TB, and it transfers 50 GB.
    """

    engine: "CardEngine"

    @cached_property
    def _summary(self) -> "Summary":
        summary, self._failed = self.engine.summary(self._x0, self.P)
        return summary

    @property
    def attaining(self) -> Indices | None:
        return None if "_trajectories" in self.__dict__ else self._summary.at

    def extremes(self) -> tuple[Array, Array]:
        return super().extremes() if "_trajectories" in self.__dict__ else (*self._summary.ends,)

    def moments(self) -> tuple[Array, Array]:
        """Means and standard deviations (n_t, n_y) of the outputs of samples that did not fail; 0 without samples."""
        return self._summary.mean, self._summary.sigma

    def histogram(self, output: int, ends: Array, bins: int) -> Indices:
        """Numbers of samples that did not fail, see `CardEngine.histogram`."""
        counts, self._failed = self.engine.histogram(self._x0, self.P, output, ends, bins)
        return counts
