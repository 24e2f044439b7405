"""Simulators as black boxes: parameters in, trajectories out.

The modules define the interface of simulators, the executors and the store of runs. Simulators are made from functions,
programs and FMUs.
"""

from symmb.connect.black_box import BlackBox
from symmb.connect.executors import LostTask, finished, is_shut_down
from symmb.connect.identity import digest
from symmb.connect.recorded_runs import RecordedRuns
from symmb.connect.run_database import STATES, RunDatabase, open_run_database
from symmb.connect.simulator import (
    BLOCK,
    Attained,
    Ensemble,
    Jets,
    Kinked,
    March,
    Noisy,
    Progress,
    Reduction,
    S,
    Samples,
    SecondLook,
    Simulator,
    attained_by_runs,
    blocks,
    checked_samples,
    noise_from_runs,
    note_attained,
    run_blocks,
    stream,
)
from symmb.connect.stored_simulator import StoredSimulator
