"""Points of the unit box: quadrature rules, interpolation grids, samplers, and the fit of expansions.

Nodes and weights are those of the uniform density on [-1, 1]^d.
"""

from symmb.nodes.fit import Fit
from symmb.nodes.grid import Grid, Index, below, line
from symmb.nodes.quadrature import ChebyshevGauss, ClenshawCurtis, Gauss, Leja, Nodes, SparseGrid
from symmb.nodes.samplers import LatinHypercube, Random, Sampler, Sobol, corners, grid
from symmb.nodes.tensor_fit import group_squares
