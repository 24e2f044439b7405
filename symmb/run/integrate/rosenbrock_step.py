"""One step of RODAS, a Rosenbrock method of order 4 for stiff equations, in symbols of CasADi."""

import casadi as ca

from symmb.declare.symbolic import common, general_solver
from symmb.run.integrate.initial_value_problem import InitialValueProblem
from symmb.run.schemes import Step
from symmb.run.schemes import rosenbrock as rodas


def rosenbrock(problem: InitialValueProblem) -> Step:
    """One step of RODAS: six linear systems with one matrix, which contains the Jacobian of the problem. The history
    contains multipliers."""
    n_x, n_quad, n_z, t, p = problem.x.numel(), problem.quad.numel(), problem.z.numel(), problem.t, problem.p
    n, nothing = n_x + n_quad + n_z, ca.SX(0, 1)
    y, h = ca.SX.sym("w", n), ca.SX.sym("h")
    rows = ca.vertcat(problem.ode, problem.quad, problem.alg)
    f = common("f", [ca.vertcat(problem.x, ca.SX.sym("quad", n_quad), problem.z), p, t], [rows])
    slope = f(y, p, t)
    J = ca.Function("J", [y, p, t], [ca.jacobian(slope, y)])
    partial = ca.Function("partial", [y, p, t], [ca.densify(ca.jacobian(slope, t))])
    begin, now, stages = t - h, y, []
    differential = ca.vertcat(ca.SX.ones(n_x + n_quad), ca.SX(n_z, 1))
    solve = general_solver(ca.diag(differential / (h * rodas.GAMMA)) - J(y, p, begin))
    in_time = h * partial(y, p, begin)
    for c, d, row, past in zip(rodas.C, rodas.D, rodas.A, rodas.G, strict=True):
        now = y + sum((a * u for a, u in zip(row, stages, strict=True)), ca.SX(n, 1))
        right = f(now, p, begin + c * h) + d * in_time
        right += differential / h * sum((g * u for g, u in zip(past, stages, strict=True)), ca.SX(n, 1))
        stages.append(solve(right))
    return Step(
        x=problem.x,
        begin=ca.vertcat(problem.x, ca.SX.zeros(n_quad), problem.z_guess),
        w=y,
        z=nothing,
        p=p,
        t=t,
        h=h,
        guess=nothing,
        residual=nothing,
        following=now + stages[-1],
        weight=nothing,
        error=stages[-1][:n_x],
        n_x=n_x,
        n_quad=n_quad,
        order=4,
        growth=5.0,
        projected=problem.projected,
    )
