"""Tuned numbers of the adaptive method, which is calibrated by tests/benchmarks/estimates.py, many.py and curves.py.

The benchmark estimates.py compares estimated with true errors in 24 scenes at three tolerances. The numbers are chosen
there so that the estimate is at least the true error for 95 % of all outputs and times, and ten times it in the median.
"""

# --- Check runs --------------------------------------------------------------------------------------------------

TRUST = 0.6
"""Least share of its estimated error that an interpolant keeps when check runs show smaller errors."""
SAFETY = 2.5
"""Factor on the errors of check runs: these are at a few of the extremes, and others may have larger errors."""
CANDIDATES = 150
"""Extremes among which check points are selected: the selection compares all pairs."""
HEAVIEST = 20 * CANDIDATES
"""Extremes with the largest weights, of which the candidates are a sample."""
FARTHEST_SCALING = 10.0
"""Largest factor by which the error of a check run is scaled to the error expected elsewhere."""
ROUNDING_SHARE = 1e-6
"""Share of an expected error below which it is rounding, so that the place is a node."""

# --- Error estimate ----------------------------------------------------------------------------------------------

WINDOW = 0.02
"""Share of the times over which squares of coefficients are averaged: coefficients of a swinging response pass 0."""
SHELLS = 4
"""Degree shells, of two degrees each, whose sizes give the decay."""
DECAY_POWER, FAST_DECAY = 0.6, 0.8
"""Power of the observed decay that is expected to continue: 1 trusts it, 0 expects none. On tensor grids the power is
1 - decay / FAST_DECAY if that is more, because a fast decay goes on."""
NODE_SHARE = 0.4
"""Share of the largest error that is expected even at nodes, over the degree (at most 4): places of extremes are known
only nearly."""

# --- Tensor grids ------------------------------------------------------------------------------------------------

TENSOR_PROBES = 1
"""Quasi-random check points. Nodes lie at middles, ends and halves, where symmetric responses may be alike."""
REFINED_SHARE = 0.25
"""Directions with at least this share of the largest error are refined together."""
SMOOTH_DECAY = 0.6
"""Decay of coefficients in two degrees above which a response is not smooth."""
WHOLE_DEGREE, HALF_DEGREE = 16, 8
"""Least degree at which smoothness is judged: on the whole box, and on halves, one of which is expected to be rough."""
SMALL_HALF_WIDTH, SMALLEST_HALF_WIDTH = 0.05, 1e-6
"""Half width of a rough piece at which a smooth response is nearly linear, and at which halving ends."""
INHERITED_SHARE = 0.25
"""Share of the error that is left after a rough piece was halved along every parameter."""
TENSOR_RANGE = 1e-5
"""Accuracy of a range, over its width."""

# --- Sparse grids ------------------------------------------------------------------------------------------------

GROWTH = 0.25
"""Share by which the grid grows at a time."""
SPARSE_PROBES = 2
"""Quasi-random check points. Runs along the axes cannot show products of parameters; runs at these points can."""
SURPRISE = 3.0
"""Error at these points over the estimate above which any index ahead of the grid may have caused it."""
PATIENCE, LEAST_PROGRESS = 30, 0.7
"""Nodes for each parameter before growth may be given up, and the share of the error that remains, when the number of
nodes doubles, above which it is."""
CONTINUED_SHARE = 0.2
"""Share of the expected error that remains at places of check runs, since the continuation does not interpolate."""
SPARSE_RANGE = 0.02
"""Accuracy of a range, over the tolerance."""
RANGE_WORK, FEWEST_BOXES = 200_000, 20
"""Coefficients in all boxes that the search of a range may take, since many parameters leave it unproved anyway, and
fewest boxes."""

# --- Runs --------------------------------------------------------------------------------------------------------

MOST_RUNS, MOST_NUMBERS = 5000, 40_000_000
"""Without a budget, the most runs, and the most numbers that are kept of them: 0.3 GB, and as many coefficients."""
TENSOR_PARAMETERS = 3
"""Most parameters of tensor grids. Extremes lie at corners and edges, where sparse grids are least accurate."""
ROUNDING_WIDTH = 1e-9
"""Share of an output's scale below which its width is rounding."""
NODE_DIGITS = 12
"""Decimal digits in which equal nodes agree."""
