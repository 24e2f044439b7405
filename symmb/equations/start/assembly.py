"""Assembly at the nominal parameters: coordinates near a guess that satisfy the constraints."""

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._magnitudes import SLIGHT
from symmb._types import Array, Indices
from symmb.declare.mechanics import Constraint, Motion
from symmb.equations import start
from symmb.equations.model import DAE, Scene
from symmb.equations.start.forward_kinematics import placed_along_joints
from symmb.equations.start.gauss_newton import FailedAssembly, PositionRows
from symmb.equations.start.joint_values import (
    angles,
    listed_states,
    of_positions,
    with_position_rows,
    with_states,
    with_turns,
)
from symmb.equations.start.labels import constraint_of_row
from symmb.equations.start.residual_limits import SOLVED
from symmb.equations.start.scales import with_coarse_scales


def assemble(scene: Scene, dae: DAE, t0: float) -> tuple[Array, Array]:
    """Coordinates (n_q,) and states (n_s,) with Phi = 0 at the nominal parameters, near the guess.

    Forward kinematics along the joints is followed by damped Gauss-Newton steps. If the constraints are still violated,
    full steps are tried, and then angles with other numbers of whole turns. If all attempts fail, an AssemblyError
    names the worst joint and a remedy.
    """
    try:
        return _assembled(scene, dae, t0)
    except FailedAssembly as failure:
        text, joint = str(failure), failure.joint

    def assembles(other: Scene) -> bool:
        try:
            _assembled(other, dae, t0)
        except FailedAssembly:
            return False
        return True

    free, q = free_displacements(scene, dae), _guess(scene, dae)
    rows = _position_rows(scene, dae, q, t0)
    size = rows.size(q) * rows.dae.scales.length
    raise AssemblyError(
        f"{text} {start.advice(scene, dae, joint, free, size, assembles)}{start.reminder(scene, joint)}"
    )


def listed_coordinates(scene: Scene, dae: DAE) -> ca.Function:
    """The Function (p, q) -> q that gives the listed coordinates their listed values."""
    prescribed, q = scene.prescribed, ca.SX.sym("q_nominal", dae.n_q)
    listed_q = ca.vertcat(*[prescribed.q.get(i, q[i]) for i in range(dae.n_q)]) if dae.n_q else q
    return ca.Function("reference", [scene.system.p, q], [listed_q])


def free_displacements(scene: Scene, dae: DAE) -> Indices:
    """Indices of the displacements that are not listed. Modes without listed or guessed values are left out."""
    free = [i for i in range(dae.n_v) if i not in scene.prescribed.displacements]
    if scene.equilibrium and not scene.guess:
        free = [i for i in free if not dae.v_names[i].endswith("_dot")]
    return np.array(free, dtype=np.intp)


def _guess(scene: Scene, dae: DAE) -> Array:
    guess = dae.q_neutral.copy() if scene.restart is None else scene.restart.q.copy()
    for i, value in scene.guesses.items():
        guess[i] = float(ca.Function("guess", [scene.system.p], [value])(dae.p_nominal))
    return np.asarray(listed_coordinates(scene, dae)(dae.p_nominal, guess)).ravel()


def _assembled(scene: Scene, dae: DAE, t0: float) -> tuple[Array, Array]:
    """Assembled coordinates and states. Raises FailedAssembly if no attempt succeeds."""
    s = listed_states(scene)
    dae = with_position_rows(scene.system, with_states(scene, dae, s), of_positions(scene.prescribed))
    free = free_displacements(scene, dae)
    q = _guess(scene, dae)
    if dae.Phi is None:
        return q, s
    rows = _position_rows(scene, dae, q, t0)
    attempts = [(False, True)]
    if scene.restart is None:
        q = placed_along_joints(scene, dae, q, s, free, t0)
        s = with_turns(scene, q, s, np.empty(0, dtype=np.intp))
        if scene.guessed.joints:  # forward kinematics may not satisfy all guessed joint values
            guessed = with_position_rows(scene.system, dae, scene.guessed.joints)
            q, *_ = _position_rows(scene, guessed, q, t0).reach(q, s, free)
        s = rows.with_turns_of(drive_rows(scene, dae), q, s)
        # Full steps are tried second. They may leave a local minimum of the violation, but may also jump to another
        # assembly.
        attempts = [(False, True), (False, False), *[(True, True)] * bool(rows.angles.size)]
    failures = []
    for is_turned, is_damped in attempts:
        try:
            return _reached(scene, rows, q, rows.turned(q) if is_turned else s, free, is_damped)
        except FailedAssembly as failure:
            failures.append(failure)
    raise failures[0]


def drive_rows(scene: Scene, dae: DAE) -> Indices:
    """Indices of the rows of drives."""
    drives = [dae.rows[e.name] for e in scene.system.elements if isinstance(e, Motion) and e.name in dae.rows]
    return np.array([row for where in drives for row in range(where.start, where.stop)], dtype=np.intp)


def _position_rows(scene: Scene, dae: DAE, q: Array, t0: float) -> PositionRows:
    """The position rows, divided by coarse scales."""
    return PositionRows(with_coarse_scales(dae, q, t0), angles(scene), t0)


def _reached(
    scene: Scene, rows: PositionRows, q: Array, s: Array, free: Indices, is_damped: bool
) -> tuple[Array, Array]:
    """Coordinates and states that satisfy the constraints, from q and s. Raises FailedAssembly without convergence."""
    dae, limit = rows.dae, SOLVED * rows.size(q)
    q, s, r = rows.reach(q, s, free, is_damped)
    violation = np.abs(r)
    if not violation.max(initial=0.0) <= limit:
        # Among equal violations the first row is named, so that the message does not depend on rounding.
        name = constraint_of_row(dae, int(np.isclose(violation, violation.max()).argmax()))
        worst = float((violation * dae.row_scales[: dae.n_c]).max())
        where = f"in joint {name!r}" if "." not in name else f"for the listed {name}"
        drives = [e.name for e in scene.system.elements if isinstance(e, Motion) and e.name in dae.rows]
        drives = [e for e in drives if e != name and violation[dae.rows[e]].max() > SLIGHT * violation.max()]
        also = f", against the drive of {', '.join(map(repr, drives))}" if drives else ""
        raise FailedAssembly(f"The start violates Phi = 0: the residual is {worst:.2g} {where}{also}.", name)
    flipped = _flipped_joint(scene, dae, q)
    if flipped is not None:
        raise FailedAssembly(
            f"Joint {flipped!r} is assembled the wrong way round: its frames are antiparallel, not parallel.", flipped
        )
    return q, with_turns(scene, q, s, rows.angles)


def _flipped_joint(scene: Scene, dae: DAE, q: Array) -> str | None:
    """The name of a joint with antiparallel frames at q that must be parallel; None if there is no such joint."""
    if dae.assembly_cosines is None:
        return None
    cosines = np.asarray(dae.assembly_cosines(q, dae.p_nominal)).ravel()
    if not cosines.min(initial=1.0) < 0:
        return None
    constraints = [e for e in scene.system.elements if isinstance(e, Constraint)]
    gated = scene.system.collected.gated
    constraints = [e for e in constraints if gated.get(e.name, True)]
    owners = [e.name for e in constraints for _ in range(e.assembly_cosines().numel())]
    return owners[int(cosines.argmin())]
