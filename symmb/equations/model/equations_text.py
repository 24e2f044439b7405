"""The equations of a system for readers: text, and LaTeX with the same content."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from textwrap import fill
from typing import Any

from symmb import _html as html
from symmb._options import require_names
from symmb.declare import symbolic
from symmb.declare.mechanics import with_si_symbols
from symmb.declare.symbolic import is_zero

_WIDTH = 94
"""Maximum width of a printed matrix. For wider matrices, the nonzero entries are listed."""
_LETTERS = {"Phi": "Φ", "Psi": "Ψ", "gamma": "γ", "lambda": "λ"}


@dataclass
class Equations:
    """Parts of the equations of a system.

    The fields are: the equation of motion in LaTeX; the names of unknowns; the names of rows and columns of parts; the
    parts as SymPy matrices; the parts that are printed entry by entry; the definitions of names in these entries; and
    the names of all symbols.
    """

    motion: str
    vectors: dict[str, list[str]]
    axes: dict[str, tuple[list[str], ...]]
    matrices: dict[str, Any]
    wide: set[str]
    shared: dict[Any, Any]
    symbols: list[str]

    @property
    def text(self) -> str:
        """The equations as lines of text."""
        pretty, parts = (
            symbolic.printer(symbolic.set_names(self.symbols, symbolic.plain), "pretty"),
            [_plain(self.motion)],
        )
        for name, lines in self._parts("str"):
            if lines is None:
                form = pretty.form(self.matrices[name])
                parts.append(type(form)(*form.left(f"{_plain(_label(name))} = ")).render(wrap_line=False))
            elif lines:
                parts.append(_lines(["with", *lines] if name == "with" else lines))
        return "\n\n".join(filter(None, parts))

    @property
    def displays(self) -> dict[str, str]:
        """The equations in LaTeX, with a display for each paragraph."""
        tex, displays = (
            symbolic.printer(symbolic.set_names(self.symbols, symbolic.typeset), "latex").doprint,
            {"motion": self.motion},
        )
        for name, lines in self._parts("latex"):
            displays[name] = f"{_label(name)} = {tex(self.matrices[name])}" if lines is None else _aligned(lines)
        return {name: display for name, display in displays.items() if display}

    def _parts(self, kind: str) -> Iterator[tuple[str, list[str] | None]]:
        """The lines of each paragraph by name, as text or in LaTeX; None for a part that is printed as a matrix."""
        is_text = kind == "str"
        names, sign = (
            symbolic.set_names(self.symbols, symbolic.plain if is_text else symbolic.typeset),
            "=" if is_text else "&=",
        )
        line, said = symbolic.printer(names, kind).doprint, _plain if is_text else str
        yield "vectors", [f"{said(v)} {sign} ({', '.join(names[n] for n in of)})" for v, of in self.vectors.items()]
        for name in self.matrices:
            label, entries = said(_label(name)), self._entries(name) if name in self.wide else ()
            lines = [f"{label}[{', '.join(names[n] for n in at)}] {sign} {line(e)}" for at, e in entries]
            yield name, lines if name in self.wide else None
        yield "with", [f"{line(symbol)} {sign} {line(e)}" for symbol, e in self.shared.items()]

    @property
    def formulas(self, longest: int = 6000) -> list[str]:
        """The displays for notebooks. Displays that are too long are replaced by a note with their names."""
        large = ", ".join(name for name, tex in self.displays.items() if len(tex) > longest)
        note = f"{large}: too large for a notebook. Call system.equations() or system.latex() for all parts."
        short = [tex for tex in self.displays.values() if len(tex) <= longest]
        return [*map(html.formula, short), html.text(note if large else "")]

    def _entries(self, name: str) -> list[tuple[list[str], Any]]:
        """The nonzero entries, each with the names of row and column. For the symmetric M, only the upper half."""
        entries = self.matrices[name].todok().items()
        kept = sorted((at, e) for at, e in entries if name != "M" or at[0] <= at[1])
        return [([axis[k] for axis, k in zip(self.axes[name], at, strict=False)], e) for at, e in kept]


class ReadEquations:
    """Methods that show the equations of a system: as text, in LaTeX, as SymPy matrices, and in notebooks."""

    @cached_property
    def parts(self: Any) -> tuple[str, ...]:
        """The names of the existing parts among M, N, Q, Phi, Phi_q, Phi_t, Psi, gamma."""
        has = {
            "M": self.v.numel() > 0,
            "N": self.q.numel() > self.v.numel(),
            "Q": self.v.numel() > 0,
            "Phi": self.Phi.numel() > 0,
            "Phi_q": self.Phi.numel() > 0,
            "Phi_t": not is_zero(self.Phi_t),
            "Psi": self.Psi.numel() > 0,
            "gamma": self.G.shape[0] > 0,
        }
        return tuple(name for name, there in has.items() if there)

    def to_sympy(self: Any, *names: str) -> dict:
        """The equations as SymPy matrices by name: M, N, Q, Phi, Phi_q, Phi_t, Psi, gamma, or only the given names.

        Entries are simplified if the simplification takes few operations, as in `equations()`.
        """
        require_names("to_sympy", "part", names, self.parts)
        return matrices_of(self, names or self.parts)

    @cached_property
    def _as_read(self) -> Equations:
        return equations_of(self)

    def equations(self) -> str:
        """The equations as text: the equation of motion, its unknowns, and M, N, Q, Phi, Phi_q, Phi_t, Psi, gamma.

        Parts are matrices, simplified if this takes few operations. If a matrix is wide, its nonzero entries are listed
        one per line, and common subexpressions get names. `latex()` has the same content.

        Examples
        --------
        >>> import symmb as mb
        >>> p = mb.Parameters(m=1.0, l=1.0)
        >>> rod = mb.Body("rod", mass=p.m, inertia=p.m * p.l**2 / 12)
        >>> pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, p.l / 2))
        >>> system = mb.System(rod, pin, mb.Gravity(0, -9.81), parameters=p)
        >>> print(system.joint_space().equations())
        M q̈ = Q
        <BLANKLINE>
        q = (q_pin)
        q̇ = (q̇_pin)
        <BLANKLINE>
            ⎡ 2  ⎤
            ⎢l ⋅m⎥
        M = ⎢────⎥
            ⎣ 3  ⎦
        <BLANKLINE>
        Q = [-4.905⋅l⋅m⋅sin(q_pin)]
        """
        return self._as_read.text

    def latex(self) -> str:
        """The content of `equations()` in LaTeX, with a display for each part."""
        return "\n\n".join(rf"\[ {tex} \]" for tex in self._as_read.displays.values())

    def _repr_html_(self) -> str:
        return html.page(html.text(repr(self)), *self._as_read.formulas)


def equations_of(system: Any) -> Equations:
    """The equations of a System, simplified if this takes few operations."""
    c, symbols = system.collected, system.names
    of = [*symbols.values()], [*symbols]
    q, v, rows, n_c = [*c.q_names], [*c.v_names], [*c.row_names], system.Phi.numel()
    is_rate = len(q) == len(v) and is_zero(system.qdot - system.v)
    parts, matrices = _parts_of(system, system.parts)
    # Long entries are easier to read if common subexpressions have names.
    long = [name for name, m in matrices.items() if m is None or max(e.count_ops() for e in m) > 60]
    shared, named = symbolic.with_names([parts[name] for name in long], *of) if long else ({}, [])
    matrices |= dict(zip(long, named, strict=True))
    pretty = symbolic.printer(symbolic.set_names([*symbols], symbolic.plain), "pretty")
    fits = [name for name, m in matrices.items() if name not in long and 3 * m.cols < _WIDTH]
    narrow = {name for name in fits if pretty.form(matrices[name]).width() + len("Phi_q = ") <= _WIDTH}
    Phi, Psi = rows[:n_c], rows[n_c:]
    return Equations(
        motion=_motion(is_rate, bool(rows), bool(Psi)) if v else "",
        vectors={name: of for name, of in (("q", q), (r"\dot{q}" if is_rate else "v", v), (r"\lambda", rows)) if of},
        axes={"M": (v, v), "N": (q, v), "Q": (v,), "Phi": (Phi,), "Phi_q": (Phi, q)}
        | {"Phi_t": (Phi,), "Psi": (Psi,), "gamma": (rows,)},
        matrices=matrices,
        wide={*matrices} - narrow,
        shared=shared,
        symbols=[*symbols, *(symbol.name for symbol in shared)],
    )


def matrices_of(system: Any, names: Sequence[str]) -> dict[str, Any]:
    """Parts of a System as SymPy matrices by name, simplified if this takes few operations."""
    symbols, (parts, matrices) = system.names, _parts_of(system, names)
    of = [*symbols.values()], [*symbols]
    return {name: symbolic.to_sympy(parts[name], *of) if m is None else m for name, m in matrices.items()}


def _parts_of(system: Any, names: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parts of a System by name as expressions in SI units, and their short forms (None without a short form)."""
    symbols = system.names
    parts = {name: with_si_symbols(system.parameters, getattr(system, name)) for name in names}
    return parts, {name: symbolic.simplified(part, [*symbols.values()], [*symbols]) for name, part in parts.items()}


def _motion(is_rate: bool, has_rows: bool, has_psi: bool) -> str:
    """The equation of motion in LaTeX, with the definition of G."""
    a, G = r"\ddot{q}" if is_rate else r"\dot{v}", r"\Phi_q" if is_rate and not has_psi else "G"
    Phi_v = r"\Phi_q" if is_rate else r"\Phi_q N"
    block = rf"\begin{{bmatrix}} M & {G}^T \\ {G} & 0 \end{{bmatrix}} \begin{{bmatrix}} {a} \\ \lambda \end{{bmatrix}}"
    motion = [rf"{block} = \begin{{bmatrix}} Q \\ \gamma \end{{bmatrix}}" if has_rows else f"M {a} = Q"]
    if has_rows and G == "G":
        motion.append(rf"G = \begin{{bmatrix}} {Phi_v} \\ \Psi_v \end{{bmatrix}}" if has_psi else f"G = {Phi_v}")
    return r",\quad ".join([*motion, *([] if is_rate else [r"\dot{q} = N v"])])


def _label(name: str) -> str:
    """The name of a part in LaTeX."""
    return rf"\{name}" if name.split("_")[0] in _LETTERS else name


def _plain(tex: str) -> str:
    """The equation of motion, or the name of a vector, as text."""
    signs = {r" \\ ": "; ", " & ": "  ", r"\begin{bmatrix} ": "[", r" \end{bmatrix}": "]", r"\quad": "  ", "^T": "ᵀ"}
    signs |= {rf"\{name}": letter for name, letter in _LETTERS.items()}
    signs |= {r"\ddot{q}": "q̈", r"\dot{q}": "q̇", r"\dot{v}": "v̇"}
    for sign, text in signs.items():
        tex = tex.replace(sign, text)
    return tex


def _lines(lines: list[str]) -> str:
    wrapped = [fill(x, _WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False) for x in lines]
    return "\n".join(wrapped)


def _aligned(lines: list[str]) -> str:
    return "\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}" if lines else ""
