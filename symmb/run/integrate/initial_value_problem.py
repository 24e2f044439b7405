"""An initial value problem in SX for CasADi's integrators, and the larger problem of its Taylor coefficients."""

from dataclasses import dataclass, replace

import casadi as ca

from symmb._types import Array
from symmb.declare.symbolic import common, independent, jets, symmetric_solver
from symmb.equations.model import DAE
from symmb.run.integrate.projection import normalize, project, sampled
from symmb.run.integrate.stabilization import AugmentedLagrangian, Baumgarte, Projection, Stabilization

PROJECTION_STEPS = 3
"""Number of Newton steps of a projection. Newton's method converges quadratically, so that this number suffices for the
drift over an output interval."""


@dataclass(frozen=True)
class InitialValueProblem:
    """The equations x' = ode(x, z, p, t), 0 = alg(x, z, p, t), and the integrands `quad` along the motion.

    `projected` is x after projection: on the constraints if the method projects, with quaternions of norm 1, and with
    sampled values.
    """

    x: ca.SX
    z: ca.SX
    p: ca.SX
    t: ca.SX
    ode: ca.SX
    alg: ca.SX
    quad: ca.SX
    z_guess: ca.SX
    projected: ca.SX | None

    def projection(self) -> ca.Function | None:
        """The function (x, p, t) -> x on the constraints; None if states are not projected."""
        if self.projected is None:
            return None
        return common("project", [self.x, self.p, self.t], [self.projected])

    def in_units(self, units: Array) -> "InitialValueProblem":
        """The problem of x and integrals divided by units (n_x + n_quad,), for one absolute tolerance."""
        n, D = self.x.numel(), ca.DM(units[: self.x.numel()])

        def at(f: ca.SX) -> ca.SX:
            return ca.substitute(f, self.x, D * self.x)

        projected = None if self.projected is None else at(self.projected) / D
        parts = {
            "alg": at(self.alg),
            "quad": at(self.quad) / ca.DM(units[n:]),
            "z_guess": at(self.z_guess),
            "projected": projected,
        }
        return replace(self, ode=at(self.ode) / D, **parts)

    def from_begin(self) -> "InitialValueProblem":
        """The problem of the changes of x and of the integrals since the start, divided by units, plus offsets.

        The last parameters are x at the start, and the units and the offsets of x and of the integrals.
        """
        n, n_y = self.x.numel(), self.x.numel() + self.quad.numel()
        y, begin, units, offset = (
            ca.SX.sym(name, k) for name, k in (("y", n_y), ("begin", n), ("units", n_y), ("offset", n_y))
        )
        x = begin + units[:n] * (y[:n] - offset[:n])

        def at(f: ca.SX) -> ca.SX:
            return ca.substitute(f, self.x, x)

        ode, p = at(ca.vertcat(self.ode, self.quad)) / units, ca.vertcat(self.p, begin, units, offset)
        nothing, guess = ca.SX(0, 1), at(self.z_guess)
        return replace(self, x=y, p=p, ode=ode, alg=at(self.alg), quad=nothing, z_guess=guess, projected=None)

    def jets(self, order: int) -> "InitialValueProblem":
        """The problem of the Taylor coefficients x_0, ..., x_k for p_0 + p_1 eps, with parameters (p_0, p_1)."""
        if order == 0:
            return self
        zero = ca.SX.zeros(self.p.shape)
        p1 = ca.SX.sym("p_1", self.p.numel())
        X = [self.x, *(ca.SX.sym(f"x_{j}", self.x.numel()) for j in range(1, order + 1))]
        Z = [self.z, *(ca.SX.sym(f"z_{j}", self.z.numel()) for j in range(1, order + 1))]
        P = [ca.SX.sym(f"P_{j}", self.p.numel()) for j in range(1, order + 1)]
        fixed = ca.vertcat(*P) if P else ca.SX(0, 1)
        values = ca.vertcat(p1, *(zero for _ in P[1:])) if P else fixed

        def expand(f: ca.SX, *curves: list[ca.SX]) -> ca.SX:
            return ca.substitute(ca.vertcat(*jets(f, [*curves, [self.p, *P]])), fixed, values)

        return replace(
            self,
            x=ca.vertcat(*X),
            z=ca.vertcat(*Z),
            p=ca.vertcat(self.p, p1),
            ode=expand(self.ode, X, Z),
            alg=expand(self.alg, X, Z),
            quad=ca.SX(0, 1),
            z_guess=expand(self.z_guess, X),
            projected=None if self.projected is None else expand(self.projected, X),
        )


def build_problem(
    dae: DAE,
    stabilization: Stabilization,
    *,
    algebraic: bool,
    work: bool,
    one_step: bool = False,
    projections: int = PROJECTION_STEPS,
) -> InitialValueProblem:
    """The initial value problem of the index-reduced DAE.

    Parameters
    ----------
    dae : DAE
    stabilization : None, Baumgarte or Projection
    algebraic : bool         whether multipliers are algebraic variables (index 1); otherwise they are eliminated
    work : bool              whether the power of forces without potential is integrated too
    one_step : bool          whether the method has no history, so that quaternions can be normalised between steps
    projections : int        number of Newton steps of a projection
    """
    x = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s)
    p, time = ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    at = dae.arguments(x, p, time)
    rates = dae.rhs(*at)
    rates = list(rates) if isinstance(rates, tuple) else [rates]
    right = dae.gamma(*at) if dae.gamma is not None else ca.SX(0, 1)
    if isinstance(stabilization, Baumgarte):
        right = right - _feedback(dae, at, 2 * stabilization.alpha, stabilization.beta**2)
    if isinstance(stabilization, AugmentedLagrangian) and dae.G is not None:
        vdot, lam = _augmented(dae, at, dae.G(*at), right, stabilization)
    elif not dae.n_r:
        vdot, lam = rates[1], right
    else:
        vdot, lam = dae.forward(*at, right)
    alg, z, guess = ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1)
    if algebraic and dae.n_r and dae.G is not None:
        z, guess, alg, vdot, lam = _with_multipliers(dae, at, dae.G(*at), right, vdot, lam)
    power = dae.power(*at, lam) if work and dae.power is not None else ca.SX(0, 1)
    return InitialValueProblem(
        x=x,
        z=z,
        p=p,
        t=time,
        ode=ca.densify(ca.vertcat(rates[0], vdot, *rates[2:])),
        alg=ca.densify(alg),
        quad=power,
        z_guess=guess,
        projected=_projected(dae, x, p, time, projections if isinstance(stabilization, Projection) else 0, one_step),
    )


def _with_multipliers(
    dae: DAE, at: tuple[ca.SX, ...], G: ca.SX, right: ca.SX, vdot: ca.SX, lam: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    """Algebraic variables, their first guess and their residual, and accelerations and multipliers as expressions of
    these variables."""
    M = dae.M(*at)
    of_v, row_scales = ca.DM(dae.displacement_scales), ca.DM(dae.row_scales)
    unit = dae.scales.energy / row_scales  # scaled by the size of the motion: units have no effect
    if ca.sprank(dae.M.sparsity_out(0)) < dae.n_v:  # a massless body: accelerations are algebraic as well
        z, guess = ca.SX.sym("a_lam", dae.n_v + dae.n_r), ca.vertcat(vdot / of_v, lam / unit)
        vdot, lam = of_v * z[: dae.n_v], unit * z[dae.n_v :]
        balance = of_v / dae.scales.energy * (M @ vdot + G.T @ lam - dae.Q(*at))
    else:
        z, guess = ca.SX.sym("lam", dae.n_r), lam / unit
        # v' = M^-1 (Q - G' lam) is explicit; the rows G v' = gamma determine lam. M is inverted by blocks.
        lam = unit * z
        vdot, balance = ca.solve(M, dae.Q(*at) - G.T @ lam), ca.SX(0, 1)
    rows = (G @ vdot - right) / row_scales
    if dae.vanishing is not None:
        rows = independent(rows, lam / unit, row_scales * dae.vanishing(*at)[0])
    return z, guess, ca.vertcat(balance, rows), vdot, lam


def _projected(dae: DAE, x: ca.SX, p: ca.SX, time: ca.SX, projections: int, one_step: bool) -> ca.SX | None:
    """The state on the constraints or with quaternions of norm 1, and with sampled values; None without changes."""
    if projections:
        projected = project(dae, x, p, time, projections)
    else:
        projected = normalize(dae, x) if one_step else None
    return projected if dae.sampling is None else sampled(dae, x if projected is None else projected, p, time)


def _feedback(dae: DAE, at: tuple[ca.SX, ...], of_rates: float, of_positions: float) -> ca.SX:
    """The feedback of_rates (G v + Phi_t) + of_positions Phi, (n_r,). Velocity-only rows have no term with Phi."""
    if dae.Phi_dot is None:
        return ca.SX(0, 1)
    Phi = dae.Phi(*at) if dae.Phi is not None else ca.SX(0, 1)
    return of_rates * dae.Phi_dot(*at) + of_positions * ca.vertcat(Phi, ca.SX.zeros(dae.n_r - dae.n_c))


def _augmented(
    dae: DAE, at: tuple[ca.SX, ...], G: ca.SX, right: ca.SX, method: AugmentedLagrangian
) -> tuple[ca.SX, ca.SX]:
    """Accelerations (n_v,) and multipliers (n_r,) by the augmented Lagrangian method."""
    M, Q = dae.M(*at), dae.Q(*at)
    a = method.penalty * ca.trace(M) / dae.n_v
    omega = method.omega * dae.scales.rate
    right = right - _feedback(dae, at, 2 * method.damping * omega, omega**2)
    solve, vdot, lam = symmetric_solver(M + a * G.T @ G), Q, ca.SX.zeros(dae.n_r)
    for _ in range(method.iterations + 1):
        vdot = solve(Q - G.T @ (lam - a * right))
        lam = lam + a * (G @ vdot - right)
    return vdot, lam
