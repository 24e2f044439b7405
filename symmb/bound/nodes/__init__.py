"""Points of the unit box: quadrature rules, interpolation grids, samplers, and the fit of expansions.

Nodes and weights are those of the uniform density on [-1, 1]^d.
"""

from symmb._doors import open_door

open_door(__name__)
