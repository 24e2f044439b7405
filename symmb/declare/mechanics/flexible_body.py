"""Flexible bodies: a floating frame, and small deformations relative to it in modal coordinates.

A material point of the body is at r + R (s + u). The displacement u is the sum of mode shapes times modal coordinates
eta. The first moment f(eta), the inertia J(eta) about the frame's origin, and the angular momentum G(eta) eta' are in
the frame's axes. f, J and G are polynomials in eta with constant coefficients (`Modes`). The kinetic energy is

    T = m r'.r' / 2 + r'.R (omega x f + f_eta eta') + omega.J omega / 2 + omega.G eta' + eta'.m_eta eta' / 2

and the Boltzmann-Hamel equations give all inertia forces. The modal part m_eta of the mass matrix is the identity.
Structures with parameters are an exception: their inertia and stiffness are sums of these polynomials. An expression of
parameters multiplies each polynomial.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import NOTHING, SAME, SLIGHT
from symmb._options import is_whole, shown
from symmb._types import Array, Expr
from symmb.declare.mechanics.body import AbstractBody, Body, Inertial, Point
from symmb.declare.mechanics.pose import Frame, Planar, Pose, Spatial
from symmb.declare.structures import Invariants, Modes
from symmb.declare.symbolic import rotation_matrix, rotation_z, vector


@dataclass(frozen=True, eq=False, init=False)
class FlexibleBody(Body):
    """A flexible body with a floating frame and modal coordinates `name.eta1`, ... Without modes the body is rigid.

    The modes determine the frame: it is at the centre of mass of the undeformed body, or clamped to a node.
    Deformations are small. Joints and loads act at the nodes of the body.

    Parameters
    ----------
    name : str
        without dots
    modes : Modes
        mass, inertia, mode shapes and stiffness. Modes of structures with parameters depend on the parameters
    pose : Pose
        `Spatial()`, or `Planar()` if all modes move in the xy plane

    Examples
    --------
    >>> import symmb as mb
    >>> steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    >>> beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=8)
    >>> rod = mb.FlexibleBody("rod", mb.FiniteElements.beams(beam).modes(count=4))
    >>> rod.point(0.5, 0).body.name, rod.pose.coordinates[-1]
    ('rod.node4', 'eta4')

    References
    ----------
    Shabana, Dynamics of Multibody Systems, ch. 5 (floating frame of reference);
    Wallrapp, Standardization of flexible body modeling in multibody system codes, Mech. Struct. Mach. 22 (1994).
    """

    _is_flexible: ClassVar[bool] = True
    modes: Modes = field(kw_only=True)

    def __init__(self, name: str, modes: Modes, pose: Pose | None = None) -> None:
        if not isinstance(modes, Modes):
            raise DeclarationError(
                f"FlexibleBody {name!r}: expected Modes, got {type(modes).__name__}. "
                "Use FiniteElements(...).modes(...) or Modes.load(path)."
            )
        pose = Spatial() if pose is None else pose
        if not isinstance(pose, Planar | Spatial):
            raise DeclarationError(f"FlexibleBody {name!r}: pose {pose!r} has no rotation. Use Planar() or Spatial().")
        options = {"name": name, "mass": modes.mass, "com": (0.0, 0.0, 0.0), "modes": modes}
        J = (modes.J0 + modes.J0.T) / 2
        options |= {
            "inertia": float(J[2, 2]) if isinstance(pose, Planar) else J,
            "pose": type(pose)(len(modes.stiffness)),
        }
        if modes.family is not None:
            total = _sum(modes, lambda part: ca.SX(ca.DM(part.mass)))
            whole = _sum(modes, lambda part: ca.SX(ca.DM((part.J0 + part.J0.T) / 2)))
            options |= {"mass": total, "inertia": whole[2, 2] if isinstance(pose, Planar) else ca.SX(whole)}
        for key, value in options.items():
            object.__setattr__(self, key, value)
        self.__post_init__()

    @property
    def faults(self) -> tuple[str, ...]:
        if not isinstance(self.pose, Planar) or not len(self.modes.stiffness):
            return ()
        m = self.modes
        out = max(np.abs(m.shapes[:, 2]).max(initial=0.0), np.abs(m.S[2]).max(initial=0.0))
        largest = max(np.abs(m.shapes).max(initial=0.0), np.abs(m.S).max(initial=0.0))
        turned = np.abs(m.rotations[:, :2]).max(initial=0.0), np.abs(m.rotations).max(initial=0.0)
        if out <= SAME * largest and turned[0] <= SAME * turned[1]:
            return ()
        return (
            f"FlexibleBody {self.name!r}: the modes have displacements out of the xy plane. Compute modes with "
            "FiniteElements.modes(..., planar=True), or use pose=Spatial().",
        )

    @property
    def nearly_singular(self) -> bool:
        # Modes relative to a clamped frame can represent nearly all of the frame's rigid motion.
        return bool(self.modes.S.any() or self.modes.G0.any())

    @property
    def eta(self) -> ca.SX:
        """Modal coordinates [m sqrt(kg)], (n,)."""
        return self.frame.q[-self._n :] if self._n else ca.SX(0, 1)

    @property
    def eta_dot(self) -> ca.SX:
        """Rates of the modal coordinates [m sqrt(kg)/s], (n,)."""
        return self.frame.v[-self._n :] if self._n else ca.SX(0, 1)

    @property
    def _n(self) -> int:
        return len(self.modes.stiffness)

    def node(self, number: int) -> Point:
        """The point of a node. The point moves and turns with the node.

        Raises
        ------
        DeclarationError
            If no node has this number
        """
        count = len(self.modes.positions)
        if not is_whole(number) or not 0 <= number < count:
            raise DeclarationError(
                f"FlexibleBody {self.name!r} has no node {shown(number)}. The nodes are 0 to {count - 1}."
            )
        return Point(self._carrier(number), ca.SX(3, 1))

    def point(self, x: Expr, y: Expr, z: Expr = 0) -> Point:
        """Point at (x, y, z) [m] of the undeformed body in the mesh's axes: a node, or the end of a rigid arm.

        The rigid arm starts at the nearest node.

        Raises
        ------
        DeclarationError
            If a coordinate is not a number, if the point is between nodes, or if nodes have no rotations and the point
            is not at a node
        """
        m = self.modes
        if not all(isinstance(part, Real) for part in (x, y, z)):
            raise DeclarationError(
                f"point of {self.name!r}: points of a flexible body must be numbers, got {(x, y, z)!r}. "
                "Use parameters in joints, forces or rigid bodies instead."
            )
        place = np.array([x, y, z], dtype=float) - m.origin
        number = m.nearest(*place)
        arm = place - m.positions[number]
        arm[np.abs(arm) < SAME * np.ptp(m.positions, axis=0).max(initial=NOTHING)] = 0.0
        if arm.any() and self._n and not m.rotations.any():
            raise DeclarationError(
                f"point of {self.name!r}: there is no node at ({x:g}, {y:g}, {z:g}). Other points need nodes with "
                f"rotations, which this mesh does not have. Use the nearest node {number} at "
                f"{tuple((m.positions[number] + m.origin).tolist())}."
            )
        if arm.any() and self._n and (other := self._beyond(number, arm)) is not None:
            raise DeclarationError(
                f"point of {self.name!r}: ({x:g}, {y:g}, {z:g}) is between the nodes {number} and {other}, and no node "
                "follows the deformation at this point. Use one of the two nodes, or end a Beam at this point."
            )
        return Point(self._carrier(number), vector(arm.tolist()))

    def _beyond(self, number: int, arm: Array, short: float = 0.051) -> int | None:
        """The second node of the beam element that contains the end of a long arm from a node; else None."""
        structure, size = self.modes.flexibility, np.linalg.norm(np.ptp(self.modes.positions, axis=0))
        # An arm of half an element, in a beam of ten elements, bends little: it may be rigid.
        if structure is None or np.linalg.norm(arm) <= short * size:
            return None
        lines = self.modes.positions - self.modes.positions[number]
        along, length = lines @ arm, float(np.linalg.norm(arm))
        off = np.linalg.norm(lines - along[:, None] * arm / length**2, axis=1)
        ahead = np.flatnonzero((along > length**2) & (off <= SLIGHT * np.linalg.norm(lines, axis=1))).tolist()
        return next((other for other in ahead if structure.joins(number, other)), None)

    def number_of(self, carrier: AbstractBody) -> int | None:
        """The number of the node of a carrier; None if the carrier is not a node of this body."""
        return next((number for number, own in self._nodes.items() if own is carrier), None)

    @property
    def used_nodes(self) -> tuple[int, ...]:
        """Numbers of the nodes for which points have been declared."""
        return tuple(self._nodes)

    def _carrier(self, number: int) -> "_Carrier":
        if number not in self._nodes:
            m = self.modes
            place = _polynomial(m.positions[number], m.shapes[number], m.shapes2[number], self.eta)
            self._nodes[number] = _Carrier(self, f"node{number}", place, m.rotations[number])
        return self._nodes[number]

    @cached_property
    def _nodes(self) -> "dict[int, _Carrier]":
        """The frames of the used nodes. Each node has one frame only, because elements compare bodies by identity."""
        return {}

    @cached_property
    def center(self) -> AbstractBody:
        return _Carrier(self, "center", self._first_moment / self.mass, np.zeros_like(self.modes.S))

    @cached_property
    def _first_moment(self) -> ca.SX:
        """The first moment of mass about the frame's origin, in the frame's axes [kg m], (3,)."""
        return _sum(self.modes, lambda part: _polynomial(part.moment, part.S, part.S2, self.eta))

    @property
    def laws(self) -> ca.SX:
        family = self.modes.family
        return ca.SX(0, 1) if family is None else ca.vertcat(ca.vec(family.stiffness), family.damping)

    def inertial(self, mass: ca.SX, J: ca.SX) -> Inertial:
        m, n, eta, rate = self.modes, self._n, self.eta, self.eta_dot
        R, omega = self.frame.R, self.frame.omega
        first = self._first_moment
        S, J = ca.jacobian(first, eta), _sum(m, lambda part: _inertia(part, eta))
        G, modal = _sum(m, lambda part: _momentum(part, eta)), _sum(m, lambda part: _numbers(part.modal))
        # The momenta are those of a body with the frame's origin at rest. By Galilean invariance, inertia forces do not
        # depend on the velocity of the origin.
        P, H = ca.cross(omega, first) + S @ rate, J @ omega + G @ rate
        spin = G.T @ omega
        forces = -ca.vertcat(
            R @ (ca.jtimes(P, eta, rate) + ca.cross(omega, P)),
            ca.jtimes(H, eta, rate) + ca.cross(omega, H),
            ca.jtimes(spin, eta, rate) - ca.gradient(0.5 * ca.dot(omega, J @ omega) + ca.dot(spin, rate), eta),
        )
        moment = -R @ ca.skew(first)
        M = ca.blockcat([[mass * ca.SX.eye(3), moment, R @ S], [moment.T, J, G], [(R @ S).T, G.T, modal]])
        rigid = self.frame.S[:, :-n] if n else self.frame.S
        select = ca.diagcat(rigid, ca.SX.eye(n))
        family = m.family
        stiffness = ca.diag(_numbers(m.stiffness)) if family is None else family.stiffness
        damping = _numbers(m.damping) if family is None else family.damping
        none = ca.SX(rigid.shape[1], 1)
        return Inertial(
            M=ca.sparsify(select.T @ M @ select),
            Q=select.T @ forces - ca.vertcat(none, stiffness @ eta),
            Q_work=-ca.vertcat(none, damping * rate) if damping.nnz() else None,
            potential=0.5 * ca.dot(eta, stiffness @ eta),
            flows=False,
        )


class _Carrier(AbstractBody):
    """The frame of a node: at `place` (3,) in axes of the floating frame, turned by `rotations` (3, n) times eta."""

    def __init__(self, body: FlexibleBody, what: str, place: ca.SX, rotations: Array) -> None:
        self.name, self.pose, self.com, self._body = f"{body.name}.{what}", body.pose, (0.0, 0.0, 0.0), body
        frame, eta = body.frame, body.eta
        Phi, Theta = ca.jacobian(place, eta), _numbers(rotations)
        psi = Theta @ eta
        n = eta.numel()
        if isinstance(body.pose, Planar):
            angle = frame.angle + psi[2]
            R, turn, per_rate = rotation_z(angle), ca.SX.eye(3), Theta
        else:
            # Rodrigues parameters psi / 2 always give an orthogonal matrix. It agrees with the small rotation of the
            # mesh to second order.
            angle, wide = ca.SX(), 1 / (1 + ca.sumsqr(psi) / 4)
            turn = rotation_matrix(ca.vertcat(1, psi / 2)) if rotations.any() else ca.SX.eye(3)
            R, per_rate = frame.R @ turn, wide * (Theta - ca.skew(psi) @ Theta / 2)
        arm = -frame.R @ ca.skew(place)
        twist = ca.blockcat([[ca.SX.eye(3), arm, frame.R @ Phi], [ca.SX(3, 3), turn.T, per_rate]])
        rigid = frame.S[:, :-n] if n else frame.S
        select = ca.diagcat(rigid, ca.SX.eye(n))
        back = ca.blockcat([[ca.SX.eye(3), -arm @ turn], [ca.SX(3, 3), turn], [ca.SX(n, 3), ca.SX(n, 3)]])
        self.frame = Frame(
            frame.q,
            frame.v,
            frame.rate,
            frame.r + frame.R @ place,
            R,
            ca.sparsify(twist @ select),
            angle,
            ca.sparsify(select.T @ back),
            frame.records,
        )

    @property
    def owner(self) -> AbstractBody:
        return self._body


def _sum(modes: Modes, part: Callable[[Invariants], ca.SX]) -> ca.SX:
    """A part of the inertia, summed over the terms of a structure. Each term is multiplied by its expression."""
    first, *more = [law * part(some) for law, some in modes.masses]
    return sum(more, first)


def _numbers(values: Array) -> ca.SX:
    """Numbers as SX with structural zeros."""
    return ca.SX(ca.sparsify(ca.DM(values)))


def _polynomial(constant: Array, linear: Array, quadratic: Array, eta: ca.SX) -> ca.SX:
    """The polynomial (3,) of eta with coefficients (3,), (3, n) and (3, n, n)."""
    rows = [
        float(constant[k]) + ca.dot(_numbers(linear[k]) + _numbers(_triangle(quadratic[k])) @ eta, eta)
        for k in range(3)
    ]
    return ca.densify(ca.vertcat(*rows))


def _inertia(m: Invariants, eta: ca.SX) -> ca.SX:
    """The inertia J(eta) about the frame's origin, (3, 3)."""
    J = ca.SX(3, 3)
    for i in range(3):
        for k in range(i, 3):
            slope = _numbers(m.J1[:, i, k]) + _numbers(_triangle(m.J2[:, :, i, k])) @ eta
            J[i, k] = J[k, i] = float(m.J0[i, k]) + ca.dot(slope, eta)
    return ca.sparsify(J)


def _triangle(A: Array) -> Array:
    """The upper triangular matrix with the same quadratic form as a symmetric matrix, but half the products."""
    return np.triu(A) + np.triu(A, 1)


def _momentum(m: Invariants, eta: ca.SX) -> ca.SX:
    """The matrix G(eta) (3, n): G eta' is a part of the angular momentum about the frame's origin."""
    if not eta.numel():
        return ca.SX(3, 0)
    return ca.sparsify(ca.vertcat(*[(_numbers(m.G0[k]) + _numbers(m.G1[:, k, :]).T @ eta).T for k in range(3)]))
