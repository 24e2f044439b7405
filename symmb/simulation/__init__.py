"""Runs of scenes: `simulate` makes one run, and a `DAESimulator` those of samples."""

from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.figure_simulator import FigureSimulator, SceneSimulator, motion_of
from symmb.simulation.sensitivities import Sensitivities, sensitivities
from symmb.simulation.single_run import parameter_values, simulate
from symmb.simulation.subject import (
    chosen_parameters,
    prepare,
    prepare_equations,
    scene_of,
    simulator_of,
    simulator_with,
)
from symmb.simulation.sweep import Sweep, sweep
from symmb.simulation.trajectory import Trajectory
