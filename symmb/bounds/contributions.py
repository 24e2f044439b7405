"""What each uncertain parameter contributes to the bounds, and to the variance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from symmb import _html as html
from symmb import plot
from symmb._labelled import Labelled, Named, Result, over_outputs, texts
from symmb._table import aligned, at_time, time_text
from symmb._types import Array
from symmb.bounds.responses import Responses
from symmb.bounds.time_windows import ROUNDING
from symmb.bounds.worst_case import row_of
from symmb.files import NAMES, TIMES, Record, Saved, entry
from symmb.nodes import Sobol
from symmb.polynomials import moments
from symmb.polynomials.ranges import Piecewise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POOR = 0.5
"""Error over the largest width alone from which on these widths are taken from runs along lines."""
_SAMPLES = 2048
"""Samples of each matrix from which shares of pieces are taken."""
_SAMPLING = 0.03
"""Error of such shares: the largest difference from exact ones in 200 random polynomials was 0.02."""
_WHY = "Widths do not add up to the whole one: parameters act together, and extremes lie at different values of others."


_SERIES = entry(Record.with_nan, "t", "names")
_EACH = entry(Record.with_nan, "t", "names", "parameters")


@dataclass(frozen=True, eq=False, repr=False)
class Contributions(Result, Saved):
    """What each parameter contributes to the outputs over time.

    `print` shows them where outputs are widest, by the width of each parameter alone; `plot` draws them.

    Attributes
    ----------
    t : (n_t,)
        times [s]
    names, units : n_y outputs and their units, '' where they are not known
    parameters : n_p names
    width : (n_t, n_y)
        of the bounds
    alone : (n_t, n_y, n_p)
        width if this parameter alone is uncertain, and the others are nominal
    saved : (n_t, n_y, n_p)
        width that goes away if this parameter is known to be nominal
    first, total : (n_t, n_y, n_p)
        Sobol's indices: the share of the variance that a parameter explains by itself, and with others, for uniform
        independent parameters. nan where the variance is rounding, and where no surrogate is good enough
    estimate : (n_t, n_y)
        estimated error of alone
    saved_estimate : (n_t, n_y)
        estimated error of saved
    share_estimate : (n_t, n_y)
        estimated error of the indices
    runs : int
        further runs that were made
    method : str
        where the surrogate comes from, or the runs
    remarks : sentences
        what else is known

    Examples
    --------
    >>> import symmb as mb
    >>> total = mb.FunctionSimulator(lambda a, b: [[a + b**2]], {"a": 1.0, "b": 1.0}, [0.0], ["y"])
    >>> bounds = mb.propagate(total, mb.PolynomialChaos(), mb.Box(a=(0.9, 1.1), b=(0.9, 1.1)))
    >>> bounds.contributions().alone.round(4)
    array([[[0.2, 0.4]]])
    """

    t: Array = field(metadata=TIMES)
    names: tuple[str, ...] = field(metadata=NAMES)
    units: tuple[str, ...]
    parameters: tuple[str, ...] = field(metadata=NAMES)
    width: Array = field(metadata=_SERIES)
    alone: Array = field(metadata=_EACH)
    saved: Array = field(metadata=_EACH)
    first: Array = field(metadata=_EACH)
    total: Array = field(metadata=_EACH)
    estimate: Array = field(metadata=_SERIES)
    saved_estimate: Array = field(metadata=_SERIES)
    share_estimate: Array = field(metadata=_SERIES)
    runs: int
    method: str
    remarks: tuple[str, ...] = ()

    def _head(self) -> str:
        source = f"{self.runs} further runs" if self.runs else "no further runs"
        first = f"Contributions to the bounds by {self.method}, {source}"
        return "\n".join([first, f"  {_WHY}", *(f"  remark  {remark}" for remark in self.remarks)])

    def _rows(self, k: int, i: int | None = None) -> list[list[str]]:
        """Those to output number k at time number i, or where it is widest, the largest first."""
        i = int(self.width[:, k].argmax()) if i is None else i
        width, of_share = self.width[i, k], self.share_estimate[i, k]
        has_times = time_text(self.t, i, self.width[:, k]) != ""
        title = f"{self.names[k]}{at_time(self.t, i)}" if has_times else self.names[k]
        rows = [[title, "alone", "saved", f"of width {width:.4g}", "first", "total"]]
        for p in np.argsort(-self.alone[i, k], kind="stable"):
            share = f"{self.alone[i, k, p] / width:.1%} / {self.saved[i, k, p] / width:.1%}" if width > 0 else "–"
            widths = (f"{each[i, k, p]:.4g}" for each in (self.alone, self.saved))
            indices = (f"{x:.3f}" if np.isfinite(x) else "–" for x in (self.first[i, k, p], self.total[i, k, p]))
            rows.append([self.parameters[p], *widths, share, *indices])
        known = f"≤ {of_share:.1g}" if np.isfinite(of_share) else "–"
        errors = (f"≤ {each[i, k]:.1e}" for each in (self.estimate, self.saved_estimate))
        rows.append(["estimated error", *errors, "", known, known])
        return rows

    def __str__(self) -> str:
        tables = ("\n".join(aligned(self._rows(k))) for k in range(len(self.names)))
        return "\n\n".join([self._head(), *tables])

    def _repr_html_(self) -> str:
        picture = html.picture(plot.png(self.plot()))
        return html.page(self.some_as_html(range(len(self.names)), {}), picture)

    def some_as_html(self, columns: Sequence[int], rows: Mapping[int, int]) -> str:
        """Tables of some outputs, by their numbers, at numbers of times, or where they are widest; no picture."""
        return html.page(html.text(self._head()), *(html.table(self._rows(k, rows.get(k))) for k in columns))

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        time: float | None = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
    ) -> "Figure":
        """Draw the widths of each parameter alone, stacked over time, or bars at a time; write it to `path` if given.

        Parameters
        ----------
        outputs : str or list
            those to draw; default: the first six
        time : float
            the output time [s] that is closest is drawn as bars of `alone` and `saved`
        figsize : (width, height)
            of the figure [inch]
        title : str
            of the figure
        """
        figure = plot.plot_contributions(
            self.t,
            self.names,
            self.parameters,
            self.width,
            self.alone,
            self.saved,
            units=self.units,
            chosen=plot.columns_of("Contributions.plot", outputs, self.names),
            row=None if time is None else row_of("Contributions.plot", self.t, time),
        )
        return plot.finish(figure, "Contributions.plot", path, None, figsize, title)

    def _labelled(self) -> Labelled:
        coordinates, units = over_outputs(self.t, self.names, self.units)
        coordinates["parameter"] = (("parameter",), texts(self.parameters))
        series = ("time", "output")
        variables: dict[str, Named] = {
            name: ((*series, "parameter"), getattr(self, name)) for name in ("alone", "saved", "first", "total")
        }
        variables |= {
            name: (series, getattr(self, name)) for name in ("width", "estimate", "saved_estimate", "share_estimate")
        }
        rows = ("time", "output", "parameter")
        return Labelled(coordinates, variables, {"method": self.method}, units, rows)


def contributions_of(responses: Responses) -> Contributions:
    """Ranges over lines and faces through the nominal point, and shares of the variance."""
    d, width, without = len(responses.box), responses.upper - responses.lower, replace(responses, surrogate=None)
    alone, error, runs = _widths(responses, is_alone=True)
    if responses.surrogate is not None and responses.runs is not None and _is_poor(responses, 2 * error, alone):
        alone, error, runs = _widths(without, is_alone=True)
    others, of_others, more = _widths(responses, is_alone=False)
    whole = width
    if responses.surrogate is not None:  # differences of its own ranges are more accurate
        low, high, *_ = responses.range(-np.ones(d), np.ones(d))
        whole = high - low
    saved = np.where(responses.box.radius[:, None, None] > 0, np.maximum(whole - others, 0.0), 0.0)
    of_saved = 2 * (of_others + responses.estimate) + width - whole
    estimates = np.minimum(2 * error, width), np.minimum(of_saved, width)
    first, total, share_estimate = _shares(responses, width)
    alone, saved, first, total = (np.moveaxis(part, 0, -1) for part in (alone, saved, first, total))
    units = responses.units or ("",) * len(responses.names)
    own = responses.t, responses.names, units, responses.box.names, width, alone, saved, first, total
    runs += more + responses.extra_runs
    return Contributions(*own, *estimates, share_estimate, runs, responses.method, responses.remarks)


def takes_runs(responses: Responses) -> bool:
    """Whether contributions take further runs: no polynomials are good enough, or their error hides these."""
    if responses.surrogate is None or responses.runs is None:
        return responses.surrogate is None
    alone, error, _ = _widths(responses, is_alone=True)
    return responses.extra_runs > 0 or _is_poor(responses, 2 * error, alone)


def _is_poor(responses: Responses, error: Array, alone: Array) -> bool:
    """Whether an error (n_t, n_y) hides what parameters contribute, (d, n_t, n_y). Rounding and noise do not count.

    Polynomials that are good enough have errors so large beside the width only where an output is noise.
    """
    largest = np.abs([responses.lower, responses.upper]).max(axis=(0, 1), initial=0.0)
    error = np.where(error > ROUNDING * largest, error, 0.0)
    size, wrong, width = (
        np.sqrt(np.square(part).mean(axis=-2)) for part in (alone, error, responses.upper - responses.lower)
    )
    return bool(((wrong > _POOR * size.max(axis=0, initial=0.0)) & (wrong <= _POOR * width)).any())


def _widths(responses: Responses, is_alone: bool) -> tuple[Array, Array, int]:
    """Widths (d, n_t, n_y) over lines and faces through the nominal point, the error of ranges, and how many runs.

    Each parameter is free alone, or nominal alone.
    """
    d, one = len(responses.box), np.ones(len(responses.box))
    widths, error, runs = np.zeros((d, *responses.lower.shape)), np.zeros_like(responses.lower), 0
    for i in np.flatnonzero(responses.box.radius > 0):
        is_fixed = (np.arange(d) != i) == is_alone
        ends = np.where(is_fixed, responses.nominal, -one), np.where(is_fixed, responses.nominal, one)
        low, high, of_range, more = responses.range(*ends)
        widths[i] = np.maximum(high - low, 0.0)
        error, runs = np.maximum(error, of_range), runs + more
    return widths, error, runs


def _shares(responses: Responses, width: Array) -> tuple[Array, Array, Array]:
    """First and total indices (d, n_t, n_y), and their estimated error (n_t, n_y); nan where they are not known.

    An error e of the responses changes the standard deviation s of a part by e at most, and a share by
    (s + e)^2 / s^2 - 1 at most.
    """
    d, surrogate = len(responses.box), responses.surrogate
    if surrogate is None:
        unknown = np.full((d, *width.shape), np.nan)
        return unknown, unknown, unknown[0]
    if len(surrogate.expansions) == 1:
        exact, sampling = moments(surrogate.expansions[0], responses.t, responses.names), 0.0
        first, total, variance = exact.first, exact.total, exact.variance
    else:
        first, total, variance = _sampled_shares(surrogate, d)
        sampling = _SAMPLING
    e = np.divide(surrogate.error, np.sqrt(variance), out=np.ones_like(variance), where=variance > 0)
    return first, total, np.minimum(e * (2 + e) + sampling, 1.0)


def _sampled_shares(surrogate: Piecewise, d: int) -> tuple[Array, Array, Array]:
    """First and total indices (d, n_t, n_y), and the variance (n_t, n_y), from samples of two matrices.

    Saltelli and others, Computer Physics Communications 181 (2010): of the first index (b), of the total one (f).
    """
    A, B = np.split(Sobol().points(_SAMPLES, 2 * d, seed=0), 2, axis=1)
    first, total = np.empty((2, d, *surrogate.error.shape))
    variance = np.empty(surrogate.error.shape)
    for k in range(surrogate.error.shape[1]):
        own = surrogate.part(slice(None), [k])
        at_a, at_b = (own.values(points)[:, :, 0] for points in (A, B))
        mean, variance[:, k] = np.concatenate([at_a, at_b]).mean(axis=0), np.concatenate([at_a, at_b]).var(axis=0)
        for i in range(d):
            mixed = A.copy()
            mixed[:, i] = B[:, i]
            at_mixed = own.values(mixed)[:, :, 0]
            first[i, :, k] = ((at_b - mean) * (at_mixed - at_a)).mean(axis=0)
            total[i, :, k] = np.square(at_a - at_mixed).mean(axis=0) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.clip(first / variance, 0.0, 1.0), np.clip(total / variance, 0.0, 1.0), variance
