"""Simulators: parameters in, trajectories out.

`simulate` makes one run of a scene; the methods in `bounds` run many samples by a `Simulator`.
"""

from symmb.simulation.attained import Attained, attained_by_runs, note_attained
from symmb.simulation.black_box import BlackBox
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.formulation import Formulation, formulations
from symmb.simulation.linear_theory import deformation_doubts
from symmb.simulation.missing_modes import REMEDY, AttachedLoads, attached_loads, with_loads
from symmb.simulation.run_database import STATES, RunDatabase, opened
from symmb.simulation.simulator import (
    Jets,
    Kinked,
    March,
    Noisy,
    Progress,
    Reduction,
    S,
    Samples,
    Simulator,
    run_blocks,
)
from symmb.simulation.single_run import parameter_values, simulate
from symmb.simulation.stored_simulator import StoredSimulator
from symmb.simulation.subject import prepare, prepare_equations, scene_of, simulator_of
from symmb.simulation.trajectory import Trajectory
from symmb.simulation.worker_pool import WorkerPool
