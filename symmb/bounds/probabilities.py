"""Quantiles and probabilities of outputs, for parameters with laws, and parameters that stay intervals."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, PropagationError
from symmb._labelled import Labelled, Named, Result
from symmb._limits import require_memory
from symmb._options import is_finite_number, numbers_of, shown, whole
from symmb._table import aligned, at_time, is_timeless, over_times, time_text
from symmb._types import Array
from symmb.bounds.laws import Laws
from symmb.bounds.responses import Responses
from symmb.nodes import Random, Sobol
from symmb.simulation import Sweep

_REPLICATES = 8
"""Independent sets of samples: their scatter is the sampling error."""
_SAMPLES, _FEWER = 512, 128
"""Samples of a set from polynomials, and where each takes a search for extremes or a run: more take more time."""
_AT_ONCE = 2**20
"""Values that are computed at once: what the cache of a processor holds."""
_NEAR = 2.0
"""Samples next to a quantile that are not told from it."""
_FEW = 8
"""Samples beyond a quantile below which it is told that these are few."""
_NONE = 3.0
"""Expected number of events of which none is seen in one of 20 samples: the least sampling error of a probability."""
_DEVIATIONS = 3.5
"""Standard errors of the mean of the sets that are told as sampling error: 99 % of Student's t with 7 degrees."""


@dataclass(frozen=True, eq=False, repr=False)
class Figures(Result):
    """What quantiles and probabilities share.

    Attributes
    ----------
    output, unit : str
    t : (n_t,)             times [s]
    laws : str             of the parameters that have one
    intervals : names      of the parameters that have none
    samples : int
    remarks : sentences
    """

    output: str
    unit: str
    t: Array
    laws: str
    intervals: tuple[str, ...]
    samples: int
    remarks: tuple[str, ...]

    def _title(self) -> str:
        raise NotImplementedError

    def _rows(self) -> list[list[str]]:
        raise NotImplementedError

    def _head(self) -> str:
        lines = [self._title(), f"  laws         {self.laws}, {self.samples} samples"]
        if self.intervals:
            lines.append(
                f"  intervals    {', '.join(self.intervals)}: anything in the box, so that there are two values"
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
    lower, upper : (n_q, n_t)      least and greatest quantile, whatever the parameters without a law are in each
                                   sample; they are the same if all have laws
    estimate : (n_q, n_t)          estimated error: that of the polynomials and of sampling
    """

    levels: Array
    lower: Array
    upper: Array
    estimate: Array

    def _title(self) -> str:
        return f"Quantiles of {self.output}, {len(self.t)} times"

    def _rows(self) -> list[list[str]]:
        ends = ["least", "at [s]", "greatest", "at [s]", "estimated error"]
        rows = [["quantile", *ends]]
        for q, lower, upper, error in zip(self.levels, self.lower, self.upper, self.estimate, strict=True):
            i, j = int(lower.argmin()), int(upper.argmax())
            when = [time_text(self.t, row, lower, upper) for row in (i, j)]
            values = f"{lower[i]:.6g}", when[0], f"{upper[j]:.6g}", when[1]
            rows.append([f"{q:g}", *values, f"≤ {error.max():.1e}"])
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
    """How probable it is that an output is beyond a value.

    Attributes
    ----------
    event : str                the event
    lower, upper : (n_t,)      least and greatest probability at each time; the same if all parameters have laws
    estimate : (n_t,)          estimated error: that of the polynomials and of sampling
    ever : (lower, upper, estimate)    of the event at any output time
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
        largest = f"greatest,{at_time(self.t, i)}", self.lower[i], self.upper[i], self.estimate[i]
        rows = [["", "probability", "estimated error"]]
        ever = "at any output time" if has_times else "", *self.ever
        for name, low, high, error in (ever, largest) if has_times else (ever,):
            value = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            rows.append([name, value, f"≤ {error:.1e}"])
        return rows

    def _labelled(self) -> Labelled:
        variables: dict[str, Named] = {
            name: (("time",), getattr(self, name)) for name in ("lower", "upper", "estimate")
        }
        about = dict(zip(("ever_lower", "ever_upper", "ever_estimate"), self.ever, strict=True))
        return Labelled({"time": (("time",), self.t)}, variables, {"event": self.event, **about}, {"time": "s"})


def quantiles_of(responses: Responses, output: object, levels: object, laws: object, correlation: object) -> Quantiles:
    """Quantiles of an output; see `Bounds.quantiles`."""
    owner = "Bounds.quantiles"
    k = responses.column(owner, output)
    q = numbers_of([levels] if is_finite_number(levels) else levels)
    if q is None or q.ndim != 1 or not len(q) or not ((q > 0) & (q < 1)).all():
        raise DeclarationError(f"{owner}: levels must be probabilities above 0 and below 1, got {shown(levels)}.")
    samples = _Samples(owner, responses, k, laws, correlation)
    parts = []
    for _, low, high in samples.over_time():
        ends = [_quantiles_and_scatter(each, q) for each in ((low,) if low is high else (low, high))]
        parts.append((ends[0][0], ends[-1][0], np.maximum(ends[0][1], ends[-1][1])))
    lower, upper, sampling = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
    lower, upper = np.clip((lower, upper), responses.lower[:, k], responses.upper[:, k])
    return Quantiles(*samples.about(q), q, lower, upper, sampling + samples.error)


def _quantiles_and_scatter(values: Array, q: Array) -> tuple[Array, Array]:
    """Quantiles (n_q, n_t) of values (replicates, n, n_t), and their sampling error."""
    sets = np.ascontiguousarray(values.transpose(2, 0, 1))
    sets.sort(axis=2)  # np.quantile takes five times as long
    whole = sets.reshape(len(sets), -1).copy()
    whole.sort(axis=1)
    near = _NEAR / whole.shape[1]
    quantiles, above, below = (_of_sorted(whole, np.clip(q + sign * near, 0, 1)) for sign in (0, 1, -1))
    scatter = _scatter(np.moveaxis(_of_sorted(sets, q), 2, 0))
    return quantiles, np.maximum(scatter, np.maximum(above - quantiles, quantiles - below))


def _of_sorted(values: Array, q: Array) -> Array:
    """(n_q, n_t, ...) quantiles of values (n_t, ..., n) that rise along the last axis."""
    place = q * (values.shape[-1] - 1)
    first = np.minimum(place.astype(int), values.shape[-1] - 2)
    share = place - first
    return np.moveaxis((1 - share) * values[..., first] + share * values[..., first + 1], -1, 0)


def probability_of(
    responses: Responses, output: object, above: object, below: object, laws: object, correlation: object
) -> Probability:
    """Probability that an output is above one value or below another; see `Bounds.probability`.

    Where parameters without a law give a sample a range, the event is certain if the range is on one side as a whole.
    """
    owner = "Bounds.probability"
    k = responses.column(owner, output)
    thresholds = [value for value in (below, above) if value is not None]
    ends = [float(value) for value in thresholds if is_finite_number(value)]
    if not ends or len(ends) < len(thresholds) or ends != sorted(ends):
        raise DeclarationError(
            f"{owner}: give a number for one of above and below, or for both, of which below is not the larger one, "
            f"got {shown(above)} and {shown(below)}."
        )
    bottom, top = -np.inf if below is None else ends[0], np.inf if above is None else ends[-1]
    samples = _Samples(owner, responses, k, laws, correlation)
    at_times, ever = [], np.zeros((4, _REPLICATES, samples.number // _REPLICATES), dtype=bool)
    for window, low, high in samples.over_time():
        least, greatest, e = responses.lower[window, k], responses.upper[window, k], samples.error[window]
        low, high = np.clip((low, high), least, greatest)
        pairs = (low, high), (high, low), (low - e, high + e), (high + e, low - e)
        beyond = np.stack([(above_it > top) | (below_it < bottom) for above_it, below_it in pairs])
        at_times.append(beyond.mean(axis=2))
        ever |= beyond.any(axis=3)
    sets = np.concatenate([*at_times, ever.mean(axis=2)[..., None]], axis=2)  # (4, replicates, n_t + 1)
    lower, upper, least, greatest = sets.mean(axis=1)
    sampling = np.maximum(np.maximum(_scatter(sets[0]), _scatter(sets[1])), _NONE / samples.number)
    estimate = sampling + np.maximum(lower - least, greatest - upper)
    sides = ((below, "below"), (above, "above"))
    event = f"{responses.names[k]} " + " or ".join(f"{word} {end:g}" for end, word in sides if end is not None)
    last = float(lower[-1]), float(upper[-1]), float(estimate[-1])
    return Probability(*samples.about(), event, lower[:-1], upper[:-1], estimate[:-1], last)


def samples_of(
    responses: Responses, n: object, laws: object, correlation: object, seed: object, nominal: Mapping[str, float]
) -> Sweep:
    """Random samples; see `Bounds.samples`."""
    owner, box = "Bounds.samples", responses.box
    number, seed = whole(owner, "n", n, 1), whole(owner, "seed", seed, 0)
    require_memory(owner, "the samples", number * responses.lower.size)
    own = Laws.of(owner, laws, correlation, box)
    lacking = [name for name, r in zip(box.names, box.radius, strict=True) if r > 0 and name not in own.names]
    if lacking:
        raise DeclarationError(
            f"{owner}: samples need a law of every parameter, and {', '.join(lacking)} have none. "
            "scipy.stats.uniform(low, width) spreads evenly."
        )
    points = np.zeros((number, len(box)))
    points[:, own.columns] = own.unit_points((Random().points(number, len(own.names), seed) + 1) / 2, box)
    if responses.surrogate is not None:
        Y = responses.surrogate.values(points)
    else:
        assert responses.runs is not None
        Y = responses.runs.values(points)
    parameters = {name: np.full(number, value) for name, value in nominal.items()}
    parameters |= dict(zip(box.names, box.from_unit(points).T, strict=True))
    units = responses.units or ("",) * len(responses.names)
    name = f"samples by {responses.method}"
    return Sweep(name, responses.t, responses.names, units, parameters, {}, Y, np.ones(number, dtype=bool), ())


class _Samples:
    """Samples of an output: sets of points that are spread by laws, and ranges over the parameters without a law.

    Attributes
    ----------
    number : int           of all samples
    error : (n_t,)         of the polynomials
    """

    def __init__(self, owner: str, responses: Responses, k: int, laws: object, correlation: object) -> None:
        box = responses.box
        self._responses, self._k, self._laws = responses, k, Laws.of(owner, laws, correlation, box)
        self._free = box.radius > 0
        self._free[self._laws.columns] = False
        surrogate = responses.surrogate
        if surrogate is None and self._free.any():
            raise PropagationError(
                f"{owner}: no polynomials are good enough for parameters that stay intervals: give all of them laws."
            )
        n = _SAMPLES if surrogate is not None and not self._free.any() else _FEWER
        self.number = _REPLICATES * n
        self.error = np.zeros(len(responses.t)) if surrogate is None else surrogate.error[:, k]
        sets = [Sobol().points(n, len(self._laws.names), seed) for seed in range(_REPLICATES)]
        self._points = np.zeros((self.number, len(box)))
        self._points[:, self._laws.columns] = self._laws.unit_points((np.concatenate(sets) + 1) / 2, box)

    def over_time(self) -> Iterator[tuple[slice, Array, Array]]:
        """Windows of time, and the least and greatest values (replicates, n, n_t) there."""
        responses, k = self._responses, self._k
        n_t = step = len(responses.t)
        if responses.surrogate is not None:  # each window computes all terms at the points again
            terms = max(len(own.alpha) for own in responses.surrogate.expansions)
            step = max(_AT_ONCE // self.number, terms)
        for start in range(0, n_t, step):
            window = slice(start, min(start + step, n_t))
            if responses.surrogate is None:
                assert responses.runs is not None
                low = high = responses.runs.values(self._points)[:, :, k : k + 1]
            else:
                own = responses.surrogate.part(window, [k])
                if self._free.any():
                    low, high = own.ranges(self._points, self._free)
                else:
                    low = high = own.values(self._points)
            shape = _REPLICATES, -1, low.shape[1]
            sets = low.reshape(shape)
            yield window, sets, sets if low is high else high.reshape(shape)

    def about(self, levels: Array | None = None) -> tuple[str, str, Array, str, tuple[str, ...], int, tuple[str, ...]]:
        """The attributes of `Figures`."""
        responses = self._responses
        intervals = tuple(name for name, free in zip(responses.box.names, self._free, strict=True) if free)
        remarks = (*responses.remarks, *self._laws.remarks)
        if levels is not None and (few := np.minimum(levels, 1 - levels) * self.number < _FEW).any():
            text = ", ".join(f"{q:g}" for q in levels[few])
            remarks = (*remarks, f"Few of the samples are beyond the quantiles {text}: their error is a rough guess.")
        unit = responses.units[self._k] if responses.units else ""
        return responses.names[self._k], unit, responses.t, repr(self._laws), intervals, self.number, remarks


def _scatter(sets: Array) -> Array:
    """Sampling error of the mean of figures of all sets (replicates, ...)."""
    return _DEVIATIONS * sets.std(axis=0, ddof=1) / np.sqrt(_REPLICATES)
