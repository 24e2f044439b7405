"""Parameters: named symbols with nominal values."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from weakref import WeakValueDictionary

import casadi as ca
import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, Faults, NoParameterError
from symmb._interrupts import kept_interrupts
from symmb._names import did_you_mean, name_fault, normal, normal_keys
from symmb._options import shown
from symmb._types import Array
from symmb._units import label, number_in, quantity, scaled, unit_of, units_of_parameters
from symmb.declare.symbolic import Kind, Symbol, declare

_DECLARED: "WeakValueDictionary[int, Parameters]" = WeakValueDictionary()


def declared_with(symbol: ca.SX) -> "Parameters | None":
    """The Parameters object that declared a symbol; None if no such object exists any more."""
    return _DECLARED.get(symbol.element_hash())


class Parameters(Mapping[str, float]):
    """Named parameters with nominal values: a mapping from names to nominal values.

    Parameters
    ----------
    **nominal : float, (float, str) or str
        nominal value of each parameter: a number, usually in SI units, or a value with a unit, such as (235, "mm") or
        "235 mm". With a unit, `p.l1` is the quantity in SI units. In boxes, tables, pictures, reports, files and FMUs,
        the value is a number in the given unit

    Raises
    ------
    DeclarationError
        If a value is not a finite number, if a unit is not known, or if a name is not an identifier or is an attribute
        of this class

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(l1=1.0, m1=2.5)
    >>> p.l1, p["m1"]
    (SX(l1), 2.5)
    >>> p = mb.Parameters(arm=(235, "mm"), rate="2.5 N/mm")
    >>> p.arm, p["arm"]
    (SX((arm/1000)), 235.0)
    """

    @kept_interrupts()
    def __init__(self, **nominal: "float | tuple[float, str] | str") -> None:
        nominal = normal_keys("Parameters", nominal)
        taken = [n for n in nominal if n == "t" or hasattr(type(self), n)]
        faults = Faults(f"parameter {n!r}: symmb uses this name itself. Choose another name." for n in taken)
        faults += [
            f"parameter {n!r}: the name must consist of letters, digits and underscores, and start with a letter."
            for n in nominal
            if not n.isidentifier() or name_fault(n)
        ]
        given = dict[str, tuple[float, str]]()
        for name, value in nominal.items():
            with faults.noted():
                given[name] = quantity(f"parameter {name!r}: nominal value", value)
                unit_of(f"parameter {name!r}", given[name][1])
        faults.raise_any()
        self._nominal = {name: value for name, (value, _) in given.items()}
        self._units = {name: unit for name, (_, unit) in given.items() if unit}
        self._symbols = ca.vertcat(*[ca.SX.sym(name) for name in nominal]) if nominal else ca.SX(0, 1)
        self._records = declare(nominal, Kind.PARAMETER, self._symbols)
        for record in self._records:
            _DECLARED[record.sx.element_hash()] = self
        self._quantities = _quantities(self._symbols, self._nominal, self._units)

    def with_more(self, **nominal: float) -> "Parameters":
        """Parameters with the symbols of this object, followed by more parameters."""
        more = Parameters(**nominal)
        return self._with(self._nominal | more._nominal, more._records)

    def with_inputs(self, inputs: Sequence[Symbol]) -> "Parameters":
        """Parameters with the symbols of this object, followed by the symbols of inputs with nominal value 0."""
        return self._with(self._nominal | dict.fromkeys((symbol.name for symbol in inputs), 0.0), inputs)

    def with_nominal(self, nominal: Mapping[str, float]) -> "Parameters":
        """Parameters with the same symbols and other nominal values: numbers in the parameters' units, or "240 mm"."""
        nominal = normal_keys("with_nominal", nominal)
        if not isinstance(nominal, Mapping) or not self._nominal.keys() <= nominal.keys():
            names = ", ".join(self._nominal)
            raise DeclarationError(f"with_nominal: expected numbers for {names}, got {shown(nominal)}.")
        owner, own = "with_nominal", self._units
        return self._with({n: number_in(f"{owner}: {n}", n, nominal[n], own.get(n, "")) for n in self._nominal})

    def _with(self, nominal: dict[str, float], more: Sequence[Symbol] = ()) -> "Parameters":
        """A copy with other nominal values, and with more symbols after the symbols of this object."""
        other = object.__new__(Parameters)
        other._nominal, other._units, other._records = nominal, self._units, (*self._records, *more)
        symbols = [symbol.sx for symbol in more]
        other._symbols = ca.vertcat(self._symbols, *symbols) if symbols else self._symbols
        other._quantities = ca.vertcat(self._quantities, *symbols) if symbols else self._quantities
        return other

    def __getattr__(self, name: str) -> ca.SX:
        names, name = list(self.__dict__.get("_nominal", ())), normal(name)
        if name not in names:
            raise AttributeError(f"no parameter {name!r}. Declared parameters: {', '.join(names) or 'none'}.")
        return self._quantities[names.index(name)]

    @property
    def symbols(self) -> ca.SX:
        """All symbols as one vector (n_p,), in the order of declaration. Values are in the parameters' units."""
        return self._symbols

    @property
    def nominal(self) -> Array:
        """All nominal values, (n_p,)."""
        return np.array(list(self._nominal.values()))

    def __getitem__(self, name: str) -> float:
        name = normal(name)
        if not isinstance(name, str) or name not in self._nominal:
            raise NoParameterError(f"no parameter {shown(name)}.{did_you_mean(name, self._nominal)}")
        return self._nominal[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._nominal)

    def __len__(self) -> int:
        return len(self._nominal)

    def __repr__(self) -> str:
        texts = (f"({v:g}, {self._units[n]!r})" if n in self._units else f"{v:g}" for n, v in self._nominal.items())
        return f"Parameters({', '.join(f'{n}={text}' for n, text in zip(self, texts, strict=True))})"

    def _repr_html_(self) -> str:
        rows = [[label(name, self._units.get(name, "")), f"{value:.12g}"] for name, value in self._nominal.items()]
        return html.page(html.table([["parameter", "nominal"], *rows]))


def _quantities(symbols: ca.SX, names: Iterable[str], units: Mapping[str, str]) -> ca.SX:
    """The symbols (n_p,) of parameters, converted from the units of the parameters to SI units."""
    ratios = (unit_of(name, units.get(name, "")) for name in names)
    return ca.vertcat(ca.SX(0, 1), *(scaled(symbols[i], ratio) for i, ratio in enumerate(ratios))) if units else symbols


def with_si_symbols(parameters: Parameters, expression: ca.SX) -> ca.SX:
    """Convert an expression of symbols in the parameters' units to symbols in SI units, as in textbooks."""
    units, symbols = units_of_parameters(parameters), parameters.symbols
    ratios = [unit_of(name, units.get(name, "")) for name in parameters]
    numbers = [scaled(symbols[i], ratio, inverse=True) for i, ratio in enumerate(ratios)]
    return ca.substitute(expression, symbols, ca.vertcat(*numbers)) if units else expression
