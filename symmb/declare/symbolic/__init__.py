"""Algebra on CasADi SX: symbols, vectors, derivatives, linear systems, and conversion from and to SymPy.

Only the files sympy_in, sympy_out, simplified and printing use SymPy.
"""

from symmb.declare.symbolic.batch import batch, batch_padded, evaluated, nonzeros, pattern, so_far
from symmb.declare.symbolic.common import common, shared
from symmb.declare.symbolic.condition import EXAMPLE, margin_of
from symmb.declare.symbolic.geometry import (
    Z,
    components,
    conjugate,
    has_irregular_constant,
    irregular_part,
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
from symmb.declare.symbolic.given import given
from symmb.declare.symbolic.instructions import interpret, operation_name
from symmb.declare.symbolic.jets import HIGHEST_ORDER, jet_function, jets
from symmb.declare.symbolic.linear import (
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
from symmb.declare.symbolic.nodes import with_nodes
from symmb.declare.symbolic.pickling import reduction
from symmb.declare.symbolic.pieces import Entry, Pieces, Sides, Smooth, applied, called
from symmb.declare.symbolic.printing import plain, printer, set_names, typeset
from symmb.declare.symbolic.ranges import ranges_along
from symmb.declare.symbolic.simplified import simplified
from symmb.declare.symbolic.switching import (
    SOFT,
    Branches,
    On,
    branches,
    has_kinks,
    laws,
    margins,
    switching,
    with_common_expressions,
)
from symmb.declare.symbolic.symbols import (
    Kind,
    Symbol,
    TruthValueError,
    ddt,
    declare,
    is_time,
    lookup,
    rate,
    records_in,
    t,
)
from symmb.declare.symbolic.sympy_in import from_sympy, is_sympy
from symmb.declare.symbolic.sympy_out import to_sympy, with_names
