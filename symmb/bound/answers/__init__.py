"""Bounds, and what they answer.

In:   lower and upper values of outputs over time, the runs, and polynomials.
Out:  `Bounds` (`result`), and its answers. `limits` decides limits (`further_runs` searches closer runs,
      `between_times` examines curves between output times), `contributions` attributes widths and variances to
      parameters, `probabilities` and `statistical` use laws of parameters.

`envelope` has the curves, and the warnings about them. `result_file` stores them.
"""

from symmb.bound.answers.contributions import Contributions
from symmb.bound.answers.envelope import Envelope
from symmb.bound.answers.laws import Correlation, Laws, given_once, laws_text
from symmb.bound.answers.limits import (
    WARNED,
    KeptLimit,
    LimitCheck,
    Limits,
    limit_pairs,
    limit_text,
    other_side,
    unit_suffix,
)
from symmb.bound.answers.result import Bounds
from symmb.bound.answers.result_file import INNER, Kind, box_coordinates, box_entries, box_of, inner_entries, kind_of
from symmb.bound.answers.statistical import Statistics, laws_within, rejects_of, statistics_of
