"""What the centrifugal forces of a steady rotation do to the stiffness of beams."""

import numpy as np

from symmb._types import Array, Indices
from symmb.flexible._eigen import factorized
from symmb.flexible._samples import Samples, Sparse
from symmb.flexible.beams import AxialForces


def centrifugal_stiffness(
    K: Sparse, free: Indices, samples: Samples, axial: AxialForces, X: Array, origin: Array
) -> Array:
    """W (n, n, 3, 3): turning steadily with ω about the origin adds Σ ω_k ω_l W[:, :, k, l] to the stiffness.

    The force on a mass at s is m (ω² s - ω (ω·s)). By a static solution of the structure, held where it is not `free`,
    each of the six products of ω gives axial forces N and so the geometric stiffness ∫ N (v'² + w'²) dx of the
    shapes X (d, n).
    """
    s, n = samples.positions - origin, X.shape[1]
    static = factorized(K[free][:, free])
    bent = np.einsum("egpi,ein->egpn", axial.slopes, X[axial.dofs], optimize=True)
    W = np.zeros((n, n, 3, 3))
    for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        pull = float(a == b) * s
        pull[:, a] -= s[:, b] / 2
        pull[:, b] -= s[:, a] / 2
        loads = samples.mass[:, None] * pull
        displacements = np.zeros(len(X))
        displacements[free] = static((samples.translation.T @ loads.ravel())[free])
        forces = axial.weights * axial.forces(displacements, loads[: axial.weights.size])
        W[:, :, a, b] = W[:, :, b, a] = np.einsum("eg,egpi,egpj->ij", forces, bent, bent, optimize=True)
    return W
