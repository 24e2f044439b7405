"""The linearisation of a scene as a function of its parameters."""

import numpy as np

from symmb._errors import SimulationError, warn_of
from symmb._types import Array
from symmb.linear.eigenvalues import Eigenvalues, eigenvalues
from symmb.linear.linear_equations import LinearEquations, lifts
from symmb.linear.linearization import formulation_of, free_states
from symmb.linear.point import require_smooth, started, steadiness
from symmb.model import Scene
from symmb.simulation import require_scene


class LinearFamily:
    """The linearisation of a scene at its start as a function of its parameters.

    A scene that starts neither in equilibrium nor in a steady motion is a SymmbWarning.
    """

    def __init__(self, scene: Scene) -> None:
        require_scene(scene)
        self.scene = scene
        formulation = formulation_of(scene)
        self.nominal = scene.system.parameters.nominal
        self.t = float(scene.times[0])
        self._formulation, self._equations = formulation, LinearEquations(formulation, often=True)
        point = started(scene, formulation, self.nominal, self.t, None)
        require_smooth(formulation, point, self._equations)
        self._free = free_states(self._equations, self._equations.blocks(point.x[None], self.nominal[None], self.t))
        A = self.matrices(self.nominal[None])[0][0]
        warn_of(steadiness(self._equations, point, A, self._free), f"Linearisation of {scene.name}")

    def matrices(self, P: Array) -> tuple[Array, Array, tuple[str, ...]]:
        """A (N, n, n) for parameters P (N, n_p), all displacements for the states (N, n_z, n), and N reasons.

        A reason says why a start fails. It is empty where the start succeeds.
        """
        X, reasons = self._formulation.start.states(P)
        ok = np.array([not reason for reason in reasons], dtype=bool)
        A = np.full((len(P), len(self._free), len(self._free)), np.nan)
        lift = np.full((len(P), self._equations.n_z, len(self._free)), np.nan)
        if ok.any():
            blocks = self._equations.blocks(X[ok], P[ok], self.t)
            lift[ok] = lifts(blocks, self._free)
            A[ok] = (blocks.A @ lift[ok])[:, self._free]
        return A, lift, reasons

    def eigen(self, p: Array) -> tuple[Eigenvalues, Array]:
        """Eigenvalues and the displacements of their modes (n_v, n) over their sizes, for parameters p (n_p,)."""
        A, lift, (reason,) = self.matrices(p[None])
        if reason:
            raise SimulationError(reason)
        eigen, n_v = eigenvalues(A[0]), self._formulation.dae.n_v
        return eigen, (lift[0] @ eigen.vectors)[:n_v] / self._equations.sizes[:n_v, None]
