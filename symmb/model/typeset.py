"""A system and a scene as HTML, for notebooks: equations typeset, and tables."""

from collections.abc import Mapping, Sequence

import casadi as ca

from symmb import _html as html
from symmb._types import Expr
from symmb.symbolic import latex

_MOST_NODES, _LONGEST = 1000, 6000
"""Operations of a part, and characters of its LaTeX, up to which it is typeset: larger ones cannot be read."""
_LONGEST_CELL = 80
"""Most characters of an expression in a table."""
_GREEK = {"Phi": r"\Phi", "Phi_q": r"\Phi_q", "Phi_t": r"\Phi_t", "Psi": r"\Psi", "gamma": r"\gamma"}


def displays(parts: Mapping[str, ca.SX], symbols: Sequence[ca.SX], names: Sequence[str]) -> dict[str, str]:
    """LaTeX of the parts of the equations, by name, each as `part = ...`."""
    return {name: f"{_GREEK.get(name, name)} = {latex(part, symbols, names)}" for name, part in parts.items()}


def system_html(text: str, parts: Mapping[str, ca.SX], symbols: Sequence[ca.SX], names: Sequence[str]) -> str:
    """What a system has in words, and its equations; large parts are left to `latex()`."""
    small = {name: part for name, part in parts.items() if ca.n_nodes(part) <= _MOST_NODES}
    formulas = {name: tex for name, tex in displays(small, symbols, names).items() if len(tex) <= _LONGEST}
    large = ", ".join(name for name in parts if name not in formulas)
    note = f"{large}: too large to be read here. system.latex() gives all parts, system.{large.split(',')[0]} each."
    return html.page(html.text(text), *map(html.formula, formulas.values()), html.text(note if large else ""))


def scene_html(
    text: str,
    outputs: Mapping[str, tuple[str, ca.SX]],
    start: Mapping[str, Expr],
    parameters: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    picture: bytes | str,
) -> str:
    """A scene as a picture and tables.

    Parameters
    ----------
    text                 the scene in a line
    outputs              name -> unit and expression
    start                listed start values
    parameters           nominal values
    intervals            those of the uncertain parameters
    picture              PNG of the mechanism, or why there is none
    """
    tables = [html.table([["output", "unit", "expression"], *_output_rows(outputs)], (0, 1, 2))]
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


def _output_rows(outputs: Mapping[str, tuple[str, ca.SX]]) -> list[list[str]]:
    return [[name, unit, _cell(expression)] for name, (unit, expression) in outputs.items()]


def _cell(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= _LONGEST_CELL else f"{text[:_LONGEST_CELL]} ..."
