"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .covariances import Ridge as Ridge, Sum as Sum
from .direct_search import LINE_POINTS as LINE_POINTS, direct_search as direct_search
from .gaussian_process import EXPECTED_NOISE as EXPECTED_NOISE, GaussianProcess as GaussianProcess, Kernel as Kernel
from .gradient_sampling import gradient_sampling as gradient_sampling
from .quadratic_models import quadratics as quadratics
