"""Runs of one problem for many samples: over the whole time grid in one call, or from one output time to the next."""

import io
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, redirect_stderr
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._interrupts import Interrupts
from symmb._types import Array, Mask
from symmb.events import Event
from symmb.integrate.marching import Marching
from symmb.integrate.side_walk import Stops, no_stops
from symmb.model import DAE
from symmb.symbolic import batch

_COUNTED = {
    "nsteps": "steps",
    "nfevals": "evaluations",
    "netfails": "error test failures",
    "nniters": "nonlinear iterations",
    "nncfails": "nonlinear convergence failures",
}


@dataclass(frozen=True)
class Run:
    """One run: X (n_t, n_x), quadratures (n_t, n_quad), where it broke down: nan or a time, with the reason; events."""

    X: Array
    quad: Array
    t_failed: float = np.nan
    message: str = ""
    events: tuple[Event, ...] = ()


class Integration:
    """Compiled runs over one time grid. They can be pickled: threads and processes get copies.

    Parameters
    ----------
    times : (n_t,) array                 [s]
    n_x, n_quad : int
    whole : Function, optional           (x0, z0, p) -> x (n_x, n_t), z, quad (n_quad, n_t) at all times
    between : Function, optional         (x0, z0, (p, begin, span)) -> x, z, quad at the end of one interval
    guess : Function                     (x, p, t) -> z0
    project : Function, optional         (x, p, t) -> x on the constraints
    marching : Marching, optional        the single steps of a scheme with a fixed step
    stops : x0, p -> Stops               switches of N samples, where steps end; optional
    units : (n_x,) array, optional       the Functions take and give states over these units
    """

    def __init__(
        self,
        times: Array,
        n_x: int,
        n_quad: int,
        whole: ca.Function | None,
        between: ca.Function | None,
        guess: ca.Function,
        project: ca.Function | None = None,
        marching: Marching | None = None,
        stops: Callable[[Array, Array], Stops] | None = None,
        units: Array | None = None,
    ) -> None:
        self.times = times
        self.n_x, self.n_quad = n_x, n_quad
        self._whole, self._between, self._guess, self._project = whole, between, guess, project
        self._marching, self._stops, self._units = marching, stops, units
        self._counted = False

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        """Integrate N samples, x0 (N, n_x), p (N, n_p), each by itself, on so many of CasADi's own threads.

        Python threads must not share CasADi objects (their reference counts are not atomic); its thread map may.

        Raises
        ------
        KeyboardInterrupt      at the end of the call of CasADi in which it arrives, which carries the runs so far
        """
        interrupts = Interrupts()
        runs = self._run(x0 if self._units is None else x0 / self._units, p, threads, interrupts)
        if self._units is not None:
            runs = [replace(run, X=run.X * self._units) for run in runs]
        interrupts.raise_with(runs)
        return runs

    def _run(self, x0: Array, p: Array, threads: int, interrupts: Interrupts) -> list[Run]:
        started: Mask = np.atleast_1d(np.isfinite(x0).all(axis=1))
        if not started.all():
            parts = iter(self._run(x0[started], p[started], threads, interrupts))
            return [next(parts) if ok else self._unstarted() for ok in started]
        stops = no_stops(len(p))
        if self._stops is not None:
            stops = self._stops(x0 if self._units is None else x0 * self._units, p)
        if self._whole is None or not len(x0) or stops.times.size:
            return [self._walk(x0[k], p[k], stops.of(k), interrupts) for k in range(len(x0))]
        try:
            self._counted = True
            (z0,) = batch(self._guess, x0, p, self.times[:1])
            with quiet(), interrupts:
                xf, _, qf, *_ = batch(self._whole, x0, z0, p, threads=threads)
        except RuntimeError:  # one failing sample fails the whole call; the walk finds out where
            if len(x0) > 1:
                samples = zip(x0[:, None], p[:, None], strict=True)
                return [run for sample in samples for run in self._run(*sample, 1, interrupts)]
            return [self._walk(x0[0], p[0], stops.of(0), interrupts)]
        X, quad = xf.swapaxes(1, 2), qf.swapaxes(1, 2)
        done: Mask = np.atleast_1d(np.isfinite(X).all(axis=(1, 2)))
        return [
            Run(X[k], quad[k]) if done[k] else self._walk(x0[k], p[k], stops.of(k), interrupts) for k in range(len(x0))
        ]

    def _unstarted(self) -> Run:
        n_t = len(self.times)
        message = "the start could not be solved for"
        return Run(np.full((n_t, self.n_x), np.nan), np.zeros((n_t, self.n_quad)), float(self.times[0]), message)

    def _walk(self, x0: Array, p: Array, stops: Stops, interrupts: Interrupts) -> Run:
        X = np.full((len(self.times), self.n_x), np.nan)
        quad = np.zeros((len(self.times), self.n_quad))
        X[0] = x = self.project(x0[None], p[None], 0)[0]
        advance = self._pieces(p, stops)
        for i in range(1, len(self.times)):
            if interrupts.noticed:
                return Run(X, quad, float(self.times[i - 1]), "interrupted")
            try:
                quad[i] = quad[i - 1]
                for begin, end in pieces_between(self.times[i - 1], self.times[i], stops.times):
                    with interrupts:
                        x, q = advance(begin, end, x)
                    quad[i] += q
            except RuntimeError as error:
                return Run(X, quad, float(self.times[i - 1]), _reason(error))
            if not np.isfinite(x).all():
                return Run(X, quad, float(self.times[i - 1]), "the state became infinite or NaN")
            X[i] = x = self.project(x[None], p[None], i)[0]
        return Run(X, quad)

    def _pieces(self, p: Array, stops: Stops) -> Callable[[float, float, Array], tuple[Array, Array]]:
        """(begin, end, x) -> x, quad of one sample, to be called for one piece between its stops after the other."""
        return lambda begin, end, x: self.advance(begin, end, x, p)

    def advance(self, begin: float, end: float, x: Array, p: Array) -> tuple[Array, Array]:
        """From one time to another, of one sample: x (n_x,), p (n_p,) -> x (n_x,), quad (n_quad,)."""
        if self._between is None:
            return x, np.zeros(self.n_quad)
        (z0,) = batch(self._guess, x[None], p[None], np.array([begin]))
        with quiet():
            xf, _, qf, *_ = batch(self._between, x[None], z0, np.hstack([p, begin, end - begin])[None])
        return xf[0], qf[0]

    def project(self, x: Array, p: Array, i: int) -> Array:
        """States (N, n_x) on the constraints of time i, if the solver projects."""
        return x if self._project is None else batch(self._project, x, p, self.times[i : i + 1])[0]

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        """All samples side by side, x0 (N, n_x), p (N, n_p): yields (i, x (N, n_x)) for every time.

        Raises
        ------
        PropagationError       if the solver chooses its steps, so that samples cannot share them
        """
        if self._marching is None:
            raise PropagationError(
                "Lockstep needs a solver with a fixed step, such as RungeKutta(), and more than one output time."
            )
        yield from self._marching.march(x0, p, self._project)

    def statistics(self) -> dict[str, int]:
        """Counts of the integrator in its last call over the whole time grid; empty without counts."""
        counted = self._whole.buffer()[0].stats() if self._whole is not None and self._counted else {}
        return {ours: counted[theirs] for theirs, ours in _COUNTED.items() if theirs in counted}


def stateless_integration(dae: DAE, times: Array, order: int = 0) -> Integration:
    """Runs of a scene without states, or of its Taylor coefficients up to an order."""
    n_p = len(dae.p_names) * (2 if order else 1)
    guess = ca.Function("guess", [ca.SX(0, 1), ca.SX.sym("p", n_p), ca.SX.sym("t")], [ca.SX(0, 1)])
    return Integration(times, 0, 0, None, None, guess)


def pieces_between(begin: float, end: float, stops: Array) -> Iterator[tuple[float, float]]:
    """An interval cut at stops. Pieces end before a stop, and begin behind it, by its rounding."""
    for stop in stops[(stops >= begin) & (stops <= end)].tolist():
        margin = 2 * np.spacing(max(abs(stop), 1e-3 * (end - begin)))
        if stop - margin > begin:
            yield begin, stop - margin
        begin = stop + margin
    if begin < end:
        yield begin, end


def quiet() -> AbstractContextManager[object]:
    """CasADi writes all arguments of a failing call to stderr. `Run.message` contains the reason."""
    return redirect_stderr(io.StringIO())


def _reason(error: RuntimeError) -> str:
    """The message of the integrator, without paths of CasADi's source."""
    text = str(error).strip().splitlines()[-1]
    return text.split(": ", 1)[-1].removesuffix(" documentation.").split(". Consult")[0]
