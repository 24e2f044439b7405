"""Simulators: parameters in, trajectories out.

`simulate` makes one run of a scene; the methods in `bounds` run many samples by a `Simulator`.
"""

from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.function_simulator import FunctionSimulator
from symmb.simulation.simulator import Jets, Kinked, March, Plain, Progress, Reduction, Samples, Simulator, run_blocks
from symmb.simulation.single_run import simulate
from symmb.simulation.subject import simulator_of
from symmb.simulation.trajectory import Trajectory
