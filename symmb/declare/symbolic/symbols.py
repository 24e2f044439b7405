"""The table of symbols: the kind and the rate of every coordinate, velocity, state and parameter.

A CasADi symbol has only a name. The owner of a symbol (a body, a joint, the parameters) keeps a `Symbol` record with
its kind and rate. The table has weak references to the records, so a record does not outlive its model.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from weakref import WeakKeyDictionary, WeakValueDictionary

import casadi as ca

from symmb._errors import DeclarationError
from symmb._names import normal
from symmb._options import shown
from symmb.declare.symbolic.given import given

if ca.GlobalOptions.getNumpyMode() == 0:
    ca.GlobalOptions.setNumpyMode(-1)  # NumPy's functions take expressions without a notice

_casadi_bool = ca.SX.__bool__


class TruthValueError(DeclarationError, RuntimeError):
    """Error if Python needs the truth value of a symbolic expression: also a RuntimeError, as in CasADi."""


def _truth_value(expression: ca.SX) -> bool:
    try:
        return _casadi_bool(expression)
    except RuntimeError:
        raise TruthValueError(
            f"Python's if, and, or, max and min cannot decide whether {str(expression)[:80]} is true, because it is an "
            "expression. Write casadi.if_else, logic_and, logic_or, fmax or fmin."
        ) from None


# The class itself is patched, because laws such as `1.0 if mb.t > 1 else 0.0` are evaluated before symmb gets them.
ca.SX.__bool__ = _truth_value  # pyright: ignore[reportAttributeAccessIssue]

t = ca.SX.sym("t")
"""Time [s], the independent variable of all laws."""


class Kind(Enum):
    """The kind of quantity that a symbol represents."""

    COORDINATE = "coordinate"
    VELOCITY = "velocity"
    STATE = "first-order state"
    PARAMETER = "parameter"


@dataclass(frozen=True, eq=False)
class Symbol:
    """A declared symbol: dotted name, kind, rate of a variable, and start `value` of a state.

    Fields without a meaning for the kind are empty. `owner` is the name of the element that must be in the System. A
    state without owner belongs to each system that uses it in an expression.
    """

    name: str
    kind: Kind
    sx: ca.SX
    rate: ca.SX = field(default_factory=ca.SX)
    value: ca.SX = field(default_factory=ca.SX)
    owner: str = ""

    @property
    def resting(self) -> float:
        """The start value of a state if it is a number, else 0."""
        return float(self.value) if self.value.is_constant() else 0.0

    def __reduce__(self) -> tuple[Callable[..., "Symbol"], tuple[object, ...]]:
        return _entered, (self.name, self.kind, self.sx, self.rate, self.value, self.owner)


_TABLE: WeakValueDictionary[int, Symbol] = WeakValueDictionary()
_STARTS: WeakKeyDictionary[Symbol, list[Symbol]] = WeakKeyDictionary()
"""Records of `initial` values. A record lives as long as a coordinate in its expression."""


def _entered(name: str, kind: Kind, sx: ca.SX, rate: ca.SX, value: ca.SX, owner: str) -> Symbol:
    """The record of a symbol that was unpickled or copied. A symbol in use keeps its record."""
    known = _TABLE.get(sx.element_hash())
    if known is not None:
        return known
    record = _TABLE[sx.element_hash()] = Symbol(name, kind, sx, rate, value, owner)
    return record


def declare(
    names: Iterable[str],
    kind: Kind,
    symbols: ca.SX,
    rates: ca.SX | None = None,
    value: ca.SX | None = None,
    owner: str = "",
) -> tuple[Symbol, ...]:
    """Enter symbols into the table, and return their records. The caller must keep the records alive."""
    records = tuple(
        Symbol(
            normal(name),
            kind,
            symbols[i],
            ca.SX() if rates is None else rates[i],
            ca.SX() if value is None else value[i],
            owner,
        )
        for i, name in enumerate(names)
    )
    for record in records:
        _TABLE[record.sx.element_hash()] = record
    return records


def lookup(symbol: ca.SX) -> Symbol | None:
    """The record of a symbol; None for a symbol that was not declared."""
    return _TABLE.get(symbol.element_hash())


def is_time(symbol: ca.SX) -> bool:
    """Whether a symbol is the time `t`."""
    return symbol.element_hash() == t.element_hash()


def initial(expression: ca.SX) -> ca.SX:
    """Value of a position expression at the start of a run. The value is a first-order state without rate.

    The start of a scene is often computed, for example as an equilibrium. `x - initial(x)` is the displacement since
    the start.

    Parameters
    ----------
    expression : SX of any shape, in coordinates and parameters [unit]

    Returns
    -------
    SX of the same shape [unit]

    Raises
    ------
    DeclarationError
        if the expression contains a velocity, a multiplier or `t`, or contains no coordinate

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", mass=1.0, pose=mb.Particle())
    >>> block.x - mb.initial(block.x)
    SX((block.x-initial))
    """
    value = given(expression)
    if value is None:
        raise DeclarationError(f"initial: {expression!r} is not a CasADi SX expression.")
    expression = ca.densify(value)
    records = [lookup(symbol) for symbol in ca.symvar(expression)]
    moving = [r for r in records if r is not None and r.kind is Kind.COORDINATE]
    if not moving or any(r is None or r.kind not in (Kind.COORDINATE, Kind.PARAMETER) for r in records):
        raise DeclarationError(
            f"initial: {expression} must consist of coordinates and parameters only. "
            "List the start values of velocities in start."
        )
    values = _STARTS.setdefault(moving[0], [])
    state = ca.SX.sym("initial", *expression.shape)
    names = [s.name() for s in ca.vertsplit(ca.vec(state))]
    values += declare(names, Kind.STATE, ca.vec(state), ca.SX.zeros(state.numel(), 1), ca.vec(expression))
    return state


def records_in(expression: ca.SX, *kinds: Kind) -> list[Symbol]:
    """The records of the declared symbols in an expression. `kinds` selects some kinds; the default is all kinds."""
    records = map(lookup, ca.symvar(expression))
    return [record for record in records if record is not None and record.kind in (kinds or Kind)]


def ddt(expression: ca.SX) -> ca.SX:
    """Rate of a position expression, d/dt f(q, t) = f_q N v + f_t.

    Parameters
    ----------
    expression : SX of any shape, in coordinates, first-order states, parameters and `t` [unit]

    Returns
    -------
    SX of the same shape, in coordinates, velocities, parameters and `t` [unit/s]

    Raises
    ------
    DeclarationError
        if the expression contains a velocity or a multiplier: its rate needs the equations of motion

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=1.0, inertia=0.1)
    >>> mb.ddt(rod.x ** 2)
    SX(((2.*rod.x)*rod.vx))
    """
    return rate(expression, {})


def rate(expression: ca.SX, accelerations: Mapping[int, ca.SX]) -> ca.SX:
    """The result of `ddt`, also for velocities. `accelerations` are the rates of velocities by hashes of velocities."""
    value = given(expression)
    if value is None or (value.is_constant() and not value.is_regular()):
        raise DeclarationError(f"ddt: expected a finite number or CasADi SX, got {shown(expression)}.")
    expression, moving, rates = value, [t], [ca.SX(1)]
    for symbol in ca.symvar(expression):
        record = lookup(symbol)
        if record is None or record.kind is Kind.PARAMETER:
            continue
        known = accelerations.get(symbol.element_hash(), record.rate)
        if known.is_empty():
            late = record.kind is Kind.STATE
            why = "names elements that are declared later" if late else "follows from the equations of motion"
            raise DeclarationError(
                f"ddt: expected an expression of positions, but {record.name!r} is a {record.kind.value}. Its rate "
                f"{why}. For outputs, use system.ddt(...)."
            )
        moving.append(record.sx)
        rates.append(known)
    return ca.jtimes(expression, ca.vertcat(*moving), ca.vertcat(*rates))
