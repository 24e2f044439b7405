"""Motions by SciPy, from a system's M, Q, G, gamma alone: split at switches that the caller names.

symmb's integrators, its choice of rows and its detection of switches take no part. All quantities are divided by
their natural sizes, so that one tolerance serves all units. Accelerations follow from the null space of G at the rank
counted at the start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import symmb as mb
from symmb._types import Array

MOST_RATES, MOST_PIECES = 40_000, 300
"""Evaluations of a run, and pieces between switches, beyond which a scene is no good as a reference."""
REGULAR, LOST = 3e-3, 1e-7
"""Singular values of G, over the largest: those that count are above the first, all others below the second."""
LONGEST_STEP = 0.1
"""Steps over the natural time, so that each switch has one extreme at most in a step."""


LEAST_STEPS = 4
"""Steps up to a switch. The first of fewer steps may pass over a force that begins at 0."""


class UnusableError(Exception):
    """This scene has no reference that is beyond doubt."""


@dataclass(frozen=True)
class Motion:
    """Values (n_t, n_q + n_v) at the output times over their natural sizes, and when switches were passed."""

    values: Array
    passes: Array


class Reference:
    """The equations of a system in natural units.

    Parameters
    ----------
    system : System
    sizes : (n_x,)           natural sizes of (q, v, s)
    time : float             natural time [s]
    switches                 what changes sign at the switches, of (q, v, s, t), with natural sizes
    """

    def __init__(self, system: mb.System, sizes: Array, time: float, switches: Sequence[tuple[ca.SX, float]]) -> None:
        q, v, s = system.q, system.v, system.s
        self.n_q, self.n_v, self.n_r = q.numel(), v.numel(), system.G.shape[0]
        z, tau = ca.SX.sym("z", len(sizes)), ca.SX.sym("tau")
        scaled_v = ca.diag(ca.SX(sizes[self.n_q : self.n_q + self.n_v]))
        u = ca.vertcat(ca.SX(0, 1), *(value / size for value, size in switches))
        x = ca.vertcat(q, v, s)
        parts = [
            scaled_v @ system.M @ scaled_v,
            time * scaled_v @ system.Q,
            system.G @ scaled_v,
            time * system.gamma if self.n_r else ca.SX(0, 1),
            time * ca.vertcat(system.qdot, system.s_rate) / np.delete(sizes, range(self.n_q, self.n_q + self.n_v)),
        ]
        slopes = [u, ca.jacobian(u, x) @ ca.diag(ca.SX(sizes)), time * ca.jacobian(u, mb.t)]
        rows = [system.Phi, system.Phi_t, ca.jacobian(system.Phi_dot, v) @ scaled_v]

        def compiled(name: str, outputs: list[ca.SX]) -> ca.Function:
            flat = ca.vertcat(*(ca.densify(ca.vec(part)) for part in outputs))
            (flat,) = ca.substitute([flat], [x, mb.t], [ca.vertcat(*sizes) * z, time * tau])
            return ca.Function(name, [z, tau], [flat], {"cse": True})

        self._parts, self._slopes, self._rows = (
            compiled("parts", parts),
            compiled("slopes", slopes),
            compiled("rows", rows),
        )
        self._time = time
        self._n_u, self._scale, self._rank = u.numel(), np.ones(self.n_r), self.n_r
        self.rates_left = 0

    def start(self, q: Array, s: Array, listed: dict[int, float]) -> Array:
        """The state at t = 0 from coordinates q that fulfil Phi = 0 and from listed velocities, by least squares."""
        z = np.concatenate([q, np.zeros(self.n_v), s])
        flat = self._rows(z, 0.0).full().ravel()
        n_c = (len(flat) - self.n_r * self.n_v) // 2
        G = flat[2 * n_c :].reshape(self.n_v, self.n_r).T
        self._scale = 1 / np.linalg.norm(G, axis=1) if self.n_r else self._scale
        values = np.linalg.svd(G * self._scale[:, None], compute_uv=False) if self.n_r else np.ones(1)
        self._rank = int(np.sum(values > np.sqrt(REGULAR * LOST) * values[0])) if self.n_r else 0
        gaps = np.abs(flat[:n_c] * self._scale[:n_c]) / self._time
        if not gaps.max(initial=0.0) < 1e-12:
            raise AssertionError(f"the start does not close the loops: {gaps.max():g}")
        chosen = np.eye(self.n_v)[list(listed)]
        drives = np.concatenate([-flat[n_c : 2 * n_c], np.zeros(self.n_r - n_c)]) * self._scale
        A, b = np.vstack([G * self._scale[:, None], chosen]), np.concatenate([drives, list(listed.values())])
        v, _, rank, _ = np.linalg.lstsq(A, b, rcond=1e-9)
        if rank < self.n_v or not np.abs(A @ v - b).max() < 1e-9 * (1 + np.abs(v).max()):
            raise AssertionError(f"velocities: rank {rank} of {self.n_v}, residual {np.abs(A @ v - b).max():g}")
        return np.concatenate([q, v, s])

    def rates(self, t: float, z: Array) -> Array:
        self.rates_left -= 1
        if self.rates_left < 0:
            raise UnusableError("too many steps")
        flat, n, r = self._parts(z, t).full().ravel(), self.n_v, self.n_r
        cuts = np.cumsum([n * n, n, r * n, r])
        M, Q, G, gamma, others = np.split(flat, cuts)
        M, G = M.reshape(n, n).T, G.reshape(n, r).T * self._scale[:, None]
        a = _accelerations(M, Q, G, gamma * self._scale, self._rank)
        return np.concatenate([others[: self.n_q], a, others[self.n_q :]])

    def is_regular(self, t: float, z: Array) -> bool:
        """Whether the rank of G is what it was at the start, beyond doubt."""
        if not self.n_r:
            return True
        flat = self._parts(z, t).full().ravel()
        begin = self.n_v * (self.n_v + 1)
        G = flat[begin : begin + self.n_r * self.n_v].reshape(self.n_v, self.n_r).T * self._scale[:, None]
        values = np.append(np.linalg.svd(G, compute_uv=False), 0.0)
        return bool(values[self._rank - 1] > REGULAR * values[0] and values[self._rank] < LOST * values[0])

    def switches(self, t: float, z: Array) -> tuple[Array, Array]:
        """Switches (m,) and their rates (m,)."""
        m = self._n_u
        flat = self._slopes(z, t).full().ravel()
        return flat[:m], flat[m:-m].reshape(-1, m).T @ self.rates(t, z) + flat[-m:]

    def run(self, z: Array, times: Array, rtol: float) -> Motion:
        """From a state z at times[0], over natural times."""
        self.rates_left = MOST_RATES
        t, known, passes = float(times[0]), [z[None]], []
        while t < times[-1]:
            if len(passes) > MOST_PIECES:
                raise UnusableError("too many switches")
            sides = self._sides(t, z)
            curve, end, passed, steps = self._piece(t, z, float(times[-1]), rtol, sides)
            while (
                passed is not None and steps < LEAST_STEPS and end - t > 1e-14
            ):  # so long that what acts here was not seen
                until, longest = min(2 * end - t, float(times[-1])), (end - t) / LEAST_STEPS
                curve, end, passed, steps = self._piece(t, z, until, rtol, sides, longest)
            inside = times[(times > t) & (times <= end)]
            known.append(np.array([curve(at) for at in inside]).reshape(-1, len(z)))
            if passed is None:
                t, z = end, curve(end)
            else:
                passes.append(end)
                t, z = self._beyond(curve, end, passed, sides[passed])
        values = np.concatenate(known)
        if len(values) != len(times):  # a switch within rounding of an output time
            raise UnusableError("a switch at an output time")
        if not all(self.is_regular(*at) for at in zip(times.tolist(), values, strict=True)):
            raise UnusableError("close to a singular position")
        return Motion(values[:, : self.n_q + self.n_v], np.array(passes))

    def _sides(self, t: float, z: Array) -> Array:
        """Signs of the switches; where one is 0, that of its rate."""
        if not self._n_u:
            return np.empty(0)
        values, slopes = self.switches(t, z)
        return np.sign(np.where(values == 0, slopes, values))

    def _piece(
        self, t: float, z: Array, until: float, rtol: float, sides: Array, longest: float = LONGEST_STEP
    ) -> tuple[Callable[[float], Array], float, int | None, int]:
        """The motion up to the first switch: its curve, its end, the number of the switch, and of the steps."""
        m = self._n_u

        def event(k: int, kind: int) -> Callable[[float, Array], float]:
            def value(t: float, z: Array) -> float:
                return float(sides[k] * self.switches(t, z)[kind][k])

            value.terminal, value.direction = kind == 0, -1 if kind == 0 else 1  # pyright: ignore
            return value

        events = [event(k, kind) for kind in (0, 1) for k in range(m)]
        found = solve_ivp(
            self.rates, (t, until), z, "DOP853", rtol=rtol, atol=1e-2 * rtol, max_step=longest,
            dense_output=True, events=events or None,
        )  # fmt: skip
        if found.status < 0:
            raise UnusableError("SciPy breaks down")
        end, curve = float(found.t[-1]), found.sol
        passed = next((k for k in range(m) if found.status == 1 and found.t_events[k].size), None)
        for k in range(m):  # passed twice within a step, about an extreme of the switch
            for extreme in found.t_events[m + k]:
                begin = found.t[np.searchsorted(found.t, extreme) - 1]
                on_curve = lambda t, k=k: events[k](t, curve(t))  # noqa: E731
                if extreme < end and on_curve(extreme) < 0 < on_curve(begin):
                    end, passed = brentq(on_curve, begin, extreme, xtol=1e-16, rtol=1e-15), k
        return curve, end, passed, int(np.searchsorted(found.t, end))

    def _beyond(self, curve: Callable[[float], Array], end: float, passed: int, side: float) -> tuple[float, Array]:
        """The state a few roundings behind a switch, where it has the new sign."""
        step = np.spacing(end)
        while step < 1e-9:
            z = curve(end + step)
            if self.switches(end + step, z)[0][passed] * side < 0:
                return end + step, z
            step *= 2
        raise UnusableError("a switch that is only touched")


def _accelerations(M: Array, Q: Array, G: Array, gamma: Array, rank: int) -> Array:
    if not len(G):
        return np.linalg.solve(M, Q)
    if rank == len(G):
        zero = np.zeros((rank, rank))
        size = np.abs(M).max()
        saddle = np.block([[M / size, G.T], [G, zero]])
        return np.linalg.solve(saddle, np.concatenate([Q / size, gamma]))[: len(Q)]
    U, s, Vt = np.linalg.svd(G)
    a = Vt[:rank].T @ ((U[:, :rank].T @ gamma) / s[:rank])
    Z = Vt[rank:].T
    return a + Z @ np.linalg.solve(Z.T @ M @ Z, Z.T @ (Q - M @ a))
