"""Outputs of a scene as CasADi Functions of state, parameters and time."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import batch, common, jets
from symmb.declare.symbolic import t as time_symbol
from symmb.equations.model import DAE, JointSpace, Scene, System
from symmb.run.integrate import Run


def declared_function(scene: Scene, own: System, y: ca.SX) -> ca.Function:
    """A function (x, p, t, multipliers, accelerations of the bodies) -> y. The states x belong to `own`, which is the
    system of the scene, or a system in joint space."""
    x = ca.vertcat(own.q, own.v, own.s)
    arguments = [x, own.p, time_symbol, ca.SX(scene.system.lam), scene.system.vdot]
    return ca.Function("declared", arguments, [ca.densify(y)])


def output_function(dae: DAE, scene: Scene, y: ca.SX, often: bool = True) -> ca.Function:
    """A function (x, p, t) -> y. Multipliers and accelerations are computed only if y depends on them.

    For a function that is not evaluated often, the search for common expressions takes longer than the evaluations."""
    system = scene.system
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    at = dae.arguments(x, p, t)
    if dae.sampling is not None:  # at an instant, outputs have the new values
        at = (*at[:2], dae.sampling.held(*at), *at[3:])
    declared = declared_function(scene, system, y)
    multipliers = _multipliers(dae, scene, y, at)
    accelerations = dae.rhs(*at)[1] if _contains(y, system.vdot) else ca.SX(*system.vdot.shape)
    found = declared(ca.vertcat(*map(ca.vec, at[:-2])), p, t, multipliers, accelerations)
    return (common if often else ca.Function)("y", [x, p, t], [found])


def joint_output_function(
    dae: DAE, joint_dae: DAE, scene: Scene, system: System, joints: JointSpace, declared: ca.Function
) -> ca.Function:
    """A function (x, p, t) -> outputs, for states x in joint coordinates.

    `declared` is the `declared_function` of the outputs, `system` is the system of the scene in joint space, and `dae`
    has the equations of the bodies.
    """
    t = time_symbol
    own = ca.vertcat(system.q, system.v, system.s)
    x, p = ca.SX.sym("x", own.numel()), ca.SX.sym("p", len(dae.p_names))
    vdot = scene.system.vdot
    q, v, s = joints.of_bodies
    multipliers = _multipliers(dae, scene, scene.y, (q, v, *([s] if dae.n_s else []), system.p, t))
    accelerations = ca.SX(*vdot.shape)
    if _contains(scene.y, vdot):
        rates = joint_dae.rhs(*joint_dae.arguments(own, system.p, t))
        accelerations = ca.jtimes(v, own, ca.vertcat(*rates))
    y = declared(own, system.p, t, multipliers, accelerations)
    if joint_dae.sampling is not None:  # at an instant, outputs have the new values
        held = joint_dae.sampling.held(*joint_dae.arguments(own, system.p, t))
        y = ca.substitute(y, system.s, held)
    f = ca.Function("solved", [own, system.p, t], [y])
    return common("y", [x, p, t], [f(x, p, t)])


def _multipliers(dae: DAE, scene: Scene, y: ca.SX, at: tuple[ca.SX, ...]) -> ca.SX:
    """Multipliers of all rows at a state, if y depends on them; zeros otherwise."""
    lam = ca.SX(scene.system.lam)
    if dae.gamma is None or not _contains(y, lam):
        return ca.SX(*lam.shape)
    multipliers = dae.forward(*at, dae.gamma(*at))[1]
    return multipliers if dae.distribute_multipliers is None else dae.distribute_multipliers(*at, multipliers)


def _contains(y: ca.SX, symbols: ca.SX) -> bool:
    return any(ca.which_depends(y, symbols, 1, True) or [])


def jet_outputs(y: ca.Function, order: int) -> ca.Function:
    """A function of (x_0 ... x_k, (p_0, p_1), t) that gives the Taylor coefficients of y(x, p, t) in eps, for
    x = x_0 + x_1 eps + ... + x_k eps^k and p = p_0 + p_1 eps."""
    n_x, n_p = y.numel_in(0), y.numel_in(1)
    X = [ca.SX.sym(f"x_{j}", n_x) for j in range(order + 1)]
    P = [ca.SX.sym(f"p_{j}", n_p) for j in range(order + 1)]
    t = ca.SX.sym("t")
    coefficients = ca.vertcat(*jets(y(X[0], P[0], t), [X, P]))
    if order > 1:  # parameters p_0 + p_1 eps have no higher coefficients
        coefficients = ca.substitute(coefficients, ca.vertcat(*P[2:]), ca.SX.zeros(n_p * (order - 1)))
    return common("jets", [ca.vertcat(*X), ca.vertcat(*P[:2]), t], [coefficients])


def outputs_along(y: ca.Function, runs: Sequence[Run], P: Array, times: Array, threads: int) -> Array:
    """The values (N, n_t, n_y) of a Function y (x, p, t) along N runs with parameters P (N, d) at times (n_t,)."""
    n_t, N = len(times), len(P)
    if not y.numel_out(0) or not N:
        return np.zeros((N, n_t, y.numel_out(0)))
    arguments = (np.concatenate([run.X for run in runs]), np.repeat(P, n_t, axis=0), np.tile(times, N)[:, None])
    return batch(y, *arguments, threads=threads)[0].reshape(N, n_t, -1)
