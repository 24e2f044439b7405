"""Runs over a box, and what is known of their responses.

In:   a simulator, a box, and points of the box.
Out:  responses (N, n_t, n_y), their extremes and the runs that attain them, failed runs, and polynomials or samples.

`RunsOverBox` in `box_runs` makes the runs of a method. `streams` reduces runs block by block. `failures` describes
where runs fail, `worst_case` has the runs at extremes, `time_windows` decides whether an error is doubtful, and `trace`
lists the rules that decide errors.
"""

from symmb.bound.responses.allowed import FEW, allowed_points, first_points
from symmb.bound.responses.box_runs import RunsOverBox, parameter_columns, parameter_samples
from symmb.bound.responses.failures import Failure, failed_region, failure_text, find_failed_region
from symmb.bound.responses.responses import FINE, GOOD, Responses, Runs, RunsUsedUpError
from symmb.bound.responses.streams import (
    MOST_NUMBERS,
    FailedRuns,
    extremes,
    failure_details,
    failure_records,
    failures,
    gathered,
    node_values,
    projection,
    require_some,
    together,
    which_failed,
)
from symmb.bound.responses.time_windows import (
    DOUBTFUL,
    LEAST_WIDTH,
    WINDOW,
    average_over_window,
    is_doubtful,
    is_doubtful_in_window,
    rests_for_a_time,
    rms,
)
from symmb.bound.responses.trace import (
    ENDED,
    RULES,
    STALLED,
    USED_UP,
    Rounds,
    Trace,
    tolerance_remark,
    with_tolerance_remark,
)
from symmb.bound.responses.worst_case import SIDES, AttainingRuns, Place, Sample, Worst, WorstCase, row_of, worst_rows
