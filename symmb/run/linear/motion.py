"""A mode as a motion of the scene, for animations."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._errors import SimulationError
from symmb._types import Array
from symmb.declare.mechanics import is_flexible
from symmb.declare.symbolic import batch, common
from symmb.equations.model import Scene
from symmb.run.formulations import Formulation, program_of
from symmb.run.integrate import project
from symmb.run.linear.point import LinearizationPoint
from symmb.run.simulation import Trajectory

_PERIODS, _PICTURES = 3, 36
"""Number of oscillations of the motion, and of output times in each oscillation."""
_STARTED = ("held", "solved", "free", "redundant")


@dataclass(frozen=True, eq=False)
class Origin:
    """The scene and the state of a linearisation.

    Attributes
    ----------
    scene : Scene
    formulation : Formulation
    point : LinearizationPoint
    lift : (n_z, n) array      displacements, velocities, first-order states for unit values of the linear states
    """

    scene: Scene
    formulation: Formulation
    point: LinearizationPoint
    lift: Array

    def motion(self, label: str, eigenvalue: complex, vector: Array, shape: Array) -> Trajectory:
        """The undamped oscillation as a run. `vector` (n,) is its eigenvector, `shape` (n_b,) are displacements."""
        form, p, rate = self.formulation, self.point.p, abs(eigenvalue.imag)
        phase = np.linspace(0.0, 2 * np.pi * _PERIODS, _PERIODS * _PICTURES + 1)
        deviation = self._amplitude(shape) * self.lift @ vector
        Z = np.real(np.exp(1j * phase)[:, None] * deviation)
        X = batch(self._displaced(), self.point.x, Z, p)[0]
        if not np.isfinite(X).all():
            raise SimulationError(f"{label} cannot be shown: joints cannot be closed near the state.")
        scene = self.scene.curves.with_name(label).with_times(self.point.t + phase / rate)
        run = Trajectory(
            scene=scene,
            program=program_of(scene),
            parameters=dict(zip(self.scene.system.parameters, p.tolist(), strict=True)),
            solver="linearize",
            reason="",
            t=np.asarray(scene.times, dtype=float),
            x=form.in_bodies(X, p)[1],
            work=np.full(len(X), np.nan),
            statistics={"start": {name: [] for name in _STARTED}, "integrator": {}},
            setup_seconds=0.0,
            run_seconds=0.0,
        )
        doubt = "This motion is a mode without damping, with a visible amplitude. It is not a run of the scene."
        vars(run).update(doubts=(doubt,))  # replaces the warnings about a run
        return run

    def _displaced(self) -> ca.Function:
        """A function (x, z, p) -> the state after a linear deviation z, with closed joints."""
        dae = self.formulation.dae
        x, p = ca.SX.sym("x", len(self.point.x)), ca.SX.sym("p", len(self.point.p))
        z = ca.SX.sym("z", len(self.lift))
        delta, more = z[: dae.n_v], z[dae.n_v :]
        moved = ca.vertcat(dae.retract(x[: dae.n_q, :], delta), x[dae.n_q :] + more)
        # Number of Newton steps that close joints after large linear displacements. The last step removes rounding.
        closed = project(dae, moved, p, ca.SX(self.point.t), 4)
        return common("displaced", [x, z, p], [ca.densify(moved if closed is None else closed)])

    def _amplitude(self, shape: Array) -> float:
        """The factor that makes displacements of bodies (n_b,) visible."""
        system, (dae, x) = self.scene.system, self.formulation.in_bodies(self.point.x[None], self.point.p)
        places, turns = [], []
        for body in system.bodies:
            places.append(body.frame.velocity)
            if is_flexible(body):
                places += [body.node(number).velocity for number in range(len(body.modes.positions))]
            turns.append(body.frame.omega)
        moved = [ca.densify(self.scene.expression(ca.vertcat(*some))) for some in (places, turns)]
        rates = ca.Function("rates", [system.q, system.v, system.p], moved)
        V = np.stack([np.zeros(len(shape)), shape.real, shape.imag])
        values = batch(rates, x[0, : dae.n_q], V, self.point.p)
        travel, turn = (np.linalg.norm(some[1:] - some[0], axis=0).max(initial=0.0) for some in values)
        # Largest displacement, divided by the length of the scene, and largest angle [rad]. With these, motions are
        # visible and look linear.
        limits = [limit / size for limit, size in ((0.15 * dae.scales.length, travel), (0.25, turn)) if size]
        return float(min(limits))
