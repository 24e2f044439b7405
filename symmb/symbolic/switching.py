"""The parts of an expression that depend on time alone, and where they have kinks or jumps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import casadi as ca

from symmb.symbolic.instructions import interpret

_GUARD = 1e-20
"""Bounds up to this size keep a denominator from vanishing: they are not kinks of the motion."""
_KINKS: dict[int, tuple[str, Callable[..., ca.SX]]] = {
    ca.OP_FABS: ("fabs", lambda a: a),
    ca.OP_SIGN: ("sign", lambda a: a),
    ca.OP_COPYSIGN: ("copysign", lambda a, b: b),
    ca.OP_FMIN: ("fmin", lambda a, b: a - b),
    ca.OP_FMAX: ("fmax", lambda a, b: a - b),
    **dict.fromkeys((ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE), ("comparison", lambda a, b: a - b)),
    ca.OP_FLOOR: ("floor", lambda a: ca.sin(ca.pi * a)),
    ca.OP_CEIL: ("ceil", lambda a: ca.sin(ca.pi * a)),
    ca.OP_FMOD: ("fmod", lambda a, b: ca.sin(ca.pi * a / b)),
}
"""Name of an operation, and what of its arguments changes sign at its kinks or jumps."""


class On(IntEnum):
    """What a value depends on, the most changeable of its parts."""

    PARAMETERS = 0
    TIME = 1
    STATE = 2


@dataclass(frozen=True, eq=False)
class Switching:
    """Where a Function's outputs are not smooth.

    Attributes
    ----------
    kinks : tuple of str   operations with a kink or a jump whose arguments depend on the state or on time
    switches : (m,) SX     what changes sign there
    """

    kinks: tuple[str, ...]
    switches: ca.SX


@dataclass(frozen=True, eq=False)
class _Value:
    sx: ca.SX
    on: On


def switching(f: ca.Function, inputs: Sequence[tuple[ca.SX, On]]) -> Switching:
    """Kinks and jumps of an SX Function at symbols for its inputs.

    Examples
    --------
    >>> x, t = ca.SX.sym("x"), ca.SX.sym("t")
    >>> f = ca.Function("f", [x, t], [ca.fabs(x) * ca.sin(2 * t)])
    >>> switching(f, [(x, On.STATE), (t, On.TIME)]).kinks
    ('fabs',)
    """
    switches: dict[int, ca.SX] = {}
    kinks: set[str] = set()

    def operation(code: int, arguments: tuple[_Value, ...]) -> _Value:
        on = max((a.on for a in arguments), default=On.PARAMETERS)
        if on > On.PARAMETERS and code in _KINKS and not any(_is_guard(a.sx) for a in arguments):
            name, of = _KINKS[code]
            kinks.add(name)
            switch = of(*(a.sx for a in arguments))
            switches.setdefault(switch.element_hash(), switch)
        if len(arguments) == 2:
            return _Value(ca.SX.binary(code, arguments[0].sx, arguments[1].sx), on)
        return _Value(ca.SX.unary(code, arguments[0].sx), on)

    values = [[_Value(e, on) for e in ca.vertsplit(ca.vec(symbols))] for symbols, on in inputs]
    interpret(f, values, operation, lambda number: _Value(ca.SX(number), On.PARAMETERS))
    return Switching(tuple(sorted(kinks)), ca.vertcat(ca.SX(0, 1), *switches.values()))


def laws(expression: ca.SX, p: ca.SX, t: ca.SX) -> ca.SX:
    """(n,) the largest parts that depend on time, and perhaps on parameters, alone; time itself is none.

    Examples
    --------
    >>> x, p, t = (ca.SX.sym(name) for name in "xpt")
    >>> laws(x * ca.sin(p * t) + x * p, p, t)
    SX(sin((p*t)))
    """
    _, _, parts = ca.extract_parametric(expression, ca.vertcat(p, t))
    return ca.vertcat(ca.SX(0, 1), *[part for part in parts if ca.depends_on(part, t)])


def _is_guard(value: ca.SX) -> bool:
    return value.is_constant() and 0 < abs(float(value)) <= _GUARD
