"""Methods that bound responses over a box of parameters, and their results.

The method that chooses its own runs is in `bounds.adaptive`.
"""

from symmb.bounds.interval_arithmetic import IntervalArithmetic
from symmb.bounds.method import Method, require_method
from symmb.bounds.optimization import Optimization
from symmb.bounds.polynomial_chaos import PolynomialChaos
from symmb.bounds.propagation import propagate
from symmb.bounds.registry import METHODS, read_method
from symmb.bounds.result import Bounds
from symmb.bounds.sampling import MonteCarlo, Scanning, Vertex
from symmb.bounds.swarm import Swarm
from symmb.bounds.taylor import Taylor
