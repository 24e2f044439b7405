"""Ziegler's column: two rods on springs and dampers under a force that follows the second one."""

from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.optimize import brentq

import symmb as mb


def ziegler(rng: np.random.Generator, damping: float) -> tuple[mb.Scene, Callable[..., float]]:
    """A random column, and its critical force for values of its first stiffness k and last mass m.

    The masses are at the ends of the rods, of which each has an inertia besides. Small angles a, b obey
    M (a'', b'') + C (a', b') + K(F) (a, b) = 0.
    """
    m1, m2, l1, l2 = rng.uniform(0.5, 2, 4)
    k1, k2 = rng.uniform(5, 20, 2)
    c1, c2 = damping * rng.uniform(0.5, 2, 2)
    p = mb.Parameters(k=float(k1), m=float(m2), F=1.0)
    first = mb.Body("a", mass=float(m1), inertia=0.01, pose=mb.Planar())
    last = mb.Body("b", mass=p.m, inertia=0.02, pose=mb.Planar())
    pull = k2 * (last.theta - first.theta) + c2 * (last.omega - first.omega)
    lower = mb.Revolute("lower", mb.Ground().point(0, 0), first.point(0, -l1))
    upper = mb.Revolute("upper", first.point(0, 0), last.point(0, -l2))
    on_first = mb.Torque("ta", first, -p.k * first.theta - c1 * first.omega + pull)
    follower = mb.Force("follower", last.point(0, 0), (p.F * ca.sin(last.theta), -p.F * ca.cos(last.theta)))
    system = mb.System(first, last, lower, upper, on_first, mb.Torque("tb", last, -pull), follower, parameters=p)
    scene = mb.Scene(system, start={"a.y": float(l1), "b.y": float(l1 + l2)})

    def critical(k: float, m: float = float(m2)) -> float:
        M = np.array([[(m1 + m) * l1**2 + 0.01, m * l1 * l2], [m * l1 * l2, m * l2**2 + 0.02]])
        C = np.array([[c1 + c2, -c2], [-c2, c2]])

        def growth(F: float) -> float:
            K = np.array([[k + k2 - F * l1, F * l1 - k2], [-k2, k2]])
            below = -np.linalg.solve(M, np.hstack([K, C]))
            return float(np.linalg.eigvals(np.vstack([np.eye(2, 4, 2), below])).real.max())

        grid = np.linspace(0.1, 60, 600)
        i = int(np.argmax([growth(F) > 0 for F in grid]))
        return float(brentq(growth, grid[i - 1], grid[i], xtol=1e-13))

    return scene, critical
