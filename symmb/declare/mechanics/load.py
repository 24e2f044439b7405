"""Forces of machines: nonlinear springs, hydraulic dampers, gas springs and soil."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import casadi as ca

from symmb._magnitudes import MEETING
from symmb._types import Expr
from symmb.declare.mechanics.body import Body, Point
from symmb.declare.mechanics.contact import press
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.element import DIRECTION, NOT_NEGATIVE, POSITIVE, Bind, Law, bound, function, law_value
from symmb.declare.mechanics.force import Action, ForceElement, PairForce, mount, mount_matrices, push
from symmb.declare.symbolic import ddt, scalar, unit, vector


@dataclass(frozen=True, eq=False)
class NonlinearSpring(PairForce):
    """A force along the line between two points as a function of their distance and its rate.

    Parameters
    ----------
    name : str
    point_a, point_b : Point
    pull : callable
        function of the distance [m] and its rate [m/s] (SX) that returns the force [N] that pulls the points together.
        Examples are `GasSpring(...)`, `Orifice(...)`, or a sum: `lambda d, v: gas(d, v) + oil(d, v)`

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.NonlinearSpring("spring", mb.Ground().point(0, 0), bob.point(0, 0), lambda d, v: 3 * d**3 + v)
    >>> scene = mb.Scene(mb.System(bob, spring), {"bob.x": 1.0}, [0.0, 1.0])
    >>> mb.simulate(scene, mb.CVODES())["bob.x"].round(4)
    array([1.    , 0.3262])
    """

    pull: Callable[[ca.SX, ca.SX], Expr] = field(metadata=function("length and rate: lambda d, v: ..."))

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        d = self.point_b.r - self.point_a.r
        # Points closer than MEETING do not determine a line. There the force decreases to 0, and stays finite.
        length = ca.sqrt(ca.fmax(ca.sumsqr(d), MEETING**2))
        title = f"{self.title}: pull"
        law = bound(self.pull, bind, title) if isinstance(self.pull, GasSpring | Orifice) else self.pull
        pull = bind(law_value(law, title, length, ca.dot(d, ddt(d)) / length), title)
        yield Action(self.pair_loads(pull * d / length), force=pull)


@dataclass(frozen=True, eq=False)
class GasSpring(Law):
    """Gas in a cylinder that pushes two points apart: a law for a `NonlinearSpring`. The product p V^n is constant.

    If the volume V of the gas is below `volume` / 100, the pressure p is constant.

    Parameters
    ----------
    pressure : Expr
        pressure at `length` [Pa]; the ambient pressure is neglected
    volume : Expr
        volume at `length` [m^3]
    area : Expr
        area of the piston [m^2]; negative if the gas is compressed when the distance grows, as in a recuperator
    length : Expr
        distance of the points [m] at the given pressure and volume
    exponent : Expr
        polytropic exponent n: 1 for slow and 1.4 for fast changes of air [-]

    Examples
    --------
    >>> import symmb as mb
    >>> gas = mb.GasSpring(pressure=5e5, volume=1e-3, area=0.01, length=0.5)
    >>> gas(0.5, 0.0)
    SX(-5000)
    """

    pressure: Expr = field(metadata=NOT_NEGATIVE)
    volume: Expr = field(metadata=POSITIVE)
    area: Expr
    length: Expr
    exponent: Expr = field(default=1.4, metadata=POSITIVE)

    def __call__(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        """The force [N] that pulls the points together, for a length [m] and its rate [m/s]."""
        law = bound(self, scalar, "GasSpring")
        share = 1 + law.area * (scalar(length, "GasSpring: length") - law.length) / law.volume
        return (
            -law.pressure * law.area * ca.if_else(share > _SMALLEST_VOLUME, share, _SMALLEST_VOLUME) ** (-law.exponent)
        )


_SMALLEST_VOLUME = 0.01
"""Smallest gas volume, divided by the given volume. This limit keeps the pressure finite for all motions."""


@dataclass(frozen=True, eq=False)
class Orifice(Law):
    """Fluid that a piston pushes through an opening, as in recoil brakes: a law for a `NonlinearSpring`.

    The pressure loss of the flow A v through the opening gives the force F = rho A^3 / (2 (Cd a)^2) v |v|. In this
    formula v sqrt(v^2 + speed^2) replaces v |v|, so that the force is smooth, and the flow at low speeds is laminar.

    Parameters
    ----------
    area : Expr
        area A of the piston [m^2]
    opening : Expr
        positive area a of the opening [m^2], or a function of the stroke [m] and its rate [m/s] (SX) that returns the
        area. For a throttling ring with the areas in a `Table`, use `lambda stroke, rate: table(stroke)`
    length : Expr
        distance of the points at stroke 0 [m]
    density : Expr
        density rho of the fluid [kg/m^3]
    discharge : Expr
        coefficient of discharge Cd [-]
    speed : Expr
        speed below which the flow is laminar [m/s]

    Examples
    --------
    >>> import symmb as mb
    >>> oil = mb.Orifice(area=0.01, opening=1e-4)
    >>> oil(0.1, 0.5)
    SX(22193.9)
    """

    area: Expr
    opening: Expr | Callable[[ca.SX, ca.SX], Expr] = field(metadata=POSITIVE)
    length: Expr = 0.0
    density: Expr = field(default=870.0, metadata=NOT_NEGATIVE)
    discharge: Expr = field(default=0.7, metadata=POSITIVE)
    speed: Expr = field(default=1e-3, metadata=NOT_NEGATIVE)

    def __call__(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        """The force [N] that pulls the points together, for a length [m] and its rate [m/s]."""
        law = bound(self, scalar, "Orifice")
        length, rate = scalar(length, "Orifice: length"), scalar(rate, "Orifice: rate")
        opening = law.opening(length - law.length, rate) if callable(law.opening) else law.opening
        loss = 0.5 * law.density * law.area**3 / (law.discharge * scalar(opening, "Orifice: opening")) ** 2
        return loss * rate * ca.sqrt(rate**2 + law.speed**2)


@dataclass(frozen=True, eq=False)
class Soil(ForceElement):
    """Soil under a foot. The soil pushes along the normal, and springs and dampers act in the other directions.

    The tangential springs also act without a normal force, because spades and ribs stay in the soil.

    Parameters
    ----------
    name : str
    ground_point : Point
        point of the soil's surface, on the ground or on another body
    point : Point
        point of the foot that touches the soil
    normal : tuple
        direction out of the soil, in the axes of ground_point's body
    law : ContactLaw
        law along the normal: `KelvinVoigt(...)`, or `Tabulated(...)` for measured forces
    stiffness, damping : scalar or (x, y, z)
        stiffness [N/m] and damping [N s/m] in the tangential directions
    rotational_stiffness, rotational_damping : scalar or (x, y, z)
        stiffness [N m/rad] and damping [N m s/rad] about the axes, see `Bushing`

    Examples
    --------
    >>> import symmb as mb
    >>> foot = mb.Body("foot", 2.0, 0.1, mb.Planar())
    >>> law = mb.KelvinVoigt(1e3, 1e2)
    >>> soil = mb.Soil("soil", mb.Ground().point(0, 0), foot.point(0, 0), (0, 1, 0), law, 500.0, 50.0, 10.0)
    >>> scene = mb.Scene(mb.System(foot, soil, mb.Gravity(0, -10.0)), guess={"foot.y": -0.01}, equilibrium=True)
    >>> mb.simulate(scene)["foot.y"].round(4)
    array([-0.02])
    """

    name: str
    ground_point: Point
    point: Point
    normal: tuple[Expr, ...] = field(metadata=DIRECTION)
    law: ContactLaw
    stiffness: Expr = 0.0
    damping: Expr = 0.0
    rotational_stiffness: Expr = 0.0
    rotational_damping: Expr = 0.0

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        a = self.ground_point.body
        normal = unit(vector(self.normal))
        penetration = -ca.dot(normal, a.frame.R.T @ (self.point.r - self.ground_point.r))
        law = bound(self.law, bind, self.title)
        fixed = (self.point.s, self.ground_point.s, normal)
        yield press(law, penetration, lambda force: push(self.point, a, force * (a.frame.R @ normal)), *fixed)
        across = ca.SX.eye(3) - normal @ normal.T
        K, C, *turning = mount_matrices(self, bind)
        K, C = (ca.sparsify(across @ matrix @ across) for matrix in (K, C))
        yield from mount(self.ground_point, self.point, K, C, *turning)
