"""Ensembles in compiled lanes: steps of W samples in parallel, in blocks on several threads."""

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symmb._types import Array
from symmb.declare.symbolic import called
from symmb.run.codegen.build import load
from symmb.run.codegen.contacts import BLAMED, CROWD, EVENT, Contacts
from symmb.run.codegen.failures import REASONS, FailureCode
from symmb.run.codegen.model_source import Scheme, source_of
from symmb.run.codegen.threads import side_by_side
from symmb.run.schemes import MOST_STEPS


@dataclass(frozen=True)
class Tolerances:
    """Step control by relative and absolute tolerances, with a longest step [s], 0 for no limit.

    The absolute tolerance of a state is `atol` times its `sizes` (n_x,), 1 if left out. With explicit steps it follows
    the state: it is `growth` times the largest value so far, or the one that a slope leads to in the time `ahead` up to
    the size, and at least the share `least` of that.
    """

    rtol: float
    atol: float
    longest: float = 0.0
    sizes: tuple[float, ...] = ()
    growth: float = 0.0
    least: float = 1.0
    ahead: float = 0.0

    def absolute(self, n_x: int) -> Array:
        """Absolute tolerances (n_x,) by the sizes of the states."""
        return self.atol * np.array([*self.sizes, *[1.0] * (n_x - len(self.sizes))])


@dataclass(frozen=True)
class FixedStep:
    """Equal steps between output times, with a longest step [s]."""

    longest: float


@dataclass(frozen=True, eq=False)
class StepEnds:
    """Where steps end besides: at switches of the state, and at switches of time.

    Attributes
    ----------
    hysteresis : m numbers         by which each switch of the state must be passed, above its rounding
    stops : x0, p -> (N, k)        where steps of N samples end in order, infinite behind the last one [s], or None
    """

    hysteresis: tuple[float, ...] = ()
    stops: Callable[[Array, Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class Lanes:
    """What an `Engine` runs.

    Attributes
    ----------
    f : from `model_function` or `scheme_function`; with a start the engine computes the states at the start
    control : Tolerances or FixedStep
    scheme : Scheme, optional           without one, steps are those of the pair of Dormand and Prince with tolerances,
                                        and of the classical Runge-Kutta method with a fixed step
    ends : StepEnds                     switches, for the pair of Dormand and Prince
    contacts : Contacts, optional       for the same: samples then have steps of their own
    knots : places of tables of time, for single runs; see `TimeSwitches.linear`
    """

    f: ca.Function
    control: Tolerances | FixedStep
    scheme: Scheme | None = None
    ends: StepEnds = field(default_factory=StepEnds)
    contacts: Contacts | None = None
    knots: tuple[Array, ...] = ()


_EVENTS = 50
"""Events of a sample for which there is room at first: with more, the runs are made again."""
MOST_PASSES = 1000
"""Passes of switches of a sample that are noted: with more, other solvers end their steps at the first ones only."""


_DATA: dict[str, Array] = {}
"""What libraries read, which stay open: pieces by their names, which tell their values."""


class _Study(ctypes.Structure):
    """Study of c/block.h."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("x0", "p", "times")),
        ("n", ctypes.c_long),
        ("n_t", ctypes.c_long),
        ("rtol", ctypes.c_double),
        ("growth", ctypes.c_double),
        ("ahead", ctypes.c_double),
        ("least", ctypes.c_double),
        ("atol", ctypes.c_void_p),
        ("longest", ctypes.c_double),
        ("newton", ctypes.c_double),
        ("most_steps", ctypes.c_long),
        ("next_block", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("t_failed", "failure", "x_failed", "Y")),
        ("stops", ctypes.c_void_p),
        ("n_stops", ctypes.c_long),
        ("passes", ctypes.c_void_p),
        ("most_passes", ctypes.c_long),
        *((name, ctypes.c_long) for name in ("steps", "iterations", "most")),
        ("events", ctypes.c_void_p),
        *((name, ctypes.c_long) for name in ("n_events", "most_events")),
    ]


@dataclass(frozen=True)
class FailedSamples:
    """Failed samples: t_failed (N,) [s], nan for others, and the failure (N,), an index of `REASONS`.

    The first columns of x_failed (N, ...) are the states where the last steps of failed samples began. `passes` are the
    first times (N, MOST_PASSES) at which samples pass switches of the state [s], nan behind the last one; None without.
    `events` (k, 8) are those of contacts, sample after sample and in order of time, see `EVENT`. `faults` are texts
    about samples that cannot start.
    """

    t_failed: Array
    failure: NDArray[np.int8]
    x_failed: Array
    passes: Array | None = None
    events: Array = field(default_factory=lambda: np.empty((0, len(EVENT))))
    contacts: tuple[str, ...] = ()
    faults: Mapping[int, str] = field(default_factory=dict)

    @property
    def reasons(self) -> list[str]:
        """The reason of each failed sample."""
        codes = enumerate(self.failure.tolist())
        return [self.faults.get(i) or REASONS[code].format(self._blamed(i, code)) for i, code in codes]

    def _blamed(self, sample: int, code: int) -> str:
        """Names of the contacts that let a sample fail."""
        if code < FailureCode.IMMOVABLE:
            return ""
        own = self.events[self.events[:, 0] == sample]
        blamed = own[-CROWD:] if code == FailureCode.ENDLESS else own[own[:, 2] == BLAMED]
        return ", ".join(repr(name) for name in dict.fromkeys(self.contacts[int(k)] for k in blamed[:, 1]))


@dataclass(frozen=True)
class Counts:
    """Counts of the last call: steps of all blocks, iterations of Newton's method, the most in a step, and choices of
    independent coordinates.
    """

    steps: int = 0
    iterations: int = 0
    most: int = 0
    choices: int = 0


class Engine:
    """An initial value problem compiled for many samples.

    Parameters
    ----------
    lanes : Lanes
    times : (n_t,) array
        output times [s]
    """

    def __init__(self, lanes: Lanes, times: Array) -> None:
        f, scheme = lanes.f, lanes.scheme
        self.control, self.ends, self.contacts = lanes.control, lanes.ends, lanes.contacts
        self._room = _EVENTS if lanes.contacts else 0
        self.starts = "start" in f.name_out()
        self.n_x, self.n_y = f.numel_in("x"), f.numel_out("outputs")
        self.times = np.ascontiguousarray(times, dtype=float)
        self.newton = scheme.newton if scheme else 0.0
        self.counts, self.most_steps = Counts(), MOST_STEPS
        fixed = isinstance(lanes.control, FixedStep)
        self.source = source_of(f, fixed, scheme, lanes.ends.hysteresis, lanes.contacts)
        self._pieces = {entry.pieces.name: entry.pieces.data for call in called(f).values() for entry in call if entry}
        self._open()

    def _open(self) -> None:
        self._library = load(self.source, "width", "work")
        for name, data in self._pieces.items():
            kept = _DATA.setdefault(name, data)
            ctypes.c_void_p.in_dll(self._library, name).value = kept.ctypes.data
        self.width = ctypes.c_int.in_dll(self._library, "width").value

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "_library"}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._open()

    def at(self, times: Array) -> "Engine":
        """The same engine with other output times (n_t,), which begin and end as its own."""
        copy = object.__new__(type(self))
        vars(copy).update(vars(self))
        copy.times = np.ascontiguousarray(times, dtype=float)
        return copy

    def values(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, FailedSamples]:
        """Outputs of N samples, x0 (N, n_x), p (N, n_p); x0 is (N, 0) if the engine computes the start.

        Returns
        -------
        (N, n_t, n_y) array        nan from the time on at which a sample stopped
        FailedSamples
        """
        Y = np.full((len(p), len(self.times), self.n_y), np.nan)
        return Y, self._run(x0, p, Y, [None] * threads)

    def extremes(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Array, FailedSamples]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail, and those that did."""
        extremes = np.full((threads, 2, len(self.times), self.n_y), np.inf)
        extremes[:, 1] = -np.inf
        failed_samples = self._run(x0, p, None, list(extremes))
        lower, upper = extremes[:, 0].min(axis=0), extremes[:, 1].max(axis=0)
        return lower + 0.0, upper + 0.0, failed_samples  # -0 and 0 are equal, and their order depends on the threads

    def _run(self, x0: Array, p: Array, Y: Array | None, extremes: list[Array | None]) -> FailedSamples:
        """Run blocks of W samples, fixed by sample index, on threads. Values go to Y or to extremes of a thread."""
        N, faults, given = len(p), {}, x0
        if self.contacts is not None:
            x0, faults = self.contacts.started(self.times, x0, p)
        if not self.starts and x0.shape[1] < self.n_x:  # the history follows from the state
            x0 = np.hstack([x0, np.zeros((N, self.n_x - x0.shape[1]))])
        x0, p = np.ascontiguousarray(x0, dtype=float), np.ascontiguousarray(p, dtype=float)
        notes = Y is not None and len(self.ends.hysteresis) > (len(self.contacts.names) if self.contacts else 0)
        passes = np.full((N, MOST_PASSES), np.nan) if notes else None
        events = np.empty((N * self._room, len(EVENT)))
        failed_samples = FailedSamples(np.full(N, np.nan), np.zeros(N, dtype=np.int8), np.empty((N, self.n_x)), passes)
        stops = None if self.ends.stops is None else np.ascontiguousarray(self.ends.stops(x0, p))
        control = self.control
        tolerances, atol = (0.0, 0.0, 0.0, 1.0), np.zeros(self.n_x)
        if isinstance(control, Tolerances):
            tolerances = control.rtol, control.growth, control.ahead, control.least
            atol = control.absolute(self.n_x)
        study = _Study(
            x0.ctypes.data,
            p.ctypes.data,
            self.times.ctypes.data,
            N,
            len(self.times),
            *tolerances,
            atol.ctypes.data,
            control.longest,
            self.newton,
            self.most_steps,
            0,
            failed_samples.t_failed.ctypes.data,
            failed_samples.failure.ctypes.data,
            failed_samples.x_failed.ctypes.data,
            _address(Y),
            _address(stops),
            0 if stops is None else stops.shape[1],
            _address(passes),
            MOST_PASSES,
            0,
            0,
            0,
            events.ctypes.data,
            0,
            len(events),
        )

        def work(part: Array | None) -> bool:
            lower, upper = (None, None) if part is None else (a.ctypes.data for a in part)
            return bool(self._library.work(ctypes.byref(study), ctypes.c_void_p(lower), ctypes.c_void_p(upper)))

        if not all(side_by_side(work, extremes[: max(1, -(-N // self.width))])):
            raise MemoryError("not enough memory for the compiled engine")
        if study.n_events > len(events):
            self._room = study.n_events // N + 1
            return self._run(given, p, Y, extremes)
        self.counts = Counts(study.steps, study.iterations, study.most)
        if self.contacts is None:
            return failed_samples
        events = events[: study.n_events]
        events = events[np.argsort(events[:, 0], kind="stable")]
        return replace(failed_samples, events=events, contacts=self.contacts.names, faults=faults)


def _address(a: Array | None) -> int | None:
    return None if a is None else a.ctypes.data
