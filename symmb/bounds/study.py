"""What bounds are made from: kept with them, so that the runs that attain them can be found again."""

from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, cast

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array, Executor, Indices
from symmb.black_boxes import Progress, Reduction, S, Samples, Simulator
from symmb.bounds.reductions import together
from symmb.model import Box, Scene
from symmb.simulation import DAESimulator


class Bounding(Protocol):
    """A method that bounds the outputs of a simulator over a box."""

    def bounds(self, simulator: Simulator, box: Box) -> object: ...


@dataclass(frozen=True, eq=False)
class Sample:
    """A run of a study: its value of the output, and the parameters of itself and of those that ran beside it.

    A simulator chooses its steps for some samples together, so that run `index` of the block P (n, d) is repeated to
    the last bit only in its block.
    """

    value: float
    P: Array
    index: int


@dataclass(frozen=True, eq=False)
class Study:
    """The scene, its simulator, the method and the box of bounds."""

    scene: Scene
    simulator: DAESimulator
    method: Bounding
    box: Box

    def attaining(self, output: str, time: int) -> tuple[Sample, Sample]:
        """The runs with the least and the largest value of an output at a time, given by its number.

        The method runs once more, as its runs were not kept.

        Raises
        ------
        DeclarationError       if the method runs no samples
        """
        watched = _Watched(self.simulator, self.simulator.outputs.index(output), time)
        self.method.bounds(watched, self.box)
        if not watched.seen:
            raise DeclarationError(
                f"{self.method!r} keeps no runs that attain its bounds, which view would draw. "
                "Use PolynomialChaos() or Vertex()."
            )
        return min(watched.seen, key=lambda s: s.value), max(watched.seen, key=lambda s: s.value)


_TOGETHER = 64
"""Samples of a block that is repeated: a multiple of those that share their steps."""


class _Watched(DAESimulator):
    """A simulator that notes the samples with the least and the largest value of an output at a time."""

    def __init__(self, simulator: DAESimulator, output: int, time: int) -> None:
        self.__dict__ |= simulator.__dict__
        self._output, self._time = output, time
        self.seen: list[Sample] = []

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        extremes: Reduction[Any] = Reduction(tuple, partial(_note, self._output, self._time), lambda a, b: a + b)
        noted, result = super().stream(P, together(extremes, reduction), executor, progress)
        for value, number, first, last in noted:
            begin = first + (number - first) // _TOGETHER * _TOGETHER
            self.seen.append(Sample(value, np.array(P[begin : min(begin + _TOGETHER, last + 1)]), number - begin))
        return cast(S, result)


def _note(output: int, time: int, state: tuple, block: Samples, indices: Indices) -> tuple:
    """(value, sample number, first and last of its block) of both extremes of a block are added to the state."""
    ok = np.flatnonzero(block.ok)
    if not ok.size:
        return state
    values = block.Y[ok, time, output]
    both = (ok[values.argmin()], ok[values.argmax()])
    return state + tuple(
        (float(block.Y[k, time, output]), int(indices[k]), int(indices[0]), int(indices[-1])) for k in both
    )


def study_of(subject: Scene | Simulator, simulator: Simulator, method: Bounding, box: Box) -> Study | None:
    """The study of a scene; None for other simulators, which have no mechanism."""
    if isinstance(subject, Scene) and isinstance(simulator, DAESimulator):
        return Study(subject, simulator, method, box)
    return None
