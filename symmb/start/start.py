"""Starting: coordinates and velocities that satisfy the constraints, for one sample or many, on one assembly branch.

At the nominal parameters the coordinates that are not listed start from their guess and are moved least until Phi =
0. Which of them the constraints determine is decided there, once; the rest stay where they are. Every sample then
solves for the same ones from the nominal solution. Velocities follow from positions by linear equations.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.model import DAE, Scales, is_linear
from symmb.start.implicit_function import ROUNDING, ImplicitMap
from symmb.start.scales import PART_ROUNDING, distances, length_of, power_of_two, sizes_of_parts
from symmb.symbolic import batch, evaluated, jet_function, saddle_solver

MOST_COMPILED_STATES = 100
"""States up to which starts are compiled. With more states runs take much longer than starts, and so do compilers."""
VIOLATION = 1e-7
"""Violation of rows at the start, over the largest coordinate or velocity and over 1, that is a contradiction."""


@dataclass(frozen=True)
class Start:
    """The start of a scene as a map from parameters to states. It can be pickled.

    `listed`, `solved` and `free` name the coordinates that the scene lists, that are solved for, and that stay at their
    assembled values. `listed_velocities`, `solved_velocities` and `free_velocities` name the velocities that the scene
    lists, that the constraints determine, and that nothing determines. Where the rows of the constraints `redundant`
    depend on each other, `rows` are the numbers of those that determine the motion; it is None elsewhere. `nullities`
    count the combinations of these rows, and of the position rows among them, that vanish: where no choice of rows
    stays independent. `ranks` are those of all rows of the scene, and of its position rows.
    `joint_residuals`, a Function (q, v, p), is 0 where the listed `joint_values` hold.
    `is_equilibrium` means a start in static equilibrium, which is not compiled. `doubts` are sentences on what is
    doubtful at the nominal parameters. `held` are the numbers of the displacements that are not solved for.
    """

    dae: DAE
    t0: float
    q_nominal: Array
    reference: ca.Function  # p, q_nominal -> coordinates before they are solved for
    place: ca.Function  # u, p -> q
    position: ImplicitMap | None
    velocities: ca.Function  # q, p -> v
    listed: tuple[str, ...]
    listed_velocities: tuple[str, ...]
    solved: tuple[str, ...]
    free: tuple[str, ...]
    solved_velocities: tuple[str, ...]
    free_velocities: tuple[str, ...]
    joint_residuals: ca.Function | None
    joint_values: tuple[str, ...]
    rows: tuple[int, ...] | None
    nullities: tuple[int, int]
    ranks: tuple[int, int]
    redundant: tuple[str, ...]
    is_equilibrium: bool
    doubts: tuple[str, ...]
    held: tuple[int, ...]
    implied: ca.Function | None = None  # u, p -> what must vanish besides the rows of the constraints

    @property
    def compiles(self) -> bool:
        """Whether starts are compiled as well."""
        return not self.is_equilibrium and self.dae.n_q + self.dae.n_v + self.dae.n_s <= MOST_COMPILED_STATES

    def states(self, P: Array) -> tuple[Array, tuple[str, ...]]:
        """Starting states of N samples.

        Parameters
        ----------
        P : (N, n_p) array

        Returns
        -------
        (N, n_x) array         x = (q, v, s), nan where the start could not be solved
        tuple of N str         the reason if not, else empty
        """
        ok: Mask = np.ones(len(P), dtype=bool)
        u = np.zeros((len(P), self.place.numel_in(0)))
        if self.position is not None:
            u, ok = self.position.solve(P)
        q = _repeat_rows(batch(self.place, u, P)[0], len(P))
        parts = [q, _repeat_rows(batch(self.velocities, q, P)[0], len(P))]
        if self.dae.s_start is not None:
            parts.append(_repeat_rows(batch(self.dae.s_start, q, P)[0], len(P)))
        x = np.hstack(parts)
        if self._sampled is not None:
            x = _repeat_rows(batch(self._sampled, x, P)[0], len(P))
        ok = ok & (batch(self._holds, x, u, P)[0] > 0).all(axis=1)
        reasons = ["" if good else "the start could not be solved for" for good in ok.tolist()]
        values = _repeat_rows(batch(self.dae.positive, P)[0], len(P))
        for k, which in np.argwhere(~(values > 0))[::-1].tolist():  # the first fault of each sample remains
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

        If it starts at the origin, the length is the distance that speeds and accelerations lead in this time.
        """
        at = self.nominal()
        x = (at["q"], at["v"], *([at["s"]] if dae.n_s else []), at["p"], self.t0)
        G = evaluated(dae.G, *map(np.atleast_1d, x)) if dae.G is not None else np.zeros((0, dae.n_v))
        length = length_of(dae, at["q"], G)
        linear = np.array([is_linear(name) for name in dae.v_names], dtype=bool)
        far = float(distances(dae, x, span)[linear].max(initial=0.0))
        if length <= PART_ROUNDING * far:
            length = far
        length = power_of_two(length)
        scaled = dae.scaled(lambda: Scales(length)).displacement_scales
        inertia = np.diag(batch(dae.inertia, *map(np.atleast_1d, x), np.eye(dae.n_v))[0]) if dae.n_v else np.zeros(0)
        energy = power_of_two(float((inertia * scaled**2).max(initial=0.0)))
        rows = np.abs(G * scaled).max(axis=1, initial=0.0)
        states, rate = sizes_of_parts(dae, x, G, span, Scales(length).size)
        return Scales(length, energy, np.array([power_of_two(float(row)) for row in rows]), states, rate)

    @property
    def state_scales(self) -> Array:
        """Scales of the states, (n_x,)."""
        return np.concatenate([self.dae.coordinate_scales, self.dae.displacement_scales, np.ones(self.dae.n_s)])

    @cached_property
    def _holds(self) -> ca.Function:
        """(x, u, p) -> whether a state satisfies all rows and listed values, and no joint is assembled flipped.

        Newton's method may go on to the flipped root, and solves only for rows that are independent.
        """
        n_x = self.dae.n_q + self.dae.n_v + self.dae.n_s
        x, u = ca.SX.sym("x", n_x), ca.SX.sym("u", self.place.numel_in(0))
        p = ca.SX.sym("p", len(self.dae.p_names))
        arguments = self.dae.arguments(x, p, ca.SX(self.t0))
        rows = [f(*arguments) for f in (self.dae.Phi, self.dae.Phi_dot) if f is not None]
        rows = [row / self.dae.row_scales[: row.numel()] for row in rows]
        rows += [self.joint_residuals(*arguments[:2], p)] if self.joint_residuals is not None else []
        limit = VIOLATION * reduce(ca.fmax, ca.vertsplit(ca.fabs(x / self.state_scales)), ca.SX(1))
        holds = [ca.SX(1), ca.fabs(ca.vertcat(*rows)) <= limit]
        if self.dae.assembly_cosines is not None:
            holds.append(self.dae.assembly_cosines(x[: self.dae.n_q], p) > 0)
        if self.implied is not None:
            holds.append(ca.fabs(self.implied(u, p)) <= VIOLATION)
        return ca.Function("holds", [x, u, p], [ca.densify(ca.vertcat(*holds))])

    @cached_property
    def _sampled(self) -> ca.Function | None:
        """(x, p) -> x with the sampled values of the start."""
        if self.dae.sampling is None:
            return None
        x, p = ca.SX.sym("x", self.dae.n_q + self.dae.n_v + self.dae.n_s), ca.SX.sym("p", len(self.dae.p_names))
        at = self.dae.arguments(x, p, ca.SX(self.t0))
        return ca.Function("sampled", [x, p], [ca.vertcat(*at[:2], self.dae.sampling.held(*at))], {"cse": True})

    def state(self, u: ca.SX, p: ca.SX) -> ca.SX:
        """The state (n_x,) of unknowns u (n_u,) that solve the equations of positions."""
        q = self.place(u, p)
        s = [self.dae.s_start(q, p)] if self.dae.s_start is not None else []
        x = ca.densify(ca.vertcat(q, self.velocities(q, p), *s))
        return x if self._sampled is None else self._sampled(x, p)

    def equations(self, x: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The equations of `states` for generated code.

        Parameters
        ----------
        x : (n_x,) SX          whose first entries are the unknowns u
        p : (n_p,) SX

        Returns
        -------
        (n_u,) SX              Newton's step of u
        (n_x,) SX              state of the solution u, nan if it violates rows or parameters have impossible values
        """
        u = x[: self.place.numel_in(0)]
        newton = ca.SX(0, 1)
        if self.position is not None:
            J = self.position.jacobian(u, p)
            n = J.shape[0]
            r = self.position.residual(u, p)
            step, _ = saddle_solver(ca.SX.eye(n), J, [1] * n)(ca.SX(n, 1), r)
            rounded = ca.fabs(r) <= ROUNDING * ca.sum2(ca.fabs(J))
            newton = ca.if_else(reduce(ca.logic_and, ca.vertsplit(rounded)), 0, step)
        state = self.state(u, p)
        tests = ca.vertcat(self._holds(state, u, p), self.dae.positive(p) > 0)
        good = reduce(ca.logic_and, ca.vertsplit(tests))
        return newton, state + ca.if_else(good, 0, math.nan)

    def jets(self, p: Array, directions: Array, order: int) -> list[Array]:
        """Taylor coefficients x_0, ..., x_k of the start along directions, each (m, n_x), at parameters p (n_p,)."""
        m, P = len(directions), parameter_jets(p, directions, order)
        u = [np.zeros((m, self.place.numel_in(0)))] * (order + 1)
        if self.position is not None:
            u = self.position.jets(self.position.solve(P[0])[0], P)
        q = function_jets(self.place, [u, P])
        x = [[a, b] for a, b in zip(q, function_jets(self.velocities, [q, P]), strict=True)]
        if self.dae.s_start is not None:
            for parts, s in zip(x, function_jets(self.dae.s_start, [q, P]), strict=True):
                parts.append(s)
        states = [np.hstack([_repeat_rows(part, m) for part in parts]) for parts in x]
        return states if self._sampled is None else function_jets(self._sampled, [states, P])


def _repeat_rows(a: Array, N: int) -> Array:
    return a if len(a) == N else np.repeat(a, N, axis=0)


def parameter_jets(p: Array, directions: Array, order: int) -> list[Array]:
    """Taylor coefficients of parameters p (n_p,) along directions (m, n_p), each (m, n_p)."""
    zeros = [np.zeros_like(directions)] * (order - 1)
    return [np.tile(p, (len(directions), 1)), directions, *zeros][: order + 1]


def function_jets(f: ca.Function, curves: Sequence[Sequence[Array]]) -> list[Array]:
    """Taylor coefficients of a Function along curves of its arguments, given by their coefficients."""
    return list(batch(jet_function(f, len(curves[0])), *[a for c in curves for a in c]))
