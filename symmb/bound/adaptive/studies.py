"""The small studies of PolynomialChaos(), in the order in which they are tried. Each is loaded when it is tried."""

from collections.abc import Iterator

from symmb._threads import one_thread
from symmb.bound import adaptive
from symmb.bound.adaptive.first_grid import FirstGrid
from symmb.bound.adaptive.small_study import JointStudy, OutputStudy, Problem, Studies
from symmb.bound.adaptive.surrogate import EstimatedRange


def of_an_output() -> tuple[OutputStudy, ...]:
    """The small studies of single outputs."""
    grid, resumed = adaptive.SparseGrid(), adaptive.SparseGrid(resumes=True)
    return grid, adaptive.Corners(), adaptive.ResponseSurface(), resumed, adaptive.NearExtremes()


def row() -> Iterator[JointStudy]:
    yield FirstGrid()
    yield adaptive.Waveforms()
    yield FirstGrid(resumes=True)
    yield adaptive.TensorGrids()
    yield adaptive.PerOutput(of_an_output())
    yield adaptive.TensorGrids(resumes=True)


def studies() -> Studies:
    """All small studies."""
    return Studies([own for study in row() for own in getattr(study, "studies", (study,))])


def decided(problem: Problem) -> EstimatedRange:
    """The range of all outputs. Each small study takes the outputs that earlier studies have not decided."""
    left = row()
    with one_thread():
        while problem.open.any() and (study := next(left, None)):
            if study.accepts(problem):
                problem.add(*study.ranges(problem))
    every = problem.others | problem.known
    n_t, n_y = problem.runs.shape
    return EstimatedRange.joined([every[k] for k in range(n_y)], n_t, len(problem.runs.box))
