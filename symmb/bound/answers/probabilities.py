"""Quantiles and probabilities of outputs, for parameters with distributions and for intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._labelled import Labelled, Named, Result
from symmb._limits import require_memory
from symmb._magnitudes import ROUNDING
from symmb._names import ByName, counted
from symmb._options import is_finite_number, numbers_of, shown, whole
from symmb._table import aligned, apart, at_time, is_timeless, over_times, time_text
from symmb._types import Array
from symmb._units import number_in, told_names, typeset, units_of_parameters
from symmb.bound.answers.law_samples import (
    SAFETY_OF_RUNS,
    SAMPLES_BEFORE_RUNS,
    STANDARD_ERRORS,
    LawSamples,
    scatter,
    verifying_runs,
)
from symmb.bound.answers.laws import Laws
from symmb.bound.answers.limit_state import EXPECTED_IF_NONE, SETS_OF_SAMPLES, rare_event
from symmb.bound.nodes import Random
from symmb.bound.responses import FINE, Responses, RunsUsedUpError
from symmb.run.simulation import Sweep

Ends = float | Array
"""A limit, or limits over time (n_t,)."""
_MOST_VALUES = 2**24
"""Largest number of values of polynomials for quantiles with a given error: some seconds."""
_MOST_RUNS_NEAR_LIMIT, _LEAST_RUNS_NEAR_LIMIT = 1000, 200
"""Largest number of runs near a limit, and the number below which these runs are of no use."""
_VALUES_TOGETHER = 2**20
"""Number of values of an output that are computed together. They fit into the processor cache."""


@dataclass(frozen=True, eq=False, repr=False)
class Figures(Result):
    """Common attributes of quantiles and probabilities.

    Attributes
    ----------
    output, unit : str
    t : (n_t,)             times [s]
    laws : str             distributions of parameters, in words
    intervals : names      of the parameters without a distribution
    samples : int
    runs : int             further runs that were made
    remarks : sentences
    """

    output: str
    unit: str
    t: Array
    laws: str
    intervals: tuple[str, ...]
    samples: int
    runs: int
    remarks: tuple[str, ...]

    def _title(self) -> str:
        raise NotImplementedError

    def _rows(self) -> list[list[str]]:
        raise NotImplementedError

    def _head(self) -> str:
        lines = [
            self._title(),
            f"  distribution {self.laws}, {self.samples} samples, {counted(self.runs, 'further run')}",
        ]
        if self.intervals:
            lines.append(
                f"  intervals    {', '.join(self.intervals)}: any value in the box, "
                "so each result has a lowest and a highest value"
            )
        return "\n".join([*lines, *(f"  remark       {remark}" for remark in self.remarks)])

    def __str__(self) -> str:
        return "\n".join([self._head(), *(f"  {line}" for line in aligned(self._rows()))])

    def _repr_html_(self) -> str:
        return html.page(html.text(self._head()), html.table(self._rows()))


@dataclass(frozen=True, eq=False, repr=False)
class Quantiles(Figures):
    """Quantiles of an output over time.

    Attributes
    ----------
    levels : (n_q,)                probabilities
    lower, upper : (n_q, n_t)      lowest and highest quantile, for all values of the parameters without a distribution;
                                   equal if all parameters have a distribution
    estimate : (n_q, n_t)          estimated error: that of the polynomials and of sampling
    """

    levels: Array
    lower: Array
    upper: Array
    estimate: Array

    def _title(self) -> str:
        (name,) = told_names([self.output], [self.unit])
        return f"Quantiles of {name}, " + (f"{len(self.t)} times" if len(self.t) > 1 else "one time")

    def _rows(self) -> list[list[str]]:
        ends = ["lowest", "at [s]", "highest", "at [s]", "estimated error"]
        rows = [["quantile", *ends]]
        for q, lower, upper, error in zip(self.levels, self.lower, self.upper, self.estimate, strict=True):
            i, j = int(lower.argmin()), int(upper.argmax())
            when = [time_text(self.t, row, lower, upper) for row in (i, j)]
            values = f"{lower[i]:.6g}", when[0], f"{upper[j]:.6g}", when[1]
            rows.append([f"{q:g}", *values, f"≤ {error.max():.2g}"])
        return over_times(rows, self.t)

    def _labelled(self) -> Labelled:
        coordinates: dict[str, Named] = {"time": (("time",), self.t), "level": (("level",), self.levels)}
        variables: dict[str, Named] = {
            name: (("level", "time"), getattr(self, name)) for name in ("lower", "upper", "estimate")
        }
        return Labelled(
            coordinates, variables, {"output": self.output, "laws": self.laws}, {"time": "s"}, ("level", "time")
        )


@dataclass(frozen=True, eq=False, repr=False)
class Probability(Figures):
    """The probability that an output is above or below a value.

    Attributes
    ----------
    event : str                the event
    lower, upper : (n_t,)      lowest and highest probability at each time; equal if all parameters have distributions
    estimate : (n_t,)          estimated error: that of the polynomials and of sampling
    ever : (lower, upper, estimate)    probability that the event happens at any output time
    """

    event: str
    lower: Array
    upper: Array
    estimate: Array
    ever: tuple[float, float, float]

    def _title(self) -> str:
        return f"Probability of {self.event}"

    def _rows(self) -> list[list[str]]:
        i = int(self.upper.argmax())
        has_times = not is_timeless(self.t) and time_text(self.t, i, self.lower, self.upper) != ""
        largest = f"highest,{at_time(self.t, i)}", self.lower[i], self.upper[i], self.estimate[i]
        rows = [["", "probability", "estimated error"]]
        ever = "at any output time" if has_times else "", *self.ever
        for name, low, high, error in (ever, largest) if has_times else (ever,):
            value = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            rows.append([name, value, f"≤ {error:.2g}"])
        return rows

    def _labelled(self) -> Labelled:
        variables: dict[str, Named] = {
            name: (("time",), getattr(self, name)) for name in ("lower", "upper", "estimate")
        }
        about = dict(zip(("ever_lower", "ever_upper", "ever_estimate"), self.ever, strict=True))
        return Labelled({"time": (("time",), self.t)}, variables, {"event": self.event, **about}, {"time": "s"})


def quantiles_of(
    responses: Responses, output: object, levels: object, laws: object, correlation: object, error: object
) -> Quantiles:
    """Quantiles of an output; see `Bounds.quantiles`."""
    owner = "Bounds.quantiles"
    if error is not None and (not is_finite_number(error) or not 0 < error < 1):
        raise DeclarationError(f"{owner}: error must be above 0 and below 1, got {shown(error)}.")
    k = responses.column(owner, output)
    q = numbers_of([levels] if is_finite_number(levels) else levels)
    if q is None or q.ndim != 1 or not len(q) or not ((q > 0) & (q < 1)).all():
        raise DeclarationError(f"{owner}: levels must be probabilities above 0 and below 1, got {shown(levels)}.")
    samples = LawSamples(owner, responses, k, laws, correlation)
    width = responses.upper[:, k] - responses.lower[:, k]
    while True:
        parts = [samples.quantiles_on_card(q)] if samples.on_card else []
        for _, low, high in samples.over_time() if not parts else ():
            ends = [_quantiles_and_scatter(each, q) for each in ((low,) if low is high else (low, high))]
            parts.append((ends[0][0], ends[-1][0], np.maximum(ends[0][1], ends[-1][1])))
        lower, upper, sampling = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
        is_short = error is not None and bool((sampling > error * width.max()).any())
        if not is_short or not samples.may_grow(_MOST_VALUES):
            break
        samples.draw(4 * samples.number // SETS_OF_SAMPLES)
    lower, upper = np.clip((lower, upper), responses.lower[:, k], responses.upper[:, k])
    estimate = np.minimum(sampling + samples.error, width)  # no error is larger
    found = Quantiles(*samples.about(q), q, lower, upper, estimate)
    if not is_short:
        return found
    told, most = apart(float(sampling.max() / width.max()), float(error))  # pyright: ignore[reportArgumentType]
    short = f"The error of sampling is {told} times the width of the bounds, and not {most}."
    return replace(found, remarks=(*found.remarks, short))


def _quantiles_and_scatter(values: Array, q: Array) -> tuple[Array, Array]:
    """Quantiles (n_q, n_t) of values (replicates, n, n_t), and their sampling error."""
    sets = np.ascontiguousarray(values.transpose(2, 0, 1))
    sets.sort(axis=2)  # np.quantile takes five times as long
    whole = np.sort(sets.reshape(len(sets), -1), axis=1, kind="stable")  # merges the sorted sets
    # Fraction of the samples next to a quantile that cannot be distinguished from the quantile.
    n = whole.shape[1]
    near, middle = 2.0 / n, (q * (n + 1) - 1) / (n - 1)  # the k-th of n values has the mean rank k / (n + 1)
    quantiles, above, below = (_of_sorted(whole, np.clip(middle + sign * near, 0, 1)) for sign in (0, 1, -1))
    sampling = scatter(np.moveaxis(_of_sorted(sets, q), 2, 0))
    return quantiles, np.maximum(sampling, np.maximum(above - quantiles, quantiles - below))


def _of_sorted(values: Array, q: Array) -> Array:
    """Quantiles (n_q, n_t, ...) of values (n_t, ..., n) that increase along the last axis."""
    place = q * (values.shape[-1] - 1)
    first = np.minimum(place.astype(int), values.shape[-1] - 2)
    share = place - first
    return np.moveaxis((1 - share) * values[..., first] + share * values[..., first + 1], -1, 0)


def probability_of(
    responses: Responses, output: object, above: object, below: object, laws: object, correlation: object, error: object
) -> Probability:
    """Probability that an output is above one value or below another; see `Bounds.probability`.

    If some parameters have no distribution, each sample has a range of responses. The event is certain if the whole
    range is above or below the value.
    """
    owner = "Bounds.probability"
    k = responses.column(owner, output)
    limits, event = _event(owner, responses, k, above, below)
    if not is_finite_number(error) or not 0 < error < 1:
        raise DeclarationError(f"{owner}: error must be above 0 and below 1, got {shown(error)}.")
    samples = LawSamples(owner, responses, k, laws, correlation, SAMPLES_BEFORE_RUNS)
    found = event_probability(samples, limits, error)
    lower, upper, estimate, _ = found
    last = float(lower[-1]), float(upper[-1]), float(estimate[-1])
    figures = Probability(*samples.about(), event, lower[:-1], upper[:-1], estimate[:-1], last)
    if _is_short(found, error) and upper[-1] > 0:
        told, most = apart(float(estimate[-1]), error * float(lower[-1]))
        short = f"The error {told} is above {most}, which is {error:g} times the lowest probability {lower[-1]:.2g}."
        return replace(figures, remarks=(*figures.remarks, short))
    if _is_short(found, error) and responses.runs is not None and responses.runs.left < _LEAST_RUNS_NEAR_LIMIT:
        rare = f"Rarer events take up to {_MOST_RUNS_NEAR_LIMIT:,} runs near the limit. Allow them by runs=."
        return replace(figures, remarks=(*figures.remarks, rare))
    return figures


def event_probability(samples: LawSamples, limits: tuple[Ends, Ends], error: float, least: float = 0.0) -> Array:
    """The results of `_by_samples` with an error, or as close to this error as samples and runs allow.

    The error is relative to the probability, or to `least` if the probability is smaller.
    """
    responses = samples.responses
    found = _by_samples(samples, limits)
    while _is_short(found, error, least) and samples.may_grow() and found[3, -1] < error / 2 * max(found[0, -1], least):
        samples.draw(4 * samples.number // SETS_OF_SAMPLES)
        found = _by_samples(samples, limits)
    most = 0 if responses.runs is None else min(_MOST_RUNS_NEAR_LIMIT, responses.runs.left)
    if _is_short(found, error, least) and most >= _LEAST_RUNS_NEAR_LIMIT and not samples.free.any():
        own = _near_limit(samples, limits, error, int(most))
        found = np.where(own[2] < found[2], own, found)
    return found


def _event(owner: str, responses: Responses, k: int, above: object, below: object) -> tuple[tuple[float, float], str]:
    """The values below and above which the event happens, infinite if not given, and the event in words."""
    thresholds = [value for value in (below, above) if value is not None]
    unit = responses.units[k] if responses.units else ""
    ends = [number_in(owner, f"output {responses.names[k]!r}", value, unit) for value in thresholds]
    if not ends or ends != sorted(ends):
        raise DeclarationError(
            f"{owner}: pass a number as above=, below= or both. below must not exceed above. "
            f"Got above={shown(above)} and below={shown(below)}."
        )
    limits = -np.inf if below is None else ends[0], np.inf if above is None else ends[-1]
    named = zip(("below", "above"), (below, above), strict=True)
    words = zip([word for word, given in named if given is not None], ends, strict=True)
    parts = [f"{word} {end:g} {typeset(unit)}".rstrip() for word, end in words]
    return limits, f"{responses.names[k]} {' or '.join(parts)}"


def _is_short(found: Array, error: float, least: float = 0.0) -> bool:
    """Whether the error of the event at any time is larger than the requested error."""
    return bool(found[2, -1] > error * max(found[0, -1], least))


def _by_samples(samples: LawSamples, limits: tuple[Ends, Ends]) -> Array:
    """Lowest and highest probability, their error, and the error from polynomials, (4, n_t + 1).

    The last entry of each row is for the event at any time.
    """
    responses, k = samples.responses, samples.column
    limits_over_time = [np.broadcast_to(end, responses.t.shape) for end in limits]
    at_times, ever = [], np.zeros((4, SETS_OF_SAMPLES, samples.number // SETS_OF_SAMPLES), dtype=bool)
    for window, low, high in samples.over_time():
        bottom, top = (end[window] for end in limits_over_time)
        lowest, highest, e = responses.lower[window, k], responses.upper[window, k], samples.error[window]
        low, high = np.clip((low, high), lowest, highest)
        pairs = (low, high), (high, low), (low - e, high + e), (high + e, low - e)
        beyond = np.stack([(above_it > top) | (below_it < bottom) for above_it, below_it in pairs])
        at_times.append(beyond.mean(axis=2))
        ever |= beyond.any(axis=3)
    sets = np.concatenate([*at_times, ever.mean(axis=2)[..., None]], axis=2)  # (4, replicates, n_t + 1)
    lower, upper, lowest, highest = sets.mean(axis=1)
    sampling = np.maximum(np.maximum(scatter(sets[0]), scatter(sets[1])), EXPECTED_IF_NONE / samples.number)
    of_polynomials = np.maximum(lower - lowest, highest - upper)
    return np.array([lower, upper, np.minimum(sampling + of_polynomials, 1.0), of_polynomials])


def _near_limit(samples: LawSamples, limits: tuple[Ends, Ends], error: float, most: int) -> Array:
    """The four results of `_by_samples`, from at most a number of runs near the limit."""
    from scipy.special import ndtr, ndtri

    (bottom, top), columns = limits, samples.columns

    def margins(Y: Array) -> Array:
        return np.maximum(Y - top, bottom - Y)

    uniform, Y = samples.known()
    found = rare_event(
        lambda z: samples.unit_points(ndtr(z))[:, columns],
        lambda z: margins(samples.by_runs(samples.unit_points(ndtr(z)))),
        (ndtri(uniform), margins(Y)),
        error,
        most,
    )
    samples.runs += found.runs
    share, n = np.clip(found.shares, 0.0, 1.0), max(found.failures, 1)
    unseen = np.where(share < 1 - ROUNDING, EXPECTED_IF_NONE / n, 0.0)  # shares are sums of weights
    of_share = np.minimum(STANDARD_ERRORS * np.sqrt(share * (1 - share) / n) + unseen, 1.0)
    probability = found.probability * np.append(share, 1.0)
    estimate = found.error * np.append(share, 1.0) + found.probability * np.append(of_share, 0.0)
    ends = samples.responses.lower[:, samples.column], samples.responses.upper[:, samples.column]
    if samples.surrogate is None and not found.failures and ((ends[0] < bottom) | (ends[1] > top)).any():
        # The bounds are beyond the limit, but no run is. The runs may have missed a narrow peak.
        estimate = np.maximum(estimate, EXPECTED_IF_NONE / len(uniform))
    return np.array([probability, probability, estimate, estimate])


def samples_of(
    responses: Responses,
    n: object,
    columns: Sequence[int],
    laws: object,
    correlation: object,
    seed: object,
    nominal: Mapping[str, float],
) -> Sweep:
    """Random samples of outputs with these numbers; see `Bounds.samples`."""
    owner, box = "Bounds.samples", responses.box
    number, seed = whole(owner, "n", n, 1), whole(owner, "seed", seed, 0)
    require_memory(owner, "the samples", number * len(responses.t) * len(columns))
    own = Laws.of(owner, laws, correlation, box)
    lacking = [name for name, r in zip(box.names, box.radius, strict=True) if r > 0 and name not in own.names]
    if lacking:
        raise DeclarationError(
            f"{owner}: samples need a distribution of every parameter, and {', '.join(lacking)} have none. "
            "For equally likely values, use scipy.stats.uniform(low, width)."
        )
    points = np.zeros((number, len(box)))
    points[:, own.columns] = own.unit_points((Random().points(number, len(own.names), seed) + 1) / 2, box)
    Y = values_of(responses, points, columns).Y
    parameters = {name: np.full(number, value) for name, value in nominal.items()}
    parameters |= dict(zip(box.names, box.from_unit(points).T, strict=True))
    parameters = ByName(parameters, units_of_parameters(nominal))
    names = tuple(responses.names[k] for k in columns)
    units = tuple(responses.units[k] if responses.units else "" for k in columns)
    name = f"samples by {responses.method}"
    return Sweep(name, responses.t, names, units, parameters, {}, Y, np.ones(number, dtype=bool), ())


class Values(NamedTuple):
    """Outputs (N, n_t, n) at points, or a reduction of them, the number of runs for them, and remarks."""

    Y: Array
    runs: int
    remarks: tuple[str, ...] = ()


def values_of(
    responses: Responses, points: Array, columns: Sequence[int], reduced: Callable[[Array], Array] = lambda Y: Y
) -> Values:
    """Outputs with these numbers at points (N, d), from polynomials that agree with some runs, or from runs.

    `reduced` is a function of the outputs (N, w, n) in a window of time. It keeps the axis of the times.
    If runs of a scene cost little, polynomials must be more accurate. Otherwise a remark states their error.
    """
    runs, made, remarks, parts = responses.runs, 0, tuple[str, ...](), list[tuple[list[int], Array]]()
    good = [k for k, column in enumerate(columns) if responses.is_good[column]]
    if good and responses.surrogate is not None:
        outputs = [columns[k] for k in good]
        surrogate = responses.surrogate.part(slice(None), outputs)
        error = surrogate.error
        if runs is not None and (made := verifying_runs(responses)):
            some = points[:made]
            error = SAFETY_OF_RUNS * np.abs(surrogate.values(some) - runs.values(some)[:, :, outputs]).max(axis=0)
        is_fine = is_used = responses.are_good(error, outputs, FINE)
        if runs is None or not runs.has_lanes:
            is_used = is_fine | (responses.are_good(error, outputs) if runs else True)
        if used := np.flatnonzero(is_used).tolist():
            step = max(1, _VALUES_TOGETHER // len(points))
            windows = (slice(k, k + step) for k in range(0, len(error), step))
            values = [reduced(surrogate.part(window, used).values(points)) for window in windows]
            parts.append(([good[k] for k in used], np.concatenate(values, axis=1)))
        if named := ", ".join(responses.names[outputs[k]] for k in np.flatnonzero(is_used & ~is_fine).tolist()):
            remarks = (f"Polynomials replace runs. Their error is above {FINE:.0%} of the width of {named}.",)
    if by_runs := [k for k in range(len(columns)) if not parts or k not in parts[0][0]]:
        if runs is None:
            raise RunsUsedUpError(f"{len(points)} runs are needed.")
        parts.append((by_runs, reduced(runs.values(points)[:, :, [columns[k] for k in by_runs]])))
        made += len(points)
    Y = np.empty((*parts[0][1].shape[:2], len(columns)))
    for own, values in parts:
        Y[..., own] = values
    return Values(Y, made, remarks)
