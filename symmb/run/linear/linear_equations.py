"""The linear equations of motion at a state, in independent coordinates."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, cast

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array, Indices
from symmb.declare.symbolic import batch, common
from symmb.equations.model import DAE
from symmb.run.formulations import Formulation

_BLOCKS = ("qdot", "vdot", "sdot", "rows", "outputs", "bodies")


@dataclass(frozen=True, eq=False)
class Blocks:
    """Linear equations of N samples in all displacements z = (delta, v, s), and the rows of the constraints.

    Attributes
    ----------
    A : (N, n_z, n_z)       z' = A z + B u
    B : (N, n_z, n_u)       see A
    rows : (N, n, n_z)      rows z + row_inputs u = 0
    row_inputs : (N, n, n_u)    see rows
    C : (N, n_y, n_z)       outputs y = C z + D u
    D : (N, n_y, n_u)       see C
    bodies : (N, n_b, n_z)  displacements of the bodies along their velocities
    """

    A: Array
    B: Array
    rows: Array
    row_inputs: Array
    C: Array
    D: Array
    bodies: Array

    def __getitem__(self, k: int) -> "Blocks":
        """The blocks of one sample."""
        return Blocks(**{field.name: getattr(self, field.name)[k : k + 1] for field in fields(self)})


@dataclass(frozen=True, eq=False)
class LinearEquations:
    """Exact derivatives of the equations of a formulation with respect to its states and to some parameters.

    Displacements delta are along the velocities: q = retract(q0, delta). Near a motion q0(t), delta' is the sum of
    v - v0 and the rotation of delta by the motion.

    Parameters
    ----------
    formulation : Formulation
    inputs : indices of the parameters that are inputs
    often : bool           whether blocks are computed for dozens of samples. Then whole matrices are derived. This
                           takes the time of some dozen samples, and makes each sample about ten times faster
    """

    formulation: Formulation
    inputs: tuple[int, ...] = ()
    often: bool = False

    @property
    def dae(self) -> DAE:
        """The equations of the formulation."""
        return self.formulation.dae

    @property
    def n_z(self) -> int:
        """Number of displacements, velocities and first-order states."""
        return 2 * self.dae.n_v + self.dae.n_s

    @property
    def sizes(self) -> Array:
        """Sizes of displacements, velocities and first-order states (n_z,)."""
        displacements = self.dae.displacement_scales
        return np.concatenate([displacements, displacements, np.ones(self.dae.n_s)])

    def blocks(self, X: Array, P: Array, t: float) -> Blocks:
        """The linear equations at states X (N, n_x) with parameters P (N, n_p) at the time t [s]."""
        dae, n_z, n_u = self.dae, self.n_z, len(self.inputs)
        N, n = len(X), n_z + n_u
        if not n:
            raise DeclarationError("linearize: the scene has no states. Linearise a scene with bodies that can move.")
        f, cuts = self._slopes
        # Maximum number of instructions for all columns. Up to this number, whole matrices are derived, which takes
        # some seconds.
        if self.often and f.n_instructions() * n <= 2_000_000:
            values = batch(self._jacobian, X, P, np.full((N, 1), t))[0].reshape(N, -1, n)
        else:
            seeds = np.tile(np.eye(n), (N, 1))
            repeated = [np.repeat(values, n, axis=0) for values in (X, P)]
            values = batch(f, *repeated, np.full((N * n, 1), t), seeds)[0].reshape(N, n, -1).transpose(0, 2, 1)
        parts = dict(zip(_BLOCKS, np.split(values, cuts, axis=1), strict=True))
        turning = parts["qdot"]
        moving = np.linalg.pinv(turning[:, :, dae.n_v : 2 * dae.n_v]) if dae.n_v else np.zeros((N, 0, 0))
        rates = np.concatenate([moving @ turning, parts["vdot"], parts["sdot"]], axis=1)
        split = [np.split(values, [n_z], axis=2) for values in (rates, parts["rows"], parts["outputs"])]
        bodies = np.zeros((N, parts["bodies"].shape[1], n_z))
        bodies[:, :, : dae.n_v] = parts["bodies"][:, :, dae.n_v : 2 * dae.n_v]
        (A, B), (rows, row_inputs), (C, D) = split
        return Blocks(A, B, rows, row_inputs, C, D, bodies)

    @cached_property
    def _slopes(self) -> tuple[ca.Function, list[int]]:
        """A function (x, p, t, dz) -> all blocks times dz, and the indices of the rows at which blocks end."""
        dae = self.dae
        x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        z, dz = ca.SX.sym("z", self.n_z + len(self.inputs)), ca.SX.sym("dz", self.n_z + len(self.inputs))
        delta, w, more, u = ca.vertsplit(z, [0, dae.n_v, 2 * dae.n_v, self.n_z, z.numel()])
        q0, v0, s0 = ca.vertsplit(x, [0, dae.n_q, dae.n_q + dae.n_v, x.numel()])
        q = dae.retract(q0, delta)
        moved = ca.SX(p)
        for number, value in zip(self.inputs, ca.vertsplit(u) if self.inputs else (), strict=True):
            moved[number] += value
        if dae.impacts is not None:  # contacts and joints remain closed or open
            more[dae.impacts.states.tolist()] = 0
        state = ca.vertcat(q, v0 + w, s0 + more)
        at = dae.arguments(state, moved, t)
        qdot, vdot, *sdot = dae.rhs(*at)
        begin = dae.rhs(*dae.arguments(x, p, t))[0]
        carried = ca.jtimes(q, q0, begin) if dae.n_q else begin
        rows = [f(*at) for f in (dae.Phi, dae.Phi_dot) if f is not None]
        parts = [qdot - carried, vdot, ca.vertcat(*sdot), ca.vertcat(*rows, *self._counted(q, more + s0, moved))]
        parts += [self.formulation.y(state, moved, t), self._of_bodies(state, moved)]
        parts = [ca.densify(part) for part in parts]
        slopes = ca.substitute(ca.jtimes(ca.vertcat(*parts), z, dz), z, ca.SX.zeros(z.numel()))
        cuts = np.cumsum([part.numel() for part in parts])[:-1].tolist()
        return common("slopes", [x, p, t, dz], [ca.densify(slopes)]), cuts

    @cached_property
    def _jacobian(self) -> ca.Function:
        """A function (x, p, t) -> all blocks, one below the other."""
        x, p, t, dz = self._slopes[0].sx_in()
        (slopes,) = self._slopes[0].call([x, p, t, dz], True, False)
        return ca.Function("jacobian", [x, p, t], [ca.jacobian(slopes, dz)])

    def _counted(self, q: ca.SX, s: ca.SX, p: ca.SX) -> list[ca.SX]:
        """Differences between counted angles and angles of coordinates, which are constant during a motion [rad]."""
        begin = self.dae.s_start
        if begin is None:
            return []
        angles = begin(q, p)
        return [s[k] - angles[k] for k in sorted(set(begin.jac_sparsity(0, 0).row()))]

    def _of_bodies(self, state: ca.SX, p: ca.SX) -> ca.SX:
        """Velocities of the bodies."""
        bodies, dae = self.formulation.bodies, self.dae
        if bodies is None:
            return state[dae.n_q : dae.n_q + dae.n_v]
        return bodies.states()(state, p)[bodies.dae.n_q : bodies.dae.n_q + bodies.dae.n_v]


def independent(equations: LinearEquations, blocks: Blocks) -> Indices:
    """Numbers of independent displacements, velocities and states of the first sample.

    The rank of the rows is known, because it was determined for the equations of motion at the start.
    """
    from scipy.linalg import qr

    dae, rows = equations.dae, blocks.rows[0] * equations.sizes
    if not len(rows):
        return np.arange(equations.n_z)
    rank = dae.rank + dae.position_rank + len(rows) - dae.n_r - dae.n_c
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    if dae.impacts is not None and dae.impacts.joints is not None:  # rows of open joints are 0
        rank = int(np.linalg.matrix_rank(rows))
    order = cast(tuple[Any, ...], qr(rows, mode="r", pivoting=True))[-1]
    return np.setdiff1d(np.arange(equations.n_z), order[:rank])


def lifts(blocks: Blocks, free: Indices) -> Array:
    """All displacements (N, n_z, n) for unit values of the independent displacements `free` (n,)."""
    N, _, n_z = blocks.rows.shape
    bound = np.setdiff1d(np.arange(n_z), free)
    lift = np.zeros((N, n_z, len(free)))
    lift[:, free, np.arange(len(free))] = 1.0
    for k in range(N if len(bound) else 0):
        lift[k, bound] = -np.linalg.lstsq(blocks.rows[k][:, bound], blocks.rows[k][:, free], rcond=None)[0]
    return lift
