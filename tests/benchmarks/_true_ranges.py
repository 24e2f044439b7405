"""Ranges of simulators over a box by very many runs: what bounds are compared with."""

import numpy as np
from scipy.stats import qmc

from symmb._types import Array
from symmb.bound.responses import parameter_samples
from symmb.connect import Simulator
from symmb.equations.model import Box

POINTS = 13
"""Logarithm of 2 of the Sobol points. A third of them are moved to corners, a third to edges and faces."""
MOST_CORNERS = 12
"""Most parameters of which all corners are run."""
ROUNDS, STEPS, PLACES = 6, (0.6, 0.3, 0.1), 60
"""Local searches: rounds for each step, and places of which the neighbours along each parameter are run."""
AT_ONCE = 2000
"""Runs that are kept in memory."""


def true_range(simulator: Simulator, box: Box, seed: int = 0) -> tuple[Array, Array, int]:
    """Smallest and largest responses (n_t, n_y), and the number of runs that gave them.

    Runs are at corners, at Sobol points, on edges and faces, and then at the neighbours of the best places.
    """
    d, rng = len(box), np.random.default_rng(seed)
    corners = np.indices((2,) * d).reshape(d, -1).T * 2.0 - 1.0
    if d > MOST_CORNERS:
        corners = rng.choice([-1.0, 1.0], (2**MOST_CORNERS, d))
    inside = 2 * qmc.Sobol(d, seed=rng).random_base2(POINTS) - 1
    moved = rng.uniform(size=inside.shape) < rng.choice([0.0, 0.5, 1.0], (len(inside), 1))
    search = _Search(simulator, box)
    search.run(np.concatenate([np.zeros((1, d)), corners, np.where(moved, np.sign(inside), inside)]))
    for step in STEPS:
        for _ in range(ROUNDS):
            places = search.best_places(rng)
            steps = step * np.concatenate([np.eye(d), -np.eye(d)])
            before = search.low.sum() - search.high.sum()
            search.run(np.unique(np.clip(places[:, None] + steps, -1, 1).reshape(-1, d), axis=0))
            if search.low.sum() - search.high.sum() == before:
                break
    return search.low, search.high, search.runs


class _Search:
    """The best values so far, and where they are."""

    def __init__(self, simulator: Simulator, box: Box) -> None:
        self.simulator, self.box, self.runs = simulator, box, 0
        shape = len(simulator.times), len(simulator.outputs)
        self.low, self.high = np.full(shape, np.inf), np.full(shape, -np.inf)
        self.at = np.zeros((2, *shape, len(box)))

    def run(self, points: Array) -> None:
        for first in range(0, len(points), AT_ONCE):
            some = points[first : first + AT_ONCE]
            Y = self.simulator.run(parameter_samples(self.simulator, self.box, some)).Y
            self.runs += len(some)
            for side, (best, better) in enumerate(((np.nanargmin, self.low), (np.nanargmax, self.high))):
                row = best(Y, axis=0)
                value = np.take_along_axis(Y, row[None], axis=0)[0]
                is_new = value < better if side == 0 else value > better
                better[is_new] = value[is_new]
                self.at[side][is_new] = some[row[is_new]]

    def best_places(self, rng: np.random.Generator) -> Array:
        """Some of the places (k, d) of extremes, the most frequent ones first."""
        places, count = np.unique(self.at.reshape(-1, len(self.box)).round(6), axis=0, return_counts=True)
        order = np.argsort(-count * rng.uniform(0.5, 1.0, len(count)))
        return places[order[:PLACES]]
