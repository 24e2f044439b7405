"""Ranges of oscillations over many periods, from polynomials of their phase and of their waveform.

If the period of a response depends on parameters, the response has many extremes in these parameters after many
periods. The phase and the form of the cycles remain simple functions. A few runs show these functions. Source: Mai and
Sudret, SIAM/ASA Journal on Uncertainty Quantification 5 (2017).
"""

from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb._work import count_work
from symmb.bound.adaptive.check_points import PROBES, SAFETY, corner_design, evenly_spread_points
from symmb.bound.adaptive.runs import Runs, relative_rms
from symmb.bound.adaptive.small_study import WAVEFORMS, JointStudy, Problem
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.adaptive.tensor_grids import is_resolved
from symmb.bound.nodes import Grid, along_axes
from symmb.bound.polynomials import MultiIndices, TotalDegree, basis_values
from symmb.bound.polynomials.ranges import MOST_PARAMETERS
from symmb.bound.responses import DOUBTFUL

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

LEAST_CYCLES = 8
"""Smallest number of cycles of a run, and of output times in a cycle. Splines through fewer times are less accurate."""
LEAST_SPREAD = 1.0
"""Smallest difference of the phases of two runs [cycles]. Below this, polynomials of the response are accurate."""
MOST_CHANGE = 0.1
"""Largest relative change of the period between two cycles. With several frequencies, the period changes more."""
AT_REST = 1e-4
"""Largest distance from the last value, divided by the width of a response, at which an oscillation has decayed."""
MOST_DIMENSIONS = 4
"""Largest number of parameters of waveforms. With more, searches of ranges have too few lines."""
SAMPLES, FINE_SAMPLES, SLOW_TIMES = 32, 128, 129
"""Samples of a cycle in fits and in ranges, and times at which waveforms are stored. Waveforms change slowly."""
LINE_ERROR, PHASE_ERROR = 1e-3, 0.1
"""Error of ranges on lines over the width, and error of the phase [cycles] above which extremes may be wrong."""


@dataclass(frozen=True)
class Waveforms(JointStudy):
    """Polynomials of the phase and the waveform of outputs that oscillate.

    The error is estimated by leaving out one run at a time: each run is predicted from the other runs, and compared
    with its own result. Degrees increase until the errors are within the tolerance, or no longer decrease. Outputs with
    doubtful errors are left out.

    Attributes
    ----------
    most_dimensions, most_values : largest number of parameters, and of values of waveforms in a search of ranges. The
        search takes a few seconds
    most_degree : largest degree of the polynomials
    convergence : largest ratio of the errors of two degrees. With a larger ratio, polynomials of phase and waveform do
        not converge, and other methods take fewer runs
    """

    most_dimensions: int = MOST_DIMENSIONS
    most_values: float = 5e7
    most_degree: int = 5
    convergence: float = 0.5

    name = "waveforms"
    when = f"there are up to {MOST_DIMENSIONS} parameters, and outputs oscillate with phases that differ by a cycle"

    def accepts(self, problem: Problem) -> bool:
        d = len(problem.runs.box)
        if d > self.most_dimensions or problem.runs.shape[0] < LEAST_CYCLES**2:
            return False
        return d > MOST_PARAMETERS or not is_resolved(problem)

    def ranges(self, problem: Problem) -> tuple[dict[int, EstimatedRange], Mask]:
        found = self._found(problem.runs, problem.tolerance, problem.known)
        problem.runs.clock.restart()  # other outputs get as much time as without outputs that oscillate
        return found, np.array([k in found and found[k].is_enough for k in range(problem.runs.shape[1])])

    def _found(self, runs: Runs, tolerance: float, known: Container[int]) -> dict[int, EstimatedRange]:
        """The ranges of the outputs that oscillate and are not known, by their indices."""
        t, d, before = np.asarray(runs.simulator.times), len(runs.box), np.inf
        found, oscillates, fits = dict[int, EstimatedRange](), list[int](), dict[int, tuple[float, _Fit]]()
        if not len(runs):  # sparse grids begin with the same runs
            grid = Grid(d)
            runs.at(grid.grown(grid.missing(along_axes(d, 2))).nodes)
        if runs.ok.all():
            oscillates = [k for k in _oscillating(t, np.concatenate([runs.nodes, runs.checks])) if k not in known]
        if len(oscillates) * len(t) * sum(map(len, _lines(d))) > self.most_values:
            return found
        for degree in range(2, self.most_degree + 1):
            alpha = TotalDegree().indices(d, degree)
            spread = evenly_spread_points(2 * len(alpha) + PROBES, d)
            design = np.concatenate([corner_design(d), spread])
            is_late = degree > 2 and runs.clock.is_late
            if all(k in found and found[k].is_enough for k in oscillates) or len(design) > runs.left or is_late:
                break
            runs.check(design)
            if not runs.ok.all():
                return found
            points, Y, error = np.concatenate([runs.places, runs.points]), _outputs(runs), 0.0
            for k in oscillates:
                if k in found:
                    continue
                if (fit := _Fit.of(t, Y[k], points, alpha)) is None:  # some of the new runs do not oscillate
                    return found
                own = relative_rms(SAFETY * fit.least[:, None], runs.rms_widths()[k : k + 1])
                if own <= tolerance:  # ranges take time
                    of_output = _range(runs, k, fit, tolerance)
                    own = relative_rms(of_output.estimate, runs.rms_widths()[k : k + 1])
                    if of_output.is_enough:
                        found[k] = of_output
                        continue
                fits[k] = min(fits.get(k, (np.inf, fit)), (own, fit), key=lambda each: each[0])
                error = max(error, own)
            if error > self.convergence * before:
                break
            before = error
        rest = {
            k: _range(runs, k, fit, tolerance) for k, (own, fit) in fits.items() if k not in found and own <= DOUBTFUL
        }
        return found | rest


@dataclass(frozen=True, eq=False)
class Cycles:
    """Responses as waveforms of a phase.

    Attributes
    ----------
    t : (n_t,)
    phase : (N, n_t)                      phases [cycles]
    form : (N, SLOW_TIMES, FINE_SAMPLES)  values during a cycle, at evenly spaced times
    """

    t: Array
    phase: Array
    form: Array

    @classmethod
    def of(cls, t: Array, features: Array) -> "Cycles":
        """Cycles from phases and waveforms side by side, (N, n_t + SLOW_TIMES * SAMPLES)."""
        series = np.fft.rfft(features[:, len(t) :].reshape(-1, SLOW_TIMES, SAMPLES))
        return cls(t, features[:, : len(t)], np.fft.irfft(series, FINE_SAMPLES) * (FINE_SAMPLES / SAMPLES))

    def values(self, phase: Array) -> Array:
        """Responses (N, n_t) at phases (N, n_t)."""
        u = np.mod(phase, 1.0) * FINE_SAMPLES
        before = np.minimum(u.astype(int), FINE_SAMPLES - 1)
        share, after, run = u - before, (before + 1) % FINE_SAMPLES, np.arange(len(phase))[:, None]
        row, part = _slow_rows(self.t)
        early, late = (
            (1 - share) * self.form[run, k, before] + share * self.form[run, k, after] for k in (row, row + 1)
        )
        return (1 - part) * early + part * late

    def range(self) -> tuple[Array, Array, Mask]:
        """Smallest and largest values (n_t,) on a line through N points, and whether a phase attains them (2, n_t)."""
        (row, part), values = _slow_rows(self.t), self.values(self.phase)
        ends, attained = np.empty((2, len(self.t))), np.empty((2, len(self.t)), dtype=bool)
        for side, sign in enumerate((-1.0, 1.0)):
            best = (sign * self.form).argmax(axis=2)
            top = sign * np.take_along_axis(self.form, best[..., None], axis=2)[..., 0]
            top = (1 - part) * top[:, row] + part * top[:, row + 1]
            # The top of the waveform is attained where the phase exceeds that of the top by whole cycles. The highest
            # of these places between two points is the one next to one of these points. If the top jumps to another
            # hump between two points, it is not attained there.
            at = best / FINE_SAMPLES
            turn = np.diff(at, axis=0)
            turn -= np.round(turn)
            first = self.phase[:-1] - at[:-1, row]
            last = first + np.diff(self.phase, axis=0) - turn[:, row]
            low, high = np.minimum(first, last), np.maximum(first, last)
            places = (
                np.divide(k - first, last - first, out=np.zeros_like(k), where=low < high)
                for k in (np.ceil(low), np.floor(high))
            )
            tops = np.max([top[:-1] + u * (top[1:] - top[:-1]) for u in places], axis=0)
            is_met = (np.ceil(low) <= high) & (np.abs(turn) < PHASE_ERROR)[:, row]
            tops, points = np.where(is_met, tops, -np.inf).max(axis=0), (sign * values).max(axis=0)
            ends[side], attained[side] = np.maximum(tops, points), tops >= points
        return -ends[0], ends[1], attained


def _range(runs: Runs, k: int, fit: "_Fit", tolerance: float) -> EstimatedRange:
    """The range of output k from a fit."""
    lower, upper, estimate = (each[:, None] for each in fit.range())
    is_enough = relative_rms(estimate, runs.rms_widths()[k : k + 1]) <= tolerance
    evidence = Evidence.of("waveforms", estimate)
    return EstimatedRange(lower, upper, evidence, None, WAVEFORMS, is_enough=is_enough)


def _outputs(runs: Runs) -> list[Array]:
    """Responses (N, n_t) of all runs, for each output."""
    return [*np.moveaxis(np.concatenate([runs.nodes, runs.checks]), 2, 0)]


def _oscillating(t: Array, Y: Array) -> list[int]:
    """Numbers of the outputs of runs Y (N, n_t, n_y) that oscillate, and have sufficiently different phases."""
    falls = np.diff(Y, axis=1) < 0
    minima = (falls[:, :-1] & ~falls[:, 1:]).sum(axis=1)
    pairs = np.stack([minima.argmin(axis=0), minima.argmax(axis=0)], axis=1)
    some = np.flatnonzero(minima.min(axis=0) >= LEAST_CYCLES).tolist()
    return [k for k in some if _spread(t, Y[pairs[k], :, k]) > LEAST_SPREAD]


def _spread(t: Array, pair: Array) -> float:
    """Difference of the last phases [cycles] of two responses (2, n_t); 0 if they do not oscillate."""
    lengths = [[_length(t, each) for each in starts] for _, starts in _starts_on_lines(t, pair)]
    if all(np.ptp(each) < 0.9 * LEAST_SPREAD for each in lengths):  # splines take ten times as long
        return 0.0
    found = _cycles(t, pair)
    return 0.0 if found is None else float(np.ptp(found[:, len(t) - 1]))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Polynomials of phase and waveform through runs.

    Attributes
    ----------
    alpha : (n_b, d) degrees
    coefficients : (n_b, n_t + SLOW_TIMES * SAMPLES) of phase and waveform
    spread : (n_t,) largest difference of the phases of runs
    error : (n_t,) rms difference of each run from its prediction by the other runs
    least : (n_t,) this error without the error of the phase
    is_sure : (n_t,) whether the error of the phase is small
    """

    t: Array
    alpha: MultiIndices
    coefficients: Array
    spread: Array
    error: Array
    least: Array
    is_sure: Mask

    @classmethod
    def of(cls, t: Array, Y: Array, points: Array, alpha: MultiIndices) -> "_Fit | None":
        """The fit to responses Y (N, n_t) at points (N, d); None if a response does not oscillate."""
        if (cycles := _cycles(t, Y)) is None:
            return None
        count_work(500.0 * Y.size)
        basis = basis_values(alpha, points)
        inverse = np.linalg.pinv(basis)
        coefficients, leverage = inverse @ cycles, (basis * inverse.T).sum(axis=1)[:, None]
        others = Cycles.of(t, cycles - (cycles - basis @ coefficients) / (1 - leverage))
        phase = cycles[:, : len(t)]
        errors = (others.values(each) - Y for each in (others.phase, phase))
        of_all, of_form, of_phase = (np.sqrt(np.square(e).mean(axis=0)) for e in (*errors, others.phase - phase))
        return cls(t, alpha, coefficients, np.ptp(phase, axis=0), of_all, of_form, of_phase < PHASE_ERROR)

    def range(self) -> tuple[Array, Array, Array]:
        """Smallest and largest values, and their estimated error, each (n_t,).

        If amplitude and phase are linear, a largest value at a given phase lies on an edge. Other lines pass through
        the middle and through the places of the largest amplitudes. If the largest amplitude on a grid is larger than
        on lines, the difference counts as an error. The right phase is at most half a cycle away.
        """
        t, d = self.t, self.alpha.shape[1]
        lower, upper, attained = np.full(len(t), np.inf), np.full(len(t), -np.inf), np.zeros((2, len(t)), dtype=bool)
        tops, places = self._largest_forms()
        lines = _lines(d, places)
        count_work(50.0 * len(lines) * len(lines[0]) * len(t))
        for line in lines:
            low, high, own = Cycles.of(t, basis_values(self.alpha, line) @ self.coefficients).range()
            attained = np.where([low < lower, high > upper], own, attained)
            lower, upper = np.minimum(lower, low), np.maximum(upper, high)
        # Errors of the phase do not change an extreme that some phase attains.
        is_met = attained.all(axis=0) & self.is_sure
        least, most, change = (np.interp(t, np.linspace(t[0], t[-1], tops.shape[1]), each) for each in tops)
        missed = np.maximum(lower - least, most - upper) - change / np.maximum(self.spread, 1.0)
        error = np.where(is_met, self.least + np.maximum(missed, 0.0) / SAFETY, self.error)
        return lower, upper, SAFETY * error + LINE_ERROR * (upper - lower)

    def _largest_forms(self) -> tuple[Array, Array]:
        """Extremes of waveforms on a grid, and the largest change of an extreme over the grid, each at some slow times
        (3, n), and places (N, d) of the extremes."""
        d, every = self.alpha.shape[1], SLOW_TIMES // 16
        grid = np.array([*product(_along(d)[:: 1 if d < 4 else 2], repeat=d)])
        forms = self.coefficients[:, len(self.t) :].reshape(len(self.alpha), SLOW_TIMES, SAMPLES)[:, ::every]
        forms = np.tensordot(basis_values(self.alpha, grid), forms, axes=1)
        lows, highs = forms.min(axis=2), forms.max(axis=2)
        best = np.unique([lows.argmin(axis=0), highs.argmax(axis=0)])
        change = np.maximum(np.ptp(lows, axis=0), np.ptp(highs, axis=0))
        return np.stack([lows.min(axis=0), highs.max(axis=0), change]), grid[best]


def _along(d: int) -> Array:
    """Coordinates of points on a line in a box of d parameters."""
    n = 33 if d < 3 else 17  # between points, amplitudes are linear; more lines leave time for fewer points
    return np.cos(np.pi * np.arange(n) / (n - 1))


def _lines(d: int, places: Iterable[Array] = ()) -> list[Array]:
    """Lines (N, d) parallel to the axes: edges, lines through the middle of the box and through places (n, d)."""
    along, across = _along(d), (-1.0, 0.0, 1.0) if d < MOST_DIMENSIONS else (-1.0, 1.0)
    through = [each for axis in range(d) for each in product([axis], product(across, repeat=d - 1))]
    through += [(axis, tuple(np.delete(place, axis))) for place in places for axis in range(d)]
    return [np.insert(np.tile(at, (len(along), 1)), axis, along, axis=1) for axis, at in dict.fromkeys(through)]


def _cycles(t: Array, Y: Array) -> Array | None:
    """Phases and waveforms of responses Y (N, n_t), joined as for `Cycles.of`; None if a response does not oscillate.

    Cycles begin where a response rises through the mean of all responses. If they are irregular, minima are the starts.
    """
    level = Y.mean()
    for order, _ in _starts_on_lines(t, Y):
        responses, ends = [_spline(t, y - level) for y in Y], [_end(t, y) for y in Y]
        starts = [_starts(t[t <= end], each.derivative(order)) for each, end in zip(responses, ends, strict=True)]
        if all(_is_regular(t, each, end) for each, end in zip(starts, ends, strict=True)):
            rows = [_of_cycles(t, response, own) for response, own in zip(responses, starts, strict=True)]
            found = np.array([np.concatenate([phase, form.ravel() + level]) for phase, form in rows])
            found[:, : len(t)] -= np.round(found[:, :1] - found[0, 0])  # the first start may lie before the first time
            return found
    return None


def _starts_on_lines(t: Array, Y: Array) -> Iterator[tuple[int, list[Array]]]:
    """Starts of the cycles of responses Y (N, n_t) on straight lines between the times, if the period changes slowly.

    The starts are passages of the mean value (order 0), and minima (order 1).
    """
    ends, middles = [_end(t, y) for y in Y], (t[1:] + t[:-1]) / 2
    for order, (times, values) in enumerate(((t, Y - Y.mean()), (middles, np.diff(Y) / np.diff(t)))):
        starts = [_passages(times[times <= end], y[times <= end])[1] for y, end in zip(values, ends, strict=True)]
        if all(_changes_slowly(each, 2 * MOST_CHANGE) for each in starts):
            yield order, starts


def _length(t: Array, starts: Array) -> float:
    """Number of cycles between the first and the last time, from the starts of cycles."""
    first, last = np.diff(starts)[[0, -1]]
    return len(starts) - 1 + float((starts[0] - t[0]) / first + (t[-1] - starts[-1]) / last)


def _spline(x: Array, y: Array) -> "CubicSpline":
    """The natural cubic spline through values y (n, ...) at x (n,)."""
    from scipy.interpolate import CubicSpline  # takes a tenth of a second

    return CubicSpline(x, y, bc_type="natural")


def _end(t: Array, y: Array) -> float:
    """The last time at which a response (n_t,) has not come to rest."""
    moves = np.abs(y - y[-1]) > AT_REST * np.ptp(y)
    return float(t[np.flatnonzero(moves)[-1]]) if moves.any() else float(t[0])


def _starts(t: Array, event: "CubicSpline") -> Array:
    """Times at which a spline passes 0 upwards, between the times t (n_t,)."""
    k, times = _passages(t, event(t))
    for _ in range(3):  # Newton steps from the root of the straight line
        slope = event(times, 1)
        step = np.divide(event(times), slope, out=np.zeros_like(times), where=slope > 0)
        times = np.clip(times - step, t[k], t[k + 1])
    return times


def _passages(t: Array, values: Array) -> tuple[Indices, Array]:
    """Rows of the last times before values (n_t,) pass 0 upwards, and the times of these passages on straight lines."""
    k = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
    return k, t[k] - values[k] * (t[k + 1] - t[k]) / (values[k + 1] - values[k])


def _changes_slowly(starts: Array, most: float) -> bool:
    """Whether there are enough starts of cycles, and the period changes by at most `most` between two cycles."""
    return len(starts) > LEAST_CYCLES and bool(np.abs(np.diff(np.log(np.diff(starts)))).max() <= most)


def _is_regular(t: Array, starts: Array, end: float) -> bool:
    """Whether starts of cycles exist from the first time to an end, and the period changes slowly."""
    if not _changes_slowly(starts, MOST_CHANGE) or np.diff(np.searchsorted(t, starts)).min() < LEAST_CYCLES:
        return False
    outside = np.array([starts[0] - t[0], end - starts[-1]])
    return bool((outside < (1 + MOST_CHANGE) * np.diff(starts)[[0, -1]]).all())


def _of_cycles(t: Array, response: "CubicSpline", starts: Array) -> tuple[Array, Array]:
    """Phase (n_t,) and waveforms (SLOW_TIMES, SAMPLES) of a response, from the starts of its cycles."""
    number, u = np.arange(len(starts), dtype=float), np.arange(SAMPLES) / SAMPLES
    phase = _spline(starts, number)
    wanted = number[:-1, None] + u
    at = _spline(number, starts)(wanted)
    for _ in range(2):  # Newton steps, because the inverse of a spline is no spline
        at -= (phase(at) - wanted) / phase(at, 1)
    cycles = _spline(number[:-1], response(at))
    # Beyond the last cycle, the frequency is constant. Splines are continued by two cycles at most.
    last = starts[-1]
    known = np.minimum(t, last)
    slow = np.clip(phase(np.linspace(t[0], t[-1], SLOW_TIMES)[:, None]) - u, -2, len(starts))
    return phase(known) + phase(last, 1) * (t - known), cycles(slow).diagonal(axis1=1, axis2=2)


def _slow_rows(t: Array) -> tuple[Indices, Array]:
    """For each time, the number of the last slow time before it, and the part of the interval that has passed."""
    slow = (t - t[0]) / (t[-1] - t[0]) * (SLOW_TIMES - 1)
    row = np.minimum(slow.astype(int), SLOW_TIMES - 2)
    return row, slow - row
