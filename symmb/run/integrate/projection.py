"""Projection of states onto the constraints: positions first, then velocities."""

import casadi as ca

from symmb.declare.symbolic import jet_function
from symmb.equations.model import DAE


def normalize(dae: DAE, x: ca.SX) -> ca.SX | None:
    """The state with quaternions of norm 1; None if the state has no quaternions."""
    moved = ca.vertcat(dae.retract(x[: dae.n_q, :], ca.SX.zeros(dae.n_v)), x[dae.n_q :, :])
    return None if ca.is_equal(moved, x, 1) else moved


def sampled(dae: DAE, x: ca.SX, p: ca.SX, time: ca.SX) -> ca.SX:
    """The state with new sampled values, if `time` is a sampling instant."""
    if dae.sampling is None:
        return x
    return ca.vertcat(x[: dae.n_q + dae.n_v, :], dae.sampling.held(*dae.arguments(x, p, time)))


def sampled_jets(dae: DAE, x: ca.SX, p: ca.SX, time: ca.SX, order: int) -> ca.SX:
    """Taylor coefficients x of the state up to `order`, with new sampled values, for parameters (p_0, p_1)."""
    if dae.sampling is None or not order:
        return sampled(dae, x, p, time)
    n_x, n_p = x.numel() // (order + 1), len(dae.p_names)
    own = ca.SX.sym("x", n_x), ca.SX.sym("p", n_p), ca.SX.sym("t")
    coefficients = jet_function(ca.Function("sampled", [*own], [ca.densify(sampled(dae, *own))]), order + 1)
    P = [p[:n_p], p[n_p:], *[ca.SX.zeros(n_p)] * (order - 1)]
    return ca.vertcat(*coefficients(*ca.vertsplit(x, n_x), *P, time, *[ca.SX(0)] * order))


def project(dae: DAE, x: ca.SX, p: ca.SX, time: ca.SX, projections: int) -> ca.SX | None:
    """The state x (n_x,) on the constraints: Newton steps for the positions, then one correction of the velocities.

    Each Newton step moves q by the displacement delta that minimises delta' M delta subject to G delta = -Phi. The
    steps converge quadratically from a small drift: `projections` is 1 after a step, and 3 after an output interval.
    """
    if dae.min_norm_correction is None or dae.Phi_dot is None:
        return normalize(dae, x)
    x = ca.vertcat(dae.retract(x[: dae.n_q, :], ca.SX.zeros(dae.n_v)), x[dae.n_q :, :])
    at = dae.arguments(x, p, time)
    if dae.Phi is not None:
        for _ in range(projections):
            at = dae.arguments(x, p, time)
            violation = ca.vertcat(dae.Phi(*at), ca.SX.zeros(dae.n_r - dae.n_c))
            x = ca.vertcat(dae.retract(at[0], dae.min_norm_correction(*at, -violation)), x[dae.n_q :, :])
    # The velocities use the matrix of the last Newton step. The resulting error is a product of two small drifts.
    change = dae.min_norm_correction(*at, -dae.Phi_dot(*dae.arguments(x, p, time)))
    return x + ca.vertcat(ca.SX.zeros(dae.n_q), change, ca.SX.zeros(dae.n_s))
