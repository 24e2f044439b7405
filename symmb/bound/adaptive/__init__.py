"""Polynomial chaos that chooses its runs and estimates its own error: the default `PolynomialChaos()`.

In:   a simulator, a box, a tolerance and a budget.
Out:  Bounds with estimated errors, and the trace of the study.

The study is a row of small studies (`studies`). Each takes the outputs that are not decided, and its numbers are fields
of a frozen dataclass. `studies.decided` decides: an output has the range of the first small study whose error is within
the tolerance, otherwise the range with the smallest error.

first_grid         scenes: one grid for all outputs, and runs spread over the box
oscillations       polynomials of phase and waveform of oscillations over many periods
tensor_grids       up to three parameters: refined grids on pieces (`piece`), kinks and events between runs (`secants`)
outputs            a row for each output: `sparse_grid`, corners (`monotone`), `response_surface`, runs near extremes

small_study        the base of small studies, and the runs that they ask for
surrogate          the range of a surrogate, and the evidence of its error
runs               all runs of a study, and measures of errors; `clock` ends a study that takes too long
check_points       points of check runs; `inflated_error` widens an estimate by the errors of these runs
error_estimate     the truncation error of an interpolant, and its error at events: the first estimate
check_rounds       rounds of runs near extremes; the gains of these runs give the error. `continuation` corrects grids

`error_estimate` sets the estimated error of an output at a time. Check runs increase this error. `adaptive_bounds`
increases it again: to the distance of runs beyond the range, to the noise, and near failed runs. `Evidence` keeps the
error with the name of the rule that decides it; `bounds.trace` lists the rules. `bounds_of` then limits all bounds to
the values that an output can have.
"""

from symmb._doors import open_door

open_door(__name__)
