"""What elements say of a run, and gears whose axes a turning body holds although they count against the ground."""

from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np

from symmb._types import Array, Expr
from symmb.mechanics import AbstractBody, AxisJoint, Element, Gear, Ground, Point
from symmb.model import Scene

_SAME_AXIS = 1e-6
"""Sine of an angle between two axes that are one, and their distance over that of their points from the origin."""
Hinge = tuple[Point, ca.SX, AbstractBody]
"""A point on an axis, its direction in world axes (3,), and the body that holds it."""


def carrier_doubts(elements: Sequence[object], value: Callable[[Expr], Array]) -> Iterator[str]:
    """Doubts about gears without a carrier; `value` gives numbers of expressions at the start.

    An axis may move if all hinges of a wheel are on bodies that may turn about other axes. At the ratio 1 this makes
    no difference.
    """
    joints = [e for e in elements if isinstance(e, AxisJoint) and not isinstance(e, Gear)]
    ground = _fixed_to(Ground(), joints)
    for gear in elements:
        if not isinstance(gear, Gear) or gear.carrier is not None or float(np.ravel(value(gear.ratio))[0]) == 1:
            continue
        for wheel in gear.bodies():
            names = _fixed_to(wheel, joints)
            hinges = [] if names & ground else _hinges(names, joints)
            if not hinges or any(_name(holder) in ground for *_, holder in hinges):
                continue
            point, axis, holder = hinges[0]
            pivots = _hinges(_fixed_to(holder, joints), joints)
            if not any(_name(other) in ground and _is_same(point, axis, p, u, value) for p, u, other in pivots):
                yield (
                    f"{gear.title}: Body {holder.name!r} holds the axis of {wheel.name!r} and may turn, but the angles "
                    f"are those against the ground. Write carrier={holder.name}, or carrier=Ground() if this is meant."
                )


def law_doubts(scene: Scene, t: Array, value: Callable[[Expr], Array]) -> Iterator[str]:
    """What elements doubt of a run at its times (n_t,), by numbers (n_t, ...) of expressions along it."""
    elements, bind = scene.system.elements, scene.system.bind
    known = scene.remembered(law_doubts, lambda: [
        (e.title, *doubt) for e in elements if isinstance(e, Element) for doubt in e.doubtful(bind)
    ])  # fmt: skip
    for title, margins, what in known:
        below = (np.reshape(value(margins), (len(t), -1)) < 0).any(axis=1)
        if below.any():
            yield f"{title}: " + what.format(f" at t = {t[below.argmax()]:.6g} s")
    yield from carrier_doubts(elements, lambda e: np.asarray(value(e))[:1])


def _name(body: AbstractBody) -> str | None:
    return None if isinstance(body.owner, Ground) else body.owner.name


def _fixed_to(body: AbstractBody, joints: Sequence[AxisJoint]) -> set[str | None]:
    """Names of the bodies that do not turn against a body, None of the ground."""
    names, before = {_name(body)}, 0
    while len(names) > before:
        before = len(names)
        for joint in joints:
            pair = {_name(b) for b in joint.bodies()}
            if joint.aligns and not joint.turns and pair & names:
                names |= pair
    return names


def _hinges(names: set[str | None], joints: Sequence[AxisJoint]) -> list[Hinge]:
    """The hinges between bodies of these names and others."""
    found = []
    for joint in (j for j in joints if j.turns):
        a, b = joint.point_a, joint.point_b
        if (_name(a.body) in names) != (_name(b.body) in names):
            found.append((a, joint.frames[0][:, 2], (b if _name(a.body) in names else a).body))
    return found


def _is_same(p: Point, u: ca.SX, r: Point, w: ca.SX, value: Callable[[Expr], Array]) -> bool:
    """Whether two axes are one."""
    size = 1 + ca.norm_1(p.r) + ca.norm_1(r.r)
    beside = ca.vertcat(ca.cross(u, w), ca.cross(p.r - r.r, u) / size)
    return bool(np.abs(value(beside)).max() < _SAME_AXIS)
