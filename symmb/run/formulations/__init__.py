"""The formulation in which a scene runs: equations, start and outputs in the same coordinates."""

from symmb.run.formulations.formulation import Formulation, formulations
from symmb.run.formulations.output_functions import jet_outputs, output_function, outputs_along
