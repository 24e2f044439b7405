"""Bounds by optimising the responses themselves, every output and time at once, with derivatives of the runs."""

import itertools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from symmb._box import Box
from symmb._errors import DeclarationError, PropagationError
from symmb._types import Array, Executor
from symmb.bounds._jets import unit_jets
from symmb.bounds._method import Method, constructor_text, parameter_samples, require_whole
from symmb.bounds._quadratic import quadratics
from symmb.bounds._reductions import extremes, failure_records, failures, together
from symmb.bounds._result import Bounds, Kind
from symmb.simulate import Progress, Simulator

_BATCH = 8
"""Runs with derivatives between two fits: fewer runs serve more, but every fit takes its time."""
_NARROW = 1e-2
"""Share of an output's largest width that counts as its width at the times where it is narrower."""
_ROUNDING = 1e-9
"""Share of an output's scale that counts as its width where it has none."""


@dataclass(frozen=True)
class Optimization(Method):
    """Smallest and largest responses found by Newton steps from the best runs, of all outputs and times together.

    A run with first derivatives gives value and gradient of every output at every time. About the best run of each
    minimum or maximum a quadratic with secant curvature predicts a better point of the box; the next runs are
    those whose prediction promises most, each taken to serve all others as far as their own quadratics say. The
    first half of the budget is spent so; the other half on runs without derivatives where the last quadratics
    point. The bounds are attained. Their ``estimate`` is the improvement still predicted plus the last change of
    the prediction; an extreme far from every run may be missed. The executor serves the runs without derivatives.

    Parameters
    ----------
    budget : most evaluations; a run with first derivatives in d parameters counts 1 + d
    tolerance : predicted improvement below which nothing is tried, as a share of the width at that time

    Raises
    ------
    DeclarationError
        If the budget is not a positive integer or the tolerance not between 0 and 1.
    PropagationError
        From ``bounds``: the simulator gives no derivatives, they are not finite, or the budget's first half does
        not pay one run with them.
    SimulationError
        From ``bounds``: a run with derivatives breaks down.

    Examples
    --------
    >>> Optimization(budget=500)
    Optimization(budget=500)

    References
    ----------
    Nocedal and Wright, Numerical Optimization (2006), eq. (6.6), secant condition, and section 16.7, bounds.
    """

    budget: int = 300
    tolerance: float = 1e-4

    kind: ClassVar[Kind] = "sampled"

    def __post_init__(self) -> None:
        require_whole("Optimization", "budget", self.budget, 1)
        if not 0 < self.tolerance < 1:
            raise DeclarationError(f"Optimization: tolerance must be between 0 and 1, got {self.tolerance!r}.")

    def _bounds(self, simulator: Simulator, box: Box, executor: Executor | None, progress: Progress | None) -> Bounds:
        d, shape = len(box), (len(simulator.times), len(simulator.outputs))
        most = self.budget // 2 // (1 + d)
        if not most:
            raise PropagationError(
                f"{self!r}: a run with derivatives in {d} parameters counts {1 + d}, more than half the budget. "
                f"Give a budget of at least {2 * (1 + d)}."
            )
        center = np.zeros((1, d))
        new = np.concatenate([center, _corners(d)]) if 2**d < most else center
        X, F, G = np.empty((0, d)), np.empty((0, 2 * shape[0] * shape[1])), np.empty((0, d, 2 * shape[0] * shape[1]))
        predicted = None
        while True:
            jets = [unit_jets(self, simulator, box, x, np.eye(d), 1) for x in new]
            # A maximum of y is a minimum of -y: columns of both.
            F = np.concatenate([F, *(_both(J[0, :1].reshape(1, -1)) for J in jets)])
            G = np.concatenate([G, *(_both(J[1].reshape(1, d, -1)) for J in jets)])
            X = np.concatenate([X, new])
            if progress is not None:
                progress(len(X) * (1 + d), self.budget)
            models = quadratics(X, F, G)
            found = F.min(axis=0)
            before = found if predicted is None else predicted
            predicted = found - models.gain
            least = self.tolerance * _widths(found, shape)
            new = models.promising(least, min(_BATCH, most - len(X)))
            if not len(new):
                break
        runs = len(X) * (1 + d)
        P = parameter_samples(simulator, box, models.promising(least, self.budget - runs))
        (lower, upper), bad = simulator.stream(P, together(extremes(simulator), failures()), executor)
        found = np.minimum(found, np.concatenate([lower.ravel(), -upper.ravel()]))
        estimate = np.abs(found - predicted) + np.abs(predicted - before)
        lower, upper = found[: found.size // 2].reshape(shape), -found[found.size // 2 :].reshape(shape)
        return Bounds(
            t=simulator.times,
            names=simulator.outputs,
            lower=lower,
            upper=upper,
            kind=self.kind,
            method=repr(self),
            evaluations=runs + len(P),
            estimate=estimate.reshape(2, *shape).max(axis=0),
            inner=(lower, upper),
            failed=failure_records(simulator, box, P, bad),
        )

    def __repr__(self) -> str:
        return constructor_text(self)


def _corners(d: int) -> Array:
    """(2^d, d) corners of [-1, 1]^d."""
    return np.array(list(itertools.product((-1.0, 1.0), repeat=d)))


def _both(values: Array) -> Array:
    return np.concatenate([values, -values], axis=-1)


def _widths(found: Array, shape: tuple[int, int]) -> Array:
    """Widths (2 n_t n_y,) that predicted improvements are measured by, from the extremes found."""
    lower, upper = found.reshape(2, *shape) * np.array([1.0, -1.0])[:, None, None]
    width = upper - lower
    least = np.maximum(_NARROW * width.max(axis=0), _ROUNDING * np.maximum(abs(lower), abs(upper)).max(axis=0))
    widths = np.tile(np.maximum(width, least).ravel(), 2)
    return np.where(widths > 0, widths, np.inf)
