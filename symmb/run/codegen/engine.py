"""Ensembles in compiled lanes. Samples of a block share their steps, and blocks run on several threads."""

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symmb._types import Array
from symmb.declare.symbolic import instructions
from symmb.run.codegen.build import load
from symmb.run.codegen.c_source import c_fields
from symmb.run.codegen.contacts import BLAMED, CROWD, EVENT, Contacts
from symmb.run.codegen.failures import REASONS, FailureCode
from symmb.run.codegen.model_source import Scheme, Use, source_of
from symmb.run.codegen.threads import side_by_side
from symmb.run.schemes import CLASSICAL, MOST_STEPS


@dataclass(frozen=True)
class StepTolerances:
    """Step control by relative and absolute tolerances, with a longest step [s], which is 0 if there is no limit.

    The absolute tolerance of a state is `atol` times its size in `sizes` (n_x,), by default 1. In explicit steps, the
    tolerance begins with the fraction `least` of this value. It grows to `growth` times the largest value of the state,
    and to `growth` times the change that the slope predicts for the time `ahead`, up to `atol` times the size.
    """

    rtol: float
    atol: float
    longest: float = 0.0
    sizes: tuple[float, ...] = ()
    growth: float = 0.0
    least: float = 1.0
    ahead: float = 0.0

    def absolute(self, n_x: int) -> Array:
        """Absolute tolerances (n_x,), from the sizes of the states."""
        return self.atol * np.array([*self.sizes, *[1.0] * (n_x - len(self.sizes))])


@dataclass(frozen=True)
class FixedStep:
    """Equal steps between output times, with a longest step [s]."""

    longest: float


@dataclass(frozen=True, eq=False)
class StepEnds:
    """Ends of steps at switches of the state, and at switches of time.

    Attributes
    ----------
    hysteresis : m numbers         distance by which each switch of the state must be passed, larger than its rounding
    stops : x0, p -> (N, k)        ordered times at which steps of N samples end [s]; infinite after the last one
    """

    hysteresis: tuple[float, ...] = ()
    stops: Callable[[Array, Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class Lanes:
    """The equations and the method of an `Engine`.

    Attributes
    ----------
    f : Function                        from `model_function` or `scheme_function`. If f has a start, the engine
                                        computes the states at the start
    control : StepTolerances or FixedStep
    scheme : Scheme, optional           an implicit scheme. Default: the pair of Dormand and Prince with tolerances, or
                                        the classical Runge-Kutta method with a fixed step
    ends : StepEnds                     ends of steps, for the pair of Dormand and Prince
    contacts : Contacts, optional       contacts, for the same pair; the steps of each sample are then independent
    knots : places of tables of time, for single runs; see `TimeSwitches.linear`
    power : bool, optional              whether the last state of f, the integral of the power, is integrated. Default:
                                        there is no such state
    """

    f: ca.Function
    control: StepTolerances | FixedStep
    scheme: Scheme | None = None
    ends: StepEnds = field(default_factory=StepEnds)
    contacts: Contacts | None = None
    knots: tuple[Array, ...] = ()
    power: bool | None = None

    @property
    def n_x(self) -> int:
        """The number of states that are integrated."""
        return self.f.numel_in("x") - (self.power is False)


_EVENTS = 50
"""Number of events of a sample for which there is space at first. If there are more, the runs are made again."""
MOST_PASSES = 1000
"""Maximum number of recorded passes of switches of a sample. Other solvers end their steps only at recorded passes."""


_STAGES = 6
"""Number of evaluations of a model in a step of the pair of Dormand and Prince."""
_DATA: dict[str, Array] = {}
"""Name of pieces, which identifies their values -> these values. Open libraries read the arrays until Python ends."""


class Study(ctypes.Structure):
    """The struct `Study` of c/block.h."""

    _fields_ = c_fields(
        (ctypes.c_void_p, "x0 p times"),
        (ctypes.c_long, "n n_t"),
        (ctypes.c_double, "rtol growth ahead"),
        (ctypes.c_double, "least"),
        (ctypes.c_void_p, "atol"),
        (ctypes.c_double, "longest newton"),
        (ctypes.c_long, "most_steps next_block"),
        (ctypes.c_void_p, "t_failed failure x_failed Y stops"),
        (ctypes.c_long, "n_stops"),
        (ctypes.c_void_p, "passes"),
        (ctypes.c_long, "most_passes"),
        (ctypes.c_void_p, "reach"),
        (ctypes.c_long, "steps iterations most"),
        (ctypes.c_void_p, "events"),
        (ctypes.c_long, "n_events most_events"),
        (ctypes.c_void_p, "numbers"),
        (ctypes.c_long, "is_reduced"),
    )
    arrays: Mapping[str, np.ndarray | None]
    """The arrays to which the pointers point. They are kept here, because the study uses them."""


@dataclass(frozen=True)
class FailedSamples:
    """Failed samples: t_failed (N,) [s], nan for other samples, and failure (N,), an index of `REASONS`.

    The first columns of x_failed (N, ...) are the states of failed samples at the start of their last steps. `passes`
    (N, MOST_PASSES) are the first times at which samples pass switches of the state [s], nan after the last one, or
    None. `reach` (N, 2, m) are the smallest and largest values of the switches during a run, nan for failed samples.
    `events` (k, 14) are the events of contacts by sample, in the order of time; see `EVENT`. `faults` has, by sample
    number, the reasons why samples cannot start.
    """

    t_failed: Array
    failure: NDArray[np.int8]
    x_failed: Array
    passes: Array | None = None
    reach: Array | None = None
    events: Array = field(default_factory=lambda: np.empty((0, len(EVENT))))
    contacts: tuple[str, ...] = ()
    faults: Mapping[int, str] = field(default_factory=dict)

    @property
    def reasons(self) -> list[str]:
        """The reason of each failed sample."""
        codes = enumerate(self.failure.tolist())
        return [self.faults.get(i) or REASONS[code].format(self._blamed(i, code)) for i, code in codes]

    def _blamed(self, sample: int, code: int) -> str:
        """The reason of a failed sample, with the names of the contacts that cause the failure."""
        if code < FailureCode.IMMOVABLE:
            return ""
        own = self.events[self.events[:, 0] == sample]
        blamed = own[-CROWD:] if code == FailureCode.ENDLESS else own[own[:, 2] == BLAMED]
        return ", ".join(repr(name) for name in dict.fromkeys(self.contacts[int(k)] for k in blamed[:, 1]))


@dataclass(frozen=True)
class Counts:
    """Counts of the last call: steps of all blocks, iterations of Newton's method in all steps and in the worst step,
    and choices of independent coordinates.
    """

    steps: int = 0
    iterations: int = 0
    most: int = 0
    choices: int = 0


class Engine:
    """An initial value problem that is compiled for many samples.

    Parameters
    ----------
    lanes : Lanes
    times : (n_t,) array
        output times [s]

    Attributes
    ----------
    operations : int
        number of operations of a step
    """

    use: Use = "lanes"

    def __init__(self, lanes: Lanes, times: Array) -> None:
        f, scheme = lanes.f, lanes.scheme
        self.control, self.ends, self.contacts = lanes.control, lanes.ends, lanes.contacts
        self._room = _EVENTS if lanes.contacts else 0
        self.starts = "start" in f.name_out()
        self.n_x, self.n_y = lanes.n_x, f.numel_out("outputs")
        self.times = np.ascontiguousarray(times, dtype=float)
        self.newton = scheme.newton if scheme else 0.0
        self.counts, self.most_steps = Counts(), MOST_STEPS
        self.operations = f.n_instructions() * (1 if scheme else _STAGES)
        tableau = CLASSICAL if isinstance(lanes.control, FixedStep) else None
        self._source = source_of(f, scheme or tableau, lanes.ends.hysteresis, lanes.contacts, self.use, lanes.power)
        self._numbers = np.array(self._source.numbers)
        self._pieces = {entry.pieces.name: entry.pieces.data for entry in instructions(f).entries() if entry}
        self._open()

    def _open(self) -> None:
        shared = self._source.equations, self._source.engine
        self._library = load(self._source.task, "width", "work", shared=shared)
        for name, data in self._pieces.items():
            kept = _DATA.setdefault(name, data)
            ctypes.c_void_p.in_dll(self._library, name).value = kept.ctypes.data
        self.width = ctypes.c_int.in_dll(self._library, "width").value

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "_library"}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._open()

    @property
    def source(self) -> str:
        """The C source of the model and of the engine."""
        return self._source.text

    @property
    def _notes_passes(self) -> bool:
        """Whether there are switches that are not contacts, so that `values` records their passes."""
        return len(self.ends.hysteresis) > (len(self.contacts.names) if self.contacts else 0)

    @property
    def numbers(self) -> int:
        """Number of values, passes and numbers of events for which `values` has space for each sample."""
        return len(self.times) * self.n_y + MOST_PASSES * self._notes_passes + len(EVENT) * self._room

    def at(self, times: Array) -> "Engine":
        """A copy of this engine with other output times (n_t,). The first and the last time must be the same."""
        copy = object.__new__(type(self))  # not copy.copy, whose __setstate__ would open the library again
        vars(copy).update(vars(self))
        copy.times = np.ascontiguousarray(times, dtype=float)
        return copy

    def values(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, FailedSamples]:
        """Outputs (N, n_t, n_y) of N samples, which are nan after a sample failed, and the failed samples.

        The samples have states x0 (N, n_x), or (N, 0) if the engine computes the start, and parameters p (N, n_p).
        """
        Y = np.empty((len(p), len(self.times), self.n_y))
        return Y, self._run(x0, p, Y, [None] * threads)

    def extremes(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Array, FailedSamples]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail, and the failed samples."""
        extremes = np.full((threads, 2, len(self.times), self.n_y), np.inf)
        extremes[:, 1] = -np.inf
        failed_samples = self._run(x0, p, None, list(extremes))
        lower, upper = extremes[:, 0].min(axis=0), extremes[:, 1].max(axis=0)
        # -0 and 0 are equal, and which of them is found first depends on the threads. The sum makes both 0.
        return lower + 0.0, upper + 0.0, failed_samples

    def _study(self, n: int, n_stops: int, most_events: int, arrays: Mapping[str, np.ndarray | None]) -> Study:
        """The study of n samples with these arrays."""
        control = (
            self.control if isinstance(self.control, StepTolerances) else StepTolerances(0.0, 0.0, self.control.longest)
        )
        arrays = {**arrays, "times": self.times, "numbers": self._numbers, "atol": control.absolute(self.n_x)}
        study = Study(
            n=n,
            n_t=len(self.times),
            newton=self.newton,
            most_steps=self.most_steps,
            n_stops=n_stops,
            most_passes=MOST_PASSES,
            most_events=most_events,
            **{name: getattr(control, name) for name in ("rtol", "growth", "ahead", "least", "longest")},
            **{name: array.ctypes.data for name, array in arrays.items() if array is not None},
        )
        study.arrays = arrays
        return study

    def _run(self, x0: Array, p: Array, Y: Array | None, parts: list[Any]) -> FailedSamples:
        """Run the blocks on threads. They write values to Y, or to the extremes of each thread, which are its part."""
        N, faults, given = len(p), {}, x0
        if self.contacts is not None:
            x0, faults = self.contacts.started(self.times, x0, p)
        if not self.starts and x0.shape[1] < self.n_x:  # the history follows from the state
            x0 = np.hstack([x0, np.zeros((N, self.n_x - x0.shape[1]))])
        x0, p = np.ascontiguousarray(x0, dtype=float), np.ascontiguousarray(p, dtype=float)
        passes = np.full((N, MOST_PASSES), np.nan) if Y is not None and self._notes_passes else None
        notes = Y is not None and self.ends.hysteresis and self.use == "lanes"
        reach = np.full((N, 2, len(self.ends.hysteresis)), np.nan) if notes else None
        events = np.empty((N * self._room, len(EVENT)))
        failed_samples = FailedSamples(
            np.full(N, np.nan), np.zeros(N, dtype=np.int8), np.empty((N, self.n_x)), passes, reach
        )
        stops = None if self.ends.stops is None else np.ascontiguousarray(self.ends.stops(x0, p))
        arrays = {"x0": x0, "p": p, "Y": Y, "stops": stops, "events": events}
        arrays |= {
            name: getattr(failed_samples, name) for name in ("t_failed", "failure", "x_failed", "passes", "reach")
        }
        study = self._study(N, 0 if stops is None else stops.shape[1], len(events), arrays)

        self._execute(study, parts)
        if study.n_events > len(events):  # the repeated runs have the same number of events
            self._room = study.n_events // N + 1
            return self._run(given, p, Y, parts)
        self.counts = Counts(study.steps, study.iterations, study.most)
        if self.contacts is None:
            return failed_samples
        events = events[: study.n_events]
        events = events[np.argsort(events[:, 0], kind="stable")]
        return replace(failed_samples, events=events, contacts=self.contacts.names, faults=faults)

    def _execute(self, study: Study, parts: list[Any]) -> None:
        """Run the blocks of a study on threads. The study gets the values, or each thread extends its extremes."""

        def work(part: Array | None) -> bool:
            lower, upper = (None, None) if part is None else (a.ctypes.data for a in part)
            return bool(self._library.work(ctypes.byref(study), ctypes.c_void_p(lower), ctypes.c_void_p(upper)))

        if not all(side_by_side(work, parts[: max(1, -(-study.n // self.width))])):
            raise MemoryError("not enough memory for the compiled engine")
