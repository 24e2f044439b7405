"""Flexible bodies that joints hold at two nodes between which no mode stretches them."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from symmb.mechanics import Constraint, FlexibleBody
from symmb.model import Scene
from symmb.start.tolerances import NEGLIGIBLE


def unstretched(scene: Scene) -> Iterator[str]:
    """What the modes of such a body need, in a sentence for each body: without it the joints depend on each other."""
    joints = [element for element in scene.system.elements if isinstance(element, Constraint)]
    for body in scene.system.bodies:
        if not isinstance(body, FlexibleBody) or not len(body.modes.stiffness):
            continue
        carriers = [carrier for joint in joints for carrier in joint.bodies()]
        held = sorted({n for carrier in carriers if (n := body.number_of(carrier)) is not None})
        shapes, places = body.modes.shapes, body.modes.positions
        for a, b in combinations(held, 2):
            line = (places[b] - places[a]) / max(float(np.linalg.norm(places[b] - places[a])), 1e-300)
            if np.abs(line @ (shapes[b] - shapes[a])).max() <= NEGLIGIBLE * np.abs(shapes).max():
                yield (
                    f"FlexibleBody {body.name!r}: joints hold its nodes {a} and {b}, and none of its modes changes "
                    f"their distance. Compute its modes with interfaces=[{a}, {b}], but for a clamped one, and with "
                    "all shapes of these."
                )
                break
