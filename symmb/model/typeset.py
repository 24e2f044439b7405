"""A scene as HTML, for notebooks."""

from collections.abc import Mapping

from symmb import _html as html
from symmb._types import Expr

_LONGEST_CELL = 80
"""Most characters of an expression in a table."""


def scene_html(
    text: str,
    outputs: Mapping[str, tuple[str, object]],
    start: Mapping[str, Expr],
    parameters: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    picture: bytes | str,
) -> str:
    """A scene as its text, a PNG, or why there is none, and tables. Outputs are units and expressions by name."""
    rows = [[name, unit, _cell(expression)] for name, (unit, expression) in outputs.items()]
    tables = [html.table([["output", "unit", "expression"], *rows], (0, 1, 2))]
    if start:
        tables.append(
            html.table([["start", "value"], *([name, _cell(value)] for name, value in start.items())], (0, 1))
        )
    if parameters:
        rows = [
            [name, f"{value:g}", *(f"{end:g}" for end in intervals.get(name, ()))] for name, value in parameters.items()
        ]
        head = ["parameter", "nominal", "lower", "upper"]
        tables.append(html.table([head, *([*row, *[""] * (4 - len(row))] for row in rows)]))
    shown = html.text(picture) if isinstance(picture, str) else html.picture(picture)
    return html.page(html.text(text), shown, *tables)


def _cell(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= _LONGEST_CELL else f"{text[:_LONGEST_CELL]} ..."
