"""Problems to enclose, and samples of their solutions by SciPy, with mpmath where these are not exact enough."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import casadi as ca
import mpmath
import numpy as np
from scipy.integrate import DOP853

from symmb.declare.symbolic import interpret, operation_name
from symmb.prove.problem import Problem, StartEquations

FINE, COARSE = 1e-13, 3e-13
"""Relative tolerances of samples, and of those that tell their errors."""
OWN = 3.0
"""Error of a sample over its difference from the coarse one."""
ROUNDING = 1e-14
"""Least error of a sample over the size of its output."""
DIGITS = 50


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
    """What samples say of bounds.

    Attributes
    ----------
    outside : farthest that a sample is outside, over the size of the output
    beyond : the same less the sample's own error
    filled : least part of a width that the samples fill
    own : largest own error of a sample, over the size of the output
    disputed : (m, n_p) parameters of the samples that are outside by more than their own errors, the worst first
    """

    outside: float
    beyond: float
    filled: float
    own: float
    disputed: np.ndarray


def check(problem, found, count=12, seed=0, motion_of=None):
    """Corners, edges and random points of the box, integrated by DOP853, against the bounds of an enclosure.

    They are integrated up to the last time of which anything is proved: later a solution need not exist. `motion_of`
    gives other equations than those of the problem: parameters (N, n_p) -> start(), rates(t, x) and outputs(t, x).
    """
    P = parameters(problem, count, seed)
    times = np.flatnonzero(np.isfinite(found.upper).any(axis=1)).max(initial=-1) + 1
    if not times:
        return Check(-np.inf, -np.inf, 1.0, 0.0, P[:0])
    Y, own = solutions(replace(problem, times=problem.times[:times]), P, motion_of)
    lower, upper = found.lower[:times], found.upper[:times]
    known = np.isfinite(upper)
    lowest, highest = Y.min(axis=0), Y.max(axis=0)
    size = np.maximum(np.abs([lowest, highest]).max(axis=(0, 1)), 1e-300)
    own = np.maximum(own, ROUNDING * size)
    outside = np.where(known, np.maximum(lower - Y, Y - upper), -np.inf)
    beyond = ((outside - own) / size).max(axis=(1, 2))
    worst = np.argsort(-beyond)
    width = (upper - lower)[known]
    filled = ((highest - lowest)[known] / width)[width > 1e-6]
    return Check(
        float((outside / size).max()), float(beyond.max()), float(filled.min(initial=1.0)), float((own / size).max()),
        P[worst[: np.count_nonzero(beyond > 0)]],
    )  # fmt: skip


def parameters(problem, count, seed=0):
    """(count, n_p) parameters: a third are corners, a third are on edges, the others are anywhere in the box."""
    rng = np.random.default_rng(seed)
    corners, xi = rng.choice([-1.0, 1.0], (count, problem.d)), rng.uniform(-1.0, 1.0, (count, problem.d))
    free = rng.integers(0, max(problem.d, 1), count)
    fixed = (np.arange(problem.d) != free[:, None]) | (np.arange(count) % 3 == 0)[:, None]
    xi = np.where(fixed & (np.arange(count) % 3 < 2)[:, None], corners, xi)
    P = np.tile(problem.middle, (count, 1))
    for k, (radius, j) in enumerate(zip(problem.radius, problem.variables, strict=True)):
        if j >= 0:
            P[:, k] += radius * xi[:, j]
    return P


def solutions(problem, P, motion_of=None):
    """Outputs (N, n_t, n_y) for parameters P (N, n_p), and bounds of their errors, from a coarser run."""
    motion = _of_problem(problem, P) if motion_of is None else motion_of(P)
    fine, coarse = (_integrated(problem.times, motion, rtol) for rtol in (FINE, COARSE))
    return fine, OWN * np.abs(fine - coarse)


class _EachSample(DOP853):
    """DOP853 for n states of N systems side by side, whose steps suit the worst one."""

    systems = 1

    def _estimate_error_norm(self, K, h, scale):
        """The norm of the method for each system alone."""
        five, three = ((K.T @ E / scale).reshape(self.systems, -1) for E in (self.E5, self.E3))
        five, three = (five**2).sum(axis=1), (three**2).sum(axis=1)
        total = five + 0.01 * three
        norms = np.where(total > 0, five / np.sqrt(np.where(total > 0, total, 1.0) * (self.n / self.systems)), 0.0)
        return abs(h) * norms.max()


def _of_problem(problem, P):
    """The start, the rates and the outputs of a problem for parameters P (N, n_p)."""
    x = _of_all(problem.start.states, problem.start.solve(P), P)(0.0)
    return SimpleNamespace(start=lambda: x, rates=_of_all(problem.rates, x, P), outputs=_of_all(problem.outputs, x, P))


def _integrated(times, motion, rtol):
    """Outputs (N, n_t, n_y), with steps that end at the output times."""
    x = motion.start()
    shape = x.shape
    found, step = [], None
    for begin, end in zip([times[0], *times[:-1]], times, strict=True):
        if end > begin:
            rates = lambda t, z: motion.rates(t, z.reshape(shape)).ravel()  # noqa: E731
            solver = _EachSample(rates, begin, x.ravel(), end, rtol=rtol, atol=1e-3 * rtol,
                                 first_step=step and min(step, end - begin))  # fmt: skip
            solver.systems = shape[0]
            while solver.status == "running":
                step = solver.h_abs
                assert solver.step() is None
            x = solver.y.reshape(shape)
        found.append(motion.outputs(end, x))
    return np.stack(found, axis=1)


def _of_all(f, x, P):
    """(t, x (N n,)) -> (N, m) values of f(x, p, t) for all parameters, in arrays that CasADi reads and writes."""
    own, p, t = np.array(x, dtype=float), np.ascontiguousarray(P), np.zeros(len(P))
    buffer, call = f.map(len(P)).buffer()
    for i, a in enumerate((own, p, t)):
        buffer.set_arg(i, memoryview(a))

    def values(time, z=None):
        found = np.zeros((len(P), f.numel_out(0)))
        if z is not None:
            own[:] = z
        t[:] = time
        buffer.set_res(0, memoryview(found))
        call()
        return found

    return values


EXACT = {
    "OP_ADD": lambda a, b: a + b,
    "OP_SUB": lambda a, b: a - b,
    "OP_MUL": lambda a, b: a * b,
    "OP_DIV": lambda a, b: a / b,
    "OP_POW": lambda a, b: a**b,
    "OP_NEG": lambda a: -a,
    "OP_SQ": lambda a: a * a,
    "OP_TWICE": lambda a: 2 * a,
    "OP_INV": lambda a: 1 / a,
} | {
    f"OP_{name.upper()}": getattr(mpmath, name)
    for name in "atan2 hypot sqrt sin cos tan exp log sinh cosh tanh asin acos atan asinh acosh atanh"
    " log1p expm1 erf".split()
}
"""Functions of mpmath by the names of CasADi's operations."""


def exact(problem, p):
    """Outputs (n_t, n_y) for parameters (n_p,) as mpmath numbers, in 50 digits by mpmath's Taylor series."""
    with mpmath.workdps(DIGITS):
        p = [mpmath.mpf(float(value)) for value in p]
        u = [mpmath.mpf(float(value)) for value in problem.start.solve(np.array([p], dtype=float))[0]]
        if u:
            residual = lambda *u: _in_mpmath(problem.start.residual, u, p, 0)  # noqa: E731
            u = list(mpmath.findroot(residual, u, tol=10.0 ** (4 - DIGITS)))
        x = _in_mpmath(problem.start.states, u, p, 0)
        motion = mpmath.odefun(lambda t, x: _in_mpmath(problem.rates, x, p, t), 0, x) if x else lambda t: x
        times = [mpmath.mpf(float(t)) for t in problem.times]
        return np.array([_in_mpmath(problem.outputs, motion(t), p, t) for t in times])


def _in_mpmath(f, x, p, t):
    def operation(code, arguments):
        name = f"OP_{operation_name(code).upper()}".replace("CONSTPOW", "POW")
        return arguments[0] if code == ca.OP_ASSIGN else EXACT[name](*arguments)

    return interpret(f, [list(x), list(p), [mpmath.mpf(t)]], operation, mpmath.mpf)[0]


def require_sharp(bounds, runs, error, excess, size=None):
    """Bounds at all times hold runs (N, n_t, n_y) but for an error, and are wider by an excess at most.

    Both are shares of a size; where none is given, of the largest values of each output.
    """
    runs = np.array(runs)
    size = np.abs(runs).max(axis=(0, 1)) if size is None else size
    assert np.isfinite(bounds.upper).all(), bounds.doubts
    assert (np.maximum(bounds.lower - runs, runs - bounds.upper) / size).max() <= error
    assert ((bounds.upper - bounds.lower - np.ptp(runs, axis=0)) / size).max() < excess
