"""Solvers with steps in compiled C code for many samples in parallel, and runs by these solvers."""

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._interrupts import carry_runs, runs_of
from symmb._types import Array
from symmb.equations import model
from symmb.equations.model import DAE
from symmb.equations.start import Start
from symmb.run.codegen import Engine, FixedStep, Lanes, StepTolerances, require_compiler
from symmb.run.events import events_of, longest_step
from symmb.run.integrate.integration import Integration, Run
from symmb.run.integrate.projection import sampled_jets
from symmb.run.integrate.side_walk import stops_at
from symmb.run.integrate.solver import Solver

if TYPE_CHECKING:
    from symmb.run.codegen import Card


class Task(NamedTuple):
    """The quantities that the engine computes.

    Attributes
    ----------
    times : (n_t,)          output times [s]
    y : (x, p, t) -> (n_y,) outputs; with `work`, the integral of the power follows them
    order : int             if above 0, x and p are the Taylor coefficients of `InitialValueProblem.jets`
    work : bool             whether the power of forces without potential is integrated too [J]
    start : Start           compiled too, unless it is large; None if the caller gives the state of each run
    alone : bool            whether runs work without Python. Then the start is always compiled, and the C code locates
                            switches
    """

    dae: DAE
    times: Array
    y: ca.Function
    order: int = 0
    work: bool = False
    start: Start | None = None
    alone: bool = False


class CompiledSolver(Solver):
    """A solver with steps that the engine makes for many samples in parallel."""

    needs_compiler: ClassVar[bool] = True

    def runs_in_lanes(self, dae: DAE) -> bool:
        return True

    def step_control(self, dae: DAE, times: Array, order: int = 0, n_quad: int = 0) -> StepTolerances | FixedStep:
        """The step control in the engine, for Taylor coefficients up to `order` and `n_quad` integrals along the
        motion."""
        return self.tolerances(dae, order, n_quad) if self.controls_step else FixedStep(self.fixed_step(times))

    def engine(self, task: "Task", card: "Card | None" = None) -> Engine:
        """The engine that makes the runs in compiled C code, or on a graphics card.

        Raises
        ------
        NoCompilerError
            If there is no C compiler that can build the engine
        DeclarationError
            If cards do not run this solver
        """
        if card is not None:
            return card.engine(self.lanes(task), task.times)
        impacts = task.dae.impacts
        events = f", which locates the events of {impacts_text(impacts)}," if impacts else ""
        require_compiler(f"{self!r}{events}")
        return Engine(self.lanes(task), task.times)

    @abstractmethod
    def lanes(self, task: "Task") -> Lanes:
        """The equations and the method of the engine.

        Raises
        ------
        DeclarationError
            If there are switches that only Python locates
        """

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        return CompiledIntegration(self, dae, times, order, work)

    def limited_control(self, dae: DAE, times: Array, order: int, n_quad: int) -> StepTolerances | FixedStep:
        """The step control, with steps that are shorter than every pulse of a function of time."""
        self.require_affordable(times)
        control = self.step_control(dae, times, order, n_quad)
        if isinstance(control, FixedStep):
            return control
        longest = min(longest_step(dae, times), control.longest or np.inf)
        return replace(control, longest=longest if np.isfinite(longest) else 0.0)


class CompiledIntegration(Integration):
    """An integration in which the engine computes the states.

    `fixed_steps` makes the same fixed steps one by one, for runs that advance together; None if the scheme has no fixed
    step.
    """

    def __init__(
        self,
        solver: CompiledSolver,
        dae: DAE,
        times: Array,
        order: int,
        work: bool,
        fixed_steps: Callable[[], Integration] | None = None,
    ) -> None:
        n_x, n_p = (dae.n_q + dae.n_v + dae.n_s) * (order + 1), len(dae.p_names) * (2 if order else 1)
        x, p, t = ca.SX.sym("x", n_x), ca.SX.sym("p", n_p), ca.SX.sym("t")
        states = ca.Function("states", [x, p, t], [sampled_jets(dae, x, p, t, order)])
        self.engine = solver.engine(Task(dae, times, states, order, work))
        self.times, self.n_x, self.n_quad = times, n_x, self.engine.n_y - n_x
        self._fixed_steps = fixed_steps

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        x0 = np.hstack([x0, np.zeros((len(x0), self.n_quad))])
        try:
            Y, failed_samples = self.engine.values(x0, p, threads)
        except KeyboardInterrupt as interrupt:
            runs = [Run(y[:, : self.n_x], y[:, self.n_x :], message="interrupted") for y in runs_of(interrupt)]
            carry_runs(interrupt, runs)
            raise
        runs = [
            Run(y[:, : self.n_x], y[:, self.n_x :], t, "" if np.isnan(t) else why)
            for y, t, why in zip(Y, failed_samples.t_failed.tolist(), failed_samples.reasons, strict=True)
        ]
        if (contacts := self.engine.contacts) is not None:
            events = events_of(failed_samples.events, contacts, len(p))
            runs = [replace(run, events=own) for run, own in zip(runs, events, strict=True)]
        if (passes := failed_samples.passes) is None:
            return runs
        return [replace(run, stops=stops_at(own)) for run, own in zip(runs, passes, strict=True)]

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        if self._fixed_steps is None:
            raise PropagationError("Lockstep needs a solver with a fixed step, such as RungeKutta().")
        yield from self._fixed_steps().march(x0, p)

    def statistics(self) -> dict[str, int]:
        counts = self.engine.counts
        named = {"steps": counts.steps, "nonlinear iterations": counts.iterations, "most in a step": counts.most}
        named["choices of coordinates"] = counts.choices
        return {name: count for name, count in named.items() if count}


def impacts_text(impacts: "model.Impacts") -> str:
    """The impacts by name, for messages."""
    titles = () if impacts.joints is None else impacts.joints.titles
    return ", ".join(dict.fromkeys([*(f"Impact {name!r}" for name in impacts.names), *titles]))
