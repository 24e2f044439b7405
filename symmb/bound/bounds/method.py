"""The base of bounding methods, which are frozen objects that compute Bounds from a simulator and a box."""

import time
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, get_args

import numpy as np

from symmb._errors import DeclarationError, PropagationError, SymmbError, text_of
from symmb._interrupts import carry
from symmb._names import counted, did_you_mean
from symmb._options import numbers_of, require_callable, shown
from symmb._types import Array, Executor
from symmb._units import units_of_parameters
from symmb.bound.bounds.allowed import first_points
from symmb.bound.bounds.box_runs import RunsOverBox
from symmb.bound.bounds.failures import failure_text
from symmb.bound.bounds.joined import combination_words, joined
from symmb.bound.bounds.result import Bounds
from symmb.bound.bounds.result_file import Kind
from symmb.bound.bounds.worst_case import AttainingRuns
from symmb.connect import Attained, Progress, Simulator, attained_by_runs
from symmb.declare.symbolic import interpret
from symmb.equations.model import Box, hint, require_numbers_of_words
from symmb.prove import Interval, operate, parameter_intervals
from symmb.run.simulation import DAESimulator


class Method(ABC):
    """A method to bound responses over a box. A method of your own is a subclass.

    A subclass sets `kind` and writes `bounds`. Options are fields of a frozen dataclass, so that the text of a method
    shows them. `propagate` and `compare` take its objects, and `symmb compare --methods module:Name` its classes.

    Attributes
    ----------
    kind : "sampled" (values that runs attain), "estimate" (bounds that may be too wide or too narrow) or "enclosure"
        (bounds that are proved)

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> class Middles(mb.Method):
    ...     kind = "sampled"
    ...
    ...     def bounds(self, runs):
    ...         corners = np.array([runs.lower, (runs.lower + runs.upper) / 2, runs.upper])
    ...         Y = runs(corners)
    ...         return Y.min(axis=0), Y.max(axis=0)
    >>> t = np.array([0.0, 1.0])
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> bounds = mb.propagate(decay, Middles(), mb.Box(k=(0.5, 2.0)))
    >>> bounds.method, bounds.evaluations, bounds.upper[:, 0].round(3).tolist()
    ('Middles()', 3, [1.0, 0.607])
    """

    kind: ClassVar[Kind]
    unit_of_work: ClassVar[str] = "runs"
    """The unit in which the method reports its progress."""
    allows_constraints: ClassVar[bool] = False
    """Whether the method has bounds for boxes with constraints."""
    requires: ClassVar[str] = ""
    """Attribute that a simulator must have beyond `run` and `stream`: "jets" or "expression"."""

    @property
    def doubtful_miss(self) -> float:
        """Largest difference from check runs without a warning, relative to the width. This value is half of the limit
        of estimated errors, because a few runs show only a part of an error."""
        return 0.05

    @abstractmethod
    def bounds(self, runs: RunsOverBox) -> Bounds | tuple[Any, ...]:
        """Bounds of all outputs at all times.

        Parameters
        ----------
        runs : a function of samples (N, d) in the units of the box, with the values (N, n_t, n_y) of the outputs;
            `runs.lower` and `runs.upper` (d,) are the ends of the intervals

        Returns
        -------
        tuple
            (lower, upper) or (lower, upper, estimate), each (n_t, n_y). `estimate` is the estimated error.
        """

    def planned_runs(self, d: int) -> int | None:
        """Number of runs for d uncertain parameters, derivatives included; None if it is not known in advance."""
        return None

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def _result(self, runs: RunsOverBox, lower: Array, upper: Array, evaluations: int, **details: Any) -> Bounds:
        """Bounds by this method. `details` are further attributes of Bounds, besides lower and upper."""
        return Bounds(runs.times, runs.outputs, lower, upper, self.kind, repr(self), evaluations, **details)


def bounded(
    method: Method,
    simulator: Simulator,
    box: Box,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Bounds:
    """Bound all outputs of a simulator at all its times over a box, without check runs; see `propagate`.

    Raises
    ------
    DeclarationError
        If the box names a parameter that the simulator does not have.
    PropagationError
        If the simulator lacks what the method needs, too many runs fail, or a method of the user returns no bounds.
    KeyboardInterrupt
        If the study is interrupted. ``partial`` then contains the bounds that runs have attained, if there are any.
    """
    for name in box.names:
        if name not in simulator.parameters:
            known = did_you_mean(name, simulator.parameters)
            raise DeclarationError(f"Box: no parameter {name!r}.{known}{hint(box.choices, name)}")
    box = box.with_units(units_of_parameters(simulator.parameters))
    require_numbers_of_words(box.choices, simulator.parameters)
    if box.choices:
        own = [each for each in box.combinations() if not each.constraints or len(first_points(each))]
        if not own:
            raise PropagationError(f"{method!r}: no combination of the choices satisfies the constraints of the box.")
        parts, lost = list[Bounds](), dict[str, str]()
        for each in own:
            try:
                parts.append(bounded(method, simulator, each, executor=executor, progress=progress))
            except PropagationError as error:
                lost[combination_words(box, each)] = " ".join(map(str.strip, str(error).splitlines()[:2]))
        if not parts:
            word, reason = next(iter(lost.items()))
            raise PropagationError(f"No combination of choices has bounds. With {word}: {reason}")
        return joined(box, parts, lost)
    if box.constraints and not method.allows_constraints:
        raise PropagationError(
            f"{method!r}: the method has no bounds for constraints. Use PolynomialChaos(), MonteCarlo(...) or "
            "Scanning(...)."
        )
    require_callable("progress", progress, "done", "all")
    start = time.perf_counter()
    nominal = np.array(list(simulator.parameters.values()), dtype=float)
    with attained_by_runs(len(simulator.times), len(simulator.outputs), nominal) as attained:
        runs = RunsOverBox(repr(method), simulator, box, executor, progress)
        try:
            found = method.bounds(runs)
        except KeyboardInterrupt as interrupt:
            carry(interrupt, _partial(method, runs, attained, time.perf_counter() - start))
            raise
        except SymmbError:
            raise
        except Exception as error:
            if type(method).__module__.startswith("symmb.") or isinstance(error, Warning):
                raise
            raise PropagationError(f"{method!r}: `bounds` raised {text_of(error)}.") from error
    result = found if isinstance(found, Bounds) else _of_arrays(method, runs, attained, found)
    lower, upper = result.lower, result.upper
    if result.kind == "estimate":
        lower, upper = np.clip((lower, upper), *possible_values(simulator, box))
    seconds = time.perf_counter() - start
    attaining = AttainingRuns.of(simulator, attained)
    nominal = attained.nominal if result.nominal is None else result.nominal
    if box.constraints:
        told = f"The bounds hold for parameters that satisfy {counted(len(box.constraints), 'constraint')}."
        result = replace(result, remarks=(*result.remarks, told))
    known = {"lower": lower, "upper": upper, "attaining": attaining, "nominal": nominal, "seconds": seconds}
    return replace(result, **known, **_about(simulator, box))


def _partial(method: Method, runs: RunsOverBox, attained: Attained, seconds: float) -> Bounds | None:
    """The extremes of the runs before an interrupt."""
    if not (attained.lower <= attained.upper).all():
        return None
    inner, text = (attained.lower, attained.upper), f"{method!r}, interrupted"
    bounds = Bounds(runs.times, runs.outputs, *inner, "sampled", text, attained.runs, inner=inner)
    return replace(bounds, seconds=seconds, **_about(runs.simulator, runs.box))


_RETURNS = "`bounds` must return (lower, upper) or (lower, upper, estimate), each an array ({}, {}) of numbers"


def _of_arrays(method: Method, runs: RunsOverBox, attained: Attained, found: object) -> Bounds:
    """Bounds from the arrays that a method of the user returns."""
    shape = len(runs.times), len(runs.outputs)
    expected = f"{method!r}: {_RETURNS.format(*shape)}"
    if not isinstance(found, tuple | list) or len(found) not in (2, 3):
        raise PropagationError(f"{expected}, got {shown(found)}.")
    found = found[:2] if found[-1] is None else found
    arrays = [numbers_of(each) for each in found]
    if any(each is None or each.shape != shape for each in arrays):
        forms = ", ".join("no numbers" if each is None else str(each.shape) for each in arrays)
        raise PropagationError(f"{expected}, got {forms}.")
    lower, upper, *estimates = (np.array(each, dtype=float) for each in arrays)
    failed = f" Values of failed runs are nan.\n{failure_text(runs.failed)}" if runs.failed else ""
    for name, each in zip(("lower", "upper", "estimate"), (lower, upper, *estimates), strict=False):
        if np.isnan(each).any():
            k, j = np.argwhere(np.isnan(each))[0]
            raise PropagationError(
                f"{method!r}: {name} of {runs.outputs[j]} is nan at t = {runs.times[k]:g} s.{failed}"
            )
    if (lower > upper).any():
        k, j = np.argwhere(lower > upper)[0]
        raise PropagationError(
            f"{method!r}: lower is above upper for {runs.outputs[j]} at t = {runs.times[k]:g} s: "
            f"{lower[k, j]:g} and {upper[k, j]:g}."
        )
    if estimates and (estimates[0] < 0).any():
        raise PropagationError(f"{method!r}: estimate must not be negative.")
    details: dict[str, Any] = {"failed": runs.failed, "estimate": estimates[0] if estimates else None}
    if (attained.lower <= attained.upper).all():
        details["inner"] = low, high = attained.lower, attained.upper
        if method.kind == "enclosure" and ((low < lower) | (high > upper)).any():
            details["run_doubts"] = ("Runs of the method lie outside of its proved bounds.",)
        if method.kind == "sampled" and ((low > lower) | (high < upper)).any():
            details["run_doubts"] = ("The bounds are sampled, but no run of the method attains them.",)
    return method._result(runs, lower, upper, runs.evaluations, **details)


def require_method(owner: str, method: object) -> Method:
    """The given method. Other objects raise DeclarationError."""
    if isinstance(method, type):
        raise DeclarationError(f"{owner}: got the class {method.__name__}; call it, as in Vertex() or Taylor(order=2).")
    if not isinstance(method, Method):
        raise DeclarationError(f"{owner}: expected a method such as PolynomialChaos(order=4), got {shown(method)}.")
    if getattr(method, "kind", None) not in get_args(Kind):
        kinds = " or ".join(map(repr, get_args(Kind)))
        raise DeclarationError(f"{type(method).__name__}: kind must be {kinds}, as in: kind = 'sampled'.")
    if not repr(method).isprintable():
        raise DeclarationError(f"{owner}: the text of a method must be printable and on one line, got {shown(method)}.")
    return method


def units_of(simulator: Simulator) -> tuple[str, ...]:
    """Units of the outputs, if the simulator knows them."""
    return tuple(getattr(simulator, "units", ()))


def _about(simulator: Simulator, box: Box) -> dict[str, Any]:
    """Attributes of Bounds that are the same for all methods."""
    return {"units": units_of(simulator), "figures": tuple(getattr(simulator, "figures", ())), "box": box}


def possible_values(simulator: Simulator, box: Box | None) -> tuple[Array, Array]:
    """Smallest and largest possible values (n_t, n_y) of the outputs, for all states; infinite if unknown.

    Parameters are in the box. Without a box, they may have any value.
    """
    shape = len(simulator.times), len(simulator.outputs)
    lower, upper = np.full(shape, -np.inf), np.full(shape, np.inf)
    # Largest number of operations in the outputs. Their interval extension takes a tenth of a second.
    if not isinstance(simulator, DAESimulator) or simulator.y.n_instructions() > 10_000:
        return lower, upper
    y, anything = simulator.y, Interval(np.array(-np.inf), np.array(np.inf))

    def operation(code: int, arguments: tuple[Interval, ...]) -> Interval:
        try:
            return operate(code, arguments)
        except PropagationError:  # the operation has no extension, or some states have no value
            return anything

    parameters = [anything] * y.nnz_in(1) if box is None else parameter_intervals(simulator.parameters, box)
    inputs = [[anything] * y.nnz_in(0), parameters, [Interval.exactly(simulator.times)] * y.nnz_in(2)]
    values = interpret(y, inputs, operation, Interval.exactly)[0]
    for row, value in zip(y.sparsity_out(0).row(), values, strict=True):
        lower[:, row], upper[:, row] = value
    return lower, upper
