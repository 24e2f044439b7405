"""Methods that bound responses over a box. Each method has a file.

In:   a simulator and a box without choices.
Out:  Bounds. `bounds_of` in `one_box` decides: it calls a method, checks what it returns, and limits bounds to values
      that an output can have. `registry` lists the methods.
"""

from symmb.bound.methods.method import Method
from symmb.bound.methods.one_box import bounds_of, possible_values, units_of
from symmb.bound.methods.optimization import Optimization
from symmb.bound.methods.polynomial_chaos import PolynomialChaos
from symmb.bound.methods.registry import METHODS, method_of, read_method
from symmb.bound.methods.sampling import MonteCarlo, Scanning, Vertex
