"""The small studies of PolynomialChaos(), in the order in which they are tried."""

from symmb._threads import one_thread
from symmb.bound.adaptive.first_grid import FirstGrid
from symmb.bound.adaptive.monotone import Corners
from symmb.bound.adaptive.oscillations import Waveforms
from symmb.bound.adaptive.outputs import PerOutput
from symmb.bound.adaptive.response_surface import ResponseSurface
from symmb.bound.adaptive.small_study import JointStudy, Problem, Studies
from symmb.bound.adaptive.sparse_grid import NearExtremes, SparseGrid
from symmb.bound.adaptive.surrogate import EstimatedRange
from symmb.bound.adaptive.tensor_grids import TensorGrids

OF_AN_OUTPUT = SparseGrid(), Corners(), ResponseSurface(), SparseGrid(resumes=True), NearExtremes()
ROW: tuple[JointStudy, ...] = (
    FirstGrid(),
    Waveforms(),
    FirstGrid(resumes=True),
    TensorGrids(),
    PerOutput(OF_AN_OUTPUT),
    TensorGrids(resumes=True),
)
STUDIES = Studies([small for own in ROW for small in (own.studies if isinstance(own, PerOutput) else (own,))])


def decided(problem: Problem) -> EstimatedRange:
    """The range of all outputs. Each small study takes the outputs that earlier studies have not decided."""
    with one_thread():
        for study in ROW:
            if problem.open.any() and study.accepts(problem):
                problem.add(*study.ranges(problem))
    every = problem.others | problem.known
    n_t, n_y = problem.runs.shape
    return EstimatedRange.joined([every[k] for k in range(n_y)], n_t, len(problem.runs.box))
