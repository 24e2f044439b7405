"""The formulation in which a scene runs, in coordinates of its bodies or in coordinates of its joints."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._types import Array
from symmb.declare.symbolic import batch, common, least_factorization, shared
from symmb.declare.symbolic import t as time_symbol
from symmb.equations.model import DAE, Lazy, Scene, System, compile_dae
from symmb.equations.start import Singularity, Start, prepare_start, singularity, start_in_joints, with_gated_rows
from symmb.run.events import Kinks, Pulses, kinks, parameter_switches
from symmb.run.formulations.output_functions import declared_function, joint_output_function, output_function
from symmb.run.integrate import Run, Solver

_STAGE = 8
"""Number of operations for sums of slopes, for each state and each stage of an explicit step."""
_CHEAPER = 0.8
"""Coordinates of joints are chosen if their operations, over those in coordinates of bodies, are below this ratio.
For the same error, they take up to a fifth more steps (double pendulum, heavy top, four-bar)."""


@dataclass(frozen=True, eq=False)
class Formulation:
    """Equations, start and outputs in the same coordinates.

    Attributes
    ----------
    dae : DAE
    start : Start
    y : (x, p, t) -> outputs (n_y,)
    declared : (x, p, t, multipliers, accelerations of the bodies) -> outputs (n_y,)
    bodies : InBodies          the bodies, if the coordinates are those of joints
    why : str                  why these coordinates are chosen; empty for coordinates of bodies, or if they are given
    judging : equations with the scales of bodies that move along joints, and with fewer operations than `dae`
    """

    dae: DAE
    start: Start
    y: ca.Function
    declared: ca.Function
    bodies: "InBodies | None" = None
    why: str = ""
    judging: Lazy[DAE] | None = None

    @cached_property
    def judged(self) -> DAE:
        """The equations with the scales that checks of runs use."""
        return self.dae if self.judging is None else self.judging().around(self.dae.p_nominal)

    def around(self, p: Array) -> "Formulation":
        """The formulation for runs with parameters p (n_p,)."""
        return replace(self, dae=self.dae.around(p))

    def kinks(self, times: Array) -> Kinks | None:
        """Kinks and jumps over the output times (n_t,), if there are any."""
        return self.dae.remembered(kinks, times)

    @cached_property
    def parameter_switches(self) -> ca.Function | None:
        """Kinks and jumps of parameters alone; see `events.parameter_switches`."""
        return parameter_switches(self.dae, self.y)

    def pulses(self, times: Array) -> Pulses:
        """Pulses of functions of time over the output times (n_t,)."""
        return self.dae.remembered(Pulses, times)

    def singularity(self, X: Array, times: Array, p: Array) -> Singularity | None:
        """The position closest to a singular one, among the finite states X (m, n_x) at `times` (m,); None if no state
        is close."""
        finite = np.isfinite(X).all(axis=1)
        dae, X = self.in_bodies(X[finite], p)
        return singularity(self.judged if self.bodies is None else dae, X, p, times[finite])

    def in_bodies(self, X: Array, p: Array) -> tuple[DAE, Array]:
        """The equations of the bodies, and the states (m, n_x) of the bodies for states X of this formulation."""
        return (self.dae, X) if self.bodies is None else (self.bodies.dae, batch(self.bodies.states(), X, p)[0])

    def run_of_bodies(self, run: Run, p: Array) -> Run:
        """A copy of a run with the states of the bodies. `p` (n_p,) are the parameters of the run."""
        return replace(run, X=self.in_bodies(run.X, p)[1])

    @property
    def has_loops(self) -> bool:
        """Whether the Jacobian of the rows changes along the motion. If not, no position is singular."""
        return self.dae.G is not None and self.dae.G.jac_sparsity(0, 0).nnz() > 0

    @property
    def operations(self) -> int:
        """Number of operations of a stage of an explicit step."""
        return self.dae.rhs.n_instructions() + _STAGE * self.y.numel_in(0)

    @property
    def least_operations(self) -> int:
        """Number of operations of a stage for the rows of constraints and their factors. Other equations are not
        derived for this number."""
        gamma, G = self.dae.gamma, self.dae.G
        rows = 0 if gamma is None or G is None else gamma.n_instructions() - gamma.nnz_out(0) + least_factorization(G)
        return rows + _STAGE * self.y.numel_in(0)


@dataclass(frozen=True, eq=False)
class InBodies:
    """The bodies of a scene that runs in coordinates of its joints. Unless said otherwise, x are states of the joints.

    Attributes
    ----------
    dae : DAE                 equations of the bodies
    states : (x, p)           states of the bodies
    joints : (x, p)           states of the joints, within half a turn, for states x of the bodies
    loads : (x, p, t)         forces Q (n_v,) on the bodies, and the Jacobian G (n_r, n_v) of all rows of the system;
                              None in a copy from a pickle
    carried : pairs           name of a joint, and index of the body that it carries; carriers come first
    """

    dae: DAE
    states: Lazy[ca.Function]
    joints: Lazy[ca.Function]
    loads: Lazy[ca.Function] | None
    carried: tuple[tuple[str, int], ...]


class _Loads(Lazy[ca.Function]):
    """The function `InBodies.loads`. It is None in a pickle, because it is large and only proofs need it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return type(None), ()


class Formulations(NamedTuple):
    """A scene in coordinates of its bodies and in coordinates of its joints.

    Attributes
    ----------
    bodies : Formulation           formulation in coordinates of the bodies
    joints : Formulation or None   formulation in coordinates of the joints, if the scene runs in them
    spare : Formulation or None    formulation in joints that is not used, because it has more operations
    """

    bodies: Formulation
    joints: Formulation | None
    spare: Formulation | None

    def of(self, solver: Solver) -> Formulation:
        """The formulation in which a solver runs."""
        return self.joints if self.joints is not None and solver.takes_any_coordinates else self.bodies

    @property
    def least_constrained(self) -> Formulation:
        """The formulation with the fewest rows of constraints."""
        return min(filter(None, self), key=lambda form: form.dae.n_r)

    def around(self, p: Array) -> "Formulations":
        """The formulations for runs with parameters p (n_p,)."""
        return Formulations(self.bodies.around(p), *(form and form.around(p) for form in self[1:]))


def formulations(scene: Scene) -> Formulations:
    """A scene in coordinates of its bodies and, if possible, of its joints. The scene stores the result."""
    with kept_interrupts():
        return scene.remembered(formulations, lambda: _formulations(scene))


def _formulations(scene: Scene) -> Formulations:
    bodies = _in_bodies(scene)
    if scene.coordinates == "body" or (scene.system.collected.gated and not scene.coordinates):
        return Formulations(bodies, None, None)
    system = scene.system.joint_space()
    if turns := system.joints.whole_turns(bodies.start.q_nominal):
        system = scene.system.joint_space(turns)
    joints = _in_joints(scene, bodies, system) if system.joints.names else None
    if joints is None and scene.coordinates == "joint":
        why = "it starts close to a singular position" if system.joints.names else "no joint carries a rigid body"
        raise DeclarationError(f'Scene {scene.name!r}: coordinates="joint" are not possible: {why}.')
    if joints is None:
        return Formulations(bodies, None, None)
    rhs = Lazy(lambda: _along_joints(scene.system, joints.dae, system))
    moved = replace(bodies.dae, equations={**bodies.dae.equations, "rhs": rhs})
    scales = _scaled(moved, bodies.start, scene).measured
    beside = replace(bodies, judging=Lazy(lambda: bodies.dae.scaled(scales)))
    if scene.coordinates:
        return Formulations(beside, joints, None)
    least = bodies.least_operations
    counted = joints.operations > _CHEAPER * least
    if counted and joints.operations > _CHEAPER * bodies.operations:
        return Formulations(bodies, None, joints)
    of_bodies = f"{bodies.operations}" if counted else f"more than {least}"
    why = f"coordinates of joints, which take fewer operations: {joints.operations} instead of {of_bodies}"
    return Formulations(beside, replace(joints, why=why), None)


def _in_bodies(scene: Scene) -> Formulation:
    dae, gated = compile_dae(scene.system), scene.system.collected.gated
    if gated:
        closed = [k for name, at in dae.rows.items() if gated.get(name, True) for k in range(at.start, at.stop)]
        start = prepare_start(scene, compile_dae(scene.system.keeping(closed)))
        start = with_gated_rows(start, dae, gated)
    else:
        start = prepare_start(scene, dae)
    if start.rows is not None:
        dae = compile_dae(scene.system, start.rows, start.nullities)
    dae = replace(_scaled(dae, start, scene), sampling=start.dae.sampling)
    declared = declared_function(scene, scene.system, scene.y)
    return Formulation(dae, start, output_function(dae, scene, scene.y), declared)


def _in_joints(scene: Scene, bodies: Formulation, system: System) -> Formulation | None:
    start = start_in_joints(bodies.start, scene, system)
    if start is None:
        return None
    x = ca.vertcat(system.q, system.v, system.s)
    at = start.nominal()
    place = ca.Function("place", [x, system.p], [system.joints.of_bodies[0]])
    state = place(np.concatenate([at["q"], at["v"], at["s"]]), at["p"]).full().ravel()
    joints = system.joints.with_signs(state, bodies.start.nominal()["q"])
    declared = declared_function(scene, system, joints.expression(ca.densify(scene.y)))
    y = joint_output_function(bodies.dae, start.dae, scene, system, joints, declared)

    def states() -> ca.Function:
        return common("of_bodies", [x, system.p], [ca.densify(ca.vertcat(*joints.of_bodies))])

    def of_joints() -> ca.Function:
        x = ca.vertcat(scene.system.q, scene.system.v, scene.system.s)
        return common("of_joints", [x, scene.system.p], [ca.densify(ca.vertcat(*joints.of_joints))])

    def loads() -> ca.Function:
        return common("loads", [x, system.p, time_symbol], joints.expressions([scene.system.Q, scene.system.G]))

    carried = tuple((link.carrying.joint.name, link.body) for link in joints.links if link.carrying is not None)
    in_bodies = InBodies(bodies.dae, Lazy(states), Lazy(of_joints), _Loads(loads), carried)
    return Formulation(_scaled(start.dae, start, scene), start, y, declared, in_bodies)


def _along_joints(bodies: System, dae: DAE, joints: System) -> ca.Function:
    """The function `DAE.rhs` of the bodies, from the equations `dae` of the joints. The function from the equations of
    the bodies has many more operations."""
    p, t, x = bodies.p, time_symbol, ca.vertcat(joints.q, joints.v, joints.s)
    there, states = ca.vertcat(*joints.joints.of_joints), ca.vertcat(*joints.joints.of_bodies)
    rates = ca.vertcat(*dae.rhs.call(list(dae.arguments(x, p, t))))
    moved = ca.Function("moved", [x, p, t], [ca.jtimes(states, x, rates)])(there, p, t)
    parts = [part for part in (bodies.q, bodies.v, bodies.s) if part.numel()]
    ends = np.cumsum([0, *[part.numel() for part in parts]]).tolist()
    return ca.Function("rhs", [*parts, p, t], shared(ca.vertsplit(ca.densify(moved), ends)))


def _scaled(dae: DAE, start: Start, scene: Scene) -> DAE:
    return dae.scaled(lambda: start.scales(dae, float(np.ptp(scene.times))))
