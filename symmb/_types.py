"""Type names shared by all floors."""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
Expr = Any
"""A number, a CasADi SX scalar or, where a law or a mass is asked for, a SymPy expression."""


Executor = Any
"""An object with `submit` or with an ordered `map`, or a function that makes one."""
