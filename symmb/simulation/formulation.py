"""The formulation in which a scene runs: in coordinates of its bodies, or of the joints that carry them."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symmb.model import DAE, Scene, compile_dae
from symmb.simulation.outputs import joint_output_function, output_function
from symmb.start import Start, prepare_start, start_in_joints

_STAGE = 8
"""Operations of a stage of an explicit step for each state: sums of slopes."""


@dataclass(frozen=True, eq=False)
class Formulation:
    """Equations, start and outputs in the same coordinates.

    Attributes
    ----------
    dae : DAE
    start : Start
    y : (x, p, t) -> outputs (n_y,)
    """

    dae: DAE
    start: Start
    y: ca.Function

    @property
    def operations(self) -> int:
        """Operations of a stage of an explicit step."""
        return self.dae.rhs.n_instructions() + _STAGE * self.y.numel_in(0)


def in_bodies(scene: Scene) -> Formulation:
    """A scene in coordinates of its bodies.

    Raises
    ------
    AssemblyError              if the scene cannot be started
    """
    dae = compile_dae(scene.system)
    start = prepare_start(scene, dae)
    if start.rows is not None:
        dae = compile_dae(scene.system, start.rows, start.nullities)
    dae = replace(_scaled(dae, start, scene), sampling=start.dae.sampling)
    return Formulation(dae, start, output_function(dae, scene, scene.y))


def in_joints(scene: Scene, bodies: Formulation) -> Formulation | None:
    """A scene in coordinates of its joints. None if no joint carries a body, and where bodies are needed.

    They are needed to find a static equilibrium, where constraints are redundant, and for sampled values.
    """
    redundant = bodies.start.rows is not None
    if redundant or scene.equilibrium or bodies.dae.sampling is not None:
        return None
    system = scene.system.joint_space()
    if not any(link.carrying for link in system.joints.links):
        return None
    dae = compile_dae(system)
    start = start_in_joints(bodies.start, scene.system, system, dae)
    return Formulation(
        _scaled(dae, start, scene), start, joint_output_function(bodies.dae, dae, scene, system, scene.y)
    )


def _scaled(dae: DAE, start: Start, scene: Scene) -> DAE:
    return replace(dae, scales=start.scales(dae, float(np.ptp(scene.times))))
