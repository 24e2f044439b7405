"""The function that a method bounds in the place of the responses."""

from collections.abc import Callable
from dataclasses import dataclass

from symmb._types import Array


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A polynomial or another function that stands for the responses over the unit box.

    Attributes
    ----------
    values : points (N, d) of [-1, 1]^d -> responses (N, n_t, n_y)
    exact : whether the bounds are its range; without it they may be wider
    """

    values: Callable[[Array], Array]
    exact: bool
