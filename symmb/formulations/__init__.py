"""The formulation in which a scene runs: equations, start and outputs in the same coordinates."""

from symmb.formulations.formulation import Formulation, formulations
from symmb.formulations.output_functions import jet_outputs, output_function, outputs_along
