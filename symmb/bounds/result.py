"""The result of every bounding method."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb import _html as html
from symmb import files, plot
from symmb._errors import DeclarationError, PropagationError
from symmb._labelled import Labelled, Result
from symmb._names import did_you_mean
from symmb._options import require_positive, require_truth
from symmb._table import aligned
from symmb._types import Array
from symmb.bounds.answers import Answers
from symmb.bounds.failures import Failure, failure_text
from symmb.bounds.limits import KeptLimit, LimitCheck, OutputBounds, kept_limit, limit_pairs
from symmb.bounds.responses import Runs
from symmb.bounds.result_file import (
    MEANING,
    Kind,
    attributes_of,
    extremes_of_bounds,
    labelled,
    record_of_table,
    surrogate_entries,
)
from symmb.bounds.time_windows import DOUBTFUL, is_doubtful, is_doubtful_in_window
from symmb.bounds.worst_case import SIDES, AttainingRuns, Place, Worst, WorstCase, row_of, worst_cases
from symmb.model import Box
from symmb.polynomials import Expansion, Moments, moments
from symmb.polynomials.ranges import Piecewise

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


ROUNDING = 1e-9
"""Share of an output's largest value below which errors are rounding."""
_WITHOUT_RUNS = "Taylor(", "TaylorModel(", "IntervalArithmetic("
"""Methods that make no runs in the box, by the begin of their texts."""
_NAMED_WINDOWS = 3
"""Doubtful windows of an output that a sentence names."""


@dataclass(frozen=True, eq=False, repr=False)
class Bounds(Answers, Result, files.Saved):
    """Lower and upper bounds of every output at every time.

    `print` shows their kind, extremes and widths, `plot` draws them, `save` and `load` keep them in a file.

    Attributes
    ----------
    t : (n_t,) times [s]
    names : n_y outputs
    lower, upper : (n_t, n_y) best estimate of the bounds
    kind : "enclosure" (proved to contain the responses), "estimate" (of a surrogate: may miss either way) or
        "sampled" (attained by runs: the responses reach at least these values)
    method : text of the method's constructor
    evaluations : runs; a run with derivatives counts as many as they cost
    estimate : (n_t, n_y) estimated error of lower and upper, at least 0, or None where the method has none
    noise : (n_y,) how far runs may be off by noise or rounding, or None where it is not known
    inner : (lower, upper), each (n_t, n_y), attained by actual runs, or None
    failed : the runs that failed
    failed_region : where these lie in the box, in words; empty for less than two, and where it is not known
    seconds : wall time of runs and bounding [s]
    expansion : polynomial chaos of a given order, or None
    caution : from when on the method is not valid, and why; empty if it is valid
    run_doubts : what cannot be trusted about the runs, in sentences; `doubts` are all
    remarks : what else is known about the bounds, in sentences: a tolerance that was not reached
    units : n_y units of the outputs, '' where they are not known; empty if none is known
    box : intervals of the parameters, or None where they are not known
    surrogate : polynomials in the place of the responses, with their error; None if the method has none, or a file
        was read that does not hold them
    study : simulator and box, for more runs; None if they were read or pickled
    nominal : (n_t, n_y) outputs of the nominal run, or None where it is not known
    nominal_parameters : nominal values of all parameters; empty if they are not known
    attaining : the runs that attain the bounds; None if they were read or pickled, or no runs are made
    worst_cases : those over all times, of bounds that were read from a file
    range_of : whose range an adaptive method took, in words: interpolants, runs at corners; empty of other methods

    Examples
    --------
    >>> t = np.array([0.0, 1.0])
    >>> Bounds(t, ("x",), np.array([[0.0], [1.0]]), np.array([[0.0], [3.0]]), "sampled", "Vertex()", 4)["x"]
    (array([0., 1.]), array([0., 3.]))
    """

    t: Array
    names: tuple[str, ...]
    lower: Array
    upper: Array
    kind: Kind
    method: str
    evaluations: int
    estimate: Array | None = None
    noise: Array | None = None
    inner: tuple[Array, Array] | None = None
    failed: tuple[Failure, ...] = ()
    failed_region: str = ""
    seconds: float = field(default=float("nan"))
    expansion: Expansion | None = None
    caution: str = ""
    run_doubts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    box: Box | None = None
    surrogate: Piecewise | None = None
    study: Runs | None = None
    range_of: str = ""
    nominal: Array | None = None
    nominal_parameters: Mapping[str, float] = field(default_factory=dict)
    attaining: AttainingRuns | None = None
    worst_cases: tuple[WorstCase, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "study": None, "attaining": None}

    @property
    def doubts(self) -> tuple[str, ...]:
        """What cannot be trusted, in sentences; empty if nothing is known to be wrong."""
        doubts = list(self.run_doubts)
        if self.failed:
            where = f" Runs fail {self.failed_region}." if self.failed_region else ""
            doubts.append(
                f"{len(self.failed)} of {self.evaluations} runs failed: the bounds are those of the others, and what "
                f"happens near the failed ones is not known.{where}"
            )
        if since := self.doubtful():
            windows = self.doubtful_windows()
            parts = [
                name + self._doubtful_part(t, [w[1:] for w in windows if w[0] == name]) for name, t in since.items()
            ]
            doubts.append(f"The estimated error is above 10 % of the width: {', '.join(parts)}.")
        if self.caution:
            doubts.append(f"The bounds are {self.caution}.")
        return tuple(doubts)

    @property
    def outer(self) -> tuple[Array, Array]:
        """(lower, upper) widened by the estimated error, where there is one."""
        if self.estimate is None:
            return self.lower, self.upper
        with np.errstate(over="ignore"):
            return self.lower - self.estimate, self.upper + self.estimate

    def doubtful(self, share: float = DOUBTFUL) -> dict[str, float]:
        """Doubtful outputs, and from when on [s]: their estimated error exceeds a share of the width.

        Both are root mean squares from a time to the end, the width at least a tenth of that over all times. Errors
        within the noise of the runs, and rounding, do not count. The result is empty without an estimate.
        """
        require_positive("doubtful", "share", share)
        if self.estimate is None:
            return {}
        bad = is_doubtful(*self._scaled(self.estimate), share)
        return {
            name: float(self.t[int(np.argmax(rest))])
            for name, rest in zip(self.names, bad.T, strict=True)
            if rest.any()
        }

    def doubtful_windows(self, share: float = DOUBTFUL) -> tuple[tuple[str, float, float], ...]:
        """Doubtful outputs with windows of time, as (name, from, to) [s]: there the estimated error exceeds a share of
        the width.

        Both are root mean squares over 2 % of the times, the width at least a tenth of that over all times.
        """
        require_positive("doubtful_windows", "share", share)
        if self.estimate is None:
            return ()
        bad = is_doubtful_in_window(*self._scaled(self.estimate), share)
        edges = np.diff(np.pad(bad, ((1, 1), (0, 0))).astype(int), axis=0)
        return tuple(
            (name, float(self.t[first]), float(self.t[behind - 1]))
            for name, edge in zip(self.names, edges.T, strict=True)
            for first, behind in zip(np.flatnonzero(edge > 0), np.flatnonzero(edge < 0), strict=True)
        )

    def _doubtful_part(self, since: float, windows: list[tuple[float, float]]) -> str:
        """When an output is doubtful, in words: windows of time, or from a time on if they reach the end."""
        if len(self.t) == 1:
            return ""
        if not windows or windows[-1][1] == self.t[-1]:
            return f" from {since:g} s"
        texts = [f"from {begin:g} to {end:g} s" for begin, end in windows[:_NAMED_WINDOWS]]
        return " " + " and ".join([*texts, *(["later"] if len(windows) > _NAMED_WINDOWS else [])])

    def _scaled(self, estimate: Array) -> tuple[Array, Array, Array]:
        """Estimated error, width, each (n_t, n_y), and errors that are noise or rounding (n_y,), by powers of two.

        Their squares neither overflow nor underflow.
        """
        scale = np.abs([self.lower, self.upper]).max(axis=(0, 1), initial=0.0)
        power = np.frexp(scale)[1]
        lower, upper = np.ldexp([self.lower, self.upper], -power)
        floor = ROUNDING * scale if self.noise is None else self.noise
        return np.ldexp(estimate, -power), upper - lower, np.ldexp(floor, -power)

    def __getitem__(self, name: str) -> tuple[Array, Array]:
        """(lower, upper) of one output, each (n_t,)."""
        if not isinstance(name, str) or name not in self.names:
            raise DeclarationError(f"Bounds: no output '{name}'.{did_you_mean(name, self.names)}")
        column = self.names.index(name)
        return self.lower[:, column], self.upper[:, column]

    def worst(self, output: str, time: float | None = None) -> Worst:
        """Where an output is least and largest: values, times, and the parameters of the runs that attain them.

        Parameters
        ----------
        output : name of an output
        time : the output time [s] that is closest to this one; default: the extremes over all times

        Raises
        ------
        DeclarationError
            If there is no such output or time, no runs were made, or a file holds the extremes over all times alone.
        SimulationError
            If the run does not come again.
        """
        k = self.names.index(output) if self[output] else 0
        if self.attaining is None:
            known = {case.side: case for case in self.worst_cases if case.output == output}
            if time is None and len(known) == len(SIDES):
                return Worst(**known)
            raise DeclarationError(f"Bounds.worst: {self._why_no_worst(bool(known))}")
        rows = self._extreme_rows(k) if time is None else [row_of("Bounds.worst", self.t, time)] * 2
        places = [(side, row, k) for side, row in zip(SIDES, rows, strict=True)]
        return Worst(*self._cases(self.attaining, places))

    def _cases(self, runs: AttainingRuns, places: Sequence[Place]) -> list[WorstCase]:
        """The worst cases at places. Where runs of the study fall short of the bounds, one is made at the extreme."""
        varied = self._acting(self.box) if self.box else tuple(runs.simulator.parameters)
        cases = worst_cases(runs, places, varied, self.names, self.t, self.lower, self.upper)
        return [
            self._at_extreme(case, place) if case.is_short else case for case, place in zip(cases, places, strict=True)
        ]

    def _at_extreme(self, case: WorstCase, place: Place) -> WorstCase:
        """The run where the polynomials have their extreme, if it comes closer to the bound."""
        if self.surrogate is None or self.study is None or self.box is None:
            return case
        side, i, k = place
        one = np.ones(len(self.box))
        point = self.surrogate.part([i], [k]).range(-one, one)[2][SIDES.index(side), 0]
        try:
            attained = float(self.study.values(point)[0, i, k])
        except PropagationError:
            return case
        values = self.box.from_unit(point[0]).tolist()
        parameters = {**self.nominal_parameters, **dict(zip(self.box.names, values, strict=True))}
        found = replace(case, parameters=parameters, attained=attained)
        return found if found.shortfall < case.shortfall else case

    def _why_no_worst(self, knows_some: bool) -> str:
        if knows_some:
            return "a file holds the worst cases over all times alone."
        if self.study is not None or self.method.startswith(_WITHOUT_RUNS):
            return f"{self.method} makes no runs that attain its bounds. Use PolynomialChaos() or Vertex()."
        what = "pickled bounds keep" if self.box else "a .csv file keeps"
        return f"{what} no worst cases. Save bounds as .npz or .json."

    def _extreme_rows(self, k: int) -> list[int]:
        """Numbers of the times at which output number k is least and largest."""
        return [int(self.lower[:, k].argmin()), int(self.upper[:, k].argmax())]

    def check(self, limits: Mapping[str, tuple[float | None, float | None]]) -> LimitCheck:
        """Whether outputs keep limits for all parameters of the box, at all times.

        A limit is kept if the bounds, widened by their estimated error, are inside and nothing is doubted. It is
        violated if a run is beyond it by more than rounding and noise, or the bounds are so by more than their error.
        Otherwise it is undecided. For enclosures it is proved to be kept; samples alone can only violate it.

        Parameters
        ----------
        limits : mapping of output to (low, high), of which one may be None

        Raises
        ------
        DeclarationError
            If an output is unknown, or limits cross.
        """
        found, doubtful = [], self.doubtful()
        is_doubted = bool(self.run_doubts or self.failed or self.caution)
        for name, ends in limit_pairs("Bounds.check", limits, self.names).items():
            lower, upper = self[name]
            k = self.names.index(name)
            estimate = None if self.estimate is None else self.estimate[:, k]
            inner = None if self.inner is None else (self.inner[0][:, k], self.inner[1][:, k])
            rounding = float(ROUNDING * np.abs([lower, upper]).max(initial=0.0))
            if self.noise is not None:
                rounding = max(rounding, float(self.noise[k]))
            doubted = is_doubted or name in doubtful
            own = OutputBounds(self.kind, lower, upper, estimate, inner, self.evaluations, doubted, rounding)
            found.append(kept_limit(name, self.units[k] if self.units else "", *ends, own))
        return LimitCheck(self.t, self.method, tuple(found), partial(self.plot, None), self._closest_to(found))

    def _closest_to(self, limits: Sequence[KeptLimit]) -> WorstCase | None:
        """The run that comes closest to one of some limits, if runs are known.

        Limits are the same at all times, so that it is the worst case over all times, which files hold.
        """
        limit = min(limits, key=lambda limit: float(limit.margin.min()))
        i, (lower, upper) = int(limit.margin.argmin()), self[limit.output]
        side = "lower" if lower[i] - limit.low < limit.high - upper[i] else "upper"
        if self.attaining is None:
            return next((case for case in self.worst_cases if (case.output, case.side) == (limit.output, side)), None)
        place = side, i, self.names.index(limit.output)
        return self._cases(self.attaining, [place])[0]

    def moments(self) -> Moments:
        """Mean, variance and Sobol indices, for parameters that are uniform and independent in the box.

        Raises
        ------
        PropagationError
            If the method has no expansion.
        """
        if self.expansion is None:
            raise PropagationError(
                f"Bounds by {self.method} hold no expansion to take moments of. Use PolynomialChaos(order=4); "
                "at kinks or jumps, where PolynomialChaos() cuts the box into pieces, samples of your own."
            )
        return moments(self.expansion, self.t, self.names)

    @classmethod
    def _of_record(cls, record: files.Record) -> "Bounds":
        return cls(**attributes_of(record))

    @classmethod
    def _of_table(cls, table: files.Record) -> "Bounds":
        return cls(**attributes_of(record_of_table(table)))

    def _record(self) -> dict[str, Any]:
        inner_lower, inner_upper = self.inner or (None, None)
        return {
            "t": self.t,
            "names": self.names,
            "lower": self.lower,
            "upper": self.upper,
            "kind": self.kind,
            "method": self.method,
            "evaluations": self.evaluations,
            "estimate": self.estimate,
            "noise": self.noise,
            "inner_lower": inner_lower,
            "inner_upper": inner_upper,
            "failed": [asdict(run) for run in self.failed],
            "failed_region": self.failed_region,
            "seconds": self.seconds,
            "caution": self.caution,
            "run_doubts": self.run_doubts,
            "remarks": self.remarks,
            "range_of": self.range_of,
            "nominal": self.nominal,
            "nominal_parameters": dict(self.nominal_parameters),
            "worst": [case.record() for case in self._all_worst()],
            "units": self.units,
            "box": self.box and dict(zip(self.box.names, map(list, self.box.bounds), strict=True)),
            "doubts": self.doubts,
            "parameters": self.expansion and self.expansion.parameters,
            "alpha": self.expansion and self.expansion.alpha,
            "coefficients": self.expansion and self.expansion.coefficients,
            **surrogate_entries(self.surrogate),
        }

    def _all_worst(self) -> Sequence[WorstCase]:
        """Those over all times, for files."""
        if self.attaining is None:
            return self.worst_cases
        rows = enumerate(map(self._extreme_rows, range(len(self.names))))
        places = [(side, row, k) for k, both in rows for side, row in zip(SIDES, both, strict=True)]
        return self._cases(self.attaining, places)

    def _table(self) -> files.Table:
        parts = {"lower": self.lower, "upper": self.upper, "estimate": self.estimate}
        columns = {
            f"{name} {part}": values[:, k]
            for k, name in enumerate(self.names)
            for part, values in parts.items()
            if values is not None
        }
        same = {"kind": self.kind, "method": self.method, "evaluations": self.evaluations}
        return {"t": self.t, **columns, **{name: [value] * len(self.t) for name, value in same.items()}}

    def _labelled(self) -> Labelled:
        return labelled(self._record(), self.outer, self.failed, self.box)

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        deviation: bool = False,
    ) -> "Figure":
        """Draw the bounds of outputs over time; write the picture to ``path`` if given.

        Without names these are the first six outputs. The filled band lies between lower and upper; dashed lines are
        ``outer``, dotted ones ``inner`` of bounds that are not sampled. The thin line is the nominal run.

        Parameters
        ----------
        ax : matplotlib Axes to draw in, in the place of a new figure, one an output
        figsize : (width, height)  of a new figure [inch]
        title : str                of a new figure, in place of its own
        deviation : bool           draw deviations from the nominal run: bands may be too narrow to be seen beside it

        Raises
        ------
        DeclarationError           if an option is wrong, or deviations are asked for and the nominal run is not known
        """
        require_truth("Bounds.plot", "deviation", deviation)
        if deviation and self.nominal is None:
            raise DeclarationError(
                "Bounds.plot: deviation needs the nominal run, which these bounds do not hold. Those by "
                "PolynomialChaos() hold it where the nominal parameters are in the middle of the box."
            )
        figure = plot.plot_bounds(
            self.t,
            self.names,
            plot.Band(f"{self.method}, {self.kind}", self.lower, self.upper),
            units=self.units,
            family=plot.family(self.method),
            chosen=plot.columns_of("Bounds.plot", outputs, self.names),
            outer=None if self.estimate is None else self.outer,
            inner=None if self.kind == "sampled" else self.inner,
            nominal=self.nominal,
            deviation=deviation,
            ax=ax,
        )
        return plot.finish(figure, "Bounds.plot", path, ax, figsize, title)

    def report(self, path: str | Path, limits: Mapping[str, tuple[float | None, float | None]] | None = None) -> None:
        """Write a report: one .html file that opens offline, and prints.

        It tells doubts, whether limits are kept, the bounds, worst cases and curves, what they assume and cost, and
        how to repeat them; of a scene also the mechanism and its equations; by adaptive methods also contributions.

        Parameters
        ----------
        path : of the file
        limits : those of `check`; default: none

        Raises
        ------
        DeclarationError
            If the name has another suffix, an output is unknown, or limits cross.
        FileError
            If the file cannot be written; the previous one is kept.

        Examples
        --------
        >>> import symmb as mb, tempfile, pathlib
        >>> t = np.linspace(0.0, 1.0, 3)
        >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
        >>> bounds = mb.propagate(decay, mb.PolynomialChaos(), mb.Box(k=(0.5, 2.0)))
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "report.html"
        >>> bounds.report(path, {"x": (0.1, None)})
        >>> "Limits by PolynomialChaos(): kept" in path.read_text()
        True
        """
        # Reports stand on drawings, which stand on bounds. Only who asks for one loads them.
        import_module("symmb.report").write_bounds(self, path, limits)

    def _about(self) -> list[str]:
        failed = f"{len(self.failed)} failed:" if self.failed else "none failed"
        times = f"{len(self.t)} times from {self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) > 1 else "one time"
        return [
            f"Bounds by {self.method}, {times}",
            f"  kind         {self.kind} ({MEANING[self.kind]})",
            f"  evaluations  {self.evaluations}, {failed}",
            *([failure_text(self.failed, 3, indent="    ")] if self.failed else []),
            *([f"  range of     {self.range_of}"] if self.range_of else []),
        ]

    def _head(self) -> list[str]:
        lines = [*self._about(), *(f"  doubtful     {doubt}" for doubt in self.doubts)]
        return [*lines, *(f"  remark       {remark}" for remark in self.remarks)]

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        return extremes_of_bounds(self.t, names, self.lower, self.upper, self.nominal, self.estimate)

    def __str__(self) -> str:
        return "\n".join([*self._head(), *(f"  {line}" for line in aligned(self._rows(self.names)))])

    def _tabulated(self, head: Sequence[str]) -> str:
        """A head and the extremes as HTML."""
        return html.page(html.text("\n".join(head)), html.table(self._rows(plot.labels(self.names, self.units))))

    def _repr_html_(self) -> str:
        return html.page(self._tabulated(self._head()), html.picture(plot.png(self.plot())))
