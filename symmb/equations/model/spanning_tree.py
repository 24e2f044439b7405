"""The tree of joints that carry bodies. All other joints close loops."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

import casadi as ca

from symmb.declare.mechanics import Body, Ground, Joint, Planar, Spatial
from symmb.equations.model.binding import Binding
from symmb.equations.model.joint_motion import JointMotion, motion_of


@dataclass(frozen=True, eq=False)
class Carrying:
    """A joint that carries a body: the carrier (None for the ground), the relative motion, and the joint's points (3,)
    on both bodies, from the centres of mass in body axes [m]."""

    carrier: int | None
    joint: Joint
    motion: JointMotion
    on_carrier: ca.SX
    on_body: ca.SX


@dataclass(frozen=True, eq=False)
class Link:
    """A body, given by its index, and the joint that carries the body, if any."""

    body: int
    carrying: Carrying | None = None


def spanning_tree(
    bodies: Sequence[Body],
    rigid: Sequence[int],
    joints: Sequence[Joint],
    rows: Mapping[str, int],
    bind: Binding,
    turns: Mapping[str, int],
) -> tuple[Link, ...]:
    """The links of the `rigid` bodies, each after the link of its carrier.

    `turns` are whole turns of body b relative to body a in planar joints that do not count turns.

    Joints with many rows come first, so that joints that close loops have few rows. Among equal joints, joints close to
    the ground come first, so that branches are short.
    """
    edges, by_carrier = list(_edges(bodies, joints, rows, bind, turns)), dict[int | None, list[int]]()
    for number, (_, carrying) in enumerate(edges):
        by_carrier.setdefault(carrying.carrier, []).append(number)
    links: dict[int, Link] = {}
    for root in (None, *rigid):
        if root in links:
            continue
        if root is not None:
            links[root] = Link(root)
        queue: list[tuple[int, int, int]] = []
        depth: dict[int | None, int] = {root: 0}
        reached = [root]
        for body in reached:  # the list grows in the loop
            for number in by_carrier.get(body, ()):
                joint = edges[number][1].joint
                heappush(queue, (-rows[joint.name], depth[body] + 1, number))
            while queue:
                _, level, number = heappop(queue)
                follower, carrying = edges[number]
                if follower not in links:
                    links[follower] = Link(follower, carrying)
                    depth[follower] = level
                    reached.append(follower)
                    break
    return tuple(links.values())


def _edges(
    bodies: Sequence[Body], joints: Sequence[Joint], rows: Mapping[str, int], bind: Binding, turns: Mapping[str, int]
) -> Iterator[tuple[int, Carrying]]:
    """Pairs of the index of a body and a joint that can carry the body."""
    numbers = {id(body): k for k, body in enumerate(bodies)}
    for joint in joints:
        ends = [(numbers.get(id(point.body)), point) for point in (joint.point_a, joint.point_b)]
        known = all(number is not None or isinstance(point.body, Ground) for number, point in ends)
        if not known or not all(bind.has_parameters_alone(point.s) for _, point in ends):
            continue
        motion = motion_of(joint, bind)
        if motion is None:
            continue
        motion = motion.turned(turns[joint.name]) if joint.name in turns else motion
        for (carrier, on_carrier), (follower, on_body), own in (
            (ends[0], ends[1], motion),
            (ends[1], ends[0], motion.reversed()),
        ):
            if follower is None or not _suits(bodies, carrier, bodies[follower], rows[joint.name] + motion.u.numel()):
                continue
            yield follower, Carrying(carrier, joint, own, on_carrier.s, on_body.s)


def _suits(bodies: Sequence[Body], carrier: int | None, follower: Body, determined: int) -> bool:
    """Whether the rows and coordinates of a joint determine the pose of the follower."""
    flat = carrier is None or isinstance(bodies[carrier].pose, Planar)
    return determined == follower.frame.v.numel() and (isinstance(follower.pose, Spatial) or flat)
