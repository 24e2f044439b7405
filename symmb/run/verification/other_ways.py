"""Runs of a program that are made in another way: by another family of solvers, in other coordinates."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from symmb._types import Array
from symmb.equations.model import Scene
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
from symmb.run.verification.two_ways import TwoWays, noise_of_outputs, times_to_compare

_FINE, _FINEST = 1e-9, 1e-12
"""Largest and smallest relative tolerance of a run that checks another one: its own error should not matter."""


class OtherWays:
    """What runs of a program in other ways tell. Each of them is made once, at its first use.

    Parameters
    ----------
    program : Program
    names : n_y names of outputs
    flexible : Scene, optional
        the scene, if it has flexible bodies
    """

    def __init__(self, program: Program, names: tuple[str, ...], flexible: Scene | None) -> None:
        self._program, self._names, self.flexible = program, names, flexible
        self._values: dict[bytes, Array] = {}
        self._ways: dict[bytes, TwoWays] = {}
        self._theory: dict[bytes, tuple[str, ...]] = {}

    def at_nominal(self) -> tuple[Array, Array, tuple[str, ...]]:
        """Outputs (n_t, n_y) of the nominal run, how far they may be off (n_y,), and what is doubtful."""
        program = self._program
        dae, start, p = program.bodies.dae, program.bodies.start, program.bodies.dae.p_nominal
        x, t, rtol = start.states(p[None])[0][0], float(program.times[0]), getattr(program.solver, "rtol", None)
        of_steps, ways = noise_of_outputs(program.bodies.y, dae, x, p, t, rtol), self.two(p)
        doubts = (*start.doubts, *follow_doubts(dae), *self.theory_doubts(p), *ways.doubts)
        return self.values(p), np.maximum(of_steps, ways.error.max(axis=0, initial=0.0)), doubts

    def values(self, p: Array) -> Array:
        """Outputs (n_t, n_y) of the run with parameters p (n_p,)."""
        key = p.tobytes()
        if key not in self._values:
            self._values[key] = self._program.runs(p[None]).Y[0]
        return self._values[key]

    def two(self, p: Array, finest: bool = False) -> TwoWays:
        """The run with parameters p (n_p,) as studies make it, and one in another way, at some of the times.

        It takes the more accurate second way if `finest` is true, or if the ways disagree.
        """
        key = p.tobytes() + bytes([finest])
        if key not in self._ways:
            self._ways[key] = in_two_ways(self._program, self._other, self._names, p, self.values(p), finest)
        return self._ways[key]

    def theory_doubts(self, p: Array) -> tuple[str, ...]:
        """Those of `linear_theory_doubts` about a run with parameters p (n_p,), in a way that compiles nothing."""
        if self.flexible is None:
            return ()
        key = p.tobytes()
        if key not in self._theory:
            way = self._other if self._program.runs_in_lanes else self._program
            form = way.formulation
            run = way.integration().run(form.start.states(p[None])[0], p[None])[0]
            self._theory[key] = linear_theory_doubts(self.flexible, *form.in_bodies(run.X, p), p, way.times)
        return self._theory[key]

    @cached_property
    def _other(self) -> Program:
        return other_way(self._program, self._program.times[times_to_compare(self._program.times)])


def in_two_ways(
    program: Program, other: Program, names: tuple[str, ...], p: Array, values: Array, finest: bool = False
) -> TwoWays:
    """A run of a program with parameters p (n_p,) and outputs (n_t, n_y), and one in another way.

    It takes the more accurate second way if `finest` is true, or if the ways disagree.
    """
    ways = None if finest else TwoWays.of(program, other, names, p, values)
    if ways is None or ways.lost.any():
        ways = TwoWays.of(program, other_way(program, other.times, finest=True), names, p, values)
    if ways.message:  # the same family of solvers tells less, but more than nothing
        tighter = program.solver.tighter(times=program.times)
        by_itself = TwoWays.of(program, Program(program.forms, tighter, other.times), names, p, values)
        ways = ways if by_itself.message else replace(by_itself, unchecked=ways.unchecked)
    return ways


def other_way(program: Program, times: Array, finest: bool = False) -> Program:
    """The same scene by a solver of another family, and in other coordinates if the scene has any."""
    # With impacts, or drives whose rates jump, there is one family only.
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
    """A solver of another family: those of SUNDIALS take the place of the others, and the others of them.

    Without a C compiler there are no others. BDF and Adams formulas then take the place of each other.
    """
    stiff = isinstance(solver, Rosenbrock | StabilizedIndex2) or getattr(solver, "stiff", False)
    is_sundials = isinstance(solver, CVODES | IDAS | StabilizedIndex2)
    rtol = _FINEST if finest else min(max((getattr(solver, "rtol", None) or 1.0) / 10, _FINEST), _FINE)
    through = getattr(solver, "stabilization", None)
    through = through if isinstance(through, AugmentedLagrangian) else None
    if not (is_sundials and has_compiler()):
        return CVODES(rtol, stiff=stiff ^ is_sundials, stabilization=through)
    return Rosenbrock(rtol, stabilization=through) if stiff else DormandPrince(rtol, stabilization=through)
