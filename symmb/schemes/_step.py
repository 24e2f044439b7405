"""What an implicit scheme is: one step as a system of equations in SX."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from symmb.dae import DAE
from symmb.symbolic.jets import jets


@dataclass(frozen=True)
class Step:
    """One step of an implicit scheme from the history w to the time t, of length h.

    Attributes
    ----------
    x (n_x,), begin        the state at the start, and the history that it makes with a first step of length h at time t
    w, z                   history and unknowns, SX symbols
    p, t, h                parameters, time at the end of the step, its length, SX symbols
    guess                  of z, in w, p, t, h
    residual               zero at the solution, in z, w, p, t, h
    following              history at the end of the step, in z, w, p, t, h
    n_x, n_quad            the history begins with the state x (n_x,), the integral of the power (n_quad,) follows
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
    n_x: int
    n_quad: int

    def jets(self, order: int) -> "Step":
        """The step of the Taylor coefficients along p_0 + p_1 eps; states stand as (x_0, ..., x_k) in front of w."""
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

        return Step(
            x=ca.vertcat(*X),
            begin=stacked(expand(self.begin, X)),
            w=stacked(W),
            z=ca.vertcat(*Z),
            p=ca.vertcat(*P[:2]),
            t=self.t,
            h=self.h,
            guess=ca.vertcat(*expand(self.guess, W)),
            residual=ca.vertcat(*expand(self.residual, Z, W)),
            following=stacked(expand(self.following, Z, W)),
            n_x=n_x * (order + 1),
            n_quad=0,
        )


@dataclass(frozen=True)
class At:
    """The DAE at one state: velocities, forces, rows; empty where the scene has none."""

    dae: DAE
    x: ca.SX
    p: ca.SX
    t: ca.SX

    @property
    def arguments(self) -> tuple[ca.SX, ...]:
        """The state split into the arguments of the DAE's Functions."""
        return self.dae.arguments(self.x, self.p, self.t)

    @property
    def qdot(self) -> ca.SX:
        """N v, (n_q,)."""
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
        """M v' + G' lam - Q, (n_v,)."""
        a = self.arguments
        f = self.dae.M(*a) @ vdot - self.dae.Q(*a)
        return f + self.dae.G(*a).T @ lam if self.dae.G is not None else f

    def power(self, lam: ca.SX) -> ca.SX:
        """Power of forces without potential [W], no entry if there are none."""
        return self.dae.power(*self.arguments, lam) if self.dae.power is not None else ca.SX(0, 1)

    def Phi(self) -> ca.SX:
        """Position rows, (n_c,)."""
        return self.dae.Phi(*self.arguments) if self.dae.Phi is not None else ca.SX(0, 1)

    def Phi_dot(self) -> ca.SX:
        """Rates of all rows, (n_r,)."""
        return self.dae.Phi_dot(*self.arguments) if self.dae.Phi_dot is not None else ca.SX(0, 1)
