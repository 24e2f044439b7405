"""Problems to enclose, and samples of their solutions by SciPy."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from symmb.enclosures.problem import Problem, StartEquations


def ode(f, start, box, times, outputs=None):
    """x' = f(x, p, t), x(0) = start(p), for parameters p in a box of (low, high)."""
    low, high = np.array(box, dtype=float).reshape(-1, 2).T
    n = len(start([0.0] * len(low)))
    x, u, p, t = ca.SX.sym("x", n), ca.SX.sym("u", 0), ca.SX.sym("p", len(low)), ca.SX.sym("t")
    y = ca.vertcat(*(outputs(x, p, t) if outputs else [x]))
    radius = np.nextafter(0.5 * (high - low), np.inf) * (high > low)
    return Problem(
        rates=ca.Function("f", [x, p, t], [ca.densify(ca.vertcat(*f(x, p, t)))]),
        outputs=ca.Function("y", [x, p, t], [ca.densify(y)]),
        middle=0.5 * (low + high),
        radius=radius,
        variables=tuple(int(np.count_nonzero(radius[:k] > 0)) if radius[k] else -1 for k in range(len(low))),
        times=np.asarray(times, dtype=float),
        scales=np.ones(n),
        start=StartEquations(
            ca.Function("residual", [u, p, t], [ca.SX(0, 1)]),
            ca.Function("states", [u, p, t], [ca.densify(ca.vertcat(*start(p)))]),
            lambda P: np.zeros((len(P), 0)),
        ),
    )


@dataclass(frozen=True)
class Check:
    """How far samples are outside of bounds, over the size of the output, and the least part of a width they fill."""

    outside: float
    filled: float


def check(problem, found, count=12, seed=0, start=None):
    """Corners and random points of the box, integrated by DOP853, against the bounds of an enclosure.

    `start`, P (1, n_p) -> x (1, n), is the start of a scene's simulator.
    """
    rng = np.random.default_rng(seed)
    known = np.isfinite(found.upper)
    lowest, highest = np.full(found.lower.shape, np.inf), np.full(found.lower.shape, -np.inf)
    for k in range(count):
        xi = rng.choice([-1.0, 1.0], problem.d) if k % 2 else rng.uniform(-1.0, 1.0, problem.d)
        p = np.array(
            [
                m + r * xi[j] if j >= 0 else m
                for m, r, j in zip(problem.middle, problem.radius, problem.variables, strict=True)
            ]
        )
        Y = solution(problem, p, start)
        lowest, highest = np.minimum(lowest, Y), np.maximum(highest, Y)
    size = np.abs([lowest, highest]).max(axis=(0, 1))
    outside = np.maximum(found.lower - lowest, highest - found.upper) / np.maximum(size, 1e-300)
    width = (found.upper - found.lower)[known]
    filled = ((highest - lowest)[known] / width)[width > 1e-6]
    return Check(float(outside[known].max()), float(filled.min(initial=1.0)))


def solution(problem, p, start=None):
    """Outputs (n_t, n_y) for parameters p, by DOP853."""
    if start is None:
        x0 = np.array(problem.start.states(np.zeros(0), p, 0.0)).ravel()
    else:
        x0 = start(p[None])[0][0]
    times = problem.times
    run = solve_ivp(
        lambda t, x: np.array(problem.rates(x, p, t)).ravel(),
        (times[0], times[-1]),
        x0,
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
        t_eval=times,
    )
    assert run.success
    return np.array([np.array(problem.outputs(x, p, t)).ravel() for x, t in zip(run.y.T, times, strict=True)])
