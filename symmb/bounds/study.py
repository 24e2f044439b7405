"""What bounds are made from: kept with them, so that more runs can be made."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._progress import shown_runs
from symmb._types import Array
from symmb.black_boxes import Simulator
from symmb.bounds.method import parameter_samples
from symmb.bounds.polynomial_chaos import PolynomialChaos
from symmb.bounds.reductions import gathered, which_failed
from symmb.bounds.result import Bounds
from symmb.integrate import Solver
from symmb.model import Box, Scene
from symmb.nodes import Sobol
from symmb.simulation import DAESimulator, SceneSimulator, simulator_with

_VERIFYING = 16
"""Runs that verify polynomials where their values count, and not only their range: more find narrower kinks."""


@dataclass(frozen=True, eq=False)
class Study:
    """The simulator and the box of bounds."""

    simulator: Simulator
    box: Box

    @property
    def scene(self) -> Scene:
        """The scene. Other simulators have no mechanism."""
        return self.prepared.scene

    @property
    def solver(self) -> Solver:
        """That of the scene."""
        return self.prepared.solver

    @property
    def prepared(self) -> DAESimulator:
        """The scene, prepared for runs."""
        simulator = self.simulator
        if isinstance(simulator, SceneSimulator) and simulator.scene is not None:
            is_whole = isinstance(simulator, DAESimulator)
            return simulator if is_whole else simulator_with(simulator.scene, simulator.solver)
        raise DeclarationError(f"These bounds hold no scene: they are of {self.simulator!r}.")

    @cached_property
    def adaptive(self) -> Bounds:
        """Bounds over the box by PolynomialChaos()."""
        with shown_runs(None, "a study with PolynomialChaos()") as progress:
            return PolynomialChaos().bounds(self.simulator, self.box, progress=progress)

    def range(self, box: Box) -> tuple[Array, Array, Array, int]:
        """Bounds (n_t, n_y) over another box by PolynomialChaos(), their estimated error, and how many runs they took.

        Parameters that are not in the box have their nominal values.
        """
        with shown_runs(None, f"range over {', '.join(box.names)}") as progress:
            bounds = PolynomialChaos().bounds(self.simulator, box, progress=progress)
        assert bounds.estimate is not None
        return bounds.lower, bounds.upper, bounds.estimate, bounds.evaluations

    @cached_property
    def sample(self) -> tuple[Array, Array]:
        """Points (N, d) that are spread over the unit box, and the responses there; none if a run fails."""
        points = Sobol().points(_VERIFYING, len(self.box), seed=1)
        try:
            return points, self.values(points)
        except PropagationError:
            return points[:0], np.zeros((0, len(self.simulator.times), len(self.simulator.outputs)))

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d) of the unit box, where no run may fail."""
        P = parameter_samples(self.simulator, self.box, points)
        Y, bad = gathered(self.simulator, P, None)
        if which_failed(bad, len(P)).any():
            raise PropagationError(
                f"{len(bad)} of {len(P)} runs failed: {bad[0][2]}. Take a box without failures; "
                "bounds by MonteCarlo(n, laws=...) leave failed runs out."
            )
        return Y
