"""Units of outputs, where the expression shows them."""

import casadi as ca

from symmb.symbolic.symbols import lookup, symbols_in

_UNITS = {"x": "m", "y": "m", "z": "m", "theta": "rad", "vx": "m/s", "vy": "m/s", "vz": "m/s", "omega": "rad/s"}
_UNITS |= {f"omega_{c}": "rad/s" for c in "xyz"}


def unit_of(expression: ca.SX) -> str:
    """Unit of an expression that contains a coordinate or a velocity with the factor 1 or -1, else ''.

    Lengths come before angles: in x + l sin(theta) it is x that tells.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=1.0, inertia=0.1)
    >>> unit_of(rod.point(0, 1).x), unit_of(-rod.omega), unit_of(rod.x**2)
    ('m', 'rad/s', '')
    """
    found = set()
    for symbol in symbols_in(expression):
        record = lookup(symbol)
        factor = ca.simplify(ca.jacobian(expression, symbol))
        if record is not None and factor.is_constant() and abs(float(factor)) == 1:
            found.add(_UNITS.get(record.name.rpartition(".")[2], ""))
    return next((unit for unit in ("m", "m/s", "rad", "rad/s") if unit in found), "")
