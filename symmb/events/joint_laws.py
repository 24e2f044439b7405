"""Joints that open and close at the start, on arrays of many samples."""

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.model import DAE, JointEvents
from symmb.symbolic import batch


def evaluate_padded(f: ca.Function, *arguments: Array) -> list[Array]:
    """A Function of N samples, all arguments (N, n), padded to a power of 2: CasADi keeps one map for each number."""
    N = len(arguments[0])
    if N < 2:
        return list(batch(f, *arguments))
    rows = np.minimum(np.arange(1 << (N - 1).bit_length()), N - 1)
    return [values[:N] for values in batch(f, *[a[rows] for a in arguments])]


def arguments_of(dae: DAE, x: Array, p: Array, t: Array) -> tuple[Array, ...]:
    """States (N, n_x), parameters (N, n_p) and times (N,) as the Functions of impacts take them."""
    x, p = x[:, : dae.n_q + dae.n_v + dae.n_s], p[:, : len(dae.p_names)]
    return (*np.split(x, [dae.n_q, dae.n_q + dae.n_v], axis=1), p, t[:, None])


class JointLaws:
    """What events do to the joints of a DAE. Margins (m,) up to some tolerances are 0 but for rounding."""

    def __init__(self, dae: DAE, joints: JointEvents, tolerances: tuple[float, ...]) -> None:
        self._dae, self._joints, self._tolerances = dae, joints, np.array(tolerances)
        at = dae.n_q + dae.n_v
        self._holding, self._flags = (at + np.array(k, dtype=np.intp) for k in (joints.holding, joints.flags))
        self._opens = np.array(joints.opens)
        same = np.array(joints.names)[:, None] == joints.names
        self._same = same.astype(float)  # events of the same joint
        self._clutches = at + np.array(joints.clutches, dtype=np.intp).reshape(-1, 2).T
        self._declared = ~np.isin(self._flags, self._clutches[0])  # by a user: their conditions hold at the start

    def _margins(self, x: Array, p: Array, t: Array) -> list[Array]:
        return evaluate_padded(self._joints.margins, *arguments_of(self._dae, x, p, t))

    def _armed(self, x: Array) -> Mask:
        """Whether events would change their joints: open a closed one, or close an open one, (N, m)."""
        return np.asarray((x[:, self._flags] @ self._same > 0.5) == self._opens)

    def started(self, x: Array, p: Array, t: Array) -> Array:
        """States at the start, with the conditions that hold there. Clutches without slip stick."""
        x, (sticks, side) = x.copy(), self._clutches
        slip, rounding = evaluate_padded(self._joints.slips, *arguments_of(self._dae, x, p, t))
        fresh, rest = (x[:, sticks] == 0) & (x[:, side] == 0), np.abs(slip) <= rounding
        x[:, sticks], x[:, side] = (
            np.where(fresh, rest, x[:, sticks]),
            np.where(fresh, np.sign(slip) * ~rest, x[:, side]),
        )
        x[:, self._holding] = (self._margins(x, p, t)[0] < -self._tolerances) & self._declared
        return x

    def start_faults(self, x: Array, p: Array, t: Array) -> dict[int, str]:
        """Samples whose joints would have opened or closed before the start."""
        holds = (self._margins(x, p, t)[0] < -self._tolerances) & self._armed(x) & self._declared
        return {
            i: f"{self._joints.titles[k]}: its condition holds at the start, and counts where it becomes true; start "
            f"where it does not hold, or {'leave the joint out' if self._opens[k] else 'leave the Latch out'}"
            for i, k in np.argwhere(holds)[::-1].tolist()
        }
