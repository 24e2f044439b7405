"""Designs as points of a box, their intervals, and polynomials of their outputs in a region of designs."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Executor, Mask
from symmb._units import units_of_parameters
from symmb.bound.bounds import Limits, fitted, gathered, parameter_samples
from symmb.bound.nodes import Sobol
from symmb.bound.polynomials.ranges import Piecewise
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box

LARGEST_FACTOR = 4.0
"""Largest factor of a tolerance with costs. The smallest factor is its inverse."""
_NUMBERS, _FEWEST, _ACCURATE = (64, 128, 256), 8, 0.02
"""Numbers of runs of the polynomials of a region, which increase until the error of the polynomials, divided by the
standard deviation, is small enough, and smallest number of runs that do not fail."""
_EDGE = 1e-3
"""Distance from an end that is no distance, in a region of size 1."""
WEIGHTS = {"upper": (0.0, 1.0), "lower": (-1.0, 0.0), "width": (-1.0, 1.0)}
"""Weights of the lowest and of the highest value in a goal."""
COST, FAILED = -2, -1
"""Numbers of the columns of the cost, and of failures: 1 if a run fails, and -1 otherwise."""


class Goal(NamedTuple):
    """A number that should be small: an upper bound, a negative lower bound, or a width, the largest over time.

    `k` is the number of the column. `most` is the limit; infinite for objectives.
    """

    k: int
    side: str
    most: float = np.inf


class Region(NamedTuple):
    """Designs between two ends (n,), the box and runs of all their parameters, polynomials, and the sizes (n_c,) of
    output changes."""

    low: Array
    high: Array
    joint: Box
    points: Array
    Y: Array
    surrogate: Piecewise
    is_accurate: bool
    changes: Array


class DesignSpace:
    """Designs z (n,) are the values of the variables, followed by the logarithms of the factors of tolerances.

    Parameters are the variables, followed by the other parameters of the box. `limits` are those of outputs, and `held`
    are the goals of all limits. Columns (n_c,) are the outputs, the failed runs and the cost.
    """

    def __init__(
        self,
        simulator: Simulator,
        ranges: Box,
        tolerances: Box | None,
        allocated: Sequence[str],
        cost: Callable[[Array], float],
        limits: Limits,
        held: Sequence[Goal],
        executor: Executor | None,
        progress: Progress | None,
    ) -> None:
        self.simulator, self._limits, self._cost = simulator, limits, cost
        self._held, self._executor, self._progress = [*held, Goal(FAILED, "upper", -0.5)], executor, progress
        ends = {} if tolerances is None else dict(zip(tolerances.names, tolerances.bounds, strict=True))
        self.names = tuple(dict.fromkeys([*ranges, *(name for name, (low, high) in ends.items() if low < high)]))
        self._nominal = np.array([float(simulator.parameters[name]) for name in self.names])
        own = np.array([ends.get(name, (p, p)) for name, p in zip(self.names, self._nominal, strict=True)])
        self._below, self._above = np.abs(own.T - self._nominal)
        self._n_x, self._scaled = len(ranges), [self.names.index(name) for name in allocated]
        lowest, highest = self._nominal.copy(), self._nominal.copy()
        lowest[: self._n_x], highest[: self._n_x] = ranges.lower, ranges.upper
        with np.errstate(divide="ignore", invalid="ignore"):  # no interval of a mass or length may reach 0
            to_zero = np.where(lowest > 0, lowest / self._below, np.where(highest < 0, -highest / self._above, np.inf))
        most = np.log(np.clip(0.99 * to_zero[self._scaled], 1.0, LARGEST_FACTOR))
        self.low = np.concatenate([ranges.lower, np.full(len(most), -np.log(LARGEST_FACTOR))])
        self.high = np.concatenate([ranges.upper, most])
        self.evaluations, self.failure, self._regions = 0, "", list[Region]()

    def factors(self, z: Array) -> Array:
        """Factors (n_f,) of the tolerances with costs."""
        return np.exp(z[self._n_x :])

    def cost(self, z: Array) -> float:
        """Sum of the costs of the tolerances."""
        return self._cost(self.factors(z))

    def _middle(self, z: Array) -> Array:
        """Nominal values (d,) of the parameters."""
        return np.concatenate([z[: self._n_x], self._nominal[self._n_x :]])

    def _ends(self, z: Array) -> Array:
        """Ends (2, d) of the intervals of a design."""
        middle, factors = self._middle(z), np.ones(len(self.names))
        factors[self._scaled] = self.factors(z)
        return np.array([middle - factors * self._below, middle + factors * self._above])

    def _box(self, low: Array, high: Array) -> Box:
        ends = dict(zip(self.names, zip(low.tolist(), high.tolist(), strict=True), strict=True))
        return Box(**ends).with_units(units_of_parameters(self.simulator.parameters))

    def box(self, z: Array) -> Box:
        """The intervals of a design."""
        return self._box(*self._ends(z))

    def at_ends(self, z: Array, low: Array, high: Array) -> tuple[Mask, Mask]:
        """Masks (n,) of the parts of a design at the lower and at the upper ends."""
        near = _EDGE * (high - low)
        return z <= low + near, z >= high - near

    def _runs(self, box: Box, points: Array) -> Array:
        """Outputs and failures (N, n_t, n_y + 1) at points (N, d) of a box. Outputs of failed runs are nan."""
        Y, bad = gathered(self.simulator, parameter_samples(self.simulator, box, points), self._executor)
        self.evaluations += len(Y)
        failed = np.full((*Y.shape[:2], 1), -1.0)
        failed[[index for index, _, _ in bad]] = 1.0
        if bad:
            self.failure = bad[0][2]
        return np.concatenate([Y, failed], axis=2)

    def region(self, centre: Array, size: float) -> Region:
        """A region about a design, or a smaller known one. The size is a fraction of the ranges."""
        half = size * (self.high - self.low) / 2
        for known in self._regions:
            fits = (known.high - known.low <= 2.01 * half).all()
            quarter = (known.high - known.low) / 4
            is_low = (centre >= known.low + quarter) | (known.low <= self.low)
            if fits and (is_low & ((centre <= known.high - quarter) | (known.high >= self.high))).all():
                return known
        centre = np.clip(centre, self.low + half, self.high - half)
        low, high = centre - half, centre + half
        narrow = np.concatenate([low[: self._n_x], high[self._n_x :]])
        joint = self._box(self._ends(narrow)[0], self._ends(high)[1])
        share, points, Y = np.inf, np.zeros((0, len(self.names))), self._runs(joint, np.zeros((0, len(self.names))))
        for n in _NUMBERS:
            new, before = Sobol().points(n, len(self.names), seed=1)[len(points) :], share
            new = np.sin(np.pi / 2 * new)
            points, Y = np.concatenate([points, new]), np.concatenate([Y, self._runs(joint, new)])
            ok = Y[:, 0, FAILED] < 0
            if ok.sum() < _FEWEST:
                raise PropagationError(f"design: {(~ok).sum()} of {len(ok)} runs in the ranges fail: {self.failure}")
            known = Y.copy()
            if not ok.all():  # the boundary between failed and other runs is a polynomial, too
                known[~ok, :, :-1] = fitted(points[ok], Y[ok], joint.names).values(points[~ok])[..., :-1]
            surrogate, outputs = fitted(points, known, joint.names), Y[ok][..., :-1]
            error, spread = np.square(surrogate.error[:, :-1]).mean(axis=0), outputs.var(axis=0).mean(axis=0)
            share = float(np.sqrt(error / np.maximum(spread, 1e-300)).max())
            if share <= _ACCURATE or share > before / 2:  # kinks: more runs would not help much
                break
        sizes = outputs.max(axis=1).std(axis=0) + outputs.min(axis=1).std(axis=0)
        sizes += 1e-9 * np.abs(outputs).max(axis=(0, 1)) + 1e-300
        changes = np.array([*sizes, self.cost((low + high) / 2) or 1.0, 1.0])
        self._regions.append(Region(low, high, joint, points, Y, surrogate, share <= _ACCURATE, changes))
        return self._regions[-1]

    def curves(self, goals: Sequence[Goal], z: Array, extremes: Array) -> list[Array]:
        """The curves (n_t,) of goals from the lowest and highest values (2, n_t, n_c)."""
        cost = np.full(extremes.shape[1], self.cost(z))
        return [cost if g.k == COST else np.tensordot(WEIGHTS[g.side], extremes[..., g.k], 1) for g in goals]
