"""Explicit Runge-Kutta methods without error estimates."""

from collections.abc import Mapping
from typing import NamedTuple


class Tableau(NamedTuple):
    """Butcher's tableau of an explicit method. Weights of slopes are nonzero values by stage.

    Attributes
    ----------
    A : weights of earlier slopes in each stage
    B : weights of the slopes in the step
    C : times of the stages, as fractions of the step
    """

    A: tuple[Mapping[int, float], ...]
    B: Mapping[int, float]
    C: tuple[float, ...]


CLASSICAL = Tableau(
    A=({}, {0: 0.5}, {1: 0.5}, {2: 1.0}), B={0: 1 / 6, 1: 1 / 3, 2: 1 / 3, 3: 1 / 6}, C=(0.0, 0.5, 0.5, 1.0)
)
"""The classical method of order 4 (Kutta 1901)."""
