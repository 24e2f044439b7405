"""States that users declare, sampled values, and inputs from other programs."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import casadi as ca

from symmb._errors import DeclarationError
from symmb._options import is_real, shown
from symmb._types import Expr
from symmb.declare.mechanics.element import Element, law_value
from symmb.declare.symbolic import Kind, Symbol, declare, scalar


@dataclass(frozen=True, eq=False)
class OwnState(Element):
    """An element with first-order states. The first state is the value of the element."""

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
    """A first-order state z with z' = rate. A State is an element of the System. Laws and outputs use its `value`.

    The state starts at 0, or at the value in `Scene(start={"z": 0.5})`.

    Parameters
    ----------
    name : str
        without dots
    rate : callable
        function of the value z (SX) that returns z' as an expression of z, coordinates, velocities, other states,
        parameters and `t`. The function is called once. `rate` may also be an expression without z

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=1.0, pose=mb.Particle())
    >>> slow = mb.State("slow", rate=lambda z: (cart.x - z) / 0.5)
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


@dataclass(frozen=True, eq=False)
class Sampled(OwnState):
    """A value that is computed at sampling instants and held between them (zero-order hold).

    The first sampling instant is the start of the scene's times. The next instants follow at intervals of `period`.
    Steps of solvers end at these instants. Values are computed in the order of declaration, so a law uses the new
    values of elements that are declared before it. At a sampling instant, outputs have the new value.

    Parameters
    ----------
    name : str
        without dots
    period : float
        time between two sampling instants [s], without parameters
    law : Expr
        expression of coordinates, velocities, states, parameters and `t`; or a function of the held value (SX)
        that returns such an expression. The function is called once. Before the start, the held value is 0, or the
        value in `Scene(start=...)`

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=1.0, pose=mb.Particle())
    >>> brake = mb.Sampled("brake", period=0.5, law=-cart.vx)
    >>> push = mb.Force("push", cart.point(0, 0), (brake.value, 0))
    >>> scene = mb.Scene(mb.System(cart, brake, push), {"cart.vx": 8.0}, [0.0, 1.0], {"v": cart.vx})
    >>> float(mb.simulate(scene)["v"][-1].round(9))
    2.0
    """

    period: float
    law: Callable[[ca.SX], Expr] | Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        states = ca.vertcat(ca.SX.sym(self.name), ca.SX.sym(f"{self.name}.count"))
        names, zero = [self.name, f"{self.name}.count"], ca.SX.zeros(2, 1)
        object.__setattr__(self, "symbols", declare(names, Kind.STATE, states, zero, zero, self.title))
        if callable(self.law):
            object.__setattr__(self, "law", law_value(self.law, f"{self.title}: law", self.value))

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if not is_real(self.period):
            yield f"{self.title}: period {shown(self.period)} is not a number. Pass a number, without parameters."
        elif not 0 < self.period < math.inf:
            yield f"{self.title}: period {self.period!r} must be positive and finite."


@dataclass(frozen=True, eq=False)
class Input(Element):
    """A value that another program sets during a run. An Input is an element of the System. Laws use its `value`.

    The value is 0 in runs of symmb. FMUs that `save_fmu` writes have this input, and `linearize(inputs=...)` accepts
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
