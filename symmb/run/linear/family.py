"""The linearisation of a scene as a function of its parameters."""

import numpy as np

from symmb._errors import SimulationError, warn_of
from symmb._types import Array
from symmb.equations.model import Scene
from symmb.run.linear.doubts import doubts_of
from symmb.run.linear.eigenvalues import Eigenvalues, eigenvalues
from symmb.run.linear.linear_equations import Blocks, LinearEquations
from symmb.run.linear.linearization import formulation_of, free_states
from symmb.run.linear.point import LinearizationPoint, require_smooth, started
from symmb.run.linear.steady import SteadyMotion
from symmb.run.simulation import scene_of
from symmb.run.verification import attached_loads, with_loads


class LinearFamily:
    """The linearisation of a scene at its start as a function of its parameters.

    A SymmbWarning is issued, and added to `doubts`, if the scene starts neither in equilibrium nor in a steady motion.
    There is also a warning if modes of flexible bodies make frequencies too high at the nominal parameters.
    """

    def __init__(self, scene: Scene) -> None:
        scene = scene_of(scene)
        self.scene = scene
        formulation = formulation_of(scene)
        self.nominal = scene.system.parameters.nominal
        self.t = float(scene.times[0])
        self._formulation, self._equations = formulation, LinearEquations(formulation, often=True)
        point = started(scene, formulation, self.nominal, self.t, None)
        require_smooth(formulation, point, self._equations)
        loads = attached_loads(scene)
        equations = LinearEquations(with_loads(scene, formulation, loads)) if loads else self._equations
        blocks = equations.blocks(point.x[None], self.nominal[None], self.t)
        motion = SteadyMotion(equations, point, blocks, free_states(equations, blocks))
        self.doubts = doubts_of(scene, motion, blocks, loads)
        self._turns: bool | None = None
        warn_of(self.doubts, f"Linearisation of {scene.name}")

    def eigen(self, p: Array) -> tuple[Eigenvalues, Array]:
        """Eigenvalues for parameters p (n_p,), and displacements (n_v, n) of the modes, divided by typical sizes."""
        (found,) = self.eigen_of(p[None])
        return found

    def eigen_of(self, P: Array) -> list[tuple[Eigenvalues, Array]]:
        """The results of `eigen` for each row of parameters P (N, n_p)."""
        X, reasons = self._formulation.start.states(P)
        for k, reason in enumerate(reasons):
            if reason:
                raise SimulationError(reason + self._place(P, k))
        blocks, n_v, found = self._equations.blocks(X, P, self.t), self._formulation.dae.n_v, []
        for k in range(len(P)):
            with np.errstate(over="ignore", invalid="ignore"):
                A, lift = self._reduced(blocks[k], LinearizationPoint(X[k], P[k], self.t))
            if not np.isfinite(A).all():
                raise SimulationError(f"Entries of the matrix A are infinite or undefined{self._place(P, k)}.")
            eigen = eigenvalues(A)
            found.append((eigen, (lift @ eigen.vectors)[:n_v] / self._equations.sizes[:n_v, None]))
        return found

    def _place(self, P: Array, k: int) -> str:
        """Row k of the samples P (N, n_p) in words: the parameters that differ among the samples."""
        names = list(self.scene.system.parameters)
        told = ", ".join(f"{names[i]} = {P[k, i]:g}" for i in np.flatnonzero(np.ptp(P, axis=0)))
        return f" at {told}" if told else ""

    def _reduced(self, blocks: Blocks, point: LinearizationPoint) -> tuple[Array, Array]:
        """The matrix A (n, n) of one sample, and all displacements (n_z, n) for unit states.

        Independent states are chosen for each sample, because the choice for another sample may be wrong for this one.
        For example, the heading of a bicycle follows from its sideways motion only if the bicycle moves.
        """
        free = free_states(self._equations, blocks)
        motion = SteadyMotion(self._equations, point, blocks, free)
        if self._turns is None and motion.moves:  # the first sample that moves decides whether coordinates rotate
            self._turns = motion.turning is not None and bool(motion.turning.any())
        return motion.turned(motion.best_turning() if self._turns and motion.moves else None), motion.lift
