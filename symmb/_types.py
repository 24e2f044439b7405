"""Names of types that all folders share."""

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
"""A number, a CasADi SX scalar or, for laws and masses, a SymPy expression."""
Executor = Any
"""An object with `submit` or with an ordered `map`, or a function that makes such an object."""
Figure: TypeAlias = "matplotlib.figure.Figure"
Axes: TypeAlias = "matplotlib.axes.Axes"
GivenAxes: TypeAlias = "matplotlib.axes.Axes | Sequence[matplotlib.axes.Axes] | np.ndarray | None"
"""Axes that the caller gives for a picture: one, or one for each output; None for a new picture."""
