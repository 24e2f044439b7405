"""Sampled values that are held between instants, such as the outputs of digital controllers."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca

from symmb._options import is_real, shown
from symmb._types import Expr
from symmb.declare.mechanics.element import law_value
from symmb.declare.mechanics.state import OwnState
from symmb.declare.symbolic import Kind, declare


@dataclass(frozen=True, eq=False)
class Sampled(OwnState):
    """A value that is computed at sampling instants and held between them (zero-order hold).

    Sampling instants are the start of the scene's times and every `period` after it. Steps of solvers end at these
    instants. Values are computed in the order of declaration, so a law sees the new values of elements that are
    declared before it. At an instant, outputs have the new value.

    Parameters
    ----------
    name : str
        without dots
    period : float
        a number [s]
    law : Expr
        expression of coordinates, velocities, states, parameters and `t`; or a function of the held value, SX, that
        returns such an expression and is called once. The held value is 0 before the start, or the value in
        `Scene(start=...)`

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=1.0, pose=mb.Particle())
    >>> brake = Sampled("brake", period=0.5, law=-cart.vx)
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
