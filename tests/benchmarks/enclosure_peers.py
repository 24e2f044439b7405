"""Proved bounds of the states by symmb and by codac's CtcLohner: the time at which they are twice as wide as the truth.

    PYTHONPATH=.:tests python tests/benchmarks/enclosure_peers.py

Needs `codac` from PyPI. Both get the same equations, in coordinates of joints; codac has parameters as further states
that do not move. The true width is that of 300 samples. Of states whose true width is below a hundredth of its largest
one, the widths are not compared. codac is run with several steps up to 2 s. Its latest time is told,
and until when its bounds are finite.

JuliaReach and CORA publish a double pendulum with a controller and uncertain starts, not with uncertain lengths: they
enclose it for 1 s, JuliaReach in 72 boxes, to decide one property (ARCH-COMP, AINNCS). Neither is
run here, and we know of no published widths. The last row repeats this.
"""

import time
from dataclasses import replace

import casadi as ca
import codac
import numpy as np
from enclosure_samples import parameters, solutions
from enclosure_scenes import double_pendulum, duffing, pendulum, van_der_pol

from symmb.declare.symbolic import interpret, operation_name
from symmb.prove import enclose, problem_of
from symmb.run.simulation import DAESimulator

CASES = (
    (pendulum, 0.01, 10.0, 12),
    (pendulum, 0.05, 10.0, 16),
    (van_der_pol, 0.01, 20.0, 8),
    (van_der_pol, 0.05, 20.0, 8),
    (duffing, 0.05, 20.0, 6),
    (double_pendulum, 0.0001, 5.0, 6),
    (double_pendulum, 0.01, 5.0, 8),
)
PUBLISHED = (
    "published, not run here: JuliaReach encloses a double pendulum with a controller and uncertain starts for 1 s in "
    "72 boxes (ARCH-COMP, AINNCS)"
)
STEPS, FAR = (0.02, 0.005, 0.002), 2.0
"""Steps of codac [s], and the time up to which it is run [s]: its slices take minutes where boxes are wide."""
OPERATIONS = {
    "OP_ADD": lambda a, b: a + b,
    "OP_SUB": lambda a, b: a - b,
    "OP_MUL": lambda a, b: a * b,
    "OP_DIV": lambda a, b: a / b,
    "OP_NEG": lambda a: -a,
    "OP_SQ": codac.sqr,
    "OP_TWICE": lambda a: 2.0 * a,
    "OP_INV": lambda a: 1.0 / a,
    "OP_SIN": codac.sin,
    "OP_COS": codac.cos,
    "OP_CONSTPOW": lambda a, b: codac.pow(a, int(b)),
}


def _of_states(scene):
    """The problem of a scene, whose outputs are its states."""
    problem = problem_of("benchmark", DAESimulator(scene), scene.box)
    n = problem.n
    x, p, t = ca.SX.sym("x", n), ca.SX.sym("p", len(problem.middle)), ca.SX.sym("t")
    return replace(problem, outputs=ca.Function("states", [x, p, t], [x]))


def _by_codac(problem, step):
    """Lower and upper bounds (n_t, n) of the states at the output times."""
    n, m = problem.n, len(problem.middle)
    z = codac.VectorVar(n + m + 1)
    inputs = [[z[i] for i in range(n)], [z[n + i] for i in range(m)], [z[n + m]]]
    rates = interpret(problem.rates, inputs, lambda code, a: OPERATIONS[operation_name(code)](*a), float)[0]
    zero = 0.0 * z[0]
    f = codac.AnalyticFunction([z], codac.vec(*(zero + r for r in rates), *[zero] * m, zero + 1.0))
    tube = codac.SlicedTube(codac.create_tdomain([0.0, problem.times[-1]], step, True), codac.IntervalVector(n + m + 1))
    P = parameters(problem, 300)
    starts = np.array([np.array(problem.start.states(u, p, 0.0)).ravel()
                       for u, p in zip(problem.start.solve(P), P, strict=True)])  # fmt: skip
    box = [
        codac.Interval(float(low), float(high))
        for low, high in zip(starts.min(axis=0), starts.max(axis=0), strict=True)
    ]
    box += [codac.Interval(a - r, a + r) for a, r in zip(problem.middle.tolist(), problem.radius.tolist(), strict=True)]
    tube.set(codac.IntervalVector([*box, codac.Interval(0.0)]), 0.0)
    tube = codac.CtcLohner(f).contract(tube, codac.TimePropag.FWD)
    gates = np.array([piece.lb() for piece in tube.tdomain().tslices_vector() if piece.is_gate()])
    found = [tube(float(gates[np.argmin(np.abs(gates - t))])) for t in problem.times]  # between gates, boxes are wider
    return np.array([[[x[i].lb(), x[i].ub()] for i in range(n)] for x in found]).transpose(2, 0, 1)


def _doubled(lower, upper, true, times):
    """The last time up to which no width is more than twice the true one."""
    wide = true > 1e-2 * true.max(axis=0)
    with np.errstate(all="ignore"):
        bad = ((~(upper - lower <= 2.0 * true)) & wide).any(axis=1)
    return times[np.argmax(bad) - 1] if bad.any() else times[-1]


def main() -> None:
    print(
        f"{'scene':20} {'spread':>7} {'horizon':>8} | {'TaylorModel':>14} {'seconds':>8} | {'CtcLohner':>10} "
        f"{'finite':>10} seconds"
    )
    for make, spread, end, order in CASES:
        scene = make(spread=spread, end=end).with_times(np.linspace(0, end, 1 + int(50 * end)))
        problem = _of_states(scene)
        Y, _ = solutions(problem, parameters(problem, 300))
        true = np.ptp(Y, axis=0)
        begin = time.process_time()
        found = enclose(problem, order, 1)
        own = time.process_time() - begin
        until = _doubled(found.lower, found.upper, true, problem.times)
        short = replace(problem, times=problem.times[problem.times <= FAR])
        best, finite, begin = 0.0, 0.0, time.process_time()
        for step in STEPS:
            lower, upper = _by_codac(short, step)
            best = max(best, _doubled(lower, upper, true[: len(short.times)], short.times))
            finite = max(finite, short.times[np.isfinite(upper - lower).all(axis=1)].max())
        theirs = time.process_time() - begin
        print(
            f"{scene.name:20} {spread:7} {end:6} s | {until:5.2f} s (order {order:2}) {own:6.1f} | {best:8.2f} s "
            f"{finite:8.2f} s {theirs:6.1f}",
            flush=True,
        )
    print(PUBLISHED)


if __name__ == "__main__":
    main()
