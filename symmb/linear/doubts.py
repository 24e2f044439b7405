"""What cannot be trusted about a linearisation."""

import numpy as np

from symmb.linear.high_frequencies import doubts_of_loads
from symmb.linear.linear_equations import Blocks
from symmb.linear.steady import DOUBT, SteadyMotion
from symmb.model import Scene
from symmb.verification import AttachedLoads, deformation_doubts

_TIMES, _GOLDEN = 21, 0.6180339887
"""Later times at which A is compared, and the share of the horizon between them: they do not fall on whole periods."""
_CHANGE = 1e-3
"""Change of an entry of A, over its largest one, from which it is not constant."""


def doubts_of(scene: Scene, motion: SteadyMotion, blocks: Blocks, loads: tuple[AttachedLoads, ...]) -> tuple[str, ...]:
    """Doubts about a scene that is linear next to a motion. The loads of its flexible bodies are the last outputs."""
    point, formulation = motion.point, motion.equations.formulation
    dae, X = formulation.in_bodies(point.x[None], point.p)
    own = motion.doubts or ((DOUBT,) if _varies(scene, motion, blocks) else ())
    deformed = deformation_doubts(scene, dae, X, point.p, np.array([point.t])) if loads else ()
    return (*own, *deformed, *doubts_of_loads(loads, motion, blocks))


def _varies(scene: Scene, motion: SteadyMotion, blocks: Blocks) -> bool:
    """Whether coefficients of the equations change with time where nothing moves, as a stiffness that is a law of t."""
    point, end = motion.point, float(scene.times[-1])
    if motion.moves or end <= point.t:
        return False
    for k in range(1, _TIMES + 1):
        A = motion.equations.blocks(point.x[None], point.p[None], point.t + (end - point.t) * (k * _GOLDEN % 1)).A
        if np.abs(A - blocks.A).max(initial=0.0) > _CHANGE * np.abs(blocks.A).max(initial=0.0):
            return True
    return False
