"""A free beam of Euler and Bernoulli in space: consistent matrices, written out from the textbook."""

import numpy as np

E, NU, DENSITY = 2.1e11, 0.3, 7850.0
LENGTH, WIDTH, HEIGHT = 1.0, 0.02, 0.01
AREA = WIDTH * HEIGHT
I_Y, I_Z = WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
"""About the axes y and z of the section: it bends along z, and along y."""
J = I_Y + I_Z


def free_beam(elements):
    """Positions (k, 3), K and M (6 k, 6 k) of a beam along x, free in space, without rotary inertia of bending."""
    h, k = LENGTH / elements, elements + 1
    K, M = np.zeros((6 * k, 6 * k)), np.zeros((6 * k, 6 * k))
    bar, mass = np.array([[1, -1], [-1, 1]]) / h, h * np.array([[2, 1], [1, 2]]) / 6
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h], [-12, -6 * h, 12, -6 * h],
                     [6 * h, 2 * h * h, -6 * h, 4 * h * h]]) / h**3  # fmt: skip
    move = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                     [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]) * h / 420  # fmt: skip
    down = np.diag([1, -1, 1, -1])  # a rotation about y lowers the tip
    shear = E / (2 + 2 * NU)
    for e in range(elements):
        at = 6 * e
        for rows, stiffness, inertia in (
            ([0, 6], E * AREA * bar, DENSITY * AREA * mass),
            ([3, 9], shear * J * bar, DENSITY * J * mass),
            ([1, 5, 7, 11], E * I_Z * bend, DENSITY * AREA * move),
            ([2, 4, 8, 10], E * I_Y * down @ bend @ down, DENSITY * AREA * down @ move @ down),
        ):
            place = np.ix_(at + np.array(rows), at + np.array(rows))
            K[place] += stiffness
            M[place] += inertia
    return np.column_stack([np.linspace(0, LENGTH, k), np.zeros(k), np.zeros(k)]), K, M
