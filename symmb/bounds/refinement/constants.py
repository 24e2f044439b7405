"""Tuned numbers of the refinement, each with its reason; seven more are those of the adaptive method."""

# --- Prediction of surpluses ---------------------------------------------------------------------------------------

DECAY_POWER = 0.8
"""Power of the observed decay of surpluses that is expected to continue: 1 trusts it, 0 expects none."""
LEAST_DECAY = 0.02
"""Least decay from level to level that is expected: a smaller one was seen once, and may be chance."""
MIXED_SHARE = 0.1
"""Share of the surpluses of products that those of an axis count for at least: it may be a line of symmetry."""
SPAN = 4
"""Levels over which decays are averaged: a halving of angles at degree 16 has as many."""
PRIOR_WEIGHT = 0.1
"""Observations for which a prediction counts: after ten errors that vanish, a tenth of it is left."""

# --- Growth --------------------------------------------------------------------------------------------------------

GROWTH = 0.25
"""Share by which an interpolant grows at a time: the predictions of these nodes are those of the same runs."""
REFINED_SHARE = 0.1
"""Share of the largest predicted surplus from which indices are added together."""
MOST_GROWTH = 2.0
"""Growth of the nodes of many parameters until extremes are looked for again."""
MOST_STEPS = 3
"""Most steps by which a half grows until extremes are looked for again: it may turn out to hold none."""
EARLY = 5.0
"""Predicted error over the tolerance at which check runs may show that it is enough."""
ROUGH_DECAY, WHOLE_DEGREE, HALF_DEGREE = 0.75, 16, 8
"""Decay from level to level above which a response is not smooth, and the least degrees at which this is judged: of the
box, and of its parts, one of which is expected to be rough."""
HOPELESS_NODES, HOPELESS_SHARE = 60, 0.25
"""Nodes for each parameter at which an error above this share of the width takes more runs than it is worth."""

# --- Check runs ----------------------------------------------------------------------------------------------------

MOST_CHECKS = 60
"""Runs beside the nodes of a box through which its interpolant is continued: the matrix of all pairs is solved."""
CONFIDENCE = 0.98
"""Share of the errors that are below the estimate, if they are as normal ones: 95 % are asked for, and the runs that
tell their size are at places where the surrogate was expected to be wrong."""
NODE_SHARE = 0.5
"""Share of the usual error that is expected even at runs inside the box: places of extremes are known only nearly."""
SURPRISE = 3.0
"""Error at check runs over the predicted one above which any index may have caused it."""
PROGRESS = 0.7
"""Share of an error that is left after check runs, up to which more of them are worth their runs."""
NUGGET = 1e-3
"""Share of the variance at a run that comes from other indices: without it few of them had to explain all."""

# --- Ranges --------------------------------------------------------------------------------------------------------

RANGE = 1e-4
"""Accuracy of a range, over its width; of many parameters ten times it, as places count there, which are run."""
DENSE = 1500
"""Most coefficients of a full tensor whose range is searched on a grid of samples."""
REFUTATIONS = 3
"""Rounds of runs at extremes of the surrogate beyond those of all corners: a kink inside shows there."""
COMPARED, COMPARED_POINTS = 20_000, 100
"""Most points of comparison near extremes, each of which takes a value of all basis polynomials, and those anywhere."""
