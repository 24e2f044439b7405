"""The coordinates in which a scene runs, and the program that runs its samples with a solver.

A Formulation has equations, start and outputs in the same coordinates. A Program has formulations, a solver and times.
"""

from symmb.run.formulations.ensembles import FAR, LOCK, CardEnsemble, CompiledEnsemble, block_size
from symmb.run.formulations.formulation import Formulation, Formulations, formulations
from symmb.run.formulations.output_functions import jet_outputs, output_function, outputs_along
from symmb.run.formulations.program import Program, program_of
