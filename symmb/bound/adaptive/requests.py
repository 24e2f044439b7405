"""Requests for runs by studies of outputs. Each study makes one request per round, and all studies use all runs."""

from collections.abc import Generator
from dataclasses import dataclass

from symmb._types import Array
from symmb.bound.adaptive.surrogate import EstimatedRange


@dataclass
class Nodes:
    """Runs at new nodes (N, d). If too few runs are left for all nodes, no node is run."""

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
    """A measurement of the noise of runs."""


Request = Nodes | Checks | Places | Noise
Steps = Generator[Request, None, EstimatedRange]
"""A study of an output, which requests runs and returns the range."""
Attempt = Generator[Request, None, EstimatedRange | None]
"""A small study of an output, which returns None if the next small study continues."""
