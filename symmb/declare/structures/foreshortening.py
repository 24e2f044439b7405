"""Foreshortening of beams in bending, the cause of geometric stiffening."""

import numpy as np

from symmb._types import Array, Indices
from symmb.declare.structures.beam_element import WEIGHTS, XI
from symmb.declare.structures.beams import AxialForces
from symmb.declare.structures.eigenmodes import factorized
from symmb.declare.structures.mass_samples import MassSamples, Sparse


def foreshortening(K: Sparse, free: Indices, samples: MassSamples, axial: AxialForces, X: Array) -> tuple[Array, Array]:
    """D (d, n, n) and (s, 3, n, n): second-order displacements Σ η_i η_j D[:, i, j] of degrees of freedom and samples.

    Bending by v and w shortens the distance of the ends of an element by ½ ∫ (v'² + w'²) dx. The structure deforms as
    if its elements were shorter by this amount, and only `free` degrees of freedom move.
    """
    n, e = X.shape[1], len(axial.axis)
    bent = np.einsum("egpi,ein->egpn", axial.slopes, X[axial.dofs], optimize=True)
    drawn = -0.5 * np.einsum("egpi,egpj->egij", bent, bent)
    short = np.einsum("eg,egij->eij", axial.weights, drawn)
    loads = np.zeros((len(X), n, n))
    np.add.at(loads, axial.dofs, np.einsum("ed,eij->edij", axial.force, short))
    pairs = np.triu_indices(n)
    D = np.zeros((len(X), n, n))
    D[free[:, None], pairs[0], pairs[1]] = factorized(K[free][:, free])(loads[free][:, *pairs])
    D[:, pairs[1], pairs[0]] = D[:, pairs[0], pairs[1]]
    at = (samples.translation @ D.reshape(len(X), n * n)).reshape(len(samples.mass), 3, n, n)
    # Displacements along an element are linear between its nodes, but foreshortening is not linear.
    within = np.einsum("gh,eh,ehij->egij", _PARTIAL, axial.weights, drawn) - np.einsum("g,eij->egij", XI, short)
    at[: e * XI.size] += np.einsum("ea,egij->egaij", axial.axis, within).reshape(e * XI.size, 3, n, n)
    return D, at


def _partial() -> Array:
    """Weights (g, g) of the Gauss points for integrals up to each Gauss point, exact for polynomials."""
    legendre = np.polynomial.legendre
    series = np.linalg.inv(legendre.legvander(2 * XI - 1, XI.size - 1))
    integrals = [legendre.legval(2 * XI - 1, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(XI.size)]
    return np.array(integrals).T @ series / WEIGHTS


_PARTIAL = _partial()
