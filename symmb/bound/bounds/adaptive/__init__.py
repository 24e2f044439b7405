"""Polynomial chaos that chooses its runs and estimates its own error.

Tensor grids serve few parameters, sparse grids many.
"""

from symmb.bound.bounds.adaptive.adaptive_bounds import adaptive_bounds
