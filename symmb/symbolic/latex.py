"""LaTeX of SX matrices, with declared names such as "rod1.theta" set as mathematics."""

import re
from collections.abc import Sequence

import casadi as ca

from symmb.symbolic.sympy_out import to_sympy

_GREEK = frozenset(
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi"
    " chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega".split()
)
_ESCAPES = str.maketrans({c: rf"\{c}" for c in "_%&#${}"} | {"\\": r"\backslash{}", "^": r"\^{}", "~": r"\~{}"})
_LOCAL = re.compile(r"(?P<letters>[A-Za-z]+)_?(?P<rest>\w*)(?:\[(?P<index>\d+)\])?")


def latex(expr: ca.SX, symbols: Sequence[ca.SX], names: Sequence[str]) -> str:
    r"""LaTeX of an SX matrix; a scalar comes without brackets.

    Parameters
    ----------
    expr : (n, m) SX
    symbols, names           as in `to_sympy`; how a name is set is told in `typeset`

    Raises
    ------
    DeclarationError         as `to_sympy`

    Examples
    --------
    >>> import casadi as ca
    >>> l, theta = ca.SX.sym("l"), ca.SX.sym("theta")
    >>> print(latex(l**2 * ca.sin(theta), [l, theta], ["l1", "rod1.theta"]))
    l_{1}^{2} \sin{\left(\theta_{\mathrm{rod1}} \right)}
    """
    import sympy

    matrix = to_sympy(expr, symbols, names)
    set_names = {sympy.Symbol(name, real=True): typeset(name) for name in names}
    return sympy.latex(matrix[0] if matrix.shape == (1, 1) else matrix, symbol_names=set_names)


def typeset(name: str) -> str:
    r"""A declared name in LaTeX: the quantity as the letter, its body or joint as subscript.

    Examples
    --------
    >>> for name in "l1", "rod1.theta", "rod1.vx", "elbow.lam[0]", "k_left", "EI":
    ...     print(typeset(name))
    l_{1}
    \theta_{\mathrm{rod1}}
    v_{x,\mathrm{rod1}}
    \lambda_{\mathrm{elbow},0}
    k_{\mathrm{left}}
    \mathrm{EI}
    """
    owner, _, local = name.rpartition(".")
    match = _LOCAL.fullmatch(local)
    if match is None:
        return _upright(name)
    letters, rest = match["letters"], match["rest"]
    if len(letters) == 2 and letters[0] in "vaw" and letters[1] in "xyz":
        letters, rest = letters[0], letters[1] + rest
    letters = {"lam": "lambda", "w": "omega"}.get(letters, letters)
    letter = f"\\{letters}" if letters in _GREEK else letters if len(letters) == 1 else _upright(letters)
    own = rest if len(rest) < 2 or rest.isdigit() else _upright(rest)
    subscript = ",".join(part for part in (own, _upright(owner) if owner else "", match["index"]) if part)
    return letter + (f"_{{{subscript}}}" if subscript else "")


def _upright(text: str) -> str:
    return rf"\mathrm{{{text.translate(_ESCAPES)}}}"
