"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .black_box import BlackBox as BlackBox
from .executors import finished_by as finished_by, is_shut_down as is_shut_down
from .identity import digest as digest
from .limited_calls import end_calls_of as end_calls_of
from .recorded_runs import RecordedRuns as RecordedRuns
from .run_database import STATES as STATES, RunDatabase as RunDatabase, open_run_database as open_run_database
from .simulator import (
    BLOCK as BLOCK,
    RUNS_TOGETHER as RUNS_TOGETHER,
    S as S,
    Attained as Attained,
    Ensemble as Ensemble,
    Jets as Jets,
    Kinked as Kinked,
    March as March,
    Noisy as Noisy,
    Progress as Progress,
    Reduction as Reduction,
    Samples as Samples,
    SecondLook as SecondLook,
    Simulator as Simulator,
    attained_by_runs as attained_by_runs,
    blocks as blocks,
    checked_samples as checked_samples,
    is_recorded as is_recorded,
    noise_from_runs as noise_from_runs,
    note_attained as note_attained,
    run_blocks as run_blocks,
    stream as stream,
)
from .stored_simulator import StoredSimulator as StoredSimulator
from .tasks import LostTask as LostTask, finished as finished
