"""Bricard's mechanism, of IFToMM's library of multibody benchmarks: five bars and six hinges with one row too many.

The bars are edges of a cube of 1 m, from P0 to P5, which are fixed. Each hinge is normal to both of its bars. Gravity
points along -y. The reference has the five angles of the chain from P0 as coordinates; it knows nothing of symmb.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from overconstrained import chain
from scipy.integrate import solve_ivp

import symmb as mb

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)], float)
AXES = np.array([(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)], float)
ALONG = 1e-4
"""Moment of inertia of a bar of 1 kg about itself."""


def principal(bar: int) -> np.ndarray:
    """Moments of inertia (3,) of a bar of 1 kg."""
    return np.where(np.abs(CORNERS[bar + 1] - CORNERS[bar]) > 0.5, ALONG, 1 / 12)


def scene(times=np.linspace(0, 10, 101), share: float = 0.01) -> mb.Scene:  # noqa: B008
    """The mechanism with masses of the bars as parameters."""
    p = mb.Parameters(m0=1.0, m1=1.0, m2=1.0, m3=1.0, m4=1.0)
    ground, middles = mb.Ground(), (CORNERS[:-1] + CORNERS[1:]) / 2
    bars = [
        mb.Body(f"bar{k}", p.symbols[k], tuple(p.symbols[k] * float(J) for J in principal(k)), mb.Spatial())
        for k in range(5)
    ]

    def corner(i: int, bar: int):
        return bars[bar].point(*(CORNERS[i] - middles[bar])) if bar < 5 else ground.point(*CORNERS[i])

    hinges = [mb.Revolute(f"hinge{i}", corner(i, (i - 1) % 6), corner(i, i), axis=tuple(AXES[i])) for i in range(6)]
    P3, P2 = corner(3, 2), corner(2, 1)
    outputs = {f"{x}{k}": getattr(P, x) for k, P in ((2, P2), (3, P3)) for x in "xyz"}
    guess = {f"bar{k}.{x}": float(value) for k in range(5) for x, value in zip("xyz", middles[k], strict=True)}
    system = mb.System(*bars, *hinges, mb.Gravity(0, -9.81, 0), parameters=p)
    return mb.Scene(system, {}, times, outputs, mb.Box.around(p, share), guess=guess, name="Bricard")


def reference(times: np.ndarray, m: Sequence[float] = (1.0,) * 5) -> np.ndarray:
    """The outputs (n_t, 6) for bars of masses m, to 1e-10."""
    angles, rates = ca.SX.sym("angles", 5), ca.SX.sym("rates", 5)
    bars, end = chain(CORNERS, AXES, angles, rates, (CORNERS[:-1] + CORNERS[1:]) / 2)
    kinetic, potential = 0, 0
    for k, (R, omega, middle) in enumerate(bars):
        v, own = ca.jtimes(middle, angles, rates), R.T @ omega
        kinetic += 0.5 * m[k] * (ca.dot(v, v) + ca.dot(own, ca.DM(principal(k)) * own))
        potential += m[k] * 9.81 * middle[1]
    closure = ca.vertcat(end - ca.DM(CORNERS[5]), ca.cross(R @ ca.DM(AXES[5]), ca.DM(AXES[5])))
    J = ca.jacobian(closure, angles)
    M = ca.hessian(kinetic, rates)[0]
    bias = ca.jtimes(ca.gradient(kinetic, rates), angles, rates) - ca.gradient(kinetic - potential, angles)
    f = ca.Function("f", [angles, rates], [M, bias, J, ca.jtimes(J @ rates, angles, rates)], {"cse": True})
    ends = [place + R @ ca.DM(CORNERS[k + 1] - CORNERS[k]) / 2 for k, (R, _, place) in enumerate(bars)]
    points = ca.Function("points", [angles], [ca.vertcat(ends[1], ends[2])])

    def slope(_: float, x: np.ndarray) -> np.ndarray:
        M, bias, J, change = (np.asarray(value) for value in f(x[:5], x[5:]))
        U, sigma, V = np.linalg.svd(J)
        along = V[4]  # the closure has rank 4
        held = -V[:4].T @ (U[:, :4].T @ change[:, 0] / sigma[:4])
        free = -along @ (M @ held + bias[:, 0]) / (along @ M @ along)
        return np.concatenate([x[5:], held + free * along])

    run = solve_ivp(slope, (times[0], times[-1]), np.zeros(10), "DOP853", times, rtol=1e-12, atol=1e-12)
    return np.array([np.asarray(points(x[:5])).ravel() for x in run.y.T])
