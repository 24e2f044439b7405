"""All runs of an adaptive study, and the measures of errors."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Executor, Indices, Mask
from symmb.bounds.adaptive.constants import NODE_DIGITS, ROUNDING_WIDTH
from symmb.bounds.failure import Failure, failure_text
from symmb.bounds.method import parameter_samples
from symmb.bounds.reductions import failure_records
from symmb.model import Box
from symmb.polynomials import Expansion
from symmb.simulation import Progress, Simulator, note_attained, run_blocks


class EstimatedRange(NamedTuple):
    """Range of an interpolant, its estimated error, each (n_t, n_y), and its expansion over the box if it is whole.

    The expansion is made on call: it is as large as the runs, which are not needed any more then.
    """

    lower: Array
    upper: Array
    estimate: Array
    expansion: Callable[[], Expansion] | None


@dataclass
class Runs:
    """All runs of a study: at nodes, none of which is run twice, and at check points.

    A node whose run failed has the value that an interpolant predicts. Check points that failed are left out.

    Attributes
    ----------
    most : the runs that are allowed
    nodes : (N, n_t, n_y) responses at nodes
    events : (N, n_t) numbers of events at nodes up to each time; -1 where not known, None where there are none
    checks, points : (C, n_t, n_y) responses at other points, (C, d)
    extremes : smallest and largest responses of all runs (n_t, n_y)
    """

    simulator: Simulator
    box: Box
    most: int
    executor: Executor | None
    progress: Progress | None
    nodes: Array = field(init=False)
    checks: Array = field(init=False)
    points: Array = field(init=False)
    extremes: tuple[Array, Array] = field(init=False)
    events: Indices | None = None
    failed: tuple[Failure, ...] = ()

    def __post_init__(self) -> None:
        self.shape = len(self.simulator.times), len(self.simulator.outputs)
        self.nodes = self.checks = np.empty((0, *self.shape))
        self.extremes = np.full(self.shape, np.inf), np.full(self.shape, -np.inf)
        self.points = np.empty((0, len(self.box)))
        self._attained = np.empty(0, dtype=bool)
        self._row: dict[bytes, int] = {}

    def __len__(self) -> int:
        """Number of runs so far, with those that failed."""
        return len(self._attained) + len(self.checks) + len(self.failed) - int((~self._attained).sum())

    @property
    def left(self) -> int:
        """Runs that are still allowed."""
        return self.most - len(self)

    def unknown(self, points: Array) -> int:
        """How many of the points (N, d) are not nodes yet."""
        return sum(key not in self._row for key in _keys(points))

    def at(self, points: Array, predict: Callable[[Array], Array] | None = None) -> Indices:
        """Rows of ``nodes`` for points (N, d) of the unit box; ``predict`` gives the values of those that fail.

        Raises
        ------
        PropagationError        if a run fails and there is no prediction
        """
        keys = _keys(points)
        new = [i for i, key in enumerate(keys) if key not in self._row]
        self._row |= {keys[i]: len(self.nodes) + k for k, i in enumerate(new)}
        if new:
            Y, ok, events = self._run(points[new])
            if not ok.all():
                if predict is None:
                    raise PropagationError(
                        f"{len(self.failed)} of the first {len(new)} runs failed, too many to go on from. "
                        "PolynomialChaos(order=..., basis=TotalDegree()) can fit around some.\n"
                        + failure_text(self.failed)
                    )
                Y[~ok] = predict(points[new][~ok])
            if events is not None:
                events[~ok] = -1
                self.events = events if self.events is None else np.concatenate([self.events, events])
            self.nodes = np.concatenate([self.nodes, Y]) if len(self.nodes) else Y
            self._attained = np.concatenate([self._attained, ok])
        return np.array([self._row[key] for key in keys], dtype=np.intp)

    def check(self, points: Array) -> tuple[Array, Array]:
        """Run check points (C, d); returns those that are new and do not fail, and the responses there."""
        known = self._row.keys() | set(_keys(self.points))
        points = points[[key not in known for key in _keys(points)]]
        Y, ok, _ = self._run(points)
        Y, points = Y[ok], points[ok]
        self.checks, self.points = np.concatenate([self.checks, Y]), np.concatenate([self.points, points])
        return points, Y

    def rms_widths(self) -> Array:
        """Root mean square widths (n_y,), by which errors are measured; infinite if a width is only rounding."""
        low, high = self.extremes
        width, scale = rms(high - low), np.maximum(rms(low), rms(high))
        return np.where(width > ROUNDING_WIDTH * scale, width, np.inf)

    def _run(self, points: Array) -> tuple[Array, Mask, Indices | None]:
        """Responses (N, n_t, n_y), which did not fail (N,), and numbers of events (N, n_t)."""
        P = parameter_samples(self.simulator, self.box, points)
        ensemble = run_blocks(self.simulator, P, self.executor, self.progress)
        bad = np.flatnonzero(~ensemble.ok)
        failed_runs = tuple(zip(bad.tolist(), ensemble.t_failed[bad].tolist(), ensemble.messages, strict=True))
        self.failed += failure_records(self.simulator, self.box, P, failed_runs)
        low, high = ensemble.extremes()
        self.extremes = np.minimum(self.extremes[0], low), np.maximum(self.extremes[1], high)
        note_attained(low, high, len(P))
        return ensemble.Y, ensemble.ok, ensemble.events


def relative_rms(error: Array, widths: Array) -> float:
    """Largest over outputs of the root mean square of error (n_t, n_y) over the rms width (n_y,)."""
    return float(np.max(rms(error) / widths, initial=0.0))


def rms(a: Array) -> Array:
    """Root mean square over the first axis."""
    return np.sqrt(np.mean(np.square(a), axis=0))


def _keys(points: Array) -> list[bytes]:
    return [point.tobytes() for point in points.round(NODE_DIGITS) + 0.0]  # no -0
