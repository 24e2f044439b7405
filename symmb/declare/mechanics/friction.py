"""Friction laws, and the friction force between two bodies that slide on each other."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from symmb._errors import DeclarationError
from symmb._magnitudes import SLIGHT
from symmb._options import is_real
from symmb._types import Expr
from symmb.declare.mechanics.body import Body
from symmb.declare.mechanics.element import DIRECTION, NOT_NEGATIVE, POSITIVE, Bind, Law, bound, number_faults
from symmb.declare.mechanics.force import Action, PairForce, push
from symmb.declare.symbolic import Kind, Symbol, ddt, declare, unit, vector


class FrictionLaw(Law):
    """A law of friction."""

    expected: ClassVar[str] = "a friction law, got {}. Use Coulomb(...) or Bristle(...)."

    kinetic: Expr
    static: Expr | None

    def __post_init__(self) -> None:
        super().__post_init__()
        if is_real(self.kinetic):
            for fault in number_faults(type(self).__name__, "static", self.static, least=self.kinetic):
                raise DeclarationError(fault)

    @abstractmethod
    def resistance(self, name: str, slip: ca.SX, normal_force: ca.SX) -> tuple[ca.SX, tuple[Symbol, ...]]:
        """Friction force (k,) [N] for the slip velocity (k,) [m/s], k = 1, 2 or 3, and the records of its states."""


@dataclass(frozen=True, eq=False)
class Coulomb(FrictionLaw):
    """Coulomb friction, smooth in the slip: mu(v) = mu_k tanh(4 u) + (mu_s - mu_k) u / (u^2 / 4 + 3 / 4)^2.

    In this formula, u is the slip speed divided by `speed`. At u = 1, mu is about mu_s. At lower speeds the force is
    about proportional to the slip. So a force f below the limit causes a creep of about `speed` f / (4 mu_k N). Use
    `Bristle` if bodies stick.

    Parameters
    ----------
    kinetic : Expr
        coefficient of friction mu_k of sliding [-]
    speed : Expr
        speed of the transition [m/s]. Smaller speeds are closer to Coulomb's law, and make equations stiffer
    static : Expr
        coefficient of friction mu_s before sliding [-]; by default mu_k

    Examples
    --------
    >>> import symmb as mb
    >>> block, law = mb.Body("block", 1.0, pose=mb.Particle()), mb.Coulomb(0.2, speed=0.01)
    >>> rub = mb.Friction("rub", mb.Ground().point(0, 0), block.point(0, 0), (1, 0, 0), 10.0, law)
    >>> mb.simulate(mb.Scene(mb.System(block, rub), {"block.vx": 3.0}, [0.0, 1.0]))["block.vx"].round(3)
    array([3., 1.])

    References
    ----------
    Brown, McPhee (2016), A continuous velocity-based friction model for dynamics and control with physically
    meaningful parameters, J. Comput. Nonlinear Dyn. 11.
    """

    kinetic: Expr = field(metadata=POSITIVE)
    speed: Expr = field(metadata=POSITIVE)
    static: Expr | None = None

    def resistance(self, name: str, slip: ca.SX, normal_force: ca.SX) -> tuple[ca.SX, tuple[Symbol, ...]]:
        w = slip / self.speed
        # The root keeps the direction of the slip and its derivatives finite at rest. It only affects slip speeds near
        # 1e-4 of the transition speed, and reduces the slope of mu at rest by 5e-8.
        size = ca.sqrt(ca.sumsqr(w) + 1e-4**2)
        mu_over_u = self.kinetic * ca.tanh(4 * size) / size
        if self.static is not None:
            mu_over_u += (self.static - self.kinetic) / (0.25 * size**2 + 0.75) ** 2
        return -normal_force * mu_over_u * w, ()


@dataclass(frozen=True, eq=False)
class Bristle(FrictionLaw):
    """Friction by elastic bristles that bend with the slip until they break away: F = N (k z + d(z')).

    The deflection z of a bristle is a first-order state called `name.bristle`. Up to 0.7 z_s, z follows the slip. The
    largest deflection is z_s = mu(v) / k, with mu(v) = mu_k + (mu_s - mu_k) exp(-(v / speed)^2). Above 0.7 z_s the
    bristle yields, and in steady sliding z is z_s. Forces below 0.7 of the breakaway force cause no creep, even if they
    vibrate. The damping term d is c z' at small rates, and at most mu. Without this limit, damping would stop a fast
    body at once.

    Parameters
    ----------
    kinetic : Expr
        coefficient of friction mu_k of sliding [-]
    stiffness : Expr
        stiffness k of the bristles per newton of normal force [1/m]
    damping : Expr
        damping c of the bristles per newton of normal force [s/m]; it makes elastic vibrations decay
    static : Expr
        coefficient of friction mu_s at breakaway [-]; by default mu_k
    speed : Expr
        Stribeck speed of the transition from mu_s to mu_k [m/s]

    Examples
    --------
    >>> import symmb as mb
    >>> block, law = mb.Body("block", 1.0, pose=mb.Particle()), mb.Bristle(0.2, 1e3)
    >>> rub = mb.Friction("rub", mb.Ground().point(0, 0), block.point(0, 0), (1, 0, 0), 10.0, law)
    >>> mb.simulate(mb.Scene(mb.System(block, rub), {"block.vx": 3.0}, [0.0, 0.1]))["block.vx"].round(3)
    array([3. , 2.8])

    References
    ----------
    Dupont, Hayward, Armstrong, Altpeter (2002), Single state elastoplastic friction models, IEEE Trans. Automat.
    Control 47.
    """

    kinetic: Expr = field(metadata=POSITIVE)
    stiffness: Expr = field(metadata=POSITIVE)
    damping: Expr = field(default=0.0, metadata=NOT_NEGATIVE)
    static: Expr | None = None
    speed: Expr = field(default=1e-3, metadata=POSITIVE)

    def resistance(self, name: str, slip: ca.SX, normal_force: ca.SX) -> tuple[ca.SX, tuple[Symbol, ...]]:
        n = slip.numel()
        names = [f"{name}.bristle"] if n == 1 else [f"{name}.bristle_{i + 1}" for i in range(n)]
        z = ca.vertcat(*[ca.SX.sym(name) for name in names])
        mu = self.kinetic
        if self.static is not None:
            mu = mu + (self.static - self.kinetic) * ca.exp(-ca.sumsqr(slip / self.speed))
        zeta = z * self.stiffness / mu
        bent = ca.sumsqr(zeta)
        along = ca.dot(slip, zeta)
        s = (bent - _ELASTIC) / (1 - _ELASTIC)
        # A polynomial of degree 5, whose first two derivatives are 0 at both ends, lets solvers keep large steps.
        blend = s**3 * (10 + s * (6 * s - 15))
        yielding = ca.if_else(bent < 1, blend, 1) * along
        # Bristles do not yield while their deflection decreases.
        rate = slip - ca.if_else(ca.logic_and(bent > _ELASTIC, along > 0), yielding, 0) * zeta
        records = declare(names, Kind.STATE, z, rate, ca.SX.zeros(n))
        damping = self.damping * rate
        # The damping term approaches mu without a kink.
        damping = damping / ca.sqrt(1 + ca.sumsqr(damping / mu))
        return -normal_force * (self.stiffness * z + damping), records


_ELASTIC = 0.7**2
"""Largest elastic deflection divided by the largest deflection, squared. The elasto-plastic model of Dupont et al.
(2002) has such a limit."""


@dataclass(frozen=True, eq=False)
class Friction(PairForce):
    """Friction between two bodies that slide along an axis, as in a `Prismatic` guide or on a table.

    Parameters
    ----------
    name : str
    point_a, point_b : Point
    axis : tuple
        direction of sliding, in the axes of point_a's body
    normal_force : Expr
        normal force between the bodies, not negative [N]
    law : FrictionLaw
        `Coulomb(...)` or `Bristle(...)`

    Examples
    --------
    >>> import symmb as mb
    >>> ground, block = mb.Ground(), mb.Body("block", 1.0, 0.1, mb.Planar())
    >>> slide = mb.Prismatic("slide", ground.point(0, 0), block.point(0, 0), axis=(1, 0, 0))
    >>> law = mb.Coulomb(0.2, 0.01)
    >>> rub = mb.Friction("rub", ground.point(0, 0), block.point(0, 0), (1, 0, 0), 10.0, law)
    >>> scene = mb.Scene(mb.System(block, slide, rub), {"block.vx": 3.0}, [0.0, 1.0])
    >>> run = mb.simulate(scene, mb.CVODES())
    >>> run["block.vx"].round(3)
    array([3., 1.])
    """

    axis: tuple[Expr, ...] = field(metadata=DIRECTION)
    normal_force: Expr = field(metadata=NOT_NEGATIVE)
    law: FrictionLaw

    def doubtful(self, bind: Bind) -> Iterator[tuple[ca.SX, str]]:
        normal_force = self.number(bind, "normal_force")
        if not normal_force.is_constant():
            yield (
                normal_force + SLIGHT,  # [N]: a little below 0 is rounding
                "the normal force is negative{}, so friction would accelerate the bodies. Use casadi.fmax(..., 0).",
            )

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        a = self.point_a.body
        axis = unit(vector(self.axis))
        normal_force = self.number(bind, "normal_force")
        slip = ddt(ca.dot(axis, a.frame.R.T @ (self.point_b.r - self.point_a.r)))
        law = bound(self.law, bind, self.title)
        force, states = law.resistance(self.name, slip, normal_force)
        yield Action(push(self.point_b, a, force * (a.frame.R @ axis)), states=states)
