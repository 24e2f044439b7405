"""Inertia of a deformed body as polynomials of the modal coordinates."""

from dataclasses import dataclass

import numpy as np

from symmb._magnitudes import ROUNDING
from symmb._types import Array
from symmb.declare.structures.mass_samples import MassSamples, Sparse

OF_MODES = 100.0
"""Rounding errors of products of modes, divided by rounding errors of other sums."""
EPSILON = np.array(
    [[[0, 0, 0], [0, 0, 1], [0, -1, 0]], [[0, 0, -1], [0, 0, 0], [1, 0, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]], float
)


@dataclass(frozen=True, eq=False)
class RigidInertia:
    """Mass [kg], its first moment [kg m] and inertia about the origin [kg m^2]."""

    mass: float
    moment: Array
    J0: Array

    @property
    def center(self) -> Array:
        """Centre of mass [m]."""
        return self.moment / self.mass


@dataclass(frozen=True, eq=False)
class Invariants:
    """Inertia of a body or of a part: fields as in `Modes`, the first moment [kg m], and the modal mass (n, n)."""

    mass: float
    moment: Array
    J0: Array
    J1: Array
    J2: Array
    S: Array
    S2: Array
    G0: Array
    G1: Array
    modal: Array


@dataclass(frozen=True, eq=False)
class Shapes:
    """Mode shapes X (d, n), rigid motions (d, 6) about an origin, and second-order displacements D (s, 3, n, n).

    Values that are very small compared with the inertia and length of the whole body are set to 0.
    """

    X: Array
    rigid: Array
    origin: Array
    D: Array | None
    whole: RigidInertia
    length: float

    def invariants(self, M: Sparse, samples: MassSamples) -> Invariants:
        """The invariants of the body, or of a part, from a mass matrix and mass samples."""
        momentum, modal = M @ self.rigid, self.X.T @ (M @ self.X)
        part, first = rigid_inertia(self.rigid.T @ momentum), momentum.T @ self.X
        J1, J2, G1, S2 = deformed_inertia(samples, self.X, self.origin, self.D)
        length, root = self.length, np.sqrt(self.whole.mass)
        return Invariants(
            mass=part.mass,
            moment=cleaned(part.moment, length * self.whole.mass),
            J0=cleaned(part.J0, np.trace(self.whole.J0)),
            J1=cleaned(J1, root * length),
            J2=cleaned(J2, max(1.0, np.abs(J2).max(initial=0))),
            S=cleaned(first[:3], root),
            S2=cleaned(S2, 1 / length),
            G0=cleaned(first[3:], root * length),
            G1=cleaned(G1, 1.0),
            modal=cleaned((modal + modal.T) / 2, OF_MODES),
        )


def rigid_inertia(M: Array) -> RigidInertia:
    """Rigid inertia from the (6, 6) mass matrix Rᵀ M R of unit rigid translations and rotations about the origin."""
    mass = np.trace(M[:3, :3]) / 3
    moment = M[:3, 3:]  # -m [c ×]
    first = np.array([moment[1, 2] - moment[2, 1], moment[2, 0] - moment[0, 2], moment[0, 1] - moment[1, 0]]) / 2
    return RigidInertia(float(mass), first, (M[3:, 3:] + M[3:, 3:].T) / 2)


def deformed_inertia(
    samples: MassSamples, X: Array, origin: Array, D: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """J1 (n, 3, 3), J2 (n, n, 3, 3), G1 (n, 3, n) and S2 (3, n, n) of point masses that move with X (d, n).

    With the moments B_j = Σ m s φ_jᵀ and A_ij = Σ m φ_i φ_jᵀ, the inertia of x = s + Σ φ_j η_j is the inertia of
    Σ m x xᵀ = A_00 + Σ η_j (B_j + B_jᵀ) + Σ η_i η_j A_ij. Rotary inertia is constant. With second-order
    displacements D (s, 3, n, n) of the masses, J2, G1 and S2 have further terms, which are linear in D.
    """
    s, n = len(samples.mass), X.shape[1]
    phi = (samples.translation @ X).reshape(s, 3, n)
    weighted, places = samples.mass[:, None, None] * phi, samples.positions - origin
    B = np.einsum("sa,sbj->jab", places, weighted)
    A = (weighted.reshape(s, 3 * n).T @ phi.reshape(s, 3 * n)).reshape(3, n, 3, n).transpose(1, 3, 0, 2)
    second, angular = (A + A.swapaxes(2, 3)) / 2, np.einsum("abc,ijbc->iaj", EPSILON, A)
    if D is None:
        return _inertia(B + B.swapaxes(1, 2)), _inertia(second), angular, np.zeros((3, n, n))
    E = np.einsum("s,sa,sbij->ijab", samples.mass, places, D)
    second, angular = second + E + E.swapaxes(2, 3), angular + 2 * np.einsum("abc,ijbc->iaj", EPSILON, E)
    return _inertia(B + B.swapaxes(1, 2)), _inertia(second), angular, np.einsum("s,saij->aij", samples.mass, D)


def _inertia(moments: Array) -> Array:
    """The inertia tr(X) 1 - X for second moments X (..., 3, 3)."""
    return np.trace(moments, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - moments


def cleaned(array: Array, size: float | Array) -> Array:
    """The array, in which values are replaced by 0 if they are rounding errors relative to the size."""
    return np.where(np.abs(array) <= ROUNDING * size, 0.0, array)
