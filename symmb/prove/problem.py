"""The initial value problem of a scene as expression graphs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import Entry, Pieces, applied, common, instructions, interpret
from symmb.prove.basis import Basis, basis_of, basis_with
from symmb.prove.rounding import U, above
from symmb.prove.tape import Tape


@dataclass(frozen=True, eq=False)
class Problem:
    """x' = f(x, p, t) with outputs y(x, p, t), for parameters p_i = middle_i + radius_i xi_j, xi in [-1, 1]^d.

    Attributes
    ----------
    rates : (x, p, t) -> x' (n_x,)
    outputs : (x, p, t) -> y (n_y,)
    start : the states at the first time
    middle, radius : (n_p,) middles and radii of all parameters
    variables : number of the variable xi_j of each parameter; -1 for fixed parameters
    times : (n_t,) output times [s]
    scales : (n_x,) sizes of the states
    errors : (n_p,) rounding errors of the middles, for a part of the box
    phase : the equations on all sides of their switches; None if there are no switches
    valid : (x, p, t) -> (m,), all positive as long as the rates are those of the scene; None: always
    regular : (x, p, t) -> (m,), all different from 0 if the rates are those of the scene; None: everywhere
    closing : names of the joints that close loops
    refused : unsupported operations of each output; the expression of such an output is nan
    meeting : sentence about a spring with points that may meet; empty if none is found
    change : change to other states; None if these states are used to the end
    weights : (d,) weights of the variables in the `Basis` of motions; empty if polynomials are tensors
    clock : the clock of the times of the outputs; None if they are the times of the rates
    """

    rates: ca.Function
    outputs: ca.Function
    middle: Array
    radius: Array
    variables: tuple[int, ...]
    times: Array
    scales: Array
    start: "StartEquations"
    errors: Array | float = 0.0
    phase: "Phase | None" = None
    valid: ca.Function | None = None
    regular: ca.Function | None = None
    closing: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    meeting: str = ""
    change: "Change | None" = None
    weights: tuple[int, ...] = ()
    clock: "Clock | None" = None

    def over(self, variable: int, side: int) -> "Problem":
        """The problem over the half of the box in which a variable is negative (side -1) or positive (side 1)."""
        mine = np.array(self.variables) == variable
        radius = np.where(mine, 0.5 * self.radius, self.radius)
        middle = np.where(mine, self.middle + side * radius, self.middle)
        errors = np.where(mine, above(self.errors + U * np.abs(middle)), self.errors)
        return self.with_fields(middle=middle, radius=radius, errors=errors)

    def with_fields(self, **fields: Any) -> "Problem":
        """The problem with the same equations and another box or change."""
        other = replace(self, **fields)
        other.__dict__.update({name: value for name, value in self.__dict__.items() if name in _GRAPHS})
        return other

    @property
    def n(self) -> int:
        """Number of states."""
        return self.rates.numel_in(0)

    @property
    def d(self) -> int:
        """Number of uncertain parameters."""
        return max(self.variables, default=-1) + 1

    @property
    def axes(self) -> int:
        """Number of axes of polynomials of the parameters."""
        return 1 if self.weights else self.d

    def reached(self, s: float) -> float:
        """The time that all parameters have reached at the time s of the rates."""
        return s if self.clock is None else s * self.clock.slowest

    def lengths(self, order: int) -> tuple[int, ...]:
        """Lengths of the axes of polynomials of the parameters of the highest degree `order`."""
        return (basis_of(self.weights, order).counts[-1],) if self.weights else (order + 1,) * self.d

    def basis(self, terms: int) -> Basis:
        """The basis with a number of terms."""
        return basis_with(self.weights, terms)

    @property
    def why_singular(self) -> str:
        """The message that rows of loops may not determine velocities. It names up to four joints that close loops."""
        names = ", ".join(map(repr, self.closing[:4])) + ", ..." * (len(self.closing) > 4)
        return f"{SINGULAR} (joints that close loops: {names})" if names else SINGULAR

    @cached_property
    def rate_tape(self) -> Tape:
        """(x, p, t) -> x'."""
        return Tape(self.rates)

    @cached_property
    def jacobian_tape(self) -> Tape:
        """(x, p, t) -> x', and its Jacobian (n, n) in column-major order."""
        return with_jacobian(self.rates)

    @cached_property
    def clock_tape(self) -> Tape | None:
        """(x, p, s) -> t / s."""
        return None if self.clock is None else Tape(self.clock.rate)

    @cached_property
    def output_tape(self) -> Tape:
        """(x, p, t) -> y."""
        return Tape(self.outputs)

    @cached_property
    def valid_tape(self) -> Tape | None:
        """(x, p, t) -> values that must be positive."""
        return None if self.valid is None else Tape(self.valid)

    def on_sides(self, sides: Array, *place: Array | float) -> "Problem":
        """The problem on given sides (m,) of its switches. It is valid near one place x, p, t."""
        phase = self.phase
        assert phase is not None
        return replace(
            self,
            phase=replace(phase, sides=sides),
            rates=phase.on(phase.rates, sides, *place),
            outputs=phase.on(phase.outputs, sides, *place),
            valid=phase.conditions(sides, *place),
        )

    @cached_property
    def regular_tape(self) -> Tape | None:
        """(x, p, t) -> values that must not be 0."""
        return None if self.regular is None else Tape(self.regular)

    def tape_of_outputs(self, which: tuple[int, ...]) -> Tape:
        """(x, p, t) -> the outputs with the indices `which`."""
        if which not in self._tapes:
            arguments = self.outputs.sx_in()
            y = ca.densify(self.outputs(*arguments))[list(which)]
            self._tapes[which] = Tape(common("some", arguments, [y]))
        return self._tapes[which]

    @cached_property
    def _tapes(self) -> dict[tuple[int, ...], Tape]:
        return {}

    @cached_property
    def sensitivity_tape(self) -> Tape:
        """(x, p, t) -> y, and its Jacobian (n_y, n) in column-major order."""
        return with_jacobian(self.outputs)


SINGULAR = "a loop may reach a singular position, such as a dead centre"


@dataclass(frozen=True, eq=False)
class Clock:
    """Times t = s tau(p) of the outputs, for the time s of the rates.

    Attributes
    ----------
    rate : (x, p, s) -> tau
    slowest, fastest : bounds of tau over the box
    """

    rate: ca.Function
    slowest: float
    fastest: float


@dataclass(frozen=True, eq=False)
class Change:
    """A change to other states at a time [s].

    Attributes
    ----------
    states : (x, p, t) -> the other states
    following : time, problem -> the problem of the other states from this time on, over the same box
    late : error of a prescribed time [s]; None if the change may be at any nearby time
    """

    time: float
    states: ca.Function
    following: Callable[[float, Problem], Problem]
    late: float | None = None


_GRAPHS = ("rate_tape", "jacobian_tape", "output_tape", "sensitivity_tape", "valid_tape", "regular_tape", "clock_tape",
           "_tapes")  # fmt: skip
"""Cached attributes that do not depend on the box."""


@dataclass(frozen=True, eq=False)
class StartEquations:
    """The start x of the states, a function of u and p. The unknowns u solve residual(u, p) = 0.

    Attributes
    ----------
    residual : (u, p, t) -> (n_u,)
    states : (u, p, t) -> x (n_x,)
    solve : P (N, n_p) -> approximate u (N, n_u)
    unproved : the message if no solution can be proved
    """

    residual: ca.Function
    states: ca.Function
    solve: Callable[[Array], Array]
    unproved: str = "the solution of the starting equations cannot be proved"


def with_jacobian(f: ca.Function) -> Tape:
    """The tape of f(x, p, t) and of its Jacobian by x."""
    arguments = f.sx_in()
    value = ca.densify(f(*arguments))
    jacobian = ca.densify(ca.jacobian(value, arguments[0]))
    return Tape(common("with_jacobian", arguments, [value, ca.vec(jacobian)]))


@dataclass(frozen=True, eq=False)
class Phase:
    """Equations on fixed sides of their switches. A switch depends on the state or on time.

    The equations are also smooth beyond the switches. They equal the equations of the scene as long as a proof shows
    that all switches are on these sides.

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
        """A Function of the phase on given sides, as (x, p, t) -> value. It is valid near one place x, p, t.

        Tables are fixed to their pieces at this place, so the Function is smooth beyond their knots. The conditions of
        the phase show whether these pieces are right.
        """
        arguments = self.rates.sx_in()[:3]
        found = common(f.name(), arguments, [ca.densify(f(*arguments, sides))])
        return _frozen(found, *place) if instructions(found).entries() else found

    def conditions(self, sides: Array, *place: Array | float) -> ca.Function:
        """(x, p, t) -> (m,) values. All are positive as long as the equations on these sides are those of the scene."""
        switches = self.on(self.switches, sides, *place)
        arguments = switches.sx_in()
        return common("conditions", arguments, [ca.densify(sides * switches(*arguments))])

    def settled(self, x: Array, p: Array, t: float, sides: Array, fixed: tuple[int, ...] = ()) -> Array:
        """Sides (m,) at one place. The switches `fixed` keep their sides. A switch may depend on earlier sides."""
        sides = sides.copy()
        others = np.setdiff1d(np.arange(len(sides)), fixed)
        for _ in range(len(sides)):
            values = self.switches(x, p, t, sides).full().ravel()
            sides[others] = np.where(values[others] >= 0, 1.0, -1.0)
        return sides

    def steep(self, which: int) -> str:
        """The message that derivatives may be infinite at a switch."""
        return (
            f"'{self.labels[which]}' becomes 0. A law may have infinite derivatives at 0, such as w*abs(w)**0.5. "
            "Make the law smooth: use sqrt(w**2 + small**2) instead of abs(w)"
        )

    def sentence(self, which: int, time: float, reason: str) -> str:
        """A message that a proof ends before a switch, `time` after the first time [s]. The reason is a sentence."""
        at = self.begin + time + 0.0  # not -0
        own = f"It cannot be proved that '{self.labels[which]}' changes its sign once for the whole box: {reason}"
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
        if isinstance(code, Entry) and type(code.pieces) is not Pieces:  # subclasses have other switches
            number = ca.SX(code.between(*(float(number) for _, number in arguments))[0])
            return number, number
        of, numbers = zip(*arguments, strict=True)
        return applied(code, *of), applied(code, *numbers)

    found = interpret(f, inputs, operation, lambda number: (ca.SX(number), ca.SX(number)))
    return common(f.name(), symbols, [ca.densify(ca.vertcat(*(value for value, _ in part))) for part in found])
