"""The linearisation of a scene as a function of its parameters."""

import numpy as np

from symmb._errors import SimulationError
from symmb._types import Array
from symmb.linear.eigenvalues import Eigenvalues, eigenvalues
from symmb.linear.linear_equations import LinearEquations, lifts
from symmb.linear.linearization import formulation_of, free_states
from symmb.linear.point import require_smooth, started
from symmb.model import Scene
from symmb.simulation import require_scene


class LinearFamily:
    """The linearisation of a scene at its start as a function of its parameters."""

    def __init__(self, scene: Scene) -> None:
        require_scene(scene)
        self.scene = scene
        formulation = formulation_of(scene)
        self.nominal = scene.system.parameters.nominal
        self.t = float(scene.times[0])
        self._formulation, self._equations = formulation, LinearEquations(formulation)
        point = started(scene, formulation, self.nominal, self.t, None)
        require_smooth(formulation, point, self._equations)
        self._free = free_states(formulation, self._equations.blocks(point.x[None], self.nominal[None], self.t))
        dae = formulation.dae
        self._sizes = np.concatenate([dae.displacement_scales, dae.displacement_scales, np.ones(dae.n_s)])

    def matrices(self, P: Array) -> tuple[Array, Array, tuple[str, ...]]:
        """A (N, n, n), and all displacements for the states (N, n_z, n), for parameters P (N, n_p); with the reasons
        why starts fail, empty where they do not."""
        X, reasons = self._formulation.start.states(P)
        ok = np.array([not reason for reason in reasons], dtype=bool)
        A = np.full((len(P), len(self._free), len(self._free)), np.nan)
        lift = np.full((len(P), len(self._sizes), len(self._free)), np.nan)
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
        found, n_v = eigenvalues(A[0]), self._formulation.dae.n_v
        return found, (lift[0] @ found.vectors)[:n_v] / self._sizes[:n_v, None]
