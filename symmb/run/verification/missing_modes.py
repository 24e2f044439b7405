"""The effects of deformations that the modes of flexible bodies neglect.

If the neglected deformations of a body have the compliance C at its nodes, loads w there cause the missing
displacements u = C w. If a joint holds a node, the body and other bodies move instead. These bodies move with the
smallest kinetic energy, and modes are stiff. For example, a missing rotation at a weld moves the other end of the body,
and a missing rotation at a loaded end moves nothing else. The slopes of outputs then give the effect on the outputs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare import mechanics, structures
from symmb.declare.mechanics import Constraint, is_flexible
from symmb.declare.symbolic import batch, common
from symmb.declare.symbolic import t as time_symbol
from symmb.equations.model import DAE, Scene
from symmb.run.formulations import Formulation, output_function


@dataclass(frozen=True, eq=False)
class AttachedLoads:
    """Loads at the nodes of a flexible body where joints and forces act.

    Parameters
    ----------
    body : FlexibleBody
    columns : tuple of int     columns of the velocities of the body in the system
    nodes : tuple of int       all nodes that the scene uses, with and without loads
    loaded : tuple of int      nodes at which joints and forces act, in rising order
    wrenches : (6 m,) SX       force and moment at each node, in the axes of the frame of the body
    """

    body: "mechanics.FlexibleBody"
    columns: tuple[int, ...]
    nodes: tuple[int, ...]
    loaded: tuple[int, ...]
    wrenches: ca.SX

    @property
    def rigid(self) -> int:
        """Number of velocities of the frame of the body."""
        return len(self.columns) - len(self.body.modes.stiffness)

    @cached_property
    def responses(self) -> "structures.Responses | None":
        """The responses of the structure to the wrenches; None if the structure is not known."""
        structure = self.body.modes.flexibility
        return None if structure is None or not self.loaded else structure.responses(self.nodes)

    @property
    def remedy(self) -> str:
        """Sentences with a remedy for neglected deformations."""
        structure, count = self.body.modes.flexibility, len(self.body.modes.stiffness)
        if structure is not None and count < structure.of_interfaces:
            return (
                f"The interfaces of the body need {structure.of_interfaces} modes, but count={count} keeps fewer. Omit "
                f"count=, or pass more than {structure.of_interfaces}."
            )
        return (
            "Compute its modes with interfaces=[...]: the nodes at which joints and forces act, except a clamped node. "
            "Further modes (a larger count=) then represent inertial loads."
        )

    @cached_property
    def shapes(self) -> Array:
        """Displacements and rotations (6 m, n) of the nodes for unit mode coordinates."""
        modes, nodes = self.body.modes, list(self.nodes)
        return np.concatenate([modes.shapes[nodes], modes.rotations[nodes]], axis=1).reshape(6 * len(nodes), -1)

    def placed(self, eta: Array) -> Array:
        """Slopes (N, m + 1, 6, n_v) of displacements and rotations of the m nodes and, last, of the frame.

        The slopes are along the velocities of the body, in the axes of the body. `eta` (N, n) are mode coordinates.
        """
        places, own = np.zeros((len(eta), len(self.nodes) + 1, 6, len(self.columns))), slice(self.rigid)
        planar = [0, 1, 5] if self.rigid == 3 else slice(6)
        places[:, :-1, :, own] = self.body.modes.carried(list(self.nodes), eta)[..., planar]
        places[:, :-1, :, self.rigid :] = self.shapes.reshape(len(self.nodes), 6, -1)
        places[:, -1, :, own] = np.eye(6)[:, planar]
        return places


def attached_loads(scene: Scene) -> tuple[AttachedLoads, ...]:
    """The loads of all flexible bodies with modes, in the order of the bodies."""
    bodies = [body for body in scene.system.bodies if is_flexible(body) and len(body.modes.stiffness)]
    return scene.remembered(attached_loads, lambda: tuple(_loads_of(scene, body) for body in bodies))


def _loads_of(scene: Scene, body: "mechanics.FlexibleBody") -> AttachedLoads:
    numbers = {v.element_hash(): k for k, v in enumerate(ca.vertsplit(scene.system.v))}
    columns = tuple(numbers[v.element_hash()] for v in ca.vertsplit(body.frame.v))
    rigid = list(columns[: len(columns) - len(body.modes.stiffness)])
    wrenches: dict[int, ca.SX] = {}
    for number, wrench in (*_of_forces(scene, body), *_of_constraints(scene, body, rigid)):
        if wrench.nnz():
            wrenches[number] = wrenches.get(number, ca.SX(6, 1)) + wrench
    loaded = tuple(sorted(wrenches))
    nodes = (*loaded, *sorted(set(body.used_nodes) - set(loaded)))
    return AttachedLoads(body, columns, nodes, loaded, ca.vertcat(*(wrenches.get(k, ca.SX(6, 1)) for k in nodes)))


def _of_forces(scene: Scene, body: "mechanics.FlexibleBody") -> Iterator[tuple[int, ca.SX]]:
    """Node and wrench of every load."""
    R = body.frame.R
    for load in scene.system.collected.loads:
        number = _clamped(body) if load.body is body else body.number_of(load.body)
        if number is not None:
            yield number, ca.vertcat(R.T @ load.force, R.T @ load.body.frame.R @ load.torque)


def _of_constraints(scene: Scene, body: "mechanics.FlexibleBody", rigid: list[int]) -> Iterator[tuple[int, ca.SX]]:
    """Node and wrench of every constraint at one node, from its work in motions of the frame (columns `rigid` of G)."""
    system, frame = scene.system, body.frame
    for element in system.elements:
        rows = system.collected.rows.get(element.name)
        if rows is None or not isinstance(element, Constraint):
            continue
        places = {number: some for some in element.bodies() if (number := body.number_of(some)) is not None}
        if not places and (held := _clamped(body)) is not None:  # a drive of the frame holds the clamped node
            places = {held: body}
        for number, carrier in places.items() if len(places) == 1 else ():
            rows_of = list(range(rows.start, rows.stop))
            f = -(system.G[rows_of, rigid].T @ ca.SX(system.lam)[rows_of])
            planar = len(rigid) == 3
            force = frame.R.T @ (ca.vertcat(f[:2], 0) if planar else f[:3])
            moment = ca.vertcat(0, 0, f[2]) if planar else f[3:]
            yield number, ca.vertcat(force, moment - ca.cross(frame.R.T @ (carrier.frame.r - frame.r), force))


def _clamped(body: "mechanics.FlexibleBody") -> int | None:
    structure = body.modes.flexibility
    return None if structure is None else structure.clamped_node


@dataclass(frozen=True, eq=False)
class LeftOut:
    """The largest effect on an output of deformations that the modes of a body neglect.

    `share` is the root mean square of this effect over time, divided by the root mean square of the effect of all
    deformations, or of the changes of the output if these are larger.
    """

    loads: AttachedLoads
    output: str
    share: float


def with_loads(scene: Scene, formulation: Formulation, some: tuple[AttachedLoads, ...]) -> Formulation:
    """The formulation with the wrenches of these loads as further outputs, which are the last ones."""
    if not some:
        return formulation
    x, p, t = (ca.SX.sym(name, formulation.y.numel_in(k)) for k, name in enumerate("xpt"))
    bodies = formulation.bodies
    wrenches = output_function(
        (bodies or formulation).dae, scene, ca.vertcat(*(loads.wrenches for loads in some)), False
    )
    y = ca.vertcat(formulation.y(x, p, t), wrenches(x if bodies is None else bodies.states()(x, p), p, t))
    return replace(formulation, y=common("y", [x, p, t], [y]))


def left_out(
    scene: Scene, dae: DAE, some: tuple[AttachedLoads, ...], X: Array, p: Array, t: Array
) -> Iterator[LeftOut]:
    """The largest neglected effect for each body, in states X (m, n_x) of all bodies at times t (m,)."""
    if all(loads.responses is None for loads in some):
        return
    names, states, slopes = scene.remembered(left_out, lambda: _judged(scene, dae, some))
    if not len(names):
        return
    # Maximum number of times at which outputs are checked.
    few = np.unique(np.linspace(0, len(t) - 1, min(len(t), 21)).round().astype(int))
    X, t = X[few], t[few]
    values = batch(states, X, p, t[:, None])[0].reshape(len(t), -1)
    numbers = batch(slopes, X, p, t[:, None])
    M, G, J, *more = (part.reshape(len(t), *slopes.size_out(i)) for i, part in enumerate(numbers))
    moved = _Moved(some, M, G)
    added = np.zeros((2, len(t), len(names)))  # by the actual modes, and by modes that follow slow loads
    lacking = np.zeros((len(some), len(t), len(names)))
    at = len(names)
    for k, loads in enumerate(some):
        n, m = len(loads.body.modes.stiffness), 6 * len(loads.nodes)
        eta, w = values[:, at : at + n], along(loads, values[:, at + n : at + n + m])
        at += n + m
        R, B = more[2 * k], more[2 * k + 1].swapaxes(1, 2)
        own = J[:, :, list(loads.columns)]
        own[:, :, : R.shape[1]] = own[:, :, : R.shape[1]] @ R
        known = loads.responses
        slow, left = (w @ known.modal.T, w @ known.left.T) if known else (eta, np.zeros((len(t), m)))
        lacking[k] = _times(J, moved.by(_times(B, left))) + _times(_direct(own, loads.placed(eta)), left)
        for kind, modal in enumerate((eta, slow)):
            bent = _times(J, moved.by(_times(B, modal @ loads.shapes.T))) + _times(own[:, :, loads.rigid :], modal)
            added[kind] += lacking[k] + bent
    Y = values[:, : len(names)]
    # Change of an output, divided by its size. Smaller changes are rounding errors.
    floor = 1e-9 * (np.abs(Y).max(axis=0) + dae.scales.length)
    size = np.max([*(_rms(some) for some in added), _rms(Y - Y.mean(axis=0)), floor], axis=0)
    for k, loads in enumerate(some):
        shares = _rms(lacking[k]) / size
        yield LeftOut(loads, names[int(shares.argmax())], float(shares.max()))


def along(loads: AttachedLoads, w: Array) -> Array:
    """The components of forces and moments w (..., 6 m) at m nodes, along the directions in which modes move nodes."""
    return w @ np.kron(np.eye(len(loads.nodes)), loads.body.modes.lively)


def _times(A: Array, x: Array) -> Array:
    """The products (m, k) of matrices A (m, k, n) and vectors x (m, n)."""
    return np.einsum("mkn,mn->mk", A, x)


def _rms(values: Array) -> Array:
    return np.sqrt((values**2).mean(axis=0))


def _judged(
    scene: Scene, dae: DAE, some: tuple[AttachedLoads, ...]
) -> tuple[tuple[str, ...], ca.Function, ca.Function]:
    """Names of the checked outputs, a function (x, p, t) -> outputs, mode coordinates and loads, and `_slopes` of them.

    The checked outputs depend on positions alone. Without such outputs, the loaded nodes are checked.
    """
    system, solved = scene.system, ca.vertcat(ca.SX(scene.system.lam), scene.system.vdot)
    places = ca.which_depends(scene.y, system.q, 1, True) or []
    forces = ca.which_depends(scene.y, solved, 1, True) or [False] * len(places)
    if chosen := [k for k in range(len(places)) if places[k] and not forces[k]]:
        names, y = tuple(scene.curve_names[k] for k in chosen), scene.y[chosen]
    else:  # the loaded nodes
        nodes = [loads.body.node(number) for loads in some for number in loads.loaded]
        names = tuple(f"{node.body.name}.{axis}" for node in nodes for axis in "xyz")
        y = scene.expression(ca.vertcat(*(node.r for node in nodes)))
    values = ca.vertcat(y, *[ca.vertcat(loads.body.eta, loads.wrenches) for loads in some])
    return names, output_function(dae, scene, values, often=False), _slopes(scene, some, y)


def _slopes(scene: Scene, some: tuple[AttachedLoads, ...], y: ca.SX) -> ca.Function:
    """A function (x, p, t) -> M, G, slopes of outputs along velocities; for each body, rotation and slopes of loads."""
    system, lam = scene.system, ca.SX(scene.system.lam)
    states = [ca.vertcat(system.q, system.v, system.s), system.p, time_symbol]
    parts = [system.M, system.G, ca.jacobian(y, system.q) @ system.N]
    for loads in some:
        R = loads.body.frame.R
        parts += [R[:2, :2] if loads.rigid == 3 else R, ca.jacobian(loads.wrenches, lam)]
    return ca.Function("slopes", states, [ca.densify(part) for part in parts])


class _Moved:
    """Motions of bodies that compensate violations of the rows of joints, with the smallest kinetic energy."""

    def __init__(self, some: tuple[AttachedLoads, ...], M: Array, G: Array) -> None:
        largest = np.abs(np.einsum("mii->mi", M)).max(axis=1, initial=1e-300)
        # Inertia of massless bodies, divided by the largest inertia.
        W = M + 1e-12 * largest[:, None, None] * np.eye(M.shape[1])
        slowest = min(float(loads.body.modes.stiffness.min()) for loads in some)
        for loads in some:
            own = list(loads.columns)[loads.rigid :]
            # Stiffness of modes, divided by their inertia, if joints move bodies. Loads change slowly.
            W[:, own, own] += 1e3 / slowest * loads.body.modes.stiffness
        self._moving = np.linalg.solve(W, G.swapaxes(1, 2))
        # Singular value, divided by the largest one. Below this value, rows depend on each other.
        self._loose = np.linalg.pinv(G @ self._moving, rcond=1e-9, hermitian=True)

    def by(self, gaps: Array) -> Array:
        """Displacements (m, n_v) along all velocities that close the gaps (m, n_r) of the rows."""
        return _times(self._moving, _times(self._loose, gaps))


def _users(own: Array, places: Array) -> list[tuple[int, ...]]:
    """For each output, the nodes of a body on which it depends. The index of the frame is -1.

    `own` (n_y, n_v) are slopes of the outputs along the velocities of the body.
    """
    frame_and_nodes = range(-1, len(places) - 1)
    units = np.linalg.norm(places[:-1], axis=(0, 1))
    units = np.where(units > 0, units, 1.0)
    slopes, chosen = own / units, [()] * len(own)
    best = np.linalg.norm(slopes, axis=1)
    # Fraction of the slopes of an output that nodes need not explain, because the output depends on positions of the
    # deformed body.
    enough = 0.05 * best
    for some in [*combinations(frame_and_nodes, 1), *combinations(frame_and_nodes, 2)]:
        A = np.concatenate(places[list(some)]) / units
        off = np.linalg.norm(slopes - slopes @ np.linalg.pinv(A) @ A, axis=1)
        for k in np.flatnonzero((off < best) & (best > enough)):
            chosen[k], best[k] = some, off[k]
    return chosen


def _direct(own: Array, places: Array) -> Array:
    """Derivatives (N, n_y, 6 m) with respect to displacements of nodes, from the slopes `own` of the outputs."""
    users = _users(own[0], places[0])
    slopes = np.zeros((*own.shape[:2], *places.shape[1:3]))
    for some in set(users) - {()}:
        which = [k for k, chosen in enumerate(users) if chosen == some]
        inverse = np.linalg.pinv(places[:, list(some)].reshape(len(own), 6 * len(some), -1))
        found = (own[:, which] @ inverse).reshape(len(own), len(which), len(some), 6)
        for place, k in enumerate(some):
            slopes[:, which, k] = found[:, :, place]
    return slopes[:, :, :-1].reshape(*own.shape[:2], -1)
