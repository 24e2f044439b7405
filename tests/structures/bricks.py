"""A soft bar of eight-node bricks: matrices as another program would give them."""

import numpy as np
from scipy.sparse import coo_array, csc_array

SIZE, CELLS = (0.6, 0.05, 0.03), (12, 2, 2)
E, NU, DENSITY = 2e8, 0.3, 1200.0
G = 1 / np.sqrt(3)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def bar() -> tuple[np.ndarray, csc_array, csc_array]:
    """Nodes (k, 3) about the centre of mass, stiffness and mass (3 k, 3 k), lumped at the nodes."""
    counts = np.array(CELLS) + 1
    sides = [np.linspace(-size / 2, size / 2, n) for size, n in zip(SIZE, counts, strict=True)]
    positions = np.stack(np.meshgrid(*sides, indexing="ij")).reshape(3, -1).T
    cell = np.array(SIZE) / CELLS
    stiffness, mass = _brick(cell)
    number = np.arange(len(positions)).reshape(counts)
    offsets = ((CORNERS + 1) / 2).astype(int)
    nodes = np.array([[number[tuple(np.add(at, o))] for o in offsets] for at in np.ndindex(*CELLS)])
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
    where = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    d = 3 * len(positions)

    def assembled(A: np.ndarray) -> csc_array:
        return csc_array(coo_array((np.tile(A.ravel(), len(nodes)), where), shape=(d, d)))

    return positions, assembled(stiffness), assembled(mass)


def _brick(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    lame, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    D = np.diag([2 * mu] * 3 + [mu] * 3)
    D[:3, :3] += lame
    K, volume = np.zeros((24, 24)), np.prod(cell) / 8
    for point in CORNERS * G:
        terms = 1 + CORNERS * point
        slopes = (
            np.stack([CORNERS[:, i] * np.delete(terms, i, axis=1).prod(axis=1) / 8 for i in range(3)])
            * (2 / cell)[:, None]
        )
        B = np.zeros((6, 24))
        for i in range(3):
            B[i, i::3] = slopes[i]
        for row, (i, j) in enumerate(((1, 2), (0, 2), (0, 1)), start=3):
            B[row, i::3], B[row, j::3] = slopes[j], slopes[i]
        K += volume * B.T @ D @ B
    return (K + K.T) / 2, np.eye(24) * DENSITY * volume
