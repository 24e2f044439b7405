"""Laws of normal contact: forces as functions of penetration and its rate. The forces never pull.

Without contact, roots and powers are evaluated at a positive argument, and their values are not used. So all
derivatives are finite, and 0 without contact.
"""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from symmb._magnitudes import MEETING
from symmb._options import require_instance
from symmb._types import Expr
from symmb.declare.mechanics.element import NOT_NEGATIVE, POSITIVE, Law, within
from symmb.declare.mechanics.table import Table
from symmb.declare.symbolic import is_zero, scalar


class ContactLaw(Law):
    """The force that pushes two surfaces apart."""

    expected: ClassVar[str] = (
        "a contact law, got {}. "
        "Use HuntCrossley(...), LankaraniNikravesh(...), Flores(...), KelvinVoigt(...) or Tabulated(...)."
    )

    @abstractmethod
    def force(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        """Force [N] from the penetration [m] and its rate [m/s]: never negative, and 0 without contact."""

    def potential(self, penetration: ca.SX) -> ca.SX | None:
        """Stored energy [J]; None if the law has losses."""
        return None

    @property
    def stores(self) -> ca.SX:
        """Expressions in the stored energy other than the penetration. Energy is conserved if these are constant."""
        return ca.SX(0, 1)


def _expressions(law: ContactLaw, penetration: object, rate: object) -> tuple[ca.SX, ca.SX]:
    """Penetration and rate as SX. Users may call laws with numbers."""
    owner = type(law).__name__
    return scalar(penetration, f"{owner}: penetration"), scalar(rate, f"{owner}: rate")


def _power(base: ca.SX, exponent: Expr) -> ca.SX:
    """A power of a positive number. A root computes the exponent 3/2 of Hertz much faster."""
    if not ca.SX(exponent).is_constant():
        return base**exponent
    return base * ca.sqrt(base) if float(exponent) == 1.5 else base ** float(exponent)


@dataclass(frozen=True, eq=False)
class _Hertzian(ContactLaw):
    """F = k d^n (1 + chi d') with the penetration d. Subclasses define chi."""

    stiffness: Expr = field(metadata=POSITIVE)
    restitution: Expr = field(metadata=within(above=0.0, most=1.0))
    speed: Expr = field(metadata=POSITIVE)
    exponent: Expr = field(default=1.5, metadata=within(least=1.0))

    @property
    @abstractmethod
    def chi(self) -> Expr:
        """The ratio of damping to stiffness [s/m]."""

    def force(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        penetration, rate = _expressions(self, penetration, rate)
        touching = penetration > MEETING
        loss = ca.if_else(touching, 1 + self.chi * rate, 1)  # without contact, the sign of the loss causes no kink
        d = ca.if_else(touching, penetration, 1)
        pushing = touching if is_zero(ca.SX(self.chi)) else ca.logic_and(touching, loss > 0)
        return ca.if_else(pushing, self.stiffness * _power(d, self.exponent) * loss, 0)

    def potential(self, penetration: ca.SX) -> ca.SX | None:
        if not is_zero(ca.SX(self.chi)):
            return None
        d = ca.if_else(penetration > MEETING, penetration, 1)
        energy = self.stiffness * d * _power(d, self.exponent) / (self.exponent + 1)
        return ca.if_else(penetration > MEETING, energy, 0)

    @property
    def stores(self) -> ca.SX:
        return ca.vertcat(self.stiffness, self.exponent)


@dataclass(frozen=True, eq=False)
class HuntCrossley(_Hertzian):
    """Law for restitutions e near 1: F = k d^n (1 + chi d') for a penetration d, with chi = 3 (1 - e) / (2 v).

    Parameters
    ----------
    stiffness : Expr
        stiffness k [N/m^n]
    restitution : Expr
        coefficient of restitution e, above 0 and at most 1 [-]; with 1 there are no losses
    speed : Expr
        speed of approach v at the start of the contact [m/s]
    exponent : Expr
        exponent n, by default 3/2 as in Hertz's law [-]

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.HuntCrossley(1e5, restitution=0.9, speed=1.0)
    >>> [law.force(1e-3, rate) for rate in (0.5, -0.5)]
    [SX(3.39945), SX(2.92511)]

    References
    ----------
    Hunt, Crossley (1975), Coefficient of restitution interpreted as damping in vibroimpact, J. Appl. Mech. 42.
    """

    @property
    def chi(self) -> Expr:
        return 1.5 * (1 - self.restitution) / self.speed


@dataclass(frozen=True, eq=False)
class LankaraniNikravesh(_Hertzian):
    """Law for restitutions e near 1: F = k d^n (1 + chi d') for a penetration d, with chi = 3 (1 - e^2) / (4 v).

    Parameters
    ----------
    stiffness, restitution, speed, exponent : Expr
        k, e, v and n as for `HuntCrossley`

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.LankaraniNikravesh(1e5, restitution=0.9, speed=1.0)
    >>> [law.force(1e-3, rate) for rate in (0.5, -0.5)]
    [SX(3.38759), SX(2.93697)]

    References
    ----------
    Lankarani, Nikravesh (1990), A contact force model with hysteresis damping for impact analysis of multibody systems,
    J. Mech. Des. 112.
    """

    @property
    def chi(self) -> Expr:
        return 0.75 * (1 - self.restitution**2) / self.speed


@dataclass(frozen=True, eq=False)
class Flores(_Hertzian):
    """Law for any restitution e and soft bodies: F = k d^n (1 + chi d') for a penetration d, chi = 8 (1 - e) / (5 e v).

    Parameters
    ----------
    stiffness, restitution, speed, exponent : Expr
        k, e, v and n as for `HuntCrossley`

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.Flores(1e5, restitution=0.5, speed=1.0)
    >>> [law.force(1e-3, rate) for rate in (0.5, -0.5)]
    [SX(5.6921), SX(0.632456)]

    References
    ----------
    Flores, Machado, Silva, Martins (2011), On the continuous contact force models for soft materials in multibody
    dynamics, Multibody Syst. Dyn. 25.
    """

    @property
    def chi(self) -> Expr:
        return 1.6 * (1 - self.restitution) / (self.restitution * self.speed)


@dataclass(frozen=True, eq=False)
class KelvinVoigt(ContactLaw):
    """F = k d + c d' for a penetration d: a spring and a damper in parallel.

    With damping the force jumps at the start of the contact, and becomes 0 before the surfaces separate.

    Parameters
    ----------
    stiffness : Expr
        stiffness k [N/m]
    damping : Expr
        damping c [N s/m]

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.KelvinVoigt(1e4, damping=20.0)
    >>> [law.force(1e-3, rate) for rate in (0.5, -0.5)]
    [SX(20), SX(0)]
    """

    stiffness: Expr = field(metadata=POSITIVE)
    damping: Expr = field(default=0.0, metadata=NOT_NEGATIVE)

    def force(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        penetration, rate = _expressions(self, penetration, rate)
        return _pushing(penetration, self.stiffness * penetration + self.damping * rate)

    def potential(self, penetration: ca.SX) -> ca.SX | None:
        if not is_zero(ca.SX(self.damping)):
            return None
        return ca.if_else(penetration > 0, 0.5 * self.stiffness * penetration**2, 0)

    @property
    def stores(self) -> ca.SX:
        return ca.SX(self.stiffness)


@dataclass(frozen=True, eq=False)
class Tabulated(ContactLaw):
    """A table of forces over the penetration, with a damper in parallel. The total force is never negative.

    Parameters
    ----------
    table : Table
        table of forces [N] for penetrations [m]
    damping : Expr
        damping c of the parallel damper [N s/m]

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.Tabulated(mb.Table([0, 0.01, 0.02], [0, 100, 400]), damping=5.0)
    >>> law.force(0.01, 2.0)
    SX(110)
    """

    table: Table
    damping: Expr = field(default=0.0, metadata=NOT_NEGATIVE)

    def __post_init__(self) -> None:
        require_instance("Tabulated: table", self.table, Table, "a Table of forces over penetrations")
        super().__post_init__()

    def force(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        penetration, rate = _expressions(self, penetration, rate)
        return _pushing(penetration, self.table(penetration) + self.damping * rate)


def _pushing(penetration: ca.SX, force: ca.SX) -> ca.SX:
    """The force if it is positive and the surfaces touch, else 0."""
    force = ca.if_else(penetration > 0, force, 0)  # without contact, the sign of the force causes no kink
    return ca.if_else(force > 0, force, 0)
