"""A plain Python function as a simulator."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from symmb._errors import DeclarationError
from symmb._options import require_timeout, shown
from symmb._types import Array
from symmb.connect.black_box import BlackBox
from symmb.connect.identity import digest
from symmb.connect.limited_calls import LimitedCalls


@dataclass(frozen=True, eq=False, repr=False)
class FunctionSimulator(BlackBox):
    """Trajectories from a function of the parameters. The function is a black box.

    Parameters
    ----------
    f : function that is called as ``f(**parameters)`` and returns (n_t, n_y), or (n_t,) if there is one output.
        A sample fails if its call raises an exception, or returns another shape or a masked or infinite value or nan.
        If the executor runs in other processes, f must be picklable, such as a function of a module.
    parameters : nominal values by name
    times : (n_t,) increasing times of the rows [s]
    outputs : n_y names of the columns
    noise : errors of the output values by name, as ``{"x": 1e-6}``; the errors of other outputs are 0. None: the errors
        are not known; adaptive methods measure them
    timeout : longest time of a call [s]. Calls are then made in forked processes, which are ended after this time

    Raises
    ------
    DeclarationError
        If times do not increase, there are no outputs, a name is not valid or repeated, a value is not a number, or
        noise is negative

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.linspace(0.0, 1.0, 3)
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> decay.run(np.array([[0.0], [2.0]])).Y[:, :, 0].round(3)
    array([[1.   , 1.   , 1.   ],
           [1.   , 0.368, 0.135]])
    """

    f: Callable[..., Any]
    timeout: float | None
    _limited: LimitedCalls | None

    def __init__(
        self,
        f: Callable[..., Any],
        parameters: Mapping[str, float],
        times: Array,
        outputs: Sequence[str],
        noise: Mapping[str, float] | None = None,
        timeout: float | None = None,
    ):
        if not callable(f):
            raise DeclarationError(f"FunctionSimulator: f must be a function of the parameters, got {shown(f)}.")
        require_timeout("FunctionSimulator", timeout)
        vars(self).update(f=f, timeout=timeout, _limited=None if timeout is None else LimitedCalls(f, timeout))
        self._declare(parameters, times, outputs, noise)

    def response(self, values: dict[str, float]) -> Any:
        """The value that f returns: (n_t, n_y), or (n_t,) if there is one output."""
        return self.f(**values) if self._limited is None else self._limited(values)

    def identity(self) -> str:
        """A digest of the function, for `StoredSimulator`."""
        return digest("function", self.f)

    def __repr__(self) -> str:
        return f"FunctionSimulator({getattr(self.f, '__name__', type(self.f).__name__)})"
