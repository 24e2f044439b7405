"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .allowed import FEW as FEW, allowed_points as allowed_points, first_points as first_points
from .box_runs import (
    RunsOverBox as RunsOverBox,
    parameter_columns as parameter_columns,
    parameter_samples as parameter_samples,
)
from .failures import (
    Failure as Failure,
    failed_region as failed_region,
    failure_text as failure_text,
    find_failed_region as find_failed_region,
)
from .responses import (
    FINE as FINE,
    GOOD as GOOD,
    Responses as Responses,
    Runs as Runs,
    RunsUsedUpError as RunsUsedUpError,
)
from .streams import (
    MOST_NUMBERS as MOST_NUMBERS,
    FailedRuns as FailedRuns,
    extremes as extremes,
    failure_details as failure_details,
    failure_records as failure_records,
    failures as failures,
    gathered as gathered,
    node_values as node_values,
    projection as projection,
    require_some as require_some,
    together as together,
    which_failed as which_failed,
)
from .time_windows import (
    DOUBTFUL as DOUBTFUL,
    LEAST_WIDTH as LEAST_WIDTH,
    WINDOW as WINDOW,
    average_over_window as average_over_window,
    is_doubtful as is_doubtful,
    is_doubtful_in_window as is_doubtful_in_window,
    rests_for_a_time as rests_for_a_time,
    rms as rms,
)
from .trace import (
    ENDED as ENDED,
    RULES as RULES,
    STALLED as STALLED,
    USED_UP as USED_UP,
    Rounds as Rounds,
    Trace as Trace,
    tolerance_remark as tolerance_remark,
    with_tolerance_remark as with_tolerance_remark,
)
from .worst_case import (
    SIDES as SIDES,
    AttainingRuns as AttainingRuns,
    Place as Place,
    Sample as Sample,
    Worst as Worst,
    WorstCase as WorstCase,
    row_of as row_of,
    worst_rows as worst_rows,
)
