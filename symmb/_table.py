"""Aligned columns of text."""

from collections.abc import Collection, Sequence


def aligned(lines: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> list[str]:
    """Lines of cells as texts; the columns named in ``left`` begin below each other, the others end so.

    Examples
    --------
    >>> aligned([["output", "least"], ["x", "-1.5"]])
    ['output  least', 'x        -1.5']
    """
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
