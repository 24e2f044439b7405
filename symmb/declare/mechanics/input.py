"""Values that other programs set during a run."""

from dataclasses import dataclass, field

import casadi as ca

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb.declare.mechanics.element import Element
from symmb.declare.symbolic import Kind, Symbol, declare


@dataclass(frozen=True, eq=False)
class Input(Element):
    """A value that another program sets during a run. It is an element of the System. Laws use its `value`.

    The value is 0 in runs of symmb. It is an input of FMUs that `save_fmu` writes, and `linearize(inputs=...)` accepts
    its name.

    Parameters
    ----------
    name : str
        without dots

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=2.0, pose=mb.Particle())
    >>> u = mb.Input("u")
    >>> system = mb.System(cart, u, mb.Force("motor", cart.point(0, 0), (8 * u.value - cart.vx, 0)))
    >>> mb.linearize(mb.Scene(system), inputs=["u"], outputs=["cart.vx"]).B.ravel()
    array([0., 4.])
    """

    name: str
    symbol: Symbol = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DeclarationError(f"Input: the name must be a text, got {shown(self.name)}.")
        (symbol,) = declare([self.name], Kind.PARAMETER, ca.SX.sym(self.name), owner=self.title)
        object.__setattr__(self, "symbol", symbol)

    @property
    def value(self) -> ca.SX:
        """The value in expressions."""
        return self.symbol.sx
