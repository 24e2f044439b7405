"""Assembly at the nominal parameters: coordinates on the constraints near a guess."""

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array, Indices
from symmb.mechanics import Constraint, Planar, Spatial
from symmb.model import DAE, Scene
from symmb.start.axis_alignment import turned_to_axes
from symmb.start.labels import constraint_of_row, coordinate_of
from symmb.start.scales import evaluate_at_rest, with_coarse_scales

_TOLERANCE = 1e-9
"""Violation of Phi over the scene's size that an assembly may leave. tests/start/test_start.py"""
_ITERATIONS, _HALVINGS = 100, 12
"""Gauss-Newton steps, and halvings of a step that does not reduce the violation."""


def assemble(scene: Scene, dae: DAE, reference: ca.Function, guess: Array, free: Indices, t0: float) -> Array:
    """Coordinates with Phi = 0 at the nominal parameters, moved least from the guess; damped Gauss-Newton.

    Parameters
    ----------
    reference : (p, q) -> q     puts the listed coordinates in
    guess : (n_q,) array
    free : (n,) indices         displacements that may move

    Raises
    ------
    AssemblyError               if Newton's method does not reach the constraints, with the worst joint
    """
    q = turned_to_axes(scene, dae, np.asarray(reference(dae.p_nominal, guess)).ravel(), free)
    Phi, G = dae.Phi, dae.G
    if Phi is None or G is None:
        return q
    dae = with_coarse_scales(dae, q, t0)
    units, row_scales = dae.displacement_scales[free], dae.row_scales[: dae.n_c]
    r = evaluate_at_rest(Phi, dae, q, t0).ravel() / row_scales
    scale = max(float(np.abs(q / dae.coordinate_scales).max(initial=0.0)), float(np.abs(r).max()), 1e-300)
    for _ in range(_ITERATIONS):
        if np.abs(r).max() <= 1e-15 * scale or not free.size:
            break
        # G holds the position rows first; the least-norm step moves the coordinates least.
        J = evaluate_at_rest(G, dae, q, t0)[: dae.n_c, free] * units / row_scales[:, None]
        irregular = ~(np.isfinite(J).all(axis=1) & np.isfinite(r))
        if irregular.any():
            raise AssemblyError(
                f"Joint {constraint_of_row(dae, int(irregular.argmax()))!r} is singular at the guess: its rows are not "
                "finite there, as those of a Distance whose points coincide. Give a guess away from this position."
            )
        step = np.linalg.lstsq(J, -r, rcond=1e-10)[0]
        for damping in 0.5 ** np.arange(_HALVINGS):
            delta = np.zeros(dae.n_v)
            delta[free] = damping * step * units
            q_new = np.asarray(dae.retract(q, delta)).ravel()
            r_new = evaluate_at_rest(Phi, dae, q_new, t0).ravel() / row_scales
            if np.linalg.norm(r_new) < np.linalg.norm(r):
                break
        else:
            break
        q, r = q_new, r_new
    worst = float(np.abs(r).max())
    if not worst <= _TOLERANCE * scale:
        name, worst = constraint_of_row(dae, int(np.abs(r).argmax())), float(np.abs(r * row_scales).max())
        raise AssemblyError(
            f"Start does not satisfy Phi = 0: residual {worst:.2g} in joint {name!r}. {_remedy(scene, dae, name, free)}"
        )
    return q


def _remedy(scene: Scene, dae: DAE, name: str, free: Indices) -> str:
    """Which listed coordinates of a joint's bodies to leave free, and which free ones to guess."""
    joints = [e for e in scene.system.elements if isinstance(e, Constraint) and e.name == name]
    bodies = {body.name for joint in joints for body in joint.bodies()}
    known = [coordinate_of(dae, i) for i in range(dae.n_v)] + [f"{body}.rotation" for body in bodies]
    listed = [key for key in scene.start if key in known]
    listed = [key for key in listed if key.split(".")[0] in bodies] or listed
    movable = [coordinate_of(dae, int(i)) for i in free]
    movable = [key.split("_")[0] if ".rotation_" in key else key for key in movable if key.split(".")[0] in bodies]
    parts = []
    if listed:
        parts.append(f"Leave {listed[0] if len(listed) == 1 else 'one of ' + ', '.join(listed)} free")
    if movable:
        value = "rotation(axis, angle)" if movable[-1].endswith("rotation") else "..."
        parts.append(f"give a better guess={{{movable[-1]!r}: {value}}}")
    text = ", or ".join(parts) or "Check the joint's points"
    return text[0].upper() + text[1:] + "."


def check_assembly_cosines(scene: Scene, dae: DAE, q: Array) -> None:
    """Raise AssemblyError if frames that a joint locks parallel are antiparallel at q."""
    if dae.assembly_cosines is None:
        return
    cosines = np.asarray(dae.assembly_cosines(q, dae.p_nominal)).ravel()
    if cosines.min(initial=1.0) < 0:
        at = int(cosines.argmin())
        constraints = [e for e in scene.system.elements if isinstance(e, Constraint)]
        owners = [e.name for e in constraints for _ in range(e.assembly_cosines().numel())]
        raise AssemblyError(
            f"Joint {owners[at]!r} is assembled the wrong way round: frames that it locks parallel end antiparallel. "
            f"Give a guess nearer to the meant position, such as guess={{'{_turned(scene, owners[at])}': ...}}."
        )


def _turned(scene: Scene, joint: str) -> str:
    """The key that turns the second body of a joint."""
    bodies = [b for e in scene.system.elements if isinstance(e, Constraint) and e.name == joint for b in e.bodies()]
    body = bodies[-1] if isinstance(bodies[-1].pose, Planar | Spatial) else bodies[0]
    return f"{body.name}.{'theta' if isinstance(body.pose, Planar) else 'rotation'}"
