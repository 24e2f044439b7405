"""Polynomial chaos that chooses its runs and estimates its own error: the default `PolynomialChaos()`.

adaptive_bounds    the way in: it chooses the kind of grid, and makes Bounds of the range that a grid estimates
runs               all runs of a study, and measures of errors; `clock` ends a study that takes too long
error_estimate     the truncation error of an interpolant, and its error at events: the first estimate
check_points       where runs check an interpolant; `inflated_error` widens the estimate by the errors that they show

Up to three parameters:
tensor_grids       refines grids, checks their ranges (`_check`) and ends when the error is small enough (`_confirmed`)
piece              a part of the box with its own interpolant; `secants` finds the kinks of one parameter

More parameters:
many_parameters    one study for each output; a round of `requests` answers all of them
output_study       sparse grids, corners and rounds for one output
monotone           bounds at corners
check_rounds       rounds of runs near extremes, whose gains are the error
continuation, response_surface   surrogates beside the sparse grids

The estimate of an output at a time is set by `error_estimate` and raised by check runs in `tensor_grids`, or with more
parameters in `check_rounds`, `output_study`, `monotone` and `response_surface`. `adaptive_bounds` raises it once more,
to the distance of runs beyond the range, near failed runs, and to the noise. `bounds.method` then limits all bounds to
the values that an output can have.
"""

from symmb.bound.bounds.adaptive.adaptive_bounds import adaptive_bounds
