"""A first guess of positions: every body is put on the joint that connects it with the body that carries it."""

from collections import defaultdict

import numpy as np

from symmb._types import Array, Indices
from symmb.mechanics import Joint
from symmb.model import DAE, Scene
from symmb.start.gauss_newton import PositionRows, SingularRow
from symmb.start.joint_placement import JointPlacement
from symmb.start.joint_tree import GROUND, JointTree
from symmb.start.scales import rest_states
from symmb.symbolic import pattern


def placed_along_joints(scene: Scene, dae: DAE, rows: PositionRows, q: Array, free: Indices) -> Array:
    """Coordinates q (n_q,) after the bodies are placed one after the other along the tree of joints.

    A body without guessed position is moved to its joint as it is turned. If other joints stay open there, such as a
    cylinder's, or its position is guessed, it is moved and turned least. A body that cannot be placed stays there.
    """
    connected, carrying = _connected(scene, dae)
    body_of = np.repeat(np.arange(len(scene.system.bodies)), scene.system.block_sizes)
    guessed = {dae.q_names[i].rpartition(".")[0] for i in scene.guesses if dae.q_names[i][-2:] in (".x", ".y", ".z")}
    joints = JointPlacement(scene, dae, free)
    rows_of = _rows_of(connected)
    element_of = np.empty(dae.n_c, dtype=np.intp)
    for number, where in enumerate(dae.rows.values()):
        element_of[where] = number
    tree = JointTree(carrying, range(len(scene.system.bodies)), joints.pairs)
    q = joints.aligned_to_known(q)
    for body, carrier in tree.carriers.items():
        q = joints.aligned(q, body, carrier)
        moved = joints.moved(q, body, carrier)
        if moved is not None:
            q = moved
            continue
        own = free[body_of[free] == body]
        shifts = np.array([i for i in own if dae.v_names[i][-3:] in (".vx", ".vy", ".vz")], dtype=np.intp)
        driven = [i for i in rows_of[body] if connected[i] <= {body, carrier, GROUND}]
        joint = np.array([i for i in driven if connected[i] == {body, carrier}], dtype=np.intp)
        targets = [np.array(driven, dtype=np.intp), joint]
        if scene.system.bodies[body].name in guessed:
            q = _placed(rows, q, targets, (own,))
        else:
            pins = [joint[element_of[joint] == number] for number in np.unique(element_of[joint])]
            pins.sort(key=len, reverse=True)
            q = _placed(rows, q, pins, (shifts,))
            q = _placed(rows, q, targets, (shifts, own))
    return q


def _placed(rows: PositionRows, q: Array, targets: list[Indices], moves: tuple[Indices, ...]) -> Array:
    """Coordinates that satisfy the first target that some displacements can reach."""
    for target in targets:
        for move in moves:
            try:
                reached = rows.reach(q, rest_states(rows.dae), target, move)
            except SingularRow:
                continue
            if reached.is_on_constraints:
                return reached.q
    return q


def _rows_of(connected: list[frozenset[int]]) -> dict[int, list[int]]:
    """The numbers of the rows of each body."""
    rows: dict[int, list[int]] = defaultdict(list)
    for row, bodies in enumerate(connected):
        for body in bodies:
            rows[body].append(row)
    return rows


def _connected(scene: Scene, dae: DAE) -> tuple[list[frozenset[int]], list[frozenset[int]]]:
    """The bodies of each position row, by their numbers; with the ground where it is no joint between two bodies.

    The second list has those rows by which a body carries another one: a drive that couples joints is none.
    """
    bodies = scene.system.bodies
    numbers = {id(body): k for k, body in enumerate(bodies)}
    joints = {e.name: e.bodies() for e in scene.system.elements if isinstance(e, Joint)}
    body_of = np.repeat(np.arange(len(bodies)), scene.system.block_sizes)
    touched = pattern(dae.G.sparsity_out(0))[: dae.n_c] if dae.G else np.zeros((0, 0), dtype=bool)
    connected, carrying = [], []
    for name, where in sorted(dae.rows.items(), key=lambda item: item[1].start):
        # Rows of listed coordinates have the name of a joint and of a handle.
        ends = [numbers.get(id(end.owner), GROUND) for end in joints.get(name.split(".")[0], ())]
        own = [frozenset({*(ends or [GROUND]), *body_of[row].tolist()}) for row in touched[where]]
        connected += own
        carrying += [bodies for bodies in own if ends or len(bodies) <= 2]
    return connected, carrying
