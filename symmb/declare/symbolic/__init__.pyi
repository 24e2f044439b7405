"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .batch import (
    batch as batch,
    batch_padded as batch_padded,
    evaluated as evaluated,
    nonzeros as nonzeros,
    pattern as pattern,
    so_far as so_far,
)
from .common import common as common, shared as shared
from .condition import EXAMPLE as EXAMPLE, margin_of as margin_of
from .geometry import (
    Z as Z,
    components as components,
    conjugate as conjugate,
    has_irregular_constant as has_irregular_constant,
    irregular_part as irregular_part,
    is_zero as is_zero,
    product as product,
    quaternion_rate as quaternion_rate,
    rotation_by as rotation_by,
    rotation_matrix as rotation_matrix,
    rotation_z as rotation_z,
    scalar as scalar,
    triad as triad,
    turn as turn,
    unit as unit,
    vector as vector,
    without_rounding as without_rounding,
)
from .given import given as given
from .instructions import (
    ENTRY as ENTRY,
    Instructions as Instructions,
    instructions as instructions,
    interpret as interpret,
    operation_name as operation_name,
)
from .jets import HIGHEST_ORDER as HIGHEST_ORDER, jet_function as jet_function, jets as jets
from .linear import (
    ExplicitSolver as ExplicitSolver,
    MassBlocks as MassBlocks,
    general_solver as general_solver,
    independent as independent,
    is_singular as is_singular,
    least_factorization as least_factorization,
    least_multipliers as least_multipliers,
    saddle_solver as saddle_solver,
    symmetric_solver as symmetric_solver,
    vanishing_rows as vanishing_rows,
)
from .nodes import with_nodes as with_nodes
from .pickling import reduction as reduction
from .pieces import (
    Entry as Entry,
    Pieces as Pieces,
    Sides as Sides,
    Smooth as Smooth,
    applied as applied,
    entries_of as entries_of,
)
from .printing import plain as plain, printer as printer, set_names as set_names, typeset as typeset
from .ranges import ranges_along as ranges_along
from .simplified import simplified as simplified
from .switching import (
    SOFT as SOFT,
    Branches as Branches,
    On as On,
    branches as branches,
    has_kinks as has_kinks,
    laws as laws,
    margins as margins,
    switching as switching,
    with_common_expressions as with_common_expressions,
)
from .symbols import (
    Kind as Kind,
    Symbol as Symbol,
    TruthValueError as TruthValueError,
    ddt as ddt,
    declare as declare,
    is_time as is_time,
    lookup as lookup,
    rate as rate,
    records_in as records_in,
    t as t,
)
from .sympy_in import from_sympy as from_sympy, is_sympy as is_sympy
from .sympy_out import to_sympy as to_sympy, with_names as with_names
