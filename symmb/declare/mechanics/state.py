"""First-order states that users declare: filters, integrals, hydraulics, heat."""

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics.element import Element, law_value
from symmb.declare.symbolic import Kind, Symbol, declare, scalar


@dataclass(frozen=True, eq=False)
class OwnState(Element):
    """An element with first-order states. The first state is its value."""

    name: str
    symbols: tuple[Symbol, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DeclarationError(f"{type(self).__name__}: the name must be a text, got {shown(self.name)}.")

    @property
    def value(self) -> ca.SX:
        """The value in expressions."""
        return self.symbols[0].sx


@dataclass(frozen=True, eq=False)
class State(OwnState):
    """A first-order state z with z' = rate. It is an element of the System. Laws and outputs use its `value`.

    The state starts at 0, or at the value in `Scene(start={"z": 0.5})`.

    Parameters
    ----------
    name : str
        without dots
    rate : callable
        function of the value z, SX, that returns z' as an expression of z, coordinates, velocities, other states,
        parameters and `t`. The function is called once. `rate` may also be an expression without z

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=1.0, pose=mb.Particle())
    >>> slow = State("slow", rate=lambda z: (cart.x - z) / 0.5)
    >>> scene = mb.Scene(mb.System(cart, slow), {"cart.x": 1.0, "slow": 2.0}, [0.0, 0.5], {"slow": slow.value})
    >>> float(mb.simulate(scene)["slow"][-1].round(6))
    1.367879
    """

    rate: Callable[[ca.SX], Expr] | Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        value = ca.SX.sym(self.name)
        title = f"{self.title}: rate"
        rate = scalar(law_value(self.rate, title, value) if callable(self.rate) else self.rate, title)
        object.__setattr__(self, "rate", rate)
        object.__setattr__(self, "symbols", declare([self.name], Kind.STATE, value, rate, ca.SX(0), self.title))
