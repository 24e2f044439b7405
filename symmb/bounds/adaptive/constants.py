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
CHECKED_TOGETHER = 5
"""Check runs whose errors are computed together: a tensor grid has nearly twice as many nodes at least."""
SHAPE_SHARE = 1e-2
"""Share of the largest shape of time from which others tell more than it does."""
SHAPE_RUNS, SHAPE_TIMES, FEW_SHAPES = 100, 100, 3
"""Most runs and about as many times of which shapes are counted: a window is 2 % of all times. Shapes that hide as much
as single numbers do."""
MOST_CORNERS = 32
"""Most corners that are run because nothing else tells where a response varies."""
ROUNDING_SHARE = 1e-6
"""Share of an expected error below which it is rounding, so that the place is a node."""

UNKNOWN_SHARE = 0.15
"""Least error over the width of a bound near failed runs: no check run tells how good the prediction is there. It is
above the share from which bounds are doubtful."""

# --- Noise -------------------------------------------------------------------------------------------------------

NOISE_RUNS, NOISE_RUNS_OF_FEW, NOISE_SPACING = 5, 7, 1e-7
"""Runs on a line from which noise is measured, at many times and at few, where few numbers may be alike by chance,
and their distance in the unit box: the response is a line there."""
LEAST_COST = 3
"""Runs of a refinement, or before it, over those that measure noise, from which it is worth while to measure."""
NOISE_SAFETY = 3.0
"""Factor on the standard deviation of noise: as far as its values reach."""
NOISY_SHARE = 0.25
"""Measured noise over the width from which bounds are doubtful: few runs of noise alone are six times as far apart."""
NOISE_OF_SOLVERS = 1e-6
"""Noise over the values of an output up to which it is what solvers leave of one that parameters do not change."""
NOISE_OF_COEFFICIENTS = 2.0
"""Coefficients of high degrees over the noise of the runs from which they are computed."""

# --- Error estimate ----------------------------------------------------------------------------------------------

SHELLS = 4
"""Degree shells, of two degrees each, whose sizes give the decay."""
DECAY_POWER, FAST_DECAY = 0.6, 0.8
"""Power of the observed decay that is expected to continue: 1 trusts it, 0 expects none. On tensor grids the power is
1 - decay / FAST_DECAY if that is more, because a fast decay goes on."""
NODE_SHARE = 0.4
"""Share of the largest error that is expected even at nodes, over the degree (at most 4): places of extremes are known
only nearly."""

MOST_SMOOTHED = 200
"""Failed nodes of a piece that get the values of the smoothest interpolant: more of them are a region of their own."""
LARGEST_SHARE = 0.25
"""Weight of the output with the largest error: the bounds of many outputs may be done when one is four times as far
off as the tolerance."""
MANY_VALUES = 1000
"""Values of a run from which check runs tell how far the estimate is from errors: their ratio is a mean over many. They
are those of one output, or all of them if none has few shapes of time, which many smooth ones would hide."""
FIELD_TRUST = 0.15
"""Least share of the estimate that errors of so many values are expected to have where check runs show less."""
CHEAP_RUNS, CHEAP_SHARE = 60, 0.5
"""Runs up to which bounds are refined until they are not doubtful, and the share of the error at which windows of time
are doubtful that these may have: what check runs show of a window is less certain."""
DOUBTED_SHARE = 0.8
"""Share of the estimate that is reported where bounds are doubtful: `outer` then covers 99 % of the outputs and times
of the double pendulum at +-20 %."""
CERTAIN_SHARE = 0.75
"""Share of what check runs let expect, with SAFETY, that is reported where bounds are not doubtful."""
SOME_VALUES, REACHED_SHARE, REACHED_POWER = 50, 0.6, -0.06
"""Values of a run from which less than the estimate is reported where the tolerance is reached without a doubt, and its
share, which the tolerance to a power multiplies: a loose tolerance is reached with few coefficients, and the estimate
is then farther above the error. Medians of estimates over errors are 4 to 6 at tolerances of 1e-1 to 1e-3, and 99 % are
covered."""
MANY_TIMES = 200
"""Least times at which errors are estimated; of twice as many and more, one of every two, three, ... A window of time
holds four of them."""
WINDOW_SHARE = 0.2
"""Weight of the largest error in a window of time: what acts for a moment counts, but less than what stays."""

# --- Tensor grids ------------------------------------------------------------------------------------------------

TENSOR_PROBES = ((FEW_SHAPES, 6), (5, 3))
"""Most shapes of time of a response, and quasi-random check points; with more shapes there is 1. Nodes lie at middles,
ends and halves, where symmetric responses may be alike. What one shape hides, others show."""
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
SCREENING_PROBES = 8
"""Further points beside the corners where few shapes, or none, tell where a response varies."""
SURPRISE = 3.0
"""Error at these points over the estimate above which any index ahead of the grid may have caused it."""
PATIENCE, LEAST_PROGRESS = 30, 0.7
"""Nodes for each parameter before growth may be given up, and the share of the error that remains, when the number of
nodes doubles, above which it is."""
SLOW = 60, 0.25
"""Nodes for each parameter at which an error above this share of the width takes more runs than it is worth."""
CONTINUED_SHARE = 0.2
"""Share of the expected error that remains at places of check runs, since the continuation does not interpolate."""
EARLY = 5.0
"""Estimated error over the tolerance at which check runs may show that it is enough."""
MOST_ROUNDS, LEAST_GAIN = 8, 0.9
"""Most rounds of check runs, and the share of the error that remains after a round above which they end."""
MOST_SEARCHES, CORNERS_SHARE, STALLED_SHARE = 4, 0.1, 0.12
"""Most searches for extremes of an interpolant that does not converge, the share that what corners attained beyond its
nodes has in the error of what the last searches attain, and the least error over the width. Errors are 1 to 6 %, and
nothing tells which (engineering_formulas.py, directions): it is above the share from which bounds are doubtful."""
CHECKED_SHARE = 0.2
"""Least share of the estimated error that is left after check runs at extremes have corrected the expansion."""
SPARSE_RANGE = 0.02
"""Accuracy of a range, over the tolerance."""
RANGE_WORK, FEWEST_BOXES = 200_000, 20
"""Coefficients in all boxes that the search of a range may take, since many parameters leave it unproved anyway, and
fewest boxes."""

# --- Corners -----------------------------------------------------------------------------------------------------

EDGES = 2
"""Pairs of corners that differ in one parameter only from which on its effect is not looked for along other edges."""
CLOSE = 0.1
"""Error at two runs over the width up to which an expansion through the others, and then through all, has moments:
those of exp and 1 / (1.5 + tanh) of many parameters are then within 3 % of the width."""
LOST_SHARE = 0.1
"""Share of the tolerance that a response may lose at a corner which is not quite its own."""
MONOTONE_SHARE = 0.2
"""Share of the tolerance that is expected as error of what runs attain at corners: effects of parameters may change
their signs where no run was."""

# --- Response surfaces -------------------------------------------------------------------------------------------

SURFACE_RESPONSES = 8
"""Most outputs times times of a response surface: each extreme of each is searched by itself."""
SURFACE_RUNS = 100, 20
"""Runs after which a surface that does not converge is given up: in all, and for each parameter."""
SUSPICIOUS_RUNS = 150
"""Runs from which it may be noise that a surface does not converge."""
SLOPE_STEP = 0.1
"""Distance from the middle at which slopes are taken."""
RIDGE_LENGTHS = (0.7, 1.4, 2.8, 5.6)
"""Lengths of a ridge of which the most likely one is the start of a search."""
REFIT, UNLIKELY, DECIDED = 1.4, 20.0, 8
"""Growth of the runs after which the kernel is chosen anew; logarithm of the ratio of likelihoods beyond which a kernel
is given up, from so many runs for each parameter on."""
DEVIATIONS, LATEST = 2.0, 10
"""Standard deviations that a response is expected to be from its mean at most, where the latest runs, so many, do not
show more."""
OBSERVED_SHARE = 0.6
"""Share of the error of the latest runs that extremes may have."""
LEFT_OUT_SAFETY = 3.0
"""Factor on the errors at runs that are left out, where a surface does not converge. Their root mean square over the
width is 7 to 40 % where the response jumps, and at most 1.5 % where it is smooth (known_ranges.py, Genz)."""
SPREAD, FEWEST_SPREAD = 4, 12
"""Runs of a round that are spread over the box, and fewest of all rounds. So many corners are the first of them: what
acts for high values of some parameters together is seen nowhere else."""
BESIDE = 0.15
"""Distance in each parameter from an extreme of the surface at which a run shows whether the response is flat there."""
PLATEAU = 3
"""Runs inside the box that share an extreme where the response is constant."""
DOUBTFUL_SHARE = 0.1
"""Error over the width from which bounds are those that runs attained."""
SEARCH_CANDIDATES, SEARCH_STARTS = 200, 3
"""Points of the box, and as many corners, of which so many start local searches."""
SEARCH_LINE = 17
"""Values of a parameter of which the best is looked for: a sine of a period has its extremes within 0.06 of them."""
EXPANSION_SIZE, EXPANSION_SHARE = 300, 0.05
"""Most polynomials of the expansion of a surface, and largest error of it, over the standard deviation."""

# --- Runs --------------------------------------------------------------------------------------------------------

LEAST_SECONDS, SECONDS_OF_RUNS = 1.0, 3.0
"""Seconds that a study may take beyond its runs, unless more are asked for: nobody notices the first, and runs that
take long are worth as much thought."""
FAR = 4.0
"""Estimated error over the tolerance from which it is doubtful that a study was ended early."""
MOST_RUNS, MOST_NUMBERS = 5000, 40_000_000
"""Without a budget, the most runs, and the most numbers that are kept of them: 0.3 GB, and as many coefficients."""
TENSOR_PARAMETERS = 3
"""Most parameters of tensor grids. Extremes lie at corners and edges, where sparse grids are least accurate."""
ROUNDING_WIDTH = 1e-9
"""Share of an output's scale below which its width is rounding, unless the simulator tells its noise."""
ROUNDING_OF_VALUES = 4 * 2.0**-52
"""The same where it tells it: the digits that numbers have."""
ORDINARY = 300
"""Powers of two, 1e90, by which numbers may grow: they are squared. Half of it is not scaled by a power of two."""
NODE_DIGITS = 12
"""Decimal digits in which equal nodes agree."""
