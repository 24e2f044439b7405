"""A comparison as text: a line for each method, and the reference."""

import textwrap
from collections.abc import Iterable, Sequence

import numpy as np

from symmb._table import aligned
from symmb._types import Array
from symmb.study.metrics import Yardstick
from symmb.study.row import NotRun, Row

_LEFT = {"method", "kind", "worst output"}


def table(rows: Sequence[Row], yardstick: Yardstick, outputs: Sequence[str]) -> str:
    """The rows as an aligned table.

    An error is the mean over the outputs that vary over the box. The last column shows the output with the largest
    error.
    """
    lines = cells(rows, yardstick, outputs)
    text = aligned(lines, left=left_columns(lines[0]))
    return "\n".join([text[0], "-" * max(map(len, text)), *text[1:]])


def cells(rows: Sequence[Row], yardstick: Yardstick, outputs: Sequence[str]) -> list[list[str]]:
    """The head of the table, and the cells of each row."""
    header = ["method", "kind", "runs", "failed", "run [s]", "error", "outer", "over", "under", "covered"]
    return [[*header, "worst output"], *([*_cells(row, yardstick), _worst(row, yardstick, outputs)] for row in rows)]


def left_columns(head: Sequence[str]) -> list[int]:
    """Columns that are aligned on the left."""
    return [i for i, name in enumerate(head) if name in _LEFT]


def not_run(methods: Iterable[NotRun]) -> list[str]:
    """One line for each method that could not run."""
    return [wrapped(f"{method.name} did not run: {method.reason}") for method in methods]


def failed(rows: Iterable[Row]) -> list[str]:
    """Failed runs: their effect on the bounds, their region, and the first message; empty if no run failed."""
    failing = [row for row in rows if row.failed]
    if not failing:
        return []
    lines = [
        "failed: number of failed runs. The bounds use the other runs. print(propagate(...)) lists the failed runs."
    ]
    lines += [f"Runs of {row.name} fail {row.failed_region}." for row in failing if row.failed_region]
    lines += [f"The first failed run of {row.name}: {row.failure}" for row in failing[:1] if row.failure]
    return [wrapped(line) for line in lines]


def cautions(rows: Iterable[Row]) -> list[str]:
    """A line for each method that is not valid at all times."""
    return [wrapped(f"{row.name} is {row.caution}.") for row in rows if row.caution]


def zero_width(rows: Sequence[Row], yardstick: Yardstick, outputs: Sequence[str]) -> list[str]:
    """A line for each output that does not vary over the box: the methods with other bounds, and their errors."""
    lines = []
    for i in np.flatnonzero(yardstick.zero_width).tolist():
        misses = [f"{row.name} {number(row.score.error[i])}" for row in rows if row.score.error[i] != 0.0]
        finding = f"absolute error of {', '.join(misses)}" if misses else "all bounds equal the reference"
        lines.append(wrapped(f"{outputs[i]} does not vary over the box and is left out of the mean errors: {finding}."))
    return lines


def mean_and_worst(values: Array, yardstick: Yardstick, outputs: Sequence[str]) -> str:
    """Mean and largest of values (n_y,), with the name of the output with the largest value."""
    share = np.where(yardstick.zero_width, np.nan, values)
    if np.isnan(share).all():
        return "not known"
    worst = int(np.nanargmax(share))
    return f"{number(_mean(values, yardstick))} of the width, at most {number(share[worst])} ({outputs[worst]})"


def number(value: float) -> str:
    """A number with two digits and constant width.

    Examples
    --------
    >>> number(0.2267), number(0.0), number(float("nan"))
    ('2.3e-01', '0', '–')
    """
    if np.isnan(value):
        return "–"
    return "0" if value == 0.0 else f"{value:.1e}"


def seconds(value: float) -> str:
    """A duration with three digits; – if it is not known.

    Examples
    --------
    >>> seconds(0.01234), seconds(123.4)
    ('0.0123', '123')
    """
    return number(value) if np.isnan(value) else f"{value:.3g}" if value >= 1e-3 else f"{value:.1e}"


def _cells(row: Row, yardstick: Yardstick) -> list[str]:
    score, covered = row.score, _mean(row.score.coverage, yardstick)
    return [
        row.name,
        row.kind,
        str(row.evaluations),
        str(row.failed) if row.failed else "–",
        seconds(row.run_seconds),
        _at_most(_mean(score.error, yardstick), _mean(yardstick.uncertainty, yardstick)),
        "–" if row.estimate is None else number(_mean(score.outer_error, yardstick)),
        number(_mean(score.over, yardstick)),
        number(_mean(score.under, yardstick)),
        "–" if np.isnan(covered) else f"{100.0 * covered:.1f} %",
    ]


def _worst(row: Row, yardstick: Yardstick, outputs: Sequence[str]) -> str:
    error = np.where(np.isnan(row.score.error), np.inf, row.score.error)
    told = np.fmax(error, yardstick.uncertainty)  # not smaller than the printed mean
    worst = int(np.argmax(np.where(yardstick.zero_width, -1.0, told)))
    if yardstick.zero_width[worst]:
        return "–"
    return f"{_at_most(row.score.error[worst], yardstick.uncertainty[worst])} {outputs[worst]}"


def _at_most(error: float, uncertainty: float) -> str:
    """The text of an error. Errors below the uncertainty of the reference are shown as at most this uncertainty."""
    return f"≤ {number(uncertainty)}" if error < uncertainty else number(error)


def _mean(values: Array, yardstick: Yardstick) -> float:
    counted = values[~yardstick.zero_width]
    return float(counted.mean()) if counted.size else float("nan")


def wrapped(text: str) -> str:
    # Largest number of characters in a line. Usual terminals would wrap longer lines.
    return textwrap.fill(text, 110, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
