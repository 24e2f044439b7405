"""The base of bounding methods, which are frozen objects that compute Bounds from a simulator and a box."""

import time
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._interrupts import carry
from symmb._names import counted, did_you_mean
from symmb._options import require_callable, shown
from symmb._types import Array, Executor
from symmb._units import units_of_parameters
from symmb.bound.bounds.allowed import first_points
from symmb.bound.bounds.joined import combination_words, joined
from symmb.bound.bounds.result import Bounds
from symmb.bound.bounds.result_file import Kind
from symmb.bound.bounds.worst_case import AttainingRuns
from symmb.connect import Attained, Jets, Progress, Simulator, attained_by_runs
from symmb.declare.symbolic import interpret
from symmb.equations.model import Box, hint, require_numbers_of_words
from symmb.prove import Interval, operate, parameter_intervals
from symmb.run.simulation import HIGHEST_OF_DIFFERENCES, DAESimulator, differences, has_exact_jets


class Method(ABC):
    """A method to bound responses over a box. Subclasses are frozen dataclasses with the options as fields."""

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

    def bounds(
        self, simulator: Simulator, box: Box, *, executor: Executor | None = None, progress: Progress | None = None
    ) -> Bounds:
        """Bound all outputs of a simulator at all its times over a box.

        Parameters
        ----------
        simulator : source of the trajectories
        box : intervals of some or all parameters; the others keep their nominal values
        executor : anything with an ordered ``map``; None: the runs use this thread
        progress : called with the number of finished runs and of all runs

        Returns
        -------
        Bounds
            ``lower`` and ``upper`` (n_t, n_y).

        Raises
        ------
        DeclarationError
            If the box names a parameter that the simulator does not have.
        PropagationError
            If the simulator lacks what the method needs, or too many runs fail.
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
                raise PropagationError(f"{self!r}: no combination of the choices satisfies the constraints of the box.")
            parts, lost = list[Bounds](), dict[str, str]()
            for each in own:
                try:
                    parts.append(self.bounds(simulator, each, executor=executor, progress=progress))
                except PropagationError as error:
                    lost[combination_words(box, each)] = " ".join(map(str.strip, str(error).splitlines()[:2]))
            if not parts:
                word, reason = next(iter(lost.items()))
                raise PropagationError(f"No combination of choices has bounds. With {word}: {reason}")
            return joined(box, parts, lost)
        if box.constraints and not self.allows_constraints:
            raise PropagationError(
                f"{self!r}: the method has no bounds for constraints. Use PolynomialChaos(), MonteCarlo(...) or "
                "Scanning(...)."
            )
        require_callable("progress", progress, "done", "all")
        start = time.perf_counter()
        nominal = np.array(list(simulator.parameters.values()), dtype=float)
        with attained_by_runs(len(simulator.times), len(simulator.outputs), nominal) as attained:
            try:
                result = self._bounds(simulator, box, executor, progress)
            except KeyboardInterrupt as interrupt:
                carry(interrupt, self._partial(simulator, box, attained, time.perf_counter() - start))
                raise
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

    def planned_runs(self, d: int) -> int | None:
        """Number of runs for d uncertain parameters, derivatives included; None if it is not known in advance."""
        return None

    def _result(self, simulator: Simulator, lower: Array, upper: Array, evaluations: int, **details: Any) -> Bounds:
        """Bounds by this method. `details` are further attributes of Bounds, besides lower and upper."""
        return Bounds(simulator.times, simulator.outputs, lower, upper, self.kind, repr(self), evaluations, **details)

    def _partial(self, simulator: Simulator, box: Box, attained: Attained, seconds: float) -> Bounds | None:
        """The extremes of the runs before an interrupt."""
        if not (attained.lower <= attained.upper).all():
            return None
        inner, text = (attained.lower, attained.upper), f"{self!r}, interrupted"
        bounds = Bounds(simulator.times, simulator.outputs, *inner, "sampled", text, attained.runs, inner=inner)
        return replace(bounds, seconds=seconds, **_about(simulator, box))

    @abstractmethod
    def _bounds(
        self, simulator: Simulator, box: Box, executor: Executor | None, progress: Progress | None
    ) -> Bounds: ...


def require_method(owner: str, method: object) -> Method:
    """The given method. Other objects raise DeclarationError."""
    if isinstance(method, type):
        raise DeclarationError(f"{owner}: got the class {method.__name__}; call it, as in Vertex() or Taylor(order=2).")
    if not isinstance(method, Method):
        raise DeclarationError(f"{owner}: expected a method such as PolynomialChaos(order=4), got {shown(method)}.")
    if not repr(method).isprintable():
        raise DeclarationError(f"{owner}: the text of a method must be printable and on one line, got {shown(method)}.")
    return method


def units_of(simulator: Simulator) -> tuple[str, ...]:
    """Units of the outputs, if the simulator knows them."""
    return tuple(getattr(simulator, "units", ()))


def _about(simulator: Simulator, box: Box) -> dict[str, Any]:
    """Attributes of Bounds that are the same for all methods."""
    return {"units": units_of(simulator), "figures": tuple(getattr(simulator, "figures", ())), "box": box}


def parameter_samples(simulator: Simulator, box: Box, unit: Array) -> Array:
    """Points (N, len(box)) of the unit box as samples (N, d) of all parameters, in the simulator's order."""
    P = np.tile(np.array(list(simulator.parameters.values()), dtype=float), (len(unit), 1))
    P[:, parameter_columns(simulator, box)] = box.from_unit(unit)
    return P


def parameter_columns(simulator: Simulator, box: Box) -> list[int]:
    """Columns of the box's parameters among the parameters of the simulator."""
    order = list(simulator.parameters)
    return [order.index(name) for name in box.names]


def unit_jets(method: Method, simulator: Simulator, box: Box, point: Array, directions: Array, order: int) -> Array:
    """Taylor coefficients (order + 1, m, n_t, n_y) about points (d,) or (m, d) along directions (m, d) in [-1, 1]^d.

    At a single point (d,), low orders are differences of runs if the run meets a kink, a jump or an event.
    """
    if not isinstance(simulator, Jets):
        figures = ", ".join(getattr(simulator, "figures", ()))
        source = f"scalar outputs ({figures}) have" if figures else f"{simulator!r} gives"
        raise PropagationError(
            f"{method!r}: the method needs derivatives of the trajectory, but {source} values only. "
            "Use MonteCarlo or PolynomialChaos."
        )
    p0 = parameter_samples(simulator, box, np.atleast_2d(point)).reshape(*point.shape[:-1], -1)
    scaled = np.zeros((len(directions), len(simulator.parameters)))
    scaled[:, parameter_columns(simulator, box)] = directions * box.radius
    if p0.ndim == 1 and order <= HIGHEST_OF_DIFFERENCES and not has_exact_jets(simulator, p0):
        return differences(simulator, p0, scaled, order)[0]
    jets = np.asarray(simulator.jets(p0, scaled, order), dtype=float)
    if not np.isfinite(jets).all():
        raise PropagationError(f"{method!r}: {simulator!r} gives derivatives that are not finite.")
    return jets


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
