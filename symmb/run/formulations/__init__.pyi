"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .ensembles import (
    FAR as FAR,
    LOCK as LOCK,
    CardEnsemble as CardEnsemble,
    CompiledEnsemble as CompiledEnsemble,
    block_size as block_size,
)
from .formulation import Formulation as Formulation, Formulations as Formulations, formulations as formulations
from .output_functions import (
    jet_outputs as jet_outputs,
    output_function as output_function,
    outputs_along as outputs_along,
)
from .program import Program as Program, program_of as program_of
