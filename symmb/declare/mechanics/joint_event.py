"""Joints that open or close during a run."""

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca

from symmb._types import Expr
from symmb.declare.mechanics.axis_joint import AxisJoint, Joint
from symmb.declare.mechanics.body import Point
from symmb.declare.mechanics.element import Bind, Element
from symmb.declare.mechanics.joint import Distance, PointOnLine, Screw, Spherical
from symmb.declare.symbolic import Kind, Symbol, declare


def event_state(name: str, value: float) -> Symbol:
    """A state that only changes at events, with its initial value."""
    return declare([name], Kind.STATE, ca.SX.sym(name), ca.SX(1, 1), ca.SX(value))[0]


@dataclass(frozen=True, eq=False)
class JointEvent(Element):
    """An event at which a joint opens or closes: the instant at which its condition becomes true."""

    opens: ClassVar[bool]

    joint: Joint
    condition: Expr | Callable[[Any], Expr]

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The name of the joint and the kind of the event, such as "sling_release"."""
        return f"{getattr(self.joint, 'name', '')}_{type(self).__name__.lower()}"

    @property
    def title(self) -> str:
        return f"{type(self).__name__} {getattr(self.joint, 'name', '')!r}"

    def parts(self) -> tuple[Element, ...]:
        return (self.joint,)

    @property
    def closed(self) -> ca.SX:
        """1 while this event keeps the joint closed, else 0."""
        return self.flag.sx

    @cached_property
    def lam(self) -> ca.SX:
        """Symbols (6,) of the joint's multipliers in the condition [N, N m]. No joint has more than 6."""
        return ca.SX.sym(f"{self.name}.lam", 6)

    @cached_property
    def flag(self) -> Symbol:
        """The record of the state `closed`."""
        return event_state(f"{self.name}.closed", float(self.opens))

    @cached_property
    def holding(self) -> Symbol:
        """The record of the state that is 1 while the condition holds, else 0."""
        return event_state(f"{self.name}.holds", 0.0)

    @property
    def states(self) -> tuple[Symbol, ...]:
        """All states that only change at the events of this element."""
        return self.flag, self.holding, *(symbol for symbol, _ in self.place)

    @property
    def place(self) -> tuple[tuple[Symbol, ca.SX], ...]:
        """States that the event sets, each with the expression of its new value."""
        return ()


class Release(JointEvent):
    """A joint that opens when a condition becomes true, such as a sling, a trigger, or a pin that is pulled.

    The event removes the rows of the joint from the equations, and the reaction of the joint becomes 0. Velocities do
    not jump. The joint is closed at the start. The condition must not hold at the start.

    Parameters
    ----------
    joint : Joint
    condition : expression
        comparison of coordinates, velocities, parameters and `t`, such as `arm.theta > 0.8`; comparisons may be joined
        by `casadi.logic_and` and `logic_or`. Other expressions are true if they are positive. The condition may also be
        a function of the joint's reaction (see `System.reaction`), such as
        `lambda pull: pull.fx**2 + pull.fy**2 > strength**2` for a pin that breaks. A peak of the reaction that is
        shorter than an eighth of a step may be missed

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", mass=1.0, pose=mb.Particle())
    >>> sling = mb.Distance("sling", mb.Ground().point(0, 0), bob.point(0, 0), 1.0)
    >>> system = mb.System(bob, sling, mb.Release(sling, bob.x < 0))
    >>> run = mb.simulate(mb.Scene(system, {"bob.x": 1.0, "bob.y": 0.0, "bob.vy": 1.0}, [0.0, 3.0]))
    >>> (event,) = run.events
    >>> event.name, event.what, round(event.time, 6)
    ('sling', 'opens', 1.570796)
    >>> run["bob.x"].round(6), run["bob.y"].round(6)
    (array([ 1.      , -1.429204]), array([0., 1.]))
    """

    opens = True


class Latch(JointEvent):
    """A joint that closes when a condition becomes true, such as a door's latch, a hook, or a clutch with teeth.

    The event adds the rows of the joint to the equations. The bodies keep their positions: the joint's point and frame
    on body a move to the point and frame on body b. A Distance keeps its current length. The closing is a plastic
    impact: velocities jump so that all rows have the rate 0,

        M (v+ - v-) + G' L = 0,    G v+ + Phi_t = 0,

    with the impulses L of the rows. If the gap of an `Impact` would then close, this impact follows. The joint is open
    at the start. A joint that also has a `Release` is closed at the start, and may open and close several times. The
    event occurs at the instant at which the condition becomes true. If the condition is true when the joint opens, the
    joint closes only after the condition has become false and then true again.

    Parameters
    ----------
    joint : Joint
        Revolute, Prismatic, Cylindrical, Weld, PlanarJoint, Spherical, PointOnLine or Distance
    condition : expression
        see `Release`

    Examples
    --------
    >>> import symmb as mb
    >>> a, b = (mb.Body(name, mass=1.0, pose=mb.Particle()) for name in "ab")
    >>> hook = mb.Spherical("hook", a.point(0, 0), b.point(0, 0))
    >>> system = mb.System(a, b, hook, mb.Latch(hook, b.x - a.x < 0.1))
    >>> run = mb.simulate(mb.Scene(system, {"a.x": 0.0, "a.vx": 2.0, "b.x": 1.1}, [0.0, 1.0]))
    >>> (event,) = run.events
    >>> round(event.time, 6), round(event.work, 6), round(event.impulse[0], 6)
    (0.5, -1.0, -1.0)
    >>> run["a.vx"].round(6), run["b.x"].round(6)
    (array([2., 1.]), array([1.1, 1.6]))
    """

    opens = False

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        joint = self.joint
        aligns = isinstance(joint, AxisJoint) and joint.aligns and not isinstance(joint, Screw)
        if isinstance(joint, Joint) and not aligns and not isinstance(joint, Spherical | PointOnLine | Distance):
            yield f"{self.title}: a {type(joint).__name__} cannot close during a run. Use Weld, Revolute or Prismatic."

    @cached_property
    def place(self) -> tuple[tuple[Symbol, ca.SX], ...]:
        """States that store the relative pose at which the joint closes, each with the expression of its new value."""
        return self._grip[1]

    @property
    def grip(self) -> Joint:
        """The joint after it has closed, with the stored relative pose."""
        return self._grip[0]

    def rows(self, bind: Bind) -> ca.SX:
        """The rows (n,) of the joint after it has closed, with the stored relative pose."""
        place, joint = self.place, self.grip
        if isinstance(joint, Distance):
            return ca.norm_2(joint.d) - place[0][0].sx
        return joint.position_rows(bind)

    @cached_property
    def _grip(self) -> tuple[Joint, tuple[tuple[Symbol, ca.SX], ...]]:
        """A copy of the joint with a moved point and frame on body a, and the states that store the displacement."""
        joint = self.joint
        if isinstance(joint, Distance):
            return joint, ((event_state(f"{self.name}.length", 1.0), ca.norm_2(joint.d)),)
        R_a, R_b = (body.frame.R for body in joint.bodies())
        shift, place = self._kept("shift", R_a.T @ joint.d, ca.SX(3, 1))
        # The joint is copied, because the handles of the original joint keep their zero.
        grip = copy(joint)
        for name in joint.__dict__.keys() - joint.__dataclass_fields__.keys():
            del vars(grip)[name]  # cached values of the old point and frame
        vars(grip)["point_a"] = Point(joint.point_a.body, joint.point_a.s + shift)
        if isinstance(joint, AxisJoint) and joint.aligns:
            turn, more = self._kept("turn", R_a.T @ R_b @ joint.alignment, ca.SX.eye(3))
            F_a, F_b = joint.own_frames
            vars(grip)["own_frames"] = (turn @ F_a, F_b)
            place = (*place, *more)
        return grip, place

    def _kept(self, name: str, value: ca.SX, start: ca.SX) -> tuple[ca.SX, tuple[tuple[Symbol, ca.SX], ...]]:
        """A matrix with states in place of the entries that may change in a run, and these states."""
        value, kept = ca.densify(value), []
        matrix = ca.SX(value)
        for i, entry in enumerate(ca.vertsplit(ca.vec(value))):
            if not entry.is_constant():
                state = event_state(f"{self.name}.{name}[{i}]", float(ca.densify(start).nz[i]))
                kept.append((state, entry))
                matrix[i] = state.sx
        return matrix, tuple(kept)


def row_gates(events: Iterable[JointEvent]) -> dict[str, ca.SX]:
    """For each joint that opens or closes, by its name: an expression that is 1 while the joint is closed, else 0."""
    gates: dict[str, ca.SX] = {}
    for event in events:
        gates[event.joint.name] = gates.get(event.joint.name, ca.SX(0)) + event.closed
    return gates


def closed_at_start(events: Iterable[JointEvent]) -> dict[str, bool]:
    """For each joint that opens or closes, by its name: whether the joint is closed at the start.

    Clutches are open at the start. Joints that have a Latch, and no event that opens them, are open as well.
    """
    events = list(events)
    released = {event.joint.name for event in events if float(event.flag.value)}
    return {event.joint.name: event.joint.name in released for event in events}
