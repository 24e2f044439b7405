"""Equations with switches of the state and of time: in each phase they are on fixed sides of all of them.

The equations of a phase are smooth beyond its switches as well. They are those of the scene as long as all switches
are proved to be on these sides.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import Entry, Pieces, applied, called, common, interpret

_LETTERS_OF_A_SWITCH = 60
"""Letters of a switch in a sentence."""


@dataclass(frozen=True, eq=False)
class Phase:
    """Equations on sides of their switches.

    Attributes
    ----------
    rates : (x, p, t, sides) -> x'
    outputs : (x, p, t, sides) -> y
    switches : (x, p, t, sides) -> (m,); a switch may depend on the sides of others
    sides : (m,) 1 where a switch is above 0, -1 where it is below
    labels : the switches, for sentences
    names : of the kinks and jumps, for sentences
    begin : the first time [s], for sentences
    """

    rates: ca.Function
    outputs: ca.Function
    switches: ca.Function
    sides: Array
    labels: tuple[str, ...]
    names: str
    begin: float

    def on(self, f: ca.Function, sides: Array, *place: Array | float) -> ca.Function:
        """A Function of these on other sides: (x, p, t) -> ., which holds about one place x, p, t.

        Numbers of parts of tables are those at the place: all is then smooth beyond their knots. The switches, above 0
        on their sides, tell that they are the true ones.
        """
        arguments = self.symbols
        found = common(f.name(), [*arguments], [ca.densify(f(*arguments, sides))])
        return _frozen(found, *place) if called(found) else found

    @property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """New symbols x, p and t."""
        x, p, t = (ca.SX.sym(name, self.rates.numel_in(i)) for i, name in enumerate("xpt"))
        return x, p, t

    def conditions(self, sides: Array, *place: Array | float) -> ca.Function:
        """(x, p, t) -> (m,), all above 0 as long as the equations on some sides are those of the scene."""
        arguments = self.symbols
        values = sides * self.on(self.switches, sides, *place)(*arguments)
        return common("conditions", [*arguments], [ca.densify(values)])

    def settled(self, x: Array, p: Array, t: float, sides: Array, fixed: tuple[int, ...] = ()) -> Array:
        """Sides (m,) at one place, of which some are given. A switch may depend on the sides of those before it."""
        sides = sides.copy()
        others = np.setdiff1d(np.arange(len(sides)), fixed)
        for _ in range(len(sides)):
            values = self.switches(x, p, t, sides).full().ravel()
            sides[others] = np.where(values[others] >= 0, 1.0, -1.0)
        return sides

    def names_any(self, text: str) -> bool:
        """Whether a text tells of one of the switches."""
        return any(f"'{own}'" in text for own in self.labels)

    def steep(self, which: int) -> str:
        """The end of a sentence: that derivatives may be infinite at a switch."""
        return (
            f"'{self.labels[which]}' comes to 0, where a law may have infinite derivatives, such as w*abs(w)**0.5. "
            "Round it, as by sqrt(w**2 + small**2) for abs(w)"
        )

    def sentence(self, which: int, time: float, reason: str) -> str:
        """Why a proof ends before a switch at a time from the first one on [s], with a reason that is a sentence."""
        at = self.begin + time + 0.0  # not -0
        own = f"'{self.labels[which]}' is not shown to be passed once by all of the box: {reason}"
        return f"the equations have {self.names} at t = {at:.6g} s, where {own}"


def label(switch: ca.SX) -> str:
    """The text of a switch."""
    text = str(switch)
    return text if len(text) <= _LETTERS_OF_A_SWITCH else f"{text[:_LETTERS_OF_A_SWITCH]}..."


def _frozen(f: ca.Function, *place: Array | float) -> ca.Function:
    """A Function in which numbers of parts of tables are those at one place."""
    symbols = f.sx_in()
    inputs = [
        list(zip(ca.vertsplit(own), map(ca.SX, np.atleast_1d(values).tolist()), strict=True))
        for own, values in zip(symbols, place, strict=True)
    ]

    def operation(code: object, arguments: tuple[tuple[ca.SX, ca.SX], ...]) -> tuple[ca.SX, ca.SX]:
        if isinstance(code, Entry) and type(code.pieces) is not Pieces:  # these have switches
            number = ca.SX(code.between(*(float(number) for _, number in arguments))[0])
            return number, number
        of, numbers = zip(*arguments, strict=True)
        return applied(code, *of), applied(code, *numbers)

    found = interpret(f, inputs, operation, lambda number: (ca.SX(number), ca.SX(number)))
    return common(f.name(), symbols, [ca.densify(ca.vertcat(*(value for value, _ in part))) for part in found])
