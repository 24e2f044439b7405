"""The interface between bounding methods and simulations: parameters in, trajectories out, in blocks.

A simulator runs samples in blocks. The limits of the blocks depend on the sample number only. A reduction turns each
block into a small state, and the states are merged in block order. For this reason, all bits of the result are the same
if the blocks run one after another, in threads, in processes or on other machines.
"""

import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeGuard, TypeVar, runtime_checkable

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._magnitudes import ROUNDING
from symmb._options import numbers_of, require_instance, shown
from symmb._types import Array, Executor, Indices, Mask
from symmb.connect.tasks import LostTask, finished

if TYPE_CHECKING:
    import symmb.connect as connect

S = TypeVar("S")
Progress = Callable[[int, int], None]
"""A function of the number of finished samples and the number of all samples."""

RUNS_TOGETHER = 64
"""Number of samples of a repeated block: a multiple of the number of samples with common steps."""
BLOCK = 128
"""Number of samples of a block. Compiled scenes use `block_size` in `run/formulations/ensembles.py`. Loops over 128
samples are long enough for vector instructions, and 12 outputs at 1001 times take only 12 MB."""


class Samples(Protocol):
    """Trajectories of N samples at n_t times, computed at their first use. See `Ensemble`."""

    @property
    def Y(self) -> Array: ...
    @property
    def ok(self) -> Mask: ...
    @property
    def t_failed(self) -> Array: ...
    @property
    def messages(self) -> tuple[str, ...]: ...
    @property
    def events(self) -> Indices | None: ...
    @property
    def reach(self) -> Array | None: ...
    @property
    def attaining(self) -> Indices | None: ...
    def extremes(self) -> tuple[Array, Array]: ...


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Trajectories of N samples at n_t times.

    Attributes
    ----------
    Y : (N, n_t, n_y) outputs; nan from the first invalid time on if a sample failed
    ok : (N,) True for samples that did not fail
    t_failed : (N,) time at which a sample failed [s], nan if it did not fail
    messages : a message for each failed sample, in order
    events : (N, n_t) numbers of events up to each time; None without events. Outputs are smooth between events
    reach : (N, 2, m) smallest and largest value over time of each of m switches, such as the gap of a contact, nan in
        failed runs. Elements act on one side of 0. None if they are not known
    """

    Y: Array
    ok: Mask
    t_failed: Array
    messages: tuple[str, ...]
    events: Indices | None = None
    reach: Array | None = None

    @classmethod
    def of(cls, samples: Samples) -> "Ensemble":
        """The ensemble of some samples. Values that are not known yet are computed now."""
        return cls(samples.Y, samples.ok, samples.t_failed, samples.messages, samples.events, samples.reach)

    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail; inf and -inf if all failed."""
        Y = self.Y if self.ok.all() else self.Y[self.ok]
        return Y.min(axis=0, initial=np.inf), Y.max(axis=0, initial=-np.inf)

    @property
    def attaining(self) -> Indices | None:
        """Numbers (2, n_t, n_y) of the samples that attain the extremes; None if they are not known."""
        return None


@dataclass(frozen=True)
class Reduction(Generic[S]):
    """A reduction of trajectories to a small state. It can be pickled if its functions can be pickled.

    Attributes
    ----------
    init : () -> state before the first sample
    update : (state, block, indices) -> state after the block; ``indices`` (n,) are the sample numbers
    merge : (state, state) -> one state of all samples; the first state has the lower sample numbers
    trajectories : whether ``update`` uses ``block.Y``; if not, blocks may be larger
    attained : state -> smallest and largest values (n_t, n_y), and the numbers (2, n_t, n_y) of the samples that attain
        them, or None; if the state contains them
    """

    init: Callable[[], S]
    update: Callable[[S, Samples, Indices], S]
    merge: Callable[[S, S], S]
    trajectories: bool = True
    attained: Callable[[S], tuple[Array, Array, Indices | None]] | None = None


class Simulator(Protocol):
    """A source of trajectories for parameter samples: a symbolic model, a function, an external program."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """Nominal values by name, in the order of the columns of P."""
        ...

    @property
    def times(self) -> Array:
        """Output times (n_t,) [s]."""
        ...

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the n_y outputs."""
        ...

    def run(self, P: Array) -> Samples:
        """Run samples P (N, d) as one block in the calling process."""
        ...

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples P (N, d) block by block, and reduce each block."""
        ...


@runtime_checkable
class Jets(Protocol):
    """A simulator that gives derivatives of the trajectory with respect to parameters."""

    def jets(self, p0: Array, directions: Array, order: int) -> Array:
        """Taylor coefficients (order + 1, m, n_t, n_y) of y(t; p0 + eps u) in powers of eps, for m directions u.

        `directions` is (m, d). The point p0 is (d,), or (m, d) with one point for each direction.
        """
        ...


@runtime_checkable
class Kinked(Protocol):
    """A simulator that finds kinks and jumps of its equations in a run. Taylor expansions are not valid after them."""

    def kink(self, p0: Array) -> tuple[float, str] | None:
        """Time at which the run at p0 (d,) first meets a kink or a jump [s], and their names; None if it meets none."""
        ...


@runtime_checkable
class Noisy(Protocol):
    """A simulator that knows the errors of its output values."""

    @property
    def noise(self) -> Array | None:
        """Errors (n_y,) of the output values, in units of the outputs; None if not known."""
        ...


@runtime_checkable
class SecondLook(Protocol):
    """A simulator that finds errors of its output values, and warnings, from two runs at the nominal parameters."""

    def second_look(self) -> None:
        """Make the two runs at the first call. Later calls do nothing."""
        ...


def is_recorded(simulator: Simulator) -> "TypeGuard[connect.RecordedRuns]":
    """Whether a simulator is RecordedRuns, which make no new runs. Other studies do not load this class."""
    return getattr(type(simulator), "_is_recorded", False)


def noise_from_runs(simulator: Simulator) -> Array | None:
    """Errors (n_y,) of the output values, after `second_look` if the simulator has it; None if not known."""
    if hasattr(simulator, "second_look"):  # `isinstance` of a protocol takes as long as a run
        simulator.second_look()  # pyright: ignore[reportAttributeAccessIssue]
    return getattr(simulator, "noise", None)


@runtime_checkable
class March(Protocol):
    """A simulator that advances all samples together from one output time to the next."""

    def march(self, P: Array) -> Iterator[tuple[int, Array]]:
        """Pairs (i, Y_i (N, n_y)) for the times i = 0 ... n_t - 1; rows of failed samples are nan."""
        ...


def blocks(n: int, size: int = BLOCK) -> list[Indices]:
    """Sample numbers 0 ... n - 1, divided into ranges of ``size``; the last range may be shorter."""
    return [np.arange(start, min(start + size, n)) for start in range(0, n, size)]


def stream(
    simulator: Simulator,
    P: Array,
    reduction: Reduction[S],
    executor: Executor | None = None,
    progress: Progress | None = None,
    block: int = BLOCK,
) -> S:
    """Run samples P (N, d) in blocks, and merge their states in block order. ``Simulator.stream`` calls this function.

    Parameters
    ----------
    simulator : picklable if the executor runs in other processes
    executor : as for `executors.finished`
    progress : called after each block with the numbers of finished samples and of all samples
    block : samples of a block; must not depend on the executor
    """
    P = checked_samples(simulator, P, progress)
    starts = range(0, len(P), block)  # tasks are made when they are needed, because 1e8 samples take some GB
    tasks = ((P[i : i + block], np.arange(i, min(i + block, len(P)))) for i in starts)
    work = partial(_reduce_block, simulator, reduction)
    merging, arrived = Merging(reduction, progress, P), dict[int, Any]()
    for k, result in finished(work, tasks, executor):
        if isinstance(result, LostTask):
            raise SimulationError(f"{simulator!r}: {result.reason}")
        # Tasks end in any order. States are merged in block order, because sums depend on the order of their terms.
        arrived[k] = result
        while (part := arrived.pop(merging.count, None)) is not None:
            i = starts[merging.count]
            merging.add(part, np.arange(i, min(i + block, len(P))))
    return merging.state


class Merging(Generic[S]):
    """The merged state of the blocks so far, and the number of these blocks."""

    def __init__(self, reduction: Reduction[S], progress: Progress | None, P: Array) -> None:
        require_instance("stream: reduction", reduction, Reduction, "a Reduction")
        self.reduction, self.progress, self.P = reduction, progress, P
        self.state, self.count, self._done = reduction.init(), 0, 0

    def reduce(self, block: Samples, indices: Indices) -> None:
        """Reduce and merge the next block, in which samples do not depend on each other."""
        self.add(self.reduction.update(self.reduction.init(), block, indices), indices, block.Y)

    def add(self, part: S, indices: Indices, Y: Array | None = None) -> None:
        """Merge the state of the next block, with its outputs (n, n_t, n_y) if samples do not depend on each other."""
        self.state = self.reduction.merge(self.state, part)
        self.count += 1
        self._done += len(indices)
        if self.reduction.attained is not None:
            lower, upper, at = self.reduction.attained(part)
            first = indices[0]
            note_attained(lower, upper, self.P[first : first + len(indices)], Y, None if at is None else at - first)
        if self.progress is not None:
            self.progress(self._done, len(self.P))


def checked_samples(simulator: Simulator, P: Array, progress: Progress | None) -> Array:
    """Samples (N, d) of a simulator's parameters.

    DeclarationError is raised if their shape is wrong, a value is not finite, or progress is not a function.
    """
    if progress is not None and (isinstance(progress, type) or not callable(progress)):
        raise DeclarationError(f"progress: expected a function (finished runs, all runs), got {shown(progress)}.")
    numbers, width = numbers_of(P), len(simulator.parameters)
    if numbers is None:
        got = shown(P)[:100]
    elif not np.isfinite(numbers).all():
        got = "numbers that are not finite"
    elif numbers.ndim == 2 and numbers.shape[1] == width:
        return numbers
    else:
        got = f"the shape {numbers.shape}"
    raise DeclarationError(
        f"{simulator!r}: samples must be numbers of the shape (N, {width}), "
        f"one column for each of {', '.join(simulator.parameters)}; got {got}."
    )


def run_blocks(
    simulator: Simulator, P: Array, executor: Executor | None = None, progress: Progress | None = None
) -> Ensemble:
    """All trajectories of samples P (N, d), run in blocks."""
    return joined(list(simulator.stream(P, _GATHER, executor, progress)), len(simulator.times), len(simulator.outputs))


def joined(parts: list[Ensemble], n_t: int, n_y: int) -> Ensemble:
    """Join all parts to one ensemble, in the order of the list. Afterwards the list is empty."""
    if len(parts) == 1:
        return parts.pop()
    ok = np.concatenate([np.empty(0, dtype=bool), *(part.ok for part in parts)])
    t_failed = np.concatenate([np.empty(0), *(part.t_failed for part in parts)])
    messages = tuple(message for part in parts for message in part.messages)
    known: list[Any] = []
    for name in ("events", "reach"):
        each = [own for part in parts if (own := getattr(part, name)) is not None]
        known.append(np.concatenate(each) if each and len(each) == len(parts) else None)
    Y, filled = np.empty((len(ok), n_t, n_y)), 0
    while parts:  # each part is freed as soon as it is copied
        values = parts.pop(0).Y
        Y[filled : filled + len(values)] = values
        filled += len(values)
    return Ensemble(Y, ok, t_failed, messages, *known)


def _reduce_block(simulator: Simulator, reduction: Reduction[S], task: tuple[Array, Indices]) -> S:
    P, indices = task
    return reduction.update(reduction.init(), simulator.run(P), indices)


def _append(state: tuple[Ensemble, ...], block: Samples, indices: Indices) -> tuple[Ensemble, ...]:
    return (*state, Ensemble.of(block))


_GATHER: Reduction[tuple[Ensemble, ...]] = Reduction(init=tuple, update=_append, merge=operator.add)


class Attained:
    """The extreme output values of the runs so far.

    Attributes
    ----------
    lower, upper : (n_t, n_y) smallest and largest values
    runs : number of runs
    blocks : samples (n, d) of each block that attains an extreme value
    lower_at, upper_at : (n_t, n_y) numbers of the blocks that attain the extreme values
    reach : samples (n, d) with their reach (n, 2, m), see `Ensemble`
    nominal : (n_t, n_y) outputs of a run at the nominal parameters, up to rounding; None without such a run
    """

    def __init__(self, n_t: int, n_y: int, nominal_parameters: Array | None = None) -> None:
        self._nominal_parameters = nominal_parameters
        self.nominal: Array | None = None
        self.lower, self.upper, self.runs = np.full((n_t, n_y), np.inf), np.full((n_t, n_y), -np.inf), 0
        self.blocks: list[Array] = []
        self.reach: list[tuple[Array, Array]] = []
        self.lower_at, self.upper_at = np.zeros((2, n_t, n_y), dtype=np.intp)

    def add(self, lower: Array, upper: Array, P: Array, Y: Array | None, at: Indices | None, together: int = 1) -> None:
        """Add values (n_t, n_y) of samples P (n, d).

        With outputs Y (n, n_t, n_y), each group of `together` samples counts as a block. With numbers `at`
        (2, n_t, n_y) of the samples, each sample counts as a block.
        """
        if self.nominal is None and self._nominal_parameters is not None and Y is not None:
            distance = np.abs(P - self._nominal_parameters)
            is_nominal = (distance <= ROUNDING * np.abs(self._nominal_parameters)).all(axis=1)
            is_nominal &= np.isfinite(Y).all(axis=(1, 2))
            if is_nominal.any():
                self.nominal = np.array(Y[int(is_nominal.argmax())])
        sides = (self.lower_at, lower < self.lower, 1), (self.upper_at, upper > self.upper, -1)
        for k, (numbers, better, sign) in enumerate(sides):
            if not better.any():
                continue
            if at is not None:
                best = at[k][better]
            elif Y is not None:
                of_group = np.fmin if sign > 0 else np.fmax
                groups = Y if together == 1 else of_group.reduceat(Y, range(0, len(Y), together), axis=0)
                best = np.where(np.isnan(groups[:, better]), np.inf, sign * groups[:, better]).argmin(axis=0)
            else:
                numbers[better] = len(self.blocks)
                self.blocks.append(P.copy())
                continue
            rows, inverse = np.unique(best, return_inverse=True)
            numbers[better] = len(self.blocks) + inverse
            self.blocks += [P[row * together : (row + 1) * together].copy() for row in rows]
        np.minimum(self.lower, lower, out=self.lower)
        np.maximum(self.upper, upper, out=self.upper)
        self.runs += len(P)


_STUDY: ContextVar[Attained | None] = ContextVar("study", default=None)


@contextmanager
def attained_by_runs(n_t: int, n_y: int, nominal_parameters: Array | None = None) -> Iterator[Attained]:
    """A context that collects the extreme values of all runs inside it."""
    attained = Attained(n_t, n_y, nominal_parameters)
    token = _STUDY.set(attained)
    try:
        yield attained
    finally:
        _STUDY.reset(token)


def note_attained(
    lower: Array,
    upper: Array,
    P: Array,
    Y: Array | None = None,
    at: Indices | None = None,
    reach: Array | None = None,
    together: int = 1,
) -> None:
    """Add values of runs, as by `Attained.add`, to the innermost context `attained_by_runs` if there is a context."""
    study = _STUDY.get()
    if study is not None:
        study.add(lower, upper, P, Y, at, together)
        if reach is not None:
            study.reach.append((P, reach))
