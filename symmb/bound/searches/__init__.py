"""Searches for extremes in points of the unit box, and surrogates of few runs.

In:   a function of points of the unit box, or runs.
Out:  its smallest value and the place; a surrogate, a Gaussian process or a quadratic model.
"""

from symmb.bound.searches.covariances import Ridge, Sum
from symmb.bound.searches.direct_search import LINE_POINTS, direct_search
from symmb.bound.searches.gaussian_process import EXPECTED_NOISE, GaussianProcess, Kernel
from symmb.bound.searches.gradient_sampling import gradient_sampling
from symmb.bound.searches.quadratic_models import quadratics
