"""A first guess of rotations: bodies turned to the axes of their joints."""

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.mechanics import AxisJoint
from symmb.model import DAE, Scene
from symmb.symbolic import product


def turned_to_axes(scene: Scene, dae: DAE, q: Array, free: Indices) -> Array:
    """Coordinates q after bodies are turned by the least angle to joints whose axes are at least 60 degrees apart.

    Newton's method does not converge from axes at right angles, and finds the flipped root beyond. Only rotations that
    are neither listed nor guessed are turned, and only for joints with an `axis_b` of their own.
    """
    system = scene.system
    for joint in system.elements:
        if not isinstance(joint, AxisJoint) or joint.axis_b is None or not joint.assembly_cosines().numel():
            continue
        A, B = joint.frames
        axes = ca.Function("axes", [system.q, system.p], [A[:, 2], B[:, 2]])
        a, b = (np.asarray(axis).ravel() for axis in axes(q, dae.p_nominal))
        movable = [body for body in reversed(joint.bodies()) if _turns_freely(scene, dae, body.name, free)]
        if a @ b > 0.5 or not movable:
            continue
        start, end = (b, a) if movable[0] is joint.point_b.body else (a, b)
        axis = np.cross(start, end)
        if np.linalg.norm(axis) < 1e-9:  # opposite: about any axis at right angles
            axis = np.cross(start, np.eye(3)[np.abs(start).argmin()])
        half = np.arccos(np.clip(start @ end, -1, 1)) / 2
        turn = np.concatenate([[np.cos(half)], np.sin(half) * axis / np.linalg.norm(axis)])
        at = dae.q_names.index(f"{movable[0].name}.e0")
        q = q.copy()
        q[at : at + 4] = np.asarray(ca.DM(product(ca.SX(turn), ca.SX(q[at : at + 4])))).ravel()
    return q


def _turns_freely(scene: Scene, dae: DAE, body: str, free: Indices) -> bool:
    """Whether a body's rotation in space is neither listed nor guessed."""
    if f"{body}.e0" not in dae.q_names:
        return False
    guessed = dae.q_names.index(f"{body}.e0") in scene.guesses
    return not guessed and dae.v_names.index(f"{body}.omega_x") in free
