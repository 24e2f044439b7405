"""The stabilised index-2 form of a DAE. The solver itself satisfies the constraints of positions and velocities."""

import casadi as ca

from symmb.declare.symbolic import independent
from symmb.equations.model import DAE
from symmb.run.integrate.initial_value_problem import InitialValueProblem
from symmb.run.integrate.projection import sampled


def stabilized_problem(dae: DAE, *, work: bool) -> InitialValueProblem:
    """The stabilised index-2 form, with constraints of positions and velocities as algebraic equations:

        q' = N v - S Phi_q' mu,      M v' = Q - G' lam,      0 = Phi,      0 = G v + Phi_t

    lam and mu are multipliers; mu is zero at the exact solution. S are squared scales of q. Units have no effect.

    References
    ----------
    Gear, Leimkuhler, Gupta (1985), Journal of Computational and Applied Mathematics 12-13, 77-90.
    """
    x = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s)
    p, time = ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    at = dae.arguments(x, p, time)
    rates = dae.rhs.call(list(at))
    of_v, row_scales = ca.DM(dae.displacement_scales), ca.DM(dae.row_scales)
    unit = dae.scales.energy / row_scales  # scaled by the size of the motion: units have no effect
    z, mu, a = ca.SX.sym("lam", dae.n_r), ca.SX.sym("mu", dae.n_c), ca.SX(0, 1)
    lam = unit * z
    qdot, vdot, guess, rows = rates[0], rates[1], ca.SX(0, 1), ca.SX(0, 1)
    if dae.G is not None and dae.Phi_dot is not None and dae.gamma is not None:
        first, guess = dae.forward(*at, dae.gamma(*at))
        guess = guess / unit
        M, force, rows = dae.M(*at), dae.Q(*at) - dae.G(*at).T @ lam, dae.Phi_dot(*at) / row_scales
        if dae.vanishing is not None:
            rows = independent(rows, z, row_scales * dae.vanishing(*at)[0])
        if ca.sprank(dae.M.sparsity_out(0)) < dae.n_v:  # a massless body: accelerations are algebraic as well
            a = ca.SX.sym("a", dae.n_v)
            vdot = of_v * a
            balance = of_v / dae.scales.energy * (M @ vdot - force)
            rows, guess = ca.vertcat(balance, rows), ca.vertcat(first / of_v, guess)
        else:
            vdot = ca.solve(M, force)
    if dae.Phi is not None and dae.Phi_q is not None:
        of_c, of_q = row_scales[: dae.n_c, :], ca.DM(dae.coordinate_scales)
        qdot = qdot - of_q**2 * (dae.Phi_q(*at).T @ (mu / of_c))
        positions = dae.Phi(*at) / of_c
        if dae.vanishing is not None:
            positions = independent(positions, mu, of_c * dae.vanishing(*at)[1])
        rows = ca.vertcat(rows, positions)
    return InitialValueProblem(
        x=x,
        z=ca.vertcat(a, z, mu),
        p=p,
        t=time,
        ode=ca.densify(ca.vertcat(qdot, vdot, *rates[2:])),
        alg=ca.densify(rows),
        quad=dae.power(*at, lam) if work and dae.power is not None else ca.SX(0, 1),
        z_guess=ca.vertcat(guess, ca.SX.zeros(dae.n_c)),
        projected=None if dae.sampling is None else sampled(dae, x, p, time),
    )
