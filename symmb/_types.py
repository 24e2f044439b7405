"""Type names shared by all floors."""

from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
Expr = Any
"""A number, a CasADi SX scalar or, where a law or a mass is asked for, a SymPy expression."""


class Executor(Protocol):
    """Anything with an ordered ``map``: thread and process pools, a Dask client's executor."""

    def map(self, fn: Callable[..., Any], /, *iterables: Iterable[Any]) -> Iterable[Any]: ...
