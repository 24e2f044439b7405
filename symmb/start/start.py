"""Starting: coordinates and velocities that satisfy the constraints, for one sample or many, on one assembly branch.

At the nominal parameters the coordinates that are not listed start from their guess and are moved least until Phi =
0. Which of them the constraints determine is decided there, once; the rest stay where they are. Every sample then
solves for the same ones from the nominal solution. Velocities are linear: dependent ones follow by minimum norm.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array, Mask
from symmb.model import DAE, Scales, Scene, is_linear
from symmb.start.equilibrium import balance, settle
from symmb.start.implicit_function import ImplicitMap
from symmb.start.initial_assembly import assemble, check_assembly_cosines, coordinate_of, kept_rows, owner, placed, rest
from symmb.start.rank import independent, left_out, redundant_names
from symmb.start.scales import at_rest, in_units, length_of
from symmb.symbolic import batch, jet_function, saddle_solver, symmetric_solver

_SMALL = 100
"""States up to which starts are compiled: beyond, runs take much longer than starts, and compilers too."""
_CONTRADICTION = 1e-7
"""Violation of rows at the start that counts, as a share of the largest coordinate or velocity, or of 1."""


@dataclass(frozen=True)
class Start:
    """The start of a scene as a map from parameters to states; pickles.

    `held`, `solved` and `free` name the coordinates that were listed, solved for, and left where assembly put them.
    `kept` are the numbers of independent constraint rows where rows of the constraints named by `redundant` depend on
    each other, or None. `balanced` is a start in static equilibrium, which is too much to compile.
    """

    dae: DAE
    t0: float
    q_nominal: Array
    reference: ca.Function  # p, q_nominal -> coordinates before they are solved for
    listed_v: ca.Function  # p -> listed velocities, 0 elsewhere
    place: ca.Function  # u, p -> q
    position: ImplicitMap | None
    velocity: ImplicitMap | None
    spread: ca.Function | None  # mu, q, p -> v
    held: tuple[str, ...]
    listed_velocities: tuple[str, ...]
    solved: tuple[str, ...]
    free: tuple[str, ...]
    kept: tuple[int, ...] | None
    redundant: tuple[str, ...]
    balanced: bool

    @property
    def compiles(self) -> bool:
        """Whether starts are compiled as well."""
        return not self.balanced and self.dae.n_q + self.dae.n_v + self.dae.n_s <= _SMALL

    def states(self, P: Array) -> tuple[Array, tuple[str, ...]]:
        """Starting states of N samples.

        Parameters
        ----------
        P : (N, n_p) array

        Returns
        -------
        (N, n_x) array         x = (q, v, s), nan where the start could not be solved
        tuple of N str         why it could not, empty where it could
        """
        ok: Mask = np.ones(len(P), dtype=bool)
        u = np.zeros((len(P), self.place.numel_in(0)))
        if self.position is not None:
            u, ok = self.position.solve(P)
        q = _rows_of(batch(self.place, u, P)[0], len(P))
        if self.velocity is not None and self.spread is not None:
            w = np.hstack([q, P])
            mu, found = self.velocity.solve(w)
            v = batch(self.spread, mu, w)[0]
            ok = ok & found
        else:
            v = batch(self.listed_v, P)[0]
        parts = [q, _rows_of(v, len(P))]
        if self.dae.s_start is not None:
            parts.append(_rows_of(batch(self.dae.s_start, q, P)[0], len(P)))
        x = np.hstack(parts)
        ok = ok & ~self._contradiction(x, P)
        reasons = ["" if good else "the start could not be solved for" for good in ok.tolist()]
        values = _rows_of(batch(self.dae.positive, P)[0], len(P))
        for k, which in np.argwhere(~(values > 0))[::-1].tolist():  # the first of each sample is told
            reasons[k] = f"{self.dae.positive_names[which]} is {values[k, which]:g}, not positive"
        started = np.array([not reason for reason in reasons], dtype=bool)
        return np.where(started[:, None], x, np.nan), tuple(reasons)

    def nominal(self) -> dict[str, Array]:
        """The start at the nominal parameters: q (n_q,), v (n_v,), s (n_s,) and p (n_p,)."""
        x = self.states(self.dae.p_nominal[None])[0][0]
        q, v, s = np.split(x, [self.dae.n_q, self.dae.n_q + self.dae.n_v])
        return {"q": q, "v": v, "s": s, "p": self.dae.p_nominal}

    def scales(self, dae: DAE, span: float) -> Scales:
        """Of the motion over a span [s] of the DAE that this is the start of, at the nominal parameters; powers of 2.

        Where it starts at the origin, the length is the way that speeds and accelerations lead from there.
        """
        at = self.nominal()
        x = (at["q"], at["v"], *([at["s"]] if dae.n_s else []), at["p"], self.t0)
        G = dae.G(*x).full() if dae.G is not None else np.zeros((0, dae.n_v))
        length = length_of(dae, at["q"], G)
        if not length:
            way = np.abs(at["v"]) * span + np.abs(dae.rhs(*x)[1].full().ravel()) * span**2 / 2
            length = max((s for name, s in zip(dae.v_names, way.tolist(), strict=True) if is_linear(name)), default=0.0)
        length = _power(length)
        scaled = replace(dae, scales=Scales(length)).displacement_scales
        energy = _power(float((np.diag(dae.M(*x).full()) * scaled**2).max(initial=0.0)))
        rows = np.abs(G * scaled).max(axis=1, initial=0.0)
        return Scales(length, energy, np.array([_power(float(row)) for row in rows]))

    @property
    def units(self) -> Array:
        """What states are measured by, (n_x,)."""
        return np.concatenate([self.dae.coordinate_scales, self.dae.displacement_scales, np.ones(self.dae.n_s)])

    def _contradiction(self, x: Array, P: Array) -> Mask:
        """Whether samples violate rows that were not needed to solve for the start, (N,)."""
        bad: Mask = np.zeros(len(P), dtype=bool)
        n = self.dae.n_q
        arguments = (x[:, :n], x[:, n : n + self.dae.n_v], *((x[:, n + self.dae.n_v :],) if self.dae.n_s else ()))
        limit = _CONTRADICTION * np.abs(x / self.units).max(axis=1, initial=1.0)
        for f in (self.dae.Phi, self.dae.Phi_dot):
            if f is not None:
                r = batch(f, *arguments, P, np.array([self.t0]))[0]
                bad = bad | ~(np.abs(r / self.dae.row_scales[: r.shape[1]]).max(axis=1) <= limit)
        return bad

    def equations(self, x: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        """What `states` does, for generated code.

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
            newton, _ = saddle_solver(ca.SX.eye(n), J, [1] * n)(ca.SX(n, 1), self.position.residual(u, p))
        q = self.place(u, p)
        v = self.listed_v(p)
        if self.velocity is not None and self.spread is not None:
            w, zero = ca.vertcat(q, p), ca.SX(self.velocity.residual.numel_in(0), 1)
            mu = symmetric_solver(self.velocity.jacobian(zero, w))(self.velocity.residual(zero, w))
            v = self.spread(-mu, w)
        s = [self.dae.s_start(q, p)] if self.dae.s_start is not None else []
        state = ca.densify(ca.vertcat(q, v, *s))
        arguments = self.dae.arguments(state, p, ca.SX(self.t0))
        rows = [f(*arguments) for f in (self.dae.Phi, self.dae.Phi_dot) if f is not None]
        rows = [row / self.dae.row_scales[: row.numel()] for row in rows]
        limit = _CONTRADICTION * reduce(ca.fmax, ca.vertsplit(ca.fabs(state / self.units)), ca.SX(1))
        tests = ca.vertcat(ca.fabs(ca.vertcat(*rows)) <= limit, self.dae.positive(p) > 0)
        good = reduce(ca.logic_and, ca.vertsplit(tests), ca.SX(1))
        return newton, state + ca.if_else(good, 0, math.nan)

    def jets(self, p: Array, directions: Array, order: int) -> list[Array]:
        """Taylor coefficients x_0, ..., x_k of the start along directions, each (m, n_x), at parameters p (n_p,)."""
        m = len(directions)
        P = [np.tile(p, (m, 1)), directions, *(np.zeros_like(directions) for _ in range(order - 1))][: order + 1]
        u = [np.zeros((m, self.place.numel_in(0)))] * (order + 1)
        if self.position is not None:
            u = self.position.jets(self.position.solve(P[0])[0], P)
        q = _function_jets(self.place, [u, P])
        w = [np.hstack(pair) for pair in zip(q, P, strict=True)]
        if self.velocity is not None and self.spread is not None:
            v = _function_jets(self.spread, [self.velocity.jets(self.velocity.solve(w[0])[0], w), w])
        else:
            v = _function_jets(self.listed_v, [P])
        x = [[a, b] for a, b in zip(q, v, strict=True)]
        if self.dae.s_start is not None:
            for parts, s in zip(x, _function_jets(self.dae.s_start, [q, P]), strict=True):
                parts.append(s)
        return [np.hstack([_rows_of(part, m) for part in parts]) for parts in x]


def _power(value: float) -> float:
    return 2.0 ** round(math.log2(value)) if 0 < value < math.inf else 1.0


def _rows_of(a: Array, N: int) -> Array:
    return a if len(a) == N else np.repeat(a, N, axis=0)


def _function_jets(f: ca.Function, curves: Sequence[Sequence[Array]]) -> list[Array]:
    return list(batch(jet_function(f, len(curves[0])), *[a for c in curves for a in c]))


def prepare_start(scene: Scene, dae: DAE) -> Start:
    """Solve for the start at the nominal parameters and decide what every sample solves for.

    Raises
    ------
    AssemblyError              if listed values contradict the constraints, no assembly is found near the guess, a joint
                               is assembled the wrong way round, or the start is a singular position
    """
    system, held = scene.system, scene.held
    t0, p0, p = float(np.asarray(scene.times)[0]), dae.p_nominal, system.p
    before = ca.SX.sym("q_nominal", dae.n_q)
    listed_q = ca.vertcat(*[held.q.get(i, before[i]) for i in range(dae.n_q)]) if dae.n_q else before
    listed_v = ca.vertcat(*[held.v.get(i, ca.SX(0)) for i in range(dae.n_v)]) if dae.n_v else ca.SX(0, 1)
    reference = ca.Function("reference", [p, before], [listed_q])
    free = np.array([i for i in range(dae.n_v) if i not in held.displacements], dtype=np.intp)
    guess = dae.q_neutral.copy()
    for i, value in scene.guesses.items():
        guess[i] = float(ca.Function("guess", [p], [value])(p0))

    modes = [i for i in free if dae.v_names[i].endswith("_dot") and not scene.guess] if scene.equilibrium else []
    q0 = assemble(scene, dae, reference, guess, np.setdiff1d(free, modes), t0)
    check_assembly_cosines(scene, dae, q0)
    dae = in_units(dae, q0, t0)
    G0 = at_rest(dae.G, dae, q0, t0) * dae.displacement_scales if dae.G is not None else np.zeros((0, dae.n_v))
    kept = kept_rows(dae, q0, t0)
    rows, columns = independent(G0[: dae.n_c, free])
    solved, lam0, stiffness = free[columns], np.empty(0), 1.0
    if scene.equilibrium:
        solved = free
        q0, lam0, stiffness = settle(dae, q0, t0, free, rows)
    u = ca.SX.sym("u", len(solved))
    places = ca.Sparsity.triplet(dae.n_v, len(solved), solved.tolist(), list(range(len(solved))))
    delta = ca.SX(ca.DM(places, dae.displacement_scales[solved])) @ u
    q = dae.retract(reference(p, ca.DM(q0)), delta)
    place = ca.Function("place", [u, p], [q], {"cse": True})
    position = None
    if scene.equilibrium:
        share = ca.SX.sym("share", len(rows))  # of the stiffness: as small as displacements, by which Newton ends
        z, lam = ca.vertcat(u, share), ca.SX(ca.DM(lam0)) + stiffness * share
        position = ImplicitMap.of(balance(dae, place(u, p), lam, p, t0, free, rows), z, p)
        place = ca.Function("place", [z, p], [q], {"cse": True})
    elif len(solved) and dae.Phi is not None:
        residual = (dae.Phi(*rest(dae, place(u, p)), p, t0) / dae.row_scales[: dae.n_c])[rows.tolist()]
        position = ImplicitMap.of(residual, u, p)
    velocity, spread = _velocities(dae, listed_v, p, [i for i in range(dae.n_v) if i not in held.v], q0, t0)
    start = Start(
        dae, t0, q0, reference, ca.Function("listed_v", [p], [listed_v]), place, position, velocity, spread,
        held=tuple(scene.start),
        listed_velocities=tuple(dae.v_names[i] for i in held.v),
        solved=tuple(coordinate_of(dae, i) for i in solved),
        free=tuple(placed(dae, i, q0) for i in np.setdiff1d(free, solved)),
        kept=None if kept is None else tuple(kept.tolist()),
        redundant=() if kept is None else redundant_names(G0, dae.rows),
        balanced=scene.equilibrium,
    )  # fmt: skip
    _check_velocities(start, p0)
    if kept is not None:
        _check_accelerations(start, G0)
    return start


def _velocities(
    dae: DAE, listed: ca.SX, p: ca.SX, free: list[int], q0: Array, t0: float
) -> tuple[ImplicitMap | None, ca.Function | None]:
    """Velocities v = listed + E G' mu with G v + Phi_t = 0; mu for independent rows only."""
    if dae.G is None or dae.Phi_dot is None:
        return None, None
    A = (at_rest(dae.G, dae, q0, t0) * dae.displacement_scales)[:, free]
    rows, _ = independent(A)
    if not rows.size:
        return None, None
    q = ca.SX.sym("q", dae.n_q)
    mu = ca.SX.sym("mu", len(rows))
    s = (ca.SX(dae.n_s, 1),) if dae.n_s else ()
    keep = np.zeros(dae.n_v)
    keep[free] = dae.displacement_scales[free] ** 2
    G = dae.G(q, ca.SX(dae.n_v, 1), *s, p, t0) / dae.row_scales
    v = listed + keep * (G[rows.tolist(), :].T @ mu)
    w = ca.vertcat(q, p)
    residual = (dae.Phi_dot(q, v, *s, p, t0) / dae.row_scales)[rows.tolist()]
    return ImplicitMap.of(residual, mu, w), ca.Function("spread", [mu, w], [ca.densify(v)], {"cse": True})


def _check_velocities(start: Start, p0: Array) -> None:
    dae = start.dae
    reason = start.states(p0[None])[1][0]
    if not reason:
        return
    if "positive" in reason:
        raise AssemblyError(f"Start at the nominal parameters: {reason}.")
    q = start.q_nominal
    v = np.asarray(start.listed_v(p0)).ravel()
    if dae.Phi_dot is None:
        raise AssemblyError("Start could not be solved for at the nominal parameters.")
    if start.velocity is not None and start.spread is not None:
        w = np.hstack([q, p0])[None]
        v = batch(start.spread, start.velocity.solve(w)[0], w)[0][0]
    s = (np.zeros(dae.n_s),) if dae.n_s else ()
    r = np.abs(np.asarray(dae.Phi_dot(q, v, *s, p0, start.t0))).ravel()
    listed = ", ".join(start.listed_velocities)
    remedy = f"Leave one of {listed} free." if listed else "None is listed in start: constraints contradict each other."
    name = owner(dae, int(r.argmax()))
    raise AssemblyError(f"Start velocities contradict the constraints: rate {r.max():.2g} in joint {name!r}. {remedy}")


def _check_accelerations(start: Start, G: Array) -> None:
    """Raise AssemblyError if redundant rows agree on positions and velocities, but not on accelerations."""
    dae, at = start.dae, start.nominal()
    if dae.gamma is None:
        return
    x = (at["q"], at["v"], *([at["s"]] if dae.n_s else []), at["p"], start.t0)
    gamma = dae.gamma(*x).full().ravel() / dae.row_scales
    off = np.abs(left_out(G / dae.row_scales[:, None]).T @ gamma)
    if off.max(initial=0.0) > _CONTRADICTION * max(np.abs(gamma).max(initial=0.0), 1.0):
        names = ", ".join(map(repr, start.redundant))
        raise AssemblyError(f"The accelerations that {names} ask for at the start contradict each other.")
