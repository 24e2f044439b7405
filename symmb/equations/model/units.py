"""Units of outputs, as far as they follow from the expressions."""

from collections.abc import Sequence
from fractions import Fraction

import casadi as ca

from symmb._units import unit_of, units_of_parameters
from symmb.declare.mechanics import ForceElement, Joint, OwnState
from symmb.declare.symbolic import Kind, interpret, is_time, lookup
from symmb.equations.model.system import System

Unit = tuple[Fraction, ...]
"""Powers of m, kg, s and rad."""


def _unit(text: str) -> Unit:
    return tuple(map(Fraction, unit_of("units", text).powers[:4]))


_TEXTS = {
    _unit(text): text
    for text in "m,m/s,m/s^2,rad,rad/s,rad/s^2,s,m^2,m^3,m^2/s^2,N,N/m,N m,W".split(",")  # units of outputs
}
_NONE, _TIME, _ANGLE, _LENGTH = _unit(""), _unit("s"), _unit("rad"), _unit("m")
_SPEED, _SPIN = _unit("m/s"), _unit("rad/s")
_POSITION = {"x": _LENGTH, "y": _LENGTH, "z": _LENGTH, "theta": _ANGLE, "angle": _ANGLE}
_VELOCITY = {
    name: _SPIN if name.startswith("o") else _SPEED for name in "vx vy vz omega omega_x omega_y omega_z".split()
}
_HANDLES = {"angle_rate": _SPIN, "displacement": _LENGTH, "displacement_rate": _SPEED}
"""Handles of joints. Their units do not follow from their expressions, because axes are numbers without a unit."""
_RATE = ".rate"
"""Suffix of the names of accelerations. Accelerations are symbols in outputs only."""
_FORCE, _ENERGY, _POWER = _unit("N"), _unit("N m"), _unit("W")
_SAME = frozenset((ca.OP_NEG, ca.OP_FABS, ca.OP_ASSIGN, ca.OP_COPYSIGN, ca.OP_FMOD))
_SUM = frozenset((ca.OP_ADD, ca.OP_SUB, ca.OP_FMIN, ca.OP_FMAX, ca.OP_HYPOT))
_ANGLES = frozenset((ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN, ca.OP_ATAN2))


def units_of(system: System, y: ca.SX) -> tuple[str, ...]:
    """Units of expressions (n_y,) of a system, '' for unknown units.

    Coordinates, velocities, accelerations, handles of joints, multipliers and the time have units. Parameters may have
    units. The units of sums, differences, products, powers and roots are computed. Numbers and parameters without a
    unit may have any unit, so the unit of a product with such a factor is unknown. All terms of a sum have the unit of
    the terms with a known unit. Lengths have precedence over angles: x + l sin(theta) has the unit of x.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=1.0, inertia=0.1)
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-0.5, 0))
    >>> system = mb.System(rod, hinge)
    >>> units_of(system, ca.vertcat(rod.point(0.5, 0).vx, rod.x**2, 1000 * rod.x, system.reaction("hinge").fx))
    ('m/s', 'm^2', '', 'N')
    """
    hashes = {symbol.element_hash() for symbol in ca.symvar(y)}
    known: dict[int, Unit | None] = {}
    n_c, rows = system.Phi.numel(), ca.vertcat(system.Phi, system.Psi)
    for i, multiplier in enumerate(ca.vertsplit(ca.SX(system.lam)) if rows.numel() else ()):
        if multiplier.element_hash() in hashes:  # the product of a multiplier and its row is an energy or a power
            (unit,) = _worked_out(rows[i], {})
            known[multiplier.element_hash()] = _product(_ENERGY if i < n_c else _POWER, unit, -1) if unit else None
    handles = [*_of_parameters(system), *_handles(system), *_forces(system, y)]
    laws = {element.name: law for element, law in system.collected.sampled}
    for state in (e for e in system.elements if isinstance(e, OwnState)):
        if state.value.element_hash() in hashes:
            law = laws.get(state.name)
            (unit,) = _worked_out(ca.SX(state.symbols[0].rate if law is None else law), {}, handles)
            known[state.value.element_hash()] = unit if unit is None or law is not None else _product(unit, _TIME)
    return tuple(_TEXTS.get(unit, "") if unit else "" for unit in _worked_out(y, known, handles))


def _of_parameters(system: System) -> list[tuple[ca.SX, Unit]]:
    """The parameters with mechanical units, each with its symbol."""
    p, units = system.parameters, units_of_parameters(system.parameters)
    mechanical = (name for name, text in units.items() if not any(unit_of(name, text).powers[4:]))
    known = ((name, _product(_unit(units[name]), _NONE)) for name in mechanical)
    return [(getattr(p, name), unit) for name, unit in known if unit]


def _handles(system: System) -> list[tuple[ca.SX, Unit]]:
    """The handles of joints that expressions may contain, with their units. A handle exists after its first use."""
    joints = [e for e in system.elements if isinstance(e, Joint)]
    return [(vars(j)[name], unit) for j in joints for name, unit in _HANDLES.items() if name in vars(j)]


def _forces(system: System, y: ca.SX) -> list[tuple[ca.SX, Unit]]:
    """Forces of elements among expressions (n_y,), with their units. Stiffnesses in the laws may have no unit."""
    forces, whole = system.collected.forces, {entry.element_hash() for entry in ca.vertsplit(ca.SX(y))}
    torques = {e.name for e in system.elements if isinstance(e, ForceElement) and e.turns}
    return [
        (force, _ENERGY if name in torques else _FORCE)
        for name, force in forces.items()
        if force is not None and force.element_hash() in whole
    ]


def _worked_out(y: ca.SX, known: dict[int, Unit | None], parts: Sequence[tuple[ca.SX, Unit]] = ()) -> list[Unit | None]:
    """Units of expressions (n,), None for unknown units.

    `known` has units of symbols by their hashes, and `parts` has units of parts of the expressions.
    """
    if not ca.symvar(y):
        return [None] * y.numel()
    expressions = [*(part for part, _ in parts), ca.densify(y)]
    symbols = ca.symvar(ca.vertcat(*expressions))
    f = ca.Function("y", [ca.vertcat(*symbols)], expressions)
    units = [known[s.element_hash()] if s.element_hash() in known else _of_symbol(s) for s in symbols]
    return interpret(f, [units], _operation, _literal, dict(enumerate(unit for _, unit in parts)))[-1]


def _of_symbol(symbol: ca.SX) -> Unit | None:
    record, name = lookup(symbol), symbol.name()
    if is_time(symbol):
        return _TIME
    if record is None:
        rate = _VELOCITY.get(name.removesuffix(_RATE).rpartition(".")[2]) if name.endswith(_RATE) else None
        return _product(rate, _TIME, -1) if rate else None
    if record.kind is Kind.COORDINATE:
        return _POSITION.get(record.name.rpartition(".")[2])
    if record.kind is Kind.VELOCITY:
        return _VELOCITY.get(record.name.rpartition(".")[2])
    if record.kind is Kind.STATE and record.value.numel():
        return _worked_out(record.value, {})[0]
    return None


def _literal(value: float) -> None:
    """None, because a number may have any unit."""


def _operation(code: int, arguments: Sequence[Unit | None]) -> Unit | None:
    first, second = (*arguments, None, None)[:2]
    if code in _SUM:
        return _sum(first, second)
    if code in _SAME:
        return first
    if code == ca.OP_IF_ELSE_ZERO:
        return second
    if code in _ANGLES:
        return _ANGLE
    if first and code == ca.OP_SQ:
        return _product(first, first)
    if first and code == ca.OP_SQRT:
        return tuple(power / 2 for power in first)
    if first and second and code in (ca.OP_MUL, ca.OP_DIV):
        return _product(first, second, 1 if code == ca.OP_MUL else -1)
    return None


def _sum(first: Unit | None, second: Unit | None) -> Unit | None:
    if not first or not second or first == second:
        return first or second
    straight = [unit for unit in (first, second) if not unit[3]]  # x + l sin(theta) with l = 1 is a length
    return straight[0] if len(straight) == 1 else None


def _product(first: Unit, second: Unit, sign: int = 1) -> Unit | None:
    """The unit of a product or a quotient. An angle times a length is a length. A ratio of equal units is unknown."""
    unit = tuple(a + sign * b for a, b in zip(first, second, strict=True))
    if unit[0]:
        unit = (*unit[:3], Fraction(0))
    return unit if any(unit) else None
