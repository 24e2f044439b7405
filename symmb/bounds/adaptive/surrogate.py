"""What stands for the responses over the box: the interface of interpolants, searches and response surfaces."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from symmb._types import Array
from symmb.polynomials.ranges import Piecewise


class EstimatedRange(NamedTuple):
    """Range of a surrogate, its estimated error, each (n_t, n_y), and polynomials that are close to it everywhere.

    The polynomials are made on call: they are as large as the runs, which are not needed any more then. `places` are
    those of the minima and the maxima, (2, n_t, n_y, d), if they are known. `is_enough` tells whether the tolerance is
    reached. `surrogate` names whose range it is.
    """

    lower: Array
    upper: Array
    estimate: Array
    polynomials: Callable[[], Piecewise | None] | None
    surrogate: str
    places: Array | None = None
    is_enough: bool = False


class Surrogate(Protocol):
    """A function in the place of the responses, with the runs that it was made of."""

    def bounded(self) -> EstimatedRange | None:
        """Its range, if that is accurate enough or cannot be improved; check runs may be made for it."""
        ...

    def refined(self) -> "Surrogate":
        """It, made of more runs, or another surrogate that serves the responses better."""
        ...
