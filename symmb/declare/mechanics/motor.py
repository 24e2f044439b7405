"""Electric motors in joints."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca

from symmb._types import Expr
from symmb.declare.mechanics.actuator import JointForce
from symmb.declare.mechanics.body import Body
from symmb.declare.mechanics.element import NOT_NEGATIVE, POSITIVE, Bind
from symmb.declare.mechanics.force import Action
from symmb.declare.symbolic import Kind, Symbol, declare, is_zero, scalar


@dataclass(frozen=True, eq=False)
class Motor(JointForce):
    """A DC motor with a gear in a joint. The voltage is V = R i + L i' + k_e n w, and the torque is n (k_t i - b n w).

    w is the rate of the joint's angle. The rotor turns n times as fast. The torque acts on body b in the direction of
    increasing angle, and with the opposite sign on body a. The current i is a first-order state called `name.current`,
    which starts at 0. Without inductance the current is an expression of V and w. The rotor has no inertia: add n^2
    times the rotor's inertia to the inertia of body b. For dry friction, add a `Clutch` of constant capacity. In a
    `Prismatic` joint the motor is linear, with a force and a velocity in place of torque and angular velocity.

    Parameters
    ----------
    name : str
    joint : Joint
        Revolute, Prismatic, Cylindrical or Screw
    voltage : Expr
        voltage V [V]: any expression of coordinates, velocities, states, parameters and `t`, such as a controller
    resistance : Expr
        resistance R [ohm]
    torque_constant : Expr
        torque per current, k_t [N m/A]
    inductance : Expr
        inductance L [H]; with 0 the equations are not stiff
    gear : Expr
        turns n of the rotor per turn of the joint [-]
    friction : Expr
        coefficient b of viscous friction of the rotor [N m s/rad]
    emf_constant : Expr
        induced voltage per rotor speed, k_e [V s/rad]; by default k_t
    coordinate : str
        "angle" or "displacement", for joints that have both

    Examples
    --------
    >>> import symmb as mb
    >>> wheel = mb.Body("wheel", mass=1.0, inertia=0.01)
    >>> shaft = mb.Revolute("shaft", mb.Ground().point(0, 0), wheel.point(0, 0))
    >>> motor = mb.Motor("motor", shaft, voltage=12.0, resistance=2.0, torque_constant=0.1, inductance=1e-3)
    >>> run = mb.simulate(mb.Scene(mb.System(wheel, shaft, motor), times=[0.0, 40.0], outputs={"i": motor.current}))
    >>> run["wheel.omega"].round(3), run["i"].round(3)
    (array([  0., 120.]), array([0., 0.]))
    """

    of_start: ClassVar[str | None] = ".current"
    voltage: Expr
    resistance: Expr = field(metadata=POSITIVE)
    torque_constant: Expr
    inductance: Expr = field(default=0.0, metadata=NOT_NEGATIVE)
    gear: Expr = 1.0
    friction: Expr = field(default=0.0, metadata=NOT_NEGATIVE)
    emf_constant: Expr | None = None

    @property
    def current(self) -> ca.SX:
        """Current i [A]."""
        return self._free_voltage / self._number("resistance") if self._state is None else self._state.sx

    @property
    def torque(self) -> ca.SX:
        """Torque of the motor in the joint [N m], or force [N]."""
        gear, speed = self._number("gear"), self._speed
        return gear * (self._number("torque_constant") * self.current - self._number("friction") * speed)

    @property
    def power(self) -> ca.SX:
        """Electric power V i of the motor [W]."""
        return self._number("voltage") * self.current

    @cached_property
    def _state(self) -> Symbol | None:
        """The record of the state of the current; None without inductance."""
        L, current = self._number("inductance"), ca.SX.sym(f"{self.name}.current")
        if is_zero(L):
            return None
        rate = (self._free_voltage - self._number("resistance") * current) / L
        return declare([f"{self.name}.current"], Kind.STATE, current, rate, ca.SX(1, 1))[0]

    @property
    def _speed(self) -> ca.SX:
        """Speed of the rotor [rad/s]."""
        return self._number("gear") * getattr(self.joint, f"{self.handle}_rate")

    @property
    def _free_voltage(self) -> ca.SX:
        """Voltage minus the induced voltage [V]."""
        constant = self._number("torque_constant" if self.emf_constant is None else "emf_constant")
        return self._number("voltage") - constant * self._speed

    def _number(self, what: str) -> ca.SX:
        return scalar(getattr(self, what), f"{self.title}: {what}")

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        for what in ("voltage", "resistance", "torque_constant", "inductance", "gear", "friction"):
            bind(getattr(self, what), f"{self.title}: {what}")
        torque = bind(self.torque, self.title)
        yield Action(self.loads(torque), force=torque, states=() if self._state is None else (self._state,))
