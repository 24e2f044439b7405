"""The equations of a system as they are read: text, and LaTeX of the same content."""

from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any

import casadi as ca

from symmb.symbolic import is_zero, plain, printer, set_names, simplified, typeset, with_names

if TYPE_CHECKING:
    from symmb.model.system import System

_WIDTH = 110
"""Columns of text up to which a matrix is printed as such. Of wider ones the entries that are not zero are printed."""
_LONGEST = 60
"""Operations of the longest entry up to which what the entries share has no names."""
_MOST = 20_000
"""Operations of a part up to which it is printed: ten seconds."""
_GREEK = {"Phi": "Φ", "Phi_q": "Φ_q", "Phi_t": "Φ_t", "Psi": "Ψ", "gamma": "γ"}
_TEX = {"Phi": r"\Phi", "Phi_q": r"\Phi_q", "Phi_t": r"\Phi_t", "Psi": r"\Psi", "gamma": r"\gamma"}


@dataclass
class Equations:
    """Parts of the equations of a system, as SymPy has them.

    matrices by their names, of which those in `wide` are printed by their entries; what shared parts of these stand for;
    names of parts that are too long; the vectors of unknowns and their names; the equations of motion in a line.
    """

    symbols: list[str]
    vectors: dict[str, list[str]]
    rows: dict[str, tuple[list[str], list[str]]]
    matrices: dict[str, Any]
    wide: set[str]
    shared: dict[Any, Any]
    left_out: dict[str, int]
    line: tuple[str, str]

    @property
    def text(self) -> str:
        """The equations as lines of text."""
        names = set_names(self.symbols, plain)
        pretty, line = printer(names, "pretty"), printer(names, "str")
        vectors = [f"{vector} = ({', '.join(names[n] for n in of)})" for vector, of in self.vectors.items()]
        parts = [self.line[0], "\n".join(_folded(vector) for vector in vectors)]
        for name, matrix in self.matrices.items():
            label = _GREEK.get(name, name)
            if name not in self.wide:
                form = pretty._print(matrix)
                parts.append(type(form)(*form.left(f"{label} = ")).render(wrap_line=False))
                continue
            entries = self._entries(name, matrix)
            parts.append("\n".join(_folded(f"{label}[{', '.join(names[n] for n in at)}] = {line.doprint(e)}") for at, e in entries))
        if self.shared:
            parts.append("\n".join(["with", *(_folded(f"{n} = {line.doprint(e)}") for n, e in self.shared.items())]))
        parts += [f"{_GREEK.get(n, n)} has {size} operations: system.to_sympy('{n}')" for n, size in self.left_out.items()]
        return "\n\n".join(part.rstrip() for part in parts if part)

    @property
    def displays(self) -> dict[str, str]:
        """The equations in LaTeX: a display for the line, the vectors, each part, and what shared parts stand for."""
        names = set_names(self.symbols, typeset)
        tex = printer(names, "latex").doprint
        vectors = [rf"{vector} &= ({', '.join(names[n] for n in of)})" for vector, of in self._tex_vectors]
        displays = {"line": self.line[1], "vectors": _aligned(vectors)} if vectors else {}
        for name, matrix in self.matrices.items():
            label = _TEX.get(name, name)
            if name not in self.wide:
                displays[name] = f"{label} = {tex(matrix)}"
                continue
            of = [(", ".join(names[n] for n in at), tex(e)) for at, e in self._entries(name, matrix)]
            displays[name] = _aligned([rf"{label}[{at}] &= {e}" for at, e in of])
        if self.shared:
            displays["with"] = _aligned([rf"{tex(n)} &= {tex(e)}" for n, e in self.shared.items()])
        return displays

    @property
    def _tex_vectors(self) -> list[tuple[str, list[str]]]:
        tex = {"q̇": r"\dot{q}", "λ": r"\lambda"}
        return [(tex.get(vector, vector), of) for vector, of in self.vectors.items()]

    def _entries(self, name: str, matrix: Any) -> list[tuple[tuple[str, ...], Any]]:
        """Names of rows and columns, and entries that are not zero. M is symmetric: its upper half."""
        rows, columns = self.rows[name]
        return [
            ((rows[i], columns[j]) if columns else (rows[i],), matrix[i, j])
            for i in range(matrix.rows)
            for j in range(i if name == "M" else 0, matrix.cols)
            if matrix[i, j] != 0
        ]


def equations_of(system: "System") -> Equations:
    """The equations of a system, in short forms where these are found with few operations."""
    c, symbols = system.collected, system.names
    of = [*symbols.values()], [*symbols]
    q, v, rows = [*c.q_names], [*c.v_names], [*c.row_names]
    is_rate = is_zero(system.qdot - system.v) if len(q) == len(v) else False
    n_c = system.Phi.numel()
    names = {"M": (v, v), "N": (q, v), "Q": (v, []), "Phi": (rows[:n_c], []), "Phi_q": (rows[:n_c], q)}
    names |= {"Phi_t": (rows[:n_c], []), "Psi": (rows[n_c:], []), "gamma": (rows, [])}
    sizes = {name: ca.n_nodes(getattr(system, name)) for name in system.parts}
    short = {name: simplified(getattr(system, name), *of) for name, n in sizes.items() if n <= _MOST}
    long = [name for name, matrix in short.items() if matrix is None or max(e.count_ops() for e in matrix) > _LONGEST]
    shared, matrices = with_names([getattr(system, name) for name in long], *of) if long else ({}, [])
    short |= dict(zip(long, matrices, strict=True))
    pretty = printer(set_names([*symbols], plain), "pretty")
    narrow = [name for name, matrix in short.items() if name not in long and 3 * matrix.cols < _WIDTH]
    fits = [name for name in narrow if pretty._print(short[name]).width() + len("Phi_q = ") <= _WIDTH]
    return Equations(
        symbols=[*symbols, *(symbol.name for symbol in shared)],
        vectors={name: of for name, of in (("q", q), ("q̇" if is_rate else "v", v), ("λ", rows)) if of},
        rows=names,
        matrices=short,
        wide={name for name in short if name not in fits},
        shared=shared,
        left_out={name: n for name, n in sizes.items() if n > _MOST},
        line=_line(is_rate, bool(rows), bool(system.Psi.numel())) if v else ("", ""),
    )


def _line(is_rate: bool, has_rows: bool, has_psi: bool) -> tuple[str, str]:
    """The equations of motion, as text and in LaTeX."""
    a, tex_a = ("q̈", r"\ddot{q}") if is_rate else ("v̇", r"\dot{v}")
    rates = ([], []) if is_rate else (["q̇ = N v"], [r"\dot{q} = N v"])
    if not has_rows:
        return ",   ".join([f"M {a} = Q", *rates[0]]), r",\quad ".join([f"M {tex_a} = Q", *rates[1]])
    G, tex_G = ("Φ_q", r"\Phi_q") if is_rate and not has_psi else ("G", "G")
    upper = "Φ_q" if is_rate else "Φ_q N"
    means = [] if G != "G" else [f"G = [{upper}; Ψ_v]" if has_psi else f"G = {upper}"]
    text = f"[M  {G}ᵀ; {G}  0] [{a}; λ] = [Q; γ]"
    block = rf"\begin{{bmatrix}} M & {tex_G}^T \\ {tex_G} & 0 \end{{bmatrix}}"
    unknown = rf"\begin{{bmatrix}} {tex_a} \\ \lambda \end{{bmatrix}}"
    tex = rf"{block} {unknown} = \begin{{bmatrix}} Q \\ \gamma \end{{bmatrix}}"
    tex_means = [m.replace("Φ", r"\Phi").replace("Ψ", r"\Psi") for m in means]
    return ",   ".join([text, *means, *rates[0]]), r",\quad ".join([tex, *tex_means, *rates[1]])


def _folded(line: str) -> str:
    return fill(line, _WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)


def _aligned(lines: list[str]) -> str:
    return "\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}"
