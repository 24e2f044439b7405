"""The equations of motion with closed contacts, and the equations of an impact and of a joint that closes.

With gaps g, their rates g' = W v + g_t, and the effects B, L of unit forces along them,

    M B + G' L = W',    G B = 0,    D = W B,

the forces f >= 0 in closed contacts follow from g'' = W (v'_free + B f) + zeta = 0, and impulses P change v by B P.
States c are 1 for closed contacts and 0 for open contacts. With (c D c + 1 - c) f = -c (W v'_free + zeta), the forces
of open contacts are 0. So the same equations are valid for all combinations of open and closed contacts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symmb._magnitudes import ROUNDING
from symmb._types import Indices
from symmb.declare.mechanics import JointEvent, Latch, Sticks, Struck
from symmb.declare.symbolic import common, least_multipliers, symmetric_solver, t
from symmb.equations.model.system import System


@dataclass(frozen=True)
class Impacts:
    """Compiled equations of n contacts; every Function takes (q, v, s, p, t)."""

    names: tuple[str, ...]
    closed: Indices  # (n,), indices of the states s for closed contacts
    gaps: ca.Function  # -> gaps (n,), their rates (n,), and the sizes of the coordinates in the gaps (n,)
    # -> forces in closed contacts (n,), 0 in open contacts, accelerations of gaps (n,), the sizes of the terms in
    # these sums (n,), and effective inertias 1 / D_kk (n,)
    forces: ca.Function
    impulses: ca.Function  # -> W (n, n_v), B (n_v, n), rates g_t of gaps at rest (n,), restitutions (n,)
    # -> q (n_q,), v (n_v,) after the smallest change in the norm of M that makes closed gaps and their rates 0
    project: ca.Function
    joints: "JointEvents | None" = None  # None without joints that open and close

    @property
    def states(self) -> Indices:
        """Indices of the states s that change only at events."""
        joints = self.joints
        own = () if joints is None else (*joints.holding, *joints.flags, *joints.place)
        return np.concatenate([self.closed, np.array(own, dtype=np.intp)])


@dataclass(frozen=True)
class JointEvents:
    """Compiled equations of m events of joints; every Function takes (q, v, s, p, t)."""

    names: tuple[str, ...]  # of the joints
    titles: tuple[str, ...]  # of the events, for messages
    opens: tuple[bool, ...]  # whether the joint opens
    holding: tuple[int, ...]  # the states s that record whether conditions are true
    flags: tuple[int, ...]  # the states s for joints that the event keeps closed
    others: tuple[tuple[int, ...], ...]  # `flags` of other events of the same joint
    rows: tuple[slice, ...]  # of the joints
    by_force: tuple[bool, ...]  # whether the margin needs multipliers
    place: tuple[int, ...]  # (k,), the states s for poses at closing, or for directions of slip of clutches
    owners: tuple[int, ...]  # (k,), the events that set these states
    clutches: tuple[
        tuple[int, int], ...
    ]  # (c, 2), indices of two states: 1 while the clutch sticks, and the direction of slip
    margins: ca.Function  # -> margins (m,), negative if conditions hold, and their rates (m,)
    places: ca.Function  # -> new values of the states `place` for joints that close now (k,)
    slips: ca.Function  # -> slips of the clutches (c,), and their rounding errors (c,)
    # -> v (n_v,) after the smallest change in the norm of M that makes the rates of all rows 0, impulses (n_r,) of
    # these rows, and their work [J]
    jump: ca.Function

    @property
    def let_slip(self) -> tuple[int, ...]:
        """Kinds of the events (m,): 1 if torque makes a clutch slip, 2 if an impulse does, 0 for other events."""
        flags = {own for own, _ in self.clutches}
        events = zip(self.opens, self.flags, self.by_force, strict=True)
        return tuple((2 - by_force) * (opens and flag in flags) for opens, flag, by_force in events)


class ContactEquations:
    """The equations of a system's impacts in SX."""

    def __init__(self, system: System) -> None:
        c = self._c = system.collected
        self._system = system
        self.gap = ca.vertcat(ca.SX(0, 1), *[gap for _, gap, _ in c.impacts])
        self.restitution = ca.vertcat(ca.SX(0, 1), *[e for *_, e in c.impacts])
        s_names = [state.name for state in c.states]
        self.closed = [s_names.index(f"{name}.closed") for name, *_ in c.impacts]
        self.rate = ca.densify(self._along(self.gap))
        self.W = ca.jacobian(self.rate, system.v)
        self.at_rest = ca.substitute(self.rate, system.v, ca.SX.zeros(system.v.shape))
        effects = [system.solve(ca.densify(self.W[k, :].T), ca.SX(len(c.row_names), 1)) for k in range(len(c.impacts))]
        self.B = ca.horzcat(ca.SX(system.v.numel(), 0), *[a for a, _ in effects])
        self._L = ca.horzcat(ca.SX(len(c.row_names), 0), *[lam for _, lam in effects])
        flags = system.s[self.closed] if self.closed else ca.SX(0, 1)
        D, closed = self.W @ self.B, ca.diag(flags)
        self._D, self._flags = D, flags
        self._solve = symmetric_solver(closed @ D @ closed + ca.diag(1 - flags)) if self.closed else lambda r: r
        self._zeta = self._along(self.rate)

    def _along(self, f: ca.SX) -> ca.SX:
        """The time derivative of f for v' = 0."""
        system = self._system
        return ca.jtimes(f, system.q, system.qdot) + ca.jtimes(f, system.s, system.s_rate) + ca.jacobian(f, t)

    def _with_multipliers(self, expression: ca.SX, multipliers: ca.SX) -> ca.SX:
        """An expression of a joint condition, in which multipliers (n_r,) replace their symbols."""
        c, system = self._c, self._system
        symbols = {event.joint.name: event.lam for event, _ in c.joint_events if ca.depends_on(expression, event.lam)}
        if not symbols:
            return expression
        clutches = {event.joint.name for event, _ in c.joint_events if isinstance(event, Sticks)}
        least, values = least_multipliers(system.G, system.G.T @ multipliers, c.units), []
        for name, lam in symbols.items():
            at = c.rows.get(name, slice(0, 0))
            own, raw = least[at], multipliers[at]
            if name in clutches:  # other rows move the clutch against any torque: the sign follows from the multipliers
                # In the solver, multipliers of contradictory rows are 1e10 times larger than the smallest ones.
                # tests/events/test_clutches.py
                own = ca.if_else(ca.fabs(raw) > 100 * ca.fabs(own), raw, own)
            values.append(ca.vertcat(own, ca.SX.zeros(lam.numel() - own.numel())))
        return ca.substitute(expression, ca.vertcat(*symbols.values()), ca.vertcat(*values))

    def _without_rounding(self, event: JointEvent, rate: ca.SX, accelerations: ca.SX) -> ca.SX:
        """The rate of an event's margin, with 0 for rates that are rounding errors.

        Rounding must not make a clutch stick. It must also not close a Latch after its joint has opened without a jump
        of accelerations. The margin of a clutch during an impulse depends on the impulse only.
        """
        system = self._system
        if isinstance(event, Struck):
            return ca.SX(0)
        if isinstance(event, Latch):
            sizes = zip((system.q, system.v), (system.qdot, accelerations), strict=True)
            margin = dict(self._c.joint_events)[event]
            terms = [ca.fabs(ca.jacobian(margin, x)) @ ca.fabs(change) for x, change in sizes]
            return ca.if_else(ca.fabs(rate) <= ROUNDING * ca.sum1(ca.vertcat(*terms)), 0, rate)
        if not isinstance(event, Sticks):
            return rate
        W = ca.jacobian(event.joint.slip, system.v)
        friction = ca.densify(ca.jacobian(system.Q, event.joint.direction))
        effect, _ = system.solve(friction, ca.SX(system.lam.numel(), 1))
        return rate + ROUNDING * ca.fabs(W) @ (ca.fabs(accelerations) + ca.fabs(effect))

    def _opposing(self, r: ca.SX) -> ca.SX:
        """Forces or impulses (n,) along closed gaps that compensate r (n,)."""
        return -self._solve(self._flags * r)

    def solve(self, f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The solution (a, lam) for right sides (f, g), as in `System.solve`, with forces in closed contacts."""
        a, lam = self._system.solve(f, g)
        force = self._opposing(self.W @ a + self._zeta)
        return a + self.B @ force, lam + self._L @ force

    @property
    def force(self) -> ca.SX:
        """Forces in closed contacts, (n,) [N, N m]."""
        a, _ = self._system.solve(self._system.Q, self._system.gamma)
        return self._opposing(self.W @ a + self._zeta)

    @property
    def power(self) -> ca.SX:
        """Power of the forces in closed contacts [W]. Contact forces do work if a law of time moves a body."""
        return -ca.dot(self.force, self.at_rest)

    def _function(self, name: str, **outputs: ca.SX) -> ca.Function:
        """A Function of the states with these outputs."""
        system, dense = self._system, [ca.densify(e) for e in outputs.values()]
        states = [system.q, system.v, system.s, system.p, t]
        return common(name, states, dense, ["q", "v", "s", "p", "t"], list(outputs))

    def _slipping(self, *outputs: ca.SX) -> list[ca.SX]:
        """Outputs for an impulse. All clutches slip during an impulse, because a clutch transmits no impulse."""
        sticks = ca.vertcat(ca.SX(0, 1), *[e.flag.sx for e, _ in self._c.joint_events if isinstance(e, Sticks)])
        return ca.substitute([*outputs], [sticks], [ca.SX.zeros(sticks.shape)])

    def compiled(self, retract: ca.Function) -> Impacts:
        """The compiled Functions of the contacts and joint events."""
        system, c = self._system, self._c
        free, _ = system.solve(system.Q, system.gamma)
        force = self.force
        return Impacts(
            names=tuple(name for name, *_ in c.impacts),
            closed=np.array(self.closed, dtype=np.intp),
            joints=self._joints() if c.joint_events else None,
            gaps=self._function(
                "gaps", gap=self.gap, rate=self.rate, reach=ca.fabs(ca.jacobian(self.gap, system.q)) @ ca.fabs(system.q)
            ),
            forces=self._function(
                "forces",
                force=force,
                acceleration=self.W @ free + self._zeta + self._D @ force,
                size=ca.fabs(self.W) @ ca.fabs(free) + ca.fabs(self._zeta),
                inertia=1 / ca.diag(self._D),
            ),
            impulses=self._function(
                "impulses", W=self.W, B=self._slipping(self.B)[0], at_rest=self.at_rest, restitution=self.restitution
            ),
            project=self._function(
                "held",
                q_held=retract(system.q, self.B @ self._opposing(self.gap)),
                v_held=system.v + self.B @ self._opposing(self.rate),
            ),
        )

    def _joints(self) -> JointEvents:
        """The Functions of events of joints."""
        system, c = self._system, self._c
        events, numbers = [e for e, _ in c.joint_events], {state.name: k for k, state in enumerate(c.states)}
        accelerations, multipliers = self.solve(system.Q, system.gamma)
        margins = self._with_multipliers(ca.vertcat(*[margin for _, margin in c.joint_events]), multipliers)
        rates = ca.vertsplit(self._along(margins) + ca.jtimes(margins, system.v, accelerations))
        rates = [self._without_rounding(e, rate, accelerations) for e, rate in zip(events, rates, strict=True)]
        places = [(k, state.name, value) for k, e in enumerate(events) for state, value in e.place]
        place = self._with_multipliers(ca.vertcat(ca.SX(0, 1), *[value for *_, value in places]), multipliers)
        clutches = [e.joint for e in events if isinstance(e, Sticks)]
        slip = ca.vertcat(ca.SX(0, 1), *[clutch.slip for clutch in clutches])
        rounding = 1e-10 * (ca.fabs(ca.jacobian(slip, system.v)) @ ca.fabs(system.v))
        # The smallest change of velocities that stops all rows. Rows that a law of time moves do work.
        at_rest = ca.substitute(system.Phi_dot, system.v, ca.SX.zeros(system.v.shape))
        lost, L = system.solve(ca.SX(system.v.numel(), 1), system.Phi_dot)
        v_new, impulse, work = self._slipping(system.v - lost, -L, ca.dot(L, system.Phi_dot / 2 - at_rest))
        return JointEvents(
            **_columns([self._entries(e, numbers) for e in events]),
            place=tuple(numbers[name] for _, name, _ in places),
            owners=tuple(k for k, *_ in places),
            clutches=tuple((numbers[clutch.flag.name], numbers[clutch.side.name]) for clutch in clutches),
            margins=self._function("margins", margin=margins, rate=ca.vertcat(*rates)),
            places=self._function("places", place=place),
            slips=self._function("slips", slip=slip, rounding=rounding),
            jump=self._function("jump", v_new=v_new, impulse=impulse, work=work),
        )

    def _entries(self, event: JointEvent, numbers: Mapping[str, int]) -> dict[str, Any]:
        """The entries of `JointEvents` for one event. `numbers` are the indices of the states."""
        others = [e for e, _ in self._c.joint_events if e.joint is event.joint and e.flag is not event.flag]
        return {
            "names": event.joint.name,
            "titles": event.title,
            "opens": event.opens,
            "holding": numbers[event.holding.name],
            "flags": numbers[event.flag.name],
            "others": tuple(numbers[other.flag.name] for other in others),
            "rows": self._c.rows.get(event.joint.name, slice(0, 0)),
            "by_force": ca.depends_on(dict(self._c.joint_events)[event], event.lam),
        }


def _columns(rows: Sequence[dict[str, Any]]) -> dict[str, tuple[Any, ...]]:
    """The columns of a table of rows, by name."""
    return {name: tuple(row[name] for row in rows) for name in rows[0]}
