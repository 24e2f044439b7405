"""The state-space method: independent coordinates are integrated, the others follow from the constraints."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, cast

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.codegen import ArrayEngine, StepEnds, Tolerances, Values, model_function
from symmb.integrate.compiled import AnyEngine, CompiledIntegration, CompiledSolver
from symmb.integrate.initial_value_problem import build_problem
from symmb.integrate.integration import Integration, stateless_integration
from symmb.integrate.step_ends import SwitchedProblem, switched
from symmb.model import DAE
from symmb.start import Start, independent_rows_and_columns
from symmb.symbolic import batch, common


@dataclass(frozen=True, repr=False)
class StateSpace(CompiledSolver):
    """Coordinate partitioning: pair of Dormand and Prince in independent coordinates, Newton's method for the others.

    The independent coordinates are chosen anew when they no longer determine the others well. Samples run in Python one
    after the other: the method is for checks, not for speed.

    Parameters
    ----------
    rtol, atol : float
        as of `CVODES`

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0)
    >>> scene = mb.Scene(mb.System(bob, spring), {"bob.x": 1.0}, [0.0, 1.0, 2.0])
    >>> mb.simulate(scene, mb.StateSpace())["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])

    References
    ----------
    Wehage, Haug (1982), Journal of Mechanical Design 104, 247-255.
    """

    meets_switches: ClassVar[bool] = True
    keeps_positions: ClassVar[bool] = True
    gives_derivatives: ClassVar[bool] = False

    rtol: float = 1e-8
    atol: float | None = None

    def has_dense_output(self, dae: DAE) -> bool:
        return True

    def runs_in_lanes(self, dae: DAE) -> bool:
        return False

    def step_control(self, dae: DAE, times: Array, order: int = 0, n_quad: int = 0) -> Tolerances:
        return replace(self.tolerances(dae, order, n_quad), growth=0.0, least=1.0, ahead=0.0)

    def engine(
        self, dae: DAE, times: Array, y: ca.Function, *, order: int = 0, work: bool = False, start: Start | None = None
    ) -> AnyEngine:
        problem = build_problem(dae, None, algebraic=False, work=work)
        frozen = switched(problem, dae, times) or SwitchedProblem(problem, ca.SX(0, 1), StepEnds())
        outputs, problem = y(problem.x, problem.p, problem.t), frozen.problem
        control = cast(Tolerances, self.limited_control(dae, times, order, problem.quad.numel()))
        n_x = problem.x.numel()
        x = ca.vertcat(problem.x, ca.SX.sym("work", problem.quad.numel()))
        projected = None if problem.projected is None else ca.vertcat(problem.projected, x[n_x:, :])
        switches = frozen.switches if frozen.switches.numel() else None
        rates = ca.vertcat(problem.ode, problem.quad)
        outputs = ca.vertcat(outputs, x[n_x:, :])
        f = model_function(x, problem.p, problem.t, rates, outputs, projected, None, switches)
        return _Partitioned(dae, f, times, control, frozen.ends)

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        if not dae.n_v + dae.n_s:
            return stateless_integration(dae, times)
        return CompiledIntegration(self, dae, times, order, work)


_WORSE = 1.5
"""Growth of the condition number of the dependent coordinates after which they are chosen anew. Errors grow with it: a
spatial mechanism is solved 20 to 50 times less accurately with 3 to 100, in up to twice as many steps."""


class _Partitioned(ArrayEngine):
    """Steps of one sample after the other.

    moved : (x, delta, p, t) -> x moved by displacements (n_v,), and there Phi, Phi_dot and G
    """

    together = 1

    def __init__(self, dae: DAE, f: ca.Function, times: Array, control: Tolerances, ends: StepEnds) -> None:
        super().__init__(f, times, control, ends)
        self.width, self._dae, self._held = 1, dae, self.project
        self._rates_there, self._outputs_there = self.rates, self.outputs
        self._choices, self._first_condition = 0, np.inf
        self._dependent: Indices | None = None
        x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        delta, none = ca.SX.sym("delta", dae.n_v), ca.SX(0, 1)
        there = ca.vertcat(dae.retract(x[: dae.n_q, :], delta), x[dae.n_q :, :])
        at = dae.arguments(there, p, t)
        rows = [none if f is None else f(*at) for f in (dae.Phi, dae.Phi_dot)]
        G = ca.SX(0, dae.n_v) if dae.G is None else dae.G(*at)
        self._moved = common("moved", [x, delta, p, t], [ca.densify(e) for e in (there, *rows, G)])
        self.rates, self.outputs, self.project = self._rates, self._completed_outputs, self._renewed

    def functions_of(self, f: ca.Function) -> tuple[Values, Sequence[Values]]:
        """By CasADi: a sample has few values at once."""
        x, p, t, box = f.sx_in()
        at = {"bounds": [box, p, t]}
        parts = zip(f.name_out(), f.call([x, p, t, box]), strict=True)
        functions = [common(name, at.get(name, [x, p, t]), [part]) for name, part in parts]
        return _parameters, [partial(_columns, function) for function in functions]

    def _part(self, x0: Array, p: Array, *others: Any) -> list[Indices]:
        self._dependent, self._choices = None, self.counts.choices
        again = super()._part(x0, p, *others)
        self.counts = replace(self.counts, choices=self._choices)
        return again

    def _rates(self, x: Array, c: Array, t: Array) -> Array:
        """x' at the state whose dependent part follows from the constraints; nan where that is not determined."""
        try:
            return self._rates_there(self._completed(x, c, t), c, t)
        except np.linalg.LinAlgError:
            return np.full(x.shape, np.nan)

    def _completed_outputs(self, x: Array, c: Array, t: Array, out: Array | None = None) -> Array:
        y = self._outputs_there(self._completed(x, c, t) if t[0] > self.times[0] else x, c, t)
        if out is not None:
            out[:] = y
        return y

    def _renewed(self, x: Array, c: Array, t: Array) -> Array:
        """The state where a step begins. It is completed where coordinates are chosen anew."""
        x = x if self._held is None else self._held(x, c, t)
        if self._dependent is None:
            self._choose(x, c, t)
            return x
        y = self._completed(x, c, t)
        condition = self._condition(y, c, t)
        self._first_condition = min(self._first_condition, condition)
        self.begins_anew = condition > _WORSE * self._first_condition
        if self.begins_anew:
            self._choose(y, c, t)
        return y if self.begins_anew else x

    def _choose(self, x: Array, c: Array, t: Array) -> None:
        """Choose the dependent velocities, as many as rows."""
        *_, G = self._at(x, c, t)
        self._dependent = independent_rows_and_columns(G * self._dae.displacement_scales, rank=self._dae.rank)[1]
        self._choices, self._first_condition = self._choices + 1, np.inf

    def _condition(self, x: Array, c: Array, t: Array) -> float:
        """Condition number of the matrix that determines the dependent velocities."""
        *_, G = self._at(x, c, t)
        G = (G * self._dae.displacement_scales)[:, self._dependent]
        return float(np.linalg.cond(G / np.linalg.norm(G, axis=1, keepdims=True))) if G.size else 0.0

    def _at(self, x: Array, c: Array, t: Array, delta: Array | float = 0.0) -> tuple[Array, Array, Array, Array]:
        """The state (n_x,) of x (n, 1) moved by delta (n_v,), and there Phi (n_c,), Phi_dot (n_r,) and G (n_r, n_v)."""
        dae, n_x = self._dae, self._moved.numel_in(0)
        at = x[:n_x, 0], np.broadcast_to(delta, dae.n_v), c[: len(dae.p_names), 0], t
        there, Phi, Phi_dot, G = (value[0] for value in batch(self._moved, *at))
        return there, Phi, Phi_dot, G.reshape(len(Phi_dot), dae.n_v)

    def _completed(self, x: Array, c: Array, t: Array) -> Array:
        """x with its dependent coordinates and velocities moved onto the constraints."""
        dae, which = self._dae, cast(Indices, self._dependent)
        if dae.Phi_dot is None:
            return x
        x = x.copy()
        y, Phi, Phi_dot, G = self._at(x, c, t)
        for _ in range(8 if dae.n_c else 0):
            delta = np.zeros(dae.n_v)
            delta[which] = np.linalg.lstsq(G[: dae.n_c, which], -Phi, rcond=None)[0]
            y, Phi, Phi_dot, G = self._at(y[:, None], c, t, delta)
            if np.abs(delta / dae.displacement_scales).max() < 1e-9:  # Newton is quadratic
                break
        G = G[:, which]
        solved = np.linalg.solve(G, Phi_dot) if dae.vanishing is None else np.linalg.lstsq(G, Phi_dot, rcond=None)[0]
        x[: len(y), 0] = y
        x[dae.n_q + which, 0] -= solved
        return x


def _parameters(x: Array, p: Array, t: Array) -> Array:
    """Values that depend on parameters alone are the parameters."""
    return p


def _columns(f: ca.Function, x: Array, p: Array, t: Array) -> Array:
    """f of samples that are columns."""
    return batch(f, x.T, p.T, t[:, None])[0].T
