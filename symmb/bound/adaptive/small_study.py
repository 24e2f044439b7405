"""The base of small studies, and the runs that they ask for. A study with PolynomialChaos() is a row of them."""

from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from symmb._types import Array, Mask
from symmb.bound.adaptive.runs import Runs, relative_errors
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


WAVEFORMS = "waveforms of a phase"
"""The name of this surrogate."""


@dataclass(eq=False)
class Problem:
    """What the small studies of a study share.

    Attributes
    ----------
    runs : all runs until now
    tolerance : largest accepted error of an output, as root mean square over time, divided by the width
    is_patient : whether runs continue until the budget is used up
    known : ranges (n_t, 1) of decided outputs, by their indices
    others : the best ranges of other outputs until now
    refinement : the tensor grids until now, if they are too costly to refine
    """

    runs: Runs
    tolerance: float
    is_patient: bool
    known: dict[int, EstimatedRange] = field(default_factory=dict)
    others: dict[int, EstimatedRange] = field(default_factory=dict)
    refinement: Any = None

    @property
    def open(self) -> Mask:
        """Mask (n_y,) of the outputs that are not decided."""
        return np.array([k not in self.known for k in range(self.runs.shape[1])])

    @property
    def waves(self) -> list[int]:
        """Indices of the outputs whose range comes from waveforms."""
        return [k for k, own in (self.others | self.known).items() if own.surrogate == WAVEFORMS]

    def error(self, k: int, own: EstimatedRange) -> float:
        """The relative error of a range of one output."""
        return float(relative_errors(own.estimate, self.runs.rms_widths()[k : k + 1]).max())

    def add(self, found: dict[int, EstimatedRange], decided: Mask | bool) -> None:
        """Add ranges of outputs that are not decided. They are decided if a mask (n_y,) is True.

        If another range of an output is known, the range with the smaller error stays.
        """
        is_decided = np.broadcast_to(decided, self.runs.shape[1:])
        for k, own in found.items():
            if (other := self.others.pop(k, None)) and self.error(k, other) <= self.error(k, own):
                own = other
            (self.known if is_decided[k] else self.others)[k] = own


class SmallStudy(ABC):
    """A way to bound outputs. Its numbers are fields of a frozen dataclass.

    Attributes
    ----------
    name : of the study
    when : the outputs that it takes, in words
    """

    name: ClassVar[str]
    when: ClassVar[str]


class JointStudy(SmallStudy):
    """A small study of all outputs that are not decided."""

    @abstractmethod
    def accepts(self, problem: Problem) -> bool:
        """Whether the study takes outputs of a problem."""

    @abstractmethod
    def ranges(self, problem: Problem) -> tuple[dict[int, EstimatedRange], Mask]:
        """Make runs. Return ranges (n_t, 1) of outputs, by their indices, and a mask (n_y,) of decided outputs."""


class OutputStudy(SmallStudy):
    """A small study of one output, whose problem is an `OutputProblem` of `outputs`."""

    @abstractmethod
    def accepts(self, problem: Any) -> bool:
        """Whether the study takes the output."""

    @abstractmethod
    def steps(self, problem: Any) -> Attempt:
        """Ask for runs. Return the range of the output, or None if the next small study continues."""


class Studies(tuple[SmallStudy, ...]):
    """Small studies in the order in which they are tried."""

    def __str__(self) -> str:
        lines = list[str]()
        for k, own in enumerate(self, 1):
            numbers = [(each.name, getattr(own, each.name)) for each in fields(own)]  # pyright: ignore[reportArgumentType]
            told = ", ".join(f"{name} {value}" for name, value in numbers if value is not True and value is not False)
            lines += [f"{k}. {own.name}, if {own.when}", *([f"   {told}"] if told else [])]
        return "\n".join(lines)

    __repr__ = __str__
