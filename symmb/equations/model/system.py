"""The equations of motion of a system of bodies, constraints and forces. Each part is derived at its first use.

    M(q, p) v' + G' lam = Q(q, v, p, t)          q' = N(q) v
    Phi(q, p, t) = 0                             positions
    Phi_v v + Phi_t = 0,  Psi(q, v, p, t) = 0    velocities; Psi are velocity-only rows, linear in v
    G v' = gamma                                 accelerations, G = [Phi_v; Psi_v], Phi_v = Phi_q N

q (n_q,) are coordinates, v (n_v,) velocities, and s (n_s,) first-order states with s' = f(q, v, s, p, t). lam has a
multiplier for every row of Phi and Psi. Planar bodies have v = q' and N = I; spatial bodies have v = (r', omega) with
omega in body axes. M is block-diagonal with a block for each body. Parts that a scene does not need are left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any

import casadi as ca

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._names import normal
from symmb._options import require_instance, require_name
from symmb._types import Expr
from symmb.declare.mechanics import Body, Element, FilledByBlock, Ground, Input, Joint, Parameters, States, mark_as_used
from symmb.declare.symbolic import Symbol, rate, reduction, saddle_solver, t
from symmb.equations import model
from symmb.equations.model.assembly import Collected, collect
from symmb.equations.model.binding import Binding
from symmb.equations.model.box import Box
from symmb.equations.model.equations_text import ReadEquations
from symmb.equations.model.joint_space import JointSpace
from symmb.equations.model.multipliers import Multipliers
from symmb.equations.model.validation import sign_faults

_DECLARED = "elements", "parameters", "collected", "nullity", "_added", "_joints", "_is_driven"
"""Attributes that are copied with a system. All other attributes are derived from these attributes."""


class System(FilledByBlock, ReadEquations):
    """Bodies, constraints and forces with their equations of motion.

    `with System() as system:` collects the elements that are made in the block. The system is complete at the end
    of the block.

    Parameters
    ----------
    *elements : Body, Constraint, ForceElement, Impact or States; their order is the order of coordinates and rows
    parameters : Parameters
        default: the parameters with symbols in the elements

    Raises
    ------
    DeclarationError
        If the declaration is not valid. The text lists all faults with names and remedies

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(m=2.0, k=50.0)
    >>> mass = mb.Body("mass", mass=p.m, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), mass.point(0, 0), p.k)
    >>> system = mb.System(mass, spring, parameters=p)
    >>> system.Q
    SX([(-(k*mass.x)), (-(k*mass.y)), (-(k*mass.z))])
    """

    @kept_interrupts()
    def __init__(self, *elements: Body | Ground | Element | States, parameters: Parameters | None = None) -> None:
        if parameters is not None:
            require_instance("System: parameters", parameters, Parameters, "Parameters(l1=1.0, ...)")
        single = chain.from_iterable(e if isinstance(e, States) else (e,) for e in elements)
        self.elements = tuple(e for e in single if not isinstance(e, Ground))
        for element in self.elements:
            if isinstance(name := getattr(element, "name", ""), str) and name != normal(name):
                object.__setattr__(element, "name", normal(name))
        self.collected: Collected = collect(self.elements, parameters)
        mark_as_used((*self.elements, *(event for event, _ in self.collected.joint_events)))  # clutches make events
        self.parameters = self.collected.bind.parameters
        self._added: tuple[Symbol, ...] = ()
        self.nullity = 0
        self._joints: JointSpace | None = None
        self._is_driven = bool(self.inputs)

    def __reduce__(self) -> tuple:
        parts = (self.elements, self.parameters, ca.SX(self.lam), self.vdot, self._added, self._is_driven)
        return reduction(_restored, *parts)

    @property
    def without_inputs(self) -> "System":
        """The system with inputs of value 0, as in runs."""
        if not self._is_driven:
            return self
        return self._with(lam=self.lam, vdot=self.vdot, _is_driven=False)

    @cached_property
    def with_inputs(self) -> "System":
        """The system with its inputs as the last parameters."""
        if not self._is_driven:
            return self
        system = self.with_elements((), self.parameters.with_inputs([*self.inputs.values()]))
        return system if self._joints is None else system.joint_space()

    def _driven(self, name: str) -> ca.SX:
        """A part of the equations in the coordinates of this system, with inputs as symbols."""
        own = self.with_inputs
        part = getattr(own.collected, name) if name != "s_rate" else own.s_rate
        if own is self:
            return part
        return ca.substitute(part, ca.vertcat(own.q, own.v, own.s), ca.vertcat(self.q, self.v, self.s))

    def with_states(self, states: Sequence[Symbol]) -> "System":
        """A copy with additional first-order states that outputs need."""
        added, collected = (*self._added, *states), replace(self.collected, states=(*self.collected.states, *states))
        # Outputs contain the symbols of multipliers and accelerations.
        return self._with(collected=collected, _added=added, lam=self.lam, vdot=self.vdot)

    def with_elements(self, more: Sequence[Element], parameters: Parameters) -> "System":
        """A copy with more elements and more parameters. The parameters of this system come first."""
        return _restored((*self.elements, *more), parameters, ca.SX(self.lam), self.vdot, self._added)

    def keeping(self, rows: Sequence[int], nullity: int = 0) -> "System":
        """A copy with only these rows, and new multipliers. `nullity` linear combinations of the rows vanish."""
        return self._with(collected=self.collected.keeping(rows), nullity=nullity)

    def _with(self, **changes: Any) -> "System":
        """A copy in which some attributes are changed. Derived attributes are not copied."""
        other = object.__new__(System)
        vars(other).update({name: vars(self)[name] for name in _DECLARED} | changes)
        return other

    @kept_interrupts()
    def joint_space(self, turns: Mapping[str, int] | None = None) -> "System":
        """The same system in joint coordinates. Constraint rows that the joint coordinates satisfy are left out.

        The joints of a spanning tree determine the poses of the bodies. Joints that close loops keep their rows. Bodies
        without a joint in the tree, flexible bodies and particles keep their coordinates. `turns` (see `JointSpace`)
        are rarely needed.

        Examples
        --------
        >>> import symmb as mb
        >>> rod = mb.Body("rod", mass=3.0, inertia=1.0)
        >>> pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(-1, 0))
        >>> system = mb.System(rod, pin, mb.Torque("motor", rod, 8.0)).joint_space()
        >>> system.q, system.v, system.Phi.numel()
        (SX(pin.angle), SX(pin.angle_rate), 0)
        """
        if gated := self.collected.gated:
            names = ", ".join(map(repr, gated))
            raise DeclarationError(
                f"Joint coordinates are not possible, because {names} may open or close. Use coordinates of bodies."
            )
        joints = JointSpace(self.collected, self.elements, turns or {})
        return self._with(collected=joints.collected, nullity=0, _joints=joints)

    @property
    def joints(self) -> "JointSpace":
        """The joint coordinates of a system that `joint_space()` returned."""
        if self._joints is None:
            raise DeclarationError("The system has coordinates of bodies. Use system.joint_space().joints.")
        return self._joints

    @property
    def bind(self) -> Binding:
        """Converts expressions of the system's symbols (numbers, SX or SymPy) into SX."""
        return self.collected.bind

    @property
    def inputs(self) -> dict[str, Symbol]:
        """The symbols of the inputs that are not parameters, by name."""
        inputs = [e for e in self.elements if isinstance(e, Input) and e.name not in self.parameters]
        return {u.name: u.symbol for u in inputs}

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The declared bodies."""
        return self.collected.bodies

    @property
    def p(self) -> ca.SX:
        """Parameters, (n_p,)."""
        return self.parameters.symbols

    @property
    def q(self) -> ca.SX:
        """Coordinates, (n_q,) [m, rad, -]."""
        return self.collected.q

    @property
    def v(self) -> ca.SX:
        """Velocities, (n_v,) [m/s, rad/s]."""
        return self.collected.v

    @property
    def s(self) -> ca.SX:
        """First-order states, (n_s,)."""
        return ca.vertcat(*[s.sx for s in self.collected.states]) if self.collected.states else ca.SX(0, 1)

    @cached_property
    def s_rate(self) -> ca.SX:
        """Rates of the first-order states, (n_s,)."""
        if self._is_driven:
            return self._driven("s_rate")
        states = self.collected.states
        return ca.vertcat(*[s.rate for s in states]) if states else ca.SX(0, 1)

    @cached_property
    def lam(self) -> Multipliers:
        """Multipliers, (n_c + n_psi,) [N, N m]. `lam("elbow")` returns the multipliers of one joint."""
        names = self.collected.row_names
        lam = Multipliers(ca.vertcat(*[ca.SX.sym(n) for n in names]) if names else ca.SX(0, 1))
        lam.rows = self.collected.rows
        return lam

    @cached_property
    def vdot(self) -> ca.SX:
        """Accelerations as symbols for outputs, (n_v,) [m/s^2, rad/s^2]."""
        return ca.vertcat(*[ca.SX.sym(f"{name}.rate") for name in self.collected.v_names])

    @cached_property
    def solved_hashes(self) -> frozenset[int]:
        """Hashes of multipliers and accelerations, which identify outputs that need a solution of the equations."""
        return frozenset(s.element_hash() for s in ca.vertsplit(ca.vertcat(ca.SX(self.lam), self.vdot)))

    def ddt(self, expression: Expr) -> ca.SX:
        """Rate of an expression of coordinates, velocities, first-order states and `t`, for outputs: d/dt f(q, v, t).

        Unlike `symmb.ddt`, this method accepts velocities: `system.ddt(ram.vx)` is an acceleration.

        Raises
        ------
        DeclarationError
            If the expression contains an unknown symbol or a multiplier

        Examples
        --------
        >>> import symmb as mb
        >>> rod = mb.Body("rod", mass=1.0, inertia=0.1)
        >>> mb.System(rod).ddt(rod.omega**2)
        SX(((2.*rod.omega)*rod.omega.rate))
        """
        c = self.collected
        pairs = zip(ca.vertsplit(self.v), ca.vertsplit(self.vdot), strict=True)
        accelerations = {v.element_hash(): a for v, a in pairs}
        # No element acts on these coordinates, so they move uniformly.
        accelerations |= {v.element_hash(): ca.SX(0) for _, _, _, v in c.decoupled}
        return rate(self.bind(expression, "ddt", any_size=True), accelerations)

    @property
    def M(self) -> ca.SX:
        """Mass matrix, (n_v, n_v), block-diagonal by body [kg, kg m^2]."""
        return self.collected.M if self._joints is None else self._joints.M

    def inertial(self, a: ca.SX) -> ca.SX:
        """Inertial forces M a (n_v,) for accelerations a (n_v,)."""
        return self.M @ a if self._joints is None else self._joints.inertial(a)

    @property
    def Q(self) -> ca.SX:
        """Generalised forces with gyroscopic terms, (n_v,) [N, N m]. Inputs are symbols in all equations."""
        return self._driven("Q")

    @property
    def Phi(self) -> ca.SX:
        """Position constraints, (n_c,)."""
        return self._driven("Phi")

    @property
    def Psi(self) -> ca.SX:
        """Velocity-only constraints, (n_psi,)."""
        return self._driven("Psi")

    @cached_property
    def qdot(self) -> ca.SX:
        """Rates of the coordinates N v, (n_q,)."""
        return self.collected.qdot

    @cached_property
    def N(self) -> ca.SX:
        """N(q) in q' = N v, (n_q, n_v)."""
        return ca.jacobian(self.qdot, self.v)

    @cached_property
    def Phi_q(self) -> ca.SX:
        """Jacobian of the position constraints, (n_c, n_q)."""
        return ca.jacobian(self.Phi, self.q)

    @cached_property
    def Phi_t(self) -> ca.SX:
        """Partial time derivative of the position constraints, (n_c,), nonzero only in rows of drives."""
        return ca.sparsify(ca.jacobian(self.Phi, t))

    @cached_property
    def Phi_dot(self) -> ca.SX:
        """Rates of all rows, [Phi_v v + Phi_s s' + Phi_t; Psi], (n_c + n_psi,)."""
        x, rates = ca.vertcat(self.q, self.s), ca.vertcat(self.qdot, self.s_rate)
        return ca.densify(ca.vertcat(ca.jtimes(self.Phi, x, rates) + self.Phi_t, self.Psi))

    @cached_property
    def G(self) -> ca.SX:
        """Velocity Jacobian of all rows, [Phi_v; Psi_v], (n_c + n_psi, n_v)."""
        return ca.sparsify(ca.jacobian(self.Phi_dot, self.v))

    @cached_property
    def gamma(self) -> ca.SX:
        """Right side of G v' = gamma, (n_c + n_psi,). gamma is minus the time derivative of `Phi_dot` for v' = 0."""
        x, rates = ca.vertcat(self.q, self.s), ca.vertcat(self.qdot, self.s_rate)
        return ca.densify(-(ca.jtimes(self.Phi_dot, x, rates) + ca.jacobian(self.Phi_dot, t)))

    @cached_property
    def block_sizes(self) -> tuple[int, ...]:
        """Number of velocities of each body, which are the sizes of the blocks of M."""
        return self.collected.block_sizes

    @cached_property
    def solve(self) -> Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
        """Solver (f, g) -> (a, lam) of M a + G' lam = f, G a = g, with one factorisation. See `saddle_solver`."""
        if self._joints is not None and not self.G.shape[0]:
            return self._joints.solve
        coupled = any(body.nearly_singular for body in self.bodies)
        c = self.collected
        return saddle_solver(self.M, self.G, self.block_sizes, coupled, self.nullity, c.gates, 1 / c.units)

    @cached_property
    def accelerations(self) -> ca.SX:
        """Accelerations (n_v,) that satisfy all rows [m/s^2, rad/s^2]."""
        if self._joints is not None and not self.G.shape[0] and not self._is_driven:
            return self._joints.accelerations
        return self.solve(self.Q, self.gamma)[0]

    def retract(self, delta: ca.SX) -> ca.SX:
        """Coordinates (n_q,) after a small displacement delta = v dt (n_v,). Quaternions keep norm 1."""
        return self.collected.retract(delta) if self._joints is None else self._joints.retract(self.q, delta)

    @property
    def kinetic_energy(self) -> ca.SX:
        """Kinetic energy v' M v / 2 [J]."""
        return 0.5 * ca.dot(self.v, self.inertial(self.v))

    @property
    def potential_energy(self) -> ca.SX:
        """Potential of gravity and springs [J]."""
        return self._driven("potential")

    @cached_property
    def power(self) -> ca.SX:
        """Power of forces without potential, of drives and of added or removed mass [W].

        The power depends on q, v, s, lam, p and t. Mass joins and leaves at the velocity of the body, so M v' = Q.
        """
        at_rest = ca.substitute(self.Phi_dot, self.v, ca.SX.zeros(self.v.shape))
        of_forces = self.collected.power if self._joints is None else self._joints.power
        return of_forces + ca.dot(ca.SX(self.lam), at_rest)

    @kept_interrupts()
    def reaction(self, name: str) -> "model.Reaction":
        """Force [N] and torque [N m] of a joint on its second body, at the joint's point, in world axes.

        Raises
        ------
        DeclarationError
            If there is no joint with this name between two bodies
        """
        return model.reaction([e for e in self.elements if isinstance(e, Joint)], name, self.Phi, self.lam)

    def force(self, name: str) -> ca.SX:
        """Force of the element with this name [N, N m], such as the tension of a spring or the torque of a motor.

        The force of a contact is its normal force. For several contact points, the normal forces are added.

        Raises
        ------
        DeclarationError
            If there is no element with this name, or if its force is not a scalar
        """
        name = normal(name)
        forces = {key: force for key, force in self.collected.forces.items() if force is not None}
        if isinstance(name, str) and name in self.lam.rows and name not in forces:
            raise DeclarationError(f"system.force: the force of {name!r} is a multiplier. Use system.lam({name!r}).")
        require_name("system.force", "element with a force", name, forces)
        return forces[name]

    @cached_property
    def positive(self) -> tuple[tuple[str, ...], ca.Function]:
        """Masses and lengths that must be above 0: names (n,) and a Function p -> values (n,)."""
        names, values = [name for name, _ in self.collected.positive], [value for _, value in self.collected.positive]
        return tuple(names), ca.Function("positive", [self.p], [ca.vertcat(ca.SX(0, 1), *values)])

    def sign_faults(self, box: Box) -> list[str]:
        """Messages for masses and for numbers such as lengths that are not positive at a corner of the box."""
        return sign_faults(*self.positive, self.parameters, box)

    @property
    def names(self) -> dict[str, ca.SX]:
        """All symbols by name: parameters, coordinates, velocities, states, multipliers and time."""
        c = self.collected
        names = (*self.parameters, *c.q_names, *c.v_names, *(s.name for s in c.states), *c.row_names, "t")
        inputs = {name: symbol.sx for name, symbol in self.inputs.items()}
        symbols = ca.vertsplit(ca.vertcat(self.p, self.q, self.v, self.s, self.lam, t))
        return dict(zip(names, symbols, strict=True)) | inputs

    def __repr__(self) -> str:
        return model.system_text(self, self._joints)


def _restored(
    elements: tuple[Body | Element, ...],
    parameters: Parameters,
    lam: ca.SX,
    vdot: ca.SX,
    added: tuple[Symbol, ...],
    is_driven: bool = False,
) -> System:
    """A system from its pickle. It keeps symbols of multipliers and accelerations, because outputs may contain them."""
    system = System(*elements, parameters=parameters)
    system._is_driven = is_driven
    rows, system.lam, system.vdot = system.lam.rows, Multipliers(lam), vdot
    system.lam.rows = rows
    return system.with_states(added) if added else system
