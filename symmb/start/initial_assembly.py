"""Assembly at the nominal parameters: coordinates on the constraints near a guess, or what is wrong."""

from collections.abc import Iterator

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array, Indices
from symmb.mechanics import AxisJoint, Constraint, Planar, Spatial
from symmb.model import DAE, Scene
from symmb.start.rank import independent, redundant_names
from symmb.start.scales import at_rest, in_units
from symmb.symbolic import product

_TOLERANCE = 1e-9
_NEARBY, _STEP, _STEPS = 3, 0.02, 5
"""Positions close to the start where ranks are compared, how far they are [rad, share of the size], and Newton's steps
to get back onto the constraints there."""


def rest(dae: DAE, q: ca.SX) -> tuple[ca.SX, ...]:
    """The arguments (q, v[, s]) of the DAE's Functions with nothing moving."""
    return (q, ca.SX(dae.n_v, 1), *((ca.SX(dae.n_s, 1),) if dae.n_s else ()))


def coordinate_of(dae: DAE, displacement: int) -> str:
    """Name of the coordinate that a displacement moves."""
    body, _, part = dae.v_names[displacement].rpartition(".")
    part = "theta" if part == "omega" else part.replace("omega_", "rotation_")
    return f"{body}.{part.removeprefix('v') if part in ('vx', 'vy', 'vz') else part}"


def placed(dae: DAE, displacement: int, q: Array) -> str:
    """Name and value of the coordinate that a displacement moves; the name alone for a rotation in space."""
    name = coordinate_of(dae, displacement)
    return f"{name} = {q[dae.q_names.index(name)]:.6g}" if name in dae.q_names else name


def assemble(scene: Scene, dae: DAE, reference: ca.Function, guess: Array, free: Indices, t0: float) -> Array:
    """Coordinates with Phi = 0 at the nominal parameters, moved least from the guess; damped Gauss-Newton.

    Parameters
    ----------
    reference : (p, q) -> q     puts the listed coordinates in
    guess : (n_q,) array
    free : (n,) indices         displacements that may move

    Raises
    ------
    AssemblyError               if Newton ends off the constraints, with the joint that is worst
    """
    q = aligned(scene, dae, np.asarray(reference(dae.p_nominal, guess)).ravel(), free)
    Phi, G = dae.Phi, dae.G
    if Phi is None or G is None:
        return q
    dae = in_units(dae, q, t0)
    units, row_scales = dae.displacement_scales[free], dae.row_scales[: dae.n_c]
    r = at_rest(Phi, dae, q, t0).ravel() / row_scales
    scale = max(float(np.abs(q / dae.coordinate_scales).max(initial=0.0)), float(np.abs(r).max()), 1e-300)
    for _ in range(100):
        if np.abs(r).max() <= 1e-15 * scale or not free.size:
            break
        # G holds the position rows first; the least-norm step moves the coordinates least.
        J = at_rest(G, dae, q, t0)[: dae.n_c, free] * units / row_scales[:, None]
        irregular = ~(np.isfinite(J).all(axis=1) & np.isfinite(r))
        if irregular.any():
            raise AssemblyError(
                f"Joint {owner(dae, int(irregular.argmax()))!r} is singular at the guess: its rows are not finite "
                "there, as those of a Distance between points that coincide. Give a guess away from that position."
            )
        step = np.linalg.lstsq(J, -r, rcond=1e-10)[0]
        for damping in 0.5 ** np.arange(12):
            delta = np.zeros(dae.n_v)
            delta[free] = damping * step * units
            q_new = np.asarray(dae.retract(q, delta)).ravel()
            r_new = at_rest(Phi, dae, q_new, t0).ravel() / row_scales
            if np.linalg.norm(r_new) < np.linalg.norm(r):
                break
        else:
            break
        q, r = q_new, r_new
    worst = float(np.abs(r).max())
    if not worst <= _TOLERANCE * scale:
        name, worst = owner(dae, int(np.abs(r).argmax())), float(np.abs(r * row_scales).max())
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


def aligned(scene: Scene, dae: DAE, q: Array, free: Indices) -> Array:
    """Coordinates q with bodies turned, least, to joints whose axes are 60 degrees apart or more at the guess.

    Newton cannot find its way from axes at right angles, and ends at the flipped root beyond. Only rotations that
    are neither listed nor guessed are turned, and only to joints with an `axis_b` of their own.
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


def owner(dae: DAE, row: int) -> str:
    """Name of the constraint that a row belongs to."""
    return next(name for name, rows in dae.rows.items() if rows.start <= row < rows.stop)


def kept_rows(dae: DAE, q: Array, t0: float) -> Indices | None:
    """Numbers of independent rows of the velocity Jacobian where others are redundant; None where all are independent.

    In units of the DAE's scales.

    Raises
    ------
    AssemblyError        if rows depend on each other at q (n_q,) but not close to it: a singular position
    """
    if dae.G is None:
        return None
    G = at_rest(dae.G, dae, q, t0) * dae.displacement_scales
    rows, _ = independent(G)
    if len(rows) == dae.n_r:
        return None
    for position in _nearby(dae, dae.G, q, t0):
        rank = len(independent(at_rest(dae.G, dae, position, t0) * dae.displacement_scales)[0])
        if rank > len(rows):
            names = ", ".join(map(repr, redundant_names(G, dae.rows)))
            raise AssemblyError(
                f"The start is a singular position: rank {len(rows)} of {dae.n_r} constraint rows there and {rank} "
                f"close to it; the rows of {names} depend on each other, and the motion could go on in more than one "
                "way. Start away from it."
            )
    return rows


def _nearby(dae: DAE, G: ca.Function, q: Array, t0: float) -> Iterator[Array]:
    """Positions on the constraints to which the system can move from q (n_q,), a small step away."""
    far = float(np.abs(q).max(initial=0.0)) or 1.0
    scale = np.array([far if name.rpartition(".")[2] in ("vx", "vy", "vz") else 1.0 for name in dae.v_names])
    _, sigma, V = np.linalg.svd(at_rest(G, dae, q, t0) * scale)
    free = V[int((sigma > 1e-9 * sigma.max(initial=0.0)).sum()) :]
    random = np.random.default_rng(0)
    for _ in range(_NEARBY if len(free) else 0):
        step = random.normal(size=len(free)) @ free
        position = np.asarray(dae.retract(q, _STEP * scale * step / np.abs(step).max())).ravel()
        for _ in range(_STEPS):
            if dae.Phi is None:
                break
            r = at_rest(dae.Phi, dae, position, t0).ravel()
            back = np.linalg.lstsq(at_rest(G, dae, position, t0)[: dae.n_c] * scale, -r, rcond=1e-10)[0]
            position = np.asarray(dae.retract(position, scale * back)).ravel()
        yield position


def _turned(scene: Scene, joint: str) -> str:
    """The key that turns the second body of a joint."""
    bodies = [b for e in scene.system.elements if isinstance(e, Constraint) and e.name == joint for b in e.bodies()]
    body = bodies[-1] if isinstance(bodies[-1].pose, Planar | Spatial) else bodies[0]
    return f"{body.name}.{'theta' if isinstance(body.pose, Planar) else 'rotation'}"
