"""Second-order BDF on the stabilised index-2 form, which is called NSTIFF-SI2, and on the index-3 form."""

import casadi as ca

from symmb.equations.model import DAE
from symmb.run.schemes.step import At, Step, sizes


def nstiff_si2(dae: DAE, work: bool, stabilized: bool = True) -> Step:
    """The step of eqs. (5)-(7) of Wang & Yang (2021), for steps of varying length; without stabilisation, of index 3.

    The unknowns are v', q', lam and mu. The BDF formula gives the new state q, v. The equations are

        M v' + G' lam - Q = 0,      N v - q' + Phi_q' mu = 0,      Phi / (b h) = 0,      (G v + Phi_t) / (b h) = 0,

    with b = 2/3 for equal steps. The norms of quaternions are rows of Phi in the second and third equation. mu is zero
    at the exact solution; it has a weight if the size of the motion is not 1 m. With index 3 there is no mu, and the
    last equation has only velocity-only rows.

    References
    ----------
    Wang, Yang (2021), Nonlinear Dynamics, eqs. (5)-(8); Negrut, Rampalli, Ottarsson, Sajdak (2007), ASME Journal of
    Computational and Nonlinear Dynamics 2, 73-85, for the scaling of Phi.
    """
    n_q, n_v, n_x = dae.n_q, dae.n_v, dae.n_q + dae.n_v + dae.n_s
    x, p, t, h = ca.SX.sym("x", n_x), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t"), ca.SX.sym("h")
    n_quad = 1 if work and dae.power is not None else 0
    # history: state, work, power, previous state, length of the last step
    w = ca.SX.sym("w", 2 * n_x + 2 * n_quad + 1)
    now, before, h_last = w[:n_x], w[n_x + 2 * n_quad : -1], w[-1]
    W, power_now = w[n_x : n_x + n_quad], w[n_x + n_quad : n_x + 2 * n_quad]
    ratio = h / h_last
    b = (1 + ratio) / (1 + 2 * ratio)
    past = ((1 + ratio) ** 2 * now - ratio**2 * before) / (1 + 2 * ratio)

    heads = quaternions(dae) if stabilized else []
    # Unknowns and residuals are relative to the changes in a step, so that units and step do not affect the condition.
    tau, energy = b * h, dae.scales.energy
    of_q, of_v, row_scales = ca.DM(dae.coordinate_scales), ca.DM(dae.displacement_scales), ca.DM(dae.row_scales)
    n_c, of_c = dae.n_c, row_scales[: dae.n_c, :]
    unit_x, unit_lam, unit_mu = parts = _units(dae, tau, len(heads), stabilized)
    units = ca.vertcat(*parts)
    z = ca.SX.sym("z", units.numel())
    rate, lam, mu = ca.vertsplit(units * z, [0, n_x, n_x + dae.n_r, z.numel()])
    new = past + b * h * rate
    at = At(dae, new, p, t)
    positions, towards = _positions(dae, x, p, t, mu.numel(), heads)(new, mu, p, t)
    here, z_lam, z_mu = At(dae, now, p, t - h), lam / unit_lam, mu / unit_mu
    if stabilized:
        positions = ca.vertcat(here.independent(positions[:n_c, :] / of_c, z_mu[:n_c, :], of_c), positions[n_c:, :])
        rows = positions, here.independent(tau * at.Phi_dot() / row_scales, z_lam, row_scales)
    else:
        rows = (here.independent(ca.vertcat(positions, tau * at.Phi_dot()[n_c:, :]) / row_scales, z_lam, row_scales),)
    residual = ca.vertcat(
        tau**2 / energy * of_v * at.unbalance(rate[n_q : n_q + n_v, :], lam),
        tau / of_q * (at.qdot - rate[:n_q, :] + towards),
        tau * (at.sdot - rate[n_q + n_v :, :]),
        *rows,
    )
    power = at.power(lam) if n_quad else ca.SX(0, 1)
    begin = _first_history(At(dae, x, p, t), h, n_quad)
    vdot_now, lam_now = here.solved()
    rate_now = ca.vertcat(here.qdot, vdot_now, here.sdot)
    # The errors of both formulas are multiples of the third derivative, and so is their difference.
    predicted = now + (1 + ratio) * h * rate_now - ratio**2 * (now - before)
    return Step(
        x=x,
        begin=begin,
        w=w,
        z=z,
        p=p,
        t=t,
        h=h,
        guess=ca.vertcat(rate_now, lam_now, ca.SX.zeros(mu.numel())) / units,
        residual=ca.densify(residual),
        following=ca.vertcat(new, W + h * (power_now + power) / 2, power, now, h),
        weight=ca.vertcat(tau * unit_x / sizes(dae, now)[0], ca.SX(z.numel() - n_x, 1)),
        error=(new - predicted) * (1 + ratio) / (2 + 3 * ratio),
        n_x=n_x,
        n_quad=n_quad,
        order=2,
        growth=2.0,
    )


def _units(dae: DAE, tau: ca.SX, n_heads: int, stabilized: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The unknowns of a step: rates of the state, multipliers lam and, at index 2, mu."""
    of_q, of_v, row_scales = ca.DM(dae.coordinate_scales), ca.DM(dae.displacement_scales), ca.DM(dae.row_scales)
    of_positions = ca.vertcat(row_scales[: dae.n_c, :], ca.DM.ones(n_heads))
    return (
        ca.vertcat(of_q / tau, of_v / tau**2, ca.DM.ones(dae.n_s) / tau),
        dae.scales.energy / row_scales / tau**2,
        dae.scales.length**2 / of_positions / tau if stabilized else ca.SX(0, 1),
    )


def _positions(dae: DAE, x: ca.SX, p: ca.SX, t: ca.SX, n_mu: int, heads: list[int]) -> ca.Function:
    """A function (x, mu, p, t) -> rows of Phi and norms of quaternions, and the correction of q' by mu."""
    q, mu = x[: dae.n_q], ca.SX.sym("mu", n_mu)
    norms = ca.vertcat(*[(ca.sumsqr(q[i : i + 4]) - 1) / 2 for i in heads]) if heads else ca.SX(0, 1)
    rows = ca.densify(ca.vertcat(At(dae, x, p, t).Phi(), norms))
    if not n_mu:
        return ca.Function("positions", [x, mu, p, t], [rows, ca.SX.zeros(dae.n_q)])
    # Angles are corrected as if they were lengths. Otherwise the correction would depend on the unit of length.
    weights = (ca.DM(dae.coordinate_scales) / dae.scales.length) ** 2
    back = weights * ca.densify(ca.jacobian(rows, q).T @ mu)
    return ca.Function("positions", [x, mu, p, t], [rows, back])


def _first_history(first: At, h: ca.SX, n_quad: int) -> ca.SX:
    """The history at the start. A Taylor expansion of order 2 gives the state one step before the start."""
    vdot, lam = first.solved()
    slope = ca.vertcat(first.qdot, vdot, first.sdot)
    bend = ca.jtimes(slope, first.x, slope) + ca.jacobian(slope, first.t)
    power = first.power(lam) if n_quad else ca.SX(0, 1)
    return ca.vertcat(first.x, ca.SX.zeros(n_quad), power, first.x - h * slope + h**2 / 2 * bend, h)


def quaternions(dae: DAE) -> list[int]:
    """Index of the scalar part of each quaternion in q."""
    return [
        i for i, (name, one) in enumerate(zip(dae.q_names, dae.q_neutral, strict=True)) if one and name[-3:] == ".e0"
    ]
