"""A run in two independent ways, for an estimate of its errors, and the effect of errors of states on outputs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from symmb._doubt import Doubt
from symmb._types import Array, Mask
from symmb._units import values_text
from symmb.declare.symbolic import batch
from symmb.equations.model import DAE, Scene
from symmb.run.codegen import has_compiler
from symmb.run.formulations import Program
from symmb.run.integrate import (
    CVODES,
    IDAS,
    AugmentedLagrangian,
    DormandPrince,
    Rosenbrock,
    Solver,
    StabilizedIndex2,
    follow_doubts,
)
from symmb.run.verification.linear_theory import linear_theory_doubts

_CERTAIN, _EXACT = 1e-3, 1e-9
"""Largest error of an output with three certain digits, divided by the range of the output. The second value is for an
output that hardly changes: largest error, divided by the size of the output."""
_OF_WIDTH = 0.02
"""Error of a run, divided by the width of bounds. A larger error causes a warning, as other errors of bounds do."""
_GLOBAL, _MULTISTEP, _USUAL = 100, 1000, 1e-8
"""Largest error of a run, divided by the relative tolerance of its steps, for one-step and for multistep methods. 2,000
steps have errors of 40 and 400 tolerances. Tolerances above `_USUAL` do not explain larger errors."""
_NAMED = 4
"""Maximum number of outputs in a sentence."""
_FINE, _FINEST = 1e-9, 1e-12
"""Largest and smallest relative tolerance of a run that checks another run. The error of the check should be small."""
ROUNDING, _SHIFT = 1e-12, 1e-6
"""Changes of states, divided by their sizes: rounding, which no solver resolves, and the change for difference
quotients."""


@dataclass(frozen=True, eq=False)
class TwoWays:
    """Outputs of a run in two ways, which differ in the family of the solver and, if possible, in the coordinates.

    Attributes
    ----------
    t, names : (m,), (n_y,)        times [s], and names of the outputs
    values, others : (m, n_y)      outputs of the first and of the second way; nan after a failure
    ways : (str, str)              solver and coordinates of both ways
    floor : level -> (n_y,)        changes of the outputs if states change by `level` times their sizes
    levels : (float, float)        levels of errors that the tolerances of both ways explain
    parameters : str               parameters as text, such as "l1 = 1.02"
    message : str                  time and reason of a failure of the second way; empty without a failure
    operations : float             number of operations of the second way, as in `Program.operations`
    unchecked : str                a sentence if the run is not checked to its end, or not by another family
    """

    t: Array
    names: tuple[str, ...]
    values: Array
    others: Array
    ways: tuple[str, str]
    floor: Callable[[float], Array]
    levels: tuple[float, float]
    parameters: str = ""
    message: str = ""
    operations: float = 0.0
    unchecked: str = ""

    @classmethod
    def of(cls, first: Program, second: Program, names: tuple[str, ...], p: Array, values: Array) -> "TwoWays":
        """A run with parameters p (n_p,) in two ways. `values` (n_t, n_y) are the outputs in the first way.

        Outputs are compared at the times of the second way. The first way has these times, too.
        """
        some = np.searchsorted(first.times, second.times)
        run = second.runs(p[None])
        parameters = values_text(first.bodies.dae.p_names, p, first.bodies.dae.p_units)
        at = f"t = {run.t_failed[0]:g} s"
        told = f"{at}{parameters and f', {parameters}'}: "  # the time and the parameters are not repeated
        message = "".join(f"fails at {at}: {text.removeprefix(told)}" for text in run.messages)
        where = parameters and f", with {parameters},"
        return cls(
            t=second.times,
            names=names,
            values=values[some],
            others=run.Y[0],
            ways=(repr(first), repr(second)),
            floor=partial(_changes, second, p),
            levels=(_error_of_runs(first.solver), _error_of_runs(second.solver)),
            parameters=parameters,
            message=message,
            operations=second.operations(),
            unchecked=message and f"A second run by {second!r}{where} {message}.",
        )

    @cached_property
    def error(self) -> Array:
        """Differences (m, n_y) of both ways; 0 after a failure."""
        with np.errstate(invalid="ignore"):  # equal infinities
            return np.nan_to_num(np.abs(self.values - self.others), nan=0.0, posinf=0.0)

    @cached_property
    def _range(self) -> Array:
        return np.ptp(np.nan_to_num(self.values), axis=0)

    @cached_property
    def lost(self) -> Mask:
        """Mask (m, n_y) of the outputs with fewer than three certain digits."""
        return self.beyond(_CERTAIN * self._range, max(self.levels))

    def beyond(self, limits: Array, level: float) -> Mask:
        """Mask (m, n_y) of errors above `limits` (n_y,) that changes of the states by `level` do not explain."""
        size = np.abs(np.nan_to_num(self.values)).max(axis=0, initial=0.0)
        large = self.error > np.maximum(limits, _EXACT * size)
        return large & (self.error > self.floor(level)) if large.any() else large

    @property
    def doubts(self) -> tuple[str, ...]:
        """A warning with the time after which digits are lost, and with the largest difference of both ways."""
        return self._doubts(self.lost, self._range, "a thousandth of their range")

    def is_large_beside(self, widths: Array) -> bool:
        """Whether differences of both ways are large in comparison with the widths (n_y,) of bounds."""
        return bool(self.beyond(_OF_WIDTH * widths, ROUNDING).any())

    def doubts_of_widths(self, widths: Array) -> tuple[str, ...]:
        """A warning about errors that are large in comparison with the widths (n_y,) of bounds.

        The second way is more accurate.
        """
        lost = self.beyond(_OF_WIDTH * widths, self.levels[1])
        if lost.any():
            lost &= widths > self.floor(self.levels[0])  # tolerances explain smaller widths
        return self._doubts(
            lost, widths, f"{_OF_WIDTH:.0%} of the width of their bounds", " Use a solver with a smaller rtol."
        )

    def _doubts(self, lost: Mask, sizes: Array, beyond: str, advice: str = "") -> tuple[str, ...]:
        if not lost.any():
            return ()
        concerned = [name for name, some in zip(self.names, lost.T, strict=True) if some.any()]
        listed = ", ".join(concerned[:_NAMED] + ["..."] * (len(concerned) > _NAMED))
        shares = np.where(lost, self.error / np.maximum(sizes, np.finfo(float).tiny), 0.0)
        k, i = np.unravel_index(int(shares.argmax()), lost.shape)
        both = zip((self.values, self.others), self.ways, strict=True)
        value, other = (f"{values[k, i]:.9g} by {way}" for values, way in both)
        since = f"From t = {self.t[int(lost.any(axis=1).argmax())]:g} s on, errors of {listed} exceed {beyond}"
        at = f"at t = {self.t[k]:g} s" + (self.parameters and f" and {self.parameters}")
        return (Doubt(f"{since}: {at}, {self.names[i]} is {value}, and {other}.{advice}", concerned),)


class OtherWays:
    """Checks of a program by runs in other ways. Each run is made once, at its first use.

    Parameters
    ----------
    program : Program
    names : n_y names of outputs
    flexible : Scene, optional
        the scene, if it has flexible bodies
    """

    def __init__(self, program: Program, names: tuple[str, ...], flexible: Scene | None) -> None:
        self._program, self._names, self.flexible = program, names, flexible
        self._told: dict[tuple[str, bytes], Any] = {}

    def at_nominal(self) -> tuple[Array, Array, tuple[str, ...]]:
        """Outputs (n_t, n_y) of the nominal run, their estimated errors (n_y,), and warnings."""
        program = self._program
        dae, start, p = program.bodies.dae, program.bodies.start, program.bodies.dae.p_nominal
        x, t, rtol = start.states(p[None])[0][0], float(program.times[0]), getattr(program.solver, "rtol", None)
        of_steps, ways = noise_of_outputs(program.bodies.y, dae, x, p, t, rtol), self.two(p)
        doubts = (*start.doubts, *follow_doubts(dae), *self.theory_doubts(p), *ways.doubts)
        return self.values(p), np.maximum(of_steps, ways.error.max(axis=0, initial=0.0)), doubts

    def values(self, p: Array) -> Array:
        """Outputs (n_t, n_y) of the run with parameters p (n_p,)."""
        return self._run(p)[0]

    def most(self, p: Array, operations: float, runs: int) -> int:
        """How many runs in another way take as many operations as given ones and runs of the program; at most 100."""
        return int(min((operations + runs * self._run(p)[1]) / max(self.two(p).operations, 1.0), 100))

    def _run(self, p: Array) -> tuple[Array, float]:
        """Outputs (n_t, n_y) of the run with parameters p (n_p,), and its number of operations."""
        return self._once("run", p, lambda: (self._program.runs(p[None]).Y[0], self._program.operations()))

    def two(self, p: Array, finest: bool = False) -> TwoWays:
        """The run of the program with parameters p (n_p,), and a run in another way, at some of the times.

        The second way is more accurate if `finest` is true, or if the two ways disagree.
        """
        ways = partial(in_two_ways, self._program, self._other, self._names, p, self.values(p), finest)
        return self._once("finest" if finest else "ways", p, ways)

    def theory_doubts(self, p: Array) -> tuple[str, ...]:
        """Warnings of `linear_theory_doubts` about a run with parameters p (n_p,). Nothing is compiled for this run."""
        return () if self.flexible is None else self._once("theory", p, partial(self._theory, self.flexible, p))

    def _theory(self, flexible: Scene, p: Array) -> tuple[str, ...]:
        way = self._other if self._program.runs_in_lanes else self._program
        return linear_theory_doubts(flexible, *way.formulation.in_bodies(way.states(p[None])[0].X, p), p, way.times)

    def _once(self, what: str, p: Array, tell: Callable[[], Any]) -> Any:
        key = what, p.tobytes()
        if key not in self._told:
            self._told[key] = tell()
        return self._told[key]

    @cached_property
    def _other(self) -> Program:
        """The program of the second way, at some output times, which include the first and the last one."""
        times = self._program.times
        # Maximum number of times at which a study compares two ways: as many as a picture shows.
        some = np.unique(np.linspace(0, len(times) - 1, min(len(times), 101)).round().astype(np.intp))
        return other_way(self._program, times[some])


def in_two_ways(
    program: Program, other: Program, names: tuple[str, ...], p: Array, values: Array, finest: bool = False
) -> TwoWays:
    """A run of a program with parameters p (n_p,) and outputs `values` (n_t, n_y), and a run in another way.

    The second way is more accurate if `finest` is true, or if the two ways disagree.
    """
    ways = None if finest else TwoWays.of(program, other, names, p, values)
    if ways is None or ways.lost.any():
        ways = TwoWays.of(program, other_way(program, other.times, finest=True), names, p, values)
    if ways.message:  # a check by the same family of solvers is better than no check
        tighter = program.solver.tighter(times=program.times)
        by_itself = TwoWays.of(program, Program(program.forms, tighter, other.times), names, p, values)
        ways = ways if by_itself.message else replace(by_itself, unchecked=ways.unchecked)
    return ways


def other_way(program: Program, times: Array, finest: bool = False) -> Program:
    """The program of the same scene with a solver of another family, and in other coordinates if these exist."""
    # Only one family can solve scenes with impacts, or with drives that have jumps in their rates.
    if program.bodies.dae.impacts is not None or program.contradiction or program.is_stateless:
        return program.tighter()
    solver, forms = _another(program.solver, finest), program.forms
    forms = forms._replace(joints=None if program.coordinates == "joint" else forms.spare)
    other = Program(forms, solver, times)
    if isinstance(solver, CVODES):
        integration = solver.independent_integration(other.formulation.dae, times, finest)
        other.compiled.get(("integration", 0), lambda: integration)
    return other


def _another(solver: Solver, finest: bool) -> Solver:
    """A solver of another family. SUNDIALS solvers replace compiled solvers, and compiled solvers replace SUNDIALS.

    Without a C compiler, all solvers are SUNDIALS solvers. BDF formulas then replace Adams formulas, and vice versa.
    """
    stiff = isinstance(solver, Rosenbrock | StabilizedIndex2) or getattr(solver, "stiff", False)
    is_sundials = isinstance(solver, CVODES | IDAS | StabilizedIndex2)
    rtol = _FINEST if finest else min(max((getattr(solver, "rtol", None) or 1.0) / 10, _FINEST), _FINE)
    through = getattr(solver, "stabilization", None)
    through = through if isinstance(through, AugmentedLagrangian) else None
    if not (is_sundials and has_compiler()):
        return CVODES(rtol, stiff=stiff ^ is_sundials, stabilization=through)
    return Rosenbrock(rtol, stabilization=through) if stiff else DormandPrince(rtol, stabilization=through)


def _error_of_runs(solver: Solver) -> float:
    """Error of the states, divided by their sizes, that the tolerance explains; 0 for a solver with fixed steps."""
    rtol = min(getattr(solver, "rtol", None) or 0.0, _USUAL)
    return rtol * (_MULTISTEP if isinstance(solver, CVODES | IDAS | StabilizedIndex2) else _GLOBAL)


def _changes(way: Program, p: Array, level: float) -> Array:
    """Largest changes (n_y,) of outputs in a run with parameters p, if states change by `level` times their sizes."""
    form = way.formulation
    X = way.integration().run(form.start.states(p[None])[0], p[None])[0].X
    return changes_of_outputs(way.bodies.y, *form.in_bodies(X, p), p, way.times, level)


def changes_of_outputs(y: ca.Function, dae: DAE, X: Array, p: Array, t: Array, level: float) -> Array:
    """Largest changes (n_y,) of outputs y(x, p, t) along states X (n_t, n_x) that change by a level of their sizes."""
    k = np.arange(1, X.shape[1] + 1)  # changes that do not cancel in sums and differences of states:
    shares = np.where(np.cos(k**1.5) > 0, 1.0, -1.0) * (1 + k * np.sqrt(1.25) % 1 / 2)
    shifted, here = (batch(y, states, p, t[:, None])[0] for states in (X + _SHIFT * shares * dae.state_sizes, X))
    change = np.nan_to_num(np.abs(shifted - here), posinf=0.0)
    return level / _SHIFT * change.reshape(len(t), -1).max(axis=0)


def noise_of_outputs(y: ca.Function, dae: DAE, x: Array, p: Array, t: float, rtol: float | None) -> Array:
    """Errors (n_y,) of outputs y(x, p, t) because of errors of the states in the steps of a solver.

    The state x (n_x,) may be special, such as a state of rest. Therefore the median over states around it is used.
    """
    # Number of states for the estimate, and errors of steps, divided by rtol and by the sizes of states.
    around = np.random.default_rng(0).uniform(-1, 1, (10, len(x))) * dae.state_sizes
    states = x + np.vstack([np.zeros(len(x)), around])
    shift = np.random.default_rng(1).uniform(-1, 1, states.shape) * _SHIFT * dae.state_sizes
    there, here = (batch(y, some, p, np.full((len(some), 1), t))[0] for some in (states + shift, states))
    level = ROUNDING if rtol is None else max(0.1 * rtol, ROUNDING)
    return level / _SHIFT * np.median(np.nan_to_num(np.abs(there - here), posinf=0.0), axis=0)
