"""Algebra on CasADi SX: symbols, vectors, derivatives, linear systems, and conversion from and to SymPy.

Only the files sympy_in, sympy_out, simplified and printing use SymPy.
"""

from symmb._doors import open_door

open_door(__name__)
