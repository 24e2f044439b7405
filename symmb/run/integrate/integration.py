"""Runs of one problem for many samples, in one call for all times or from one output time to the next."""

import io
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, redirect_stderr
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._interrupts import Interrupts
from symmb._types import Array, Indices, Mask
from symmb.declare.symbolic import batch, so_far
from symmb.equations.model import DAE, Lazy
from symmb.run.codegen import REASONS, FailureCode
from symmb.run.events import Event
from symmb.run.integrate.side_walk import Stops, no_stops

_COUNTED = {
    "nsteps": "steps",
    "nfevals": "evaluations",
    "netfails": "error test failures",
    "nniters": "nonlinear iterations",
    "nncfails": "nonlinear convergence failures",
}


RunAdvance = Callable[[float, float, Array], tuple[Array, Array]]
"""A function (begin, end, x (n_x,)) -> x, quad (n_quad,) for one sample."""


@dataclass(frozen=True)
class Run:
    """One run: states X (n_t, n_x), integrals (n_t, n_quad), time (or nan) and reason of a failure, and events.

    `stops` are the times at which the run passed switches [s]; None if the run does not store them.
    """

    X: Array
    quad: Array
    t_failed: float = np.nan
    message: str = ""
    events: tuple[Event, ...] = ()
    stops: Stops | None = None

    def at(self, which: Indices) -> "Run":
        """The run at the times with the given numbers, in this order."""
        return self if len(which) == len(self.X) else replace(self, X=self.X[which], quad=self.quad[which])


@dataclass(eq=False)
class Integration:
    """Compiled runs over one time grid. Threads and processes get pickled copies.

    Parameters
    ----------
    times : (n_t,) array                 output times [s]
    n_x, n_quad : int                    numbers of states and of integrals
    guess : Function                     (x, p, t) -> z0
    whole : Function, optional           (x0, z0, p) -> x (n_x, m), z, quad (n_quad, m) at its times
    between : Function, optional         (x0, z0, (p, begin, span)) -> x, z, quad at the end of an interval of `times`
    project : Function, optional         (x, p, t) -> x on the constraints
    stops : x0, p -> Stops, optional     switches of N samples, at which steps end
    units : (n_x + n_quad,), optional    inputs and results of the Functions are states and integrals over these units
    whole_times : (m,), (n_t,), optional times of `whole` [s], and indices of `times` in them. Default: `times`
    onward : Lazy of a Function, optional    `between` for intervals of the times of `whole`
    limit : (float, float)               number of steps per time of a usual run [1/s], and maximum number of further
                                         steps of one sample in intervals of the times of `whole`
    samples : bool                       whether `project` also computes sampled values, after which steps start again
    """

    times: Array
    n_x: int
    n_quad: int
    guess: ca.Function
    whole: ca.Function | None = None
    between: ca.Function | None = None
    project: ca.Function | None = None
    stops: Callable[[Array, Array], Stops] | None = None
    units: Array | None = None
    whole_times: tuple[Array, Indices] | None = None
    onward: Lazy[ca.Function] | None = None
    limit: tuple[float, float] = (np.inf, np.inf)
    samples: bool = False

    def __post_init__(self) -> None:
        self._fine, self._outputs = self.whole_times or (self.times, np.arange(len(self.times)))
        self._statistics: Counter[str] = Counter()

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        """Runs of N samples x0 (N, n_x), p (N, n_p), which do not share steps, on `threads` threads of CasADi.

        Python threads must not share CasADi objects, because their reference counts are not atomic.

        Raises
        ------
        KeyboardInterrupt      at the end of the current call of CasADi; the exception contains the runs so far
        """
        interrupts = Interrupts()
        n, units = self.n_x, self.units
        runs = self._run(x0 if units is None else x0 / units[:n], p, threads, interrupts)
        if units is not None:
            runs = [replace(run, X=run.X * units[:n], quad=run.quad * units[n:]) for run in runs]
        interrupts.raise_with(runs)
        return runs

    def _run(self, x0: Array, p: Array, threads: int, interrupts: Interrupts) -> list[Run]:
        self._statistics = Counter()
        started: Mask = np.atleast_1d(np.isfinite(x0).all(axis=1))
        if not started.all():
            parts = iter(self._run(x0[started], p[started], threads, interrupts))
            return [next(parts) if ok else self._unstarted() for ok in started]
        stops = no_stops(len(p))
        if self.stops is not None:
            stops = self.stops(x0 if self.units is None else x0 * self.units[: self.n_x], p)
        if self.whole is None or not len(x0) or stops.times.size:
            return [self._walk(x0[k], p[k], stops.of(k), interrupts) for k in range(len(x0))]
        (z0,) = batch(self.guess, x0, p, self.times[:1])
        runs = self._together(self.whole, x0, z0, p, threads, interrupts) if len(x0) > 1 else [None]
        samples = zip(runs, x0, z0, p, strict=True)
        return [run or self._alone(self.whole, x, z, values, interrupts) for run, x, z, values in samples]

    def _together(
        self, whole: ca.Function, x0: Array, z0: Array, p: Array, threads: int, interrupts: Interrupts
    ) -> list[Run | None]:
        """Runs of all samples in one call. The result is None for samples that fail, or for all samples if the call
        fails."""
        try:
            with quiet(), interrupts:
                xf, _, qf, *_ = batch(whole, x0, z0, p, threads=threads)
        except RuntimeError:
            return [None] * len(x0)
        self._statistics = _counts(whole)
        X, quad = xf.swapaxes(1, 2), qf.swapaxes(1, 2)
        done: Mask = np.atleast_1d(np.isfinite(X).all(axis=(1, 2)))
        return [Run(X[k], quad[k]).at(self._outputs) if done[k] else None for k in range(len(x0))]

    def _alone(self, whole: ca.Function, x0: Array, z0: Array, p: Array, interrupts: Interrupts) -> Run:
        """The run of one sample. If the call fails, a second call starts from the last known state."""
        times = self._fine
        X, quad = np.full((len(times), self.n_x), np.nan), np.zeros((len(times), self.n_quad))
        if not interrupts.noticed:
            with quiet(), interrupts:
                xf, _, qf, *_ = so_far(whole, x0, z0, p)
            X, quad = xf[0].T, qf[0].T
            self.count(whole)
        X[0], quad[0] = self._projected(x0, p, times[0]), 0.0
        known, run = np.atleast_1d(np.isfinite(X).all(axis=1)), Run(X, quad)
        if not known.all():
            last = int(known.argmin()) - 1
            X[last + 1 :], quad[last + 1 :] = np.nan, 0.0
            onward = partial(self.advance, self.onward() if self.onward else self.between, p)
            run = self._go_on(onward, run, times, last, p, no_stops(1).of(0), interrupts)
        return run.at(self._outputs)

    def _walk(self, x0: Array, p: Array, stops: Stops, interrupts: Interrupts) -> Run:
        """The run of one sample with restarts at stops and output times."""
        X, quad = np.full((len(self.times), self.n_x), np.nan), np.zeros((len(self.times), self.n_quad))
        X[0] = self._projected(x0, p, self.times[0])
        run = Run(X, quad, stops=stops if stops.passes.size else None)
        return self._go_on(self._pieces(p, stops), run, self.times, 0, p, stops, interrupts)

    def _pieces(self, p: Array, stops: Stops) -> RunAdvance:
        """A function that continues one sample to the end of the next piece between stops."""
        return partial(self.advance, self.between, p)

    def _go_on(
        self, advance: RunAdvance, run: Run, times: Array, last: int, p: Array, stops: Stops, interrupts: Interrupts
    ) -> Run:
        """The run, continued from the last known time to each later time."""
        x, (usual, spare), first = run.X[last], self.limit, self._statistics["steps"]
        for i, (begin, end) in enumerate(pairwise(times[last:].tolist()), start=last + 1):
            if interrupts.noticed:
                return replace(run, t_failed=begin, message="interrupted")
            run.quad[i] = run.quad[i - 1]
            for piece in pieces_between(begin, end, stops.times):
                if piece[0] > stops.sticks:
                    return replace(run, t_failed=float(stops.sticks), message=REASONS[FailureCode.STICKS])
                x = self._projected(x, p, piece[0]) if self.samples else x
                before = self._statistics["steps"]
                try:
                    with interrupts:
                        x, q = advance(*piece, x)
                except RuntimeError as error:
                    return replace(run, t_failed=piece[0], message=_reason(error))
                if not np.isfinite(x).all():
                    return replace(run, t_failed=piece[0], message="the state became infinite or NaN")
                spare -= max(self._statistics["steps"] - before - usual * (piece[1] - piece[0]), 0.0)
                if spare < 0:
                    steps = self._statistics["steps"] - first
                    return replace(run, t_failed=piece[0], message=f"{steps} steps are not enough")
                run.quad[i] += q
            run.X[i] = x = self._projected(x, p, end)
        return run

    def _unstarted(self) -> Run:
        n_t = len(self.times)
        message = "the start could not be computed"
        return Run(np.full((n_t, self.n_x), np.nan), np.zeros((n_t, self.n_quad)), float(self.times[0]), message)

    def advance(self, f: ca.Function | None, p: Array, begin: float, end: float, x: Array) -> tuple[Array, Array]:
        """The state (n_x,) and the integrals (n_quad,) of one sample at the time `end`. The function f advances the
        state x (n_x,) from `begin` with parameters p (n_p,)."""
        if f is None:
            return x, np.zeros(self.n_quad)
        (z0,) = batch(self.guess, x[None], p[None], np.array([begin]))
        with quiet():
            xf, _, qf, *_ = batch(f, x[None], z0, np.hstack([p, begin, end - begin])[None])
        self.count(f)
        return xf[0], qf[0]

    def count(self, f: ca.Function) -> None:
        """Add the counts of the last call of an integrator to `statistics`."""
        self._statistics.update(_counts(f))

    def _projected(self, x: Array, p: Array, t: float) -> Array:
        """The state (n_x,) of one sample at a time, projected onto the constraints if the solver projects."""
        return x if self.project is None else batch(self.project, x[None], p[None], np.array([t]))[0][0]

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        """Pairs (i, x (N, n_x)) for each time number i. All samples x0 (N, n_x), p (N, n_p) advance together.

        Raises
        ------
        PropagationError       if the solver has step control, so that samples cannot share steps
        """
        raise PropagationError(
            "Lockstep needs a solver with a fixed step, such as RungeKutta(), and more than one output time."
        )

    def statistics(self) -> dict[str, int]:
        """Counts of the integrator for its last samples; empty if the integrator has no counts."""
        return dict(self._statistics)


def _counts(integrator: ca.Function) -> Counter[str]:
    """Counts of the last call of an integrator; empty if the integrator has no counts."""
    counted = integrator.buffer()[0].stats()
    return Counter({ours: counted[theirs] for theirs, ours in _COUNTED.items() if theirs in counted})


def stateless_integration(dae: DAE, times: Array, order: int = 0) -> Integration:
    """The integration of a scene without states, also for Taylor coefficients up to `order`."""
    n_p = len(dae.p_names) * (2 if order else 1)
    guess = ca.Function("guess", [ca.SX(0, 1), ca.SX.sym("p", n_p), ca.SX.sym("t")], [ca.SX(0, 1)])
    return Integration(times, 0, 0, guess)


def pieces_between(begin: float, end: float, stops: Array) -> Iterator[tuple[float, float]]:
    """The pieces of an interval between stops. At a stop, a gap of some rounding errors remains."""
    for stop in stops[(stops >= begin) & (stops <= end)].tolist():
        margin = 2 * np.spacing(max(abs(stop), 1e-3 * (end - begin)))
        if stop - margin > begin:
            yield begin, stop - margin
        begin = stop + margin
    if begin < end:
        yield begin, end


def quiet() -> AbstractContextManager[object]:
    """A context without output on stderr, where CasADi writes all arguments of a failing call. `Run.message` contains
    the reason."""
    return redirect_stderr(io.StringIO())


def _reason(error: RuntimeError) -> str:
    """The message of the integrator, without paths of CasADi's source files."""
    text = str(error).strip().splitlines()[-1]
    return text.split(": ", 1)[-1].removesuffix(" documentation.").split(". Consult")[0]
