"""Declared names such as "rod1.theta" as mathematics, and expressions of SymPy with them, as text and in LaTeX."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

_GREEK = frozenset(
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi"
    " chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega".split()
)
_ESCAPES = str.maketrans({c: rf"\{c}" for c in "_%&#${}"} | {"\\": r"\backslash{}", "^": r"\^{}", "~": r"\~{}"})
_LOCAL = re.compile(r"(?P<letters>[A-Za-z]+)_?(?P<rest>\w*)(?:\[(?P<index>\d+)\])?")
_OF_JOINTS = {name + rate: "q" + rate for name in ("angle", "displacement") for rate in ("", "_rate")}
"""Handles of joints are printed as coordinates q. Rates have a dot."""


def typeset(name: str, is_full: bool = False) -> str:
    r"""A declared name in LaTeX: the quantity is the letter, and the body or joint is the subscript.

    With `is_full`, the whole name of the quantity is written, because another name has the same letter.

    Examples
    --------
    >>> for name in "l1", "rod1.theta", "rod1.vx", "pin.angle_rate", "elbow.lam[0]", "k_left", "EI":
    ...     print(typeset(name))
    l_{1}
    \theta_{\mathrm{rod1}}
    v_{x,\mathrm{rod1}}
    \dot{q}_{\mathrm{pin}}
    \lambda_{\mathrm{elbow},0}
    k_{\mathrm{left}}
    \mathrm{EI}
    """
    parts = None if is_full else _parts(name)
    if parts is None:
        return _upright(name)
    letters, own, owner, index = parts
    letter = f"\\{letters}" if letters in _GREEK else letters if len(letters) == 1 else _upright(letters)
    if letters == "q" and own == "rate" and owner:
        letter, own = r"\dot{q}", ""
    own = own if len(own) < 2 or own.isdigit() else _upright(own)
    subscript = ",".join(part for part in (own, _upright(owner) if owner else "", index) if part)
    return letter + (f"_{{{subscript}}}" if subscript else "")


def plain(name: str, is_full: bool = False) -> str:
    """A declared name in a line of text.

    Examples
    --------
    >>> print(*map(plain, ("l1", "rod1.theta", "rod1.vx", "pin.angle_rate", "elbow.lam[0]", "k_left", "mu_s")))
    l1 θ_rod1 vx_rod1 q̇_pin λ_elbow[0] k_left μ_s
    """
    from sympy.printing.pretty.pretty_symbology import greek_unicode

    parts = None if is_full else _parts(name)
    if parts is None:
        return name
    letters, own, owner, index = parts
    letter = greek_unicode.get(letters) or letters
    if letters == "q" and own == "rate" and owner:
        letter, own = "q\u0307", ""
    if not owner:
        return letter + name[len(letters) :]
    return f"{letter}{own}_{owner}" + (f"[{index}]" if index else "")


def _parts(name: str) -> tuple[str, str, str, str] | None:
    """The letters of a quantity, the remaining part of its name, its owner, and its index; None for other names."""
    owner, _, local = name.rpartition(".")
    match = _LOCAL.fullmatch(_OF_JOINTS.get(local, local) if owner else local)
    if match is None:
        return None
    letters, rest = match["letters"], match["rest"] or ""
    if len(letters) == 2 and letters[0] in "vaw" and letters[1] in "xyz":
        letters, rest = letters[0], letters[1] + rest
    if owner:
        letters = {"lam": "lambda", "w": "omega"}.get(letters, letters)
    return letters, rest, owner, match["index"] or ""


def _upright(text: str) -> str:
    return rf"\mathrm{{{text.translate(_ESCAPES)}}}"


def set_names(names: Sequence[str], typeset: Callable[..., str]) -> dict[str, str]:
    """Names, printed by `typeset` or `plain`. Names that would look equal are written in full."""
    made = {name: typeset(name) for name in names}
    times = Counter(made.values())
    return {name: typeset(name, True) if times[text] > 1 else text for name, text in made.items()}


def decimal(value: Any) -> Any:
    """A rational number of SymPy for printing: 1/12 and 1/2 stay fractions, 9.81 and 2.5 become decimals."""
    import sympy

    fraction = Fraction(value.p, value.q)
    twos, rest = fraction.denominator & -fraction.denominator, fraction.denominator
    while rest % 5 == 0:
        rest //= 5
    is_decimal = rest == twos and (fraction.denominator > twos or abs(fraction) > 2)
    if fraction.denominator > 1 and (is_decimal or fraction.denominator > 10_000):
        return sympy.Float(float(fraction))
    return value


def printer(names: dict[str, str], kind: str) -> Any:
    """A printer of SymPy: "pretty" for matrices as text, "str" for lines of text, or "latex".

    `names` maps the names of symbols to their printed form.
    """
    import sympy
    from sympy.printing.latex import LatexPrinter
    from sympy.printing.pretty.pretty import PrettyPrinter, pretty_use_unicode, prettyForm
    from sympy.printing.str import StrPrinter

    base, settings = {
        "pretty": (PrettyPrinter, {"use_unicode": True, "wrap_line": False, "full_prec": False}),
        "str": (StrPrinter, {"full_prec": False}),
        "latex": (LatexPrinter, {}),
    }[kind]

    class Printer(base):
        def form(self, matrix: Any) -> Any:
            """A matrix as text, always in Unicode. SymPy would check the abilities of the standard output."""
            before = pretty_use_unicode(True)
            try:
                return self._print(matrix)
            finally:
                pretty_use_unicode(before)

        def _print_Symbol(self, symbol: Any, *_: Any, **__: Any) -> Any:
            name = names.get(symbol.name, symbol.name)
            return prettyForm(name, binding=prettyForm.ATOM) if kind == "pretty" else name

        def _print_Rational(self, value: Any) -> Any:
            shown = decimal(value)
            return super()._print_Rational(value) if shown is value else self._print(shown)

        def _print_Mul(self, product: Any) -> Any:
            factor, rest = product.as_coeff_Mul()
            if factor.is_Rational and (shown := decimal(factor)) is not factor:
                product = sympy.Mul(shown, *sympy.Mul.make_args(rest), evaluate=False)
            return super()._print_Mul(product)

        def _print_Add(self, total: Any, order: Any = None) -> Any:
            terms = [decimal(term) if term.is_Rational else term for term in total.args]
            return super()._print_Add(sympy.Add(*terms, evaluate=False), order=order)

    return Printer(settings)
