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
    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    loads = []
    for a, b in pairs:
        force = float(a == b) * s
        force[:, a] -= s[:, b] / 2
        force[:, b] -= s[:, a] / 2
        loads.append(samples.translation.T @ (samples.mass[:, None] * force).ravel())
    displacement = np.zeros((len(X), len(pairs)))
    displacement[free] = factorized(K[free][:, free])(np.stack(loads, axis=1)[free])
    forces = np.einsum("ei,eip->ep", axial.force, displacement[axial.dofs])
    bent = X[axial.dofs]
    products = np.einsum("eai,eab,ebj->eij", bent, axial.slopes, bent, optimize=True).reshape(len(forces), -1)
    W = np.zeros((n, n, 3, 3))
    for (a, b), gain in zip(pairs, (forces.T @ products).reshape(-1, n, n), strict=True):
        W[:, :, a, b] = W[:, :, b, a] = gain
    return W
