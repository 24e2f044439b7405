"""Equations with switches of the state and of time. In each phase, all switches are on fixed sides.

The equations of a phase are also smooth beyond its switches. They are the equations of the scene as long as a proof
shows that all switches are on these sides.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import Entry, Pieces, applied, called, common, interpret


@dataclass(frozen=True, eq=False)
class Phase:
    """Equations on sides of their switches.

    Attributes
    ----------
    rates : (x, p, t, sides) -> x'
    outputs : (x, p, t, sides) -> y
    switches : (x, p, t, sides) -> (m,); a switch may depend on the sides of others
    sides : (m,) 1 if a switch is above 0, -1 if it is below
    labels : texts of the switches, for messages
    names : text of the kinks and jumps, for messages
    begin : the first time [s], for messages
    """

    rates: ca.Function
    outputs: ca.Function
    switches: ca.Function
    sides: Array
    labels: tuple[str, ...]
    names: str
    begin: float

    def on(self, f: ca.Function, sides: Array, *place: Array | float) -> ca.Function:
        """One of these Functions on other sides, as (x, p, t) -> value. It is valid near one place x, p, t.

        Tables are fixed to their pieces at this place, so that the Function is smooth beyond their knots. The
        conditions of the phase show whether these are the right pieces.
        """
        arguments = self.rates.sx_in()[:3]
        found = common(f.name(), arguments, [ca.densify(f(*arguments, sides))])
        return _frozen(found, *place) if called(found) else found

    def conditions(self, sides: Array, *place: Array | float) -> ca.Function:
        """(x, p, t) -> (m,) values. All are positive as long as the equations on these sides are those of the scene."""
        switches = self.on(self.switches, sides, *place)
        arguments = switches.sx_in()
        return common("conditions", arguments, [ca.densify(sides * switches(*arguments))])

    def settled(self, x: Array, p: Array, t: float, sides: Array, fixed: tuple[int, ...] = ()) -> Array:
        """Sides (m,) at one place. Those of the switches `fixed` are given. A switch may depend on earlier sides."""
        sides = sides.copy()
        others = np.setdiff1d(np.arange(len(sides)), fixed)
        for _ in range(len(sides)):
            values = self.switches(x, p, t, sides).full().ravel()
            sides[others] = np.where(values[others] >= 0, 1.0, -1.0)
        return sides

    def steep(self, which: int) -> str:
        """The message that derivatives may be infinite at a switch."""
        return (
            f"'{self.labels[which]}' comes to 0. A law may have infinite derivatives there, such as w*abs(w)**0.5. "
            "Make the law smooth: use sqrt(w**2 + small**2) instead of abs(w)"
        )

    def sentence(self, which: int, time: float, reason: str) -> str:
        """Why a proof ends before a switch at a time after the first one [s]. The reason is a sentence."""
        at = self.begin + time + 0.0  # not -0
        own = f"It cannot be proved that all parameters of the box pass '{self.labels[which]}' once: {reason}"
        return f"the equations have {self.names} at t = {at:.6g} s. {own}"


def label(switch: ca.SX) -> str:
    """The text of a switch in messages, with at most 60 letters."""
    text = str(switch)
    return text if len(text) <= 60 else f"{text[:60]}..."


def _frozen(f: ca.Function, *place: Array | float) -> ca.Function:
    """A Function in which tables are fixed to their pieces at one place x, p, t."""
    symbols = f.sx_in()
    inputs = [
        list(zip(ca.vertsplit(own), map(ca.SX, np.atleast_1d(values).tolist()), strict=True))
        for own, values in zip(symbols, place, strict=True)
    ]

    def operation(code: object, arguments: tuple[tuple[ca.SX, ca.SX], ...]) -> tuple[ca.SX, ca.SX]:
        if isinstance(code, Entry) and type(code.pieces) is not Pieces:  # subclasses have switches of their own
            number = ca.SX(code.between(*(float(number) for _, number in arguments))[0])
            return number, number
        of, numbers = zip(*arguments, strict=True)
        return applied(code, *of), applied(code, *numbers)

    found = interpret(f, inputs, operation, lambda number: (ca.SX(number), ca.SX(number)))
    return common(f.name(), symbols, [ca.densify(ca.vertcat(*(value for value, _ in part))) for part in found])
