"""The result of every bounding method."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._labelled import ByOutput, Counted, Labelled, NamedColumns, Result
from symmb._magnitudes import ROUNDING
from symmb._names import look_up_by_name
from symmb._options import require_numbers, require_truth
from symmb._presentation import presentation
from symmb._progress import shown_runs
from symmb._table import aligned, is_timeless, over_times, span_text
from symmb._units import headings, told_names, with_units
from symmb.bound import answers
from symmb.bound.answers import result_file
from symmb.bound.answers.answers import Answers
from symmb.bound.responses import ENDED, RULES, STALLED, USED_UP, WorstCase, failure_text
from symmb.results import files, plot
from symmb.results.files import Record, Saved, attributes, entries

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Bounds(Answers, Counted, Result, ByOutput, Saved):
    """Lower and upper bounds of every output at every time.

    `print` shows kind, extremes and widths. `plot` draws the bounds. `save` and `load` write and read files.

    Attributes
    ----------
    t : (n_t,) times [s]
    names : n_y outputs
    lower, upper : (n_t, n_y) best estimate of the bounds; `lower["x"]` is the lower bound of one output
    kind : "enclosure" (proved to contain the responses), "estimate" (from a surrogate: possibly too wide or too narrow)
        or "sampled" (attained by runs: the true bounds may be wider)
    method : text of the call that made the method
    evaluations, runs : number of runs; a run with derivatives counts as several runs, by its cost
    estimate : (n_t, n_y) estimated error of lower and upper, at least 0; None if the method has none
    noise : (n_y,) error of runs by noise or rounding; None if it is not known
    inner : (lower, upper), each (n_t, n_y): extremes that runs attained; or None
    failed : failed runs
    failed_region : region of failed runs in the box, in words; empty for fewer than two failed runs, or if the region
        is not known
    seconds : wall time of runs and bounding [s]
    expansion : polynomial chaos of a given order, or None
    caution : time from which the method is not valid, and the reason; empty if the method is valid at all times
    run_doubts : warnings about the runs, in sentences; `warnings` (or `doubts`) contains all warnings
    remarks : further information in sentences, for example on a tolerance that was not reached
    units : n_y units of the outputs, '' for unknown ones; empty if none is known
    box : intervals of the parameters; None if they are not known
    surrogate : polynomials that replace the responses, with their error; None if the method or the file has none
    study : simulator and box, for more runs; None if the bounds were read or pickled
    subject, solver : name of the scene or simulator, and the solver of a scene in words; empty if not known
    nominal : (n_t, n_y) outputs of the nominal run; None if they are not known
    nominal_parameters : nominal values of all parameters; empty if they are not known
    attaining : the runs that attain the bounds; None if the bounds were read or pickled, or if there are no runs
    worst_cases : worst cases over all times, if the bounds were read from a file
    figures : names of the scalar outputs (one number per run); their bounds are the same at all times
    range_of : source of the range of an adaptive method, such as runs at corners; empty for other methods
    parts : bounds of each combination of the choices of the box; empty if there are no choices
    lost : errors of combinations without bounds, by their words, as "spring: hard"; empty in bounds from a file
    trace : rounds of an adaptive study with the rule that decides each error; None for other methods. See `why`
    next_run : parameters at which one more run would reduce the error most, for bounds of RecordedRuns; otherwise None

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.array([0.0, 1.0])
    >>> mb.Bounds(t, ("x",), np.array([[0.0], [1.0]]), np.array([[0.0], [3.0]]), "sampled", "Vertex()", 4)["x"]
    (array([0., 1.]), array([0., 3.]))
    """

    def __post_init__(self) -> None:
        look_up_by_name(self)
        for name in ("lower", "upper", "estimate"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, NamedColumns(values, self.names))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "study": None, "attaining": None, "parts": ()}

    @np.errstate(invalid="ignore")  # bounds and limits may be infinite
    def check(self, limits: "answers.Limits", *, runs: int | None = None) -> "answers.LimitCheck":
        """Check whether outputs satisfy limits for all parameters of the box, at all times.

        The check widens the bounds by their estimated error at each time. A limit is satisfied if the widened bounds
        are inside the limit, and no warning concerns the output. A limit is violated if a run exceeds it by more than
        rounding and noise. The nominal run counts if its parameters are in the box. If a limit is still undecided, the
        check makes the nominal run.

        If the bounds are closer to a limit than twice their estimated error, further runs search for a run beyond the
        limit. For a scene, the search also starts if the bounds are closer than half of their width. The search makes
        at most as many runs as the study, or 600 runs of a scene if this is more. The limit is satisfied if the closest
        run is farther inside than the error of the search, and undecided otherwise.

        For scenes, the check uses the lowest and highest values of runs over time, as from `mb.minimum` and
        `mb.maximum`. These values are used for the nominal run, for the corners if there are few, for the runs closest
        to the limit, and for the search. For other simulators, the check uses values at output times only.

        An enclosure proves that a limit is satisfied at the output times. Samples alone can only show that a limit is
        violated.

        Parameters
        ----------
        limits : mapping of output to (low, high); one of them may be None. Numbers are in the unit of the output.
            Examples of limits in other units: ("75 deg/s", None), (0.2, 0.3, "mm")
        runs : largest number of further runs of a search

        Raises
        ------
        DeclarationError
            If an output is unknown, or a lower limit is above the upper limit.
        """
        pairs = answers.limit_pairs("Bounds.check", limits, self.names, self.units)
        with shown_runs(None, "runs near limits"):
            checked, between = self._checked(pairs, runs)
        worst = self._closest_to(checked)
        told = " ".join(between)
        others = [
            answers.other_side(self, limit, self._side(limit))
            for limit in checked
            if f"cases {limit.output} may" not in told
        ]
        remarks = (*self._about_nominal(), *filter(None, others), *between)
        return answers.LimitCheck(self.t, self.method, tuple(checked), self, worst, remarks)

    def why(self, output: str, time: float | None = None) -> str:
        """Where the estimated error of an output comes from, and what would reduce it, in two sentences.

        Parameters
        ----------
        output : name of the output
        time : time [s], of which the nearest output time is used; default: the time of the largest error

        Raises
        ------
        DeclarationError
            If the output is unknown, or the time is not a finite number.

        Examples
        --------
        >>> import numpy as np, symmb as mb
        >>> t = np.array([1.0, 2.0])
        >>> waves = mb.FunctionSimulator(lambda w: np.sin(w * t), {"w": 1.0}, t, ["x"])
        >>> why = mb.propagate(waves, box=mb.Box(w=(0.8, 1.2))).why("x", 1.0)
        >>> why.partition(": ")[2].partition(". ")[0]
        'it is the accuracy of the search for the range of the polynomial'
        """
        k = self._column(output)
        if lack := self._without_value(k):
            return lack
        if self.estimate is None:
            return f"{self.method} does not estimate the error of its bounds. PolynomialChaos() does."
        i = int(np.argmax(self.estimate[:, k]))
        if time is not None:
            if not np.isfinite(near := require_numbers("Bounds.why", "time", time)):
                raise DeclarationError(f"Bounds.why: time must be finite, got {near}.")
            i = int(np.argmin(np.abs(self.t - near)))
        if self.parts:
            return max(self.parts, key=lambda part: part.estimate[i, k]).why(output, float(self.t[i]))
        error, width = self.estimate[i, k], self.upper[i, k] - self.lower[i, k]
        of_width = f", {100 * error / width:.2g} % of the width there" if 0 < width < np.inf else ""
        told = f"the estimated error of {output} is {error:.2g}{answers.unit_suffix(self, k)}{of_width}"
        has_time = not is_timeless(self.t) and output not in self.figures
        begin = f"At t = {self.t[i]:g} s, {told}" if has_time else "T" + told[1:]
        if self.trace is None:
            return f"{begin}. The reasons of this error are not recorded."
        rule = RULES[self.trace.rule(i, k)]
        remedy = rule.remedy
        if rule.is_reduced and any("was not reached" in remark for remark in self.remarks):
            remedy = ENDED if any(USED_UP in remark for remark in self.remarks) else STALLED
        return f"{begin}: {rule.cause[0].lower()}{rule.cause[1:]} {remedy}"

    def _checked(
        self, pairs: Mapping[str, tuple[float, float]], runs: int | None
    ) -> "tuple[list[answers.KeptLimit], list[str]]":
        """The results of limits, and remarks. With choices, the worst combination decides each limit."""
        if not self.parts:
            allowed = nullcontext() if self.study is None else self.study.allowing(self._leave("Bounds.check", runs))
            with allowed:
                limits = [answers.kept_limit(self, name, *ends) for name, ends in pairs.items()]
            return answers.with_peaks(self, limits)
        found = [part._checked(pairs, runs) for part in self.parts]
        remarks = [remark for _, own in found for remark in own]
        return answers.joined_limits(self, [limits for limits, _ in found]), [*dict.fromkeys(remarks)]

    def _about_nominal(self) -> tuple[str, ...]:
        """A remark if the box does not contain the nominal values."""
        values = {name: f"{self.nominal_parameters[name]:.6g}" for name in self._left_out}
        listed = ", ".join(with_units(values, self.nominal_parameters))
        text = f"The nominal values ({listed}) are outside of the box. The check does not include the nominal run."
        return (text,) if values else ()

    def _closest_to(self, limits: "Sequence[answers.KeptLimit]") -> WorstCase | None:
        """The run that comes closest to one of the limits; None if no runs are known.

        Limits are the same at all times. The run is thus a worst case over all times. Files contain these worst cases.
        """
        limit = answers.closest(limits)
        i, k, side = limit.row, self._column(limit.output), self._side(limit)
        if self.attaining is None:
            return next((case for case in self.worst_cases if (case.output, case.side) == (limit.output, side)), None)
        case, further = self._cases(self.attaining, [(side, i, k)])[0], limit.further
        if further is None:
            return case
        case = self._closer(case, further.side, further.place, float(further.values[i]))
        if np.isfinite(limit.between) and case.attained == further.values[i]:
            case = replace(
                case, time=limit.between, varied=tuple(case.parameters) if self.box is None else self.box.names
            )
        return replace(case, value=case.attained) if np.isfinite(further.error) else case

    @np.errstate(invalid="ignore")  # bounds and limits may be infinite
    def _side(self, limit: "answers.KeptLimit") -> str:
        """The side of a limit that is closest to the bounds or to a further run."""
        i, k = limit.row, self._column(limit.output)
        nearest = "lower" if self.lower[i, k] - limit.low < limit.high - self.upper[i, k] else "upper"
        return limit.further.side if limit.further else nearest

    @classmethod
    def _of_record(cls, record: Record) -> "Bounds":
        return cls(**attributes(cls, record), **result_file.parts_of(record))

    @classmethod
    def _of_table(cls, table: Record) -> "Bounds":
        return cls._of_record(result_file.record_of_table(table))

    def _record(self) -> dict[str, Any]:
        expansion = self.expansion
        return {
            **entries(self),
            **result_file.inner_entries(self.inner),
            "failed": [asdict(run) for run in self.failed],
            **result_file.doubts_entries(self.run_doubts, self.names),
            "doubts": self.doubts,
            "worst": [entries(case) for case in self._all_worst()],
            **result_file.box_entries(self.box),
            **{name: expansion and getattr(expansion, name) for name in ("parameters", "alpha", "coefficients")},
            **result_file.surrogate_entries(self.surrogate),
            **({} if self.trace is None else {"trace": self.trace.record()}),
        }

    def _table(self) -> "files.Table":
        parts = {"lower": self.lower, "upper": self.upper, "estimate": self.estimate}
        time, *heads = headings(self.names, self.units, self.nominal_parameters)
        columns = {
            f"{head} {part}": values[:, k]
            for k, head in enumerate(heads)
            for part, values in parts.items()
            if values is not None
        }
        same = {"kind": self.kind, "method": self.method, "evaluations": self.evaluations}
        return {time: self.t, **columns, **{name: [value] * len(self.t) for name, value in same.items()}}

    def _labelled(self) -> Labelled:
        return result_file.labelled(self._record(), self.outer, self.failed, self.box)

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        deviation: bool = False,
        **look: Any,
    ) -> "Figure":
        """Draw the bounds of outputs over time; write the picture to ``path`` if given.

        If `outputs` is not given, the first six outputs are drawn. The filled band is between lower and upper. Dashed
        lines are ``outer``. Dotted lines are ``inner``, unless the bounds are sampled. The thin line is the nominal
        run. Scalar outputs are bars.

        Parameters
        ----------
        ax : matplotlib Axes to draw in, one for each output, instead of a new figure
        figsize : (width, height)  of a new figure [inch]
        title : str                of a new figure, instead of the default title
        deviation : bool           draw deviations from the nominal run, because bands may be too narrow to see
        label, color, legend       of the bounds: a text, a colour, and True or False

        Raises
        ------
        DeclarationError           if an option is wrong, or deviations are requested and the nominal run is not known
        """
        require_truth("Bounds.plot", "deviation", deviation)
        if deviation and self.nominal is None:
            raise DeclarationError(
                "Bounds.plot: deviation needs the nominal run, which these bounds do not contain. Bounds by "
                "PolynomialChaos() contain it if the nominal parameters are in the middle of the box."
            )
        columns = plot.columns_of("Bounds.plot", outputs, self.names)
        figure = self._figure(columns, plot.Style("Bounds.plot", ax, **look), deviation)
        return plot.finish(figure, "Bounds.plot", path, ax, figsize, title)

    def report(self, path: str | Path, limits: "answers.Limits | None" = None, **block: object) -> None:
        """Write a report: one .html file that can be opened offline and printed.

        The report first states whether limits are satisfied. The report then states which tolerance to tighten, and by
        how much. Curves and the mechanism follow. An annex contains warnings, tables, worst cases, contributions by
        adaptive methods, the equations, the assumptions, the cost, and how to repeat the study.

        Parameters
        ----------
        path : path of the file
        limits : limits as in `check`; default: none
        company, author, date, drawing, revision :
            the title block; parts that are not given are left out

        Raises
        ------
        DeclarationError
            If the suffix is not .html, an output or a part of the title block is unknown, or limits cross.
        FileError
            If the file cannot be written. A previous file is kept.

        Examples
        --------
        >>> import numpy as np, pathlib, symmb as mb, tempfile
        >>> t = np.linspace(0.0, 1.0, 3)
        >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
        >>> bounds = mb.propagate(decay, mb.PolynomialChaos(), mb.Box(k=(0.5, 2.0)))
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "report.html"
        >>> bounds.report(path, {"x": (0.1, None)}, author="A. Miller", drawing="D-17")
        >>> "is at least 0.1 in all cases" in path.read_text()
        True
        """
        presentation("write_bounds")(self, path, limits, block)

    def live(self, path: str | Path | None = None, limits: "answers.Limits | None" = None) -> Any:
        """Write the live page of the scene with the box of these bounds, as ``mb.live``.

        Bounds without a scene, of other simulators or from a file, have a page of their polynomials instead. Its values
        stay in the box. DeclarationError is raised if there are no polynomials, or if they are in several parts.
        """
        scene = getattr(getattr(self.study, "simulator", None), "scene", None)
        if scene is None or self.box is None:
            return presentation("live_surrogate")(self, path, limits)
        return presentation("live")(scene.with_box(self.box), path, limits)

    def _about(self) -> list[str]:
        failed = f"{len(self.failed)} failed:" if self.failed else "none failed"
        times = span_text(self.t)
        return [
            f"Bounds by {self.method}, {times}",
            f"  kind         {self.kind} ({result_file.MEANING[self.kind]})",
            f"  evaluations  {self.evaluations}, {failed}",
            *([failure_text(self.failed, 3, indent="    ")] if self.failed else []),
            *([f"  range of     {self.range_of}"] if self.range_of else []),
        ]

    def _head(self) -> list[str]:
        lines = [*self._about(), *(f"  warning      {doubt}" for doubt in self.doubts)]
        return [*lines, *(f"  remark       {remark}" for remark in self.remarks)]

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        """Extremes of each output, nominal values at these times, largest width and error. Rounding errors are 0."""
        then = [] if self.nominal is None else ["nominal then"]
        rows = [["output", "lowest", "at [s]", *then, "highest", "at [s]", *then, "width", "at [s]", "estimated error"]]
        with np.errstate(over="ignore"):
            width = self.upper - self.lower
        width = np.where(np.isnan(width), np.inf, width)
        for k, name in enumerate(names):
            sizes = np.abs([self.lower[:, k], self.upper[:, k]])
            # Smaller numbers, relative to the largest bound of an output, count as rounding and are printed as 0.
            least = ROUNDING * sizes.max(initial=0.0, where=np.isfinite(sizes))
            places = int(self.lower[:, k].argmin()), int(self.upper[:, k].argmax())
            cells = [name]
            is_figure = self.names[k] in self.figures
            for values, i in zip((self.lower, self.upper), places, strict=True):
                cells += [_number_text(values[i, k], least), "" if is_figure else f"{self.t[i]:.6g}"]
                cells += [] if self.nominal is None else [_number_text(self.nominal[i, k], least)]
            widest = int(width[:, k].argmax())
            when = "" if is_figure else f"{self.t[widest]:.6g}"
            error = "–" if self.estimate is None else f"≤ {self.estimate[:, k].max():.2g}"
            rows.append([*cells, _number_text(width[widest, k], least), when, error])
        return over_times(rows, self.t)

    def __str__(self) -> str:
        names = told_names(self.names, self.units, self.nominal_parameters)
        return "\n".join([*self._head(), *(f"  {line}" for line in aligned(self._rows(names)))])

    def _tabulated(self, head: Sequence[str]) -> str:
        """A head and the extremes as HTML."""
        return html.page(html.text("\n".join(head)), html.table(self._rows(plot.labels(self.names, self.units))))

    def _repr_html_(self) -> str:
        return html.page(self._tabulated(self._head()), html.picture(plot.png(self.plot())))


def _number_text(value: float, least: float) -> str:
    return "0" if abs(value) <= least else f"{value:.6g}"
