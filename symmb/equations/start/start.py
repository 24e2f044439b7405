"""Start: coordinates and velocities that satisfy the constraints, for one or many samples, on one assembly branch.

At the nominal parameters, unlisted coordinates start from their guess, and the smallest change with Phi = 0 is
computed. The coordinates that the constraints determine are chosen once; all other coordinates stay at their values.
For every sample, the same coordinates are computed, starting from the nominal solution. Velocities follow from
positions by linear equations.
"""

import math
from dataclasses import dataclass
from functools import reduce

import casadi as ca
import numpy as np

from symmb._magnitudes import ROUNDING
from symmb._types import Array
from symmb.declare.symbolic import batch, evaluated, jet_function, saddle_solver
from symmb.equations.model import DAE, Scales, is_linear
from symmb.equations.start.implicit_function import LAST_DIGITS, ImplicitMap
from symmb.equations.start.residual_limits import VIOLATION
from symmb.equations.start.scales import distances, length_of, power_of_two, sizes_of_parts


@dataclass(frozen=True)
class Start:
    """The start of a scene as a map from parameters to states. It can be pickled."""

    dae: DAE
    t0: float
    q_nominal: Array
    reference: ca.Function  # p, q_nominal -> coordinates before the solution
    position: ImplicitMap  # p -> u
    state: ca.Function  # u, p -> x
    holds: ca.Function  # x, u, p -> conditions, 1 for satisfied conditions
    velocities: ca.Function  # q, p -> v, of the bodies
    listed: tuple[str, ...]  # coordinates that the scene lists
    listed_velocities: tuple[str, ...]  # velocities that the scene lists
    solved: tuple[str, ...]  # unknown coordinates
    free: tuple[str, ...]  # coordinates that keep their assembled values
    solved_velocities: tuple[str, ...]  # velocities that the constraints determine
    free_velocities: tuple[str, ...]  # velocities that nothing determines
    joint_residuals: ca.Function | None  # (q, v, p) -> residuals of the listed `joint_values`
    joint_values: tuple[str, ...]
    rows: tuple[int, ...] | None  # rows that determine the motion if rows are redundant, else None
    nullities: tuple[int, int]  # vanishing combinations of these rows, and of the position rows among them
    ranks: tuple[int, int]  # ranks of all rows and of the position rows
    redundant: tuple[str, ...]  # constraints with dependent rows
    is_equilibrium: bool  # whether the start is a static equilibrium; such starts are not compiled
    doubts: tuple[str, ...]  # warnings about the start at the nominal parameters
    held: tuple[int, ...]  # displacements that are not unknowns

    @property
    def compiles(self) -> bool:
        """Whether starts are compiled like runs."""
        n_u, n_x = (self.state.numel_in(0), self.state.numel_out(0))
        # Starts are compiled for scenes with at most this number of states. With more states, compilation takes
        # longer than it saves in runs.
        return not self.is_equilibrium and n_u <= n_x <= 100

    def states(self, P: Array) -> tuple[Array, tuple[str, ...]]:
        """Start states (N, n_x) of samples P (N, n_p), nan for failed starts, and reasons for failures (else '')."""
        u, ok = self.position.solve(P)
        x = batch(self.state, u, P)[0]
        ok = ok & (batch(self.holds, x, u, P)[0] > 0).all(axis=1)
        reasons = ["" if good else "the start could not be computed" for good in ok.tolist()]
        values = batch(self.dae.positive, P)[0]
        for k, which in np.argwhere(~(values > 0)).tolist()[::-1]:  # the first fault of each sample remains
            reasons[k] = f"{self.dae.positive_names[which]} is {values[k, which]:g}, not positive"
        started = np.array([not reason for reason in reasons], dtype=bool)
        return np.where(started[:, None], x, np.nan), tuple(reasons)

    def nominal(self) -> dict[str, Array]:
        """The start at the nominal parameters: q (n_q,), v (n_v,), s (n_s,) and p (n_p,)."""
        x = self.states(self.dae.p_nominal[None])[0][0]
        q, v, s = np.split(x, [self.dae.n_q, self.dae.n_q + self.dae.n_v])
        return {"q": q, "v": v, "s": s, "p": self.dae.p_nominal}

    def scales(self, dae: DAE, span: float) -> Scales:
        """Scales of the motion over a span [s] at the nominal parameters, as powers of 2.

        If the motion starts at the origin, the length is the distance that speeds and accelerations cover in this time.
        """
        at = self.nominal()
        x = (at["q"], at["v"], *([at["s"]] if dae.n_s else []), at["p"], self.t0)
        G = evaluated(dae.G, *map(np.atleast_1d, x)) if dae.G is not None else np.zeros((0, dae.n_v))
        length = length_of(dae, at["q"], G)
        linear = np.array([is_linear(name) for name in dae.v_names], dtype=bool)
        far = float(distances(dae, x, span)[linear].max(initial=0.0))
        if length <= ROUNDING * far:  # coordinates that small are rounding of an assembly
            length = far
        length = power_of_two(length)
        scaled = dae.scaled(lambda: Scales(length)).displacement_scales
        inertia = np.diag(batch(dae.inertia, *map(np.atleast_1d, x), np.eye(dae.n_v))[0]) if dae.n_v else np.zeros(0)
        energy = power_of_two(float((inertia * scaled**2).max(initial=0.0)))
        rows = np.abs(G * scaled).max(axis=1, initial=0.0)
        states, rate = sizes_of_parts(dae, x, G, span, Scales(length).size)
        return Scales(length, energy, np.array([power_of_two(float(row)) for row in rows]), states, rate)

    def equations(self, p: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The equations of `states` for generated code: unknowns u (n_u,), Newton's step of u, and the state (n_x,).

        The state is nan if the solution u violates rows or parameters p (n_p,) have impossible values.
        """
        u = ca.SX.sym("u", self.state.numel_in(0))
        J, r = self.position.jacobian(u, p), self.position.residual(u, p)
        newton = saddle_solver(ca.SX.eye(u.numel()), J, [1] * u.numel())(ca.SX(u.numel(), 1), r)[0]
        rounded = ca.fabs(r) <= LAST_DIGITS * ca.sum2(ca.fabs(J))
        # Near singular positions, steps are rounding errors and never become small. Such steps must end the iteration.
        newton = ca.if_else(_all(rounded), 0, newton)
        state = self.state(u, p)
        good = _all(ca.vertcat(self.holds(state, u, p), self.dae.positive(p) > 0))
        return u, newton, state + ca.if_else(good, 0, math.nan)

    def jets(self, p: Array, directions: Array, order: int) -> list[Array]:
        """Taylor coefficients x_0, ..., x_k of the start along directions, each (m, n_x), at p (n_p,) or (m, n_p)."""
        P0, zeros = np.array(np.broadcast_to(p, directions.shape)), [np.zeros_like(directions)] * (order - 1)
        P = [P0, directions, *zeros][: order + 1]
        u = self.position.jets(self.position.solve(P0)[0], P)
        return list(batch(jet_function(self.state, order + 1), *u, *P))


def start_functions(
    dae: DAE, t0: float, unknowns: tuple[ca.SX, ca.SX], q: ca.SX, v: ca.SX, listed: ca.Function | None, implied: ca.SX
) -> tuple[ca.Function, ca.Function]:
    """The Functions `state` and `holds` of a start with coordinates q (n_q,) and velocities v (n_v,).

    Coordinates and velocities are expressions of the `unknowns` u and the parameters p. The conditions `holds` check
    all constraint rows, the Function (q, v, p) `listed` and the expressions `implied`. Newton's method solves only
    independent rows, and may converge to the flipped root.
    """
    u, p = unknowns
    x = ca.densify(ca.vertcat(q, v, *([dae.s_start(q, p)] if dae.s_start is not None else [])))
    if dae.sampling is not None:
        arguments = dae.arguments(x, p, ca.SX(t0))
        x = ca.densify(ca.vertcat(*arguments[:2], dae.sampling.held(*arguments)))
    y = ca.SX.sym("x", x.numel())
    arguments = dae.arguments(y, p, ca.SX(t0))
    rows = [f(*arguments) / dae.row_scales[: f.numel_out(0)] for f in (dae.Phi, dae.Phi_dot) if f is not None]
    rows += [listed(*arguments[:2], p)] if listed is not None else []
    scales = np.concatenate([dae.coordinate_scales, dae.displacement_scales, np.ones(dae.n_s)])
    limit = VIOLATION * reduce(ca.fmax, ca.vertsplit(ca.fabs(y / scales)), ca.SX(1))
    none = ca.SX(0, 1)
    conditions = [ca.fabs(ca.vertcat(none, *rows)) <= limit, ca.fabs(ca.vertcat(none, implied)) <= VIOLATION]
    if dae.assembly_cosines is not None:
        conditions.append(dae.assembly_cosines(y[: dae.n_q], p) > 0)
    holds = ca.Function("holds", [y, u, p], [ca.densify(ca.vertcat(ca.SX(1), *conditions))])
    return ca.Function("state", [u, p], [x]), holds


def _all(conditions: ca.SX) -> ca.SX:
    return reduce(ca.logic_and, ca.vertsplit(conditions), ca.SX(1))
