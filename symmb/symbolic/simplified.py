"""Short forms of expressions: sums of products of symbols, with one sine or cosine of an angle in each.

sin(x)^2 + cos(x)^2 and products of sines and cosines of sums fall together there, because this form is unique. Of it, of
forms with powers of sines and cosines, and of what was derived, the one with the fewest operations is taken.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import casadi as ca

from symmb.symbolic.instructions import interpret
from symmb.symbolic.pieces import Entry
from symmb.symbolic.sympy_out import exact, length_of, operation, rational, to_sympy

_MOST_OPERATIONS, _MOST_PRODUCTS, _MOST_TERMS = 3000, 4000, 32
"""Operations and products of terms of a matrix, and terms of an entry, up to which it is simplified.

Systems of up to three degrees of freedom take less than a second for all matrices: `test_equations_of_models` measures it.
"""
_MUCH = 1.25
"""What was derived is kept if another form is longer by this factor: products of sums that are not worth multiplying."""
_HIGHEST = 4
"""The largest power of a sum that is multiplied out."""

Monomial = tuple[tuple[int, int], ...]
"""Numbers of factors and their exponents, sorted."""
Angle = tuple[tuple[Monomial, Fraction], ...]
"""A sum of monomials, of which the first has a coefficient above 0."""
Sum = dict[tuple[Monomial, Angle, int], Fraction]
"""Coefficients of monomial * cos(angle - n pi / 2), n = 0 or 1."""


def simplified(expr: ca.SX, symbols: Sequence[ca.SX], names: Sequence[str]) -> Any:
    """The matrix that `to_sympy` gives, with short entries; None where they would take many operations to find.

    Examples
    --------
    >>> import casadi as ca
    >>> m, l, theta = ca.SX.sym("m"), ca.SX.sym("l"), ca.SX.sym("theta")
    >>> x, y = l / 2 * ca.cos(theta), l / 2 * ca.sin(theta)
    >>> simplified(m * (x**2 + y**2) + m * l**2 / 12, [m, l, theta], ["m", "l", "theta"])
    Matrix([[l**2*m/3]])
    """
    import sympy

    f = ca.Function("expr", [ca.vertcat(ca.SX(0, 1), *symbols)], [expr])
    [lengths] = interpret(f, [[0] * len(names)], lambda code, of: sum(of, length_of(code)), lambda _: 0)
    if sum(lengths) > _MOST_OPERATIONS:
        return None
    sums = _Sums()
    try:
        inputs = [[sums.factor(sympy.Symbol(name, real=True)) for name in names]]
        [entries] = interpret(f, inputs, sums.operation, sums.constant)
        forms = [sums.forms(entry) for entry in entries]
    except _TooLong:
        return None
    matrix = to_sympy(expr, symbols, names)
    for row, column, known in zip(*expr.sparsity().get_triplet(), forms, strict=True):
        shortest = min(known, key=_length)
        if _length(shortest) <= _MUCH * _length(matrix[row, column]):
            matrix[row, column] = shortest
    return matrix


def _length(expression: Any) -> int:
    return expression.count_ops()


class _TooLong(Exception):
    """The sums have too many terms."""


class _Sums:
    """Arithmetic of sums, whose factors are symbols and what is no polynomial, such as roots."""

    def __init__(self) -> None:
        self.factors: list[Any] = []
        self.numbers: dict[Any, int] = {}
        self.left = _MOST_PRODUCTS

    def factor(self, value: Any, exponent: int = 1) -> Sum:
        if value not in self.numbers:
            self.numbers[value] = len(self.factors)
            self.factors.append(value)
        return {(((self.numbers[value], exponent),), (), 0): Fraction(1)}

    def constant(self, value: float) -> Sum:
        import sympy

        turn, times_pi = exact(value)
        if turn is None:
            return self.factor(sympy.oo if value > 0 else -sympy.oo)
        return _scaled(self.factor(sympy.pi) if times_pi else _ONE, turn)

    def operation(self, code: int | Entry, of: tuple[Any, ...]) -> Any:
        a, b = (*of, None)[:2] if len(of) < 2 else of
        sums = all(isinstance(part, dict) for part in of)
        if sums and code in _LINEAR and not any(map(self._is_piecewise, of)):
            return _total(a, _scaled(b, _LINEAR[code]))
        if sums and code in _SCALES:
            return _scaled(a, _SCALES[code])
        if sums and code in (ca.OP_MUL, ca.OP_SQ):
            return self._product(a, a if b is None else b)
        if sums and code in (ca.OP_DIV, ca.OP_INV):
            return self._product(_ONE if b is None else a, self._inverse(a if b is None else b))
        if sums and code in (ca.OP_POW, ca.OP_CONSTPOW) and (power := self._power(a, b)) is not None:
            return power
        if sums and code in (ca.OP_SIN, ca.OP_COS) and not any(angle for _, angle, _ in a):
            return _harmonic(Fraction(1), (), sorted((m, c) for (m, _, _), c in a.items()), int(code == ca.OP_SIN))
        value = operation(code, tuple(self.expression(part) if isinstance(part, dict) else part for part in of))
        return value if value.is_Boolean or value.is_Relational else self.factor(value)

    def _is_piecewise(self, part: Sum) -> bool:
        return any(self.factors[at].is_Piecewise for monomial, _, _ in part for at, _ in monomial)

    def _product(self, a: Sum, b: Sum) -> Sum:
        self.left -= len(a) * len(b)
        if self.left < 0:
            raise _TooLong
        total: Sum = {}
        for (m, alpha, s), x in a.items():
            for (n, beta, r), y in b.items():
                both = _merged(m, n)
                if alpha and beta:  # cos(a) cos(b) = (cos(a - b) + cos(a + b)) / 2, sines are cosines of x - pi / 2
                    less = x * y / 2 * (-1 if s < r else 1)
                    more = x * y / 2 * (-1 if s and r else 1)
                    total = _total(total, _harmonic(less, both, _merged(alpha, beta, -1), abs(s - r)))
                    total = _total(total, _harmonic(more, both, _merged(alpha, beta), (s + r) % 2))
                else:
                    total = _total(total, {(both, alpha or beta, s or r): x * y})
        return total

    def _inverse(self, a: Sum) -> Sum:
        if not a:
            raise _TooLong  # as SymPy has it
        if len(a) == 1:
            [((monomial, angle, _), coefficient)] = a.items()
            if not angle:
                return {(tuple((at, -n) for at, n in monomial), (), 0): 1 / coefficient}
        return self.factor(self.expression(a), -1)

    def _power(self, a: Sum, b: Sum) -> Sum | None:
        exponent = b.get(((), (), 0), Fraction(0)) if len(b) < 2 else Fraction(1, 2)
        if [*b] not in ([], [((), (), 0)]) or exponent.denominator > 1 or abs(exponent) > _HIGHEST:
            return None
        power = _ONE
        for _ in range(abs(exponent.numerator)):
            power = self._product(power, a)
        return power if exponent >= 0 else self._inverse(power)

    def expression(self, a: Sum) -> Any:
        """The shortest form in SymPy."""
        return min(self.forms(a), key=_length)

    def forms(self, a: Sum) -> list[Any]:
        """Forms in SymPy, those first that are taken among those of one length."""
        import sympy
        from sympy.simplify.fu import TR5, TR6

        if len(a) > _MOST_TERMS:
            raise _TooLong
        names = [f if f.is_Symbol else sympy.Symbol(f"{k}", real=True) for k, f in enumerate(self.factors)]
        total = sympy.Add(*[_term(key, coefficient, names) for key, coefficient in a.items()])
        forms = [total]
        if any(len(angle) > 1 or abs(c) > 1 for _, angle, _ in a for _, c in angle):
            powers = sympy.expand(sympy.expand_trig(total))
            halved = sympy.Add(*[_term(key, c, names, halved=True) for key, c in a.items()])
            forms += [sympy.expand(f) for f in (halved, TR6(halved), TR5(powers), TR6(powers))]
        back = {name: factor for name, factor in zip(names, self.factors, strict=True) if name is not factor}
        forms = [_with_floats(form) for whole in forms for form in (whole, _grouped(whole, [*back]))]
        return [form.xreplace(back) if back else form for form in forms]


_ONE: Sum = {((), (), 0): Fraction(1)}
_LINEAR = {ca.OP_ADD: 1, ca.OP_SUB: -1}
_SCALES = {ca.OP_NEG: -1, ca.OP_TWICE: 2, ca.OP_ASSIGN: 1, ca.OP_LIFT: 1}


def _scaled(a: Sum, by: Any) -> Sum:
    return {key: coefficient * by for key, coefficient in a.items()} if by else {}


def _total(a: Any, b: Any) -> Any:
    """The sum of two dictionaries of coefficients, without those that are 0."""
    total = dict(a)
    for key, coefficient in b.items():
        total[key] = total.get(key, 0) + coefficient
        if not total[key]:
            del total[key]
    return total


def _merged(a: Any, b: Any, sign: int = 1) -> Any:
    """The product of monomials, or the sum of angles."""
    return tuple(sorted(_total(dict(a), {key: sign * n for key, n in b}).items()))


def _harmonic(coefficient: Fraction, monomial: Monomial, angle: Any, is_sine: int) -> Sum:
    """A cosine or sine, of an angle whose first coefficient becomes positive."""
    if angle and angle[0][1] < 0:
        coefficient, angle = coefficient * (-1) ** is_sine, [(m, -c) for m, c in angle]
    if not angle and is_sine:
        return {}
    return {(monomial, tuple(angle), is_sine): coefficient}


def _term(key: tuple[Monomial, Angle, int], coefficient: Fraction, names: list[Any], halved: bool = False) -> Any:
    import sympy

    def product(monomial: Monomial, by: Fraction) -> Any:
        powers = (names[at] ** n for at, n in monomial)
        return sympy.Mul(sympy.Rational(by.numerator, by.denominator), *powers)

    monomial, angle, is_sine = key
    of = sympy.Add(*[product(m, c) for m, c in angle])
    if halved and angle and all(c.denominator == 1 and c % 2 == 0 for _, c in angle):
        half = sympy.Add(*[product(m, c / 2) for m, c in angle])
        wave = 2 * sympy.sin(half) * sympy.cos(half) if is_sine else 1 - 2 * sympy.sin(half) ** 2
    else:
        wave = sympy.sin(of) if is_sine else sympy.cos(of)
    return product(monomial, coefficient) * wave


def _grouped(total: Any, others: list[Any]) -> Any:
    """A sum in which what the same sines, cosines and others multiply is one factor, where it has common symbols."""
    import sympy

    groups: dict[Any, list[Any]] = {}
    for term in sympy.Add.make_args(total):
        coefficient, wave = term.as_independent(sympy.sin, sympy.cos, *others, as_Add=False)
        groups.setdefault(wave, []).append(coefficient)
    terms = []
    for wave, coefficients in groups.items():
        plain = sympy.Add(*coefficients)
        content, rest = plain.primitive()
        common = sympy.factor(rest)
        has_symbols = common.is_Pow or common.is_Mul and any(not (f.is_Number or f.is_Add) for f in common.args)
        terms.append((content * common if has_symbols else plain) * wave)
    return sympy.Add(*terms)


def _with_floats(expression: Any) -> Any:
    """Fractions whose numbers are long as floats."""
    import sympy

    fractions = expression.atoms(sympy.Rational)
    return expression.xreplace({r: rational(Fraction(r.p, r.q)) for r in fractions})
