"""Conversion of numbers, arrays and expressions from users into CasADi SX."""

from typing import Any

import casadi as ca

from symmb._options import numbers_of


def given(value: Any) -> ca.SX | None:
    """SX of a number, an array with at most two axes, a list of numbers and expressions, or an expression; else None.

    CasADi gets only doubles, because it crashes with NumPy's long doubles.
    """
    if isinstance(value, ca.SX | ca.DM):
        return ca.SX(value)
    if isinstance(value, list | tuple) and any(isinstance(entry, ca.SX | ca.DM) for entry in value):
        parts = [given(entry) for entry in value if not isinstance(entry, list | tuple)]
        parts = [part for part in parts if part is not None and part.is_scalar()]
        return ca.vertcat(*parts) if len(parts) == len(value) else None
    array = numbers_of(value)
    # CasADi converts this number of entries within seconds.
    return ca.SX(array) if array is not None and array.ndim <= 2 and array.size <= 10_000_000 else None
