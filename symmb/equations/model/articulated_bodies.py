"""Motion and forces along a tree of joints: recursions from body to body.

Every body has working axes W and an origin. For a spatial body on a joint, W and the origin are those of the joint
frame. The axes W of a planar body are parallel to the world axes. Accelerations (a, alpha) are accelerations of the
origin in working axes, and forces (f, n) act at the origin.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from symmb.declare.mechanics import Body, Planar, Spatial
from symmb.declare.symbolic import conjugate, product, rotation_z, symmetric_solver
from symmb.equations.model.joint_motion import JointMotion
from symmb.equations.model.spanning_tree import Carrying, Link


@dataclass(frozen=True, eq=False)
class Placed:
    """Position and motion of a body."""

    axes: ca.SX  # (3, 3), W to world
    body_axes: ca.SX  # (3, 3), W to body
    origin: ca.SX  # (3,), in world axes [m]
    velocity: ca.SX  # (3,), of the origin in world axes [m/s]
    spin: ca.SX  # (3,), angular velocity in W [rad/s]
    center: ca.SX  # (3,), centre of mass from the origin, in W [m]
    angle: ca.SX  # about z, of a planar body [rad]
    quaternion: ca.SX  # (4,), of a spatial body
    turn: ca.SX  # (3, 3), W to the carrier's W
    arm: ca.SX  # (3,), from the carrier's origin to the origin, in the carrier's W [m]
    bias: ca.SX  # (6,), (a, alpha) for zero accelerations of the carrier and the joint
    H: ca.SX  # (6, n), accelerations of the body for unit accelerations of the joint

    @property
    def rotation(self) -> ca.SX:
        """Rotation matrix from body axes to world axes, (3, 3)."""
        return self.axes @ self.body_axes.T

    @property
    def r(self) -> ca.SX:
        """Centre of mass in world axes [m], (3,)."""
        return self.origin + self.axes @ self.center

    @property
    def omega(self) -> ca.SX:
        """Angular velocity in body axes [rad/s], (3,)."""
        return self.body_axes @ self.spin

    @property
    def r_dot(self) -> ca.SX:
        """Velocity of the centre of mass in world axes [m/s], (3,)."""
        return self.velocity + self.axes @ ca.cross(self.spin, self.center)


_I, _O = ca.SX.eye(3), ca.SX(3, 1)
GROUND = Placed(
    _I, _I, _O, _O, _O, _O, ca.SX(0), ca.SX(ca.sparsify(ca.DM([1, 0, 0, 0]))), _I, _O, ca.SX(6, 1), ca.SX(6, 0)
)


def free(body: Body) -> Placed:
    """A body without a carrying joint. The coordinates of the body determine its acceleration."""
    frame = body.frame
    n = frame.v.numel()
    axes = _I if isinstance(body.pose, Planar) or not isinstance(body.pose, Spatial) else frame.R
    S = frame.S
    H = ca.vertcat(axes.T @ S[:3, :], S[3:, :])
    return Placed(
        axes=axes,
        body_axes=frame.R.T @ axes if not isinstance(body.pose, Spatial) else _I,
        origin=frame.r,
        velocity=frame.velocity,
        spin=frame.omega,
        center=_O,
        angle=frame.angle,
        quaternion=frame.q[3:7] if isinstance(body.pose, Spatial) else _about_z(frame.angle),
        turn=axes,
        arm=_O,
        bias=ca.SX(6, 1),
        H=H[:, :n],
    )


def carried(body: Body, by: Carrying, carrier: Placed) -> Placed:
    """A body that a joint carries."""
    motion = by.motion
    planar = isinstance(body.pose, Planar)
    # From the carrier's W to its joint frame. This rotation is constant unless the carrier is planar.
    joint_axes = carrier.body_axes.T @ motion.carrier
    angle = carrier.angle + motion.angle if planar else ca.SX(0)
    if planar:
        axes, turn = _I, _I
        body_axes = rotation_z(angle).T
        to_joint = body_axes.T @ motion.follower  # the follower's joint frame in W
    else:
        turn = joint_axes @ motion.turn
        axes = carrier.axes @ turn
        body_axes, to_joint = motion.follower, _I
    foot = carrier.body_axes.T @ by.on_carrier + carrier.center
    shift = joint_axes @ motion.shift
    arm = foot + shift
    spin_c = turn.T @ carrier.spin
    spin_r = to_joint @ motion.spin
    sliding = joint_axes @ motion.speed
    H_shift, H_spin = joint_axes @ motion.speed_matrix, to_joint @ motion.spin_matrix
    change = (
        ca.cross(carrier.spin, ca.cross(carrier.spin, arm))
        + 2 * ca.cross(carrier.spin, sliding)
        + joint_axes @ motion.speed_change
    )
    return Placed(
        axes=axes,
        body_axes=body_axes,
        origin=carrier.origin + carrier.axes @ arm,
        velocity=carrier.velocity + carrier.axes @ (ca.cross(carrier.spin, arm) + sliding),
        spin=spin_c + spin_r,
        center=-body_axes.T @ by.on_body,
        angle=angle,
        quaternion=_about_z(angle) if planar else _product(carrier.quaternion, motion),
        turn=turn,
        arm=arm,
        bias=ca.vertcat(turn.T @ change, ca.cross(spin_c, spin_r) + to_joint @ motion.spin_change),
        H=ca.vertcat(turn.T @ H_shift, H_spin),
    )


def _about_z(angle: ca.SX) -> ca.SX:
    return ca.vertcat(ca.cos(angle / 2), 0, 0, ca.sin(angle / 2)) if angle.numel() else GROUND.quaternion


def _product(carrier: ca.SX, motion: JointMotion) -> ca.SX:
    on_carrier = product(motion.carrier_quaternion, motion.quaternion)
    return product(product(carrier, on_carrier), conjugate(motion.follower_quaternion))


class ArticulatedBodies:
    """The mass matrix, forces and accelerations of bodies on a tree of joints. Carriers come first."""

    def __init__(self, bodies: Sequence[Body], links: Sequence[Link]) -> None:
        self.links = links
        self.placed: dict[int | None, Placed] = {None: GROUND}
        self.columns: dict[int, slice] = {}
        at = 0
        for link in links:
            body, carrying = bodies[link.body], link.carrying
            here = free(body) if carrying is None else carried(body, carrying, self.placed[carrying.carrier])
            self.placed[link.body] = here
            self.columns[link.body] = slice(at, at + here.H.shape[1])
            at += here.H.shape[1]
        self.n_v = at

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of velocities of each tree of bodies, in order."""
        sizes: list[int] = []
        for link in self.links:
            own = self.columns[link.body]
            alone = link.carrying is None or link.carrying.carrier is None
            sizes = [*sizes, own.stop - own.start] if alone else [*sizes[:-1], sizes[-1] + own.stop - own.start]
        return tuple(sizes)

    def loads(self, M: Mapping[int, ca.SX], Q: Mapping[int, ca.SX]) -> "Loads":
        """Inertia and forces of the bodies. M (6, 6) and Q (6,) are at centres of mass, in world and body axes."""
        inertia = {link.body: self._inertia(link, M[link.body]) for link in self.links}
        force = {link.body: self._force(link, M[link.body], Q[link.body]) for link in self.links}
        return Loads(self, inertia, force)

    def _inertia(self, link: Link, M: ca.SX) -> ca.SX:
        here = self.placed[link.body]
        m, J, c = M[0, 0], here.body_axes.T @ M[3:, 3:] @ here.body_axes, ca.skew(here.center)
        return _symmetric(m * _I, -m * c, J - m * c @ c)

    def _force(self, link: Link, M: ca.SX, Q: ca.SX) -> ca.SX:
        here = self.placed[link.body]
        f = here.axes.T @ Q[:3] - M[0, 0] * ca.cross(here.spin, ca.cross(here.spin, here.center))
        return ca.vertcat(f, here.body_axes.T @ Q[3:] + ca.cross(here.center, f))


class Loads:
    """Inertia (6, 6) and forces (6,) of bodies on a tree of joints, in working axes W and at origins of the bodies.

    The articulated-body algorithm computes accelerations, and the composite-rigid-body algorithm computes the mass
    matrix. (Featherstone 2008, Rigid Body Dynamics Algorithms, chapters 6 and 7)
    """

    def __init__(self, tree: ArticulatedBodies, inertia: dict[int, ca.SX], force: dict[int, ca.SX]) -> None:
        self._tree, self._inertia, self._force = tree, inertia, force

    @cached_property
    def _drift(self) -> dict[int | None, ca.SX]:
        """Accelerations (6,) of each body for joint accelerations of 0."""
        A: dict[int | None, ca.SX] = {None: ca.SX(6, 1)}
        for link, here, carrier in self._walk():
            A[link.body] = _from_carrier(here, A[carrier]) + here.bias
        return A

    def _walk(self) -> list[tuple[Link, Placed, int | None]]:
        carriers = [None if link.carrying is None else link.carrying.carrier for link in self._tree.links]
        return [(link, self._tree.placed[link.body], at) for link, at in zip(self._tree.links, carriers, strict=True)]

    @cached_property
    def M(self) -> ca.SX:
        """Mass matrix (n_v, n_v)."""
        composite = dict(self._inertia)
        M = ca.SX(self._tree.n_v, self._tree.n_v)
        carriers = {link.body: carrier for link, _, carrier in self._walk()}
        for link, here, carrier in reversed(self._walk()):
            F, own = composite[link.body] @ here.H, self._tree.columns[link.body]
            # The exact symmetry halves the operations, and rounding cannot make M unsymmetric.
            M[own, own] = ca.triu2symm(ca.triu(here.H.T @ F))
            if carrier is not None:
                composite[carrier] = composite[carrier] + _inertia_to_carrier(here, composite[link.body])
            at = link.body
            while (above := carriers[at]) is not None:
                F, at = _to_carrier(self._tree.placed[at], F), above
                columns = self._tree.columns[at]
                M[columns, own] = self._tree.placed[at].H.T @ F
                M[own, columns] = M[columns, own].T
        return ca.sparsify(M)

    @cached_property
    def Q(self) -> ca.SX:
        """Generalised forces along the joints' velocities (n_v,), including velocity-dependent inertial forces."""
        return self._along_joints(
            {body: force - self._inertia[body] @ self._drift[body] for body, force in self._force.items()}
        )

    def inertial(self, a: ca.SX) -> ca.SX:
        """Inertial forces M a (n_v,) for accelerations a (n_v,), computed without the matrix M."""
        A: dict[int | None, ca.SX] = {None: ca.SX(6, 1)}
        for link, here, carrier in self._walk():
            own = here.H @ a[self._tree.columns[link.body]] if here.H.shape[1] else ca.SX(6, 1)
            A[link.body] = _from_carrier(here, A[carrier]) + own
        return self._along_joints({body: inertia @ A[body] for body, inertia in self._inertia.items()})

    def _along_joints(self, forces: dict[int, ca.SX]) -> ca.SX:
        """Generalised forces (n_v,) along the joints' velocities, from forces (6,) on the bodies."""
        F, along = dict(forces), ca.SX(self._tree.n_v, 1)
        for link, here, carrier in reversed(self._walk()):
            if here.H.shape[1]:
                along[self._tree.columns[link.body]] = here.H.T @ F[link.body]
            if carrier is not None:
                F[carrier] = F[carrier] + _to_carrier(here, F[link.body])
        return ca.densify(along)

    @cached_property
    def _articulated(self) -> dict[int, tuple[ca.SX, Callable[[ca.SX], ca.SX], ca.SX]]:
        """For each body: U = M H, a solver of H' M H z = r, and the articulated inertia (6, 6) for the carrier."""
        M, parts = dict(self._inertia), {}
        # From the tips to the roots: the inertia of a body must contain all bodies that it carries.
        for link, here, carrier in reversed(self._walk()):
            U = M[link.body] @ here.H
            invert = _inverse(here.H.T @ U)
            rest = M[link.body]
            if carrier is not None:
                if U.shape[1]:
                    rest = ca.triu2symm(ca.triu(rest - U @ invert(U.T)))
                M[carrier] = M[carrier] + _inertia_to_carrier(here, rest)
            parts[link.body] = U, invert, rest
        return parts

    def solve(self, f: ca.SX) -> ca.SX:
        """Accelerations M^-1 f (n_v,) for forces f (n_v,) along the joints' velocities."""
        zero = {link.body: ca.SX(6, 1) for link in self._tree.links}
        return self._accelerations(f, zero, zero)

    @cached_property
    def accelerations(self) -> ca.SX:
        """Accelerations M^-1 Q (n_v,)."""
        bias = {link.body: here.bias for link, here, _ in self._walk()}
        return self._accelerations(ca.SX(self._tree.n_v, 1), self._force, bias)

    def _accelerations(self, f: ca.SX, forces: dict[int, ca.SX], bias: dict[int, ca.SX]) -> ca.SX:
        F, along = dict(forces), {}
        for link, here, carrier in reversed(self._walk()):
            U, invert, rest = self._articulated[link.body]
            left = F[link.body] - rest @ bias[link.body]
            if U.shape[1]:
                own = f[self._tree.columns[link.body]] + here.H.T @ F[link.body]
                along[link.body], left = own, left - U @ invert(own)
            if carrier is not None:
                F[carrier] = F[carrier] + _to_carrier(here, left)
        A: dict[int | None, ca.SX] = {None: ca.SX(6, 1)}
        result = ca.SX(self._tree.n_v, 1)
        for link, here, carrier in self._walk():
            U, invert, _ = self._articulated[link.body]
            A_c = _from_carrier(here, A[carrier]) + bias[link.body]
            if U.shape[1]:
                rates = invert(along[link.body] - U.T @ A_c)
                result[self._tree.columns[link.body]] = rates
                A_c = A_c + here.H @ rates
            A[link.body] = A_c
        return ca.densify(result)


def _inverse(D: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Solver of D z = r for a symmetric D (n, n), and r (n, k)."""
    n = D.shape[0]
    if n == 1:
        over = 1 / D
        return lambda r: over * r
    if ca.sparsify(D).sparsity().is_diag():
        over = ca.sparsify(ca.diag(1 / ca.diag(D)))
        return lambda r: over @ r
    solve = symmetric_solver(D)
    return lambda r: ca.horzcat(*[solve(r[:, k]) for k in range(r.shape[1])])


def _to_carrier(here: Placed, F: ca.SX) -> ca.SX:
    """Forces (6, k), moved to the carrier's origin and working axes."""
    f = here.turn @ F[:3, :]
    return ca.vertcat(f, here.turn @ F[3:, :] + ca.skew(here.arm) @ f)


def _from_carrier(here: Placed, A: ca.SX) -> ca.SX:
    """The acceleration (6,) of a body for the acceleration A (6,) of its carrier."""
    return ca.vertcat(here.turn.T @ (A[:3] + ca.cross(A[3:], here.arm)), here.turn.T @ A[3:])


def _inertia_to_carrier(here: Placed, M: ca.SX) -> ca.SX:
    """An inertia (6, 6), moved to the carrier's origin and working axes."""
    K, arm = here.turn, ca.skew(here.arm)
    P, B, C = K @ M[:3, :3] @ K.T, K @ M[:3, 3:] @ K.T, K @ M[3:, 3:] @ K.T
    P = ca.triu2symm(ca.triu(P))
    moved = B - P @ arm
    return _symmetric(P, moved, C + arm @ moved + (arm @ B).T)


def _symmetric(P: ca.SX, B: ca.SX, C: ca.SX) -> ca.SX:
    return ca.sparsify(ca.triu2symm(ca.triu(ca.vertcat(ca.horzcat(P, B), ca.horzcat(ca.SX(3, 3), C)))))
