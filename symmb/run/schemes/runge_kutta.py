"""Explicit Runge-Kutta methods without error estimates."""

from collections.abc import Mapping
from typing import NamedTuple


class Tableau(NamedTuple):
    """Weights A of slopes in each stage and B in the step, by stage, and times C as fractions of the step."""

    A: tuple[Mapping[int, float], ...]
    B: Mapping[int, float]
    C: tuple[float, ...]


CLASSICAL = Tableau(({}, {0: 0.5}, {1: 0.5}, {2: 1.0}), {0: 1 / 6, 1: 1 / 3, 2: 1 / 3, 3: 1 / 6}, (0.0, 0.5, 0.5, 1.0))
"""The classical method of order 4 (Kutta 1901)."""
