"""Random planar trees and loops with uncertain numbers, and their motions from Lagrange's equations in NumPy.

Bodies are rods with absolute angles a (n,), and their centres are sums of L_ij e(a_j) with e(a) = (cos a, sin a). Let
C = sum of m_i L_ij L_ik. The kinetic energy is 1/2 a' M a' with M_jk = C_jk cos(a_j - a_k) + J_j [j = k], so that

    M a'' + (C_jk sin(a_j - a_k)) a'^2 = Q,      Q_j = -g cos(a_j) sum of m_i L_ij + torques.

A closed four-bar has one velocity: a' = w(a) s. The rows above are multiplied by w, with a'' = w s' + w' s.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import symmb as mb

G = 9.81


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Rods on hinges, with springs and dampers at the hinges. All values have a row for each of N samples.

    Attributes
    ----------
    parents : number of the parent of each rod; -1 for the ground
    places : hinges on the parents, as fractions of their lengths
    mass, length, angle, rate, stiffness, damping : (N, n) values of the rods and of their hinges at the start
    base : (N,) distance of the hinges of a four-bar on the ground; None for a tree
    """

    parents: tuple[int, ...]
    places: tuple[float, ...]
    mass: np.ndarray
    length: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    base: np.ndarray | None = None

    @property
    def n(self):
        return len(self.parents)

    @cached_property
    def L(self):
        """(N, n, n) factors of e(a_j) in the centre of rod i."""
        L = np.zeros((len(self.mass), self.n, self.n))
        for i in range(self.n):
            L[:, i, i] = 0.5 * self.length[:, i]
            child, j = i, self.parents[i]
            while j >= 0:
                L[:, i, j] = self.places[child] * self.length[:, j]
                child, j = j, self.parents[j]
        return L

    @cached_property
    def C(self):
        return np.einsum("si,sij,sik->sjk", self.mass, self.L, self.L)

    def start(self):
        """(N, 2 n) angles and their rates; for a four-bar the rate of the crank is the last value (N, n + 1)."""
        a, v = self.angle.copy(), self.rate.copy()
        for i, j in enumerate(self.parents):
            if j >= 0:
                a[:, i] += a[:, j]
                v[:, i] += v[:, j]
        if self.base is None:
            return np.hstack([a, v])
        crank, b, c = self.angle[:, 0], self.length[:, 1], self.length[:, 2]
        x, y = self.base - self.length[:, 0] * np.cos(crank), -self.length[:, 0] * np.sin(crank)
        f = np.hypot(x, y)
        a = np.stack([crank, np.arctan2(y, x) + np.arccos((f**2 + b**2 - c**2) / (2 * f * b)),
                      np.arctan2(y, x) + np.pi - np.arccos((f**2 + c**2 - b**2) / (2 * f * c))], axis=1)  # fmt: skip
        return np.hstack([a, self.rate[:, :1]])

    def rates(self, t, x):
        """(N, m) rates of the states (N, m)."""
        a = x[:, : self.n]
        if self.base is None:
            v = x[:, self.n :]
            M, rest = self._equations(a, v)
            return np.hstack([v, np.linalg.solve(M, rest[..., None])[..., 0]])
        s, (l0, l1, l2) = x[:, self.n], self.length.T
        beta, gamma = a[:, 1] - a[:, 2], a[:, 0] - a[:, 1]
        # l0 e(a0) + l1 e(a1) = base + l2 e(a2): rates of the coupler and of the rocker
        p, q = l0 * np.sin(a[:, 0] - a[:, 2]), l0 * np.sin(gamma)
        w = np.stack([np.ones_like(s), -p / (l1 * np.sin(beta)), -q / (l2 * np.sin(beta))], axis=1)
        along = lambda y, z, l: -(y / (l * np.sin(beta)) - z * np.cos(beta) / (l * np.sin(beta) ** 2)  # noqa: E731, E741
                                  * (w[:, 1] - w[:, 2]))  # fmt: skip
        w_s = np.stack([0 * s, along(l0 * np.cos(a[:, 0] - a[:, 2]) * (1 - w[:, 2]), p, l1),
                        along(l0 * np.cos(gamma) * (1 - w[:, 1]), q, l2)], axis=1)  # fmt: skip
        v = w * s[:, None]
        M, rest = self._equations(a, v)
        turned = rest - np.einsum("sij,sj->si", M, w_s) * s[:, None] ** 2
        ds = (w * turned).sum(axis=1) / np.einsum("si,sij,sj->s", w, M, w)
        return np.hstack([v, ds[:, None]])

    def _equations(self, a, v):
        """M (N, n, n), and the right-hand sides (N, n)."""
        between = a[:, :, None] - a[:, None]
        M = self.C * np.cos(between)
        k = np.arange(self.n)
        M[:, k, k] += self.mass * self.length**2 / 12
        Q = -G * np.cos(a) * np.einsum("si,sij->sj", self.mass, self.L)
        Q -= np.einsum("sjk,sk->sj", self.C * np.sin(between), v**2)
        for i, j in enumerate(self.parents):
            own = np.stack([a[:, i], v[:, i]]) - (np.stack([a[:, j], v[:, j]]) if j >= 0 else 0.0)
            torque = -self.stiffness[:, i] * own[0] - self.damping[:, i] * own[1]
            Q[:, i] += torque
            if j >= 0:
                Q[:, j] -= torque
        return M, Q

    def outputs(self, t, x):
        """(N, 2 n) heights of the centres and angles."""
        a = x[:, : self.n]
        y = np.einsum("sij,sj->si", self.L, np.sin(a))
        return np.hstack([y, a])


def random_mechanism(seed):
    """A scene with three to twelve uncertain numbers, and a function from its parameters (N, n_p) to a `Mechanism`."""
    rng = np.random.default_rng(seed)
    is_loop = seed % 2 == 1
    n = 3 if is_loop else int(rng.integers(1, 4) - (rng.random() < 0.5)) or 1
    parents = (-1, 0, -1) if is_loop else (-1, *(int(rng.integers(0, k)) for k in range(1, n)))
    places = (0.0, 1.0, 0.0) if is_loop else tuple(rng.uniform(0.5, 1.0, n))
    values = {f"{name}{k}": rng.uniform(*span) for k in range(n) for name, span in _SPANS.items()}
    if is_loop:  # Grashof's condition with room: the crank turns, and the others never are in line
        values |= {"l0": rng.uniform(0.2, 0.3), "l1": rng.uniform(0.8, 1.0), "l2": rng.uniform(0.8, 1.0),
                   "base": rng.uniform(0.9, 1.1)}  # fmt: skip
    used = [name for name in values if not (is_loop and name in {"a1", "a2", "v1", "v2", "k2", "d2", "k1", "d1"})]
    d = int(rng.integers(3, min(12, len(used)) + 1))
    spread = 10.0 ** rng.uniform(-3.0, -2.0)
    chosen = rng.permutation(used)[:d]
    fixed = {name: 0.0 if name[0] in "kd" and is_loop and name[1] != "0" else value for name, value in values.items()}
    p = mb.Parameters(**fixed)
    of = lambda name, k: getattr(p, f"{name}{k}")  # noqa: E731
    rods = [mb.Body(f"rod{k}", of("m", k), of("m", k) * of("l", k) ** 2 / 12) for k in range(n)]
    elements, start = [*rods, mb.Gravity(0, -G)], {}
    for k, j in enumerate(parents):
        ground = mb.Ground().point(p.base if is_loop and k == 2 else 0.0, 0.0)
        on = ground if j < 0 else rods[j].point((places[k] - 0.5) * of("l", j), 0.0)
        hinge = mb.Revolute(f"h{k}", on, rods[k].point(-0.5 * of("l", k), 0.0))
        torque = -of("k", k) * hinge.angle - of("d", k) * hinge.angle_rate
        elements += [hinge] if is_loop and k else [hinge, mb.Actuator(f"t{k}", hinge, torque)]
        if not is_loop or k == 0:
            start |= {f"h{k}.angle": of("a", k), f"h{k}.angle_rate": of("v", k)}
    guess = {}
    if is_loop:
        ends = rods[1].point(0.5 * p.l1, 0.0), rods[2].point(0.5 * p.l2, 0.0)
        elements.append(mb.Revolute("closing", *ends))
        found = _mechanism([*fixed], np.array([[*fixed.values()]]), parents, places)
        x = found.start()[0]
        guess = {f"rod{k}.theta": float(x[k]) for k in (1, 2)}
    outputs = {f"y{k}": rod.y for k, rod in enumerate(rods)} | {f"angle{k}": rod.theta for k, rod in enumerate(rods)}
    ends = {str(name): sorted((fixed[name] * (1 - spread), fixed[name] * (1 + spread))) for name in chosen}
    box = mb.Box(**{name: tuple(interval) for name, interval in ends.items()})
    times = np.linspace(0.0, rng.choice([0.1, 0.2, 0.4]), 7)
    scene = mb.Scene(mb.System(*elements, parameters=p), start, times, outputs, guess=guess, box=box, name=f"{seed}")
    return scene, lambda P: _mechanism([*fixed], P, parents, places)


_SPANS = {"m": (0.5, 2.0), "l": (0.5, 1.0), "a": (-1.0, 1.0), "v": (-2.0, 2.0), "k": (0.1, 1.0), "d": (0.005, 0.05)}


def _mechanism(names, P, parents, places):
    """The mechanism for the values P (N, n_p) of the named parameters."""
    column = lambda name: P[:, names.index(name)]  # noqa: E731
    own = [np.stack([column(f"{name}{k}") for k in range(len(parents))], axis=1) for name in _SPANS]
    return Mechanism(parents, places, *own, column("base") if "base" in names else None)
