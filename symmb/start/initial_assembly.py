"""Assembly at the nominal parameters: coordinates on the constraints near a guess."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array, Indices
from symmb.mechanics import Constraint, Motion
from symmb.model import DAE, Scene
from symmb.start.axis_alignment import turned_to_axes
from symmb.start.gauss_newton import PositionRows, SingularRow
from symmb.start.joint_values import angles, listed_states, of_positions, with_position_rows, with_states, with_turns
from symmb.start.labels import constraint_of_row
from symmb.start.placement import placed_along_joints
from symmb.start.remedies import Assembles, FailedScene, nearer_guess, other_guess, remedy
from symmb.start.scales import with_coarse_scales

_SHARED = 1e-3
"""Violation of a drive, over the largest one, from which on it is named beside the joint with the largest one."""


def assemble(scene: Scene, dae: DAE, t0: float) -> tuple[Array, Array]:
    """Coordinates and states with Phi = 0 at the nominal parameters, near the guess; damped Gauss-Newton.

    It starts where bodies are placed one after the other along the joints. If that leads to no assembly, it takes full
    steps from there, it starts at the guess itself, and last it lets angles begin with whole turns.

    Raises
    ------
    AssemblyError               if no assembly is reached, with the worst joint, and what helps
    """
    outcome = _attempt(scene, dae, t0)
    if not isinstance(outcome, _Failure):
        return outcome

    def assembles(other: Scene) -> bool:
        return not isinstance(_attempt(other, dae, t0), _Failure)

    failed = FailedScene(scene, dae, outcome.joint, free_displacements(scene, dae), outcome.size)
    raise AssemblyError(f"{outcome.text} {outcome.advice(failed, assembles)}")


@dataclass(frozen=True)
class _Failure:
    """Why an assembly fails: a sentence, the joint, what advises, and the size of the scene [m]."""

    text: str
    joint: str
    advice: Callable[[FailedScene, Assembles], str]
    size: float


def listed_coordinates(scene: Scene, dae: DAE) -> ca.Function:
    """The Function (p, q) -> q with the listed coordinates."""
    prescribed, q = scene.prescribed, ca.SX.sym("q_nominal", dae.n_q)
    listed_q = ca.vertcat(*[prescribed.q.get(i, q[i]) for i in range(dae.n_q)]) if dae.n_q else q
    return ca.Function("reference", [scene.system.p, q], [listed_q])


def free_displacements(scene: Scene, dae: DAE) -> Indices:
    """The displacements that are not listed. Modes that nothing is known of stay undeformed until forces act."""
    free = [i for i in range(dae.n_v) if i not in scene.prescribed.displacements]
    if scene.equilibrium and not scene.guess:
        free = [i for i in free if not dae.v_names[i].endswith("_dot")]
    return np.array(free, dtype=np.intp)


def _guess(scene: Scene, dae: DAE) -> Array:
    guess = dae.q_neutral.copy() if scene.restart is None else scene.restart.q.copy()
    for i, value in scene.guesses.items():
        guess[i] = float(ca.Function("guess", [scene.system.p], [value])(dae.p_nominal))
    return np.asarray(listed_coordinates(scene, dae)(dae.p_nominal, guess)).ravel()


def _attempt(scene: Scene, dae: DAE, t0: float) -> tuple[Array, Array] | _Failure:
    """Assembled coordinates and states, or why there are none."""
    s = listed_states(scene)
    dae = with_position_rows(scene.system, with_states(scene, dae, s), of_positions(scene.prescribed))
    free = free_displacements(scene, dae)
    q = _guess(scene, dae)
    q = turned_to_axes(scene, dae, q, free) if scene.restart is None else q
    if dae.Phi is None:
        return q, s
    dae, rows = _position_rows(scene, dae, q, t0)
    if scene.restart is not None:
        return _reached(scene, dae, rows, q, s, free)
    placed = placed_along_joints(scene, dae, rows, q, free)
    s = with_turns(scene, placed, s, np.empty(0, dtype=np.intp))
    if scene.guessed.joints:
        placed = _near_guess(scene, dae, placed, s, free, t0)
    first = _reached(scene, dae, rows, placed, s, free)
    if not isinstance(first, _Failure):
        return first
    others = [(placed, s, False), (q, s, True)] + [(placed, rows.turned(placed), True)] * bool(rows.angles.size)
    for begin, turns, is_damped in others:
        outcome = _reached(scene, dae, rows, begin, turns, free, is_damped)
        if not isinstance(outcome, _Failure):
            return outcome
    return first


def _position_rows(scene: Scene, dae: DAE, q: Array, t0: float) -> tuple[DAE, PositionRows]:
    """The DAE in coarse scales, and its position rows."""
    dae = with_coarse_scales(dae, q, t0)
    return dae, PositionRows(dae, cast(ca.Function, dae.Phi), cast(ca.Function, dae.G), angles(scene), t0)


def _near_guess(scene: Scene, dae: DAE, q: Array, s: Array, free: Indices, t0: float) -> Array:
    """Coordinates at which the constraints hold and guessed coordinates of joints have their values, or nearly.

    The joint of a guess need not be one along which bodies are placed.
    """
    dae, rows = _position_rows(scene, with_position_rows(scene.system, dae, scene.guessed.joints), q, t0)
    try:
        return rows.reach(q, s, np.arange(dae.n_c), free).q
    except SingularRow:
        return q


def _reached(
    scene: Scene, dae: DAE, rows: PositionRows, q: Array, s: Array, free: Indices, is_damped: bool = True
) -> tuple[Array, Array] | _Failure:
    size = rows.size(q) * dae.scales.length
    try:
        reached = rows.reach(q, s, np.arange(dae.n_c), free, is_damped)
    except SingularRow as error:
        return _Failure(str(error), error.joint, other_guess, size)
    if not reached.is_on_constraints:
        name = constraint_of_row(dae, int(np.abs(reached.r).argmax()))
        worst = float(np.abs(reached.r * dae.row_scales[: dae.n_c]).max())
        where = f"in joint {name!r}" if "." not in name else f"of the listed {name}"
        drives = [e.name for e in scene.system.elements if isinstance(e, Motion) and e.name in dae.rows]
        drives = [
            e for e in drives if e != name and np.abs(reached.r[dae.rows[e]]).max() > _SHARED * np.abs(reached.r).max()
        ]
        also = f", against the drive of {', '.join(map(repr, drives))}" if drives else ""
        text = f"Start does not satisfy Phi = 0: residual {worst:.2g} {where}{also}."
        return _Failure(text, name, remedy, size)
    flipped = _flipped_joint(scene, dae, reached.q)
    if flipped is not None:
        text = f"Joint {flipped!r} is assembled the wrong way round: frames that it locks parallel end antiparallel."
        return _Failure(text, flipped, nearer_guess, size)
    return reached.q, with_turns(scene, reached.q, reached.s, rows.angles)


def _flipped_joint(scene: Scene, dae: DAE, q: Array) -> str | None:
    """A joint whose frames are antiparallel at q, though it locks them parallel."""
    if dae.assembly_cosines is None:
        return None
    cosines = np.asarray(dae.assembly_cosines(q, dae.p_nominal)).ravel()
    if not cosines.min(initial=1.0) < 0:
        return None
    constraints = [e for e in scene.system.elements if isinstance(e, Constraint)]
    owners = [e.name for e in constraints for _ in range(e.assembly_cosines().numel())]
    return owners[int(cosines.argmin())]
