"""A system and a scene as HTML, for notebooks: equations typeset, and tables."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

import casadi as ca

from symmb import _html as html
from symmb._options import require_names
from symmb._types import Expr
from symmb.symbolic import latex, to_sympy

_MOST_NODES, _LONGEST = 1000, 6000
"""Operations of a part, and characters of its LaTeX, up to which it is typeset: larger ones cannot be read."""
_LONGEST_CELL = 80
"""Most characters of an expression in a table."""
_GREEK = {"Phi": r"\Phi", "Phi_q": r"\Phi_q", "Phi_t": r"\Phi_t", "Psi": r"\Psi", "gamma": r"\gamma"}


class Typeset(ABC):
    """Equations as SymPy matrices, in LaTeX and in HTML, by the names of their parts, which are attributes."""

    @property
    @abstractmethod
    def parts(self) -> tuple[str, ...]:
        """The parts that there are."""

    @property
    @abstractmethod
    def names(self) -> dict[str, ca.SX]:
        """All symbols by name."""

    def to_sympy(self, *names: str) -> dict:
        """The equations as SymPy matrices by name: M, N, Q, Phi, Phi_q, Phi_t, Psi, gamma, or those asked for."""
        symbols = self.names
        require_names("to_sympy", "part", names, self.parts)
        return {name: to_sympy(getattr(self, name), [*symbols.values()], [*symbols]) for name in names or self.parts}

    def latex(self) -> str:
        """The equations in LaTeX, one display for each part that the scene has."""
        return "\n\n".join(rf"\[ {self._display(name)} \]" for name in self.parts)

    def _display(self, name: str) -> str:
        """A part in LaTeX, as `part = ...`."""
        symbols = self.names
        return f"{_GREEK.get(name, name)} = {latex(getattr(self, name), [*symbols.values()], [*symbols])}"

    def _repr_html_(self) -> str:
        small = [name for name in self.parts if ca.n_nodes(getattr(self, name)) <= _MOST_NODES]
        formulas = {name: tex for name in small if len(tex := self._display(name)) <= _LONGEST}
        large = ", ".join(name for name in self.parts if name not in formulas)
        note = f"{large}: too large to be read here. system.latex() gives all parts, system.{large.split(',')[0]} each."
        text = html.text(repr(self))
        return html.page(text, *map(html.formula, formulas.values()), html.text(note if large else ""))


def scene_html(
    text: str,
    outputs: Mapping[str, tuple[str, object]],
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


def _output_rows(outputs: Mapping[str, tuple[str, object]]) -> list[list[str]]:
    return [[name, unit, _cell(expression)] for name, (unit, expression) in outputs.items()]


def _cell(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= _LONGEST_CELL else f"{text[:_LONGEST_CELL]} ..."
