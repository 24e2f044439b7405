"""Requests for runs by studies of outputs. All studies make one request per round, and share the runs."""

from collections.abc import Generator
from dataclasses import dataclass

from symmb._types import Array
from symmb.bound.bounds.adaptive.surrogate import EstimatedRange


@dataclass
class Nodes:
    """Runs at new nodes (N, d): all of them, or none if too few runs are left."""

    points: Array
    are_run: bool = False


@dataclass
class Checks:
    """Check runs at points (C, d), at most as many as are left."""

    points: Array


@dataclass
class Places:
    """Check runs at some of the places (2, n_t, n_y, d) with large weights (2, n_t, n_y)."""

    places: Array
    weights: Array


@dataclass
class Noise:
    """A measurement of the noise."""


Request = Nodes | Checks | Places | Noise
Steps = Generator[Request, None, EstimatedRange]
"""A study of an output, which requests runs and returns the range."""
