"""Conversion of declared expressions (numbers, SX, SymPy) into SX with known symbols."""

import re
from collections.abc import Collection, Sequence

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, Faults, faults_of
from symmb._names import did_you_mean, shown
from symmb._types import Array, Expr
from symmb.declare.mechanics import Body, Input, OwnState, Parameters, declared_with
from symmb.declare.symbolic import Kind, Symbol, from_sympy, given, irregular_part, is_sympy, lookup, records_in, t


class Binding:
    """Converts expressions into SX of time and of the parameters, coordinates and velocities of one system."""

    def __init__(
        self,
        parameters: Parameters,
        bodies: Sequence[Body],
        states: Sequence[OwnState] = (),
        inputs: Sequence[Input] = (),
    ) -> None:
        self.parameters = parameters
        self.missing: Parameters | None = None  # unknown parameters with symbols in expressions
        self._inputs = ca.vertcat(ca.SX(0, 1), *(u.value for u in inputs if u.name not in parameters))
        self._known: dict[int, tuple[str, Kind | None, ca.SX]] = {t.element_hash(): ("t", None, t)}
        for i, name in enumerate(parameters):
            symbol = parameters.symbols[i]
            self._known[symbol.element_hash()] = (name, Kind.PARAMETER, symbol)
        for body in bodies:
            for record in body.frame.records:
                self._known[record.sx.element_hash()] = (record.name, record.kind, record.sx)
        for state in states:
            for record in state.symbols:
                self._known[record.sx.element_hash()] = (record.name, Kind.STATE, record.sx)
        for u in inputs:
            self._known[u.value.element_hash()] = (u.name, Kind.PARAMETER, u.value)

    @property
    def by_name(self) -> dict[str, ca.SX]:
        """All known symbols by their dotted names, and parameters with units as quantities."""
        quantities = {name: self.parameters.__getattr__(name) for name in self.parameters}
        return {name: symbol for name, _, symbol in self._known.values()} | quantities

    def __call__(self, law: Expr, what: str, also: Collection[int] = (), any_size: bool = False) -> ca.SX:
        """The law as SX with one component, or with any number of components for `any_size`.

        Raises DeclarationError if the law contains NaN, infinity or a symbol that is neither known nor in `also`. The
        text `what` names the owner in messages.
        """
        if is_sympy(law):
            with faults_of(what):
                law = from_sympy(law, self.by_name)
        expression = given(law)
        if expression is None:
            more = ""
            if isinstance(law, list) and len(law) == 2 and isinstance(law[1], str):
                more = f" Write a tuple for an expression with a unit, such as ({shown(law[0])}, {law[1]!r})."
            elif isinstance(law, tuple) or (isinstance(law, str) and any(map(str.isdigit, law[:2]))):
                more = " Write numbers in SI units, as np.deg2rad(80) for 80°."
            elif isinstance(law, str):
                more = " Write the expression itself, such as rod.x, without quotation marks."
            elif given(getattr(law, "value", None)) is not None:
                more = " Write its value, with .value at the end."
            raise DeclarationError(f"{what}: {shown(law)} is not a number, a CasADi SX or a SymPy expression.{more}")
        if expression.numel() != 1 and not any_size:
            raise DeclarationError(f"{what} has {expression.numel()} components; expected one number or expression.")
        self.check(expression, what, also)
        expression = self.without_inputs(expression)
        return ca.sparsify(expression) if expression.numel() != 1 else ca.densify(expression)

    def without_inputs(self, expression: ca.SX) -> ca.SX:
        """An expression in which inputs that are not parameters have the value 0."""
        return ca.substitute(expression, self._inputs, 0 * self._inputs) if self._inputs.numel() else expression

    def inputs_in(self, expressions: Sequence[ca.SX]) -> list[str]:
        """Names of the inputs in unbound expressions that are not parameters."""
        if not self._inputs.numel():
            return []
        return [u.name() for u in ca.vertsplit(self._inputs) if ca.depends_on(ca.veccat(*expressions), u)]

    def check(self, expression: ca.SX, what: str, also: Collection[int] = ()) -> None:
        """Raise if an expression has NaN, infinity or unknown symbols. `also` has hashes of further known symbols."""
        if expression.is_constant() and np.isinf(np.array(ca.DM(expression))).any():
            raise DeclarationError(f"{what} is infinite. Give a finite number.")
        if (part := irregular_part(expression)) == "erfinv":
            raise DeclarationError(
                f"{what}: contains erfinv, whose values in CasADi have errors of 2e-6 and jump at 0.7. Use a table of "
                "its values, mb.Table(...)."
            )
        if part:
            raise DeclarationError(
                f"{what}: contains NaN or infinity. Use casadi.sin(mb.t) instead of math.sin(mb.t), because "
                "Python's math gives NaN for expressions. Do not mix CasADi and SymPy in one expression."
            )
        unknown = (self._fault(symbol, also) for symbol in ca.symvar(expression))
        Faults(f"{what}: {fault}" for fault in unknown if fault).raise_any()

    def _fault(self, symbol: ca.SX, also: Collection[int]) -> str:
        """Why a symbol is not known, as a sentence; empty if the symbol is known."""
        record = lookup(symbol)
        if symbol.element_hash() in self._known or symbol.element_hash() in also:
            return ""
        self.missing = self.missing or declared_with(symbol)
        is_other = symbol.name() in self.by_name
        if record is not None and record.owner and not is_other:
            return f"{record.owner} is not part of the System. Add it to System(...)."
        if record is not None and record.kind is Kind.STATE and not record.owner:
            return ""
        if is_other:
            return (
                f"symbol {symbol.name()!r} belongs to an object outside the System, which has another object "
                "with the same name. Use one object for both."
            )
        if re.search(r"\.lam\[\d+\]$", symbol.name()):
            return (
                f"{symbol.name()!r} is a reaction and follows from the equations, so laws cannot depend on it. Only "
                "outputs and conditions of Release can depend on reactions of the same System."
            )
        if declared_with(symbol) is not None:
            return (
                f"symbol {symbol.name()!r} belongs to Parameters that the System does not have. Declare all parameters "
                "in one object. If no element depends on this object, pass System(..., parameters=p)."
            )
        return (
            f"symbol {symbol.name()!r} does not belong to a parameter or a body of the System."
            f"{did_you_mean(symbol.name(), self.by_name)}"
        )

    def states(self, expression: ca.SX) -> tuple[Symbol, ...]:
        """The first-order states in an expression."""
        return tuple(records_in(expression, Kind.STATE))

    def symbols(self, kind: Kind, expression: ca.SX) -> list[ca.SX]:
        """The symbols of one kind, such as velocities of the system, in an expression."""
        symbols = ca.symvar(expression)
        return [s for s in symbols if self._known.get(s.element_hash(), ("", None, s))[1] is kind]

    def has_parameters_alone(self, expression: ca.SX) -> bool:
        """Whether all symbols in an expression are parameters of the system."""
        return len(self.symbols(Kind.PARAMETER, expression)) == len(ca.symvar(expression))

    def nominal(self, expression: ca.SX) -> Array:
        """Values of an expression of parameters at the nominal parameters."""
        f = ca.Function("nominal", [self.parameters.symbols], [expression])
        return f(self.parameters.nominal).full()
