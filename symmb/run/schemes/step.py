"""One step of an implicit scheme as a system of equations in SX."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca

from symmb.declare.symbolic import general_solver, independent, is_zero, jets
from symmb.equations.model import DAE, is_linear


@dataclass(frozen=True)
class Step:
    """One step of an implicit scheme from the history w to the time t, of length h.

    Attributes
    ----------
    x (n_x,), begin        state at the start, and first history: an expression of x, p, t and the first length h
    w, z                   history and unknowns, SX symbols
    p, t, h                parameters, time at the end of the step, and length of the step, SX symbols
    guess                  start value of z, an expression of w, p, t, h
    residual               equations that are zero at the solution, expressions of z, w, p, t, h
    following              history at the end of the step, an expression of z, w, p, t, h
    weight                 weight of the change of each unknown in the test of Newton's method, of z, w, p, t, h
    error                  estimated error (n_x,) or (0,) of the state at the end of the step, of z, w, p, t, h
    n_x, n_quad            numbers of the first entries of the history: state x (n_x,), integral of the power (n_quad,)
    order : int            order of the scheme
    growth : float         largest ratio of the length of a step to the length of the previous step
    projected              state on the constraints, an expression of x, p, t; None if the scheme does not project
    """

    x: ca.SX
    begin: ca.SX
    w: ca.SX
    z: ca.SX
    p: ca.SX
    t: ca.SX
    h: ca.SX
    guess: ca.SX
    residual: ca.SX
    following: ca.SX
    weight: ca.SX
    error: ca.SX
    n_x: int
    n_quad: int
    order: int
    growth: float
    projected: ca.SX | None = None

    def newton(self) -> tuple[ca.SX, ca.SX]:
        """The change of z (n_z,) that Newton's method subtracts, and this change times its weights, for the test of
        convergence. Entries of weight zero are left out."""
        if not self.z.numel():
            return self.z, self.z
        change = general_solver(ca.jacobian(self.residual, self.z))(self.residual)
        counted = [i for i in range(change.numel()) if not is_zero(self.weight[i])]
        return change, (self.weight * change)[counted]

    def jets(self, order: int) -> "Step":
        """The step of the Taylor coefficients for parameters p_0 + p_1 eps. The history begins with (x_0, ..., x_k)."""
        if order == 0:
            return self
        n_w, n_x = self.w.numel(), self.n_x

        def curve(symbol: ca.SX, name: str) -> list[ca.SX]:
            return [symbol, *(ca.SX.sym(f"{name}_{j}", symbol.numel()) for j in range(1, order + 1))]

        X, W, Z, P = curve(self.x, "x"), curve(self.w, "w"), curve(self.z, "z"), curve(self.p, "p")

        def expand(f: ca.SX, *curves: Sequence[ca.SX]) -> list[ca.SX]:
            coefficients = jets(f, [*curves, P])
            higher, zeros = ca.vertcat(*P[2:]), ca.SX.zeros(self.p.numel() * (order - 1))
            return [ca.substitute(c, higher, zeros) for c in coefficients] if order > 1 else coefficients

        def stacked(histories: Sequence[ca.SX]) -> ca.SX:
            return ca.vertcat(*[w[:n_x] for w in histories], *[w[n_x:n_w] for w in histories])

        return replace(
            self,
            x=ca.vertcat(*X),
            begin=stacked(expand(self.begin, X)),
            w=stacked(W),
            z=ca.vertcat(*Z),
            p=ca.vertcat(*P[:2]),
            guess=ca.vertcat(*expand(self.guess, W)),
            residual=ca.vertcat(*expand(self.residual, Z, W)),
            following=stacked(expand(self.following, Z, W)),
            weight=ca.repmat(self.weight, order + 1, 1),
            error=ca.vertcat(*expand(self.error, Z, W)),
            n_x=n_x * (order + 1),
            n_quad=0,
        )


@dataclass(frozen=True)
class At:
    """The DAE at one state: velocities, forces and rows of constraints. Missing parts are empty."""

    dae: DAE
    x: ca.SX
    p: ca.SX
    t: ca.SX

    @property
    def arguments(self) -> tuple[ca.SX, ...]:
        """The state, split into the arguments of the Functions of the DAE."""
        return self.dae.arguments(self.x, self.p, self.t)

    @property
    def qdot(self) -> ca.SX:
        """The rates N v of the coordinates, (n_q,)."""
        return self._rates()[0]

    @property
    def sdot(self) -> ca.SX:
        """Rates of the first-order states, (n_s,)."""
        return self._rates()[2] if self.dae.n_s else ca.SX(0, 1)

    def _rates(self) -> Sequence[ca.SX]:
        return self.dae.rhs.call(list(self.arguments))

    def solved(self) -> tuple[ca.SX, ca.SX]:
        """Accelerations (n_v,) and multipliers (n_r,) of the index-1 equations."""
        gamma = self.dae.gamma(*self.arguments) if self.dae.gamma is not None else ca.SX(0, 1)
        vdot, lam = self.dae.forward.call([*self.arguments, gamma])
        return vdot, lam

    def unbalance(self, vdot: ca.SX, lam: ca.SX) -> ca.SX:
        """The residual M v' + G' lam - Q, (n_v,)."""
        a = self.arguments
        f = self.dae.inertia(*a, vdot) - self.dae.Q(*a)
        return f + self.dae.G(*a).T @ lam if self.dae.G is not None else f

    def power(self, lam: ca.SX) -> ca.SX:
        """Power of forces without potential [W], (1,), or (0,) if there are no such forces."""
        return self.dae.power(*self.arguments, lam) if self.dae.power is not None else ca.SX(0, 1)

    def independent(self, rows: ca.SX, multipliers: ca.SX, scales: ca.SX | ca.DM) -> ca.SX:
        """Rows (n_r,) divided by their scales, or position rows (n_c,), without redundancy.

        At this state, rows can be redundant: some linear combinations of them are zero. The same combinations of the
        multipliers are added to the rows.
        """
        if self.dae.vanishing is None:
            return rows
        of_all, of_positions = self.dae.vanishing(*self.arguments)
        return independent(rows, multipliers, scales * (of_all if rows.numel() == self.dae.n_r else of_positions))

    def Phi(self) -> ca.SX:
        """Position rows, (n_c,)."""
        return self.dae.Phi(*self.arguments) if self.dae.Phi is not None else ca.SX(0, 1)

    def Phi_dot(self) -> ca.SX:
        """Rates of all rows, (n_r,)."""
        return self.dae.Phi_dot(*self.arguments) if self.dae.Phi_dot is not None else ca.SX(0, 1)


def sizes(dae: DAE, x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Scales of changes of the state x (n_x,), and of displacements along v (n_v,).

    The scale of lengths is the largest length, and the scale of angles the largest angle. Rates have scales of the same
    kind.
    """
    names = [*dae.q_names, *dae.v_names, *dae.s_names]
    linear = [is_linear(name) for name in names]
    rates = range(dae.n_q, dae.n_q + dae.n_v)
    both = (True, False)
    largest = {(kind, rate): ca.SX(dae.scales.size if kind else 1.0) for kind in both for rate in both}
    for i, kind in enumerate(linear):
        largest[kind, i in rates] = ca.fmax(largest[kind, i in rates], ca.fabs(x[i]))
    return (
        ca.vertcat(*[largest[kind, i in rates] for i, kind in enumerate(linear)]),
        ca.vertcat(*[largest[linear[i], False] for i in rates]),
    )
