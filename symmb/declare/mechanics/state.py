"""States that users declare, sampled values, and inputs from other programs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca

from symmb._errors import DeclarationError, Faults, NoHandleError
from symmb._names import ByName, counted, did_you_mean, name_faults, normal
from symmb._options import is_finite_number, is_real, shown
from symmb._types import Expr
from symmb.declare.mechanics.element import Element, law_faults, law_value
from symmb.declare.symbolic import Kind, Symbol, components, declare, scalar

_NOT_THERE_YET = NameError, LookupError, AttributeError
"""What Python raises if a law names a variable, an entry or an attribute that does not exist yet."""


@dataclass(frozen=True, eq=False)
class OwnState(Element):
    """An element with first-order states. The first state is the value of the element.

    `law_field` is the name of the field for the law. The law is an expression, or a function of the value.
    """

    law_field: ClassVar[str]
    of_start: ClassVar[str | None] = ""

    name: str
    symbols: tuple[Symbol, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DeclarationError(f"{type(self).__name__}: the name must be a text, got {shown(self.name)}.")

    @property
    def value(self) -> ca.SX:
        """The value in expressions."""
        return self.symbols[0].sx

    def settle(self) -> None:
        """Replace a law that is a function by the expression that the function returns."""
        law = getattr(self, self.law_field)
        if callable(law):
            object.__setattr__(self, self.law_field, law_value(law, f"{self.title}: {self.law_field}", self.value))

    def _settle_now(self) -> None:
        """Settle now, so that a law in a loop gets the values of this turn of the loop.

        If the law names an element that is declared later, the System settles it.
        """
        try:
            self.settle()
        except DeclarationError as error:
            if not isinstance(error.__cause__, _NOT_THERE_YET):
                raise


@dataclass(frozen=True, eq=False)
class State(OwnState):
    """A first-order state z with z' = rate. A State is an element of the System. Laws and outputs use its `value`.

    The state starts at 0, or at the value in `Scene(start={"z": 0.5})`. `States` declares several states whose rates
    depend on each other.

    Parameters
    ----------
    name : str
        without dots
    rate : callable
        function of the value z (SX) that returns z' as an expression of z, coordinates, velocities, other states,
        parameters and `t`. The function is called once. If it names elements that are declared later, it is called
        when the System is made. `rate` may also be an expression without z

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=1.0, pose=mb.Particle())
    >>> slow = mb.State("slow", rate=lambda z: (cart.x - z) / 0.5)
    >>> scene = mb.Scene(mb.System(cart, slow), {"cart.x": 1.0, "slow": 2.0}, [0.0, 0.5], {"slow": slow.value})
    >>> float(mb.simulate(scene)["slow"][-1].round(6))
    1.367879
    """

    law_field: ClassVar[str] = "rate"

    rate: Callable[[ca.SX], Expr] | Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        self._declare(self.rate.value if isinstance(self.rate, _Share) else ca.SX.sym(self.name))
        self._settle_now()

    def settle(self) -> None:
        if self.symbols[0].rate.is_empty():
            super().settle()
            rate = scalar(self.rate, f"{self.title}: rate")
            object.__setattr__(self, "rate", rate)
            self._declare(self.value, rate)

    def _declare(self, value: ca.SX, rate: ca.SX | None = None) -> None:
        object.__setattr__(self, "symbols", declare([self.name], Kind.STATE, value, rate, ca.SX(0), self.title))


class _Together:
    """The values of several states, and the function of these values that returns all rates. It is called once."""

    def __init__(self, names: Sequence[str], law: Callable[..., Any]) -> None:
        self.values = [ca.SX.sym(name) for name in names]
        self._title, self._law = f"States {shown([*names])}: rates", law

    @cached_property
    def rates(self) -> list[Any]:
        """The rates of all states."""
        returned = law_value(self._law, self._title, *self.values)
        rates = components(returned)
        rates = [returned] if rates is None else rates
        if len(rates) != len(self.values):
            expected = counted(len(self.values), "rate")
            raise DeclarationError(f"{self._title}: expected {expected}, one for each state, got {len(rates)}.")
        return rates


@dataclass(frozen=True, eq=False)
class _Share:
    """The rate of one of several states, as the rate of a State."""

    together: _Together
    index: int

    @property
    def value(self) -> ca.SX:
        """The value of the state."""
        return self.together.values[self.index]

    def __call__(self, _: ca.SX) -> Any:
        return self.together.rates[self.index]


class States:
    """Several first-order states whose rates depend on each other, such as circuits, reactions or a state space.

    `System(states)` has each as a `State`. They are `states.x`, `states["x"]` or `states[0]`, and `x, y = states`. Laws
    and outputs use `x.value`. Each state starts at 0, or at the value in `Scene(start={"x": 0.5})`.

    Parameters
    ----------
    names : sequence of str
        identifiers
    rates : callable
        function of the values (one SX for each name) that returns the rates in the same order: a list, a tuple, an
        array or a CasADi vector. Rates are expressions as in `State`. The function is called once. If it names elements
        that are declared later, it is called when the System is made

    Raises
    ------
    DeclarationError
        If a name is not an identifier or is used twice, or if the number of rates is not the number of names

    Examples
    --------
    >>> import symmb as mb
    >>> swing = mb.States(["x", "v"], lambda x, v: (v, -4 * x))
    >>> x, v = swing
    >>> scene = mb.Scene(mb.System(swing), {"x": 1.0}, [0.0, 0.5], {"x": x.value, "v": v.value})
    >>> mb.simulate(scene)["x"].round(6)
    array([1.      , 0.540302])
    """

    def __init__(self, names: Sequence[str], rates: Callable[..., Any]) -> None:
        if not isinstance(names, list | tuple) or not names:
            raise DeclarationError(f'States: expected a list of names, such as ["x", "y"], got {shown(names)}.')
        faults = Faults(f"States: {fault}" for fault in name_faults(names))
        faults += [
            f"States: {name!r}: the name must consist of letters, digits and underscores, and start with a letter."
            for name in names
            if isinstance(name, str) and not name.isidentifier()
        ]
        faults += law_faults("States", "rates", rates, of="the values that returns one rate for each name.")
        faults.raise_any()
        names = [*map(normal, names)]
        together = _Together(names, rates)
        self._states = ByName({name: State(name, _Share(together, k)) for k, name in enumerate(names)})

    def __iter__(self) -> Iterator[State]:
        return iter(self._states.values())

    def __len__(self) -> int:
        return len(self._states)

    def __getitem__(self, name: str | int) -> State:
        if isinstance(name, int):
            return [*self][name]
        if name not in self._states:
            raise DeclarationError(f"States: no state {shown(name)}.{did_you_mean(name, self._states)}")
        return self._states[name]

    def __getattr__(self, name: str) -> State:
        if name not in (states := vars(self).get("_states", {})):
            raise NoHandleError(f"States: no state {name!r}.{did_you_mean(name, states)}")
        return states[name]

    def __repr__(self) -> str:
        return f"States({[*self._states]})"


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
        that returns such an expression. The function is called once. If it names elements that are declared later, it
        is called when the System is made. Before the start, the held value is 0, or the value in `Scene(start=...)`

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

    law_field: ClassVar[str] = "law"

    period: float
    law: Callable[[ca.SX], Expr] | Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        states = ca.vertcat(ca.SX.sym(self.name), ca.SX.sym(f"{self.name}.count"))
        names, zero = [self.name, f"{self.name}.count"], ca.SX.zeros(2, 1)
        object.__setattr__(self, "symbols", declare(names, Kind.STATE, states, zero, zero, self.title))
        self._settle_now()

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if not is_real(self.period):
            yield f"{self.title}: period {shown(self.period)} is not a number. Pass a number, without parameters."
        elif not is_finite_number(self.period) or self.period <= 0:
            yield f"{self.title}: period {shown(self.period)} must be positive and finite."


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
