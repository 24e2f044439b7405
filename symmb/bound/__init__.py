"""From runs to bounds over a box, and to answers from these bounds.

In:   a box of parameters, a method, and a simulator that runs samples of the parameters.
Out:  Bounds: lower and upper values of each output at each time, with an error. Limits, quantiles, probabilities and
      contributions follow from the bounds.

polynomials   bases, fits, and the ranges of polynomials
nodes         points for runs, and fits to the runs
bounds        methods, bounds, and answers; `adaptive` is the method that chooses its own runs

A method declares what it needs of a simulator: runs, derivatives, or equations.

`propagate` in `bounds.propagation` makes the simulator, computes bounds by the method (`bounds.method`), and adds
warnings (`bounds.doubts`; `bounds.check_runs` checks methods without an estimated error). The Bounds then answer:
`bounds.limits` decides limits (`bounds.further_runs` searches closer runs, and `bounds.between_times` examines curves
between output times), `bounds.answers` has means, standard deviations and quantiles, `bounds.contributions`
attributes widths and variances to parameters, and `bounds.probabilities` computes probabilities.
"""
