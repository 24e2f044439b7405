"""Legendre and Chebyshev polynomials of several variables, and expansions in them.

The ranges of expansions over the box are in `polynomials.ranges`.
"""

from symmb._doors import open_door

open_door(__name__)
