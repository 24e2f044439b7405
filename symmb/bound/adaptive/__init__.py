"""Polynomial chaos that chooses its runs and estimates its own error: the default `PolynomialChaos()`.

adaptive_bounds    entry point: chooses the kind of grid, and makes Bounds from the estimated range
runs               all runs of a study, and measures of errors; `clock` ends a study that takes too long
error_estimate     the truncation error of an interpolant, and its error at events: the first estimate
check_points       points of check runs; `inflated_error` widens the estimate by the errors of these runs
oscillations       ranges of oscillations over many periods, from polynomials of phase and waveform

Up to three parameters:
tensor_grids       refines grids, checks their ranges (`_check`) and ends when the error is small enough (`_confirmed`)
piece              a part of the box with an interpolant of degrees up to HIGHEST_DEGREE; `secants` finds its kinks

More parameters:
many_parameters    one study for each output; each round makes the runs of all `requests`
output_study       sparse grids, corners and rounds for one output
monotone           bounds at corners
check_rounds       rounds of runs near extremes; the gains of these runs give the error
continuation, response_surface   surrogates in addition to sparse grids

`error_estimate` sets the estimated error of an output at a time. Check runs increase this error in `tensor_grids`, or,
for more parameters, in `check_rounds`, `output_study`, `monotone` and `response_surface`. `adaptive_bounds` increases
the error again: to the distance of runs beyond the range, to the noise, and near failed runs. `evidence` keeps the
error with the name of the rule that decides it; `bounds.trace` lists the rules. `bounds.method` then limits all bounds
to the values that an output can have.
"""

from symmb.bound.adaptive.adaptive_bounds import adaptive_bounds
