"""What studies of outputs ask runs for. All studies ask once a round, and share what is run."""

from collections.abc import Generator
from dataclasses import dataclass

from symmb._types import Array
from symmb.bound.bounds.adaptive.surrogate import EstimatedRange


@dataclass
class Nodes:
    """Runs at new nodes (N, d), all of them or, if too few are left, none."""

    points: Array
    are_run: bool = False


@dataclass
class Checks:
    """Check runs at points (C, d), as many as are left."""

    points: Array


@dataclass
class Places:
    """Check runs at some of the places (2, n_t, n_y, d), where the weights (2, n_t, n_y) are large."""

    places: Array
    weights: Array


@dataclass
class Noise:
    """The noise is measured."""


Request = Nodes | Checks | Places | Noise
Steps = Generator[Request, None, EstimatedRange]
"""A study of an output, which asks for runs and ends with the range."""
