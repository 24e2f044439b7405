"""Generalised-alpha on the index-3 form; HHT and Newmark's method are members of the family."""

import casadi as ca

from symmb.equations.model import DAE
from symmb.run.schemes.step import At, Step, sizes


def generalized_alpha(dae: DAE, work: bool, alpha_m: float, alpha_f: float, gamma: float) -> Step:
    """One step. Positions change by increments along the velocities, so that rotations remain rotations.

        v+ = v + h ((1 - gamma) a + gamma a+)
        q+ = q (+) (h v + h^2 ((1/2 - beta) a + beta a+)),      beta = (gamma + 1/2)^2 / 4
        (1 - alpha_m) a+ + alpha_m a = (1 - alpha_f) v'+ + alpha_f v'
        M v'+ + G' lam+ = Q,      Phi = 0,      rates of velocity-only rows = 0

    The method is of second order if gamma = 1/2 + alpha_f - alpha_m. HHT has alpha_m = 0. Newmark's method has
    alpha_m = alpha_f = 0, and any gamma.

    References
    ----------
    Chung, Hulbert (1993), Journal of Applied Mechanics 60, 371-375; Arnold, Bruls (2007), Multibody System Dynamics 18,
    185-202, eqs. (6)-(8).
    """
    n_q, n_v, n_s = dae.n_q, dae.n_v, dae.n_s
    n_x = n_q + n_v + n_s
    beta = 0.25 * (gamma + 0.5) ** 2
    x, p, t, h = ca.SX.sym("x", n_x), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t"), ca.SX.sym("h")
    n_quad = 1 if work and dae.power is not None else 0
    w = ca.SX.sym("w", n_x + 2 * n_quad + 2 * n_v + n_s)
    cuts = [0, n_q, n_q + n_v, n_x, n_x + n_quad, n_x + 2 * n_quad, n_x + 2 * n_quad + n_v, n_x + 2 * n_quad + 2 * n_v]
    q, v, s, W, power_now, a, vdot, sdot = ca.vertsplit(w, [*cuts, w.numel()])

    # Unknowns and residuals are displacements relative to the size of the motion. Otherwise, rounding in Phi over h^2
    # prevents the convergence of Newton's method, and the matrix depends on units.
    scale, of_v, row_scales = beta * h**2, ca.DM(dae.displacement_scales), ca.DM(dae.row_scales)
    unit_v, unit_lam = of_v / scale, dae.scales.energy / row_scales / scale
    unknown, unknown_lam, s_new = ca.SX.sym("vdot", n_v), ca.SX.sym("lam", dae.n_r), ca.SX.sym("s", n_s)
    vdot_new, lam = unit_v * unknown, unit_lam * unknown_lam
    a_new = ((1 - alpha_f) * vdot_new + alpha_f * vdot - alpha_m * a) / (1 - alpha_m)
    v_new = v + h * ((1 - gamma) * a + gamma * a_new)
    q_new = dae.retract(q, h * v + h**2 * ((0.5 - beta) * a + beta * a_new))
    new = ca.vertcat(q_new, v_new, s_new)
    at, here = At(dae, new, p, t), At(dae, ca.vertcat(q, v, s), p, t - h)
    residual = ca.vertcat(
        scale * of_v / dae.scales.energy * at.unbalance(vdot_new, lam),
        here.independent(ca.vertcat(at.Phi(), h * at.Phi_dot()[dae.n_c :, :]) / row_scales, unknown_lam, row_scales),
        s_new - s - h * (at.sdot + sdot) / 2,
    )
    power = at.power(lam) if n_quad else ca.SX(0, 1)
    first = At(dae, x, p, t)
    vdot_first, lam_first = first.solved()
    # a is v' at a time that is shifted by (alpha_m - alpha_f) h. So the first step is of second order too.
    slope = ca.vertcat(first.qdot, vdot_first, first.sdot)
    jerk = ca.jtimes(vdot_first, x, slope) + ca.jacobian(vdot_first, t)
    begin = ca.vertcat(
        x,
        ca.SX.zeros(n_quad),
        first.power(lam_first) if n_quad else ca.SX(0, 1),
        vdot_first + (alpha_m - alpha_f) * h * jerk,
        vdot_first,
        first.sdot,
    )
    return Step(
        x=x,
        begin=begin,
        w=w,
        z=ca.vertcat(unknown, unknown_lam, s_new),
        p=p,
        t=t,
        h=h,
        guess=ca.vertcat(vdot / unit_v, here.solved()[1] / unit_lam, s),
        residual=ca.densify(residual),
        following=ca.vertcat(new, W + h * (power_now + power) / 2, power, a_new, vdot_new, at.sdot),
        weight=ca.vertcat(of_v / sizes(dae, w[:n_x])[1], ca.SX(dae.n_r, 1), ca.SX.ones(n_s)),
        error=ca.SX(0, 1),
        n_x=n_x,
        n_quad=n_quad,
        order=2,
        growth=5.0,
    )
