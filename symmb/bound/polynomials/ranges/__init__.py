"""Ranges of many polynomials over the unit box: exact, Bernstein, or by interval arithmetic.

The compiled parts are in codegen/c.
"""

from symmb._doors import open_door

open_door(__name__)
