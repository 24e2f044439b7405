"""Kinks and jumps of expressions, the branches on each side, and the parts that depend on time only."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from typing import Any, Generic, NamedTuple, TypeVar, cast

import casadi as ca

from symmb.declare.symbolic.common import common
from symmb.declare.symbolic.instructions import ENTRY, Instructions, instructions, interpret
from symmb.declare.symbolic.pieces import Entry, Pieces, Sides, applied

T = TypeVar("T")

SOFT = 1e-300
"""A comparison a < -SOFT is soft: the value and the slope are continuous there, so steps need not end there."""
_KINKS: dict[Any, tuple[str, Callable[..., ca.SX]]] = {
    ca.OP_FABS: ("fabs", lambda a: a),
    ca.OP_SIGN: ("sign", lambda a: a),
    ca.OP_COPYSIGN: ("copysign", lambda a, b: b),
    ca.OP_FMIN: ("fmin", lambda a, b: a - b),
    ca.OP_FMAX: ("fmax", lambda a, b: a - b),
    **dict.fromkeys((ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE), ("comparison", lambda a, b: a - b)),
    ca.OP_FLOOR: ("floor", lambda a: ca.sin(ca.pi * a)),
    ca.OP_CEIL: ("ceil", lambda a: ca.sin(-ca.pi * a)),
    ca.OP_FMOD: ("fmod", lambda a, b: ca.sin(ca.pi * a / b)),
    ca.OP_REMAINDER: ("remainder", lambda a, b: ca.cos(ca.pi * a / b)),
}
"""Name of an operation, and the expression of its arguments that changes sign at a kink or jump."""


def _whole(side: ca.SX, value: ca.SX) -> ca.SX:
    """floor(value) for a given sign of sin(pi value): the nearest even or odd number, valid 0.5 beyond it."""
    odd = (1 - side) / 2
    return 2 * ca.floor((value - odd + 0.5) / 2) + odd


def _fmod(side: ca.SX, a: ca.SX, b: ca.SX) -> ca.SX:
    whole = _whole(side, a / b)
    return a - b * (whole + (whole < 0))  # the quotient is rounded towards 0


_ON_A_SIDE: dict[Any, Callable[..., ca.SX]] = {
    ca.OP_FABS: lambda side, a: side * a,
    ca.OP_SIGN: lambda side, a: side,
    ca.OP_COPYSIGN: lambda side, a, b: side * ca.fabs(a),
    ca.OP_FMIN: lambda side, a, b: ca.if_else(side < 0, a, b),
    ca.OP_FMAX: lambda side, a, b: ca.if_else(side > 0, a, b),
    **dict.fromkeys((ca.OP_LT, ca.OP_LE), lambda side, a, b: side < 0),
    ca.OP_FLOOR: _whole,
    ca.OP_CEIL: lambda side, a: -_whole(side, -a),
    ca.OP_FMOD: _fmod,
    ca.OP_REMAINDER: lambda side, a, b: a - b * _whole(side, a / b + 0.5),
}
"""The value of an operation on one side of its switch. Steps do not end at other switches, such as equality."""
_FRONTS = {ca.OP_EXP, ca.OP_TANH, ca.OP_ERF, ca.OP_COSH}
"""Operations with fronts: they change only in a short interval of their argument, near 0.

An exponential also changes near the largest value of its argument. Products and differences of fronts make pulses."""
_LEVELS = (-40.0, -10.0, -1.0, 1.0, 10.0, 40.0)
"""Arguments at which fronts start, are steep, and end: exp(-40) = 4e-18 is a rounding error. 0 is not used, because
an argument such as -x**2 does not change its sign there.

A motion may turn back on either flank. With fewer levels, a long step could skip both passes of a level."""
_STEEP = 8
"""Lowest exponent of a power with a front. If the base decreases by 9 % from its largest value, the power is halved.
Without such fronts, steps would be longer than a pulse of cos(angle)**50."""
_POSITIVE = {ca.OP_SQRT, ca.OP_LOG, ca.OP_POW, ca.OP_CONSTPOW}
"""Operations that are not defined for negative numbers (powers only if the exponent is not whole)."""


class On(IntEnum):
    """What a value depends on: parameters only, time but not the state, or the state."""

    PARAMETERS = 0
    TIME = 1
    STATE = 2


@dataclass(frozen=True, eq=False)
class Switching:
    """The kinks and jumps of a Function's outputs."""

    kinks: tuple[str, ...]  # operations with a kink or jump in arguments that depend on the state or time
    switches: ca.SX  # (m,), expressions that change sign at kinks and jumps
    located: tuple[bool, ...]  # (m,), whether `branches` makes it a switch at which steps end


class _Value(NamedTuple):
    sx: ca.SX
    on: On
    is_power: bool = False  # whether it is a known power of another value


def switching(f: ca.Function, inputs: Sequence[tuple[ca.SX, On]]) -> Switching:
    """Kinks and jumps of an SX Function, with symbols for its inputs.

    Examples
    --------
    >>> x, t = ca.SX.sym("x"), ca.SX.sym("t")
    >>> f = ca.Function("f", [x, t], [ca.fabs(x) * ca.sin(2 * t)])
    >>> switching(f, [(x, On.STATE), (t, On.TIME)]).kinks
    ('fabs',)
    """
    switches: dict[int, ca.SX] = {}
    located: dict[int, bool] = {}
    kinks: set[str] = set()

    def operation(code: Any, arguments: tuple[_Value, ...]) -> _Value:
        on = max((a.on for a in arguments), default=On.PARAMETERS)
        is_kink = code in _KINKS and not any(_is_guard(a.sx) or is_soft(a.sx) for a in arguments)
        if on > On.PARAMETERS and is_kink:
            name, of = _KINKS[code]
            kinks.add(name)
            switch = of(*(a.sx for a in arguments))
            key = switch.element_hash()
            switches.setdefault(key, switch)
            located[key] = located.get(key, False) or code in _ON_A_SIDE
        if on > On.PARAMETERS and isinstance(code, Entry) and type(code.pieces) in (Pieces, Sides):
            kinks.add("table")
            sides = code.pieces if isinstance(code.pieces, Sides) else code.pieces.sided[0]
            switch = sides.wave(arguments[1].sx)
            switches[switch.element_hash()], located[switch.element_hash()] = switch, sides is code.pieces
        return _Value(applied(code, *(a.sx for a in arguments)), on)

    values = [[_Value(e, on) for e in ca.vertsplit(ca.vec(symbols))] for symbols, on in inputs]
    interpret(f, values, operation, lambda number: _Value(ca.SX(number), On.PARAMETERS))
    return Switching(tuple(sorted(kinks)), ca.vertcat(ca.SX(0, 1), *switches.values()), tuple(located.values()))


def margins(f: ca.Function, symbols: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Margins (m,) that change sign where an operation of a Function of some symbols has a kink or a jump.

    Comparisons that `logic_and`, `logic_or` and `logic_not` combine have one margin. The second part are values (k,) of
    products, minima and maxima of several values with kinks, such as a force that acts if several gaps are closed.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> margins(ca.Function("f", [x], [ca.if_else(ca.logic_and(x < 2, 1 < x), 5, 0)]), x)[0]
    SX(fmax((x-2),(1-x)))
    >>> margins(ca.Function("f", [x], [ca.fmax(x - 1, 0) * ca.fmax(2 - x, 0)]), x)[1]
    SX(@1=0, (fmax((x-1),@1)*fmax((2-x),@1)))
    """
    single, joint = dict[int, ca.SX](), dict[int, ca.SX]()

    def add(values: Iterable[_Pending]) -> None:
        single.update({a.margin.element_hash(): a.margin for a in values if a.margin is not None})

    def operation(code: Any, of: tuple[_Pending, ...]) -> _Pending:
        arguments, is_bent = [a.sx for a in of], any(a.is_bent for a in of)
        value, is_kink = applied(code, *arguments), not any(_is_guard(a) or is_soft(a) for a in arguments)
        is_comparison = code in (ca.OP_LT, ca.OP_LE)
        if is_comparison and any(a.is_constant() and math.isinf(float(a)) for a in arguments):
            return _Pending(value)  # whether a value is finite
        if code in _OF_MARGINS and all(a.is_condition for a in of):
            return _Pending(value, _OF_MARGINS[code](*(cast(ca.SX, a.margin) for a in of)), True, True)
        add(of)
        if is_bent and code in _JOINING and not any(a.is_constant() for a in arguments if code == ca.OP_MUL):
            joint[value.element_hash()] = value
        margin = _KINKS[code][1](*arguments) if code in _KINKS and is_kink else None
        return _Pending(value, margin, is_comparison and is_kink, is_bent or margin is not None)

    of_symbols = [_Pending(e) for e in ca.vertsplit(symbols)]
    for part in interpret(f, [of_symbols], operation, lambda number: _Pending(ca.SX(number))):
        add(part)
    return ca.vertcat(ca.SX(0, 1), *single.values()), ca.vertcat(ca.SX(0, 1), *reversed(joint.values()))


@dataclass(frozen=True, eq=False)
class _Pending:
    """A value of an operation, and its margin, which counts if another operation uses the value."""

    sx: ca.SX
    margin: ca.SX | None = None
    is_condition: bool = False  # true where the margin is negative
    is_bent: bool = False  # whether it contains a kink or a jump


_JOINING = {ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX, ca.OP_IF_ELSE_ZERO}
"""Operations that are 0, or the same, unless several conditions hold."""
_OF_MARGINS: dict[Any, Callable[..., ca.SX]] = {ca.OP_AND: ca.fmax, ca.OP_OR: ca.fmin, ca.OP_NOT: lambda a: -a}
"""The margin of an operation on conditions, from their margins."""


@dataclass(frozen=True, eq=False)
class Branches:
    """A Function in which kinks and jumps of the state are replaced by the branch on one side of each switch.

    All evaluations in a step use the same branch, even beyond the switch, so steps are smooth.
    """

    outputs: list[ca.SX]  # the Function's outputs on these branches
    sides: ca.SX  # (m,) symbols, 1 where a switch is above 0 and -1 where it is below
    switches: ca.SX  # (m,), expressions of the switches on these branches
    times: ca.SX  # (k,), change sign at kinks, jumps and fronts that depend on time and parameters only
    fronts: ca.SX  # (l,), change sign at smooth fronts that depend on the state
    exponents: ca.SX  # (e,), exponents and bases of powers: their rates also change sign at smooth fronts
    knots: list[tuple[ca.SX, Pieces]]  # time-dependent arguments of tables, and the pieces of the tables


_BENT = _KINKS.keys() | _FRONTS


@lru_cache(maxsize=256)
def has_kinks(f: ca.Function) -> bool:
    """Whether an SX Function has operations with a kink, a jump or a front in any argument."""
    if any(map(_BENT.__contains__, map(f.instruction_id, range(f.n_instructions())))):
        return True
    own = instructions(f)
    return ENTRY in own.codes or _has_steep_power(own)


def _has_steep_power(own: Instructions) -> bool:
    known: dict[int, _Power[int]] = {}  # powers by row
    for k, (code, *places) in enumerate(own.rows()):
        if code in _POWERS:
            places = places[: 1 if code == ca.OP_SQ else 2]
            of = [known.get(i, _Power(i, 1.0)) for i in places]
            power = _power(code, of, own.data.get(places[-1]) if own.codes[places[-1]] == ca.OP_CONST else None)
            if power is not None and power.exponent >= _STEEP:
                return True
            if power is not None:
                known[k] = power
    return False


class _Power(NamedTuple, Generic[T]):
    """A power. `base` identifies the base."""

    base: T
    exponent: float


_POWERS = {ca.OP_SQ, ca.OP_MUL, ca.OP_POW, ca.OP_CONSTPOW}
"""Operations that make powers. CasADi writes integer powers as squares and products."""


def _power(code: Any, of: Sequence[_Power[T]], constant: float | None) -> _Power[T] | None:
    """An operation of `_POWERS` as a power; None for other operations. The exponent of `pow` may be constant."""
    base, exponent = of[0]
    if code == ca.OP_MUL:
        return _Power(base, exponent + of[1].exponent) if base == of[1].base else None
    if code == ca.OP_SQ:
        return _Power(base, 2 * exponent)
    return _Power(base, math.inf if constant is None else exponent * abs(constant))


def with_common_expressions(f: ca.Function) -> ca.Function:
    """An SX Function with the same values, in which equal expressions are evaluated once."""
    inputs = f.sx_in()
    return common(f.name(), inputs, f.call(inputs), f.name_in(), f.name_out())


def branches(f: ca.Function, inputs: Sequence[tuple[ca.SX, On]]) -> Branches:
    """The branches of an SX Function, with symbols for its inputs.

    If a switch keeps the argument of a root, logarithm or power positive, the operation is continued beyond the switch:
    sqrt(a) becomes sqrt(|a|).

    Examples
    --------
    >>> x, t = ca.SX.sym("x"), ca.SX.sym("t")
    >>> f = ca.Function("f", [x, t], [ca.fmax(x, 0) + ca.fabs(t - 1)])
    >>> branches(f, [(x, On.STATE), (t, On.TIME)]).switches
    SX(x)
    """
    found = _Found(next((symbols for symbols, on in inputs if on is On.TIME), ca.SX(0, 1)))
    values = [[_Value(e, on) for e in ca.vertsplit(ca.vec(symbols))] for symbols, on in inputs]
    parts = interpret(f, values, found.operation, lambda number: _Value(ca.SX(number), On.PARAMETERS))
    found.add_fronts_of_powers()
    pairs = list(found.switches.values())
    return Branches(
        [ca.vertcat(ca.SX(0, 1), *(value.sx for value in part)) for part in parts],
        ca.vertcat(ca.SX(0, 1), *(symbol for _, symbol in pairs)),
        ca.vertcat(ca.SX(0, 1), *(switch for switch, _ in pairs)),
        *(ca.vertcat(ca.SX(0, 1), *group.values()) for group in (found.times, found.fronts, found.exponents)),
        knots=list(found.knots.values()),
    )


@dataclass(eq=False)
class _Found:
    """The kinks, jumps, fronts and powers in the operations of a Function. Keys are hashes of expressions."""

    t: ca.SX
    switches: dict[tuple[int, int], tuple[ca.SX, ca.SX]] = field(default_factory=dict)
    times: dict[tuple[int, float], ca.SX] = field(default_factory=dict)
    fronts: dict[tuple[int, float], ca.SX] = field(default_factory=dict)
    exponents: dict[int, ca.SX] = field(default_factory=dict)
    powers: dict[int, _Power[int]] = field(default_factory=dict)  # powers by their own hash
    steepest: dict[int, tuple[ca.SX, float]] = field(default_factory=dict)  # base, largest exponent
    knots: dict[tuple[int, str], tuple[ca.SX, Pieces]] = field(default_factory=dict)

    def operation(self, code: Any, arguments: tuple[_Value, ...]) -> _Value:
        """The value of an operation on one side of its switches."""
        on = max([a.on for a in arguments], default=On.PARAMETERS)
        of = tuple([a.sx for a in arguments])
        is_switch = code in _KINKS and not any(_is_guard(a) or is_soft(a) for a in of)
        if on is On.TIME:
            self._note_times(code, of, is_switch)
        if on is not On.STATE:
            return _Value(applied(code, *of), on)
        if code in _FRONTS:
            self.fronts.update(_levels(of[0]))
            if code == ca.OP_EXP:
                self.exponents.setdefault(of[0].element_hash(), of[0])
        value = self._entry(code, *of) if isinstance(code, Entry) else None
        if is_switch and code in _ON_A_SIDE:
            value = _ON_A_SIDE[code](self._side(_KINKS[code][1](*of)), *of)
        if value is not None:
            return _Value(value, on)
        if code in _POSITIVE and (code != ca.OP_CONSTPOW or float(of[1]) % 1):
            of = (ca.fabs(of[0]), *of[1:])  # continued beyond switches that keep the argument positive
        value = applied(code, *of)
        is_product = code == ca.OP_MUL and not (arguments[0].is_power or arguments[1].is_power)
        if code not in _POWERS or (is_product and of[0].element_hash() != of[1].element_hash()):
            return _Value(value, on)
        self._note_power(code, of, value)
        return _Value(value, on, is_power=True)

    def add_fronts_of_powers(self) -> None:
        """Add the fronts of steep powers. All operations must be known."""
        for key, (base, exponent) in self.steepest.items():
            if exponent >= _STEEP:
                self.exponents[key] = base
                levels = [math.exp(level / exponent) for level in _LEVELS if level < 0 and math.isfinite(exponent)]
                self.fronts.update({(key, level): ca.fabs(base) - level for level in levels})

    def _side(self, switch: ca.SX) -> ca.SX:
        a, b = _difference(switch)
        # a - b and b - a are one switch. Two switches would change their sides at the same time in two events.
        if (b, a) in self.switches:
            return -self.switches[b, a][1]
        if (a, b) not in self.switches:
            self.switches[a, b] = switch, ca.SX.sym(f"side_{len(self.switches)}")
        return self.switches[a, b][1]

    def _note_times(self, code: Any, of: tuple[ca.SX, ...], is_switch: bool) -> None:
        if is_switch:
            switch = _KINKS[code][1](*of)
            self.times.setdefault((switch.element_hash(), 0.0), switch)
        if isinstance(code, Entry):
            self.knots[of[1].element_hash(), code.pieces.name] = of[1], code.pieces
        if code in _FRONTS:
            self.times.update(_levels(of[0]))
            if code == ca.OP_EXP and ca.depends_on(rate := ca.jacobian(of[0], self.t), self.t):
                self.times[rate.element_hash(), 0.0] = rate

    def _entry(self, entry: Entry, group: ca.SX, at: ca.SX) -> ca.SX | None:
        """An entry of a table on the piece that the sides of its switches select; None for a table without switches."""
        pieces = entry.pieces
        if isinstance(pieces, Sides):
            return pieces.on_side(self._side(pieces.wave(at)), at)
        if type(pieces) is not Pieces or not group.is_constant():
            return None
        sides, coefficients = pieces.sided
        return coefficients(sides.on_side(self._side(sides.wave(at)), at), at)[entry.column]

    def _note_power(self, code: Any, of: tuple[ca.SX, ...], value: ca.SX) -> None:
        of_powers = [self.powers.get(a.element_hash(), _Power(a.element_hash(), 1.0)) for a in of]
        power = _power(code, of_powers, float(of[-1]) if of[-1].is_constant() else None)
        if power is not None:
            self.powers[value.element_hash()] = power
            base = self.steepest[power.base][0] if power.base in self.steepest else of[0]
            self.steepest[power.base] = base, power.exponent


def _levels(argument: ca.SX) -> dict[tuple[int, float], ca.SX]:
    return {(argument.element_hash(), level): argument - level for level in _LEVELS}


def laws(expression: ca.SX, p: ca.SX, t: ca.SX) -> ca.SX:
    """Largest parts (n,) of an expression that depend only on time, or on time and parameters, except time itself.

    Examples
    --------
    >>> x, p, t = (ca.SX.sym(name) for name in "xpt")
    >>> laws(x * ca.sin(p * t) + x * p, p, t)
    SX(sin((p*t)))
    """
    _, _, parts = ca.extract_parametric(expression, ca.vertcat(p, t))
    return ca.vertcat(ca.SX(0, 1), *[part for part in parts if ca.depends_on(part, t)])


def _difference(value: ca.SX) -> tuple[int, int]:
    """Hashes of a and b in a - b, 0 for a missing operand. For b - a the order is reversed."""
    if value.is_op(ca.OP_SUB):
        return value.dep(0).element_hash(), value.dep(1).element_hash()
    return (0, value.dep(0).element_hash()) if value.is_op(ca.OP_NEG) else (value.element_hash(), 0)


def _is_guard(value: ca.SX) -> bool:
    return value.is_constant() and SOFT < abs(float(value)) <= 1e-20  # larger bounds are kinks of the motion


def is_soft(value: ca.SX) -> bool:
    """Whether a value marks a soft comparison, at which neither the expression nor its slope jumps."""
    return value.is_constant() and abs(float(value)) == SOFT
