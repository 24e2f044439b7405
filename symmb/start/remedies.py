"""Advice for assemblies that fail: only what has been tried is told."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, islice, product

from symmb._types import Expr, Indices
from symmb.mechanics import Constraint, rotation
from symmb.model import DAE, Scene
from symmb.start.labels import coordinate_of

Assembles = Callable[[Scene], bool]
"""Whether a scene assembles."""

_TRIES = 300
"""Remedies of a kind that are tried, times the number of velocities."""
_ANGLES = (0.0, 0.5, -0.5, 1.0, -1.0, 1.5, -1.5, 2.0, -2.0, 2.5, -2.5, 3.0, -3.0)
"""Guesses of angles that are tried [rad]."""
_AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
"""Axes of rotations in space that are tried."""
_SHARES = (0.0, 0.5, -0.5, 1.0, -1.0)
"""Guesses of positions that are tried, over the size of the scene."""


@dataclass(frozen=True)
class FailedScene:
    """A scene that does not assemble, the joint to blame, the free displacements and the size of the scene [m]."""

    scene: Scene
    dae: DAE
    joint: str
    free: Indices
    size: float

    @property
    def tries(self) -> int:
        """How many remedies of each kind are tried: fewer for large scenes, whose assembly takes longer."""
        return max(_TRIES // max(self.dae.n_v, 1), 1)


def remedy(failed: FailedScene, assembles: Assembles) -> str:
    """Which listed coordinates of a joint's bodies to leave free, or what to guess."""
    parts = [*_to_free(failed, assembles)]
    guess = _better_guess(failed, assembles)
    parts += [f"give a better guess={guess}"] if guess else []
    if not parts:
        return (
            "None of the other guesses that were tried helps, nor does any listed coordinate that is left free. "
            "Check the points and lengths of this joint and of those close to it."
        )
    text = ", or ".join(parts)
    return text[0].upper() + text[1:] + "."


def other_guess(failed: FailedScene, assembles: Assembles) -> str:
    """A guess at which the rows are regular."""
    guess = _better_guess(failed, assembles)
    return f"Give a guess away from this position{f', such as guess={guess}' if guess else ''}."


def nearer_guess(failed: FailedScene, assembles: Assembles) -> str:
    """A guess from which the frames end parallel."""
    guess = _better_guess(failed, assembles)
    return f"Give a guess nearer to the meant position{f', such as guess={guess}' if guess else ''}."


def _bodies(failed: FailedScene) -> set[str]:
    """Names of the bodies of the joint to blame; none where it is a drive."""
    name = failed.joint.split(".")[0]  # of a listed coordinate: the joint's
    constraints = [e for e in failed.scene.system.elements if isinstance(e, Constraint) and e.name == name]
    return {body.name for constraint in constraints for body in constraint.bodies()}


def _to_free(failed: FailedScene, assembles: Assembles) -> Iterator[str]:
    """Listed coordinates without which the scene assembles: one of some, or two together."""
    scene = failed.scene
    known = {coordinate_of(failed.dae, i) for i in range(failed.dae.n_v)}
    known |= {f"{body.name}.rotation" for body in scene.system.bodies}
    known |= {value.name for value in scene.prescribed.joints}
    listed = [key for key in scene.start if key in known]
    owners = {*_bodies(failed), failed.joint.split(".")[0]}
    listed.sort(key=lambda key: key.split(".")[0] not in owners)
    near = [key for key in listed if key.split(".")[0] in owners] or listed

    def helps(*keys: str) -> bool:
        return assembles(replace(scene, start={k: v for k, v in scene.start.items() if k not in keys}))

    single = [key for key in near[: failed.tries] if helps(key)]
    if single:
        yield f"leave {single[0] if len(single) == 1 else 'one of ' + ', '.join(single)} free"
        return
    pair = next((pair for pair in islice(combinations(listed, 2), failed.tries) if helps(*pair)), None)
    if pair is not None:
        yield f"leave {' and '.join(pair)} free"


def _better_guess(failed: FailedScene, assembles: Assembles) -> str | None:
    """A guess of one coordinate, as text, from which the scene assembles."""
    for key, value, text in islice(_guesses(failed), failed.tries):
        if assembles(replace(failed.scene, guess={**failed.scene.guess, key: value})):
            return f"{{{key!r}: {text}}}"
    return None


def _guesses(failed: FailedScene) -> Iterator[tuple[str, Expr, str]]:
    """Guesses of free coordinates, those of the joint's bodies first: key, value and the value as text."""
    bodies = _bodies(failed)
    free = [coordinate_of(failed.dae, int(i)) for i in reversed(failed.free)]
    yield from _guesses_of([key for key in free if key.split(".")[0] in bodies], failed.size)
    yield from _guesses_of([key for key in free if key.split(".")[0] not in bodies], failed.size)


def _guesses_of(free: list[str], size: float) -> Iterator[tuple[str, Expr, str]]:
    """Guesses of coordinates, rotations first."""
    turned = dict.fromkeys(key.rpartition("_")[0] for key in free if ".rotation_" in key)
    for key in turned:
        for axis, angle in product(_AXES, _ANGLES[1:]):
            yield key, rotation(axis, angle), f"rotation({axis}, {angle})"
    for key, angle in product([key for key in free if key.endswith(".theta")], _ANGLES):
        yield key, angle, str(angle)
    for key, share in product([key for key in free if key[-2:] in (".x", ".y", ".z")], _SHARES):
        value = float(f"{share * size:.2g}")
        yield key, value, str(value)
