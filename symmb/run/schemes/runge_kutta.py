"""Coefficients of the classical Runge-Kutta method of order 4 (Kutta 1901). Rows have nonzero values by stage."""

A = ({}, {0: 0.5}, {1: 0.5}, {2: 1.0})
"""Weights of earlier slopes in each stage."""

C = (0.0, 0.5, 0.5, 1.0)
"""Times of the stages, as fractions of the step."""

B = {0: 1 / 6, 1: 1 / 3, 2: 1 / 3, 3: 1 / 6}
"""Weights of the slopes in the step."""
