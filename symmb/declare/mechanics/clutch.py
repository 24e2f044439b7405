"""Clutches and brakes, which slip with a torque of dry friction, or stick."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._magnitudes import SLIGHT, SMALL
from symmb._options import is_real
from symmb._types import Expr
from symmb.declare.mechanics.angle import turning_direction
from symmb.declare.mechanics.body import Body
from symmb.declare.mechanics.constraint import Constraint
from symmb.declare.mechanics.element import NOT_NEGATIVE, Bind, within
from symmb.declare.mechanics.force import Action, PairTorque
from symmb.declare.mechanics.joint_event import JointEvent, event_state
from symmb.declare.symbolic import Symbol, unit, vector


@dataclass(frozen=True, eq=False)
class Clutch(PairTorque, Constraint):
    """A clutch between two shafts on one axis, or a brake if one of the shafts is the ground. A clutch slips or sticks.

    While the clutch slips, the torque of body a on body b is `capacity`, and it opposes the slip, like dry friction.
    When the slip becomes 0, the shafts stick without impact: a constraint keeps their speeds equal. If the torque of
    this constraint exceeds `static_ratio` times the capacity, the clutch slips again in the direction of the torque.
    If the shafts have equal speeds at the start, the clutch sticks from the start, provided that its capacity suffices.
    The clutch does not transmit impulses of an `Impact` or a `Latch`: after an impulse the shafts slip.

    Parameters
    ----------
    name : str
    body_a, body_b : Body or Ground
    capacity : Expr
        torque of the slipping clutch [N m]: an expression of `t`, coordinates, velocities, states and parameters.
        Negative values count as 0
    static_ratio : Expr
        largest torque of the sticking clutch divided by the torque of the slipping clutch, at least 1 [-]
    axis : tuple
        direction of the axis, with the same components in the axes of both bodies

    Examples
    --------
    >>> import symmb as mb
    >>> ground, wheel = mb.Ground(), mb.Body("wheel", mass=1.0, inertia=2.0)
    >>> shaft = mb.Revolute("shaft", ground.point(0, 0), wheel.point(0, 0))
    >>> brake = mb.Clutch("brake", ground, wheel, capacity=4.0)
    >>> system = mb.System(wheel, shaft, brake, mb.Torque("load", wheel, 1.0))
    >>> run = mb.simulate(mb.Scene(system, {"wheel.omega": 3.0}, [0.0, 1.0, 3.0]))
    >>> run["wheel.omega"].round(6), run.events[0].what, round(run.events[0].time, 6)
    (array([3. , 1.5, 0. ]), 'closes', 2.0)
    >>> run(system.lam("brake")).round(6)
    array([0., 0., 1.])
    """

    capacity: Expr = field(metadata=NOT_NEGATIVE)
    static_ratio: Expr = field(default=1.0, metadata=within(least=1.0))
    axis: tuple[Expr, ...] = (0, 0, 1)

    @cached_property
    def slip(self) -> ca.SX:
        """Angular velocity of body b relative to body a about the axis [rad/s]."""
        a, b = self.body_a, self.body_b
        along = turning_direction(a, unit(vector(self.axis)), b, ca.SX.eye(3))
        return ca.dot(along, b.frame.R @ b.frame.omega - a.frame.R @ a.frame.omega)

    def faults(self) -> Iterator[str]:
        """Faults of the declaration. Each fault is a sentence with a remedy."""
        yield from super().faults()
        if not self.place_faults() and self._jumps_with_slip():
            yield (
                f"{self.title}: capacity jumps when the slip changes its sign, so the clutch would stick and slip "
                "endlessly. Use a continuous capacity. For a one-way clutch, use a Weld with a Latch and a Release."
            )

    def _jumps_with_slip(self, states: int = 4) -> bool:
        """Whether the capacity jumps at zero slip: True if the capacity jumps at each of some random states."""
        if not isinstance(self.capacity, ca.SX) or self.capacity.numel() != 1:
            return False
        symbols = ca.vertcat(*ca.symvar(ca.vertcat(self.capacity, self.slip)))
        slope = ca.jacobian(self.slip, symbols)
        f = ca.Function("f", [symbols], [self.slip, ca.densify(slope), self.capacity])
        for state in np.random.default_rng(0).uniform(0.5, 1.5, (states, symbols.numel())):
            slip, along, _ = (np.array(part).ravel() for part in f(state))
            step = along / max(along @ along, np.finfo(float).tiny)
            below, above = (float(f(state - (slip - side) * step)[2]) for side in (-SLIGHT, SLIGHT))
            # For so small a change of the slip, a steep but continuous capacity changes by less than this limit.
            if not abs(above - below) > SMALL * max(abs(above), abs(below)):
                return False
        return True

    @property
    def closed(self) -> ca.SX:
        """1 while the clutch sticks, 0 while it slips."""
        return self.flag.sx

    @property
    def direction(self) -> ca.SX:
        """1 or -1 while the clutch slips, the sign of `slip`; 0 while it sticks."""
        return self.side.sx

    @cached_property
    def flag(self) -> Symbol:
        """The record of the state `closed`."""
        return event_state(f"{self.name}.closed", 0.0)

    @cached_property
    def side(self) -> Symbol:
        """The record of the state `direction`."""
        return event_state(f"{self.name}.direction", 0.0)

    def velocity_rows(self, bind: Bind) -> ca.SX:
        return self.closed * self.slip

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        yield Action(self._loads(-self.direction * self._held(bind)))

    def _held(self, bind: Bind) -> ca.SX:
        """The capacity as an expression that is never negative."""
        capacity = self.number(bind, "capacity")
        return capacity if is_real(self.capacity) else ca.fmax(capacity, 0)

    def events(self, bind: Bind) -> tuple[JointEvent, ...]:
        """The events at which the clutch starts to slip and to stick."""
        limit = self.number(bind, "static_ratio") * self._held(bind)
        # An event needs a condition that becomes true. So the conditions of slip are false while the clutch slips, and
        # the condition of sticking is false while it sticks.
        slips = ca.fabs(self.lam) > limit + (1 - self.closed)
        struck = self.closed * ca.fabs(self.slip) > 1 - self.closed
        return Slips(self, slips), Struck(self, struck), Sticks(self, self.direction * self.slip + self.closed < 0)

    @cached_property
    def lam(self) -> ca.SX:
        """The symbol of the clutch's multiplier in conditions [N m]."""
        return ca.SX.sym(f"{self.name}.lam")


@dataclass(frozen=True, eq=False)
class ClutchEvent(JointEvent):
    """An event of a clutch."""

    joint: Clutch  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def title(self) -> str:
        return self.joint.title

    @property
    def lam(self) -> ca.SX:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The symbol (1,) of the clutch's multiplier in the condition [N m]."""
        return self.joint.lam

    @property
    def flag(self) -> Symbol:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The record of the state `closed`. All events of a clutch change this state."""
        return self.joint.flag


class Slips(ClutchEvent):
    """The event at which a clutch starts to slip. The slip torque on body b then has the sign of -lam."""

    opens = True

    @property
    def closed(self) -> ca.SX:
        """The number 0, because this event does not keep the clutch closed."""
        return ca.SX(0)

    @property
    def place(self) -> tuple[tuple[Symbol, ca.SX], ...]:
        return ((self.joint.side, ca.if_else(self.lam < 0, -1, 1)),)


class Struck(Slips):
    """The event at which an impulse makes a sticking clutch slip. A finite torque cannot transmit an impulse."""

    @property
    def place(self) -> tuple[tuple[Symbol, ca.SX], ...]:
        return ((self.joint.side, ca.if_else(self.joint.slip < 0, -1, 1)),)


class Sticks(ClutchEvent):
    """The event at which a slipping clutch sticks."""

    opens = False

    @property
    def place(self) -> tuple[tuple[Symbol, ca.SX], ...]:
        return ((self.joint.side, ca.SX(0)),)
