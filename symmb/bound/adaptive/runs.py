"""The runs of an adaptive study, and the measures of errors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import LAST_DIGITS, SAME
from symmb._types import Array, Executor, Indices, Mask
from symmb.bound.adaptive.check_points import SAFETY, has_few_shapes, quasi_random_points
from symmb.bound.adaptive.clock import Clock
from symmb.bound.nodes import Grid
from symmb.bound.polynomials import Expansion, TotalDegree, basis_values
from symmb.bound.responses import (
    DOUBTFUL,
    Failure,
    Rounds,
    failure_records,
    failure_text,
    find_failed_region,
    parameter_samples,
    rests_for_a_time,
    rms,
)
from symmb.connect import RUNS_TOGETHER, Progress, Simulator, noise_from_runs, note_attained, run_blocks
from symmb.equations.model import Box
from symmb.run.simulation import SceneSimulator, motion_of

TRUST = 0.6
"""Smallest ratio of an interpolant's error after check runs to the earlier estimate. The error of a surface's extremes
has the same ratio to the error at the latest runs. Smaller ratios miss more extremes. Larger ratios take more runs."""
CHEAP_RUNS = 60
"""Number of runs up to which uncertain bounds are always refined. Above this number, a few runs measure the noise."""
NOISE_RUNS, NOISE_SPACING = 5, 1e-7
"""Number of runs on a short line from which noise is measured, and their distance in the unit box. The exact response
is linear along this line. Fewer runs measure the noise less reliably."""
UNKNOWN_SHARE = 1.2 * DOUBTFUL
"""Smallest error divided by the width, near failed runs and at extremes from searches. These errors cannot be measured.
Smaller values miss more errors without a warning. Larger values cause more needless warnings."""
_ORDINARY_POWER = 300
"""Largest exponent of two of stored numbers (1e90), because they are squared. Above half of it, numbers are scaled."""


class OutgrownError(Exception):
    """Values of new runs are too large for the scale of their output. The study starts again with another scale."""


@dataclass
class Runs:
    """All runs of a study, at nodes and at check points. No node is run twice.

    If the run at a node fails, its value is predicted by an interpolant. Check points with failed runs are left out.
    Responses of the simulator are divided by 2^power.

    Attributes
    ----------
    whole, box : the box of the study, and its parameters that vary, with d names
    most : allowed number of runs
    probes : requested number of further check runs, evenly spread over the box
    clock : limits the time of the study
    power : (n_y,) exponents of two; 0 for outputs with squares that neither overflow nor underflow
    before : number of runs before the study began again with larger powers
    rounding : ratio of width to scale of an output below which the width is only rounding
    is_attained : (N,) mask of the nodes with successful runs
    events : (N, n_t) numbers of events at nodes up to each time; -1 if not known. None if there are no events
    places : (N, d) nodes
    checks, points : (C, n_t, n_y) responses at other points, (C, d)
    tried, ok : (M, d) all points that were run, and (M,) mask of successful runs
    noise : (n_y,) error of responses, stated by the simulator or measured; 0 before it is measured
    extremes : smallest and largest responses of all runs (n_t, n_y)
    first : the largest grid of `first_grid`; None before it is run
    lack : whether a study needed more runs than are left
    rounds : the rounds of the study until now, for its trace
    """

    simulator: Simulator
    whole: Box
    most: int
    executor: Executor | None
    progress: Progress | None
    clock: Clock
    probes: int = 0
    before: int = 0
    events: Indices | None = None
    failed: tuple[Failure, ...] = ()

    def __post_init__(self) -> None:
        self._varied = self.whole.radius > 0
        self.box = self.whole.part(self._varied)
        self.shape = len(self.simulator.times), len(self.simulator.outputs)
        self._blocks: list[Array] = []  # interpolants need no copy of these arrays
        self.checks = np.empty((0, *self.shape))
        self.extremes = np.full(self.shape, np.inf), np.full(self.shape, -np.inf)
        self.points = self.places = self.tried = np.empty((0, len(self.box)))
        self.ok = np.empty(0, dtype=bool)
        self.power = np.zeros(self.shape[1], dtype=np.intp)
        self._least_power = np.full(self.shape[1], np.iinfo(np.int32).min)
        self._largest = np.zeros(self.shape[1])
        self._widths: Array | None = None
        self._scale = np.full(self.shape[1], np.inf)  # root mean square (n_y,) of the extremes
        with self.clock.of_runs():  # the rounding of a scene takes runs, and compiles the scene
            self._told = noise_from_runs(self.simulator)
        self.noise_is_known = self._told is not None
        self.noise = np.zeros(self.shape[1])
        self.rounding = SAME if self._told is None else LAST_DIGITS
        self.is_attained = np.empty(0, dtype=bool)
        self._row: dict[bytes, int] = {}
        self.first: Grid | None = None
        self.lack = False
        self.rounds = Rounds()

    def __len__(self) -> int:
        """Number of runs so far, including failed runs."""
        return self.before + len(self.tried)

    @property
    def has_lanes(self) -> bool:
        """Whether the simulator runs samples side by side, so that runs cost little."""
        return isinstance(self.simulator, SceneSimulator)

    def cost_little(self, most_operations: int) -> bool:
        """Whether a run takes less time than a decision, because samples advance side by side in few operations."""
        motion = motion_of(self.simulator)
        return motion is not None and motion.program.runs_in_lanes and motion.formulation.operations <= most_operations

    @property
    def left(self) -> int:
        """Number of runs that are still allowed."""
        return self.most - len(self)

    def anew(self) -> "Runs":
        """An empty set of runs with the required powers, and the number of runs that are left."""
        runs = replace(self, before=len(self), events=None, failed=())
        runs._least_power, runs.rounds = self._least_power, self.rounds
        return runs

    @property
    def nodes(self) -> Array:
        """Responses (N, n_t, n_y) at nodes."""
        if len(self._blocks) > 1:
            self._blocks = [np.concatenate(self._blocks)]
        return self._blocks[0]

    def interpolant(self, grid: Grid, rows: Indices) -> Expansion:
        """The polynomial through the responses at the nodes of these rows (N,), in named parameters."""
        coefficients = grid.coefficients(*(Y.reshape(len(Y), -1) for Y in self._blocks), rows=rows)
        return Expansion(grid.alpha, coefficients.reshape(len(rows), *self.shape), self.box.names)

    def unknown(self, points: Array) -> int:
        """Number of points (N, d) that are not nodes yet."""
        return len(set(_keys(points)).difference(self._row))

    def at(self, points: Array, predict: Callable[[Array], Array] | None = None) -> Indices:
        """Rows of ``nodes`` for points (N, d) of the unit box. ``predict`` gives the values of failed nodes.

        Without ``predict``, a quadratic polynomial through the other nodes gives the values. PropagationError is raised
        if most nodes fail.
        """
        keys = _keys(points)
        if new := [i for i, key in enumerate(keys) if key not in self._row]:
            self._store(points[new], *self._made_runs("node", points[new]), predict)
        return np.array([self._row[key] for key in keys], dtype=np.intp)

    def begin(self, nodes: Array, points: Array) -> Indices:
        """Rows of the first nodes (N, d). The nodes and the first check points (C, d) are run together."""
        n = len(nodes)
        Y, ok, events = self._run(np.concatenate([nodes, points]))
        self.rounds.made |= {"node": n, "check run": len(points)}
        self._store(nodes, Y[:n], ok[:n], None if events is None else events[:n], None)
        self.checks, self.points = Y[n:][ok[n:]], points[ok[n:]]
        return np.arange(n)

    def _store(
        self, points: Array, Y: Array, ok: Mask, events: Indices | None, predict: Callable[[Array], Array] | None
    ) -> None:
        """Store the runs at new nodes (N, d). Failed nodes get predicted values."""
        self._row |= {key: len(self.is_attained) + k for k, key in enumerate(_keys(points))}
        if predict is None and 2 * ok.sum() < len(ok):
            raise PropagationError(
                f"{len(self.failed)} of the first {len(self.tried)} runs failed, so the study cannot continue.\n"
                + failure_text(self.failed)
            )
        if not ok.all():
            # An interpolant needs a value at each node. A smooth continuation of the other values keeps coefficients
            # small.
            predict = predict or _quadratic(points[ok], Y[ok])
            Y[~ok] = predict(points[~ok])
        if events is not None:
            events[~ok] = -1
            self.events = events if self.events is None else np.concatenate([self.events, events])
        self._blocks.append(Y)
        self.places = np.concatenate([self.places, points])
        self.is_attained = np.concatenate([self.is_attained, ok])

    def check(self, points: Array) -> tuple[Array, Array]:
        """Run check points (C, d). Return the new points with successful runs, and their responses (C, n_t, n_y)."""
        known = self._row.keys() | set(_keys(self.points))
        points = points[[key not in known for key in _keys(points)]]
        Y, ok, _ = self._made_runs("check run", points)
        Y, points = Y[ok], points[ok]
        self.checks, self.points = np.concatenate([self.checks, Y]), np.concatenate([self.points, points])
        return points, Y

    def tell(self, study: str, rule: str, errors: Array, columns: Sequence[int] | None = None) -> None:
        """Report the relative errors (m,) of outputs as progress, and as a step of the trace. A rule decides them."""
        k = int(np.argmax(errors))
        after = float(errors[k])
        if hasattr(self.progress, "estimate"):
            self.progress.estimate(after)  # pyright: ignore[reportFunctionMemberAccess, reportOptionalMemberAccess]
        output = self.simulator.outputs[k if columns is None else columns[k]]
        self.rounds.add(study, rule, output, after)

    def rms_widths(self) -> Array:
        """Root mean square widths (n_y,), the units of errors; infinite if a width is only rounding."""
        if self._widths is None:
            low, high = self.extremes
            width = rms(high - low)
            self._widths = np.where(width > np.maximum(self.rounding * self._scale, 2 * self.noise), width, np.inf)
        return self._widths

    @property
    def floor(self) -> Array:
        """Errors (n_y,) that are caused by noise or rounding."""
        return np.maximum(self.noise, self.rounding * self._scale)

    def suffice(self, number: int) -> bool:
        """Whether enough runs are left. If not, `lack` becomes true."""
        self.lack |= number > self.left
        return number <= self.left

    def is_near_lost(self, places: Array) -> Mask:
        """Mask (...) of the points (..., d) whose nearest run, or most of whose nearby runs, failed."""
        if self.ok.all():
            return np.zeros(places.shape[:-1], dtype=bool)
        near, which = np.unique(places.reshape(-1, places.shape[-1]).round(2), axis=0, return_inverse=True)
        is_lost = _distance(near, self.tried[~self.ok]) < _distance(near, self.tried[self.ok])
        region = find_failed_region(self.box, self.tried, ~self.ok)
        if region is not None and 2 * region.inside[0] > region.inside[1]:
            is_lost |= region.contains(near)
        return is_lost[which.ravel()].reshape(places.shape[:-1])

    def beyond(self, lower: Array, upper: Array) -> Array:
        """Distance (n_t, n_y) by which runs exceed bounds, without noise."""
        lowest, highest = self.extremes
        return np.maximum(np.maximum(lower - lowest, highest - upper) - self.noise, 0.0)

    def measure_noise(self) -> None:
        """Measure the noise on a short line, along which exact responses are straight, if enough runs are left."""
        d = len(self.box)
        middle, direction = quasi_random_points(9, d)[-2:]  # earlier points are check points
        self.noise_is_known = True
        if NOISE_RUNS > self.left:
            return
        along = np.arange(NOISE_RUNS) - 0.5 * (NOISE_RUNS - 1)
        Y, ok, _ = self._made_runs("noise run", middle + NOISE_SPACING * along[:, None] * direction)
        if (freedom := int(ok.sum()) - 2) > 0:
            # The residual of a straight line is noise. The line takes two degrees of freedom.
            line, _ = np.linalg.qr(np.vander(along[ok], 2))
            rest = Y[ok] - np.tensordot(line, np.tensordot(line, Y[ok], axes=(0, 0)), axes=1)
            self.noise = SAFETY * np.sqrt(np.square(rest).sum(axis=0).mean(axis=0) / freedom)
            self._widths = None

    def _made_runs(self, purpose: str, points: Array) -> tuple[Array, Mask, Indices | None]:
        """What `_run` returns. The runs are counted for the next step of the trace."""
        before = len(self)
        found = self._run(points)
        self.rounds.made[purpose] += len(self) - before
        return found

    def _run(self, points: Array) -> tuple[Array, Mask, Indices | None]:
        """Responses (N, n_t, n_y), a mask (N,) of successful runs, and numbers of events (N, n_t).

        Points that failed before are not run again.
        """
        lost = set(_keys(self.tried[~self.ok]))
        if (again := np.array([key in lost for key in _keys(points)], dtype=bool)).any():
            values, fine, numbers = self._run(points[~again])
            Y, ok = np.full((len(points), *self.shape), np.nan), np.zeros(len(points), dtype=bool)
            Y[~again], ok[~again] = values, fine
            events = None
            if numbers is not None:
                events = np.full((len(points), self.shape[0]), -1)
                events[~again] = numbers
            return Y, ok, events
        places = np.zeros((len(points), len(self.whole)))
        places[:, self._varied] = points
        P = parameter_samples(self.simulator, self.whole, places)
        with self.clock.of_runs(len(points), self.has_lanes):
            progress, before = self.progress, len(self)
            counted = progress and (lambda done, n: progress(before + done, before + n))
            ensemble = run_blocks(self.simulator, P, self.executor, counted)
        self.tried, self.ok = np.concatenate([self.tried, points]), np.concatenate([self.ok, ensemble.ok])
        bad = np.flatnonzero(~ensemble.ok)
        failed_runs = tuple(zip(bad.tolist(), ensemble.t_failed[bad].tolist(), ensemble.messages, strict=True))
        self.failed += failure_records(self.simulator, self.whole, P, failed_runs)
        low, high = ensemble.extremes()
        together = RUNS_TOGETHER if isinstance(self.simulator, SceneSimulator) else 1
        note_attained(low, high, P, ensemble.Y, reach=ensemble.reach, together=together)
        if not ensemble.ok.any():
            return ensemble.Y, ensemble.ok, ensemble.events
        # Errors are squared, and squares of numbers above 1e154 overflow. Powers of two change no digit.
        self._choose_powers(np.maximum(high.max(axis=0), -low.min(axis=0)))
        self.extremes = (
            np.minimum(self.extremes[0], self._scaled(low)),
            np.maximum(self.extremes[1], self._scaled(high)),
        )
        self._widths, self._scale = None, np.maximum(*map(rms, self.extremes))
        if self._told is not None:
            self.noise = np.maximum(self._scaled(self._told), self.rounding * self._scale)
        return self._scaled(ensemble.Y), ensemble.ok, ensemble.events

    def _scaled(self, values: Array) -> Array:
        return np.ldexp(values, -self.power) if self.power.any() else values

    def _choose_powers(self, largest: Array) -> None:
        """Scale outputs that were 0 so far by their largest values (n_y,) in new runs.

        OutgrownError is raised if other outputs are so far above earlier values that their squares overflow.
        """
        varies = self._largest > 0
        self._largest = np.maximum(self._largest, largest)
        largest = np.maximum(largest, 0.0 if self._told is None else self._told)
        new = np.maximum(np.where(largest > 0, np.frexp(largest)[1], self.power), self._least_power)
        if (too_large := varies & (new - self.power > _ORDINARY_POWER)).any():
            self._least_power = np.where(too_large, new, self._least_power)
            raise OutgrownError
        self.power = np.where(varies | (np.abs(new) < _ORDINARY_POWER / 2), self.power, new)


class OutputRuns:
    """Runs of a study, for one of its outputs. A scalar output has one time."""

    def __init__(self, runs: Runs, column: int) -> None:
        is_figure = runs.simulator.outputs[column] in getattr(runs.simulator, "figures", ())
        self._runs, self.box, self.clock, self.column = runs, runs.box, runs.clock, column
        self._own = (..., slice(0, 1) if is_figure else slice(None), slice(column, column + 1))
        self.shape = 1 if is_figure else runs.shape[0], 1
        self.has_lanes = isinstance(runs.simulator, SceneSimulator)
        self.probes, self.most, self.rounding = runs.probes, runs.most, runs.rounding

    def __len__(self) -> int:
        return len(self._runs)

    @property
    def left(self) -> int:
        """Number of runs that are still allowed."""
        return self._runs.left

    @property
    def nodes(self) -> Array:
        """Responses (N, n_t, 1) at nodes."""
        return self._runs.nodes[self._own]

    @property
    def checks(self) -> Array:
        """Responses (C, n_t, 1) at check points."""
        return self._runs.checks[self._own]

    @property
    def points(self) -> Array:
        """The check points (C, d)."""
        return self._runs.points

    def attained(self, among: Array | None = None) -> tuple[Array, Array]:
        """Points (M, d) of successful runs, of all runs or of the runs at given points, and responses (M, n_t, 1)."""
        ok = self._runs.is_attained
        points, Y = np.concatenate([self._runs.places[ok], self.points]), np.concatenate([self.nodes[ok], self.checks])
        if among is None:
            return points, Y
        wanted = set(_keys(among))
        kept = [key in wanted for key in _keys(points)]
        return points[kept], Y[kept]

    @property
    def are_ok(self) -> bool:
        """Whether no run failed."""
        return bool(self._runs.ok.all())

    @property
    def noise(self) -> Array:
        """Error (1,) of responses from noise; 0 before it is known."""
        return self._runs.noise[self._own[-1]]

    @property
    def noise_is_known(self) -> bool:
        """Whether the noise is known, from the simulator or from a measurement."""
        return self._runs.noise_is_known

    @property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest responses (n_t, 1)."""
        low, high = self._runs.extremes
        return low[self._own[1:]], high[self._own[1:]]

    def rms_widths(self) -> Array:
        """Root mean square width (1,)."""
        return self._runs.rms_widths()[self._own[-1]]

    def beyond(self, lower: Array, upper: Array) -> Array:
        """Distance (n_t, 1) by which runs exceed bounds, without noise."""
        lowest, highest = self.extremes
        return np.maximum(np.maximum(lower - lowest, highest - upper) - self.noise, 0.0)

    def interpolant(self, grid: Grid) -> Expansion:
        """The polynomial through the responses at the nodes of a grid."""
        Y = self.nodes[self._runs.at(grid.nodes)]
        return Expansion(grid.alpha, grid.coefficients(Y.reshape(len(Y), -1)).reshape(Y.shape), self.box.names)

    def at_nodes(self, points: Array) -> Array:
        """Responses (N, n_t, 1) at nodes (N, d) that were run before."""
        return self.nodes[self._runs.at(points)]

    def known(self, points: Array) -> tuple[Array, Array]:
        """The points (C, d) with successful check runs, and their responses."""
        row = {key: k for k, key in enumerate(_keys(self.points))}
        rows = [row[key] for key in _keys(points) if key in row]
        return self.points[rows], self.checks[rows]

    def checked(self, points: Array) -> Array | None:
        """Responses (C, n_t, 1) at check points; None if some points were not run, or if runs failed."""
        found, Y = self.known(points)
        return Y if len(found) == len(points) else None

    def may_hide(self) -> bool:
        """Whether runs say little: they have few functions of time, or the same value for a time."""
        nodes = self.nodes / self.rms_widths()
        return has_few_shapes(nodes) or rests_for_a_time(*self.extremes, self.noise)

    def tell(self, study: str, rule: str, error: float) -> None:
        """Report the relative error as progress, and as a step of the trace."""
        self._runs.tell(study, rule, np.array([error]), [self.column])


def relative_rms(error: Array, widths: Array) -> float:
    """The largest of the `relative_errors` of all outputs."""
    return float(np.max(relative_errors(error, widths), initial=0.0))


def relative_errors(error: Array, widths: Array) -> Array:
    """Root mean square over time of errors (..., n_t, n_y), divided by the rms width (n_y,) of each output."""
    return np.asarray(np.sqrt(np.square(error).mean(axis=-2)) / widths)


def _quadratic(points: Array, Y: Array) -> Callable[[Array], Array]:
    """The quadratic polynomial with the smallest coefficients through responses Y (N, n_t, n_y) at points (N, d)."""
    alpha = TotalDegree().indices(points.shape[1], 2)
    coefficients = np.linalg.lstsq(basis_values(alpha, points), Y.reshape(len(Y), -1))[0]
    return lambda others: (basis_values(alpha, others) @ coefficients).reshape(-1, *Y.shape[1:])


def _distance(places: Array, points: Array) -> Array:
    """Distance (k,) of places (k, d) from the nearest of the points (m, d)."""
    nearest = np.full(len(places), np.inf)
    for point in points:
        nearest = np.minimum(nearest, np.square(places - point).sum(axis=1))
    return nearest


def _keys(points: Array) -> list[bytes]:
    rounded = np.ascontiguousarray(points.round(12) + 0.0)  # equal nodes agree, and 0 is not -0
    return rounded.view(f"V{8 * points.shape[1]}").ravel().tolist()
