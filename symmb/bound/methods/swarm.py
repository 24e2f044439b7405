"""Bounds by particle swarms, one for each minimum and maximum, as in references of the literature."""

import operator
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from symmb._limits import require_memory, require_runs
from symmb._options import constructor_text, require_whole
from symmb._types import Array, Indices, Mask
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods.method import Method
from symmb.bound.responses import (
    Failure,
    RunsOverBox,
    extremes,
    failed_region,
    failure_records,
    failures,
    parameter_samples,
    require_some,
    together,
    which_failed,
)
from symmb.connect import Reduction, Samples

_CONSTRICTION, _PULL = 0.7298, 2.05
"""Factor on the velocity, and largest acceleration factor towards the best points of a particle and of its swarm: Clerc
and Kennedy (2002), IEEE Transactions on Evolutionary Computation 6, 58-73."""


@dataclass(frozen=True)
class Swarm(Method):
    """Extremes found by particle swarms: for every output and time, one swarm minimises and one maximises.

    All 2 n_t n_y swarms make their steps together, with one call of the simulator for each step. A particle only
    optimises the output and time of its swarm, but the bounds are the extremes of all runs. The method takes 2 n_t n_y
    ``particles`` ``steps`` runs, so use few output times. If a run fails, its particle continues, and the failed
    point is never the best point.

    Parameters
    ----------
    particles : number of particles of each swarm
    steps : number of positions of each particle, including the random start
    seed : seed of the random numbers

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Swarm(particles=20)
    Swarm(particles=20)

    References
    ----------
    Clerc and Kennedy, IEEE Transactions on Evolutionary Computation 6 (2002), the constricted swarm.
    """

    particles: int = 10
    steps: int = 20
    seed: int = 0

    kind: ClassVar[Kind] = "sampled"

    def __post_init__(self) -> None:
        require_whole(self, "particles", 1)
        require_whole(self, "steps", 1)
        require_whole(self, "seed", 0)

    def bounds(self, runs: RunsOverBox) -> Bounds:
        simulator, box, (n_t, n_y), d = runs.simulator, runs.box, runs.shape, len(runs.box)
        random = np.random.default_rng(self.seed)
        shape = 2 * n_t * n_y, self.particles, d
        number = shape[0] * self.particles
        require_runs(self, self.steps * number, "Use fewer times, particles or steps.")
        require_memory(self, "the positions of all particles", self.steps * number * d)
        watched = Reduction(tuple, partial(_watch, n_t * n_y, self.particles), operator.add)
        reduction = together(watched, extremes(simulator), failures())
        x, velocity = random.uniform(-1.0, 1.0, shape), np.zeros(shape)
        own, least = x.copy(), np.full(shape[:2], np.inf)
        lower, upper = np.full((n_t, n_y), np.inf), np.full((n_t, n_y), -np.inf)
        failed: tuple[Failure, ...] = ()
        points, lost = list[Array](), list[Mask]()
        for step in range(self.steps):
            P = parameter_samples(simulator, box, x.reshape(number, d))
            values, (low, high, _), bad = simulator.stream(P, reduction, runs.executor)
            lower, upper = np.minimum(lower, low), np.maximum(upper, high)
            failed += failure_records(simulator, box, P, bad)
            points.append(x.reshape(number, d))
            lost.append(which_failed(bad, number))
            if runs.progress is not None:
                runs.progress((step + 1) * number, self.steps * number)
            value = np.concatenate(values).reshape(shape[:2])
            better = value < least
            own[better], least[better] = x[better], value[better]
            common = np.take_along_axis(own, least.argmin(axis=1)[:, None, None], axis=1)
            pull = random.uniform(0.0, _PULL, shape) * (own - x) + random.uniform(0.0, _PULL, shape) * (common - x)
            moved = np.clip(x + _CONSTRICTION * (velocity + pull), -1.0, 1.0)
            x, velocity = moved, moved - x
        require_some(self, failed, self.steps * number)
        region = failed_region(box, np.concatenate(points), np.concatenate(lost))
        details = {"inner": (lower, upper), "failed": failed, "failed_region": region}
        return self._result(runs, lower, upper, self.steps * number, **details)

    def __repr__(self) -> str:
        return constructor_text(self)


def _watch(pairs: int, particles: int, state: tuple[Array, ...], block: Samples, indices: Indices) -> tuple[Array, ...]:
    """The objective of each run: a response, or its negative in the second half of the swarms; inf for a failed run."""
    swarm = indices // particles
    values = block.Y.reshape(len(indices), -1)[np.arange(len(indices)), swarm % pairs]
    return (*state, np.where(block.ok, np.where(swarm < pairs, values, -values), np.inf))
