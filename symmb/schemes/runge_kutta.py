"""Tableaus of explicit Runge-Kutta methods: weights b, nodes c, matrix a."""

import numpy as np

CLASSICAL = (
    np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
    np.array([0.0, 0.5, 0.5, 1.0]),
    np.array([[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
)
"""The classical method of order 4 (Kutta 1901)."""
