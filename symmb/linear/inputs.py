"""Inputs of a linearisation: additional forces of actuators, and parameters."""

from collections.abc import Sequence
from dataclasses import replace

from symmb._errors import DeclarationError
from symmb._names import did_you_mean
from symmb.mechanics import Actuator
from symmb.model import Scene


def with_inputs(scene: Scene, inputs: Sequence[str]) -> tuple[Scene, tuple[int, ...]]:
    """The scene with a parameter for the additional force of each actuator, and the numbers of all input parameters.

    Raises
    ------
    DeclarationError       if a name is neither of an actuator nor of a parameter, or repeats
    """
    if isinstance(inputs, str):
        raise DeclarationError(f'inputs: expected a list of names, got the text {inputs!r}. Write ["{inputs}"].')
    if not isinstance(inputs, Sequence):
        raise DeclarationError(f"inputs: expected a list of names, got {inputs!r}.")
    actuators = {e.name: e for e in scene.system.elements if isinstance(e, Actuator)}
    parameters = scene.system.parameters
    known = (*actuators, *parameters)
    for name in inputs:
        if name not in known:
            raise DeclarationError(f"inputs: no actuator or parameter {name!r}.{did_you_mean(str(name), known)}")
    if len(set(inputs)) < len(inputs):
        raise DeclarationError(f"inputs: names repeat: {', '.join(inputs)}.")
    forces = {f"input_{k}": actuators[name] for k, name in enumerate(inputs) if name in actuators}
    if not forces:
        return scene, tuple(list(parameters).index(name) for name in inputs)
    more = parameters.with_more(**dict.fromkeys(forces, 0.0))
    pushed = [
        Actuator(f"{name}_{actuator.name}", actuator.joint, getattr(more, name), coordinate=actuator.coordinate)
        for name, actuator in forces.items()
    ]
    numbers = {actuator.name: list(more).index(name) for name, actuator in forces.items()}
    extended = replace(scene, system=scene.system.with_elements(pushed, more))
    return extended, tuple(numbers[name] if name in numbers else list(more).index(name) for name in inputs)
