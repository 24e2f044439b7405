"""Aligned columns of text."""

from collections.abc import Collection, Sequence

import numpy as np

from symmb._magnitudes import SAME


def is_timeless(t: Sequence[float] | np.ndarray) -> bool:
    """Whether the only time is 0, as in results without times. This time is neither printed nor drawn."""
    return len(t) == 1 and t[0] == 0


def over_times(rows: Sequence[Sequence[str]], t: Sequence[float] | np.ndarray = ()) -> list[list[str]]:
    """Rows of a table, head first. The columns "at [s]" are left out if they are empty, or if there are no times.

    Examples
    --------
    >>> over_times([["output", "lowest", "at [s]"], ["x", "-1.5", "0"]], [0.0])
    [['output', 'lowest'], ['x', '-1.5']]
    """
    told = [not is_timeless(t) and any(column[1:]) for column in zip(*rows, strict=True)]
    kept = [i for i, name in enumerate(rows[0]) if name != "at [s]" or told[i]]
    return [[row[i] for i in kept] for row in rows]


def time_text(t: Sequence[float] | np.ndarray, i: int, *values: np.ndarray) -> str:
    """Time number i as text. The text is empty if the values (n_t,) are equal at all times, as for scalar outputs."""
    is_scalar = len(t) > 1 and all(np.allclose(own, own[0], SAME, 0.0, equal_nan=True) for own in values)
    return "" if is_scalar else f"{t[i]:.6g}"


def at_time(t: Sequence[float] | np.ndarray, i: int) -> str:
    """Words such as " at 2 s" for time number i, to print after a value; empty if there are no times."""
    return "" if is_timeless(t) else f" at {t[i]:g} s"


def span_text(t: Sequence[float] | np.ndarray) -> str:
    """The number of times and their range, such as "11 times from 0 to 1 s"."""
    return f"{len(t)} times from {t[0]:g} to {t[-1]:g} s" if len(t) > 1 else "one time"


def apart(one: float, other: float) -> tuple[str, str]:
    """Two numbers with two digits, or with as many digits as they need to differ.

    Examples
    --------
    >>> apart(0.0102, 0.01), apart(0.5, 0.01)
    (('0.0102', '0.01'), ('0.5', '0.01'))
    """
    pairs = [(f"{one:.{digits}g}", f"{other:.{digits}g}") for digits in range(2, 18)]
    return next((pair for pair in pairs if pair[0] != pair[1]), pairs[0])


def aligned(lines: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> list[str]:
    """Lines of cells as texts. Columns whose number is in ``left`` are aligned on the left, others on the right.

    Examples
    --------
    >>> aligned([["output", "lowest"], ["x", "-1.5"]])
    ['output  lowest', 'x         -1.5']
    """
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
