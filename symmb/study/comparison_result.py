"""The result of a comparison, which can be printed, plotted and saved."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import WithWarnings
from symmb._labelled import BOUND, Labelled, Named, Result, known, over_outputs, texts, unit_text
from symmb._presentation import presentation
from symmb._table import span_text
from symmb._types import Array, Figure
from symmb.bound.answers import box_coordinates, box_entries, box_of
from symmb.equations.model import Box
from symmb.results import plot
from symmb.results.files import NOT_KEPT, Record, Saved, attributes, entries, entry
from symmb.study import report
from symmb.study.reference import Reference
from symmb.study.row import LONG_RUN, NotRun, Row


@dataclass(frozen=True, repr=False)
class Comparison(plot.OverTime, Result, WithWarnings, Saved):
    """Bounds of one scene by several methods, compared with one reference.

    `print` shows a table. `save` writes a file, and `load` reads it. `plot` draws bounds over time, and error against
    run time, for the given outputs or for the six outputs with the largest errors. Bounds are drawn for the most
    accurate setting of each family of methods. The reference is a filled band. If a single Axes is given, this Axes
    shows the errors.

    Attributes
    ----------
    scene, solver : str
        name of the scene, and text of the solver
    times : (n_t,)
        output times [s]
    outputs : tuple of n_y names
    box : Box
    reference : Reference
    rows : tuple[Row, ...]
        the methods that ran, in the given order
    not_run : tuple[NotRun, ...]
        the methods that could not run
    setup_seconds : float or None
        time for deriving and compiling [s]
    solver_error : (n_y,) or None
        rms difference from a solver with ten times smaller tolerances, in the norm of `Score.error`. The difference is
        measured at the centre and two opposite corners of the box
    threads, repeats : int or None
        number of threads for runs, and number of repetitions for the run time
    units : tuple of n_y str
        units of the outputs, '' if not known
    reason : str
        reason why symmb chose this solver, if symmb chose it
    doubts : tuple of str
        warnings about the runs, in sentences

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> comparison = mb.compare(scene, [mb.Taylor(2), mb.Vertex()])
    >>> [row.evaluations for row in comparison.rows]
    [3, 2]
    """

    scene: str
    times: Array = field(metadata=entry(Record.times, name="t"))
    outputs: tuple[str, ...] = field(metadata=entry(Record.names, name="names"))
    box: Box = field(metadata=entry(box_of))
    solver: str
    reference: Reference = field(metadata=NOT_KEPT)
    rows: tuple[Row, ...] = field(metadata=NOT_KEPT)
    not_run: tuple[NotRun, ...] = field(default=(), metadata=NOT_KEPT)
    setup_seconds: float | None = None
    solver_error: Array | None = field(default=None, metadata=entry(Record.size, "names"))
    threads: int | None = None
    repeats: int | None = None
    units: tuple[str, ...] = ()
    reason: str = ""
    doubts: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The outputs. Other results use this name."""
        return self.outputs

    def __str__(self) -> str:
        table = report.table(self.rows, self.reference.yardstick, self.outputs)
        return "\n".join([*self._head(), "", table, "", *self._notes()])

    def _repr_html_(self) -> str:
        rows = report.cells(self.rows, self.reference.yardstick, self.outputs)
        table = html.table(rows, report.left_columns(rows[0]))
        head, notes = html.text("\n".join(self._head())), html.text("\n".join(self._notes()))
        return html.page(head, table, notes, html.picture(plot.png(self.plot())))

    def _notes(self) -> list[str]:
        yardstick = self.reference.yardstick
        return [
            *report.not_run(self.not_run),
            *report.failed(self.rows),
            *(report.wrapped(f"warning: {doubt}") for doubt in self.doubts),
            *report.cautions(self.rows),
            *report.zero_width(self.rows, yardstick, self.outputs),
            "error: rms deviation of bounds / rms width. outer: error of bounds widened by the method's estimate.",
            "over, under: mean distance outside and inside of the reference / mean width. All are means over outputs.",
            f"covered: fraction of times at which outer contains the reference. run [s]: {self._timing()}.",
            "Sampled bounds are attained, not proved.",
        ]

    def _labelled(self) -> Labelled:
        """Bounds of all methods, their cost and their scores. If a method estimates no error, its estimate is nan."""
        record, rows, reference = self._record(), self.rows, self.reference
        names, units = record["names"], record["units"]
        shape = len(record["t"]), len(names)
        coordinates, unit_of = over_outputs(record["t"], names, units, "value", "reference", "estimate", "inner")
        coordinates |= {
            "bound": (("bound",), texts(BOUND)),
            **box_coordinates(self.box),
            "method": (("method",), texts([row.name for row in rows])),
            "kind": (("method",), texts([row.kind for row in rows])),
        }
        series, pair = ("time", "output"), ("bound", "time", "output")
        costs = (("evaluations", int), ("failed", int), ("run_seconds", float))
        scores = {
            name: np.reshape([getattr(row.score, name) for row in rows], (len(rows), shape[1])).astype(float)
            for name in ("error", "over", "under", "coverage")
        }
        variables: dict[str, Named] = {
            "value": (("method", *pair), np.reshape([[row.lower, row.upper] for row in rows], (len(rows), 2, *shape))),
            "reference": (pair, np.stack([reference.lower, reference.upper])),
            "uncertainty": (("output",), reference.uncertainty),
            **{name: (("method",), np.array([getattr(row, name) for row in rows], dtype=kind)) for name, kind in costs},
            "estimate": (("method", *series), _filled([row.estimate for row in rows], shape)),
            "inner": (("method", *pair), _filled([row.inner and np.stack(row.inner) for row in rows], (2, *shape))),
            **{name: (("method", "output"), own) for name, own in scores.items()},
            "solver_error": (("output",), record["solver_error"]),
        }
        attributes = {
            "scene": record["scene"],
            **{name: record[name] or None for name in ("solver", "reason")},
            "reference_method": reference.method,
            "units": unit_text(names, units),
            "doubts": "\n".join(record["doubts"]) or None,
        }
        return Labelled(coordinates, known(variables), attributes, unit_of | {"run_seconds": "s"})

    def _record(self) -> dict[str, Any]:
        return entries(self) | {
            **box_entries(self.box),
            "reference": entries(self.reference),
            "methods": [row.record() for row in self.rows],
            "not_run": [entries(method) for method in self.not_run],
        }

    @classmethod
    def _of_record(cls, record: Record) -> "Comparison":
        own = attributes(cls, record)
        reference = Reference(**attributes(Reference, record.record("reference")))
        rows = tuple(Row.of_record(row, reference.yardstick) for row in record.records("methods"))
        if own["setup_seconds"] is None and rows:  # in files of earlier versions
            own["setup_seconds"] = rows[0].setup_seconds
        not_run = tuple(NotRun(**attributes(NotRun, method)) for method in record.records("not_run"))
        return cls(**own, reference=reference, rows=rows, not_run=not_run)

    def _figure(self, columns: list[int] | None, style: plot.Style) -> Figure:
        reference = self.reference
        curves = [
            plot.PlottedBounds(
                family=plot.family(row.name),
                label=row.name,
                kind=row.kind,
                lower=row.lower,
                upper=row.upper,
                error=row.score.error,
                evaluations=row.evaluations,
                seconds=row.run_seconds,
            )
            for row in self.rows
        ]
        return plot.plot_comparison(
            self.times,
            self.outputs,
            plot.Band(f"reference: {reference.method}", reference.lower, reference.upper),
            curves,
            measured=~reference.yardstick.zero_width,
            uncertainty=reference.uncertainty,
            units=self.units,
            chosen=columns,
            title=self.scene,
            style=style,
        )

    def report(self, path: str | Path) -> None:
        """Write a report: one .html file that can be opened offline and printed.

        The report contains the warnings, table, picture, assumptions and cost, and how to repeat the comparison.

        Raises
        ------
        DeclarationError       if the suffix is not .html
        FileError              if the file cannot be written; the previous file stays
        """
        presentation("write_comparison")(self, path)

    def _head(self) -> list[str]:
        yardstick = self.reference.yardstick
        names = ", ".join(
            " ".join([f"{name} [{lower:.6g}, {upper:.6g}]", *unit])
            for name, (lower, upper, *unit) in self.box.intervals.items()
        )
        names = repr(self.box) if self.box.is_cut else names
        lines = [f"{self.scene}: {', '.join(self.outputs)}; {span_text(self.times)}", f"box: {names}"]
        setup = "" if self.setup_seconds is None else f"; set up in {report.seconds(self.setup_seconds)} s"
        if self.solver:
            lines.append(f"solver: {self.solver}{f' ({self.reason})' if self.reason else ''}{setup}")
        if self.solver_error is not None:
            own = report.mean_and_worst(self.solver_error, yardstick, self.outputs)
            lines.append(f"solver's own error: {own}")
        uncertainty = report.mean_and_worst(self.reference.uncertainty, yardstick, self.outputs)
        lines.append(f"reference: {self._reference()}; uncertainty {uncertainty}")
        if self.reference.proved is not None:
            missed = report.mean_and_worst(self.reference.proved, yardstick, self.outputs)
            by = " and ".join(self.reference.proved_by)
            lines.append(f"proved by {by}: the reference misses the true bounds by at most {missed}")
        return [report.wrapped(line) for line in lines]

    def _reference(self) -> str:
        reference = self.reference
        text = reference.method
        if reference.evaluations is not None:
            text += f", {reference.evaluations} runs"
        if reference.failed:
            text += f", {reference.failed} failed"
        if reference.seconds is not None:
            text += f", {report.seconds(reference.seconds)} s"
        return text

    def _timing(self) -> str:
        if self.repeats is None or self.threads is None:
            return "median time of evaluations and bounding, without the first run"
        if self.repeats == 1:
            return "time of bounding, and of evaluations that earlier methods have not stored"
        threads = "1 thread" if self.threads == 1 else f"{self.threads} threads"
        once = f" (1 if longer than {LONG_RUN:g} s)" if any(row.run_seconds > LONG_RUN for row in self.rows) else ""
        return f"evaluations and bounding, median of at least {self.repeats} measurements{once}, {threads}"


def _filled(arrays: Sequence[Array | None], shape: tuple[int, ...]) -> Array | None:
    """The arrays stacked in one array, with nan for missing arrays; None if all are missing."""
    if all(array is None for array in arrays):
        return None
    return np.stack([np.full(shape, np.nan) if array is None else array for array in arrays])
