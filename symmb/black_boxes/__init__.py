"""Simulators as black boxes: parameters in, trajectories out.

The interface, executors, functions, programs and FMUs of others, and the store of their runs.
"""

from symmb.black_boxes.black_box import BlackBox
from symmb.black_boxes.identity import digest
from symmb.black_boxes.run_database import STATES, RunDatabase, open_run_database
from symmb.black_boxes.simulator import (
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
    checked_samples,
    noise_from_runs,
    note_attained,
    run_blocks,
    stream,
)
from symmb.black_boxes.stored_simulator import StoredSimulator
