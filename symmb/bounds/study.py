"""What bounds are made from: kept with them, so that views can make more runs."""

from dataclasses import dataclass

from symmb.black_boxes import Simulator
from symmb.model import Box, Scene
from symmb.simulation import DAESimulator


@dataclass(frozen=True, eq=False)
class Study:
    """The scene, its simulator and the box of bounds."""

    scene: Scene
    simulator: DAESimulator
    box: Box


def study_of(subject: Scene | Simulator, simulator: Simulator, box: Box) -> Study | None:
    """The study of a scene; None for other simulators, which have no mechanism."""
    if isinstance(subject, Scene) and isinstance(simulator, DAESimulator):
        return Study(subject, simulator, box)
    return None
