"""Contributions of each uncertain parameter to the bounds and to the variance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb import _html as html
from symmb._labelled import Labelled, Named, Result, over_outputs, texts
from symmb._magnitudes import ROUNDING, SAME
from symmb._table import aligned, at_time, time_text
from symmb._types import Array, Mask
from symmb._units import told_names
from symmb.bound.nodes import Sobol, fitted
from symmb.bound.polynomials import moments
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import Responses, RunsUsedUpError, rms, row_of
from symmb.results import plot
from symmb.results.files import NAMES, TIMES, Record, Saved, entry

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POOR_LINE, _SMALL_OF_WIDTH, _NOISE_OF_WIDTH = 0.1, 0.05, 0.5
"""Three limits for the error of a width of one parameter alone: one relative to this width, two to the full width.

If the error is above the first two limits, runs give the width instead of polynomials, because a study of one parameter
takes few runs. An error above the third limit is noise, which runs would not reduce.
"""
_FEWEST_SHARE_RUNS, _MOST_SHARE_RUNS = 64, 1024
"""Smallest and largest number of runs for variance fractions."""
_BEYOND_SAMPLES = 4.0
"""Largest error of polynomials at an end of a range, divided by their largest error at random points. In 45 outputs of
eight scenes the ratio was 2.1 at most, apart from rounding."""
_NO_SUM = "The widths of single parameters do not sum to the full width, because parameters act together."


_OF_OUTPUT = entry(Record.with_nan, "t", "names")
_OF_PARAMETER = entry(Record.with_nan, "t", "names", "parameters")


@dataclass(frozen=True, eq=False, repr=False)
class Contributions(Result, Saved):
    """Contributions of each parameter to the outputs over time.

    `print` shows the contributions at the times of the largest widths, sorted by `alone`. `plot` draws them. A
    contribution may be zero if its estimated error is larger than the contribution. In this case, a sentence below the
    table says that contributions may be zero.

    Attributes
    ----------
    t : (n_t,)
        times [s]
    names, units : n_y outputs and their units, '' if they are not known
    parameters : n_p names
    width : (n_t, n_y)
        width of the bounds
    alone : (n_t, n_y, n_p)
        width if only this parameter is uncertain, and the others are nominal
    saved : (n_t, n_y, n_p)
        decrease of the width if this parameter has its nominal value
    first, total : (n_t, n_y, n_p)
        Sobol's indices: the fraction of the variance that a parameter causes alone, and with its interactions.
        Parameters are uniform and independent. Indices are nan if the variance is only rounding
    estimate : (n_t, n_y)
        largest estimated error of `alone`
    saved_estimate : (n_t, n_y)
        largest estimated error of `saved`
    share_estimate : (n_t, n_y)
        estimated error of the indices
    runs : int
        number of further runs
    method : str
        method of the surrogate or of the runs
    remarks : sentences
        further information
    errors : (2, n_t, n_y, n_p)
        estimated errors of `alone` and of `saved` for each parameter; None in files of earlier versions

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
    width: Array = field(metadata=_OF_OUTPUT)
    alone: Array = field(metadata=_OF_PARAMETER)
    saved: Array = field(metadata=_OF_PARAMETER)
    first: Array = field(metadata=_OF_PARAMETER)
    total: Array = field(metadata=_OF_PARAMETER)
    estimate: Array = field(metadata=_OF_OUTPUT)
    saved_estimate: Array = field(metadata=_OF_OUTPUT)
    share_estimate: Array = field(metadata=_OF_OUTPUT)
    runs: int
    method: str
    remarks: tuple[str, ...] = ()
    errors: Array | None = field(default=None, metadata=entry(Record.with_nan, None, "t", "names", "parameters"))

    def _head(self) -> str:
        source = f"{self.runs} further runs" if self.runs else "no further runs"
        first = f"Contributions to the bounds by {self.method}, {source}"
        apart = np.abs(self.alone.sum(axis=-1) - self.width) > self.estimate * len(self.parameters) + SAME * self.width
        return "\n".join([first, *[f"  {_NO_SUM}"] * bool(apart.any()), *(f"  remark  {r}" for r in self.remarks)])

    def _row(self, k: int, i: int | None) -> int:
        """The time i, or the time of the largest width of output k."""
        return int(self.width[:, k].argmax()) if i is None else i

    def _each_error(self) -> Array:
        """(2, n_t, n_y, n_p) estimated errors of alone and of saved."""
        if self.errors is not None:
            return self.errors
        return np.stack([self.estimate, self.saved_estimate])[..., None].repeat(len(self.parameters), axis=-1)

    def _may_be_zero(self, k: int, i: int | None = None) -> str:
        """A sentence if contributions to output k at time i are smaller than their errors; else empty."""
        i = self._row(k, i)
        values, errors = np.stack([self.alone, self.saved])[:, i, k], self._each_error()[:, i, k]
        is_small = (values > SAME * self.width[i, k]) & (values < errors)
        return "Contributions that are smaller than their estimated errors may be zero." if is_small.any() else ""

    def _rows(self, k: int, i: int | None = None) -> list[list[str]]:
        """A table of contributions to output k at time i (default: of the largest width), with the largest first."""
        i, errors = self._row(k, i), self._each_error()
        width, of_share = self.width[i, k], self.share_estimate[i, k]
        has_times = time_text(self.t, i, self.width[:, k]) != ""
        name = told_names(self.names, self.units)[k]
        title = f"{name}{at_time(self.t, i)}" if has_times else name
        of = f"of width {width:.4g}" if np.isfinite(width) else "of infinite width"
        rows = [[title, "alone", "±", "saved", "±", of, "first", "total"]]
        for p in np.argsort(-self.alone[i, k], kind="stable"):
            share = (
                f"{self.alone[i, k, p] / width:.1%} / {self.saved[i, k, p] / width:.1%}" if 0 < width < np.inf else "–"
            )
            pairs = zip((self.alone, self.saved), errors, strict=True)
            widths = (text for value, e in pairs for text in (f"{value[i, k, p]:.4g}", f"{e[i, k, p]:.1g}"))
            indices = (f"{x:.3f}" if np.isfinite(x) else "–" for x in (self.first[i, k, p], self.total[i, k, p]))
            rows.append([self.parameters[p], *widths, share, *indices])
        known = f"≤ {of_share:.1g}" if np.isfinite(of_share) else "–"
        rows.append(["estimated error", *[""] * 5, known, known])
        return rows

    def __str__(self) -> str:
        tables = (
            "\n".join(filter(None, [*aligned(self._rows(k)), self._may_be_zero(k)])) for k in range(len(self.names))
        )
        return "\n\n".join([self._head(), *tables])

    def _repr_html_(self) -> str:
        picture = html.picture(plot.png(self.plot()))
        return html.page(self.some_as_html(range(len(self.names)), {}), picture)

    def some_as_html(self, columns: Sequence[int], rows: Mapping[int, int]) -> str:
        """Tables of the outputs `columns`, at the times `rows` (output -> time), or where the bounds are widest."""
        tables = (
            html.page(html.table(self._rows(k, rows.get(k))), html.text(self._may_be_zero(k, rows.get(k))))
            for k in columns
        )
        return html.page(html.text(self._head()), *tables)

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        time: float | str | None = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        **look: Any,
    ) -> "Figure":
        """Draw the widths of each parameter alone over time, or bars at a time; write the picture to `path` if given.

        Parameters
        ----------
        outputs : str or list
            outputs to draw; default: the first six
        time : float or str
            [s], or with a unit; `alone` and `saved` at the closest output time are drawn as bars
        figsize : (width, height)
            of a new figure [inch]
        title : str
            of a new figure
        ax : matplotlib Axes
            one for each output, used instead of a new figure
        label, color, legend
            of the curves: a text or a colour, or a list with an entry for each curve; and True or False
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
            style=plot.Style("Contributions.plot", ax, **look),
        )
        return plot.finish(figure, "Contributions.plot", path, ax, figsize, title)

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


@np.errstate(invalid="ignore")  # widths may be infinite
def contributions_of(responses: Responses, may_run: bool = True) -> Contributions | None:
    """Contributions from ranges over lines and faces through the nominal point, and from variance fractions.

    The result is None if further runs are required and `may_run` is false.
    """
    width, free = responses.upper - responses.lower, responses.box.radius > 0
    alone, of_alone, missing = _widths(responses, is_alone=True)
    others, of_others, lacking = _widths(responses, is_alone=False)
    if not may_run and (missing.any() or lacking.any()):
        return None
    allowed = np.inf if responses.runs is None else responses.runs.left
    asked = int(missing.any(axis=1).sum()), int(lacking.any(axis=1).sum())
    # Studies of one parameter take few runs, so they are first. Variance fractions have a part of the other runs.
    runs = _by_runs(responses, missing, True, alone, of_alone, (0, sum(asked)), asked[0])
    runs += _by_runs(responses, lacking, False, others, of_others, (asked[0], sum(asked)), asked[1] + 1)
    low, high, _ = responses.range(-np.ones(len(free)), np.ones(len(free)))
    # A face contains the lines of its parameters, so few runs cannot know its range better than those of the lines.
    of_lines = np.stack([np.delete(of_alone, i, axis=0).max(axis=0, initial=0.0) for i in range(len(free))])
    of_others = np.where(lacking[:, None], np.maximum(of_others, of_lines), of_others)
    # Differences of ranges of the same polynomials are more accurate.
    whole = np.where(np.isnan(low) | lacking[:, None], width, high - low)
    saved = np.where(free[:, None, None] & (whole - others > ROUNDING * whole), whole - others, 0.0)
    first, total, share_estimate, sampled, residual = _shares(responses, may_run)
    of_alone, of_others = np.minimum([of_alone, of_others], _BEYOND_SAMPLES * residual + responses.floor)
    of_saved = np.where(free[:, None, None], 2 * (of_others + responses.estimate) + width - whole, 0.0)
    errors = np.nan_to_num(np.minimum([2 * of_alone, of_saved], width), nan=np.inf, posinf=np.inf)
    are_large = rms(np.moveaxis(errors, 2, 0)) > _POOR_LINE * rms(width)
    few = np.isfinite(allowed) and (are_large & [missing, lacking]).any()
    remarks = (f"{allowed:g} further runs do not suffice. More are allowed by runs=.",) if few else ()
    alone, saved, first, total = (np.moveaxis(part, 0, -1) for part in (alone, saved, first, total))
    units = responses.units or ("",) * len(responses.names)
    return Contributions(
        responses.t,
        responses.names,
        units,
        responses.box.names,
        width,
        alone,
        saved,
        first,
        total,
        estimate=errors[0].max(axis=0),
        saved_estimate=errors[1].max(axis=0),
        share_estimate=share_estimate,
        runs=runs + sampled + responses.extra_runs,
        method=responses.method,
        remarks=(*responses.remarks, *remarks),
        errors=np.moveaxis(errors, 1, -1),
    )


def _widths(responses: Responses, is_alone: bool) -> tuple[Array, Array, Mask]:
    """Widths (d, n_t, n_y) of polynomials over lines or faces through the nominal point, and the errors of their ends.

    The third array (d, n_y) marks widths that require runs. On a line, one parameter varies and all other parameters
    are nominal. On a face, one parameter is nominal and all other parameters vary.
    """
    d, whole = len(responses.box), rms(responses.upper - responses.lower)
    widths, error = np.zeros((2, d, *responses.lower.shape))
    missing = np.zeros((d, len(responses.names)), dtype=bool)
    largest = np.abs([responses.lower, responses.upper]).max(axis=(0, 1), initial=0.0)
    free = np.flatnonzero(responses.box.radius > 0)
    if len(free) == 1:  # its line is the box, and the other end of the face is a point
        widths[free] = (responses.upper - responses.lower) * is_alone
        error[free] = responses.estimate * is_alone
        return widths, error, missing
    for i in free:
        low, high, error[i] = responses.range(*_ends(responses, i, is_alone))
        widths[i] = np.maximum(high - low, 0.0)
        missing[i] = ~responses.is_good
        if is_alone and responses.runs is not None:
            wrong = rms(np.where(2 * error[i] > SAME * largest, 2 * error[i], 0.0))
            hides = wrong > np.maximum(_POOR_LINE * rms(widths[i]), _SMALL_OF_WIDTH * whole)
            missing[i] |= hides & (wrong <= _NOISE_OF_WIDTH * whole)
    return widths, error, missing


def _by_runs(
    responses: Responses,
    missing: Mask,
    is_alone: bool,
    widths: Array,
    error: Array,
    studies: tuple[int, int],
    parts: int,
) -> int:
    """Fill in missing widths and errors, each (d, n_t, n_y), by further studies, and return the number of runs.

    `missing` (d, n_y) marks these widths, and after the studies all widths from runs. Errors of other outputs are often
    smaller in the same studies. The progress shows `studies`: the numbers of earlier studies and of all studies. The
    runs that are left are divided into equal `parts`, one for each study. If a part does not suffice, the width of
    inaccurate polynomials is used, and its error is the full width.
    """
    runs, (before, of_all) = 0, studies
    for number, i in enumerate(np.flatnonzero(missing.any(axis=1))):
        each = ((np.arange(len(responses.box)) == i) == is_alone) & (responses.box.radius > 0)
        label = f"contributions, further study {before + number + 1} of {of_all}"
        try:
            low, high, of_range, more = responses.range_by_runs(each, label, parts - number)
        except RunsUsedUpError:
            low, high = responses.lower, responses.upper
            if responses.surrogate is not None:
                low, high, _ = responses.surrogate.range(*_ends(responses, i, is_alone))
            of_range, more = np.where(responses.is_good, error[i], responses.upper - responses.lower), 0
        # The widths of the full box and of its faces are from one source. Runs replace polynomials if they gain much.
        own = missing[i] = missing[i] | (2 * rms(of_range) < rms(error[i]))
        # Ranges inside of the box cannot be wider than the bounds.
        widths[i][:, own] = np.clip(high - low, 0.0, responses.upper - responses.lower)[:, own]
        error[i][:, own] = of_range[:, own]
        runs += more
    return runs


def _ends(responses: Responses, i: int | np.intp, is_alone: bool) -> tuple[Array, Array]:
    """The ends (d,), (d,) of the line of parameter i, or of the face where it is nominal."""
    is_fixed, one = (np.arange(len(responses.box)) != i) == is_alone, np.ones(len(responses.box))
    return np.where(is_fixed, responses.nominal, -one), np.where(is_fixed, responses.nominal, one)


def _shares(responses: Responses, may_run: bool) -> tuple[Array, Array, Array, int, Array]:
    """First and total indices (d, n_t, n_y), their estimated error (n_t, n_y), and the number of runs.

    The last result is the largest residual (n_t, n_y) of the polynomials at these runs; infinite without runs.

    The indices are those of polynomials. They are nan if the variance is only rounding. If polynomials miss the
    fraction r of the variance, the error of a variance fraction is at most r + 2 sqrt(r). If residuals are independent
    of the polynomials, as for least squares, this error is at most r.
    """
    first, total = np.full((2, len(responses.box), *responses.lower.shape), np.nan)
    variance, error = np.zeros(responses.lower.shape), np.ones(responses.lower.shape)
    largest = np.full(responses.lower.shape, np.inf)
    surrogate, good = responses.surrogate, np.flatnonzero(responses.is_good).tolist()
    if surrogate is not None and len(good):
        own = surrogate.part(slice(None), good)
        first[..., good], total[..., good], variance[:, good], sampling = _shares_of(own, responses)
        error[:, good] = _share_error(own.error, variance[:, good]) + sampling
    known = first.copy(), total.copy(), error.copy()
    varies = ~np.isnan(first).all(axis=0) | ~responses.is_good
    n, most = _FEWEST_SHARE_RUNS, 0 if not may_run or responses.runs is None else _MOST_SHARE_RUNS
    while n <= most and _is_large(error, variance, varies):
        assert responses.runs is not None
        if n > responses.runs.left:
            break
        points, Y = responses.runs.sample(n)
        fit = fitted(points, Y, responses.box.names)
        of_fit = moments(fit.expansions[0], responses.t, responses.names)
        variance, rest = Y.var(axis=0), np.square(fit.error)
        missed = np.divide(rest, variance, out=np.ones_like(rest), where=variance > 0)
        of_errors = missed + 2 * np.sqrt(missed / len(points))
        first, total, error = (part.copy() for part in known)
        if surrogate is not None and len(good):
            own = surrogate.part(slice(None), good)
            residual = own.values(points) - Y[..., good]
            error[:, good] = np.minimum(error[:, good], _share_error(rms(residual), variance[:, good]) + sampling)
            largest[:, good] = np.abs(residual).max(axis=0)
        better = varies & (of_errors < error)
        first, total = np.where(better, of_fit.first, first), np.where(better, of_fit.total, total)
        error, n = np.where(better, of_errors, error), 2 * n
    error = np.where(np.isnan(first).all(axis=0), np.nan, np.minimum(error, 1.0))
    return first, total, error, n // 2 if n > _FEWEST_SHARE_RUNS else 0, largest


def _share_error(e: Array, variance: Array) -> Array:
    """Largest error of a variance fraction for responses with the rms error e: r (2 + r), r = e / deviation."""
    e = np.divide(e, np.sqrt(variance), out=np.ones_like(variance), where=variance > 0)
    return np.asarray(e * (2 + e))


def _is_large(error: Array, variance: Array, varies: Mask) -> bool:
    """Whether variance fractions of an output have a large error at times with a large variance."""
    weights = np.where(varies, variance, 0.0)
    typical = (np.minimum(error, 1.0) * weights).sum(axis=0) / np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    unknown = varies.any(axis=0) & (weights.sum(axis=0) == 0)  # before the first runs
    # Further runs are made if the mean error of variance fractions, weighted with the variance, is above this value.
    return bool((np.where(unknown, 1.0, typical) > 0.04).any())


def _shares_of(surrogate: Piecewise, responses: Responses) -> tuple[Array, Array, Array, float]:
    """First and total indices (d, n_t, n_y) of polynomials, their variance (n_t, n_y), and the sampling error."""
    if len(surrogate.expansions) > 1:
        first, total, variance = _sampled_shares(surrogate, len(responses.box))
        # Error of these fractions: the largest difference from exact fractions in 200 random polynomials was 0.02.
        return first, total, variance, 0.03
    names = tuple(name for name, is_good in zip(responses.names, responses.is_good, strict=True) if is_good)
    expansion = next(iter(surrogate.expansions))
    exact = moments(expansion, responses.t, names)
    return exact.first, exact.total, exact.variance, 0.0


def _sampled_shares(surrogate: Piecewise, d: int) -> tuple[Array, Array, Array]:
    """First and total indices (d, n_t, n_y), and the variance (n_t, n_y), from samples of two matrices.

    Saltelli and others, Computer Physics Communications 181 (2010): formula (b) of the first index, formula (f) of the
    total index.
    """
    # Number of samples of each matrix for variance fractions of piecewise polynomials.
    A, B = np.split(Sobol().points(2048, 2 * d, seed=0), 2, axis=1)
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
