"""Remedies for assemblies that fail. Each remedy is tried before a message suggests it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import combinations, islice

from symmb._types import Expr, Indices
from symmb.declare.mechanics import Constraint, Joint, rotation
from symmb.equations.model import DAE, Scene, is_linear
from symmb.equations.start.labels import coordinate_of

_GUESSES = [0.0, *(sign * half / 2 for half in range(1, 7) for sign in (1, -1))]
"""Guesses that are tried [rad, fraction of the size of the scene]."""


Assembles = Callable[[Scene], bool]
"""Function that returns whether a scene assembles."""


def advice(scene: Scene, dae: DAE, joint: str, free: Indices, size: float, assembles: Assembles) -> str:
    """A text that names listed coordinates to remove, or a coordinate to guess. Bodies of the joint are tried first.

    `free` are the indices of displacements that are not listed, and `size` [m] is the size of the scene.
    """
    # Large scenes take longer to assemble, so fewer remedies are tried.
    name, tries = joint.split(".")[0], max(300 // max(dae.n_v, 1), 1)
    joints = [e for e in scene.system.elements if isinstance(e, Constraint) and e.name == name]
    owners = {name, *(body.name for e in joints for body in e.bodies())}
    listed = [k for k in scene.start if k not in dae.v_names and not k.endswith((".omega", "_rate"))]
    near = [key for key in listed if key.split(".")[0] in owners]
    others = [key for key in listed if key not in near]
    parts = [*_to_free(scene, near, others, tries, assembles)]
    displacements = sorted(reversed(free.tolist()), key=lambda i: is_linear(dae.v_names[i]))
    displacements.sort(key=lambda i: dae.v_names[i].split(".")[0] not in owners)
    for key, value, text in islice(_guesses(dae, displacements, size), tries):
        if assembles(replace(scene, guess={**scene.guess, key: value})):
            parts.append(f"give a better guess={text}")
            break
    if not parts:
        return (
            "Other guesses and fewer listed coordinates were tried without success. "
            "Check the points and lengths of this joint and of neighbouring joints."
        )
    text = ", or ".join(parts)
    return text[0].upper() + text[1:] + "."


def reminder(scene: Scene, joint: str) -> str:
    """A sentence on a property of a joint that users forget, such as the axis of a PlanarJoint; '' for other joints."""
    return "".join(
        f" {e.also}" for e in scene.system.elements if isinstance(e, Joint) and e.name == joint.split(".")[0] and e.also
    )


def _to_free(scene: Scene, near: list[str], others: list[str], tries: int, assembles: Assembles) -> Iterator[str]:
    """Texts that name listed coordinates to remove. The scene assembles without the named coordinates."""

    def helps(*keys: str) -> bool:
        return assembles(replace(scene, start={k: v for k, v in scene.start.items() if k not in keys}))

    helpful = [key for key in (near or others)[:tries] if helps(key)]
    if helpful:
        yield f"remove {'one of ' * (len(helpful) > 1)}{', '.join(helpful)} from start"
        return
    pairs = islice(combinations([*near, *others], 2), tries)
    yield from islice((f"remove {' and '.join(pair)} from start" for pair in pairs if helps(*pair)), 1)


def _guesses(dae: DAE, displacements: Iterable[int], size: float) -> Iterator[tuple[str, Expr, str]]:
    """Guesses of coordinates: key, value, and both as text."""
    for i in displacements:
        body, _, part = coordinate_of(dae, i).rpartition(".")
        for share in _GUESSES:
            if part.startswith("rotation_"):
                axis = tuple(int(part.endswith(c)) for c in "xyz")
                key = f"{body}.rotation"
                yield key, rotation(axis, share), f"{{{key!r}: rotation({axis}, {share})}}"
            elif part in ("theta", "x", "y", "z"):
                value = share if part == "theta" else float(f"{share * size:.2g}")
                yield f"{body}.{part}", value, f"{{'{body}.{part}': {value}}}"
