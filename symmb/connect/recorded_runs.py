"""Runs that exist already, as a simulator that cannot make new runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._names import normal
from symmb._options import numbers_of, shown
from symmb._types import Array, Executor, Mask
from symmb.connect.black_box import BlackBox, values_of
from symmb.connect.simulator import Ensemble, Progress, Reduction, S, checked_samples, stream
from symmb.equations.model import Box


@dataclass(frozen=True, eq=False, repr=False)
class RecordedRuns(BlackBox):
    """Runs from a table, a file or another program. No new run can be made.

    ``propagate(recorded)`` fits sparse polynomials to the runs. The polynomials give bounds, contributions, results of
    `check` and quantiles. Groups of runs that are left out of the fit give the estimated error of the bounds.
    ``bounds.next_run`` contains the parameters at which one more run would reduce this error most.

    A run with nan or an infinite value in its outputs is a failed run. Runs with equal parameters are averaged.

    Parameters
    ----------
    X : (N, d) parameters of the runs
    Y : (N, n_t, n_y) outputs; (N, n_t) if there is one output, (N, n_y) if there is one time, (N,) if there is one of
        both
    parameters : nominal values by name, in the order of the columns of X; or only names. The nominal values are then
        in the middle of the runs
    times : (n_t,) increasing times [s]
    outputs : n_y names

    Attributes
    ----------
    ok : (N,) True for runs that did not fail
    box : smallest box that contains all runs; the default box of `propagate`

    Raises
    ------
    DeclarationError
        If a shape does not fit, or X contains a value that is not finite. Also for wrong names and times, as for a
        FunctionSimulator.
    PropagationError
        Raised by ``run`` and ``stream``, and thus by all methods that need new runs.

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> X = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    >>> recorded = mb.RecordedRuns(X, X[:, 0] + X[:, 1] ** 2, ["a", "b"], [0.0], ["y"])
    >>> bounds = mb.propagate(recorded, box=mb.Box(a=(-1, 1), b=(-1, 1)))
    >>> bounds.lower.round(3), bounds.upper.round(3)
    (array([[-1.]]), array([[2.]]))
    """

    X: Array
    Y: Array
    ok: Mask
    box: Box

    def __init__(
        self,
        X: Array,
        Y: Array,
        parameters: Mapping[str, float] | Sequence[str],
        times: Array | Sequence[float],
        outputs: Sequence[str],
    ) -> None:
        points, values = numbers_of(X), numbers_of(Y)
        if points is None or points.ndim != 2 or not points.size:
            raise DeclarationError(f"RecordedRuns: X must be numbers of the shape (N, d), got {_kind(X, points)}.")
        if not np.isfinite(points).all():
            row = int(np.isfinite(points).all(axis=1).argmin())
            raise DeclarationError(f"RecordedRuns: row {row} of X is not finite. Leave out this run.")
        low, high = points.min(axis=0), points.max(axis=0)
        if isinstance(parameters, list | tuple):
            if len(parameters) != points.shape[1] or not all(isinstance(name, str) for name in parameters):
                raise DeclarationError(
                    f"RecordedRuns: X has {points.shape[1]} columns, but parameters are {shown(parameters)}."
                )
            if len(set(map(normal, parameters))) < len(parameters):
                raise DeclarationError(f"RecordedRuns: parameters contain a name twice: {shown(parameters)}.")
            middle = low + 0.5 * (high - low)
            parameters = dict(zip(parameters, middle.tolist(), strict=True))
        self._declare(parameters, times, outputs, None)
        shape = len(points), len(self.times), len(self.outputs)
        if len(self.parameters) != points.shape[1]:
            listed = ", ".join(self.parameters)
            raise DeclarationError(f"RecordedRuns: X has {points.shape[1]} columns, but the parameters are {listed}.")
        if values is None or _long_axes(values.shape) != _long_axes(shape):
            raise DeclarationError(
                f"RecordedRuns: Y must be numbers of the shape {shape} (N, n_t, n_y), got {_kind(Y, values)}."
            )
        values = values.reshape(shape)
        ends = zip(self.parameters, low.tolist(), high.tolist(), strict=True)
        box = Box(**{name: (least, most) for name, least, most in ends})
        vars(self).update(X=points, Y=values, ok=np.isfinite(values).all(axis=(1, 2)), box=box)

    def run(self, P: Array) -> Ensemble:
        """The recorded runs at samples P (N, d). PropagationError is raised if one of them was not recorded."""
        P = checked_samples(self, P, None)
        is_same = (P[:, None] == self.X).all(axis=2)
        if not is_same.any(axis=1).all():
            raise self.refusal()
        rows = is_same.argmax(axis=1)
        Y, ok = self.Y[rows].copy(), self.ok[rows]
        first = np.where(ok, 0, np.isfinite(Y).all(axis=2).argmin(axis=1))
        messages = [f"{self._irregular(Y[i])} ({values_of(self, P[i])})" for i in np.flatnonzero(~ok)]
        for i in np.flatnonzero(~ok):
            Y[i, first[i] :] = np.nan
        return Ensemble(Y, ok, np.where(ok, np.nan, self.times[first]), tuple(messages))

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Reduce the recorded runs at samples P (N, d), as `run`."""
        return stream(self, P, reduction, None, progress)

    def response(self, values: dict[str, float]) -> Array:
        """The outputs (n_t, n_y) of the recorded run with these parameters."""
        return self.run(np.array([[values[name] for name in self.parameters]])).Y[0]

    def refusal(self) -> PropagationError:
        """The error of methods that need new runs."""
        return PropagationError(
            f"{self!r} cannot make new runs. Use PolynomialChaos() without options, which needs only recorded runs."
        )

    def __repr__(self) -> str:
        return f"RecordedRuns({len(self.X)} runs of {', '.join(self.outputs)})"


def _kind(given: object, numbers: Array | None) -> str:
    return shown(given)[:100] if numbers is None else f"the shape {numbers.shape}"


def _long_axes(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape without axes of length 1, except the axis of the runs."""
    return shape[:1] + tuple(n for n in shape[1:] if n != 1)
