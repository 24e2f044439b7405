"""Runs of scenes. `simulate` makes one run, and a `DAESimulator` runs samples of parameters.

`pilots` chooses the solver by short trial runs.
"""

from symmb.run.simulation.dae_simulator import DAESimulator
from symmb.run.simulation.derivatives import has_exact_jets
from symmb.run.simulation.differences import HIGHEST_OF_DIFFERENCES, differences
from symmb.run.simulation.figure_simulator import FigureSimulator, SceneSimulator, motion_of, never_holds
from symmb.run.simulation.random_simulator import RandomSimulator
from symmb.run.simulation.sensitivities import Sensitivities, sensitivities
from symmb.run.simulation.single_run import parameter_values, simulate
from symmb.run.simulation.subject import Device, Subject, chosen_parameters, prepare, scene_of
from symmb.run.simulation.sweep import Sweep, sweep
from symmb.run.simulation.trajectory import Trajectory
