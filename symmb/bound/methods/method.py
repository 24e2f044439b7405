"""The base of bounding methods, which are frozen objects that compute Bounds from a simulator and a box."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal, get_args

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import Array
from symmb.bound.answers import Bounds, Kind
from symmb.bound.responses import RunsOverBox

OfConstraints = Literal["refused", "own", "polynomials"]
"""Bounds over a box with constraints: none, by the method, or from the polynomials of bounds over the whole box."""


class Method(ABC):
    """A method to bound responses over a box. A method of your own is a subclass.

    A subclass sets `kind` and writes `bounds`. Options are fields of a frozen dataclass, so that the text of a method
    shows them. `propagate` and `compare` take its objects, and `symmb compare --methods module:Name` its classes.

    Attributes
    ----------
    kind : "sampled" (values that runs attain), "estimate" (bounds that may be too wide or too narrow) or "enclosure"
        (bounds that are proved)

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> class Middles(mb.Method):
    ...     kind = "sampled"
    ...
    ...     def bounds(self, runs):
    ...         corners = np.array([runs.lower, (runs.lower + runs.upper) / 2, runs.upper])
    ...         Y = runs(corners)
    ...         return Y.min(axis=0), Y.max(axis=0)
    >>> t = np.array([0.0, 1.0])
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> bounds = mb.propagate(decay, Middles(), mb.Box(k=(0.5, 2.0)))
    >>> bounds.method, bounds.evaluations, bounds.upper[:, 0].round(3).tolist()
    ('Middles()', 3, [1.0, 0.607])
    """

    kind: ClassVar[Kind]
    unit_of_work: ClassVar[str] = "runs"
    """The unit in which the method reports its progress."""
    constraints: ClassVar[OfConstraints] = "refused"
    requires: ClassVar[str] = ""
    """Attribute that a simulator must have beyond `run` and `stream`: "jets" or "expression"."""

    @property
    def doubtful_miss(self) -> float:
        """Largest difference from check runs without a warning, relative to the width. This value is half of the limit
        of estimated errors, because a few runs show only a part of an error."""
        return 0.05

    @abstractmethod
    def bounds(self, runs: RunsOverBox) -> Bounds | tuple[Any, ...]:
        """Bounds of all outputs at all times.

        Parameters
        ----------
        runs : a function of samples (N, d) in the units of the box, with the values (N, n_t, n_y) of the outputs;
            `runs.lower` and `runs.upper` (d,) are the ends of the intervals

        Returns
        -------
        tuple
            (lower, upper) or (lower, upper, estimate), each (n_t, n_y). `estimate` is the estimated error.
        """

    def planned_runs(self, d: int) -> int | None:
        """Number of runs for d uncertain parameters, derivatives included; None if it is not known in advance."""
        return None

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def _result(self, runs: RunsOverBox, lower: Array, upper: Array, evaluations: int, **details: Any) -> Bounds:
        """Bounds by this method. `details` are further attributes of Bounds, besides lower and upper."""
        return Bounds(runs.times, runs.outputs, lower, upper, self.kind, repr(self), evaluations, **details)


def require_method(owner: str, method: object) -> Method:
    """The given method. Other objects raise DeclarationError."""
    if isinstance(method, type):
        raise DeclarationError(f"{owner}: got the class {method.__name__}; call it, as in Vertex() or Taylor(order=2).")
    if not isinstance(method, Method):
        raise DeclarationError(f"{owner}: expected a method such as PolynomialChaos(order=4), got {shown(method)}.")
    if getattr(method, "kind", None) not in get_args(Kind):
        kinds = " or ".join(map(repr, get_args(Kind)))
        raise DeclarationError(f"{type(method).__name__}: kind must be {kinds}, as in: kind = 'sampled'.")
    if not repr(method).isprintable():
        raise DeclarationError(f"{owner}: the text of a method must be printable and on one line, got {shown(method)}.")
    return method
