"""Values that outputs can have whatever the motion: a clamped force is not negative, nor is a distance."""

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.black_boxes import Simulator
from symmb.bounds.interval import Interval, operate
from symmb.model import Box
from symmb.simulation import DAESimulator
from symmb.symbolic import interpret

_MOST = 10_000
"""Operations of outputs that take a tenth of a second."""


def possible_values(simulator: Simulator, box: Box) -> tuple[Array, Array]:
    """Least and largest values (n_t, n_y) of the outputs over a box, for all states. They are infinite if unknown."""
    shape = len(simulator.times), len(simulator.outputs)
    lower, upper = np.full(shape, -np.inf), np.full(shape, np.inf)
    if not isinstance(simulator, DAESimulator) or simulator.y.n_instructions() > _MOST:
        return lower, upper
    y, anything = simulator.y, Interval(np.array(-np.inf), np.array(np.inf))
    ends = {name: (value, value) for name, value in simulator.parameters.items()}
    ends |= dict(zip(box.names, box.bounds, strict=True))
    parameters = [Interval(*map(np.asarray, pair)) for pair in ends.values()]

    def operation(code: int, arguments: tuple[Interval, ...]) -> Interval:
        try:
            return operate(code, arguments)
        except PropagationError:  # the operation has no extension, or some states have no value
            return anything

    inputs = [[anything] * y.nnz_in(0), parameters, [Interval.exactly(simulator.times)] * y.nnz_in(2)]
    for row, value in zip(y.sparsity_out(0).row(), interpret(y, inputs, operation, Interval.exactly)[0], strict=True):
        lower[:, row], upper[:, row] = value
    return lower, upper
