"""Bounds, and what they answer.

In:   lower and upper values of outputs over time, the runs, and polynomials.
Out:  `Bounds` (`result`), and its answers. `limits` decides limits (`further_runs` searches closer runs,
      `between_times` examines curves between output times), `contributions` attributes widths and variances to
      parameters, `probabilities` and `statistical` use laws of parameters.

`envelope` has the curves, and the warnings about them. `result_file` stores them.
"""

from symmb._doors import open_door

open_door(__name__)
