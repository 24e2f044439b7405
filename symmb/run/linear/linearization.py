"""The linearisation of a scene at its start, or of a run at an output time."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import cast

import numpy as np

from symmb._errors import DeclarationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._options import require_names
from symmb._types import Array, Indices
from symmb.equations.model import DAE, Scene
from symmb.run.formulations import Formulation, formulations
from symmb.run.linear.doubts import doubts_of
from symmb.run.linear.inputs import with_inputs, with_uniform
from symmb.run.linear.linear_equations import Blocks, LinearEquations, independent
from symmb.run.linear.motion import Origin
from symmb.run.linear.point import point_of, require_smooth, started
from symmb.run.linear.result import Linearization
from symmb.run.linear.steady import SteadyMotion
from symmb.run.simulation import Trajectory
from symmb.run.verification import attached_loads, with_loads


@kept_interrupts()
def linearize(
    subject: Scene | Trajectory,
    time: float | str | None = None,
    parameters: Mapping[str, float] | None = None,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] | None = None,
) -> Linearization:
    """Linearise a scene at its start, or a run at one of its times.

    Derivatives are exact. Constraints are eliminated. The states are independent displacements, independent velocities
    and first-order states.

    Parameters
    ----------
    subject : Scene or Trajectory
        a scene that starts in equilibrium or in a steady motion, or a run
    time : float or str, optional
        an output time of the run [s], or a text with a unit; default: the last output time
    parameters : mapping, optional
        values of parameters instead of the nominal values, for a scene
    inputs : names
        names of actuators, inputs or parameters; for an actuator, the input is an additional force or torque
    outputs : names, optional
        names of outputs; default: all outputs of the scene over time

    Raises
    ------
    DeclarationError
        If a name is unknown, an input moves constraints, or the equations have no derivative at the state
    AssemblyError, SimulationError
        If the scene cannot be started

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> rod = mb.Body("rod", mass=3.0, inertia=1.0)
    >>> pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, 1))
    >>> scene = mb.Scene(mb.System(rod, pin, mb.Gravity(0, -9.81)), equilibrium=True)
    >>> lin = mb.linearize(scene)
    >>> float((2 * np.pi * lin.frequencies[0]) ** 2 * 4 / 3 / 9.81)  # inertia 4 kg m^2 about the pin
    1.0
    """
    scene, values, t, of_bodies = point_of(subject, time, parameters)
    known = scene.curve_names
    names = require_names("outputs", "output", known if outputs is None else outputs, known)
    chosen = [known.index(name) for name in names]
    extended, input_numbers = with_inputs(scene, inputs)
    extended, starts, uniform = with_uniform(extended)
    formulation, loads = formulation_of(extended), attached_loads(extended)
    formulation = with_loads(extended, formulation, loads)
    p = np.array([*values.values(), *[0.0] * (len(extended.system.parameters) - len(values))])
    point = started(extended, formulation, p, t, of_bodies)
    equations = LinearEquations(formulation, (*input_numbers, *starts))
    require_smooth(formulation, point, equations)
    blocks = equations.blocks(point.x[None], p[None], t)
    _require_free_inputs(inputs, blocks)
    _require_slopes_of_outputs(names, blocks.C[0][chosen], blocks.D[0][chosen])
    free = free_states(equations, blocks, len(uniform))
    motion = SteadyMotion(equations, point, blocks, free)
    doubts = doubts_of(extended, motion, blocks, loads)
    n, n_u, more = len(free), len(inputs), np.zeros((len(motion.lift), len(uniform)))
    lift = np.hstack([motion.lift, more])
    # Columns for positions and velocities of uniform motions at time t, from the columns for their start values.
    of_starts = blocks.D[0][:, n_u:].copy()
    of_starts[:, 1::2] -= (t - scene.times[0]) * of_starts[:, ::2]
    whole = np.zeros((n + len(uniform),) * 2)
    whole[:n, :n] = motion.A
    whole[np.arange(n, len(whole), 2), np.arange(n + 1, len(whole), 2)] = 1.0
    result = Linearization(
        name=scene.name,
        A=whole,
        B=np.vstack([blocks.B[0][free, :n_u], np.zeros((len(uniform), n_u))]),
        C=np.hstack([blocks.C[0] @ motion.lift, of_starts])[chosen],
        D=blocks.D[0][chosen, :n_u],
        states=(*(state_names(formulation.dae)[k] for k in free), *uniform),
        inputs=tuple(inputs),
        outputs=tuple(names),
        time=t,
        parameters=values,
        doubts=doubts,
        shapes=blocks.bodies[0] @ lift,
        displacements=displacement_names((formulation.bodies or formulation).dae),
        origin=Origin(extended, formulation, point, lift),
    )
    warn_of(result.doubts, f"linearize({scene.name})")
    return result


def formulation_of(scene: Scene) -> Formulation:
    """The formulation in joint coordinates if possible, because joint coordinates do not turn with a spinning body."""
    can_choose = scene.coordinates is None and not scene.system.collected.gated
    if can_choose and scene.system.joint_space().joints.names:
        with suppress(DeclarationError):
            scene = replace(scene, coordinates="joint")
            return cast(Formulation, formulations(scene)[1])
    bodies, joints, *_ = formulations(replace(scene, coordinates="body") if scene.coordinates is None else scene)
    return joints or bodies


def _require_slopes_of_outputs(names: Sequence[str], *parts: Array) -> None:
    """Raise a DeclarationError if an output has no derivative, such as a norm at 0."""
    for name, *rows in zip(names, *parts, strict=True):
        if not all(np.isfinite(row).all() for row in rows):
            raise DeclarationError(
                f"linearize: output {name!r} has no finite derivative at this state (example: a square root at 0). "
                "Remove this output, or linearise at a state nearby."
            )


def _require_free_inputs(inputs: Sequence[str], blocks: Blocks) -> None:
    """Raise a DeclarationError if an input moves constraints. States would then depend on the rate of the input."""
    moved = np.abs(blocks.row_inputs[0]).max(axis=0, initial=0.0)
    for name, size in zip(inputs, moved, strict=False):
        # Slope of a constraint with respect to an input, over its largest slope. Smaller slopes are rounding errors.
        if size > 1e-12 * np.abs(blocks.rows[0]).max(initial=0.0):
            raise DeclarationError(
                f"linearize: input {name!r} moves constraints, such as a length or a position. Use inputs that change "
                "forces only."
            )


def free_states(equations: LinearEquations, blocks: Blocks, others: int = 0) -> Indices:
    """Numbers of independent displacements, velocities and first-order states, without states of events.

    `others` is the number of further states. DeclarationError is raised if there are no states at all.
    """
    dae = equations.dae
    flags = 2 * dae.n_v + dae.impacts.states if dae.impacts is not None else np.zeros(0, dtype=np.intp)
    free = np.setdiff1d(independent(equations, blocks), flags)
    if not len(free) + others:
        raise DeclarationError("linearize: no part of the scene can move freely. Linearise a scene with free motions.")
    return free


def state_names(dae: DAE) -> tuple[str, ...]:
    """Names of displacements, velocities and first-order states."""
    return (*displacement_names(dae), *dae.v_names, *dae.s_names)


def displacement_names(dae: DAE) -> tuple[str, ...]:
    """Names of displacements along velocities: "rod.x" for "rod.vx", "top.rotation_x" for "top.omega_x"."""
    found = []
    for owner, _, part in (name.rpartition(".") for name in dae.v_names):
        other = part.removesuffix("_rate").removesuffix("_dot").replace("omega_", "rotation_")
        found.append(f"{owner}.{_DISPLACEMENTS.get(part, other)}")
    return tuple(found)


_DISPLACEMENTS = {"vx": "x", "vy": "y", "vz": "z", "omega": "theta"}
