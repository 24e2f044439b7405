"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .method import Method as Method
from .one_box import bounds_of as bounds_of, possible_values as possible_values, units_of as units_of
from .optimization import Optimization as Optimization
from .polynomial_chaos import PolynomialChaos as PolynomialChaos
from .recorded import recorded_bounds as recorded_bounds
from .registry import METHODS as METHODS, method_of as method_of, read_method as read_method
from .sampling import MonteCarlo as MonteCarlo, Scanning as Scanning, Vertex as Vertex, sampled as sampled
