"""Runs that exist already, as a simulator that cannot make new runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._names import name_faults
from symmb._options import numbers_of, require_numbers
from symmb._types import Array, Mask
from symmb.connect.black_box import BlackBox
from symmb.connect.simulator import Ensemble, checked_samples
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
    times : (n_t,) increasing times [s]; default: one time, for outputs that are single numbers
    outputs : n_y names; default: one output, y

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
        Raised by all methods that need new runs.

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> X = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    >>> recorded = mb.RecordedRuns(X, X[:, 0] + X[:, 1] ** 2, ["a", "b"])
    >>> bounds = mb.propagate(recorded, box=mb.Box(a=(-1, 1), b=(-1, 1)))
    >>> bounds.lower.round(3), bounds.upper.round(3)
    (array([[-1.]]), array([[2.]]))
    """

    _is_recorded: ClassVar[bool] = True
    X: Array
    Y: Array
    ok: Mask
    box: Box
    _rows: Mapping[bytes, int]

    def __init__(
        self,
        X: Array,
        Y: Array,
        parameters: Mapping[str, float] | Sequence[str],
        times: Array | Sequence[float] = (0.0,),
        outputs: Sequence[str] = ("y",),
    ) -> None:
        points, values = require_numbers("RecordedRuns", "X", X, None, None), numbers_of(Y)
        if not points.size:
            raise DeclarationError("RecordedRuns: X has no runs or no columns.")
        if not (is_finite := np.isfinite(points).all(axis=1)).all():
            raise DeclarationError(f"RecordedRuns: row {is_finite.argmin()} of X is not finite. Leave out this run.")
        low, high = points.min(axis=0), points.max(axis=0)
        if isinstance(parameters, list | tuple) and all(isinstance(name, str) for name in parameters):
            if faults := name_faults(parameters):
                raise DeclarationError(f"RecordedRuns: parameters: {' '.join(faults)}")
            middle = low + 0.5 * (high - low)
            parameters = dict(zip(parameters, [*middle.tolist(), *[0.0] * len(parameters)], strict=False))
        self._declare(parameters, times, outputs, None)  # pyright: ignore[reportArgumentType]
        if len(self.parameters) != points.shape[1]:
            listed = ", ".join(self.parameters)
            raise DeclarationError(f"RecordedRuns: X has {points.shape[1]} columns, but the parameters are {listed}.")
        shape = len(points), len(self.times), len(self.outputs)
        if values is None or [n for n in values.shape if n > 1] != [n for n in shape if n > 1]:
            values = require_numbers("RecordedRuns", "Y", Y, *shape)
        box = Box(**dict(zip(self.parameters, zip(low.tolist(), high.tolist(), strict=True), strict=True)))
        values = values.reshape(shape)
        ok = np.isfinite(values).all(axis=(1, 2))
        rows = {points[k].tobytes(): k for k in np.argsort(ok).tolist()}  # successful runs replace failed equal ones
        vars(self).update(X=points, Y=values, ok=ok, box=box, _rows=rows)

    def run(self, P: Array) -> Ensemble:
        """The recorded runs at samples P (N, d). PropagationError is raised if one of them was not recorded."""
        P = checked_samples(self, P, None)
        if not all(row.tobytes() in self._rows for row in P):
            raise self.refusal()
        return super().run(P)

    def response(self, values: dict[str, float]) -> Array:
        """The outputs (n_t, n_y) of the recorded run with these parameters."""
        return self.Y[self._rows[np.array([*values.values()]).tobytes()]]

    def refusal(self, owner: str = "") -> PropagationError:
        """The error of methods that need new runs. The text starts with `owner`."""
        return PropagationError(
            f"{owner}{self!r} cannot make new runs. Use propagate with PolynomialChaos() without options, and methods "
            "of its bounds: check, contributions, quantiles or probability. For other tolerances, use another box."
        )

    def __repr__(self) -> str:
        return f"RecordedRuns({len(self.X)} runs of {', '.join(self.outputs)})"
