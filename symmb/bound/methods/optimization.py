"""Bounds by optimisation of the responses of all outputs and times together, with derivatives of the runs."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import SAME
from symmb._options import constructor_text, require_between, require_whole
from symmb._types import Array
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods.method import Method
from symmb.bound.nodes import corners
from symmb.bound.responses import RunsOverBox, extremes, failure_details, failures, parameter_samples, together
from symmb.bound.searches import quadratics

_SIGNS = np.array([1.0, -1.0]).reshape(2, 1, 1)
"""The two signs of a response: minima of y and of -y give its minimum and its maximum."""


@dataclass(frozen=True)
class Optimization(Method):
    """Smallest and largest responses of all outputs and times together, by Newton steps from the best runs.

    A run with first derivatives gives the value and the gradient of every output at every time. For each minimum and
    maximum, a quadratic model about the best run predicts a better point of the box. The curvature of the model follows
    from secant equations. The next runs are at the best predicted points, and each run also serves all other extremes.
    These runs take the first half of the budget. The second half is for runs without derivatives at the points that the
    last models predict. Runs attain the bounds. The ``estimate`` is the distance of the bounds from the prediction plus
    the last change of the prediction. An extreme far from every run may be missed. The executor makes the runs without
    derivatives.

    Parameters
    ----------
    budget : largest number of evaluations; a run with first derivatives in d parameters counts as 1 + d
    tolerance : smallest predicted improvement, divided by the width at that time, for which a run is made

    Raises
    ------
    DeclarationError
        If the budget is not a positive integer, or the tolerance is not between 0 and 1.
    PropagationError
        Raised by ``bounds`` if the simulator gives no derivatives, if derivatives are not finite, or if the first half
        of the budget is less than one run with derivatives.
    SimulationError
        Raised by ``bounds`` if a run with derivatives fails.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Optimization(budget=500)
    Optimization(budget=500)

    References
    ----------
    Nocedal and Wright, Numerical Optimization (2006), eq. (6.6), the secant equation.
    """

    budget: int = 300
    tolerance: float = 1e-4

    requires: ClassVar[str] = "jets"
    kind: ClassVar[Kind] = "sampled"

    def __post_init__(self) -> None:
        require_whole(self, "budget", 1)
        require_between(self, "tolerance", "()", 0.0, 1.0)

    def bounds(self, runs: RunsOverBox) -> Bounds:
        simulator, box, shape = runs.simulator, runs.box, runs.shape
        points, attained, predicted, before, evaluations = self._descended(runs)
        P = parameter_samples(simulator, box, points)
        (lower, upper, _), bad = simulator.stream(P, together(extremes(simulator), failures()), runs.executor)
        attained = np.minimum(attained, np.concatenate([lower.ravel(), -upper.ravel()]))
        estimate = np.abs(attained - predicted) + np.abs(predicted - before)
        lower, upper = attained.reshape(2, *shape) * _SIGNS
        return self._result(
            runs,
            lower,
            upper,
            evaluations + len(P),
            estimate=estimate.reshape(2, *shape).max(axis=0),
            inner=(lower, upper),
            **failure_details(simulator, box, points, P, bad),
        )

    def _descended(self, runs: RunsOverBox) -> tuple[Array, Array, Array, Array, int]:
        """Points for further runs, smallest values of the runs with derivatives, the last two predictions, and
        evaluations. A maximum of y is a minimum of -y: the arrays contain all y, then all -y."""
        d, shape = len(runs.box), runs.shape
        cost = 1 + d
        most = self.budget // 2 // cost
        if not most:
            raise PropagationError(
                f"{self!r}: a run with derivatives in {d} parameters counts as {cost} evaluations. "
                f"This is more than half the budget. Give a budget of at least {2 * cost}."
            )
        new = corners(d) if 2**d < most else np.empty((0, d))
        new = np.concatenate([np.zeros((1, d)), new])
        X, J, n = np.empty((0, d)), list[Array](), math.prod(shape)
        attained, predicted = np.full(2 * n, np.inf), None
        lowest, falling = np.zeros(2 * n, dtype=int), np.ones(2 * n, dtype=bool)
        while True:
            for x, jets in zip(new, self._jets(runs, new), strict=True):
                values = np.concatenate([jets[:, 0], -jets[:, 0]])
                better = np.flatnonzero(values < attained)
                attained[better], lowest[better] = values[better], len(J)
                # A function that rises along all edges from a corner of the box probably has its minimum there.
                slopes = jets[better % n, 1:] * np.where(better < n, 1.0, -1.0)[:, None]
                falling[better] = (x * np.sign(slopes) > SAME - 1.0).any(axis=1)
                J.append(jets)
            X = np.concatenate([X, new])
            if runs.progress is not None:
                runs.progress(len(X) * cost, self.budget)
            some = np.flatnonzero(falling)
            models = quadratics(X, J, some, lowest[some])
            least = self.tolerance * np.tile(_widths(attained.reshape(2, *shape), J[0]).ravel(), 2)[some]
            before = attained.copy() if predicted is None else predicted
            predicted = attained.copy()
            predicted[some] -= models.gain
            # Number of runs between two fits. Smaller numbers use runs better, but each fit takes time.
            new = models.promising(least, min(8, most - len(X)))
            if not len(new):
                evaluations = len(X) * cost
                return models.promising(least, self.budget - evaluations), attained, predicted, before, evaluations

    def _jets(self, runs: RunsOverBox, points: Array) -> Array:
        """Values and slopes (N, n_t n_y, 1 + d) of all outputs and times at points (N, d)."""
        N, d = points.shape
        Y, slopes = runs.unit_jets(points.repeat(d, axis=0), np.tile(np.eye(d), (N, 1)), 1)
        return np.stack([Y[::d], *(slopes[i::d] for i in range(d))], axis=-1).reshape(N, -1, 1 + d)

    def __repr__(self) -> str:
        return constructor_text(self)


def _widths(attained: Array, jets: Array) -> Array:
    """Widths (n_t, n_y), the scales of gains, from the smallest values (2, n_t, n_y) of y and of -y.

    The width of a single run follows from its jets (n_t n_y, 1 + d). The width is inf if an output is always 0.
    """
    width = -attained.sum(axis=0)
    if not width.any():
        width = 2 * np.abs(jets[:, 1:]).sum(axis=1).reshape(width.shape)
    # Smallest width of an output at a time, divided by its largest width over all times.
    least = np.maximum(1e-2 * width.max(axis=0), SAME * np.abs(attained).max(axis=(0, 1)))
    widths = np.maximum(width, least)
    return np.where(widths > 0, widths, np.inf)
