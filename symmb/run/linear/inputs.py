"""Inputs of a linearisation: forces of actuators, parameters, and start values of uniform motions."""

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from symmb._errors import DeclarationError
from symmb._options import require_names
from symmb.declare.mechanics import Actuator, Figure, Motor
from symmb.equations.model import Scene


def with_inputs(scene: Scene, inputs: Sequence[str]) -> tuple[Scene, tuple[int, ...]]:
    """The scene with parameters instead of forces of actuators and inputs, and the indices of these parameters.

    DeclarationError is raised if a name is not an actuator, an input or a parameter, or is listed twice.
    """
    actuators = {e.name: e for e in scene.system.elements if isinstance(e, Actuator)}
    declared = scene.system.inputs
    motors = [e.name for e in scene.system.elements if isinstance(e, Motor)]
    known = (*actuators, *declared, *scene.system.parameters, *motors)
    inputs = require_names("inputs", "actuator, input or parameter", inputs, known)
    if name := next((name for name in inputs if name in motors), None):
        raise DeclarationError(
            f"inputs: the input of Motor {name!r} is its voltage. Declare u = mb.Input('u') and voltage=u.value, and "
            "pass inputs=['u']."
        )
    if len(set(inputs)) < len(inputs):
        raise DeclarationError(f"inputs: a name is listed twice: {', '.join(inputs)}. List each name once.")
    scene = scene.with_inputs([name for name in declared if name in inputs])
    parameters = scene.system.parameters
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


def with_uniform(scene: Scene) -> tuple[Scene, tuple[int, ...], tuple[str, ...]]:
    """The scene with parameters for start values of uniform motions, and the indices and names of these parameters.

    A coordinate moves uniformly if no force depends on it. Such a coordinate is not a state of the equations of motion,
    but outputs may contain it. Such a coordinate has two parameters: position and velocity at the start.
    """
    system = scene.system
    curves = [y for y, _ in scene.asked.values() if not isinstance(y, Figure)]
    bound = [system.bind(y, "output", also=system.solved_hashes) for y in curves]
    y = ca.vertcat(*bound) if bound else ca.SX(0, 1)
    touched = [(x, v) for x, sx, v, sv in system.collected.decoupled if ca.depends_on(y, ca.vertcat(sx, sv))]
    names = tuple(name for pair in touched for name in pair)
    if not names:
        return scene, (), ()
    more = system.parameters.with_more(**{f"uniform_{k}": 0.0 for k in range(len(names))})
    start = {
        name: scene.prescribed.drift.get(name, ca.SX(0)) + getattr(more, f"uniform_{k}") for k, name in enumerate(names)
    }
    extended = replace(scene, system=system.with_elements((), more), start={**scene.start, **start})
    return extended, tuple(list(more).index(f"uniform_{k}") for k in range(len(names))), names
