"""From runs to bounds over a box, and to answers from these bounds.

In:   a box of parameters, a method, and a simulator that runs samples of the parameters.
Out:  Bounds: lower and upper values of each output at each time, with an error. Limits, quantiles, probabilities and
      contributions follow from the bounds.

polynomials   bases, fits, and the ranges of polynomials
nodes         points for runs, and fits to the runs
searches      searches for extremes, and surrogates of few runs
responses     runs over a box, and what is known of their responses
answers       Bounds, and what they answer
adaptive      polynomial chaos that chooses its own runs, `PolynomialChaos()`
methods       the other methods, one file for each, and their registry
reductions    features of a box that are taken out before a study, and put back into its bounds
propagation   `propagate`: reduce, bound, and check

A method declares what it needs of a simulator: runs, derivatives, or equations.
"""
