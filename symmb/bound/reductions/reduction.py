"""The base of reductions: features of a box that are taken out before a study, and put back into its bounds."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from symmb._errors import PropagationError
from symmb._types import Executor
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method
from symmb.connect import Simulator
from symmb.equations.model import Box


@dataclass(frozen=True)
class Reduced:
    """A study with a feature that a reduction takes out."""

    method: Method
    simulator: Simulator
    box: Box
    executor: Executor | None


class Reduction(ABC):
    """A feature of boxes without which methods are simpler."""

    @abstractmethod
    def accepts(self, method: Method, box: Box) -> bool:
        """Whether the box has the feature, and the method does not handle it."""

    @abstractmethod
    def apply(self, method: Method, box: Box) -> Sequence[Box]:
        """The boxes without the feature. Each has a study. PropagationError is raised if the method cannot use them."""

    @abstractmethod
    def invert(self, study: Reduced, found: Sequence[Bounds | PropagationError]) -> Bounds:
        """The bounds over the box of a study, from the bounds over each of the boxes without the feature.

        If a box has no bounds, its error stands in their place.
        """
