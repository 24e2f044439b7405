"""Type names shared by all floors."""

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Sequence

    import matplotlib.axes
    import matplotlib.figure

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
Expr = Any
"""A number, a CasADi SX scalar or, where a law or a mass is asked for, a SymPy expression."""
Executor = Any
"""An object with `submit` or with an ordered `map`, or a function that makes one."""
Figure: TypeAlias = "matplotlib.figure.Figure"
Axes: TypeAlias = "matplotlib.axes.Axes"
GivenAxes: TypeAlias = "matplotlib.axes.Axes | Sequence[matplotlib.axes.Axes] | np.ndarray | None"
"""The axes that a caller wants a picture in: one, or one an output; None for a new figure."""
