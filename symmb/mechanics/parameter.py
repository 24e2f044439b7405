"""Parameters: named symbols with nominal values."""

from collections.abc import Iterator, Mapping, Sequence
from weakref import WeakValueDictionary

import casadi as ca
import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, NoParameterError
from symmb._interrupts import kept_interrupts
from symmb._names import did_you_mean, name_fault, normal, normal_keys
from symmb._options import is_finite_number, shown
from symmb._types import Array
from symmb.symbolic import Kind, Symbol, declare

_DECLARED: "WeakValueDictionary[int, Parameters]" = WeakValueDictionary()


def declared_with(symbol: ca.SX) -> "Parameters | None":
    """The parameters that a symbol was declared with, as long as they are in use."""
    return _DECLARED.get(symbol.element_hash())


class Parameters(Mapping[str, float]):
    """Named parameters with nominal values; a mapping from name to nominal value.

    Parameters
    ----------
    **nominal : float
        nominal value of each parameter, in SI units unless expressions convert it

    Raises
    ------
    DeclarationError
        If a value is not a finite number, or a name is no identifier or taken by the class itself

    Examples
    --------
    >>> p = Parameters(l1=1.0, m1=2.5)
    >>> p.l1, p["m1"]
    (SX(l1), 2.5)
    """

    @kept_interrupts()
    def __init__(self, **nominal: float) -> None:
        nominal = normal_keys("Parameters", nominal)
        taken = [n for n in nominal if n == "t" or hasattr(type(self), n)]
        faults = [f"parameter {n!r}: the name is taken; choose another." for n in taken]
        faults += [
            f"parameter {n!r}: a name has letters, digits and underscores, a letter first."
            for n in nominal
            if not n.isidentifier() or name_fault(n)
        ]
        for name, value in nominal.items():
            if not is_finite_number(value):
                faults.append(f"parameter {name!r}: nominal value {shown(value)} is not a finite number.")
        if faults:
            raise DeclarationError("\n".join(faults))
        self._nominal = {name: float(value) for name, value in nominal.items()}
        self._symbols = ca.vertcat(*[ca.SX.sym(name) for name in nominal]) if nominal else ca.SX(0, 1)
        self._records = declare(nominal, Kind.PARAMETER, self._symbols)
        for record in self._records:
            _DECLARED[record.sx.element_hash()] = self

    def with_more(self, **nominal: float) -> "Parameters":
        """These parameters, with the same symbols, and more behind them."""
        more, both = Parameters(**nominal), object.__new__(Parameters)
        both._nominal = self._nominal | more._nominal
        both._symbols = ca.vertcat(self._symbols, more._symbols)
        both._records = (*self._records, *more._records)
        return both

    def with_inputs(self, inputs: Sequence[Symbol]) -> "Parameters":
        """These parameters, and the symbols of inputs behind them, whose nominal values are 0."""
        both = object.__new__(Parameters)
        both._nominal = self._nominal | dict.fromkeys((symbol.name for symbol in inputs), 0.0)
        both._symbols = ca.vertcat(self._symbols, *(symbol.sx for symbol in inputs))
        both._records = (*self._records, *inputs)
        return both

    def with_nominal(self, nominal: Mapping[str, float]) -> "Parameters":
        """These parameters, with the same symbols, and with other nominal values."""
        nominal = normal_keys("with_nominal", nominal)
        if not isinstance(nominal, Mapping) or not all(is_finite_number(nominal.get(name)) for name in self._nominal):
            names = ", ".join(self._nominal)
            raise DeclarationError(f"with_nominal: expected finite numbers by the names {names}, got {shown(nominal)}.")
        other = object.__new__(Parameters)
        other._nominal = {name: float(nominal[name]) for name in self._nominal}
        other._symbols, other._records = self._symbols, self._records
        return other

    def __getattr__(self, name: str) -> ca.SX:
        names, name = list(self.__dict__.get("_nominal", ())), normal(name)
        if name not in names:
            raise AttributeError(f"no parameter {name!r}; declared are: {', '.join(names) or 'none'}.")
        return self._symbols[names.index(name)]

    @property
    def symbols(self) -> ca.SX:
        """All symbols as one vector, (n_p,), in the order of declaration."""
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
        return f"Parameters({', '.join(f'{n}={v:g}' for n, v in self._nominal.items())})"

    def _repr_html_(self) -> str:
        rows = [[name, f"{value:.12g}"] for name, value in self._nominal.items()]
        return html.page(html.table([["parameter", "nominal"], *rows]))
