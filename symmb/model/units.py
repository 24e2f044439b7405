"""Units of outputs, as far as they follow from the expression."""

import casadi as ca

from symmb.symbolic import lookup, symbols_in

_UNITS = {"x": "m", "y": "m", "z": "m", "theta": "rad", "vx": "m/s", "vy": "m/s", "vz": "m/s", "omega": "rad/s"}
_UNITS |= {f"omega_{c}": "rad/s" for c in "xyz"}
_RATE = ".rate"
"""End of the names of accelerations, which are symbols in outputs only."""


def unit_of(expression: ca.SX) -> str:
    """Unit of an expression with a coordinate, a velocity or an acceleration that has the factor 1 or -1, else ''.

    Lengths have precedence over angles: x + l sin(theta) has the unit of x.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=1.0, inertia=0.1)
    >>> unit_of(rod.point(0, 1).x), unit_of(-rod.omega), unit_of(rod.x**2)
    ('m', 'rad/s', '')
    """
    units = set()
    for symbol in symbols_in(expression):
        record, name = lookup(symbol), symbol.name()
        factor = ca.simplify(ca.jacobian(expression, symbol))
        if factor.is_constant() and abs(float(factor)) == 1:
            if record is not None:
                units.add(_UNITS.get(record.name.rpartition(".")[2], ""))
            elif name.endswith(_RATE):
                units.add(_UNITS.get(name.removesuffix(_RATE).rpartition(".")[2], "") + "^2")
    return next((unit for unit in ("m", "m/s", "m/s^2", "rad", "rad/s", "rad/s^2") if unit in units), "")
