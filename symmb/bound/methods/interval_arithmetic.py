"""Natural interval arithmetic: the outputs' expressions evaluated with intervals instead of numbers."""

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods.method import Method
from symmb.bound.responses import RunsOverBox
from symmb.declare.symbolic import interpret
from symmb.prove import Interval, operate, parameter_intervals, require_rounding_to_nearest


@dataclass(frozen=True)
class IntervalArithmetic(Method):
    """Enclosure of plain expressions of parameters and time by natural interval arithmetic, eq. (12).

    Every operation is replaced by its interval extension and rounded outward. The bounds thus contain the range of the
    expression. Constants of the expression, the ends of the box and the times are double precision numbers. The bounds
    are usually far too wide, because an argument that occurs twice counts as two arguments. One evaluation gives the
    bounds at all times.

    Raises
    ------
    PropagationError
        Raised by ``bounds`` if the outputs are not plain expressions, an operation has no interval extension, or an
        argument lies outside the domain of its function.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.IntervalArithmetic()
    IntervalArithmetic()

    References
    ----------
    Moore, Kearfott and Cloud (2009), Introduction to Interval Analysis, chapter 5.
    """

    requires: ClassVar[str] = "expression"
    kind: ClassVar[Kind] = "enclosure"

    def bounds(self, runs: RunsOverBox) -> Bounds:
        simulator, box = runs.simulator, runs.box
        # The attribute is read, because isinstance accepts a property that raises (from Python 3.12 on).
        f: ca.Function | None = getattr(simulator, "expression", None)
        if f is None:
            raise PropagationError(
                f"{self!r}: outputs must be plain expressions of parameters and time, "
                f"but {simulator!r} integrates or calls a function. Use MonteCarlo or PolynomialChaos."
            )
        require_rounding_to_nearest()
        inputs = [parameter_intervals(simulator.parameters, box), [Interval.exactly(simulator.times)] * f.nnz_in(1)]
        values = interpret(f, inputs, operate, Interval.exactly)[0]
        # Outputs that are structurally zero have no entry.
        lower, upper = np.zeros((2, len(simulator.times), len(simulator.outputs)))
        for row, value in zip(f.sparsity_out(0).row(), values, strict=True):
            lower[:, row], upper[:, row] = value.lower, value.upper
        return self._result(runs, lower, upper, 1)
