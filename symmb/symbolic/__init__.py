"""Algebra on CasADi SX: symbols, vectors, derivatives, linear systems, and the border to SymPy.

The files sympy_in, sympy_out, simplified and printing are the only ones that know SymPy.
"""

from symmb.symbolic.batch import batch, batch_padded, evaluated, nonzeros, pattern, so_far
from symmb.symbolic.common import common, shared
from symmb.symbolic.condition import EXAMPLE, margin_of
from symmb.symbolic.geometry import (
    Z,
    components,
    conjugate,
    has_irregular_constant,
    is_zero,
    product,
    quaternion_rate,
    rotation_by,
    rotation_matrix,
    rotation_z,
    scalar,
    triad,
    turn,
    unit,
    vector,
    without_rounding,
)
from symmb.symbolic.given import given
from symmb.symbolic.instructions import interpret, operation_name
from symmb.symbolic.jets import HIGHEST_ORDER, jet_function, jets
from symmb.symbolic.linear import (
    ExplicitSolver,
    MassBlocks,
    general_solver,
    independent,
    is_singular,
    least_factorization,
    least_multipliers,
    saddle_solver,
    symmetric_solver,
    vanishing_rows,
)
from symmb.symbolic.nodes import with_nodes
from symmb.symbolic.pickling import reduction
from symmb.symbolic.pieces import Entry, Pieces, Sides, Smooth, applied, called
from symmb.symbolic.printing import plain, printer, set_names, typeset
from symmb.symbolic.ranges import ranges_along
from symmb.symbolic.simplified import simplified
from symmb.symbolic.switching import SOFT, Branches, On, branches, has_kinks, laws, switching, with_common_expressions
from symmb.symbolic.symbols import Kind, Symbol, TruthValueError, ddt, declare, is_time, lookup, rate, symbols_in, t
from symmb.symbolic.sympy_in import from_sympy, is_sympy
from symmb.symbolic.sympy_out import to_sympy, with_names
